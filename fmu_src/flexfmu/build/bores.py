"""Bores of a mesh: cylindrical pieces of its surface that are seen from their axis."""

import numpy as np
import scipy.sparse as sp
from scipy.optimize import least_squares
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from ..reduction.options import Place
from ..reduction.surface import surface_nodes

# Faces whose normals differ by less belong to one smooth piece: coarse bores of eight elements have 45° between them.
_SMOOTH = np.cos(np.radians(50.0))
# Share of normals along the axis, which faces of tetrahedra have too, of those across it in the lesser direction, and
# share of the radius by which nodes miss it, up to which a piece is a cylinder.
_ALONG, _ACROSS, _ROUND = 0.15, 1e-2, 1e-2
# The widest gap as seen from the axis that no face spans, a keyway's or a slot's: more is a fillet or an open ring.
_GAP = np.radians(40.0)
_DIGITS = 9


def bores(mesh: Mesh) -> dict[str, Place]:
    """Bores by a name such as ``"bore_1"``.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    dict of str to Place
        Cylinders, the widest first.
    """
    nodes, faces = surface_nodes(mesh)
    points = mesh.points[nodes]
    corners = points[faces]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    # Triangles have their last corner twice.
    flat = faces[:, 2] == faces[:, 3]
    normal[flat] = np.cross(corners[flat, 1] - corners[flat, 0], corners[flat, 2] - corners[flat, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    piece = _smooth_pieces(faces, normal)
    found = [_bore(points, faces[piece == k], normal[piece == k]) for k in range(int(piece.max()) + 1)]
    places = sorted((place for place in found if place is not None), key=lambda place: -(place.radius or 0.0))
    return {f"bore_{k}": place for k, place in enumerate(places, start=1)}


def _smooth_pieces(faces: IntArray, normal: FloatArray) -> IntArray:
    """Piece (f,) that each face belongs to: connected over edges without a kink."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 4)
    real = edges[:, 0] != edges[:, 1]
    edges, owner = edges[real], owner[real]
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    same = np.flatnonzero(np.all(edges[1:] == edges[:-1], axis=1))
    first, second = owner[same], owner[same + 1]
    kept = np.einsum("ei,ei->e", normal[first], normal[second]) > _SMOOTH
    graph = sp.coo_array((np.ones(int(kept.sum())), (first[kept], second[kept])), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _bore(points: FloatArray, faces: IntArray, normal: FloatArray) -> Place | None:
    """The cylinder that a smooth piece of the surface is, if it is a bore."""
    values, turn = np.linalg.eigh(normal.T @ normal / len(normal))
    # A plane has one direction of normals only, a cylinder two.
    if values[0] > _ALONG or values[1] < _ACROSS:
        return None
    at = points[np.unique(faces)]
    turn = _axes(at, turn)
    axis, flat = turn[:, 0], at @ turn[:, 1:]
    x, y, radius = _circle(flat)
    arm = flat - [x, y]
    if np.abs(np.linalg.norm(arm, axis=1) - radius).max() > _ROUND * radius:
        return None
    angle = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
    gap = np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()
    towards = np.einsum("fi,fi->f", points[faces].mean(axis=1) @ turn[:, 1:] - [x, y], normal @ turn[:, 1:])
    chord = np.linalg.norm(np.ptp(points[faces] @ turn[:, 1:], axis=1), axis=1).max()
    span = 2.0 * np.arcsin(min(0.5 * chord / radius, 1.0))
    if gap > max(_GAP, span) + 1e-9 or not np.all(towards < 0.0):
        return None
    low, high = (at @ axis).min(), (at @ axis).max()
    # Adding zero takes the sign of −0.
    ends = [tuple(((turn[:, 1:] @ [x, y] + axis * along).round(_DIGITS) + 0.0).tolist()) for along in (low, high)]
    return Place(cylinder=(ends[0], ends[1]), radius=round(radius, _DIGITS))


def _axes(points: FloatArray, start: FloatArray) -> FloatArray:
    """Directions (3, 3) of a cylinder, its axis first, by points on it and directions nearby."""

    def turned(tilt: FloatArray) -> FloatArray:
        return Rotation.from_rotvec(start[:, 1:] @ tilt).as_matrix() @ start

    def missed(tilt: FloatArray) -> FloatArray:
        flat = points @ turned(tilt)[:, 1:]
        x, y, radius = _circle(flat)
        return np.hypot(*(flat - [x, y]).T) - radius

    return turned(least_squares(missed, np.zeros(2), xtol=1e-15, ftol=1e-15, gtol=1e-15).x)


def _circle(flat: FloatArray) -> tuple[float, float, float]:
    """Centre and radius of the circle that fits points (k, 2) best."""
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    return float(x), float(y), float(np.sqrt(max(rest + x * x + y * y, 0.0)))
