"""Where to open loops that close within a body (docs/theory.md, section 10).

The distance along the body from its supports is cut into thin levels, whose connected pieces are a graph: a tree from
the supports, and a connection more for each loop, where two arms of it meet. A section across one of the arms, near
where they meet, opens the loop.
"""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...files.array_types import BoolArray, FloatArray, IntArray
from ...mesh.model import Mesh
from ..division import distance_along
from .loops import (
    LARGE,
    PLACES,
    RAGGED,
    SLENDER,
    Contacts,
    LoopSection,
    element_contacts,
    element_means,
    sections_between,
    straddled,
)

# A level is as deep as this share of all elements, and the body has no more of them than this.
_DEEP, _LEVELS = 0.9, 200
# A shorter way around than so many levels is none: a bore, or a ragged level.
_SHORT = 6
# How far from where the arms meet a section may lie, of the way around, and what its distance weighs.
_OFFSET, _FAR = 0.2, 1.0
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
    contacts = element_contacts(mesh)
    distance = distance_along(mesh, anchored)
    middle = element_means(mesh, distance)
    extent = np.concatenate([np.ptp(distance[block.connectivity], axis=1) for block in mesh.blocks])
    depth = max(1.2 * float(np.quantile(extent, _DEEP)), float(distance.max()) / _LEVELS)
    level = np.floor(middle / depth).astype(np.int64)
    held = np.concatenate([np.isin(block.connectivity, anchored).any(axis=1) for block in mesh.blocks])
    closed = np.ones(len(contacts.elements), dtype=bool)
    avoided = np.unique(np.concatenate([anchored, *clear.values()]))
    found: list[LoopSection] = []
    while True:
        piece, loops = _loops(contacts.elements[closed], level, middle, held, _SHORT * depth)
        tried = (_best(mesh, contacts, piece, one, middle, depth, avoided, clear, closed) for one in loops)
        opened = next((one for one in tried if one is not None), None)
        if opened is None:
            return found
        found.append(opened[0])
        if len(found) > _MOST:
            return []
        closed &= ~opened[1]


def _linked(pairs: IntArray, count: int) -> IntArray:
    """Number (count,) of the connected piece of each of some elements, by pairs (k, 2) that hang together."""
    graph = sp.coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _loops(
    pairs: IntArray, level: IntArray, middle: FloatArray, held: BoolArray, shortest: float
) -> tuple[IntArray, list[_Loop]]:
    """Pieces (e,) of levels (e,), and the loops that they close, the longest first; `pairs` (k, 2) hang together."""
    same = level[pairs[:, 0]] == level[pairs[:, 1]]
    piece = _linked(pairs[same], middle.size)
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


def _best(
    mesh: Mesh,
    contacts: Contacts,
    piece: IntArray,
    loop: _Loop,
    middle: FloatArray,
    depth: float,
    avoided: IntArray,
    clear: Mapping[str, IntArray],
    closed: BoolArray,
) -> tuple[LoopSection, BoolArray] | None:
    """The best section that opens a loop, and the contacts (c,) across it; none if nothing slender and clear does."""
    tried = []
    for arm in loop.arms:
        inside = np.isin(piece, arm)
        for offset in loop.way * np.linspace(0.0, _OFFSET, PLACES):
            side = np.where(inside, (middle >= loop.end - offset).astype(np.int64), -1)
            sections, flat, area = sections_between(mesh, contacts, side)
            slender = len(sections) == 1 and sections[0].width <= SLENDER * loop.way
            if not slender or np.intersect1d(sections[0].nodes, avoided).size:
                continue
            ends = side[contacts.elements]
            across = (ends.min(axis=1) == 0) & (ends.max(axis=1) == 1)
            around = np.abs(middle - loop.end + offset) <= 2.0 * depth
            if straddled(mesh, side, tuple(clear.values())) or _beside(
                contacts, closed & ~across, around, side, across
            ):
                continue
            tried.append((flat, area, offset / loop.way, sections[0], across))
    if not tried:
        return None
    smallest = min(area for _, area, *_ in tried)
    cost = [RAGGED * (1.0 - flat) + LARGE * (area / smallest - 1.0) + _FAR * far for flat, area, far, *_ in tried]
    return tried[int(np.argmin(np.round(cost, 9)))][3:]


def _beside(contacts: Contacts, closed: BoolArray, around: BoolArray, side: IntArray, across: BoolArray) -> bool:
    """Whether a way leads past a section, by contacts (c,) that stay closed, through the elements (e,) around it."""
    near = closed & around[contacts.elements].all(axis=1)
    piece = _linked(contacts.elements[near], side.size)
    ends = contacts.elements[across]
    first = side[ends[:, 0]] == 0
    return bool(
        np.intersect1d(
            piece[np.where(first, ends[:, 0], ends[:, 1])], piece[np.where(first, ends[:, 1], ends[:, 0])]
        ).size
    )
