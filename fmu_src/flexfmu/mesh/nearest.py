"""The nearest places on faces."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..files.basics import FloatArray, IntArray
from .elements import face_corners
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
