"""The whole finite element model of a scene's body: equilibria with geometric nonlinearity, and what they took."""

import time
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ...build.reduce import BodyModel, read_body_model
from ...fe.nonlinear import load_path
from ...files.basics import AccuracyError, FloatArray
from ...files.outputs import Reporter
from ...files.store import Store, content_key
from ...model.rotations import rotation_vector, skew, turned_by
from ...reduction.basis import Matrices
from ...reduction.bodies import InterfaceFit, fit_interface
from ...reduction.bushings import resisted
from ...reduction.model import Model
from ...reduction.rigid_fit import is_mean, model_mass
from .config import SceneError
from .scene import Scene, StaticCase

# Rounds in which a turn is found, to this; step of differences over the size of what they are of.
_FIT_ROUNDS, _FITTED, _SMALL = 50, 1e-12, 1e-5
# Share of the rotation in an interface's displacement above which its force is spread with a moment. Nodes beside an
# edge or a point, which count by a thousandth, stay below.
_OFF = 0.1


@dataclass(frozen=True, slots=True)
class Equilibria:
    """The whole model under the parts of a static case's load.

    Attributes
    ----------
    motion : (factors, interfaces, 6) float
        Displacement (m) and rotation vector (rad) of the interfaces that count.
    seconds : float
        Time that all of them took, one after the other, from the unloaded body.
    increments, iterations : int
        Equilibria on the way, and rounds of Newton's method.
    """

    motion: FloatArray
    seconds: float
    increments: int
    iterations: int


class WholeModel:
    """The finite element model, read once, when first needed.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store
        Where equilibria are kept from run to run, by content.
    """

    def __init__(self, scene: Scene, report: Reporter, store: Store):
        self._scene = scene
        self._report = report
        self._store = store

    @cached_property
    def model(self) -> Model:
        """Mesh and supports."""
        return self._body_model.model

    @cached_property
    def _body_model(self) -> BodyModel:
        return read_body_model(self._scene.config, self._report)

    @cached_property
    def interfaces(self) -> list[InterfaceFit]:
        """The fits of the interfaces."""
        return [fit_interface(table, self.model.mesh, []) for table in self._body_model.options.interfaces]

    def load(self, case: StaticCase) -> FloatArray:
        """Nodal forces (3n,) that do not depend on where nodes are, N."""
        mesh = self.model.mesh
        result = np.zeros(3 * len(mesh.points))
        for interface, force in zip(self.interfaces, case.peak.force, strict=True):
            if is_mean(interface.operator, _OFF):
                result += interface.nodal_loads(len(mesh.points))[:, :3] @ force
        if np.any(case.peak.acceleration):
            # In the frame of its supports every mass feels the opposite.
            result -= model_mass(mesh) @ np.tile(case.peak.acceleration, len(mesh.points))
        return result

    def turning(self, case: StaticCase) -> list["TurningLoad"]:
        """The other loads: moments, and forces on points that are not the centre of their nodes."""
        found = zip(self.interfaces, case.peak.force, case.peak.moment, strict=True)
        loads = [(i, np.stack([0.0 * f if is_mean(i.operator, _OFF) else f, m])) for i, f, m in found]
        return [TurningLoad(one, self.model.mesh.points, load) for one, load in loads if load.any()]

    def equilibria(self, case: StaticCase) -> Equilibria:
        """Equilibria under the parts of a case's load.

        Parameters
        ----------
        case : StaticCase

        Returns
        -------
        Equilibria

        Raises
        ------
        SceneError
            A free body, or no equilibrium.
        """
        if self.model.rigid.shape[1]:
            raise SceneError(
                f"{case.name}: the body is free to move, so that the finite element model has no equilibrium to "
                f'compare with; bring results: results = "{case.name}.csv"'
            )
        matrices = Matrices(self.model, self._report).key
        key = content_key(__name__, "scene equilibria", matrices, case.peak.packed(True), np.array(case.factors))
        title = f"equilibria of the finite element model under {case.name}"
        kept = self._store.arrays(key, title, self._report, partial(self._solve, case))
        chosen = [self.interfaces[k] for k in self._scene.read_index]
        motion = [[finite_motion(i, self.model.mesh.points, row) for i in chosen] for row in kept["displacement"]]
        seconds, increments, iterations = (float(x) for x in kept["effort"])
        return Equilibria(np.array(motion), seconds, int(increments), int(iterations))

    def _solve(self, case: StaticCase) -> dict[str, FloatArray]:
        model = self.model
        wall, own = time.perf_counter(), time.process_time()
        try:
            with self._report.stage(f"Solve the finite element model under {case.name}"):
                others = [*model.bushings.readings, *(turning := self.turning(case))]
                how = model.mesh, model.unknowns, model.spring, self.load(case), case.factors, self._report
                path = load_path(*how, partial(resisted, others) if others else None, bool(turning))
        except AccuracyError as error:
            raise SceneError(f"{case.name}: {error}; or bring results") from error
        # What other programs took of the processor meanwhile does not count, nor do threads.
        seconds = min(time.perf_counter() - wall, time.process_time() - own)
        return {"displacement": path.displacement, "effort": np.array([seconds, path.increments, path.iterations])}


class TurningLoad:
    """Force and moment on an interface, which work on its `finite_motion`.

    Nodal forces depend on displacements by sums over the nodes alone, of rows of the fit by places.

    Parameters
    ----------
    interface : InterfaceFit
    points : (n, 3) float
    load : (2, 3) float
        N and N m, about fixed axes.
    """

    def __init__(self, interface: InterfaceFit, points: FloatArray, load: FloatArray):
        self._load = load
        rows = interface.operator.reshape(6, -1, 3)
        arm = points[interface.nodes] - interface.point
        self._rows = np.einsum("ckj,il->cjikl", rows, np.eye(3)).reshape(54, -1)
        self._still = (self._rows @ arm.ravel()).reshape(6, 3, 3)
        self.columns = (3 * interface.nodes[:, None] + np.arange(3)).ravel()

    def _spread(self, sums: FloatArray) -> FloatArray:
        """How rows of the fit add up to nodal forces (54,), by sums (6, 3, 3)."""
        turn = np.eye(3)
        for _ in range(_FIT_ROUNDS):
            seen = sums @ turn
            read = np.trace(seen - self._still, axis1=1, axis2=2)
            turn = turn @ turned_by(read[3:])
            if np.linalg.norm(read[3:]) < _FITTED:
                break
        # Seen from where the point goes, in axes that turn along.
        seen[:3] -= np.eye(3)[:, :, None] * read[:3]
        motion = np.eye(6)
        motion[:, 3:] = -np.einsum("cjja->ca", skew(seen))
        return np.einsum("c,ij->cji", np.linalg.solve(motion.T, (self._load @ turn).ravel()), turn).ravel()

    def force(self, displacement: FloatArray, factor: float, derived: bool = True) -> tuple[FloatArray, FloatArray]:
        """Nodal forces (3k,) against displacements (3n,) by a part of the load, and their derivative, if asked for."""
        sums = self._still + (self._rows @ displacement[self.columns]).reshape(6, 3, 3)
        slopes = np.zeros((54, 54))
        step = _SMALL * np.abs(sums).max()
        for number, change in enumerate(step * np.eye(54 * derived, 54).reshape(-1, 6, 3, 3)):
            slopes[:, number] = (self._spread(sums + change) - self._spread(sums - change)) / (2.0 * step)
        return -factor * self._rows.T @ self._spread(sums), -factor * self._rows.T @ slopes @ self._rows


def finite_motion(interface: InterfaceFit, points: FloatArray, displacement: FloatArray) -> FloatArray:
    """Displacement and rotation vector (6,) of the rigid motion that fits an interface's nodes best, however far.

    Parameters
    ----------
    interface : InterfaceFit
    points : (n, 3) float
    displacement : (3n,) float

    Returns
    -------
    (6,) float
    """
    arm = points[interface.nodes] - interface.point
    moved = arm + displacement.reshape(-1, 3)[interface.nodes]
    shift, turn = np.zeros(3), np.eye(3)
    # The linear fit of what a rigid motion leaves, until it leaves nothing that is rigid.
    for _ in range(_FIT_ROUNDS):
        change = interface.operator @ ((moved - shift) @ turn - arm).ravel()
        shift = shift + turn @ change[:3]
        turn = turn @ turned_by(change[3:])
        if np.linalg.norm(change[3:]) < _FITTED:
            break
    return np.concatenate([shift, rotation_vector(turn)])
