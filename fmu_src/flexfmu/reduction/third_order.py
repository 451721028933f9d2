"""Static shapes by which a body answers its loads at second and third order, and in which it buckles.

The former: docs/theory.md, section 1; the latter, under the stress of its softest motions: section 7a.

A motion x under interface loads has the stress σ(x), and at second order the stress S = C (½ GᵀG + sym ∇w) that no
displacement takes away (section 4c). Both act on the body once more where it has moved, with the forces

    d(x) = ∫ σ_JK x_i,K N,_J dV,     g(x) = ∫ S_JK x_i,K N,_J dV = V′(x).                         (2c)

A basis without K⁻¹d and K⁻¹g answers too stiffly: it locks where the body would evade its stretch.
"""

from collections.abc import Callable, Iterator
from itertools import combinations_with_replacement, permutations, zip_longest

import numpy as np
import scipy.sparse.linalg as spla

from ..fe.gradients import mean_spin, own_spin, quadratic_strain, stress_stiffness, stressed_gradients
from ..files.basics import FloatArray
from ..files.progress import Reporter, tell_nobody
from ..files.store import Store, content_key
from .basis import Matrices, completed_basis
from .modes import Modes

# Shapes that a basis gets, of all interfaces and of each, and the energy, as of `third_order_loads`, up to which it
# gets none: a thin annulus bends 22 % too little without them, at 43, a twisted beam 1.5 %, at 0.5, and 0.1 % without
# the one at 0.013.
_MOST, _LEAST = (6, 2), 0.01
# Motions that are combined: the softest ones.
_MOTIONS = 6
# Motions that turn the material less than this of the most turning one, in squares at the same energy, stretch it; of
# the second round. A strip that is twenty times as wide as thick turns 1/400 as much on edge, and yet evades sideways.
_STIFF, _STIFFER = 1e-2, 1e-4
# Relative size of an eigenvalue below which loads depend on each other.
_DEPENDENT = 1e-10
# Numbers of the unit loads beyond which their forces of third order, some times as many, are not kept on disk.
_KEPT = 2_000_000
# Rotation of the material (rms, rad) at which shapes are compared: over all of it; of the second round, where it turns.
_TURN, _OWN_TURN = 0.5, 0.6


def with_third_order(matrices: Matrices, modes: Modes, modes_key: str, loads: FloatArray) -> tuple[Modes, str]:
    """A basis with the shapes of second and third order that it lacks most, and its key; parameters as below."""
    forces = matrices.kept(
        content_key(__name__, modes_key, loads),
        "static shapes of third order",
        lambda: third_order_loads(matrices, modes, loads, _LEAST, _MOST),
    )
    return completed_basis(matrices, modes, modes_key, forces)


def third_order_loads(
    matrices: Matrices, modes: Modes, loads: FloatArray, least: float, most: tuple[int, int]
) -> FloatArray:
    """Nodal forces whose static shapes a basis lacks most at second and third order.

    They complete a basis as unit loads do: `modal_basis` and `with_residual_flexibility` take them among `residual`.

    Parameters
    ----------
    matrices : Matrices
    modes : Modes
        The basis as it is, static shapes included.
    loads : (3n, l) float
        Nodal forces of the interfaces' unit loads.
    least : float
        Energy of a shape over the linear one of the motion that makes it, where the material turns by 0.5 rad (rms), up
        to which it is left out: by about as much a motion under its own load is too small without the shape.
    most : (int, int)
        How many shapes at most; and for each interface, of motions by its loads alone.

    Returns
    -------
    (3n, k) float
        Each of unit energy in what the basis lacks; the largest first.
    """
    model, elastic = matrices.supported, modes.angular_frequency > 0.0
    # Loads on a support do nothing.
    if not np.any(model.forces(loads)):
        return np.zeros((len(loads), 0))
    found, count = np.zeros((len(loads), 0)), loads.shape[1] // 6

    def held(forces: FloatArray) -> FloatArray:
        return (modes.shapes[:, elastic] / modes.angular_frequency[elastic]).T @ forces

    with matrices.report.stage("Find static shapes of third order"):
        for which, number in ((_together, most[0]), (_by_interface, most[1] * count)):
            forces, answer = _answered(matrices, loads, which)
            free, known = model.forces(forces), held(forces)
            taken = model.forces(found).T @ answer - held(found).T @ known
            # What they do outside the basis, and what is taken already.
            work = free.T @ answer
            values, axes = np.linalg.eigh(0.5 * (work + work.T) - known.T @ known - taken.T @ taken)
            chosen = np.flatnonzero(values > 2.0 * least)[::-1][:number]
            found = np.hstack([found, (forces - found @ taken) @ (axes[:, chosen] / np.sqrt(values[chosen]))])
    return found


_Motions = tuple[FloatArray, FloatArray]


def _answered(
    matrices: Matrices, loads: FloatArray, which: Callable[[Matrices, FloatArray], Iterator[_Motions]]
) -> tuple[FloatArray, FloatArray]:
    """Forces (3n, k) by the stress of some motions, and what they displace (f, k)."""
    model = matrices.supported

    def make() -> dict[str, FloatArray]:
        forces = np.hstack([loads[:, :0], *(_forces(matrices, *motions) for motions in which(matrices, loads))])
        return {"forces": forces, "answer": model.static(model.forces(forces))}

    kept = matrices.store if loads.size < _KEPT else Store()
    found = kept.arrays(content_key(__name__, which.__name__, matrices.key, loads), "forces", Reporter(), make)
    return found["forces"], found["answer"]


def _together(matrices: Matrices, loads: FloatArray) -> Iterator[_Motions]:
    """The softest motions of all loads, each at 0.5 rad."""
    yield softest_motions(matrices, loads)


def _by_interface(matrices: Matrices, loads: FloatArray) -> Iterator[_Motions]:
    """The softest motions of each interface's loads, stiffer ones too, at the same energy, where that adds any.

    Of all together the softest may be those of other arms than the one that evades sideways. Stiff motions at large
    turns of their own would outweigh all others, under loads that no body bears.
    """
    for own in np.arange(loads.shape[1]).reshape(2, -1, 3).swapaxes(0, 1).reshape(-1, 6):
        fields, energy = softest_motions(matrices, loads[:, own], _STIFFER)
        known = own.size == loads.shape[1] and softest_motions(matrices, loads)[1].size
        if energy.size > known:
            first = energy[0] * _OWN_TURN**2 / own_spin(matrices.model.mesh, fields[:, 0])
            yield fields * np.sqrt(first / energy), np.full(energy.size, first)


def softest_motions(matrices: Matrices, loads: FloatArray, stiff: float = _STIFF) -> _Motions:
    """Motions (3n, m) under loads (3n, l) that turn the material most at the same energy, by 0.5 rad; energies (m,)."""
    model = matrices.supported
    found = model.static(model.forces(loads))
    stiffness = found.T @ (model.stiffness @ found)
    # Loads on a support do nothing.
    size = np.where(np.diag(stiffness) > 0.0, np.sqrt(np.maximum(np.diag(stiffness), 0.0)), np.inf)
    values, axes = np.linalg.eigh(stiffness / np.outer(size, size))
    kept = values > _DEPENDENT * values[-1]
    fields = model.whole(found @ (axes[:, kept] / np.sqrt(values[kept]) / size[:, None]))
    turned, axes = np.linalg.eigh(mean_spin(matrices.model.mesh, fields))
    chosen = np.flatnonzero(turned > stiff * turned[-1])[::-1][:_MOTIONS]
    scale = _TURN / np.sqrt(turned[chosen])
    # Their squares are twice the energy: the fields had a half of one.
    return fields @ (axes[:, chosen] * scale), 0.5 * scale**2


def _forces(matrices: Matrices, fields: FloatArray, energy: FloatArray) -> FloatArray:
    """Forces (3n, k) of (2c) for products of the motions' amplitudes, over the root of the motions' energy."""
    model, mesh = matrices.supported, matrices.model.mesh
    every = range(fields.shape[1])
    pairs = np.array(list(combinations_with_replacement(every, 2)))
    responses = -model.static(model.forces(quadratic_strain(mesh, fields, pairs, tell_nobody)[0]))
    pulled = stressed_gradients(mesh, fields, model.whole(responses), pairs)
    # Polynomials of second and third order: what belongs to one product of amplitudes, over its number of orders.
    found: dict[tuple[int, ...], FloatArray] = {}
    for a in every:
        for column, other in enumerate([(b,) for b in every] + [tuple(pair) for pair in pairs.tolist()]):
            product = tuple(sorted((a, *other)))
            found[product] = found.get(product, 0.0) + pulled[:, a, column]
    scaled = []
    for product, force in found.items():
        orders = len(set(permutations(product)))
        scaled.append(force / np.sqrt(orders * np.prod(energy[list(product)]) ** (1.0 / len(product))))
    return np.array(scaled).T


# Motions, of which stiffer ones bear far more stress than they will; shapes in all, and of each motion; the part of a
# motion with a turn of 0.5 rad (rms) beyond which none counts.
_BENT, _BUCKLED, _EACH, _REACH = 3, 8, 6, 1.0
# Of the iteration, whose shapes need not be exact: Krylov vectors, relative error.
_VECTORS, _TOLERANCE, _SEED = 20, 1e-2, 20261122


def buckling_loads(matrices: Matrices, loads: FloatArray) -> FloatArray:
    """Nodal forces (3n, k) whose static responses are shapes of buckling, K x = −λ K_σ x, of the smallest |λ|.

    K_σ is the geometric stiffness of one of the softest motions.

    Parameters
    ----------
    matrices : Matrices
    loads : (3n, l) float
        Nodal forces of the interfaces' unit loads.

    Returns
    -------
    (3n, k) float
    """
    model = matrices.supported
    # Loads on a support do nothing.
    if model.free.size <= 2 * _VECTORS or not np.any(model.forces(loads)):
        return np.zeros((len(loads), 0))
    motions = softest_motions(matrices, loads)[0][:, :_BENT]
    with matrices.report.counted("Find shapes of buckling", motions.shape[1], "motions") as tell:
        found = []
        for number, motion in enumerate(motions.T):
            found.append(_buckled_shapes(matrices, motion))
            tell(number)
    # The lowest of each motion first.
    ranked = [shape for level in zip_longest(*found) for shape in level if shape is not None][:_BUCKLED]
    return model.applied(model.whole(np.array(ranked).reshape(-1, model.free.size).T))


def _buckled_shapes(matrices: Matrices, motion: FloatArray) -> FloatArray:
    """Shapes (k, f) in which the stress of a motion (3n,), or its opposite, buckles the body, the first ones first."""
    model = matrices.supported
    size = model.free.size
    stress = model.unknowns.matrix(model.unknowns.in_means(stress_stiffness(matrices.model.mesh, motion)))
    solve = spla.LinearOperator((size, size), matvec=lambda force: model.static(force.reshape(-1, 1))[:, 0])
    start = model.static(np.random.default_rng(_SEED).standard_normal((size, 1)))[:, 0]
    try:
        inverse, shapes = spla.eigsh(
            stress, _EACH, model.stiffness, which="BE", v0=start, Minv=solve, ncv=_VECTORS, tol=_TOLERANCE
        )
    except spla.ArpackNoConvergence as error:
        inverse, shapes = error.eigenvalues, error.eigenvectors
    order = np.argsort(-np.abs(inverse))
    return shapes[:, order[np.abs(inverse[order]) > 1.0 / _REACH]].T
