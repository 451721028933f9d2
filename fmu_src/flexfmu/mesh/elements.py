"""The table of elements: what a body may be made of, and blocks of them. Beside it nothing says what an element is."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from flexfmu.files.basics import BoolArray, FloatArray, IntArray
from flexfmu.mesh import shapes
from flexfmu.mesh.shapes import Quadrature, Shape, Sheet, StrainRule, prism_rule, rectangle_rule, shell_rule


class ElementType(Enum):
    """The solid elements by their Abaqus and CalculiX names, a row each.

    C3D20R takes 2 × 2 × 2 points for stiffness and mass both, as CalculiX does; all others are fully integrated. C3D6
    has two points, as both solvers have it: one alone can twist without energy.

    Attributes
    ----------
    shape : Shape
        Nodes, in the order of the decks, which is meshio's (VTK's) too, and the functions between them.
    stiffness, mass : Quadrature
    assumed : bool
        Whether files that name the shape alone are read as this element. Most 20-node models are run with reduced
        integration, most programs' 8-node bricks bend without locking.
    incompatible : bool
        Whether three shape functions 1 − ξ² of the element's own are added, docs/theory.md section 2.
    shell : bool
        Whether a brick or wedge of one layer is a shell: its nodes are on both faces, bottom first.
    beam : bool
        Whether a brick is a piece of a beam between two rigid sections, `mesh.beams`.
    natural : bool
        Whether its stiffness is that of natural strains: a shell or a beam.
    """

    C3D4 = "C3D4", shapes.TETRAHEDRON_4, shapes.tetrahedron_rule(1), shapes.tetrahedron_rule(2)
    C3D6 = "C3D6", shapes.WEDGE_6, shapes.wedge_rule(1, 2), shapes.wedge_rule(2, 2)
    C3D8 = "C3D8", shapes.BRICK_8, shapes.brick_rule(2), shapes.brick_rule(2), "full"
    C3D8I = "C3D8I", shapes.BRICK_8, shapes.brick_rule(2), shapes.brick_rule(2), "incompatible"
    C3D10 = "C3D10", shapes.TETRAHEDRON_10, shapes.tetrahedron_rule(2), shapes.tetrahedron_rule(4)
    C3D15 = "C3D15", shapes.WEDGE_15, shapes.wedge_rule(2, 3), shapes.wedge_rule(5, 3)
    C3D20 = "C3D20", shapes.BRICK_20, shapes.brick_rule(3), shapes.brick_rule(3), "full"
    C3D20R = "C3D20R", shapes.BRICK_20, shapes.brick_rule(2), shapes.brick_rule(2)
    S3 = "S3", shapes.SHEET_3, shell_rule(shapes.TRIANGLE_3), shapes.wedge_rule(2, 2), "shell"
    S4 = "S4", shapes.SHEET_4, shell_rule(shapes.RECTANGLE_4), shapes.brick_rule(2), "shell"
    S6 = "S6", shapes.SHEET_6, shell_rule(shapes.TRIANGLE_6), shapes.wedge_rule(5, 2), "shell"
    S8 = "S8", shapes.SHEET_9, shell_rule(shapes.RECTANGLE_9), prism_rule(rectangle_rule(), 2), "shell"
    B31 = "B31", shapes.BRICK_8, shapes.beam_rule(), shapes.brick_rule(2), "beam"

    def __new__(cls, name: str, *_: object) -> "ElementType":
        """Let the name be the value."""
        member = object.__new__(cls)
        member._value_ = name
        return member

    def __init__(self, _: str, shape: Shape, stiffness: Quadrature, mass: Quadrature, sort: str = ""):
        self.shape, self.stiffness, self.mass = shape, stiffness, mass
        self.incompatible, self.shell, self.beam = (sort == one for one in ("incompatible", "shell", "beam"))
        self.assumed, self.natural = sort in ("", "incompatible"), self.shell or self.beam

    @property
    def node_count(self) -> int:
        """Nodes per element."""
        return len(self.shape.nodes)

    @property
    def corner_count(self) -> int:
        """Corners per element: 4 of a tetrahedron, 6 of a wedge, 8 of a brick."""
        return len(self.shape.polytope.corners)

    @property
    def sheet(self) -> Sheet:
        """Of shells the shape."""
        assert isinstance(self.shape, Sheet)
        return self.shape

    @property
    def strains(self) -> StrainRule:
        """Of shells the places of their strains."""
        assert isinstance(self.stiffness, StrainRule)
        return self.stiffness


ASSUMED = {kind.shape.name: kind for kind in ElementType if kind.assumed}
"""What the names of shapes are read as."""


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
    return len(shapes.FACE_SHAPES[nodes.shape[1]].polytope.corners)


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
