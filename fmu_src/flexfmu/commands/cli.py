"""The `flexfmu` command: its options, and its commands."""

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from . import jobs
from .plain import LOUDNESS, ends_in_words

# In the order of the help; functions of `jobs`.
COMMANDS = ("build", "pack", "info", "check", "init", "simulate", "view", "couple", "chart", "fit", "damping")

_FLAGS = {"-q": "quiet", "--quiet": "quiet", "-v": "verbose", "--verbose": "verbose"}


class _Commands(TyperGroup):
    """Commands whose common options stand before or after the command's name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        found = [_FLAGS[word] for word in args if word in _FLAGS]
        LOUDNESS.set(found[-1] if found else "")
        return super().parse_args(ctx, [word for word in args if word not in _FLAGS])


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    help="Turn finite element models of flexible bodies into FMI 2.0 co-simulation FMUs that stay right when the body "
    "bends far.",
)
for _name in COMMANDS:
    app.command()(ends_in_words(getattr(jobs, _name)))


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"flexfmu {version('flexfmu')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show it.")] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say nothing but warnings, errors and results; also after a command.")
    ] = False,
    verbose: Annotated[
        bool,
        typer.Option("--verbose", "-v", help="Say all that is done and found, and where in the code an error arose."),
    ] = False,
) -> None:
    """Options of all commands."""
