"""Nodal forces of stress that turns with its material, docs/theory.md section 4c."""

from collections.abc import Callable

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from .cells import Cells, cells

# Numbers of a stress field that are held at a time: as of the quadratic strain.
_NUMBERS = 400_000


def turned_stress(
    mesh: Mesh, shapes: FloatArray, forces: FloatArray, pairs: IntArray, tell: Callable[[float], None]
) -> FloatArray:
    """Nodal forces by which stress of one mode flattens what another one curves.

    The stress σ_b, turned by ω_a = ½ curl φ_a, is in equilibrium with the nodal forces of mode b turned likewise, but
    for what the rotation's change along the body makes of it: (∂ω_a/∂X_J) × σ_b e_J.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    shapes : (3n, m) float
    forces : (3n, m) float
        Nodal forces K φ_b.
    pairs : (p, 2) int
        a and b of each.
    tell : callable
        Takes how many elements are done.

    Returns
    -------
    (3n, p) float
        The mean of both orders of a pair.
    """
    count, modes = len(mesh.points), shapes.shape[1]
    phi = shapes.reshape(count, 3, modes)
    result = np.zeros((count, 3, len(pairs)))
    spin, volume = np.zeros((count, 3, 3, modes)), np.zeros(count)
    done = 0
    for block in mesh.blocks:
        points = len(block.type.stiffness.weights)
        size = max(1, _NUMBERS // (9 * points * max(len(pairs), modes)))
        for _, some in cells(mesh, block, size):
            _add(some, phi, pairs, result, spin, volume)
            done += len(some.nodes)
            tell(done)
    spin /= np.where(volume > 0.0, volume, 1.0)[:, None, None, None]
    applied = forces.reshape(count, 3, modes)
    # One by one: rotations of all pairs at once would take three times what the forces do.
    for pair, (a, b) in enumerate(pairs):
        both = np.einsum("nij,nj->ni", spin[..., a], applied[..., b])
        both += np.einsum("nij,nj->ni", spin[..., b], applied[..., a])
        result[..., pair] -= 0.5 * both
    return result.reshape(3 * count, -1)


def _add(
    some: Cells, phi: FloatArray, pairs: IntArray, forces: FloatArray, spin: FloatArray, volume: FloatArray
) -> None:
    """Add the forces of some elements, and the integral of the rotation over them to each of their nodes."""
    gradient = some.displacement_gradient(phi)
    other = gradient.swapaxes(2, 3)
    turn, stress = 0.5 * (gradient - other), some.stress(0.5 * (gradient + other))
    a, b = pairs.T
    turned = np.einsum("eqiKp,eqKJp->eqiJp", turn[..., a], stress[..., b], optimize=True)
    turned += np.einsum("eqiKp,eqKJp->eqiJp", turn[..., b], stress[..., a], optimize=True)
    np.add.at(forces, some.nodes, some.relaxed(0.5 * turned)[0])
    mean = np.einsum("eqijm,eq->eijm", turn, some.volume)
    np.add.at(spin, some.nodes, np.broadcast_to(mean[:, None], (*some.nodes.shape, *mean.shape[1:])))
    np.add.at(volume, some.nodes, np.broadcast_to(some.volume.sum(axis=1)[:, None], some.nodes.shape))
