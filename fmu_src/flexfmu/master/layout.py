"""A coupling as arrays: what every FMU gives and gets, connections, springs' ends, tables and what is recorded.

All outputs that the coupling needs make one vector of signals, all inputs that it drives another: FMU by FMU in the
order listed. The connections are a matrix from the one to the other; springs read and write places in them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..files.array_types import BoolArray, FloatArray, IntArray
from .config import StartValue
from .descriptions import Description


@dataclass(frozen=True, slots=True)
class SignalTable:
    """Inputs over time: linear between rows, of rows at one time the last counts from then on.

    Attributes
    ----------
    time : (R,) float
        s.
    values : (R, C) float
    inputs : (C,) int
        Places among the driven inputs.
    """

    time: FloatArray
    values: FloatArray
    inputs: IntArray


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
    axes: FloatArray | None = None


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

    @property
    def input_share(self) -> slice:
        """Its share of the driven inputs."""
        return slice(self.first_input, self.first_input + len(self.inputs))

    @property
    def signal_share(self) -> slice:
        """Its share of the signals."""
        return slice(self.first_signal, self.first_signal + len(self.signals))


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
    moved, loaded : str
        Interfaces of the same FMU, "fmu.interface".
    role : int
    references : (36,) int
        Value references of motion by loads held over a step, row by row.
    motion, rates : (6,) int
        Signals: displacement and rotation, velocity and angular velocity.
    loads : (6,) int
        Driven inputs: force and moment.
    """

    moved: str
    loaded: str
    role: int
    references: tuple[int, ...]
    motion: IntArray
    rates: IntArray
    loads: IntArray


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
    tables : tuple of SignalTable
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
    tables: tuple[SignalTable, ...]
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
