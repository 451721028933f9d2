"""pythonfmu's slave over the core: every call goes to the FMI functions of the compiled core beside this file.

It travels inside FMUs of `--runtime python` and needs nothing but the standard library. pythonfmu's library calls the
methods; it finds the class in a generated module that derives from this one and from pythonfmu's base class.
"""

import ctypes
import logging
import platform
import sys
from collections.abc import Callable
from ctypes import py_object, pythonapi
from functools import partialmethod
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError, iterparse

_OK, _WARNING, _DISCARD, _ERROR = 0, 1, 2, 3
_CO_SIMULATION = 1
WORDS = logging.getLogger("flexfmu.fmu")
"""Warns where the master has FMI's logging off, and pythonfmu's library says nothing."""
_TEXT = ctypes.c_char_p
_LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, _TEXT, ctypes.c_int, _TEXT, _TEXT, use_errno=False)


class LogMessage:
    """A line for the master's logger, in the form that pythonfmu's library reads."""

    def __init__(self, status: int, category: str, text: str):
        self.status = status
        self.category = category
        # The library hands the text on as a printf format; the core has doubled its percent signs.
        self.msg = text


class SlaveError(Exception):
    """A call that cannot be honoured; the log says why."""


def core_file(resources: Path) -> Path:
    """The compiled core of this machine in an FMU's resources."""
    arm = platform.machine().lower() in ("arm64", "aarch64")
    names = {"win32": "win64.dll", "darwin": "darwin64.dylib"}
    return resources / "core" / names.get(sys.platform, "aarch64-linux.so" if arm else "linux64.so")


def guid_in(xml: bytes) -> str | None:
    """Guid in a model description, of FMI 3.0 its token; None where it is no XML."""
    try:
        # The root comes first: of a body with many variables the rest need not be read.
        _, root = next(iterparse(BytesIO(xml), events=("start",)))
    except (ParseError, StopIteration):
        return None
    return str(root.get("guid", "") or root.get("instantiationToken", ""))


class BodySlave:
    """A flexible body behind pythonfmu's calls.

    Parameters
    ----------
    **kwargs
        `instance_name` and `resources` (the folder of the unpacked FMU's resources), from pythonfmu's library.

    Raises
    ------
    SlaveError
        The core or its data are missing, damaged or of another FMU: instantiation fails.
    """

    guid = ""
    """Of the FMU that this travels in; set by the generated module."""

    def __init__(self, **kwargs: Any):
        self.instance_name = str(kwargs["instance_name"])
        self._log: list[LogMessage] = []
        resources = Path(str(kwargs["resources"]))
        path = core_file(resources)
        try:
            self._core = ctypes.CDLL(str(path))
        except OSError as error:
            raise self._failure(f"no core for this machine in the FMU: {error}") from error
        self._core.fmi2Instantiate.restype = ctypes.c_void_p
        self._logger = _LOGGER(self._logged)
        # Of five the first; the core asks for no other.
        self._callbacks = (ctypes.c_void_p * 5)(ctypes.cast(self._logger, ctypes.c_void_p).value)
        # Masters may unpack the resources only: then there is no guid to compare.
        description = resources.parent / "modelDescription.xml"
        guid = (guid_in(description.read_bytes()) or "") if description.is_file() else self.guid
        name, token, place = (text.encode() for text in (self.instance_name or "instance", guid, str(resources)))
        found = self._core.fmi2Instantiate(name, _CO_SIMULATION, token, place, self._callbacks, 0, 1)
        self._handle = ctypes.c_void_p(found)
        if not self._handle:
            raise self._failure(None)

    def __del__(self) -> None:
        handle = getattr(self, "_handle", None)
        if handle:
            self._core.fmi2FreeInstance(handle)
            self._handle = ctypes.c_void_p()

    # Life cycle.

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Hand on start and stop."""
        stop, bound = stop_time or 0.0, tolerance or 0.0
        real = ctypes.c_double
        span = real(start_time), int(stop > start_time), real(stop)
        self._call("fmi2SetupExperiment", int(bound > 0.0), real(bound), *span)

    def enter_initialization_mode(self) -> None:
        """Begin the initialisation."""
        self._call("fmi2EnterInitializationMode")

    def exit_initialization_mode(self) -> None:
        """Fix the parameters and the initial state."""
        self._call("fmi2ExitInitializationMode")

    def terminate(self) -> None:
        """End the run."""
        self._call("fmi2Terminate")

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by a step; False (discard) leaves the state as it was and says why in the log."""
        real = ctypes.c_double
        return self._call("fmi2DoStep", real(current_time), real(step_size), 0) != _DISCARD

    # Values: of the variables of some references; to be set are inputs, and parameters before initialisation ends.

    def _get(self, name: str, kind: Callable[..., Any], told: Callable[[Any], Any], vrs: list[int]) -> list[Any]:
        values = (kind * len(vrs))()  # type: ignore[operator]
        self._call(f"fmi2Get{name}", self._references(vrs), ctypes.c_size_t(len(vrs)), values)
        return list(map(told, values))

    def _set(
        self, name: str, kind: Callable[..., Any], made: Callable[[Any], Any], vrs: list[int], values: Any
    ) -> None:
        if len(values) != len(vrs):
            raise self._failure(f"fmi2Set{name}: {len(values)} values for {len(vrs)} references")
        given = (kind * len(values))(*map(made, values))  # type: ignore[operator]
        self._call(f"fmi2Set{name}", self._references(vrs), ctypes.c_size_t(len(vrs)), given)

    get_real = partialmethod(_get, "Real", ctypes.c_double, float)
    get_integer = partialmethod(_get, "Integer", ctypes.c_int, int)
    get_boolean = partialmethod(_get, "Boolean", ctypes.c_int, bool)
    get_string = partialmethod(_get, "String", ctypes.c_char_p, bytes.decode)
    set_real = partialmethod(_set, "Real", ctypes.c_double, float)
    set_integer = partialmethod(_set, "Integer", ctypes.c_int, int)
    set_boolean = partialmethod(_set, "Boolean", ctypes.c_int, int)
    set_string = partialmethod(_set, "String", ctypes.c_char_p, str.encode)

    # State.

    def _get_fmu_state(self) -> bytes:
        """Everything that the future depends on, as one block of bytes."""
        state, size = ctypes.c_void_p(), ctypes.c_size_t()
        self._call("fmi2GetFMUstate", ctypes.byref(state))
        try:
            self._call("fmi2SerializedFMUstateSize", state, ctypes.byref(size))
            block = ctypes.create_string_buffer(size.value)
            self._call("fmi2SerializeFMUstate", state, block, size)
        finally:
            self._core.fmi2FreeFMUstate(self._handle, ctypes.byref(state))
        return block.raw

    def _set_fmu_state(self, block: bytes) -> None:
        """Go back to a state taken from this or another instance of the same FMU."""
        state = ctypes.c_void_p()
        self._call("fmi2DeSerializeFMUstate", bytes(block), ctypes.c_size_t(len(block)), ctypes.byref(state))
        try:
            self._call("fmi2SetFMUstate", state)
        finally:
            self._core.fmi2FreeFMUstate(self._handle, ctypes.byref(state))

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        return bytes(state)

    def _get_log_queue(self) -> list[LogMessage]:
        return self._log

    # Inside.

    def _logged(self, _environment: object, _name: bytes, status: int, category: bytes, text: bytes) -> None:
        words = text.decode(errors="replace")
        self._log.append(LogMessage(status, category.decode(), words))
        if status >= _WARNING:
            WORDS.warning("%s: %s", self.instance_name, words.replace("%%", "%"))

    def _call(self, name: str, *arguments: object) -> int:
        """Status of a call; an exception where it is an error."""
        status: int = getattr(self._core, name)(self._handle, *arguments)
        if status >= _ERROR:
            raise self._failure(None)
        return status

    def _references(self, vrs: list[int]) -> ctypes.Array[ctypes.c_uint]:
        return (ctypes.c_uint * len(vrs))(*(vr & 0xFFFFFFFF for vr in vrs))

    def _failure(self, text: str | None) -> SlaveError:
        """Error that makes pythonfmu's library answer the call with a failure."""
        if text is not None:
            self._log.append(LogMessage(_ERROR, "logStatusError", text.replace("%", "%%")))
        # The library gives up its references to these when a call raises, and once more when the instance is freed:
        # without one to spare, every later call would use freed memory and end the master's process.
        for held in (self, type(self), self._log):
            pythonapi.Py_IncRef(py_object(held))
        return SlaveError(text or (self._log[-1].msg if self._log else "the call failed"))
