"""Springs between sections of a body that its frames carry: what closes a loop again where a body was cut.

A tie joins section a to section b, or to the ground. Its springs, of stiffness k along the global axes, lie spread over
the section: at its centre x and, for what they resist of tilting, at three points x + R l_c, l_c l_cᵀ summed being the
second moments of where they are. Its energy

    E = ½ Σ_axes k (d² + Σ_c d_c²),   d = x_a − x_b − (X_a − X_b),   d_c = (R_a − R_b) l_c,                        (16)

is a function of q through the tree of frames. The modes hold its second derivative at q = 0 already, E''(0) = H; so
what the ties add to the modal force is −∂E/∂q + Hq.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .reduced_body import ReducedBody
from .rotations import cross, skew
from .tree import Configuration, Tree, configuration, jacobians

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUND_OFF = 64.0 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class TieForces:
    """Ties of a body under one kinematics; constant.

    Attributes
    ----------
    first : slice
        Where their ends a stand among the tree's nodes.
    second : slice
        The same of their ends b.
    stiffness : (T, 1, 3) float
        k, N/m.
    lever : (T, 3, 3) float
        l_c in its columns, m.
    apart : (T, 3) float
        X_a − X_b, m.
    initial : (m, m) float
        H, 1/s²: what the modes hold of it.
    welded : (m, m) float
        The part of H that is due to ties between two sections, without those to the ground.
    noise : float
        What the round-off of places makes of the springs' strain: no change of Ωq below it means anything, J^1/2.
    """

    first: slice
    second: slice
    stiffness: FloatArray
    lever: FloatArray
    apart: FloatArray
    initial: FloatArray
    welded: FloatArray
    noise: float


def tie_forces(body: ReducedBody, tree: Tree) -> TieForces | None:
    """Ties of a body on its tree; None where there are none, or where linear kinematics leave nothing to add.

    Parameters
    ----------
    body : ReducedBody
    tree : Tree

    Returns
    -------
    TieForces or None
    """
    if body.ties is None or tree.tie_count == 0:
        return None
    stop, count = len(tree.parent), tree.tie_count
    first, second = slice(stop - 2 * count, stop - count), slice(stop - count, stop)
    apart = tree.point[first] - tree.point[second]
    none = np.zeros((body.mode_count, body.mode_count))
    bare = TieForces(first, second, body.ties.stiffness[:, None, :], body.ties.lever, apart, none, none, 0.0)
    here = configuration(tree, np.zeros(body.mode_count))
    change = gap_derivative(bare, here, *jacobians(tree, here))
    weighed = bare.stiffness[..., None] * change
    each = np.einsum("tcim,tcin->tmn", weighed, change, optimize=True)
    welded = np.asarray(body.ties.frame[:, 1] >= 0)
    # Each tie has four springs along an axis: at its centre and at three levers.
    far = float(np.linalg.norm(tree.point, axis=1).max())
    noise = _ROUND_OFF * far * float(np.sqrt(4.0 * body.ties.stiffness.sum()))
    initial = each.sum(axis=0)
    return TieForces(first, second, bare.stiffness, bare.lever, apart, initial, each[welded].sum(axis=0), noise)


def _levers(ties: TieForces, state: Configuration) -> tuple[FloatArray, FloatArray]:
    """R_a l_c and R_b l_c, each (T, 3, 3) with c first."""
    a = state.rotation[ties.first] @ ties.lever
    b = state.rotation[ties.second] @ ties.lever
    return np.swapaxes(a, 1, 2), np.swapaxes(b, 1, 2)


def gaps(ties: TieForces, state: Configuration) -> FloatArray:
    """How far the springs are stretched, (T, 4, 3) m: at the centre, then at the three points."""
    a, b = _levers(ties, state)
    result = np.empty((len(a), 4, 3))
    result[:, 0] = state.position[ties.first] - state.position[ties.second] - ties.apart
    result[:, 1:] = a - b
    return result


def energy(ties: TieForces, state: Configuration) -> float:
    """What the ties hold beyond what the modes do, E − ½ qᵀHq, J."""
    stretch = gaps(ties, state)
    whole = 0.5 * float(np.sum(ties.stiffness * stretch * stretch))
    return whole - 0.5 * float(state.q @ ties.initial @ state.q)


def tension(ties: TieForces, state: Configuration) -> FloatArray:
    """Forces in the springs, (T, 4, 3) N."""
    result: FloatArray = ties.stiffness * gaps(ties, state)
    return result


def nodal_loads(ties: TieForces, state: Configuration, tense: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loads of springs of a given tension (T, 4, 3) on the tree's nodes.

    Returns
    -------
    force, moment : (K, 3) float
        N and N m, global frame.
    """
    a, b = _levers(ties, state)
    force = np.zeros_like(state.position)
    moment = np.zeros_like(force)
    force[ties.first], force[ties.second] = -tense[:, 0], tense[:, 0]
    moment[ties.first] = -cross(a, tense[:, 1:]).sum(axis=1)
    moment[ties.second] = cross(b, tense[:, 1:]).sum(axis=1)
    return force, moment


def gap_derivative(ties: TieForces, state: Configuration, translation: FloatArray, spin: FloatArray) -> FloatArray:
    """Derivative of `gaps` with respect to q, (T, 4, 3, m), from the tree's `jacobians`."""
    a, b = _levers(ties, state)
    result = np.empty((len(a), 4, 3, translation.shape[-1]))
    result[:, 0] = translation[ties.first] - translation[ties.second]
    result[:, 1:] = skew(b) @ spin[ties.second][:, None] - skew(a) @ spin[ties.first][:, None]
    return result


def relative_motion(ties: TieForces, tree: Tree, state: Configuration) -> FloatArray:
    """Derivative of how ends a move and turn against ends b with respect to q: six rows a tie, (6T, m)."""
    translation, spin = jacobians(tree, state)
    both = np.stack([x[ties.first] - x[ties.second] for x in (translation, spin)], axis=1)
    return both.reshape(-1, both.shape[-1])


def relative_stiffness(ties: TieForces, state: Configuration) -> FloatArray:
    """What ties resist such motions with, (6T, 6T), as long as their ends stay close."""
    arms = skew(_levers(ties, state)[0])
    count = len(arms)
    result = np.zeros((count, 6, count, 6))
    each = np.arange(count)
    result[each, :3, each, :3] = ties.stiffness * np.eye(3)
    result[each, 3:, each, 3:] = np.einsum("tcli,tl,tclj->tij", arms, ties.stiffness[:, 0], arms)
    return result.reshape(6 * count, 6 * count)


def resisting(ties: TieForces) -> IntArray:
    """Which of the 6T motions of `relative_motion` ties resist, in some position of their ends."""
    directions = np.broadcast_to(ties.stiffness[:, 0] > 0.0, (len(ties.apart), 3))
    turns = np.any(ties.stiffness > 0.0, axis=(1, 2)) & np.any(ties.lever != 0.0, axis=(1, 2))
    kept = np.concatenate([directions, np.repeat(turns[:, None], 3, axis=1)], axis=1)
    return np.flatnonzero(kept)


def moment_stiffness(ties: TieForces, state: Configuration, tense: FloatArray, spin: FloatArray) -> FloatArray:
    """Σ Wᵀ (∂m/∂ω) W (m, m) of the moments of springs of a given tension, which turn with their points."""
    result = np.zeros((spin.shape[-1], spin.shape[-1]))
    for end, arms, sign in (
        (ties.first, *_levers(ties, state)[:1], -1.0),
        (ties.second, *_levers(ties, state)[1:], 1.0),
    ):
        # (ω × r) × t = r (ω·t) − ω (r·t)
        turned = np.einsum("tci,tcj->tij", arms, tense[:, 1:])
        change = turned - np.trace(turned, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        own = spin[end]
        result += sign * np.einsum("tim,tij,tjn->mn", own, change, own, optimize=True)
    return result


def foreseen_tension(
    ties: TieForces, state: Configuration, translation: FloatArray, spin: FloatArray, change: FloatArray
) -> FloatArray:
    """Tension (T, 4, 3) that the springs will have once q has changed by `change` (m,), to first order."""
    result: FloatArray = ties.stiffness * (gaps(ties, state) + gap_derivative(ties, state, translation, spin) @ change)
    return result
