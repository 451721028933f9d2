"""Pictures of the maps, from records alone: a panel a grid of runs, shaded by error, with a sign for each verdict."""

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.legend_handler import HandlerPatch
from matplotlib.patches import Patch, Polygon, Rectangle

from ...files.figures import ORANGE, VERMILION, save
from ...files.targets import PICTURE_SUFFIXES, check_target
from ..scenes.map_config import Map
from .records import LAYOUT, Run, StabilityError, Verdict

# Errors are shades, which grey and colour-blind eyes keep apart; verdicts are signs.
_SHADES = LinearSegmentedColormap.from_list("errors", ["#f1f6fb", "#c6dcef", "#5b9bcb", "#0b4c8c"])
_LEAST, _MOST = 1e-3, 1.0
# From here on a shade is so dark that its number is white.
_DARK = 0.6
_REFUSED = "#b0b0b0"
_WORDS = {
    Verdict.RIGHT: "within the tolerance, no warning",
    Verdict.WARNED: "warned",
    Verdict.REFUSED: "refused",
    Verdict.SILENT: "wrong in silence",
}
_AXES = {
    Map.BUCKLING: ("load / critical load", "frames × method"),
    Map.ROTATION: ("rotation in linear theory / °", "frames × method"),
    Map.COUPLING: ("spring / interface stiffness", "steps a period"),
}
_COLUMNS = {Map.BUCKLING: 1, Map.ROTATION: 1, Map.COUPLING: 4}
_CELL, _ROW = 0.42, 0.3
# Part of a cell that its sign takes.
_SIGN = 0.3


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
    runs = LAYOUT.read(records)
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
    width = columns * (_CELL * wide + 0.6) + (2.6 if named else 1.1)
    height = lines * (_ROW * high + 0.8) + 0.75
    figure, grid = plt.subplots(lines, columns, figsize=(width, height), squeeze=False, layout="constrained")
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _panel(axes, [run for run in rows if run.panel == panel], named)
        axes.set_xlabel(_AXES[kind][0], fontsize="small")
        axes.set_ylabel(_AXES[kind][1], fontsize="small")
        if len(panels) > 1:
            axes.set_title(panel, fontsize="small")
    scale = ScalarMappable(LogNorm(_LEAST, _MOST), _SHADES)
    bar = figure.colorbar(scale, ax=grid, pad=0.02, fraction=0.03, aspect=30, extend="both")
    bar.set_ticks([0.001, 0.01, 0.1, 1.0], labels=["0.1 %", "1 %", "10 %", "100 %"], fontsize="x-small")
    bar.set_label("error", fontsize="small")
    found = {run.verdict for run in rows}
    handles = [_Sign(verdict) for verdict in Verdict if verdict.value in found]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=len(handles), fontsize="small", frameon=False,
        handler_map={_Sign: _SignInLegend()},
    )  # fmt: skip
    unknown = "; –: no equilibrium to compare with" if any(_is_unknown(run) for run in rows) else ""
    figure.suptitle(f"{rows[0].body}: {kind.value}; numbers are errors in %{unknown}", fontsize="medium")
    save(figure, target)


def _panel(axes: Axes, rows: Sequence[Run], named: bool) -> None:
    across = sorted({run.x for run in rows}, key=float)
    up = list(dict.fromkeys(run.y for run in rows)) if named else sorted({run.y for run in rows}, key=float)
    if named:
        up = up[::-1]
    for run in rows:
        x, y = across.index(run.x), up.index(run.y)
        verdict = Verdict(run.verdict)
        shade = _shade(run.error)
        face = _REFUSED if verdict is Verdict.REFUSED else "white" if math.isnan(run.error) else _SHADES(shade)
        axes.add_patch(Rectangle((x, y), 1, 1, facecolor=face, edgecolor="white", linewidth=0.8))
        for patch in _sign(verdict, x, y, 1.0, 1.0):
            axes.add_patch(patch)
        words = "–" if _is_unknown(run) else _words(run.error)
        if words:
            dark = verdict is not Verdict.REFUSED and shade > _DARK
            box = {"facecolor": _REFUSED, "edgecolor": "none", "pad": 0.6} if verdict is Verdict.REFUSED else None
            colour = "white" if dark else "black"
            axes.text(x + 0.5, y + 0.5, words, ha="center", va="center", fontsize=6, color=colour, bbox=box)
    axes.set_xlim(0, len(across))
    axes.set_ylim(0, len(up))
    axes.set_xticks(np.arange(len(across)) + 0.5, [f"{float(x):g}" for x in across], fontsize="x-small")
    axes.set_yticks(np.arange(len(up)) + 0.5, up, fontsize="x-small")
    axes.tick_params(length=0)


def _is_unknown(run: Run) -> bool:
    """Whether a run that went on has nothing to be compared with."""
    return math.isnan(run.error) and run.verdict != Verdict.REFUSED.value


def _shade(error: float) -> float:
    """Place of an error between white and dark; no number where it is none."""
    return float(np.clip(np.log(max(error, 1e-12) / _LEAST) / np.log(_MOST / _LEAST), 0.0, 1.0))


def _sign(verdict: Verdict, x: float, y: float, wide: float, high: float) -> list[Patch]:
    """What a verdict puts on a cell."""
    if verdict is Verdict.WARNED:
        corner = [(x, y + high), (x + _SIGN * wide, y + high), (x, y + (1.0 - 1.5 * _SIGN) * high)]
        return [Polygon(corner, facecolor=ORANGE, edgecolor="white", linewidth=0.4)]
    if verdict is Verdict.REFUSED:
        return [Rectangle((x, y), wide, high, fill=False, hatch="////", edgecolor="white", linewidth=0.8)]
    if verdict is Verdict.SILENT:
        return [Rectangle((x, y), wide, high, fill=False, hatch="xx", edgecolor=VERMILION, linewidth=2.0)]
    return []


class _Sign(Patch):
    """A verdict in the legend."""

    def __init__(self, verdict: Verdict):
        super().__init__(label=_WORDS[verdict])
        self.verdict = verdict


class _SignInLegend(HandlerPatch):
    """Draws a verdict as it is drawn on a cell."""

    def create_artists(self, legend, orig_handle, xdescent, ydescent, width, height, fontsize, trans):  # type: ignore[no-untyped-def]  # noqa: ARG002
        face = _REFUSED if orig_handle.verdict is Verdict.REFUSED else "#e3eef8"
        cell = Rectangle((-xdescent, -ydescent), width, height, facecolor=face, edgecolor="0.4", linewidth=0.5)
        found = [cell, *_sign(orig_handle.verdict, -xdescent, -ydescent, width, height)]
        for one in found:
            one.set_transform(trans)
        return found


def _words(error: float) -> str:
    """Error in %, as short as can be."""
    if math.isnan(error):
        return ""
    percent = 100.0 * error
    if not percent < 1000.0:
        return ">999"
    return f"{percent:.0f}" if percent >= 9.5 else f"{percent:.1g}" if percent >= 0.001 else "0"
