"""`flexfmu init`: a body file to start from."""

from pathlib import Path
from typing import Annotated

import typer


def init(
    mesh: Annotated[Path, typer.Argument(help="Mesh.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Body file; default: beside the mesh.")] = None,
    units: Annotated[str, typer.Option(help="Units of the mesh; default: those in which the body is likely.")] = "",
) -> None:
    """Write a body file to start from: supports and interfaces at reference points and plane ends of a mesh."""
    from ..calls.functions import init as write

    typer.echo(str(write(mesh, output, units)))
