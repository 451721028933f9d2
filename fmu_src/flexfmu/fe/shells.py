"""Shells as metric elements: bricks and wedges of one layer whose strains are taken where they do not lock.

The unknowns are positions of points on both faces, so every formula of solids holds. Natural strains at some places,
e_ij = J_iᵀ E J_j, make the energy ½ eᵀ D e (docs/theory.md, equation (2e)), with one constant matrix D an element that
holds all of the shell: plane stress, assumed shear (E. N. Dvorkin, K.-J. Bathe, Eng. Comput. 1 (1984) 77; P. S. Lee,
K.-J. Bathe, Comput. Struct. 82 (2004) 945), stretch of the thickness at the corners (P. Betsch, E. Stein, Commun.
Numer. Methods Eng. 11 (1995) 899), and four strains of its own in the plane (J. C. Simo, M. S. Rifai, Int. J. Numer.
Meth. Engng. 29 (1990) 1595).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..files.errors import ModelError
from ..mesh.blocks import ElementBlock, jacobians
from ..mesh.elements import ElementType
from ..mesh.model import Mesh
from ..mesh.shapes import brick_rule, wedge_rule
from .cells import VOIGT, Cells

# Share of the shear that is constant across the thickness and is not; and, of triangles, by how much shear of elements
# that are wide against their thickness is softened (M. Lyly, R. Stenberg, T. Vihinen, 1993).
_SHEAR, _SOFTENED = 5.0 / 6.0, 0.1
# Places of the rules in `mesh.elements` by component: first those in the plane, then shear, then across.
_IN_PLANE = ((0, 0), (1, 1), (0, 1))
_QUAD_SHEAR = ((8, 0, 2), (9, 0, 2), (10, 1, 2), (11, 1, 2))
_TRIANGLE_SHEAR = ((2, 0, 2), (3, 0, 2), (4, 1, 2), (3, 1, 2))


@dataclass(frozen=True, slots=True)
class ShellCells(Cells):
    """Shells of one type, for their stiffness.

    Attributes
    ----------
    place : (r,) int
        Integration point of each natural strain.
    slope : (2, e or 1, r, a) float
        ∂N_a/∂ξ_i and ∂N_a/∂ξ_j of each natural strain e_ij.
    base : (2, e, r, 3) float
        J_i and J_j: ∂X/∂ξ, m.
    law : (e, r, r) float
        D, J.
    """

    place: IntArray
    slope: FloatArray
    base: FloatArray
    law: FloatArray

    def in_means(self) -> "ShellCells":
        """The same for fields in means and differences of both faces; of these, slopes along both faces cancel exactly.

        Rows of the means are the lower ones of both faces.
        """
        low, high = np.split(self.nodes, 2, axis=1)
        sign = np.where(low < high, 1.0, -1.0)

        def turned(below: FloatArray, above: FloatArray) -> list[FloatArray]:
            return [np.sqrt(0.5) * (below + above), np.sqrt(0.5) * (above - below)]

        mean, across = turned(*np.split(self.slope, 2, axis=3))
        slope = np.concatenate([mean + 0.0 * sign[:, None], sign[:, None] * across], axis=3)
        mean, across = turned(*np.split(self.gradient, 2, axis=2))
        gradient = np.concatenate([mean, sign[:, None, :, None] * across], axis=2)
        nodes = np.concatenate([np.minimum(low, high), np.maximum(low, high)], axis=1)
        return replace(self, nodes=nodes, slope=slope, gradient=gradient)

    def stiffness(self, deformation: FloatArray | None = None) -> FloatArray:
        """∂e/∂uᵀ D ∂e/∂u (e, 3a, 3a), by default of the undeformed elements."""
        first, second = self.base
        if deformation is not None:
            first, second = (np.einsum("erij,erj->eri", deformation[:, self.place], one) for one in (first, second))
        b = 0.5 * (self.slope[0][..., None] * second[:, :, None] + self.slope[1][..., None] * first[:, :, None])
        b = b.reshape(*b.shape[:2], -1)
        result: FloatArray = b.swapaxes(1, 2) @ (self.law @ b)
        return result

    def stress(self, strain: FloatArray) -> FloatArray:
        """Stress (e, q, 3, 3, ...) at the places whose work is D's, of symmetric strains of the same shape."""
        first, second = self.base
        natural = np.einsum("eri,erj,erij...->er...", first, second, strain[:, self.place], optimize=True)
        force = np.einsum("erk,ek...->er...", self.law, natural, optimize=True)
        pulled = np.einsum("eri,erj,er...->erij...", first, second, force, optimize=True)
        result = np.zeros_like(strain)
        for row, place in enumerate(self.place.tolist()):
            result[:, place] += 0.5 * (pulled[:, row] + pulled[:, row].swapaxes(1, 2))
        result /= self.volume.reshape(*self.volume.shape, *(1,) * (strain.ndim - 2))
        return result


def shell_cells(mesh: Mesh, block: ElementBlock, size: int) -> Iterator[ShellCells]:
    """Yield a block's shells, some at a time; see `cells.cells`."""
    shape, rule = block.type.shape, block.type.stiffness
    slope = shape.gradient(rule.points)
    rows = _rows(block.type)
    place, i, j = rows.T
    for first in range(0, len(block.labels), size):
        places = slice(first, min(first + size, len(block.labels)))
        nodes = block.connectivity[places]
        corners = mesh.points[nodes]
        inverse, determinant = jacobians(corners, slope)
        base = np.einsum("qaJ,eai->eqJi", slope, corners)
        materials = [mesh.materials[k] for k in block.material[places]]
        if any(material.constants is not None for material in materials):
            raise ModelError(
                "shells of anisotropic material are not supported: give Young's modulus and Poisson's ratio"
            )
        constants = np.array([(material.youngs_modulus, material.poissons_ratio) for material in materials])
        yield ShellCells(
            nodes,
            shape.value(rule.points),
            slope @ inverse,
            determinant * rule.weights,
            np.zeros((len(nodes), 6, 6)),
            place,
            np.stack([slope[place, :, i], slope[place, :, j]])[:, None],
            np.stack([base[:, place, i], base[:, place, j]]),
            _law(block.type, corners, rows, constants),
        )


def _rows(kind: ElementType) -> IntArray:
    """Place and both components of each natural strain (r, 3)."""
    flat, shear, count = (8, _QUAD_SHEAR, 12) if kind is ElementType.S4 else (2, _TRIANGLE_SHEAR, 5)
    corners = len(kind.stiffness.weights) - count
    inside = [(place, i, j) for place in range(flat) for i, j in _IN_PLANE]
    return np.array([*inside, *shear, *((count + k, 2, 2) for k in range(corners))])


def _law(kind: ElementType, corners: FloatArray, rows: IntArray, constants: FloatArray) -> FloatArray:
    """D (e, r, r) of elements with corners (e, a, 3) and E, ν (e, 2)."""
    quad = kind is ElementType.S4
    rule = brick_rule(2) if quad else wedge_rule(2, 2)
    slope = kind.shape.gradient(np.concatenate([rule.points, [[0.0, 0.0, 0.0] if quad else [1 / 3, 1 / 3, 0.0]]]))
    base = np.einsum("qaJ,eai->eqJi", slope, corners)
    determinant = np.linalg.det(base)
    # Local axes: first along the element, third across it.
    across = np.cross(base[:, :, 0], base[:, :, 1])
    along = base[:, :, 0] / np.linalg.norm(base[:, :, 0], axis=2, keepdims=True)
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    axes = np.stack([along, np.cross(across, along), across], axis=2)
    elastic = _plane_stress(constants, 1.0 if quad else _softening(corners))
    law = np.zeros((len(corners), len(rows), len(rows)))
    own, mixed = np.zeros((len(corners), 4, 4)), np.zeros((len(corners), 4, len(rows)))
    to_centre = np.linalg.inv(base[:, -1])
    for q, (point, weight) in enumerate(zip(rule.points, rule.weights, strict=True)):
        assumed = _assumed(quad, q, point, rows)
        local = _turned(axes[:, q] @ np.linalg.inv(base[:, q])) @ assumed
        stiff = (weight * determinant[:, q])[:, None, None] * elastic
        law += local.swapaxes(1, 2) @ (stiff @ local)
        if quad:
            shapes = np.zeros((6, 4))
            shapes[[0, 1, 3, 3], range(4)] = point[[0, 1, 0, 1]]
            extra = _turned(axes[:, q] @ to_centre) @ shapes
            extra = extra * (determinant[:, -1] / determinant[:, q])[:, None, None]
            own += extra.swapaxes(1, 2) @ (stiff @ extra)
            mixed += extra.swapaxes(1, 2) @ (stiff @ local)
    if quad:
        law -= mixed.swapaxes(1, 2) @ np.linalg.solve(own, mixed)
    result: FloatArray = 0.5 * (law + law.swapaxes(1, 2))
    return result


def _assumed(quad: bool, q: int, point: FloatArray, rows: IntArray) -> FloatArray:
    """Natural strains, shear twice, (6, r) at an integration point of those at the places."""
    x, y, _ = point
    result = np.zeros((6, len(rows)))
    flat = 3 * (q if quad else q // 3)
    result[[0, 1, 3], range(flat, flat + 3)] = 1.0, 1.0, 2.0
    if quad:
        result[5, 24:26] = 1.0 - y, 1.0 + y
        result[4, 26:28] = 1.0 - x, 1.0 + x
        signs = ElementType.S4.stiffness.points[12:, :2]
        result[2, 28:] = 0.25 * np.prod(1.0 + signs * point[:2], axis=1)
    else:
        # e₁₃ = e₁₃⁽¹⁾ + c s, e₂₃ = e₂₃⁽²⁾ − c r, c = e₂₃⁽²⁾ − e₁₃⁽¹⁾ − e₂₃⁽³⁾ + e₁₃⁽³⁾.
        change = np.array([-1.0, 1.0, 1.0, -1.0])
        result[5, 6:10] = 2.0 * (np.array([1.0, 0.0, 0.0, 0.0]) + y * change)
        result[4, 6:10] = 2.0 * (np.array([0.0, 0.0, 1.0, 0.0]) - x * change)
        result[2, 10:] = 1.0 - x - y, x, y
    return result


def _turned(to_local: FloatArray) -> FloatArray:
    """Strain in local axes, shear twice, of natural strain, shear twice, (e, 6, 6), by e_a · Gⁱ (e, 3, 3)."""
    result = np.empty((len(to_local), 6, 6))
    for row, (a, b) in enumerate(VOIGT):
        for column, (i, j) in enumerate(VOIGT):
            value = to_local[:, a, i] * to_local[:, b, j]
            if i != j:
                value = 0.5 * (value + to_local[:, a, j] * to_local[:, b, i])
            result[:, row, column] = value if a == b else 2.0 * value
    return result


def _plane_stress(constants: FloatArray, softened: FloatArray | float) -> FloatArray:
    """Matrix (e, 6, 6) of plane stress in the first two axes; across, the modulus alone, which keeps the thickness."""
    modulus, poisson = constants.T
    shear = 0.5 * modulus / (1.0 + poisson)
    result = np.zeros((len(constants), 6, 6))
    result[:, 0, 0] = result[:, 1, 1] = modulus / (1.0 - poisson**2)
    result[:, 0, 1] = result[:, 1, 0] = poisson * modulus / (1.0 - poisson**2)
    result[:, 2, 2], result[:, 3, 3] = modulus, shear
    result[:, 4, 4] = result[:, 5, 5] = _SHEAR * softened * shear
    return result


def _softening(corners: FloatArray) -> FloatArray:
    """t²/(t² + 0.1 h²) of wedges (e, 6, 3): thickness and longest edge."""
    thickness = np.linalg.norm(corners[:, 3:].mean(axis=1) - corners[:, :3].mean(axis=1), axis=1)
    middle = 0.5 * (corners[:, :3] + corners[:, 3:])
    longest = np.linalg.norm(middle - np.roll(middle, 1, axis=1), axis=2).max(axis=1)
    result: FloatArray = thickness**2 / (thickness**2 + _SOFTENED * longest**2)
    return result
