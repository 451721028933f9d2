"""What a variable of an FMU is, and the names that Python needs of them; core/interface.def has all of them."""

from dataclasses import dataclass

from ..core.interface import parameter, rows_of

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
