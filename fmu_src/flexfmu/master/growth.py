"""Whether a coupling feeds the motion or takes from it, told while it runs and stopped before it is absurd."""

from collections.abc import Callable

from .exchange import EnergyCount

# Energy created or taken by the coupling, of the most that the springs held, beyond which a run is warned of.
_SHARE = 0.1
# Of the work of all loads: less is round-off.
_NOTHING = 1e-6
# Of the most that the springs held: when they have given back so much, the motion has turned once.
_TURNED = 0.5
# Steps in a row that must agree.
_STEPS = 5
# Growth of the springs' energy since the warning, tenfold motion, at which a run is stopped.
_RUNAWAY = 100.0
# Growth of the springs' energy a step that nothing but a coupling that diverges has for several steps in a row.
_DIVERGING, _IN_A_ROW = 4.0, 6

FED = 'the coupling itself fed the motion: take scheme = "iterated", or a shorter step'
TAKEN = "the coupling itself damped the motion: take a shorter step{}"


class GrowthWatch:
    """Looks at the count of energies after each step.

    Parameters
    ----------
    warn : callable
        Takes the words.
    iterated : bool
        Whether the scheme iterates: of what it takes, `held = "mean"` is the remedy.
    """

    def __init__(self, warn: Callable[[str], None], iterated: bool):
        self._warn = warn
        self._remedy = ', or held = "mean"' if iterated else ', or scheme = "iterated" with held = "mean"'
        self._turned = False
        self._row = {FED: 0, TAKEN: 0}
        self._diverging = 0
        self._warned: dict[str, float] = {}
        self._now = 0.0

    def look(self, count: EnergyCount, time: float) -> str | None:
        """Look at a step's end.

        Parameters
        ----------
        count : EnergyCount
        time : float
            s.

        Returns
        -------
        str or None
            Why the run has to stop.
        """
        self._turned = self._turned or count.now < _TURNED * count.stored
        grew = fed(count)
        diverging = grew and count.now > _DIVERGING * self._now > 0.0
        self._diverging = self._diverging + 1 if diverging else 0
        self._now = count.now
        for kind, found in ((FED, grew), (TAKEN, taken(count))):
            self._row[kind] = self._row[kind] + 1 if found and self._turned else 0
            if self._row[kind] >= _STEPS and kind not in self._warned:
                self._say(kind, count, f" from {time:.6g} s on")
        runaway = grew and count.stored > _RUNAWAY * self._warned.get(FED, float("inf"))
        if runaway or self._diverging >= _IN_A_ROW or not count.stored < float("inf"):
            return f"the motion grows without bound. {FED} (it created {count.created:.3g} J)"
        return None

    def end(self, count: EnergyCount) -> None:
        """Say what was not said on the way."""
        if fed(count) and FED not in self._warned:
            self._say(FED, count, "")

    def _say(self, kind: str, count: EnergyCount, since: str) -> None:
        self._warned[kind] = count.stored
        verb = "created" if kind == FED else "took"
        self._warn(
            f"{kind.format(self._remedy)} (it {verb} {abs(count.created):.3g} J{since}, the springs held "
            f"{count.stored:.3g} J at most)"
        )


def fed(count: EnergyCount) -> bool:
    """Whether the coupling fed the motion, beyond what round-off explains."""
    # What is no number any more has grown, too.
    return not count.created <= max(_SHARE * count.stored, _NOTHING * count.exchanged)


def taken(count: EnergyCount) -> bool:
    """Whether the coupling damped the motion, beyond what round-off explains."""
    return count.created < -max(_SHARE * count.stored, _NOTHING * count.exchanged)
