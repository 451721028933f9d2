"""Which models of a sweep are tried first, and which ones next: coarse, then finer where the front is."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ...model.methods import Method, has_frames
from ..candidates import EXACT, REDUCED, SINGLE, Candidate, offered_frames
from ..front import QUANTITIES, cost_axis, front
from ..records import Record
from ..scene.config import BasisChoice
from ..scene.scene import Scene

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
        return cls(tuple(models), tuple(modes), tuple(offered_frames(scene.config, scene.file.sweep.frames)))

    def coarse(self) -> list[Candidate]:
        """Few modes and few frames under the main methods, in one basis."""
        methods = {m.variant.method for m in self.models}
        bases = {m.reduction.basis for m in self.models}
        steps = {m.internal_step for m in self.models} - {EXACT}
        step = SINGLE if SINGLE in steps else max(steps, default=EXACT)
        # The fewest, and a middling number.
        modes, frames = ({listed[0], listed[len(listed) // 2]} for listed in (self.modes, self.frames))
        return [
            m
            for m in self.models
            if m.variant.method in (methods & set(_MAIN) or methods)
            and m.variant.mass is min((m.variant.mass for m in self.models), key=lambda one: one.value != "constant")
            and m.reduction.basis is min(bases, key=lambda one: (one is not BasisChoice.RESIDUAL, one.value))
            and m.reduction.modes in modes
            and (not _divided(m) or m.reduction.frames in frames)
            and m.internal_step in (step, EXACT)
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
        step = None if model.internal_step == EXACT else model.internal_step
        return self.modes.index(reduction.modes), frames, reduction.basis, variant.method, variant.mass, step


def _divided(model: Candidate) -> bool:
    method = model.variant.method
    return has_frames(method) and method is not Method.FLOATING_FRAME


def _distance(place: tuple[object, ...], other: tuple[object, ...]) -> int:
    pairs = [(a, b) for a, b in zip(place, other, strict=True) if None not in (a, b)]
    return sum(abs(a - b) if isinstance(a, int) and isinstance(b, int) else int(a != b) for a, b in pairs)


def members(rows: Sequence[Record]) -> set[tuple[str, ...]]:
    """Keys of the models on the fronts of all that a chart shows, and of the error over the tolerance."""
    rows = [row for row in rows if row.solver == REDUCED and row.status == "ok"]
    axis = cost_axis(rows)
    shown = [q for q in ("share", *QUANTITIES) if any(getattr(row, q) > 0.0 for row in rows)]
    return {row.key for q in shown for row in front(rows, q, axis)}
