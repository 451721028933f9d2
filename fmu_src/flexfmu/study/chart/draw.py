"""Charts of records: a picture, and a page to look into."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...files.targets import PICTURE_SUFFIXES, check_target, whole_file
from ..scenes.candidates import REDUCED
from ..scenes.errors import SceneError
from .front import QUANTITIES, Axis, bodies, cost_axis, finding, front, recommended
from .page import page
from .picture import Picture
from .records import LAYOUT, Record


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
    """

    named: list[Record]
    axis: Axis
    finding: str


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
    every = [row for path in paths for row in LAYOUT.read(path) if row.status == "ok"]
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
            part.write_text(page(every, title), encoding="utf-8")
    quantities = [q for q in QUANTITIES if any(getattr(row, q) > 0.0 for row in rows)]
    fronts = {q: front(rows, q, axis) for q in quantities}
    if picture is not None:
        Picture(rows, whole, axis).draw(fronts, picture, title)
    taken = recommended(rows, axis)
    named = [row for members in fronts.values() for row in members]
    return Drawn(list(dict.fromkeys([*named, *([] if taken is None else [taken])])), axis, found)


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
