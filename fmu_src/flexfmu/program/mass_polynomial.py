"""Mass of the deformed body as a polynomial of the slow coordinates (docs/theory.md, section 9).

M(q) − 1 to second order in q follows from the mass of the lumps on a fine tree of frames, once, at build time. That is

    M(q) = 1 + Σ_k (l_k·q + qᵀV_k q) U_k,                                                                      (13a)

a table of pairs of rates by coordinates and pairs of them, of low rank: the few combinations that matter are kept.
"""

from collections.abc import Sequence

import numpy as np

from ..core.library import Core
from ..files.array_types import FloatArray, IntArray
from ..model.inertia import MassPolynomial
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from .compile import compile_program
from .mechanics import Turning, inertial_modes, turning_of

# Largest turn of a frame in the differences, rad, or displacement over the body's size: their error is its square, and
# round-off over it.
_TURN = 1e-3
# Turn at which first and second order are weighed against each other, rad, and share of the largest combination below
# which one is left out.
_WEIGHED, _SMALL = 0.3, 3e-3


def mass_polynomial(parts: Sequence[tuple[ReducedBody, FloatArray]]) -> MassPolynomial | None:
    """The polynomial of a body, or of one that is joined of held parts.

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
    every = [(turn.T @ own.form @ turn, own.linear @ turn, turn.T @ own.square @ turn) for own, turn in found]
    terms = [np.concatenate(arrays) for arrays in zip(*every, strict=True)]
    # Of a body that slides there is one part.
    own, turn = found[0]
    if own.centre is not None and own.centre_square is not None:
        terms += [own.centre @ turn, turn.T @ own.centre_square @ turn]
    return MassPolynomial(*terms)


def _of_part(body: ReducedBody) -> MassPolynomial | None:
    """The polynomial of a body: of one that slides its mass about its centre, and where that is.

    Stiff coordinates enter to first order, so that they are stretched by what turns and swings.
    """
    rigid, count, modes = body.rigid_count, inertial_modes(body), body.mode_count
    turning = turning_of(body)
    if rigid and turning is None:
        return None
    whole, turn = np.split(_largest_turn(body), [rigid])
    omega = body.angular_frequency[rigid:]
    # What hardly moves the lumps is taken as far as the softest motion's energy takes it.
    (linear, quadratic), centre = _differences(body, _TURN / np.maximum(turn, turn[0] * omega / omega[0]), turning)
    first, second = np.triu_indices(count)
    one, other = np.triu_indices(count - rigid)
    # Coordinates and rates of equal energy, the former at a reference turn, and a spin of the first frequency; a pair
    # stands for both halves.
    coordinate = _WEIGHED * omega[0] / turn[0] / omega
    rate = np.concatenate([turn[0] / _WEIGHED / whole, omega[0] / omega])
    both, places = np.where(first == second, 1.0, np.sqrt(2.0)), np.where(one == other, 1.0, np.sqrt(2.0))
    rates, places = both * rate[first] * rate[second], places * coordinate[one] * coordinate[other]
    table = np.hstack([linear[:, first, second].T * coordinate, quadratic[one, other][:, first, second].T * places])
    forms, strength, values = np.linalg.svd(table * rates[:, None], full_matrices=False)
    kept = strength > _SMALL * strength[0]
    if not strength[0] > 0.0:
        return None

    def ahead(values: FloatArray) -> FloatArray:
        result = np.zeros((len(values), modes))
        result[:, rigid:] = values
        return result

    def matrices(pairs: FloatArray, start: int, a: IntArray, b: IntArray) -> FloatArray:
        result = np.zeros((len(pairs), modes, modes))
        result[:, start + a, start + b] = result[:, start + b, start + a] = pairs
        return result

    values = strength[kept, None] * values[kept]
    terms = (
        matrices(forms.T[kept] / rates, 0, first, second),
        ahead(values[:, : turn.size] / coordinate),
        matrices(values[:, turn.size :] / places, rigid, one, other),
    )
    if centre is None:
        return MassPolynomial(*terms)
    moved, squared = centre
    return MassPolynomial(*terms, ahead(moved.T), matrices(squared[one, other].T, rigid, one, other))


def _largest_turn(body: ReducedBody) -> FloatArray:
    """Rotation of frames per unit coordinate (m), or displacement over the body's size where it stretches alone."""
    turn: FloatArray = np.linalg.norm(body.frame_rotation, axis=1).max(axis=0)
    if body.inertia is not None and (size := float(np.linalg.norm(np.ptp(body.inertia.point, axis=0)))) > 0.0:
        turn = np.maximum(turn, np.linalg.norm(body.inertia.displacement, axis=1).max(axis=0) / size)
    return turn


_Derivatives = tuple[FloatArray, FloatArray]


def _differences(
    body: ReducedBody, size: FloatArray, turning: Turning | None
) -> tuple[_Derivatives, _Derivatives | None]:
    """First derivatives (e, ...) of the mass (r, r) of the lumps, and half the second ones by slow coordinates.

    Of a body that slides, of the mass about its centre, and those of that centre (3,) seen from the root.
    """
    rigid, core = body.rigid_count, Core(compile_program(body, Method.SECOND_ORDER, Mass.CONFIGURATION))
    count = inertial_modes(body)
    slow = count - rigid
    slides = turning is not None and turning.slides

    def found(way: FloatArray) -> FloatArray:
        """The mass, row by row, and three numbers of the centre where it slides."""
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

    def even(way: FloatArray) -> FloatArray:
        return 0.5 * (found(way) + found(-way)) - still

    still, ways = found(np.zeros(size.size)), np.diag(size)
    linear = np.array([(found(way) - found(-way)) / (2.0 * step) for way, step in zip(ways, size, strict=True)])
    alone = np.array([even(way) for way in ways[:slow]])
    quadratic = np.empty((slow, slow, still.size))
    for a in range(slow):
        quadratic[a, a] = alone[a] / size[a] ** 2
        for b in range(a):
            mixed = 0.5 * (even(ways[a] + ways[b]) - alone[a] - alone[b])
            quadratic[a, b] = quadratic[b, a] = mixed / (size[a] * size[b])
    last = count * count
    mass = linear[:, :last].reshape(-1, count, count), quadratic[..., :last].reshape(slow, slow, count, count)
    return mass, (linear[:, last:], quadratic[..., last:]) if slides else None
