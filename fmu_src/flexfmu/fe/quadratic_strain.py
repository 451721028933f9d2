"""Strain of second order in the modes: its nodal forces, and its energy on the undeformed body."""

from collections.abc import Callable

import felupe
import numpy as np

from ..mesh.model import ElementBlock, FloatArray, IntArray, Mesh
from .elements import rule

# Numbers of a strain field that are held at a time: some 200 MB with what is made of them.
_NUMBERS = 6_000_000
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
        points = len(rule(block.type).stiffness.weights)  # type: ignore[attr-defined]
        size = max(1, _NUMBERS // (9 * points * len(pairs)))
        for first in range(0, len(block.labels), size):
            part = slice(first, first + size)
            chosen = ElementBlock(block.type, block.labels[part], block.connectivity[part], block.material[part])
            energies += _add_block(mesh, chosen, phi, pairs, forces)
            done += len(chosen.labels)
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
        choice = rule(block.type)
        for first in range(0, len(block.labels), _CHUNK):
            cells = block.connectivity[first : first + _CHUNK]
            region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
            gradient = np.einsum("eaim,aJqe->eqiJm", phi[cells], region.dhdX, optimize=True)
            # |ω|² is a quarter of the sum over all places of a gradient less its transpose, halved.
            spin = (gradient - gradient.swapaxes(2, 3)) * np.sqrt(region.dV.T)[:, :, None, None, None]
            rows = spin.reshape(-1, phi.shape[2])
            total += 0.125 * rows.T @ rows
            volume += float(region.dV.sum())
    return total / volume


def _add_block(mesh: Mesh, block: ElementBlock, phi: FloatArray, pairs: IntArray, forces: FloatArray) -> FloatArray:
    """Add the forces of some elements; return their energies."""
    choice = rule(block.type)
    cells = block.connectivity
    region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
    materials = [mesh.materials[index] for index in block.material]
    e = np.array([material.youngs_modulus for material in materials])
    nu = np.array([material.poissons_ratio for material in materials])
    shear, bulk = 0.5 * e / (1.0 + nu), e / (3.0 * (1.0 - 2.0 * nu))
    # (elements, points, direction, derivative, mode)
    gradient = np.einsum("eaim,aJqe->eqiJm", phi[cells], region.dhdX, optimize=True)
    a, b = gradient[..., pairs[:, 0]], gradient[..., pairs[:, 1]]
    half = np.einsum("eqiJp,eqiKp->eqJKp", a, b, optimize=True)
    strain = 0.25 * (half + half.swapaxes(2, 3))
    mean = np.einsum("eqJJp->eqp", strain) / 3.0
    deviator = strain
    for axis in range(3):
        deviator[:, :, axis, axis] -= mean
    volume = region.dV.T[:, :, None, None, None]
    shear, bulk = shear[:, None, None, None, None], bulk[:, None, None, None, None]
    # Roots of the energy: their squares add up.
    shapes = (np.sqrt(2.0 * shear * volume) * deviator).reshape(-1, len(pairs))
    sizes = (np.sqrt(9.0 * bulk * volume)[:, :, 0, 0] * mean).reshape(-1, len(pairs))
    stress = 2.0 * shear * deviator
    for axis in range(3):
        stress[:, :, axis, axis] += 3.0 * bulk[:, :, 0, 0] * mean
    nodal = np.einsum("aJqe,eqiJp->eaip", region.dhdX, stress * volume, optimize=True)
    np.add.at(forces, cells, nodal)
    result: FloatArray = shapes.T @ shapes + sizes.T @ sizes
    return result
