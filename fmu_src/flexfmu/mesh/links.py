"""Nodes that move as one rigid body, exactly also in large turns (docs/theory.md, equation (2b)).

Of the nodes of a link as many are masters as span it: four in space, three in a plane, two on a line. All others follow
them affinely, which is linear in displacements and right for every rotation. That the masters keep their distances is
left to a simplex between them, an element of one integration point that is far stiffer than what is around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..files.array_types import BoolArray, FloatArray, IntArray

# Distance from what other masters span, over the link's size, from which on a node is off it.
_OFF = 1e-6
# Singular values of gradients below this part of the largest are round-off.
_FLAT = 1e-9
# Entries of an equation's effect on rigid motions and stretches below this part of its terms are round-off.
_ROUND_OFF = 1e-7
# Nodes that equations join up to which it is asked whether they make one rigid body: a dense matrix of thrice as many.
_RECOGNISED = 400


@dataclass(frozen=True, slots=True)
class RigidLink:
    """Nodes that move as one rigid body.

    Attributes
    ----------
    name : str
    nodes : (k,) int
        Rows of `Mesh.points`, ascending.
    """

    name: str
    nodes: IntArray


@dataclass(frozen=True, slots=True)
class Simplices:
    """Stiff simplices that keep the masters of rigid links in shape, of energy ½ k |E|², E their Green strain.

    Attributes
    ----------
    nodes : (e, d + 1) int
        Masters; d = 3 in space, 2 in a plane, 1 on a line.
    gradient : (e, d + 1, 3) float
        Of the affine functions that are one at a master and zero at the others, along what the masters span, 1/m.
    stiffness : (e,) float
        k, J.
    """

    nodes: IntArray
    gradient: FloatArray
    stiffness: FloatArray

    @property
    def span(self) -> FloatArray:
        """Projectors (e, 3, 3) on what the masters span, in which alone strain has energy."""
        return np.linalg.pinv(self.gradient, rcond=_FLAT) @ self.gradient


def renumbered(simplices: Sequence[Simplices], place: IntArray) -> tuple[Simplices, ...]:
    """Simplices of the nodes that have a place (n,), there; −1: none."""
    kept = [(one, (place[one.nodes] >= 0).all(axis=1)) for one in simplices]
    return tuple(Simplices(place[s.nodes[own]], s.gradient[own], s.stiffness[own]) for s, own in kept if own.any())


def merged(links: Sequence[RigidLink], joining: BoolArray) -> tuple[RigidLink, ...]:
    """Links as they are when those that share any of the nodes `joining` (n,) are one."""
    member = [np.flatnonzero(joining[link.nodes]) for link in links]
    pairs = [(number, link.nodes[place]) for number, link in enumerate(links) for place in member[number]]
    if not pairs:
        return tuple(links)
    number, node = np.array(pairs).T
    uses = sp.csr_array((np.ones(len(pairs)), (number, node)), shape=(len(links), joining.size))
    count, group = connected_components(uses @ uses.T, directed=False)
    together = [[links[k] for k in np.flatnonzero(group == one).tolist()] for one in range(count)]
    return tuple(RigidLink(some[0].name, np.unique(np.concatenate([link.nodes for link in some]))) for some in together)


def recognised(points: FloatArray, equations: sp.csr_array) -> tuple[tuple[RigidLink, ...], sp.csr_array]:
    """Find the nodes that equations make one rigid body, linearly.

    Parameters
    ----------
    points : (n, 3) float
    equations : (r, 3n) sparse

    Returns
    -------
    links : tuple of RigidLink
    equations : (s, 3n) sparse
        The others.
    """
    of_rigid, stretched = effects(points, equations)
    entry = equations.tocoo()
    node = sp.csr_array((np.ones(entry.nnz), (entry.row, entry.col // 3)), shape=(len(of_rigid), len(points)))
    kept, links = np.ones(len(of_rigid), dtype=bool), []
    candidate = np.flatnonzero(of_rigid)
    _, group = connected_components(sp.csr_array(node[candidate] @ node[candidate].T), directed=False)
    for number in np.unique(group[stretched[candidate]]).tolist():
        rows = candidate[group == number]
        nodes = np.unique(node[rows].indices)
        if nodes.size > _RECOGNISED:
            continue
        columns = (3 * nodes[:, None] + np.arange(3)).ravel()
        own = np.linalg.matrix_rank(equations[rows][:, columns].toarray())
        if columns.size - own == _rigid_motions(points[nodes]):
            links.append(RigidLink(f"equations of {nodes.size} nodes", nodes))
            kept[rows] = False
    return tuple(links), sp.csr_array(equations[np.flatnonzero(kept)])


def effects(points: FloatArray, equations: sp.csr_array) -> tuple[BoolArray, BoolArray]:
    """Which equations (r,) rigid motions fulfil at first order, and which of these no stretch does."""
    centred = points - points.mean(axis=0)
    fields = np.zeros((len(points), 3, 3, 4))
    for axis in range(3):
        fields[:, axis, axis, 0], fields[:, axis, axis, 1:] = 1.0, centred
    whole = fields.reshape(3 * len(points), 12)
    effect = (equations @ whole).reshape(-1, 3, 4)
    limit = _ROUND_OFF * (abs(equations) @ np.abs(whole)).max(axis=1)
    moved, slope = np.abs(effect[:, :, 0]).max(axis=1), effect[:, :, 1:]
    turned = np.abs(slope - slope.swapaxes(1, 2)).max(axis=(1, 2))
    of_rigid = (moved <= limit / max(float(np.abs(centred).max()), 1e-300)) & (turned <= limit)
    return of_rigid, of_rigid & (np.abs(slope).max(axis=(1, 2)) > limit)


def _rigid_motions(points: FloatArray) -> int:
    """How many independent rigid motions points (k, 3) show."""
    return (0, 3, 5, 6, 6)[simplex(points, np.arange(len(points)))[0].size]


def simplex(points: FloatArray, nodes: IntArray) -> tuple[IntArray, FloatArray]:
    """Masters (d + 1,) among nodes, far apart, and the gradients (d + 1, 3) of their affine functions."""
    arm = points[nodes] - points[nodes].mean(axis=0)
    size = float(np.linalg.norm(arm, axis=1).max())
    chosen = [int(np.argmax(np.linalg.norm(arm, axis=1)))]
    rest = arm - arm[chosen[0]]
    while len(chosen) < 4:
        away = np.linalg.norm(rest, axis=1)
        farthest = int(np.argmax(away))
        if away[farthest] <= _OFF * size:
            break
        chosen.append(farthest)
        along = rest[farthest] / away[farthest]
        rest = rest - np.outer(rest @ along, along)
    slope = np.linalg.pinv(arm[chosen[1:]] - arm[chosen[0]]).T
    return nodes[chosen], np.concatenate([-slope.sum(axis=0, keepdims=True), slope])


def followers(points: FloatArray, nodes: IntArray, masters: IntArray, gradient: FloatArray) -> list[dict[int, float]]:
    """Equations by which nodes follow masters affinely."""
    share = (points[nodes] - points[masters[0]]) @ gradient.T
    share[:, 0] += 1.0
    return [
        {3 * int(node) + axis: -1.0}
        | {3 * int(master) + axis: float(part) for master, part in zip(masters, own, strict=True) if part}
        for node, own in zip(nodes, share, strict=True)
        for axis in range(3)
    ]
