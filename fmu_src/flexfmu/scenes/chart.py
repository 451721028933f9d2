"""Pictures of a sweep's records: error against cost."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter

from ..targets import PICTURE_SUFFIXES, check_target, whole_file
from .errors import SceneError
from .page import page
from .records import Record, pareto_front, read_records

# A member of the front is named where it takes at least this share off the error of the one before it.
WORTH_NAMING = 0.1
_MARKERS = {"normal": "o", "residual": "s", "craig_bampton": "^"}
_BASES = {"normal": "normal modes", "residual": "with residual flexibility", "craig_bampton": "Craig-Bampton"}
_LINEAR = "0.55"
_WIDTH, _FEW = 5.6, 60.0
# Kinematics for comparison, beside the frames' own colours.
_OTHERS = {"literal": "tab:red", "secant": "tab:pink"}
QUANTITIES = {
    "static_displacement": "static displacement error",
    "transient_displacement": "displacement error over time, rms",
}


def chart(records: Path, picture: Path | None = None, html: Path | None = None, title: str = "") -> list[Record]:
    """Draw the records of a sweep as a picture, as a page to look into, or as both.

    Parameters
    ----------
    records : Path
        As `sweep` writes them.
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
    if picture is not None:
        check_target(picture, PICTURE_SUFFIXES, inputs=(records,))
    if html is not None:
        check_target(html, (".html", ".htm"), inputs=(records,))
    rows = [row for row in read_records(records) if row.status == "ok"]
    if not rows:
        raise SceneError(f"{records}: no record with an answer, nothing to draw")
    title = title or f"{rows[0].body}: {len(rows)} models"
    if html is not None:
        with whole_file(html) as part:
            part.write_text(page(rows, title), encoding="utf-8")
    quantities = [q for q in QUANTITIES if any(getattr(row, q) > 0.0 for row in rows)]
    fronts = {q: front(rows, q) for q in quantities}
    if picture is not None:
        _draw(rows, fronts, picture, title)
    return list(dict.fromkeys(row for members in fronts.values() for row in members))


def front(rows: Sequence[Record], quantity: str) -> list[Record]:
    """Records that no other beats in cost and in a quantity, cheapest first, with those left out that gain little."""
    costs, found = [row.step_us for row in rows], [getattr(row, quantity) for row in rows]
    return [rows[k] for k in pareto_front(costs, found, WORTH_NAMING)]


def _colours(rows: Sequence[Record]) -> dict[tuple[str, int], str | tuple[float, ...]]:
    """A colour for each kinematics and number of frames."""
    counts = sorted({row.frames for row in rows if row.kinematics == "corotated"})
    shades = plt.get_cmap("viridis")
    colours: dict[tuple[str, int], str | tuple[float, ...]] = {}
    for row in sorted(rows, key=lambda r: (r.kinematics != "linear", r.kinematics != "corotated", r.frames)):
        if row.kinematics == "linear":
            colours[row.kinematics, row.frames] = _LINEAR
        elif row.kinematics == "corotated":
            place = counts.index(row.frames) / max(len(counts) - 1, 1)
            colours[row.kinematics, row.frames] = shades(0.92 - 0.87 * place)
        else:
            colours[row.kinematics, row.frames] = _OTHERS.get(row.kinematics, "tab:brown")
    return colours


def _draw(rows: Sequence[Record], fronts: dict[str, list[Record]], picture: Path, title: str) -> None:
    width, lines = _WIDTH * len(fronts), max(len(members) for members in fronts.values())
    below, above = 0.12 * lines + 0.12, 0.75 if len(fronts) > 1 else 1.1
    height = 3.6 + below + above
    figure, panels = plt.subplots(1, len(fronts), figsize=(width, height), squeeze=False)
    colours = _colours(rows)
    for number, (axes, (quantity, members)) in enumerate(zip(panels[0], fronts.items(), strict=True)):
        _panel(axes, rows, quantity, colours)
        _draw_front(axes, members, quantity)
        place = (number + 0.09) / len(fronts), below / height
        figure.text(*place, _names(members, quantity), fontsize="x-small", va="top", linespacing=1.2)
    handles = _handles(rows, colours)
    columns = math.ceil(len(handles) / (2 if len(fronts) > 1 else 4))
    top = 1.0 - 0.26 / height
    figure.legend(
        handles=handles, fontsize="x-small", frameon=False, ncols=columns, loc="upper center", bbox_to_anchor=(0.5, top)
    )
    figure.suptitle(title, fontsize="medium", y=1.0 - 0.1 / height, va="top")
    figure.subplots_adjust(
        left=0.66 / width,
        right=1.0 - 0.1 / width,
        top=1.0 - above / height,
        bottom=(below + 0.5) / height,
        wspace=0.17,
    )
    try:
        with whole_file(picture) as part:
            figure.savefig(part, dpi=150, format=picture.suffix[1:])
    finally:
        plt.close(figure)


def _panel(
    axes: Axes, rows: Sequence[Record], quantity: str, colours: dict[tuple[str, int], str | tuple[float, ...]]
) -> None:
    for row in rows:
        value = getattr(row, quantity)
        if not (math.isfinite(value) and value > 0.0 and math.isfinite(row.step_us)):
            continue
        colour = colours[row.kinematics, row.frames]
        hollow = row.loads == "reference" and row.kinematics != "linear"
        axes.plot(
            row.step_us,
            100.0 * value,
            _MARKERS.get(row.basis, "D"),
            markersize=4.0 + 1.5 * math.log10(max(row.mode_count, 1)),
            markerfacecolor="none" if hollow else colour,
            markeredgecolor=colour,
            # Strong where all that the scene accepts is met.
            alpha=0.95 if row.share <= 1.0 else 0.35,
            zorder=3.0 if row.share <= 1.0 else 2.0,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("time of a step / µs", fontsize="small")
    axes.set_ylabel(f"{QUANTITIES[quantity]} / %", fontsize="small")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    values = [v for v in (getattr(row, quantity) for row in rows) if 0.0 < v < math.inf]
    # Within less than two decades the decades alone say too little.
    axes.yaxis.set_minor_formatter("{x:g}" if max(values) < _FEW * min(values) else NullFormatter())
    axes.tick_params(which="both", labelsize="x-small")
    axes.grid(alpha=0.25, which="both")


def _draw_front(axes: Axes, members: Sequence[Record], quantity: str) -> None:
    costs = [row.step_us for row in members]
    found = [100.0 * getattr(row, quantity) for row in members]
    axes.step(costs, found, where="post", color="k", linewidth=0.8, zorder=1.5)
    for number, place in enumerate(zip(costs, found, strict=True), start=1):
        text = axes.annotate(
            str(number), place, xytext=(-7, -9), textcoords="offset points", fontsize="x-small", zorder=5
        )
        text.set_path_effects([withStroke(linewidth=2.0, foreground="w")])


def _names(members: Sequence[Record], quantity: str) -> str:
    """Who is on the front, one line each."""
    return "\n".join(
        f"{n}  {row.label}: {row.step_us:.3g} µs, {100.0 * getattr(row, quantity):.2g} %"
        + ("" if row.share <= 1.0 else " (beyond tolerance)")
        for n, row in enumerate(members, start=1)
    )


def _handles(rows: Sequence[Record], colours: dict[tuple[str, int], str | tuple[float, ...]]) -> list[Line2D]:
    def dot(label: str, **style: object) -> Line2D:
        look: dict[str, Any] = {"color": "none", "marker": "o", "markersize": 5}
        look |= {"markeredgecolor": "0.3", "markerfacecolor": "0.3"} | style
        return Line2D([], [], label=label, **look)

    handles = []
    for (kinematics, frames), colour in colours.items():
        label = f"{kinematics}, frames = {frames}" if frames >= 0 else f"{kinematics}, the body's own frames"
        label = kinematics if kinematics == "linear" else label
        handles.append(dot(label, markerfacecolor=colour, markeredgecolor=colour))
    handles += [
        dot(words, marker=_MARKERS[basis]) for basis, words in _BASES.items() if any(row.basis == basis for row in rows)
    ]
    if any(row.loads == "reference" and row.kinematics != "linear" for row in rows):
        handles.append(dot("hollow: loads on the undeformed body", markerfacecolor="none"))
    if any(row.share > 1.0 for row in rows):
        handles.append(dot("pale: beyond the scene's tolerance", alpha=0.35))
    return handles
