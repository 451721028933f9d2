"""Where to cut a body whose supports close a loop (docs/theory.md, section 10).

Each element belongs to the support that is nearest along the body. Where the elements of two supports meet is a section
of whole element faces that opens the loop between them. It is moved along the body, within the middle of the way, to
where it is flat and small and clear of interfaces. Supports that no slender section separates count as one.

Within the body, too, loops close. The distance along the body from its supports is cut into thin levels, whose
connected pieces are a graph: a tree from the supports, and a connection more for each loop, where two arms of it
meet. A section across one of the arms, near where they meet, opens the loop.
"""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...files.basics import BoolArray, FloatArray, IntArray
from ...mesh.checks import linked_pieces, node_groups, nodes_of_elements
from ...mesh.equations import coupled_nodes
from ...mesh.model import Mesh
from ..division import corner_areas, distance_along

T = TypeVar("T")
SLENDER = 0.25
"""A section is slender if it is no wider than this share of the way from support to support."""
# How far from the middle of the way a section may lie, of the way.
_OFFSET = 0.3
PLACES = 41
"""How many places of a section are tried."""
# What a section's raggedness (1 less its projected area over its area), its area (over the smallest less 1) and its
# distance from the middle (over the way) weigh: a ragged one costs accuracy, a large one is a corner.
RAGGED, LARGE = 10.0, 1.0
_FAR = 0.3


@dataclass(frozen=True, slots=True)
class LoopSection:
    """A section that opens a loop.

    Attributes
    ----------
    nodes : (k,) int
        Nodes of whole element faces across the body.
    place : (3,) float
        Their centre, m.
    width : float
        Largest extent, m.
    """

    nodes: IntArray
    place: FloatArray
    width: float


@dataclass(frozen=True, slots=True)
class Contacts:
    """Faces inside a body: their two elements (f, 2), area vectors from the first to the second (f, 3), m², nodes.

    Elements whose nodes equations couple, such as those of sheets at a fold, are last, without area and nodes. Coupled
    are nodes (n, n) with themselves and with those.
    """

    elements: IntArray
    area: FloatArray
    incidence: sp.csr_array
    coupled: sp.csr_array


def loop_sections(mesh: Mesh, anchored: IntArray, clear: Mapping[str, IntArray]) -> list[LoopSection]:
    """Sections that open the loops between a body's supports.

    Parameters
    ----------
    mesh : Mesh
        In one piece.
    anchored : (k,) int
        Nodes that supports hold; those that elements connect are one support.
    clear : mapping of str to (k,) int
        Nodes of interfaces: a section touches none of them, and leaves each on one side.

    Returns
    -------
    list of LoopSection
        By place; empty if one support holds the body, or no slender section separates two of them.
    """
    group = node_groups(mesh, anchored)
    if int(group.max(initial=0)) < 1:
        return []
    search = _Search.of(mesh, anchored, clear)
    ways = np.array([distance_along(mesh, anchored[group == g]) for g in range(int(group.max()) + 1)])
    # A label for each support; those that nothing slender separates get the same one.
    label = np.arange(len(ways))
    while len(set(label.tolist())) > 1:
        names = np.unique(label)
        near = np.array([ways[label == name].min(axis=0) for name in names])
        cell = np.argmin([mesh.element_means(row) for row in near], axis=0)
        met = np.unique(np.sort(cell[search.contacts.elements], axis=1), axis=0)
        pairs = [(i, j) for i, j in met.tolist() if i != j]
        found = [_best(search, cell, near, pair) for pair in pairs]
        if all(found):
            return sorted((one for each in found for one in each), key=lambda one: tuple(np.round(one.place, 9)))
        i, j = next(pair for pair, each in zip(pairs, found, strict=True) if not each)
        label = np.where(label == names[j], names[i], label)
    return []


def element_contacts(mesh: Mesh) -> Contacts:
    """The faces inside a body."""
    centre = mesh.element_means(mesh.points)
    elements, areas, rows, columns = ([np.zeros(shape, int)] for shape in ((0, 2), (0, 3), 0, 0))
    first = 0
    for block in mesh.faces:
        inner = block.beyond >= 0
        if not inner.any():
            continue
        members = block.nodes[inner]
        pair = np.stack([block.element[inner], block.beyond[inner]], axis=1)
        area = corner_areas(mesh.points[members[:, : block.corner_count]])
        areas.append(area * np.sign(np.einsum("fi,fi->f", area, centre[pair[:, 1]] - centre[pair[:, 0]]))[:, None])
        elements.append(pair)
        rows.append(np.repeat(first + np.arange(len(members)), members.shape[1]))
        columns.append(members.ravel())
        first += len(members)
    uses = nodes_of_elements(mesh)
    others = coupled_nodes(mesh.equations)
    coupled = sp.csr_array(sp.eye_array(len(mesh.points))) + others
    beside = sp.triu(uses @ others @ uses.T, 1).tocoo()
    elements.append(np.stack(beside.coords, axis=1))
    areas.append(np.zeros((beside.nnz, 3)))
    r, c, pairs = (np.concatenate(parts) for parts in (rows, columns, elements))
    incidence = sp.csr_array(sp.coo_array((np.ones(r.size), (r, c)), shape=(len(pairs), len(mesh.points))))
    return Contacts(pairs, np.concatenate(areas), incidence, coupled)


@dataclass(frozen=True, slots=True)
class _Search:
    """A body in which sections are sought, its contacts, the nodes that none may touch and those it may not part."""

    mesh: Mesh
    contacts: Contacts
    avoided: IntArray
    whole: Sequence[IntArray]

    @classmethod
    def of(cls, mesh: Mesh, anchored: IntArray, clear: Mapping[str, IntArray]) -> "_Search":
        """See `loop_sections`."""
        whole = list(clear.values())
        return cls(mesh, element_contacts(mesh), np.unique(np.concatenate([anchored, *whole])), whole)

    def sections(self, side: IntArray, way: float) -> tuple[list[LoopSection], float, float]:
        """The sections between two sides if all are clear, and slender on so long a way; as `_sections_between`."""
        found, flat, area = _sections_between(self.mesh, self.contacts, side)
        wrong = (one.width > SLENDER * way or np.intersect1d(one.nodes, self.avoided).size for one in found)
        return [] if any(wrong) else found, flat, area


def _best(search: _Search, cell: IntArray, near: FloatArray, pair: tuple[int, int]) -> list[LoopSection]:
    """The best sections between the cells (e,) of two supports; none if nothing slender and clear separates them."""
    i, j = pair
    way = float((near[i] + near[j]).min())
    lead = np.where((cell == i) | (cell == j), search.mesh.element_means(near[i] - near[j]), np.nan)
    tried: list[tuple[float, float, float, list[LoopSection]]] = []
    for offset in _OFFSET * way * np.linspace(-1.0, 1.0, PLACES):
        side = np.where(np.isnan(lead), -1, lead > offset)
        sections, flat, area = search.sections(side, way)
        if sections and _sides_hang_together(search.contacts, side) and not straddled(search.mesh, side, search.whole):
            tried.append((flat, area, _FAR * (abs(offset) / way), sections))
    return _cheapest(tried) or []


def _cheapest(tried: Sequence[tuple[float, float, float, T]]) -> T | None:
    """The best of some tries, of which flatness, area and what their distance weighs are known; None of none."""
    if not tried:
        return None
    smallest = min(area for _, area, _, _ in tried)
    cost = [RAGGED * (1.0 - flat) + LARGE * (area / smallest - 1.0) + far for flat, area, far, _ in tried]
    return tried[int(np.argmin(np.round(cost, 9)))][3]


def _across(contacts: Contacts, side: IntArray) -> BoolArray:
    """Contacts (c,) between elements of the sides (e,) 0 and 1."""
    ends = side[contacts.elements]
    return (ends.min(axis=1) == 0) & (ends.max(axis=1) == 1)


def _sections_between(mesh: Mesh, contacts: Contacts, side: IntArray) -> tuple[list[LoopSection], float, float]:
    """The connected sections between two sides (e,), 0 and 1; how flat the worst is, and the area of all, m².

    Flat is projected area over area, one for a plane.
    """
    ends = side[contacts.elements]
    faces = np.flatnonzero(_across(contacts, side) & contacts.area.any(axis=1))
    if not faces.size:
        return [], 0.0, 0.0
    touch = contacts.incidence[faces]
    count, number = connected_components(touch @ contacts.coupled @ touch.T, directed=False)
    area = contacts.area[faces] * np.where(ends[faces, 0] == 0, 1.0, -1.0)[:, None]
    size = np.linalg.norm(area, axis=1)
    found, flat = [], []
    for k in range(count):
        nodes = np.unique(touch[np.flatnonzero(number == k)].indices)
        points = mesh.points[nodes]
        found.append(LoopSection(nodes, points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))))
        flat.append(float(np.linalg.norm(area[number == k].sum(axis=0)) / size[number == k].sum()))
    return found, min(flat), float(size.sum())


def _sides_hang_together(contacts: Contacts, side: IntArray) -> bool:
    """Whether each side is in one piece."""
    ends = side[contacts.elements]
    number = linked_pieces(contacts.elements[(ends[:, 0] == ends[:, 1]) & (ends[:, 0] >= 0)], side.size)
    return all(np.unique(number[side == one]).size == 1 for one in (0, 1))


def straddled(mesh: Mesh, side: IntArray, sets: Sequence[IntArray]) -> bool:
    """Whether one of some node sets has nodes on both sides."""
    touched = [nodes_of_elements(mesh).T @ (side == one) > 0.0 for one in (0, 1)]
    return any(touched[0][members].any() and touched[1][members].any() for members in sets)


# A level is as deep as this share of all elements, and the body has no more of them than this.
_DEEP, _LEVELS = 0.9, 200
# A shorter way around than so many levels is none: a bore, or a ragged level.
_SHORT = 6
# How far from where the arms meet a section may lie, of the way around, and what its distance weighs.
_INNER_OFFSET, _INNER_FAR = 0.2, 1.0
# More loops than so many are left closed: a lattice is no frame of slender members.
_MOST = 6


@dataclass(frozen=True, slots=True)
class _Loop:
    """A loop: the way around it, m, the distance from the supports at which its arms meet, pieces of each arm."""

    way: float
    end: float
    arms: tuple[Sequence[int], Sequence[int]]


def inner_sections(mesh: Mesh, anchored: IntArray, clear: Mapping[str, IntArray]) -> list[LoopSection]:
    """Sections that open the loops within a body, one a loop; the longest first.

    Parameters
    ----------
    mesh : Mesh
        In one piece.
    anchored : (k,) int
        Nodes that supports hold: distances count from there. Loops from support to support are not looked for.
    clear : mapping of str to (k,) int
        Nodes of interfaces, none of which is at a section.

    Returns
    -------
    list of LoopSection
        None where a loop stays without a slender section, or where there are too many.
    """
    search = _Search.of(mesh, anchored, clear)
    distance = distance_along(mesh, anchored)
    middle = mesh.element_means(distance)
    extent = np.concatenate([np.ptp(distance[block.connectivity], axis=1) for block in mesh.blocks])
    depth = max(1.2 * float(np.quantile(extent, _DEEP)), float(distance.max()) / _LEVELS)
    level = np.floor(middle / depth).astype(np.int64)
    held = np.concatenate([np.isin(block.connectivity, anchored).any(axis=1) for block in mesh.blocks])
    closed = np.ones(len(search.contacts.elements), dtype=bool)
    found: list[LoopSection] = []
    while True:
        piece, loops = _loops(search.contacts.elements[closed], level, middle, held, _SHORT * depth)
        tried = (_best_inner(search, piece, one, middle, depth, closed) for one in loops)
        opened = next((one for one in tried if one is not None), None)
        if opened is None:
            return found
        found.append(opened[0])
        if len(found) > _MOST:
            return []
        closed &= ~opened[1]


def _loops(
    pairs: IntArray, level: IntArray, middle: FloatArray, held: BoolArray, shortest: float
) -> tuple[IntArray, list[_Loop]]:
    """Pieces (e,) of levels (e,), and the loops that they close, the longest first; `pairs` (k, 2) hang together."""
    same = level[pairs[:, 0]] == level[pairs[:, 1]]
    piece = linked_pieces(pairs[same], middle.size)
    near = np.full(int(piece.max()) + 1, np.inf)
    np.minimum.at(near, piece, middle)
    links = np.unique(np.sort(piece[pairs[~same]], axis=1), axis=0).tolist()
    beside: list[list[int]] = [[] for _ in near]
    for a, b in links:
        beside[a].append(b)
        beside[b].append(a)
    # The tree from the supports, nearest first.
    parent = dict.fromkeys(np.unique(piece[held]).tolist(), -1)
    waiting = [(near[root], root) for root in parent]
    heapq.heapify(waiting)
    while waiting:
        _, here = heapq.heappop(waiting)
        for other in beside[here]:
            if other not in parent:
                parent[other] = here
                heapq.heappush(waiting, (near[other], other))
    found = []
    for a, b in links:
        if parent.get(a, b) == b or parent.get(b, a) == a:
            continue
        ways = _way(parent, a), _way(parent, b)
        common = set(ways[0]) & set(ways[1])
        fork = next((one for one in ways[0] if one in common), None)
        way = 0.0 if fork is None else float(near[a] + near[b] - 2.0 * near[fork])
        if way >= shortest:
            arms = tuple([one for one in each if one not in common] for each in ways)
            found.append(_Loop(way, float(max(near[a], near[b])), (arms[0], arms[1])))
    return piece, sorted(found, key=lambda one: -one.way)


def _way(parent: Mapping[int, int], piece: int) -> list[int]:
    """A piece and those on its way to the supports."""
    found = [piece]
    while parent[found[-1]] >= 0:
        found.append(parent[found[-1]])
    return found


def _best_inner(
    search: _Search, piece: IntArray, loop: _Loop, middle: FloatArray, depth: float, closed: BoolArray
) -> tuple[LoopSection, BoolArray] | None:
    """The best section that opens a loop, and the contacts (c,) across it; none if nothing slender and clear does."""
    contacts, tried = search.contacts, []
    for arm in loop.arms:
        inside = np.isin(piece, arm)
        for offset in loop.way * np.linspace(0.0, _INNER_OFFSET, PLACES):
            side = np.where(inside, (middle >= loop.end - offset).astype(np.int64), -1)
            sections, flat, area = search.sections(side, loop.way)
            if len(sections) != 1 or straddled(search.mesh, side, search.whole):
                continue
            across, around = _across(contacts, side), np.abs(middle - loop.end + offset) <= 2.0 * depth
            if not _beside(contacts, closed & ~across, around, side, across):
                tried.append((flat, area, _INNER_FAR * (offset / loop.way), (sections[0], across)))
    return _cheapest(tried)


def _beside(contacts: Contacts, closed: BoolArray, around: BoolArray, side: IntArray, across: BoolArray) -> bool:
    """Whether a way leads past a section, by contacts (c,) that stay closed, through the elements (e,) around it."""
    piece = linked_pieces(contacts.elements[closed & around[contacts.elements].all(axis=1)], side.size)
    ends = contacts.elements[across]
    first = side[ends[:, 0]] == 0
    here, there = np.where(first, ends[:, 0], ends[:, 1]), np.where(first, ends[:, 1], ends[:, 0])
    return bool(np.intersect1d(piece[here], piece[there]).size)
