"""What shells are made of across their thickness: layers, each in plane stress, and the shear of all of them.

Shear of a laminate is that of the stress which equilibrium needs beside bending about either axis (R. Rolfes,
K. Rohwer, Int. J. Numer. Meth. Engng. 40 (1997) 51): 5/6 of the modulus where there is one layer.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..files.basics import FloatArray, IntArray
from ..mesh.elements import ElementBlock
from ..mesh.model import Layer, Material, Mesh
from ..mesh.shapes import Quadrature
from .cells import turning

# Strains in the plane, and shear across it, among xx, yy, zz, xy, yz, zx.
_PLANE, _ACROSS = np.array([0, 1, 3]), np.array([5, 4])
# Sine of the angle to the normal below which the first axis gives no direction: 0.1 degrees.
_NORMAL = np.sin(np.radians(0.1))
# Bending stiffness that differs by less is the same in all directions.
_EVEN = 1e-6


@dataclass(frozen=True, slots=True)
class Laminate:
    """Shells of the same material.

    Attributes
    ----------
    heights : (l + 1,) float
        Of the layers' faces, −1 to 1.
    elastic : (l, 6, 6) float
        In the material's axes, N/m²; across, the modulus alone, which keeps the thickness.
    axes : (e, 3, 3) float or None
        The material's, as columns; None where it has no direction.
    fixed : bool
        Whether the third of them is that of the angles, and not the shells' normal.
    bending : float
        As of `Material`.
    """

    heights: FloatArray
    elastic: FloatArray
    axes: FloatArray | None
    fixed: bool
    bending: float

    def rule(self, whole: Quadrature) -> tuple[Quadrature, IntArray]:
        """A rule with two points across each layer for one with two across all, and the layer of each point."""
        plane = whole.points[:, 2] > 0.0
        middle, half = 0.5 * (self.heights[1:] + self.heights[:-1]), 0.5 * np.diff(self.heights)
        across = (middle[:, None] + half[:, None] * [-(3.0**-0.5), 3.0**-0.5]).ravel()
        count, places = int(plane.sum()), whole.points[plane, :2]
        points = np.column_stack([np.tile(places, (across.size, 1)), np.repeat(across, count)])
        weights = np.tile(whole.weights[plane], across.size) * np.repeat(half, 2 * count)
        return Quadrature(points, weights), np.repeat(np.arange(half.size), 2 * count)

    def at(self, local: FloatArray, layer: int) -> FloatArray:
        """Elasticity (e or 1, 6, 6) of a layer in axes (e, 3, 3), rows, the third the normal."""
        if self.axes is None:
            return self.elastic[layer][None]
        normal, first = local[:, 2], self.axes[:, :, 0]
        along = first - np.sum(first * normal, axis=1, keepdims=True) * normal
        steep = np.linalg.norm(along, axis=1) < _NORMAL
        third = self.axes[steep, :, 2]
        along[steep] = third - np.sum(third * normal[steep], axis=1, keepdims=True) * normal[steep]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        below = np.sum(self.axes[:, :, 2] * normal, axis=1, keepdims=True) < 0.0
        up = np.where(below & self.fixed, -1.0, 1.0) * normal
        turn = turning(local @ np.stack([along, np.cross(up, along), up], axis=2))
        return turn @ self.elastic[layer] @ turn.swapaxes(1, 2)


def laminates(mesh: Mesh, block: ElementBlock) -> Iterator[tuple[IntArray, Laminate]]:
    """Shells of a block by their material: places in the block, and what they are made of."""
    for row in np.unique(block.material).tolist():
        chosen, material = np.flatnonzero(block.material == row), mesh.materials[row]
        axes = np.tile(np.eye(3), (len(chosen), 1, 1)) if block.axes is None else block.axes[chosen]
        directed = material.layers or material.constants is not None
        yield chosen, Laminate(*stack(material), axes if directed else None, not material.by_normal, material.bending)


def bent(strains: FloatArray, points: FloatArray, factor: float) -> FloatArray:
    """Strains (q, …, 6, r) at points in pairs across the middle: those in the plane that are odd there by a factor."""
    other = (np.abs(points[:, None] - points * [1.0, 1.0, -1.0]).max(axis=2) < _EVEN).argmax(axis=1)
    changed = strains.copy()
    changed[..., _PLANE, :] += 0.5 * (factor - 1.0) * (strains - strains[other])[..., _PLANE, :]
    return changed


@cache
def stack(material: Material) -> tuple[FloatArray, FloatArray]:
    """Heights (l + 1,) of the faces of a material's layers, −1 to 1, and their elasticity (l, 6, 6) in its axes."""
    layers = material.layers or (Layer(1.0, 0.0, tuple(material.elasticity.ravel().tolist())),)
    heights = np.cumsum([0.0, *(layer.share for layer in layers)])
    heights = 2.0 * heights / heights[-1] - 1.0
    soft = np.linalg.inv(np.array([layer.constants for layer in layers]).reshape(-1, 6, 6))
    elastic = np.zeros_like(soft)
    for part in (_PLANE, _ACROSS):
        elastic[:, part[:, None], part] = np.linalg.inv(soft[:, part[:, None], part])
    elastic[:, 2, 2] = 1.0 / soft[:, 2, 2]
    elastic = _turned(elastic, np.array([layer.angle for layer in layers]))
    # Bending about either axis by itself is another thing in other axes: those of the largest bending stiffness.
    main = _stiffest(np.einsum("lij,l->ij", elastic[:, _PLANE[:, None], _PLANE], np.diff(heights**3)))
    whole = np.zeros((1, 6, 6))
    whole[0, _ACROSS[:, None], _ACROSS] = _shear(0.5 * heights, _turned(elastic, np.full(len(layers), -main)))
    elastic[:, _ACROSS[:, None], _ACROSS] = _turned(whole, np.array([main]))[:, _ACROSS[:, None], _ACROSS]
    return heights, elastic


def _turned(elastic: FloatArray, angle: FloatArray) -> FloatArray:
    """Elasticity (l, 6, 6) turned about the third axis by angles (l,), rad."""
    turn = np.tile(np.eye(3), (len(angle), 1, 1))
    turn[:, 0, 0], turn[:, 1, 1] = np.cos(angle), np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
    both = turning(turn)
    return both @ elastic @ both.swapaxes(1, 2)


def _stiffest(bend: FloatArray) -> float:
    """Angle, rad, of the direction in which the bending stiffness (3, 3) is largest."""

    def slopes(angle: float) -> tuple[float, float, float]:
        c, s = np.cos(2.0 * angle), np.sin(2.0 * angle)
        place, first = np.array([0.5 + 0.5 * c, 0.5 - 0.5 * c, s]), np.array([-s, s, 2.0 * c])
        second = np.array([-2.0 * c, 2.0 * c, -4.0 * s])
        return place @ bend @ place, first @ bend @ place, first @ bend @ first + second @ bend @ place

    angles = np.linspace(0.0, np.pi, 180, endpoint=False)
    sizes = [slopes(angle)[0] for angle in angles]
    if np.ptp(sizes) < _EVEN * max(sizes):
        return 0.0
    best: float = angles[np.argmax(sizes)]
    for _ in range(4):
        _, slope, curve = slopes(best)
        best -= slope / curve
    return best


def _shear(z: FloatArray, elastic: FloatArray) -> FloatArray:
    """Shear stiffness (2, 2) of zx and yz, over the thickness, of layers between heights over it."""
    plane, across = elastic[:, _PLANE[:, None], _PLANE], elastic[:, _ACROSS[:, None], _ACROSS]
    stretch, both, bend = (np.einsum("lij,l->ij", plane, np.diff(z**power) / power) for power in (1, 2, 3))
    flexible = np.linalg.inv(np.block([[stretch, both], [both, bend]]))[:, 3:]
    # Stress by moments is linear across a layer, so is the shear by shear forces quadratic.
    along, length = np.polynomial.legendre.leggauss(3)
    below: FloatArray = np.zeros((2, 2))
    soft: FloatArray = np.zeros((2, 2))
    rows, columns = np.array([[0, 2], [2, 1]]), np.array([[0, 1], [0, 1]])
    for low, high, own, shear in zip(z[:-1], z[1:], plane, across, strict=True):

        def upto(height: float, low: float = low, own: FloatArray = own) -> FloatArray:
            first, second = height - low, 0.5 * (height**2 - low**2)
            return (own @ (first * flexible[:3] + second * flexible[3:]))[rows, columns]

        for place, weight in zip(along, length, strict=True):
            stress = below + upto(0.5 * (low + high + place * (high - low)))
            soft += 0.5 * weight * (high - low) * stress.T @ np.linalg.solve(shear, stress)
        below = np.asarray(below + upto(high), dtype=np.float64)
    return np.linalg.inv(soft).astype(np.float64)
