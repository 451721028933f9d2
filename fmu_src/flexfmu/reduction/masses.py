"""Mass and centre of mass of each sub-domain: what acceleration of the supports, or weight, acts on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh, PointMass
from ..model.reduced_body import GROUND, Masses, Properties
from .point_masses import attachment
from .subdomains import Subdomain, carrying_frame, element_owner


@dataclass(frozen=True, slots=True)
class Centre:
    """A centre of mass, and how it moves.

    Attributes
    ----------
    point : (3,) float
        m.
    nodes : (k,) int
    operator : (3, 3k) float
        From displacements of the nodes to its own.
    """

    point: FloatArray
    nodes: IntArray
    operator: FloatArray

    @classmethod
    def mean(cls, points: FloatArray, share: FloatArray) -> "Centre":
        """Centre of points (n, 3) with shares (n,) that sum up to one."""
        nodes = np.flatnonzero(share)
        operator = (share[nodes, None, None] * np.eye(3)).transpose(1, 0, 2).reshape(3, -1)
        return cls(share @ points, nodes, operator)

    def moved(self, shapes: FloatArray) -> FloatArray:
        """Displacement (3, m) of mode shapes (3n, m)."""
        local = shapes.reshape(-1, 3, shapes.shape[1])[self.nodes]
        return self.operator @ local.reshape(self.operator.shape[1], -1)


def hung_centre(points: FloatArray, one: PointMass) -> Centre:
    """Centre of a mass at a point."""
    return Centre(one.point, one.nodes, attachment(points, one)[:3])


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
    return (
        np.append(mass[kept], [one.mass for one in mesh.masses]),
        np.append(frame[kept], frames).astype(np.int64),
        centres,
    )


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
