"""Every meaningful model of a body, tried on a scene and recorded one by one."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from ..body import FlexibleBody
from ..build import reduce_body
from ..errors import AccuracyError, SimulationError
from ..methods import Variant, lean
from ..model.errors import RuntimeBodyError
from ..model.modal_file import write_modal_file
from ..model.reduced_body import ReducedBody
from ..progress import Reporter
from ..store import Store
from .candidates import GIVEN, Candidate, Reduction, candidates, grouped, reduction_config
from .finite_elements import finite_element_records
from .fmu_cost import FmuTimer
from .measure import communication_step, equilibrium_time, errors, step_cost
from .records import KEY, Record, Records
from .reference import Reference, references
from .scene import Scene
from .whole_model import WholeModel

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
        self.whole = WholeModel(scene, report, self._store)
        self._known: dict[str, Reference] | None = None
        self._step: float | None = None

    @property
    def known(self) -> dict[str, Reference]:
        """The references, found when first needed."""
        if self._known is None:
            self._known = references(self.scene, self._report, self._store, self.whole)
        return self._known

    def reduce(self, reduction: Reduction, variants: list[Variant]) -> tuple[ReducedBody, float, bool]:
        """Reduce the body; seconds that it took, and whether something came from an earlier build."""
        listening = _Listening(self._report)
        start = time.perf_counter()
        config = reduction_config(self.scene.config, reduction, variants).without_pictures
        body = reduce_body(config, listening, self._store)
        return body, time.perf_counter() - start, listening.reused

    def record(
        self,
        candidate: Candidate,
        body: ReducedBody,
        build: tuple[float, bool] = (float("nan"), False),
        timer: FmuTimer | None = None,
    ) -> Record:
        """Measure a candidate on a body that was reduced for it, and maybe for others."""
        scene, reduction, variant = self.scene, candidate.reduction, candidate.variant
        slim = lean(body, variant)
        words: dict[str, object] = {
            "scene": scene.digest,
            "body": scene.config.name,
            **dict(zip(KEY, candidate.key, strict=True)),
            "modes": reduction.modes,
            "frames": reduction.frames,
            "mode_count": body.mode_count,
            "frame_count": body.frame_count,
            "build_s": build[0],
            "build_reused": "yes" if build[1] else "no",
            "modal_bytes": modal_size(slim),
        }
        try:
            model = FlexibleBody(slim, limits=candidate.limits)
            found = asdict(errors(scene, self.known, model))
            failure = found.pop("failure")
            words |= found | {"note": failure, "status": "no answer" if failure else "ok"}
            if not failure:
                words |= self._costs(model)
                if timer is not None:
                    words |= self._fmu_costs(timer, body, candidate, self.step(model))
        except RuntimeBodyError as error:
            words |= {"note": str(error), "status": "no answer"}
        return Record(**words)  # type: ignore[arg-type]

    def _costs(self, model: FlexibleBody) -> dict[str, object]:
        """What a model costs without FMI."""
        step = self.step(model)
        cost = step_cost(self.scene, model, step)
        return {
            "step": step,
            "step_us": 1e6 * cost.fastest,
            "step_us_median": 1e6 * cost.median,
            "iterations": cost.iterations,
            "busy": cost.busy,
            "bare_ms_per_s": 1e3 * cost.fastest / step,
            "equilibrium_ms": 1e3 * equilibrium_time(self.scene, model),
            "memory_bytes": model.core.bytes,
        }

    def _fmu_costs(self, timer: FmuTimer, body: ReducedBody, candidate: Candidate, step: float) -> dict[str, object]:
        """What it costs through the FMU; a note where that does not run."""
        try:
            times = timer.times(body, self.scene, step, candidate.variant, candidate.limits)
        except SimulationError as error:
            self._report.warning(str(error))
            return {"note": str(error)}
        return {**times, "fmu_ms_per_s": 1e-3 * times["fmu_us"] / step}

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
    fmu: bool = True,
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
        Whether to time steps through the FMU too, in turns with an empty one.

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
    done = 0
    with _timer(fmu) as timer, report.counted(f"Try {len(left)} models", len(left), "models") as tell:
        for reduction, members in grouped(left):
            count = "own" if reduction.frames == GIVEN else reduction.frames
            title = f"{reduction.basis.value}, {reduction.modes} modes, {count} frames"
            with report.stage(f"{title}: {len(members)} methods"):
                try:
                    body, seconds, reused = workshop.reduce(reduction, [member.variant for member in members])
                except AccuracyError as error:
                    report.warning(f"{title}: {error}")
                    done += len(members)
                    continue
                for member in members:
                    kept.append(workshop.record(member, body, (seconds, reused), timer))
                    done += 1
                    tell(done)
    for record in finite_element_records(scene, workshop.known, workshop.whole, kept, report):
        kept.append(record)
    return kept.rows


@contextmanager
def _timer(wanted: bool) -> Iterator[FmuTimer | None]:
    if not wanted:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder, FmuTimer(Path(folder)) as timer:
        yield timer
