"""Which models of a sweep are tried first, and which ones next: coarse, then finer where the front is."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ...model.methods import Method, has_frames
from ..scenes.candidates import EXACT, REDUCED, SINGLE, Candidate, offered_frames
from ..scenes.config import BasisChoice
from ..scenes.scene import Scene
from .front import QUANTITIES, cost_axis, front
from .records import Record

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
        modes = sorted({model.reduction.numbers[-1] for model in models})
        return cls(tuple(models), tuple(modes), tuple(offered_frames(scene.config, scene.file.sweep.frames)))

    def coarse(self) -> list[Candidate]:
        """Few modes and few frames under the main methods, in one basis."""
        methods = {m.variant.method for m in self.models}
        methods &= set(_MAIN) if methods & set(_MAIN) else methods
        bases = {m.reduction.basis for m in self.models}
        basis = BasisChoice.RESIDUAL if BasisChoice.RESIDUAL in bases else min(bases, key=lambda one: one.value)
        # The fewest, and a middling number.
        modes, frames = ({listed[0], listed[len(listed) // 2]} for listed in (self.modes, self.frames))
        steps = {m.internal_step for m in self.models} - {EXACT}
        step = SINGLE if SINGLE in steps else max(steps, default=EXACT)
        masses = [m.variant.mass for m in self.models]
        return [
            m
            for m in self.models
            if m.variant.method in methods
            and m.variant.mass is min(masses, key=lambda one: one.value != "constant")
            and m.reduction.basis is basis
            and m.reduction.modes in modes
            and (not self._divided(m) or m.reduction.frames in frames)
            and m.internal_step in (step, EXACT)
        ]

    def around(self, keys: Collection[tuple[str, ...]]) -> list[Candidate]:
        """Models that differ in one thing, by one number at most, from some that are given by their keys."""
        given = [model for model in self.models if model.key in keys]
        return [model for model in self.models if any(self._near(model, one) for one in given)]

    def _divided(self, model: Candidate) -> bool:
        method = model.variant.method
        return has_frames(method) and method is not Method.FLOATING_FRAME

    def _near(self, one: Candidate, other: Candidate) -> bool:
        here, there = one.reduction, other.reduction
        apart = [abs(self.modes.index(here.numbers[-1]) - self.modes.index(there.numbers[-1]))]
        if self._divided(one) and self._divided(other):
            apart.append(abs(self._place(one) - self._place(other)))
        apart += [here.basis is not there.basis, one.variant.method is not other.variant.method]
        apart += [one.variant.mass is not other.variant.mass]
        if EXACT not in (one.internal_step, other.internal_step):
            apart.append(one.internal_step != other.internal_step)
        return sum(apart) <= 1

    def _place(self, model: Candidate) -> int:
        frames = model.reduction.frames
        assert isinstance(frames, int)
        return self.frames.index(frames)


def members(rows: Sequence[Record]) -> set[tuple[str, ...]]:
    """Keys of the models on the fronts of all that a chart shows, and of the error over the tolerance."""
    rows = [row for row in rows if row.solver == REDUCED and row.status == "ok"]
    axis = cost_axis(rows)
    shown = [q for q in ("share", *QUANTITIES) if any(getattr(row, q) > 0.0 for row in rows)]
    return {row.key for q in shown for row in front(rows, q, axis)}
