"""The basis that a body file asks for and its geometric stiffness, found once and kept by content.

And static shapes by which a body answers its loads at second and third order (docs/theory.md, section 1), and in which
it buckles, under the stress of its softest motions (section 7a).

A motion x under interface loads has the stress σ(x), and at second order the stress S = C (½ GᵀG + sym ∇w) that no
displacement takes away (section 4c). Both act on the body once more where it has moved, with the forces

    d(x) = ∫ σ_JK x_i,K N,_J dV,     g(x) = ∫ S_JK x_i,K N,_J dV = V′(x).                         (2c)

A basis without K⁻¹d and K⁻¹g answers too stiffly: it locks where the body would evade its stretch.
"""

from collections.abc import Callable, Iterator
from copy import copy
from functools import cached_property, partial
from itertools import combinations_with_replacement, permutations, zip_longest

import numpy as np

from ..fe import gradients
from ..fe.assembly import stiffness
from ..fe.factorisation import solver_name
from ..files.basics import FloatArray
from ..files.outputs import Reporter, tell_nobody
from ..files.store import Store, content_key
from .model import Model
from .modes import Modes, chosen_modes, craig_bampton, normal_modes, with_residual_flexibility
from .options import Basis, BasisOptions
from .rigid_fit import model_mass
from .supported import Supported, eliminated, supported

MISSED = 5e-3
"""Share of its own displacement that a load may miss where shapes are taken by need."""


class Matrices:
    """Stiffness and mass of a model, assembled and factorised once, when first needed.

    Parameters
    ----------
    model : Model
    report : Reporter
        Hears of what is found with them.
    store : Store, optional
        Keeps it. Default: nothing is kept.
    """

    def __init__(self, model: Model, report: Reporter, store: Store | None = None):
        self.model, self.report, self.store = model, report, store or Store()

    @property
    def quiet(self) -> "Matrices":
        """The same matrices; of what is found with these nobody hears."""
        found = copy(self)
        found.report = Reporter()
        return found

    def kept(self, key: str, what: str, make: Callable[[], FloatArray]) -> FloatArray:
        """An array that is found with them, from the store where it was found before."""
        return self.store.arrays(key, what, self.report, lambda: {"found": make()})["found"]

    @cached_property
    def key(self) -> str:
        """Hash of all that the matrices depend on."""
        model, mesh = self.model, self.model.mesh
        blocks = [part for b in mesh.blocks for part in (b.type.name, b.connectivity, b.material, b.axes, b.section)]
        materials = [(*m.elasticity.ravel().tolist(), m.density, m.by_normal, m.layers) for m in mesh.materials]
        tied = mesh.equations.data, mesh.equations.indices, mesh.equations.indptr
        stiff = [part for one in mesh.simplices for part in (one.nodes, one.stiffness)]
        hung = [part for one in mesh.masses for part in (one.mass, one.inertia, one.point, one.nodes)]
        supports = model.fixed, model.spring, model.rigid.shape, *model.bushings.key
        return content_key(__name__, mesh.points, *blocks, *materials, *supports, *tied, *stiff, *hung)

    @property
    def supported(self) -> Supported:
        """Both without the supports, factorised when first needed: where all is kept they never are."""
        found: Supported = self.store.last("factors", self.key, self._factorised)
        return found

    def _factorised(self) -> Supported:
        model = self.model
        with self.report.stage("Assemble stiffness and mass"):
            # Without names for those of all degrees of freedom, which are not kept beside the factors.
            springs = model.unknowns.in_means(model.springs)
            matrices = eliminated(stiffness(model.mesh) + springs, model_mass(model.mesh), model.unknowns)
        with self.report.stage(f"Factorise the stiffness ({solver_name()})"):
            return supported(matrices, model.rigid, self.report.note)


def modal_basis(table: BasisOptions, matrices: Matrices, loads: FloatArray, residual: FloatArray) -> tuple[Modes, str]:
    """Modes of the basis that the body file asks for.

    Parameters
    ----------
    table : BasisOptions
    matrices : Matrices
    loads : (3n, 6I) float
        Nodal forces of the interfaces' unit loads; normal modes alone do not depend on them.
    residual : (3n, j) float
        Those whose static response normal modes are completed by.

    Returns
    -------
    modes : Modes
    key : str
        Hash of all that they depend on.
    """
    model, numbers = matrices.model, table.numbers
    if table.exact:
        return _numbered_basis(table, numbers, matrices, loads, residual)
    # The iteration needs two unknowns more than it finds modes.
    most = model.free.size - model.rigid.shape[1] - (loads.shape[1] if table.kind is Basis.CRAIG_BAMPTON else 0) - 2
    numbers = numbers[: max(most, 1)]
    modes, key = _numbered_basis(table, numbers, matrices, loads, residual)
    if modes.splits_pair and len(numbers) < most:
        numbers = (*numbers, numbers[-1] + 1)
        modes, key = _numbered_basis(table, numbers, matrices, loads, residual)
    return modes, key


def _numbered_basis(
    table: BasisOptions, numbers: tuple[int, ...], matrices: Matrices, loads: FloatArray, residual: FloatArray
) -> tuple[Modes, str]:
    """Modes of a basis with the normal modes of these numbers; the rest as of `modal_basis`."""
    count = numbers[-1]
    # Those that are left out.
    few = len(numbers) < count
    chosen = np.array(numbers) - 1
    if table.kind is Basis.CRAIG_BAMPTON:
        key = content_key(__name__, "craig-bampton", matrices.key, numbers if few else count, loads)
        words = f"Find {loads.shape[1]} constraint modes and {count} fixed-interface normal modes"
        modes = _kept(matrices, key, "modes", words, lambda model: craig_bampton(model, chosen, loads))
        if table.residual:
            matrices.report.note("residual_flexibility adds nothing: constraint modes hold the static response already")
        return modes, key
    key, words = content_key(__name__, "normal", matrices.key, count), f"Find {count} normal modes"
    modes = _kept(matrices, key, "normal modes", words, lambda model: normal_modes(model, count))
    if few:
        matrices.report.detail(f"kept of {count} normal modes: {', '.join(map(str, numbers))}")
        modes, key = chosen_modes(modes, chosen), content_key(__name__, "chosen", key, numbers)
    return completed_basis(matrices, modes, key, residual, MISSED if table.by_need else 0.0)


def completed_basis(
    matrices: Matrices, modes: Modes, key: str, residual: FloatArray, missed: float = 0.0
) -> tuple[Modes, str]:
    """Modes, and what they lack of the static response to nodal forces (3n, j); see `modal_basis`.

    Of its own displacement every load may miss the part `missed`.
    """
    if not residual.shape[1]:
        return modes, key
    key = content_key(__name__, "residual", key, residual, missed)
    words = f"Add the static response to {residual.shape[1]} unit loads"

    def completed(model: Supported) -> Modes:
        return with_residual_flexibility(model, modes, residual, missed)

    return _kept(matrices, key, "static response", words, completed), key


def _kept(matrices: Matrices, key: str, title: str, words: str, find: Callable[[Supported], Modes]) -> Modes:
    """Modes from the store, or found in a stage of these words."""

    def make() -> dict[str, FloatArray]:
        model = matrices.supported
        with matrices.report.stage(words):
            modes = find(model)
        checks = np.array([modes.orthonormality_error, modes.frequency_error, float(modes.splits_pair)])
        return {"angular_frequency": modes.angular_frequency, "shapes": modes.shapes, "checks": checks}

    arrays = matrices.store.arrays(key, title, matrices.report, make)
    orthonormality, error, splits = arrays["checks"]
    return Modes(arrays["angular_frequency"], arrays["shapes"], float(orthonormality), float(error), bool(splits))


def stiffness_by_load(matrices: Matrices, modes: Modes, modes_key: str, loads: FloatArray, heavy: bool) -> FloatArray:
    """Geometric stiffness of unit loads.

    Parameters
    ----------
    matrices : Matrices
    modes : Modes
    modes_key : str
        As of `modal_basis`.
    loads : (3n, 6I) float
        Forces of all interfaces, then moments.
    heavy : bool
        Whether unit accelerations of the supports come after them.

    Returns
    -------
    (6I, m, m) or (6I + 3, m, m) float
    """

    def make() -> FloatArray:
        model = matrices.supported
        # What the mass of the body does under a unit acceleration of its supports.
        every = np.hstack([loads, -model.inertia]) if heavy else loads
        with matrices.report.stage(f"Geometric stiffness of {every.shape[1]} unit loads"):
            fields = model.whole(model.static(model.forces(every)))
            return gradients.geometric_stiffness(matrices.model.mesh, fields, modes.shapes)

    return matrices.kept(content_key(__name__, "by load", modes_key, loads, heavy), "geometric stiffness by load", make)


def stiffness_by_mode(matrices: Matrices, modes: Modes, modes_key: str) -> FloatArray:
    """Geometric stiffness (m, m, m) of unit modal coordinates; parameters as of `stiffness_by_load`."""

    def make() -> FloatArray:
        with matrices.report.stage(f"Geometric stiffness of {modes.shapes.shape[1]} modes"):
            return gradients.geometric_stiffness(matrices.model.mesh, modes.shapes, modes.shapes)

    return matrices.kept(content_key(__name__, "by mode", modes_key), "geometric stiffness by mode", make)


# Shapes that a basis gets, of all interfaces and of each, and the energy, as of `third_order_loads`, up to which it
# gets none: a thin annulus bends 22 % too little without them, at 43, a twisted beam 1.5 %, at 0.5, and 0.1 % without
# the one at 0.013. Of bodies that bend far: past its buckling a strip on edge was 1.2 % off without the one at 0.005,
# with it 0.7.
_MOST, _LEAST, _LEAST_FAR = (6, 2), 0.01, 0.003
# Motions that are combined: the softest ones.
_MOTIONS = 6
# Motions that turn the material less than this of the most turning one, in squares at the same energy, stretch it; of
# the second round. A strip that is twenty times as wide as thick turns 1/400 as much on edge, and yet evades sideways.
# A part of a cut body is pressed along itself by the others, which turns it by round-off.
_STIFF, _STIFFER, _ALONG = 1e-2, 1e-4, 1e-9
# Relative size of an eigenvalue below which loads depend on each other.
_DEPENDENT = 1e-10
# Numbers of the unit loads beyond which their forces of third order, some times as many, are not kept on disk.
_KEPT = 2_000_000
# Rotation of the material (rms, rad) at which shapes are compared: over all of it; of the second round, where it turns.
_TURN, _OWN_TURN = 0.5, 0.6
# Turn by displacements of second order over the square of the motions' (rms) from which they are coordinates of the
# shadow: 1.2 in a thin strip that both ends hold, with a boss on one face, 0.5 to 0.7 in a sheet on four corners with
# a rib. There the stretch holds 400 and 60 to 130 times the linear energy at 0.5 rad (rms), in lattices, bellows and
# blades, which do without such shapes, up to 0.5. How much less turn, in squares, is none, and how many shapes there
# are at most.
TURNING, TENSE, _NO_TURN, _TURNED = 0.4, 10.0, 1e-4, 21


def with_third_order(
    matrices: Matrices, modes: Modes, key: str, loads: FloatArray, far: bool, part: bool
) -> tuple[Modes, str]:
    """A basis with the shapes of second and third order that it lacks most, and its key.

    Of a body that bends far, or of a part of a cut one, they are more; other parameters as below.
    """
    least = _LEAST_FAR if far else _LEAST
    make = partial(third_order_loads, matrices, modes, loads, least, _MOST, part)
    forces = matrices.kept(content_key(__name__, key, loads, least, part), "static shapes of third order", make)
    return completed_basis(matrices, modes, key, forces)


def third_order_loads(
    matrices: Matrices, modes: Modes, loads: FloatArray, least: float, most: tuple[int, int], part: bool = False
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
    part : bool
        Whether motions count that hardly turn material: of a part, which others press along itself.

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
        for stiff, number in ((None, most[0]), (_ALONG if part else _STIFFER, most[1] * count)):
            forces, answer = _answered(matrices, loads, stiff)
            free, known = model.forces(forces), held(forces)
            taken = model.forces(found).T @ answer - held(found).T @ known
            # What they do outside the basis, and what is taken already.
            work = free.T @ answer
            values, axes = np.linalg.eigh(0.5 * (work + work.T) - known.T @ known - taken.T @ taken)
            chosen = np.flatnonzero(values > 2.0 * least)[::-1][:number]
            found = np.hstack([found, (forces - found @ taken) @ (axes[:, chosen] / np.sqrt(values[chosen]))])
    return found


def turning_loads(matrices: Matrices, loads: FloatArray) -> FloatArray:
    """Nodal forces whose static shapes are displacements of second order that turn the material, where any do.

    Parameters
    ----------
    matrices : Matrices
    loads : (3n, l) float
        Nodal forces of the interfaces' unit loads.

    Returns
    -------
    (3n, k) float
    """
    model, mesh = matrices.supported, matrices.model.mesh
    if not np.any(model.forces(loads)):
        return np.zeros((len(loads), 0))
    fields, energy = softest_motions(matrices, loads)
    pairs = np.array(list(combinations_with_replacement(range(fields.shape[1]), 2)))
    forces, held = gradients.quadratic_strain(mesh, fields, pairs, tell_nobody)
    answer = model.static(model.forces(forces))
    spin = gradients.mean_spin(mesh, model.whole(answer))
    tense = (0.5 * (held - model.forces(forces).T @ answer).diagonal()) > TENSE * np.sqrt(energy[pairs].prod(axis=1))
    enough = tense & (spin.diagonal() > (TURNING * _TURN**2) ** 2)
    turned, axes = np.linalg.eigh(spin)
    return forces @ axes[:, np.flatnonzero((turned > _NO_TURN * turned[-1]) & enough.any())[::-1][:_TURNED]]


_Motions = tuple[FloatArray, FloatArray]


def _answered(matrices: Matrices, loads: FloatArray, stiff: float | None) -> tuple[FloatArray, FloatArray]:
    """Forces (3n, k) by the stress of the softest motions of all loads, or of each interface's, and answers (f, k)."""
    model = matrices.supported

    def make() -> dict[str, FloatArray]:
        several = [softest_motions(matrices, loads)] if stiff is None else _by_interface(matrices, loads, stiff)
        forces = np.hstack([loads[:, :0], *(_forces(matrices, *motions) for motions in several)])
        return {"forces": forces, "answer": model.static(model.forces(forces))}

    kept = matrices.store if loads.size < _KEPT else Store()
    found = kept.arrays(content_key(__name__, f"forces {stiff}", matrices.key, loads), "forces", Reporter(), make)
    return found["forces"], found["answer"]


def _by_interface(matrices: Matrices, loads: FloatArray, stiff: float) -> Iterator[_Motions]:
    """The softest motions of each interface's loads, stiffer ones too, at the same energy, where that adds any.

    Of all together the softest may be those of other arms than the one that evades sideways. Stiff motions at large
    turns of their own would outweigh all others, under loads that no body bears.
    """
    each = np.arange(loads.shape[1]).reshape(2, -1, 3).swapaxes(0, 1).reshape(-1, 6)
    # Of one on a support nothing is asked.
    for own in filter(lambda one: matrices.supported.forces(loads[:, one]).any(), each):
        fields, energy = softest_motions(matrices, loads[:, own], stiff)
        known = own.size == loads.shape[1] and softest_motions(matrices, loads)[1].size
        if energy.size > known:
            first = energy[0] * _OWN_TURN**2 / gradients.own_spin(matrices.model.mesh, fields[:, :1])
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
    turned, axes = np.linalg.eigh(gradients.mean_spin(matrices.model.mesh, fields))
    chosen = np.flatnonzero(turned > stiff * turned[-1])[::-1][:_MOTIONS]
    scale = _TURN / np.sqrt(turned[chosen])
    # Their squares are twice the energy: the fields had a half of one.
    return fields @ (axes[:, chosen] * scale), 0.5 * scale**2


def _forces(matrices: Matrices, fields: FloatArray, energy: FloatArray) -> FloatArray:
    """Forces (3n, k) of (2c) for products of the motions' amplitudes, over the root of the motions' energy."""
    model, mesh = matrices.supported, matrices.model.mesh
    every = range(fields.shape[1])
    pairs = np.array(list(combinations_with_replacement(every, 2)))
    responses = -model.static(model.forces(gradients.quadratic_strain(mesh, fields, pairs, tell_nobody)[0]))
    pulled = gradients.stressed_gradients(mesh, fields, model.whole(responses), pairs)
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


# Motions, of which stiffer ones bear far more stress than they will; shapes in all, and of each motion. None counts
# beyond a turn of 0.5 rad (rms); the fourth motion does where it buckles the body with no more energy than the
# softest has there. With eight in all a channel whose flanges had buckled was 2.6 % off in silence; with three
# motions a wing's box of shells 4 %.
_BENT, _BUCKLED, _EACH = 4, 16, 6
# Of the iteration, whose shapes need not be exact: directions at a time, as many as cost one right-hand side, rounds at
# least and at most, relative error of what buckles, and energy, over a round's largest, that is round-off.
_BLOCK, _ROUNDS, _TOLERANCE, _NONE, _SEED = 3, (5, 20), 1e-2, 1e-20, 20261122


def buckling_loads(matrices: Matrices, loads: FloatArray, cut: bool) -> FloatArray:
    """Nodal forces (3n, k) whose static responses are shapes of buckling, K x = −λ K_σ x, of the smallest |λ|.

    K_σ is the geometric stiffness of one of the softest motions.

    Parameters
    ----------
    matrices : Matrices
    loads : (3n, l) float
        Nodal forces of the interfaces' unit loads.
    cut : bool
        Whether it is a part of a cut body, whose fourth motion is left out.

    Returns
    -------
    (3n, k) float
    """
    model = matrices.supported
    # Loads on a support do nothing.
    if model.free.size <= _BLOCK * _ROUNDS[1] or not np.any(model.forces(loads)):
        return np.zeros((len(loads), 0))
    (motions, energy), found = softest_motions(matrices, loads), []
    with matrices.report.counted("Find shapes of buckling", min(motions.shape[1], _BENT), "motions") as tell:
        for number, motion in enumerate(motions.T[:_BENT]):
            soft = np.sqrt(energy[0] / energy[number]) * motion
            if number < 3 or (not cut and _buckled_shapes(matrices, soft).size):
                found.append(_buckled_shapes(matrices, motion))
            tell(number)
    # The lowest of each motion first.
    ranked = [shape for level in zip_longest(*found) for shape in level if shape is not None][:_BUCKLED]
    return model.applied(model.whole(np.array(ranked).reshape(-1, model.free.size).T))


def _buckled_shapes(matrices: Matrices, motion: FloatArray) -> FloatArray:
    """Shapes (k, f) in which the stress of a motion (3n,), or its opposite, buckles the body, the first ones first.

    Block Lanczos iteration with K⁻¹K_σ, orthogonal in strain energy.
    """
    model, most = matrices.supported, _BLOCK * _ROUNDS[1]
    stress = model.unknowns.matrix(model.unknowns.in_means(gradients.stress_stiffness(matrices.model.mesh, motion)))
    spanned, held = np.zeros((2, most, model.free.size)).swapaxes(1, 2)
    work = np.zeros((most, most))
    block = model.static(np.random.default_rng(_SEED).standard_normal((model.free.size, _BLOCK)))
    force, inverse, ended = model.stiffness @ block, np.zeros(1), 0
    for number in range(1, _ROUNDS[1] + 1):
        energy, turn = np.linalg.eigh(block.T @ force)
        turn = (turn / np.sqrt(np.abs(energy)))[:, energy > _NONE * np.square(inverse).max()]
        own = slice(ended, ended := ended + turn.shape[1])
        spanned[:, own], held[:, own] = block @ turn, force @ turn
        pushed = stress @ spanned[:, own]
        work[:ended, own] = spanned[:, :ended].T @ pushed
        inverse, found = np.linalg.eigh(work[:ended, :ended], UPLO="U")
        # Those of the motion, and those of its opposite.
        ends = np.unique(np.arange(-(_EACH // 2), _EACH // 2) % ended)
        inverse, found = inverse[ends], found[:, ends]
        block = model.static(pushed)
        for _ in range(2):
            block -= spanned[:, :ended] @ (held[:, :ended].T @ block)
        force = model.stiffness @ block
        # What they have of the next round.
        left = np.sqrt(np.abs(np.einsum("ik,ij,jk->k", found[own], block.T @ force, found[own])))
        settled = left <= np.maximum(_TOLERANCE * np.abs(inverse), 1.0 - np.abs(inverse))
        if settled.all() and (number >= _ROUNDS[0] or not turn.size):
            break
    return (spanned[:, :ended] @ found[:, np.argsort(-np.abs(inverse))[: np.sum(np.abs(inverse) > 1.0)]]).T
