"""What an FMU offers a master, as core/interface.def lists it: names, units, start values, words and messages."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

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
