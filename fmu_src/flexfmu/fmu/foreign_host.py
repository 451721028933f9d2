"""An FMU of another program in the process of a `files.workers.Worker`: what it does to it ends nothing else.

Calls come one by one, until the core serves those of the loop through memory that both sides share. What is imported
here is little: each FMU's process waits for it.
"""

import ctypes
import mmap
import pickle
from pathlib import Path
from typing import Any

from ..core.structures import enumeration, structures
from ..files.workers import PLATFORM
from .instance import LOGGER, Instance

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
