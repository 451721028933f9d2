"""Strain of second order in the modes: its nodal forces, and its energy on the undeformed body."""

from collections.abc import Callable

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from .cells import Cells, cells

# Numbers of a strain field that are held at a time: few enough to stay in the processor's cache, which halves the time.
_NUMBERS = 400_000
# Elements at a time where there are no pairs.
_CHUNK = 4096


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
    done = 0
    for block in mesh.blocks:
        points = len(block.type.stiffness.weights)
        size = max(1, _NUMBERS // (9 * points * len(pairs)))
        for _, some in cells(mesh, block, size):
            energies += _add(some, phi, pairs, forces)
            done += len(some.nodes)
            tell(done)
    return forces.reshape(phi.shape[0] * 3, -1), 0.5 * (energies + energies.T)


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
    phi = shapes.reshape(len(mesh.points), 3, -1)
    total, volume = np.zeros((phi.shape[2], phi.shape[2])), 0.0
    for block in mesh.blocks:
        for _, some in cells(mesh, block, _CHUNK):
            gradient = some.displacement_gradient(phi)
            # |ω|² is a quarter of the sum over all places of a gradient less its transpose, halved.
            spin = (gradient - gradient.swapaxes(2, 3)) * np.sqrt(some.volume)[:, :, None, None, None]
            rows = spin.reshape(-1, phi.shape[2])
            total += 0.125 * rows.T @ rows
            volume += float(some.volume.sum())
    return total / volume


def _add(some: Cells, phi: FloatArray, pairs: IntArray, forces: FloatArray) -> FloatArray:
    """Add the forces of some elements; return their energies."""
    # (elements, points, direction, derivative, mode)
    gradient = some.displacement_gradient(phi)
    a, b = gradient[..., pairs[:, 0]], gradient[..., pairs[:, 1]]
    half = np.einsum("eqiJp,eqiKp->eqJKp", a, b, optimize=True)
    strain = 0.25 * (half + half.swapaxes(2, 3))
    stress = some.stress(strain)
    nodal, relaxed = some.relaxed(stress)
    np.add.at(forces, some.nodes, nodal)
    weighted = (stress * some.volume[:, :, None, None, None]).reshape(-1, len(pairs))
    result: FloatArray = strain.reshape(-1, len(pairs)).T @ weighted - relaxed
    return result
