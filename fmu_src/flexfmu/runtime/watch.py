"""What a body is watched for while it runs: limits beyond which its results are not to be trusted.

Rotation within a frame: the remainder of a sub-domain's motion is taken as small (docs/theory.md, section 8).
Stability: the smallest eigenvalue of the tangent stiffness, relative to the unloaded body's: 1 without loads, 0 at the
critical load (section 7).
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from .body import FlexibleBody
from .stepping import State

FloatArray = NDArray[np.float64]

# Share of the largest loads' norm by which loads must have changed for stability to be looked at again.
_CHANGED = 0.05


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
    """

    rotation: float
    on_rotation: OnLimit
    stability: float
    on_stability: OnLimit


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
    if limits.rotation <= 0.0 or body.largest_rotation(state) <= limits.rotation:
        return None
    turned = body.rotation_within_frames(state)
    worst = int(np.argmax(turned))
    names = body.model.frame_names
    where = f"frame {names[worst]!r}" if len(turned) == len(names) and names else "the body as one piece"
    return Finding(
        f"material turns by {np.degrees(turned[worst]):.3g}° within {where}, beyond the limit of "
        f"{np.degrees(limits.rotation):.3g}°: displacements there are less accurate; build with more frames",
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
