"""What the motion of a scene is: from the whole finite element model, a tight reduced one, or the user."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..build import reduce_body
from ..config import Basis, BodyFile
from ..errors import AccuracyError
from ..fe.assembly import mass, volume_matrices
from ..fe.faces import element_faces
from ..fe.nonlinear import load_path
from ..mesh.checks import checked
from ..mesh.formats import read_mesh
from ..mesh.model import FloatArray
from ..progress import Reporter
from ..reduction.basis import Matrices
from ..reduction.interfaces import Interface, fit_interface
from ..reduction.model import Model, assemble_model
from ..runtime.body import FlexibleBody
from ..runtime.errors import EquilibriumError, StepError
from ..runtime.loads import Loads
from ..runtime.reduced_body import Formulation, Mass
from ..runtime.rotations import exponential, rotation_vector
from ..runtime.stepping import StepLimits
from ..store import Store, content_key
from .errors import SceneError
from .scene import Scene, StaticCase, TransientCase, read_results

# A factor in a table of results counts as one of the scene's within this.
_SAME = 1e-9
_FIT_ROUNDS = 50
# Error of a reference in statics over what is accepted over time that is worth a warning.
_DOUBTFUL = 0.33


@dataclass(frozen=True, slots=True)
class Reference:
    """Motion of the interfaces that count.

    Attributes
    ----------
    motion : (rows, interfaces, 6) float
        Displacement (m) and rotation vector (rad) at each factor or communication point; not a number where nothing
        is known.
    origin : str
        Where it comes from, in words.
    doubt : float
        Of a reduced model: its own relative error in the scene's static cases, where the finite element model tells.
    """

    motion: FloatArray
    origin: str
    doubt: float = math.nan


def references(scene: Scene, report: Reporter, store: Store | None = None) -> dict[str, Reference]:
    """Find the motion of every case.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store, optional
        Where results are kept from run to run, by content.

    Returns
    -------
    dict of str to Reference
        By the name of the case.

    Raises
    ------
    SceneError
        A case that the finite element model cannot follow, and for which the user brings no results.
    """
    store = store or Store()
    whole = _Whole(scene.config, report)
    found: dict[str, Reference] = {}
    for case in scene.static:
        found[case.name] = (
            _whole_model(scene, case, whole, report, store) if case.results is None else _brought_static(scene, case)
        )
    for motion in scene.transient:
        found[motion.name] = (
            _tight_model(scene, motion, found, report, store)
            if motion.results is None
            else _brought_transient(scene, motion)
        )
    return found


class _Whole:
    """The finite element model, read once, when first needed."""

    def __init__(self, config: BodyFile, report: Reporter):
        self._config = config
        self._report = report

    @cached_property
    def model(self) -> Model:
        """Mesh and supports."""
        with self._report.stage(f"Read {self._config.mesh.file.name}"):
            return assemble_model(checked(read_mesh(self._config.mesh.file, self._config.mesh.units)), self._config)

    @cached_property
    def interfaces(self) -> list[Interface]:
        """The fits of the interfaces."""
        mesh = self.model.mesh
        faces = element_faces(mesh)
        return [fit_interface(table, mesh, faces, []) for table in self._config.interface]

    def load(self, case: StaticCase) -> FloatArray:
        """Nodal forces (3n,), N."""
        mesh = self.model.mesh
        result = np.zeros(3 * len(mesh.points))
        for interface, force in zip(self.interfaces, case.peak.force, strict=True):
            result += interface.nodal_loads(len(mesh.points))[:, :3] @ force
        if np.any(case.peak.acceleration):
            # In the frame of its supports every mass feels the opposite.
            result -= mass(mesh, volume_matrices(mesh)) @ np.tile(case.peak.acceleration, len(mesh.points))
        return result


def _whole_model(scene: Scene, case: StaticCase, whole: _Whole, report: Reporter, store: Store) -> Reference:
    if np.any(case.peak.moment):
        raise SceneError(
            f"{case.name}: the finite element model takes forces only, since the forces that make up a moment would "
            "have to turn with the interface; replace the moment by forces on two interfaces, or bring results: "
            f'results = "{case.name}.csv"'
        )
    model = whole.model
    if model.rigid.shape[1]:
        raise SceneError(
            f"{case.name}: the body is free to move, so that the finite element model has no equilibrium to compare "
            f'with; bring results: results = "{case.name}.csv"'
        )
    load = whole.load(case)

    def solve() -> dict[str, FloatArray]:
        with report.stage(f"Solve the finite element model under {case.name}"):
            try:
                path = load_path(model.mesh, model.free, model.spring, load, case.factors, report)
            except AccuracyError as error:
                raise SceneError(f"{case.name}: {error}; or bring results") from error
        return {"displacement": path.displacement}

    key = content_key("scene static", Matrices(model, (), report).key, load, np.array(case.factors))
    kept = store.arrays(key, f"equilibria of the finite element model under {case.name}", report, solve)
    chosen = [whole.interfaces[k] for k in scene.read_index]
    motion = np.array([[finite_motion(i, model.mesh.points, row) for i in chosen] for row in kept["displacement"]])
    return Reference(motion, f"finite element model, {len(model.mesh.points)} nodes, geometric nonlinearity")


def finite_motion(interface: Interface, points: FloatArray, displacement: FloatArray) -> FloatArray:
    """Displacement and rotation vector (6,) of the rigid motion that fits an interface's nodes best, however far.

    Parameters
    ----------
    interface : Interface
    points : (n, 3) float
    displacement : (3n,) float

    Returns
    -------
    (6,) float
    """
    arm = points[interface.nodes] - interface.point
    moved = arm + displacement.reshape(-1, 3)[interface.nodes]
    shift, rotation = np.zeros(3), np.eye(3)
    # The linear fit of what a rigid motion leaves, until it leaves nothing that is rigid.
    for _ in range(_FIT_ROUNDS):
        left = (moved - shift) @ rotation - arm
        change = interface.operator @ left.ravel()
        shift = shift + rotation @ change[:3]
        rotation = rotation @ exponential(change[3:])
        if np.linalg.norm(change[3:]) < 1e-12:
            break
    return np.concatenate([shift, rotation_vector(rotation)])


def _brought_static(scene: Scene, case: StaticCase) -> Reference:
    assert case.results is not None
    factors, motion = read_results(case.results, "factor", scene.read)
    rows = []
    for factor in case.factors:
        near = np.flatnonzero(np.abs(factors - factor) <= _SAME * max(1.0, factor))
        if not near.size:
            raise SceneError(
                f"{case.results}: no row for the factor {factor} of {case.name}; it has {factors.tolist()}"
            )
        rows.append(near[-1])
    return Reference(_complete(motion[rows], case.results), str(case.results.name))


def _brought_transient(scene: Scene, case: TransientCase) -> Reference:
    assert case.results is not None
    times, motion = read_results(case.results, "time", scene.read)
    if np.any(np.diff(times) <= 0.0) or times[0] > _SAME or times[-1] < case.time[-1] * (1.0 - _SAME):
        raise SceneError(
            f"{case.results}: times go from {times[0]} s to {times[-1]} s, expected them to ascend from 0 to at least "
            f"{case.time[-1]:g} s"
        )
    columns = motion.reshape(len(times), -1)
    at = np.column_stack([np.interp(case.time, times, column) for column in columns.T])
    return Reference(_complete(at.reshape(len(at), *motion.shape[1:]), case.results), str(case.results.name))


def _complete(motion: FloatArray, path: Path) -> FloatArray:
    if np.all(np.isnan(motion)):
        raise SceneError(f"{path}: no column is an output of an interface that the scene reads")
    return motion


def _tight_model(
    scene: Scene, case: TransientCase, known: Mapping[str, Reference], report: Reporter, store: Store
) -> Reference:
    """Motion of a model with more modes and frames than any that will be delivered."""
    settings, config = scene.file.reference, scene.config
    mass = settings.mass
    if config.cut or settings.frames == 0:
        mass = Mass.CONSTANT
    reduction = config.reduction.model_copy(
        update={
            "basis": Basis.NORMAL,
            "modes": settings.modes,
            "residual_flexibility": True,
            "geometric_stiffness": [],
            "inertia": mass is Mass.CONFIGURATION,
        }
    )
    tight = config.model_copy(update={"frames": settings.frames, "frame": [], "reduction": reduction})

    def run() -> dict[str, FloatArray]:
        body = reduce_body(tight, report, store)
        model = FlexibleBody(body, Formulation(mass=mass), limits=StepLimits(tolerance=settings.tolerance))
        steps = len(case.start_loads)
        with report.stage(
            f"Follow {case.name} with {body.mode_count} modes and {body.frame_count} frames, {steps} steps"
        ):
            try:
                return {"motion": follow(model, case), "doubt": np.array(_static_error(scene, known, model))}
            except StepError as error:
                raise SceneError(
                    f"{case.name}: the reference model refuses a step: {error}; take other numbers in [reference], or "
                    "bring results"
                ) from error

    mesh = hashlib.sha256(Path(config.mesh.file).read_bytes()).hexdigest()
    said = tight.model_dump_json(exclude={"mesh": {"file"}, "formulation": True})
    start = np.array([loads.packed(True) for loads in case.start_loads])
    end = np.array([loads.packed(True) for loads in case.end_loads])
    statics = [part for one in scene.static for part in (one.peak.packed(True), known[one.name].motion)]
    key = content_key("scene transient", mesh, said, mass.value, settings.tolerance, case.step, start, end, *statics)
    kept = store.arrays(key, f"reference motion under {case.name}", report, run)
    doubt, accepted = float(kept["doubt"]), scene.file.tolerance.transient.displacement
    if not math.isnan(doubt):
        report.note(f"the reference model of {case.name} is off by {100.0 * doubt:.2g} % in the static cases")
    if doubt > _DOUBTFUL * accepted:
        report.warning(
            f"{case.name}: the reference model itself is off by {100.0 * doubt:.2g} % in the static cases, where "
            f"{100.0 * accepted:g} % are accepted over time: errors over time say little; give [reference] more modes "
            "or frames, or bring results"
        )
    words = (
        f"reduced model, {settings.modes} modes and residual flexibility, frames = {settings.frames}, mass {mass.value}"
    )
    return Reference(kept["motion"][:, scene.read_index], words, doubt)


def _static_error(scene: Scene, known: Mapping[str, Reference], model: FlexibleBody) -> float:
    """Largest relative displacement error of a model in the static cases; infinite where it has no equilibrium."""
    worst = math.nan
    for case in scene.static:
        for factor, expected in zip(case.factors, known[case.name].motion[..., :3], strict=True):
            try:
                state = model.static(case.peak.scaled(factor))
            except EquilibriumError:
                return math.inf
            found = model.response(state).displacement[scene.read_index]
            told = np.all(np.isfinite(expected), axis=1)
            size = np.linalg.norm(expected[told])
            if size > 0.0:
                error = float(np.linalg.norm((found - expected)[told]) / size)
                worst = error if math.isnan(worst) else max(worst, error)
    return worst


def follow(model: FlexibleBody, case: TransientCase) -> FloatArray:
    """Motion (steps + 1, I, 6) of all interfaces from rest through a transient.

    Raises
    ------
    StepError
    """
    heavy = model.model.masses is not None
    start, end = _packed(case.start_loads, heavy), _packed(case.end_loads, heavy)
    state = model.rest()
    rows = [model.motion(state)]
    for first, last in zip(start, end, strict=True):
        same = np.array_equal(first, last)
        state, _ = model.step_packed(state, first, case.step, None if same else last)
        rows.append(model.motion(state))
    return np.array(rows).reshape(len(rows), -1, 6)


def _packed(loads: Sequence[Loads], heavy: bool) -> list[FloatArray]:
    return [one.packed(heavy) for one in loads]
