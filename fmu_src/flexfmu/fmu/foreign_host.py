"""FMUs of other programs, carried out in the process of a `files.workers.Worker`: what they do to it ends nothing else.

It takes several calls at once, and answers with what came of them and the lines that the FMU logged meanwhile.
"""

from ctypes import byref
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

DONE, REFUSED, FAILED = "done", "refused", "failed"
# Lines of a log that one call may hand on, and their length.
_LINES, _LENGTH = 200, 2000


class Host:
    """FMUs by name, their saved states, and what they logged since the last answer."""

    def __init__(self) -> None:
        self._slaves: dict[str, Any] = {}
        self._states: dict[str, Any] = {}
        self.lines: list[tuple[bytes | None, int, bytes | None, bytes | None]] = []
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(self._callbacks))

    def __call__(self, request: tuple[str, list[tuple[str, tuple[Any, ...], dict[str, Any]]]]) -> tuple[Any, ...]:
        """Carry out calls one after the other, as far as they are honoured."""
        name, calls = request
        values: list[Any] = []
        self.lines = []
        try:
            # One after the other, so that those before an error stay.
            values.extend(self._carried_out(name, *call) for call in calls)
        except FMICallException as error:
            return REFUSED, values, (error.function, error.status), self.lines
        except Exception as error:  # whatever a library raises is for the one who asked
            return FAILED, values, f"{type(error).__name__}: {error}", self.lines
        return DONE, values, None, self.lines

    def _carried_out(self, name: str, call: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """Have an FMU carry out a call."""
        if call == "instantiate":
            self._slaves[name] = FMU2Slave(**named)
            return self._slaves[name].instantiate(callbacks=self._callbacks, loggingOn=True)
        slave = self._slaves[name]
        # Of each FMU one state is kept, here.
        if call == "getFMUstate":
            self._states[name] = slave.getFMUstate()
            return None
        if call in ("setFMUstate", "freeFMUstate"):
            return getattr(slave, call)(self._states[name])
        return getattr(slave, call)(*arguments, **named)

    def _log(self, _: object, instance: bytes | None, status: int, category: bytes | None, text: bytes | None) -> None:
        if len(self.lines) < _LINES:
            self.lines.append((instance, status, category, text and text[:_LENGTH]))
