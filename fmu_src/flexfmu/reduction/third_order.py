"""Energy of what the tree's places miss at third order (docs/theory.md, section 7a).

A body's places are right to second order. What they miss at third order works on its loads: that is a quartic form of
the coordinates. A shadow that has it as energy moves by what the body misses.
"""

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement

import numpy as np

from ..files.basics import FloatArray, IntArray
from ..model.reduced_body import ReducedBody
from ..model.rotations import skew


def third_order_motion(body: ReducedBody, motions: FloatArray, amplitudes: FloatArray) -> FloatArray:
    """Displacements and rotation vectors of the interfaces at third order, (4) to (6) with (19) and (20).

    Parameters
    ----------
    body : ReducedBody
        With second order, without rigid motions.
    motions : (r, m) float
        Modal coordinates.
    amplitudes : (k, r) float
        Of the motions in each sample.

    Returns
    -------
    (k, I, 6) float
        m and rad.
    """
    assert body.second is not None
    parents, frames = np.concatenate([body.frame_parent, body.interface_frame]), body.frame_count
    points = np.concatenate([body.joint_point, body.interface_point])
    moved = (body.joint_displacement, body.interface_displacement), (body.frame_rotation, body.interface_rotation)
    linear = np.stack([np.concatenate(both) for both in moved])
    bent = np.stack([body.second.displacement, body.second.rotation])[:, : len(points)]
    products = 0.5 * np.einsum("ka,kb->kab", amplitudes, amplitudes).reshape(len(amplitudes), -1)

    def squared(forms: FloatArray) -> FloatArray:
        # The few motions come first: of all coordinates there are many more pairs.
        return np.tensordot(products, (motions @ forms @ motions.T).reshape(*forms.shape[:-2], -1), (1, -1))

    q, second = amplitudes @ motions, squared(bent)
    if body.membrane is not None:
        second += np.tensordot(squared(body.membrane.shift(body.angular_frequency**2)), linear, (1, -1))
    # By displacement and rotation, sample and node.
    (u, turn), (w, more) = (part.swapaxes(0, 1) for part in (np.tensordot(q, linear, (1, -1)), second))
    result, spin = np.zeros(u.shape), np.zeros((*u.shape, 3))
    for node, parent in enumerate(parents.tolist()):
        relative, half = skew(turn[:, node]), skew(more[:, node])
        if parent >= 0:
            arm, hat = points[node] - points[parent], skew(turn[:, parent])
            curl = skew(more[:, parent]) + 0.5 * hat @ hat
            offset = u[:, node] - u[:, parent] - hat @ arm
            bend = w[:, node] - w[:, parent] - curl @ arm - _times(hat, offset)
            result[:, node] = result[:, parent] + spin[:, parent] @ arm + _times(curl, offset) + _times(hat, bend)
            relative = relative - hat
            half = half - skew(more[:, parent] + 0.5 * _times(hat, turn[:, node]))
            spin[:, node] = spin[:, parent] + curl @ relative + hat @ (half + 0.5 * relative @ relative)
        spin[:, node] += 0.5 * (relative @ half + half @ relative) + relative @ relative @ relative / 6.0
    hat, half = skew(turn[:, frames:]), skew(more[:, frames:])
    log = spin[:, frames:] - 0.5 * (hat @ half + half @ hat) - hat @ hat @ hat / 6.0
    return np.concatenate([result[:, frames:], log[..., [2, 0, 1], [1, 2, 0]]], axis=2)


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.einsum("kij,kj->ki", matrices, vectors)


def lever_sums(loads: FloatArray, fields: FloatArray) -> FloatArray:
    """Σ x μᵀ (k, I, 3, 3, 3) of fields x (k, n, 3) over the nodal forces μ of unit moments (3n, 3I), axis by axis."""
    return np.einsum("kna,nbic->kicab", fields, loads.reshape(fields.shape[1], 3, -1, 3), optimize=True)


def fitted_motion(turned: FloatArray, still: FloatArray, moved: FloatArray, off: FloatArray) -> FloatArray:
    """Third order of points, and of rotation vectors whose turn, taken back, leaves a section none of (3).

    Parameters
    ----------
    turned : (k, I, 3) float
        Linear rotations.
    still, moved : (k or 1, I, 3, 3, 3) float
        `lever_sums` of places and of displacements.
    off : (I, 3) float
        How far points lie off the centres of their nodes, which carry them.

    Returns
    -------
    (k, I, 6) float
        m and rad.
    """

    def read(turn: FloatArray, sums: FloatArray) -> FloatArray:
        return np.trace(turn[:, :, None] @ sums, axis1=-2, axis2=-1)

    hat = skew(turned)
    more = skew(read(0.5 * hat @ hat, still) - read(hat, moved))
    both, cubed = 0.5 * (more @ hat + hat @ more), hat @ hat @ hat / 6.0
    third = read(0.5 * hat @ hat - more, moved) + read(both - cubed, still)
    return np.concatenate([((skew(third) + both + cubed) @ off[..., None])[..., 0], third], axis=-1)


def turning_forces(
    loads: FloatArray, acting: FloatArray, turned: FloatArray, still: FloatArray, moved: FloatArray, off: FloatArray
) -> FloatArray:
    """Gradient (3n, r, r) of the work of loads on points and rotation vectors of second order, by motions of both.

    Parameters
    ----------
    loads : (3n, 3I) float
        Nodal forces of unit moments.
    acting : (r, I, 6) float
        Forces and moments that cause motions.
    turned : (r, I, 3) float
        Linear rotations by them.
    still, moved : (1, I, 3, 3, 3) and (r, I, 3, 3, 3) float
        As of `fitted_motion`.
    off : (I, 3) float
        Likewise.
    """
    pulls, moments = acting[:, None, :, :3], acting[..., 3:] + np.cross(off, acting[..., :3])
    force, hat = loads.reshape(len(loads) // 3, 3, -1, 3), skew(turned)
    own = np.einsum("icxy,aic->aixy", still[0], moments)[:, None]
    sums = 0.5 * (hat @ own + own @ hat) - np.einsum("bicxy,aic->abixy", moved, moments)
    about = (sums - sums.swapaxes(-2, -1))[..., [1, 2, 0], [2, 0, 1]]
    about += 0.5 * (np.cross(np.cross(turned, off), pulls) + np.cross(off, np.cross(pulls, turned)))
    result = np.einsum("bixy,nyic,aic->nxab", hat, force, moments, optimize=True)
    return (result + np.einsum("nxic,abic->nxab", force, about)).reshape(len(loads), len(turned), -1)


def missed_energy(
    body: ReducedBody, motions: FloatArray, loads: FloatArray, stiff: int, alone: int, sums: Sequence[FloatArray],
    work: FloatArray, least: float, springs: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Quartic form by which the work of loads on the tree's places exceeds that on those of the finite element model.

    Parameters
    ----------
    body : ReducedBody
    motions : (r, m) float
        Modal coordinates of static responses.
    loads : (r, 6 I + s) float
        Forces and moments on the interfaces that cause them, N and N m, and pulls of springs.
    stiff, alone : int
        How many of the first ones count by their first power, and how many of these by themselves, too.
    sums : (1, I, 3, 3, 3), (r, I, 3, 3, 3) and (I, 3) float
        `lever_sums` of places and of motions, and how far points are off their nodes.
    work : (p, p) float
        Of the loads on the model's displacements of third order, by pairs of motions, J.
    least : float
        Energy up to which a form is left out, J.
    springs : callable
        Takes amplitudes (r, k). What springs of the finite element model read at third order (k, s).

    Returns
    -------
    forms : (k, r, r) float
        In the motions' amplitudes, J^½.
    signs : (k,) float
        Of their squares, which add up to the energy.
    """
    count, turns = len(motions), motions @ body.interface_rotation.swapaxes(1, 2)

    def cubic(*several: IntArray) -> FloatArray:
        """Third orders (k, l) in sums of motions (k,)."""
        amplitudes = np.sum([np.eye(count)[one] for one in several], axis=0)
        third, moved = third_order_motion(body, motions, amplitudes), np.tensordot(amplitudes, sums[1], 1)
        third -= fitted_motion(np.tensordot(amplitudes, turns, (1, 1)), sums[0], moved, sums[2])
        return np.hstack([third.reshape(len(third), -1), springs(amplitudes.T)])

    # A cubic form follows from what it is of sums of three motions; equations of quartic terms would be thousands.
    a, b, c = np.array([t for t in combinations_with_replacement(range(count), 3) if t[1] >= stiff or t[2] < alone]).T
    one, two = cubic(np.arange(count)), cubic(*np.indices((count, count)).reshape(2, -1)).reshape(count, count, -1)
    found = cubic(a, b, c) - two[a, b] - two[a, c] - two[b, c] + one[a] + one[b] + one[c]
    found /= ((1 + (a == b)) * (1 + (b == c) * (1 + (a == b))))[:, None]
    every = np.stack([each.ravel() for each in np.broadcast_arrays(np.arange(count)[:, None], a, b, c)], axis=-1)
    pairs, places = np.array(list(combinations_with_replacement(range(count), 2))), count ** np.arange(4)
    four = np.sort(np.concatenate(np.broadcast_arrays(pairs[:, None], pairs), axis=2), axis=2)
    terms, which, times = np.unique(four @ places, return_inverse=True, return_counts=True)
    energy = np.bincount(np.searchsorted(terms, np.sort(every) @ places), (loads @ found.T).ravel(), len(terms))
    energy -= np.bincount(which.ravel(), work.ravel(), len(terms))
    mixed = (four[..., 1] < stiff) & (four[..., 3] >= alone)
    # Equal parts go to all products of two pairs that make a term.
    values, vectors = np.linalg.eigh(np.where(mixed, 0.0, (energy / times)[which.reshape(work.shape)]))
    kept = np.abs(values) > least
    forms = np.zeros((kept.sum(), count, count))
    half = 0.5 * vectors[:, kept].T * np.sqrt(np.abs(values[kept]))[:, None]
    forms[:, pairs[:, 0], pairs[:, 1]] = half
    forms[:, pairs[:, 1], pairs[:, 0]] += half
    return forms, np.sign(values[kept])
