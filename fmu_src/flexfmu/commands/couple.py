"""`flexfmu couple`: several FMUs together."""

from pathlib import Path
from typing import Annotated

import typer

from .common import reporter


def couple(
    file: Annotated[Path, typer.Argument(help="Coupling file (TOML): FMUs, connections, springs, scheme.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Results to write (CSV or HDF5).")],
) -> None:
    """Run several FMUs together, linked by connections and by springs between interfaces."""
    from ..calls.functions import couple as run

    run(file, output, reporter())
    typer.echo(f"{output}")
