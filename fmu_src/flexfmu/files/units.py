"""The table of units, and the systems of them that mesh files and body files' materials may be in."""

import math
from enum import Enum
from typing import Any

from .basics import BodyFileError

# Exact by definition: the inch, and the pound-force.
_DEGREE, _INCH, _POUND = math.pi / 180.0, 0.0254, 4.4482216152605
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
    "kg/m³": {
        "kg/m³": 1.0, "g/cm³": 1e3, "t/mm³": 1e12, "kg/mm³": 1e9, "lb/in³": 0.45359237 / _INCH**3,
        "lbf s²/in⁴": _POUND / _INCH**4,
    },
}  # fmt: skip
"""SI unit of each quantity as the FMU names it, and what else is read, by how many of it one is."""
QUANTITIES = {
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
"""SI unit of variables by the last word of their names but the axis."""


# Of length, stress and density.
_NAMES = {"m-kg-s": ("m", "N/m²", "kg/m³"), "mm-t-s": ("mm", "MPa", "t/mm³"), "in-lbf-s": ("in", "psi", "lbf s²/in⁴")}


class UnitSystem(Enum):
    """Consistent units that a mesh file may be written in.

    `SI` is metre, kilogram, second, newton and pascal; `MM_T_S` is millimetre, tonne, second, newton and
    megapascal; `IN_LBF_S` is inch, pound-force, second and psi, densities in lbf s²/in⁴.

    Attributes
    ----------
    length, stress, density : float
        Metres, pascals and kilograms per cubic metre per unit.
    length_name, stress_name, density_name : str
    """

    SI = "m-kg-s"
    MM_T_S = "mm-t-s"
    IN_LBF_S = "in-lbf-s"

    def __init__(self, name: Any):
        self.length_name, self.stress_name, self.density_name = _NAMES[name]
        self.length, self.stress = UNITS["m"][self.length_name], UNITS["Pa"].get(self.stress_name, 1.0)
        self.density = UNITS["kg/m³"][self.density_name]


def unit_system(given: UnitSystem | str) -> UnitSystem:
    """Unit system of its name; BodyFileError without one."""
    try:
        return UnitSystem(given)
    except ValueError as error:
        known = ", ".join(repr(system.value) for system in UnitSystem)
        raise BodyFileError(f"units are {given!r}, expected one of {known}") from error
