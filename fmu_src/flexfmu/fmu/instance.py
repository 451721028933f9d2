"""An FMU's instance through its library alone: a process that needs no more of Python starts within some ten ms."""

import ctypes
import sys
from contextlib import chdir
from pathlib import Path
from typing import Any

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
