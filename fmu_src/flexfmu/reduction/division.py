"""Automatic division of a body into a tree of sub-domains (docs/theory.md, section 5).

The distance along the body from its supports is cut into n equal levels; the connected pieces of a level are the
sub-domains, so that a branch of the body becomes a branch of the tree. A piece's parent is the neighbour nearer to the
support with which it shares most; its joint is their common section. Where pieces close a loop, one connection is cut.
Instead of equal levels the distances may be given, of each branch by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, dijkstra

from ..files.basics import BodyFileError, FloatArray, IntArray, MeshError
from ..mesh.checks import nodes_of_elements
from ..mesh.elements import FaceBlock
from ..mesh.equations import coupled_nodes
from ..mesh.model import Mesh, once
from ..model.reduced_body import GROUND
from ..model.summary import point
from .subdomains import Subdomain, first_of, mean_rotation, section, volume_weighted

# A piece that reaches along the body for less than this share of a level is a sliver: it would bend too little to
# be worth a frame.
_SLIVER = 0.34
# So is an end whose volume is less than its section times this share of a level: an odd element or two that a level's
# ragged boundary cuts off. The tip of a cone has a third.
_FRAGMENT = 0.1
# Distances, areas and places that differ by less than this share are the same: round-off must not decide.
_DIGITS = 9
# Corners of bricks; of sheets with four those of both faces.
_BRICK = 8
# Least distance between nodes that an equation joins, over the body's size: a graph's edge of none is no edge. And what
# an edge or a corner holds where no face does, over a face.
_TOUCHING, _EDGE = 1e-12, 1e-6


@dataclass(frozen=True, slots=True)
class Division:
    """Result of dividing a body.

    Attributes
    ----------
    subdomains : tuple of Subdomain
    cuts : tuple of str
        Where a closed loop was cut, in words.
    """

    subdomains: tuple[Subdomain, ...]
    cuts: tuple[str, ...]


@once
def distance_along(mesh: Mesh, sources: IntArray) -> FloatArray:
    """Shortest way from the sources to each node, from node to node within elements.

    Parameters
    ----------
    mesh : Mesh
    sources : (k,) int

    Returns
    -------
    (n,) float
        m; infinite for nodes that no way leads to.
    """
    size = len(mesh.points)
    graph = sp.csr_array((size, size))
    for block in mesh.blocks:
        ends = np.column_stack(np.triu_indices(block.connectivity.shape[1], 1))
        pairs = np.unique(np.sort(block.connectivity[:, ends].reshape(-1, 2), axis=1), axis=0)
        length = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
        graph = graph.maximum(sp.csr_array(sp.coo_array((length, pairs.T), shape=(size, size))))
    # Over a gap it is as far as the gap is wide.
    joined = coupled_nodes(mesh.equations).tocoo()
    gap = np.linalg.norm(mesh.points[joined.row] - mesh.points[joined.col], axis=1)
    gap = np.maximum(gap, _TOUCHING * np.ptp(mesh.points))
    graph = graph.maximum(sp.csr_array(sp.coo_array((gap, (joined.row, joined.col)), graph.shape)))
    distance = dijkstra(graph, directed=False, indices=sources, min_only=True)
    return distance if distance.any() else np.ones(size)


@once
def divide(mesh: Mesh, supported: IntArray, levels: int) -> Division:
    """Divide a body into sub-domains by levels of the distance from its supports.

    Parameters
    ----------
    mesh : Mesh
    supported : (k,) int
        Nodes from which the distance counts.
    levels : int
        n ≥ 1.

    Returns
    -------
    Division

    Raises
    ------
    BodyFileError
        No support to count from.
    MeshError
        Parts of the mesh that do not hang together.
    """
    distance = _supported_distance(mesh, supported)
    middle = mesh.element_means(distance)
    # Thinner than a row of triangles or tetrahedra, a level would be those that point one way, each a piece.
    pointed = [block.connectivity for block in mesh.blocks if block.type.corner_count < _BRICK]
    rows = np.concatenate([np.zeros(1), *(np.ptp(distance[nodes], axis=1) for nodes in pointed)])
    way = float(distance.max())
    levels = max(round(way / max(float(np.median(rows)), way / levels)), 1)
    depth = way / levels
    level = np.minimum(np.floor(np.round(middle / depth, _DIGITS)).astype(np.int64), levels - 1)
    return _divided(mesh, supported, level, linked(mesh), distance, depth)


def divide_branches(
    mesh: Mesh, supported: IntArray, branches: Sequence[tuple[str, IntArray, tuple[float, ...]]]
) -> Division:
    """Divide a body at given distances from its supports, of each branch by itself.

    A joint separates what lies beyond it and hangs together with the branch's end from all the rest.

    Parameters
    ----------
    mesh : Mesh
    supported : (k,) int
        Nodes from which the distance counts.
    branches : sequence of (str, (k,) int, tuple of float)
        Name of a way from the supports, for messages, nodes where it ends, and distances of joints (m), ascending.

    Returns
    -------
    Division

    Raises
    ------
    BodyFileError
        No support to count from, or a joint beyond the end of its branch.
    MeshError
        Parts of the mesh that do not hang together.
    """
    distance = _supported_distance(mesh, supported)
    middle = mesh.element_means(distance)
    link = linked(mesh)
    size = float(distance.max())
    place = np.round(middle / size, _DIGITS)
    beyond = []
    for name, nodes, joints in branches:
        touching = np.concatenate([np.isin(b.connectivity, nodes).any(axis=1) for b in mesh.blocks])
        end = int(np.argmax(np.where(touching, middle, -np.inf)))
        for joint in joints:
            outer = (place >= round(joint / size, _DIGITS)).astype(np.int64)
            if not outer[end]:
                raise BodyFileError(
                    f"[[branch]] toward {name!r}: a joint at {joint:g} m from the supports, where the branch "
                    f"ends at {middle[end]:.4g} m; the distance counts from node to node along the body"
                )
            _, label = connected_components(link.multiply(equal_labels(link, outer)), directed=False)
            beyond.append(label == label[end])
    # Elements beyond the same joints are a piece if they hang together.
    flags = np.array(beyond, dtype=np.int64).reshape(len(beyond), -1)
    level = np.unique(flags, axis=1, return_inverse=True)[1].ravel().astype(np.int64)
    steps = [b - a for _, _, joints in branches for a, b in pairwise((0.0, *joints))]
    return _divided(mesh, supported, level, link, distance, min(steps, default=size))


def _supported_distance(mesh: Mesh, supported: IntArray) -> FloatArray:
    """Distance along the body from its supports (n,), of a body that has some and hangs together."""
    if not supported.size:
        raise BodyFileError("the division counts from the supports, and the body has none that holds a node")
    distance = distance_along(mesh, supported)
    if not np.all(np.isfinite(distance)):
        raise MeshError(f"{int(np.sum(~np.isfinite(distance)))} nodes are not connected to any support: several parts")
    return distance


def _divided(
    mesh: Mesh, supported: IntArray, level: IntArray, link: sp.csr_array, distance: FloatArray, depth: float
) -> Division:
    """Sub-domains of the connected pieces of each level (e,), slivers against a depth (m) joined."""
    _, piece = connected_components(link.multiply(equal_labels(link, level)), directed=False)
    away = [distance[block.connectivity] for block in mesh.blocks]
    reach = np.concatenate([np.stack([one.min(axis=1), one.max(axis=1)], axis=1) for one in away])
    piece = _merge_thin(piece.astype(np.int64), link, reach, mesh.volumes, depth)
    return _tree(mesh, supported, piece, mesh.element_means(distance), link)


def neighbours(points: FloatArray, faces: tuple[FaceBlock, ...], elements: int) -> sp.csr_array:
    """Elements with a face in common, (e, e) with the area between its corners."""
    rows, columns, areas = ([np.zeros(0, dtype=kind)] for kind in (np.int64, np.int64, float))
    for block in faces:
        inner = block.beyond >= 0
        rows.append(block.element[inner])
        columns.append(block.beyond[inner])
        areas.append(np.linalg.norm(corner_areas(points[block.nodes[inner, : block.corner_count]]), axis=1))
    r, c, area = np.concatenate(rows), np.concatenate(columns), np.concatenate(areas)
    return sp.csr_array(sp.coo_array((np.r_[area, area], (np.r_[r, c], np.r_[c, r])), shape=(elements, elements)))


def corner_areas(at: FloatArray) -> FloatArray:
    """Areas (f, 3) between corners (f, 3 or 4, 3): of a triangle by two edges, of a quadrilateral by its diagonals."""
    return 0.5 * np.cross(at[:, 2] - at[:, 0], at[:, -1] - at[:, 1] if at.shape[1] == 4 else at[:, 1] - at[:, 0])


@once
def linked(mesh: Mesh) -> sp.csr_array:
    """Elements that share a face, or whose outer faces equations join, (e, e) with the area in common."""
    link = neighbours(mesh.points, mesh.faces, mesh.element_count)
    count, part = connected_components(link, directed=False)
    if count > 1:
        # Faces that are halves of others, of tetrahedra on bricks, have three corners in common; edges hold little.
        corners = np.unique(np.concatenate([b.connectivity[:, : b.type.corner_count].ravel() for b in mesh.blocks]))
        met = sp.coo_array((uses := nodes_of_elements(mesh)[:, corners]) @ uses.T)
        area = np.minimum(mesh.volumes[met.row], mesh.volumes[met.col]) ** (2.0 / 3.0)
        area *= (part[met.row] != part[met.col]) * np.where(met.data < 3.0, _EDGE, 1.0)
        link = sp.csr_array(link.maximum(sp.csr_array(sp.coo_array((area, (met.row, met.col)), link.shape))))
    if not mesh.equations.shape[0]:
        return link
    joined = coupled_nodes(mesh.equations)
    inside = np.diff(joined.indptr) > 0
    shape = (mesh.element_count, len(mesh.points))
    parts = [sp.csr_array(shape)]
    for block in mesh.faces:
        nodes, element = block.nodes[block.outer], block.element[block.outer]
        area = np.linalg.norm(corner_areas(mesh.points[nodes[:, : block.corner_count]]), axis=1)
        share = inside[nodes] * area[:, None] / nodes.shape[1]
        owner = np.broadcast_to(element[:, None], nodes.shape)
        parts.append(sp.csr_array(sp.coo_array((share.ravel(), (owner.ravel(), nodes.ravel())), shape=shape)))
    share = sum(parts[1:], parts[0])
    share.eliminate_zeros()
    # Each node's share of a face goes to the elements of the nodes that it is joined to, in equal parts.
    reached = sp.csr_array(joined @ sp.csr_array((np.ones(share.nnz), share.indices, share.indptr), shape=shape).T)
    reached.data[:] = 1.0
    count = np.maximum(np.asarray(reached.sum(axis=1)).ravel(), 1.0)
    across = sp.csr_array(share @ (sp.diags_array(1.0 / count) @ reached))
    across.setdiag(0.0)
    return sp.csr_array(link + 0.5 * (across + across.T))


def equal_labels(link: sp.csr_array, label: IntArray) -> sp.csr_array:
    """Ones (e, e) where linked elements have the same label (e,)."""
    pairs = link.tocoo()
    keep = label[pairs.row] == label[pairs.col]
    return sp.csr_array(sp.coo_array((np.ones(int(keep.sum())), (pairs.row[keep], pairs.col[keep])), shape=link.shape))


def _merge_thin(piece: IntArray, link: sp.csr_array, reach: FloatArray, volume: FloatArray, depth: float) -> IntArray:
    """Join each piece that is a sliver to the neighbour with which it shares the largest section, the shortest first.

    `reach` (e, 2) is the smallest and largest distance of each element's nodes, `volume` (e,) is in m³.
    """
    while True:
        count = int(piece.max()) + 1
        near, far = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(near, piece, reach[:, 0])
        np.maximum.at(far, piece, reach[:, 1])
        shared = _shared(piece, link, count)
        largest = shared.max(axis=1)
        # Slivers are below one; a piece without neighbours stays.
        extent = np.where(largest > 0.0, (far - near) / (_SLIVER * depth), np.inf)
        end = np.count_nonzero(shared, axis=1) == 1
        thickness = np.bincount(piece, volume, count)[end] / largest[end]
        extent[end] = np.minimum(extent[end], thickness / (_FRAGMENT * depth))
        place = np.round(near / depth, _DIGITS)
        first = int(np.lexsort((place, np.round(extent, _DIGITS)))[0])
        if extent[first] >= 1.0:
            return piece
        host = int(np.lexsort((place, -np.round(shared[first] / largest[first], _DIGITS)))[0])
        piece = np.unique(np.where(piece == first, host, piece), return_inverse=True)[1].astype(np.int64)


def _shared(piece: IntArray, link: sp.csr_array, count: int) -> FloatArray:
    """Area (count, count) of the sections that pieces share, zero on the diagonal."""
    pairs = link.tocoo()
    table = np.zeros((count, count))
    np.add.at(table, (piece[pairs.row], piece[pairs.col]), pairs.data)
    np.fill_diagonal(table, 0.0)
    return table


def _tree(mesh: Mesh, supported: IntArray, piece: IntArray, middle: FloatArray, link: sp.csr_array) -> Division:
    """Hang the pieces on each other, nearest to the support first."""
    count = int(piece.max()) + 1
    bodies = [volume_weighted(mesh, mesh.volume_matrices, np.flatnonzero(piece == p)) for p in range(count)]
    near = np.full(count, np.inf)
    np.minimum.at(near, piece, middle)
    roots = [p for p in range(count) if np.intersect1d(bodies[p].nodes, supported).size]
    shared = _shared(piece, link, count)
    area = np.round(shared / max(float(shared.max()), 1e-300), _DIGITS)
    # Nearest to the support first; of those at the same distance by place, not by the numbering of the mesh.
    size = float(np.abs(mesh.points).max())
    place = np.round(np.array([body.centre(mesh.points) for body in bodies]) / size, _DIGITS)
    rank = [(x, *xyz) for x, xyz in zip(np.round(near / middle.max(), _DIGITS), place.tolist(), strict=True)]

    parent: dict[int, int] = dict.fromkeys(roots, GROUND)
    order = sorted(roots, key=lambda p: rank[p])
    waiting = set(range(count)) - set(roots)
    while waiting:
        # The waiting piece nearest to the support that touches the tree; its parent is where the section is largest.
        ready = [p for p in waiting if any(shared[p, other] for other in order)]
        child = min(ready, key=lambda p: rank[p])
        parent[child] = min(order, key=lambda other: (-area[child, other], rank[other]))
        order.append(child)
        waiting.remove(child)

    position = {p: s for s, p in enumerate(order)}
    digits = len(str(count))
    subdomains: list[Subdomain] = []
    for p in order:
        up = parent[p]
        beyond = supported if up == GROUND else bodies[up].nodes
        if up != GROUND:
            beyond = np.union1d(beyond, np.unique(coupled_nodes(mesh.equations)[beyond].indices))
        joint = section(mesh, np.intersect1d(bodies[p].nodes, beyond))
        index = GROUND if up == GROUND else position[up]
        elements = np.flatnonzero(piece == p)
        turn = mean_rotation(mesh, elements)
        own = bodies[p], turn, joint, joint.centre(mesh.points)
        subdomains.append(Subdomain(f"frame_{position[p] + 1:0{digits}d}", index, elements, *own))

    return Division(tuple(subdomains), _open_loops(mesh, subdomains, shared[np.ix_(order, order)]))


def open_loops(mesh: Mesh, subdomains: Sequence[Subdomain]) -> tuple[str, ...]:
    """Where sub-domains given by hand share a section without hanging on each other, in words.

    Parameters
    ----------
    mesh : Mesh
    subdomains : sequence of Subdomain

    Returns
    -------
    tuple of str
    """
    count = len(subdomains)
    # What lies in no frame is a piece more, of which nothing is said.
    piece = first_of([domain.elements for domain in subdomains], mesh.element_count, count)
    return _open_loops(mesh, subdomains, _shared(piece, linked(mesh), count + 1)[:count, :count])


def _open_loops(mesh: Mesh, subdomains: Sequence[Subdomain], shared: FloatArray) -> tuple[str, ...]:
    """Pairs of sub-domains with a common section (S, S), in m², neither of which hangs on the other."""
    found = []
    for p, q in zip(*np.nonzero(np.triu(shared)), strict=True):
        first, second = subdomains[p], subdomains[q]
        if first.parent == q or second.parent == p:
            continue
        common = mesh.points[np.intersect1d(first.body.nodes, second.body.nodes)]
        where = f"at {point(common.mean(axis=0))} m" if len(common) else "where equations or rigid links join them"
        found.append(f"closed loop cut between frames {first.name} and {second.name} {where}")
    return tuple(found)
