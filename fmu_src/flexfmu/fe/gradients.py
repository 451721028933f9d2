"""Products of displacement gradients: geometric stiffness, strain of second order, stress that turns, spin; and stress.

And what stress does to the gradients of displacements, docs/theory.md sections 1, 4c and 7a.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import scipy.sparse as sp

from ..files.basics import BoolArray, FloatArray, IntArray, ModelError
from ..files.outputs import Tell, tell_nobody
from ..mesh.elements import ElementBlock, ElementType
from ..mesh.model import Mesh, once
from ..mesh.shapes import LINEAR
from .assembly import CHUNK, add_nodal, elastic_cells, scatter, summed
from .layers import Cells, cells, turning
from .shells import face_rule, face_stress, inner_rule, local_stress

# Numbers of a field of pairs that are held at a time: they stay in the processor's cache, which halves the time.
_NUMBERS = 150_000
# Rows at a time of which only the upper triangle is wanted, and fields; strains that are summed up at a time: sums are
# as large as what they are made of.
_STRIP, _FIELDS, _ROWS = 128, 16, 400


def _some(mesh: Mesh, pairs: int, tell: Tell = tell_nobody) -> Iterator[Cells]:
    """Elements, few at a time: of so many pairs or fields."""
    done = 0
    for some in elastic_cells(mesh, 0, max(_ROWS, _NUMBERS // pairs)):
        yield some
        done += len(some.nodes)
        tell(done)


def geometric_stiffness(mesh: Mesh, fields: FloatArray, shapes: FloatArray) -> FloatArray:
    """Geometric stiffness matrices of several displacement fields in the modes, docs/theory.md equation (11).

    The full matrices are never assembled: stress and mode gradients are contracted at the integration points.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    fields : (3n, k) float
        Displacements, m per unit of whatever they belong to.
    shapes : (3n, m) float
        Mode shapes, kg^-1/2.

    Returns
    -------
    (k, m, m) float
        ∫ σ_JK ∂φ_a/∂X_J · ∂φ_b/∂X_K dV, 1/s² per that unit; symmetric in a and b.
    """
    u, phi, m = *(some.reshape(len(mesh.points), 3, -1) for some in (fields, shapes)), shapes.shape[1]
    result = np.zeros((u.shape[2], m, m))
    for some in elastic_cells(mesh, 0, max(_ROWS, 4 * _NUMBERS // max(u.shape[2], m * min(m, _FIELDS)))):
        slopes = some.slopes(phi)
        work = 2.0 * some.work(some.strains(u)).reshape(-1, u.shape[2]).T
        # The upper triangle, by strips. The strain of second order is half of what stress takes.
        for first in range(0, m, _FIELDS):
            strain = some.all_products(slopes[..., first : first + _FIELDS], slopes[..., first:])
            strain = strain.reshape(-1, *strain.shape[2:])
            result[:, first : first + _FIELDS, first:] += np.tensordot(work, strain, 1)
    for one in result:
        one[:] = np.triu(one) + np.triu(one, 1).T
    return result


def quadratic_strain(mesh: Mesh, shapes: FloatArray, pairs: IntArray, tell: Tell) -> tuple[FloatArray, FloatArray]:
    """Nodal forces and energies of E_ab = ¼ (G_aᵀ G_b + G_bᵀ G_a), G_a = ∇φ_a, docs/theory.md section 4c.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    shapes : (3n, m) float
        Mode shapes, kg^-1/2.
    pairs : (p, 2) int
        a and b of each.
    tell : callable
        Takes how many elements are done.

    Returns
    -------
    forces : (3n, p) float
        ∫ Bᵀ C E_ab dV, N/(kg m²).
    energies : (p, p) float
        ∫ E_ab : C : E_cd dV, J/(kg m²)².
    """
    phi = shapes.reshape(len(mesh.points), 3, -1)
    forces, energies = np.zeros((len(mesh.points), 3, len(pairs))), np.zeros((len(pairs), len(pairs)))
    for some in _some(mesh, len(pairs), tell):
        strain = some.products(some.slopes(phi), pairs)
        work = some.work(strain)
        nodal, relaxed = some.relaxed(some.nodal(work))
        add_nodal(forces, some.nodes, nodal)
        energies[: len(relaxed), : len(relaxed)] -= relaxed
        left, right = strain.reshape(-1, len(pairs)), work.reshape(-1, len(pairs))
        # The upper triangle, by strips.
        for first in range(0, len(pairs), _STRIP):
            energies[first : first + _STRIP, first:] += left[:, first : first + _STRIP].T @ right[:, first:]
    return forces.reshape(-1, len(pairs)), np.triu(energies) + np.triu(energies, 1).T


def mean_spin(mesh: Mesh, shapes: FloatArray) -> FloatArray:
    """Mean over the volume of ω_a·ω_b, ω_a = ½ curl φ_a.

    Parameters
    ----------
    mesh : Mesh
    shapes : (3n, m) float

    Returns
    -------
    (m, m) float
    """
    total, volume = np.zeros((shapes.shape[1], shapes.shape[1])), 0.0
    for some in _some(mesh, shapes.shape[1]):
        turn = some.turn(shapes.reshape(len(mesh.points), 3, -1)) * np.sqrt(some.volume)[:, :, None, None, None]
        rows = turn.reshape(-1, shapes.shape[1])
        # |ω|² is half of the sum over all places of the turn.
        total += 0.5 * rows.T @ rows
        volume += float(some.volume.sum())
    return total / volume


def own_spin(mesh: Mesh, shapes: FloatArray) -> FloatArray:
    """Means (m,) of |ω|² over where motions (3n, m) turn the material: ∫ |ω|⁴ dV / ∫ |ω|² dV, ω = ½ curl u."""
    square, fourth = np.zeros((2, shapes.shape[1]))
    for some in _some(mesh, shapes.shape[1]):
        spin = 0.5 * (some.turn(shapes.reshape(len(mesh.points), 3, -1)) ** 2).sum(axis=(2, 3))
        square += np.einsum("eq,eqm->m", some.volume, spin)
        fourth += np.einsum("eq,eqm->m", some.volume, spin**2)
    return fourth / np.where(square > 0.0, square, 1.0)


def turned_stress(mesh: Mesh, shapes: FloatArray, forces: FloatArray, pairs: IntArray, tell: Tell) -> FloatArray:
    """Nodal forces by which stress of one mode flattens what another one curves.

    The stress σ_b, turned by ω_a = ½ curl φ_a, is in equilibrium with the nodal forces of mode b turned likewise, but
    for what the rotation's change along the body makes of it: (∂ω_a/∂X_J) × σ_b e_J.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    shapes : (3n, m) float
    forces : (3n, m) float
        Nodal forces K φ_b.
    pairs : (p, 2) int
        a and b of each.
    tell : callable
        Takes how many elements are done.

    Returns
    -------
    (3n, p) float
        The mean of both orders of a pair.
    """
    count, modes = len(mesh.points), shapes.shape[1]
    result = np.zeros((count, 3, len(pairs)))
    spin, volume, u = np.zeros((count, 3, 3, modes)), np.zeros(count), shapes.reshape(count, 3, modes)
    for some in _some(mesh, max(len(pairs), modes), tell):
        turn = some.turn(u)
        found = some.nodal(some.work(some.strains(u)), some.turned(turn))
        add_nodal(result, some.nodes, some.relaxed(0.5 * (found + found.swapaxes(3, 4))[..., *pairs.T])[0])
        # The integral of the rotation over an element goes to each of its nodes.
        mean = np.einsum("eqijm,eq->eijm", turn, some.volume)
        np.add.at(spin, some.nodes, np.broadcast_to(mean[:, None], (*some.nodes.shape, *mean.shape[1:])))
        np.add.at(volume, some.nodes, np.broadcast_to(some.volume.sum(axis=1)[:, None], some.nodes.shape))
    spin /= np.where(volume > 0.0, volume, 1.0)[:, None, None, None]
    applied = forces.reshape(count, 3, modes)
    # One by one: rotations of all pairs at once would take three times what the forces do.
    for a in np.unique(pairs[:, 0]):
        chosen = pairs[:, 0] == a
        both = spin[..., a] @ applied[..., b := pairs[chosen, 1]]
        result[..., chosen] -= 0.5 * (both + np.einsum("nijb,nj->nib", spin[..., b], applied[..., a]))
    return result.reshape(3 * count, -1)


def stressed_gradients(mesh: Mesh, fields: FloatArray, responses: FloatArray, pairs: IntArray) -> FloatArray:
    """Forces ∫ S_JK u_i,K N,_J dV of a motion u = Σ c_a u_a, by products of its amplitudes c.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    fields : (3n, m) float
        u_a, m.
    responses : (3n, p) float
        w_ab of each pair, the response to its strain of second order, m.
    pairs : (p, 2) int
        a ≤ b: each pair once.

    Returns
    -------
    (3n, m, m + p) float
        By a: first with S the linear stress of u_b, then with S = C (½ GᵀG + sym ∇w) of the pairs, that of two
        different motions twice; N.
    """
    count, m = len(mesh.points), fields.shape[1]
    u, w = fields.reshape(count, 3, -1), responses.reshape(count, 3, -1)
    result = np.zeros((count, 3, m, m + len(pairs)))
    for some in elastic_cells(mesh, 0, _NUMBERS // (m + len(pairs))):
        slopes = some.slopes(u)
        strain = some.products(slopes, pairs)
        # What responses and the elements' own shape functions leave; each of two different motions comes first once.
        strain += some.strains(w) + some.relaxation(some.work(strain))
        strain *= np.where(pairs[:, 0] == pairs[:, 1], 1.0, 2.0)
        forces = some.nodal(some.work(np.concatenate([some.strains(u), strain], axis=2)), slopes)
        add_nodal(result, some.nodes, some.relaxed(forces.reshape(*forces.shape[:3], -1))[0])
    return result.reshape(3 * count, m, -1)


def stress_stiffness(mesh: Mesh, field: FloatArray) -> sp.csr_array:
    """Geometric stiffness (3n, 3n), N/m, of the linear stress of a displacement (3n,), m; own shape functions rest."""
    count, u = len(mesh.points), field.reshape(len(mesh.points), 3, 1)
    parts = []
    for some in elastic_cells(mesh, CHUNK):
        inner = some.nodes.shape[1]
        matrices = some.geometric(some.work(some.strains(u))[..., 0])[:, :inner, :inner]
        parts.append(scatter(some.nodes, matrices, count))
    return sp.csr_array(sp.kron(summed(parts), sp.eye_array(3)))


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
                    place, found = face_stress(mesh, block.part(chosen[first : first + CHUNK]), u, mesh.materials[row])
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


@once
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
