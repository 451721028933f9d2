"""Pictures of records: error against cost of a sweep's models, a panel a kind of case; and maps of stability.

Records alone are drawn. Colours, markers and words of a chart's points are the same on its page (chart/page.html).
"""

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

from ..files.figures import BLACK, BLUE, GREEN, ORANGE, PINK, SKY, VERMILION, YELLOW, Drawing, save
from ..model.methods import Method
from .candidates import short
from .front import QUANTITIES, Axis, bodies, recommended, tolerance
from .records import RUNS, VERDICTS, Record, Run
from .scene.config import SceneError

COLOURS = {
    Method.LINEAR.value: BLACK,
    Method.STIFFNESS_BY_LOAD.value: ORANGE,
    Method.FLOATING_FRAME.value: YELLOW,
    Method.FRAMES.value: SKY,
    Method.FRAMES_STIFFNESS.value: GREEN,
    Method.SECOND_ORDER.value: BLUE,
}
"""Of models on the front, by method; all others are grey."""
OTHER, BEATEN, TAKEN, WHOLE = PINK, "#bfbfbf", VERMILION, VERMILION
MARKERS = {"normal": "o", "residual": "s", "craig_bampton": "^"}
"""By basis."""
BASIS_WORDS = {"normal": "normal modes", "residual": "with residual flexibility", "craig_bampton": "Craig-Bampton"}
STARS = {"flexfmu": "*", "results": "X"}
"""By solver of the finite element model."""
SOLVERS = {"flexfmu": "finite elements (flexfmu)", "results": "your results"}
BEATEN_WORDS = "beaten in speed and accuracy"
TAKEN_WORDS = "take this: the fastest within the tolerance"
ESTIMATED_WORDS = "its own estimate of its error"

# Panels, inches: with and without the strip for the finite element model.
_WIDTH, _STRIP, _HEIGHT = 5.6, 0.9, 3.6
# Axes of less than so many times their start: two decades nearly, and less than one.
_FEW, _SHORT = 60.0, 6.0
# Room of a letter and of a line of names beside points, half of a point's and the gap between them, parts of a panel.
_LETTER, _LINE, _DOT, _GAP = 0.0125, 0.04, 0.012, 0.022
# Names of the front that are longer, in characters, are set smaller.
_LONG_LINE = 95
_Box = tuple[float, float, float, float]


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

    def figure(self, fronts: dict[str, list[Record]], title: str) -> Figure:
        """Draw it."""
        names = {quantity: self._names(members, quantity) for quantity, members in fronts.items()}
        handles = self._handles({row.method for members in fronts.values() for row in members})
        columns = (5 if len(self._bodies) > 1 else 6) if len(fronts) > 1 else 3
        below = 0.125 * max(len(lines) for lines in names.values()) + 0.15
        above = 0.42 + 0.17 * math.ceil(len(handles) / columns) + 0.4
        height = _HEIGHT + below + above + 0.45
        figure = Drawing(figsize=((_WIDTH + _STRIP) * len(fronts), height))
        for number, (quantity, members) in enumerate(fronts.items()):
            left = (number + 0.11) / len(fronts)
            bottom, tall = (below + 0.45) / height, _HEIGHT / height
            self._panel(figure, quantity, members, (left, bottom, 0.87 / len(fronts), tall))
            place = (number + 0.07) / len(fronts), (below - 0.02) / height
            size = "xx-small" if max(map(len, names[quantity])) > _LONG_LINE else "x-small"
            figure.text(*place, "\n".join(names[quantity]), fontsize=size, va="top", linespacing=1.3)
        place = 0.5, 1.0 - 0.27 / height
        look: dict[str, Any] = {"fontsize": "x-small", "frameon": False, "ncols": columns}
        figure.legend(handles=handles, loc="upper center", bbox_to_anchor=place, **look)
        figure.suptitle(title, fontsize="medium", y=1.0 - 0.1 / height, va="top")
        return figure

    def _cost(self, row: Record) -> float:
        return float(getattr(row, self._axis.column))

    def _finite_elements(self, quantity: str) -> list[Record]:
        return [row for row in self._whole if not math.isnan(getattr(row, quantity))]

    def _panel(self, figure: Figure, quantity: str, members: list[Record], place: _Box) -> None:
        whole = [row for row in self._finite_elements(quantity) if math.isfinite(self._cost(row))]
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
            value, cost = getattr(row, quantity), self._cost(row)
            if not (math.isfinite(value) and value > 0.0 and math.isfinite(cost)):
                continue
            named = row in members or row is self._best
            colour = COLOURS.get(row.method, OTHER) if named else BEATEN
            axes.plot(cost, 100.0 * value, zorder=3.0 if named else 2.0, **self._look(row, colour))
            if named and quantity == "static_displacement" and row.static_estimate > 0.0:
                told: dict[str, Any] = {"color": colour, "linewidth": 0.8, "zorder": 2.5}
                axes.plot([cost, cost], [100.0 * value, 100.0 * row.static_estimate], linestyle=":", **told)
                axes.plot(cost, 100.0 * row.static_estimate, "_", mew=1.8, markersize=9, **told)
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
        pairs = [(self._cost(row), getattr(row, self._axis.per_second)) for row in self._rows]
        known = [per_second / cost for cost, per_second in pairs if math.isfinite(cost) and math.isfinite(per_second)]
        if known:
            scale = statistics.median(known)
            above = axes.secondary_xaxis("top", functions=(lambda x: x * scale, lambda x: x / scale))
            above.set_xlabel("ms per simulated second", fontsize="x-small")
            above.tick_params(which="both", labelsize="xx-small")
            _mark(above.xaxis, *(scale * x for x in axes.get_xlim()))

    def _front(self, axes: Axes, members: Sequence[Record], quantity: str) -> None:
        marked = members if self._best is None or self._best in members else [*members, self._best]
        points = [(self._cost(row), 100.0 * getattr(row, quantity)) for row in marked]
        steps = points[: len(members)]
        axes.step([x for x, _ in steps], [y for _, y in steps], where="post", color="k", linewidth=0.8, zorder=1.5)
        # Scales follow the data only now, with room for names below the last point.
        axes.margins(y=0.1)
        axes.autoscale_view()
        place = axes.transAxes.inverted().transform(axes.transData.transform(np.array(points))).tolist()
        taken = [(x - _DOT, y - _DOT, x + _DOT, y + _DOT) for x, y in place]
        # The model to take has the first choice.
        for k in sorted(range(len(members)), key=lambda k: members[k] is not self._best):
            name, box, right, below = _room(f"#{k + 1}", members[k].short_label, place[k], taken)
            taken.append(box)
            beside: dict[str, Any] = {"ha": "left" if right else "right", "va": "top" if below else "bottom"}
            shift, units = (-2 if right else 2, -7 if below else 7), "offset points"
            text = axes.annotate(name, points[k], shift, textcoords=units, fontsize="x-small", zorder=5, **beside)
            text.set_path_effects([withStroke(linewidth=2.0, foreground="w")])

    def _strip(self, strip: Axes, axes: Axes, whole: list[Record], quantity: str) -> None:
        """The finite element model, far to the right, beyond a gap; what is the reference stands on the floor."""
        costs = [self._cost(row) for row in whole]
        low, high = axes.get_ylim()
        strip.set_xscale("log")
        strip.set_yscale("log")
        # Whole decades, so that one at least is told.
        strip.set_xlim(10.0 ** math.floor(math.log10(min(costs))), 10.0 ** math.ceil(math.log10(max(costs))))
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
            f"#{n}  {f'{row.body}: ' if several else ''}{row.label}; {short(self._cost(row))} ×, "
            f"{100.0 * getattr(row, quantity):.2g} %" + ("" if row.share <= 1.0 else " (misses the tolerance)")
            for n, row in enumerate(members, start=1)
        ]
        for row in self._finite_elements(quantity):
            kind = "one equilibrium" if quantity.startswith("static") else "a step's share"
            seconds = 1e-6 * row.step_us
            took = f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"
            lines.append(f"–  {row.label}, {kind}: {took}, {short(row.fmu_ratio)} ×")
        return lines

    def _handles(self, methods: set[str]) -> list[Line2D]:
        def dot(label: str, face: str = "0.3", edge: str = "0.3", marker: str = "o", size: float = 5) -> Line2D:
            colours = {"color": "none", "markerfacecolor": face, "markeredgecolor": edge}
            return Line2D([], [], label=label, marker=marker, markersize=size, **colours)  # type: ignore[arg-type]

        colours = {m.label: COLOURS.get(m.value, OTHER) for m in Method if m.value in methods}
        handles = [dot(label, colour, colour) for label, colour in (colours | {BEATEN_WORDS: BEATEN}).items()]
        bases = [basis for basis in BASIS_WORDS if any(row.basis == basis for row in self._rows)]
        handles += [dot(BASIS_WORDS[basis], marker=MARKERS[basis]) for basis in bases]
        if len(self._bodies) > 1:
            handles += [dot(body, face="w" if k else "0.3") for k, body in enumerate(self._bodies)]
        if self._best is not None:
            handles.append(dot(TAKEN_WORDS, "none", TAKEN, size=9))
        if any(row.static_estimate > 0.0 for row in self._rows):
            handles.append(dot(ESTIMATED_WORDS, edge="0.3", marker="_", size=9))
        solvers = dict.fromkeys(row.solver for row in self._whole)
        return handles + [dot(SOLVERS.get(s, s), WHOLE, WHOLE, STARS.get(s, "*"), 7) for s in solvers]


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


# Errors are shades, which grey and colour-blind eyes keep apart; verdicts are frames and hatches.
_SHADES = LinearSegmentedColormap.from_list("errors", ["#f1f6fb", "#c6dcef", "#5b9bcb", "#0b4c8c"])
_SCALE = LogNorm(1e-3, 1.0, clip=True)
_LOOKS: dict[str, dict[str, object]] = {
    "right": {"edgecolor": "white", "linewidth": 0.8},
    "warned": {"edgecolor": ORANGE, "linewidth": 1.8},
    "refused": {"edgecolor": "white", "facecolor": "#b0b0b0", "hatch": "////", "linewidth": 0.8},
    "silent": {"edgecolor": VERMILION, "hatch": "xx", "linewidth": 1.8},
}
# From here on a shade is so dark that its number is white.
_DARK = 0.6
# Size of a cell, of what stands beside cells, and of a page across, inches; wider maps have panels below each other.
_CELL, _ROW, _LABELS, _PAGE = 0.42, 0.26, 2.6, 8.0


def draw_map(records: Path, picture: Path) -> None:
    """Draw the map of some records, a panel a case.

    Parameters
    ----------
    records, picture : Path

    Raises
    ------
    SceneError
        No runs.
    OutputError
        The picture cannot be written.
    """
    save(map_figure(records), picture)


def map_figure(records: Path) -> Figure:
    """The same as a figure."""
    rows = RUNS.read(records)
    if not rows:
        raise SceneError(f"{records}: no runs, nothing to draw")
    cases = list(dict.fromkeys(run.case for run in rows))
    wide, high = len({run.factor for run in rows}), len({run.model for run in rows})
    panel_width = _CELL * wide + 0.6
    across = min(len(cases), max(1, int((_PAGE - _LABELS) / panel_width)))
    down = math.ceil(len(cases) / across)
    figure = Drawing(figsize=(across * panel_width + _LABELS, down * (_ROW * high + 0.7) + 0.9), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharey=True)
    for panel in grid.flat[len(cases) :]:
        panel.set_visible(False)
    for panel, case in zip(grid.flat, cases, strict=False):
        _draw_case(panel, [run for run in rows if run.case == case])
        panel.set_title(case, fontsize="small")
    bar = figure.colorbar(ScalarMappable(_SCALE, _SHADES), ax=grid, pad=0.02, fraction=0.03, aspect=30, extend="both")
    bar.set_ticks([0.001, 0.01, 0.1, 1.0], labels=["0.1 %", "1 %", "10 %", "100 %"], fontsize="x-small")
    bar.set_label("error", fontsize="small")
    handles = [Patch(**{"facecolor": "#e3eef8", **_LOOKS[one]}, label=words) for one, words in VERDICTS.items()]  # type: ignore[arg-type]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize="small", frameon=False)
    figure.suptitle(f"{rows[0].body}; numbers are errors in %, –: no equilibrium to compare with", fontsize="medium")
    return figure


def _draw_case(panel: Axes, rows: Sequence[Run]) -> None:
    across = sorted({run.factor for run in rows}, key=float)
    up = list(dict.fromkeys(run.model for run in rows))[::-1]
    for run in rows:
        x, y, found = across.index(run.factor), up.index(run.model), run.verdict
        known = math.isfinite(run.error)
        look = {"facecolor": _SHADES(_SCALE(run.error)) if known else "white", **_LOOKS[found]}
        order = 2.0 if found in ("warned", "silent") else 1.0
        panel.add_patch(Rectangle((x + 0.04, y + 0.05), 0.92, 0.9, zorder=order, **look))  # type: ignore[arg-type]
        if found != "refused":
            colour = "white" if known and _SCALE(run.error) > _DARK else "black"
            words = percent_words(run.error) if known else "–"
            panel.text(x + 0.5, y + 0.5, words, ha="center", va="center", fontsize=7, color=colour, zorder=3.0)
    panel.set(xlim=(0, len(across)), ylim=(0, len(up)))
    panel.set_xticks(np.arange(len(across)) + 0.5, across, fontsize="x-small")
    panel.set_yticks(np.arange(len(up)) + 0.5, up, fontsize="x-small")
    panel.set_xlabel("factor of the loads", fontsize="small")
    panel.tick_params(length=0)


def percent_words(error: float) -> str:
    """Error in %, as short as can be.

    Parameters
    ----------
    error : float
        Relative.

    Returns
    -------
    str
    """
    percent = 100.0 * error
    if percent >= 999.5:
        return ">999"
    return f"{percent:.0f}" if percent >= 9.5 else f"{percent:.1g}" if percent >= 0.001 else "0"
