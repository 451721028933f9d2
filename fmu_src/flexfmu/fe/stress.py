"""Stress of displacement fields at the integration points of chosen elements."""

from functools import cache

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..files.errors import ModelError
from ..mesh.elements import ElementType
from ..mesh.model import Mesh
from ..mesh.shapes import LINEAR
from .assembly import CHUNK
from .cells import cells


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
    for block, inside in mesh.by_block(elements):
        if block.type.shell:
            raise ModelError("stress of shells is not offered: leave the stress of these elements out of the body file")
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
            stress = point_stress(mesh, first + touching, fields)[1]
            stress = stress.reshape(touching.size, -1, 6 * fields.shape[1])
            at_corners = (outward @ stress).reshape(-1, 6, fields.shape[1])
            there = corners[touching].ravel()
            np.add.at(total, there[there >= 0], at_corners[there >= 0])
            np.add.at(met, there[there >= 0], 1.0)
    return total / np.maximum(met, 1.0)[:, None, None]


@cache
def _extrapolation(kind: ElementType) -> FloatArray:
    """Values at the corners (corners, points) between which linear functions fit those at the points best.

    Of several the least: one point gives a constant, one of the triangle at two heights what is linear along the wedge.
    """
    return np.linalg.pinv(LINEAR[kind.shape.polytope].value(kind.stiffness.points)).astype(np.float64)
