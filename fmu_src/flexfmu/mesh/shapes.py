"""Reference polytopes, the polynomials on them that are one at one node and zero at the others, and quadrature.

Coordinates go from −1 to 1 along the edges of bricks and rectangles, from 0 to 1 in triangles and tetrahedra. Those of
wedges are the triangle's, then −1 to 1 along the prism. Source: K.-J. Bathe, Finite Element Procedures, 2nd ed., 5.3.

Shells of one layer take their natural strains at few places: assumed strains. Of four nodes (E. N. Dvorkin, K.-J.
Bathe, Eng. Comput. 1 (1984) 77), of three and six (P. S. Lee, K.-J. Bathe, Comput. Struct. 82 (2004) 945; K.-J. Bathe,
F. Brezzi, S. W. Cho, Comput. Struct. 32 (1989) 797), of nine (M. L. Bucalem, K.-J. Bathe, Int. J. Numer. Meth. Engng.
36 (1993) 3729); stretch of the thickness of all at the nodes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import factorial

import numpy as np

from flexfmu.files.basics import FloatArray, IntArray

# Decimals of a polynomial's coefficients, which are fractions of small numbers: what comes after is round-off.
_DECIMALS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Polytope:
    """A polyhedron or polygon in its own coordinates.

    Attributes
    ----------
    corners : (c, d) float
    nastran, exodus : str
        Nastran's name, without the number of nodes of a face, and the first three letters of Exodus'.
    edges : tuple of (int, int)
        Corners between which mid-side nodes lie, in the order of these nodes.
    faces : tuple of tuple of int
        Corners around each face, in the order of the decks' S1, S2, ...; none of a polygon.
    """

    corners: FloatArray
    nastran: str
    exodus: str
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class Shape:
    """Nodes of a polytope, and the polynomials between them.

    Attributes
    ----------
    polytope : Polytope
    name : str
        meshio's, which follows VTK.
    quadratic : bool
        Whether there are mid-side nodes, after the corners; then one in the middle where there are more powers.
    powers : (n, d) int
        Exponents of the monomials that the polynomials are made of.
    """

    polytope: Polytope
    name: str
    quadratic: bool
    powers: IntArray

    @cached_property
    def nodes(self) -> FloatArray:
        """Places of the nodes (n, d)."""
        corners = self.polytope.corners
        middle = corners[np.array(self.polytope.edges)].mean(axis=1)
        return np.concatenate([corners, middle, corners.mean(axis=0)[None]])[: len(self.powers)]

    @cached_property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of each face, in the polytope's order: corners around it, then mid-side nodes likewise."""
        if not self.quadratic:
            return self.polytope.faces
        middle = {frozenset(edge): len(self.polytope.corners) + k for k, edge in enumerate(self.polytope.edges)}
        return tuple(
            (*face, *(middle[frozenset(ends)] for ends in zip(face, (*face[1:], face[0]), strict=True)))
            for face in self.polytope.faces
        )

    @cached_property
    def mirrored(self) -> IntArray:
        """The nodes (n,) in the order that turns an element inside out."""
        turned = self.nodes[:, [1, 0, *range(2, self.nodes.shape[1])]]
        return np.array([np.flatnonzero((self.nodes == place).all(axis=1))[0] for place in turned], dtype=np.int64)

    @cached_property
    def layered(self) -> IntArray:
        """Where the nodes (n,) stand in Nastran and Exodus, with mid-side nodes from the bottom to the top."""
        count = len(self.polytope.corners)
        return np.argsort([*range(count), *(count + np.argsort(self.nodes[count:, 2:].sum(axis=1), kind="stable"))])

    @cached_property
    def _coefficients(self) -> FloatArray:
        return np.round(np.linalg.inv(_monomials(self.nodes, self.powers)), _DECIMALS)

    def value(self, points: FloatArray) -> FloatArray:
        """The polynomials (q, n) at points (q, d)."""
        return _monomials(points, self.powers) @ self._coefficients

    def gradient(self, points: FloatArray) -> FloatArray:
        """Their derivatives (q, n, d) at points (q, d)."""
        slopes = []
        for axis, unit in enumerate(np.eye(points.shape[1], dtype=np.int64)):
            lower = _monomials(points, np.maximum(self.powers - unit, 0))
            slopes.append((self.powers[:, axis] * lower) @ self._coefficients)
        return np.stack(slopes, axis=2)


@dataclass(frozen=True, eq=False)
class Sheet(Shape):
    """A polygon's nodes at the bottom and the top of a brick or wedge, linear between them.

    Attributes
    ----------
    flat : Shape
        The polygon's.
    """

    flat: Shape

    @cached_property
    def halves(self) -> IntArray:
        """The nodes (2, n/2) of the bottom and the top in the polygon's order; corners of both stand before others."""
        count, corners = len(self.flat.nodes), len(self.flat.polytope.corners)
        low = np.arange(count) + np.where(np.arange(count) < corners, 0, corners)
        return np.array([low, low + np.where(np.arange(count) < corners, corners, count - corners)])

    @cached_property
    def nodes(self) -> FloatArray:
        """As of all shapes."""
        places = np.zeros((self.halves.size, 3))
        for rows, end in zip(self.halves, (-1.0, 1.0), strict=True):
            places[rows] = np.column_stack([self.flat.nodes, np.full(len(rows), end)])
        return places

    @cached_property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Bottom, top, and the sides, two for each with a node in its middle."""
        low, high = self.halves.tolist()
        if not self.quadratic:
            return self.polytope.faces
        found, corners = [tuple(low), tuple(high)], len(self.flat.polytope.corners)
        for middle, (first, last) in enumerate(self.flat.polytope.edges, start=corners):
            found += [(low[a], low[b], high[b], high[a]) for a, b in ((first, middle), (middle, last))]
        return tuple(found)


def _monomials(points: FloatArray, powers: IntArray) -> FloatArray:
    return np.prod(points[:, None, :] ** powers, axis=2)


def _powers(dimension: int, wanted: Callable[..., bool]) -> IntArray:
    """Exponents up to two of each coordinate for which a condition holds."""
    return np.array([power for power in product(range(3), repeat=dimension) if wanted(*power)], dtype=np.int64)


_TRIANGLE = Polytope(np.array([(0, 0), (1, 0), (0, 1)], dtype=float), "CTRIA", "TRI", ((0, 1), (1, 2), (2, 0)))
_SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
_RECTANGLE = Polytope(_SQUARE, "CQUAD", "QUA", ((0, 1), (1, 2), (2, 3), (3, 0)))
TETRAHEDRON = Polytope(
    np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float),
    "CTETRA",
    "TET",
    ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    ((0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
)
WEDGE = Polytope(
    np.array([(*corner, end) for end in (-1.0, 1.0) for corner in _TRIANGLE.corners]),
    "CPENTA",
    "WED",
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
)
BRICK = Polytope(
    np.array([(*corner, end) for end in (-1.0, 1.0) for corner in _RECTANGLE.corners]),
    "CHEXA",
    "HEX",
    ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
)

TRIANGLE_3 = Shape(_TRIANGLE, "triangle", False, _powers(2, lambda r, s: r + s <= 1))
TRIANGLE_6 = Shape(_TRIANGLE, "triangle6", True, _powers(2, lambda r, s: r + s <= 2))
RECTANGLE_4 = Shape(_RECTANGLE, "quad", False, _powers(2, lambda r, s: max(r, s) <= 1))
RECTANGLE_8 = Shape(_RECTANGLE, "quad8", True, _powers(2, lambda *p: p.count(2) <= 1))
RECTANGLE_9 = Shape(_RECTANGLE, "quad9", True, _powers(2, lambda *p: max(p) <= 2))
TETRAHEDRON_4 = Shape(TETRAHEDRON, "tetra", False, _powers(3, lambda r, s, t: r + s + t <= 1))
TETRAHEDRON_10 = Shape(TETRAHEDRON, "tetra10", True, _powers(3, lambda r, s, t: r + s + t <= 2))
WEDGE_6 = Shape(WEDGE, "wedge", False, _powers(3, lambda r, s, t: r + s <= 1 and t <= 1))
WEDGE_15 = Shape(WEDGE, "wedge15", True, _powers(3, lambda r, s, t: r + s <= (2 if t <= 1 else 1)))
BRICK_8 = Shape(BRICK, "hexahedron", False, _powers(3, lambda *p: max(p) <= 1))
BRICK_20 = Shape(BRICK, "hexahedron20", True, _powers(3, lambda *p: p.count(2) <= 1))
SHEET_3 = Sheet(WEDGE, "wedge", False, WEDGE_6.powers, TRIANGLE_3)
SHEET_4 = Sheet(BRICK, "hexahedron", False, BRICK_8.powers, RECTANGLE_4)
SHEET_6 = Sheet(WEDGE, "wedge12", True, _powers(3, lambda r, s, t: r + s <= 2 and t <= 1), TRIANGLE_6)
SHEET_9 = Sheet(BRICK, "hexahedron18", True, _powers(3, lambda *p: p[2] <= 1), RECTANGLE_9)

LINEAR = {shape.polytope: shape for shape in (TETRAHEDRON_4, WEDGE_6, BRICK_8)}
"""The functions between the corners of a polytope."""
FACE_SHAPES = {len(shape.nodes): shape for shape in (TRIANGLE_3, TRIANGLE_6, RECTANGLE_4, RECTANGLE_8, RECTANGLE_9)}
"""By the number of a face's nodes."""


@dataclass(frozen=True, slots=True, eq=False)
class Quadrature:
    """Where and with which weights functions on a polytope are summed.

    Attributes
    ----------
    points : (q, d) float
    weights : (q,) float
    """

    points: FloatArray
    weights: FloatArray


def brick_rule(count: int) -> Quadrature:
    """Gauss points, `count` along each edge (2 or 3), in the order of the corners, mid-sides, faces and the centre."""
    faces = np.concatenate([[-unit, unit] for unit in np.eye(3)])
    return _gauss(BRICK.corners if count == 2 else np.concatenate([BRICK_20.nodes, faces, np.zeros((1, 3))]), count)


def rectangle_rule() -> Quadrature:
    """Three Gauss points along each edge, in the order of the corners, mid-sides and the centre."""
    return _gauss(np.concatenate([RECTANGLE_8.nodes, np.zeros((1, 2))]), 3)


def _gauss(places: FloatArray, count: int) -> Quadrature:
    """Gauss points in the order of places with the coordinates −1, 0 and 1."""
    along, length = np.polynomial.legendre.leggauss(count)
    index = ((places + 1.0) * (0.5 * (count - 1))).astype(np.int64)
    return Quadrature(along[index], np.prod(length[index], axis=1))


def triangle_rule(degree: int) -> Quadrature:
    """Rule that is exact to degree 1, 2 or 5; the last is J. Radon's, Monatsh. Math. 52 (1948) 286."""
    root = np.sqrt(15.0)
    orbits = {
        1: [(1.0 / 3.0, 1.0)],
        2: [(2.0 / 3.0, 1.0)],
        5: [((9.0 + 2.0 * root) / 21.0, (155.0 - root) / 400.0), ((9.0 - 2.0 * root) / 21.0, (155.0 + root) / 400.0)],
    }[degree]
    return _simplex_rule(2, [*orbits, *([(1.0 / 3.0, 9.0 / 40.0)] if degree == 5 else [])])


def tetrahedron_rule(degree: int) -> Quadrature:
    """Rule that is exact to degree 1, 2 or 4; the last is P. Keast's, Comp. Meth. Appl. Mech. Engng. 55 (1986) 339."""
    if degree < 3:
        return _simplex_rule(3, [(0.25 if degree == 1 else (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, 1.0)])
    orbits = (0.698419704324386603, 0.354359298971922790), (0.0568813795204234229, 0.531354986742362930)
    corners = _simplex_rule(3, orbits)
    middle = TETRAHEDRON_10.nodes[len(TETRAHEDRON.corners) :]
    weights = np.full(len(middle), 1.0 / 315.0)
    return Quadrature(np.concatenate([middle, corners.points]), np.concatenate([weights, corners.weights]))


def _simplex_rule(dimension: int, orbits: Sequence[tuple[float, float]]) -> Quadrature:
    """Points with one area or volume coordinate that differs from the others: it, and their part of the weights."""
    points, weights = [], []
    for odd, part in orbits:
        areas = np.full((dimension + 1, dimension + 1), (1.0 - odd) / dimension)
        np.fill_diagonal(areas, odd)
        chosen = areas[:1] if np.isclose(odd, areas[0, 1]) else areas
        points.append(chosen[:, 1:])
        weights.append(np.full(len(chosen), part / len(chosen) / factorial(dimension)))
    return Quadrature(np.concatenate(points), np.concatenate(weights))


def prism_rule(flat: Quadrature, count: int) -> Quadrature:
    """A polygon's rule at each of some Gauss points along the prism."""
    heights, lengths = np.polynomial.legendre.leggauss(count)
    points = np.array([(*point, height) for height in heights for point in flat.points])
    return Quadrature(points, np.outer(lengths, flat.weights).ravel())


def wedge_rule(degree: int, count: int) -> Quadrature:
    """A triangle's rule at each of some Gauss points along the prism."""
    return prism_rule(triangle_rule(degree), count)


def beam_rule() -> Quadrature:
    """Places in the middle section at which beams take their strains: the axis, and where the section's axes end."""
    ends = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)]
    return Quadrature(np.array(ends), np.full(5, 8.0 / 5.0))


FACE_RULES = {3: triangle_rule(2), 6: triangle_rule(5), 4: rectangle_rule(), 8: rectangle_rule(), 9: rectangle_rule()}
"""Rules that integrate a face's mass matrix exactly, by the number of its nodes."""


_VOIGT = {(0, 0): 0, (1, 1): 1, (2, 2): 2, (0, 1): 3, (1, 2): 4, (0, 2): 5}
# Gauss points, two and three along a line.
_TWO, _THREE = (-(3.0**-0.5), 3.0**-0.5), (-(0.6**0.5), 0.0, 0.6**0.5)


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """Some components of natural strain by as many functions as there are values at places.

    Attributes
    ----------
    components : sequence of (int, int)
    places : (k, 2) float
    weights : (k, c) float
        Of the components in each value.
    basis : callable
        Functions (q, c, k) at points (q, 2).
    heights : tuple of float
        Of the places; of several, strain is linear between them.
    """

    components: Sequence[tuple[int, int]]
    places: FloatArray
    weights: FloatArray
    basis: Callable[[FloatArray], FloatArray]
    heights: tuple[float, ...] = (0.0,)

    def at(self, points: FloatArray) -> FloatArray:
        """Strains (q, 6, r) at points (q, 3) of those with a weight, height by height."""
        values = np.einsum("kc,kcj->kj", self.weights, self.basis(self.places))
        parts = (self.basis(points[:, :2]) @ np.linalg.inv(values))[..., None] * self.weights
        parts = parts[:, :, self.weights != 0.0]
        shares = [0.5 * (1.0 + points[:, 2] / height) if height else np.ones(len(points)) for height in self.heights]
        found = np.zeros((len(points), 6, len(shares) * parts.shape[2]))
        every = np.concatenate([share[:, None, None] * parts for share in shares], axis=2)
        found[:, [_VOIGT[one] for one in self.components]] = every
        return found


@dataclass(frozen=True, slots=True, eq=False)
class StrainRule(Quadrature):
    """Places of natural strains, of equal weight, and what strains are between them.

    Attributes
    ----------
    rows : (r, 3) int
        Place and both components of each.
    assumed : callable
        Strains (q, 6, r), shear twice, at points (q, 3).
    """

    rows: IntArray
    assumed: Callable[[FloatArray], FloatArray]


def shell_rule(flat: Shape) -> StrainRule:
    """Assumed strains of shells with the nodes of a polygon."""
    count, whole = len(flat.nodes), 8.0 if len(flat.polytope.corners) == 4 else 1.0
    if whole == 8.0:
        more = (-_TWO[1], 0.0, _TWO[1])
        two, three = (_TWO, _TWO) if count == 4 else (_TWO, more)
        shear = ((0.0,), (-1.0, 1.0)) if count == 4 else (_TWO, _THREE)
        fields = [_grid((0, 0), two, three, _TWO), _grid((1, 1), three, two, _TWO), _grid((0, 1), two, two, _TWO)]
        fields += [_grid((0, 2), *shear), _grid((1, 2), *shear[::-1])]
    else:
        fields = [_along_edges(count // 4)]
        if count == 3:
            middle = np.full((1, 2), 1.0 / 3.0)
            fields += [_scalar(one, middle, _plane_monomials([(0, 0)]), _TWO) for one in ((0, 0), (1, 1), (0, 1))]
        else:
            fields.append(_stretched_edges())
    fields.append(_scalar((2, 2), flat.nodes, flat.value))
    points: list[tuple[float, ...]] = []
    rows: list[tuple[int, int, int]] = []
    for field in fields:
        for height in field.heights:
            for place, weights in zip(field.places, field.weights, strict=True):
                used = [one for one, weight in zip(field.components, weights, strict=True) if weight]
                rows += [(len(points), *one) for one in used]
                points.append((*place, height))

    def assumed(places: FloatArray) -> FloatArray:
        return np.concatenate([field.at(places) for field in fields], axis=2)

    return StrainRule(np.array(points), np.full(len(points), whole / len(points)), np.array(rows), assumed)


def _plane_monomials(powers: Sequence[tuple[int, int]]) -> Callable[[FloatArray], FloatArray]:
    return lambda points: np.prod(points[:, None] ** np.array(powers), axis=2)


def _scalar(
    component: tuple[int, int],
    places: FloatArray,
    functions: Callable[[FloatArray], FloatArray],
    heights: tuple[float, ...] = (0.0,),
) -> _Field:
    """One component by its values at places."""
    return _Field((component,), places, np.ones((len(places), 1)), lambda at: functions(at)[:, None], heights)


def _grid(
    component: tuple[int, int], first: Sequence[float], second: Sequence[float], heights: tuple[float, ...] = (0.0,)
) -> _Field:
    """One component by its values on a grid."""
    powers = list(product(range(len(first)), range(len(second))))
    return _scalar(component, np.array(list(product(first, second))), _plane_monomials(powers), heights)


def _stretched_edges() -> _Field:
    """Strain in the plane of six nodes: linear, by stretch of the nine lines from node to node, as of flat triangles.

    In the middle of a line the slope of what is quadratic along it is that between its ends: nothing locks that would
    not between flat triangles.
    """
    (low, high), inside = (0.25, 0.75), 0.5
    places = [(low, 0.0), (high, 0.0), (low, inside), (0.0, low), (0.0, high), (inside, low)]
    weights = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, -1.0]], 3, axis=0)
    linear = _plane_monomials([(0, 0), (1, 0), (0, 1)])

    def basis(points: FloatArray) -> FloatArray:
        return np.einsum("cd,qk->qcdk", np.eye(3), linear(points)).reshape(len(points), 3, -1)

    every = np.array([*places, (high, low), (low, high), (low, low)])
    return _Field(((0, 0), (1, 1), (0, 1)), every, weights, basis, _TWO)


def _along_edges(degree: int) -> _Field:
    """Shear of triangles, along each edge of some degree and that of the edge, 0 or 1; of the latter two more inside.

    J.-C. Nédélec, Numer. Math. 35 (1980) 315: all vectors of that degree, and (y, −x) times what has it alone.
    """
    along = 0.5 * (1.0 + np.polynomial.legendre.leggauss(degree + 1)[0])
    nothing = np.zeros(len(along))
    edges = [np.stack(one, axis=1) for one in ((along, nothing), (nothing, along), (1.0 - along, along))]
    places, weights = np.concatenate(edges), np.repeat([[1.0, 0.0], [0.0, 1.0], [-1.0, 1.0]], len(along), axis=0)
    if degree:
        places = np.concatenate([places, np.full((2, 2), 1.0 / 3.0)])
        weights = np.concatenate([weights, np.eye(2)])
    lower = _plane_monomials([(i, j) for i, j in product(range(2), repeat=2) if i + j <= degree])
    alone = _plane_monomials([(i, degree - i) for i in range(degree + 1)])

    def basis(points: FloatArray) -> FloatArray:
        turned = np.stack([points[:, 1], -points[:, 0]], axis=1)[:, :, None] * alone(points)[:, None]
        both = np.einsum("cd,qk->qcdk", np.eye(2), lower(points)).reshape(len(points), 2, -1)
        return np.concatenate([both, turned], axis=2)

    return _Field(((0, 2), (1, 2)), places, weights, basis)
