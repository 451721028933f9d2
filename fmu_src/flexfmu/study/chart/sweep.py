"""Models of a body, tried on a scene and recorded one by one: coarse, then finer where the front is.

The whole finite element model is among them: how long it takes for what a reduced model gives at each step.
"""

import math
import statistics
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...body.flexible_body import FlexibleBody
from ...files.basics import AccuracyError, RuntimeBodyError, SimulationError, plural
from ...files.outputs import Reporter
from ...files.store import Store
from ...model.methods import Mass, Method, has_frames
from ...model.modal_file import modal_bytes
from ...model.reduced_body import ReducedBody
from ...model.variants import lean
from .. import candidates
from ..candidates import Candidate, Reduction, frames_words
from ..fmu_cost import FmuTimer, fmu_timer
from ..front import QUANTITIES, cost_axis, front
from ..records import KEY, RECORDS, Record, RecordFile
from ..scene.config import BasisChoice, SceneError, ToleranceTable
from ..scene.reference import Reference, SceneErrors, equilibria_errors
from ..scene.scene import Scene
from ..scene.whole_model import WholeModel
from ..workshop import Built, Crew, Workshop

BROUGHT, OWN = "results", "flexfmu"
"""The solver of what the user brings, and the package's own."""


def finite_element_records(
    scene: Scene, known: Mapping[str, Reference], whole: WholeModel, kept: RecordFile[Record], report: Reporter
) -> Iterator[Record]:
    """Records of the finite element model, where they are not kept already.

    Static: one equilibrium, reached from the one before, stands against one step. Transient: what a simulated second
    takes, where the user tells.

    Parameters
    ----------
    scene : Scene
    known : mapping of str to Reference
    whole : WholeModel
    kept : RecordFile
        Of the reduced models, whose step and empty FMU are those that times are taken against.
    report : Reporter

    Yields
    ------
    Record
    """
    rows = [row for row in kept.rows if row.solver == candidates.REDUCED and row.status == "ok"]
    done = {(row.solver, row.case) for row in kept.rows}
    if not rows:
        return
    empty = [row.empty_us for row in rows if math.isfinite(row.empty_us)]
    empty_us = statistics.median(empty) if empty else math.nan
    plain = Record(scene.digest, scene.config.name, step=rows[0].step, empty_us=empty_us)
    for case in scene.static:
        if case.results_seconds is not None and (BROUGHT, case.name) not in done:
            count, seconds = known[case.name].equilibria, case.results_seconds
            note, spent = f"{count} equilibria in {seconds:.3g} s", 1e3 * seconds
            own = _timed(plain, BROUGHT, case.name, seconds / count, note=note, equilibrium_ms=spent)
            yield replace(own, static_displacement=0.0, share=0.0)
    for motion in scene.transient:
        if motion.seconds_per_second is not None and (BROUGHT, motion.name) not in done:
            note = f"{motion.seconds_per_second:.3g} s per simulated second"
            own = _timed(plain, BROUGHT, motion.name, motion.seconds_per_second * plain.step, note=note)
            yield replace(own, transient_displacement=0.0, share=0.0)
    if scene.static and scene.file.sweep.finite_elements and (OWN, scene.static[0].name) not in done:
        yield from _own(plain, scene, known, whole, report)


def _own(
    plain: Record, scene: Scene, known: Mapping[str, Reference], whole: WholeModel, report: Reporter
) -> Iterator[Record]:
    """Record of the package's own finite element model in the first static case; a word why where there is none."""
    case = scene.static[0]
    try:
        found = known[case.name].whole or whole.equilibria(case)
    except SceneError as error:
        report.note(f"no time of the finite element model: {error}")
        return
    yield _timed(
        plain,
        OWN,
        case.name,
        found.seconds / found.increments,
        equilibrium_ms=1e3 * found.seconds,
        iterations=found.iterations / found.increments,
        mode_count=whole.model.free.size,
        note=f"{len(case.factors)} equilibria in {found.seconds:.3g} s: {found.increments} increments, "
        f"{found.iterations} iterations",
        **equilibria_errors(scene, case, found.motion, known[case.name]).columns,
    )


def _timed(plain: Record, solver: str, case: str, seconds: float, **others: Any) -> Record:
    """Record of what takes so many seconds where a reduced model takes a step."""
    us = 1e6 * seconds
    others |= dict.fromkeys(("step_us", "step_us_median", "fmu_us"), us)
    others |= dict.fromkeys(("bare_ms_per_s", "fmu_ms_per_s"), 1e3 * seconds / plain.step)
    return replace(plain, solver=solver, case=case, fmu_ratio=us / plain.empty_us, **others)


_MAIN = (Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER)


@dataclass(frozen=True, slots=True)
class Grid:
    """The models of a scene's sweep, as neighbours of each other.

    Attributes
    ----------
    models : tuple of Candidate
    modes, frames : tuple of int
        In the order in which they follow each other.
    """

    models: tuple[Candidate, ...]
    modes: tuple[int, ...]
    frames: tuple[int, ...]

    @classmethod
    def of(cls, scene: Scene, models: Sequence[Candidate]) -> "Grid":
        """Grid of the models of a scene."""
        modes = sorted({model.reduction.modes for model in models})
        return cls(tuple(models), tuple(modes), tuple(candidates.offered_frames(scene.config, scene.file.sweep.frames)))

    def coarse(self) -> list[Candidate]:
        """Few modes and few frames under the main methods, in one basis."""
        methods = {m.variant.method for m in self.models}
        bases = {m.reduction.basis for m in self.models}
        steps = {m.internal_step for m in self.models} - {candidates.EXACT}
        step = candidates.SINGLE if candidates.SINGLE in steps else max(steps, default=candidates.EXACT)
        # Each method with the mass that it has by default, where that is listed.
        usual = [Mass.POLYNOMIAL, Mass.CONSTANT, Mass.CONFIGURATION].index
        masses = {
            way: min((m.variant.mass for m in self.models if m.variant.method is way), key=usual) for way in methods
        }
        # The fewest, and a middling number.
        modes, frames = ({listed[0], listed[len(listed) // 2]} for listed in (self.modes, self.frames))
        return [
            m
            for m in self.models
            if m.variant.method in (methods & set(_MAIN) or methods)
            and m.variant.mass is masses[m.variant.method]
            and m.reduction.basis is min(bases, key=lambda one: (one is not BasisChoice.RESIDUAL, one.value))
            and m.reduction.modes in modes
            and (not _divided(m) or m.reduction.frames in frames)
            and m.internal_step in (step, candidates.EXACT)
        ]

    def around(self, keys: Collection[tuple[str, ...]]) -> list[Candidate]:
        """Models that differ in one thing, by one number at most, from some that are given by their keys."""
        places = {model: self._place(model) for model in self.models}
        given = [place for model, place in places.items() if model.key in keys]
        return [model for model, place in places.items() if any(_distance(place, one) <= 1 for one in given)]

    def _place(self, model: Candidate) -> tuple[object, ...]:
        """What tells a model from its neighbours; None where that has no meaning for it."""
        reduction, variant = model.reduction, model.variant
        frames = self.frames.index(reduction.frames) if _divided(model) else None
        step = None if model.internal_step == candidates.EXACT else model.internal_step
        return self.modes.index(reduction.modes), frames, reduction.basis, variant.method, variant.mass, step


def _divided(model: Candidate) -> bool:
    method = model.variant.method
    return has_frames(method) and method is not Method.FLOATING_FRAME


def _distance(place: tuple[object, ...], other: tuple[object, ...]) -> int:
    pairs = [(a, b) for a, b in zip(place, other, strict=True) if None not in (a, b)]
    return sum(abs(a - b) if isinstance(a, int) and isinstance(b, int) else int(a != b) for a, b in pairs)


# What is so much more accurate than a scene asks for needs no neighbours.
_AMPLE = 0.1


def members(rows: Sequence[Record], asked: ToleranceTable | None = None) -> set[tuple[str, ...]]:
    """Keys of the models on the fronts of all that a chart shows, and of the error over the tolerance.

    Parameters
    ----------
    rows : sequence of Record
    asked : ToleranceTable, optional
        Those alone whose error there is above a tenth of it.
    """
    rows = [row for row in rows if row.solver == candidates.REDUCED and row.status == "ok"]
    axis, least = cost_axis(rows), dict.fromkeys(("share", *QUANTITIES), 0.0)
    if asked is not None:
        accepted = (1.0, asked.static.displacement, asked.transient.displacement)
        least = {q: _AMPLE * one for q, one in zip(least, accepted, strict=True)}
    shown = [q for q in least if any(getattr(row, q) > 0.0 for row in rows)]
    return {row.key for q in shown for row in front(rows, q, axis) if getattr(row, q) > least[q]}


Look = Callable[[str], None]


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
    kept = RecordFile(RECORDS, target, scene.digest)
    wanted = candidates.candidates(scene)
    report.note(f"{len(wanted)} combinations, {sum(c.key in kept for c in wanted)} of them recorded already")
    workshop = Workshop(scene, report, store, crew)
    with fmu_timer(fmu) as timer:
        trial = _Trial(workshop, Grid.of(scene, wanted), kept, timer, look)
        if every:
            trial.run("All combinations", wanted)
        else:
            trial.refine()
        trial.estimate()
    for record in finite_element_records(scene, workshop.known, workshop.whole, kept, report):
        kept.append(record)
    trial.draw()
    return kept.rows


class _Trial:
    """Tries the models of a sweep, records them, and has them drawn.

    Parameters
    ----------
    workshop : Workshop
    grid : Grid
    kept : RecordFile
    timer : FmuTimer or None
    look : callable
        See `sweep`.
    """

    def __init__(self, workshop: Workshop, grid: Grid, kept: RecordFile[Record], timer: FmuTimer | None, look: Look):
        self._workshop, self._grid, self._kept, self._timer, self._look = workshop, grid, kept, timer, look
        self._extent = ""

    @property
    def _drawable(self) -> bool:
        """Whether any model has an answer."""
        return any(row.status == "ok" and row.solver == candidates.REDUCED for row in self._kept.rows)

    def draw(self) -> None:
        """Draw, and say how much of the sweep it is."""
        if self._drawable:
            models = self._grid.models
            self._look(f"{self._extent}{sum(one.key in self._kept for one in models)} of {len(models)} models")

    def refine(self) -> None:
        """Try few models, and then neighbours of those on the front that are not far more accurate than asked for."""
        title, wanted, self._extent = "Coarse sweep", self._grid.coarse(), "coarse: "
        while any(one.key not in self._kept for one in wanted):
            before = len(self._kept.rows)
            self.run(title, wanted)
            if len(self._kept.rows) == before:
                # What cannot be reduced leaves no record.
                break
            if self._extent:
                self.draw()
            self._extent, title = "", "Finer near the front"
            asked = self._workshop.scene.file.tolerance
            wanted = self._grid.around(members(self._kept.rows, asked)) if self._drawable else list(self._grid.models)
        self._extent = ""

    def estimate(self) -> None:
        """Have the models on the fronts tell their own error in the static cases, once each."""
        shown = members(self._kept.rows) if self._drawable and self._workshop.scene.static else set()
        models = {one.key: one for one in self._grid.models}
        left = [row for row in self._kept.rows if row.key in shown and math.isnan(row.static_estimate)]
        alike: dict[Reduction, list[Record]] = {}
        # Those of one basis come together: what is found last is at hand.
        for row in sorted(left, key=lambda row: (row.basis, row.modes)):
            if row.key in models:
                alike.setdefault(self._workshop.most(models[row.key].reduction), []).append(row)
        if not alike:
            return
        own = [([models[row.key] for row in rows],) for rows in alike.values()]
        with self._workshop.report.counted("Own errors of the front", len(own), "reductions") as tell:
            told = zip(alike.values(), self._workshop.each(Workshop.own_errors, own), strict=True)
            for done, (rows, errors) in enumerate(told, start=1):
                self._kept.amend(replace(row, static_estimate=e) for row, e in zip(rows, errors, strict=True))
                tell(done)

    def run(self, title: str, wanted: Sequence[Candidate]) -> None:
        """Measure and time those of some models that are not recorded, and record each.

        SceneErrors are measured by the crew, as many reductions at once as it has processes. While models are timed it
        rests.
        """
        left = [one for one in wanted if one.key not in self._kept]
        if not left:
            return
        workshop, done = self._workshop, 0
        _ = workshop.known
        groups, size = list(candidates.grouped(left, workshop.most)), workshop.crew.count
        with workshop.report.counted(title, len(left), "models") as tell:
            for first in range(0, len(groups), size):
                some = groups[first : first + size]
                with workshop.report.stage("; ".join(_words(group) for group in some)):
                    for group, found in zip(some, list(workshop.each(measure, [(one,) for one in some])), strict=True):
                        if isinstance(found, str):
                            workshop.report.warning(f"{_words(group)}: {found}")
                            done += len(group)
                            continue
                        for member, (built, errors) in zip(group, found, strict=True):
                            self._kept.append(record(workshop, member, built, errors, self._timer))
                            done += 1
                            tell(done)


def _words(group: Sequence[Candidate]) -> str:
    reductions = [member.reduction for member in group]
    bases = ", ".join(dict.fromkeys(candidates.BASES[one.basis.value] for one in reductions))
    modes = ", ".join(dict.fromkeys(str(one.modes) for one in reductions))
    return f"{bases}, {modes} modes, {frames_words(reductions[0].frames)}: {plural(len(group), 'model')}"


def measure(workshop: Workshop, group: Sequence[Candidate]) -> list[tuple[Built, SceneErrors]] | str:
    """Reduce the body for some models of one basis and division, and measure their errors.

    Parameters
    ----------
    workshop : Workshop
    group : sequence of Candidate

    Returns
    -------
    list of (Built, SceneErrors), or str
        Why the body cannot be reduced so.
    """
    try:
        bodies = {one: workshop.shared(one) for one in dict.fromkeys(member.reduction for member in group)}
    except AccuracyError as error:
        return str(error)
    return [(bodies[m.reduction], workshop.errors(bodies[m.reduction].body, m.variant, m.limits)) for m in group]


def record(
    workshop: Workshop, candidate: Candidate, built: Built, errors: SceneErrors, timer: FmuTimer | None = None
) -> Record:
    """Time a model whose errors are known, unless it has no answer.

    Parameters
    ----------
    workshop : Workshop
    candidate : Candidate
    built : Built
        The body, reduced for it, and maybe for others.
    errors : SceneErrors
    timer : FmuTimer, optional

    Returns
    -------
    Record
    """
    body, slim = built.body, lean(built.body, candidate.variant)
    words: dict[str, object] = {
        "scene": workshop.scene.digest,
        "body": workshop.scene.config.name,
        **dict(zip(KEY, candidate.key, strict=True)),
        "modes": candidate.reduction.modes,
        "frames": candidate.reduction.frames,
        "mode_count": body.mode_count,
        "frame_count": body.frame_count,
        "build_s": built.seconds,
        "build_reused": "yes" if built.reused else "no",
        "modal_bytes": len(modal_bytes(slim)),
        **errors.columns,
    }
    failure = errors.failure
    if not failure:
        try:
            model = FlexibleBody(slim, limits=candidate.limits)
            words |= _costs(workshop, model)
            if timer is not None:
                words |= _by_fmu(workshop, timer, body, candidate, workshop.step(model))
        except RuntimeBodyError as error:
            failure = str(error)
    if failure:
        words |= {"note": failure, "status": "no answer"}
    return Record(**words)  # type: ignore[arg-type]


def _costs(workshop: Workshop, model: FlexibleBody) -> dict[str, object]:
    """What a model costs without FMI."""
    step, cost = workshop.step(model), workshop.time_steps(model)
    return {
        "step": step,
        "step_us": 1e6 * cost.fastest,
        "step_us_median": 1e6 * cost.median,
        "iterations": cost.iterations,
        "busy": cost.busy,
        "bare_ms_per_s": 1e3 * cost.fastest / step,
        "equilibrium_ms": 1e3 * workshop.time_equilibrium(model),
        "memory_bytes": model.core.bytes,
    }


def _by_fmu(workshop: Workshop, timer: FmuTimer, body: ReducedBody, model: Candidate, step: float) -> dict[str, object]:
    """What it costs through the FMU; a note where that does not run."""
    try:
        times = timer.times(body, workshop.scene, step, model.variant, model.limits)
    except SimulationError as error:
        workshop.report.warning(str(error))
        return {"note": str(error)}
    return {**times, "fmu_ms_per_s": 1e-3 * times["fmu_us"] / step}
