"""What of a body is rigid: couplings of its mesh file, interfaces of the body file, equations that amount to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..files.basics import FloatArray, IntArray
from ..mesh.equations import RigidLink, Row, Simplices, effects, followers, matrix_of, recognised, simplex
from ..mesh.model import Mesh
from .options import BodyOptions, node_set

# Stiffness of a simplex over that of the layer of elements around its link: less than a thousandth of their compliance
# is added, and round-off grows with it.
_STIFFER = 200.0


def with_rigid_nodes(mesh: Mesh, config: BodyOptions) -> Mesh:
    """Make rigid what the mesh file says is rigid, unless the body file says otherwise, and what that adds."""
    found, rest = recognised(mesh.points, mesh.equations)
    links = [*mesh.links, *found]
    words = "make a rigid body: it is rigid in large turns, too"
    mesh = replace(mesh, equations=rest, notes=(*mesh.notes, *(f"{one.name} {words}" for one in found)))
    for interface in config.interfaces:
        nodes = node_set(mesh, interface.nodes, f"interface {interface.name!r}, nodes")
        apart = [one for one in links if not np.isin(nodes, one.nodes).all()]
        if interface.rigid is False:
            links = apart
        elif interface.rigid and len(apart) == len(links):
            links.append(RigidLink(f"interface {interface.name}", nodes))
    return _with_links(mesh, links)


def _with_links(mesh: Mesh, links: Sequence[RigidLink]) -> Mesh:
    """Make nodes of a mesh rigid.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    links : sequence of RigidLink

    Returns
    -------
    Mesh
        With equations and simplices; masses that hang on a link hang on its masters, which move likewise.
    """
    rows: list[Row] = []
    found: dict[int, list[tuple[IntArray, FloatArray, float]]] = {}
    masses = list(mesh.masses)
    for link, size in zip(links, _surroundings(mesh, links), strict=True):
        masters, gradient = simplex(mesh.points, link.nodes)
        if masters.size < 2:
            continue
        found.setdefault(masters.size, []).append((masters, gradient, _STIFFER * size))
        rows += followers(mesh.points, np.setdiff1d(link.nodes, masters), masters, gradient)
        for place, one in enumerate(masses):
            if one.nodes.size > masters.size and np.isin(one.nodes, link.nodes).all():
                masses[place] = replace(one, nodes=np.sort(masters))
    equations = sp.csr_array(sp.vstack([mesh.equations, matrix_of(rows, 3 * len(mesh.points))]))
    by_count = [zip(*found[count], strict=True) for count in sorted(found)]
    simplices = tuple(Simplices(*map(np.array, columns)) for columns in by_count)
    return replace(mesh, equations=equations, simplices=simplices, masses=tuple(masses), links=tuple(links))


def stretch_free(mesh: Mesh) -> list[str]:
    """Say how many equations let their nodes turn and not stretch, which is false in large turns."""
    count = int(effects(mesh.points, mesh.equations)[1].sum())
    found = f"{count} equations of the mesh file keep distances by linear terms, which is wrong in large turns"
    words = f"{found}, by 16 to 54 % at bores: say *RIGID BODY or *KINEMATIC instead, or rigid = true of an interface"
    return [words] if count else []


def _surroundings(mesh: Mesh, links: Sequence[RigidLink]) -> FloatArray:
    """Energies (l,), J, of the order of what it takes to stretch each link's surroundings by one.

    E V R / h: modulus and volume of the elements at the link, as its nodes share them, its radius, and their size.
    """
    moduli = np.array([material.youngs_modulus for material in mesh.materials])
    modulus, volume, size = (np.zeros(len(mesh.points)) for _ in range(3))
    for block, first in zip(mesh.blocks, mesh.starts, strict=False):
        nodes, own = block.connectivity, mesh.volumes[first : first + len(block.labels), None]
        np.maximum.at(modulus, nodes, np.broadcast_to(moduli[block.material][:, None], nodes.shape))
        length = np.cbrt(own) if block.section is None else own / block.section[:, :1]
        np.maximum.at(size, nodes, np.broadcast_to(length, nodes.shape))
        np.add.at(volume, nodes, np.broadcast_to(own / nodes.shape[1], nodes.shape))
    found = np.zeros(len(links))
    for number, link in enumerate(links):
        radius = 0.5 * np.linalg.norm(np.ptp(mesh.points[link.nodes], axis=0))
        found[number] = modulus[link.nodes].max() * volume[link.nodes].sum() * radius / size[link.nodes].mean()
    return found
