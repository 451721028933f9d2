"""What FMUs write to their logs: refusals, to be quoted where a run stops, and warnings, to be handed on."""

from collections import deque
from collections.abc import Mapping

from fmpy.fmi2 import fmi2CallbackLoggerTYPE

_WARNING, _DISCARD = 1, 2
# Lines that a message quotes, and warnings that are handed on.
_QUOTED, _HANDED_ON = 3, 20

_refusals: dict[str, deque[str]] = {}
_warnings: dict[str, dict[str, None]] = {}


def open_log(name: str) -> None:
    """Begin an instance's log.

    Parameters
    ----------
    name : str
        Of the instance.
    """
    _refusals[name] = deque(maxlen=_QUOTED)
    _warnings[name] = {}


def forget_refusals(name: str) -> None:
    """Drop what an instance refused so far.

    Parameters
    ----------
    name : str
        Of the instance.
    """
    _refusals[name].clear()


def quoted(name: str) -> str:
    """The last lines in which an instance said why it refused a call.

    Parameters
    ----------
    name : str
        Of the instance.

    Returns
    -------
    str
        Empty: it said nothing.
    """
    return "; ".join(dict.fromkeys(_refusals[name]))


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


def take_back_warnings(name: str, to: Mapping[str, None]) -> None:
    """Go back to earlier warnings: what a step taken back warned of did not happen.

    Parameters
    ----------
    name : str
        Of the instance.
    to : mapping with str keys
        From `warnings_of`.
    """
    _warnings[name] = dict(to)


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
        _refusals[name].append(words)
    elif status == _WARNING and name in _warnings and len(_warnings[name]) < _HANDED_ON:
        _warnings[name][words] = None


LOGGER = fmi2CallbackLoggerTYPE(lambda _, *line: hand_on(*line))
"""fmpy's proxy knows one logger in a process: this one tells by the instance's name whose line it is."""
