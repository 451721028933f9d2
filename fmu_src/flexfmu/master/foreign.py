"""FMUs of other programs at work in a process of their own, and what any FMU writes to its log.

What exits, crashes or never returns ends its run only. Of a log, refusals are quoted where a run stops; warnings are
handed on.
"""

import ctypes
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2CallbackLoggerTYPE

from ..files.array_types import IntArray
from ..files.errors import SimulationError
from ..files.workers import Worker, WorkerError
from ..fmu import foreign_host

_WARNING, _DISCARD = 1, 2
# Lines that a message quotes, and warnings that are handed on.
_QUOTED, _HANDED_ON = 3, 20

_refusals: dict[str, deque[str]] = {}
_warnings: dict[str, dict[str, None]] = {}
_kept: dict[str, dict[str, None]] = {}
# Of each instance: tries of steps so far, and whether it warned since its state was kept, both by the loop; and the try
# of its last refusal.
_marks: dict[str, IntArray] = {}
_refused_at: dict[str, int] = {}


def open_log(name: str) -> IntArray:
    """Begin an instance's log.

    Parameters
    ----------
    name : str
        Of the instance.

    Returns
    -------
    (2,) int
        Marks: the loop counts tries of steps in the first, and clears the second when it keeps a state.
    """
    _refusals[name] = deque(maxlen=_QUOTED)
    _warnings[name], _kept[name] = {}, {}
    _marks[name], _refused_at[name] = np.zeros(2, dtype=np.int64), 0
    return _marks[name]


def quoted(name: str) -> str:
    """The last lines in which an instance said why it refused a call, since its last try of a step began.

    Parameters
    ----------
    name : str
        Of the instance.

    Returns
    -------
    str
        Empty: it said nothing.
    """
    return "; ".join(dict.fromkeys(_refusals[name])) if _refused_at[name] == _marks[name][0] else ""


def warnings_of(name: str) -> dict[str, None]:
    """What an instance warned of so far, each once.

    Parameters
    ----------
    name : str
        Of the instance.

    Returns
    -------
    dict with str keys
        In the order of the log.
    """
    return dict(_warnings[name])


def take_back_warnings(name: str) -> None:
    """Go back to the warnings before the state was kept: what a step taken back warned of did not happen.

    Parameters
    ----------
    name : str
        Of the instance.
    """
    _warnings[name] = dict(_kept[name])


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
    if not category or not text or not instance:
        return
    name = instance.decode(errors="replace")
    words = text.decode(errors="replace").removeprefix(f"{name}: ")
    if status >= _DISCARD and name in _refusals:
        if _refused_at[name] != _marks[name][0]:
            _refusals[name].clear()
            _refused_at[name] = int(_marks[name][0])
        _refusals[name].append(words)
    elif status == _WARNING and name in _warnings and len(_warnings[name]) < _HANDED_ON:
        if not _marks[name][1]:
            _kept[name] = dict(_warnings[name])
            _marks[name][1] = 1
        _warnings[name][words] = None


LOGGER = fmi2CallbackLoggerTYPE(lambda _, *line: hand_on(*line))
"""fmpy's proxy knows one logger in a process: this one tells by the instance's name whose line it is."""


# FMI 2.0: after this status nothing may be called.
_FATAL = 4
# What a call that waits for the next was to do, as in "fmu NAME failed …".
_LATER = {
    "setReal": "to take its inputs",
    "getFMUstate": "to save its state",
    "setFMUstate": "to go back to its state",
    "freeFMUstate": "to drop its state",
}

Call = tuple[str, tuple[Any, ...], dict[str, Any]]
"""A call of fmpy's `FMU2Slave`, its arguments, and those by name."""
References = tuple[int, ...]


class ForeignProcess:
    """The process of a coupling's FMUs of other programs; it starts with the first of them.

    Parameters
    ----------
    timeout : float
        s that a call may take.
    """

    def __init__(self, timeout: float):
        self._timeout, self._over = timeout, False
        self._worker = Worker(f"{foreign_host.__name__}:Host")
        self.close = self._worker.close

    def ask(self, name: str, calls: Sequence[Call]) -> tuple[list[Any], FMICallException | None]:
        """Have an FMU carry out calls of fmpy's `FMU2Slave`, one after the other.

        Parameters
        ----------
        name : str
            Of the FMU.
        calls : sequence of (str, tuple, dict)
            Each with its arguments.

        Returns
        -------
        values : list
            What the calls returned.
        refusal : FMICallException or None
            The FMU did not honour the call after these.

        Raises
        ------
        SimulationError
            It raises an error, ends its process, or does not answer in time.
        """
        words = [call for call, _, _ in calls]
        told = "doStep" if "doStep" in words else words[-1]
        if self._over:
            raise SimulationError(f"fmu {name!r}: the process of FMUs of other programs has ended before {told}")
        try:
            answer = self._worker.ask((name, calls), self._timeout)
        except WorkerError as error:
            self._over = True
            if error.ending:
                raise SimulationError(f"fmu {name!r} ended its process in {told}: {error.ending}") from None
            raise SimulationError(
                f"fmu {name!r} did not come back from {told} within {self._timeout:g} s and was ended: give it "
                "longer by experiment.timeout, or look into the FMU"
            ) from None
        kind, values, wrong, lines = answer
        for line in lines:
            hand_on(*line)
        if kind == foreign_host.FAILED:
            raise SimulationError(f"fmu {name!r} failed {words[len(values)]}: {wrong}")
        return values, FMICallException(*wrong) if kind == foreign_host.REFUSED else None


class ForeignSlave:
    """An FMU in that process, with the calls of fmpy's `FMU2Slave`.

    Parameters
    ----------
    process : ForeignProcess
    name : str
        Of the instance.
    construction : str by name
        Arguments of `FMU2Slave`.

    Attributes
    ----------
    raised : BaseException or None
        What ended a call to one of its functions, beside FMI.
    """

    def __init__(self, process: ForeignProcess, name: str, **construction: str):
        self._process, self._name = process, name
        self.raised: BaseException | None = None
        # Calls that travel with the next one that needs an answer.
        self._later: list[Call] = []
        # Real values that came with the last step: what was asked after earlier ones, by references. The first try of
        # a step, after its state was saved, is asked for more than others.
        self._ahead: dict[References, list[float]] = {}
        self._asked: dict[bool, dict[References, None]] = {False: {}, True: {}}
        self._saved = self._first = False
        self._ask(("instantiate", (), construction))

    def __getattr__(self, call: str) -> Any:
        """Carry out a call there."""
        return lambda *arguments, **named: self._ask((call, arguments, named))[0]

    def _ask(self, *calls: Call) -> list[Any]:
        """Carry out those that wait, and calls; values of the latter as far as they were honoured, one at least."""
        before, self._later = self._later, []
        values, refusal = self._process.ask(self._name, [*before, *calls])
        if refusal is not None and len(values) < len(before):
            words = _LATER[before[len(values)][0]]
            raise SimulationError(f"fmu {self._name!r} failed {words}: {quoted(self._name) or refusal}")
        if refusal is not None and len(values) == len(before):
            raise refusal
        return values[len(before) :]

    def functions(self) -> dict[str, Any]:
        """What the core's loop calls in place of the library's functions, by the names of core/participant.h."""

        def later(call: str, *arguments: Any) -> None:
            if call.startswith("set"):
                self._ahead = {}
            self._later.append((call, arguments, {}))

        def end_initialization() -> None:
            self._ahead = {}
            self.exitInitializationMode()

        def do_step(*arguments: Any) -> None:
            self._ahead, self._first, self._saved = {}, self._saved, False
            known = self._asked[self._first]
            more: list[Call] = [("getReal", (list(references),), {}) for references in known]
            values = self._ask(("doStep", arguments, {}), *more)
            self._ahead = dict(zip(known, values[1:], strict=False))

        def reals(references: References) -> list[float]:
            if references not in self._ahead:
                self._ahead[references] = self.getReal(list(references))
                self._asked[self._first][references] = None
            return self._ahead[references]

        def getter(ask: Callable[[References], list[Any]]) -> Callable[..., None]:
            def get(references: Any, count: int, values: Any) -> None:
                for k, value in enumerate(ask(tuple(references[:count]))):
                    values[k] = value

            return get

        def get_state(state: Any) -> None:
            later("getFMUstate")
            self._saved = True
            # Any but null.
            state[0] = 1

        numbers = (ctypes.POINTER(ctypes.c_uint), ctypes.c_size_t, ctypes.POINTER(ctypes.c_double))
        wholes, states = (*numbers[:2], ctypes.POINTER(ctypes.c_int)), ctypes.POINTER(ctypes.c_void_p)
        return {
            "set_real": self._function(lambda r, n, v: later("setReal", r[:n], v[:n]), *numbers),
            "get_real": self._function(getter(reals), *numbers),
            "get_integer": self._function(getter(lambda r: self.getInteger(list(r))), *wholes),
            "get_boolean": self._function(getter(lambda r: self.getBoolean(list(r))), *wholes),
            "end_initialization": self._function(end_initialization),
            "do_step": self._function(do_step, ctypes.c_double, ctypes.c_double, ctypes.c_int),
            "get_state": self._function(get_state, states),
            "set_state": self._function(lambda _: later("setFMUstate"), ctypes.c_void_p),
            "free_state": self._function(lambda _: later("freeFMUstate"), states),
        }

    def _function(self, call: Callable[..., Any], *kinds: Any) -> Any:
        """A function of C, with an instance before its arguments, that answers by FMI's status."""

        def answered(_: object, *arguments: Any) -> int:
            try:
                call(*arguments)
            except FMICallException as error:
                return int(error.status)
            except BaseException as error:  # C knows no exceptions: whoever called it raises this one
                self.raised = error
                return _FATAL
            return 0

        return ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, *kinds)(answered)
