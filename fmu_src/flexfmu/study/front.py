"""Which models nothing beats in cost and error at once, and which of them to take."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.methods import Method
from .candidates import short
from .records import Record

# A member of the front is named where it takes at least this share off the error of the one before it.
WORTH_NAMING = 0.1
# Costs that differ by less are the same: one timing after the other of the same model differs by a per cent or two.
SAME_COST = 0.03
QUANTITIES = {
    "static_displacement": "static displacement error",
    "transient_displacement": "displacement error over time, rms",
}
_KINDS = {"static_displacement": " static", "transient_displacement": " over time"}


@dataclass(frozen=True, slots=True)
class Axis:
    """What cost is drawn.

    Attributes
    ----------
    column : str
        Of the records.
    label, unit : str
    per_second : str
        Column of the same in ms per simulated second.
    """

    column: str
    label: str
    unit: str
    per_second: str


RATIO = Axis("fmu_ratio", "time of a step over that of an empty FMU", "× empty FMU", "fmu_ms_per_s")
BARE = Axis("step_us", "time of a step from Python / µs", "µs", "bare_ms_per_s")


def cost_axis(rows: Sequence[Record]) -> Axis:
    """Ratios to the empty FMU, unless nothing was timed through one."""
    return RATIO if any(math.isfinite(row.fmu_ratio) for row in rows) else BARE


def front(rows: Sequence[Record], quantity: str, axis: Axis = RATIO) -> list[Record]:
    """Records that no other beats in cost and in a quantity, cheapest first, with those left out that gain little."""
    return plain_front(rows, axis.column, quantity, WORTH_NAMING, SAME_COST)


def recommended(rows: Sequence[Record], axis: Axis) -> Record | None:
    """The cheapest model that meets the scene's tolerance, or None."""
    return next((row for row in front(rows, "share", axis) if row.share <= 1.0), None)


def finding(rows: Sequence[Record], axis: Axis) -> str:
    """What to take, in a line: its number on the front that is drawn first, its error, its cost over linear's."""
    best = recommended(rows, axis)
    several = len(bodies(rows)) > 1
    if best is None:
        nearest = min(rows, key=lambda row: row.share)
        return f"none meets the tolerance; nearest, {short(nearest.share)} × it, {describe(nearest, axis, several)}"
    first = next(q for q in (*QUANTITIES, "share") if any(getattr(row, q) > 0.0 for row in rows))
    members = front(rows, first, axis)
    number = f"#{members.index(best) + 1}: " if best in members else ""
    name = f"{best.body}: {best.label}" if several else best.label
    linear = [getattr(row, axis.column) for row in rows if row.method == Method.LINEAR.value and row.body == best.body]
    cost = getattr(best, axis.column)
    least = min((one for one in linear if one > 0.0), default=math.nan)
    errors = {words: getattr(best, q) for q, words in _KINDS.items() if getattr(best, q) > 0.0}
    told = [f"{100.0 * error:.2g} %{words if len(errors) > 1 else ''}" for words, error in errors.items()]
    told += [f"{cost / least:.2g} × linear" if cost > 0.0 and least > 0.0 else f"{short(cost)} {axis.unit}"]
    return f"take {number}{name}; {', '.join(told)}"


def tolerance(rows: Sequence[Record], quantity: str) -> float | None:
    """The scene's tolerance of a displacement, from records that it limits; None where they do not agree on one.

    Parameters
    ----------
    rows : sequence of Record
    quantity : str
        One of `QUANTITIES`.
    """
    place = quantity.replace("displacement", "at")
    found = [
        getattr(row, quantity) / row.share
        for row in rows
        if 0.0 < row.share < math.inf and row.limited_by == f"displacement, {getattr(row, place)}"
    ]
    # Absolute tolerances differ from case to case.
    return found[0] if found and max(found) < 1.01 * min(found) else None


def describe(row: Record, axis: Axis, several: bool = False) -> str:
    """What a model costs, and which it is, in a few words.

    Parameters
    ----------
    row : Record
    axis : Axis
    several : bool
        Whether the body has to be named.

    Returns
    -------
    str
    """
    name = f"{row.body}: {row.label}" if several else row.label
    cost, per_second = getattr(row, axis.column), getattr(row, axis.per_second)
    return f"{short(cost)} {axis.unit}, {short(per_second)} ms/s: {name}"


def bodies(rows: Sequence[Record]) -> list[str]:
    """Names of the bodies, each once."""
    return list(dict.fromkeys(row.body for row in rows))


def plain_front(rows: Sequence[Record], cost: str, error: str, margin: float = 0.0, same: float = 0.0) -> list[Record]:
    """Records that no other beats; of those that are as good as such a one, the plainest stands for it.

    Parameters
    ----------
    rows : sequence of Record
    cost, error : str
        Columns.
    margin : float
        Relative gain in error that makes a costlier member worth naming.
    same : float
        Relative difference of costs that counts as none.

    Returns
    -------
    list of Record
        Cheapest first.
    """
    costs, errors = ([getattr(row, name) for row in rows] for name in (cost, error))
    members: dict[Record, None] = {}
    for k in pareto_front(costs, errors, margin):
        most, worst = (1.0 + same) * costs[k], errors[k] / (1.0 - margin)
        as_good = [n for n in range(len(rows)) if costs[n] <= most and errors[n] <= worst]
        # One may stand for two.
        members[rows[min(as_good, key=lambda n: (rows[n].plainness, costs[n]))]] = None
    # Where a costlier one stands for a member, the next member may beat it.
    left = [one for one in members if not any(_beats(other, one, cost, error) for other in members)]
    return sorted(left, key=lambda row: float(getattr(row, cost)))


def _beats(row: Record, other: Record, cost: str, error: str) -> bool:
    """Whether a record is at least as good as another one in both, and is not the same in both."""
    here, there = ((getattr(one, cost), getattr(one, error)) for one in (row, other))
    return bool(here[0] <= there[0] and here[1] <= there[1] and here != there)


def pareto_front(costs: Sequence[float], errors: Sequence[float], margin: float = 0.0) -> list[int]:
    """Members that no other beats in cost and error at once, cheapest first.

    Parameters
    ----------
    costs, errors : sequence of float
        What is not finite never belongs to the front.
    margin : float
        Relative gain in error that makes a costlier member worth naming.

    Returns
    -------
    list of int
    """
    front: list[int] = []
    known = (k for k, pair in enumerate(zip(costs, errors, strict=True)) if all(map(math.isfinite, pair)))
    # Of equal costs the smaller error comes first.
    for k in sorted(known, key=lambda k: (costs[k], errors[k])):
        if not front or errors[k] < (1.0 - margin) * errors[front[-1]]:
            front.append(k)
    return front
