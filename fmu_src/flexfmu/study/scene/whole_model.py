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
from ...model.rotations import rotation_vector, turned_by
from ...reduction.basis import Matrices
from ...reduction.bodies import InterfaceFit, fit_interface
from ...reduction.model import Model
from ...reduction.rigid_fit import is_mean, model_mass
from .config import SceneError
from .scene import Scene, StaticCase

_FIT_ROUNDS = 50
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
        """Nodal forces (3n,), N."""
        mesh = self.model.mesh
        result = np.zeros(3 * len(mesh.points))
        for interface, force in zip(self.interfaces, case.peak.force, strict=True):
            result += interface.nodal_loads(len(mesh.points))[:, :3] @ force
        if np.any(case.peak.acceleration):
            # In the frame of its supports every mass feels the opposite.
            result -= model_mass(mesh) @ np.tile(case.peak.acceleration, len(mesh.points))
        return result

    def refusal(self, case: StaticCase) -> str:
        """Why a case cannot be followed; empty where it can."""
        if np.any(case.peak.moment):
            return (
                f"{case.name}: the finite element model takes forces only, since the forces that make up a moment "
                "would have to turn with the interface; replace the moment by forces on two interfaces, or bring "
                f'results: results = "{case.name}.csv"'
            )
        pushed = [one for one, force in zip(self.interfaces, case.peak.force, strict=True) if np.any(force)]
        if off := [one.name for one in pushed if not is_mean(one.operator, _OFF)]:
            return (
                f"{case.name}: the point of interface {off[0]!r} lies off the centre of its nodes, so that its force "
                "is spread with a moment, which would have to turn with the interface in finite elements; leave "
                f'`point` out, or bring results: results = "{case.name}.csv"'
            )
        if self.model.rigid.shape[1]:
            return (
                f"{case.name}: the body is free to move, so that the finite element model has no equilibrium to "
                f'compare with; bring results: results = "{case.name}.csv"'
            )
        return ""

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
            A moment, a free body, or no equilibrium.
        """
        if refusal := self.refusal(case):
            raise SceneError(refusal)
        load = self.load(case)
        matrices = Matrices(self.model, self._report).key
        key = content_key(__name__, "scene equilibria", matrices, load, np.array(case.factors))
        title = f"equilibria of the finite element model under {case.name}"
        kept = self._store.arrays(key, title, self._report, partial(self._solve, case, load))
        chosen = [self.interfaces[k] for k in self._scene.read_index]
        motion = [[finite_motion(i, self.model.mesh.points, row) for i in chosen] for row in kept["displacement"]]
        seconds, increments, iterations = (float(x) for x in kept["effort"])
        return Equilibria(np.array(motion), seconds, int(increments), int(iterations))

    def _solve(self, case: StaticCase, load: FloatArray) -> dict[str, FloatArray]:
        model = self.model
        wall, own = time.perf_counter(), time.process_time()
        try:
            with self._report.stage(f"Solve the finite element model under {case.name}"):
                bushings = model.bushings.forces if model.bushings.readings else None
                path = load_path(model.mesh, model.unknowns, model.spring, load, case.factors, self._report, bushings)
        except AccuracyError as error:
            raise SceneError(f"{case.name}: {error}; or bring results") from error
        # What other programs took of the processor meanwhile does not count, nor do threads.
        seconds = min(time.perf_counter() - wall, time.process_time() - own)
        return {"displacement": path.displacement, "effort": np.array([seconds, path.increments, path.iterations])}


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
        left = (moved - shift) @ turn - arm
        change = interface.operator @ left.ravel()
        shift = shift + turn @ change[:3]
        turn = turn @ turned_by(change[3:])
        if np.linalg.norm(change[3:]) < 1e-12:
            break
    return np.concatenate([shift, rotation_vector(turn)])
