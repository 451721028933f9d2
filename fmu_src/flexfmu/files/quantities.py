"""Numbers with units, as people write them: in headers of tables and on the command line; SI inside."""

import re

from .basics import FlexfmuError
from .units import QUANTITIES, UNITS

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


def number(text: str, name: str) -> float:
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
    offered = ", ".join(UNITS[expected])
    raise FlexfmuError(f"{where}: the unit is {unit!r}, expected one of {offered}")
