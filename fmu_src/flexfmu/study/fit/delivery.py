"""What was found, written as a body file and an FMU, read back and measured."""

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

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
from ..scene.measure import Errors
from ..workshop import Workshop, build
from .body_text import body_text
from .contributions import loads_by_kind, missed
from .modes import Choice, loaded_inputs

_TIMINGS = 2
# Natural logarithm of the ratio of two paces that are the same: timings of one model differ by as much.
_SAME_PACE = 0.05
# Part of the static displacement that is missing under a load from which on the user is told.
_STIFF = 0.1 + 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
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
    given_step: float = math.nan
    fmu_step: float = math.nan
    given_fmu_step: float = math.nan
    fmu_ratio: float = math.nan
    mode_count: int
    given_mode_count: int = 0
    frame_count: int
    given_frame_count: int = 0
    reasons: dict[str, str]
    limit: str
    stiff: tuple[str, ...]
    seconds: float = math.nan
    tried: int

    @property
    def verdict(self) -> str:
        """Pass or fail, in a line."""
        words = "pass: {} × the tolerance"
        if not self.met:
            words = "fail: {} × the tolerance; the best model found is written all the same"
        return words.format(times(self.measured.share))

    @property
    def summary(self) -> list[str]:
        """The result in a few lines."""
        measured, errors = self.measured, []
        for kind, error, words in (
            ("static displacement", measured.static_displacement, ""),
            ("displacement over time", measured.transient_displacement, " rms"),
        ):
            if not math.isnan(error):
                errors.append(f"{kind} {100.0 * error:.2g} %{words}")
        where = f" ({measured.limited_by})" if measured.limited_by else ""
        lines = [
            f"Error over tolerance: predicted {times(self.predicted.share)}, measured {times(measured.share)}"
            f"{where}; {', '.join(errors)}.",
            f"{_counts(self.mode_count, self.frame_count)}; a step from Python takes {1e6 * self.step:.3g} µs.",
        ]
        if math.isfinite(self.given_step):
            lines.append(
                f"As given: {times(self.given.share)} of the tolerance, "
                f"{_counts(self.given_mode_count, self.given_frame_count)}, {1e6 * self.given_step:.3g} µs; this is "
                f"{_faster(self.given_step / self.step)}."
            )
            if math.isfinite(self.fmu_step):
                lines.append(
                    f"Through the FMU a step takes {1e6 * self.fmu_step:.3g} µs, {self.fmu_ratio:.2g} times that of an "
                    f"empty FMU; as given {1e6 * self.given_fmu_step:.3g} µs: "
                    f"{_faster(self.given_fmu_step / self.fmu_step)}."
                )
        else:
            lines.append(f"As given the body has no answer in this scene: {self.given.failure}")
        if self.stiff:
            lines.append(
                f"Too stiff, or rigid, under loads that the scene does not have: {', '.join(self.stiff)}. Where they "
                "may come, put them into the scene, or give its [fit] a smaller other_loads."
            )
        return [*lines, self.limit] if self.limit else lines


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
    words = "the smallest and fastest model found within a scene's tolerance."
    title = f"{config.name}: {'the best model found for a scene; its tolerance is not met.' if limit else words}"
    with whole_file(target) as part:
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
    bodies = {"": body}
    found: dict[str, Any] = {}
    try:
        given = build(workshop.scene.given, workshop.store).body
        given_errors = workshop.errors(given, chosen(given))
        found |= {"given_mode_count": given.mode_count, "given_frame_count": given.frame_count}
        if not given_errors.failure:
            bodies["given_"] = given
    except RuntimeBodyError as error:
        given_errors = Errors(failure=str(error))
    for _ in range(_TIMINGS):
        for name, one in bodies.items():
            key = f"{name}step"
            found[key] = min(workshop.cost(one, chosen(one)).fastest, found.get(key, math.inf))
    measured = workshop.errors(body, best.variant)
    with fmu_timer(through_fmu) as timer:
        if timer is not None:
            step = workshop.step(FlexibleBody(body))
            for name, one in bodies.items():
                took = timer.times(one, workshop.scene, step, chosen(one), StepLimits())
                found[f"{name}fmu_step"] = 1e-6 * took["fmu_us"]
                found.setdefault("fmu_ratio", took["fmu_ratio"])
    return Fit(
        plan=best.plan,
        variant=best.variant,
        met=measured.share <= 1.0,
        predicted=best.errors,
        measured=measured,
        given=given_errors,
        mode_count=body.mode_count,
        frame_count=body.frame_count,
        reasons=reasons,
        limit=limit,
        stiff=_too_stiff(workshop, best, body),
        tried=workshop.tried,
        **found,
    )


def _too_stiff(workshop: Workshop, best: Choice, body: ReducedBody) -> tuple[str, ...]:
    """Loads that the scene does not have and that the body as written gives way to by too little."""
    whole = workshop.body(workshop.ample(best.plan.frames), [best.variant])
    loaded = loaded_inputs(workshop.scene)
    lacking = zip(loads_by_kind(whole), missed(body, whole), strict=True)
    return tuple(name for name, part in lacking if part > _STIFF and name not in loaded)
