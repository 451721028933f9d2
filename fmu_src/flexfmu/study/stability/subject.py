"""What the maps are about: a body, reduced as they ask, and what a scene says or the body suggests."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...build.config import BodyFile, FormulationTable, read_body_file
from ...files.array_types import FloatArray
from ...files.progress import Reporter
from ...files.store import Store
from ...model.methods import Method
from ...model.reduced_body import ReducedBody
from ..records import Run, StabilityError
from ..scene.config import Map, SceneFile, StabilityTable, read_scene_file
from ..scene.scene import load_names
from ..workshop import Heard, build

# Modes and frames of what others are compared with.
_REFERENCE_MODES, _REFERENCE_FRAMES = 20, 16
# Components of a direction below this part of the largest are round-off.
_ROUND_OFF = 1e-6


Task = Callable[[], tuple[list[Run], list[str]]]
"""Makes some runs, and tells what was warned of."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A body and a scene.

    Attributes
    ----------
    config : BodyFile
    scene : SceneFile
    digest : str
    store : Store
    report : Reporter
    quiet : Heard
        For the many reductions: warnings only, once each.
    """

    config: BodyFile
    scene: SceneFile
    digest: str
    store: Store
    report: Reporter
    quiet: Heard

    @property
    def table(self) -> StabilityTable:
        """`[stability]`."""
        return self.scene.stability

    def silent(self) -> "Subject":
        """Return the same for another process: it keeps its warnings."""
        return replace(self, report=Reporter(), quiet=Heard())

    def blank(self, kind: Map, panel: str, x: str, y: str) -> Run:
        """A run that nothing is known of yet."""
        return Run(self.digest, self.config.name, kind.value, panel, x, y, "")

    def reduced(self, **changes: object) -> ReducedBody:
        """Body with changes of its `[reduction]`; `frames` and `method` are keys of their own."""
        update: dict[str, object] = {}
        if "frames" in changes:
            update |= {"frames": changes.pop("frames"), "frame": [], "branch": []}
        if "method" in changes:
            update["formulation"] = FormulationTable.model_validate({"method": changes.pop("method")})
        update["reduction"] = self.config.reduction.model_copy(update=changes)
        return build(self.config.model_copy(update=update).without_pictures, self.store, self.quiet).body

    def reference(self) -> FlexibleBody:
        """The finest body: many modes with residual flexibility, many frames, stiffness by load."""
        if self.config.cut:
            return FlexibleBody(self.reduced(residual_flexibility=True))
        body = self.reduced(
            modes=max(_REFERENCE_MODES, _mode_count(self.config)),
            residual_flexibility=True,
            frames=_REFERENCE_FRAMES,
            geometric_stiffness=["by_load"],
            method=Method.FRAMES,
        )
        return FlexibleBody(body)

    def interface(self, body: ReducedBody) -> int:
        """Place of the interface that is loaded and read."""
        name = self.table.interface
        if name is None:
            return int(np.argmax(np.abs(self.peak(body)[: 6 * body.interface_count]))) // 6
        if name not in body.interface_names:
            raise StabilityError(
                f"[stability] interface is {name!r}, expected one of the body's: {', '.join(body.interface_names)}"
            )
        return body.interface_names.index(name)

    def peak(self, body: ReducedBody) -> FloatArray:
        """Loads (L,) of the scene's first static case, as of `Loads.packed`."""
        inputs = np.zeros(6 * body.interface_count + (0 if body.masses is None else 3))
        names = load_names(body.interface_names)
        for name, value in self.scene.static[0].loads.items() if self.scene.static else ():
            if name in names:
                inputs[names.index(name)] = value
        if not inputs.any():
            raise StabilityError(
                "the scene has no [[static]] case with forces or moments on the body's interfaces, which the maps of "
                "stability start from: add one"
            )
        return inputs


def read_subject(body: Path, scene: Path, report: Reporter, store: Store) -> Subject:
    """Read a body file and a scene file.

    Parameters
    ----------
    body, scene : Path
    report : Reporter
    store : Store

    Returns
    -------
    Subject

    Raises
    ------
    FlexfmuError
        A wrong file.
    """
    config, file = read_body_file(body), read_scene_file(scene)
    digest = hashlib.sha256(config.model_dump_json(exclude={"mesh": {"file"}}).encode())
    digest.update(Path(config.mesh.file).read_bytes())
    varied = {"maps", "shares", "angles", "frames"}
    varied |= {"mass_ratios", "stiffness_ratios", "coupling_steps_per_period"}
    digest.update(file.stability.model_dump_json(exclude=varied).encode())
    digest.update(repr([(case.name, case.loads) for case in file.static[:1]]).encode())
    return Subject(config, file, digest.hexdigest()[:12], store, report, Heard(report))


def linear_response(body: ReducedBody, inputs: FloatArray) -> FloatArray:
    """Linear displacement and rotation of each interface, (I, 2, 3), under loads (L,)."""
    count = body.interface_count
    operator = np.stack([body.interface_displacement, body.interface_rotation], axis=1).reshape(6 * count, -1)
    elastic = body.angular_frequency > 0.0
    force = inputs[: 6 * count] @ operator
    q = np.zeros(body.mode_count)
    q[elastic] = force[elastic] / body.angular_frequency[elastic] ** 2
    return (operator @ q).reshape(count, 2, 3)


def unit(vector: FloatArray) -> FloatArray:
    """Vector of length one, round-off taken out."""
    cleaned = np.where(np.abs(vector) > _ROUND_OFF * np.max(np.abs(vector)), vector, 0.0)
    result: FloatArray = cleaned / np.linalg.norm(cleaned)
    return result


def period(body: ReducedBody) -> float:
    """Period of the lowest elastic mode, s."""
    return float(2.0 * np.pi / body.angular_frequency[body.rigid_count])


def _mode_count(config: BodyFile) -> int:
    modes = config.reduction.modes
    return modes if isinstance(modes, int) else len(modes)
