"""Charts of records: a picture, and a page to look into, one HTML file with its data, drawing and script inside."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...files.outputs import PICTURE_SUFFIXES, check_target, page_text, picture_html, records_frame, whole_file
from ...model.methods import Method
from ..candidates import REDUCED
from ..front import QUANTITIES, Axis, bodies, cost_axis, finding, front, recommended, tolerance
from ..records import RECORDS, Record
from ..scene.config import SceneError

# Its import takes half a second, and records alone are no picture.
if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FILTERS = ("body", "solver", "method", "frames", "basis", "modes", "mass", "internal_step", "status")
_COSTS = {
    "fmu_ratio": "time of a step over that of an empty FMU",
    "fmu_ms_per_s": "ms per simulated second, through the FMU",
    "bare_ms_per_s": "ms per simulated second, from Python",
    "step_us": "time of a step from Python / µs",
    "equilibrium_ms": "one equilibrium from rest, from Python / ms",
    "memory_bytes": "memory of the running model / bytes",
    "modal_bytes": "modal file / bytes",
    "mode_count": "modes",
    "build_s": "time to build / s",
}
_ERRORS = {
    "static_displacement": "static displacement error",
    "static_rotation": "static rotation error",
    "static_estimate": "static displacement error by their own estimate",
    "transient_displacement": "displacement error over time, rms",
    "transient_rotation": "rotation error over time, rms",
    "share": "error over the scene's tolerance",
}
# What the data says of all rows alike.
_LEFT_OUT = ("scene",)
# Colours, markers and words of pictures.py that the page has, too.
_LOOK = "colours other beaten beaten_words taken taken_words estimated_words whole markers basis_words stars solvers"


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a chart shows.

    Attributes
    ----------
    named : list of Record
        Members of the fronts, those of the first panel first, and what to take.
    axis : Axis
        What cost is.
    finding : str
        What to take, in a line.
    records : list of Record
        All models with an answer.
    plot : callable
        Draws it anew, a matplotlib figure.
    """

    named: list[Record]
    axis: Axis
    finding: str
    records: list[Record]
    plot: Callable[[], "Figure"]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of the records, one row a model."""
        return records_frame(self.records)

    def _repr_html_(self) -> str:
        return picture_html(self.plot())


def chart(
    records: Path | Sequence[Path], picture: Path | None = None, html: Path | None = None, extent: str = ""
) -> Drawn:
    """Draw the records of sweeps as a picture, as a page to look into, or as both.

    Parameters
    ----------
    records : Path or sequence of Path
        As `sweep` writes them; those of several bodies are drawn together.
    picture : Path, optional
        PNG, PDF or SVG.
    html : Path, optional
        One file, which needs no network.
    extent : str
        How much of a sweep is drawn, in words; default: the number of models.

    Returns
    -------
    Drawn

    Raises
    ------
    SceneError
        No records with an answer.
    OutputError
        A file cannot be written.
    """
    paths = [records] if isinstance(records, Path) else list(records)
    check_targets(paths, picture, html)
    every = [row for path in paths for row in RECORDS.read(path) if row.status == "ok"]
    rows = [row for row in every if row.solver == REDUCED]
    # Of descriptions of the same body one will do.
    whole = list({(row.solver, row.case): row for row in reversed(every) if row.solver != REDUCED}.values())[::-1]
    if not rows:
        raise SceneError(f"{', '.join(map(str, paths))}: no record with an answer, nothing to draw")
    axis = cost_axis(rows)
    found = finding(rows, axis)
    title = f"{', '.join(bodies(rows))}, {extent or f'{len(rows)} models'}: {found}"
    if html is not None:
        with whole_file(html) as part:
            part.write_text(_page(every, title), encoding="utf-8")
    fronts = {q: front(rows, q, axis) for q in QUANTITIES if any(getattr(row, q) > 0.0 for row in rows)}

    def figure() -> "Figure":
        from .. import pictures

        return pictures.Picture(rows, whole, axis).figure(fronts, title)

    if picture is not None:
        from ...files.figures import save

        save(figure(), picture)
    taken = recommended(rows, axis)
    named = [row for members in fronts.values() for row in members] + ([] if taken is None else [taken])
    return Drawn(list(dict.fromkeys(named)), axis, found, rows, figure)


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


def _page(rows: Sequence[Record], title: str) -> str:
    """Text of the page: reduced models, and the finite element model where it was timed."""
    from .. import pictures

    names = [field.name for field in fields(Record) if field.name not in _LEFT_OUT]
    data = [{name: getattr(row, name) for name in (*names, "label", "short_label", "plainness")} for row in rows]
    reduced = [row for row in rows if row.solver == REDUCED]
    content: dict[str, object] = {"rows": data, "columns": names, "filters": _FILTERS, "reduced": REDUCED}
    for kind, axes in (("costs", _COSTS), ("errors", _ERRORS)):
        content[kind] = {n: words for n, words in axes.items() if any(0 < getattr(r, n) < math.inf for r in reduced)}
    content["tolerances"] = {"share": 1.0, **{quantity: tolerance(reduced, quantity) for quantity in QUANTITIES}}
    content["look"] = {name: getattr(pictures, name.upper()) for name in _LOOK.split()}
    content["methods"] = {method.value: method.label for method in Method}
    return page_text(__package__, title, content)
