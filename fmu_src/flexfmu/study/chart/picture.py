"""The picture of a chart: error against cost, a panel a kind of case."""

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

from ...files.figures import save
from ...model.methods import Method
from ..scenes.words import short
from .front import QUANTITIES, Axis, bodies, recommended, tolerance
from .look import BASES, BEATEN, BEATEN_WORDS, COLOURS, MARKERS, OTHER, SOLVERS, STARS, TAKEN, TAKEN_WORDS, WHOLE
from .records import Record

# Panels, inches: with and without the strip for the finite element model.
_WIDTH, _STRIP, _HEIGHT = 5.6, 0.9, 3.6
# Axes of less than so many times their start: two decades nearly, and less than one.
_FEW, _SHORT = 60.0, 6.0
# Room of a letter and of a line of names beside points, half of a point's and the gap between them, parts of a panel.
_LETTER, _LINE, _DOT, _GAP = 0.0125, 0.04, 0.012, 0.022
# Names of the front that are longer, in characters, are set smaller.
_LONG_LINE = 95


class Picture:
    """A picture of some records.

    Parameters
    ----------
    rows : sequence of Record
        Of reduced models.
    whole : sequence of Record
        Of the finite element model.
    axis : Axis
    """

    def __init__(self, rows: Sequence[Record], whole: Sequence[Record], axis: Axis):
        self._rows = rows
        self._whole = whole
        self._axis = axis
        self._bodies = bodies(rows)
        self._best = recommended(rows, axis)
        self._named: set[Record] = set()

    def draw(self, fronts: dict[str, list[Record]], picture: Path, title: str) -> None:
        """Write the picture."""
        self._named = {row for members in fronts.values() for row in members}
        names = {quantity: self._names(members, quantity) for quantity, members in fronts.items()}
        handles = self._handles()
        width = (_WIDTH + _STRIP) * len(fronts)
        columns = (5 if len(self._bodies) > 1 else 6) if len(fronts) > 1 else 3
        below = 0.125 * max(len(lines) for lines in names.values()) + 0.15
        above = 0.42 + 0.17 * math.ceil(len(handles) / columns) + 0.4
        height = _HEIGHT + below + above + 0.45
        figure = plt.figure(figsize=(width, height))
        for number, (quantity, members) in enumerate(fronts.items()):
            left = (number + 0.11) / len(fronts)
            bottom, tall = (below + 0.45) / height, _HEIGHT / height
            self._panel(figure, quantity, members, (left, bottom, 0.87 / len(fronts), tall))
            place = (number + 0.07) / len(fronts), (below - 0.02) / height
            size = "xx-small" if max(map(len, names[quantity])) > _LONG_LINE else "x-small"
            figure.text(*place, "\n".join(names[quantity]), fontsize=size, va="top", linespacing=1.3)
        figure.legend(
            handles=handles,
            fontsize="x-small",
            frameon=False,
            ncols=columns,
            loc="upper center",
            bbox_to_anchor=(0.5, 1.0 - 0.27 / height),
        )
        figure.suptitle(title, fontsize="medium", y=1.0 - 0.1 / height, va="top")
        save(figure, picture)

    def _finite_elements(self, quantity: str) -> list[Record]:
        return [row for row in self._whole if not math.isnan(getattr(row, quantity))]

    def _panel(
        self, figure: Figure, quantity: str, members: list[Record], place: tuple[float, float, float, float]
    ) -> None:
        whole = [r for r in self._finite_elements(quantity) if math.isfinite(getattr(r, self._axis.column))]
        left, bottom, wide, tall = place
        share = _STRIP / (_WIDTH + _STRIP) if whole else 0.0
        axes = figure.add_axes((left, bottom, wide * (1.0 - share), tall))
        self._points(axes, members, quantity)
        self._front(axes, members, quantity)
        self._label(axes, quantity)
        if whole:
            gap = 0.012 * wide
            strip = figure.add_axes((left + wide * (1.0 - share) + gap, bottom, wide * share - gap, tall))
            self._strip(strip, axes, whole, quantity)

    def _points(self, axes: Axes, members: Sequence[Record], quantity: str) -> None:
        axes.set_xscale("log")
        axes.set_yscale("log")
        for row in self._rows:
            value, cost = getattr(row, quantity), getattr(row, self._axis.column)
            if not (math.isfinite(value) and value > 0.0 and math.isfinite(cost)):
                continue
            named = row in members or row is self._best
            axes.plot(
                cost, 100.0 * value, zorder=3.0 if named else 2.0, **self._look(row, _colour(row) if named else BEATEN)
            )
            if row is self._best:
                axes.plot(cost, 100.0 * value, "o", mfc="none", mec=TAKEN, mew=1.6, markersize=13, zorder=4.0)
        limit = tolerance(self._rows, quantity)
        if limit is not None:
            axes.axhline(100.0 * limit, color=TAKEN, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1.0)
            words = axes.annotate(
                f"tolerance {100.0 * limit:.3g} %", (1.0, 100.0 * limit), (-3, 2), ("axes fraction", "data"),
                "offset points", ha="right", fontsize="xx-small", color=TAKEN,
            )  # fmt: skip
            words.set_path_effects([withStroke(linewidth=2.0, foreground="w")])

    def _look(self, row: Record, colour: str) -> dict[str, Any]:
        """Form by basis, size by modes, filled for the first body."""
        return {
            "marker": MARKERS.get(row.basis, "D"),
            "markersize": 4.0 + 1.5 * math.log10(max(row.mode_count, 1)),
            "color": "none",
            "markerfacecolor": colour if row.body == self._bodies[0] else "w",
            "markeredgecolor": colour,
        }

    def _label(self, axes: Axes, quantity: str) -> None:
        axes.set_xlabel(self._axis.label, fontsize="small")
        axes.set_ylabel(f"{QUANTITIES[quantity]} / %", fontsize="small")
        for direction in (axes.xaxis, axes.yaxis):
            direction.set_major_formatter("{x:g}")
        values = [v for v in (getattr(row, quantity) for row in self._rows) if 0.0 < v < math.inf]
        # Within less than two decades the decades alone say too little, within one also their parts.
        axes.yaxis.set_minor_formatter("{x:g}" if max(values) < _FEW * min(values) else NullFormatter())
        _mark(axes.xaxis, *axes.get_xlim())
        axes.tick_params(which="both", labelsize="x-small")
        axes.grid(alpha=0.25, which="both")
        pairs = [(getattr(r, self._axis.column), getattr(r, self._axis.per_second)) for r in self._rows]
        known = [per_second / cost for cost, per_second in pairs if math.isfinite(cost) and math.isfinite(per_second)]
        if known:
            scale = statistics.median(known)
            above = axes.secondary_xaxis("top", functions=(lambda x: x * scale, lambda x: x / scale))
            above.set_xlabel("ms per simulated second", fontsize="x-small")
            above.tick_params(which="both", labelsize="xx-small")
            _mark(above.xaxis, *(scale * x for x in axes.get_xlim()))

    def _front(self, axes: Axes, members: Sequence[Record], quantity: str) -> None:
        costs = [getattr(row, self._axis.column) for row in members]
        found = [100.0 * getattr(row, quantity) for row in members]
        axes.step(costs, found, where="post", color="k", linewidth=0.8, zorder=1.5)
        # Scales follow the data only now.
        axes.autoscale_view()
        marked = members if self._best is None or self._best in members else [*members, self._best]
        points = [(getattr(row, self._axis.column), 100.0 * getattr(row, quantity)) for row in marked]
        place = axes.transAxes.inverted().transform(axes.transData.transform(np.array(points))).tolist()
        taken = [(x - _DOT, y - _DOT, x + _DOT, y + _DOT) for x, y in place]
        # The model to take has the first choice.
        for k in sorted(range(len(members)), key=lambda k: members[k] is not self._best):
            name, box, right, below = _room(f"#{k + 1}", members[k].short_label, place[k], taken)
            taken.append(box)
            text = axes.annotate(
                name,
                points[k],
                xytext=(-2 if right else 2, -7 if below else 7),
                textcoords="offset points",
                ha="left" if right else "right",
                va="top" if below else "bottom",
                fontsize="x-small",
                zorder=5,
            )
            text.set_path_effects([withStroke(linewidth=2.0, foreground="w")])

    def _strip(self, strip: Axes, axes: Axes, whole: list[Record], quantity: str) -> None:
        """The finite element model, far to the right, beyond a gap; what is the reference stands on the floor."""
        costs = [getattr(row, self._axis.column) for row in whole]
        low, high = axes.get_ylim()
        strip.set_xscale("log")
        strip.set_yscale("log")
        # Whole decades, so that one at least is told.
        strip.set_xlim(
            *(10.0 ** round_(math.log10(x)) for round_, x in ((math.floor, min(costs)), (math.ceil, max(costs))))
        )
        strip.set_ylim(low, high)
        for row, cost in zip(whole, costs, strict=True):
            value = max(100.0 * getattr(row, quantity), low)
            strip.plot(cost, value, STARS.get(row.solver, "*"), color=WHOLE, markersize=9, clip_on=False, zorder=4)
        strip.tick_params(which="both", labelsize="xx-small", labelleft=False, left=False)
        strip.xaxis.set_minor_formatter(NullFormatter())
        strip.grid(alpha=0.25, which="major")
        strip.spines["left"].set_linestyle((0, (1, 2)))
        axes.set_ylim(low, high)
        strip.set_title("finite\nelements", fontsize="xx-small")

    def _names(self, members: Sequence[Record], quantity: str) -> list[str]:
        """Who is on the front, one line each, and what the finite element model takes."""
        several = len(self._bodies) > 1
        lines = [
            f"#{n}  {f'{row.body}: ' if several else ''}{row.label}; {short(getattr(row, self._axis.column))} ×, "
            f"{100.0 * getattr(row, quantity):.2g} %" + ("" if row.share <= 1.0 else " (misses the tolerance)")
            for n, row in enumerate(members, start=1)
        ]
        for row in self._finite_elements(quantity):
            kind = "one equilibrium" if quantity.startswith("static") else "a step's share"
            lines.append(f"–  {row.label}, {kind}: {describe_time(row)}, {short(row.fmu_ratio)} ×")
        return lines

    def _handles(self) -> list[Line2D]:
        def dot(label: str, **style: object) -> Line2D:
            look: dict[str, Any] = {"color": "none", "marker": "o", "markersize": 5}
            look |= {"markeredgecolor": "0.3", "markerfacecolor": "0.3"} | style
            return Line2D([], [], label=label, **look)

        ranks = [method.value for method in Method]
        methods = sorted({row.method for row in self._named}, key=ranks.index)
        colours = {method: COLOURS.get(method, OTHER) for method in methods}
        handles = [dot(Method(m).label, markerfacecolor=c, markeredgecolor=c) for m, c in colours.items()]
        handles += [dot(BEATEN_WORDS, markerfacecolor=BEATEN, markeredgecolor=BEATEN)]
        handles += [
            dot(words, marker=MARKERS[basis])
            for basis, words in BASES.items()
            if any(row.basis == basis for row in self._rows)
        ]
        if len(self._bodies) > 1:
            handles += [dot(body, markerfacecolor="w" if k else "0.3") for k, body in enumerate(self._bodies)]
        if self._best is not None:
            ring = {"markerfacecolor": "none", "markeredgecolor": TAKEN, "markersize": 9}
            handles.append(dot(TAKEN_WORDS, **ring))
        for solver in dict.fromkeys(row.solver for row in self._whole):
            red = {"markerfacecolor": WHOLE, "markeredgecolor": WHOLE, "markersize": 7}
            handles.append(dot(SOLVERS.get(solver, solver), marker=STARS.get(solver, "*"), **red))
        return handles


_Box = tuple[float, float, float, float]


def _room(number: str, label: str, point: tuple[float, float], taken: Sequence[_Box]) -> tuple[str, _Box, bool, bool]:
    """A name beside a point where nothing else is: the name, its box, and whether it goes to the right and below.

    Below the front no model is: names go there, to the left where there is room; where there is none, the number alone.
    """
    (x, y), found = point, None
    for name, sides in ((f"{number} {label}", (True,)), (number, (True, False))):
        wide = _LETTER * len(name)
        for below in sides:
            for right in (x < 0.45, x >= 0.45):
                left, top = (x if right else x - wide), (y - _GAP if below else y + _GAP + _LINE)
                box = (left, top - _LINE, left + wide, top)
                found = name, box, right, below
                if left > 0.0 and left + wide < 1.0 and not any(_overlap(box, other) for other in taken):
                    return found
    assert found is not None
    return found


def _overlap(one: _Box, other: _Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _mark(axis: Any, low: float, high: float) -> None:
    """Ticks of a logarithmic axis that may be much shorter than a decade."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}" if high < _FEW * low else NullFormatter())
    if high < _SHORT * low:
        axis.set_major_locator(MaxNLocator(7))
        axis.set_minor_locator(NullLocator())


def _colour(row: Record) -> str:
    return COLOURS.get(row.method, OTHER)


def describe_time(row: Record) -> str:
    """Time of the finite element model for what a reduced model does in a step, in words."""
    seconds = 1e-6 * row.step_us
    return f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"
