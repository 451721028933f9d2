"""Records of the maps of stability: one CSV, one row a run, written as soon as it is known; see docs/stability.md."""

import csv
import math
import os
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any

from ..errors import FlexfmuError
from ..targets import whole_file


class StabilityError(FlexfmuError):
    """A map cannot be made or drawn."""


class Verdict(Enum):
    """What came of a run."""

    RIGHT = "right"
    """Within the tolerance, and nothing said."""
    WARNED = "warned"
    """The FMU, or the master, warned; right or wrong."""
    REFUSED = "refused"
    """The FMU, or the master, stopped."""
    SILENT = "silent"
    """Beyond the tolerance, and nothing said."""


Key = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Run:
    """One run.

    Attributes
    ----------
    digest : str
        Of the body, the scene and this program's maps.
    body : str
    map : str
    panel : str
        What the map is drawn for, one picture's part.
    x, y : str
        Place in the panel.
    verdict : str
    error : float
        Relative; not a number where the run has no result, or nothing is known to compare it with.
    measure : float
        Of evaluation: share of the motion fed or taken; of buckling: `diagnostics.stability`; of rotation: within a
        frame, rad; of coupling: κ.
    taken : int
        Steps taken before the run's fate was known.
    seconds : float
    words : str
        First words of the log.
    """

    digest: str
    body: str
    map: str
    panel: str
    x: str
    y: str
    verdict: str
    error: float = math.nan
    measure: float = math.nan
    taken: int = 0
    seconds: float = math.nan
    words: str = ""

    @property
    def key(self) -> Key:
        """What tells it from others."""
        return self.map, self.panel, self.x, self.y

    @property
    def key_and_owner(self) -> tuple[str, str, str, str, str, str]:
        """The first columns."""
        return self.digest, self.body, *self.key


def verdict(error: float, warned: bool, refused: bool, tolerance: float) -> Verdict:
    """What to call a run.

    Parameters
    ----------
    error : float
        What is no number counts as wrong.
    warned, refused : bool
    tolerance : float

    Returns
    -------
    Verdict
    """
    if refused:
        return Verdict.REFUSED
    if warned:
        return Verdict.WARNED
    return Verdict.RIGHT if error <= tolerance else Verdict.SILENT


COLUMNS = tuple(f.name for f in fields(Run))
_TYPES = {f.name: f.type for f in fields(Run)}


class Runs:
    """The file; rows are appended and brought to the disk one by one.

    Parameters
    ----------
    path : Path
        CSV; begun where it is not there.
    digest : str

    Raises
    ------
    StabilityError
        The file holds something else, or runs of another body or scene.
    """

    def __init__(self, path: Path, digest: str):
        self._path = path
        self.rows = read_runs(path) if path.exists() else []
        if {row.digest for row in self.rows} - {digest}:
            raise StabilityError(
                f"{path}: holds runs of another body or scene, or of this one before it changed; give another file, or "
                "remove it"
            )
        self._known = {row.key for row in self.rows}
        # What an interrupted run left half-written goes.
        with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *(_cells(row) for row in self.rows)])

    def __contains__(self, key: object) -> bool:
        return key in self._known

    def append(self, run: Run) -> None:
        """Add a run."""
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow(_cells(run))
            file.flush()
            os.fsync(file.fileno())
        self.rows.append(run)
        self._known.add(run.key)


def _cells(run: Run) -> list[str]:
    cells = []
    for name in COLUMNS:
        value = getattr(run, name)
        if isinstance(value, float):
            cells.append("" if math.isnan(value) else f"{value:.4g}")
        else:
            # One run, one line.
            cells.append(" ".join(str(value).split()))
    return cells


def read_runs(path: Path) -> list[Run]:
    """Read runs; a last line that is not whole is left out.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Run

    Raises
    ------
    StabilityError
        No such file, or another kind of file.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StabilityError(f"{path}: cannot be read ({error})") from error
    lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
    if not lines:
        return []
    if tuple(lines[0]) != COLUMNS:
        raise StabilityError(f"{path}: not the records of maps of stability; expected the columns {', '.join(COLUMNS)}")
    runs = []
    for number, cells in enumerate(lines[1:], start=2):
        try:
            runs.append(Run(**{n: _value(n, c) for n, c in zip(COLUMNS, cells, strict=True)}))
        except ValueError as error:
            raise StabilityError(f"{path}, line {number}: {error}; expected {len(COLUMNS)} columns") from error
    return runs


def _value(name: str, cell: str) -> Any:
    kind = _TYPES[name]
    if kind is float:
        return float(cell) if cell else math.nan
    return int(cell) if kind is int else cell
