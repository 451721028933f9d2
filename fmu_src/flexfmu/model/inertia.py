"""Mass of the deformed body, M(q) = Jᵀ M_FE J, from constant integrals of each frame (docs/theory.md, section 9).

What frame s carries goes to x' = x_s + R_s y with y = r + Σ e_j q_j, r = X − X_s, e_j the remainder of mode j in the
frame. Per unit of q_j all of it moves by

    Rᵀ ∂x'/∂q_j = t_j + w_j × y + e_j,

t_j and w_j being the frame's own motion. So the kinetic energy knows of the finite element model only the moments of
r and e_j: ∫ρ, ∫ρ y_a and ∫ρ y_a ⊗ y_b, which are constants; the core (core/inertia.c) makes M of them. Source: A. A.
Shabana, Dynamics of Multibody Systems, 4th ed., chapter 5 (inertia shape integrals).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..rotations import skew
from .arrays import INERTIA, settle

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

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
        settle(self, INERTIA, {"m": len(self.ground)}, "inertia")
        elastic = self.ground + np.einsum("pabii->ab", self.second[:, 1:, 1:])
        elastic.flags.writeable = False
        object.__setattr__(self, "elastic", elastic)

    @property
    def mode_count(self) -> int:
        """Number of modal coordinates m."""
        return len(self.ground)


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
