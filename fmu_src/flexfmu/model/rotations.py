"""Finite rotations in three dimensions by their rotation vectors, on stacks of any leading shape.

A rotation vector φ (rad) turns by |φ| about φ/|φ|; its matrix is exp(φ̂), φ̂ x = φ × x. All formulas are
closed forms in three functions of |φ|, expanded in series where they would cancel:

    α = sin|φ|/|φ|,   β = (1 − cos|φ|)/|φ|²,   γ = (|φ| − sin|φ|)/|φ|³.

Source: M. Géradin, A. Cardona, Flexible Multibody Dynamics, Wiley 2001, chapter 4.

Beside them, second derivatives of the tree's offsets and rotations, so that places are right to second order in q.

The finite element model gives where the nodes of the tree go to second order in q, seen from one place: the ground, or
the floating frame. The tree composes these motions of finite rotations, which have second-order parts of their own.
What is left for each offset and relative rotation is the difference, docs/theory.md equations (19) and (20). Places are
then those of the finite element model to second order, whatever the frames are.
"""

import numpy as np

from ..files.basics import FloatArray

# Keeps |φ| off zero where it divides; far below round-off of any rotation.
_TINY = 1e-20
_IDENTITY = np.eye(3).ravel()
# φ @ _CROSS is φ̂, row by row.
_CROSS = np.zeros((3, 9))
_CROSS[0, [5, 7]] = -1.0, 1.0
_CROSS[1, [2, 6]] = 1.0, -1.0
_CROSS[2, [1, 3]] = -1.0, 1.0


def skew(vector: FloatArray) -> FloatArray:
    """Matrix of the vector product, φ̂ x = φ × x.

    Parameters
    ----------
    vector : (..., 3) float

    Returns
    -------
    (..., 3, 3) float
    """
    return (vector @ _CROSS).reshape(*vector.shape, 3)


def exponential(vector: FloatArray) -> FloatArray:
    """Rotation matrix exp(φ̂) (Rodrigues' formula).

    Parameters
    ----------
    vector : (..., 3) float
        Rotation vectors, rad.

    Returns
    -------
    (..., 3, 3) float
    """
    return exponential_and_jacobian(vector)[0]


def exponential_and_jacobian(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation matrix E = exp(φ̂) and left Jacobian T with  Ė Eᵀ = (T φ̇)^.

    Parameters
    ----------
    vector : (..., 3) float
        Rotation vectors φ, rad.

    Returns
    -------
    rotation : (..., 3, 3) float
        I + α φ̂ + β φ̂².
    jacobian : (..., 3, 3) float
        I + β φ̂ + γ φ̂².
    """
    square = np.einsum("...i,...i->...", vector, vector)
    # The closed forms lose digits of β and γ near zero, but there they meet φ̂ and φ̂² that are as small.
    angle = np.sqrt(square + _TINY)
    sine, cosine = np.sin(0.5 * angle), np.cos(0.5 * angle)
    twice = 2.0 * sine / angle
    basis = np.empty((*square.shape, 3, 9))
    basis[..., 0, :] = _IDENTITY
    basis[..., 1, :] = vector @ _CROSS
    hat = basis[..., 1, :].reshape(*vector.shape, 3)
    basis[..., 2, :] = (hat @ hat).reshape(*square.shape, 9)
    weights = np.ones((*square.shape, 2, 3))
    weights[..., 0, 1] = alpha = twice * cosine
    weights[..., 0, 2] = weights[..., 1, 1] = 0.5 * twice * twice
    weights[..., 1, 2] = (1.0 - alpha) / (angle * angle)
    both = (weights @ basis).reshape(*square.shape, 2, 3, 3)
    return both[..., 0, :, :], both[..., 1, :, :]


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, |φ| ≤ π, accurate near 0 and near π (by the unit quaternion).

    Parameters
    ----------
    rotation : (..., 3, 3) float

    Returns
    -------
    (..., 3) float
        rad.
    """
    r = rotation
    trace = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    diagonal = np.stack([r[..., 0, 0], r[..., 1, 1], r[..., 2, 2], trace], axis=-1)
    axial = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
    # 4 q qᵀ of the quaternion q = (vector, scalar); its column with the largest diagonal is the safest to divide by.
    product = np.empty((*trace.shape, 4, 4))
    product[..., :3, :3] = r + np.swapaxes(r, -1, -2)
    for i in range(3):
        product[..., i, i] = 1.0 + 2.0 * r[..., i, i] - trace
    product[..., :3, 3] = product[..., 3, :3] = axial
    product[..., 3, 3] = 1.0 + trace
    best = np.argmax(diagonal, axis=-1)
    quaternion = np.take_along_axis(product, best[..., None, None], axis=-1)[..., 0]
    quaternion /= np.sqrt(np.einsum("...i,...i->...", quaternion, quaternion))[..., None]
    quaternion *= np.where(quaternion[..., 3:] < 0.0, -1.0, 1.0)
    vector = quaternion[..., :3]
    sine = np.sqrt(np.einsum("...i,...i->...", vector, vector))
    angle = 2.0 * np.arctan2(sine, quaternion[..., 3])
    scale = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)
    return scale[..., None] * vector


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Second derivative (..., 3, m, m) of the vector product of two linear functions of q, (..., 3, m) each."""
    matrices = np.moveaxis(skew(np.swapaxes(first, -1, -2)), -3, -1)
    half = np.einsum("...ija,...jb->...iab", matrices, second)
    return half + np.swapaxes(half, -1, -2)


def from_ground(
    seen: tuple[FloatArray, FloatArray], reference: FloatArray, arm: FloatArray, change: FloatArray, turn: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of motions seen from the ground, of those seen from a reference that turns.

    Parameters
    ----------
    seen : pair of (K, 3, m, m) float
        Second derivatives of displacements and rotation vectors, seen from the reference.
    reference : (3, m) float
        Its linear rotation.
    arm : (K, 3) float
        From the point about which it turns to the nodes, m.
    change : (K, 3, m) float
        Linear displacements of the nodes seen from the reference.
    turn : (K, 3, m) float
        Linear rotations of the nodes seen from the ground.

    Returns
    -------
    displacement, rotation : (K, 3, m, m) float
    """
    displacement, rotation = seen
    whole = np.broadcast_to(reference, turn.shape)
    d = displacement + product(whole, change) + 0.5 * product(whole, -skew(arm) @ reference)
    return d, rotation + 0.5 * product(whole, turn)
