"""What was found, written as a body file and an FMU, read back and measured."""

import math
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from ...body.flexible_body import FlexibleBody, StepLimits
from ...build.config import read_body_file
from ...files.counts import plural
from ...files.targets import whole_file
from ...fmu.package import package_fmu
from ...model.errors import RuntimeBodyError
from ...model.methods import Variant
from ...model.reduced_body import ReducedBody
from ...model.variants import chosen
from ..candidates import Reduction, reduction_config, times
from ..fmu_cost import fmu_timer
from ..scene.config import BasisChoice
from ..scene.measure import Errors
from ..workshop import Workshop, build
from .body_text import body_text
from .contributions import load_names, missed
from .modes import Choice, loaded_inputs

_TIMINGS = 2
# Natural logarithm of the ratio of two paces that are the same: timings of one model differ by as much.
_SAME_PACE = 0.05
# Part of the static displacement that is missing under a load from which on the user is told.
_STIFF = 0.1 + 1e-6


@dataclass(frozen=True, slots=True)
class Fit:
    """What was found.

    Attributes
    ----------
    plan : Reduction
    variant : Variant
    met : bool
        Whether the tolerance is met, as measured on the file that was written.
    predicted, measured, given : Errors
        Of the search, of the file, and of the body as the user has it.
    step, given_step : float
        Time of a step of the bare model, s; not a number where the body as given has no answer.
    fmu_step, given_fmu_step, fmu_ratio : float
        The same through their FMUs, s, and the first of them over that of an empty FMU; not numbers where no FMU was
        written.
    mode_count, given_mode_count, frame_count, given_frame_count : int
    reasons : dict of str to str
        By the key of the body file.
    limit : str
        Where the tolerance is not met: what stands in the way.
    stiff : tuple of str
        Loads, which the scene does not have, under which more than a tenth of the static displacement is missing.
    seconds : float
        What it took.
    tried : int
        Models whose error was measured.
    """

    plan: Reduction
    variant: Variant
    met: bool
    predicted: Errors
    measured: Errors
    given: Errors
    step: float
    given_step: float
    fmu_step: float
    given_fmu_step: float
    fmu_ratio: float
    mode_count: int
    given_mode_count: int
    frame_count: int
    given_frame_count: int
    reasons: dict[str, str]
    limit: str
    stiff: tuple[str, ...]
    seconds: float
    tried: int

    @property
    def verdict(self) -> str:
        """Pass or fail, in a line."""
        share = times(self.measured.share)
        if self.met:
            return f"pass: {share} × the tolerance"
        return f"fail: {share} × the tolerance; the best model found is written all the same"

    @property
    def summary(self) -> list[str]:
        """The result in a few lines."""
        where = f" ({self.measured.limited_by})" if self.measured.limited_by else ""
        lines = [
            f"Error over tolerance: predicted {times(self.predicted.share)}, measured {times(self.measured.share)}"
            f"{where}; {_in_percent(self.measured)}.",
            f"{_counts(self.mode_count, self.frame_count)}; a step from Python takes {1e6 * self.step:.3g} µs.",
        ]
        if math.isfinite(self.given_step):
            gain = self.given_step / self.step
            lines.append(
                f"As given: {times(self.given.share)} of the tolerance, "
                f"{_counts(self.given_mode_count, self.given_frame_count)}, {1e6 * self.given_step:.3g} µs; this is "
                f"{_faster(gain)}."
            )
            if math.isfinite(self.fmu_step):
                gain = self.given_fmu_step / self.fmu_step
                lines.append(
                    f"Through the FMU a step takes {1e6 * self.fmu_step:.3g} µs, {self.fmu_ratio:.2g} times that of an "
                    f"empty FMU; as given {1e6 * self.given_fmu_step:.3g} µs: {_faster(gain)}."
                )
        else:
            lines.append(f"As given the body has no answer in this scene: {self.given.failure}")
        if self.stiff:
            lines.append(
                f"Too stiff, or rigid, under loads that the scene does not have: {', '.join(self.stiff)}. Where they "
                "may come, put them into the scene, or give its [fit] a smaller other_loads."
            )
        return [*lines, self.limit] if self.limit else lines


def _in_percent(found: Errors) -> str:
    parts = []
    if not math.isnan(found.static_displacement):
        parts.append(f"static displacement {100.0 * found.static_displacement:.2g} %")
    if not math.isnan(found.transient_displacement):
        parts.append(f"displacement over time {100.0 * found.transient_displacement:.2g} % rms")
    return ", ".join(parts)


def _counts(modes: int, frames: int) -> str:
    return f"{plural(modes, 'mode')}, {plural(frames, 'frame')}"


def _faster(gain: float) -> str:
    if abs(math.log(gain)) < _SAME_PACE:
        return "as fast"
    return f"{gain:.2g} times as fast" if gain >= 1.0 else f"{1.0 / gain:.2g} times as slow"


def deliver(
    workshop: Workshop,
    best: Choice,
    reasons: dict[str, str],
    limit: str,
    target: Path,
    fmu: Path | None,
    begun: float,
) -> Fit:
    """Write the file and the FMU, and measure what was written.

    Parameters
    ----------
    workshop : Workshop
    best : Choice
    reasons : dict of str to str
    limit : str
        Where the tolerance is not met: why.
    target : Path
        Body file.
    fmu : Path or None
    begun : float
        When the search began, as of `time.perf_counter`.

    Returns
    -------
    Fit
    """
    config = reduction_config(workshop.scene.config, best.plan, [best.variant])
    title = f"{config.name}: the smallest and fastest model found within a scene's tolerance."
    if limit:
        title = f"{config.name}: the best model found for a scene; its tolerance is not met."
    with ExitStack() as files:
        part = files.enter_context(whole_file(target))
        # It is read where it stands while it is written: paths in it are taken from there.
        part.write_text(body_text(config, part.parent, [title], reasons), encoding="utf-8")
        body = build(read_body_file(part), workshop.store).body
        result = _measured(workshop, best, body, reasons, limit, fmu is not None)
        result = replace(result, seconds=time.perf_counter() - begun)
        part.write_text(body_text(config, target.parent, [title, *result.summary], reasons), encoding="utf-8")
        if result.stiff:
            workshop.report.warning(
                f"too stiff, or rigid, under {', '.join(result.stiff)}, which the scene does not have"
            )
        if fmu is not None:
            with workshop.report.stage(f"Write {fmu}"):
                # The body file takes its name once the FMU is there.
                package_fmu(body, fmu)
    return result


def _measured(
    workshop: Workshop, best: Choice, body: ReducedBody, reasons: dict[str, str], limit: str, through_fmu: bool
) -> Fit:
    """Measure a body against the scene, and its steps against those of the body as given."""
    given = None
    try:
        given = build(workshop.scene.given, workshop.store).body
        given_errors = workshop.errors(given, chosen(given))
    except RuntimeBodyError as error:
        given_errors = Errors(failure=str(error))
    found = {"fit": math.inf, "given": math.inf}
    for _ in range(_TIMINGS):
        found["fit"] = min(found["fit"], workshop.cost(body, best.variant).fastest)
        if given is not None and not given_errors.failure:
            found["given"] = min(found["given"], workshop.cost(given, chosen(given)).fastest)
    measured = workshop.errors(body, best.variant)
    bodies = [body] if given is None or given_errors.failure else [body, given]
    fmu_times = _through_fmu(workshop, bodies) if through_fmu else []
    return Fit(
        plan=best.plan,
        variant=best.variant,
        met=measured.share <= 1.0,
        predicted=best.errors,
        measured=measured,
        given=given_errors,
        step=found["fit"],
        given_step=found["given"] if math.isfinite(found["given"]) else math.nan,
        fmu_step=fmu_times[0]["fmu_us"] * 1e-6 if fmu_times else math.nan,
        given_fmu_step=fmu_times[1]["fmu_us"] * 1e-6 if len(fmu_times) > 1 else math.nan,
        fmu_ratio=fmu_times[0]["fmu_ratio"] if fmu_times else math.nan,
        mode_count=body.mode_count,
        given_mode_count=0 if given is None else given.mode_count,
        frame_count=body.frame_count,
        given_frame_count=0 if given is None else given.frame_count,
        reasons=reasons,
        limit=limit,
        stiff=_too_stiff(workshop, best, body),
        seconds=math.nan,
        tried=workshop.tried,
    )


def _too_stiff(workshop: Workshop, best: Choice, body: ReducedBody) -> tuple[str, ...]:
    """Loads that the scene does not have and that the body as written gives way to by too little."""
    most = max(workshop.scene.file.sweep.modes)
    whole = workshop.body(Reduction(BasisChoice.RESIDUAL, most, best.plan.frames), [best.variant])
    loaded = loaded_inputs(workshop.scene)
    lacking = zip(load_names(whole), missed(body, whole), strict=True)
    return tuple(name for name, part in lacking if part > _STIFF and name not in loaded)


def _through_fmu(workshop: Workshop, bodies: list[ReducedBody]) -> list[dict[str, float]]:
    """Time steps of bodies, each under its own method, through their FMUs."""
    step = workshop.step(FlexibleBody(bodies[0]))
    with fmu_timer() as timer:
        assert timer is not None
        return [timer.times(body, workshop.scene, step, chosen(body), StepLimits()) for body in bodies]
