"""Every meaningful model of a body, tried on a scene and recorded one by one."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from ..build import reduce_body
from ..errors import AccuracyError
from ..progress import Reporter
from ..runtime.body import FlexibleBody
from ..runtime.errors import RuntimeBodyError
from ..runtime.modal_file import write_modal_file
from ..runtime.reduced_body import Formulation, ReducedBody
from ..store import Store
from .candidates import GIVEN, Candidate, Reduction, candidates, grouped, lean, reduction_config
from .fmu_cost import FmuTimer
from .measure import communication_step, errors, step_cost
from .records import Record, Records
from .reference import Reference, references
from .scene import Scene

_REUSED = "taken from an earlier build"


class _Listening(Reporter):
    """Passes warnings on and remembers whether something was taken from the store."""

    def __init__(self, report: Reporter):
        self._report = report
        self.reused = False

    def note(self, text: str) -> None:
        """Remember."""
        self.reused = self.reused or _REUSED in text


class Workshop:
    """Reduces a scene's body and measures models of it.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store, optional
        Where modes, and the references, are kept from run to run.
    """

    def __init__(self, scene: Scene, report: Reporter, store: Store | None = None):
        self.scene = scene
        self._report = report
        self._store = store or Store()
        self._known: dict[str, Reference] | None = None
        self._step: float | None = None

    @property
    def known(self) -> dict[str, Reference]:
        """The references, found when first needed."""
        if self._known is None:
            self._known = references(self.scene, self._report, self._store)
        return self._known

    def reduce(self, reduction: Reduction, formulations: list[Formulation]) -> tuple[ReducedBody, float, bool]:
        """Reduce the body; seconds that it took, and whether something came from an earlier build."""
        listening = _Listening(self._report)
        start = time.perf_counter()
        body = reduce_body(reduction_config(self.scene.config, reduction, formulations), listening, self._store)
        return body, time.perf_counter() - start, listening.reused

    def record(
        self,
        candidate: Candidate,
        body: ReducedBody,
        build: tuple[float, bool] = (float("nan"), False),
        timer: FmuTimer | None = None,
    ) -> Record:
        """Measure a candidate on a body that was reduced for it."""
        scene, reduction, formulation = self.scene, candidate.reduction, candidate.formulation
        slim = lean(body, formulation)
        words: dict[str, object] = {
            "scene": scene.digest,
            "body": scene.config.name,
            "basis": reduction.basis.value,
            "modes": reduction.modes,
            "frames": reduction.frames,
            "kinematics": formulation.kinematics.value,
            "loads": formulation.loads.value,
            "stiffness": formulation.stiffness.value,
            "mass": formulation.mass.value,
            "mode_count": body.mode_count,
            "frame_count": body.frame_count,
            "build_s": build[0],
            "build_reused": "yes" if build[1] else "no",
            "modal_bytes": modal_size(slim),
        }
        try:
            model = FlexibleBody(slim)
            found = asdict(errors(scene, self.known, model))
            failure = found.pop("failure")
            words |= found | {"note": failure, "status": "no answer" if failure else "ok"}
            if not failure:
                step = self.step(model)
                cost = step_cost(scene, model, step)
                words |= {
                    "step": step,
                    "step_us": 1e6 * cost.fastest,
                    "step_us_median": 1e6 * cost.median,
                    "iterations": cost.iterations,
                    "busy": cost.busy,
                }
                if timer is not None:
                    words |= timer.times(slim, scene, step)
        except RuntimeBodyError as error:
            words |= {"note": str(error), "status": "no answer"}
        return Record(**words)  # type: ignore[arg-type]

    def step(self, model: FlexibleBody) -> float:
        """Step (s) at which all models are timed."""
        if self._step is None:
            self._step = communication_step(self.scene, model)
        return self._step


def modal_size(body: ReducedBody) -> int:
    """Size of a body's modal file, bytes."""
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        path = Path(folder) / "modal.h5"
        write_modal_file(body, path)
        return path.stat().st_size


def sweep(
    scene: Scene,
    target: Path,
    report: Reporter,
    store: Store | None = None,
    fmu: bool = False,
) -> list[Record]:
    """Try every combination that a scene asks for and record it; what is in the records already is not tried again.

    Parameters
    ----------
    scene : Scene
    target : Path
        Records, CSV.
    report : Reporter
    store : Store, optional
    fmu : bool
        Whether to time steps through the FMU too, against an empty one.

    Returns
    -------
    list of Record

    Raises
    ------
    SceneError
    """
    kept = Records(target, scene.digest)
    wanted = candidates(scene)
    left = [candidate for candidate in wanted if kept.find(candidate.key) is None]
    report.note(f"{len(wanted)} combinations, {len(wanted) - len(left)} of them recorded already")
    workshop = Workshop(scene, report, store)
    if left:
        _ = workshop.known
    with _timer(fmu) as timer:
        for reduction, members in grouped(left):
            count = "own" if reduction.frames == GIVEN else reduction.frames
            title = f"{reduction.basis.value}, {reduction.modes} modes, {count} frames"
            with report.stage(f"{title}: {len(members)} formulations"):
                try:
                    body, seconds, reused = workshop.reduce(reduction, [member.formulation for member in members])
                except AccuracyError as error:
                    report.warning(f"{title}: {error}")
                    continue
                for member in members:
                    kept.append(workshop.record(member, body, (seconds, reused), timer))
    return kept.rows


@contextmanager
def _timer(wanted: bool) -> Iterator[FmuTimer | None]:
    if not wanted:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        yield FmuTimer(Path(folder))
