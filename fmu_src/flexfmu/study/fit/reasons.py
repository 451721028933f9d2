"""The reason of each choice, for the body file's comments; and what limits a scene that no model meets."""

import math
from dataclasses import replace

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import FloatArray
from ...files.counts import plural
from ...files.errors import AccuracyError
from ...model.errors import RuntimeBodyError
from ...model.methods import Data, Mass, Method, Variant, has_frames, masses_of, needs
from ...model.variants import lean
from ..candidates import GIVEN, Candidate, Joints, Reduction, basis_words, frames_words, has_meaning, times
from ..scene.config import BasisChoice
from ..scene.scene import Scene
from ..subspace import normal_frequencies
from ..workshop import Workshop
from .contributions import configurations, contributions
from .frames import HELPS, Tried
from .modes import Choice, loaded_inputs, mode_groups

# Groups of modes that a comment lists.
_LISTED = 6
# A part of the motion that is none.
_NOTHING = 1e-5


def reasons(workshop: Workshop, tried: list[Tried], found: list[Choice], best: Choice) -> dict[str, str]:
    """Why the body file says what it says, by its keys.

    Parameters
    ----------
    workshop : Workshop
    tried : list of Tried
    found : list of Choice
        What would do.
    best : Choice

    Returns
    -------
    dict of str to str
    """
    scene, variant, frames = workshop.scene, best.variant, best.plan.frames
    result: dict[str, str] = {}
    left = [table.name for table in scene.given.interface if table not in scene.config.interface]
    if left:
        result["interface"] = f"Left out, since the scene neither loads nor reads them: {', '.join(left)}."
    linear = [(one.variant.words, next(iter(one.shares.values()))) for one in tried if one.linear]
    seen = "; ".join(f"{words} comes to {times(errors.share)} times the tolerance" for words, errors in linear)
    if not has_frames(variant.method):
        result["method"] = f"Linear is enough: with {workshop.plenty} modes {seen}."
        result["frames"] = "Linear methods need no frames."
    else:
        own = next(one for one in tried if one.variant == variant)
        others = [_other(one, found) for one in tried if one.variant != variant and not one.linear]
        beside = f" Beside it, {'; '.join(others)}." if others else ""
        result["method"] = f"Linear is not enough: with {workshop.plenty} modes {seen}.{beside}"
        key = "frame" if frames == GIVEN else "frames" if isinstance(frames, int) else "branch"
        result[key] = _frames(own, best, workshop)
    spared = [name for name in best.plan.residual if name not in loaded_inputs(scene)]
    if spared:
        result["residual_flexibility"] = (
            f"{', '.join(spared)}: not among the scene's loads, and kept so that under no load of an interface more "
            f"than {_percent(scene.file.fit.other_loads)} of the static displacement is missing."
        )
    alike = [choice for choice in found if choice.variant == variant]
    compared = [f"{basis_words(c.plan)} {len(c.plan.numbers)} ({c.body.mode_count} in all{_cost(c)})" for c in alike]
    result["basis"] = f"Fewest modes that will do, by basis: {', '.join(compared)}."
    result["modes"] = "The lowest of each part, and residual flexibility of its interfaces and sections."
    if not scene.config.cut:
        result["modes"] = _modes(workshop, best, alike)
    return result


def _frames(own: Tried, choice: Choice, workshop: Workshop) -> str:
    """Error by division, and the rotation that is left within frames."""
    equal, uneven = [], []
    for division, errors in own.shares.items():
        if isinstance(division, int):
            equal.append(f"{'own' if division == GIVEN else division}: {times(errors.share)}")
        else:
            uneven.append(f"{own.counts[division]} ({frames_words(division)}): {times(errors.share)}")
    words = f"Error over tolerance by the number of frames, {workshop.plenty} modes: {', '.join(equal)} at equal levels"
    if uneven:
        words += f"; divided where the body turns, {', '.join(uneven)}"
    left = rotation_left(workshop.scene, choice)
    return f"{words}. The material turns by {left:.2g} rad at most within a frame."


def _other(one: Tried, found: list[Choice]) -> str:
    """What another variant needs, and its fastest step."""
    if one.enough is None:
        return f"{one.variant.words} does not reach it with {plural(max(one.counts.values()), 'frame')}"
    fastest = min((c for c in found if c.variant == one.variant), key=lambda c: c.cost, default=None)
    told = "" if fastest is None else f" ({plural(fastest.body.mode_count, 'mode')}{_cost(fastest)})"
    return f"{one.variant.words} needs {plural(one.counts[one.enough], 'frame')}{told}"


def _cost(choice: Choice) -> str:
    """Cost of a step, of those that were timed."""
    return f", {1e6 * choice.cost:.3g} µs" if math.isfinite(choice.cost) else ""


def _modes(workshop: Workshop, best: Choice, found: list[Choice]) -> str:
    """What each of the chosen modes adds, what was left out, and what lies beyond the frequencies that count."""
    scene, plan, variant = workshop.scene, best.plan, best.variant
    most = replace(workshop.ample(plan.frames), basis=plan.basis)
    body = workshop.body(most, [variant])
    part = contributions(scene, body, variant, plan.basis)
    groups = sorted(mode_groups(body, most), key=lambda g: -float(part[g].max()))
    kept = [g for g in groups if g[0] + 1 in plan.numbers]
    left = [g for g in groups if g[0] + 1 not in plan.numbers]
    of = {
        BasisChoice.NORMAL: "the displacement of the scene's interfaces",
        BasisChoice.RESIDUAL: "the vibration of the scene's interfaces, since residual flexibility holds what follows "
        "the loads",
        BasisChoice.CRAIG_BAMPTON: "the strain, since constraint modes hold what follows the interfaces",
    }[plan.basis]
    if not np.any(part[np.concatenate(groups)] > _NOTHING):
        return "Static shapes hold what follows the loads; of the modes just as many are kept as the error asks for."
    listed = [f"{' and '.join(str(k + 1) for k in g)}: {_percent(float(part[g].max()))}" for g in kept[:_LISTED]]
    words = f"Chosen by their part in {of} (the largest over all cases): {', '.join(listed)}"
    words += f", and {len(kept) - _LISTED} more." if len(kept) > _LISTED else "."
    if left:
        largest = _percent(float(part[left[0]].max()))
        words += f" Those of the lowest {workshop.plenty} that are left out have {largest} at most."
    return words + _beyond_band(workshop, best, found, normal_frequencies(body, plan.basis))


def _beyond_band(workshop: Workshop, best: Choice, found: list[Choice], omega: FloatArray) -> str:
    """Modes above the frequencies that count contribute statically: whether residual flexibility replaces them."""
    scene = workshop.scene
    bands = [case.frequencies[1] for case in scene.transient if case.frequencies is not None]
    if len(bands) < len(scene.transient):
        return ""
    highest = max(bands, default=0.0)
    normal = next((c for c in found if c.plan.basis is BasisChoice.NORMAL), None)
    if best.plan.basis is BasisChoice.NORMAL:
        above = [n for n in best.plan.numbers if omega[n - 1] > 2.0 * np.pi * highest]
        residual = [c for c in found if c.plan.basis is BasisChoice.RESIDUAL]
        other = min(residual, key=lambda c: (c.cost, c.body.mode_count), default=None)
        if not above or other is None:
            return ""
        where = f", above the {highest:g} Hz that count," if bands else ""
        return (
            f" {_list(above)}{where} contribute statically; residual flexibility instead would make "
            f"{other.body.mode_count} modes{_cost(other)}: not cheaper."
        )
    if best.plan.basis is not BasisChoice.RESIDUAL:
        return ""
    if normal is None and BasisChoice.NORMAL in scene.file.sweep.basis:
        return f" Normal modes alone, the lowest {workshop.plenty}, are too stiff for the scene or under other loads."
    above = [] if normal is None else [n for n in normal.plan.numbers if n not in best.plan.numbers]
    if normal is None or not above:
        return ""
    return (
        f" {_list(above)}, which normal modes alone would need, are replaced by residual flexibility: "
        f"{best.body.mode_count} modes instead of {normal.body.mode_count}."
    )


def _list(numbers: list[int]) -> str:
    return f"Mode{'' if len(numbers) == 1 else 's'} {', '.join(map(str, numbers))}"


def _percent(part: float) -> str:
    return f"{100.0 * part:.{2 if part < 0.995 else 3}g} %" if part > _NOTHING else "nothing"


def rotation_left(scene: Scene, choice: Choice) -> float:
    """Largest rotation within any frame in the scene, rad: the FMU's own `diagnostics.rotation_within_frame`."""
    model = FlexibleBody(lean(choice.body, choice.variant))
    try:
        return max(model.largest_rotation(replace(model.rest(), q=q)) for q in configurations(scene, model))
    except (RuntimeBodyError, ValueError):
        return float("nan")


def limit(workshop: Workshop, one: Tried, frames: int | Joints) -> str:
    """What stands in the way of the tolerance: more of everything in turn.

    Parameters
    ----------
    workshop : Workshop
    one : Tried
    frames : int or Joints
        The best that was found.

    Returns
    -------
    str
    """
    here = one.shares[frames]
    more = _more(workshop, one.variant, frames, one.counts[frames])
    more = {words: pair for words, pair in more.items() if has_meaning(workshop.scene.config, Candidate(*pair))}
    found = zip(more, workshop.each(_share, list(more.values())), strict=True)
    after = {words: share for words, share in found if share is not None}
    begin = (
        f"The tolerance is out of reach: the best comes to {times(here.share)} times it "
        f"({here.limited_by or here.failure})."
    )
    best = min(after, key=lambda words: after[words], default=None)
    shown = ", ".join(f"{words}: {times(share)}" for words, share in after.items())
    if best is None or after[best] > (1.0 - HELPS) * here.share:
        return (
            f"{begin} Neither more modes nor more frames help ({shown}): it is the method, or a reference that it does "
            "not know, such as a loop whose parts turn far, or stretch without membrane energy; docs/methods.md says "
            "for which bodies."
        )
    return f"{begin} What limits it, error over tolerance with more: {shown}. Most is to be had from {best}."


def _share(workshop: Workshop, plan: Reduction, variant: Variant) -> float | None:
    """Error over tolerance; None where the body cannot be reduced so."""
    try:
        return workshop.errors(workshop.body(plan, [variant]), variant).share
    except AccuracyError:
        return None


def _more(
    workshop: Workshop, variant: Variant, frames: int | Joints, count: int
) -> dict[str, tuple[Reduction, Variant]]:
    """Models that have more of one thing each."""
    plenty, ample, at = workshop.plenty, workshop.ample(frames), workshop.ample(frames or 1)
    turned = variant if has_frames(variant.method) else Variant(Method.FRAMES)
    now = frames if isinstance(frames, int) and frames != GIVEN else count
    twice, before = 2 * max(now, 1), "its own" if frames == GIVEN else now
    found = {
        f"modes ({2 * plenty} instead of {plenty})": (replace(ample, modes=2 * plenty), variant),
        f"frames ({twice} instead of {before})": (workshop.ample(twice), turned),
    }
    if Data.BY_LOAD not in needs(variant.method):
        found[f'method = "{Method.FRAMES_STIFFNESS.value}"'] = at, Variant(Method.FRAMES_STIFFNESS)
    if workshop.scene.transient and variant.mass is Mass.CONSTANT:
        method = variant.method if Mass.CONFIGURATION in masses_of(variant.method) else Method.SECOND_ORDER
        found['mass = "configuration"'] = at, Variant(method, Mass.CONFIGURATION)
    return found
