"""Mass of sub-domains, on which acceleration and weight act, and of lumps, for the turned body (docs/theory.md, 9)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..files.basics import FloatArray, IntArray
from ..mesh.model import Mesh, PointMass
from ..model.inertia import LumpedMass
from ..model.reduced_body import GROUND, Masses, Properties
from ..model.rotations import skew
from .rigid_fit import attachment
from .subdomains import FrameOperators, Subdomain, carrying_frame, element_owner, volume_weighted


@dataclass(frozen=True, slots=True)
class Centre:
    """A centre of mass, and how it moves.

    Attributes
    ----------
    point : (3,) float
        m.
    nodes : (k,) int
    operator : (3 or 6, 3k) float
        From displacements of the nodes to its own, and to the rotation on which nodes that it hangs on carry it.
    """

    point: FloatArray
    nodes: IntArray
    operator: FloatArray

    @classmethod
    def mean(cls, points: FloatArray, share: FloatArray) -> "Centre":
        """Centre of points (n, 3) with shares (n,) that sum up to one."""
        nodes = np.flatnonzero(share)
        return cls(share @ points, nodes, (share[nodes, None, None] * np.eye(3)).transpose(1, 0, 2).reshape(3, -1))

    def moved(self, shapes: FloatArray) -> FloatArray:
        """Displacement (3, m) of mode shapes (3n, m)."""
        return self.operator[:3] @ shapes.reshape(-1, 3, shapes.shape[1])[self.nodes].reshape(-1, shapes.shape[1])


def hung_centre(points: FloatArray, one: PointMass) -> Centre:
    """Centre of a mass at a point."""
    return Centre(one.point, one.nodes, attachment(points, one))


def body_properties(mesh: Mesh) -> Properties:
    """Size, and volume and constants of each material.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.

    Returns
    -------
    Properties
        Materials of no element are left out.
    """
    volume = np.zeros(len(mesh.materials))
    for block, matrices in zip(mesh.blocks, mesh.volume_matrices, strict=True):
        np.add.at(volume, block.material, matrices.sum(axis=(1, 2)))
    used = np.flatnonzero(volume)
    made = [mesh.materials[index] for index in used]
    modulus, ratio, density = np.array([(m.youngs_modulus, m.poissons_ratio, m.density) for m in made]).T
    box = np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)])
    hung = np.array([one.mass for one in mesh.masses]) if mesh.masses else None
    return Properties(box, tuple(m.name for m in made), volume[used], modulus, ratio, density, hung)


def sub_masses(mesh: Mesh, shapes: FloatArray, subdomains: Sequence[Subdomain]) -> Masses:
    """Masses of the sub-domains, and of what lies in none of them, on the ground.

    Exact for a uniform acceleration: the mean displacement of a part is that of its centre of mass, in any frame.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    shapes : (3n, m) float
    subdomains : sequence of Subdomain

    Returns
    -------
    Masses
    """
    mass, frame, centres = mass_centres(mesh, subdomains)
    displacement = np.array([centre.moved(shapes) for centre in centres])
    return Masses(mass, np.array([centre.point for centre in centres]), displacement, frame)


def mass_centres(mesh: Mesh, subdomains: Sequence[Subdomain]) -> tuple[FloatArray, IntArray, list[Centre]]:
    """Masses (P,) of the sub-domains, of what lies in none, and at points; their frames (P,) and centres."""
    share = _shares(mesh, subdomains)
    mass = share.sum(axis=1)
    frame = np.append(np.arange(len(subdomains)), GROUND)
    kept = mass > 0.0
    centres = [Centre.mean(mesh.points, row) for row in share[kept] / mass[kept, None]]
    centres += [hung_centre(mesh.points, one) for one in mesh.masses]
    frames = [carrying_frame(subdomains, one.nodes) for one in mesh.masses]
    every = np.append(mass[kept], [one.mass for one in mesh.masses])
    return every, np.append(frame[kept], frames).astype(np.int64), centres


def _shares(mesh: Mesh, subdomains: Sequence[Subdomain]) -> FloatArray:
    """Mass (S + 1, n) that each node has in each sub-domain and, in the last row, in none, kg."""
    owner = element_owner(mesh, subdomains)
    density = np.array([material.density for material in mesh.materials])
    share = np.zeros((len(subdomains) + 1, len(mesh.points)))
    for block, matrices, rows in zip(mesh.blocks, mesh.volume_matrices, mesh.split(owner), strict=True):
        nodal = density[block.material][:, None] * matrices.sum(axis=1)
        # Row GROUND is the last.
        np.add.at(share, (np.broadcast_to(rows[:, None], nodal.shape), block.connectivity), nodal)
    return share


LUMPS = 16
"""Of a body; each frame has one at least."""


def element_lumps(mesh: Mesh, subdomains: Sequence[Subdomain]) -> list[tuple[int, IntArray]]:
    """Lumps as frames and elements: the one whose mass lies farthest from its centre is split until there are enough.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    subdomains : sequence of Subdomain

    Returns
    -------
    list of (int, (k,) int)
        By frame; what lies on no frame has none.
    """
    density = np.array([material.density for material in mesh.materials])
    pairs = zip(mesh.blocks, mesh.volume_matrices, strict=True)
    nodal = [density[block.material][:, None] * matrices.sum(axis=2) for block, matrices in pairs]
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


def _lump_of_elements(
    mesh: Mesh, masses: tuple[FloatArray, ...], nodal: FloatArray, elements: IntArray, turn: FloatArray
) -> tuple[float, Centre, FloatArray, FloatArray, FloatArray]:
    """Mass, centre, mean displacement (3, m), inertia about the centre and sweep (3, m) of a lump whose frame turns."""
    part = volume_weighted(mesh, masses, elements)
    weight = part.weight @ np.ones(part.nodes.size)
    share = np.zeros(len(mesh.points))
    share[part.nodes] = weight / weight.sum()
    moved = nodal[part.nodes]
    centre = Centre.mean(mesh.points, share)
    arm = mesh.points[part.nodes] - centre.point
    weighted = part.weight @ arm
    square = arm.T @ weighted
    inertia = np.trace(square) * np.eye(3) - square
    # ∫ρ r × e, where the frame's turn is taken off: the mean of either does not count.
    swept = np.einsum("nij,nja->ia", skew(weighted), moved, optimize=True)
    return float(weight.sum()), centre, np.tensordot(share[part.nodes], moved, axes=1), inertia, swept - inertia @ turn


def lumped_mass(
    mesh: Mesh,
    shapes: FloatArray,
    lumps: Sequence[tuple[int, IntArray]],
    frames: FrameOperators,
    carried: Sequence[int] = (),
) -> tuple[LumpedMass, list[Centre]]:
    """Mass of each lump with the consistent mass matrix, and masses at points, without curvature.

    Parameters
    ----------
    mesh : Mesh
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
    modes, turn = shapes.shape[1], frames.frame_rotation
    nodal, masses = shapes.reshape(len(mesh.points), 3, modes), mesh.mass_matrices
    found = [(frame, *_lump_of_elements(mesh, masses, nodal, elements, turn[frame])) for frame, elements in lumps]
    for frame, one in zip(carried, mesh.masses, strict=False):
        if frame == GROUND:
            continue
        motion = attachment(mesh.points, one) @ nodal[one.nodes].reshape(-1, modes)
        swept, centre = one.inertia @ (motion[3:] - turn[frame]), hung_centre(mesh.points, one)
        found.append((frame, one.mass, centre, motion[:3], one.inertia, swept))
    frame_of, mass, centres, displacement, inertia, swept_by = zip(*found, strict=True)
    turning, sweep = np.zeros((len(turn), 3, 3)), np.zeros((len(turn), 3, modes))
    for k, frame in enumerate(frame_of):
        turning[frame] += inertia[k]
        sweep[frame] += swept_by[k]
    arrays = np.array(mass), np.array([centre.point for centre in centres]), np.array(displacement)
    return LumpedMass(np.array(frame_of, dtype=np.int64), *arrays, turning, sweep), list(centres)
