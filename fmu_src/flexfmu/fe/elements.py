"""Shape functions and quadrature of each element type, from felupe; the only module that chooses them."""

from dataclasses import dataclass
from typing import Any

import felupe
import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import ElementType
from ..mesh.wedges import QuadraticWedge, Wedge, wedge_quadrature


@dataclass(frozen=True, slots=True)
class Rule:
    """How an element type is integrated.

    Attributes
    ----------
    element : felupe element
    stiffness : felupe quadrature
    mass : felupe quadrature
    incompatible : bool
        Whether three shape functions 1 − ξ² of the element's own are added, docs/theory.md section 2.
    """

    element: Any
    stiffness: Any
    mass: Any
    incompatible: bool = False


def rule(kind: ElementType) -> Rule:
    """Shape functions and quadrature of an element type.

    C3D20R takes 2 × 2 × 2 points for stiffness and mass both, as CalculiX does; all others are fully integrated. C3D6
    has two points, which is full for a stiffness without zero-energy modes, as both solvers have it.

    Parameters
    ----------
    kind : ElementType

    Returns
    -------
    Rule
    """
    two, three = felupe.GaussLegendre(order=1, dim=3), felupe.GaussLegendre(order=2, dim=3)
    match kind:
        case ElementType.C3D8:
            return Rule(felupe.Hexahedron(), two, two)
        case ElementType.C3D8I:
            return Rule(felupe.Hexahedron(), two, two, incompatible=True)
        case ElementType.C3D6:
            return Rule(Wedge(), wedge_quadrature(1, 2), wedge_quadrature(2, 2))
        case ElementType.C3D15:
            return Rule(QuadraticWedge(), wedge_quadrature(2, 3), wedge_quadrature(5, 3))
        case ElementType.C3D20R:
            return Rule(felupe.QuadraticHexahedron(), two, two)
        case ElementType.C3D20:
            return Rule(felupe.QuadraticHexahedron(), three, three)
        case ElementType.C3D4:
            return Rule(felupe.Tetra(), felupe.TetrahedronQuadrature(1), felupe.TetrahedronQuadrature(2))
        case ElementType.C3D10:
            return Rule(felupe.QuadraticTetra(), felupe.TetrahedronQuadrature(2), felupe.TetrahedronQuadrature(5))


# Local nodes of each face, corners in order around it, then mid-side nodes in the same order; triangles and others
# in tables of their own.
_HEX_FACES = (
    (0, 1, 2, 3, 8, 9, 10, 11),
    (4, 5, 6, 7, 12, 13, 14, 15),
    (0, 1, 5, 4, 8, 17, 12, 16),
    (1, 2, 6, 5, 9, 18, 13, 17),
    (2, 3, 7, 6, 10, 19, 14, 18),
    (3, 0, 4, 7, 11, 16, 15, 19),
)
_TET_FACES = ((0, 1, 2, 4, 5, 6), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9))
_WEDGE_TRIANGLES = ((0, 1, 2, 6, 7, 8), (3, 4, 5, 9, 10, 11))
_WEDGE_SIDES = ((0, 1, 4, 3, 6, 13, 9, 12), (1, 2, 5, 4, 7, 14, 10, 13), (2, 0, 3, 5, 8, 12, 11, 14))
FACES: dict[ElementType, tuple[IntArray, ...]] = {
    ElementType.C3D4: (np.array(_TET_FACES)[:, :3],),
    ElementType.C3D10: (np.array(_TET_FACES),),
    ElementType.C3D6: (np.array(_WEDGE_TRIANGLES)[:, :3], np.array(_WEDGE_SIDES)[:, :4]),
    ElementType.C3D15: (np.array(_WEDGE_TRIANGLES), np.array(_WEDGE_SIDES)),
    ElementType.C3D8: (np.array(_HEX_FACES)[:, :4],),
    ElementType.C3D8I: (np.array(_HEX_FACES)[:, :4],),
    ElementType.C3D20: (np.array(_HEX_FACES),),
    ElementType.C3D20R: (np.array(_HEX_FACES),),
}


def face_rule(node_count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shape functions of a face of 3, 4, 6 or 8 nodes at quadrature points that integrate its mass matrix exactly.

    Parameters
    ----------
    node_count : int

    Returns
    -------
    value : (points, node_count) float
    gradient : (points, node_count, 2) float
    weight : (points,) float
    """
    element, quadrature = {
        3: (felupe.Triangle(), felupe.TriangleQuadrature(2)),
        4: (felupe.Quad(), felupe.GaussLegendre(order=2, dim=2)),
        6: (felupe.QuadraticTriangle(), felupe.TriangleQuadrature(5)),
        8: (felupe.QuadraticQuad(), felupe.GaussLegendre(order=2, dim=2)),
    }[node_count]
    value = np.array([element.function(point) for point in quadrature.points])
    # felupe 11.3 has a wrong gradient for the quadratic triangle, which shows on curved faces only.
    slope = _quadratic_triangle_gradient if node_count == 6 else element.gradient
    gradient = np.array([slope(point) for point in quadrature.points])
    return value, gradient, np.asarray(quadrature.weights)


def _quadratic_triangle_gradient(point: FloatArray) -> FloatArray:
    """Gradients (6, 2) of L_i (2 L_i − 1) at the corners and 4 L_i L_j between them, L being area coordinates."""
    area = np.array([1.0 - point[0] - point[1], point[0], point[1]])
    slope = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    following, next_area = np.roll(slope, -1, axis=0), np.roll(area, -1)
    corner = (4.0 * area - 1.0)[:, None] * slope
    return np.concatenate([corner, 4.0 * (area[:, None] * following + next_area[:, None] * slope)])
