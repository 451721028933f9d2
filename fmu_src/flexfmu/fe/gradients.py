"""Products of displacement gradients: geometric stiffness, strain of second order, stress that turns, spin.

And what stress does to the gradients of displacements, docs/theory.md sections 1, 4c and 7a.
"""

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse as sp

from ..files.basics import FloatArray, IntArray
from ..files.progress import tell_nobody
from ..mesh.model import Mesh
from .assembly import CHUNK, elastic_cells, scatter, summed
from .cells import Cells

# Numbers of a field of pairs that are held at a time: they stay in the processor's cache, which halves the time.
_NUMBERS = 400_000
# Rows at a time of which only the upper triangle is wanted.
_STRIP = 128


def _some(mesh: Mesh, pairs: int, tell: Callable[[float], None] = tell_nobody) -> Iterator[Cells]:
    """Elements, few at a time: of so many pairs or fields."""
    done = 0
    for some in elastic_cells(mesh, 0, _NUMBERS // pairs):
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
    pairs = np.stack(np.triu_indices(m), axis=1)
    found = np.zeros((u.shape[2], len(pairs)))
    # Larger pieces: what is summed up is as large as what it is summed from.
    for some in _some(mesh, max(len(pairs), u.shape[2]) // 4 + 1):
        strain, work = some.products(some.slopes(phi), pairs), some.work(some.strains(u))
        found += work.reshape(-1, u.shape[2]).T @ strain.reshape(-1, len(pairs))
    result = np.empty((u.shape[2], m, m))
    # The strain of second order is half of what stress takes.
    result[:, pairs[:, 0], pairs[:, 1]] = result[:, pairs[:, 1], pairs[:, 0]] = 2.0 * found
    return result


def quadratic_strain(
    mesh: Mesh, shapes: FloatArray, pairs: IntArray, tell: Callable[[float], None]
) -> tuple[FloatArray, FloatArray]:
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
    forces = np.zeros((len(mesh.points), 3, len(pairs)))
    energies = np.zeros((len(pairs), len(pairs)))
    for some in _some(mesh, len(pairs), tell):
        strain = some.products(some.slopes(phi), pairs)
        work = some.work(strain)
        nodal, relaxed = some.relaxed(some.nodal(work))
        np.add.at(forces, some.nodes, nodal)
        energies -= relaxed
        _add_products(strain.reshape(-1, len(pairs)), work.reshape(-1, len(pairs)), energies)
    energies = np.triu(energies) + np.triu(energies, 1).T
    return forces.reshape(-1, len(pairs)), energies


def _add_products(strain: FloatArray, work: FloatArray, energies: FloatArray) -> None:
    """Add their products to the upper triangle of a symmetric matrix, by strips."""
    for first in range(0, len(energies), _STRIP):
        energies[first : first + _STRIP, first:] += strain[:, first : first + _STRIP].T @ work[:, first:]


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
        gradient = some.displacement_gradient(shapes.reshape(len(mesh.points), 3, -1))
        # |ω|² is a quarter of the sum over all places of a gradient less its transpose, halved.
        spin = (gradient - gradient.swapaxes(2, 3)) * np.sqrt(some.volume)[:, :, None, None, None]
        rows = spin.reshape(-1, shapes.shape[1])
        total += 0.125 * rows.T @ rows
        volume += float(some.volume.sum())
    return total / volume


def own_spin(mesh: Mesh, shape: FloatArray) -> float:
    """Mean of |ω|² over where a motion (3n,) turns the material: ∫ |ω|⁴ dV / ∫ |ω|² dV, ω = ½ curl u."""
    square = fourth = 0.0
    for some in _some(mesh, 1):
        gradient = some.displacement_gradient(shape.reshape(len(mesh.points), 3, 1))
        spin = 0.125 * ((gradient - gradient.swapaxes(2, 3)) ** 2).sum(axis=(2, 3, 4))
        square += float((some.volume * spin).sum())
        fourth += float((some.volume * spin**2).sum())
    return fourth / square


def turned_stress(
    mesh: Mesh, shapes: FloatArray, forces: FloatArray, pairs: IntArray, tell: Callable[[float], None]
) -> FloatArray:
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
        gradient = some.displacement_gradient(u)
        turn = 0.5 * (gradient - gradient.swapaxes(2, 3))
        np.add.at(result, some.nodes, _turned(some, turn, some.work(some.strains(u)), pairs))
        # The integral of the rotation over an element goes to each of its nodes.
        mean = np.einsum("eqijm,eq->eijm", turn, some.volume)
        np.add.at(spin, some.nodes, np.broadcast_to(mean[:, None], (*some.nodes.shape, *mean.shape[1:])))
        np.add.at(volume, some.nodes, np.broadcast_to(some.volume.sum(axis=1)[:, None], some.nodes.shape))
    spin /= np.where(volume > 0.0, volume, 1.0)[:, None, None, None]
    applied = forces.reshape(count, 3, modes)
    # One by one: rotations of all pairs at once would take three times what the forces do.
    for pair, (a, b) in enumerate(pairs):
        both = np.einsum("nij,nj->ni", spin[..., a], applied[..., b])
        both += np.einsum("nij,nj->ni", spin[..., b], applied[..., a])
        result[..., pair] -= 0.5 * both
    return result.reshape(3 * count, -1)


def _turned(some: Cells, turn: FloatArray, work: FloatArray, pairs: IntArray) -> FloatArray:
    """Forces (e, a, 3, p) of what works on strains of fields (e, r, k), turned by turns (e, q, 3, 3, k)."""
    slopes = some.turned(turn)
    found = np.stack([some.operator(slopes[..., a]).swapaxes(1, 2) @ work for a in range(slopes.shape[3])], axis=2)
    both = 0.5 * (found + found.swapaxes(2, 3))[:, :, pairs[:, 0], pairs[:, 1]]
    return some.relaxed(both.reshape(len(both), -1, 3, len(pairs)))[0]


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
        work = some.work(np.concatenate([some.strains(u), strain], axis=2))
        for a in range(m):
            np.add.at(result[:, :, a], some.nodes, some.relaxed(some.nodal(work, slopes[..., a]))[0])
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
