"""Mass of the deformed body as a polynomial of the slow coordinates (docs/theory.md, section 9).

M(q) − 1 to second order in q follows from the mass of the lumps on a fine tree of frames, once, at build time. That is

    M(q) = 1 + Σ_k (l_k·q + qᵀV_k q) U_k,                                                                      (13a)

a table of pairs of rates by coordinates and pairs of them, of low rank: the few combinations that matter are kept.
"""

from collections.abc import Sequence

import numpy as np

from ..core.library import Core
from ..files.array_types import FloatArray
from ..model.inertia import MassPolynomial
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from .compile import compile_program
from .mechanics import inertial_modes

# Largest turn of a frame in the differences, rad, or displacement over the body's size: their error is its square, and
# round-off over it.
_TURN = 1e-3
# Turn at which first and second order are weighed against each other, rad, and share of the largest combination below
# which one is left out.
_WEIGHED, _SMALL = 0.3, 3e-3


def mass_polynomial(parts: Sequence[tuple[ReducedBody, FloatArray]]) -> MassPolynomial | None:
    """The polynomial of a held body, or of one that is joined of held parts.

    Parameters
    ----------
    parts : sequence of (ReducedBody, (m_p, m) float)
        With frames, lumps and second order, and without rigid motions; and their coordinates in those of the body.

    Returns
    -------
    MassPolynomial or None
        None where nothing of the mass changes.
    """
    found = [(own, turn) for part, turn in parts if (own := _of_part(part)) is not None]
    if not found:
        return None
    every = [(turn.T @ own.form @ turn, own.linear @ turn, turn.T @ own.square @ turn) for own, turn in found]
    return MassPolynomial(*(np.concatenate(arrays) for arrays in zip(*every, strict=True)))


def _of_part(body: ReducedBody) -> MassPolynomial | None:
    """The polynomial of a held body, or none where nothing of the mass changes."""
    count, modes = inertial_modes(body), body.mode_count
    turn = _largest_turn(body)[:count]
    linear, quadratic = _differences(body, _TURN / turn)
    first, second = np.triu_indices(count)
    # Coordinates and rates of equal energy, the former at a reference turn; a pair stands for both halves.
    omega = body.angular_frequency[:count]
    coordinate, rate = _WEIGHED * omega[0] / turn[0] / omega, omega[0] / omega
    both = np.where(first == second, 1.0, np.sqrt(2.0))
    rates, places = both * rate[first] * rate[second], both * coordinate[first] * coordinate[second]
    by_pair = quadratic[first, second][:, first, second].T
    table = np.hstack([linear[:, first, second].T * coordinate, by_pair * places])
    forms, strength, values = np.linalg.svd(table * rates[:, None], full_matrices=False)
    kept = strength > _SMALL * strength[0]
    if not strength[0] > 0.0:
        return None

    def matrices(pairs: FloatArray) -> FloatArray:
        result = np.zeros((len(pairs), modes, modes))
        result[:, first, second] = result[:, second, first] = pairs
        return result

    ahead = np.zeros((int(kept.sum()), modes))
    values = strength[kept, None] * values[kept]
    ahead[:, :count] = values[:, :count] / coordinate
    return MassPolynomial(matrices(forms.T[kept] / rates), ahead, matrices(values[:, count:] / places))


def _largest_turn(body: ReducedBody) -> FloatArray:
    """Rotation of frames per unit coordinate (m), or displacement over the body's size where it stretches alone."""
    turn: FloatArray = np.linalg.norm(body.frame_rotation, axis=1).max(axis=0)
    if body.inertia is not None and (size := float(np.linalg.norm(np.ptp(body.inertia.point, axis=0)))) > 0.0:
        turn = np.maximum(turn, np.linalg.norm(body.inertia.displacement, axis=1).max(axis=0) / size)
    return turn


def _differences(body: ReducedBody, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First (r, r, r) and half the second derivatives (r, r, r, r) of the mass of the lumps; coordinates come first."""
    count, core = size.size, Core(compile_program(body, Method.SECOND_ORDER, Mass.CONFIGURATION))

    def mass(way: FloatArray) -> FloatArray:
        result: FloatArray = core.mass(np.concatenate([way, np.zeros(body.mode_count - count)]))[:count, :count]
        return result

    def even(way: FloatArray) -> FloatArray:
        return 0.5 * (mass(way) + mass(-way)) - still

    still, ways = mass(np.zeros(count)), np.diag(size)
    linear = np.array([(mass(way) - mass(-way)) / (2.0 * step) for way, step in zip(ways, size, strict=True)])
    alone = np.array([even(way) for way in ways])
    quadratic = np.empty((count,) * 4)
    for a in range(count):
        quadratic[a, a] = alone[a] / size[a] ** 2
        for b in range(a):
            mixed = 0.5 * (even(ways[a] + ways[b]) - alone[a] - alone[b])
            quadratic[a, b] = quadratic[b, a] = mixed / (size[a] * size[b])
    return linear, quadratic
