"""Whether the communication step resolves the motion of what springs join; iteration makes it stable, not right."""

import math
from collections.abc import Callable

import numpy as np

from ..files.array_types import FloatArray
from .layout import Wiring

# Phase, rad, by which the motion may lag: an error of some 8 % of it, rms, until then.
_PHASE = 0.2
# Steps before anything is said: what a start makes jump has to be small against what follows.
_FEWEST = 24


class ResolutionWatch:
    """Adds up how far the ends of springs move, and how sharply they turn from step to step.

    Of a vibration the second difference is (ωh)² times its amplitude: its rms over that of the motion tells ωh of what
    the motion is made of, however fast a stiff spring may ring beside it. With the mean of its force held over each
    step, a spring's vibration lags by (ωh)³/12 a step.

    Parameters
    ----------
    wiring : Wiring
    warn : callable
        Takes the words.
    """

    def __init__(self, wiring: Wiring, warn: Callable[[str], None]):
        self._wiring, self._warn = wiring, warn
        ends = len(wiring.ends.names)
        self._last: list[FloatArray] = []
        self._count, self._said = 0, False
        # Of displacement and rotation of each end: sums of motion, of its square, and of the turns' square.
        self._sum, self._square = np.zeros((ends, 2, 3)), np.zeros((ends, 2))
        self._sharp, self._largest = np.zeros((ends, 2)), np.zeros((ends, 2))

    def look(self, signals: FloatArray, time: float) -> None:
        """Look at a step's end.

        Parameters
        ----------
        signals : (m,) float
        time : float
            s.
        """
        if self._said or not len(self._wiring.springs.a):
            return
        motion = np.append(signals, 0.0)[self._wiring.ends.motion].reshape(-1, 2, 3)
        self._count += 1
        self._sum += motion
        self._square += np.sum(motion**2, axis=2)
        if len(self._last) == 2:
            before, earlier = self._last
            self._sharp += np.sum((motion - 2.0 * before + earlier) ** 2, axis=2)
        self._last = [motion, *self._last[:1]]
        if self._count < _FEWEST:
            return
        # About its mean: where the body hangs still under a load says nothing of how it vibrates.
        mean = self._sum / self._count
        moved = self._square - self._count * np.sum(mean**2, axis=2)
        self._largest = np.maximum(self._largest, np.sum((motion - mean) ** 2, axis=2))
        # Next to the end that moves farthest what others do is no matter.
        moved, largest = np.maximum(moved, np.max(moved, axis=0)), np.max(self._largest, axis=0)
        angle = np.divide(self._sharp, moved, out=np.zeros_like(moved), where=moved > 0.0) ** 0.25
        # Steps at full amplitude: what has died away lags no more.
        full = np.minimum(np.divide(2.0 * moved, largest, out=np.zeros_like(moved), where=largest > 0.0), self._count)
        phase = full * angle**3 / 12.0
        worst, kind = np.unravel_index(int(np.argmax(phase)), phase.shape)
        if phase[worst, kind] > _PHASE:
            self._said = True
            steps = 2.0 * math.pi / angle[worst, kind]
            self._warn(
                f"the step does not resolve the motion of {self._wiring.ends.names[worst]}: with {steps:.3g} steps a "
                f"period it lags by some {phase[worst, kind]:.2g} rad at {time:.6g} s: take a shorter step"
            )
