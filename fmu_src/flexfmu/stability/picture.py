"""Pictures of the maps, from records alone: a panel a grid of runs, each told by colour, sign and error."""

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle

from ..targets import PICTURE_SUFFIXES, check_target, whole_file
from .config import Map
from .records import Run, StabilityError, Verdict, read_runs

# Told apart in grey and by colour-blind eyes (Okabe and Ito); signs tell where colours fail.
_LOOK = {
    Verdict.RIGHT: ("#cfe8f7", "", "right"),
    Verdict.WARNED: ("#f0d64a", "", "warned"),
    Verdict.REFUSED: ("#8c8c8c", "////", "refused"),
    Verdict.SILENT: ("#d55e00", "xxxx", "wrong in silence"),
}
_AXES = {
    Map.BUCKLING: ("load / critical load", ""),
    Map.ROTATION: ("rotation in linear theory / °", ""),
    Map.COUPLING: ("stiffness of the spring / the interface's", "steps a period of the lowest mode"),
}
_COLUMNS = {Map.BUCKLING: 1, Map.ROTATION: 1, Map.COUPLING: 4}
_CELL, _ROW = 0.42, 0.3


def pictures(records: Path, picture: Path) -> list[Path]:
    """Draw each map of some records, as NAME-MAP beside the picture's name.

    Parameters
    ----------
    records, picture : Path

    Returns
    -------
    list of Path

    Raises
    ------
    StabilityError
        No runs.
    OutputError
        A picture cannot be written.
    """
    check_target(picture, PICTURE_SUFFIXES, inputs=(records,))
    runs = read_runs(records)
    if not runs:
        raise StabilityError(f"{records}: no runs, nothing to draw")
    drawn = []
    for kind in Map:
        rows = [run for run in runs if run.map == kind.value]
        if rows:
            target = picture.with_name(f"{picture.stem}_{kind.value}{picture.suffix}")
            _draw(kind, rows, target)
            drawn.append(target)
    return drawn


def _draw(kind: Map, rows: Sequence[Run], target: Path) -> None:
    panels = list(dict.fromkeys(run.panel for run in rows))
    columns = min(_COLUMNS[kind], len(panels))
    lines = math.ceil(len(panels) / columns)
    first = [run for run in rows if run.panel == panels[0]]
    wide, high = len({run.x for run in first}), len({run.y for run in first})
    named = kind in (Map.BUCKLING, Map.ROTATION)
    width = columns * (_CELL * wide + 0.35) + (1.9 if named else 0.75)
    height = lines * (_ROW * high + 0.62) + 0.75
    figure, grid = plt.subplots(lines, columns, figsize=(width, height), squeeze=False, layout="constrained")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _panel(axes, [run for run in rows if run.panel == panel], named)
        if len(panels) > 1:
            axes.set_title(panel, fontsize="small")
    # One label for all panels: longer than a panel is high, they would run into each other.
    grid[-1, columns // 2 if len(panels) == lines * columns else 0].set_xlabel(_AXES[kind][0], fontsize="small")
    grid[lines // 2, 0].set_ylabel(_AXES[kind][1], fontsize="small")
    found = {run.verdict for run in rows}
    handles = [
        Patch(facecolor=colour, hatch=hatch, edgecolor="0.3", linewidth=0.5, label=words)
        for verdict, (colour, hatch, words) in _LOOK.items()
        if verdict.value in found
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize="small", frameon=False)
    figure.suptitle(f"{rows[0].body}: {kind.value}; numbers are errors in %", fontsize="medium")
    try:
        with whole_file(target) as part:
            figure.savefig(part, dpi=150, format=target.suffix[1:])
    finally:
        plt.close(figure)


def _panel(axes: Axes, rows: Sequence[Run], named: bool) -> None:
    across = sorted({run.x for run in rows}, key=float)
    up = list(dict.fromkeys(run.y for run in rows)) if named else sorted({run.y for run in rows}, key=float)
    if named:
        up = up[::-1]
    for run in rows:
        place = across.index(run.x), up.index(run.y)
        colour, hatch, _ = _LOOK[Verdict(run.verdict)]
        axes.add_patch(Rectangle(place, 1, 1, facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.8))
        words = _words(run.error)
        if words:
            box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.75} if hatch else None
            axes.text(place[0] + 0.5, place[1] + 0.5, words, ha="center", va="center", fontsize=6, bbox=box)
    axes.set_xlim(0, len(across))
    axes.set_ylim(0, len(up))
    axes.set_xticks(np.arange(len(across)) + 0.5, [f"{float(x):g}" for x in across], fontsize="x-small")
    axes.set_yticks(np.arange(len(up)) + 0.5, up, fontsize="x-small")
    axes.tick_params(length=0)


def _words(error: float) -> str:
    """Error in %, as short as can be."""
    if math.isnan(error):
        return ""
    percent = 100.0 * error
    if not percent < 1000.0:
        return ">999"
    return f"{percent:.0f}" if percent >= 9.5 else f"{percent:.1g}" if percent >= 0.001 else "0"
