"""What a long job says while it runs: stages with their time, how far they are, notes and warnings.

On a terminal a stage is a line that moves; elsewhere (a file, a pipe) a counted stage prints a plain line now and then.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn

# Seconds between two states of a line on a terminal, and between two lines elsewhere.
_REFRESH, _PAUSE = 0.1, 10.0
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

    def warning(self, text: str) -> None:
        """Say what the user should look at."""


class ConsoleReporter(Reporter):
    """Writes to the terminal: a moving line while a stage runs, its time when it is done.

    Parameters
    ----------
    console : rich.console.Console, optional
        Default: standard error, so that results on standard output stay clean.
    clock : callable, optional
        Seconds from any start.
    quiet : bool
        Whether nothing is written but warnings.
    """

    def __init__(
        self,
        console: Console | None = None,
        clock: Callable[[], float] = time.perf_counter,
        quiet: bool = False,
    ):
        self._console = console or Console(stderr=True, highlight=False)
        self._clock = clock
        self._quiet = quiet
        self.warnings = 0
        # One display for all stages that are open at a time.
        self._lines = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            _Bar(bar_width=24),
            TextColumn("[dim]{task.fields[words]}[/]"),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:
        """Show `title` with a spinner, then with the time it took."""
        start = self._clock()
        with self._line(title, None):
            yield
        self._done(title, start)

    @contextmanager
    def counted(self, title: str, total: float, unit: str = "") -> Iterator[Tell]:
        """Show `title` with a bar, how much of `total` is done and the time left, then with the time it took."""
        start = self._clock()
        with self._line(title, total) as line:
            yield _Count(self, line, total, unit, start).tell
        self._done(title, start)

    def note(self, text: str) -> None:
        """Print an indented line."""
        if not self._quiet:
            self._console.print(f"  [dim]{escape(text)}[/]")

    def warning(self, text: str) -> None:
        """Print a line that stands out, and count it."""
        self.warnings += 1
        self._console.print(f"[yellow]! {escape(text)}[/]")

    @contextmanager
    def _line(self, title: str, total: float | None) -> Iterator[TaskID]:
        """A line of the display, which stands as long as one stage is open."""
        line = self._lines.add_task(escape(title) + (" …" if total is None else ""), total=total, words="")
        self._lines.start()
        try:
            yield line
        finally:
            self._lines.remove_task(line)
            if not self._lines.tasks:
                self._lines.stop()

    def _done(self, title: str, start: float) -> None:
        _end_if_interrupted()
        if not self._quiet:
            self._console.print(f"[green]✓[/] {escape(title)} [dim]{self._clock() - start:.2f} s[/]")

    def _show(self, line: TaskID, done: float, words: str) -> None:
        if self._console.is_terminal:
            self._lines.update(line, completed=done, words=escape(words))
        else:
            self.note(words)


class _Bar(BarColumn):
    """A bar where it is known how much there is to do."""

    def render(self, task):  # type: ignore[no-untyped-def]
        return "" if task.total is None else super().render(task)


class _Count:
    """How far one stage is.

    Parameters
    ----------
    reporter : ConsoleReporter
    line : rich.progress.TaskID
    total : float
    unit : str
    start : float
        s.
    """

    def __init__(self, reporter: ConsoleReporter, line: TaskID, total: float, unit: str, start: float):
        self._reporter, self._line, self._total, self._unit, self._start = reporter, line, total, unit, start
        self._pause = _REFRESH if reporter._console.is_terminal else _PAUSE
        self._said = start

    def tell(self, done: float) -> None:
        """Show it, unless something was shown a moment ago."""
        _end_if_interrupted()
        now = self._reporter._clock()
        if now - self._said >= self._pause:
            self._said = now
            words = progress_words(done, self._total, self._unit, now - self._start)
            self._reporter._show(self._line, done, words)


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
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:
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


def _end_if_interrupted() -> None:
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
