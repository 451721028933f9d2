"""What a long job says while it runs: stages with their time, notes and warnings."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape


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

    def note(self, text: str) -> None:
        """Say what was found or chosen."""

    def warning(self, text: str) -> None:
        """Say what the user should look at."""


class ConsoleReporter(Reporter):
    """Writes to the terminal: a spinner while a stage runs, its time when it is done.

    Parameters
    ----------
    console : rich.console.Console, optional
        Default: standard error, so that results on standard output stay clean.
    """

    def __init__(self, console: Console | None = None):
        self._console = console or Console(stderr=True, highlight=False)

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:
        """Show `title` with a spinner, then with the time it took."""
        start = time.perf_counter()
        with self._console.status(escape(title) + " …"):
            yield
        self._console.print(f"[green]✓[/] {escape(title)} [dim]{time.perf_counter() - start:.2f} s[/]")

    def note(self, text: str) -> None:
        """Print an indented line."""
        self._console.print(f"  [dim]{escape(text)}[/]")

    def warning(self, text: str) -> None:
        """Print a line that stands out."""
        self._console.print(f"[yellow]! {escape(text)}[/]")
