"""Elements of one type, and what follows from where their nodes are: faces, Jacobians, volumes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flexfmu.files.array_types import BoolArray, FloatArray, IntArray
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.shapes import FACE_SHAPES


@dataclass(frozen=True, slots=True)
class ElementBlock:
    """Elements of one type.

    Attributes
    ----------
    type : ElementType
    labels : (n_elements,) int
        The file's element numbers.
    connectivity : (n_elements, node_count) int
        Rows of `Mesh.points`.
    material : (n_elements,) int
        Rows of `Mesh.materials`; `NO_MATERIAL` where the file gives none.
    axes : (n_elements, 3, 3) float, optional
        Axes of the material as columns, global frame; by default the global axes.
    section : (n_elements, 8) float, optional
        Of beams: area, ∫x₁² dA, ∫x₂² dA, torsion constant, shear areas along both axes; m², m⁴; where the shear centre
        is from the centroid, m.
    """

    type: ElementType
    labels: IntArray
    connectivity: IntArray
    material: IntArray
    axes: FloatArray | None = None
    section: FloatArray | None = None

    @property
    def filling(self) -> FloatArray:
        """Volume over that of the brick between the nodes (n_elements, 1); one but of beams."""
        if self.section is None:
            return np.ones((len(self.labels), 1))
        area, first, second = self.section[:, :3].T
        return (area**2 / np.sqrt(144.0 * first * second))[:, None]

    def part(self, chosen: IntArray | BoolArray) -> "ElementBlock":
        """Return some of the elements.

        Parameters
        ----------
        chosen : (k,) int or (n_elements,) bool

        Returns
        -------
        ElementBlock
        """
        axes = None if self.axes is None else self.axes[chosen]
        section = None if self.section is None else self.section[chosen]
        rows = self.labels[chosen], self.connectivity[chosen], self.material[chosen]
        return ElementBlock(self.type, *rows, axes, section)


def by_block(blocks: Sequence[ElementBlock], elements: IntArray) -> Iterator[tuple[ElementBlock, IntArray]]:
    """Yield each block that has some of the elements, counted over all blocks, and their places in it.

    Parameters
    ----------
    blocks : sequence of ElementBlock
    elements : (k,) int

    Yields
    ------
    block : ElementBlock
    places : (j,) int
    """
    start = 0
    for block in blocks:
        inside = elements[(elements >= start) & (elements < start + len(block.labels))] - start
        start += len(block.labels)
        if inside.size:
            yield block, inside


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
    beyond : (n_faces,) int
        The other element, at the first of two faces that are one; −1 at the second and outside.
    """

    nodes: IntArray
    element: IntArray
    outer: BoolArray
    beyond: IntArray

    @property
    def corner_count(self) -> int:
        """Three or four."""
        return face_corners(self.nodes)


def face_corners(nodes: IntArray) -> int:
    """Number of corners of faces (f, k)."""
    return len(FACE_SHAPES[nodes.shape[1]].polytope.corners)


def faces_of(blocks: Sequence[ElementBlock]) -> tuple[FaceBlock, ...]:
    """All faces of all elements; a face between two elements appears twice.

    Parameters
    ----------
    blocks : sequence of ElementBlock

    Returns
    -------
    tuple of FaceBlock
        One per block, two of wedges: triangles, then rectangles.
    """
    first = 0
    found, keys = [], []
    for block in blocks:
        faces = block.type.shape.faces
        for width in sorted({len(face) for face in faces}):
            table = np.array([face for face in faces if len(face) == width])
            nodes = block.connectivity[:, table].reshape(-1, width)
            corners = face_corners(nodes)
            key = np.full((len(nodes), 4), -1)
            key[:, :corners] = np.sort(nodes[:, :corners], axis=1)
            found.append((nodes, first + np.repeat(np.arange(len(block.labels)), len(table))))
            keys.append(key)
        first += len(block.labels)
    if not keys:
        return ()
    _, inverse, count = np.unique(np.concatenate(keys), axis=0, return_inverse=True, return_counts=True)
    face = inverse.ravel()
    element, beyond = np.concatenate([one for _, one in found]), np.full(len(face), -1)
    order = np.argsort(face, kind="stable")
    same = np.flatnonzero(face[order[1:]] == face[order[:-1]])
    beyond[order[same]] = element[order[same + 1]]
    ends = np.cumsum([len(key) for key in keys])[:-1]
    parts = zip(found, np.split((count == 1)[face], ends), np.split(beyond, ends), strict=True)
    return tuple(FaceBlock(*both, outer, other) for both, outer, other in parts)


def jacobians(corners: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the elements' own coordinates by place, and how much larger the elements are than their polytope.

    Parameters
    ----------
    corners : (e, n, 3) float
        Places of the elements' nodes, m.
    slope : (q, n, 3) float
        Gradients of the shape functions at some points.

    Returns
    -------
    inverse : (e, q, 3, 3) float
        1/m.
    determinant : (e, q) float
        m³.
    """
    u, v, w = np.einsum("eai,qaJ->Jeqi", corners, slope, optimize=True)
    adjugate = np.stack([np.cross(v, w), np.cross(w, u), np.cross(u, v)], axis=2)
    determinant: FloatArray = np.einsum("eqi,eqi->eq", u, adjugate[:, :, 0])
    return adjugate / determinant[..., None, None], determinant


def volume_matrices(points: FloatArray, blocks: Sequence[ElementBlock]) -> tuple[FloatArray, ...]:
    """∫ N_a N_b dV of each element, by the mass quadrature of its type.

    Parameters
    ----------
    points : (n, 3) float
        m.
    blocks : sequence of ElementBlock

    Returns
    -------
    tuple of (n_elements, node_count, node_count) float
        One array per block, m³.
    """
    found = []
    for block in blocks:
        rule, shape = block.type.mass, block.type.shape
        value = shape.value(rule.points)
        volume = jacobians(points[block.connectivity], shape.gradient(rule.points))[1] * rule.weights
        volume *= block.filling
        found.append(np.einsum("qa,qb,eq->eab", value, value, volume, optimize=True))
    return tuple(found)
