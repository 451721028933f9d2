"""Element faces: which ones a node set consists of, and how nodes share in an area."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..files.array_types import BoolArray, FloatArray, IntArray
from ..mesh.model import Mesh
from .elements import FACES, face_rule


@dataclass(frozen=True, slots=True)
class FaceBlock:
    """Faces with the same number of nodes.

    Attributes
    ----------
    nodes : (n_faces, k) int
        Rows of `Mesh.points`, corners first; the outward side is not told.
    element : (n_faces,) int
        Element to which the face belongs, counted over all blocks.
    outer : (n_faces,) bool
        Whether no other element shares the face.
    """

    nodes: IntArray
    element: IntArray
    outer: BoolArray

    @property
    def corner_count(self) -> int:
        """Three or four."""
        return 3 if self.nodes.shape[1] in (3, 6) else 4


def element_faces(mesh: Mesh) -> tuple[FaceBlock, ...]:
    """All faces of all elements; a face between two elements appears twice.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    tuple of FaceBlock
        One per block of the mesh, two of wedges: triangles, then rectangles.
    """
    first = 0
    blocks, keys = [], []
    for block in mesh.blocks:
        for table in FACES[block.type]:
            nodes = block.connectivity[:, table].reshape(-1, table.shape[1])
            element = first + np.repeat(np.arange(len(block.labels)), len(table))
            corners = 3 if table.shape[1] in (3, 6) else 4
            key = np.full((len(nodes), 4), -1)
            key[:, :corners] = np.sort(nodes[:, :corners], axis=1)
            blocks.append((nodes, element))
            keys.append(key)
        first += len(block.labels)
    _, inverse, count = np.unique(np.concatenate(keys), axis=0, return_inverse=True, return_counts=True)
    outer = (count == 1)[inverse.ravel()]
    ends = np.cumsum([len(key) for key in keys])
    return tuple(
        FaceBlock(nodes, element, outer[end - len(element) : end])
        for (nodes, element), end in zip(blocks, ends, strict=True)
    )


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
        count = block.shape[1]
        value, gradient, weight = face_rule(count)
        tangents = np.einsum("fai,qaj->qfij", points[block], gradient)
        area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)
        matrices = np.einsum("qa,qb,q,qf->fab", value, value, weight, area, optimize=True)
        local = np.searchsorted(nodes, block)
        rows, columns = np.repeat(local, count, axis=1).ravel(), np.tile(local, (1, count)).ravel()
        total = total + sp.csr_array(sp.coo_array((matrices.ravel(), (rows, columns)), shape=total.shape))
    return total
