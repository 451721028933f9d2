"""Records of sweeps and of stability maps: a CSV, one row each, on the disk as soon as it is known.

Behind the fields of a record stand the code that made it, which alone continues the file, and a checksum of its row,
which is verified when it is read. Columns: docs/scenes.md.
"""

import csv
import hashlib
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from ..files.basics import plural
from ..files.outputs import whole_file
from ..files.store import code_digest
from ..model.methods import Method, has_frames
from .candidates import REDUCED, modes_words
from .scene.config import SceneError

_ADDED = ("code", "check")
_CHECK_DIGITS = 8
# Significant digits of a float.
_DIGITS = 6


class Keyed(Protocol):
    """A record: a dataclass of texts, whole numbers and floats."""

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others of the same owner."""


R = TypeVar("R", bound=Keyed)


@dataclass(frozen=True, slots=True)
class Layout(Generic[R]):
    """What the records of a kind look like in a file.

    Attributes
    ----------
    kind : type
        Dataclass of texts, whole numbers and floats; its first field tells what a record is of.
    """

    kind: type[R]

    @property
    def columns(self) -> tuple[str, ...]:
        """Header of the file."""
        return (*(field.name for field in fields(self.kind)), *_ADDED)  # type: ignore[arg-type]

    def cells(self, record: R, code: str) -> list[str]:
        """Row of a record made by a code."""
        cells = [*(self._cell(getattr(record, name)) for name in self.columns[: -len(_ADDED)]), code]
        return [*cells, row_check(cells)]

    def _cell(self, value: object) -> str:
        if isinstance(value, float):
            return "" if math.isnan(value) else f"{value:.{_DIGITS}g}"
        # One record, one line.
        return " ".join(str(value).split())

    def read(self, path: Path) -> list[R]:
        """Read the records of a file, whatever code made them.

        Parameters
        ----------
        path : Path

        Returns
        -------
        list
            A last line that is not whole is left out.

        Raises
        ------
        FlexfmuError
            No such file, another kind of file, or a row that was altered.
        """
        return [record for record, _ in self.read_with_code(path)]

    def read_with_code(self, path: Path) -> list[tuple[R, str]]:
        """Read records and the code that made each; see `read`."""
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{path}: cannot be read ({error})") from error
        # A line counts when it was ended.
        lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
        if text and tuple(lines[0] if lines else ()) != self.columns:
            columns = ", ".join(self.columns)
            raise SceneError(f"{path}: not records of this version; name another file, or give the columns {columns}")
        return [self._parsed(cells, f"{path}, line {number}") for number, cells in enumerate(lines[1:], start=2)]

    def _parsed(self, cells: Sequence[str], where: str) -> tuple[R, str]:
        if len(cells) != len(self.columns):
            raise SceneError(f"{where}: {len(cells)} columns, expected {len(self.columns)}")
        *values, code, check = cells
        if row_check([*values, code]) != check:
            fault = "it was altered, or two runs wrote at once; remove the line to have it made anew"
            raise SceneError(f"{where}: the row does not match its checksum: {fault}")
        try:
            known = zip(fields(self.kind), values, strict=True)  # type: ignore[arg-type]
            return self.kind(**{field.name: _value(field, cell) for field, cell in known}), code
        except ValueError as error:
            raise SceneError(f"{where}: {error}") from error


class RecordFile(Generic[R]):
    """The records of one owner, made by one code; those that are there already are not made again.

    Parameters
    ----------
    layout : Layout
    path : Path
        CSV; begun where it is not there.
    owner : str

    Raises
    ------
    FlexfmuError
        The file holds something else, or records of another owner or of other code.
    """

    def __init__(self, layout: Layout[R], path: Path, owner: str):
        self._layout, self._path, self._code = layout, path, code_digest()
        kept = layout.read_with_code(path) if path.exists() else []
        self.rows = [record for record, _ in kept]
        self._known = {record.key for record in self.rows}
        if {getattr(record, layout.columns[0]) for record in self.rows} - {owner}:
            other = "of another scene, or of this one before its body, cases or tolerances changed"
            raise SceneError(f"{path}: holds records {other}; give another file, or remove it")
        if found := {code for _, code in kept} - {self._code}:
            raise SceneError(
                f"{path}: holds records made by other code of flexfmu or of its libraries "
                f"({', '.join(code or 'unknown' for code in sorted(found))}, now {self._code}): results of both do not "
                "belong together; give another file, or remove it"
            )
        if not path.parent.is_dir():
            raise SceneError(f"{path}: the folder {path.parent} does not exist; make it first")
        # What an interrupted run left half-written goes.
        self._rewrite()

    def _rewrite(self) -> None:
        layout = self._layout
        with whole_file(self._path) as part, part.open("w", newline="", encoding="utf-8") as file:
            _write(file, [layout.columns, *(layout.cells(record, self._code) for record in self.rows)])

    def append(self, record: R) -> None:
        """Add a record."""
        with self._path.open("a", newline="", encoding="utf-8") as file:
            _write(file, [self._layout.cells(record, self._code)])
            file.flush()
            os.fsync(file.fileno())
        self.rows.append(record)
        self._known.add(record.key)

    def amend(self, records: Iterable[R]) -> None:
        """Put records in the place of those with their keys."""
        newer = {record.key: record for record in records}
        self.rows = [newer.get(row.key, row) for row in self.rows]
        self._rewrite()

    def __contains__(self, key: object) -> bool:
        return key in self._known


def row_check(cells: Iterable[str]) -> str:
    """Checksum of the cells before it."""
    return hashlib.sha256("\x1f".join(cells).encode()).hexdigest()[:_CHECK_DIGITS]


def _write(file: Any, rows: Iterable[Sequence[str]]) -> None:
    csv.writer(file, lineterminator="\n").writerows(rows)


def _value(field: Field[Any], cell: str) -> Any:
    if field.type is float:
        return float(cell) if cell else math.nan
    return int(cell) if field.type is int else cell


KEY = ("solver", "case", "basis", "modes", "frames", "method", "mass", "internal_step")
"""Columns that tell records of a sweep apart."""
# Internal steps that need no word: without error, the FMU's own tolerance, and none at all.
_USUAL_STEPS = ("exact", "0.0001", "")


@dataclass(frozen=True, slots=True)
class Record:
    """One row of a chart's records: a reduced model on the whole scene, or a finite element model in one case.

    Attributes
    ----------
    scene, body : str
        Digest of the scene; name of the body.
    solver, case : str
        "reduced"; for finite elements "flexfmu" or "results" (the user's own), and the case.
    basis, modes, frames, method, mass, internal_step
        The combination; empty for finite elements. `frames` is -1 where the body file gives them by hand;
        `internal_step` is "single", "exact" or the tolerance.
    mode_count, frame_count : int
        Result, interface modes included; for finite elements the degrees of freedom, and none.
    status, note : str
        "ok", or "no answer" and why; for finite elements the increments and iterations.
    static_displacement, static_rotation, static_rotation_rad, static_at, transient_displacement, transient_rotation, \
transient_rotation_rad, transient_at, share, limited_by
        As of `SceneErrors`.
    static_estimate : float
        Error of static displacements that a model on the front tells of itself; not a number for others.
    step : float
        Communication step of the timing, s.
    step_us, step_us_median : float
        Step of the model without FMI, µs: fastest and median block; for finite elements one equilibrium, from the
        previous one.
    iterations, busy : float
        Rounds a step; time that passed while timing over that of the steps themselves (1: nobody else was at work).
    bare_ms_per_s, fmu_ms_per_s : float
        ms per simulated second, without FMI and through the FMU.
    fmu_us, empty_us, fmu_ratio, fmu_busy : float
        Step of the FMU and of an empty one, µs, their ratio, and the same of it; not a number without FMUs.
    equilibrium_ms : float
        Equilibrium without FMI under the first static case, from rest.
    memory_bytes, modal_bytes : int
        Program and work space while running; modal file with the data of this method.
    build_s : float
        Time of the reduction, s, common to all methods of the same basis, modes and frames.
    build_reused : str
        "yes" where parts of it came from an earlier build.
    """

    scene: str
    body: str
    solver: str = REDUCED
    case: str = ""
    basis: str = ""
    modes: int = 0
    frames: int = 0
    method: str = ""
    mass: str = ""
    internal_step: str = ""
    mode_count: int = 0
    frame_count: int = 0
    status: str = "ok"
    note: str = ""
    static_displacement: float = math.nan
    static_rotation: float = math.nan
    static_rotation_rad: float = math.nan
    static_at: str = ""
    static_estimate: float = math.nan
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
    bare_ms_per_s: float = math.nan
    fmu_us: float = math.nan
    fmu_busy: float = math.nan
    fmu_ms_per_s: float = math.nan
    empty_us: float = math.nan
    fmu_ratio: float = math.nan
    equilibrium_ms: float = math.nan
    memory_bytes: int = 0
    modal_bytes: int = 0
    build_s: float = math.nan
    build_reused: str = "no"

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others of the same scene."""
        return tuple(str(getattr(self, name)) for name in KEY)

    @property
    def label(self) -> str:
        """A few words for a chart."""
        if self.solver != REDUCED:
            who = "your results" if self.solver == "results" else self.solver
            return f"finite elements ({who}), {self.case}"
        words = [self.short_label]
        if self.mass != "constant":
            words.append(f"mass {self.mass}")
        if self.internal_step == "single":
            words.append("one internal step")
        elif self.internal_step not in _USUAL_STEPS:
            words.append(f"step error {self.internal_step}")
        return f"{', '.join(words)}; {modes_words(self.basis, self.modes)}"

    @property
    def short_label(self) -> str:
        """Method and frames, for a point of a chart."""
        if self.solver != REDUCED:
            return self.label
        if not has_frames(Method(self.method)):
            return Method(self.method).label
        count = f"its own {plural(self.frame_count, 'frame')}" if self.frames < 0 else plural(self.frames, "frame")
        return f"{Method(self.method).label}, {count}"

    @property
    def plainness(self) -> float:
        """How much there is to it beyond the plainest model: of models that are as good, the lowest is named."""
        plain = [self.method in (Method.LINEAR.value, Method.FRAMES.value), self.mass == "constant"]
        plain += [self.internal_step in _USUAL_STEPS, self.basis == "normal"]
        return plain.count(False) + 0.01 * self.mode_count


RECORDS = Layout(Record)


VERDICTS = {
    "right": "within the tolerance, no warning",
    "warned": "warned",
    "refused": "refused",
    "silent": "wrong in silence",
}
"""What came of a run, in words: a run that is warned of may be right or wrong; one that is refused, the FMU stopped."""


@dataclass(frozen=True, slots=True)
class Run:
    """One row of the records of a map of stability.

    Attributes
    ----------
    scene, body : str
        Digest of the scene, with the map's tolerance; name of the body.
    case, factor, model : str
        Static case of the scene, factor of its loads, frames and method.
    verdict : str
        One of `VERDICTS`.
    error : float
        Relative displacement of the interfaces; not a number where nothing is known to compare with.
    seconds : float
        s.
    words : str
        First message.
    """

    scene: str
    body: str
    case: str
    factor: str
    model: str
    verdict: str
    error: float = math.nan
    seconds: float = math.nan
    words: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others."""
        return self.case, self.factor, self.model


def verdict(error: float, warned: bool, refused: bool, tolerance: float) -> str:
    """What to call a run.

    Parameters
    ----------
    error : float
        What is no number counts as wrong.
    warned, refused : bool
    tolerance : float

    Returns
    -------
    str
        One of `VERDICTS`.
    """
    if refused:
        return "refused"
    if warned:
        return "warned"
    return "right" if error <= tolerance else "silent"


RUNS = Layout(Run)
