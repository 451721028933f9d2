"""Nodal forces of the second-order strain that pairs of displacement fields hold (docs/theory.md, section 4a)."""

import felupe
import numpy as np

from ..mesh.model import ElementBlock, FloatArray, IntArray, Mesh
from .elements import rule

# Elements at a time, as of the geometric stiffness.
_CHUNK = 4096


def strain_forces(mesh: Mesh, fields: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
    """Forces with which the strain sym(GₐᵀG_b) of pairs of fields pulls at the nodes, G being a field's gradient.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    fields : (3n, k) float
        Displacements, m per unit of whatever they belong to.
    first, second : (p,) int
        Columns of `fields` that make up each pair.

    Returns
    -------
    (3n, p) float
        ∫ Bᵀ C sym(GₐᵀG_b) dV, N per those units.
    """
    u = fields.reshape(len(mesh.points), 3, -1)
    result = np.zeros((first.size, len(mesh.points), 3))
    for block in mesh.blocks:
        for begin in range(0, len(block.labels), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            part = ElementBlock(block.type, block.labels[rows], block.connectivity[rows], block.material[rows])
            _add_block(mesh, part, u, first, second, result)
    return result.reshape(first.size, -1).T


def _add_block(
    mesh: Mesh, block: ElementBlock, u: FloatArray, first: IntArray, second: IntArray, result: FloatArray
) -> None:
    choice, cells = rule(block.type), block.connectivity
    region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
    materials = [mesh.materials[index] for index in block.material]
    e = np.array([material.youngs_modulus for material in materials])[:, None]
    nu = np.array([material.poissons_ratio for material in materials])[:, None]
    lame, shear = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * e / (1.0 + nu)
    weight = region.dV.T
    # (field, element, point, direction, derivative) and (element, node, point, derivative).
    gradient = np.einsum("eaim,aJqe->meqiJ", u[cells], region.dhdX, optimize=True)
    shape = np.ascontiguousarray(np.moveaxis(region.dhdX, (0, 1, 2, 3), (1, 3, 2, 0)))
    flat = shape.reshape(*shape.shape[:2], -1)
    for pair, (a, b) in enumerate(zip(first, second, strict=True)):
        product = gradient[a].swapaxes(2, 3) @ gradient[b]
        stress = (shear * weight)[:, :, None, None] * (product + product.swapaxes(2, 3))
        stress += (lame * weight * np.trace(product, axis1=2, axis2=3))[:, :, None, None] * np.eye(3)
        forces = flat @ stress.transpose(0, 1, 3, 2).reshape(len(cells), -1, 3)
        np.add.at(result[pair], cells, forces)
