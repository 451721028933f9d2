"""Stress of displacement fields at the integration points of chosen elements."""

from functools import cache
from typing import Any

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import ElementType, Mesh
from .assembly import CHUNK
from .cells import VOIGT, cells
from .elements import rule


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
        for _, some in cells(mesh, block.part(inside), CHUNK):
            gradient = some.displacement_gradient(u)
            found = some.stress(0.5 * (gradient + gradient.swapaxes(2, 3)))
            stresses.append(np.stack([found[:, :, i, j] for i, j in VOIGT], axis=2).reshape(-1, 6, u.shape[2]))
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
    first = 0
    for block in mesh.blocks:
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
        first += len(block.labels)
    return total / np.maximum(met, 1.0)[:, None, None]


@cache
def _extrapolation(kind: ElementType) -> FloatArray:
    """Values at an element's corners of what fits those at its integration points best, (corners, points)."""
    choice = rule(kind)
    bricks, wedges = kind.corner_count == 8, kind.corner_count == 6
    powers = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1) if bricks or i + j + (0 if wedges else k) < 2]
    element: Any = choice.element
    scheme: Any = choice.stiffness
    corners, points = np.asarray(element.points)[: kind.corner_count], scheme.points
    if len(points) < len(powers):
        # One integration point: constant stress; one of the triangle at two heights: linear along the wedge.
        powers = [(0, 0, k) for k in range(len(points))]

    def terms(places: FloatArray) -> FloatArray:
        found: FloatArray = np.stack([np.prod(places ** np.array(power), axis=1) for power in powers], axis=1)
        return found

    result: FloatArray = terms(corners) @ np.linalg.pinv(terms(points))
    return result
