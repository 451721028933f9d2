"""The variables of a body's FMU: the rows of core/interface.def for its interfaces, axes and the like.

Value references count from zero in this order. The model description and the programs that the core runs follow it.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, product

import numpy as np

from ..core.interface import Row, lines, parameter, rows, rows_of, words_of
from ..model.methods import Mass
from ..model.reduced_body import GROUND, ReducedBody
from ..model.variants import chosen, offered

AXES = ("x", "y", "z")
METHOD = parameter("METHOD").name
INITIALIZATION = parameter("INITIALIZATION").name
INTERPOLATION = parameter("INTERPOLATION").name
DAMPING_SCALE = parameter("DAMPING_SCALE").name
STIFFNESS_SCALE = parameter("STIFFNESS_SCALE").name
DENSITY_SCALE = parameter("DENSITY_SCALE").name
STEP_LIMIT = parameter("STEP_LIMIT").name
STEP_TOLERANCE = parameter("STEP_TOLERANCE").name
STEP_MOST = parameter("STEP_MOST").name
STATUS_CODE = rows_of("STATUS")[0].name
ERROR = next(row.name for row in rows_of("DIAGNOSTIC") if row.symbol == "error")
ACCELERATION = rows_of("INPUT")[-1].name.removesuffix(".AXIS")
FIXED = ".fixed"
"""Ends the name of the parameter that fixes an interface of a free body."""


@dataclass(frozen=True, slots=True)
class Variable:
    """An FMI 2.0 scalar variable; its position in the table is its value reference.

    Attributes
    ----------
    name : str
    type : str
        "Real", "Integer", "Boolean" or "String".
    role : str
        Of the roles of interface.def.
    number : int
        The core's, among those of its role.
    causality, variability : str
        As in FMI 2.0.
    initial : str or None
    start : float, int, bool, str or None
    unit : str or None
    description : str
    minimum : float or None
    nominal : float or None
        Order of magnitude where it is known.
    choices : tuple of str
        What a String offers.
    """

    name: str
    type: str
    role: str
    number: int
    causality: str
    variability: str
    initial: str | None
    start: float | int | bool | str | None
    unit: str | None
    description: str
    minimum: float | None = None
    nominal: float | None = None
    choices: tuple[str, ...] = ()


# Variability and initial of each causality.
_KINDS = {
    "input": ("continuous", None),
    "output": ("continuous", "calculated"),
    "local": ("continuous", "calculated"),
    "parameter": ("fixed", "exact"),
}
# Rows and columns of an interface's compliance, and the unit of each pair of their first letters.
_ROWS = {f"u{axis}": f"displacement along {axis}" for axis in AXES}
_ROWS |= {f"r{axis}": f"rotation about {axis}" for axis in AXES}
_COLUMNS = {f"f{axis}": f"the force along {axis}" for axis in AXES}
_COLUMNS |= {f"m{axis}": f"the moment about {axis}" for axis in AXES}
_UNITS = {"uf": "m/N", "um": "m/(N.m)", "rf": "rad/N", "rm": "rad/(N.m)"}

# Limits of relative errors of displacements.
_OF_ERRORS = ("ERROR_LIMIT", "TRUNCATION_LIMIT", "INERTIA_LIMIT", "ASTRAY_LIMIT", "SOFTNESS_LIMIT")

Words = dict[str, str]

CONDITIONS: dict[str, Callable[[ReducedBody], bool]] = {
    "always": lambda _: True,
    "masses": lambda body: body.masses is not None,
    "rates": lambda body: body.velocity_outputs,
    "free": lambda body: body.rigid_count > 0,
    "turning": lambda body: bool(body.polynomial) and body.mass is not Mass.CONFIGURATION and not body.rigid_count,
    "held": lambda body: body.ties is None and not body.rigid_count,
    "swinging": lambda body: body.shadow is not None and not body.rigid_count,
    "fixable": lambda body: body.root_interface != GROUND,
    "certified": lambda body: body.shadow is not None,
    "truncated": lambda body: body.frequency_spread is not None,
    "unsprung": lambda body: body.properties is None or body.properties.spring is None,
    "unladen": lambda body: body.properties is None or body.properties.point_mass is None,
}
"""Which bodies have a variable, by its column `when`."""


def variable_table(body: ReducedBody) -> tuple[Variable, ...]:
    """All variables of a body's FMU.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    tuple of Variable
    """
    nominal = _nominal_values(body)
    result = []
    for role, kinds in groupby((row for row in rows() if CONDITIONS[row.when](body)), lambda row: row.role):
        for place, (row, words, spoken) in enumerate(_expanded(body, role, list(kinds))):
            result.append(_variable(body, row, _number(body, row, words, place), words, words | spoken, nominal))
    return tuple(result)


def input_names(body: ReducedBody) -> list[str]:
    """Names of the loads in the order of a program: force and moment of each interface, then the acceleration."""
    there = [row for row in rows_of("INPUT") if CONDITIONS[row.when](body)]
    return [_filled(row.name, words) for row, words, _ in _expanded(body, "INPUT", there)]


def _expanded(body: ReducedBody, role: str, kinds: Sequence[Row]) -> Iterator[tuple[Row, Words, Words]]:
    """Rows with what stands for their capitals in names, and otherwise in descriptions."""
    if role == "COMPLIANCE":
        for name, other in product(body.compliance_interfaces, repeat=2):
            for (motion, moved), (cause, load) in product(_ROWS.items(), _COLUMNS.items()):
                words = {"NAME": name, "OTHER": other, "ROW": motion, "COLUMN": cause}
                yield kinds[name != other], words, {"ROW": moved, "COLUMN": load}
    elif role == "STRESS":
        for part in body.stress_sets:
            yield kinds[0], {"SET": part.name}, {"COUNT": str(len(part.point))}
    else:
        for each, block in groupby(kinds, lambda row: "NAME" in row.name):
            for name, row in product(body.interface_names if each else ("",), list(block)):
                for axis in AXES if "AXIS" in row.name else ("",):
                    yield row, {"NAME": name, "AXIS": axis}, {}


def _number(body: ReducedBody, row: Row, words: Words, place: int) -> int:
    """The core's number of a variable among those of its role."""
    known = [kind.symbol for kind in rows() if kind.role == row.role and kind.symbol]
    if row.symbol:
        return known.index(row.symbol)
    # Parameters that fix interfaces follow the others.
    return len(known) + body.interface_names.index(words["NAME"]) if known else place


def _variable(
    body: ReducedBody, row: Row, number: int, words: Words, spoken: Words, nominal: Mapping[str, float]
) -> Variable:
    """The variable of a row."""
    causality = next(causality for role, causality, *_ in lines("ROLE") if role == row.role)
    variability, initial = _KINDS[causality]
    if row.tunable:
        variability = "tunable"
    elif row.type == "Integer":
        variability = "discrete"
    choices = tuple(method.value for method in offered(body)) if row.words == "METHOD" else words_of(row.words)
    return Variable(
        name=_filled(row.name, words),
        type=row.type,
        role=row.role,
        number=number,
        causality=causality,
        variability=variability,
        initial=initial,
        start=_start(body, row, choices),
        unit=_UNITS[words["ROW"][0] + words["COLUMN"][0]] if row.role == "COMPLIANCE" else row.unit or None,
        description=_filled(_description(body, row, choices, words), spoken),
        minimum=row.least if row.role == "PARAMETER" and row.type == "Real" else None,
        nominal=nominal.get(row.name.split(".")[1]) if causality in ("input", "output") else None,
        choices=choices,
    )


def _filled(pattern: str, words: Words) -> str:
    """A text with words for its capitals."""
    return re.sub("|".join(words), lambda found: words[found[0]], pattern)


def _start(body: ReducedBody, row: Row, choices: Sequence[str]) -> float | bool | str | None:
    """Start value of inputs and parameters."""
    if row.words:
        return chosen(body).method.value if row.words == "METHOD" else choices[0]
    if row.symbol == "STABILITY_LIMIT" and body.ties is not None:
        # The joints of a cut body ring in tension as it moves, which says nothing of the loads.
        return 0.0
    if row.symbol in _OF_ERRORS and body.tolerance is not None:
        return body.tolerance
    if row.role not in ("INPUT", "PARAMETER"):
        return None
    return row.start if row.type == "Real" else False


def _description(body: ReducedBody, row: Row, choices: Sequence[str], words: Words) -> str:
    """What the model description says of a row."""
    text, axis = row.text, ", along the global AXIS axis"
    if row.role == "INPUT" and words["NAME"] in body.following_interfaces:
        text = text.removesuffix(", fixed in direction").replace("moving ", "")
        axis = ", along the interface's own AXIS axis, which turns with it"
    if row.role == "STATUS":
        states = "; ".join(f"{code}: {meaning}" for code, (_, meaning) in enumerate(lines("STATE")))
        text = f"{states}; {text}"
    if choices:
        listed = ", ".join(f'"{choice}"' for choice in choices)
        text = f"{text}: {listed}"
    owner = next((f"{word}: " for word in ("NAME", "SET") if word in row.name), "")
    return f"{owner}{text}{axis if 'AXIS' in row.name else ''}"


def _nominal_values(body: ReducedBody) -> dict[str, float]:
    """Orders of magnitude: a hundredth of the body's size, of a radian, and what brings them about."""
    elastic = slice(body.rigid_count, None)
    frequency = body.angular_frequency[elastic]
    displacement, rotation = 1e-2 * body.extent, 1e-2
    compliance = [
        float(np.max(np.sum((operator[..., elastic] / frequency) ** 2, axis=2), initial=0.0))
        for operator in (body.interface_displacement, body.interface_rotation)
    ]
    values = {
        "displacement": displacement,
        "rotation": rotation,
        "velocity": displacement * float(frequency[0]),
        "angular_velocity": rotation * float(frequency[0]),
        "force": displacement / compliance[0] if compliance[0] > 0.0 else 1.0,
        "moment": rotation / compliance[1] if compliance[1] > 0.0 else 1.0,
        # Of gravity, and of metals under load.
        "acceleration": 10.0,
        "von_mises": 1e8,
    }
    return {name: float(f"{value:.0e}") for name, value in values.items()}
