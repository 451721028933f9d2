"""What a run of a coupling is told of while it goes on, in words; core/doubts.c finds it."""

from typing import Any

import numpy as np

from ..files.array_types import FloatArray
from ..files.progress import Reporter
from .config import ExperimentTable, Scheme
from .layout import Wiring
from .loop import Loop

FED = 'the coupling itself fed the motion: take scheme = "iterated", or a shorter step'
TAKEN = "the coupling itself damped the motion: take a shorter step{}"
# `NoticeKind` of core/doubts.h.
_ODD_STATUS, _FED, _TAKEN, _COARSE = range(4)
# Answer of springs to their own loads beyond which explicit schemes are warned of.
_STIFF = 0.1


class Words:
    """Tells a user what the loop noticed.

    Parameters
    ----------
    wiring : Wiring
    settings : ExperimentTable
    report : Reporter
    """

    def __init__(self, wiring: Wiring, settings: ExperimentTable, report: Reporter):
        self._wiring, self._settings, self._report = wiring, settings, report
        self._iterated = settings.scheme is Scheme.ITERATED
        self._told, self._fed = 0, False

    def notices(self, loop: Loop) -> None:
        """Tell what was noticed since the last time.

        Parameters
        ----------
        loop : Loop
        """
        for notice in loop.notices[self._told : loop.outcome.notices]:
            self._report.warning(self._words(notice, notice.step * self._settings.step))
            self._fed |= notice.kind == _FED
        self._told = loop.outcome.notices

    def _words(self, notice: Any, time: float) -> str:
        figure, other = notice.figures
        if notice.kind == _ODD_STATUS:
            name = self._wiring.roles[notice.who].description.name
            return f"{name}: status.code is {figure:.0f} from {time:.6g} s on"
        if notice.kind == _COARSE:
            return (
                f"the step does not resolve the motion of {self._wiring.ends.names[notice.who]}: with {figure:.3g} "
                f"steps a period it lags by some {other:.2g} rad at {time:.6g} s: take a shorter step"
            )
        if notice.kind == _FED:
            return _energies(FED, "created", figure, other, f" from {time:.6g} s on")
        remedy = ', or held = "mean"' if self._iterated else ', or scheme = "iterated" with held = "mean"'
        return _energies(TAKEN.format(remedy), "took", figure, other, f" from {time:.6g} s on")

    def stiff_springs(self, slope: FloatArray | None) -> None:
        """Say so where the interfaces' compliance tells that an explicit scheme will grow.

        Parameters
        ----------
        slope : (n, n) float or None
            Of the coupled inputs by themselves.
        """
        size = 0.0 if slope is None else float(np.max(np.abs(np.linalg.eigvals(slope)), initial=0.0))
        if size > _STIFF:
            self._report.warning(
                f"springs answer their own loads {size:.2g}-fold within a step; explicit coupling grows where that is "
                'not small against 1: take scheme = "iterated", or a shorter step'
            )

    def runaway(self, outcome: Any) -> str:
        """Why a run is stopped whose motion grows without bound."""
        return f"the motion grows without bound. {FED} (it created {outcome.energies.created:.3g} J)"

    def end(self, outcome: Any) -> None:
        """Say what was not said on the way, and how many iterations there were."""
        if outcome.feeds > 0 and not self._fed:
            self._report.warning(_energies(FED, "created", outcome.energies.created, outcome.energies.stored, ""))
        if self._iterated:
            self._report.note(f"{outcome.rounds / outcome.steps:.2f} iterations a step")


def _energies(words: str, verb: str, created: float, stored: float, since: str) -> str:
    return f"{words} (it {verb} {abs(created):.3g} J{since}, the springs held {stored:.3g} J at most)"
