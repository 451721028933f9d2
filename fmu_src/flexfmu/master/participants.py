"""An FMU at work: its start, the functions by which the core's loop drives it, its end and log."""

import ctypes
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import fmpy
from fmpy.logging import logging as proxy

from ..files.basics import SimulationError
from ..files.inputs import check_unpacked
from ..fmu.instance import Instance
from .foreign import HAND_ON, START, ForeignSlave, Log
from .layout import Role

# Of flexfmu's bodies: what tells masters that overlook a discarded step; how many internal steps a step took; and the
# parameter, set between steps, that says how many it takes at least.
STATUS_CODE, _SUBSTEPS, _FEWEST = "status.code", "diagnostics.substeps", "internal_step.fewest"
# FMI 2.0: the greatest status of a call that is honoured; the one after which nothing may be called.
_WARNING, _FATAL = 1, 4

_TAKE_BACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


# Folders of an archive that do not serve an FMU at work; of the libraries this machine's do.
_IDLE = ("binaries/", "sources/", "documentation/")


def _needed(name: str) -> bool:
    """Whether a file of an archive serves an FMU at work."""
    return name.startswith(f"binaries/{fmpy.platform}/") or not name.startswith(_IDLE)


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
        with self._loading():
            check_unpacked(role.description.file)
            fmpy.extract(str(role.description.file), self._folder, _needed)
            identifier = role.description.model_identifier
            construction = {
                "library": str(Path(self._folder, "binaries", fmpy.platform, identifier + fmpy.sharedLibraryExtension)),
                "proxy": proxy._name,
                "resources": Path(self._folder, "resources").as_uri(),
                "guid": role.description.guid,
                "name": self.name,
            }
            if role.description.own:
                self._slave = Instance(HAND_ON, **construction)
            else:
                self._slave = ForeignSlave(self.name, timeout)
                path = Path(self._folder, "flexfmu.shared")
                self._slave.start(path, len(role.description.variables), **construction)
        self.functions = dict(self._slave.functions) if role.description.own else {}
        self.functions["take_back"] = _TAKE_BACK(lambda _: self._log.take_back())
        self.instance = self._slave.component if role.description.own else None
        self.bookkeeping = self._bookkeeping()

    @contextmanager
    def _loading(self) -> Iterator[None]:
        """Say whose start failed, and free what there is of it."""
        try:
            yield
        except Exception as error:  # whatever a library raises
            self.close()
            raise SimulationError(
                f"fmu {self.name!r} ({self.role.description.file}) cannot be loaded: {self._log.quoted or error}"
            ) from error

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
        if isinstance(self._slave, ForeignSlave):
            with self._loading():
                self._slave.answered(START)
        calls: list[tuple[Any, ...]] = []
        for name, value in self.role.start.items():
            variable = self.role.description.variables[name]
            kind = "Integer" if variable.type == "Enumeration" else variable.type
            calls.append((f"Set{kind}", int(variable.valueReference), value))
        for call in (*calls, ("SetupExperiment", 0, 0.0, 0.0, 1, float(stop)), ("EnterInitializationMode",)):
            status = self._slave.call(*call)
            if status > _WARNING:
                raise self.failed("its start", status)

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
            with suppress(SimulationError):
                self._slave.call("Terminate")
        return list(self._log.warnings)

    def close(self) -> None:
        """Free the instance and remove what was unpacked."""
        if self._slave is not None and self.usable:
            # A process that has ended has nothing left to free.
            with suppress(SimulationError):
                self._slave.call("FreeInstance")
        if isinstance(self._slave, ForeignSlave):
            self._slave.worker.close()
        self._slave = None
        shutil.rmtree(self._folder, ignore_errors=True)
