"""The table of elements: what a body may be made of. Beside it nothing says what an element is."""

from enum import Enum

from flexfmu.mesh.shapes import (
    BRICK_8,
    BRICK_20,
    RECTANGLE_4,
    RECTANGLE_9,
    SHEET_3,
    SHEET_4,
    SHEET_6,
    SHEET_9,
    TETRAHEDRON_4,
    TETRAHEDRON_10,
    TRIANGLE_3,
    TRIANGLE_6,
    WEDGE_6,
    WEDGE_15,
    Quadrature,
    Shape,
    Sheet,
    StrainRule,
    beam_rule,
    brick_rule,
    prism_rule,
    rectangle_rule,
    shell_rule,
    tetrahedron_rule,
    wedge_rule,
)


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

    C3D4 = "C3D4", TETRAHEDRON_4, tetrahedron_rule(1), tetrahedron_rule(2)
    C3D6 = "C3D6", WEDGE_6, wedge_rule(1, 2), wedge_rule(2, 2)
    C3D8 = "C3D8", BRICK_8, brick_rule(2), brick_rule(2), False
    C3D8I = "C3D8I", BRICK_8, brick_rule(2), brick_rule(2), True, True
    C3D10 = "C3D10", TETRAHEDRON_10, tetrahedron_rule(2), tetrahedron_rule(4)
    C3D15 = "C3D15", WEDGE_15, wedge_rule(2, 3), wedge_rule(5, 3)
    C3D20 = "C3D20", BRICK_20, brick_rule(3), brick_rule(3), False
    C3D20R = "C3D20R", BRICK_20, brick_rule(2), brick_rule(2)
    S3 = "S3", SHEET_3, shell_rule(TRIANGLE_3), wedge_rule(2, 2), False, False, True
    S4 = "S4", SHEET_4, shell_rule(RECTANGLE_4), brick_rule(2), False, False, True
    S6 = "S6", SHEET_6, shell_rule(TRIANGLE_6), wedge_rule(5, 2), False, False, True
    S8 = "S8", SHEET_9, shell_rule(RECTANGLE_9), prism_rule(rectangle_rule(), 2), False, False, True
    B31 = "B31", BRICK_8, beam_rule(), brick_rule(2), False, False, False, True

    def __new__(cls, name: str, *_: object) -> "ElementType":
        """Let the name be the value."""
        member = object.__new__(cls)
        member._value_ = name
        return member

    def __init__(
        self,
        _: str,
        shape: Shape,
        stiffness: Quadrature,
        mass: Quadrature,
        assumed: bool = True,
        incompatible: bool = False,
        shell: bool = False,
        beam: bool = False,
    ):
        self.shape = shape
        self.stiffness = stiffness
        self.mass = mass
        self.assumed = assumed
        self.incompatible = incompatible
        self.shell = shell
        self.beam = beam
        self.natural = shell or beam

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
