"""Modal bases of the supported body, equation (1)'s Φ: mass-orthonormal, checked, with fixed signs.

Sources: R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313; for residual modes S. Rubin, AIAA J. 13 (1975) 995.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..files.basics import AccuracyError, BodyFileError, FloatArray, IntArray, ModelError
from .supported import Supported

# The small eigenproblem reaches round-off; this leaves three decades for matrices of bad condition.
_ORTHONORMALITY_LIMIT = 1e-9
# Kinetic energy of a shape's entries' sizes over its own, beyond which its mass is mere round-off.
_MASSLESS = 1e6
# Mass over what it would be of parts of like sign, and share of a scaled mass, that is none.
_NO_MASS = 1e-12
# Unknowns of a mesh that is small enough to look at all its mass.
_FEW = 400
# Far below what a mesh leaves open of a frequency.
_FREQUENCY_LIMIT = 1e-3
# Twist of prisms alone passes both of their points by.
_TWISTS = ", or single C3D6 in a row twist, which costs them no energy: take C3D15"
_ILL_CONDITIONED = (
    "the body is so soft against its stiffest elements that round-off of the stiffness shows. In a thin body take one "
    "layer of elements across the thickness; look for parts that hang on the rest by a single edge or corner, and for "
    "elements that are far smaller than the others"
)
# Strain energy of a shape over that of its entries' sizes which is round-off of none at all, and which may be.
_ROUND_OFF, _DOUBTFUL = 1e-17, 1.1e-16
# Relative distance of ω² below which modes span a plane whose axes are arbitrary.
_DEGENERATE = 1e-7
# Share of a static shape's strain energy below which the modes hold it already: the compliance is right to as much.
_HELD_ALREADY = 1e-10
# Energies cannot be negative: those of this many times the most negative one are round-off.
_OF_ROUND_OFF = 30.0
# Smallest eigenvalue of the interfaces' scaled compliance below which they depend on each other.
_DEPENDENT = 1e-10
# Spread of a mode's vibrations that is more than round-off.
_MIXED = 1e-6
# Squared frequencies over the largest whose modes its round-off turns into each other.
_SOFTER = 1e-6, 1e-12
# A component this close to the largest may serve to fix a sign: the first such one is taken.
_NEARLY_LARGEST = 0.9


@dataclass(frozen=True, slots=True)
class Modes:
    """Mass-orthonormal modes.

    Attributes
    ----------
    angular_frequency : (m,) float
        rad/s, ascending; zero for the rigid motions of a free body.
    shapes : (3n, m) float
        kg^-1/2, zero at supports; degree of freedom 3 i + j is node i in direction j.
    orthonormality_error : float
        Largest entry of |ΦᵀMΦ − I|.
    frequency_error : float
        Largest relative error of the normal modes' frequencies, by the residual in the norm of strain energy: a bound
        for the stiffness as it stands, whose own round-off is of the same size.
    splits_pair : bool
        Whether a mode that is left out has the frequency of one that is not.
    """

    angular_frequency: FloatArray
    shapes: FloatArray
    orthonormality_error: float
    frequency_error: float
    splits_pair: bool


def normal_modes(model: Supported, count: int) -> Modes:
    """Rigid motions, and lowest elastic modes with the supports in place, by shift-invert Lanczos about zero.

    Parameters
    ----------
    model : Supported
    count : int
        Number of elastic modes.

    Returns
    -------
    Modes

    Raises
    ------
    BodyFileError
        More modes are asked for than the mesh has.
    AccuracyError
        The modes do not pass their own check.
    """
    return _with_rigid(model, _lowest(model, count, np.zeros((model.free.size, 0))))


def chosen_modes(modes: Modes, chosen: IntArray) -> Modes:
    """Rigid motions and some of the normal modes.

    Parameters
    ----------
    modes : Modes
        Of `normal_modes`.
    chosen : (k,) int
        Elastic modes to keep, from 0, ascending.

    Returns
    -------
    Modes
    """
    omega = modes.angular_frequency
    kept = omega == 0.0
    kept[kept.sum() + chosen] = True
    squares = omega**2
    # Neighbours of the same frequency of which one is kept.
    torn = (np.diff(squares) < _DEGENERATE * squares[1:]) & (kept[1:] != kept[:-1]) & (omega[1:] > 0.0)
    splits = bool(np.any(torn)) or (modes.splits_pair and bool(kept[-1]))
    return Modes(omega[kept], modes.shapes[:, kept], modes.orthonormality_error, modes.frequency_error, splits)


def craig_bampton(model: Supported, chosen: IntArray, interface_loads: FloatArray) -> Modes:
    """Constraint modes of the interfaces and fixed-interface normal modes, orthonormalised by the small eigenproblem.

    An interface is a distributing coupling: it is held where its rigid fit (3) is zero, and its constraint modes are
    the shapes of least strain energy with one component of one fit at one. They span what unit loads on it do; on a
    free body, what loads in balance do, and the rigid motions.

    Parameters
    ----------
    model : Supported
    chosen : (k,) int
        Fixed-interface normal modes in order of frequency, from 0, ascending.
    interface_loads : (3n, 6I) float
        Nodal forces of the interfaces' unit forces and moments, Gᵀ.

    Returns
    -------
    Modes
        k + 6I of them.

    Raises
    ------
    BodyFileError, AccuracyError
        As of `normal_modes`.
    """
    loads = model.forces(interface_loads)
    fixed = chosen_modes(_lowest(model, int(chosen[-1]) + 1, loads), chosen)
    return _joined(model, fixed, _statics(model, loads @ balanced(model, loads)))


def with_residual_flexibility(model: Supported, modes: Modes, loads: FloatArray, missed: float = 0.0) -> Modes:
    """Modes and what they lack of the static response to interface loads, orthonormalised by the small eigenproblem.

    Static displacements of the interfaces are then those of the whole finite element model. The additional modes are
    of high frequency; unlike a residual flexibility matrix on the outputs they make no direct feedthrough.

    Parameters
    ----------
    model : Supported
    modes : Modes
    loads : (3n, 6I) float
        Nodal forces of the interfaces' unit forces and moments.
    missed : float
        Share of its own displacement (2d) that every load may miss, so that few shapes will do.

    Returns
    -------
    Modes
        At most 6I more.
    """
    return _joined(model, modes, _statics(model, model.forces(loads)), missed)


def frequency_spread(model: Supported, angular_frequency: FloatArray, shapes: FloatArray) -> FloatArray:
    """How far modes are from vibrations of the whole model: λ ⟨1/λ⟩ − 1 over the vibrations that each is made of.

    Parameters
    ----------
    model : Supported
    angular_frequency : (m,) float
        rad/s.
    shapes : (3n, m) float

    Returns
    -------
    (m,) float
        0 where a mode is one of the model's own, and for rigid motions.
    """
    shapes = model.unknowns.of(shapes)
    inertia = model.mass @ shapes
    energy = np.einsum("ij,ij->j", shapes, inertia)
    elastic = (angular_frequency > 0.0) & (energy > 0.0)
    felt = inertia[:, elastic]
    found = np.zeros(elastic.size)
    mean = np.einsum("ij,ij->j", felt, model.static(felt)) / energy[elastic]
    found[elastic] = angular_frequency[elastic] ** 2 * mean - 1.0
    return np.where(found > _MIXED, found, 0.0)


def _statics(model: Supported, loads: FloatArray) -> FloatArray:
    """Static shapes (k, j) under loads (k, j), if their strain energy is what the loads have worked."""
    shapes = model.static(loads)
    energy = np.einsum("ij,ij->j", shapes, model.stiffness @ shapes)
    work = np.einsum("ij,ij->j", shapes, loads)
    # Loads on a support do nothing. Of the energy the frequency is the root.
    moved = energy > 0.0
    error = 0.5 * float(np.max(np.abs(1.0 - work[moved] / energy[moved]), initial=0.0))
    if error > _FREQUENCY_LIMIT:
        found = f"static shapes are not good enough: energy and work of a unit load differ by {200.0 * error:.2g} %"
        raise AccuracyError(f"{found} (limit {200.0 * _FREQUENCY_LIMIT:.2g} %); {_ILL_CONDITIONED}")
    return shapes


def balanced(model: Supported, loads: FloatArray) -> FloatArray:
    """Combinations (l, l - r) of the interfaces' unit loads (k, l) that no rigid motion feels."""
    felt = model.rigid.T @ loads
    # Moments are felt in other units than forces: what matters is the direction each load pushes in.
    scale = np.linalg.norm(felt, axis=0)
    scale[scale == 0.0] = 1.0
    _, _, turn = np.linalg.svd(felt / scale)
    return turn[len(felt) :].T / scale[:, None]


def _with_rigid(model: Supported, modes: Modes) -> Modes:
    """Put the rigid motions before elastic modes."""
    if not model.rigid.shape[1]:
        return modes
    shapes = np.hstack([model.rigid, model.unknowns.of(modes.shapes)])
    orthonormality = _checked_orthonormality(model.mass, shapes)
    frequency = np.concatenate([np.zeros(model.rigid.shape[1]), modes.angular_frequency])
    return Modes(frequency, model.whole(shapes), orthonormality, modes.frequency_error, modes.splits_pair)


def _lowest(model: Supported, count: int, held: FloatArray) -> Modes:
    """Lowest modes among the shapes that do no work under the forces `held` (k, j): those with Gu = 0."""
    k, m = model.stiffness, model.mass
    asked = count + 1
    if asked >= model.free.size - held.shape[1]:
        raise BodyFileError(f"[reduction] modes = {count}: the mesh has {model.free.size} free degrees of freedom only")
    released = model.static(held)
    # K⁻¹ b less what brings Gu back to zero. Holding the interfaces holds the rigid motions too: their amplitudes are
    # such that the reactions balance b.
    compliance = _checked_compliance(held.T @ released)
    moved = held.T @ model.rigid
    weight = np.linalg.solve(compliance, moved) if held.shape[1] else moved

    def inverse(right: FloatArray) -> FloatArray:
        solution = model.static(right)
        if held.shape[1]:
            gap = held.T @ solution
            if moved.shape[1]:
                amplitude = np.linalg.solve(moved.T @ weight, model.rigid.T @ right - weight.T @ gap)
                solution += model.rigid @ amplitude
                gap += moved @ amplitude
            solution -= released @ np.linalg.solve(compliance, gap)
        return solution

    vectors = _of_few(m, inverse, asked) if model.free.size <= _FEW else None
    if vectors is None:
        # A fixed start with all wave lengths in it makes a rebuild repeat the same iteration.
        start = inverse(m @ np.random.default_rng(0).standard_normal(model.free.size))
        operator = spla.LinearOperator(k.shape, matvec=inverse, dtype=np.float64)
        try:
            _, vectors = spla.eigsh(k, k=asked, M=m, sigma=0.0, OPinv=operator, v0=start)
        except spla.ArpackError as error:
            raise AccuracyError(f"the eigenvalue iteration failed ({error}); ask for fewer modes") from error
    # One Rayleigh-Ritz step removes what is left of the iteration's lack of orthogonality.
    squares, vectors = _rayleigh_ritz(k, m, vectors)
    splits = bool(squares[count] - squares[count - 1] < _DEGENERATE * squares[count])
    squares, vectors = squares[:count], _fixed_axes(squares[:count], vectors[:, :count])
    orthonormality = _checked_orthonormality(m, vectors)
    accuracy = _checked(k, m, vectors, np.sqrt(squares), inverse(m @ vectors))
    return Modes(np.sqrt(squares), model.whole(vectors), orthonormality, accuracy, splits)


def _of_few(m: sp.csr_array, inverse: Callable[[FloatArray], FloatArray], asked: int) -> FloatArray | None:
    """Softest motions (k, asked) of few unknowns: with M = FFᵀ they are K⁻¹Fy, where FᵀK⁻¹F y = y / ω².

    None where all motions have mass; where some have none, as in a few C3D20R elements, iteration drifts among them.
    """
    scale = np.sqrt(np.where(m.diagonal() > 0.0, m.diagonal(), 1.0))
    share, directions = np.linalg.eigh(m.toarray() / np.outer(scale, scale))
    if share[0] > _NO_MASS:
        return None
    factor = scale[:, None] * (directions * np.sqrt(np.maximum(share, 0.0)))[:, share > _NO_MASS]
    # A C3D20R element has mass at eight points alone.
    if asked > factor.shape[1]:
        raise AccuracyError(f"{asked} modes are wanted, and {factor.shape[1]} have mass; ask for fewer modes")
    return inverse(factor @ np.linalg.eigh(factor.T @ inverse(factor))[1][:, : -asked - 1 : -1])


def _checked(k: sp.csr_array, m: sp.csr_array, vectors: FloatArray, omega: FloatArray, found: FloatArray) -> float:
    """Largest relative error of frequencies (j,) of modes (k, j), from K⁻¹Mφ as `found` (k, j).

    In the modes that are sought, φ = Σ cᵢ φᵢ with Σ cᵢ² = 1, so that the residual φ − ω²K⁻¹Mφ has over ω² the energy
    Σ cᵢ² (ωᵢ/ω − ω/ωᵢ)²: in the norm of energy some ωᵢ lies within half of it. In forces, round-off of a stiff mesh
    would drown a soft mode's own; in displacements, that of the soft modes would drown a stiff one's.
    """
    astray = vectors - omega**2 * found
    # What lies among the modes found is round-off of K⁻¹: the small eigenproblem has sorted that out.
    outside = astray - vectors @ (vectors.T @ (m @ astray))
    # Round-off of zero may be negative.
    energies = (np.maximum(np.einsum("ij,ij->j", x, k @ x), 0.0) for x in (astray, outside))
    errors, unsettled = (0.5 * np.sqrt(energy) / omega for energy in energies)
    worst = int(np.argmax(errors))
    error = float(errors[worst])
    if error <= _FREQUENCY_LIMIT:
        return error
    settled = unsettled[worst] <= 0.5 * error
    words = _ILL_CONDITIONED if settled else "the iteration has not settled: ask for fewer modes"
    raise AccuracyError(
        f"modes are not good enough: the frequency of mode {worst + 1} ({omega[worst] / (2.0 * math.pi):.4g} Hz) is "
        f"off by about {100.0 * error:.2g} % (limit {100.0 * _FREQUENCY_LIMIT:.2g} %); {words}"
    )


def _checked_compliance(compliance: FloatArray) -> FloatArray:
    """Compliance (6I, 6I) of the interfaces, if all of them can move independently of each other."""
    size = np.sqrt(np.maximum(np.diag(compliance), 0.0))
    if compliance.size and (size.min() <= 0.0 or np.linalg.eigvalsh(compliance / np.outer(size, size))[0] < _DEPENDENT):
        raise BodyFileError(
            'basis = "craig_bampton" holds every interface by itself, which these do not allow: an interface lies on a '
            'support, or two share their nodes; take it out, or take basis = "normal" with residual_flexibility = true'
        )
    return compliance


def _rayleigh_ritz(k: sp.csr_array, m: sp.csr_array, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared frequencies and modes of the small eigenproblem that vectors (k, j) span."""
    masses, parts = (np.einsum("ij,ij->j", v, one @ v) for v, one in ((vectors, m), (abs(vectors), abs(m))))
    # Of what has none round-off is left, of either sign.
    if not np.all(masses > _NO_MASS * parts):
        raise AccuracyError("some modes have no mass: ask for fewer modes")
    vectors = vectors / np.sqrt(masses)
    try:
        squares, small = scipy.linalg.eigh(vectors.T @ (k @ vectors), vectors.T @ (m @ vectors))
        modes = vectors @ small
        # Shapes of stiff pieces leave more than round-off. In this order soft modes stay clear of them; in the small
        # eigenproblem they do not, and are turned once more by themselves.
        for share in _SOFTER:
            modes = scipy.linalg.solve_triangular(np.linalg.cholesky(modes.T @ (m @ modes)), modes.T, lower=True).T
            soft = modes[:, : np.searchsorted(squares, share * squares[-1])]
            squares[: soft.shape[1]], turn = np.linalg.eigh(soft.T @ (k @ soft))
            soft[:] = soft @ turn
    except np.linalg.LinAlgError as error:
        found = f"the modes are not independent of each other ({error})"
        advice = "look for parts that hang on the rest by a single edge or corner, or ask for fewer modes"
        raise AccuracyError(f"{found}; {advice}") from error
    softest = np.abs(modes[:, 0])
    # Its indices are no copies.
    size = float(softest @ (sp.csr_array((np.abs(k.data), k.indices, k.indptr), shape=k.shape) @ softest))
    if squares[0] <= _ROUND_OFF * size:
        raise ModelError(f"the lowest eigenvalue is {squares[0]:.3e} 1/s²: a part of the body is free to move{_TWISTS}")
    if squares[0] <= _DOUBTFUL * size:
        raise AccuracyError(f"modes are not good enough: the lowest frequency may be off by 100 %; {_ILL_CONDITIONED}")
    return squares, modes


def _joined(model: Supported, modes: Modes, statics: FloatArray, missed: float = 0.0) -> Modes:
    """Span of modes and static shapes (k, j), orthonormalised; shapes that the modes hold already add nothing.

    Of each static shape a share of its energy may be missed.
    """
    k, m = model.stiffness, model.mass
    # Rigid motions stand for themselves; what is elastic about the rest follows.
    phi = model.elastic(model.unknowns.of(modes.shapes[:, modes.angular_frequency > 0.0]))
    energy = np.einsum("ij,ij->j", statics, k @ statics)
    # Loads on a support do nothing.
    statics = statics[:, energy > 0.0] / np.sqrt(energy[energy > 0.0])
    # Modes with fixed interfaces are none of a free body: without static shapes, too, they take the rigid motions in.
    if not statics.shape[1] and np.count_nonzero(modes.angular_frequency == 0.0) == model.rigid.shape[1]:
        return modes
    statics = model.elastic(statics)
    # What is left over in strain energy once the modes have taken their part.
    rest = statics - phi @ np.linalg.solve(phi.T @ (k @ phi), phi.T @ (k @ statics))
    energies, turn = np.linalg.eigh(rest.T @ (k @ rest))
    kept = energies > max(_HELD_ALREADY, -_OF_ROUND_OFF * energies.min(initial=0.0))
    # What each load misses without this one and all that hold less.
    kept &= np.cumsum(turn**2 * energies, axis=1).max(axis=0, initial=0.0) > missed
    rest = rest @ (turn[:, kept] / np.sqrt(energies[kept]))
    # Scaled up, shapes that the modes hold nearly have again some of the modes, by round-off.
    rest -= phi @ np.linalg.solve(phi.T @ (k @ phi), phi.T @ (k @ rest))
    squares, vectors = _rayleigh_ritz(k, m, np.hstack([phi, rest]))
    # Elements that are integrated at few points have motions of hardly any mass: those are the last modes.
    massive = np.einsum("ij,ij->j", np.abs(vectors), abs(m) @ np.abs(vectors)) < _MASSLESS
    squares, vectors = squares[massive], vectors[:, massive]
    # Shapes that the modes hold nearly come scaled up, and with them what they have of the rigid motions by round-off.
    vectors = model.elastic(_fixed_axes(squares, vectors))
    orthonormality = _checked_orthonormality(m, vectors)
    elastic = Modes(np.sqrt(squares), model.whole(vectors), orthonormality, modes.frequency_error, modes.splits_pair)
    return _with_rigid(model, elastic)


def _checked_orthonormality(m: sp.csr_array, vectors: FloatArray) -> float:
    error = float(np.max(np.abs(vectors.T @ (m @ vectors) - np.eye(vectors.shape[1]))))
    if error > _ORTHONORMALITY_LIMIT:
        found = f"modes are not good enough: |ΦᵀMΦ − I| = {error:.1e} (limit {_ORTHONORMALITY_LIMIT:.0e})"
        raise AccuracyError(f"{found}; check the mesh for badly shaped elements, or ask for fewer modes")
    return error


def _fixed_axes(squares: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn modes of equal frequency to fixed axes and give every mode a fixed sign."""
    vectors = vectors.copy()
    starts = np.flatnonzero(np.diff(squares, prepend=-np.inf) > _DEGENERATE * squares)
    for first, end in zip(starts, [*starts[1:], squares.size], strict=True):
        block = vectors[:, first:end]
        for column in range(block.shape[1]):
            # Put all of one component that these modes have much of into this mode, none into the later ones.
            size = np.linalg.norm(block[:, column:], axis=1)
            row = int(np.argmax(size >= _NEARLY_LARGEST * size.max()))
            axis = block[row, column:] / size[row]
            # The first column of an orthogonal matrix.
            turn, upper = np.linalg.qr(np.column_stack([axis, np.eye(axis.size)]))
            turn *= np.sign(np.concatenate([[upper[0, 0]], np.ones(axis.size - 1)]))
            block[:, column:] = block[:, column:] @ turn
    return vectors
