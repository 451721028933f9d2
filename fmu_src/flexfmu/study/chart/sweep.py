"""Models of a body, tried on a scene and recorded one by one."""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from ...body.flexible_body import FlexibleBody
from ...files.counts import plural
from ...files.errors import AccuracyError, SimulationError
from ...files.progress import Reporter
from ...files.store import Store
from ...model.errors import RuntimeBodyError
from ...model.methods import lean
from ...model.modal_file import write_modal_file
from ...model.reduced_body import ReducedBody
from ..scenes.candidates import REDUCED, Candidate, Reduction, candidates, grouped
from ..scenes.cost import equilibrium_time, step_cost
from ..scenes.fmu_cost import FmuTimer, fmu_timer
from ..scenes.jobs import Crew
from ..scenes.measure import Errors
from ..scenes.record_file import RecordFile
from ..scenes.scene import Scene
from ..scenes.words import BASES, frames_words
from ..scenes.workshop import Built, Workshop
from .extent import Grid, members
from .finite_elements import finite_element_records
from .records import KEY, LAYOUT, Record

Look = Callable[[str], None]
# A sweep that takes long is drawn as often as this, s.
_PAUSE = 30.0


def sweep(
    scene: Scene,
    target: Path,
    report: Reporter,
    store: Store | None = None,
    fmu: bool = True,
    crew: Crew | None = None,
    every: bool = True,
    look: Look = lambda _words: None,
) -> list[Record]:
    """Try models that a scene asks for and record them; what is in the records already is not tried again.

    Parameters
    ----------
    scene : Scene
    target : Path
        Records, CSV.
    report : Reporter
    store : Store, optional
    fmu : bool
        Whether to time steps through the FMU too, in turns with an empty one.
    crew : Crew, optional
        Processes that measure errors. Default: this one.
    every : bool
        Whether every combination is tried; else a coarse sweep, and then what is next to the front, as long as there
        is more.
    look : callable
        Called when there is something new to draw, with words that say how much of the sweep it is.

    Returns
    -------
    list of Record

    Raises
    ------
    SceneError
    """
    kept = RecordFile(LAYOUT, target, scene.digest)
    wanted = candidates(scene)
    report.note(f"{len(wanted)} combinations, {sum(c.key in kept for c in wanted)} of them recorded already")
    workshop = Workshop(scene, report, store, crew)
    grid = Grid.of(scene, wanted)
    drawing = _Drawing(grid, kept, look)
    with fmu_timer(fmu) as timer:
        if every:
            left = [c for c in wanted if c.key not in kept]
            try_models(workshop, "Try", left, kept, timer, drawing.now_and_then)
        else:
            _refine(workshop, drawing, timer)
    for record in finite_element_records(scene, workshop.known, workshop.whole, kept, report):
        kept.append(record)
    drawing.now()
    return kept.rows


class _Drawing:
    """Draws what is known of a sweep.

    Parameters
    ----------
    grid : Grid
    kept : RecordFile
    look : callable
        See `sweep`.
    """

    def __init__(self, grid: Grid, kept: RecordFile[Record], look: Look):
        self.grid, self.kept, self.coarse = grid, kept, False
        self._look, self._last = look, time.monotonic()

    @property
    def possible(self) -> bool:
        """Whether any model has an answer."""
        return any(row.status == "ok" and row.solver == REDUCED for row in self.kept.rows)

    def now(self) -> None:
        """Draw, and say how much of the sweep it is."""
        if self.possible:
            known = sum(model.key in self.kept for model in self.grid.models)
            self._look(f"{'coarse: ' if self.coarse else ''}{known} of {len(self.grid.models)} models")
        self._last = time.monotonic()

    def now_and_then(self) -> None:
        """Draw, unless that was done a moment ago."""
        if time.monotonic() - self._last > _PAUSE:
            self.now()


def _refine(workshop: Workshop, drawing: _Drawing, timer: FmuTimer | None) -> None:
    """Try few models, and then the neighbours of those on the front until all of them are known."""
    grid, kept = drawing.grid, drawing.kept
    title, wanted, drawing.coarse = "Coarse sweep: try", grid.coarse(), True
    while left := [c for c in wanted if c.key not in kept]:
        before = len(kept.rows)
        try_models(workshop, title, left, kept, timer, drawing.now_and_then)
        if len(kept.rows) == before:
            # What cannot be reduced leaves no record.
            break
        drawing.now()
        drawing.coarse = False
        title = "Finer where the front is: try"
        wanted = grid.around(members(kept.rows)) if drawing.possible else list(grid.models)
    drawing.coarse = False


def try_models(
    workshop: Workshop,
    title: str,
    wanted: Sequence[Candidate],
    kept: RecordFile[Record],
    timer: FmuTimer | None,
    now_and_then: Callable[[], None],
) -> None:
    """Measure and time some models, and record each.

    Errors are measured by the crew, as many reductions at once as it has processes. While models are timed it rests.

    Parameters
    ----------
    workshop : Workshop
    title : str
        What is done, before the number of models.
    wanted : sequence of Candidate
    kept : RecordFile
    timer : FmuTimer or None
    now_and_then : callable
        Called between reductions.
    """
    if not wanted:
        return
    _ = workshop.known
    report, done, size = workshop.report, 0, workshop.crew.count
    groups = list(grouped(wanted))
    with report.counted(f"{title} {len(wanted)} models", len(wanted), "models") as tell:
        for first in range(0, len(groups), size):
            some = groups[first : first + size]
            with report.stage("; ".join(_words(members) for members in some)):
                for members, found in zip(some, list(workshop.each(measure, [(one,) for one in some])), strict=True):
                    if isinstance(found, str):
                        report.warning(f"{_words(members)}: {found}")
                        done += len(members)
                        continue
                    for member, (built, errors) in zip(members, found, strict=True):
                        kept.append(record(workshop, member, built, errors, timer))
                        done += 1
                        tell(done)
            now_and_then()


def _words(members: Sequence[Candidate]) -> str:
    first = members[0].reduction
    modes = ", ".join(str(modes) for modes in dict.fromkeys(member.reduction.modes for member in members))
    return f"{BASES[first.basis.value]}, {modes} modes, {frames_words(first.frames)}: {plural(len(members), 'model')}"


def measure(workshop: Workshop, members: Sequence[Candidate]) -> list[tuple[Built, Errors]] | str:
    """Reduce the body for some models of one basis and division, and measure their errors.

    Parameters
    ----------
    workshop : Workshop
    members : sequence of Candidate

    Returns
    -------
    list of (Built, Errors), or str
        Why the body cannot be reduced so.
    """
    variants = list(dict.fromkeys(member.variant for member in members))
    bodies: dict[Reduction, Built] = {}
    try:
        for reduction in dict.fromkeys(member.reduction for member in members):
            bodies[reduction] = workshop.shared(reduction, variants)
    except AccuracyError as error:
        return str(error)
    return [(bodies[m.reduction], workshop.errors(bodies[m.reduction].body, m.variant, m.limits)) for m in members]


def record(
    workshop: Workshop, candidate: Candidate, built: Built, errors: Errors, timer: FmuTimer | None = None
) -> Record:
    """Time a model whose errors are known, unless it has no answer.

    Parameters
    ----------
    workshop : Workshop
    candidate : Candidate
    built : Built
        The body, reduced for it, and maybe for others.
    errors : Errors
    timer : FmuTimer, optional

    Returns
    -------
    Record
    """
    scene, reduction, body = workshop.scene, candidate.reduction, built.body
    slim = lean(body, candidate.variant)
    found = asdict(errors)
    failure = found.pop("failure")
    words: dict[str, object] = {
        "scene": scene.digest,
        "body": scene.config.name,
        **dict(zip(KEY, candidate.key, strict=True)),
        "modes": reduction.modes,
        "frames": reduction.frames,
        "mode_count": body.mode_count,
        "frame_count": body.frame_count,
        "build_s": built.seconds,
        "build_reused": "yes" if built.reused else "no",
        "modal_bytes": modal_size(slim),
        "note": failure,
        "status": "no answer" if failure else "ok",
        **found,
    }
    if not failure:
        try:
            model = FlexibleBody(slim, limits=candidate.limits)
            words |= _costs(workshop, model)
            if timer is not None:
                words |= _fmu_costs(workshop, timer, body, candidate, workshop.step(model))
        except RuntimeBodyError as error:
            words |= {"note": str(error), "status": "no answer"}
    return Record(**words)  # type: ignore[arg-type]


def _costs(workshop: Workshop, model: FlexibleBody) -> dict[str, object]:
    """What a model costs without FMI."""
    step = workshop.step(model)
    cost = step_cost(workshop.scene, model, step)
    return {
        "step": step,
        "step_us": 1e6 * cost.fastest,
        "step_us_median": 1e6 * cost.median,
        "iterations": cost.iterations,
        "busy": cost.busy,
        "bare_ms_per_s": 1e3 * cost.fastest / step,
        "equilibrium_ms": 1e3 * equilibrium_time(workshop.scene, model),
        "memory_bytes": model.core.bytes,
    }


def _fmu_costs(
    workshop: Workshop, timer: FmuTimer, body: ReducedBody, candidate: Candidate, step: float
) -> dict[str, object]:
    """What it costs through the FMU; a note where that does not run."""
    try:
        times = timer.times(body, workshop.scene, step, candidate.variant, candidate.limits)
    except SimulationError as error:
        workshop.report.warning(str(error))
        return {"note": str(error)}
    return {**times, "fmu_ms_per_s": 1e-3 * times["fmu_us"] / step}


def modal_size(body: ReducedBody) -> int:
    """Size of a body's modal file, bytes."""
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        path = Path(folder) / "modal.h5"
        write_modal_file(body, path)
        return path.stat().st_size
