"""The elements whose material is watched: where it turns most within its frame, and how much it is strained.

Chosen at build from motions that a body may make: responses to unit loads, modes, and random sums of both.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..fe.layers import cells
from ..files.basics import FloatArray, IntArray
from ..mesh.model import Mesh
from .subdomains import Subdomain

# Elements a frame, and at least of the whole body: in nine motions of ten they find 0.99 of the largest rotation.
_ELEMENTS, _FEWEST = 12, 36
# Random sums of responses, and of modes; few of many count in each.
_SUMS, _SEED = 400, 20261122
# Patterns of strain.
_PATTERNS = 6
# Elements at a time.
_CHUNK = 2048


def watched_material(
    mesh: Mesh, shapes: FloatArray, omega: FloatArray, loads: FloatArray, subdomains: Sequence[Subdomain],
    frame_rotation: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray]:  # fmt: skip
    """Mean rotation of chosen elements, and root mean square strain of each material in each frame.

    Parameters
    ----------
    mesh : Mesh
    shapes : (3n, m) float
    omega : (m,) float
        rad/s; zero for rigid motions.
    loads : (3n, k) float
        Unit loads.
    subdomains : sequence of Subdomain
    frame_rotation : (S, 3, m) float

    Returns
    -------
    frame : (w,) int
    rotation : (w, 3, m) float
    strain : (v, 6, m) float
        As of `ReducedBody`.
    """
    phi = shapes.reshape(len(mesh.points), 3, -1)
    motions = _motions(omega, shapes.T @ loads)
    own = [(s, domain.elements) for s, domain in enumerate(subdomains) if domain.elements.size]
    groups = own or [(0, np.arange(mesh.element_count))]
    turned = frame_rotation if own else np.zeros((1, 3, len(omega)))
    found = [most_turned(mesh, phi, elements, turned[s], motions) for s, elements in groups]
    largest = np.max([most.max(axis=0) for _, most, _ in found], axis=0)
    # Some motions turn nothing.
    largest[largest == 0.0] = 1.0
    count = max(_ELEMENTS, _FEWEST // len(groups))
    chosen = [rotation[_greedy(most / largest, count)] for rotation, most, _ in found]
    frame = [np.full(len(rotation), s if own else -1) for (s, _), rotation in zip(groups, chosen, strict=True)]
    strain = [_patterns(square, motions) for _, _, squares in found for square in squares]
    return np.concatenate(frame), np.concatenate(chosen), np.array(strain)


def _motions(omega: FloatArray, forces: FloatArray) -> FloatArray:
    """Modal coordinates (m, k) of motions that a body may make, each of the same energy."""
    elastic = omega > 0.0
    stiffness = np.where(elastic, omega, np.inf)[:, None]
    # In coordinates whose square is the energy.
    static = forces / stiffness
    static = static[:, np.linalg.norm(static, axis=0) > 0.0]
    modes = np.diag(elastic / np.arange(1.0, omega.size + 1.0))[:, elastic]
    unit = static / np.linalg.norm(static, axis=0)
    random = np.random.default_rng(_SEED)
    sums = [basis @ random.standard_normal((basis.shape[1], _SUMS)) ** 3 for basis in (unit, modes) if basis.shape[1]]
    every = np.hstack([unit, modes, *sums])
    return every / np.linalg.norm(every, axis=0) / stiffness


def _gradients(mesh: Mesh, phi: FloatArray, elements: IntArray) -> Iterator[tuple[FloatArray, FloatArray, IntArray]]:
    """Displacement gradients (e, q, 3, 3, m) of elements, volumes (e, q), and materials (e,), some at a time."""
    for block, inside in mesh.by_block(elements):
        part = block.part(inside)
        for places, some in cells(mesh, part, _CHUNK):
            slope = some.gradient[:, :, : some.nodes.shape[1]]
            gradient = np.einsum("eaik,eqaJ->eqiJk", phi[some.nodes], slope, optimize=True)
            yield gradient, some.volume, part.material[places]


def most_turned(
    mesh: Mesh, phi: FloatArray, elements: IntArray, frame: FloatArray, motions: FloatArray
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Of elements that turn most in any motion the rotation (c, 3, m) less the frame's, and angles (c, k).

    And of each material in all of them the mean of |ε|² (m, m).
    """
    rotations, angles, sums = [], [], dict[int, tuple[FloatArray, float]]()
    for gradients, volume, material in _gradients(mesh, phi, elements):
        gradient = np.einsum("eq,eqiJk->eiJk", volume / volume.sum(axis=1)[:, None], gradients)
        rotation = 0.5 * np.stack([gradient[:, k, j] - gradient[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)
        angle = np.sqrt(np.einsum("eik,eik->ek", *[(rotation - frame) @ motions] * 2))
        rotations.append(rotation)
        angles.append(angle)
        strain = 0.5 * np.sqrt(volume)[:, :, None, None, None] * (gradients + gradients.swapaxes(2, 3))
        for kind in np.unique(material):
            rows = strain[material == kind].reshape(-1, strain.shape[-1])
            total, size = sums.get(kind, (0.0, 0.0))
            sums[kind] = total + rows.T @ rows, size + float(volume[material == kind].sum())
    rotation, angle = np.concatenate(rotations), np.concatenate(angles)
    kept = np.unique(angle.argmax(axis=0))
    return rotation[kept], angle[kept], [total / size for total, size in sums.values()]


def _greedy(share: FloatArray, count: int) -> IntArray:
    """Some of the candidates (c, k) so that the largest of theirs comes near the largest of all in every motion."""
    goal, chosen = share.max(axis=0), np.zeros(share.shape[1])
    picked: list[int] = []
    for _ in range(min(count, len(share))):
        picked.append(int((((goal - np.maximum(chosen, share)) ** 2) ** 2).sum(axis=1).argmin()))
        chosen = np.maximum(chosen, share[picked[-1]])
    return np.unique(picked)


def _patterns(square: FloatArray, motions: FloatArray) -> FloatArray:
    """Rows (6, m), (row·q)² adding up to q·`square` q: of its patterns those that count most in motions (m, k)."""
    values, vectors = np.linalg.eigh(square)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    patterns = np.linalg.svd(root @ motions, full_matrices=False)[0][:, :_PATTERNS]
    rows = np.zeros((_PATTERNS, len(square)))
    rows[: patterns.shape[1]] = patterns.T @ root
    return rows
