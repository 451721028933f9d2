"""Records of a sweep: one CSV, one row a combination, written as soon as it is known; see docs/scenes.md."""

import csv
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ..targets import whole_file
from .errors import SceneError

KEY = ("basis", "modes", "frames", "kinematics", "loads", "stiffness", "mass")


@dataclass(frozen=True, slots=True)
class Record:
    """One combination: what was asked for, how far it is off, what it costs.

    Attributes
    ----------
    scene : str
        Digest of the scene.
    body : str
    basis, modes, frames, kinematics, loads, stiffness, mass
        The combination.
    mode_count, frame_count : int
        What came of it.
    status : str
        "ok", or "no answer".
    note : str
        Why there is no answer.
    static_displacement … limited_by
        As of `measure.Errors`.
    step : float
        Communication step of the timing, s.
    step_us, step_us_median : float
        The bare model's step, µs: fastest and median of blocks.
    iterations : float
        Rounds a step.
    busy : float
        How busy the machine was with other things meanwhile: 1 when calm, 2 when all took twice as long.
    fmu_us, empty_us, fmu_ratio : float
        Step of the FMU and of an empty one, µs, and their ratio; not a number where not asked for.
    modal_bytes : int
        Size of the modal file.
    build_s : float
        Time of the reduction, s, which serves all formulations of the same basis, modes and frames.
    build_reused : str
        "yes" where parts of it came from an earlier build.
    """

    scene: str
    body: str
    basis: str
    modes: int
    frames: int
    kinematics: str
    loads: str
    stiffness: str
    mass: str
    mode_count: int = 0
    frame_count: int = 0
    status: str = "ok"
    note: str = ""
    static_displacement: float = math.nan
    static_rotation: float = math.nan
    static_rotation_rad: float = math.nan
    static_at: str = ""
    transient_displacement: float = math.nan
    transient_rotation: float = math.nan
    transient_rotation_rad: float = math.nan
    transient_at: str = ""
    share: float = math.inf
    limited_by: str = ""
    step: float = math.nan
    step_us: float = math.nan
    step_us_median: float = math.nan
    iterations: float = math.nan
    busy: float = math.nan
    fmu_us: float = math.nan
    empty_us: float = math.nan
    fmu_ratio: float = math.nan
    modal_bytes: int = 0
    build_s: float = math.nan
    build_reused: str = "no"
    key: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Remember what tells it from others."""
        object.__setattr__(self, "key", tuple(str(getattr(self, name)) for name in KEY))

    @property
    def label(self) -> str:
        """A few words for a chart."""
        basis = {"normal": "normal", "residual": "normal + residual", "craig_bampton": "Craig-Bampton"}
        modes = f"{basis.get(self.basis, self.basis)} {self.modes}"
        words = [self.kinematics]
        if self.kinematics != "linear":
            own = f"own {self.frame_count}" if self.frames < 0 else str(self.frames)
            words = [f"{own} × {self.kinematics}", self.loads.replace("_", " ")]
        if self.stiffness != "constant":
            words.append(self.stiffness.replace("_", " "))
        if self.mass != "constant":
            words.append(f"mass {self.mass}")
        return f"{', '.join(words)}; {modes}"


COLUMNS = tuple(f.name for f in fields(Record) if f.init)
_TYPES = {f.name: f.type for f in fields(Record)}


class Records:
    """The file; rows are appended and brought to the disk one by one.

    Parameters
    ----------
    path : Path
        CSV; begun where it is not there.
    scene : str
        Digest of the scene.

    Raises
    ------
    SceneError
        The file holds something else, or records of another scene.
    """

    def __init__(self, path: Path, scene: str):
        self._path = path
        self.rows = read_records(path) if path.exists() else []
        other = {row.scene for row in self.rows} - {scene}
        if other:
            raise SceneError(
                f"{path}: holds records of another scene, or of this one before its body, cases or tolerances changed; "
                "give another file, or remove it"
            )
        if not path.parent.is_dir():
            raise SceneError(f"{path}: the folder {path.parent} does not exist; make it first")
        # What an interrupted run left half-written goes.
        with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
            _write(file, [list(COLUMNS), *(_cells(row) for row in self.rows)])

    def find(self, key: Sequence[str]) -> Record | None:
        """Return the record of a combination."""
        return next((row for row in self.rows if row.key == tuple(key)), None)

    def append(self, record: Record) -> None:
        """Add a record."""
        with self._path.open("a", newline="", encoding="utf-8") as file:
            _write(file, [_cells(record)])
            file.flush()
            os.fsync(file.fileno())
        self.rows.append(record)


def _write(file: Any, rows: Iterable[list[str]]) -> None:
    csv.writer(file, lineterminator="\n").writerows(rows)


def _cells(record: Record) -> list[str]:
    cells = []
    for name in COLUMNS:
        value = getattr(record, name)
        if isinstance(value, float):
            cells.append("" if math.isnan(value) else f"{value:.6g}")
        else:
            # One record, one line.
            cells.append(" ".join(str(value).split()))
    return cells


def read_records(path: Path) -> list[Record]:
    """Read the records of a sweep; a last line that is not whole is left out.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Record

    Raises
    ------
    SceneError
        No such file, or another kind of file.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read ({error})") from error
    # A line counts when it was ended.
    whole = text[: text.rfind("\n") + 1]
    lines = list(csv.reader(whole.splitlines()))
    if not lines:
        return []
    if tuple(lines[0]) != COLUMNS:
        raise SceneError(
            f"{path}: not the records of a sweep of this version; expected the columns {', '.join(COLUMNS)}"
        )
    records = []
    for number, cells in enumerate(lines[1:], start=2):
        if len(cells) != len(COLUMNS):
            raise SceneError(f"{path}, line {number}: {len(cells)} columns, expected {len(COLUMNS)}")
        try:
            records.append(Record(**{n: _value(n, c) for n, c in zip(COLUMNS, cells, strict=True)}))
        except ValueError as error:
            raise SceneError(f"{path}, line {number}: {error}") from error
    return records


def _value(name: str, cell: str) -> Any:
    kind = _TYPES[name]
    if kind is float:
        return float(cell) if cell else math.nan
    return int(cell) if kind is int else cell


def pareto_front(costs: Sequence[float], errors: Sequence[float], margin: float = 0.0) -> list[int]:
    """Members that no other beats in cost and error at once, cheapest first.

    Parameters
    ----------
    costs, errors : sequence of float
        What is not finite never belongs to the front.
    margin : float
        Relative gain in error that makes a costlier member worth naming.

    Returns
    -------
    list of int
    """
    order = sorted(
        (k for k in range(len(costs)) if math.isfinite(costs[k]) and math.isfinite(errors[k])),
        key=lambda k: (costs[k], errors[k]),
    )
    front: list[int] = []
    for k in order:
        if not front or errors[k] < (1.0 - margin) * errors[front[-1]]:
            front.append(k)
    return front
