"""The table of FMU variables: names, value references, units and start values of everything a master sees.

The model description, the programs that the core runs and docs/fmu-variables.md all follow this table. Value references
count from zero in its order: inputs, outputs, status, parameters, diagnostics, compliances. The order of roles,
parameters and diagnostics is that of core/instance.h, of choices that of the enumerations here.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from ..core import StepLimits
from ..methods import Mass, chosen, offered
from ..model.reduced_body import GROUND, ReducedBody

AXES = ("x", "y", "z")
# Orders of magnitude of metals under load, and of gravity.
_NOMINAL_STRESS, _NOMINAL_ACCELERATION = 1e8, 10.0


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

_MOTIONS = (
    ("displacement", "m", "displacement of the reference point"),
    ("rotation", "rad", "component of the rotation vector"),
)
_RATES = (
    ("velocity", "m/s", "velocity of the reference point"),
    ("angular_velocity", "rad/s", "angular velocity"),
)
_LOADS = (
    ("force", "N", "force at the reference point, fixed in direction"),
    ("moment", "N.m", "moment about the moving reference point, fixed in direction"),
)
_FOLLOWING = {"force": "force at the reference point", "moment": "moment about the reference point"}
# Rows and columns of an interface's compliance, and the unit of each pair of their first letters.
_COMPLIANCE_ROWS = {f"u{axis}": f"displacement along {axis}" for axis in AXES}
_COMPLIANCE_ROWS |= {f"r{axis}": f"rotation about {axis}" for axis in AXES}
_COMPLIANCE_COLUMNS = {f"f{axis}": f"the force along {axis}" for axis in AXES}
_COMPLIANCE_COLUMNS |= {f"m{axis}": f"the moment about {axis}" for axis in AXES}
_COMPLIANCE_UNITS = {"uf": "m/N", "um": "m/(N.m)", "rf": "rad/N", "rm": "rad/(N.m)"}


def _nominal_values(body: ReducedBody) -> dict[str, float]:
    """Orders of magnitude: a hundredth of the body's size, of a radian, and what brings them about."""
    points = np.concatenate([body.interface_point, body.joint_point])
    size = float(np.max(np.ptp(points, axis=0))) or 1.0
    elastic = slice(body.rigid_count, None)
    frequency = body.angular_frequency[elastic]
    displacement, rotation = 1e-2 * size, 1e-2
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
    }
    return {name: float(f"{value:.0e}") for name, value in values.items()}


def variable_table(body: ReducedBody) -> tuple[Variable, ...]:
    """All variables of a body's FMU.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    tuple of Variable
    """
    table: list[Variable] = []
    nominal = _nominal_values(body)
    for quantities, group, causality in (
        (_LOADS, Group.INPUT, "input"),
        (_MOTIONS, Group.MOTION, "output"),
        (_RATES if body.velocity_outputs else (), Group.RATE, "output"),
    ):
        table += [
            Variable(
                f"{interface}.{quantity}.{axis}",
                "Real",
                group,
                causality,
                "continuous",
                None if group is Group.INPUT else "calculated",
                0.0 if group is Group.INPUT else None,
                unit,
                f"{interface}: {words}, along the global {axis} axis"
                if group is not Group.INPUT or interface not in body.following_interfaces
                else f"{interface}: {_FOLLOWING[quantity]}, along the interface's own {axis} axis, which turns with it",
                nominal=nominal[quantity],
            )
            for interface in body.interface_names
            for quantity, unit, words in quantities
            for axis in AXES
        ]
    table += [
        Variable(
            f"{part.name}.von_mises",
            "Real",
            Group.STRESS,
            "output",
            "continuous",
            "calculated",
            None,
            "Pa",
            f"{part.name}: largest von Mises stress at {len(part.point)} points",
            nominal=_NOMINAL_STRESS,
        )
        for part in body.stress_sets
    ]
    if body.masses is not None:
        after_loads = 6 * body.interface_count
        words = "acceleration of the supports (a weight is one against gravity), along the global {} axis"
        table[after_loads:after_loads] = [
            Variable(
                f"{ACCELERATION}.{axis}",
                "Real",
                Group.INPUT,
                "input",
                "continuous",
                None,
                0.0,
                "m/s2",
                words.format(axis),
                nominal=_NOMINAL_ACCELERATION,
            )
            for axis in AXES
        ]
    status = (
        "0: sound; 1: a step was refused or the start failed; 2: a limit was passed; see the log; stays until reset"
    )
    # Not an output: masters that take every output for a real number would stop at an integer.
    table.append(Variable(STATUS_CODE, "Integer", Group.STATUS, "local", "discrete", "calculated", None, None, status))
    table += _parameters(body)
    table += _diagnostics(body)
    table += [
        Variable(
            f"{interface}.compliance.{'' if other == interface else f'{other}.'}{row}.{column}",
            "Real",
            Group.COMPLIANCE,
            "local",
            "continuous",
            "calculated",
            None,
            _COMPLIANCE_UNITS[row[0] + column[0]],
            f"{interface}: change of {words} at the end of a step with {cause}"
            f"{'' if other == interface else f' on {other}'} held over it",
        )
        for interface in body.compliance_interfaces
        for other in body.compliance_interfaces
        for row, words in _COMPLIANCE_ROWS.items()
        for column, cause in _COMPLIANCE_COLUMNS.items()
    ]
    return tuple(table)


def _parameters(body: ReducedBody) -> list[Variable]:
    """Parameters in the order of the core's."""

    def choice(name: str, start: Enum, among: Iterable[Enum], description: str) -> Variable:
        choices = tuple(str(option.value) for option in among)
        offered_words = ", ".join(f'"{option}"' for option in choices)
        words = f"{description}: {offered_words}"
        return Variable(
            name,
            "String",
            Group.PARAMETER,
            "parameter",
            "fixed",
            "exact",
            str(start.value),
            None,
            words,
            choices=choices,
        )

    def number(name: str, start: float, unit: str | None, description: str, minimum: float = 0.0) -> Variable:
        return Variable(
            name, "Real", Group.PARAMETER, "parameter", "fixed", "exact", start, unit, description, minimum=minimum
        )

    fixable = body.interface_names if body.root_interface != GROUND else ()
    # The joints of a cut body ring in tension as it moves, which says nothing of the loads.
    stability = 0.05 if body.ties is None else 0.0
    method = chosen(body).method
    return [
        choice(METHOD, method, offered(body), "how the motion follows from the modes"),
        choice(INITIALIZATION, Initialization.REST, Initialization, "how the body starts"),
        choice(INTERPOLATION, Interpolation.CONSTANT, Interpolation, "how inputs are taken over a step"),
        number(DAMPING_SCALE, 1.0, None, "factor on all modal damping ratios"),
        number(STEP_LIMIT, StepLimits().longest, "s", "longest internal step; 0 for none"),
        number(
            STEP_TOLERANCE, StepLimits().tolerance, None, "error accepted per step, relative, in the energy norm", 1e-14
        ),
        number(STEP_MOST, StepLimits().most, None, "most work of a call, in internal steps of ordinary cost", 1.0),
        replace(
            # A master that repeats a step raises it, so that all tries have the same internal steps.
            number(STEP_FEWEST, 1.0, None, "internal steps that a step with implicit loads has at least", 1.0),
            variability=TUNABLE,
        ),
        choice(ON_STEP, OnRefusal.DISCARD, OnRefusal, "what happens when a step is refused"),
        number(ROTATION_LIMIT, 0.5, "rad", "largest rotation within a frame; 0 for no limit"),
        choice(ON_ROTATION, OnLimit.WARN, OnLimit, "what happens above it"),
        number(STABILITY_LIMIT, stability, None, f"smallest stability, see {STABILITY}; 0 for no limit"),
        choice(ON_STABILITY, OnLimit.WARN, OnLimit, "what happens below it"),
        number(MISSED_LIMIT, 0.1, None, f"largest {MISSED}; 0 for no limit"),
        choice(ON_MISSED, OnLimit.WARN, OnLimit, "what happens above it"),
        *(
            (
                number(SPIN_LIMIT, 0.15, None, f"largest {SPIN}; 0 for no limit"),
                choice(ON_SPIN, OnLimit.WARN, OnLimit, "what happens above it"),
                number(MOMENTUM_LIMIT, 0.1, None, f"largest {MOMENTUM}; 0 for no limit"),
                choice(ON_MOMENTUM, OnLimit.WARN, OnLimit, "what happens above it"),
            )
            if body.rigid_count
            else ()
        ),
        *(
            (
                number(INERTIA_LIMIT, 0.01, None, f"largest {INERTIA}; 0 for no limit"),
                choice(ON_INERTIA, OnLimit.WARN, OnLimit, "what happens beyond it"),
            )
            if watches_inertia(body)
            else ()
        ),
        *(
            Variable(
                f"{interface}{FIXED}",
                "Boolean",
                Group.PARAMETER,
                "parameter",
                "fixed",
                "exact",
                False,
                None,
                f"{interface}: held at zero displacement and rotation",
            )
            for interface in fixable
        ),
    ]


def watches_inertia(body: ReducedBody) -> bool:
    """Whether it is told what constant mass leaves out."""
    return body.missed_inertia is not None and body.mass is Mass.CONSTANT


def _diagnostics(body: ReducedBody) -> list[Variable]:
    """Diagnostics in the order of the core's."""

    def local(name: str, kind: str, unit: str | None, description: str) -> Variable:
        variability = "continuous" if kind == "Real" else "discrete"
        return Variable(name, kind, Group.DIAGNOSTIC, "local", variability, "calculated", None, unit, description)

    return [
        local(FRAME_ROTATION, "Real", "rad", "largest rotation within a frame; trustworthy up to about 0.5 rad"),
        local(
            STABILITY, "Real", None, "tangent stiffness over the unloaded one: 1 without loads, 0 at the critical load"
        ),
        local(
            MISSED, "Real", None, "upper bound of the deflection error from geometric stiffness that the method omits"
        ),
        *(
            (
                local(SPIN, "Real", None, "spin of a body with constant mass over its first elastic frequency"),
                local(
                    MOMENTUM, "Real", None, "share by which its angular momentum has drifted from the moments' impulse"
                ),
            )
            if body.rigid_count
            else ()
        ),
        *(
            (local(INERTIA, "Real", None, "share of the kinetic energy so far that constant mass leaves out"),)
            if watches_inertia(body)
            else ()
        ),
        local(STEP_ERROR, "Real", None, f"estimated error of the last step, as {STEP_TOLERANCE} bounds it"),
        local(STRAIN_ENERGY, "Real", "J", "strain energy"),
        local(KINETIC_ENERGY, "Real", "J", "kinetic energy"),
        local(ITERATIONS, "Integer", None, "rounds of the implicit iteration in the last step"),
        local(SUBSTEPS, "Integer", None, "internal steps in the last step"),
    ]
