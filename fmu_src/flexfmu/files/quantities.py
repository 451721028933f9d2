"""Numbers with units, as people write them: in headers of tables and on the command line; SI inside."""

import math
import re

from .errors import FlexfmuError

_DEGREE, _INCH, _POUND = math.pi / 180.0, 0.0254, 4.4482216152605
# SI unit of each quantity as the FMU names it, and what else is read, by how many of it one is.
UNITS: dict[str, dict[str, float]] = {
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6, "lbf": _POUND},
    "N.m": {
        "N.m": 1.0, "Nm": 1.0, "N.mm": 1e-3, "Nmm": 1e-3, "kN.m": 1e3, "kNm": 1e3, "lbf.in": _POUND * _INCH,
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "in": _INCH},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": _DEGREE, "°": _DEGREE},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "in/s": _INCH},
    "rad/s": {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "rpm": math.pi / 30.0, "1/min": math.pi / 30.0},
    "m/s2": {"m/s2": 1.0, "mm/s2": 1e-3, "g": 9.80665},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "N/mm2": 1e6, "GPa": 1e9, "psi": _POUND / _INCH**2},
    "J": {"J": 1.0, "mJ": 1e-3, "kJ": 1e3},
    "s": {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "min": 60.0},
}  # fmt: skip
# Unit of variables by the last word of their names but the axis.
_QUANTITIES = {
    "time": "s",
    "force": "N",
    "moment": "N.m",
    "acceleration": "m/s2",
    "displacement": "m",
    "rotation": "rad",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "von_mises": "Pa",
}
_HEADER = re.compile(r"^(?P<name>[^\[\]()]*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")
_NUMBER = re.compile(r"^(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*(?P<unit>\S.*)?$")


def unit_of(name: str) -> str | None:
    """SI unit of a variable by its name, as of `time` or `tip.force.y`; None where the name does not tell."""
    words = name.strip().split(".")
    return _QUANTITIES.get(words[-2] if len(words) > 1 and words[-1] in ("x", "y", "z") else words[-1])


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


def with_unit(name: str) -> str:
    """A variable's name with its unit, as `named` reads it; the name alone where it does not tell."""
    unit = unit_of(name)
    return name if unit is None else f"{name} [{unit}]"


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
