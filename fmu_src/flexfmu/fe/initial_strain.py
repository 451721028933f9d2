"""Nodal forces of the second-order strain that pairs of displacement fields hold (docs/theory.md, section 4a)."""

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from .cells import Cells, cells

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
        for _, some in cells(mesh, block, _CHUNK):
            _add(some, u, first, second, result)
    return result.reshape(first.size, -1).T


def _add(some: Cells, u: FloatArray, first: IntArray, second: IntArray, result: FloatArray) -> None:
    gradient = np.moveaxis(some.displacement_gradient(u), -1, 0)
    for pair, (a, b) in enumerate(zip(first, second, strict=True)):
        product = gradient[a].swapaxes(2, 3) @ gradient[b]
        stress = some.stress(0.5 * (product + product.swapaxes(2, 3)))
        np.add.at(result[pair], some.nodes, some.relaxed(stress[..., None])[0][..., 0])
