"""Vector products, and second derivatives of the tree's offsets and rotations: places are right to second order.

The finite element model gives where the nodes of the tree go to second order in q, seen from one place: the ground, or
the floating frame. The tree composes these motions of finite rotations, which have second-order parts of their own.
What is left for each offset and relative rotation is the difference, docs/theory.md equations (19) and (20). Places are
then those of the finite element model to second order, whatever the frames are.
"""

import numpy as np

from ..files.basics import FloatArray

# φ @ _CROSS is φ̂, row by row.
_CROSS = np.zeros((3, 9))
_CROSS[0, [5, 7]] = -1.0, 1.0
_CROSS[1, [2, 6]] = 1.0, -1.0
_CROSS[2, [1, 3]] = -1.0, 1.0
PERMUTATION = np.zeros((3, 3, 3))
PERMUTATION[[0, 1, 2], [1, 2, 0], [2, 0, 1]], PERMUTATION[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = 1.0, -1.0


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


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Second derivative (..., 3, m, m) of the vector product of two linear functions of q, (..., 3, m) each."""
    half = np.einsum("...ija,...jb->...iab", np.moveaxis(skew(np.swapaxes(first, -1, -2)), -3, -1), second)
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


def turned_by(vector: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) of rotation vectors (..., 3), complex ones too."""
    square = (vector**2).sum(axis=-1)[..., None, None]
    small = np.abs(square) < 1e-8
    angle = np.sqrt(np.where(small, 1.0, square))
    one = np.where(small, 1.0 - square / 6.0, np.sin(angle) / angle)
    two = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(angle)) / np.where(small, 1.0, square))
    cross = np.einsum("ijk,...j->...ik", PERMUTATION, vector)
    return np.eye(3) + one * cross + two * cross @ cross


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3) of rotations (..., 3, 3) by less than half a turn, complex ones too."""
    sine = 0.5 * np.einsum("ijk,...kj->...i", PERMUTATION, rotation)
    square, cosine = (sine**2).sum(axis=-1), 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    # Near half a turn the sine is as small.
    small = (np.abs(square) < 1e-8) & (cosine.real > 0.0)
    size = np.sqrt(np.where(small, 1.0, square))
    return sine * np.where(small, 1.0 + square / 6.0, 2.0 * np.arctan(size / (1.0 + cosine)) / size)[..., None]
