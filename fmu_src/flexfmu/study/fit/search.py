"""The smallest, fastest model of a body that a scene's tolerance allows, with the reason of each choice."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...build.body_model import read_body_model
from ...files.progress import Reporter
from ...files.store import Store
from ...files.targets import check_target
from ...reduction.cut.cut import cut_loops
from ..candidates import Joints
from ..jobs import Crew
from ..scene.scene import Scene
from ..workshop import Workshop
from .delivery import Fit, deliver
from .frames import Tried, frames_needed
from .modes import Choice, cheapest, modes_needed, reductions_to_try
from .reasons import limit, reasons

# Share of an error that may be added to it where the tolerance is out of reach anyway, for the sake of fewer modes.
_SPARE = 0.05


def fit(
    scene: Scene,
    target: Path,
    report: Reporter,
    store: Store | None = None,
    fmu: Path | None = None,
    crew: Crew | None = None,
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
    if fmu is not None:
        check_target(fmu, (".fmu",))
    workshop = Workshop(scene, report, store, crew)
    _ = workshop.known
    workshop, tried = _searched(workshop)
    chosen = [(one, one.enough) for one in tried if one.enough is not None]
    why, allowed = "", 1.0
    if not chosen:
        one, frames = min(((t, d) for t in tried for d in t.shares), key=lambda pair: pair[0].shares[pair[1]].share)
        why = limit(workshop, one, frames)
        allowed = (1.0 + _SPARE) * one.shares[frames].share
        chosen = [(one, frames)]
    found = _with_fewest_modes(workshop, chosen, allowed)
    with report.stage(f"3 of 3: time {len(found)} models, and write the best"):
        best = cheapest(workshop, found)
        return deliver(workshop, best, reasons(workshop, tried, found, best), why, target, fmu, begun)


def _searched(workshop: Workshop) -> tuple[Workshop, list[Tried]]:
    """Frames that will do: of the body as it is, or cut where that falls short and nothing is said of cuts."""
    scene = workshop.scene
    loop = _closes_a_loop(scene)
    # A tree of several frames opens the loop, wherever its joints are.
    tried = frames_needed(workshop, uneven=not loop)
    if any(one.enough is not None for one in tried) or not loop:
        return workshop, tried
    workshop.report.note("supports close a loop: the body is tried cut, too")
    cut = workshop.of(replace(scene, config=scene.config.model_copy(update={"cut": "auto"})))
    after = frames_needed(cut)
    return (cut, after) if _least(after) < _least(tried) else (workshop, tried)


def _least(tried: list[Tried]) -> float:
    """Smallest error over tolerance."""
    return min(found.share for one in tried for found in one.shares.values())


def _closes_a_loop(scene: Scene) -> bool:
    """Whether nothing is said of cuts, and a slender section opens a loop between supports."""
    config = scene.config
    if config.cut is not None or config.frame or config.branch or config.free:
        return False
    read = read_body_model(config, Reporter())
    return read.model.mesh.equations is None and bool(cut_loops(read.options, read.model)[0].cuts)


def _with_fewest_modes(
    workshop: Workshop, chosen: Sequence[tuple[Tried, int | Joints]], allowed: float
) -> list[Choice]:
    """Models of the fewest modes in each basis, under variants with the frames that they need; never none."""
    found: list[Choice] = []
    asked = [(most, one.variant, allowed) for one, frames in chosen for most in reductions_to_try(workshop, frames)]
    title = f"2 of 3: leave out modes under {len(chosen)} methods"
    with workshop.report.counted(title, len(asked), "bases") as tell:
        for done, choice in enumerate(workshop.each(modes_needed, asked), start=1):
            found += [] if choice is None else [choice]
            tell(done)
    if found:
        return found
    # Only so many modes with everything: as the frames were found.
    one, frames = chosen[0]
    plan = workshop.ample(frames)
    return [Choice(plan, one.variant, workshop.body(plan, [one.variant]), one.shares[frames])]
