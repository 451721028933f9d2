"""`flexfmu check`: what a mesh holds, and what a body file chooses of it."""

from pathlib import Path
from typing import Annotated

import typer


def check(
    file: Annotated[Path, typer.Argument(help="Body file (TOML), or a mesh alone.")],
    units: Annotated[str, typer.Option(help="Units of a mesh alone.")] = "m-kg-s",
) -> None:
    """List what a mesh holds: mass, sets, materials, plane ends, bores; of a body file its supports and interfaces."""
    from ..calls.functions import check as found

    for line in found(file, units).lines:
        typer.echo(line)
