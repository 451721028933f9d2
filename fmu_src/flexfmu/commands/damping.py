"""`flexfmu damping`: damping ratios from a measured decay."""

from pathlib import Path
from typing import Annotated

import typer


def damping(
    file: Annotated[Path, typer.Argument(help="Free decay at equal steps (CSV: time, motion).")],
    column: Annotated[str, typer.Option(help="Column of the motion; default: the first after time.")] = "",
) -> None:
    """Find frequencies and damping ratios in a measured decay, as a table for the body file."""
    from ..calls.decay import decay

    for line in decay(file, column).words:
        typer.echo(line)
