"""The nearest places on faces; and ties to shells.

Tied points move as the places of a shell's body, or of what goes on from it, that they are in.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..files.basics import FloatArray, IntArray, MeshError
from .elements import face_corners
from .equations import Row, moved_by
from .shapes import FACE_SHAPES

# Rounds and step, in a face's own coordinates, with which the nearest place on it is found.
_ROUNDS, _SETTLED = 20, 1e-12
# Weights below this are round-off: the node lies on an edge or on a node of the face.
_NO_WEIGHT = 1e-9


def weighted(face: Sequence[int], value: FloatArray) -> dict[int, float]:
    """Shape functions at a place of a face by its nodes, without round-off."""
    return {int(node): float(w) for node, w in zip(face, value, strict=True) if abs(w) > _NO_WEIGHT}


def nearest_faces(
    points: FloatArray, nodes: IntArray, faces: Sequence[IntArray], near: float
) -> dict[int, tuple[tuple[int, ...], FloatArray]]:
    """Return where on faces nodes lie.

    Parameters
    ----------
    points : (n, 3) float
    nodes : (k,) int
    faces : sequence of (f, a) int
    near : float
        Greatest distance.

    Returns
    -------
    dict of int to (tuple of int, (a,) float)
        Nodes of the face and their shape functions at the nearest place, by node; those farther away are left out.
    """
    # Its import takes a tenth of a second.
    from scipy.spatial import cKDTree

    best: dict[int, tuple[float, tuple[int, ...], FloatArray]] = {}
    for block in faces if len(nodes) else ():
        centre = points[block].mean(axis=1)
        reach = float(np.linalg.norm(points[block] - centre[:, None], axis=2).max()) + near
        inside = cKDTree(centre).query_ball_point(points[nodes], reach * (1.0 + _NO_WEIGHT))
        pairs = [(node, face) for node, found in zip(nodes.tolist(), inside, strict=True) for face in found]
        if not pairs:
            continue
        node, face = np.array(pairs).T
        value, distance = _projected(points[node], points[block[face]], face_corners(block))
        for k in np.flatnonzero(distance <= near).tolist():
            if node[k] not in best or distance[k] < best[node[k]][0]:
                best[int(node[k])] = (float(distance[k]), tuple(block[face[k]].tolist()), value[k])
    return {node: best[node][1:] for node in sorted(best)}


def _projected(targets: FloatArray, nodes: FloatArray, corners: int) -> tuple[FloatArray, FloatArray]:
    """Shape functions (p, a) at the places of faces (p, a, 3) nearest to targets (p, 3), and the distances (p,)."""
    shape = FACE_SHAPES[nodes.shape[1]]
    place = np.full((len(nodes), 2), 0.0 if corners == 4 else 1.0 / 3.0)
    for _ in range(_ROUNDS):
        value, slope = shape.value(place), shape.gradient(place)
        gap = targets - np.einsum("pa,pai->pi", value, nodes)
        tangent = np.einsum("pab,pai->pib", slope, nodes)
        normal = np.einsum("pib,pic->pbc", tangent, tangent)
        step = np.linalg.solve(normal, np.einsum("pib,pi->pb", tangent, gap)[..., None])[..., 0]
        before, place = place, _inside(place + step, corners)
        if np.abs(place - before).max() < _SETTLED:
            break
    value = shape.value(place)
    return value, np.linalg.norm(targets - np.einsum("pa,pai->pi", value, nodes), axis=1)


def _inside(place: FloatArray, corners: int) -> FloatArray:
    """Places moved into the face where they lie beside it."""
    if corners == 4:
        return np.clip(place, -1.0, 1.0)
    area = np.column_stack([1.0 - place.sum(axis=1), place])
    area = np.maximum(area, 0.0)
    return (area / area.sum(axis=1, keepdims=True))[:, 1:]


# Rounds and step with which a place is found, and how far outside of the element it may be, in its own coordinates.
_MOST_ROUNDS, _OUTSIDE = 30, 4.0
# How far beside the faces that hold it an edge's end may lie, over the thickness.
_BESIDE = 0.05


class ShellTie(NamedTuple):
    """A node, and the nodes of the shell that it is tied to."""

    node: int
    face: tuple[int, ...]


class EdgeTie(NamedTuple):
    """A node at a shell's edge, and faces of solids (f, a) that its line lies on."""

    node: int
    faces: tuple[IntArray, ...]


OfShell = ShellTie | EdgeTie
"""A tie of either kind."""


def tie_rows(
    ties: Sequence[OfShell], points: FloatArray, own: Callable[[int], IntArray], lines: Callable[[int], IntArray]
) -> list[Row]:
    """Equations by which points are carried.

    Beside the node's own place a point follows the turn of the shell's lines there, not the slope of its middle: of a
    plate that stands on another the joint bends as one.

    Parameters
    ----------
    ties : sequence of ShellTie or EdgeTie
        Nodes of faces are points already.
    points : (n, 3) float
        Ends of lines among them.
    own : callable
        Points (k,) that a node is.
    lines : callable
        Lower and upper end (l, 2) of the lines of a shell's node.

    Returns
    -------
    list of dict of int to float
        By unknowns.
    """
    found: list[Row] = []
    for tie in ties:
        if isinstance(tie, EdgeTie):
            found += _held(own(tie.node), tie.faces, points)
            continue
        node, face = tie
        ends, corners = _ends(face, points, lines), face_corners(np.array([face]))
        middle = points[own(node)].mean(axis=0)
        for row in own(node).tolist():
            found += _carried(row, ends, points, middle, corners)
    return found


def _held(rows: IntArray, faces: Sequence[IntArray], points: FloatArray) -> Iterator[Row]:
    """Three equations of each point of a line through a shell's thickness by faces of solids."""
    middle = points[rows].mean(axis=0)
    for row, one in nearest_faces(points, rows, faces, np.inf).items():
        weights = weighted(*one)
        beside, half = points[row] - sum(part * points[node] for node, part in weights.items()), points[row] - middle
        if abs(beside @ half) > 2.0 * _BESIDE * (half @ half):
            found = f"a shell's edge at {np.array2string(middle, precision=4)} m is thicker than the faces that hold it"
            raise MeshError(f"{found}: name all faces of the solid there")
        yield from moved_by(row, weights)


def _carried(row: int, ends: IntArray, points: FloatArray, mid: FloatArray, corners: int) -> Iterator[Row]:
    """Three equations of a point by the ends (a, 2) of a shell's lines; `mid` is where its node is."""
    there = points[ends]
    here, _ = _place(mid, there, corners)
    value, share = _place(points[row], there, corners)
    sides = np.array([1.0 - share, share])
    thick = np.linalg.norm(there[:, 1] - there[:, 0], axis=1)
    normal = here @ (there[:, 1] - there[:, 0])
    normal /= np.linalg.norm(normal)
    across = np.outer(normal, normal)
    turn = np.outer(normal, ((value - here) @ np.einsum("s,asi->ai", sides, there))) / thick[:, None, None]
    # By node, end, and directions of the point and of the end.
    weight = (value[:, None, None] * (np.eye(3) - across) + here[:, None, None] * across)[:, None]
    weight = weight * sides[:, None, None] + (here[:, None, None] * turn)[:, None] * np.array([[[1.0]], [[-1.0]]])
    for axis in range(3):
        keys = (3 * ends[:, :, None] + np.arange(3)).ravel().tolist()
        yield {3 * row + axis: -1.0} | dict(zip(keys, weight[:, :, axis].ravel().tolist(), strict=True))


def _ends(face: Sequence[int], points: FloatArray, lines: Callable[[int], IntArray]) -> IntArray:
    """Ends (a, 2) of the lines of a shell's nodes that run through it, on the same sides."""
    every = [lines(node) for node in face]
    middle = points[np.array([one[0] for one in every])].mean(axis=1)
    normal = np.cross(middle[1] - middle[0], middle[2] - middle[0])
    found = []
    for one in every:
        along = (points[one[:, 1]] - points[one[:, 0]]) @ normal
        best = int(np.abs(along).argmax())
        found.append(one[best] if along[best] > 0.0 else one[best, ::-1])
    return np.array(found)


def _place(target: FloatArray, ends: FloatArray, corners: int) -> tuple[FloatArray, float]:
    """Shape functions (a,) and share of the upper ends at the place of a shell (a, 2, 3) that is a point."""
    shape = FACE_SHAPES[len(ends)]
    low, thick = ends[:, 0], ends[:, 1] - ends[:, 0]
    place, share = np.full((1, 2), 0.0 if corners == 4 else 1.0 / 3.0), 0.5
    for _ in range(_MOST_ROUNDS):
        value, slope = shape.value(place)[0], shape.gradient(place)[0]
        at = low + share * thick
        step = np.linalg.solve(np.column_stack([at.T @ slope, value @ thick]), target - value @ at)
        place, share = place + step[:2], share + float(step[2])
        if np.abs(step).max() < _SETTLED:
            break
    if not np.abs(place).max() < _OUTSIDE:
        found = f"*TIE: a point at {np.array2string(target, precision=4)} m is none that the shell beside it can carry"
        raise MeshError(f"{found}: it is bent too much there; mesh it finer, or let both share nodes")
    return shape.value(place)[0], share
