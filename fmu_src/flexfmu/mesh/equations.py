"""Linear equations between displacements of nodes, E u = 0, solved for as many of them as there are equations.

Rows are handled as mappings from unknowns to coefficients: they are short, and few unknowns are in many of them.

Nodes that move as one rigid body do so in large turns, too (docs/theory.md, equation (2b)). Of the nodes of a link as
many are masters as span it: four in space, three in a plane, two on a line. All others follow them affinely, which is
linear in displacements and right for every rotation. That the masters keep their distances is left to a simplex
between them, an element of one integration point that is far stiffer than what is around it.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..files import sparse as sp
from ..files.basics import BoolArray, FloatArray, IntArray

Row = dict[int, float]
# A coefficient below this part of those that went into it is round-off of zero.
_ROUND_OFF = 1e-12
# Digits to which coefficients count as equal when one of their unknowns is chosen.
_DIGITS = 6


MIDDLE = np.repeat([-0.25, 0.5], 4)
"""Shares of corners and mid-sides of a quadratic face in its middle."""


def middles(faces: IntArray, nodes: IntArray) -> list[Row]:
    """Equations of nodes (k,) in the middle of quadratic faces (k, 8), as of `matrix_of`."""
    share = (-MIDDLE).tolist()
    return [
        {3 * node + i: 1.0} | dict(zip((3 * face + i).tolist(), share, strict=True))
        for face, node in zip(faces, nodes.tolist(), strict=True)
        for i in range(3)
    ]


def matrix_of(rows: Sequence[Mapping[int, float]], size: int) -> "sp.csr_array":
    """Matrix (r, size) of equations.

    Parameters
    ----------
    rows : sequence of mapping of int to float
        Coefficients by unknown.
    size : int
        Number of unknowns.

    Returns
    -------
    (r, size) sparse
    """
    place = np.repeat(np.arange(len(rows)), [len(row) for row in rows]).astype(np.int64)
    unknown = np.array([key for row in rows for key in row], dtype=np.int64)
    value = np.array([value for row in rows for value in row.values()], dtype=float)
    return sp.csr_array(sp.coo_array((value, (place, unknown)), shape=(len(rows), size)))


def without(equations: "sp.csr_array", gone: BoolArray) -> "sp.csr_array":
    """What equations say of the other unknowns once some are eliminated, which nothing else determines.

    Parameters
    ----------
    equations : (r, n) sparse
    gone : (n,) bool

    Returns
    -------
    (s, n) sparse
        Without entries in the columns that are gone.
    """
    rows = dict(enumerate(_rows(equations)))
    users: dict[int, set[int]] = defaultdict(set)
    for number, row in rows.items():
        for key in row:
            if gone[key]:
                users[key].add(number)
    for key in sorted(users):
        numbers = users[key] & rows.keys()
        if not numbers:
            continue
        pivot = min(numbers, key=lambda number: (-abs(rows[number][key]), len(rows[number]), number))
        row = rows.pop(pivot)
        for number in numbers - {pivot}:
            changed = _added(rows[number], row, -rows[number][key] / row[key])
            changed.pop(key, None)
            for other in users:
                (users[other].add if other in changed else users[other].discard)(number)
            rows[number] = changed
    return matrix_of([row for row in rows.values() if row], equations.shape[1])


def solved(equations: "sp.csr_array") -> tuple[IntArray, "sp.csr_array"]:
    """Solve equations for one unknown each.

    Parameters
    ----------
    equations : (r, n) sparse
        Those that follow from others do no harm.

    Returns
    -------
    dependent : (s,) int
        Unknowns, ascending.
    matrix : (s, n) sparse
        They are this times the unknowns; its columns of dependent ones are zero.
    """
    rows = _rows(equations)
    uses = Counter(key for row in rows for key in row)
    known: dict[int, Row] = {}
    for given in rows:
        row, scale = dict(given), max(map(abs, given.values()), default=0.0)
        while inside := [key for key in row if key in known]:
            for key in inside:
                row = _added({k: v for k, v in row.items() if k != key}, known[key], row.get(key, 0.0))
        row = {key: value for key, value in row.items() if abs(value) > _ROUND_OFF * scale}
        if not row:
            continue
        largest = max(map(abs, row.values()))
        # Of the largest the one in fewest equations: little is filled in.
        pivot = min(row, key=lambda key: (-round(abs(row[key]) / largest, _DIGITS), uses[key], key))
        value = row.pop(pivot)
        known[pivot] = {key: -other / value for key, other in row.items()}
    dependent = np.array(sorted(known), dtype=np.int64)
    matrix = matrix_of([known[key] for key in dependent.tolist()], equations.shape[1])
    is_dependent = np.zeros(equations.shape[1], dtype=bool)
    is_dependent[dependent] = True
    # Rows name unknowns that later rows have been solved for; never in a circle.
    while matrix[:, dependent].nnz:
        matrix = sp.csr_array(matrix @ sp.diags_array((~is_dependent).astype(float)) + matrix[:, dependent] @ matrix)
        matrix.eliminate_zeros()
    return dependent, matrix


def coupled_nodes(equations: "sp.csr_array") -> "sp.csr_array":
    """Nodes that stand in an equation together.

    Parameters
    ----------
    equations : (r, 3n) sparse

    Returns
    -------
    (n, n) sparse
        Ones; symmetric, zero on the diagonal.
    """
    found = equations.tocoo()
    shape = (equations.shape[0], equations.shape[1] // 3)
    member = sp.csr_array(sp.coo_array((np.ones(found.nnz), (found.row, found.col // 3)), shape=shape))
    pairs = sp.coo_array(member.T @ member)
    apart = pairs.row != pairs.col
    ones: FloatArray = np.ones(int(apart.sum()))
    return sp.csr_array(sp.coo_array((ones, (pairs.row[apart], pairs.col[apart])), shape=pairs.shape))


def _rows(equations: "sp.csr_array") -> list[Row]:
    starts, keys, values = equations.indptr, equations.indices.tolist(), equations.data.tolist()
    found = []
    for first, end in pairwise(starts.tolist()):
        row: Row = defaultdict(float)
        for key, value in zip(keys[first:end], values[first:end], strict=True):
            row[key] += value
        found.append({key: value for key, value in row.items() if value})
    return found


def _added(row: Row, other: Iterable[tuple[int, float]] | Row, factor: float) -> Row:
    """`row` plus a multiple of another; what cancels is left out."""
    result = dict(row)
    for key, value in dict(other).items():
        total = result.get(key, 0.0) + factor * value
        if abs(total) > _ROUND_OFF * max(abs(result.get(key, 0.0)), abs(factor * value)):
            result[key] = total
        else:
            result.pop(key, None)
    return result


# Distance from what other masters span, over the link's size, from which on a node is off it.
_OFF = 1e-6
# Singular values of gradients below this part of the largest are round-off.
_FLAT = 1e-9
# Entries of an equation's effect on rigid motions and stretches below this part of its terms are round-off.
_EFFECTLESS = 1e-7
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
    count, group = sp.csgraph.connected_components(uses @ uses.T, directed=False)
    together = [[links[k] for k in np.flatnonzero(group == one).tolist()] for one in range(count)]
    return tuple(RigidLink(some[0].name, np.unique(np.concatenate([link.nodes for link in some]))) for some in together)


def recognised(points: FloatArray, equations: "sp.csr_array") -> tuple[tuple[RigidLink, ...], "sp.csr_array"]:
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
    _, group = sp.csgraph.connected_components(sp.csr_array(node[candidate] @ node[candidate].T), directed=False)
    for number in np.unique(group[stretched[candidate]]).tolist():
        rows = candidate[group == number]
        nodes = np.unique(node[rows].indices)
        if nodes.size > _RECOGNISED:
            continue
        columns = (3 * nodes[:, None] + np.arange(3)).ravel()
        own = np.linalg.matrix_rank(equations[rows][:, columns].toarray())
        # Independent rigid motions that so many points show.
        if columns.size - own == (0, 3, 5, 6, 6)[simplex(points[nodes], np.arange(nodes.size))[0].size]:
            links.append(RigidLink(f"equations of {nodes.size} nodes", nodes))
            kept[rows] = False
    return tuple(links), sp.csr_array(equations[np.flatnonzero(kept)])


def effects(points: FloatArray, equations: "sp.csr_array") -> tuple[BoolArray, BoolArray]:
    """Which equations (r,) rigid motions fulfil at first order, and which of these no stretch does."""
    centred = points - points.mean(axis=0)
    fields = np.zeros((len(points), 3, 3, 4))
    for axis in range(3):
        fields[:, axis, axis, 0], fields[:, axis, axis, 1:] = 1.0, centred
    whole = fields.reshape(3 * len(points), 12)
    effect = (equations @ whole).reshape(-1, 3, 4)
    limit = _EFFECTLESS * (abs(equations) @ np.abs(whole)).max(axis=1)
    moved, slope = np.abs(effect[:, :, 0]).max(axis=1), effect[:, :, 1:]
    turned = np.abs(slope - slope.swapaxes(1, 2)).max(axis=(1, 2))
    of_rigid = (moved <= limit / max(float(np.abs(centred).max()), 1e-300)) & (turned <= limit)
    return of_rigid, of_rigid & (np.abs(slope).max(axis=(1, 2)) > limit)


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


def moved_by(node: int, weights: Mapping[int, float]) -> list[Row]:
    """Three equations by which a node moves as a sum of others by their weights."""
    return [{3 * node + i: -1.0} | {3 * other + i: part for other, part in weights.items()} for i in range(3)]


def followers(points: FloatArray, nodes: IntArray, masters: IntArray, gradient: FloatArray) -> list[Row]:
    """Equations by which nodes follow masters affinely."""
    share = (points[nodes] - points[masters[0]]) @ gradient.T
    share[:, 0] += 1.0
    found: list[Row] = []
    for node, own in zip(nodes.tolist(), share.tolist(), strict=True):
        found += moved_by(node, {master: part for master, part in zip(masters.tolist(), own, strict=True) if part})
    return found
