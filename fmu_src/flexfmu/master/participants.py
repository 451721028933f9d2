"""An FMU at work: its start, and the functions by which the core's loop calls it, here or in a process of its own."""

import ctypes
import shutil
import tempfile
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from weakref import WeakSet

import fmpy
import numpy as np
from fmpy.logging import logging as proxy

from ..core.library import library
from ..files.basics import SimulationError
from ..files.tables import check_unpacked
from ..files.workers import Worker, WorkerError
from ..fmu.foreign_host import FAILED, FUNCTIONS, LOGGER, SERVE, Host, Instance, Memory, channel
from .layout import Role

# FMI 2.0: the greatest status of a call that is honoured, the next, and the one after which nothing may be called.
_WARNING, _DISCARD, _FATAL = 1, 2, 4
# Lines that a message quotes, and warnings that are handed on.
_QUOTED, _HANDED_ON = 3, 20

_logs: dict[str, "Log"] = {}


class Log:
    """What an instance said.

    Parameters
    ----------
    name : str
        Of the instance.

    Attributes
    ----------
    marks : (2,) int
        The loop counts tries of steps in the first, and clears the second when it keeps a state.
    warnings : dict with str keys
        What it warned of so far, each once.
    """

    def __init__(self, name: str):
        self._name, self._refusals, self._refused_at = name, deque[str](maxlen=_QUOTED), 0
        self.marks = np.zeros(2, dtype=np.int64)
        self.warnings: dict[str, None] = {}
        self._kept: dict[str, None] = {}
        _logs[name] = self

    @property
    def quoted(self) -> str:
        """The last lines in which it said why it refused a call, since its last try of a step began; "" for none."""
        return "; ".join(dict.fromkeys(self._refusals)) if self._refused_at == self.marks[0] else ""

    def take_back(self) -> None:
        """Go back to the warnings before the state was kept: what a step taken back warned of did not happen."""
        self.warnings = dict(self._kept)

    def add(self, status: int, text: str) -> None:
        """Take a line.

        Parameters
        ----------
        status : int
            FMI's.
        text : str
        """
        words = text.removeprefix(f"{self._name}: ")
        if status >= _DISCARD:
            if self._refused_at != self.marks[0]:
                self._refusals.clear()
                self._refused_at = int(self.marks[0])
            self._refusals.append(words)
        elif status == _WARNING and len(self.warnings) < _HANDED_ON:
            if not self.marks[1]:
                self._kept = dict(self.warnings)
                self.marks[1] = 1
            self.warnings[words] = None


def hand_on(instance: bytes | None, status: int, category: bytes | None, text: bytes | None) -> None:
    """Take a line of a log.

    Parameters
    ----------
    instance : bytes or None
        Its name.
    status : int
        FMI's.
    category, text : bytes or None
    """
    # Lines without a category are the library's own, and say only which call failed.
    name = (instance or b"").decode(errors="replace")
    if category and text and name in _logs:
        _logs[name].add(status, text.decode(errors="replace"))


HAND_ON = LOGGER(lambda _, *line: hand_on(*line))
"""fmpy's proxy knows one logger in a process: this one tells by the instance's name whose line it is."""


# What a call that waits for the next was to do, as in "fmu NAME failed …".
_LATER = {"SetReal": "to take its inputs", "GetFMUstate": "to save its state", "SetFMUstate": "to go back to its state"}
_CALLS = tuple(FUNCTIONS.values())
# Words that calls take beside those of an FMU's variables; at most s between two looks at the clock.
_WORDS, _LOOK = 2**14, 0.1
_joined: "WeakSet[ForeignSlave]" = WeakSet()
_HEAR = ctypes.CFUNCTYPE(None, ctypes.c_int64)
START = "Instantiate"


class ForeignSlave:
    """An FMU in a process of its own, with the calls of `fmu.foreign_host.Instance`, and those of the core's loop.

    Parameters
    ----------
    name : str
        Of the instance.
    timeout : float
        s that a call may take.

    Attributes
    ----------
    worker : Worker
        The process.
    """

    def __init__(self, name: str, timeout: float):
        self.worker = Worker(f"{Host.__module__}:{Host.__name__}")
        self._name, self._timeout, self._over = name, timeout, False
        self._memory: Any = None
        # Where the core serves: this side of the channel, and whether it is to end; what ended it beside FMI.
        self._channel: Any = None
        self._done, self._late = threading.Event(), False
        self._raised: BaseException | None = None

    def start(self, path: Path, variables: int, **construction: str) -> None:
        """Have the instance made there, which takes its time; `answered` waits for it.

        Parameters
        ----------
        path : Path
            Of a file for the memory that both sides share.
        variables : int
            Of the FMU: so many may travel at once.
        **construction : str
            Arguments of `Instance`.
        """
        self._memory = Memory(path, 4 * (_WORDS + 4 * variables))
        self.worker.send((START, (path,), construction))

    def call(self, name: str, *arguments: Any) -> int:
        """Status of a call there."""
        self._end_loop(name)
        self.worker.send((name, arguments, {}))
        return self.answered(name)

    def join(self, participant: Any) -> None:
        """Let the core's loop call it.

        Parameters
        ----------
        participant : structure
            Of core/participant.h.
        """
        hearing = self._hearing()
        next(hearing)
        self._hear = _HEAR(hearing.send)
        self._channel = channel(self._memory, self.worker.ends, hear=ctypes.cast(self._hear, ctypes.c_void_p).value)
        _joined.add(self)
        library().channel_join(ctypes.byref(self._channel), ctypes.byref(participant))
        self.worker.send((SERVE, (library()._name,), {}))
        threading.Thread(target=self._watch, daemon=True).start()

    @property
    def raised(self) -> BaseException | None:
        """What ended a call of the loop, beside FMI."""
        found = self._channel
        if self._raised or found is None:
            return self._raised
        if found.gone:
            self._raised = self._ended(_CALLS[found.called])
        elif found.failed:
            call = _CALLS[found.failed - 1]
            why = _logs[self._name].quoted or f"status {self._memory.words[5]} of FMI 2.0"
            self._raised = SimulationError(f"fmu {self._name!r} failed {_LATER.get(call, f'fmi2{call}')}: {why}")
        return self._raised

    def _end_loop(self, call: str) -> None:
        """Take the process back from the core's loop, before a call."""
        if self._channel is not None and not self._done.is_set():
            library().channel_leave(ctypes.byref(self._channel))
            self._done.set()
            self._over |= bool(self._channel.gone)
            if not self._over:
                self._answer(call)
        if self._over:
            raise SimulationError(f"fmu {self._name!r}: its process has ended before fmi2{call}")

    def answered(self, call: str) -> int:
        """Wait for the end of a call that was sent: its status.

        Parameters
        ----------
        call : str
            As FMI has it, without "fmi2".

        Returns
        -------
        int

        Raises
        ------
        SimulationError
            It raises an error, ends its process, or does not answer in time.
        """
        status, wrong = self._answer(call)
        for line in self._memory.read():
            hand_on(*line)
        if status == FAILED:
            raise SimulationError(f"fmu {self._name!r} failed fmi2{call}: {wrong}")
        return int(status)

    def _answer(self, call: str) -> Any:
        try:
            return self.worker.answer(self._timeout)
        except WorkerError as error:
            self._over, self._late = True, not error.ending
            raise self._ended(call, error.ending) from None

    def _ended(self, call: str, ending: str = "") -> SimulationError:
        """Why its process ended, in words."""
        self._over = True
        if not self._late:
            ending = ending or self.worker.ending()
            return SimulationError(f"fmu {self._name!r} ended its process in fmi2{call}: {ending}")
        found = f"fmu {self._name!r} did not come back from fmi2{call} within {self._timeout:g} s and was ended"
        return SimulationError(f"{found}: give it longer by experiment.timeout, or look into the FMU")

    def _hearing(self) -> Generator[None, int, None]:
        """Take what was logged, each time; without lines a signal came.

        A generator, since Ctrl-C rises as soon as Python runs: here within the `try`.
        """
        while True:
            try:
                lines = yield
                for line in self._memory.read() if lines else ():
                    hand_on(*line)
            except GeneratorExit:
                return
            except BaseException as error:  # C knows no exceptions: whoever called it raises this one
                # Others may be amid a step, too.
                for one in _joined:
                    one._raised = error
                    one.worker.kill()

    def _watch(self) -> None:
        """End the process where a call takes too long."""
        asked, since = -1, time.monotonic()
        while not self._done.wait(min(_LOOK, self._timeout / 4)):
            now, before = time.monotonic(), asked
            asked = self._memory.words[0] if self._channel.waiting else -1
            if asked < 0 or asked != before:
                since = now
            elif now - since > self._timeout:
                self._late = True
                self.worker.kill()
                return


# Of flexfmu's bodies: what tells masters that overlook a discarded step; how many internal steps a step took; and the
# parameter, set between steps, that says how many it takes at least.
STATUS_CODE, _SUBSTEPS, _FEWEST = "status.code", "diagnostics.substeps", "internal_step.fewest"

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
                self._slave.start(Path(self._folder, "flexfmu.shared"), len(role.description.variables), **construction)
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
            found = f"fmu {self.name!r} ({self.role.description.file})"
            raise SimulationError(f"{found} cannot be loaded: {self._log.quoted or error}") from error

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
