"""What commands do without typer, which takes longer to start than `info` does: end in words, and show a file."""

from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..files.console import ConsoleReporter


# How much a command says on standard error: "quiet", "verbose", or as usual.
LOUDNESS = ContextVar("loudness", default="")


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
        from ..files.outputs import keeps_interrupts

        console = Console(stderr=True, highlight=False)
        try:
            with keeps_interrupts():
                command(*arguments, **options)
        except BrokenPipeError:
            # Who reads has seen enough, as `head` does.
            console.on_broken_pipe()
        except (FlexfmuError, RuntimeBodyError, OSError, MemoryError, ImportError) as error:
            if LOUDNESS.get() == "verbose":
                console.print_exception()
            console.print(f"[red]error:[/] {escape(str(error) or 'the memory does not suffice')}", soft_wrap=True)
            raise SystemExit(error.exit_code if isinstance(error, FlexfmuError) else 1) from error
        except KeyboardInterrupt as error:
            console.print(f"[red]ended by Ctrl-C;[/] {escape(str(error) or 'nothing was written')}")
            raise SystemExit(INTERRUPTED) from error

    return guarded


def show_info(file: Path, as_json: bool, costs: "ConsoleReporter | None" = None) -> None:
    """Print what is in an FMU or a modal file.

    Parameters
    ----------
    file : Path
    as_json : bool
    costs : ConsoleReporter, optional
        Who tells of it while a step of every method is timed, too.
    """
    from ..calls.describing import cost_table, data, describe
    from ..files.outputs import fields_of, json_text
    from ..fmu.reading import read_packaged_body

    body = read_packaged_body(file)
    if costs is not None:
        from ..study.cost import step_costs
    found = {} if costs is None else step_costs(body, costs)
    if as_json:
        rows = [{"variant": variant, **fields_of(one)} for variant, one in found.items()]
        print(json_text(data(body) | ({} if costs is None else {"cost": rows})))
        return
    from rich.console import Console

    console = Console(highlight=False)
    for part in [*describe(body), *([cost_table(found)] if costs is not None else [])]:
        console.print(part)
