"""Where shells of one layer take their natural strains, and what these are between the places: assumed strains.

Of four nodes (E. N. Dvorkin, K.-J. Bathe, Eng. Comput. 1 (1984) 77), of three and six (P. S. Lee, K.-J. Bathe, Comput.
Struct. 82 (2004) 945; K.-J. Bathe, F. Brezzi, S. W. Cho, Comput. Struct. 32 (1989) 797), of nine (M. L. Bucalem,
K.-J. Bathe, Int. J. Numer. Meth. Engng. 36 (1993) 3729); stretch of the thickness of all at the nodes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.mesh.shapes import Quadrature, Shape

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
            fields += [_scalar(one, middle, _monomials([(0, 0)]), _TWO) for one in ((0, 0), (1, 1), (0, 1))]
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


def _monomials(powers: Sequence[tuple[int, int]]) -> Callable[[FloatArray], FloatArray]:
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
    return _scalar(component, np.array(list(product(first, second))), _monomials(powers), heights)


def _stretched_edges() -> _Field:
    """Strain in the plane of six nodes: linear, by stretch of the nine lines from node to node, as of flat triangles.

    In the middle of a line the slope of what is quadratic along it is that between its ends: nothing locks that would
    not between flat triangles.
    """
    (low, high), inside = (0.25, 0.75), 0.5
    places = [(low, 0.0), (high, 0.0), (low, inside), (0.0, low), (0.0, high), (inside, low)]
    weights = np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, -1.0]], 3, axis=0)
    linear = _monomials([(0, 0), (1, 0), (0, 1)])

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
    lower = _monomials([(i, j) for i, j in product(range(2), repeat=2) if i + j <= degree])
    alone = _monomials([(i, degree - i) for i in range(degree + 1)])

    def basis(points: FloatArray) -> FloatArray:
        turned = np.stack([points[:, 1], -points[:, 0]], axis=1)[:, :, None] * alone(points)[:, None]
        both = np.einsum("cd,qk->qcdk", np.eye(2), lower(points)).reshape(len(points), 2, -1)
        return np.concatenate([both, turned], axis=2)

    return _Field(((0, 2), (1, 2)), places, weights, basis)
