"""What a long job tells while it runs, and what Ctrl-C does to it."""

import logging
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

_HOURS, _MINUTES = 3600.0, 60.0

Tell = Callable[[float], None]
"""Says how much of a counted stage is done."""

_PRESSED = threading.Event()


class Reporter:
    """Says nothing; the base of those that do."""

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:  # noqa: ARG002
        """Enclose a stage of the job.

        Parameters
        ----------
        title : str
        """
        yield

    @contextmanager
    def counted(self, title: str, total: float, unit: str = "") -> Iterator[Tell]:  # noqa: ARG002
        """Enclose a stage that can tell how far it is; call what it yields as often as you like.

        Parameters
        ----------
        title : str
        total : float
            All there is to do: a number of things, or the last time of a simulation.
        unit : str
            Of `total`, such as "models" or "s".

        Yields
        ------
        callable
            Takes how much of `total` is done.
        """
        yield tell_nobody

    def note(self, text: str) -> None:
        """Say what was found or chosen."""

    def detail(self, text: str) -> None:
        """Say what few ask for; a terminal shows it with `--verbose` only."""
        self.note(text)

    def warning(self, text: str) -> None:
        """Say what the user should look at."""

    def doubt(self, text: str) -> None:
        """Say what is hardly meant; `flexfmu build` ends there unless it is told to go on."""
        self.warning(text)


class Stages(Reporter):
    """Shows stages, and keeps notes and warnings to itself.

    Parameters
    ----------
    report : Reporter
        Who shows them.
    """

    def __init__(self, report: Reporter):
        self.stage, self.counted = report.stage, report.counted  # type: ignore[method-assign]


class ScriptReporter(Reporter):
    """Warnings as Python's, notes to the log "flexfmu"."""

    def note(self, text: str) -> None:
        """Log what was found or chosen."""
        logging.getLogger("flexfmu").info(text)

    def warning(self, text: str) -> None:
        """Warn of what the user should look at."""
        warnings.warn(text, stacklevel=2)


def progress_words(done: float, total: float, unit: str, elapsed: float) -> str:
    """How far a job is and how long it will still take, at the mean pace so far.

    Parameters
    ----------
    done, total : float
    unit : str
    elapsed : float
        s.

    Returns
    -------
    str
        As "3 of 12 models, 40 s left".
    """
    words = f"{done:.6g} of {total:.6g} {unit}".rstrip()
    return words if done <= 0.0 else f"{words}, {duration_words(elapsed * max(total - done, 0.0) / done)} left"


def duration_words(seconds: float) -> str:
    """A time as a person would say it: 40 s, 3 min, 1.5 h."""
    if seconds >= _HOURS:
        return f"{seconds / _HOURS:.1f} h"
    return f"{seconds / _MINUTES:.0f} min" if seconds >= 2.0 * _MINUTES else f"{seconds:.0f} s"


def tell_nobody(_done: float) -> None:
    """Say nothing."""


@contextmanager
def keeps_interrupts() -> Iterator[None]:
    """Let no Ctrl-C be lost in what is enclosed.

    Python drops a KeyboardInterrupt that rises amid a callback of its own (of a weak reference, or `__del__`), and
    prints it. Here it is not printed, and rises anew where a `ConsoleReporter` is told of progress next.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is not signal.default_int_handler:
        yield
        return

    hook = sys.unraisablehook

    def note(number: int, frame: FrameType | None) -> None:
        _PRESSED.set()
        signal.default_int_handler(number, frame)

    def dropped(what: Any) -> None:
        if what.exc_type is not KeyboardInterrupt:
            hook(what)

    _PRESSED.clear()
    signal.signal(signal.SIGINT, note)
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook
        _PRESSED.clear()


def end_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that was lost, if one was."""
    if _PRESSED.is_set():
        _PRESSED.clear()
        raise KeyboardInterrupt


@contextmanager
def ends_on_interrupt(report: Reporter) -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C end a job at a place of its own choice, with its results so far, instead of anywhere.

    A KeyboardInterrupt may otherwise rise inside an FMU's Python code, which makes an error of it. A second Ctrl-C does
    what it always does.

    Parameters
    ----------
    report : Reporter

    Yields
    ------
    callable
        Whether Ctrl-C was pressed; ask it where the job can end.
    """
    pressed, before = threading.Event(), signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (signal.SIG_IGN, None):
        # Signals reach the main thread only; a job in the background may be meant to go on.
        yield pressed.is_set
        return

    def note(_number: int, _frame: FrameType | None) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, before)
        # The signal may come amid another line.
        with suppress(RuntimeError):
            report.note("Ctrl-C: ends after the step under way; press it again to end at once")

    signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)
