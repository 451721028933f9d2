"""Interfaces that springs hold: their variables, checked, and the places of these in a layout."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..files.array_types import IntArray
from ..files.axes import orthonormal
from ..files.errors import SimulationError
from ..files.units import QUANTITIES
from .config import SpringTable
from .descriptions import Description, split
from .layout import EndResponse, Ends, Springs

AXES = ("x", "y", "z")
ROWS = ("ux", "uy", "uz", "rx", "ry", "rz")
COLUMNS = ("fx", "fy", "fz", "mx", "my", "mz")
_MOTION, _RATES, _LOADS = ("displacement", "rotation"), ("velocity", "angular_velocity"), ("force", "moment")
# "N.m", "N m", "N*m" and "Nm" are all in use.
_JOINTS = str.maketrans("", "", ". *·")


class Shares:
    """Variables of all FMUs, collected as they are asked for, then put into the order of the FMUs."""

    def __init__(self, descriptions: Mapping[str, Description]):
        self._asked: dict[str, dict[str, None]] = {name: {} for name in descriptions}

    def ask(self, fmu: str, variable: str) -> None:
        """Ask for a variable of an FMU; once is enough."""
        self._asked[fmu][variable] = None

    def of(self, fmu: str) -> tuple[str, ...]:
        """What was asked of an FMU, in the order of asking."""
        return tuple(self._asked[fmu])

    def places(self) -> dict[tuple[str, str], int]:
        """Place of each variable by FMU and name, when all have been asked for."""
        pairs = [(fmu, variable) for fmu, variables in self._asked.items() for variable in variables]
        return {pair: place for place, pair in enumerate(pairs)}


def end_names(
    springs: list[SpringTable], descriptions: Mapping[str, Description], inputs: Shares, signals: Shares
) -> tuple[str, ...]:
    """Interfaces that springs hold, in the order found; their variables are asked for.

    Parameters
    ----------
    springs : list of SpringTable
    descriptions : mapping of str to Description
    inputs, signals : Shares
        Are asked.

    Returns
    -------
    tuple of str
        "fmu.interface".

    Raises
    ------
    SimulationError
        An end that is not there, or lacks what the spring needs.
    """
    ends: dict[str, None] = {}
    for number, spring in enumerate(springs, start=1):
        for side, text in (("a", spring.a), ("b", spring.b)):
            if text is None:
                continue
            key = f"spring {number}, {side}"
            description, interface = split(text, descriptions, key)
            for quantity in ("displacement", "force"):
                _check_vector(description, interface, quantity, key)
            turns = _group(description, f"{interface}.rotation") and _group(description, f"{interface}.moment")
            if turns:
                for quantity in ("rotation", "moment"):
                    _check_vector(description, interface, quantity, key)
            elif any(spring.stiffness[3:] + spring.damping[3:]):
                raise SimulationError(
                    f"{key}: {text} has no rotation and moment ({interface}.rotation.x …, {interface}.moment.x …): set "
                    "the last three numbers of stiffness and damping to zero"
                )
            ends[text] = None
    for text in ends:
        fmu, _, interface = text.partition(".")
        for quantity in (*_MOTION, *_RATES, *_LOADS):
            if _group(descriptions[fmu], f"{interface}.{quantity}"):
                for axis in AXES:
                    shares = inputs if quantity in _LOADS else signals
                    shares.ask(fmu, f"{interface}.{quantity}.{axis}")
    return tuple(ends)


def _check_vector(description: Description, interface: str, quantity: str, key: str) -> None:
    """Whether the three components of a vector of an interface are there, and are what a spring needs."""
    wanted = "input" if quantity in _LOADS else "output"
    expected = QUANTITIES[quantity]
    for axis in AXES:
        name = f"{interface}.{quantity}.{axis}"
        variable = description.variable(name, key)
        if variable.causality != wanted or variable.type != "Real":
            raise SimulationError(
                f"{key}: {description.name}.{name} is of causality {variable.causality} and type {variable.type}, "
                f"expected a Real {wanted}"
            )
        unit = description.unit(name)
        if unit is not None and unit.translate(_JOINTS) != expected.translate(_JOINTS):
            raise SimulationError(f"{key}: {description.name}.{name} is in {unit}, expected {expected}")


def _group(description: Description, name: str) -> bool:
    """Whether all three components of a vector are there."""
    return all(f"{name}.{axis}" in description.variables for axis in AXES)


def lay_ends(
    ends: tuple[str, ...],
    descriptions: Mapping[str, Description],
    input_place: Mapping[tuple[str, str], int],
    signal_place: Mapping[tuple[str, str], int],
) -> Ends:
    """Places of the ends' variables.

    Parameters
    ----------
    ends : tuple of str
        "fmu.interface".
    descriptions : mapping of str to Description
    input_place, signal_place : mapping of (str, str) to int
        Places of FMUs' variables.

    Returns
    -------
    Ends
    """
    order = list(descriptions)

    def places(place: Mapping[tuple[str, str], int], quantities: Sequence[str]) -> IntArray:
        return np.array([_places(place, text, quantities) for text in ends], dtype=np.int64).reshape(len(ends), 6)

    return Ends(
        ends,
        np.array([order.index(text.partition(".")[0]) for text in ends], dtype=np.int64),
        places(signal_place, _MOTION),
        places(signal_place, _RATES),
        places(input_place, _LOADS),
    )


def lay_responses(
    descriptions: Mapping[str, Description],
    fed_place: Mapping[tuple[str, str], int],
    signal_place: Mapping[tuple[str, str], int],
) -> tuple[EndResponse, ...]:
    """Compliance that FMUs offer of interfaces whose motion the coupling reads to those that it loads.

    Parameters
    ----------
    descriptions : mapping of str to Description
    fed_place, signal_place : mapping of (str, str) to int
        Places of FMUs' variables: inputs that connections or springs feed, and signals.

    Returns
    -------
    tuple of EndResponse
    """
    order, found = list(descriptions), []
    for a in _interfaces(signal_place, (*_MOTION, *_RATES)):
        for b in _interfaces(fed_place, _LOADS):
            fmu, _, interface = a.partition(".")
            other_fmu, _, other = b.partition(".")
            middle = "" if other == interface else f"{other}."
            names = [f"{interface}.compliance.{middle}{row}.{column}" for row in ROWS for column in COLUMNS]
            there = descriptions[fmu].variables
            if fmu == other_fmu and all(name in there and there[name].type == "Real" for name in names):
                references = tuple(int(there[name].valueReference) for name in names)
                motion, rates = _places(signal_place, a, _MOTION), _places(signal_place, a, _RATES)
                loads = _places(fed_place, b, _LOADS)
                found.append(EndResponse(a, b, order.index(fmu), references, motion, rates, loads))
    return tuple(found)


def _places(place: Mapping[tuple[str, str], int], text: str, quantities: Sequence[str]) -> IntArray:
    """Places (6,) of the components of two vectors of an interface."""
    fmu, _, interface = text.partition(".")
    names = [f"{interface}.{quantity}.{axis}" for quantity in quantities for axis in AXES]
    return np.array([place.get((fmu, name), -1) for name in names], dtype=np.int64)


def _interfaces(place: Mapping[tuple[str, str], int], quantities: Sequence[str]) -> list[str]:
    """Interfaces of which components of some vectors are among the variables."""
    found: dict[str, None] = {}
    for fmu, name in place:
        interface, _, rest = name.partition(".")
        quantity, _, axis = rest.partition(".")
        if quantity in quantities and axis in AXES:
            found[f"{fmu}.{interface}"] = None
    return list(found)


def lay_springs(springs: list[SpringTable], ends: tuple[str, ...]) -> Springs:
    """Springs between the ends.

    Parameters
    ----------
    springs : list of SpringTable
    ends : tuple of str
        "fmu.interface".

    Returns
    -------
    Springs
    """
    return Springs(
        np.array([ends.index(spring.a) for spring in springs], dtype=np.int64),
        np.array([len(ends) if spring.b is None else ends.index(spring.b) for spring in springs], dtype=np.int64),
        np.array([spring.stiffness for spring in springs], dtype=np.float64).reshape(-1, 6),
        np.array([spring.damping for spring in springs], dtype=np.float64).reshape(-1, 6),
        np.array([orthonormal(spring.axes) for spring in springs]).reshape(-1, 3, 3),
    )
