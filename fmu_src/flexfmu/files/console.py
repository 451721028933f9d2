"""Progress on the terminal: stages with their time, how far they are, notes and warnings.

On a terminal a stage is a line that moves; elsewhere (a file, a pipe) a counted stage prints a plain line now and then.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn
from rich.table import Column
from rich.text import Text

from .basics import BodyFileError
from .outputs import Reporter, Tell, duration_words, end_if_interrupted, progress_words

# Seconds between two states of a line on a terminal, and between two lines elsewhere; of a stage that leaves a line.
_REFRESH, _PAUSE, _LONG = 0.1, 10.0, 5.0
# Columns of a bar; of it with a spinner and the words beside it.
_BAR, _ROOM = 10, 44


class ConsoleReporter(Reporter):
    """Writes to the terminal: a moving line while a stage runs, its time when it is done and took long.

    Parameters
    ----------
    console : rich.console.Console, optional
        Default: standard error, so that results on standard output stay clean.
    clock : callable, optional
        Seconds from any start.
    quiet : bool
        Whether nothing is written but warnings.
    strict : bool
        Whether a doubt ends the job.
    verbose : bool
        Whether details and short stages are written, too.
    """

    def __init__(
        self,
        console: Console | None = None,
        clock: Callable[[], float] = time.perf_counter,
        quiet: bool = False,
        strict: bool = False,
        verbose: bool = False,
    ):
        self._console = console or Console(stderr=True, highlight=False)
        self._clock = clock
        self._quiet, self._strict, self._verbose = quiet, strict, verbose
        self.warnings = 0
        title = Column(no_wrap=True, max_width=max(20, self._console.width - _ROOM))
        # One display for all stages that are open at a time.
        self._lines = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", table_column=title),
            _Bar(bar_width=_BAR),
            TextColumn("[dim]{task.fields[words]}[/]"),
            console=self._console,
            transient=True,
            get_time=clock,
            disable=quiet or not self._console.is_terminal,
        )

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:
        """Show `title` with a spinner, then with the time it took if that was long."""
        with self.counted(title, None):
            yield

    @contextmanager
    def counted(self, title: str, total: float | None, unit: str = "") -> Iterator[Tell]:
        """Show `title` with a bar, how much of `total` is done and the time left, then with the time it took."""
        start = said = self._clock()
        pause = _REFRESH if self._console.is_terminal else _PAUSE

        def tell(done: float) -> None:
            """Show how far it is, unless something was shown a moment ago."""
            nonlocal said
            end_if_interrupted()
            now = self._clock()
            if now - said >= pause:
                said = now
                self._show(line, done, progress_words(done, total or 0.0, unit, now - start))

        with self._line(title, total) as line:
            yield tell
        self._done(title, start)

    def note(self, text: str) -> None:
        """Print an indented line."""
        if not self._quiet:
            self._console.print(f"  [dim]{escape(text)}[/]")

    def detail(self, text: str) -> None:
        """Print an indented line for those who asked for all."""
        if self._verbose:
            self.note(text)

    def warning(self, text: str) -> None:
        """Print a line that stands out, and count it."""
        self.warnings += 1
        self._console.print(f"[yellow]! {escape(text)}[/]")

    def doubt(self, text: str) -> None:
        """Warn, or end the job."""
        if self._strict:
            raise BodyFileError(f"{text}. Correct it; if it is meant, add --force")
        self.warning(text)

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
        end_if_interrupted()
        took = self._clock() - start
        if not self._quiet and (self._verbose or took >= _LONG):
            self._console.print(f"[green]✓[/] {escape(title)} [dim]{took:.2f} s[/]")

    def _show(self, line: TaskID, done: float, words: str) -> None:
        if self._console.is_terminal:
            self._lines.update(line, completed=done, words=escape(words))
        else:
            self.note(words)


class _Bar(BarColumn):
    """A bar where it is known how much there is to do, else how long it has taken."""

    def render(self, task):  # type: ignore[no-untyped-def]
        if task.total is not None:
            return super().render(task)
        return Text(duration_words(task.elapsed) if task.elapsed >= _LONG else "", style="dim")
