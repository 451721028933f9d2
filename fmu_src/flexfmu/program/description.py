"""What the FMI layer needs of a body besides mechanics: the table of variables as arrays of a program."""

from collections.abc import Sequence

import numpy as np

from ..model.reduced_body import ReducedBody
from .compile import Draft
from .variables import CORE_DIAGNOSTICS, CORE_PARAMETERS, FIXED, Group, Variable

_TYPES = ("Real", "Integer", "Boolean", "String")


def variable_fields(body: ReducedBody, table: Sequence[Variable]) -> Draft:
    """Fields of a program that describe its variables.

    Parameters
    ----------
    body : ReducedBody
    table : sequence of Variable
        By value reference.

    Returns
    -------
    Draft
    """
    groups = list(Group)
    counts = dict.fromkeys(Group, 0)
    index = []
    for variable in table:
        index.append(_core_number(body, variable, counts[variable.group]))
        counts[variable.group] += 1
    texts = b"".join("".join(f"{text}\n" for text in (v.name, *v.choices)).encode() + b"\0" for v in table)
    start = [v.choices.index(str(v.start)) if v.choices else float(v.start or 0.0) for v in table]
    offered = [body.interface_names.index(name) for name in body.compliance_interfaces]
    return Draft(
        {
            "variables": len(table),
            "variable_bytes": len(texts),
            "compliances": len(offered),
        },
        {
            "variable_type": np.array([_TYPES.index(v.type) for v in table]),
            "variable_role": np.array([groups.index(v.group) for v in table]),
            "variable_index": np.array(index),
            "variable_start": np.array(start, dtype=np.float64),
            "variable_texts": texts,
            "compliance_interface": np.array(offered, dtype=np.int64),
        },
    )


def _core_number(body: ReducedBody, variable: Variable, place: int) -> int:
    """Number of a variable among those of its group, as core/instance.h has it."""
    if variable.group is Group.DIAGNOSTIC:
        return CORE_DIAGNOSTICS.index(variable.name)
    if variable.group is Group.PARAMETER:
        if variable.name.endswith(FIXED):
            return len(CORE_PARAMETERS) + body.interface_names.index(variable.name.removesuffix(FIXED))
        return CORE_PARAMETERS.index(variable.name)
    return place
