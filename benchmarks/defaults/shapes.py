"""Meshes of quadratic bricks and tetrahedra, made by small functions: bars along paths, grids with parts left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations

import numpy as np
from demo.mesh_tools import BrickMesh, box_mesh, merge
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Path = Callable[[FloatArray], FloatArray]
"""From shares of the way (n,) to places (n, 3)."""


def lines(*runs: tuple[float, float, int]) -> FloatArray:
    """Coordinates of element boundaries: runs (start, end, elements), one after the other."""
    return np.unique(np.concatenate([np.linspace(a, b, n + 1) for a, b, n in runs]).round(12))


def kept(mesh: BrickMesh, keep: Callable[[FloatArray], NDArray[np.bool_]]) -> BrickMesh:
    """The elements whose centres (n, 3) meet a condition, and their nodes."""
    bricks = mesh.bricks[keep(mesh.centres())]
    nodes, numbers = np.unique(bricks, return_inverse=True)
    return BrickMesh(mesh.points[nodes], numbers.reshape(bricks.shape))


def moved(mesh: BrickMesh, place: Callable[[FloatArray], FloatArray]) -> BrickMesh:
    """The mesh with its points elsewhere."""
    return BrickMesh(place(mesh.points), mesh.bricks)


def bar(
    path: Path,
    along: int,
    size: Callable[[FloatArray], FloatArray],
    across: tuple[int, int] = (2, 2),
    up: object = None,
) -> BrickMesh:
    """Bar along a path.

    Parameters
    ----------
    path : callable
    along : int
        Elements.
    size : callable
        From shares of the way (n,) to height and width (n, 2), m.
    across : tuple of 2 int
        Elements over height and width.
    up : 3 float or callable, optional
        Direction of the width, or of each share: default z. The height is at right angles to it and the path.
    """
    grid = [np.linspace(0.0, 1.0, along + 1), *(np.linspace(-0.5, 0.5, n + 1) for n in across)]

    def place(points: FloatArray) -> FloatArray:
        s = points[:, 0]
        ahead, behind = np.minimum(s + 1e-5, 1.0), np.maximum(s - 1e-5, 0.0)
        tangent = _unit(path(ahead) - path(behind))
        wide = np.asarray(up(s) if callable(up) else [0.0, 0.0, 1.0] if up is None else up, dtype=float)
        high = _unit(np.cross(np.broadcast_to(wide, tangent.shape), tangent))
        wide = np.cross(tangent, high)
        height, width = size(s).T
        return path(s) + (points[:, 1] * height)[:, None] * high + (points[:, 2] * width)[:, None] * wide

    return moved(box_mesh(*grid), place)


def constant(height: float, width: float) -> Callable[[FloatArray], FloatArray]:
    """Size of a bar that is the same all along."""
    return lambda s: np.tile([height, width], (len(s), 1))


def tapered(start: tuple[float, float], end: tuple[float, float]) -> Callable[[FloatArray], FloatArray]:
    """Size of a bar that goes evenly from one to another."""
    return lambda s: np.outer(1.0 - s, start) + np.outer(s, end)


def polyline(*places: Sequence[float], radius: float) -> Path:
    """Straight legs between places, with rounded corners."""
    corners = np.array(places, dtype=float)
    way = [corners[0]]
    for before, at, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        one, two = _unit((before - at)[None])[0], _unit((after - at)[None])[0]
        half = 0.5 * np.arccos(np.clip(one @ two, -1.0, 1.0))
        cut = radius / np.tan(half)
        centre = at + _unit((one + two)[None])[0] * radius / np.sin(half)
        start, end = at + cut * one - centre, at + cut * two - centre
        turn = np.linspace(0.0, 1.0, 33)[:, None]
        angle = np.pi - 2.0 * half
        way += list(centre + (np.sin((1.0 - turn) * angle) * start + np.sin(turn * angle) * end) / np.sin(angle))
    points = np.array([*way, corners[-1]])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    reach /= reach[-1]
    return lambda s: np.stack([np.interp(s, reach, points[:, axis]) for axis in range(3)], axis=1)


def ring(
    r: FloatArray, sectors: int, z: FloatArray, keep: Callable[[FloatArray], NDArray[np.bool_]] | None = None
) -> BrickMesh:
    """Full ring about z over radii and heights, less the elements whose (r, angle, z) do not meet a condition."""
    flat = box_mesh(r, np.linspace(0.0, 2.0 * np.pi, sectors + 1), z)
    return merge(moved(flat if keep is None else kept(flat, keep), cylindrical))


def cylindrical(points: FloatArray) -> FloatArray:
    """Places of (r, angle, z)."""
    r, angle, z = points.T
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def tube(path: Path, along: int, around: int, radius: Callable[[FloatArray], FloatArray], wall: float) -> BrickMesh:
    """Pipe of one element through the wall along a path in a plane of constant z; `radius` of the wall's middle."""
    grid = box_mesh(
        np.linspace(0.0, 1.0, along + 1),
        np.linspace(0.0, 2.0 * np.pi, around + 1),
        np.array([-0.5 * wall, 0.5 * wall]),
    )

    def place(points: FloatArray) -> FloatArray:
        s, angle, out = points.T
        tangent = _unit(path(np.minimum(s + 1e-5, 1.0)) - path(np.maximum(s - 1e-5, 0.0)))
        side = np.cross([0.0, 0.0, 1.0], tangent)
        reach = radius(s) + out
        return path(s) + (reach * np.cos(angle))[:, None] * side - np.outer(reach * np.sin(angle), [0.0, 0.0, 1.0])

    return merge(moved(grid, place))


def tetrahedral(mesh: BrickMesh) -> BrickMesh:
    """Each brick as six 10-node tetrahedra; sides become straight."""
    # Corners by their place in the cell, x + 2 y + 4 z.
    corner = mesh.bricks[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    found = []
    for order in permutations((1, 2, 4)):
        path = np.cumsum([0, *order])
        odd = order in ((1, 4, 2), (2, 1, 4), (4, 2, 1))
        found.append(corner[:, path[[0, 2, 1, 3]] if odd else path])
    corners = np.concatenate(found)
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]], axis=2).reshape(-1, 2)
    sides, side = np.unique(ends, axis=0, return_inverse=True)
    used, numbers = np.unique(corners, return_inverse=True)
    points = np.concatenate([mesh.points[used], mesh.points[sides].mean(axis=1)])
    return BrickMesh(points, np.hstack([numbers.reshape(-1, 4), len(used) + side.reshape(-1, 6)]))


def wedges(mesh: BrickMesh) -> BrickMesh:
    """Each brick as two 15-node wedges; their common side becomes straight."""
    b = mesh.bricks
    # Diagonals of bottom and top from corner 0 to 2; middle nodes of both, shared where bricks meet.
    sides = np.sort(np.concatenate([b[:, [0, 2]], b[:, [4, 6]]]), axis=1)
    ends, number = np.unique(sides, axis=0, return_inverse=True)
    low, high = len(mesh.points) + number.reshape(2, -1, 1)
    one = [b[:, [0, 1, 2, 4, 5, 6, 8, 9]], low, b[:, [12, 13]], high, b[:, [16, 17, 18]]]
    two = [b[:, [0, 2, 3, 4, 6, 7]], low, b[:, [10, 11]], high, b[:, [14, 15, 16, 18, 19]]]
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1)])
    return BrickMesh(points, np.concatenate([np.hstack(one), np.hstack(two)]))


def _unit(vectors: FloatArray) -> FloatArray:
    result: FloatArray = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return result
