"""Frames: the fewest that will do, at equal levels and where the body turns."""

from dataclasses import dataclass, field

import numpy as np

from ...body.flexible_body import FlexibleBody, State
from ...files.array_types import FloatArray
from ...files.errors import BodyFileError
from ...files.progress import Tell
from ...model.errors import RuntimeBodyError
from ...model.methods import Mass, Method, Variant, has_frames
from ...model.reduced_body import ReducedBody
from ...model.variants import lean
from ..candidates import Candidate, Joints, Reduction, frames_words, has_meaning, linear_frames, offered_frames, times
from ..scene.config import BasisChoice
from ..scene.measure import Errors
from ..scene.scene import Scene
from ..workshop import Workshop
from .branches import LEVELS, Branch, find_branches, frames_of, spread_joints, turning
from .contributions import configurations

LADDER = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32)
"""Numbers that are tried one after the other."""
# What takes less than this share off the error does not help.
HELPS = 0.1
# Those that are there for comparison are left out.
_WORTH_TRYING = (
    Method.LINEAR, Method.STIFFNESS_BY_LOAD, Method.FRAMES, Method.SECOND_ORDER, Method.FRAMES_STIFFNESS,
)  # fmt: skip
_ALWAYS = (Method.LINEAR, Method.FRAMES)
# Frames are given up when so many more tries have not helped.
_PATIENCE = 2


@dataclass(slots=True)
class Tried:
    """Divisions tried under one variant.

    Attributes
    ----------
    variant : Variant
    shares : dict of int or Joints to Errors
        Ascending in each of both ways of dividing.
    counts : dict of int or Joints to int
        Frames that came of it.
    """

    variant: Variant
    shares: dict[int | Joints, Errors] = field(default_factory=dict)
    counts: dict[int | Joints, int] = field(default_factory=dict)

    @property
    def enough(self) -> int | Joints | None:
        """The division of the fewest frames within the tolerance; equal levels where they are as few."""
        met = [division for division, found in self.shares.items() if found.share <= 1.0]
        return min(met, key=lambda d: (self.counts[d], not isinstance(d, int)), default=None)

    @property
    def stuck(self) -> bool:
        """Whether more equal levels have stopped helping."""
        last = [found.share for division, found in self.shares.items() if isinstance(division, int)]
        last = last[-_PATIENCE - 1 :]
        return len(last) > _PATIENCE and np.isfinite(last[0]) and min(last[1:]) > (1.0 - HELPS) * last[0]

    @property
    def linear(self) -> bool:
        """Whether it knows no frames."""
        return not has_frames(self.variant.method)


def frames_needed(workshop: Workshop, *, uneven: bool = True) -> list[Tried]:
    """Under each variant the fewest frames that will do, with plenty of modes and residual flexibility.

    Parameters
    ----------
    workshop : Workshop
    uneven : bool
        Whether other joints than those of equal levels are tried.

    Returns
    -------
    list of Tried
    """
    scene = workshop.scene
    tried = [Tried(variant) for variant in _variants(scene)]
    most = max(scene.file.sweep.frames)
    levels = offered_frames(scene.config, (n for n in LADDER if n <= most))
    title = "1 of 3: frames, with plenty of modes"
    with workshop.report.counted(title, 1 + len(levels) + most, "divisions at most") as tell:
        _try(workshop, linear_frames(scene.config), [one for one in tried if one.linear])
        tell(1)
        if not any(one.enough is not None for one in tried):
            for done, count in enumerate(levels, start=2):
                _try(workshop, count, [one for one in _open(tried) if not one.stuck])
                tell(done)
            if uneven:
                _uneven(workshop, tried, most, lambda done: tell(1 + len(levels) + done))
    return [one for one in tried if one.shares]


def _variants(scene: Scene) -> list[Variant]:
    """What may do, roughly by cost: linear, frames, and what `[sweep]` lists of the others."""
    sweep = scene.file.sweep
    found = [Variant(method) for method in _WORTH_TRYING if method in (*_ALWAYS, *sweep.methods)]
    # Tried last, and where it is not ruled out by name.
    if scene.transient and (Mass.CONFIGURATION in sweep.mass or "mass" not in sweep.model_fields_set):
        best = Method.SECOND_ORDER if Method.SECOND_ORDER in sweep.methods else Method.FRAMES
        found.append(Variant(best, Mass.CONFIGURATION))
    flat = linear_frames(scene.config)
    smallest = [Reduction(BasisChoice.NORMAL, 1, 1 if has_frames(v.method) else flat) for v in found]
    return [v for v, r in zip(found, smallest, strict=True) if has_meaning(scene.config, Candidate(r, v))]


def _open(tried: list[Tried]) -> list[Tried]:
    """Methods that need frames and have not enough yet; the deformed body's mass only where no other will do."""
    wanted = [one for one in tried if not one.linear and one.enough is None]
    if any(one.enough is not None for one in tried):
        wanted = [one for one in wanted if one.variant.mass is Mass.CONSTANT]
    return wanted


def _try(workshop: Workshop, division: int | Joints, wanted: list[Tried]) -> ReducedBody | None:
    """Measure a division under some variants; None where the body cannot be divided so."""
    if not wanted:
        return None
    with workshop.report.stage(f"Try {frames_words(division)} with {workshop.plenty} modes"):
        try:
            body = workshop.body(workshop.ample(division), [one.variant for one in wanted])
        except BodyFileError:
            return None
        found = list(workshop.each(Workshop.errors, [(body, one.variant) for one in wanted]))
    for one, errors in zip(wanted, found, strict=True):
        one.shares[division], one.counts[division] = errors, body.frame_count
        workshop.report.note(f"{one.variant.words}: {times(errors.share)} of the tolerance")
    return body


def _uneven(workshop: Workshop, tried: list[Tried], most: int, tell: Tell) -> None:
    """From one frame a branch, divide where the frames' own indicator of rotation says so, as long as that may pay."""
    scene = workshop.scene
    # Sections that the build finds have no names by which joints could be asked for.
    if scene.config.cut == "auto" or all(one.linear for one in tried):
        return
    turned = Variant(Method.FRAMES)
    with workshop.report.stage(f"See where the body turns, with {LEVELS} levels"):
        branches = find_branches(scene.config)
        fine = workshop.body(workshop.ample(LEVELS), [turned])
        states = configurations(scene, FlexibleBody(lean(fine, turned)))
    turns = [turning(branch, fine, states) for branch in branches]
    if not states or not branches:
        return
    counts = [1] * len(branches)
    while sum(counts) <= most:
        joints = spread_joints(branches, turns, counts)
        wanted = [one for one in _improvable(tried) if one.enough is None or sum(counts) < one.counts[one.enough]]
        if not wanted:
            return
        if joints:
            body = _try(workshop, joints, wanted)
        else:
            body = workshop.body(workshop.ample(1), [one.variant for one in wanted])
        if body is None:
            return
        within = _rotation(scene, body, branches, counts, turns)
        counts[int(np.argmax(within))] += 1
        tell(sum(counts) - len(counts))


def _improvable(tried: list[Tried]) -> list[Tried]:
    """Methods of which fewer frames would be worth having, or other ones might do."""
    turned = [one for one in tried if not one.linear]
    if all(one.enough is None for one in turned):
        return turned
    return [one for one in turned if one.enough is not None or not (one.stuck or one.variant.mass is not Mass.CONSTANT)]


def _rotation(
    scene: Scene, body: ReducedBody, branches: list[Branch], counts: list[int], turns: list[FloatArray]
) -> list[float]:
    """Largest rotation within any frame of each branch in the scene, rad."""
    even = [float(np.sum(turn)) / count for turn, count in zip(turns, counts, strict=True)]
    own = frames_of(branches, counts, body)
    model = FlexibleBody(lean(body, Variant(Method.FRAMES)))
    largest = np.zeros(body.frame_count)
    try:
        for q in configurations(scene, model) if own is not None else ():
            largest = np.maximum(largest, model.rotation_within_frames(State(q, np.zeros_like(q))))
    except RuntimeBodyError:
        own = None
    if own is None:
        return even
    return [max((float(largest[s]) for s in frames), default=e) for frames, e in zip(own, even, strict=True)]
