"""Looks at what a body is watched for after each step, and remembers what it has seen; cheap where nothing changes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .body import FlexibleBody
from .evaluation import Feed, FeedRates
from .spinning import AngularMomentum
from .stepping import State
from .watch import (
    Finding,
    Limits,
    OnLimit,
    feed_finding,
    loads_changed,
    missed_finding,
    momentum_finding,
    rotation_finding,
    spin_finding,
    stability_finding,
)

FloatArray = NDArray[np.float64]

# Share of the largest motion in the energy norm by which a body must have moved for its feed to be looked at again.
_MOVED = 0.1
# Single numbers of what was seen: largest loads and motion, feed, its rates, and what was warned of.
_NUMBERS, _KINDS = 8 + AngularMomentum.COUNT, 6


@dataclass(frozen=True, slots=True)
class Seen:
    """What the watch remembers; part of the FMU's state.

    Attributes
    ----------
    inputs : (L,) float
        Loads for which stability was last looked at.
    largest : float
        Square of the largest loads so far.
    place : (m,) float
        Modal coordinates for which feed was last looked at, the rest zero.
    farthest : float
        Largest motion so far in the energy norm, Ωq.
    feed : Feed
    rates : FeedRates
        As of the last look.
    momentum : AngularMomentum
    warned : tuple of bool
        Of rotation, stability, stiffness missed, feed, spin and angular momentum: once a run, since a body that swings
        would say so twice a period.
    """

    inputs: FloatArray
    largest: float
    place: FloatArray
    farthest: float
    feed: Feed
    rates: FeedRates
    momentum: AngularMomentum
    warned: tuple[bool, ...]

    @classmethod
    def nothing(cls, inputs: int, modes: int) -> "Seen":
        """Before the first step."""
        still = AngularMomentum.nothing()
        return cls(np.zeros(inputs), 0.0, np.zeros(modes), 0.0, Feed(), FeedRates(), still, (False,) * _KINDS)

    @staticmethod
    def count(inputs: int, modes: int) -> int:
        """Size of `numbers`."""
        return inputs + modes + _NUMBERS + _KINDS

    def numbers(self) -> FloatArray:
        """All of it as numbers, (L + m + 25,)."""
        feed, rates = self.feed, self.rates
        values = [self.largest, self.farthest, feed.fed, feed.taken]
        values += [rates.fed, rates.fed_damping, rates.taken, rates.taken_damping]
        warned = np.array(self.warned, dtype=np.float64)
        return np.concatenate([self.inputs, self.place, values, self.momentum.numbers(), warned])

    @classmethod
    def of(cls, numbers: FloatArray, inputs: int) -> "Seen":
        """What `numbers` gave."""
        ends = inputs, numbers.size - _NUMBERS - _KINDS, numbers.size - _KINDS
        loads, place, values, warned = np.split(numbers, ends)
        largest, farthest, *rest = (float(value) for value in values[: -AngularMomentum.COUNT])
        return cls(
            loads.copy(),
            largest,
            place.copy(),
            farthest,
            Feed(*rest[:2]),
            FeedRates(*rest[2:]),
            AngularMomentum.of(values[-AngularMomentum.COUNT :]),
            tuple(bool(flag) for flag in warned),
        )


class Lookout:
    """Looks at a body after each step.

    Parameters
    ----------
    limits : Limits
    names : tuple of str
        Of the inputs.
    """

    def __init__(self, limits: Limits, names: tuple[str, ...]):
        self._limits, self._names = limits, names

    def look(
        self, body: FlexibleBody, state: State, inputs: FloatArray, step: float, seen: Seen
    ) -> tuple[list[Finding], Seen]:
        """Look at where a step has ended.

        Parameters
        ----------
        body : FlexibleBody
        state : State
        inputs : (L,) float
            Loads at the step's end.
        step : float
            s; 0 for a start.
        seen : Seen
            Before the step.

        Returns
        -------
        findings : list of Finding
            Limits that are passed, but for warnings that were given before.
        seen : Seen
            What counts if the step is accepted.
        """
        limits = self._limits
        square = float(inputs @ inputs)
        largest = max(seen.largest, square)
        found: list[Finding | None] = [rotation_finding(body, state, limits), *[None] * (_KINDS - 1)]
        if (limits.stability > 0.0 or limits.missed > 0.0) and loads_changed(inputs, seen.inputs, largest):
            found[1] = stability_finding(body, state, inputs, self._names, limits)
            # What was warned of is not looked for again.
            if not (seen.warned[2] and limits.on_missed is OnLimit.WARN):
                found[2] = missed_finding(body, inputs, self._names, limits)
            seen = replace(seen, inputs=inputs.copy(), largest=largest)
        elif largest > seen.largest:
            seen = replace(seen, largest=largest)
        if body.explicit and limits.feed > 0.0 and step > 0.0:
            seen = self._fed(body, state, inputs, step, seen)
            found[3] = feed_finding(seen.feed, limits)
        if body.spinning is not None and step > 0.0:
            seen = replace(seen, momentum=body.spinning.after(seen.momentum, state))
            found[4] = spin_finding(body, state, limits)
            found[5] = momentum_finding(body, seen.momentum, limits)
        if not any(found):
            return [], seen
        findings = [
            finding
            for finding, before in zip(found, seen.warned, strict=True)
            if finding is not None and not (before and finding.action is OnLimit.WARN)
        ]
        warned = tuple(before or finding is not None for finding, before in zip(found, seen.warned, strict=True))
        return findings, replace(seen, warned=warned)

    @staticmethod
    def _fed(body: FlexibleBody, state: State, inputs: FloatArray, step: float, seen: Seen) -> Seen:
        """Add up what evaluation did over a step, at rates that are found anew where the body has moved."""
        omega, count = body.model.angular_frequency, state.q.size
        moved = float(np.linalg.norm(omega * (state.q - seen.place[:count])))
        farthest = max(seen.farthest, float(np.linalg.norm(omega * state.q)))
        rates, place = seen.rates, seen.place
        if moved > _MOVED * farthest:
            rates = body.feed_rates(state, inputs, step)
            place = np.concatenate([state.q, np.zeros(place.size - count)])
        return replace(seen, place=place, farthest=farthest, rates=rates, feed=seen.feed.after(rates, step))
