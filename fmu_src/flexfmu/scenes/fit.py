"""The smallest, fastest model of a body that a scene's tolerance allows, with the reason of each choice."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..build import reduce_body
from ..config import BodyFile, read_body_file
from ..errors import AccuracyError
from ..mesh.model import FloatArray, IntArray
from ..progress import Reporter
from ..runtime.body import FlexibleBody
from ..runtime.errors import EquilibriumError, RuntimeBodyError
from ..runtime.reduced_body import Formulation, Kinematics, LoadPlacement, Mass, ReducedBody, Stiffness
from ..store import Store
from ..targets import check_target, whole_file
from .body_text import body_text
from .candidates import (
    GIVEN,
    Candidate,
    Reduction,
    has_meaning,
    lean,
    linear_frames,
    offered_frames,
    reduction_config,
    with_modes,
)
from .config import BasisChoice
from .measure import Errors, errors, step_cost
from .scene import Scene
from .sweep import Workshop

_LADDER = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32)
# Steps whose times differ by less cost the same.
_SAME_COST = 0.05
# What takes less than this share off the error is not what limits it.
_HELPS = 0.1
# Share of an error that may be added to it where the tolerance is out of reach anyway, for the sake of fewer modes.
_SPARE = 0.05
_TIMINGS = 3
# Relative difference of frequencies below which two modes are a pair.
_PAIR = 1e-4
# Frames are given up when so many more tries have not helped.
_PATIENCE = 2


@dataclass(frozen=True, slots=True)
class Fit:
    """What was found.

    Attributes
    ----------
    candidate : Candidate
    met : bool
        Whether the tolerance is met, as measured on the file that was written.
    predicted, measured, given : Errors
        Of the search, of the file, and of the body as the user has it.
    step, given_step : float
        Time of a step of the bare model, s; not a number where the body as given has no answer.
    mode_count, given_mode_count : int
    reasons : dict of str to str
        By the key of the body file.
    limit : str
        Where the tolerance is not met: what stands in the way.
    """

    candidate: Candidate
    met: bool
    predicted: Errors
    measured: Errors
    given: Errors
    step: float
    given_step: float
    mode_count: int
    given_mode_count: int
    reasons: dict[str, str]
    limit: str

    @property
    def summary(self) -> list[str]:
        """The result in a few lines."""
        where = f" ({self.measured.limited_by})" if self.measured.limited_by else ""
        lines = [
            f"Error over tolerance: predicted {_short(self.predicted.share)}, measured {_short(self.measured.share)}"
            f"{where}; {_in_percent(self.measured)}.",
            f"{self.mode_count} modes; a step of the bare model takes {1e6 * self.step:.3g} µs.",
        ]
        if math.isfinite(self.given_step):
            gain = self.given_step / self.step
            words = f"{gain:.2g} times as fast" if gain >= 1.0 else f"{1.0 / gain:.2g} times as slow"
            lines.append(
                f"As given: {_short(self.given.share)} of the tolerance, {self.given_mode_count} modes, "
                f"{1e6 * self.given_step:.3g} µs; this is {words}."
            )
        else:
            lines.append(f"As given the body has no answer in this scene: {self.given.failure}")
        return [*lines, self.limit] if self.limit else lines


@dataclass(slots=True)
class _Tried:
    """Models tried under one formulation."""

    formulation: Formulation
    shares: dict[int, Errors] = field(default_factory=dict)

    @property
    def enough(self) -> int | None:
        """The fewest frames within the tolerance."""
        return next((n for n, found in self.shares.items() if found.share <= 1.0), None)

    @property
    def stuck(self) -> bool:
        """Whether more frames have stopped helping."""
        last = [found.share for found in self.shares.values()][-_PATIENCE - 1 :]
        return len(last) > _PATIENCE and math.isfinite(last[0]) and min(last[1:]) > (1.0 - _HELPS) * last[0]


class _Search:
    """Tries models and remembers what it reduced."""

    def __init__(self, workshop: Workshop, report: Reporter):
        self.workshop = workshop
        self.scene = workshop.scene
        self._report = report
        self._bodies: dict[Reduction, tuple[ReducedBody, frozenset[Formulation]]] = {}

    def body(self, reduction: Reduction, formulations: list[Formulation]) -> ReducedBody:
        """Reduce the body for some formulations, once."""
        known = self._bodies.get(reduction)
        if known is None or not set(formulations) <= known[1]:
            body, _, _ = self.workshop.reduce(reduction, formulations)
            known = self._bodies[reduction] = body, frozenset(formulations)
        return known[0]

    def errors(self, body: ReducedBody, formulation: Formulation) -> Errors:
        """Error of a reduced body under a formulation."""
        try:
            return errors(self.scene, self.workshop.known, FlexibleBody(lean(body, formulation)))
        except RuntimeBodyError as error:
            return Errors(failure=str(error))

    def cost(self, body: ReducedBody, formulation: Formulation) -> float:
        """Fastest step, s."""
        model = FlexibleBody(lean(body, formulation))
        return step_cost(self.scene, model, self.workshop.step(model)).fastest


def fit(scene: Scene, target: Path, report: Reporter, store: Store | None = None) -> Fit:
    """Find the smallest, fastest model within the scene's tolerance and write it as a body file.

    Parameters
    ----------
    scene : Scene
    target : Path
        Body file to write; ends in .toml.
    report : Reporter
    store : Store, optional

    Returns
    -------
    Fit

    Raises
    ------
    FlexfmuError
        The file cannot be written, or a scene without a reference.
    """
    check_target(target, (".toml",), inputs=(scene.body,))
    search = _Search(Workshop(scene, report, store), report)
    _ = search.workshop.known
    plenty = max(scene.file.sweep.modes)
    tried = _frames_needed(search, plenty, report)
    enough = [one for one in tried if one.enough is not None]
    if enough:
        limit, allowed = "", 1.0
        chosen = [(one, one.enough) for one in tried if one.enough is not None]
    else:
        one, frames = min(((t, n) for t in tried for n in t.shares), key=lambda p: p[0].shares[p[1]].share)
        limit = _limit(search, one, frames, plenty)
        allowed = (1.0 + _SPARE) * one.shares[frames].share
        chosen = [(one, frames)]
    found = [choice for one, frames in chosen for choice in _modes_needed(search, one, frames, plenty, allowed)]
    if not found:
        # Only so many modes with everything: as the frames were found.
        one, frames = chosen[0]
        reduction = Reduction(BasisChoice.RESIDUAL, plenty, frames)
        body = search.body(reduction, [one.formulation])
        found = [_Choice(Candidate(reduction, one.formulation), body, one.shares[frames])]
    best = _cheapest(search, found)
    reasons = _reasons(search, tried, found, best, plenty)
    return _deliver(search, best, reasons, limit, target, store)


@dataclass(slots=True)
class _Choice:
    """A model that will do."""

    candidate: Candidate
    body: ReducedBody
    errors: Errors
    cost: float = math.inf


def _formulations(scene: Scene) -> list[Formulation]:
    """What may do, roughly by cost; readings that are there for comparison are left out."""
    sweep = scene.file.sweep
    linear, turned = Kinematics.LINEAR, Kinematics.COROTATED
    undeformed, deformed = LoadPlacement.REFERENCE, LoadPlacement.DEFORMED
    found = [Formulation(linear, undeformed)]
    if LoadPlacement.REFERENCE in sweep.loads:
        found.append(Formulation(turned, undeformed))
    if Stiffness.BY_LOAD in sweep.stiffness:
        found.append(Formulation(linear, undeformed, Stiffness.BY_LOAD))
    found.append(Formulation(turned, deformed))
    if Stiffness.BY_LOAD in sweep.stiffness:
        found.append(Formulation(turned, deformed, Stiffness.BY_LOAD))
    if scene.transient and Mass.CONFIGURATION in sweep.mass:
        found.append(Formulation(turned, deformed, mass=Mass.CONFIGURATION))
    flat = linear_frames(scene.config)
    smallest = [Reduction(BasisChoice.NORMAL, 1, flat if f.kinematics is linear else 1) for f in found]
    return [f for f, r in zip(found, smallest, strict=True) if has_meaning(scene.config, Candidate(r, f))]


def _frames_needed(search: _Search, plenty: int, report: Reporter) -> list[_Tried]:
    """Under each formulation the fewest frames that will do, with plenty of modes."""
    scene = search.scene
    tried = [_Tried(formulation) for formulation in _formulations(scene)]
    most = max(scene.file.sweep.frames)
    flat = linear_frames(scene.config)
    turned = offered_frames(scene.config, (n for n in _LADDER if n <= most))
    for frames, only_linear in ((flat, True), *((n, False) for n in turned)):
        if any(o.enough is not None for o in tried if o.formulation.kinematics is Kinematics.LINEAR):
            break
        wanted = [
            one
            for one in tried
            if (one.formulation.kinematics is Kinematics.LINEAR) == only_linear and one.enough is None and not one.stuck
        ]
        # The deformed body's mass is dear: only where nothing cheaper will do.
        cheap = [one for one in wanted if one.formulation.mass is Mass.CONSTANT]
        if any(one.enough is not None for one in tried if one.formulation.mass is Mass.CONSTANT):
            wanted = cheap
        if not wanted:
            continue
        with report.stage(f"Try {_frames(frames)} with {plenty} modes"):
            body = search.body(Reduction(BasisChoice.RESIDUAL, plenty, frames), [one.formulation for one in wanted])
            for one in wanted:
                one.shares[frames] = search.errors(body, one.formulation)
        for one in wanted:
            report.note(f"{_words(one.formulation)}: {_short(one.shares[frames].share)} of the tolerance")
    return [one for one in tried if one.shares]


def _modes_needed(search: _Search, one: _Tried, frames: int, plenty: int, allowed: float) -> list[_Choice]:
    """In each basis the fewest modes that will do."""
    found = []
    formulation = one.formulation
    for basis in search.scene.file.sweep.basis:
        # The parts of a cut body have modes of their own.
        whole = basis is BasisChoice.NORMAL and not search.scene.config.cut
        fewest = _fewest_normal if whole else _fewest_completed
        choice = fewest(search, basis, formulation, frames, plenty, allowed)
        if choice is not None:
            found.append(choice)
    return found


def _fewest_normal(
    search: _Search, basis: BasisChoice, formulation: Formulation, frames: int, plenty: int, allowed: float
) -> _Choice | None:
    """Fewest normal modes: those of lower frequency are the same however many there are, so one reduction serves."""
    body = search.body(Reduction(basis, plenty, frames), [formulation])
    rigid = body.rigid_count

    def model(count: int) -> tuple[ReducedBody, Errors]:
        kept = with_modes(body, np.arange(rigid + count))
        return kept, search.errors(kept, formulation)

    def enough(count: int) -> bool:
        # Of a pair of the same frequency one alone lies anywhere in their plane: the file would give another.
        pair = body.angular_frequency[rigid + count - 1 : rigid + count + 1]
        return not (pair.size == 2 and pair[1] < (1.0 + _PAIR) * pair[0]) and model(count)[1].share <= allowed

    count = _fewest(1, plenty, enough, formulation)
    if count is None:
        return None
    kept, found = model(count)
    return _Choice(Candidate(Reduction(basis, count, frames), formulation), kept, found)


def _fewest_completed(
    search: _Search, basis: BasisChoice, formulation: Formulation, frames: int, plenty: int, allowed: float
) -> _Choice | None:
    """Fewest modes beside those of the interfaces, which change with them."""
    for count in (n for n in _LADDER if n <= plenty):
        reduction = Reduction(basis, count, frames)
        try:
            body = search.body(reduction, [formulation])
        except AccuracyError:
            continue
        found = search.errors(body, formulation)
        if found.share <= allowed:
            return _Choice(Candidate(reduction, formulation), body, found)
    return None


def _fewest(first: int, last: int, enough: Callable[[int], bool], formulation: Formulation) -> int | None:
    """The smallest number that is enough; by halves where each try takes long."""
    if formulation.mass is Mass.CONSTANT:
        return next((n for n in range(first, last + 1) if enough(n)), None)
    if not enough(last):
        return None
    low, high = first - 1, last
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _cheapest(search: _Search, found: list[_Choice]) -> _Choice:
    """The fastest; of those that are as fast the one of the fewest modes."""
    # In turns, so that what else the machine does meets all of them.
    for _ in range(_TIMINGS):
        for choice in found:
            choice.cost = min(choice.cost, search.cost(choice.body, choice.candidate.formulation))
    fastest = min(choice.cost for choice in found)
    close = [choice for choice in found if choice.cost <= (1.0 + _SAME_COST) * fastest]
    return min(close, key=lambda choice: (choice.body.mode_count, choice.cost))


def contributions(scene: Scene, body: ReducedBody, formulation: Formulation) -> FloatArray:
    """How much each mode moves the scene's interfaces.

    Parameters
    ----------
    scene : Scene
    body : ReducedBody
        With the interfaces of `scene.config`.
    formulation : Formulation

    Returns
    -------
    (m,) float
        The largest displacement that the mode adds to an interface that counts, over that interface's displacement,
        under any load of the scene (of a transient: under its largest, held still).
    """
    model = FlexibleBody(lean(body, formulation))
    loads = [case.peak.scaled(case.factors[-1]) for case in scene.static]
    for transient in scene.transient:
        every = [*transient.start_loads, *transient.end_loads]
        loads.append(max(every, key=lambda one: float(np.linalg.norm(one.packed(True)))))
    part = np.zeros(body.mode_count)
    shapes = body.interface_displacement[scene.read_index]
    for one in loads:
        try:
            q = model.static(one).q
        except EquilibriumError:
            continue
        each = np.linalg.norm(shapes * q, axis=1)
        size = np.linalg.norm(shapes @ q, axis=1)
        moving = size > 1e-3 * np.max(size, initial=0.0)
        if np.any(moving):
            part = np.maximum(part, np.max(each[moving] / size[moving, None], axis=0))
    return part


def _by_contribution(search: _Search, best: _Choice, plenty: int) -> IntArray | None:
    """The fewest normal modes that will do when chosen by contribution instead of by frequency."""
    formulation, frames = best.candidate.formulation, best.candidate.reduction.frames
    if formulation.mass is not Mass.CONSTANT or search.scene.config.cut:
        return None
    body = search.body(Reduction(BasisChoice.NORMAL, plenty, frames), [formulation])
    if body.rigid_count:
        return None
    order = np.argsort(-contributions(search.scene, body, formulation), kind="stable")
    for count in range(1, best.candidate.reduction.modes + 1):
        kept = np.sort(order[:count])
        if search.errors(with_modes(body, kept), formulation).share <= max(1.0, best.errors.share):
            return kept
    return None


def _reasons(search: _Search, tried: list[_Tried], found: list[_Choice], best: _Choice, plenty: int) -> dict[str, str]:
    scene, formulation = search.scene, best.candidate.formulation
    reduction = best.candidate.reduction
    reasons: dict[str, str] = {}
    left = [table.name for table in scene.given.interface if table not in scene.config.interface]
    if left:
        reasons["interface"] = f"Left out, since the scene neither loads nor reads them: {', '.join(left)}."
    linear = [one for one in tried if one.formulation.kinematics is Kinematics.LINEAR]
    seen = "; ".join(
        f"{_words(one.formulation)} comes to {_short(next(iter(one.shares.values())).share)} times the tolerance"
        for one in linear
    )
    if formulation.kinematics is Kinematics.LINEAR:
        reasons["kinematics"] = f"Linear is enough: with {plenty} modes {seen}."
        reasons["frames"] = "Linear kinematics need no frames."
    else:
        reasons["kinematics"] = f"Linear is not enough: with {plenty} modes {seen}."
        own = next(one for one in tried if one.formulation == formulation)
        steps = ", ".join(f"{'own' if n == GIVEN else n}: {_short(e.share)}" for n, e in own.shares.items())
        reasons["frames"] = f"Error over tolerance by the number of frames, {plenty} modes: {steps}."
        others = [one for one in tried if one.formulation != formulation and one not in linear]
        words = [
            f"{_words(one.formulation)} "
            + (
                f"needs {_frames(one.enough)}"
                if one.enough is not None
                else f"does not reach it with {_frames(list(one.shares)[-1])}"
            )
            for one in others
        ]
        reasons["loads"] = f"Beside it, {'; '.join(words)}." if words else ""
    compared = ", ".join(
        f"{_BASES[c.candidate.reduction.basis]} {c.candidate.reduction.modes} ({c.body.mode_count} in all, "
        f"{1e6 * c.cost:.3g} µs)"
        for c in found
        if c.candidate.formulation == formulation
    )
    reasons["basis"] = f"Fewest modes that will do, by basis: {compared}."
    if reduction.basis is BasisChoice.NORMAL:
        kept = _by_contribution(search, best, plenty)
        if kept is not None and kept.size < reduction.modes:
            reasons["modes"] = (
                f"The lowest {reduction.modes}: a body file takes the lowest modes and cannot name single ones. By "
                f"what they move at the scene's interfaces {kept.size} of the lowest {plenty} would do: "
                f"{', '.join(str(k + 1) for k in kept)}."
            )
        elif kept is not None:
            reasons["modes"] = "The lowest; chosen by what they move at the scene's interfaces they would be no fewer."
    return reasons


def _limit(search: _Search, one: _Tried, frames: int, plenty: int) -> str:
    """What stands in the way of the tolerance: more of everything in turn."""
    formulation, here = one.formulation, one.shares[frames].share
    scene = search.scene
    turned = replace(formulation, kinematics=Kinematics.COROTATED, loads=LoadPlacement.DEFORMED)
    twice = 2 * (len(scene.config.frame) if frames == GIVEN else max(frames, 1))
    options: dict[str, tuple[Reduction, Formulation]] = {
        f"modes ({2 * plenty} instead of {plenty})": (
            Reduction(BasisChoice.RESIDUAL, 2 * plenty, frames), formulation
        ),
        f"frames ({twice} instead of {'its own' if frames == GIVEN else frames})": (
            Reduction(BasisChoice.RESIDUAL, plenty, twice), turned
        ),
    }  # fmt: skip
    at = Reduction(BasisChoice.RESIDUAL, plenty, frames or 1)
    if formulation.stiffness is Stiffness.CONSTANT:
        options['stiffness = "by_load"'] = (at, replace(turned, stiffness=Stiffness.BY_LOAD))
    if scene.transient and formulation.mass is Mass.CONSTANT:
        options['mass = "configuration"'] = (at, replace(turned, mass=Mass.CONFIGURATION))
    after: dict[str, float] = {}
    for words, (reduction, other) in options.items():
        if not has_meaning(scene.config, Candidate(reduction, other)):
            continue
        try:
            after[words] = search.errors(search.body(reduction, [other]), other).share
        except AccuracyError:
            continue
    where = f"{one.shares[frames].limited_by or one.shares[frames].failure}"
    begin = f"The tolerance is out of reach: the best comes to {_short(here)} times it ({where})."
    best = min(after, key=lambda words: after[words], default=None)
    shown = ", ".join(f"{words}: {_short(share)}" for words, share in after.items())
    if best is None or after[best] > (1.0 - _HELPS) * here:
        return (
            f"{begin} Neither more modes nor more frames help ({shown}): it is the method, or a reference that it does "
            "not know, such as membrane action or a closed loop; docs/methods.md says for which bodies."
        )
    return f"{begin} What limits it, error over tolerance with more: {shown}. Most is to be had from {best}."


def _deliver(
    search: _Search, best: _Choice, reasons: dict[str, str], limit: str, target: Path, store: Store | None
) -> Fit:
    """Write the file, and measure what was written."""
    scene, candidate = search.scene, best.candidate
    config = reduction_config(scene.config, candidate.reduction, [candidate.formulation])
    title = f"{config.name}: the smallest and fastest model found within a scene's tolerance."
    if limit:
        title = f"{config.name}: the best model found for a scene; its tolerance is not met."
    with whole_file(target) as part:
        part.write_text(body_text(config, target.parent, [title], reasons), encoding="utf-8")
        body = _reduced(read_body_file(part), store)
        given, given_errors = None, Errors()
        try:
            given = _reduced(scene.given, store)
            given_errors = search.errors(given, given.formulation)
        except RuntimeBodyError as error:
            given_errors = Errors(failure=str(error))
        times = {"fit": math.inf, "given": math.inf}
        for _ in range(_TIMINGS):
            times["fit"] = min(times["fit"], search.cost(body, candidate.formulation))
            if given is not None and not given_errors.failure:
                times["given"] = min(times["given"], search.cost(given, given.formulation))
        measured = search.errors(body, candidate.formulation)
        result = Fit(
            candidate,
            measured.share <= 1.0,
            best.errors,
            measured,
            given_errors,
            times["fit"],
            times["given"] if math.isfinite(times["given"]) else math.nan,
            body.mode_count,
            0 if given is None else given.mode_count,
            reasons,
            limit,
        )
        part.write_text(body_text(config, target.parent, [title, *result.summary], reasons), encoding="utf-8")
    return result


def _reduced(config: BodyFile, store: Store | None) -> ReducedBody:
    return reduce_body(config, Reporter(), store)


_BASES = {
    BasisChoice.NORMAL: "normal",
    BasisChoice.RESIDUAL: "normal with residual flexibility",
    BasisChoice.CRAIG_BAMPTON: "Craig-Bampton",
}


def _frames(count: int) -> str:
    return "the body's own frames" if count == GIVEN else f"{count} frame" + ("" if count == 1 else "s")


def _words(formulation: Formulation) -> str:
    words = [formulation.kinematics.value]
    if formulation.kinematics is not Kinematics.LINEAR:
        words.append(f"loads {formulation.loads.value}")
    if formulation.stiffness is not Stiffness.CONSTANT:
        words.append(f"stiffness {formulation.stiffness.value}")
    if formulation.mass is not Mass.CONSTANT:
        words.append(f"mass {formulation.mass.value}")
    return ", ".join(words)


def _short(share: float) -> str:
    return f"{share:.2g}" if share < 100.0 else f"{share:.0f}" if math.isfinite(share) else "no answer"


def _in_percent(found: Errors) -> str:
    parts = []
    if not math.isnan(found.static_displacement):
        parts.append(f"static displacement {100.0 * found.static_displacement:.2g} %")
    if not math.isnan(found.transient_displacement):
        parts.append(f"displacement over time {100.0 * found.transient_displacement:.2g} % rms")
    return ", ".join(parts)
