"""The basis that a body file asks for and its geometric stiffness, found once and kept by content."""

from collections.abc import Callable
from copy import copy
from functools import cached_property

import numpy as np

from ..fe.assembly import stiffness
from ..fe.factorisation import solver_name
from ..fe.gradients import geometric_stiffness
from ..files.basics import FloatArray
from ..files.progress import Reporter
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
        # Of this one and of its quiet copies.
        self._supported: list[Supported] = []

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
        found = mesh.equations
        tied = () if found is None else (found.data, found.indices, found.indptr)
        stiff = [part for one in mesh.simplices for part in (one.nodes, one.stiffness)]
        hung = [part for one in mesh.masses for part in (one.mass, one.inertia, one.point, one.nodes)]
        supports = model.fixed, model.spring, model.rigid.shape, *model.bushings.key
        return content_key(__name__, mesh.points, *blocks, *materials, *supports, *tied, *stiff, *hung)

    @property
    def supported(self) -> Supported:
        """Both without the supports, factorised when first needed: where all is kept they never are."""
        if not self._supported:
            self._supported.append(self._factorised())
        return self._supported[0]

    def _factorised(self) -> Supported:
        model = self.model
        with self.report.stage("Assemble stiffness and mass"):
            # Without names for those of all degrees of freedom, which are not kept beside the factors.
            matrices = eliminated(
                stiffness(model.mesh) + model.unknowns.in_means(model.springs), model_mass(model.mesh), model.unknowns
            )
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
    model = matrices.model
    numbers = table.numbers
    if table.exact:
        return _numbered_basis(table, numbers, matrices, loads, residual)
    held = loads.shape[1] if table.kind is Basis.CRAIG_BAMPTON else 0
    # The iteration needs two unknowns more than it finds modes.
    most = model.free.size - model.rigid.shape[1] - held - 2
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


def stiffness_by_load(
    matrices: Matrices, modes: Modes, modes_key: str, loads: FloatArray, acceleration: bool
) -> FloatArray:
    """Geometric stiffness of unit loads.

    Parameters
    ----------
    matrices : Matrices
    modes : Modes
    modes_key : str
        As of `modal_basis`.
    loads : (3n, 6I) float
        Forces of all interfaces, then moments.
    acceleration : bool
        Whether unit accelerations of the supports come after them.

    Returns
    -------
    (6I, m, m) or (6I + 3, m, m) float
    """

    def make() -> FloatArray:
        model = matrices.supported
        # What the mass of the body does under a unit acceleration of its supports.
        every = np.hstack([loads, -model.inertia]) if acceleration else loads
        with matrices.report.stage(f"Geometric stiffness of {every.shape[1]} unit loads"):
            fields = model.whole(model.static(model.forces(every)))
            return geometric_stiffness(matrices.model.mesh, fields, modes.shapes)

    key = content_key(__name__, "by load", modes_key, loads, acceleration)
    return matrices.kept(key, "geometric stiffness by load", make)


def stiffness_by_mode(matrices: Matrices, modes: Modes, modes_key: str) -> FloatArray:
    """Geometric stiffness (m, m, m) of unit modal coordinates; parameters as of `stiffness_by_load`."""

    def make() -> FloatArray:
        with matrices.report.stage(f"Geometric stiffness of {modes.shapes.shape[1]} modes"):
            return geometric_stiffness(matrices.model.mesh, modes.shapes, modes.shapes)

    return matrices.kept(content_key(__name__, "by mode", modes_key), "geometric stiffness by mode", make)
