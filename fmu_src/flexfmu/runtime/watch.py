"""What a body is watched for while it runs: limits beyond which its results are not to be trusted.

Rotation within a frame: the remainder of a sub-domain's motion is taken as small (docs/theory.md, section 8).
Stability: the smallest eigenvalue of the tangent stiffness, relative to the unloaded body's: 1 without loads, 0 at the
critical load (section 7). Stiffness missed: what loads do to it that the formulation does not know of (section 7).
Feed: what explicit evaluation adds to the motion, or takes from it (section 6).
Spin and angular momentum: what constant mass misses of a body that turns as a whole (section 9).
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from .body import FlexibleBody
from .buckling import BY_LOAD, BY_SECOND_ORDER, Judge
from .evaluation import Feed
from .reduced_body import Kinematics
from .spinning import AngularMomentum
from .stepping import State

FloatArray = NDArray[np.float64]

# Share of the largest loads' norm by which loads must have changed for stability to be looked at again.
_CHANGED = 0.05
# Part of the limit of rotation that holds where displacements are wrong by the angle, not by its square.
_FIRST_ORDER = 0.4
_WRONG_AT_FIRST_ORDER = (Kinematics.LINEAR, Kinematics.LITERAL)


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


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits and what to do about them.

    Attributes
    ----------
    rotation : float
        Largest rotation within a frame, rad; 0 for no limit.
    on_rotation : OnLimit
    stability : float
        Smallest eigenvalue of the tangent relative to the unloaded body's; 0 for none: past the critical load is then
        not looked for.
    on_stability : OnLimit
    missed : float
        Largest error of deflections by the loads' effect on stiffness that the formulation misses; 0 for no limit.
    on_missed : OnLimit
    feed : float
        Largest share of the motion that explicit evaluation adds or takes; 0 for no limit.
    on_feed : OnLimit
    spin : float
        Largest spin of a free body with constant mass over its lowest elastic frequency; 0 for no limit.
    on_spin : OnLimit
    momentum : float
        Largest share by which its angular momentum drifts; 0 for no limit.
    on_momentum : OnLimit
    """

    rotation: float
    on_rotation: OnLimit
    stability: float
    on_stability: OnLimit
    missed: float = 0.0
    on_missed: OnLimit = OnLimit.WARN
    feed: float = 0.0
    on_feed: OnLimit = OnLimit.WARN
    spin: float = 0.0
    on_spin: OnLimit = OnLimit.WARN
    momentum: float = 0.0
    on_momentum: OnLimit = OnLimit.WARN


@dataclass(frozen=True, slots=True)
class Finding:
    """A limit that is passed.

    Attributes
    ----------
    text : str
        Which, how far, and what to do.
    action : OnLimit
    """

    text: str
    action: OnLimit


def rotation_finding(body: FlexibleBody, state: State, limits: Limits) -> Finding | None:
    """Whether material turns too far within a frame.

    Parameters
    ----------
    body : FlexibleBody
    state : State
    limits : Limits

    Returns
    -------
    Finding or None
    """
    limit = limits.rotation
    if body.formulation.kinematics in _WRONG_AT_FIRST_ORDER:
        limit = _FIRST_ORDER * limit
    if limit <= 0.0 or body.largest_rotation(state) <= limit:
        return None
    turned = body.rotation_within_frames(state)
    worst = int(np.argmax(turned))
    names = body.model.frame_names
    where = f"frame {names[worst]!r}" if len(turned) == len(names) and names else "the body as one piece"
    return Finding(
        f"material turns by {np.degrees(turned[worst]):.3g}° within {where}, beyond the limit of "
        f"{np.degrees(limit):.3g}°: displacements there are less accurate; {_remedy(body)}",
        limits.on_rotation,
    )


def loads_changed(inputs: FloatArray, before: FloatArray, largest_square: float) -> bool:
    """Whether loads have changed enough since `before`, against the largest so far, for stability to be looked at."""
    difference = inputs - before
    return float(difference @ difference) > _CHANGED**2 * largest_square


def stability_finding(
    body: FlexibleBody, state: State, inputs: FloatArray, names: tuple[str, ...], limits: Limits
) -> Finding | None:
    """Whether the loads are near or beyond a critical one.

    Parameters
    ----------
    body : FlexibleBody
    state : State
    inputs : (6I,) or (6I + 3,) float
    names : tuple of str
        Of the inputs.
    limits : Limits

    Returns
    -------
    Finding or None
    """
    if limits.stability <= 0.0 or body.is_stable(state, inputs, limits.stability):
        return None
    margin, shape = body.stability(state, inputs)
    if margin > limits.stability:
        # The quick look goes by differences; what is said goes by the tangent itself.
        return None
    mode = int(np.argmax(np.abs(shape)))
    hertz = body.model.angular_frequency[mode] / (2.0 * np.pi)
    shares = []
    for index in np.flatnonzero(inputs):
        alone = np.zeros_like(inputs)
        alone[index] = inputs[index]
        shares.append((body.softening(state, alone, shape), int(index)))
    softening, worst = max(shares)
    state_words = "beyond the critical load" if margin <= 0.0 else "near the critical load"
    return Finding(
        f"the loads are {state_words}: the tangent stiffness is down to {margin:.3g} of the unloaded body's (limit "
        f"{limits.stability:.3g}); {names[worst]} = {inputs[worst]:.6g} takes off {softening:.3g} of it, in mode "
        f"{mode + 1} ({hertz:.4g} Hz); lower it, or look at whether the body really bears it",
        limits.on_stability,
    )


def missed_finding(body: FlexibleBody, inputs: FloatArray, names: tuple[str, ...], limits: Limits) -> Finding | None:
    """Whether the loads change the stiffness by more than the formulation knows.

    Parameters
    ----------
    body : FlexibleBody
    inputs : (6I,) or (6I + 3,) float
    names : tuple of str
        Of the inputs.
    limits : Limits

    Returns
    -------
    Finding or None
    """
    if limits.missed <= 0.0:
        return None
    judge = body.judge
    if judge is None or not judge.may_exceed(inputs, limits.missed):
        return None
    # An error of 1 is beyond the critical load, and no limit lies above it.
    if limits.missed < 1.0 and judge.within(inputs, limits.missed):
        return None
    error = judge.error(inputs)
    # The quick looks are of every shape of the body, loaded or not.
    if error <= limits.missed and error < 1.0:
        return None
    worst = int(np.argmax(np.abs(inputs) * judge.missed_bound))
    margin = judge.margin(inputs)
    words = f"deflections are off by up to {100.0 * error:.3g} %"
    if margin <= 0.0:
        words = "the loads are beyond the critical load, which the formulation does not know of"
    return Finding(
        f"the formulation misses what the loads do to the stiffness: judged by {judge.source}, {words} "
        f"(limit {100.0 * limits.missed:.3g} %); {names[worst]} = {inputs[worst]:.6g} does most of it; "
        f"{_knowing(body, judge)}",
        limits.on_missed,
    )


def feed_finding(feed: Feed, limits: Limits) -> Finding | None:
    """Whether explicit evaluation adds to the motion, or takes from it, more than is accepted.

    Parameters
    ----------
    feed : Feed
    limits : Limits

    Returns
    -------
    Finding or None
    """
    if limits.feed <= 0.0 or feed.largest <= limits.feed:
        return None
    verb = "added" if feed.fed >= feed.taken else "taken"
    return Finding(
        f"evaluating loads at each step's start has {verb} {100.0 * feed.largest:.3g} % of the motion (limit "
        f"{100.0 * limits.feed:.3g} %), and does so without bound where damping does not outweigh it: take "
        'formulation.evaluation = "implicit", or shorter steps',
        limits.on_feed,
    )


def spin_finding(body: FlexibleBody, state: State, limits: Limits) -> Finding | None:
    """Whether a free body with constant mass spins too fast for it.

    Parameters
    ----------
    body : FlexibleBody
    state : State
    limits : Limits

    Returns
    -------
    Finding or None
    """
    if limits.spin <= 0.0 or body.spinning is None or (ratio := body.spinning.ratio(state)) <= limits.spin:
        return None
    return Finding(
        f"the body spins at {ratio * body.spinning.frequency:.3g} rad/s, {100.0 * ratio:.3g} % of its first elastic "
        f"frequency ({body.spinning.frequency / (2.0 * np.pi):.4g} Hz; limit {100.0 * limits.spin:.3g} %): constant "
        f"mass leaves out centrifugal forces and the stiffness that they give; {_inertia_remedy(body)}",
        limits.on_spin,
    )


def momentum_finding(body: FlexibleBody, momentum: AngularMomentum, limits: Limits) -> Finding | None:
    """Whether turning about changing axes has put a free body's angular momentum off.

    Parameters
    ----------
    body : FlexibleBody
    momentum : AngularMomentum
    limits : Limits

    Returns
    -------
    Finding or None
    """
    if limits.momentum <= 0.0 or momentum.drift <= limits.momentum:
        return None
    return Finding(
        f"the body turns about changing axes, and its angular momentum is off by {100.0 * momentum.drift:.3g} % of its "
        f"largest (limit {100.0 * limits.momentum:.3g} %): constant mass leaves out gyroscopic terms; "
        f"{_inertia_remedy(body)}",
        limits.on_momentum,
    )


def _inertia_remedy(body: FlexibleBody) -> str:
    """What to do about inertia that constant mass does not know."""
    words = 'take formulation.mass = "configuration"'
    if body.formulation.kinematics is not Kinematics.COROTATED:
        words += ' with kinematics "corotated"'
    if body.model.inertia is None:
        words = f"build with inertia = true in [reduction], and {words}"
    return f"{words}, which holds for less than one turn about changing axes"


def _remedy(body: FlexibleBody) -> str:
    """What to do about rotation within a frame."""
    if body.formulation.kinematics in _WRONG_AT_FIRST_ORDER:
        return 'take formulation.kinematics = "corotated"' + (
            "" if body.model.frame_count else " and build with frames"
        )
    if body.formulation.kinematics is Kinematics.COROTATED and body.model.second is not None:
        return 'take formulation.kinematics = "second_order", or build with more frames'
    return "build with more frames"


def _knowing(body: FlexibleBody, judge: Judge) -> str:
    """What to do about stiffness that is missed."""
    if judge.source == BY_SECOND_ORDER:
        return 'take formulation.kinematics = "second_order" with loads "deformed"'
    if judge.source == BY_LOAD:
        return 'take formulation.stiffness = "by_load"'
    aboard = 'geometric_stiffness = ["by_load"] and take formulation.stiffness = "by_load"'
    if body.formulation.kinematics is Kinematics.LINEAR and body.model.frame_count > 1:
        return f'take formulation.kinematics = "corotated" with loads "deformed", or build with {aboard}'
    return f"build with more frames, or with {aboard}"
