"""Pictures of sweeps' records: error against cost."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

from ..methods import Method
from ..targets import PICTURE_SUFFIXES, check_target, whole_file
from .errors import SceneError
from .page import page
from .records import REDUCED, Record, plain_front, read_records

# A member of the front is named where it takes at least this share off the error of the one before it.
WORTH_NAMING = 0.1
# Costs that differ by less are the same: one timing after the other of the same model differs by a per cent or two.
SAME_COST = 0.03
_MARKERS = {"normal": "o", "residual": "s", "craig_bampton": "^"}
_BASES = {"normal": "normal modes", "residual": "with residual flexibility", "craig_bampton": "Craig-Bampton"}
_LINEAR = "0.55"
# Methods with a shade for each number of frames: maps for one body after the other, and what part of them.
_SHADES = {
    Method.FRAMES.value: (("viridis", "cool", "autumn"), 0.92, 0.05),
    Method.FRAMES_STIFFNESS.value: (("YlGn", "PuBu", "copper_r"), 0.5, 1.0),
    Method.SECOND_ORDER.value: (("RdPu", "YlOrBr", "Greys"), 0.5, 1.0),
}
# Methods on frames that are there for comparison.
_OTHERS = {
    Method.MODAL_ROTATION.value: "tab:red",
    Method.HALF_ROTATION.value: "tab:pink",
    Method.FLOATING_FRAME.value: "tab:orange",
}
_STARS = {"flexfmu": "*", "calculix": "P", "results": "X"}
# Panels, inches: with and without the strip for the finite element model.
_WIDTH, _STRIP, _HEIGHT = 5.6, 0.9, 3.6
# Axes of less than so many times their start: two decades nearly, and less than one.
_FEW, _SHORT = 60.0, 6.0
# Names of the front that are longer, in characters, are set smaller.
_LONG_LINE = 95
QUANTITIES = {
    "static_displacement": "static displacement error",
    "transient_displacement": "displacement error over time, rms",
}


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


RATIO = Axis("fmu_ratio", "time of a step over that of an empty FMU", "×", "fmu_ms_per_s")
BARE = Axis("step_us", "time of a step, without FMI / µs", "µs", "bare_ms_per_s")


def chart(
    records: Path | Sequence[Path], picture: Path | None = None, html: Path | None = None, title: str = ""
) -> list[Record]:
    """Draw the records of sweeps as a picture, as a page to look into, or as both.

    Parameters
    ----------
    records : Path or sequence of Path
        As `sweep` writes them; those of several bodies are drawn together.
    picture : Path, optional
        PNG, PDF or SVG.
    html : Path, optional
        One file, which needs no network.
    title : str

    Returns
    -------
    list of Record
        The members of the picture's fronts.

    Raises
    ------
    SceneError
        No records with an answer.
    OutputError
        A file cannot be written.
    """
    paths = [records] if isinstance(records, Path) else list(records)
    check_targets(paths, picture, html)
    every = [row for path in paths for row in read_records(path) if row.status == "ok"]
    rows = [row for row in every if row.solver == REDUCED]
    # Of descriptions of the same body one will do.
    whole = list({(row.solver, row.case): row for row in reversed(every) if row.solver != REDUCED}.values())[::-1]
    if not rows:
        raise SceneError(f"{', '.join(map(str, paths))}: no record with an answer, nothing to draw")
    title = title or f"{', '.join(_bodies(rows))}: {len(rows)} models"
    if html is not None:
        with whole_file(html) as part:
            part.write_text(page(every, title), encoding="utf-8")
    quantities = [q for q in QUANTITIES if any(getattr(row, q) > 0.0 for row in rows)]
    axis = cost_axis(rows)
    fronts = {q: front(rows, q, axis) for q in quantities}
    if picture is not None:
        _Picture(rows, whole, axis).draw(fronts, picture, title)
    return list(dict.fromkeys(row for members in fronts.values() for row in members))


def check_targets(records: Sequence[Path], picture: Path | None, html: Path | None) -> None:
    """Refuse files that cannot be written, before any work is done for them.

    Parameters
    ----------
    records : sequence of Path
    picture, html : Path or None

    Raises
    ------
    OutputError
    """
    check_target(records[0], (".csv",))
    if picture is not None:
        check_target(picture, PICTURE_SUFFIXES, inputs=records)
    if html is not None:
        check_target(html, (".html", ".htm"), inputs=records)


def cost_axis(rows: Sequence[Record]) -> Axis:
    """Ratios to the empty FMU, unless nothing was timed through one."""
    return RATIO if any(math.isfinite(row.fmu_ratio) for row in rows) else BARE


def front(rows: Sequence[Record], quantity: str, axis: Axis = RATIO) -> list[Record]:
    """Records that no other beats in cost and in a quantity, cheapest first, with those left out that gain little."""
    return plain_front(rows, axis.column, quantity, WORTH_NAMING, SAME_COST)


def describe(row: Record, axis: Axis, several: bool = False) -> str:
    """A model and its cost in a few words.

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
    return f"{name}: {_short(cost)} {axis.unit}, {_short(per_second)} ms/s"


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1e4 else f"{value:.2g}"


def _bodies(rows: Sequence[Record]) -> list[str]:
    return list(dict.fromkeys(row.body for row in rows))


class _Picture:
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
        self._bodies = _bodies(rows)
        self._colours = {row: self._colour(row) for row in rows}

    def draw(self, fronts: dict[str, list[Record]], picture: Path, title: str) -> None:
        """Write the picture."""
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
        try:
            with whole_file(picture) as part:
                figure.savefig(part, dpi=150, format=picture.suffix[1:])
        finally:
            plt.close(figure)

    def _colour(self, row: Record) -> str | tuple[float, ...]:
        """Grey for linear methods, a shade for each number of frames of a body, and one each for comparison."""
        body = self._bodies.index(row.body)
        if not row.on_frames:
            return _LINEAR if body == 0 else "0.78"
        if row.method not in _SHADES:
            return _OTHERS.get(row.method, "tab:brown")
        counts = sorted({r.frames for r in self._rows if r.method == row.method and r.body == row.body})
        place = counts.index(row.frames) / max(len(counts) - 1, 1)
        maps, first, last = _SHADES[row.method]
        shade: tuple[float, ...] = plt.get_cmap(maps[body % len(maps)])(first + (last - first) * place)
        return shade

    def _finite_elements(self, quantity: str) -> list[Record]:
        return [row for row in self._whole if not math.isnan(getattr(row, quantity))]

    def _panel(
        self, figure: Figure, quantity: str, members: list[Record], place: tuple[float, float, float, float]
    ) -> None:
        whole = [r for r in self._finite_elements(quantity) if math.isfinite(getattr(r, self._axis.column))]
        left, bottom, wide, tall = place
        share = _STRIP / (_WIDTH + _STRIP) if whole else 0.0
        axes = figure.add_axes((left, bottom, wide * (1.0 - share), tall))
        self._points(axes, quantity)
        self._front(axes, members, quantity)
        self._label(axes, quantity)
        if whole:
            gap = 0.012 * wide
            strip = figure.add_axes((left + wide * (1.0 - share) + gap, bottom, wide * share - gap, tall))
            self._strip(strip, axes, whole, quantity)

    def _points(self, axes: Axes, quantity: str) -> None:
        axes.set_xscale("log")
        axes.set_yscale("log")
        for row in self._rows:
            value, cost = getattr(row, quantity), getattr(row, self._axis.column)
            if not (math.isfinite(value) and value > 0.0 and math.isfinite(cost)):
                continue
            colour = self._colours[row]
            axes.plot(
                cost,
                100.0 * value,
                _MARKERS.get(row.basis, "D"),
                markersize=4.0 + 1.5 * math.log10(max(row.mode_count, 1)),
                markerfacecolor=colour,
                markeredgecolor=colour,
                # Strong where all that the scene accepts is met.
                alpha=0.95 if row.share <= 1.0 else 0.35,
                zorder=3.0 if row.share <= 1.0 else 2.0,
            )

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
        for number, place in enumerate(zip(costs, found, strict=True), start=1):
            text = axes.annotate(
                str(number), place, xytext=(-7, -9), textcoords="offset points", fontsize="x-small", zorder=5
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
            strip.plot(cost, value, _STARS.get(row.solver, "*"), color="tab:red", markersize=9, clip_on=False, zorder=4)
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
            f"{n}  {describe(row, self._axis, several)}, {100.0 * getattr(row, quantity):.2g} %"
            + ("" if row.share <= 1.0 else " (misses it)")
            for n, row in enumerate(members, start=1)
        ]
        for row in self._finite_elements(quantity):
            kind = "one equilibrium" if quantity.startswith("static") else "a step's share"
            lines.append(f"–  {row.label}, {kind}: {describe_time(row)}, {_short(row.fmu_ratio)} ×")
        return lines

    def _handles(self) -> list[Line2D]:
        def dot(label: str, **style: object) -> Line2D:
            look: dict[str, Any] = {"color": "none", "marker": "o", "markersize": 5}
            look |= {"markeredgecolor": "0.3", "markerfacecolor": "0.3"} | style
            return Line2D([], [], label=label, **look)

        rows, several = self._rows, len(self._bodies) > 1
        known: dict[str, str | tuple[float, ...]] = {}
        ranks = [method.value for method in Method]
        for row in sorted(rows, key=lambda r: (self._bodies.index(r.body), ranks.index(r.method), r.frames)):
            known.setdefault((f"{row.body}: " if several else "") + _colour_words(row), self._colours[row])
        handles = [dot(words, markerfacecolor=c, markeredgecolor=c) for words, c in known.items()]
        handles += [
            dot(words, marker=_MARKERS[basis])
            for basis, words in _BASES.items()
            if any(row.basis == basis for row in rows)
        ]
        if any(row.share > 1.0 for row in rows):
            handles.append(dot("pale: misses the scene's tolerance", alpha=0.35))
        words = {"flexfmu": "finite elements (flexfmu)", "calculix": "CalculiX", "results": "your results"}
        for solver in dict.fromkeys(row.solver for row in self._whole):
            red = {"markerfacecolor": "tab:red", "markeredgecolor": "tab:red", "markersize": 7}
            handles.append(dot(words.get(solver, solver), marker=_STARS.get(solver, "*"), **red))
        return handles


def _mark(axis: Any, low: float, high: float) -> None:
    """Ticks of a logarithmic axis that may be much shorter than a decade."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}" if high < _FEW * low else NullFormatter())
    if high < _SHORT * low:
        axis.set_major_locator(MaxNLocator(7))
        axis.set_minor_locator(NullLocator())


def _colour_words(row: Record) -> str:
    """What a colour stands for."""
    if not row.on_frames:
        return "linear"
    words = row.method.replace("_", " ")
    if row.method not in _SHADES:
        return words
    return f"{words}, frames = {row.frames}" if row.frames >= 0 else f"{words}, the body's own frames"


def describe_time(row: Record) -> str:
    """Time of the finite element model for what a reduced model does in a step, in words."""
    seconds = 1e-6 * row.step_us
    return f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"
