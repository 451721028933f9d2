"""An FMU's instance through its library alone, and that of another program's FMU in the process of a `Worker`.

What such an FMU does to its process ends nothing else. Calls come one by one, until the core serves those of the loop
through memory that both sides share. What is imported here is little: each FMU's process waits for it.
"""

import ctypes
import mmap
import pickle
import sys
from contextlib import chdir
from pathlib import Path
from typing import Any

from ..core.structures import enumeration, structures
from ..files.workers import PLATFORM

LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
"""What an FMU logs by: environment, name of the instance, status, category, text."""

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


def _for_c(value: float | str) -> Any:
    if isinstance(value, str):
        return ctypes.c_char_p(value.encode())
    return ctypes.c_double(value) if isinstance(value, float) else ctypes.c_int(value)


class Instance:
    """An instance for co-simulation by FMI 2.0.

    Parameters
    ----------
    logger : function of LOGGER
    library, proxy : str
        Paths: of the FMU's library, and of fmpy's for its log, which knows one logger in a process.
    **given : str
        name, guid, and where the resources are, an address.

    Attributes
    ----------
    component : int
        Its address.
    functions : dict of str to ctypes function
        By the names of core/participant.h; null where it has none.

    Raises
    ------
    OSError
        The library cannot be loaded.
    RuntimeError
        It makes no instance.
    """

    def __init__(self, logger: Any, library: str, proxy: str, **given: str):
        if not Path(library).is_file():
            raise FileNotFoundError(f"it has no library {'/'.join(Path(library).parts[-3:])}")
        # Some look for others beside them.
        with chdir(Path(library).parent):
            self._library = ctypes.CDLL(library)
        system = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)
        self._logger, place = logger, ctypes.c_void_p
        # Of five callbacks these three.
        self._callbacks = (place * 5)(*(ctypes.cast(f, place).value for f in (logger, system.calloc, system.free)))
        ctypes.CDLL(proxy).addLoggerProxy(self._callbacks)
        name, guid, resources = (given[key].encode() for key in ("name", "guid", "resources"))
        make = self._library.fmi2Instantiate
        make.restype = place
        self.component = make(name, 1, guid, resources, self._callbacks, 0, 1)
        if not self.component:
            raise RuntimeError("it makes no instance")
        null = ctypes.CFUNCTYPE(None)(0)
        self.functions = {name: getattr(self._library, f"fmi2{call}", null) for name, call in FUNCTIONS.items()}

    def call(self, name: str, *arguments: Any) -> int:
        """Status of a call of FMI; after that which frees the instance its library is dropped, too.

        Parameters
        ----------
        name : str
            Without "fmi2".
        *arguments : int or float or str
            Numbers; where a variable is set its reference and its value.

        Returns
        -------
        int
        """
        passed: list[Any] = [_for_c(one) for one in arguments]
        if name in ("SetReal", "SetInteger", "SetBoolean", "SetString"):
            passed = [ctypes.byref(passed[0]), ctypes.c_size_t(1), ctypes.byref(passed[1])]
        status = int(getattr(self._library, f"fmi2{name}")(ctypes.c_void_p(self.component), *passed))
        if name == "FreeInstance":
            drop = ctypes.CDLL("kernel32").FreeLibrary if sys.platform == "win32" else ctypes.CDLL(None).dlclose
            drop(ctypes.c_void_p(self._library._handle))
        return status


FAILED, SERVE = "failed", "serve"
_KINDS = structures("participant", "channel")
# Lines of a log that one call may hand on, their length, and bytes that they may take.
_LINES, _LENGTH, _ROOM = 200, 2000, 2**21
_LINES_PLACE = enumeration("channel", "Place")["LINES"]
# FMI 2.0; lesser lines serve nobody.
_WARNING = 1


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
            with path.open("wb") as file:
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
        self._instance: Any = None
        self._logger = LOGGER(self._log)

    def __call__(self, request: tuple[str, tuple[Any, ...], dict[str, str]]) -> tuple[str | int, str]:
        """Status of a call of FMI, or of this class; or why there is none."""
        call, arguments, named = request
        try:
            if call == "Instantiate":
                self._memory = Memory(*arguments)
                self._instance = Instance(self._logger, **named)
            elif call == SERVE:
                self._serve(*arguments)
            else:
                return self._instance.call(call, *arguments), ""
        except Exception as error:  # whatever a library raises is for the one who asked
            return FAILED, f"{type(error).__name__}: {error}"
        return 0, ""

    def _serve(self, path: str) -> None:
        """Let the core's library answer, which the other side has checked."""
        core, place = ctypes.CDLL(path), ctypes.c_void_p
        core.fmi2FlexfmuCall.restype = place
        serve = ctypes.CFUNCTYPE(None, place, place)(core.fmi2FlexfmuCall(b"channel_serve"))
        functions = {name: ctypes.cast(f, place).value for name, f in self._instance.functions.items()}
        one = _KINDS["Participant"](instance=self._instance.component, **functions)
        serve(ctypes.byref(channel(self._memory, self._ends)), ctypes.byref(one))

    def _log(self, _: object, instance: bytes | None, status: int, category: bytes | None, text: bytes | None) -> None:
        if status >= _WARNING and instance and text:
            # Here a line without a category says more than nothing.
            self._memory.write((instance[:_LENGTH], status, (category or b"log")[:_LENGTH], text[:_LENGTH]))
