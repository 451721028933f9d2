"""The program as bytes, as core/fields.def lists its sizes and arrays, and what an FMU offers a master.

The bytes have a head and a checksum. What is offered, core/interface.def lists: names, units, start values, words and
messages.
"""

import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.basics import FlexfmuError, FloatArray, IntArray

FIELDS = Path(__file__).parents[1] / "core" / "fields.def"
DESCRIPTION = "body.prog"
"""An FMU's program of the method that it starts with; it describes the variables, too."""
VERSION = 3
_MARK = b"flexprog"
_WORD = 8
_HEAD = struct.Struct("<8sqQqQQ")
_ALIGNMENT = 32
# Bytes from which on it is worth taking an array from another image, and matrices and rows that are packed together.
_WORTH, _TOGETHER = 4096, 4
_FIELD = re.compile(r"^(SIZE|REAL|INTEGER|SHORT|TEXT)\((\w+)(?:, ([^)]*))?\)", re.MULTILINE)
_DTYPE: dict[str, str] = {"REAL": "<f8", "INTEGER": "<i8", "SHORT": "<i2", "TEXT": "u1"}


class ProgramError(FlexfmuError):
    """Arrays that do not make a program, or a program that is none."""


@dataclass(frozen=True, slots=True)
class Field:
    """A line of fields.def.

    Attributes
    ----------
    kind : str
        "SIZE", "REAL", "INTEGER", "SHORT" or "TEXT".
    name : str
    count : str
        Number of elements, from sizes.
    """

    kind: str
    name: str
    count: str


@cache
def fields() -> tuple[Field, ...]:
    """The table of fields, in the order of the image."""
    return tuple(Field(*found) for found in _FIELD.findall(FIELDS.read_text("utf-8")))


def checksum(data: bytes) -> int:
    """Sum of the data's 64-bit words, each mixed with its place; `checksum` of core/program.c."""
    words = np.frombuffer(data + b"\0" * (-len(data) % _WORD), dtype="<u8")
    with np.errstate(over="ignore"):
        z = words + np.arange(1, words.size + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return int(np.sum(z ^ (z >> np.uint64(31)), dtype=np.uint64))


def _table() -> bytes:
    """What the core makes of the same table."""
    return "".join(f"{f.kind} {f.name}{f' {f.count}' if f.count else ''}\n" for f in fields()).encode()


@dataclass(frozen=True, slots=True)
class Image:
    """What an image holds.

    Attributes
    ----------
    sizes : dict of str to int
    arrays : dict of str to array
        Flat.
    """

    sizes: dict[str, int]
    arrays: dict[str, NDArray[np.generic]]


def read_image(image: bytes, base: bytes = b"") -> Image:
    """Sizes and arrays of an image that the core has accepted, `base` being the one that it takes arrays from."""
    sizes: dict[str, int] = {}
    arrays: dict[str, NDArray[np.generic]] = {}
    words = np.frombuffer(image, "<i8", len(fields()), _HEAD.size).tolist()
    for field, word in zip(fields(), words, strict=True):
        if field.kind == "SIZE":
            sizes[field.name] = word
        else:
            count = _count(field.count, sizes)
            place = _WORD * word if count else 0
            arrays[field.name] = np.frombuffer(base if place < 0 else image, _DTYPE[field.kind], count, abs(place))
    return Image(sizes, arrays)


def guid_of(image: bytes) -> str:
    """Guid of the model description that a program belongs to; "" for what is no program of this version."""
    if not image.startswith(struct.pack("<8sqQ", _MARK, VERSION, checksum(_table()))):
        return ""
    try:
        return bytes(read_image(image).arrays["guid"]).rstrip(b"\0").decode(errors="replace")
    except (KeyError, ValueError, struct.error):
        return ""


def packed(matrices: FloatArray) -> FloatArray:
    """Symmetric (n, r, r) as the core has them, flat: `packed_times` of core/vectors.c."""
    count, r = matrices.shape[:2]
    if not matrices.size:
        return np.zeros(0)
    whole = np.zeros((-(-count // _TOGETHER), _TOGETHER, r, r))
    whole.reshape(-1, r, r)[:count] = 0.5 * matrices + 0.5 * matrices.swapaxes(1, 2)
    rows = [slice(a, a + _TOGETHER) for a in range(0, r - r % _TOGETHER, _TOGETHER)]
    rows += [slice(a, a + 1) for a in range(r - r % _TOGETHER, r)]
    parts = [np.moveaxis(whole[:, :, own, own.start :], (1, 2, 3), (3, 2, 1)).reshape(len(whole), -1) for own in rows]
    return np.concatenate(parts, axis=1).ravel()


def aligned(data: bytes) -> bytes:
    """Bytes with zeros behind them: what follows is as vectors like it."""
    return data + b"\0" * (-len(data) % _ALIGNMENT)


def shared(several: Iterable[Mapping[str, Any]], base: bytes) -> IntArray:
    """Large arrays that several programs hold and an image does not, for that to hold them, too."""
    large = [aligned(a.tobytes()) for arrays in several for a in arrays.values() if getattr(a, "nbytes", 0) >= _WORTH]
    return np.frombuffer(
        b"".join(data for data, count in Counter(large).items() if count > 1 and data not in base), "<i8"
    )


def write_image(sizes: Mapping[str, int], arrays: Mapping[str, NDArray[Any] | bytes], base: bytes = b"") -> bytes:
    """Image of a program.

    Parameters
    ----------
    sizes : mapping of str to int
        Those left out are zero.
    arrays : mapping of str to array or bytes
        Those left out are empty; shapes do not matter, their sizes must be those of the table.
    base : bytes
        An image that large arrays are taken from where it holds them; others that are the same are written once.

    Returns
    -------
    bytes

    Raises
    ------
    ProgramError
        Naming the first array or size that the table does not know, or whose size is another.
    """
    if unknown := {*sizes, *arrays} - {field.name for field in fields()}:
        raise ProgramError(f"{min(unknown)!r} is no field of a program")
    every = {field.name: int(sizes.get(field.name, 0)) for field in fields() if field.kind == "SIZE"}
    words: list[int] = []
    start = len(aligned(bytes(_HEAD.size + _WORD * len(fields()))))
    parts = bytearray()
    for field in fields():
        if field.kind == "SIZE":
            words.append(every[field.name])
            continue
        given = arrays.get(field.name, b"")
        values = np.frombuffer(given, np.uint8) if isinstance(given, bytes) else np.ascontiguousarray(given)
        expected = _count(field.count, every)
        if values.size != expected:
            raise ProgramError(f"{field.name} has {values.size} elements, expected {field.count} = {expected}")
        data = aligned(values.astype(_DTYPE[field.kind]).tobytes())
        known = [held.find(data) if len(data) >= _WORTH else -1 for held in (base, parts)]
        other, own = (place >= 0 and place % _ALIGNMENT == 0 for place in known)
        words.append((-known[0] if other else start + (known[1] if own else len(parts))) // _WORD)
        parts += b"" if other or own else data
    body = struct.pack(f"<{len(words)}q", *words).ljust(start - _HEAD.size, b"\0") + parts
    mark = _HEAD.unpack_from(base)[-1] if base else 0
    return _HEAD.pack(_MARK, VERSION, checksum(_table()), _HEAD.size + len(body), mark, checksum(body)) + body


def _count(expression: str, sizes: Mapping[str, int]) -> int:
    """Value of sums of products of sizes and numbers."""
    return sum(math.prod(f if isinstance(f, int) else sizes[f] for f in term) for term in _terms(expression))


@cache
def _terms(expression: str) -> list[list[int | str]]:
    """Factors of each product: numbers, and names of sizes."""
    return [[int(f) if f.strip().isdigit() else f.strip() for f in term.split("*")] for term in expression.split("+")]


TABLE = Path(__file__).with_name("interface.def")
_TYPES = {"REAL": "Real", "INTEGER": "Integer"}
_LINE = re.compile(r"^([A-Z_]+)\((.*?)\)$", re.MULTILINE | re.DOTALL)
_TEXT = r'"(?:[^"\\]|\\.)*"'
_CELL = re.compile(rf"(?:{_TEXT}|[^,\"])+")


@dataclass(frozen=True, slots=True)
class Row:
    """A kind of variable.

    Attributes
    ----------
    role : str
        Of the roles of the table.
    symbol : str
        The core's name; "" for inputs and outputs.
    name : str
        NAME, AXIS and the like stand for interfaces, axes and the like.
    type : str
        "Real", "Integer", "Boolean" or "String".
    unit : str
        "" for none.
    when : str
        Which bodies have it.
    text, note : str
        What the model description says, and what the pages say with it.
    start, least : float
        Of a real parameter.
    tunable : bool
        Whether a parameter may be set between steps.
    words : str
        Table of the words that a parameter offers; "" for other parameters.
    """

    role: str
    symbol: str
    name: str
    type: str
    unit: str
    when: str
    text: str
    note: str
    start: float = 0.0
    least: float = 0.0
    tunable: bool = False
    words: str = ""


@cache
def table() -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Every line of the table: its macro, and its cells."""
    return tuple((macro, _cells(cells)) for macro, cells in _LINE.findall(TABLE.read_text("utf-8")))


def lines(macro: str) -> list[tuple[str, ...]]:
    """Cells of the lines of one macro."""
    return [cells for name, cells in table() if name == macro]


def symbols(macro: str) -> list[str]:
    """First cells of the lines of one macro: the core's enumeration in its order."""
    return [cells[0] for cells in lines(macro)]


@cache
def rows() -> tuple[Row, ...]:
    """Every kind of variable, in the order of the table."""
    made: dict[str, Callable[..., list[Row]]] = {
        "VARIABLE": _variable,
        "PARAMETER": _parameter,
        "WATCH": _watch,
        "DIAGNOSTIC": _diagnostic,
    }
    return tuple(row for macro, cells in table() if macro in made for row in made[macro](*cells))


def rows_of(role: str) -> list[Row]:
    """Kinds of variables of one role; of parameters and diagnostics in the order of the core's numbers."""
    return [row for row in rows() if row.role == role and (row.symbol or role != "PARAMETER")]


def parameter(symbol: str) -> Row:
    """A parameter by the core's name."""
    return next(row for row in rows_of("PARAMETER") if row.symbol == symbol)


def words_of(macro: str) -> tuple[str, ...]:
    """The words that a parameter offers, the default first."""
    return tuple(word for _, word, _ in lines(macro))


def word_of(macro: str, given: object = None) -> str:
    """One of the words that a parameter offers; the default where none is given.

    Raises
    ------
    ValueError
        It is none of them.
    """
    offered = words_of(macro)
    return offered[0] if given is None else offered[offered.index(str(given))]


def _cells(text: str) -> tuple[str, ...]:
    """Cells of a line; adjacent strings are one."""
    result = []
    for cell in _CELL.findall(text):
        strings = re.findall(_TEXT, cell)
        result.append("".join(re.sub(r"\\(.)", r"\1", part[1:-1]) for part in strings) if strings else cell.strip())
    return tuple(result)


def _variable(role: str, name: str, unit: str, when: str, text: str, note: str) -> list[Row]:
    kind = {"STATUS": "Integer", "PARAMETER": "Boolean"}.get(role, "Real")
    return [Row(role, "", name, kind, unit, when, text, note)]


def _parameter(symbol: str, name: str, kind: str, *cells: str) -> list[Row]:
    unit, start, least, variability, when, text, note = cells
    row = Row("PARAMETER", symbol, name, _TYPES.get(kind, "String"), unit, when, text, note)
    if kind not in _TYPES:
        return [replace(row, words=kind)]
    return [replace(row, start=float(start), least=float(least), tunable=variability == "TUNABLE")]


def _watch(symbol: str, name: str, unit: str, start: str, when: str, text: str, side: str, note: str) -> list[Row]:
    limit = _parameter(
        f"{symbol}_LIMIT", f"{name}.limit", "REAL", unit, start, "0", "FIXED", when, f"{text}; 0 for no limit", note
    )
    beyond = f"what happens {side} it"
    return limit + _parameter(f"ON_{symbol}", f"{name}.on_limit", "ON_LIMIT", "", "0", "0", "FIXED", when, beyond, "")


def _diagnostic(symbol: str, name: str, kind: str, unit: str, when: str, text: str, note: str) -> list[Row]:
    return [Row("DIAGNOSTIC", symbol, name, _TYPES[kind], unit, when, text, note)]
