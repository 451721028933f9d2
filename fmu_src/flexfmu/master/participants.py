"""An FMU at work: its start, the functions by which the core's loop drives it, its end and log."""

import ctypes
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from ..files.errors import SimulationError
from ..files.inputs import check_unpacked
from ..fmu.foreign_host import callbacks, functions_of
from .foreign import LOGGER, ForeignSlave, Log
from .layout import Role

# Of flexfmu's bodies: what tells masters that overlook a discarded step; how many internal steps a step took; and the
# parameter, set between steps, that says how many it takes at least.
STATUS_CODE, _SUBSTEPS, _FEWEST = "status.code", "diagnostics.substeps", "internal_step.fewest"
# FMI 2.0: after this status nothing may be called.
_FATAL = 4

_TAKE_BACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


class StepRefusedError(SimulationError):
    """An FMU discarded a step; its state is as it was before."""


def _needed(name: str) -> bool:
    """Whether a file of an archive serves an FMU at work."""
    return not name.startswith(("sources/", "documentation/"))


class Participant:
    """An FMU's instance in a coupling.

    Parameters
    ----------
    role : Role
    timeout : float
        s that a call to an FMU of another program may take.

    Attributes
    ----------
    instance : int or None
        FMI's component.
    functions : dict of str to ctypes function
        By the members of core/participant.h.
    bookkeeping : dict of str to float
        Further fields of core/participant.h.
    marks : (2,) int
        What the loop and the log tell each other.
    usable : bool
        Whether it may be called.

    Raises
    ------
    SimulationError
        The archive cannot be unpacked, or its library not loaded here.
    """

    def __init__(self, role: Role, timeout: float):
        self.role = role
        self.name = role.description.name
        self.usable = True
        self._slave: Any = None
        self._log = Log(self.name)
        self.marks = self._log.marks
        self._folder = tempfile.mkdtemp(prefix="flexfmu-")
        try:
            check_unpacked(role.description.file)
            fmpy.extract(str(role.description.file), self._folder, _needed)
            construction = {
                "guid": role.description.guid,
                "unzipDirectory": self._folder,
                "modelIdentifier": role.description.model_identifier,
                "instanceName": self.name,
            }
            self.functions = {}
            if role.description.own:
                slave = FMU2Slave(**construction)
                self._callbacks = callbacks(LOGGER)
                slave.instantiate(callbacks=self._callbacks, loggingOn=True)
                self._slave, self.functions = slave, functions_of(slave)
            else:
                self._slave = ForeignSlave(self.name, timeout)
                path = Path(self._folder, "flexfmu.shared")
                self._slave.instantiate(path, len(role.description.variables), **construction)
        except Exception as error:  # fmpy raises bare exceptions
            self.close()
            raise SimulationError(
                f"fmu {self.name!r} ({role.description.file}) cannot be loaded: {self._log.quoted or error}"
            ) from error
        self.functions["take_back"] = _TAKE_BACK(lambda _: self._log.take_back())
        self.instance = self._slave.component if role.description.own else None
        self.bookkeeping = self._bookkeeping()

    def _bookkeeping(self) -> dict[str, float]:
        """References of what flexfmu's bodies tell, −1 where an FMU has it not."""
        variables = self.role.description.variables
        status = STATUS_CODE in variables and variables[STATUS_CODE].type == "Integer"
        held = _SUBSTEPS in variables and _FEWEST in variables and variables[_FEWEST].variability == "tunable"
        return {
            "status": int(variables[STATUS_CODE].valueReference) if status else -1,
            "substeps": int(variables[_SUBSTEPS].valueReference) if held else -1,
            "fewest": int(variables[_FEWEST].valueReference) if held else -1,
            "fewest_start": float(self.role.start.get(_FEWEST, 1.0)),
        }

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
        try:
            for name, value in self.role.start.items():
                variable = self.role.description.variables[name]
                kind = "Integer" if variable.type == "Enumeration" else variable.type
                getattr(self._slave, f"set{kind}")([variable.valueReference], [value])
            self._slave.setupExperiment(startTime=0.0, stopTime=stop)
            self._slave.enterInitializationMode()
        except FMICallException as error:
            raise self.failed("its start", error.status) from error

    def join(self, place: Any) -> None:
        """Let the core's loop call it by a structure of core/participant.h, where it runs in another process."""
        if isinstance(self._slave, ForeignSlave):
            self._slave.join(place)

    @property
    def said(self) -> str:
        """Why it refused its last call, in its own words; empty where it said nothing."""
        return self._log.quoted

    @property
    def raised(self) -> BaseException | None:
        """What ended the call to an FMU of another program, beside FMI."""
        return self._slave.raised if isinstance(self._slave, ForeignSlave) else None

    def failed(self, call: str, status: int) -> SimulationError:
        """The error of a call that the FMU does not honour.

        Parameters
        ----------
        call : str
            As in "fmu NAME failed CALL".
        status : int
            FMI's.

        Returns
        -------
        SimulationError
        """
        self.usable = status < _FATAL
        return SimulationError(f"fmu {self.name!r} failed {call}: {self.said or f'status {status} of FMI 2.0'}")

    def ended(self) -> list[str]:
        """End the run, and say what the FMU warned of, each once.

        Returns
        -------
        list of str
        """
        if self.usable:
            with suppress(SimulationError, FMICallException):
                self._slave.terminate()
        return list(self._log.warnings)

    def close(self) -> None:
        """Free the instance and remove what was unpacked."""
        if self._slave is not None and self.usable:
            # A process that has ended has nothing left to free.
            with suppress(SimulationError):
                self._slave.freeInstance()
        if isinstance(self._slave, ForeignSlave):
            self._slave.worker.close()
        self._slave = None
        shutil.rmtree(self._folder, ignore_errors=True)
