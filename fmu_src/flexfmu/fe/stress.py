"""Stress of displacement fields at the integration points of chosen elements."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ..files.basics import BoolArray, FloatArray, IntArray, ModelError
from ..mesh.elements import ElementBlock, ElementType
from ..mesh.model import Mesh
from ..mesh.shapes import LINEAR
from .assembly import CHUNK
from .cells import cells, turning
from .shells import face_rule, face_stress, inner_rule, local_stress

# Of walls: thickness over the second side, and the part that all thin directions at a node have in common.
_THIN, _SMOOTH = 0.2, 0.95
# Deflection that quadratic shells lack over the share of jumps: 2 to 5 on plates and strips of scattered nodes.
_HIDDEN = 3.0


def point_stress(mesh: Mesh, elements: IntArray, fields: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Linear elastic stress where elements know it best: at integration points; of shells on both faces of each layer.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    elements : (e,) int
        Counted over all blocks.
    fields : (3n, k) float
        Displacements, m per unit of whatever they belong to.

    Returns
    -------
    points : (p, 3) float
        Undeformed places, m.
    stress : (p, 6, k) float
        Components xx, yy, zz, xy, yz, zx, N/m² per that unit, axes of the undeformed body.
    """
    u = fields.reshape(len(mesh.points), 3, -1)
    places, stresses = [], []
    for block, inside in mesh.by_block(elements):
        if block.type.beam:
            raise ModelError("stress of beams is not offered: leave it out of the body file")
        if block.type.shell:
            for row in np.unique(block.material[inside]).tolist():
                chosen = inside[block.material[inside] == row]
                for first in range(0, len(chosen), CHUNK):
                    part = block.part(chosen[first : first + CHUNK])
                    place, found = face_stress(mesh, part, u, mesh.materials[row])
                    places.append(place.reshape(-1, 3))
                    stresses.append(found.reshape(-1, 6, u.shape[2]))
            continue
        for _, some in cells(mesh, block.part(inside), CHUNK):
            found = some.work(some.strains(u)).reshape(len(some.nodes), 6, -1, u.shape[2]).swapaxes(1, 2)
            stresses.append((found / some.volume[:, :, None, None]).reshape(-1, 6, u.shape[2]))
            places.append(np.einsum("qa,eai->eqi", some.value, mesh.points[some.nodes]).reshape(-1, 3))
    return np.concatenate(places), np.concatenate(stresses)


def nodal_stress(mesh: Mesh, nodes: IntArray, fields: FloatArray) -> FloatArray:
    """Stress at corner nodes: extrapolated from the integration points, and the mean of the elements that meet there.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    nodes : (k,) int
        Corner nodes, ascending.
    fields : (3n, m) float
        As of `point_stress`.

    Returns
    -------
    (k, 6, m) float
        As of `point_stress`.
    """
    total, met = np.zeros((nodes.size, 6, fields.shape[1])), np.zeros(nodes.size)
    row = np.full(len(mesh.points), -1)
    row[nodes] = np.arange(nodes.size)
    for block, first in zip(mesh.blocks, mesh.starts, strict=False):
        outward = _extrapolation(block.type)
        corners = row[block.connectivity[:, : len(outward)]]
        touching = np.flatnonzero((corners >= 0).any(axis=1))
        if touching.size:
            stress = (
                face_stress(mesh, block.part(touching), fields.reshape(len(mesh.points), 3, -1))[1]
                if block.type.shell
                else point_stress(mesh, first + touching, fields)[1]
            ).reshape(touching.size, -1, 6 * fields.shape[1])
            at_corners = (outward @ stress).reshape(-1, 6, fields.shape[1])
            there = corners[touching].ravel()
            np.add.at(total, there[there >= 0], at_corners[there >= 0])
            np.add.at(met, there[there >= 0], 1.0)
    return total / np.maximum(met, 1.0)[:, None, None]


def stress_jumps(mesh: Mesh, field: FloatArray, held: BoolArray | None = None) -> float:
    """Share of a field's strain energy in what its stress differs from the same with nodal means, linear between them.

    It estimates the share of a deflection that a coarse mesh lacks (O. C. Zienkiewicz, J. Z. Zhu, Int. J. Numer. Meth.
    Engng. 24 (1987) 337). Of linear elements, of shells of one layer, and of other solids within thin walls: where
    walls meet it is too much for them. Elements beside another material do not count, nor quadratic ones that are held
    on a line or at points, where stress is singular.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    field : (3n,) float
        Displacements, m.
    held : (n,) bool, optional
        Nodes of supports.

    Returns
    -------
    float
    """
    held = np.zeros(len(mesh.points), dtype=bool) if held is None else held
    solids, shells = (tuple(b for b in mesh.blocks if b.type.shell is one and not b.type.beam) for one in (False, True))
    energies = np.zeros(2)
    if solids:
        energies += _solid_jumps(replace(mesh, blocks=solids), field, held)
    if shells:
        energies += _shell_jumps(mesh, shells, field)
    return float(energies[0] / energies[1]) if energies[1] > 0.0 else 0.0


def _solid_jumps(mesh: Mesh, field: FloatArray, held: BoolArray) -> FloatArray:
    """Twice the energies of jumps and of the field."""
    sides = [block.connectivity[:, : len(_extrapolation(block.type))] for block in mesh.blocks]
    smooth, u = np.zeros((len(mesh.points), 6)), field.reshape(-1, 3, 1)
    nodes = np.unique(np.concatenate([side.ravel() for side in sides]))
    smooth[nodes] = nodal_stress(mesh, nodes, field[:, None])[..., 0]
    first, last = np.full(len(smooth), len(mesh.materials)), np.full(len(smooth), -1)
    for block, side in zip(mesh.blocks, sides, strict=True):
        np.minimum.at(first, side, block.material[:, None])
        np.maximum.at(last, side, block.material[:, None])
    energies, walls = np.zeros(2), _walls(mesh, sides)
    for block, side in zip(mesh.blocks, sides, strict=True):
        between = LINEAR[block.type.shape.polytope].value(block.type.stiffness.points)
        linear = block.type.node_count == block.type.corner_count and not block.type.incompatible
        # Three corners are a face.
        on_a_face = ~held[block.connectivity].any(axis=1) | (np.count_nonzero(held[side], axis=1) >= 3)
        counted = (first == last)[side].all(axis=1) & (linear | walls[side].all(axis=1) & on_a_face)
        for places, some in cells(mesh, block, CHUNK):
            found = some.work(some.strains(u)).reshape(len(some.nodes), 6, -1) / some.volume[:, None]
            jump = (found - np.einsum("qa,eac->ecq", between, smooth[side[places]])) * counted[places, None, None]
            for k, stress in enumerate((jump, found)):
                energies[k] += np.einsum("ecq,ecq,eq->", stress, np.linalg.solve(some.elasticity, stress), some.volume)
    return energies


def _walls(mesh: Mesh, sides: Sequence[IntArray]) -> BoolArray:
    """Corner nodes (n,) whose elements are all thin in the same direction."""
    total, met = np.zeros((len(mesh.points), 3, 3)), np.zeros(len(mesh.points))
    for side in sides:
        corners = mesh.points[side]
        _, size, axes = np.linalg.svd(corners - corners.mean(axis=1, keepdims=True))
        thin = axes[:, 2] * (size[:, 2:] < _THIN * size[:, 1:2])
        np.add.at(total, side, (thin[:, :, None] * thin[:, None])[:, None])
        np.add.at(met, side, 1.0)
    return np.linalg.eigvalsh(total)[:, 2] > _SMOOTH * np.maximum(met, 1.0)


def _shell_jumps(mesh: Mesh, blocks: Sequence[ElementBlock], field: FloatArray) -> FloatArray:
    """The same of shells, with the shear across them; jumps of quadratic ones count a few times over."""
    u, energies = field.reshape(-1, 3, 1), np.zeros(2)
    total, met = np.zeros((len(mesh.points), 6)), np.zeros(len(mesh.points))
    parts = []
    for block in blocks:
        layered = np.array([bool(material.layers) for material in mesh.materials])[block.material]
        plain, rule = np.flatnonzero(~layered), inner_rule(block.type)
        for first in range(0, plain.size, CHUNK):
            part = block.part(plain[first : first + CHUNK])
            at, local, elastic = local_stress(mesh, part, u, rule)
            local[:, :, 2] = 0.0
            turn = turning(at.axes[:, :-1].reshape(-1, 3, 3)).reshape(elastic.shape)
            stress = np.linalg.solve(turn, local)[..., 0]
            linear, shape = LINEAR[block.type.shape.polytope], block.type.shape
            outward = linear.value(shape.nodes) @ np.linalg.pinv(linear.value(rule.points))
            np.add.at(total, part.connectivity, outward @ stress)
            np.add.at(met, part.connectivity, 1.0)
            weight = at.determinant[:, :-1] * rule.weights
            parts.append((part, shape.value(rule.points), turn, np.linalg.inv(elastic), stress, weight))
    smooth = total / np.maximum(met, 1.0)[:, None]
    for part, value, turn, soft, stress, weight in parts:
        counted = 1.0 if part.type.node_count == part.type.corner_count else _HIDDEN
        for k, (one, factor) in enumerate(((stress - value @ smooth[part.connectivity], counted), (stress, 1.0))):
            own = np.einsum("eqcd,eqd->eqc", turn, one)
            own[:, :, 2] = 0.0
            energies[k] += factor * np.einsum("eqc,eqcd,eqd,eq->", own, soft, own, weight, optimize=True)
    return energies


@cache
def _extrapolation(kind: ElementType) -> FloatArray:
    """Values at the corners, of shells all nodes, (n, points) between which linear functions fit those at points best.

    Of several the least: one point gives a constant, one of the triangle at two heights what is linear along the wedge.
    """
    linear, rule = LINEAR[kind.shape.polytope], face_rule(kind) if kind.shell else kind.stiffness
    inward = np.linalg.pinv(linear.value(rule.points)).astype(np.float64)
    return linear.value(kind.shape.nodes) @ inward if kind.shell else inward
