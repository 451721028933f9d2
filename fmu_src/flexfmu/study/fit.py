"""The smallest, fastest model of a body that a scene's tolerance allows, as a body file and an FMU."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..build.config import read_body_file
from ..build.reduce import read_body_model
from ..files.basics import AccuracyError, BodyFileError, RuntimeBodyError, plural
from ..files.outputs import Reporter, check_target, whole_file
from ..files.store import Store
from ..fmu.package import package_fmu
from ..model.methods import Mass, Method, Variant, has_frames, masses_of
from ..model.reduced_body import ReducedBody
from ..model.variants import chosen
from ..reduction.cut.parts import cut_loops
from . import candidates
from .candidates import Candidate, Reduction
from .fitted import Fit, body_text
from .scene.config import BasisChoice
from .scene.reference import SceneErrors
from .scene.scene import Scene
from .workshop import Crew, Workshop, build, normal_frequencies, pair_ends, subset

_LADDER = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of modes that are tried, where no pair of equal frequency is split."""
# Share of an error that may be added to it where the tolerance is out of reach anyway, for the sake of fewer modes.
_SPARE = 0.05
# Steps whose times differ by less cost the same; those that are slower by more are not timed again.
_SAME_COST, _CLOSE, _TIMINGS = 0.05, 0.2, 3
# Those that are there for comparison are left out.
_COMPARED = (Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.STIFFNESS_BY_MODE, Method.FLOATING_FRAME)

Tried = dict[Variant, dict[int, SceneErrors]]
"""Errors with plenty of modes, by method and number of frames."""


@dataclass(slots=True)
class Choice:
    """A model that will do.

    Attributes
    ----------
    reduction : Reduction
    variant : Variant
    body : ReducedBody
    cost : float
        Fastest step seen, s.
    """

    reduction: Reduction
    variant: Variant
    body: ReducedBody
    cost: float = math.inf

    @property
    def words(self) -> str:
        """Its basis, size and cost."""
        cost = f", {1e6 * self.cost:.3g} µs" if math.isfinite(self.cost) else ""
        basis = candidates.BASES[self.reduction.basis.value]
        return f"{basis} {self.reduction.modes} ({plural(self.body.mode_count, 'coordinate')}{cost})"


def fit(
    scene: Scene,
    target: Path,
    report: Reporter,
    store: Store | None = None,
    fmu: Path | None = None,
    crew: Crew | None = None,
    verify: bool = False,
) -> Fit:
    """Find the smallest, fastest model within the scene's tolerance and write it as a body file, and an FMU.

    Parameters
    ----------
    scene : Scene
    target : Path
        Body file to write; ends in .toml.
    report : Reporter
    store : Store, optional
    fmu : Path, optional
        FMU to write; ends in .fmu. Default: none.
    crew : Crew, optional
        Processes that measure errors. Default: this one.
    verify : bool
        Whether what was found is compared with the finite element model.

    Returns
    -------
    Fit

    Raises
    ------
    FlexfmuError
        A file cannot be written, or a scene without a reference.
    """
    begun = time.perf_counter()
    check_target(target, (".toml",), inputs=(scene.body,))
    check_target(fmu, (".fmu",))
    workshop = Workshop(scene, report, store, crew, solve=False)
    _ = workshop.known
    workshop, tried = _searched(workshop)
    enough = {variant: frames for variant in tried if (frames := _enough(tried[variant])) is not None}
    allowed = 1.0
    if not enough:
        variant, frames = min(((v, n) for v in tried for n in tried[v]), key=lambda one: tried[one[0]][one[1]].share)
        enough, allowed = {variant: frames}, (1.0 + _SPARE) * tried[variant][frames].share
    found = _with_fewest_modes(workshop, enough, allowed)
    with report.stage(f"3 of 3: time {len(found)} models, and write the best"):
        best = _cheapest(workshop, found)
        return _deliver(workshop, best, reasons(workshop, tried, found, best), target, fmu, begun, verify)


def _searched(workshop: Workshop) -> tuple[Workshop, Tried]:
    """Frames that will do: of the body as it is, or cut where that falls short and nothing is said of cuts."""
    scene = workshop.scene
    tried = frames_needed(workshop)
    if _least(tried) <= 1.0 or not _closes_a_loop(scene):
        return workshop, tried
    workshop.report.note("supports close a loop: the body is tried cut, too")
    cut = workshop.of(replace(scene, config=scene.config.model_copy(update={"cut": "auto"})))
    after = frames_needed(cut)
    return (cut, after) if _least(after) < _least(tried) else (workshop, tried)


def _least(tried: Tried) -> float:
    """Smallest error over tolerance."""
    return min(errors.share for found in tried.values() for errors in found.values())


def _enough(found: dict[int, SceneErrors]) -> int | None:
    """The fewest frames within the tolerance."""
    return next((frames for frames, errors in found.items() if errors.share <= 1.0), None)


def _closes_a_loop(scene: Scene) -> bool:
    """Whether nothing is said of cuts, and a slender section opens a loop between supports."""
    config = scene.config
    if config.cut is not None or config.frame or config.branch or config.free:
        return False
    read = read_body_model(config, Reporter())
    return not read.model.mesh.equations.shape[0] and bool(cut_loops(read.options, read.model)[0].cuts)


def frames_needed(workshop: Workshop) -> Tried:
    """Errors with plenty of modes and residual flexibility: linear, then of more and more frames until they will do.

    The mass of the deformed body is tried where no constant mass will do: as a polynomial, and then exactly.

    Parameters
    ----------
    workshop : Workshop

    Returns
    -------
    Tried
    """
    scene = workshop.scene
    levels = candidates.offered_frames(scene.config, scene.file.sweep.frames)
    constant = _variants(scene, Mass.CONSTANT)
    rounds = [
        ([candidates.linear_frames(scene.config)], [one for one in constant if not has_frames(one.method)]),
        (levels, [one for one in constant if has_frames(one.method)]),
        (levels, _variants(scene, Mass.POLYNOMIAL)),
        (levels, _variants(scene, Mass.CONFIGURATION)),
    ]
    tried: Tried = {}
    done = 0
    with workshop.report.counted("1 of 3: frames, with plenty of modes", 1 + 3 * len(levels), "counts at most") as tell:
        for numbers, variants in rounds:
            for frames in numbers:
                _try(workshop, frames, [one for one in variants if _enough(tried.get(one, {})) is None], tried)
                done += 1
                tell(done)
            if tried and _least(tried) <= 1.0:
                break
    return tried


def _variants(scene: Scene, mass: Mass) -> list[Variant]:
    """What may do with a mass: linear, frames, and what `[sweep]` lists of the others."""
    sweep = scene.file.sweep
    if mass is not Mass.CONSTANT:
        # Where it is not ruled out by name.
        if not scene.transient or (mass not in sweep.mass and "mass" in sweep.model_fields_set):
            return []
        way = Method.SECOND_ORDER if Method.SECOND_ORDER in sweep.methods else Method.FRAMES
        found = [Variant(way, mass)] if mass in masses_of(way) else []
    else:
        listed = dict.fromkeys((Method.LINEAR, Method.FRAMES, *sweep.methods))
        found = [Variant(method) for method in listed if method not in _COMPARED]
    flat = candidates.linear_frames(scene.config)
    smallest = [Reduction(BasisChoice.NORMAL, 1, 1 if has_frames(v.method) else flat) for v in found]
    return [v for v, r in zip(found, smallest, strict=True) if candidates.has_meaning(scene.config, Candidate(r, v))]


def _try(workshop: Workshop, frames: int, wanted: Sequence[Variant], tried: Tried) -> None:
    """Measure a number of frames under some variants; nothing where the body cannot be divided so."""
    if not wanted:
        return
    with workshop.report.stage(f"Try {candidates.frames_words(frames)} with {workshop.plenty} modes"):
        try:
            body = workshop.body(workshop.ample(frames), list(wanted))
        except BodyFileError:
            return
        every = workshop.each(Workshop.errors, [(body, one) for one in wanted])
        for variant, errors in zip(wanted, every, strict=True):
            tried.setdefault(variant, {})[frames] = errors
            workshop.report.note(f"{variant.words}: {candidates.times(errors.share)} of the tolerance")


def _with_fewest_modes(workshop: Workshop, enough: dict[Variant, int], allowed: float) -> list[Choice]:
    """Models of the fewest modes in each basis, under variants with the frames that they need; never none."""
    bases = dict.fromkeys(workshop.scene.file.sweep.basis)
    # Normal modes alone are too stiff under loads that the scene does not have.
    bases = {basis: None for basis in bases if basis is not BasisChoice.NORMAL} or bases
    asked = [(replace(workshop.ample(n), basis=basis), v, allowed) for v, n in enough.items() for basis in bases]
    found: list[Choice] = []
    with workshop.report.counted(f"2 of 3: fewer modes under {len(enough)} methods", len(asked), "bases") as tell:
        for done, choice in enumerate(workshop.each(modes_needed, asked), start=1):
            found += [] if choice is None else [choice]
            tell(done)
    if found:
        return found
    # Only so many modes with everything: as the frames were found.
    variant, frames = next(iter(enough.items()))
    plan = workshop.ample(frames)
    return [Choice(plan, variant, workshop.body(plan, [variant]))]


def modes_needed(workshop: Workshop, most: Reduction, variant: Variant, allowed: float) -> Choice | None:
    """The fewest of a basis' lowest modes that will do, found by halves.

    Parameters
    ----------
    workshop : Workshop
    most : Reduction
        With plenty of modes.
    variant : Variant
    allowed : float
        Error over tolerance that will do.

    Returns
    -------
    Choice or None
    """
    try:
        whole = workshop.body(most, [variant])
    except (AccuracyError, BodyFileError):
        # Interfaces that cannot be held one by one, for Craig-Bampton.
        return None
    counts = [number for number in _LADDER if number < most.modes]
    if not workshop.scene.config.cut:
        ends = pair_ends(normal_frequencies(whole, most.basis)[: most.modes])
        counts = sorted({min((end for end in ends if end >= number), default=most.modes) for number in counts})
    bodies = {most.modes: whole}

    def will_do(count: int) -> bool:
        if count not in bodies:
            cut = bool(workshop.scene.config.cut)
            fewer = replace(most, modes=count)
            bodies[count] = workshop.body(fewer, [variant]) if cut else subset(whole, most.basis, count)
        return workshop.errors(bodies[count], variant).share <= allowed

    if not will_do(most.modes):
        return None
    low, high = -1, len(counts)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if will_do(counts[middle]) else (middle, high)
    count = counts[high] if high < len(counts) else most.modes
    return Choice(replace(most, modes=count), variant, bodies[count])


def _cheapest(workshop: Workshop, found: list[Choice]) -> Choice:
    """The fastest; of those as fast within 5 % the one of the fewest modes and frames and the simplest method."""
    left = found
    # In turns, so that what else the machine does meets all of them; those that are slow by far only once.
    with workshop.report.counted("Time them", _TIMINGS * len(left), "timings at most") as tell:
        done = 0
        for _ in range(_TIMINGS):
            for choice in left:
                choice.cost = min(choice.cost, workshop.cost(choice.body, choice.variant).fastest)
                done += 1
                tell(done)
            fastest = min(choice.cost for choice in left)
            left = [choice for choice in left if choice.cost <= (1.0 + _CLOSE) * fastest]
    close = [choice for choice in left if choice.cost <= (1.0 + _SAME_COST) * fastest]
    simplest = list(Method)
    return min(close, key=lambda c: (c.body.mode_count, c.body.frame_count, simplest.index(c.variant.method), c.cost))


def reasons(workshop: Workshop, tried: Tried, found: Sequence[Choice], best: Choice) -> dict[str, str]:
    """Why the body file says what it says, by its keys.

    Parameters
    ----------
    workshop : Workshop
    tried : Tried
    found : sequence of Choice
        What would do.
    best : Choice

    Returns
    -------
    dict of str to str
    """
    scene, result = workshop.scene, {}
    left = [table.name for table in scene.given.interface if table not in scene.config.interface]
    if left:
        result["interface"] = f"Left out, since the scene neither loads nor reads them: {', '.join(left)}."
    told = [
        f"{variant.words} " + ", ".join(f"{_number(n)}{candidates.times(one.share)}" for n, one in errors.items())
        for variant, errors in tried.items()
    ]
    method = f"Error over tolerance with {workshop.plenty} modes, by the number of frames: {'; '.join(told)}."
    result["method"] = f"{'' if has_frames(best.variant.method) else 'Linear is enough. '}{method}"
    alike = [choice.words for choice in found if choice.variant == best.variant]
    result["basis"] = f"Fewest modes that will do, by basis: {', '.join(alike)}."
    if _least(tried) > 1.0:
        result["frames"] = (
            "The tolerance is out of reach with these frames and modes; give [sweep] more of them, or look in "
            "docs/methods.md for which bodies a method is."
        )
    return result


def _number(frames: int) -> str:
    return "own: " if frames == candidates.GIVEN else f"{frames}: " if frames else ""


def _deliver(
    workshop: Workshop, best: Choice, why: dict[str, str], target: Path, fmu: Path | None, begun: float, verify: bool
) -> Fit:
    """Write the file and the FMU, and measure what was written against the body as given."""
    scene = workshop.scene
    config = candidates.reduction_config(scene.config, best.reduction, [best.variant])
    with whole_file(target) as part:
        # It is read where it stands while it is written: paths in it are taken from there.
        part.write_text(body_text(config, part.parent, [], why), encoding="utf-8")
        body = build(read_body_file(part), workshop.store).body
        given, given_errors = _as_given(workshop)
        measured = workshop.errors(body, best.variant)
        result = Fit(
            reduction=best.reduction,
            variant=best.variant,
            measured=measured,
            given=given_errors,
            # By the finite element model.
            verified=Workshop(scene, workshop.report, workshop.store).errors(body, best.variant) if verify else None,
            step=workshop.cost(body, chosen(body)).fastest,
            given_step=math.nan if given_errors.failure else workshop.cost(given, chosen(given)).fastest,
            mode_count=body.mode_count,
            given_mode_count=given.mode_count,
            frame_count=body.frame_count,
            given_frame_count=given.frame_count,
            reasons=why,
            seconds=time.perf_counter() - begun,
            tried=workshop.tried,
        )
        limit = workshop.accepted(body, result.met)
        body, config = replace(body, tolerance=limit), config.accepting(limit)
        why = why | {"output": "The FMU warns above the scene's tolerance, or its own bound there."}
        title = "the smallest and fastest model found within a scene's tolerance."
        title = title if result.met else "the best model found for a scene; its tolerance is not met."
        header = [f"{config.name}: {title}", *result.summary]
        part.write_text(body_text(config, target.parent, header, why), encoding="utf-8")
        if fmu is not None:
            with workshop.report.stage(f"Write {fmu}"):
                # The body file takes its name once the FMU is there.
                package_fmu(body, fmu)
    return result


def _as_given(workshop: Workshop) -> tuple[ReducedBody, SceneErrors]:
    """The body as the user has it, and its errors."""
    given = build(workshop.scene.given, workshop.store).body
    try:
        return given, workshop.errors(given, chosen(given))
    except RuntimeBodyError as error:
        return given, SceneErrors(failure=str(error))
