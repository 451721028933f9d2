"""Stress of displacement fields at the integration points of chosen elements."""

from functools import cache
from typing import Any

import felupe
import numpy as np

from ..mesh.model import ElementType, FloatArray, IntArray, Mesh
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
    bricks = kind in (ElementType.C3D8, ElementType.C3D20, ElementType.C3D20R)
    powers = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1) if bricks or i + j + k < 2]
    element: Any = choice.element
    scheme: Any = choice.stiffness
    corners, points = element.points[: 8 if bricks else 4], scheme.points
    if len(points) < len(powers):
        # One integration point: constant stress.
        powers = powers[:1]

    def terms(places: FloatArray) -> FloatArray:
        found: FloatArray = np.stack([np.prod(places ** np.array(power), axis=1) for power in powers], axis=1)
        return found

    result: FloatArray = terms(corners) @ np.linalg.pinv(terms(points))
    return result
