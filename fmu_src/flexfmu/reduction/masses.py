"""Mass and centre of mass of each sub-domain: what acceleration of the supports, or weight, acts on."""

from collections.abc import Sequence

import numpy as np

from ..mesh.model import FloatArray, Mesh
from ..model.reduced_body import GROUND, Masses, Properties
from .subdomains import Subdomain, element_owner


def body_properties(mesh: Mesh, volumes: tuple[FloatArray, ...]) -> Properties:
    """Size, and volume and constants of each material.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    volumes : tuple of (n_elements, node_count, node_count) float
        From `fe.assembly.volume_matrices`.

    Returns
    -------
    Properties
        Materials of no element are left out.
    """
    volume = np.zeros(len(mesh.materials))
    for block, matrices in zip(mesh.blocks, volumes, strict=True):
        np.add.at(volume, block.material, matrices.sum(axis=(1, 2)))
    used = np.flatnonzero(volume)
    made = [mesh.materials[index] for index in used]
    constants = np.array([(m.youngs_modulus, m.poissons_ratio, m.density) for m in made]).T
    box = np.array([mesh.points.min(axis=0), mesh.points.max(axis=0)])
    return Properties(box, tuple(m.name for m in made), volume[used], *constants)


def sub_masses(
    mesh: Mesh, volumes: tuple[FloatArray, ...], shapes: FloatArray, subdomains: Sequence[Subdomain]
) -> Masses:
    """Masses of the sub-domains, and of what lies in none of them, on the ground.

    Exact for a uniform acceleration: the mean displacement of a part is that of its centre of mass, in any frame.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    volumes : tuple of (n_elements, node_count, node_count) float
        From `fe.assembly.volume_matrices`.
    shapes : (3n, m) float
    subdomains : sequence of Subdomain

    Returns
    -------
    Masses
    """
    share = _shares(mesh, volumes, subdomains)
    mass = share.sum(axis=1)
    frame = np.append(np.arange(len(subdomains)), GROUND)
    kept = mass > 0.0
    mean = share[kept] / mass[kept, None]
    displacement = np.tensordot(mean, shapes.reshape(len(mesh.points), 3, -1), axes=1)
    return Masses(mass[kept], mean @ mesh.points, displacement, frame[kept])


def mass_shares(mesh: Mesh, volumes: tuple[FloatArray, ...], subdomains: Sequence[Subdomain]) -> FloatArray:
    """Share (P, n) of each node in the centre of each of these masses: rows that sum up to one."""
    share = _shares(mesh, volumes, subdomains)
    mass = share.sum(axis=1, keepdims=True)
    kept = mass[:, 0] > 0.0
    result: FloatArray = share[kept] / mass[kept]
    return result


def _shares(mesh: Mesh, volumes: tuple[FloatArray, ...], subdomains: Sequence[Subdomain]) -> FloatArray:
    """Mass (S + 1, n) that each node has in each sub-domain and, in the last row, in none, kg."""
    owner = element_owner(mesh, subdomains)
    density = np.array([material.density for material in mesh.materials])
    share = np.zeros((len(subdomains) + 1, len(mesh.points)))
    first = 0
    for block, matrices in zip(mesh.blocks, volumes, strict=True):
        nodal = density[block.material][:, None] * matrices.sum(axis=1)
        rows = owner[first : first + len(block.labels)][:, None]
        # Row GROUND is the last.
        np.add.at(share, (np.broadcast_to(rows, nodal.shape), block.connectivity), nodal)
        first += len(block.labels)
    return share
