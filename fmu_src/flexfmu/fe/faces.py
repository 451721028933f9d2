"""Element faces: which ones a node set consists of, and how nodes share in an area."""

import numpy as np
import scipy.sparse as sp

from ..files.basics import FloatArray, IntArray
from ..mesh.elements import FaceBlock
from ..mesh.shapes import FACE_RULES, FACE_SHAPES
from .assembly import scatter


def select(faces: tuple[FaceBlock, ...], nodes: IntArray, *, outer: bool) -> tuple[IntArray, ...]:
    """Faces all of whose nodes are in a set.

    Parameters
    ----------
    faces : tuple of FaceBlock
    nodes : (k,) int
    outer : bool
        Only faces on the body's surface.

    Returns
    -------
    tuple of (n_faces, node_count) int
        Each face once.
    """
    result = []
    for block in faces:
        member = np.zeros(max(int(block.nodes.max()), int(nodes.max())) + 1, dtype=bool)
        member[nodes] = True
        chosen = np.all(member[block.nodes], axis=1)
        if outer:
            chosen &= block.outer
        picked = block.nodes[chosen]
        _, once = np.unique(np.sort(picked, axis=1), axis=0, return_index=True)
        result.append(picked[np.sort(once)])
    return tuple(result)


def area_matrix(points: FloatArray, faces: tuple[IntArray, ...], nodes: IntArray) -> sp.csr_array | None:
    """∫ N_a N_b dA over faces, as a matrix over the nodes of a set.

    A least-squares fit with this weight is one over the area itself, not over however many nodes it has: a force that
    is spread by its transpose is a uniform traction.

    Parameters
    ----------
    points : (n, 3) float
    faces : tuple of (n_faces, node_count) int
    nodes : (k,) int
        The set, ascending.

    Returns
    -------
    (k, k) sparse or None
        m²; None where the faces do not cover every node of the set.
    """
    covered = np.unique(np.concatenate([block.ravel() for block in faces])) if faces else np.zeros(0)
    if not np.array_equal(covered, nodes):
        return None
    total = sp.csr_array((nodes.size, nodes.size))
    for block in faces:
        if not len(block):
            continue
        shape, rule = FACE_SHAPES[block.shape[1]], FACE_RULES[block.shape[1]]
        value = shape.value(rule.points)
        tangents = np.einsum("fai,qaj->qfij", points[block], shape.gradient(rule.points))
        area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)
        matrices = np.einsum("qa,qb,q,qf->fab", value, value, rule.weights, area, optimize=True)
        total = total + scatter(np.searchsorted(nodes, block), matrices, nodes.size)
    return total
