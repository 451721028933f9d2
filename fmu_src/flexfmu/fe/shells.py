"""Shells and beams as metric elements: bricks and wedges of one layer whose strains are taken where they do not lock.

The unknowns are positions of points on both faces, so every formula of solids holds. Natural strains at some places,
e_ij = J_iᵀ E J_j, make the energy ½ eᵀ D e (docs/theory.md, equation (2e)), with one constant matrix D an element that
holds all of the shell: plane stress, assumed shear (E. N. Dvorkin, K.-J. Bathe, Eng. Comput. 1 (1984) 77; P. S. Lee,
K.-J. Bathe, Comput. Struct. 82 (2004) 945), stretch of the thickness at the corners (P. Betsch, E. Stein, Commun.
Numer. Methods Eng. 11 (1995) 899), and four strains of its own in the plane (J. C. Simo, M. S. Rifai, Int. J. Numer.
Meth. Engng. 29 (1990) 1595).

A beam is a brick between two rigid sections, of six strains in its middle: extension, shear, curvatures and twist are
products of positions' slopes too. One element is exact in linear statics: its shear compliance has the bending that
linear functions lack (R. H. MacNeal, Comput. Struct. 8 (1978) 175).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..files.basics import FloatArray, IntArray, ModelError
from ..mesh.elements import ElementBlock, ElementType, jacobians
from ..mesh.model import SECTION_SHARES, Material, Mesh
from ..mesh.shapes import Quadrature, brick_rule, wedge_rule
from .layers import Cells, Laminate, bent, laminates, stack, turning

# By how much shear of triangles that are wide against their thickness is softened (M. Lyly, R. Stenberg, T. Vihinen,
# 1993).
_SOFTENED = 0.1
# Elements at a time whose matrices are made together.
_TOGETHER = 2048


class ShellRule:
    """Where elements of a type take natural strains; places that always have the same one share it.

    Attributes
    ----------
    slope : (s, a) float
        ∂N_a/∂ξ_j of each slope.
    rows : (r, 2) int
        Slopes whose products make each strain.
    merged : (k, r) float
        Strains as the assumptions have them of those of their own.
    halves : (2, a/2) int
        Of shells the nodes of both faces.
    """

    def __init__(self, kind: ElementType):
        place, *both = (np.array(BEAM_ROWS) if kind.beam else kind.strains.rows).T
        every = np.concatenate([kind.shape.gradient(kind.stiffness.points)[place, :, one] for one in both])
        _, chosen, which = np.unique(np.round(every, 9), axis=0, return_index=True, return_inverse=True)
        self.slope: FloatArray = every[chosen]
        self.rows, strain = np.unique(which.reshape(2, len(place)).T, axis=0, return_inverse=True)
        self.merged = np.eye(len(self.rows))[strain.ravel()]
        self.halves = np.zeros((2, 0), dtype=np.int64) if kind.beam else kind.sheet.halves


shell_rule = cache(ShellRule)


@dataclass(frozen=True)
class ShellCells(Cells):
    """Shells of one type, or beams, for their stiffness.

    Attributes
    ----------
    rule : ShellRule
    slope : (e or 1, s, a) float
        ∂N_a/∂ξ_j of each slope.
    base : (e, s, 3) float
        ∂X/∂ξ_j likewise, m.
    law : (e, r, r) float
        D, J, of natural strains, shear twice.
    enhanced : (e, 4 or 0, r) float
        Strains of the elements' own by natural strains.
    """

    rule: ShellRule
    slope: FloatArray
    base: FloatArray
    law: FloatArray
    enhanced: FloatArray

    @property
    def rows(self) -> IntArray:
        """As of solids."""
        return self.rule.rows

    @property
    def undeformed(self) -> FloatArray:
        """As of solids, in natural directions."""
        return self.base

    @property
    def shape_slopes(self) -> FloatArray:
        """As of solids, in natural directions."""
        return self.slope

    def work(self, strains: FloatArray) -> FloatArray:
        """What works on natural strains (e, r, k)."""
        return self.law @ strains

    def part(self, chosen: slice) -> "ShellCells":
        """Some of the elements."""
        names = ("nodes", "gradient", "volume", "elasticity", "base", "law", "enhanced")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def in_means(self) -> "ShellCells":
        """The same for fields in means and differences of both faces; of these, slopes along both faces cancel exactly.

        But for gradients in global axes. Rows of the means are the lower ones of both faces.
        """
        if not self.rule.halves.size:
            return replace(self, slope=self.slope @ np.kron(np.eye(2), SECTION_SHARES))
        low, high = self.nodes[:, self.rule.halves].swapaxes(0, 1)
        sign = np.where(low < high, 1.0, -1.0)
        below, above = np.sqrt(0.5) * np.moveaxis(self.slope[:, :, self.rule.halves], 2, 0)
        slope = np.concatenate([below + above + 0.0 * sign[:, None], sign[:, None] * (above - below)], axis=2)
        nodes = np.concatenate([np.minimum(low, high), np.maximum(low, high)], axis=1)
        return replace(self, nodes=nodes, slope=slope)

    def turned(self, turn: FloatArray) -> FloatArray:
        """As of solids, by the mean turn of each element."""
        return np.einsum("eqijk,esj->esik", turn, self.base, optimize=True) / turn.shape[1]


def shell_cells(mesh: Mesh, block: ElementBlock, size: int) -> Iterator[ShellCells]:
    """Yield a block's shells, some at a time; see `cells.cells`. The mesh keeps them: they are asked for many times."""
    kept: list[ShellCells] = mesh.kept.setdefault(f"shells {id(block)}", [])
    for first in range(0, len(block.labels), _TOGETHER):
        if len(kept) * _TOGETHER <= first:
            kept.append(_made(mesh, block.part(np.arange(first, min(first + _TOGETHER, len(block.labels))))))
        whole = kept[first // _TOGETHER]
        yield from (whole.part(slice(start, start + size)) for start in range(0, len(whole.nodes), size))


def _made(mesh: Mesh, block: ElementBlock) -> ShellCells:
    """All shells of a block."""
    shape, rule = block.type.shape, block.type.stiffness
    slope, strains = shape.gradient(rule.points), shell_rule(block.type)
    corners = mesh.points[block.connectivity]
    inverse, determinant = jacobians(corners, slope)
    count = len(strains.rows)
    law = np.zeros((len(corners), count, count))
    enhanced = np.zeros((len(corners), 4 if block.type is ElementType.S4 else 0, count))
    if block.section is not None:
        materials = [mesh.materials[k] for k in block.material]
        if any(material.constants is not None or material.layers for material in materials):
            raise ModelError("beams of anisotropic material are not supported: give Young's modulus and ν")
        constants = np.array([(material.youngs_modulus, material.poissons_ratio) for material in materials])
        law = beam_law(corners, strains.merged, constants, block.section)
    else:
        for chosen, laminate in laminates(mesh, block):
            law[chosen], enhanced[chosen] = _law(block.type, corners[chosen], strains, laminate)
    nodes, value, elasticity = block.connectivity, shape.value(rule.points), np.zeros((len(corners), 6, 6))
    of_cells = nodes, value, slope @ inverse, determinant * rule.weights * block.filling, elasticity
    return ShellCells(*of_cells, strains, strains.slope[None], strains.slope @ corners, law, enhanced)


def face_stress(
    mesh: Mesh, block: ElementBlock, fields: FloatArray, material: Material | None = None
) -> tuple[FloatArray, FloatArray]:
    """Stress on both faces of a block's shells: membrane and bending.

    Parameters
    ----------
    mesh : Mesh
    block : ElementBlock
    fields : (n, 3, k) float
        Displacements, m.
    material : Material, optional
        That all of them are of: on both faces of each of its layers.

    Returns
    -------
    points : (e, q, 3) float
        Undeformed places, m.
    stress : (e, q, 6, k) float
        Components xx, yy, zz, xy, yz, zx, N/m².
    """
    rule, layers = face_rule(block.type), None
    if material is not None:
        heights = stack(material)[0]
        plane = rule.points[rule.points[:, 2] > 0.0, :2]
        across = np.repeat(np.stack([heights[:-1], heights[1:]], axis=1).ravel(), len(plane))
        layers = np.repeat(np.arange(len(heights) - 1), 2 * len(plane))
        places = np.tile(plane, (across.size // len(plane), 1))
        rule = Quadrature(np.column_stack([places, across]), np.ones(across.size))
    at, found, _ = local_stress(mesh, block, fields, rule, layers)
    # Faces are free: no shear there, and the modulus across keeps the thickness alone.
    found[:, :, [2, 4, 5]] = 0.0
    places = np.einsum("qa,eai->eqi", block.type.shape.value(rule.points), mesh.points[block.connectivity])
    return places, turning(at.axes[:, :-1].reshape(-1, 3, 3).swapaxes(1, 2)).reshape(*found.shape[:2], 6, 6) @ found


def local_stress(
    mesh: Mesh, block: ElementBlock, fields: FloatArray, rule: Quadrature, layers: IntArray | None = None
) -> tuple["Places", FloatArray, FloatArray]:
    """Stress (e, q, 6, k) of a block's shells at points of a rule, in axes there; of some layers (q,), or the outer.

    Beside it places and axes, and elasticity (e, q, 6, 6).
    """
    layers = np.where(rule.points[:, 2] > 0.0, -1, 0) if layers is None else layers
    some, made = _made(mesh, block), list(laminates(mesh, block))
    at = Places(block.type, mesh.points[block.connectivity], some.rule, rule)
    natural = some.strains(fields)
    own = some.enhanced @ natural
    strain = np.empty((len(natural), len(rule.points), 6, fields.shape[2]))
    elastic = np.empty((*strain.shape[:3], 6))
    for q, point in enumerate(rule.points):
        strain[:, q] = at.strains(q) @ natural
        if own.shape[1]:
            strain[:, q] += at.own(q, point) @ own
        for chosen, laminate in made:
            elastic[chosen, q] = laminate.at(at.axes[chosen, q], layers[q])
    for chosen, laminate in made:
        if laminate.bending < 1.0:
            strain[chosen] = bent(strain[chosen].swapaxes(0, 1), rule.points, laminate.bending).swapaxes(0, 1)
    return at, elastic @ strain, elastic


@cache
def face_rule(kind: ElementType) -> Quadrature:
    """Places on both faces of shells where their stress is known best."""
    points = inner_rule(kind).points
    return Quadrature(np.column_stack([points[:, :2], np.sign(points[:, 2])]), np.ones(len(points)))


@cache
def inner_rule(kind: ElementType) -> Quadrature:
    """The same places, within shells."""
    if kind in (ElementType.S4, ElementType.S8):
        return brick_rule(2)
    return wedge_rule(1 if kind is ElementType.S3 else 2, 2)


def _law(kind: ElementType, nodes: FloatArray, strains: ShellRule, laminate: Laminate) -> tuple[FloatArray, FloatArray]:
    """D (e, r, r), and strains of their own (e, 4 or 0, r), of shells with nodes (e, a, 3)."""
    quad, (rule, layers) = kind is ElementType.S4, laminate.rule(kind.mass)
    at = Places(kind, nodes, strains, rule)
    count = len(strains.rows)
    softened = _softening(nodes) if kind is ElementType.S3 else np.ones(len(nodes))
    law = np.zeros((len(nodes), count, count))
    own, mixed = np.zeros((len(nodes), 4, 4)), np.zeros((len(nodes), 4, count))
    mean: dict[float, FloatArray] = {}
    if kind is ElementType.S8:
        # Assumed strains get the means, above and below, of those of the positions: patches of distorted shells.
        found, wanted = (Places(kind, nodes, strains, one).means() for one in (kind.mass, brick_rule(2)))
        mean = {side: wanted[side] - found[side] for side in found}

    def patched(q: int) -> FloatArray:
        across = 3.0**0.5 * rule.points[q, 2]
        parts = (0.5 * (1.0 + side * across) * at.turned(q, more, back=False) for side, more in mean.items())
        return sum(parts, at.strains(q))

    every: Iterable[FloatArray] = map(patched, range(len(rule.points)))
    if laminate.bending != 1.0:
        every = bent(np.array([*every]), rule.points, laminate.bending**0.5)
    for q, (point, weight, local) in enumerate(zip(rule.points, rule.weights, every, strict=True)):
        stiff = (weight * at.determinant[:, q])[:, None, None] * laminate.at(at.axes[:, q], layers[q])
        stiff[:, 4:, 4:] *= softened[:, None, None]
        law += local.swapaxes(1, 2) @ (stiff @ local)
        if quad:
            extra = at.own(q, point)
            own += extra.swapaxes(1, 2) @ (stiff @ extra)
            mixed += extra.swapaxes(1, 2) @ (stiff @ local)
    enhanced: FloatArray = -np.linalg.solve(own, mixed).astype(np.float64) if quad else mixed[:, :0]
    if quad:
        law += mixed.swapaxes(1, 2) @ enhanced
    return 0.5 * (law + law.swapaxes(1, 2)), enhanced


class Places:
    """Assumed strains of shells in local axes, first along the element, third across it.

    Attributes
    ----------
    base : (e, q + 1, 3, 3) float
        Slopes ∂X/∂ξ_J, rows, at the points of a rule and in the middle.
    determinant : (e, q + 1) float
    axes : (e, q + 1, 3, 3) float
        Rows.
    """

    def __init__(self, kind: ElementType, corners: FloatArray, strains: ShellRule, rule: Quadrature):
        slope = kind.shape.gradient(np.concatenate([rule.points, [[0.0, 0.0, 0.0]]]))
        self.rule = rule
        self.base = np.einsum("qaJ,eai->eqJi", slope, corners)
        self.determinant = np.linalg.det(self.base)
        across = np.cross(self.base[:, :, 0], self.base[:, :, 1])
        along = self.base[:, :, 0] / np.linalg.norm(self.base[:, :, 0], axis=2, keepdims=True)
        across /= np.linalg.norm(across, axis=2, keepdims=True)
        self.axes = np.stack([along, np.cross(across, along), across], axis=2)
        self._natural = kind.strains.assumed(rule.points) @ strains.merged

    def strains(self, q: int) -> FloatArray:
        """Strains (e, 6, r) at a point of the rule."""
        to_natural = np.linalg.inv(self.base[:, q].swapaxes(1, 2)) @ self.axes[:, q].swapaxes(1, 2)
        return turning(to_natural).swapaxes(1, 2) @ self._natural[q]

    def own(self, q: int, point: FloatArray) -> FloatArray:
        """Strains (e, 6, 4) of an element's own at a point of the rule."""
        shapes = np.zeros((6, 4))
        shapes[[0, 1, 3, 3], range(4)] = point[[0, 1, 0, 1]]
        to_centre = self.axes[:, q] @ np.linalg.inv(self.base[:, -1])
        found: FloatArray = turning(to_centre.swapaxes(1, 2)).swapaxes(1, 2) @ shapes
        return found * (self.determinant[:, -1] / self.determinant[:, q])[:, None, None]

    def turned(self, q: int, strains: FloatArray, *, back: bool) -> FloatArray:
        """Strains (e, 6, r) in the middle's axes as ones in the plane at a point of the rule, or the other way."""
        turn = self.axes[:, -1] @ self.axes[:, q].swapaxes(1, 2)
        turn = turning(turn.swapaxes(1, 2) if back else turn).swapaxes(1, 2)
        inside = np.array([1.0, 1.0, 0.0, 1.0, 0.0, 0.0])
        return inside[:, None] * (turn @ (inside[:, None] * strains))

    def means(self) -> dict[float, FloatArray]:
        """Mean strains (e, 6, r) in the middle's axes above (1) and below (−1) the middle."""
        found = {}
        for side in (-1.0, 1.0):
            chosen = np.flatnonzero(self.rule.points[:, 2] * side > 0.0).tolist()
            weights = {q: (self.rule.weights[q] * self.determinant[:, q])[:, None, None] for q in chosen}
            total = sum(weights[q] * self.turned(q, self.strains(q), back=True) for q in chosen)
            found[side] = np.asarray(total / sum(weights.values()))
        return found


def _softening(corners: FloatArray) -> FloatArray:
    """t²/(t² + 0.1 h²) of wedges (e, 6, 3): thickness and longest edge."""
    thickness = np.linalg.norm(corners[:, 3:].mean(axis=1) - corners[:, :3].mean(axis=1), axis=1)
    middle = 0.5 * (corners[:, :3] + corners[:, 3:])
    longest = np.linalg.norm(middle - np.roll(middle, 1, axis=1), axis=2).max(axis=1)
    return thickness**2 / (thickness**2 + _SOFTENED * longest**2)


BEAM_ROWS = (*((place, 2, 2) for place in range(5)), *((k, 0, 2) for k in (0, 3, 4)), *((k, 1, 2) for k in (0, 1, 2)))
"""Place and both components of each natural strain; the third runs along the beam."""

# ε, κ₁, κ₂, τ, γ₁, γ₂ of them, times what lengths make of them.
_STRAINS = np.zeros((6, len(BEAM_ROWS)))
_STRAINS[[0, 4, 5], [0, 5, 8]] = 2.0, 1.0, 1.0
_STRAINS[[1, 1, 2, 2], [1, 2, 3, 4]] = _STRAINS[3, [10, 9, 6, 7]] = 1.0, -1.0, 1.0, -1.0


def beam_law(corners: FloatArray, merged: FloatArray, constants: FloatArray, section: FloatArray) -> FloatArray:
    """Matrix of a beam's energy ½ eᵀ D e.

    Parameters
    ----------
    corners : (e, 8, 3) float
        Of both sections, m.
    merged : (r, k) float
        Natural strains at `BEAM_ROWS`, shear twice, of those that differ.
    constants : (e, 2) float
        E, ν.
    section : (e, 8) float
        As of `ElementBlock`.

    Returns
    -------
    (e, k, k) float
        J.
    """
    modulus, shear = constants[:, 0], 0.5 * constants[:, 0] / (1.0 + constants[:, 1])
    length = np.linalg.norm(corners[:, 4:].mean(axis=1) - corners[:, :4].mean(axis=1), axis=1)
    a, b = np.sqrt(3.0 * section[:, 1:3] / section[:, :1]).T
    scale = np.array([1.0 / length, 1.0 / (length * a), 1.0 / (length * b), 0.25 / (a * b), 1.0 / a, 1.0 / b])
    soft = [1.0 / (shear * section[:, 4 + k]) + length**2 / (12.0 * modulus * section[:, 1 + k]) for k in (0, 1)]
    stiff = np.array([*(modulus * section[:, :3].T), shear * section[:, 3], 1.0 / soft[0], 1.0 / soft[1]])
    found = (2.0 / length * scale).T[:, :, None] * (_STRAINS @ merged)
    # Shear is that at the shear centre, which twist moves.
    found[:, 4:] += section[:, [7, 6], None] * np.array([[1.0], [-1.0]]) * found[:, 3:4]
    return found.swapaxes(1, 2) @ ((length * stiff).T[:, :, None] * found)
