"""Beams as bricks between rigid sections: each node has the corners of the sections that meet there, a rigid body.

The brick of a section has its radii of gyration, so that mass and rotary inertia follow as of solids; of a rectangle it
is the beam itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..files.array_types import BoolArray, FloatArray, IntArray
from ..files.errors import MeshError
from .blocks import ElementBlock
from .equations import matrix_of
from .links import RigidLink, merged
from .listing import listed
from .model import Mesh
from .shapes import BRICK

# Lengths below this part of the section are none; cosine of the angle up to which beams go on straight: 20 degrees.
_SAME, _SMOOTH = 1e-6, np.cos(np.radians(20.0))
_CORNERS = BRICK.corners[:4, :2]


class Beam(NamedTuple):
    """What makes a beam of nodes: section as of `ElementBlock`, and what the first axis is at right angles to it."""

    section: tuple[float, ...]
    direction: tuple[float, ...]


def with_beams(mesh: Mesh, beams: Mapping[int, Beam], turning: BoolArray) -> tuple[Mesh, BoolArray]:
    """Give beams their sections.

    Parameters
    ----------
    mesh : Mesh
        Whose beams have two nodes, or three with the middle one second, or the last one twice.
    beams : mapping of int to Beam
        By the element's label.
    turning : (n, 3) bool
        Rotations of nodes that are held at zero.

    Returns
    -------
    mesh, turning : Mesh, (m, 3) bool
        Of three nodes two beams are made; nodes of beams alone are the means of their corners.

    Raises
    ------
    MeshError
        A beam has no length, or its direction runs along it.
    """
    blocks, source, used = _split(mesh, beams)
    kept = np.flatnonzero(used)
    row = np.where(used, np.cumsum(used) - 1, -1)
    blocks, node, place, half = _bricks(mesh.points, blocks, beams, kept.size)
    origin = np.concatenate([kept, np.repeat(node, 4)])
    order, count = np.argsort(origin, kind="stable"), origin.size
    first = np.searchsorted(origin[order], np.arange(len(mesh.points) + 1))

    def moved(nodes: IntArray) -> IntArray:
        return np.unique(np.concatenate([order[:0], *(order[first[k] : first[k + 1]] for k in nodes.tolist())]))

    alone, chosen = np.unique(node, return_index=True)
    links = [RigidLink(one.name, moved(one.nodes)) for one in mesh.links]
    links += [RigidLink(f"beams at {mesh.labels[one]}", moved(np.array([one]))) for one in alone.tolist()]
    words = (
        f"{alone.size} nodes of beams; {used[alone].sum()} are shared: shells turn with them, solids only move there"
    )
    chosen, alone = chosen[~used[alone]], alone[~used[alone]]
    there = kept.size + 4 * chosen[:, None] + np.arange(4)
    places = np.concatenate([kept, np.repeat(alone, 4)]), np.concatenate([row[kept], there.ravel()])
    share = sp.coo_array((np.repeat([1.0, 0.25], [kept.size, there.size]), places), (len(row), count))
    fixed, rows = _supports(mesh.fixed[alone], turning[alone], there, half[chosen], count)
    fixed[: kept.size] = mesh.fixed[kept]
    result = replace(
        mesh,
        points=np.concatenate([mesh.points[kept], place]),
        labels=mesh.labels[origin],
        blocks=tuple(b if b.type.beam else replace(b, connectivity=row[b.connectivity]) for b in blocks),
        node_sets={name: moved(nodes) for name, nodes in mesh.node_sets.items()},
        element_sets={name: np.flatnonzero(np.isin(source, rows)) for name, rows in mesh.element_sets.items()},
        fixed=fixed,
        masses=tuple(replace(one, nodes=moved(one.nodes)) for one in mesh.masses),
        links=merged(links, np.arange(count) >= kept.size),
        equations=None if mesh.equations is None else sp.csr_array(mesh.equations @ sp.kron(share, sp.eye_array(3))),
        supports=matrix_of(rows, 3 * count) if rows else None,
        notes=(*mesh.notes, words),
    )
    return result, np.concatenate([turning[kept], np.zeros((count - kept.size, 3), dtype=bool)])


def _split(mesh: Mesh, beams: Mapping[int, Beam]) -> tuple[list[ElementBlock], IntArray, BoolArray]:
    """Blocks whose beams have two nodes and a section, the elements that theirs were, and nodes that are kept."""
    blocks, source, used = [], [], np.ones(len(mesh.points), dtype=bool)
    for block, start in zip(mesh.blocks, mesh.starts, strict=False):
        whole = np.arange(len(block.labels))
        if block.type.beam:
            used[block.connectivity] = False
            ends = np.stack([block.connectivity[:, :-1], block.connectivity[:, 1:]], axis=2)
            between = ends[..., 0] != ends[..., 1]
            whole = np.nonzero(between)[0]
            section = np.array([beams[label].section for label in block.labels.tolist()])
            block = replace(replace(block, section=section).part(whole), connectivity=ends[between])
        blocks.append(block)
        source.append(start + whole)
    for block in (one for one in blocks if not one.type.beam):
        used[block.connectivity] = True
    return blocks, np.concatenate(source), used


def _bricks(
    points: FloatArray, blocks: Sequence[ElementBlock], beams: Mapping[int, Beam], first: int
) -> tuple[list[ElementBlock], IntArray, FloatArray, FloatArray]:
    """Blocks whose beams are between corners from row `first` on; nodes, places and half axes as of `_sections`."""
    bars = [block for block in blocks if block.type.beam]
    node, place, half, which = _sections(points, bars, beams)
    corners = (first + 4 * which[..., None] + np.arange(4)).reshape(-1, 8)
    own = iter(np.split(corners, np.cumsum([len(block.labels) for block in bars])[:-1]))
    return [replace(b, connectivity=next(own)) if b.type.beam else b for b in blocks], node, place, half


def _sections(
    points: FloatArray, bars: Sequence[ElementBlock], beams: Mapping[int, Beam]
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Sections: node (s,), corners' places (4s, 3), half axes (s, 2, 3); and those at the ends of beams (e, 2)."""
    ends, labels = np.concatenate([one.connectivity for one in bars]), np.concatenate([one.labels for one in bars])
    section = np.array([beams[label].section for label in labels.tolist()])
    along = np.diff(points[ends], axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    along /= np.maximum(length, 1e-300)[:, None]
    direction = np.array([beams[label].direction for label in labels.tolist()])
    across = np.linalg.norm(np.cross(along, direction), axis=1) <= _SAME * np.linalg.norm(direction, axis=1)
    if (wrong := across | (length <= 0.0)).any():
        words = "beams have no length, or the direction of their section's first axis runs along them"
        raise MeshError(f"{words}: {listed(labels[wrong])}; give another direction")
    # Beams that go on nearly straight have a plane in common where they meet.
    sums: dict[int, list[FloatArray]] = {}
    plane = []
    for node, own in zip(ends.ravel().tolist(), np.repeat(along, 2, axis=0), strict=True):
        known = sums.setdefault(node, [])
        beside = [one for one in known if abs(one @ own) > _SMOOTH * np.linalg.norm(one)] or [np.zeros(3)]
        known += [] if beside[0].any() else beside
        beside[0] += own if beside[0] @ own >= 0.0 else -own
        plane.append(beside[0])
    normal = np.array(plane)
    normal *= np.sign(np.sum(normal * np.repeat(along, 2, axis=0), axis=1, keepdims=True))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.repeat(direction, 2, axis=0)
    first = first - np.sum(first * normal, axis=1, keepdims=True) * normal
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    size = np.repeat(np.sqrt(3.0 * section[:, 1:3] / section[:, :1]), 2, axis=0)
    half = size[..., None] * np.stack([first, np.cross(normal, first)], axis=1)
    arm = _CORNERS @ half
    near = np.rint(arm / (_SAME * size.max(axis=1)[:, None, None])).reshape(len(arm), 12)
    key = np.column_stack([ends.ravel(), np.log(size), near])
    _, index, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    node = ends.ravel()[index]
    return node, (points[node][:, None] + arm[index]).reshape(-1, 3), half[index], which.reshape(-1, 2)


def _supports(
    fixed: BoolArray, turning: BoolArray, corners: IntArray, half: FloatArray, count: int
) -> tuple[BoolArray, list[dict[int, float]]]:
    """Translations (count, 3) held at zero, and equations for what is held of beams' nodes (k, 3) otherwise."""
    held, rows = np.zeros((count, 3), dtype=bool), []
    for moves, turns, own, (one, two) in zip(fixed, turning, corners.tolist(), half, strict=True):
        if moves.all() and turns.all():
            held[own] = True
            continue
        rows += [{3 * corner + axis: 0.25 for corner in own} for axis in np.flatnonzero(moves).tolist()]
        size = np.linalg.norm([one, two], axis=1)
        one, two = one / size[0], two / size[1]
        along = np.cross(one, two)
        for axis in np.flatnonzero(turns).tolist():
            # ω of how both axes turn, ω × n.
            parts = 0.5 * along[axis] * two - two[axis] * along, one[axis] * along - 0.5 * along[axis] * one
            value = (_CORNERS / size) @ np.stack(parts)
            rows.append({3 * own[c] + k: value[c, k].item() for c, k in zip(*np.nonzero(value), strict=True)})
    return held, rows
