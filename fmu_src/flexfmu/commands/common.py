"""What commands share: options, what is said on standard error, and how errors end them."""

from collections.abc import Callable
from contextvars import ContextVar
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from ..files.console import ConsoleReporter

Json = Annotated[bool, typer.Option("--json", help="Write the result as JSON.")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="Processes that measure errors; -1: one a core.")]


class Loudness(Enum):
    """How much a command says on standard error."""

    USUAL = ""
    QUIET = "quiet"
    VERBOSE = "verbose"


LOUDNESS = ContextVar("loudness", default=Loudness.USUAL)


def reporter(strict: bool = False) -> "ConsoleReporter":
    """What tells of the job, as loud as the user asked for, and perhaps ends it in doubt."""
    from ..files.console import ConsoleReporter

    loudness = LOUDNESS.get()
    return ConsoleReporter(quiet=loudness is Loudness.QUIET, strict=strict, verbose=loudness is Loudness.VERBOSE)


def show_written(path: Path) -> None:
    """Name a file that was written, and its size."""
    typer.echo(f"{path} ({path.stat().st_size / 1024:.0f} KiB)")


def ends_in_words(command: Callable[..., None]) -> Callable[..., None]:
    """Turn a user's errors, and Ctrl-C, into a message and an exit code; a KeyboardInterrupt's text says what is left.

    Parameters
    ----------
    command : callable

    Returns
    -------
    callable
        Of the same signature.
    """

    @wraps(command)
    def guarded(*arguments: object, **options: object) -> None:
        from rich.console import Console
        from rich.markup import escape

        from ..files.basics import INTERRUPTED, FlexfmuError, RuntimeBodyError
        from ..files.progress import keeps_interrupts

        try:
            with keeps_interrupts():
                command(*arguments, **options)
        except (FlexfmuError, RuntimeBodyError, OSError) as error:
            console = Console(stderr=True, highlight=False)
            if LOUDNESS.get() is Loudness.VERBOSE:
                console.print_exception()
            console.print(f"[red]error:[/] {escape(str(error))}", soft_wrap=True)
            raise typer.Exit(error.exit_code if isinstance(error, FlexfmuError) else 1) from error
        except KeyboardInterrupt as error:
            kept = str(error) or "nothing was written"
            Console(stderr=True, highlight=False).print(f"[red]ended by Ctrl-C;[/] {escape(kept)}")
            raise typer.Exit(INTERRUPTED) from error

    return guarded
