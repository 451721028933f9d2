"""Whether the communication step resolves the motion of what springs join; iteration makes it stable, not right."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .layout import Wiring

FloatArray = NDArray[np.float64]

# Steps a period of the motion below which an iterated coupling is off by some ten per cent within a few periods.
_STEPS_PER_PERIOD = 17.0
# Steps before anything is said: what a start makes jump has to be small against what follows.
_FEWEST = 24


class ResolutionWatch:
    """Adds up how far the ends of springs move, and how sharply they turn from step to step.

    Of a vibration the second difference is (ωh)² times its amplitude: its rms over that of the motion tells ωh of what
    the motion is made of, however fast a stiff spring may ring beside it.

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
        self._sharp = np.zeros((ends, 2))

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
        moved = self._square - np.sum(self._sum**2, axis=2) / self._count
        # Next to the end that moves farthest what others do is no matter.
        moved = np.maximum(moved, np.max(moved, axis=0))
        ratio = np.divide(self._sharp, moved, out=np.zeros_like(moved), where=moved > 0.0)
        worst, kind = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        steps = 2.0 * math.pi / float(ratio[worst, kind]) ** 0.25 if ratio[worst, kind] > 0.0 else math.inf
        if steps < _STEPS_PER_PERIOD:
            self._said = True
            self._warn(
                f"the step does not resolve the motion of {self._wiring.ends.names[worst]}: by {time:.6g} s it takes "
                f"{steps:.3g} steps a period, expected {_STEPS_PER_PERIOD:g} or more: take a shorter step"
            )
