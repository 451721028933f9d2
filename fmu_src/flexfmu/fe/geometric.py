"""Reduced geometric stiffness: how the linear stress of a displacement field stiffens or softens the modes."""

import numpy as np

from ..files.array_types import FloatArray
from ..mesh.model import Mesh
from .cells import Cells, cells

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
        for _, some in cells(mesh, block, _CHUNK):
            result += _part(some, u, phi)
    return 0.5 * (result + result.transpose(0, 2, 1))


def _part(some: Cells, u: FloatArray, phi: FloatArray) -> FloatArray:
    # (elements, points, direction, derivative, mode)
    modes = some.displacement_gradient(phi)
    m = modes.shape[-1]
    result = np.empty((u.shape[2], m, m))
    rows = modes.reshape(-1, m).T
    for k in range(u.shape[2]):
        strain = some.displacement_gradient(u[:, :, k : k + 1])[..., 0]
        stress = some.stress(0.5 * (strain + strain.swapaxes(2, 3))) * some.volume[:, :, None, None]
        # σ_JK on the derivative's index, for all directions and modes at once.
        result[k] = rows @ (stress[:, :, None] @ modes).reshape(-1, m)
    return result
