"""The variables of a body's FMU."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from enum import Enum

import numpy as np

from ..core import StepLimits
from ..model.methods import Mass, chosen, offered
from ..model.reduced_body import GROUND, ReducedBody
from .variables import (
    ACCELERATION,
    AXES,
    DAMPING_SCALE,
    FIXED,
    FRAME_ROTATION,
    INERTIA,
    INERTIA_LIMIT,
    INITIALIZATION,
    INTERPOLATION,
    ITERATIONS,
    KINETIC_ENERGY,
    METHOD,
    MISSED,
    MISSED_LIMIT,
    MOMENTUM,
    MOMENTUM_LIMIT,
    ON_INERTIA,
    ON_MISSED,
    ON_MOMENTUM,
    ON_ROTATION,
    ON_SPIN,
    ON_STABILITY,
    ON_STEP,
    ROTATION_LIMIT,
    SPIN,
    SPIN_LIMIT,
    STABILITY,
    STABILITY_LIMIT,
    STATUS_CODE,
    STEP_ERROR,
    STEP_FEWEST,
    STEP_LIMIT,
    STEP_MOST,
    STEP_TOLERANCE,
    STRAIN_ENERGY,
    SUBSTEPS,
    TUNABLE,
    Group,
    Initialization,
    Interpolation,
    OnLimit,
    OnRefusal,
    Variable,
)

# Orders of magnitude of metals under load, and of gravity.
_NOMINAL_STRESS, _NOMINAL_ACCELERATION = 1e8, 10.0
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
    nominal = _nominal_values(body)
    rates = _motions(body, Group.RATE, _RATES, nominal) if body.velocity_outputs else []
    status = (
        "0: sound; 1: a step was refused or the start failed; 2: a limit was passed; see the log; stays until reset"
    )
    return (
        *_loads(body, nominal),
        *(_accelerations() if body.masses is not None else []),
        *_motions(body, Group.MOTION, _MOTIONS, nominal),
        *rates,
        *_stresses(body),
        # Not an output: masters that take every output for a real number would stop at an integer.
        Variable(STATUS_CODE, "Integer", Group.STATUS, "local", "discrete", "calculated", None, None, status),
        *_parameters(body),
        *_diagnostics(body),
        *_compliances(body),
    )


def _input(name: str, unit: str, description: str, nominal: float) -> Variable:
    return Variable(name, "Real", Group.INPUT, "input", "continuous", None, 0.0, unit, description, nominal=nominal)


def _output(name: str, group: Group, unit: str, description: str, nominal: float) -> Variable:
    return Variable(name, "Real", group, "output", "continuous", "calculated", None, unit, description, nominal=nominal)


def _loads(body: ReducedBody, nominal: Mapping[str, float]) -> list[Variable]:
    """Forces and moments on the interfaces."""
    result = []
    for interface in body.interface_names:
        follows = interface in body.following_interfaces
        for quantity, unit, fixed_words in _LOADS:
            for axis in AXES:
                words = f"{fixed_words}, along the global {axis} axis"
                if follows:
                    words = f"{_FOLLOWING[quantity]}, along the interface's own {axis} axis, which turns with it"
                name = f"{interface}.{quantity}.{axis}"
                result.append(_input(name, unit, f"{interface}: {words}", nominal[quantity]))
    return result


def _accelerations() -> list[Variable]:
    """Acceleration of the frame of reference."""
    words = "acceleration of the supports (a weight is one against gravity), along the global {} axis"
    return [_input(f"{ACCELERATION}.{axis}", "m/s2", words.format(axis), _NOMINAL_ACCELERATION) for axis in AXES]


def _motions(
    body: ReducedBody, group: Group, quantities: Iterable[tuple[str, str, str]], nominal: Mapping[str, float]
) -> list[Variable]:
    """Motions of the interfaces, or their rates."""
    return [
        _output(
            f"{interface}.{quantity}.{axis}",
            group,
            unit,
            f"{interface}: {words}, along the global {axis} axis",
            nominal[quantity],
        )
        for interface in body.interface_names
        for quantity, unit, words in quantities
        for axis in AXES
    ]


def _stresses(body: ReducedBody) -> list[Variable]:
    """Largest stress of each set."""
    return [
        _output(
            f"{part.name}.von_mises",
            Group.STRESS,
            "Pa",
            f"{part.name}: largest von Mises stress at {len(part.point)} points",
            _NOMINAL_STRESS,
        )
        for part in body.stress_sets
    ]


def _compliances(body: ReducedBody) -> list[Variable]:
    """How interfaces give way over a step, to their own loads and to each other's."""
    return [
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


def _choice(name: str, start: Enum, among: Iterable[Enum], description: str) -> Variable:
    """A parameter that is one of several words."""
    choices = tuple(str(option.value) for option in among)
    offered_words = ", ".join(f'"{option}"' for option in choices)
    words = f"{description}: {offered_words}"
    return _parameter(name, "String", str(start.value), None, words, choices=choices)


def _number(name: str, start: float, unit: str | None, description: str, minimum: float = 0.0) -> Variable:
    """A parameter that is a number from `minimum` on."""
    return _parameter(name, "Real", start, unit, description, minimum=minimum)


def _parameter(
    name: str,
    kind: str,
    start: float | bool | str,
    unit: str | None,
    description: str,
    *,
    minimum: float | None = None,
    choices: tuple[str, ...] = (),
) -> Variable:
    return Variable(
        name,
        kind,
        Group.PARAMETER,
        "parameter",
        "fixed",
        "exact",
        start,
        unit,
        description,
        minimum=minimum,
        choices=choices,
    )


def _limit(quantity: tuple[str, str], start: float, unit: str | None, description: str, side: str) -> list[Variable]:
    """A limit that is watched, and what happens beyond it."""
    limit, on_limit = quantity
    return [
        _number(limit, start, unit, f"{description}; 0 for no limit"),
        _choice(on_limit, OnLimit.WARN, OnLimit, f"what happens {side} it"),
    ]


def _parameters(body: ReducedBody) -> list[Variable]:
    """Parameters in the order of the core's."""
    limits = StepLimits()
    # The joints of a cut body ring in tension as it moves, which says nothing of the loads.
    stability = 0.05 if body.ties is None else 0.0
    table = [
        _choice(METHOD, chosen(body).method, offered(body), "how the motion follows from the modes"),
        _choice(INITIALIZATION, Initialization.REST, Initialization, "how the body starts"),
        _choice(INTERPOLATION, Interpolation.CONSTANT, Interpolation, "how inputs are taken over a step"),
        _number(DAMPING_SCALE, 1.0, None, "factor on all modal damping ratios"),
        _number(STEP_LIMIT, limits.longest, "s", "longest internal step; 0 for none"),
        _number(STEP_TOLERANCE, limits.tolerance, None, "error accepted per step, relative, in the energy norm", 1e-14),
        _number(STEP_MOST, limits.most, None, "most work of a call, in internal steps of ordinary cost", 1.0),
        replace(
            # A master that repeats a step raises it, so that all tries have the same internal steps.
            _number(STEP_FEWEST, 1.0, None, "internal steps that a step with implicit loads has at least", 1.0),
            variability=TUNABLE,
        ),
        _choice(ON_STEP, OnRefusal.DISCARD, OnRefusal, "what happens when a step is refused"),
        *_limit((ROTATION_LIMIT, ON_ROTATION), 0.5, "rad", "largest rotation within a frame", "above"),
        *_limit((STABILITY_LIMIT, ON_STABILITY), stability, None, f"smallest stability, see {STABILITY}", "below"),
        *_limit((MISSED_LIMIT, ON_MISSED), 0.1, None, f"largest {MISSED}", "above"),
    ]
    if body.rigid_count:
        table += _limit((SPIN_LIMIT, ON_SPIN), 0.15, None, f"largest {SPIN}", "above")
        table += _limit((MOMENTUM_LIMIT, ON_MOMENTUM), 0.1, None, f"largest {MOMENTUM}", "above")
    if watches_inertia(body):
        table += _limit((INERTIA_LIMIT, ON_INERTIA), 0.01, None, f"largest {INERTIA}", "beyond")
    if body.root_interface != GROUND:
        table += [
            _parameter(
                f"{interface}{FIXED}",
                "Boolean",
                False,
                None,
                f"{interface}: held at zero displacement and rotation",
            )
            for interface in body.interface_names
        ]
    return table


def watches_inertia(body: ReducedBody) -> bool:
    """Whether it is told what constant mass leaves out."""
    return body.missed_inertia is not None and body.mass is Mass.CONSTANT


def _diagnostics(body: ReducedBody) -> list[Variable]:
    """Diagnostics in the order of the core's."""

    def local(name: str, kind: str, unit: str | None, description: str) -> Variable:
        variability = "continuous" if kind == "Real" else "discrete"
        return Variable(name, kind, Group.DIAGNOSTIC, "local", variability, "calculated", None, unit, description)

    turned = "largest rotation within a frame; trustworthy up to about 0.5 rad"
    tangent = "tangent stiffness over the unloaded one: 1 without loads, 0 at the critical load"
    missed = "upper bound of the deflection error from geometric stiffness that the method omits"
    table = [
        local(FRAME_ROTATION, "Real", "rad", turned),
        local(STABILITY, "Real", None, tangent),
        local(MISSED, "Real", None, missed),
    ]
    if body.rigid_count:
        drift = "share by which its angular momentum has drifted from the moments' impulse"
        table += [
            local(SPIN, "Real", None, "spin of a body with constant mass over its first elastic frequency"),
            local(MOMENTUM, "Real", None, drift),
        ]
    if watches_inertia(body):
        table.append(local(INERTIA, "Real", None, "share of the kinetic energy so far that constant mass leaves out"))
    return [
        *table,
        local(STEP_ERROR, "Real", None, f"estimated error of the last step, as {STEP_TOLERANCE} bounds it"),
        local(STRAIN_ENERGY, "Real", "J", "strain energy"),
        local(KINETIC_ENERGY, "Real", "J", "kinetic energy"),
        local(ITERATIONS, "Integer", None, "rounds of the implicit iteration in the last step"),
        local(SUBSTEPS, "Integer", None, "internal steps in the last step"),
    ]
