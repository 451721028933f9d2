"""`flexfmu couple`: several FMUs together."""

from pathlib import Path
from typing import Annotated

import typer

from .common import reporter


def couple(
    file: Annotated[Path, typer.Argument(help="Coupling file (TOML): FMUs, connections, springs, scheme.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Results to write (CSV or HDF5).")] = None,
    ssp: Annotated[Path | None, typer.Option(help="System to write for other masters (SSP 1.0).")] = None,
) -> None:
    """Run several FMUs together, linked by connections and by springs between interfaces."""
    from ..calls.functions import couple as run
    from ..master.ssp import write_ssp

    if output is None and ssp is None:
        raise typer.BadParameter("give --output, --ssp or both")
    if ssp is not None:
        write_ssp(file, ssp, reporter())
        typer.echo(f"{ssp}")
    if output is not None:
        run(file, output, reporter())
        typer.echo(f"{output}")
