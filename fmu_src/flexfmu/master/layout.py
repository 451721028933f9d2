"""A coupling as arrays: what every FMU gives and gets, connections, springs' ends, tables and what is recorded.

All outputs that the coupling needs make one vector of signals, all inputs that it drives another: FMU by FMU in the
order listed. The connections are a matrix from the one to the other; springs read and write places in them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.model_description import BaseUnit, ModelVariable

from ..files.basics import BoolArray, FloatArray, IntArray, SimulationError, nearest
from ..fmu.simulation import description_of
from .config import StartValue

# What `generationTool` begins with in FMUs of this package.
_OWN = "flexfmu "
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset")


@dataclass(frozen=True, slots=True)
class Description:
    """An FMU as its model description tells, under the name that it has in the coupling.

    Attributes
    ----------
    name : str
        Of the instance.
    file : Path
    guid, model_identifier : str
    saves_state : bool
        `canGetAndSetFMUstate`.
    own : bool
        Made by this package.
    variables : mapping of str to ModelVariable
        By name.
    units : mapping of str to BaseUnit or None
        Declared units; None: without base units.
    """

    name: str
    file: Path
    guid: str
    model_identifier: str
    saves_state: bool
    own: bool
    variables: Mapping[str, ModelVariable]
    units: Mapping[str, BaseUnit | None]

    def variable(self, name: str, wanted: str) -> ModelVariable:
        """A variable by name.

        Parameters
        ----------
        name : str
        wanted : str
            Who asks for it, to begin the message.

        Returns
        -------
        ModelVariable

        Raises
        ------
        SimulationError
            There is none; with the nearest names.
        """
        if name not in self.variables:
            near = nearest(name, self.variables)
            raise SimulationError(f"{wanted}: {self.name!r} ({self.file.name}) has no variable {name!r}; {near}")
        return self.variables[name]

    def nominal(self, name: str) -> float:
        """Nominal value of a variable, its own or its type's; one where there is none, as FMI has it.

        Parameters
        ----------
        name : str

        Returns
        -------
        float
        """
        own = self._told(name, "nominal")
        return 1.0 if own is None else abs(float(own))

    def unit(self, name: str) -> str | None:
        """Unit of a variable, its own or its type's.

        Parameters
        ----------
        name : str

        Returns
        -------
        str or None
        """
        own = self._told(name, "unit")
        return None if own is None else str(own)

    def _told(self, name: str, what: str) -> Any:
        variable = self.variables[name]
        return getattr(variable, what) or getattr(variable.declaredType, what, None)


def read_description(name: str, file: Path) -> Description:
    """Read an FMU's model description.

    Parameters
    ----------
    name : str
        Of the instance.
    file : Path

    Returns
    -------
    Description

    Raises
    ------
    SimulationError
        No readable FMU, or not one of FMI 2.0 for co-simulation.
    """
    try:
        model = description_of(file)
    except SimulationError as error:
        raise SimulationError(f"fmu {name!r}: {error}") from error
    variables = {variable.name: variable for variable in model.modelVariables}
    units = {unit.name: unit.baseUnit for unit in model.unitDefinitions}
    can = str(model.coSimulation.modelIdentifier), bool(model.coSimulation.canGetAndSetFMUstate)
    own = str(model.generationTool or "").startswith(_OWN)
    return Description(name, file, str(model.guid), *can, own, variables, units)


def split(text: str, descriptions: Mapping[str, Description], wanted: str) -> tuple[Description, str]:
    """Take "fmu.rest" apart.

    Parameters
    ----------
    text : str
    descriptions : mapping of str to Description
    wanted : str
        Who asks for it, to begin the message.

    Returns
    -------
    description : Description
    rest : str

    Raises
    ------
    SimulationError
        No dot, or no FMU of that name.
    """
    fmu, dot, rest = text.partition(".")
    if not dot or not rest:
        raise SimulationError(f'{wanted}: found {text!r}, expected "FMU.NAME" with one of {", ".join(descriptions)}')
    if fmu not in descriptions:
        raise SimulationError(f"{wanted}: {text!r} names no [[fmu]]; {nearest(fmu, descriptions)}")
    return descriptions[fmu], rest


def units_differ(one: Description, name: str, other: Description, other_name: str) -> bool:
    """Whether two variables have units, and these are not the same.

    Units of the same name are the same; of different names, if their base units are.

    Parameters
    ----------
    one, other : Description
    name, other_name : str
        Variables.

    Returns
    -------
    bool
    """
    first, second = one.unit(name), other.unit(other_name)
    if first is None or second is None or first == second:
        return False
    base, other_base = one.units.get(first), other.units.get(second)
    if base is None or other_base is None:
        return True
    return any(float(getattr(base, key)) != float(getattr(other_base, key)) for key in _BASES)


@dataclass(frozen=True, slots=True)
class Springs:
    """N spring-dampers between E ends.

    Attributes
    ----------
    a, b : (N,) int
        Ends; E is the ground.
    stiffness : (N, 6) float
        N/m, then N m/rad; along and about the axes.
    damping : (N, 6) float
        N s/m, then N m s/rad.
    axes : (N, 3, 3) float, optional
        In rows; they turn with b. Default: global.
    """

    a: IntArray
    b: IntArray
    stiffness: FloatArray
    damping: FloatArray
    axes: FloatArray


@dataclass(frozen=True, slots=True)
class Role:
    """What an FMU gives to the coupling and gets from it.

    Attributes
    ----------
    description : Description
    start : mapping of str to float, int, bool or str
        Start values, each of its variable's type.
    inputs, signals : tuple of int
        Value references of its share of the driven inputs and of the signals.
    first_input, first_signal : int
        Where its share begins.
    """

    description: Description
    start: Mapping[str, StartValue]
    inputs: tuple[int, ...]
    signals: tuple[int, ...]
    first_input: int
    first_signal: int


@dataclass(frozen=True, slots=True)
class Ends:
    """Interfaces that springs hold, E of them; −1 stands for a variable that the FMU does not have.

    Attributes
    ----------
    names : tuple of str
        "fmu.interface".
    role : (E,) int
    motion, rates : (E, 6) int
        Signals: displacement and rotation, velocity and angular velocity.
    loads : (E, 6) int
        Driven inputs: force and moment.
    """

    names: tuple[str, ...]
    role: IntArray
    motion: IntArray
    rates: IntArray
    loads: IntArray


@dataclass(frozen=True, slots=True)
class EndResponse:
    """Compliance that an FMU offers between two of its interfaces; −1 stands for what the coupling does not use.

    Attributes
    ----------
    end : int
        That both are, of those that springs hold.
    role : int
    references : (36,) int
        Value references of motion by loads held over a step, row by row.
    places : (18,) int
        Signals: displacement and rotation, velocity and angular velocity; driven inputs: force and moment.
    """

    end: int
    role: int
    references: tuple[int, ...]
    places: IntArray


@dataclass(frozen=True, slots=True)
class Recorded:
    """A variable of the results.

    Attributes
    ----------
    name : str
        "fmu.variable".
    unit : str or None
    role : int
    reference : int
        Value reference.
    type : str
        "Real", "Integer" or "Boolean".
    """

    name: str
    unit: str | None
    role: int
    reference: int
    type: str


@dataclass(frozen=True, slots=True)
class Wiring:
    """A whole coupling, checked.

    Attributes
    ----------
    roles : tuple of Role
    input_names : tuple of str
        The driven inputs, n.
    kind : (n,) int
        Inputs of one number are compared with each other when changes are judged.
    base : (n,) float
        What inputs have apart from tables, connections and springs.
    coupled : (n,) bool
        Inputs that connections or springs feed.
    matrix : (n, signals) float
        Of the connections.
    tables : tuple of ((C,) int, (R, 1 + C) float)
        Places among the driven inputs, and rows of time (s) and values: linear between rows, of rows at one time the
        last counts from then on.
    springs : Springs
    ends : Ends
    responses : tuple of EndResponse
        Of interfaces whose motion the coupling reads to those that it loads.
    recorded : tuple of Recorded
    nominal : (m,) float
        Nominal values of the signals; one where an FMU gives none, as FMI has it.
    """

    roles: tuple[Role, ...]
    input_names: tuple[str, ...]
    kind: IntArray
    base: FloatArray
    coupled: BoolArray
    matrix: FloatArray
    tables: tuple[tuple[IntArray, FloatArray], ...]
    springs: Springs
    ends: Ends
    responses: tuple[EndResponse, ...]
    recorded: tuple[Recorded, ...]
    nominal: FloatArray

    @property
    def input_role(self) -> IntArray:
        """Number (n,) of the role of each driven input."""
        return np.repeat(np.arange(len(self.roles)), [len(role.inputs) for role in self.roles])

    @property
    def signal_role(self) -> IntArray:
        """Number (m,) of the role of each signal."""
        return np.repeat(np.arange(len(self.roles)), [len(role.signals) for role in self.roles])
