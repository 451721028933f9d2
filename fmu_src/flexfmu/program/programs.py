"""The programs that an FMU carries: one for each method that its body has the data for, and interfaces held."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from ..core.image import DESCRIPTION, shared
from ..core.interface import symbols
from ..files.basics import OptionError
from ..model.fixing import with_fixed_interfaces, with_frame_layout
from ..model.methods import Mass, Method, has_frames, masses_of
from ..model.reduced_body import GROUND, ReducedBody
from ..model.variants import chosen, offered
from .compile import compile_draft, shadow_draft
from .mechanics import Draft, texts
from .variable_table import Variable, variable_table

# What begins the name of the program that tells the error.
_SHADOW = "shadow"
# Sets of interfaces that a linear body may be fixed at: all of them as long as there are few.
_MOST_FIXED = 5
_TYPES = ("Real", "Integer", "Boolean", "String")


def programs(body: ReducedBody) -> dict[str, Draft]:
    """Every program of a body's FMU by its file name, without the guid.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    dict of str to Draft
    """
    fields = variable_fields(body, variable_table(body))
    start = chosen(body).method
    result = {}
    for method in offered(body):
        mass = body.mass if body.mass in masses_of(method) else Mass.CONSTANT
        for fixed in _fixed_sets(body, method):
            names = tuple(body.interface_names[number] for number in fixed)
            try:
                held = with_frame_layout(with_fixed_interfaces(body, names, method), method)
            except OptionError:
                if not fixed:
                    raise
                # A set that leaves the body no coordinates: the FMU says that it is not there.
                continue
            name = (
                DESCRIPTION if method is start and not fixed else f"{'-'.join([method.value, *map(str, fixed)])}.prog"
            )
            draft = compile_draft(held, method, mass)
            result[name] = Draft(draft.sizes | fields.sizes, draft.arrays | fields.arrays)
    if body.shadow is not None:
        # Frames hang on the root: of other interfaces fixed nothing is known.
        for fixed in _fixed_sets(body, Method.SECOND_ORDER):
            names = tuple(body.interface_names[number] for number in fixed)
            held = with_fixed_interfaces(body, names, Method.SECOND_ORDER)
            result[f"{'-'.join([_SHADOW, *map(str, fixed)])}.prog"] = shadow_draft(held)
    return result


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
    roles = symbols("ROLE")
    start = [v.choices.index(str(v.start)) if v.choices else float(v.start or 0.0) for v in table]
    offered = [body.interface_names.index(name) for name in body.compliance_interfaces]
    draft = Draft({}, {})
    draft.arrays |= {
        "variable_type": np.array([_TYPES.index(v.type) for v in table]),
        "variable_role": np.array([roles.index(v.role) for v in table]),
        "variable_index": np.array([v.number for v in table]),
        "variable_start": np.array(start, dtype=np.float64),
        "variable_texts": texts(*("".join(f"{text}\n" for text in (v.name, *v.choices)) for v in table)),
        "compliance_interface": np.array(offered, dtype=np.int64),
    }
    return draft


def with_guid(made: Mapping[str, Draft], guid: str) -> dict[str, bytes]:
    """Images of programs that belong to the model description of a guid."""
    drafts = {name: Draft(draft.sizes, draft.arrays | {"guid": texts(guid)}) for name, draft in made.items()}
    first = drafts.pop(DESCRIPTION)
    first.arrays["shared"] = shared([draft.arrays for draft in drafts.values()], first.image())
    base = first.image()
    return {DESCRIPTION: base} | {name: draft.image(base) for name, draft in drafts.items()}


def _fixed_sets(body: ReducedBody, method: Method) -> list[tuple[int, ...]]:
    """Sets of interfaces that a scene may fix, none first."""
    if body.root_interface == GROUND:
        return [()]
    if has_frames(method):
        return [(), (body.root_interface,)]
    count = body.interface_count
    sizes = range(count + 1) if count <= _MOST_FIXED else (0, 1, count)
    return [chosen for size in sizes for chosen in combinations(range(count), size)]
