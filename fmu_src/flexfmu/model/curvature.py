"""Second derivatives of the tree's offsets and rotations, so that places are right to second order in q.

The finite element model gives where the nodes of the tree go to second order in q, seen from one place: the ground, or
the floating frame. The tree composes these motions of finite rotations, which have second-order parts of their own.
What is left for each offset and relative rotation is the difference, docs/theory.md equations (19) and (20). Places are
then those of the finite element model to second order, whatever the frames are.
"""

import numpy as np

from ..files.basics import FloatArray
from .rotations import skew


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Second derivative (..., 3, m, m) of the vector product of two linear functions of q, (..., 3, m) each."""
    matrices = np.moveaxis(skew(np.swapaxes(first, -1, -2)), -3, -1)
    half = np.einsum("...ija,...jb->...iab", matrices, second)
    return half + np.swapaxes(half, -1, -2)


def relative_curvature(
    displacement: FloatArray,
    rotation: FloatArray,
    parent_turn: FloatArray,
    turn: FloatArray,
    offset: FloatArray,
    change: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of a node's offset and relative rotation in its parent's frame.

    Parameters
    ----------
    displacement : (K, 3, m, m) float
        Second derivatives of the node's displacement less that of its parent's joint.
    rotation : (2, K, 3, m, m) float
        Second derivatives of rotation vectors: the node's, then its parent's.
    parent_turn, turn : (K, 3, m) float
        Linear rotations of the parent and of the node.
    offset : (K, 3) float
        From the parent's joint to the node, m.
    change : (K, 3, m) float
        What is left of the node's linear displacement in the parent's frame.

    Returns
    -------
    offset, rotation : (K, 3, m, m) float
    """
    own, parent = rotation
    d = displacement + np.einsum("kij,kjab->kiab", skew(offset), parent)
    d -= product(parent_turn, change) + 0.5 * product(parent_turn, -skew(offset) @ parent_turn)
    return d, own - parent - 0.5 * product(parent_turn, turn)


def from_ground(
    displacement: FloatArray,
    rotation: FloatArray,
    reference: FloatArray,
    arm: FloatArray,
    change: FloatArray,
    turn: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of motions seen from the ground, of those seen from a reference that turns.

    Parameters
    ----------
    displacement, rotation : (K, 3, m, m) float
        Second derivatives seen from the reference.
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
    whole = np.broadcast_to(reference, turn.shape)
    d = displacement + product(whole, change) + 0.5 * product(whole, -skew(arm) @ reference)
    return d, rotation + 0.5 * product(whole, turn)
