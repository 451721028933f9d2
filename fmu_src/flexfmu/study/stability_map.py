"""The picture of a map of stability: a panel a case, a row a model, a column a load."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..files.figures import ORANGE, VERMILION, Drawing, save
from ..files.targets import PICTURE_SUFFIXES, check_target
from .records import RUNS, VERDICTS, Run, Verdict
from .scene.config import SceneError

# Errors are shades, which grey and colour-blind eyes keep apart; verdicts are frames and hatches.
_SHADES = LinearSegmentedColormap.from_list("errors", ["#f1f6fb", "#c6dcef", "#5b9bcb", "#0b4c8c"])
_SCALE = LogNorm(1e-3, 1.0, clip=True)
_LOOKS: dict[Verdict, dict[str, object]] = {
    Verdict.RIGHT: {"edgecolor": "white", "linewidth": 0.8},
    Verdict.WARNED: {"edgecolor": ORANGE, "linewidth": 1.8},
    Verdict.REFUSED: {"edgecolor": "white", "facecolor": "#b0b0b0", "hatch": "////", "linewidth": 0.8},
    Verdict.SILENT: {"edgecolor": VERMILION, "hatch": "xx", "linewidth": 1.8},
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
    check_target(picture, PICTURE_SUFFIXES, inputs=(records,))
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
    size = across * panel_width + _LABELS, down * (_ROW * high + 0.7) + 0.9
    figure = Drawing(figsize=size, layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharey=True)
    for panel in grid.flat[len(cases) :]:
        panel.set_visible(False)
    for panel, case in zip(grid.flat, cases, strict=False):
        _draw_case(panel, [run for run in rows if run.case == case])
        panel.set_title(case, fontsize="small")
    bar = figure.colorbar(ScalarMappable(_SCALE, _SHADES), ax=grid, pad=0.02, fraction=0.03, aspect=30, extend="both")
    bar.set_ticks([0.001, 0.01, 0.1, 1.0], labels=["0.1 %", "1 %", "10 %", "100 %"], fontsize="x-small")
    bar.set_label("error", fontsize="small")
    handles = [Patch(**{"facecolor": "#e3eef8", **_LOOKS[one]}, label=VERDICTS[one]) for one in Verdict]  # type: ignore[arg-type]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize="small", frameon=False)
    figure.suptitle(f"{rows[0].body}; numbers are errors in %, –: no equilibrium to compare with", fontsize="medium")
    return figure


def _draw_case(panel: Axes, rows: Sequence[Run]) -> None:
    across = sorted({run.factor for run in rows}, key=float)
    up = list(dict.fromkeys(run.model for run in rows))[::-1]
    for run in rows:
        x, y, found = across.index(run.factor), up.index(run.model), Verdict(run.verdict)
        known = math.isfinite(run.error)
        look = {"facecolor": _SHADES(_SCALE(run.error)) if known else "white", **_LOOKS[found]}
        order = 2.0 if found in (Verdict.WARNED, Verdict.SILENT) else 1.0
        panel.add_patch(Rectangle((x + 0.04, y + 0.05), 0.92, 0.9, zorder=order, **look))  # type: ignore[arg-type]
        if found is not Verdict.REFUSED:
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
