"""Lumps of the body's mass: what the mass of the deformed body is made of (docs/theory.md, section 9)."""

from collections.abc import Sequence

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from ..model.inertia import LumpedMass
from ..model.reduced_body import GROUND
from ..model.rotations import skew
from .masses import Centre, hung_centre
from .point_masses import attachment
from .subdomains import FrameOperators, Subdomain, element_owner, volume_weighted

LUMPS = 16
"""Of a body; each frame has one at least."""


def element_lumps(
    mesh: Mesh, volumes: tuple[FloatArray, ...], subdomains: Sequence[Subdomain]
) -> list[tuple[int, IntArray]]:
    """Lumps as frames and elements: the one whose mass lies farthest from its centre is split until there are enough.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    volumes : tuple of (n_elements, node_count, node_count) float
        From `Mesh.volume_matrices`.
    subdomains : sequence of Subdomain

    Returns
    -------
    list of (int, (k,) int)
        By frame; what lies on no frame has none.
    """
    density = np.array([material.density for material in mesh.materials])
    nodal = [
        density[block.material][:, None] * matrices.sum(axis=2)
        for block, matrices in zip(mesh.blocks, volumes, strict=True)
    ]
    places = [mesh.points[block.connectivity] for block in mesh.blocks]
    mass = np.concatenate([part.sum(axis=1) for part in nodal])
    centre = np.concatenate([np.einsum("en,eni->ei", *both) for both in zip(nodal, places, strict=True)])
    centre /= mass[:, None]
    owner = element_owner(mesh, subdomains)
    lumps = [(int(s), np.flatnonzero(owner == s)) for s in np.unique(owner) if s != GROUND]

    def spread(elements: IntArray) -> tuple[float, FloatArray]:
        """Largest principal moment, and the elements' places along its axis."""
        arm = centre[elements] - np.average(centre[elements], axis=0, weights=mass[elements])
        values, axes = np.linalg.eigh(arm.T @ (mass[elements, None] * arm))
        return float(values[-1]) if elements.size > 1 else 0.0, arm @ axes[:, -1]

    spreads = [spread(elements) for _, elements in lumps]
    while lumps and len(lumps) < LUMPS:
        widest = int(np.argmax([size for size, _ in spreads]))
        size, along = spreads[widest]
        frame, elements = lumps[widest]
        # Elements beside the middle by round-off belong to one side.
        far = along > 1e-9 * np.abs(along).max(initial=0.0)
        if size <= 0.0 or far.all() or not far.any():
            break
        lumps[widest : widest + 1] = [(frame, elements[~far]), (frame, elements[far])]
        spreads[widest : widest + 1] = [spread(elements[~far]), spread(elements[far])]
    return lumps


def lumped_mass(
    mesh: Mesh,
    volumes: tuple[FloatArray, ...],
    shapes: FloatArray,
    lumps: Sequence[tuple[int, IntArray]],
    frames: FrameOperators,
    carried: Sequence[int] = (),
) -> tuple[LumpedMass, list[Centre]]:
    """Mass of each lump with the consistent mass matrix, and masses at points, without curvature.

    Parameters
    ----------
    mesh : Mesh
    volumes : tuple of (n_elements, node_count, node_count) float
    shapes : (3n, m) float
    lumps : sequence of (int, (k,) int)
        From `element_lumps`.
    frames : FrameOperators
        Of the same shapes.
    carried : sequence of int
        Frame of each of the mesh's masses at points, `GROUND` of those that are not to count.

    Returns
    -------
    inertia : LumpedMass
    centres : list of Centre
    """
    density = np.array([material.density for material in mesh.materials])
    masses = tuple(
        density[block.material][:, None, None] * matrices for block, matrices in zip(mesh.blocks, volumes, strict=True)
    )
    count, modes = len(frames.frame_rotation), shapes.shape[1]
    nodal = shapes.reshape(len(mesh.points), 3, modes)
    turning, sweep = np.zeros((count, 3, 3)), np.zeros((count, 3, modes))
    mass: list[float] = []
    centres: list[Centre] = []
    displacement: list[FloatArray] = []
    for frame, elements in lumps:
        part = volume_weighted(mesh, masses, elements)
        weight = part.weight @ np.ones(part.nodes.size)
        share = np.zeros(len(mesh.points))
        share[part.nodes] = weight / weight.sum()
        moved = nodal[part.nodes]
        mass.append(float(weight.sum()))
        centres.append(Centre.mean(mesh.points, share))
        displacement.append(np.tensordot(share[part.nodes], moved, axes=1))
        arm = mesh.points[part.nodes] - centres[-1].point
        weighted = part.weight @ arm
        square = arm.T @ weighted
        inertia = np.trace(square) * np.eye(3) - square
        # ∫ρ r × e, where the frame's turn is taken off: the mean of either does not count.
        swept = np.einsum("nij,nja->ia", skew(weighted), moved, optimize=True)
        turning[frame] += inertia
        sweep[frame] += swept - inertia @ frames.frame_rotation[frame]
    frame_of = [frame for frame, _ in lumps]
    for frame, one in zip(carried, mesh.masses, strict=False):
        if frame == GROUND:
            continue
        motion = attachment(mesh.points, one) @ nodal[one.nodes].reshape(-1, modes)
        frame_of.append(frame)
        mass.append(one.mass)
        centres.append(hung_centre(mesh.points, one))
        displacement.append(motion[:3])
        turning[frame] += one.inertia
        sweep[frame] += one.inertia @ (motion[3:] - frames.frame_rotation[frame])
    places = np.array([centre.point for centre in centres])
    arrays = np.array(mass), places, np.array(displacement)
    return LumpedMass(np.array(frame_of, dtype=np.int64), *arrays, turning, sweep), centres
