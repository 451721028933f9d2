"""Reduced geometric stiffness: how the linear stress of a displacement field stiffens or softens the modes."""

import felupe
import numpy as np

from ..mesh.model import ElementBlock, FloatArray, Mesh
from .elements import rule

# Elements at a time: mode gradients of this many take some 100 MB with 20 modes.
_CHUNK = 4096


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
    count = len(mesh.points)
    u, phi = fields.reshape(count, 3, -1), shapes.reshape(count, 3, -1)
    result = np.zeros((u.shape[2], phi.shape[2], phi.shape[2]))
    for block in mesh.blocks:
        for first in range(0, len(block.labels), _CHUNK):
            chosen = slice(first, first + _CHUNK)
            part = ElementBlock(block.type, block.labels[chosen], block.connectivity[chosen], block.material[chosen])
            result += _block(mesh, part, u, phi)
    return 0.5 * (result + result.transpose(0, 2, 1))


def _block(mesh: Mesh, block: ElementBlock, u: FloatArray, phi: FloatArray) -> FloatArray:
    choice = rule(block.type)
    cells = block.connectivity
    region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
    gradient = region.dhdX
    materials = [mesh.materials[index] for index in block.material]
    e = np.array([material.youngs_modulus for material in materials])
    nu = np.array([material.poissons_ratio for material in materials])
    lame, shear = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * e / (1.0 + nu)
    # (elements, points, direction, derivative, mode)
    modes = np.einsum("eaim,aJqe->eqiJm", phi[cells], gradient, optimize=True)
    m = modes.shape[-1]
    result = np.empty((u.shape[2], m, m))
    for k in range(u.shape[2]):
        strain = np.einsum("eai,aJqe->eqiJ", u[cells, :, k], gradient, optimize=True)
        strain = 0.5 * (strain + strain.swapaxes(2, 3))
        trace = np.trace(strain, axis1=2, axis2=3)
        stress = 2.0 * shear[:, None, None, None] * strain
        stress += (lame[:, None] * trace)[:, :, None, None] * np.eye(3)
        stress *= region.dV.T[:, :, None, None]
        # σ_JK on the derivative's index, for all directions and modes at once.
        stressed = stress[:, :, None] @ modes
        result[k] = modes.reshape(-1, m).T @ stressed.reshape(-1, m)
    return result
