"""Files that a job reads: what they are, and tables over time, with numbers and units as users write them."""

import csv
import re
import tomllib
import zipfile
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from .basics import QUANTITIES, UNITS, FlexfmuError, FloatArray, SimulationError
from .outputs import whole_file

_HDF5 = b"\x89HDF\r\n\x1a\n"
# Where HDF5's own bytes begin in files of others, and in ours, behind their seal.
_BEGINNINGS = (0, 512)
_MESHES = (".inp", ".msh", ".vtk", ".vtu", ".bdf", ".nas", ".fem", ".dat", ".cdb", ".unv", ".med", ".xdmf", ".stl",
           ".e", ".exo", ".ex2", ".exii")  # fmt: skip


# Bytes that an archive may unpack to, and how many times its own size beyond them.
_UNPACKED, _RATIO = 2**30, 20


class Kind(Enum):
    """What a file is, what it is for, and of TOML files the top-level keys by which they are told from each other."""

    BODY = "a body file", "`flexfmu build` makes an FMU of it", "mesh", "interface", "support"
    SCENE = "a scene file", "it goes to `flexfmu chart` and `fit` as --scene", "static", "transient", "sweep"
    COUPLING = "a coupling file", "`flexfmu couple` runs it", "experiment", "fmu", "connection", "spring"
    MESH = "a mesh", 'name it in a body file, file = "…" in [mesh], and build that'
    FMU = "an FMU", "it goes to `flexfmu info` and `simulate`, or into a coupling file"
    MODAL = "a modal file", "`flexfmu info` shows it; the FMU of the same build has it inside"
    MODES = "modes (.npz or .h5)", "`flexfmu pack` makes an FMU of them"
    TABLE = "a table", "it goes to `flexfmu simulate` as --input"

    def __init__(self, words: str, use: str, *keys: str):
        self.words, self.use, self.keys = words, use, frozenset(keys)


def toml_kind(data: Mapping[str, Any]) -> Kind | None:
    """Kind of a TOML file by its top-level keys; None where they are nobody's or several kinds'."""
    found = [kind for kind in Kind if kind.keys & set(data)]
    return found[0] if len(found) == 1 else None


def kind_of(path: Path) -> Kind | None:
    """Kind of an existing file, by its ending or contents; None if that is not plain."""
    suffix = path.suffix.lower()
    if suffix in _MESHES:
        return Kind.MESH
    if suffix == ".csv":
        return Kind.TABLE
    if suffix == ".toml":
        try:
            return toml_kind(tomllib.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None
    if zipfile.is_zipfile(path):
        try:
            with zipfile.ZipFile(path) as archive:
                return Kind.FMU if "modelDescription.xml" in archive.namelist() else None
        except zipfile.BadZipFile:
            return None
    with path.open("rb") as file:
        head = file.read(_BEGINNINGS[-1] + len(_HDF5))
    return Kind.MODAL if any(head[place:].startswith(_HDF5) for place in _BEGINNINGS) else None


def check_input(path: Path, error_type: type[FlexfmuError], *wanted: Kind) -> None:
    """Refuse what cannot be read, or is plainly another kind of file than the one that is wanted.

    Parameters
    ----------
    path : Path
    error_type : type of FlexfmuError
        What is raised.
    *wanted : Kind
        Kinds that will do.
    """
    expected = f"expected {' or '.join(kind.words for kind in wanted)}"
    if path.is_dir():
        raise error_type(f"{path} cannot be read: it is a folder, {expected}")
    if path.exists() and not path.is_file():
        raise error_type(f"{path} cannot be read: it is a pipe or a device, which may never end, {expected} on disk")
    if not path.exists():
        raise error_type(f"{path}: no such file, {expected}; correct the path")
    try:
        with path.open("rb") as file:
            head = file.read(4)
        if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise error_type(f"{path} is text in UTF-16, {expected} in UTF-8; save it anew in that encoding")
        if head == b"PK\x03\x04" and wanted == (Kind.TABLE,):
            raise error_type(f"{path} is a workbook or an archive, {expected}; save it as CSV text")
        found = kind_of(path)
    except OSError as error:
        raise error_type(f"{path} cannot be read ({error}), {expected}") from error
    if found is not None and found not in wanted:
        raise error_type(f"{path} is {found.words}, {expected}: {found.use}")


def check_unpacked(path: Path) -> None:
    """Refuse an archive that unpacks to far more than it is.

    Parameters
    ----------
    path : Path
        FMU.

    Raises
    ------
    FlexfmuError
    """
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    packed = path.stat().st_size
    if unpacked > max(_UNPACKED, _RATIO * packed):
        found = f"{path}: {packed / 1e6:.3g} MB unpack to {unpacked / 1e6:.3g} MB"
        expected = f"at most {max(_UNPACKED, _RATIO * packed) / 1e6:.3g}: take large files out of the archive"
        raise FlexfmuError(f"{found}, expected {expected}")


_HEADER = re.compile(r"^(?P<name>[^\[\]()]*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")
_NUMBER = re.compile(r"^(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*(?P<unit>\S.*)?$")


def unit_of(name: str) -> str | None:
    """SI unit of a variable by its name, as of `time` or `tip.force.y`; None where the name does not tell."""
    words = name.strip().split(".")
    return QUANTITIES.get(words[-2] if len(words) > 1 and words[-1] in ("x", "y", "z") else words[-1])


def named(header: str) -> tuple[str, float]:
    """Name and factor to SI of a column's header, such as "tip.force.y", "tip.force.y [kN]" or "time (ms)".

    Raises
    ------
    FlexfmuError
        A unit that is not known, or not one of that quantity.
    """
    found = _HEADER.match(header.strip())
    if found is None:
        return header.strip(), 1.0
    return found["name"], factor(found["unit"], unit_of(found["name"]), header.strip())


def quantity(text: str, name: str) -> float:
    """A number in SI units, as from "5e3", "5 kN" or "5kN", for a variable of some name.

    Raises
    ------
    FlexfmuError
        No number, or a unit that does not fit.
    """
    found = _NUMBER.match(text.strip())
    if found is None:
        raise FlexfmuError(f"{name}: found {text!r}, expected a number, or one with a unit such as 5kN")
    unit = found["unit"]
    return float(found["number"]) * (1.0 if unit is None else factor(unit, unit_of(name), f"{name}={text}"))


def factor(unit: str, expected: str | None, where: str) -> float:
    """How many SI units one of `unit` is.

    Parameters
    ----------
    unit : str
    expected : str or None
        SI unit of the quantity; None where any will do.
    where : str
        For messages.

    Raises
    ------
    FlexfmuError
        It is not known, or of another quantity.
    """
    plain = re.sub(r"[\s*·]+", ".", unit.strip()).replace("²", "2").replace("^", "")
    if plain in ("", "1", "-"):
        return 1.0
    for known in [UNITS[expected]] if expected is not None else UNITS.values():
        if plain in known:
            return known[plain]
    if expected is None:
        # Of a variable of others, which nothing here reads.
        return 1.0
    raise FlexfmuError(f"{where}: the unit is {unit!r}, expected one of {', '.join(UNITS[expected])}")


def read_table(path: Path, first: str = "time") -> tuple[list[str], FloatArray]:
    """Read a CSV of numbers; units in its header are converted to SI, lines that begin with # are passed over.

    Parameters
    ----------
    path : Path
    first : str
        Name of the first column, whose numbers ascend.

    Returns
    -------
    names : list of str
        Of the columns after the first.
    values : (rows, 1 + len(names)) float

    Raises
    ------
    SimulationError
        Naming the line that is wrong.
    """
    check_input(path, SimulationError, Kind.TABLE)
    try:
        # Spreadsheets put a byte-order mark in front.
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, row) for row in reader if row and row[0][:1] != "#"]
    except (OSError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: cannot be read ({error})") from error
    try:
        columns = [named(header) for header in lines[0][1]] if lines else []
    except FlexfmuError as error:
        raise SimulationError(f"{path}: {error}") from error
    if not columns or columns[0][0] != first:
        raise SimulationError(f"{path}: {_header_fault(lines[0][1] if lines else [], first)}")
    if len(lines) < 2:
        raise SimulationError(f"{path}: a header and nothing else, expected at least one row of numbers")
    names = [name for name, _ in columns[1:]]
    if "" in names:
        fault = f'column {names.index("") + 2} of the header has no name, expected "{first},NAME,…"'
        raise SimulationError(f"{path}: {fault}; take out commas at the ends of lines")
    for name in names:
        if names.count(name) > 1 or name == first:
            raise SimulationError(f"{path}: two columns are called {name!r}, expected each name once")
    return names, _rows(path, lines, columns)


def _rows(path: Path, lines: list[tuple[int, list[str]]], columns: list[tuple[str, float]]) -> FloatArray:
    """Numbers of the lines below the header, in SI units; columns are names and factors."""
    values, header = np.empty((len(lines) - 1, len(columns))), [cell.strip() for cell in lines[0][1]]
    for k, (line, row) in enumerate(lines[1:]):
        place = f"{path}, line {line}"
        if len(row) != len(header):
            found = f"{len(row)} columns, the header has {len(header)}"
            raise SimulationError(f"{place}: {found}; expected commas between columns only, and decimal points")
        try:
            values[k] = [factor * float(cell) for cell, (_, factor) in zip(row, columns, strict=True)]
        except ValueError as error:
            wrong = next(k for k, cell in enumerate(row) if number(cell) is None)
            found = f"{header[wrong]} is {row[wrong]!r}"
            raise SimulationError(f"{place}: {found}; expected numbers, units in the header") from error
        if not np.all(np.isfinite(values[k])):
            worst = int(np.argmin(np.isfinite(values[k])))
            raise SimulationError(f"{place}: {header[worst]} is {row[worst].strip()}, expected a finite number")
        if k and values[k, 0] < values[k - 1, 0]:
            raise SimulationError(f"{place}: {columns[0][0]} goes back from {values[k - 1, 0]} to {values[k, 0]}")
    return values


def _header_fault(cells: Sequence[str], wanted: str) -> str:
    """What is wrong with a table's first line that does not begin with the name that is wanted."""
    first = cells[0].strip() if cells else ""
    called = f'"{wanted}"' + (", in s" if wanted == "time" else "")
    fault = f"the first column is called {first!r}: call it {called}" if cells else "nothing is in it"
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if sign in first:
            fault = f"its columns are separated by {name}"
    if number(first) is not None:
        fault = "the first line is numbers"
    return f'{fault}; expected a header "{wanted},NAME,…" (commas), then rows of numbers (decimal points)'


def write_table(
    path: Path, names: Sequence[str], values: FloatArray, units: Sequence[str | None] | None = None
) -> None:
    """Write a CSV with a header "time [s],NAME [UNIT],…"; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Of the columns after time.
    values : (rows, 1 + len(names)) float
    units : sequence of str or None, optional
        Of the same; default: those that their names tell.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        told = zip(names, map(unit_of, names) if units is None else units, strict=True)
        writer.writerow(["time [s]", *(f"{name} [{unit}]" if unit else name for name, unit in told)])
        writer.writerows([f"{x:.12g}" for x in row] for row in values)


def number(text: str) -> float | None:
    """The number that a text is, or None.

    Parameters
    ----------
    text : str

    Returns
    -------
    float or None
    """
    try:
        return float(text)
    except ValueError:
        return None
