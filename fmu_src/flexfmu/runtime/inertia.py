"""Mass of the deformed body, M(q) = Jᵀ M_FE J, from constant integrals of each frame (docs/theory.md, section 9).

What frame s carries goes to x' = x_s + R_s y with y = r + Σ e_j q_j, r = X − X_s, e_j the remainder of mode j in the
frame. Per unit of q_j all of it moves by

    Rᵀ ∂x'/∂q_j = t_j + w_j × y + e_j,

t_j and w_j being the frame's own motion. So the kinetic energy knows of the finite element model only the moments of
r and e_j: ∫ρ, ∫ρ y_a and ∫ρ y_a ⊗ y_b, which are constants. The derivatives of M follow from those of t_j, w_j and y,
exactly. Source: A. A. Shabana, Dynamics of Multibody Systems, 4th ed., chapter 5 (inertia shape integrals).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .errors import ModalFileError
from .rotations import cross, skew
from .tree import Configuration, Tree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Below this |φ|² the series of T's derivative are exact to round-off, above it the closed forms lose under 1e-13.
_SERIES_LIMIT = 0.05
# axial(A)_l = Σ ε_lik A_ik, so that axial(∫ρ a ⊗ b) = ∫ρ a × b.
_EPSILON = np.zeros((3, 3, 3))
_EPSILON[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_EPSILON[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0
_AXIAL = np.ascontiguousarray(_EPSILON.reshape(3, 9).T)


@dataclass(frozen=True, slots=True)
class InertiaIntegrals:
    """Moments of the mass that P frames carry; index 0 stands for r, index j for the remainder e_j of mode j.

    Arrays are made read-only.

    Attributes
    ----------
    frame : (P,) int
        The frame that carries each part.
    mass : (P,) float
        ∫ρ dV, kg.
    first : (P, 1 + m, 3) float
        ∫ρ y_a dV: kg m, and kg^1/2.
    second : (P, 1 + m, 1 + m, 3, 3) float
        ∫ρ y_a ⊗ y_b dV: kg m², kg^1/2 m and 1.
    ground : (m, m) float
        ∫ρ φ_i · φ_j dV of what lies on no frame.
    elastic : (m, m) float
        What M holds whatever q is: ∫ρ e_i · e_j dV of all parts, and `ground`.
    """

    frame: IntArray
    mass: FloatArray
    first: FloatArray
    second: FloatArray
    ground: FloatArray
    elastic: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        """Bring the arrays into their types and check their shapes.

        Raises
        ------
        ModalFileError
            Naming the array that is wrong, and how.
        """
        parts, modes = np.size(self.frame), len(self.ground)
        shapes = {
            "frame": (parts,),
            "mass": (parts,),
            "first": (parts, 1 + modes, 3),
            "second": (parts, 1 + modes, 1 + modes, 3, 3),
            "ground": (modes, modes),
        }
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=np.int64 if name == "frame" else np.float64)
            if value.shape != shape:
                raise ModalFileError(f"inertia: {name} has shape {value.shape}, expected {shape}")
            if not np.all(np.isfinite(value)):
                raise ModalFileError(f"inertia: {name} holds values that are not finite")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        elastic = self.ground + np.einsum("pabii->ab", self.second[:, 1:, 1:])
        elastic.flags.writeable = False
        object.__setattr__(self, "elastic", elastic)

    @property
    def mode_count(self) -> int:
        """Number of modal coordinates m."""
        return len(self.ground)


@dataclass(frozen=True, slots=True)
class _Motion:
    """Derivatives of the S frames' places, in the global frame, with what their own derivatives need.

    Attributes
    ----------
    turn, spin, parent_spin : (S, 3, m) float
        Spin relative to the parent, spin, and the parent's.
    push : (S, 3, m) float
        R_p D.
    arm : (S, 3) float
        R_p b.
    translation : (S, 3, m) float
    """

    turn: FloatArray
    spin: FloatArray
    parent_spin: FloatArray
    push: FloatArray
    arm: FloatArray
    translation: FloatArray


def _along(path: FloatArray, values: FloatArray) -> FloatArray:
    """Sum of values (S, ...) over the path of each frame to its root."""
    return (path @ values.reshape(len(path), -1)).reshape(values.shape)


def _motion(tree: Tree, state: Configuration) -> _Motion:
    count = tree.frame_count
    d, c = tree.operator.reshape(2, len(tree.parent), 3, -1)[:, :count]
    path, rotation = tree.path[:count, :count], state.parent_rotation[:count]
    turn, push = rotation @ (state.jacobian[:count] @ c), rotation @ d
    spin = _along(path, turn)
    parent_spin = spin - turn
    arm = (rotation @ state.offset[:count, :, None])[:, :, 0]
    return _Motion(turn, spin, parent_spin, push, arm, _along(path, push - skew(arm) @ parent_spin))


def _motion_rates(
    tree: Tree, state: Configuration, motion: _Motion, along: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of `translation` and `spin`, each (S, n, 3, m), in n directions (n, m)."""
    count = tree.frame_count
    c = tree.operator.reshape(2, len(tree.parent), 3, -1)[1, :count]
    path, rotation = tree.path[:count, :count], state.parent_rotation[:count, None]
    change = _jacobian_rate(state.relative[:count, None], along @ c.swapaxes(1, 2))
    parent_rate = along @ motion.parent_spin.swapaxes(1, 2)
    hat = skew(parent_rate)
    turn = hat @ motion.turn[:, None] + rotation @ (change @ c[:, None])
    spin = _along(path, turn)
    arm = cross(parent_rate, motion.arm[:, None]) + along @ motion.push.swapaxes(1, 2)
    step = hat @ motion.push[:, None] - skew(arm) @ motion.parent_spin[:, None]
    step -= skew(motion.arm)[:, None] @ (spin - turn)
    return _along(path, step), spin


def _jacobian_rate(vector: FloatArray, rate: FloatArray) -> FloatArray:
    """Derivative (S, n, 3, 3) of T = I + β φ̂ + γ φ̂² at φ (S, 1, 3) in directions (S, n, 3)."""
    x = (vector * vector).sum(axis=-1)[..., None, None]
    # Series where the closed forms of β, γ and their slopes over |φ| would cancel, exact to round-off.
    small = np.minimum(x, _SERIES_LIMIT)
    beta = 0.5 - small / 24.0 * (1.0 - small / 30.0 * (1.0 - small / 56.0 * (1.0 - small / 90.0)))
    gamma = (1.0 - small / 20.0 * (1.0 - small / 42.0 * (1.0 - small / 72.0 * (1.0 - small / 110.0)))) / 6.0
    beta_slope = (
        small / 15.0 * (1.0 - small * (3.0 / 112.0) * (1.0 - small * (2.0 / 135.0) * (1.0 - small / 105.6))) - 1.0
    ) / 12.0
    gamma_slope = (
        small / 21.0 * (1.0 - small / 48.0 * (1.0 - small * (2.0 / 165.0) * (1.0 - small / 124.8))) - 1.0
    ) / 60.0
    if np.any(x > _SERIES_LIMIT):
        large = x > _SERIES_LIMIT
        square = np.where(large, x, 1.0)
        angle = np.sqrt(square)
        alpha, half = np.sin(angle) / angle, np.sin(0.5 * angle)
        closed = 2.0 * half * half / square, (1.0 - alpha) / square
        beta, gamma = np.where(large, closed[0], beta), np.where(large, closed[1], gamma)
        beta_slope = np.where(large, (alpha - 2.0 * beta) / square, beta_slope)
        gamma_slope = np.where(large, (beta - 3.0 * gamma) / square, gamma_slope)
    hat, hat_rate = skew(vector), skew(rate)
    along = (vector * rate).sum(axis=-1)[..., None, None]
    result: FloatArray = (
        beta * hat_rate
        + gamma * (hat_rate @ hat + hat @ hat_rate)
        + along * (beta_slope * hat + gamma_slope * (hat @ hat))
    )
    return result


@dataclass(frozen=True, slots=True)
class _Moments:
    """Moments of the parts in one configuration, and the twists of their frames, in the frames' axes.

    Attributes
    ----------
    shape : (1 + m,) float
        One, then q: y is their sum over the index of `InertiaIntegrals`.
    back : (P, 3, 3) float
        Rᵀ of each part's frame.
    twist : (P, 6, m) float
        t_j and w_j.
    first : (P, 3) float
        ∫ρ y.
    mixed : (P, 1 + m, 3, 3) float
        ∫ρ y ⊗ y_b.
    """

    shape: FloatArray
    back: FloatArray
    twist: FloatArray
    first: FloatArray
    mixed: FloatArray


def _moments(inertia: InertiaIntegrals, state: Configuration, motion: _Motion) -> _Moments:
    shape = np.concatenate([[1.0], state.q])
    parts, count = inertia.mass.size, shape.size
    back = state.rotation[inertia.frame].swapaxes(1, 2)
    twist = np.concatenate([back @ motion.translation[inertia.frame], back @ motion.spin[inertia.frame]], axis=1)
    mixed = (shape @ inertia.second.reshape(parts, count, 9 * count)).reshape(parts, count, 3, 3)
    return _Moments(shape, back, twist, shape @ inertia.first, mixed)


def mass_matrix(tree: Tree, inertia: InertiaIntegrals, state: Configuration) -> FloatArray:
    """M(q), (m, m): symmetric; the identity where nothing has moved.

    Parameters
    ----------
    tree : Tree
        Of corotated frames.
    inertia : InertiaIntegrals
    state : Configuration
        At q.

    Returns
    -------
    (m, m) float
        1, since modal coordinates are mass-normalised.
    """
    moments = _moments(inertia, state, _motion(tree, state))
    parts, count = moments.mixed.shape[:2]
    square = (moments.shape @ moments.mixed.reshape(parts, count, 9)).reshape(parts, 3, 3)
    rigid = np.zeros((parts, 6, 6))
    rigid[:, :3, :3] = inertia.mass[:, None, None] * np.eye(3)
    rigid[:, 3:, :3] = lever = skew(moments.first)
    rigid[:, :3, 3:] = -lever
    rigid[:, 3:, 3:] = np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3) - square
    coupling = np.concatenate([inertia.first, moments.mixed.reshape(parts, count, 9) @ _AXIAL], axis=2)[:, 1:]
    half = 0.5 * (rigid @ moments.twist) + coupling.swapaxes(1, 2)
    product = moments.twist.reshape(6 * parts, -1).T @ half.reshape(6 * parts, -1)
    result: FloatArray = product + product.T + inertia.elastic
    return result


def mass_gradient(
    tree: Tree, inertia: InertiaIntegrals, state: Configuration, left: FloatArray, right: FloatArray
) -> FloatArray:
    """Derivative of leftᵀ M(q) right with respect to q.

    Parameters
    ----------
    tree : Tree
    inertia : InertiaIntegrals
    state : Configuration
        At q.
    left, right : (n, m) float
        n pairs of vectors that do not depend on q.

    Returns
    -------
    (n, m) float
    """
    n = len(left)
    found = _momentum_change(tree, inertia, state, np.concatenate([left, right]), np.roll(np.arange(2 * n), n))
    return found[:n] + found[n:]


def kinetic_gradient(tree: Tree, inertia: InertiaIntegrals, state: Configuration, rate: FloatArray) -> FloatArray:
    """Derivative of ½ q̇ᵀ M(q) q̇ with respect to q, (m,), at a fixed q̇ (m,); see `mass_gradient`."""
    gradient: FloatArray = _momentum_change(tree, inertia, state, rate[None], np.zeros(1, dtype=np.int64))[0]
    return gradient


def _momentum_change(
    tree: Tree, inertia: InertiaIntegrals, state: Configuration, along: FloatArray, other: IntArray
) -> FloatArray:
    """(∂J/∂q a)ᵀ M_FE J b, (n, m), for vectors a = `along` (n, m) and b = `along[other]`."""
    motion = _motion(tree, state)
    moments = _moments(inertia, state, motion)
    translation, spin = (
        moments.back[:, None] @ rate[inertia.frame] for rate in _motion_rates(tree, state, motion, along)
    )
    rate = along @ moments.twist.swapaxes(1, 2)
    hat = skew(rate[:, :, 3:])
    # Momentum of the motion: ∫ρ ẋ, ∫ρ ẋ ⊗ y_b, ∫ρ ẋ ⊗ y.
    momentum = inertia.mass[:, None, None] * rate[:, :, :3] + along @ inertia.first[:, 1:]
    momentum += cross(rate[:, :, 3:], moments.first[:, None])
    moment = hat[:, :, None] @ moments.mixed[:, None] + _elastic_moments(inertia, along)
    moment += rate[:, :, None, :3, None] * inertia.first[:, None, :, None, :]
    whole = _weighted(moments.shape, moment)
    if len(other) > 1:
        momentum, moment, whole = momentum[:, other], moment[:, other], whole[:, other]
    turned = whole @ hat.swapaxes(2, 3) + _weighted(along, moment[:, :, 1:])
    result = momentum[:, :, None] @ translation - _axial(whole)[:, :, None] @ spin
    result -= _axial(turned)[:, :, None] @ moments.twist[:, None, 3:]
    found = result[:, :, 0] - (_axial(moment[:, :, 1:]) @ rate[:, :, 3:, None])[:, :, :, 0]
    total: FloatArray = found.sum(axis=0)
    return total


def convective_force(tree: Tree, inertia: InertiaIntegrals, state: Configuration, rate: FloatArray) -> FloatArray:
    """Jᵀ M_FE J̇ q̇ = d(M q̇)/dt − ½ ∂(q̇ᵀ M q̇)/∂q − M q̈: centrifugal and Coriolis forces with their sign reversed.

    Parameters
    ----------
    tree : Tree
    inertia : InertiaIntegrals
    state : Configuration
        At q.
    rate : (m,) float
        q̇.

    Returns
    -------
    (m,) float
        kg^1/2 m/s².
    """
    motion = _motion(tree, state)
    moments = _moments(inertia, state, motion)
    # Convective acceleration of the frames, (P, 6), and of y: α × y + ω × (ω × y) + 2 ω × ė.
    rates = [(r[inertia.frame, 0] @ rate)[:, :, None] for r in _motion_rates(tree, state, motion, rate[None])]
    linear, angular = ((moments.back @ r)[:, :, 0] for r in rates)
    hat = skew(moments.twist[:, 3:] @ rate)
    whirl = skew(angular) + hat @ hat
    momentum = inertia.mass[:, None] * linear + (whirl @ moments.first[:, :, None])[:, :, 0]
    momentum += 2.0 * (hat @ (rate @ inertia.first[:, 1:])[:, :, None])[:, :, 0]
    moment = whirl[:, None] @ moments.mixed + 2.0 * hat[:, None] @ _elastic_moments(inertia, rate[None])[:, 0]
    moment += linear[:, None, :, None] * inertia.first[:, :, None, :]
    whole = _weighted(moments.shape, moment)
    wrench = np.concatenate([momentum, -_axial(whole)], axis=1)
    result: FloatArray = wrench.ravel() @ moments.twist.reshape(wrench.size, -1)
    trace: FloatArray = moment[:, 1:, [0, 1, 2], [0, 1, 2]].sum(axis=(0, 2))
    return result + trace


def without_frames(inertia: InertiaIntegrals, turn: FloatArray, motions: FloatArray, gone: int) -> InertiaIntegrals:
    """Integrals of the same body in another basis, the first frames taken away.

    Parameters
    ----------
    inertia : InertiaIntegrals
    turn : (m, k) float
        New modes as combinations of the old ones.
    motions : (S, 6, m) float
        Displacement and rotation of every frame's joint, per unit of the old coordinates.
    gone : int
        Number of frames that are taken away. What they carry moves linearly from then on.

    Returns
    -------
    InertiaIntegrals
    """
    parts, count = inertia.first.shape[:2]
    change = np.eye(count, 1 + turn.shape[1])
    change[1:, 1:], change[1:, :1] = turn, 0.0
    lost = inertia.frame < gone
    # φ = u(X_s) + θ_s × r + e: the mass of the undeformed part.
    twist, moments = motions[inertia.frame], inertia.second.reshape(parts, count, count, 9)
    arm = inertia.first[:, 0]
    rigid = np.zeros((parts, 6, 6))
    rigid[:, :3, :3] = inertia.mass[:, None, None] * np.eye(3)
    rigid[:, 3:, :3], rigid[:, :3, 3:] = skew(arm), -skew(arm)
    square = inertia.second[:, 0, 0]
    rigid[:, 3:, 3:] = np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3) - square
    coupling = np.concatenate([inertia.first[:, 1:], moments[:, 0, 1:] @ _AXIAL], axis=2).swapaxes(1, 2)
    half = twist.swapaxes(1, 2) @ (0.5 * (rigid @ twist) + coupling)
    whole = half + half.swapaxes(1, 2) + np.einsum("pabii->pab", inertia.second[:, 1:, 1:])
    return InertiaIntegrals(
        inertia.frame[~lost] - gone,
        inertia.mass[~lost],
        np.einsum("pai,ab->pbi", inertia.first[~lost], change),
        np.einsum("pabij,ac,bd->pcdij", inertia.second[~lost], change, change, optimize=True),
        turn.T @ (inertia.ground + whole[lost].sum(axis=0)) @ turn,
    )


def _elastic_moments(inertia: InertiaIntegrals, along: FloatArray) -> FloatArray:
    """∫ρ e ⊗ y_b with e = Σ e_j along_j, (P, n, 1 + m, 3, 3), for n vectors (n, m)."""
    parts, count = inertia.first.shape[:2]
    flat = inertia.second.reshape(parts, count, 9 * count)[:, 1:]
    return (along @ flat).reshape(parts, len(along), count, 3, 3)


def _weighted(weight: FloatArray, tensor: FloatArray) -> FloatArray:
    """Sum of tensors (..., k, 3, 3) with weights (..., k)."""
    flat = tensor.reshape(*tensor.shape[:-2], 9)
    result: FloatArray = (weight[..., None, :] @ flat).reshape(*flat.shape[:-2], 3, 3)
    return result


def _axial(tensor: FloatArray) -> FloatArray:
    """Axial vectors (..., 3) of tensors (..., 3, 3): that of a ⊗ b is a × b."""
    return tensor.reshape(*tensor.shape[:-2], 9) @ _AXIAL
