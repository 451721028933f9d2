"""Stress of displacement fields at the integration points of chosen elements."""

import felupe
import numpy as np

from ..mesh.model import FloatArray, IntArray, Mesh
from .elements import rule

# Order of the components.
COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")


def point_stress(mesh: Mesh, elements: IntArray, fields: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Linear elastic stress at the stiffness integration points, where the elements know it best.

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
    first = 0
    for block in mesh.blocks:
        inside = elements[(elements >= first) & (elements < first + len(block.labels))] - first
        first += len(block.labels)
        if not inside.size:
            continue
        choice = rule(block.type)
        cells = block.connectivity[inside]
        region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
        materials = [mesh.materials[index] for index in block.material[inside]]
        e = np.array([material.youngs_modulus for material in materials])
        nu = np.array([material.poissons_ratio for material in materials])
        lame, shear = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * e / (1.0 + nu)
        gradient = np.einsum("eaik,aJqe->eqiJk", u[cells], region.dhdX, optimize=True)
        trace = gradient[:, :, 0, 0] + gradient[:, :, 1, 1] + gradient[:, :, 2, 2]
        stress = np.empty((*gradient.shape[:2], 6, gradient.shape[4]))
        for c, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))):
            stress[:, :, c] = shear[:, None, None] * (gradient[:, :, i, j] + gradient[:, :, j, i])
        stress[:, :, :3] += (lame[:, None, None] * trace)[:, :, None]
        stresses.append(stress.reshape(-1, 6, u.shape[2]))
        places.append(np.einsum("aq,eai->eqi", region.element_h, mesh.points[cells]).reshape(-1, 3))
    return np.concatenate(places), np.concatenate(stresses)
