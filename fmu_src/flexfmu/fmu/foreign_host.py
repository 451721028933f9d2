"""An FMU of another program in the process of a `files.workers.Worker`: what it does to it ends nothing else.

Calls come one by one as fmpy's, until the core serves those of the loop through memory that both sides share.
"""

import ctypes
import mmap
import pickle
from pathlib import Path
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    calloc,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    free,
)
from fmpy.logging import addLoggerProxy

from ..core.library import library
from ..core.structures import enumeration, structures
from ..files.workers import PLATFORM

DONE, REFUSED, FAILED, SERVE = "done", "refused", "failed", "serve"
_KINDS = structures("participant", "channel")
# Lines of a log that one call may hand on, their length, and bytes that they may take.
_LINES, _LENGTH, _ROOM = 200, 2000, 2**21
_LINES_PLACE = enumeration("channel", "Place")["LINES"]
# FMI 2.0; lesser lines serve nobody.
_WARNING = 1

FUNCTIONS = {
    "set_real": "SetReal",
    "get_real": "GetReal",
    "get_integer": "GetInteger",
    "get_boolean": "GetBoolean",
    "end_initialization": "ExitInitializationMode",
    "do_step": "DoStep",
    "get_state": "GetFMUstate",
    "set_state": "SetFMUstate",
    "free_state": "FreeFMUstate",
}
"""Those of FMI that the core's loop calls, by the names of core/participant.h, in the order of core/channel.h."""


def functions_of(slave: Any) -> dict[str, Any]:
    """Functions of an FMU's library by the names of core/participant.h; null where it has none.

    Parameters
    ----------
    slave : FMU2Slave

    Returns
    -------
    dict of str to ctypes function
    """
    return {name: getattr(slave.dll, f"fmi2{call}", ctypes.CFUNCTYPE(None)(0)) for name, call in FUNCTIONS.items()}


def callbacks(logger: Any) -> Any:
    """What an FMU may call.

    Parameters
    ----------
    logger : fmi2CallbackLoggerTYPE

    Returns
    -------
    Structure
    """
    found = fmi2CallbackFunctions(logger, fmi2CallbackAllocateMemoryTYPE(calloc), fmi2CallbackFreeMemoryTYPE(free))
    addLoggerProxy(ctypes.byref(found))
    return found


class Memory:
    """What both sides share: words of the core's channel, then lines of a log.

    Parameters
    ----------
    path : Path
        A file of it.
    words : int
        Of 64 bits; the file is made. 0: it is there.
    """

    def __init__(self, path: Path, words: int = 0):
        if words:
            path.write_bytes(b"")
            with path.open("r+b") as file:
                file.truncate(8 * words + _ROOM)
        with path.open("r+b") as file:
            self._bytes = mmap.mmap(file.fileno(), 0)
        self._lines = 8 * ((len(self._bytes) - _ROOM) // 8)
        self.words = (ctypes.c_int64 * (self._lines // 8)).from_buffer(self._bytes)

    def write(self, line: tuple[Any, ...]) -> None:
        """Add a line, of so many that a call may log."""
        if self.words[_LINES_PLACE] == 0:
            self._bytes.seek(self._lines)
        if self.words[_LINES_PLACE] < _LINES:
            self._bytes.write(pickle.dumps(line))
            self.words[_LINES_PLACE] += 1

    def read(self) -> list[tuple[Any, ...]]:
        """Lines since the last call."""
        self._bytes.seek(self._lines)
        count, self.words[_LINES_PLACE] = self.words[_LINES_PLACE], 0
        return [pickle.load(self._bytes) for _ in range(count)]


def channel(memory: Memory, ends: tuple[int, ...], **more: Any) -> Any:
    """One side of a channel, as of core/channel.h.

    Parameters
    ----------
    memory : Memory
    ends : tuple of int
        Of pipes, to read and to write.
    **more
        Further members.

    Returns
    -------
    Structure
    """
    library, names = ("ucrtbase", ("_read", "_write")) if PLATFORM == "win32" else (None, ("read", "write"))
    calls = (ctypes.cast(getattr(ctypes.CDLL(library), name), ctypes.c_void_p).value for name in names)
    place = {"shared": ctypes.addressof(memory.words), "words": len(memory.words)}
    return _KINDS["Channel"](*calls, **more, **dict(zip(("from", "to"), ends, strict=True)), **place)


class Host:
    """The FMU, and what it logs.

    Parameters
    ----------
    *ends : int
        Of pipes.
    """

    def __init__(self, *ends: int):
        self._ends = ends
        self._memory: Any = None
        self._slave: Any = None
        self._callbacks = callbacks(fmi2CallbackLoggerTYPE(self._log))

    def __call__(self, request: tuple[str, tuple[Any, ...], dict[str, Any]]) -> tuple[Any, ...]:
        """Have the FMU carry out a call of fmpy's `FMU2Slave`."""
        call, arguments, named = request
        try:
            if call == "instantiate":
                self._memory, self._slave = Memory(*arguments), FMU2Slave(**named)
                self._slave.instantiate(callbacks=self._callbacks, loggingOn=True)
            elif call == SERVE:
                self._serve()
            else:
                getattr(self._slave, call)(*arguments, **named)
        except FMICallException as error:
            return REFUSED, (error.function, error.status)
        except Exception as error:  # whatever a library raises is for the one who asked
            return FAILED, f"{type(error).__name__}: {error}"
        return DONE, None

    def _serve(self) -> None:
        """Let the core answer."""
        functions = {n: ctypes.cast(f, ctypes.c_void_p).value for n, f in functions_of(self._slave).items()}
        one = _KINDS["Participant"](instance=self._slave.component, **functions)
        library().channel_serve(ctypes.byref(channel(self._memory, self._ends)), ctypes.byref(one))

    def _log(self, _: object, instance: bytes | None, status: int, category: bytes | None, text: bytes | None) -> None:
        if status >= _WARNING and instance and text:
            # Here a line without a category says more than nothing.
            self._memory.write((instance[:_LENGTH], status, (category or b"log")[:_LENGTH], text[:_LENGTH]))
