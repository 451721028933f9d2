"""Mass of the deformed body as a polynomial of the slow coordinates (docs/theory.md, section 9).

M(q) − 1 to second order in q follows from the mass of the lumps on a fine tree of frames, once, at build time. That is

    M(q) = 1 + Σ_k (l_k·q + qᵀV_k q) U_k,                                                                      (13a)

a table of pairs of rates by coordinates and pairs of them, of low rank: the few combinations that matter are kept. What
further products would add tells how far the motion is off.
"""

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement, product
from math import factorial, prod

import numpy as np

from ..core.library import Core
from ..files.array_types import FloatArray, IntArray
from ..model.inertia import MassPolynomial
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from .compile import compile_program
from .mechanics import Turning, inertial_modes, turning_of

# Turns of frames in the differences of first, second and third order, rad, or displacement over the body's size: their
# error is its square, and round-off over its power.
_TURN = (1e-3, 1e-3, 2e-2)
# Turn at which orders are weighed against each other, rad, and share of the largest combination below which one is left
# out, and of the whole below which a product beyond pairs of slow coordinates is.
_WEIGHED, _SMALL, _SMALL_PRODUCT = 0.3, 3e-3, 1e-3
# Coordinates that products of three are made of, and the last stiff one that goes with a slow one.
_CUBED, _CROSSED = 8, 30
_Product = tuple[int, ...]


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
    rigid, count = body.rigid_count, inertial_modes(body)
    turning = turning_of(body)
    if rigid and turning is None:
        return None
    whole, turn = np.split(_largest_turn(body), [rigid])
    omega = body.angular_frequency[rigid:]
    known, further = _products(count - rigid, omega.size, bool(rigid))
    # What hardly moves the lumps is taken as far as the softest motion's energy takes it.
    found = _derivatives(body, 1.0 / np.maximum(turn, turn[0] * omega / omega[0]), turning, known + further)
    mass, centre = found[:, : count * count].reshape(-1, count, count), found[: len(known), count * count :].T
    first, second = np.triu_indices(count)
    # Coordinates and rates of equal energy, the former at a reference turn, and a spin of the first frequency; a pair
    # stands for both halves.
    coordinate = _WEIGHED * omega[0] / turn[0] / omega
    rate = np.concatenate([turn[0] / _WEIGHED / whole, omega[0] / omega])
    rates = np.where(first == second, 1.0, np.sqrt(2.0)) * rate[first] * rate[second]
    alike = np.array([_alike(one) for one in known + further])
    sizes = np.sqrt(alike) * [prod(coordinate[list(one)]) for one in known + further]
    table, second_order = mass[:, first, second].T * sizes * rates[:, None], len(known)
    kept = np.linalg.norm(table, axis=0) > _SMALL_PRODUCT * np.linalg.norm(table[:, :second_order], 2)
    kept[:second_order] = True
    forms, strength, values = np.linalg.svd(table[:, kept], full_matrices=False)
    if not strength[0] > 0.0:
        return None
    large = strength > _SMALL * strength[0]
    values = strength[large, None] * values[large] / sizes[kept]
    linear, square, more = np.split(values, [omega.size, second_order], axis=1)
    one, other = rigid + np.array(known[omega.size :]).T
    terms = (
        _symmetric(forms.T[large] / rates, body.mode_count, first, second),
        np.pad(linear, ((0, 0), (rigid, 0))),
        _symmetric(square, body.mode_count, one, other),
    )
    if centre.size:
        moved, squared = np.split(centre, [omega.size], axis=1)
        seen_from_root = np.pad(moved, ((0, 0), (rigid, 0))), _symmetric(squared, body.mode_count, one, other)
        return MassPolynomial(*terms, *seen_from_root)
    # The first of a product of two is none.
    chosen = [(-1, *each)[-3:] for each, seen in zip(further, kept[second_order:], strict=True) if seen]
    product_of = np.array(chosen, dtype=np.int64).reshape(-1, 3)
    return MassPolynomial(*terms, product=product_of, further=more * alike[kept][second_order:])


def _symmetric(values: FloatArray, modes: int, a: IntArray, b: IntArray) -> FloatArray:
    """Symmetric matrices (n, m, m) with values (n, k) in rows a and columns b, (k,)."""
    result = np.zeros((len(values), modes, modes))
    result[:, a, b] = result[:, b, a] = values
    return result


def _largest_turn(body: ReducedBody) -> FloatArray:
    """Rotation of frames per unit coordinate (m), or displacement over the body's size where it stretches alone."""
    turn: FloatArray = np.linalg.norm(body.frame_rotation, axis=1).max(axis=0)
    if body.inertia is not None and (size := float(np.linalg.norm(np.ptp(body.inertia.point, axis=0)))) > 0.0:
        turn = np.maximum(turn, np.linalg.norm(body.inertia.displacement, axis=1).max(axis=0) / size)
    return turn


def _products(slow: int, count: int, rigid: bool) -> tuple[list[_Product], list[_Product]]:
    """Coordinates and pairs of slow ones; products beyond of held bodies: a slow and a stiff one, three slow ones."""
    pairs, stiff = combinations_with_replacement(range(slow), 2), range(slow, min(count, _CROSSED))
    three = combinations_with_replacement(range(min(slow, _CUBED)), 3)
    return [*((j,) for j in range(count)), *pairs], [] if rigid else [*product(range(slow), stiff), *three]


def _alike(one: _Product) -> int:
    """How many orders its factors may stand in."""
    return factorial(len(one)) // prod(factorial(one.count(j)) for j in set(one))


def _derivatives(
    body: ReducedBody, size: FloatArray, turning: Turning | None, products: Sequence[_Product]
) -> FloatArray:
    """Of the mass (r, r) of the lumps, row by row, by each product of coordinates, over the factorial of its order.

    Of a body that slides, of the mass about its centre, and three numbers more: of that centre, seen from the root.
    """
    found, result = _lumps_mass(body, turning), []
    for one in products:
        ways = np.zeros((len(one), size.size))
        ways[np.arange(len(one)), one] = _TURN[len(one) - 1] * size[list(one)]
        # What is linear in each of the ways is left of this sum.
        signs = list(product((1.0, -1.0), repeat=len(one)))
        whole = sum(prod(each) * found(np.array(each) @ ways) for each in signs)
        result.append(whole / (len(signs) * factorial(len(one)) * prod(ways.sum(axis=1))))
    return np.array(result)


def _lumps_mass(body: ReducedBody, turning: Turning | None) -> Callable[[FloatArray], FloatArray]:
    """From elastic coordinates to the mass of the lumps, row by row, and the centre where it slides."""
    rigid, core = body.rigid_count, Core(compile_program(body, Method.SECOND_ORDER, Mass.CONFIGURATION))
    count, slides = inertial_modes(body), turning is not None and turning.slides

    def found(way: FloatArray) -> FloatArray:
        place = np.zeros(body.mode_count)
        place[rigid:] = way
        mass: FloatArray = core.mass(place)[:count, :count]
        if turning is None or not slides:
            return mass.ravel()
        push = mass[:, :rigid] @ turning.coordinates
        total = push[:rigid, 0] @ turning.coordinates[:, 0]
        # What the root's displacement feels of its turns: m (e_b × c)_a.
        moment = turning.coordinates[:, :3].T @ push[:rigid, 3:] / total
        mass = mass - push[:, :3] @ push[:, :3].T / total
        return np.concatenate([mass.ravel(), [moment[1, 2], moment[2, 0], moment[0, 1]]])

    return found
