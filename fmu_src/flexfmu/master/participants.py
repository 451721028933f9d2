"""An FMU at work, by fmpy: its life cycle, values, steps, saved states and log."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from ctypes import byref
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    calloc,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    free,
)
from fmpy.logging import addLoggerProxy

from ..files.array_types import FloatArray
from ..files.errors import SimulationError
from ..files.inputs import check_unpacked
from .foreign import ForeignProcess, ForeignSlave
from .layout import Recorded, Role
from .log import LOGGER, forget_refusals, open_log, quoted, take_back_warnings, warnings_of

# Of flexfmu's bodies: what tells masters that overlook a discarded step, and its value then.
STATUS_CODE, _FAILED = "status.code", 1
# And how many internal steps a step took, and the parameter, set between steps, that says how many it takes at least.
_SUBSTEPS, _FEWEST = "diagnostics.substeps", "internal_step.fewest"
# FMI 2.0 statuses: a call that was not honoured, and one after which nothing may be called.
_DISCARD, _FATAL = 2, 4


class StepRefusedError(SimulationError):
    """An FMU discarded a step; its state is as it was before."""


def _callbacks() -> fmi2CallbackFunctions:
    """What an FMU in this process may call."""
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = LOGGER
    callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
    callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
    addLoggerProxy(byref(callbacks))
    return callbacks


class Participant:
    """An FMU's instance in a coupling.

    Parameters
    ----------
    role : Role
    foreign : ForeignProcess
        Where FMUs of other programs run.

    Attributes
    ----------
    substeps : int
        Internal steps that the last try of a step took, where the FMU tells of them.

    Raises
    ------
    SimulationError
        The archive cannot be unpacked, or its library not loaded here.
    """

    def __init__(self, role: Role, foreign: ForeignProcess):
        self.role = role
        self.name = role.description.name
        self._usable = True
        self._state: Any = None
        self._warned: dict[str, None] = {}
        self._slave: Any = None
        variables = role.description.variables
        count, fewest = variables.get(_SUBSTEPS), variables.get(_FEWEST)
        self._internal: tuple[int, int] | None = None
        if count is not None and fewest is not None and fewest.variability == "tunable":
            self._internal = int(count.valueReference), int(fewest.valueReference)
        self.substeps = 1
        open_log(self.name)
        self._folder = tempfile.mkdtemp(prefix="flexfmu-")
        try:
            check_unpacked(role.description.file)
            fmpy.extract(str(role.description.file), self._folder)
            construction = {
                "guid": role.description.guid,
                "unzipDirectory": self._folder,
                "modelIdentifier": role.description.model_identifier,
                "instanceName": self.name,
            }
            if role.description.own:
                slave = FMU2Slave(**construction)
                self._callbacks = _callbacks()
                slave.instantiate(callbacks=self._callbacks, loggingOn=True)
                self._slave = slave
            else:
                self._slave = ForeignSlave(foreign, self.name, **construction)
        except Exception as error:  # fmpy raises bare exceptions
            self.close()
            raise SimulationError(
                f"fmu {self.name!r} ({role.description.file}) cannot be loaded: {quoted(self.name) or error}"
            ) from error

    def initialize(self, stop: float) -> None:
        """Set the start values and enter the initialisation.

        Parameters
        ----------
        stop : float
            End of the experiment, s.

        Raises
        ------
        SimulationError
            The FMU fails a call.
        """
        with self._honours("its start"):
            for name, value in self.role.start.items():
                variable = self.role.description.variables[name]
                kind = "Integer" if variable.type == "Enumeration" else variable.type
                getattr(self._slave, f"set{kind}")([variable.valueReference], [value])
            self._slave.setupExperiment(startTime=0.0, stopTime=stop)
            self._slave.enterInitializationMode()

    def begin(self) -> None:
        """End the initialisation.

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        with self._honours("its start"):
            self._slave.exitInitializationMode()

    def set_inputs(self, values: FloatArray) -> None:
        """Set its share of the driven inputs.

        Parameters
        ----------
        values : (inputs,) float

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        if self.role.inputs:
            with self._honours("to take its inputs"):
                self._slave.setReal(self.role.inputs, values.tolist())

    def signals(self) -> FloatArray:
        """Its share of the signals.

        Returns
        -------
        (signals,) float

        Raises
        ------
        SimulationError
            The FMU fails the call, or a value is not finite.
        """
        values = self.reals(self.role.signals)
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            reference = self.role.signals[int(wrong[0])]
            name = next(v.name for v in self.role.description.variables.values() if v.valueReference == reference)
            raise SimulationError(
                f"fmu {self.name!r}: {name} is {values[wrong[0]]}, expected a finite value. A coupling that grows "
                "without bound ends so: take a shorter step, or the iterated scheme"
            )
        return values

    def reals(self, references: Sequence[int]) -> FloatArray:
        """Values of Real variables.

        Parameters
        ----------
        references : sequence of int

        Returns
        -------
        (references,) float

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        return np.array(self._values("Real", references), dtype=np.float64)

    def recorded(self, variables: Sequence[Recorded]) -> list[float]:
        """Values for the results.

        Parameters
        ----------
        variables : sequence of Recorded
            All of this FMU.

        Returns
        -------
        list of float
            In the order of `variables`.

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        found: dict[int, float] = {}
        for kind in ("Real", "Integer", "Boolean"):
            places = [k for k, variable in enumerate(variables) if variable.type == kind]
            values = self._values(kind, [variables[k].reference for k in places])
            found |= {k: float(value) for k, value in zip(places, values, strict=True)}
        return [found[k] for k in range(len(variables))]

    def step(self, time: float, size: float) -> None:
        """Advance by a communication step.

        Parameters
        ----------
        time, size : float
            s.

        Raises
        ------
        StepRefusedError
            The FMU discards the step.
        SimulationError
            The FMU fails the call.
        """
        # A step that may be repeated must leave what lies before it within reach.
        final = self._state is None
        forget_refusals(self.name)
        where = f"the step from {time:.9g} s by {size:g} s"
        with self._honours(where):
            try:
                self._slave.doStep(time, size, final)
            except FMICallException as error:
                if error.status != _DISCARD:
                    raise
                words = quoted(self.name) or "without a reason in its log"
                raise StepRefusedError(f"fmu {self.name!r} refused {where}: {words}") from error
        if self._internal is not None and not final:
            self.substeps = int(self._values("Integer", [self._internal[0]])[0])

    def status(self) -> int:
        """What the FMU's own status.code tells: 0, sound, also where it has none.

        Returns
        -------
        int

        Raises
        ------
        SimulationError
            The FMU fails the call, or the code tells of a failure.
        """
        variable = self.role.description.variables.get(STATUS_CODE)
        if variable is None or variable.type != "Integer":
            return 0
        code = int(self._values("Integer", [int(variable.valueReference)])[0])
        if code == _FAILED:
            raise SimulationError(
                f"fmu {self.name!r}: status.code is {code}, a failure: {quoted(self.name) or 'no log'}"
            )
        return code

    def save(self) -> None:
        """Keep the state of now, to come back to.

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        self.forget()
        with self._honours("to save its state"):
            self._state = self._slave.getFMUstate()
            self._warned = warnings_of(self.name)

    def restore(self) -> None:
        """Go back to the state kept.

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        with self._honours("to go back to its state"):
            self._slave.setFMUstate(self._state)
            take_back_warnings(self.name, self._warned)

    def hold_substeps(self) -> None:
        """Let the step that is repeated take no fewer internal steps than its last try.

        Otherwise the answer would jump by the error of an internal step where one try takes more of them than another.

        Raises
        ------
        SimulationError
            The FMU fails the call.
        """
        if self._internal is not None and self.substeps > 1:
            with self._honours("to hold its internal steps"):
                self._slave.setReal([self._internal[1]], [float(self.substeps)])

    def forget(self) -> None:
        """Drop the state kept, if any; the next step takes as many internal steps as it wants."""
        if self._state is not None:
            state, self._state = self._state, None
            with suppress(FMICallException):
                self._slave.freeFMUstate(state)
                if self._internal is not None and self.substeps > 1:
                    self._slave.setReal([self._internal[1]], [float(self.role.start.get(_FEWEST, 1.0))])
        self.substeps = 1

    def warnings(self) -> list[str]:
        """What the FMU warned of so far, each once.

        Returns
        -------
        list of str
        """
        return list(warnings_of(self.name))

    def close(self) -> None:
        """End and free the instance and remove what was unpacked."""
        if self._slave is not None and self._usable:
            # A process that has ended has nothing left to free.
            with suppress(SimulationError):
                self.forget()
                with suppress(FMICallException):
                    self._slave.terminate()
                self._slave.freeInstance()
        self._slave = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def _values(self, kind: str, references: Sequence[int]) -> list[Any]:
        if not references:
            return []
        with self._honours("to give its values"):
            values: list[Any] = getattr(self._slave, f"get{kind}")(list(references))
        return values

    @contextmanager
    def _honours(self, call: str) -> Iterator[None]:
        """Make an error of a call that the FMU does not honour: "fmu NAME failed to CALL"."""
        try:
            yield
        except FMICallException as error:
            self._usable = error.status < _FATAL
            raise SimulationError(f"fmu {self.name!r} failed {call}: {quoted(self.name) or error}") from error
