"""Mass of the deformed body as a polynomial of the slow coordinates (docs/theory.md, section 9).

M(q) − 1 to second order in q follows from the mass of the lumps on a fine tree of frames, once, at build time. That is

    M(q) = 1 + Σ_k (l_k·q + qᵀV_k q) U_k,                                                                      (13a)

a table of pairs of rates by coordinates and pairs of them, of low rank: the few combinations that matter are kept. What
further products would add tells how far the motion is off.
"""

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement as choices, permutations, product
from math import factorial, prod

import numpy as np

from ..core.library import Core
from ..files.basics import FloatArray, IntArray
from ..model.inertia import MassPolynomial
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from .compile import compile_program
from .mechanics import Turning, inertial_modes, turning_of

# Turns of frames in the differences of first, second and third order, rad, or displacement over the body's size: their
# error is its square, and round-off over its power.
_TURN = (1e-3, 1e-3, 2e-2)
# Turn at which orders are weighed against each other, rad; share of the largest combination, and of the mass, below
# which one is left out, and of both together below which a product beyond pairs of slow coordinates is.
_WEIGHED, _SMALL, _SMALL_PRODUCT = 0.3, 3e-3, 1e-3
# Coordinates that products of three are made of, and the last stiff one that goes with a slow one.
_CUBED, _CROSSED = 8, 30


def mass_polynomial(parts: Sequence[tuple[ReducedBody, FloatArray]]) -> MassPolynomial | None:
    """The polynomial of a body, or to second order of one that is joined of held parts.

    Parameters
    ----------
    parts : sequence of (ReducedBody, (m_p, m) float)
        With frames, lumps and second order; and their coordinates in those of the body.

    Returns
    -------
    MassPolynomial or None
        None where nothing of the mass changes, and of a body that slides without turning freely.
    """
    found = [(own, turn) for part, turn in parts if (own := _of_part(part)) is not None]
    if not found:
        return None
    if len(parts) == 1 and np.array_equal(found[0][1], np.eye(parts[0][0].mode_count)):
        return found[0][0]
    every = [(turn.T @ own.form @ turn, own.linear @ turn, turn.T @ own.square @ turn) for own, turn in found]
    return MassPolynomial(*(np.concatenate(arrays) for arrays in zip(*every, strict=True)))


def _of_part(body: ReducedBody) -> MassPolynomial | None:
    """The polynomial of a body: of one that slides its mass about its centre, and where that is.

    Stiff coordinates enter to first order, so that they are stretched by what turns and swings.
    """
    rigid, count, turning = body.rigid_count, inertial_modes(body, True), turning_of(body)
    if rigid and turning is None:
        return None
    omega, (whole, turn) = body.angular_frequency[rigid:], np.split(_largest_turn(body), [rigid])
    known, further = _products(inertial_modes(body) - rigid, omega.size, bool(rigid))
    # What hardly moves the lumps is taken as far as the softest motion's energy takes it.
    found = _derivatives(body, 1.0 / np.maximum(turn, turn[0] * omega / omega[0]), turning, known + further)
    mass, centre = found[:, : count * count].reshape(-1, count, count), found[: len(known), count * count :].T
    first, second = np.triu_indices(count)
    # Coordinates and rates of equal energy, the former at a reference turn, and a spin of the first frequency; a pair
    # stands for both halves.
    coordinate = _WEIGHED * omega[0] / turn[0] / omega
    rate = np.concatenate([turn[0] / _WEIGHED / whole, omega[0] / omega])
    rates = np.where(first == second, 1.0, np.sqrt(2.0)) * rate[first] * rate[second]
    alike = np.array([len({*permutations(one)}) for one in known + further])
    sizes = np.sqrt(alike) * [prod(coordinate[list(one)]) for one in known + further]
    table, plain = mass[:, first, second].T * sizes * rates[:, None], len(known)
    # A stiff mode's mass may change by many times itself; the slow ones' counts beside it.
    kept = np.linalg.norm(table, axis=0) > _SMALL_PRODUCT * min(1.0, float(np.linalg.norm(table[:, :plain], 2)))
    kept |= np.arange(kept.size) < plain
    forms, strength, values = np.linalg.svd(table[:, kept], full_matrices=False)
    if not strength[0] > 0.0:
        return None
    large = strength > _SMALL * min(1.0, strength[0])
    linear, square, more = np.split(strength[large, None] * values[large] / sizes[kept], [omega.size, plain], axis=1)
    m, both, lead = body.mode_count, [*(rigid + np.array(known[omega.size :]).T)], ((0, 0), (rigid, 0))
    terms = _symmetric(forms.T[large] / rates, m, (first, second)), np.pad(linear, lead), _symmetric(square, m, both)
    if centre.size:
        moved, squared = np.split(centre, [omega.size], axis=1)
        return MassPolynomial(*terms, np.pad(moved, lead), _symmetric(squared, m, both))
    seen = [further[k] for k in np.flatnonzero(kept[plain:])]
    factor = np.array([(one[0], known.index(one[1:])) for one in seen], dtype=np.int64).reshape(-1, 2)
    return MassPolynomial(*terms, factor=factor, further=more * alike[kept][plain:])


def _symmetric(values: FloatArray, modes: int, places: Sequence[IntArray]) -> FloatArray:
    """Symmetric matrices (n, m, m) with values (n, k) in rows and columns (2, k)."""
    result = np.zeros((len(values), modes, modes))
    result[:, places[0], places[1]] = result[:, places[1], places[0]] = values
    return result


def _largest_turn(body: ReducedBody) -> FloatArray:
    """Rotation of frames per unit coordinate (m), or displacement over the body's size where it stretches alone."""
    turn: FloatArray = np.linalg.norm(body.frame_rotation, axis=1).max(axis=0)
    if body.inertia is not None and (size := float(np.linalg.norm(np.ptp(body.inertia.point, axis=0)))) > 0.0:
        turn = np.maximum(turn, np.linalg.norm(body.inertia.displacement, axis=1).max(axis=0) / size)
    return turn


def _products(slow: int, count: int, rigid: bool) -> tuple[list[tuple[int, ...]], list[tuple[int, ...]]]:
    """Coordinates and pairs of slow ones; products beyond of held bodies: a slow and a stiff one, three slow ones."""
    known = [*((j,) for j in range(count)), *choices(range(slow), 2)]
    mixed = product(range(slow), range(slow, min(count, _CROSSED)))
    return known, [] if rigid else [*mixed, *choices(range(min(slow, _CUBED)), 3)]


def _derivatives(body: ReducedBody, size: FloatArray, turning: Turning | None, of: list[tuple[int, ...]]) -> FloatArray:
    """Of the mass (r, r) of the lumps, row by row, by each product of coordinates, over the factorial of its order.

    Of a body that slides, of the mass about its centre, and three numbers more: of that centre, seen from the root.
    """
    found, each_way, result = _lumps_mass(body, turning), np.diag(size), []
    for one in of:
        ways = _TURN[len(one) - 1] * each_way[list(one)]
        # What is linear in each of the ways is left of this sum.
        signs = list(product((1.0, -1.0), repeat=len(one)))
        whole = sum(prod(each) * found(np.array(each) @ ways) for each in signs)
        result.append(whole / (len(signs) * factorial(len(one)) * prod(ways.sum(axis=1))))
    return np.array(result)


def _lumps_mass(body: ReducedBody, turning: Turning | None) -> Callable[[FloatArray], FloatArray]:
    """From elastic coordinates to the mass of the lumps, row by row, and the centre where it slides."""
    rigid, core = body.rigid_count, Core(compile_program(body, Method.SECOND_ORDER, Mass.CONFIGURATION))
    count, slides = inertial_modes(body, True), turning is not None and turning.slides

    def found(way: FloatArray) -> FloatArray:
        mass: FloatArray = core.mass(np.concatenate([np.zeros(rigid), way]))[:count, :count]
        if turning is None or not slides:
            return mass.ravel()
        push = mass[:, :rigid] @ turning.coordinates
        total = push[:rigid, 0] @ turning.coordinates[:, 0]
        # What the root's displacement feels of its turns: m (e_b × c)_a.
        moment = turning.coordinates[:, :3].T @ push[:rigid, 3:] / total
        mass = mass - push[:, :3] @ push[:, :3].T / total
        return np.concatenate([mass.ravel(), [moment[1, 2], moment[2, 0], moment[0, 1]]])

    return found
