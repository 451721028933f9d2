"""Products of displacement gradients: geometric stiffness, strain of second order, stress that turns, spin."""

from collections.abc import Callable, Iterator

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..files.progress import tell_nobody
from ..mesh.model import Mesh
from .cells import Cells
from .elastic import elastic_cells

# Elements at a time: gradients of this many take some 100 MB with 20 modes.
_CHUNK = 4096
# Numbers of a field of pairs that are held at a time: they stay in the processor's cache, which halves the time.
_NUMBERS = 400_000


def _gradients(
    mesh: Mesh, fields: FloatArray, pairs: int = 0, tell: Callable[[float], None] = tell_nobody
) -> Iterator[tuple[Cells, FloatArray]]:
    """Elements, few at a time where there are pairs, with gradients (e, q, 3, 3, k) of displacements (3n, k)."""
    u = fields.reshape(len(mesh.points), 3, -1)
    done = 0
    for some in elastic_cells(mesh, 0, _NUMBERS // (9 * pairs)) if pairs else elastic_cells(mesh, _CHUNK):
        yield some, some.displacement_gradient(u)
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
    u, m = fields.reshape(len(mesh.points), 3, -1), shapes.shape[1]
    result = np.zeros((u.shape[2], m, m))
    for some, modes in _gradients(mesh, shapes):
        rows = modes.reshape(-1, m).T
        for k in range(u.shape[2]):
            strain = some.displacement_gradient(u[:, :, k : k + 1])[..., 0]
            stress = some.stress(0.5 * (strain + strain.swapaxes(2, 3))) * some.volume[:, :, None, None]
            # σ_JK on the derivative's index, for all directions and modes at once.
            result[k] += rows @ (stress[:, :, None] @ modes).reshape(-1, m)
    return 0.5 * (result + result.transpose(0, 2, 1))


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
    forces = np.zeros((len(mesh.points), 3, len(pairs)))
    energies = np.zeros((len(pairs), len(pairs)))
    for some, gradient in _gradients(mesh, shapes, len(pairs), tell):
        a, b = gradient[..., pairs[:, 0]], gradient[..., pairs[:, 1]]
        half = np.einsum("eqiJp,eqiKp->eqJKp", a, b, optimize=True)
        strain = 0.25 * (half + half.swapaxes(2, 3))
        stress = some.stress(strain)
        nodal, relaxed = some.relaxed(stress)
        np.add.at(forces, some.nodes, nodal)
        weighted = (stress * some.volume[:, :, None, None, None]).reshape(-1, len(pairs))
        energies += strain.reshape(-1, len(pairs)).T @ weighted - relaxed
    return forces.reshape(-1, len(pairs)), 0.5 * (energies + energies.T)


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
    for some, gradient in _gradients(mesh, shapes):
        # |ω|² is a quarter of the sum over all places of a gradient less its transpose, halved.
        spin = (gradient - gradient.swapaxes(2, 3)) * np.sqrt(some.volume)[:, :, None, None, None]
        rows = spin.reshape(-1, shapes.shape[1])
        total += 0.125 * rows.T @ rows
        volume += float(some.volume.sum())
    return total / volume


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
    spin, volume = np.zeros((count, 3, 3, modes)), np.zeros(count)
    for some, gradient in _gradients(mesh, shapes, max(len(pairs), modes), tell):
        _add_turned(some, gradient, pairs, result)
        # The integral of the rotation over an element goes to each of its nodes.
        turn = 0.5 * (gradient - gradient.swapaxes(2, 3))
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


def _add_turned(some: Cells, gradient: FloatArray, pairs: IntArray, forces: FloatArray) -> None:
    """Add the forces of the stress of some elements, turned."""
    other = gradient.swapaxes(2, 3)
    turn, stress = 0.5 * (gradient - other), some.stress(0.5 * (gradient + other))
    a, b = pairs.T
    turned = np.einsum("eqiKp,eqKJp->eqiJp", turn[..., a], stress[..., b], optimize=True)
    turned += np.einsum("eqiKp,eqKJp->eqiJp", turn[..., b], stress[..., a], optimize=True)
    np.add.at(forces, some.nodes, some.relaxed(0.5 * turned)[0])
