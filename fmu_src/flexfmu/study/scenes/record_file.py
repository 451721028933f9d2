"""A CSV of records: one row each, on the disk as soon as it is known, continued only by the code that began it.

Behind the fields of a record stand the code that made it and a checksum of its row, which is verified when it is read.
"""

import csv
import hashlib
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from ...files.code_digest import code_digest
from ...files.errors import FlexfmuError
from ...files.targets import whole_file

_ADDED = ("code", "check")
_CHECK_DIGITS = 8


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
        Dataclass of texts, whole numbers and floats.
    owner : str
        Field that tells what a record is of.
    digits : int
        Significant ones of a float.
    made_by : str
        Module that makes the records.
    called : str
        The records, in words.
    others : str
        Records of another owner, in words.
    error : type
        What is raised.
    """

    kind: type[R]
    owner: str
    digits: int
    made_by: str
    called: str
    others: str
    error: type[FlexfmuError]

    @property
    def columns(self) -> tuple[str, ...]:
        """Header of the file."""
        return (*(field.name for field in self._fields), *_ADDED)

    @property
    def _fields(self) -> tuple[Field[Any], ...]:
        return tuple(field for field in fields(self.kind) if field.init)  # type: ignore[arg-type]

    def cells(self, record: R, code: str) -> list[str]:
        """Row of a record made by a code."""
        cells = [self._cell(getattr(record, field.name)) for field in self._fields]
        return [*cells, code, row_check([*cells, code])]

    def _cell(self, value: object) -> str:
        if isinstance(value, float):
            return "" if math.isnan(value) else f"{value:.{self.digits}g}"
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
            raise self.error(f"{path}: cannot be read ({error})") from error
        # A line counts when it was ended.
        lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
        if text and tuple(lines[0] if lines else ()) != self.columns:
            raise self.error(f"{path}: not {self.called}; expected the columns {', '.join(self.columns)}")
        return [self._parsed(cells, f"{path}, line {number}") for number, cells in enumerate(lines[1:], start=2)]

    def _parsed(self, cells: Sequence[str], where: str) -> tuple[R, str]:
        if len(cells) != len(self.columns):
            raise self.error(f"{where}: {len(cells)} columns, expected {len(self.columns)}")
        *values, code, check = cells
        if row_check([*values, code]) != check:
            raise self.error(
                f"{where}: the row does not match its checksum: it was altered, or two runs wrote at once; "
                "remove the line to have it made anew"
            )
        try:
            record = self.kind(**{f.name: _value(f, c) for f, c in zip(self._fields, values, strict=True)})
        except ValueError as error:
            raise self.error(f"{where}: {error}") from error
        return record, code


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
        self._layout, self._path, self._code = layout, path, code_digest(layout.made_by)
        kept = layout.read_with_code(path) if path.exists() else []
        self.rows = [record for record, _ in kept]
        self._known = {record.key: record for record in self.rows}
        if {getattr(record, layout.owner) for record in self.rows} - {owner}:
            raise layout.error(f"{path}: holds {layout.others}; give another file, or remove it")
        if found := {code for _, code in kept} - {self._code}:
            raise layout.error(
                f"{path}: holds records made by other code of flexfmu or of its libraries "
                f"({', '.join(code or 'unknown' for code in sorted(found))}, now {self._code}): results of both do not "
                "belong together; give another file, or remove it"
            )
        if not path.parent.is_dir():
            raise layout.error(f"{path}: the folder {path.parent} does not exist; make it first")
        # What an interrupted run left half-written goes.
        with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
            _write(file, [layout.columns, *(layout.cells(record, self._code) for record in self.rows)])

    def append(self, record: R) -> None:
        """Add a record."""
        with self._path.open("a", newline="", encoding="utf-8") as file:
            _write(file, [self._layout.cells(record, self._code)])
            file.flush()
            os.fsync(file.fileno())
        self.rows.append(record)
        self._known[record.key] = record

    def find(self, key: tuple[str, ...]) -> R | None:
        """Return the record of a key."""
        return self._known.get(key)

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
