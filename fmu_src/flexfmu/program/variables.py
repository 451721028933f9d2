"""The table of FMU variables: names, value references, units and start values of everything a master sees.

The model description, the programs that the core runs and docs/fmu-variables.md all follow this table. Value references
count from zero in its order: inputs, outputs, status, parameters, diagnostics, compliances. The order of roles,
parameters and diagnostics is that of core/instance.h, of choices that of the enumerations here.
"""

from dataclasses import dataclass
from enum import Enum

AXES = ("x", "y", "z")


class Initialization(Enum):
    """How the body starts."""

    REST = "rest"
    """Undeformed, at rest."""
    STATIC = "static"
    """In equilibrium under the loads that are set before initialisation ends."""


class Interpolation(Enum):
    """How inputs are taken over a step, from the value set for it and that of the step before."""

    CONSTANT = "constant"
    """Held: the present value acts over the whole step."""
    LINEAR = "linear"
    """The present value holds at the step's start, and the growth since the step before goes on."""
    RAMP = "ramp"
    """The present value holds at the step's end, that of the step before at its start: for masters that iterate."""


class OnLimit(Enum):
    """What happens when a limit is passed."""

    WARN = "warn"
    """A line in the log the first time it is passed, and a status code; the step counts."""
    DISCARD = "discard"
    """The step is refused; the state stays as it was."""
    TERMINATE = "terminate"
    """The simulation ends with an error."""


class OnRefusal(Enum):
    """What happens when a step has no result."""

    DISCARD = "discard"
    """The step is refused; the state stays as it was."""
    TERMINATE = "terminate"
    """The simulation ends with an error."""


class Group(Enum):
    """What a variable is, in the order of the core's roles."""

    INPUT = "input"
    MOTION = "motion"
    RATE = "rate"
    STRESS = "stress"
    COMPLIANCE = "compliance"
    STATUS = "status"
    PARAMETER = "parameter"
    DIAGNOSTIC = "diagnostic"


@dataclass(frozen=True, slots=True)
class Variable:
    """An FMI 2.0 scalar variable; its position in the table is its value reference.

    Attributes
    ----------
    name : str
    type : str
        "Real", "Integer", "Boolean" or "String".
    group : Group
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
    group: Group
    causality: str
    variability: str
    initial: str | None
    start: float | int | bool | str | None
    unit: str | None
    description: str
    minimum: float | None = None
    nominal: float | None = None
    choices: tuple[str, ...] = ()


ACCELERATION = "body.acceleration"
STATUS_CODE = "status.code"
METHOD = "method"
INITIALIZATION = "initialization"
INTERPOLATION = "input.interpolation"
DAMPING_SCALE = "damping.scale"
STEP_LIMIT = "internal_step.limit"
STEP_TOLERANCE = "internal_step.tolerance"
STEP_MOST = "internal_step.most"
STEP_FEWEST = "internal_step.fewest"
FIXED = ".fixed"
"""Ends the name of the parameter that fixes an interface of a free body."""
ROTATION_LIMIT = "watch.rotation.limit"
ON_ROTATION = "watch.rotation.on_limit"
MISSED_LIMIT = "watch.stiffness_missed.limit"
ON_MISSED = "watch.stiffness_missed.on_limit"
SPIN_LIMIT = "watch.spin.limit"
ON_SPIN = "watch.spin.on_limit"
MOMENTUM_LIMIT = "watch.angular_momentum.limit"
ON_MOMENTUM = "watch.angular_momentum.on_limit"
INERTIA_LIMIT = "watch.inertia_missed.limit"
ON_INERTIA = "watch.inertia_missed.on_limit"
STABILITY_LIMIT = "watch.stability.limit"
ON_STABILITY = "watch.stability.on_limit"
ON_STEP = "watch.step.on_limit"
FRAME_ROTATION = "diagnostics.rotation_within_frame"
STABILITY = "diagnostics.stability"
MISSED = "diagnostics.stiffness_missed"
SPIN = "diagnostics.spin"
MOMENTUM = "diagnostics.angular_momentum"
INERTIA = "diagnostics.inertia_missed"
STEP_ERROR = "diagnostics.step_error"
STRAIN_ENERGY = "diagnostics.strain_energy"
KINETIC_ENERGY = "diagnostics.kinetic_energy"
ITERATIONS = "diagnostics.iterations"
SUBSTEPS = "diagnostics.substeps"

TUNABLE = "tunable"
"""Variability of parameters that may be set between steps."""
CORE_PARAMETERS = (
    METHOD,
    INITIALIZATION,
    INTERPOLATION,
    DAMPING_SCALE,
    STEP_LIMIT,
    STEP_TOLERANCE,
    STEP_MOST,
    STEP_FEWEST,
    ON_STEP,
    ROTATION_LIMIT,
    ON_ROTATION,
    STABILITY_LIMIT,
    ON_STABILITY,
    MISSED_LIMIT,
    ON_MISSED,
    SPIN_LIMIT,
    ON_SPIN,
    MOMENTUM_LIMIT,
    ON_MOMENTUM,
    INERTIA_LIMIT,
    ON_INERTIA,
)
"""Parameters by the core's numbers (core/instance.h); those that fix interfaces follow."""
CORE_DIAGNOSTICS = (
    FRAME_ROTATION,
    STABILITY,
    MISSED,
    SPIN,
    MOMENTUM,
    INERTIA,
    STEP_ERROR,
    STRAIN_ENERGY,
    KINETIC_ENERGY,
    ITERATIONS,
    SUBSTEPS,
)
"""Diagnostics by the core's numbers."""
