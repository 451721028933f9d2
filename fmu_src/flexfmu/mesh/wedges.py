"""Wedges of 6 and 15 nodes in the form of felupe's elements, which has none, and their quadrature.

Coordinates r, s of the triangle (r, s ≥ 0, r + s ≤ 1) and t along the prism (−1 to 1); nodes as in Abaqus, CalculiX.
Source: K.-J. Bathe, Finite Element Procedures, 2nd ed., section 5.3.2 (collapsed and prism elements).
"""

from dataclasses import dataclass

import felupe
import numpy as np

from ..files.array_types import FloatArray

_SLOPE = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
_CORNERS = np.array([(0, 0), (1, 0), (0, 1)], dtype=float)
_ENDS = (-1.0, 1.0)


@dataclass(frozen=True, slots=True)
class WedgeQuadrature:
    """Points and weights, named as felupe's.

    Attributes
    ----------
    points : (q, 3) float
    weights : (q,) float
    """

    points: FloatArray
    weights: FloatArray


def wedge_quadrature(triangle: int, line: int) -> WedgeQuadrature:
    """Triangle's points of an order (felupe's numbers) times Gauss points along the prism.

    Parameters
    ----------
    triangle, line : int
        Order of the triangle's rule; number of points along the prism.

    Returns
    -------
    WedgeQuadrature
    """
    flat = felupe.TriangleQuadrature(triangle)
    heights, lengths = np.polynomial.legendre.leggauss(line)
    points = np.array([(*point, height) for height in heights for point in np.asarray(flat.points)])
    return WedgeQuadrature(points, np.outer(lengths, np.asarray(flat.weights)).ravel())


class Wedge:
    """Linear wedge."""

    points = np.array([(*corner, end) for end in _ENDS for corner in _CORNERS])

    @staticmethod
    def function(place: FloatArray) -> FloatArray:
        """Shape functions (6,)."""
        area = np.array([1.0 - place[0] - place[1], place[0], place[1]])
        return np.concatenate([0.5 * (1.0 + end * place[2]) * area for end in _ENDS])

    @staticmethod
    def gradient(place: FloatArray) -> FloatArray:
        """Their gradients (6, 3)."""
        area = np.array([1.0 - place[0] - place[1], place[0], place[1]])
        parts = [np.column_stack([0.5 * (1.0 + end * place[2]) * _SLOPE, 0.5 * end * area]) for end in _ENDS]
        return np.concatenate(parts)


class QuadraticWedge:
    """Serendipity wedge of 15 nodes: corners, mid-sides of the bottom, of the top, and between them."""

    points = np.concatenate(
        [
            Wedge.points,
            [(*(0.5 * (_CORNERS[i] + _CORNERS[(i + 1) % 3])), end) for end in _ENDS for i in range(3)],
            [(*corner, 0.0) for corner in _CORNERS],
        ]
    )

    @staticmethod
    def function(place: FloatArray) -> FloatArray:
        """Shape functions (15,)."""
        t = place[2]
        area = np.array([1.0 - place[0] - place[1], place[0], place[1]])
        following = np.roll(area, -1)
        corners = [0.5 * area * ((2.0 * area - 1.0) * (1.0 + end * t) - (1.0 - t * t)) for end in _ENDS]
        sides = [2.0 * area * following * (1.0 + end * t) for end in _ENDS]
        return np.concatenate([*corners, *sides, area * (1.0 - t * t)])

    @staticmethod
    def gradient(place: FloatArray) -> FloatArray:
        """Their gradients (15, 3)."""
        t = place[2]
        area = np.array([1.0 - place[0] - place[1], place[0], place[1]])
        following, next_slope = np.roll(area, -1), np.roll(_SLOPE, -1, axis=0)
        product = area[:, None] * next_slope + following[:, None] * _SLOPE
        parts = []
        for end in _ENDS:
            flat = (0.5 * ((4.0 * area - 1.0) * (1.0 + end * t) - (1.0 - t * t)))[:, None] * _SLOPE
            parts.append(np.column_stack([flat, 0.5 * area * ((2.0 * area - 1.0) * end + 2.0 * t)]))
        parts += [np.column_stack([2.0 * (1.0 + end * t) * product, 2.0 * end * area * following]) for end in _ENDS]
        parts.append(np.column_stack([(1.0 - t * t) * _SLOPE, -2.0 * t * area]))
        return np.concatenate(parts)
