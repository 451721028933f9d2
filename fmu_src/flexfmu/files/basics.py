"""What nearly all modules take: array types, limits, units, errors, and how messages list, count and guess names."""

import difflib
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MOST_MODES = 1000
"""Normal modes of a body."""
MOST_FRAMES = 1000
"""Frames, or levels of them."""
MOST_STEPS = 1_000_000
"""Communication steps that every model of a scene takes."""
MOST_COUPLED_STEPS = 100_000_000
"""Communication steps of a coupling: of the smallest FMUs they take hours."""
MOST_VALUES = 5e7
"""Results that a run of FMUs keeps, rows times columns: some 2 GB while it runs."""

INTERRUPTED = 130
"""Exit code of a job that Ctrl-C ended, as shells have it."""

NOT_MET = 3
"""Exit code of a search that ended well and found no model within the tolerance; 1 is an error, 2 wrong usage."""


def own_version() -> str:
    """Version of this package, as it is installed."""
    from importlib.metadata import version

    return version("flexfmu")


class FlexfmuError(Exception):
    """Base of every error that a user's input can cause.

    Attributes
    ----------
    exit_code : int
        Of the command that it ends.
    """

    exit_code = 1


class BodyFileError(FlexfmuError):
    """The body file (TOML) names, lacks or contradicts something."""


class MeshError(FlexfmuError):
    """The mesh file cannot be read, or the mesh cannot be a body."""


class DeckError(MeshError):
    """A deck's line cannot be honoured.

    Parameters
    ----------
    message : str
        What was found, what was expected and what to do.
    file : str
        The deck, or the file that it includes.
    line : int
        Line number, counted from one.
    """

    def __init__(self, message: str, file: str, line: int):
        super().__init__(f"{file}, line {line}: {message}")
        self.file = file
        self.line = line


class UnitsError(DeckError):
    """A number of a deck means nothing in the units declared, and may in others."""


class SheetError(MeshError):
    """A mesh file holds sheets without thickness, and nothing else.

    Parameters
    ----------
    message : str
    size : float
        The longest side, in the file's units.
    """

    def __init__(self, message: str, size: float):
        super().__init__(message)
        self.size = size


class ModelError(FlexfmuError):
    """The finite element model is not a body that can be reduced: free to move, or without stiffness or mass."""


class AccuracyError(FlexfmuError):
    """A computed result does not pass its own check (orthogonality, residual)."""


class PackagingError(FlexfmuError):
    """The FMU archive could not be made or read."""


class OutputError(PackagingError):
    """A file cannot, or should not, be written."""


class SimulationError(FlexfmuError):
    """A simulation cannot be set up, or the FMU refused a step."""


class StoppedError(SimulationError):
    """A run that ended before its time.

    Parameters
    ----------
    message : str
    result : anything
        What came out until then.
    interrupted : bool
        Whether the user ended it.
    """

    def __init__(self, message: str, result: Any, interrupted: bool = False):
        super().__init__(message)
        self.result = result
        if interrupted:
            self.exit_code = INTERRUPTED


@contextmanager
def keeping_partial(output: Path, write: Callable[[Path, Any], None]) -> Iterator[None]:
    """Write what came out of a run that stops beside its output, and say where.

    Parameters
    ----------
    output : Path
    write : callable
        Of a path and a result.

    Raises
    ------
    StoppedError
        The run stopped.
    """
    try:
        yield
    except StoppedError as stopped:
        partial = output.with_suffix(f".partial{output.suffix}")
        write(partial, stopped.result)
        stopped.args = (f"{stopped}\nWhat came out until then is in {partial}",)
        raise


def plural(count: int, word: str) -> str:
    """A number of things; none is "no"."""
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"


def nearest(name: str, known: Iterable[str]) -> str:
    """Words that help where a name is unknown: those like it, or those that there are.

    Parameters
    ----------
    name : str
    known : iterable of str

    Returns
    -------
    str
    """
    names = list(known)
    near = alike(name, names)
    return f"did you mean {' or '.join(map(repr, near))}?" if near else f"there are: {listed(names)}"


def alike(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Known names that differ from `name` by case or a few letters, the most alike first."""
    lower = {one.lower(): one for one in known}
    return [lower[match] for match in difflib.get_close_matches(name.lower(), lower, n=count)]


def length_unit(length: float) -> tuple[float, str]:
    """The unit in which a length (m) reads best, and how many of it make one m."""
    return next((one for one in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")) if abs(length) * one[0] >= 1.0), (1.0, "m"))


def metres(length: float) -> str:
    """A length (m) in m, mm or µm, whichever reads best."""
    factor, unit = length_unit(length)
    return f"{factor * length:.4g} {unit}"


# Enough to find the place in a mesh; a thousand labels would bury the message.
SHOWN = 10


def listed(items: Iterable[object]) -> str:
    """Return the first ten items in words, with the number of those left out.

    Parameters
    ----------
    items : iterable of object
        Names or labels.

    Returns
    -------
    str
        Such as ``"3, 5, 8 and 12 more"``; ``"none"`` without items.
    """
    names = [str(item) for item in items]
    if not names:
        return "none"
    shown = ", ".join(names[:SHOWN])
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"


class RuntimeBodyError(Exception):
    """Base of the errors that the travelling code raises."""


class ModalFileError(RuntimeBodyError):
    """The modal file is not one, is damaged, or has a schema that this version does not read."""


class ContentsError(RuntimeBodyError):
    """Files of an FMU do not belong together."""


class OptionError(RuntimeBodyError):
    """An option or parameter has a value that is not offered."""


class LoadError(RuntimeBodyError):
    """A load is not finite, or acts on an interface that the body does not have."""


class EquilibriumError(RuntimeBodyError):
    """No stable equilibrium was found under the load.

    Parameters
    ----------
    message : str
        What happened and what to do.
    load_factor : float
        Largest fraction of the load for which a stable equilibrium was found.
    """

    def __init__(self, message: str, load_factor: float):
        super().__init__(message)
        self.load_factor = load_factor


class StepError(RuntimeBodyError):
    """A time step has no solution that the iteration can find; the state before it is untouched."""


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
