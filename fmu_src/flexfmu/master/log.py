"""What FMUs write to their logs: refusals, to be quoted where a run stops, and warnings, to be handed on."""

from collections import deque

import numpy as np
from fmpy.fmi2 import fmi2CallbackLoggerTYPE

from ..files.array_types import IntArray

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
