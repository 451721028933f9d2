"""`flexfmu pack`: modes of another program become an FMU."""

from pathlib import Path
from typing import Annotated

import typer

from .common import reporter, show_written


def pack(
    file: Annotated[Path, typer.Argument(help="Modes of another program (.npz, .h5), SID_FEM, or a modal file (.h5).")],
    interface: Annotated[list[str] | None, typer.Option(help="NAME=SET; may be repeated.")] = None,
    support: Annotated[list[str] | None, typer.Option(help="SET where frames hang if no node is held.")] = None,
    frames: Annotated[int | None, typer.Option(help="Frames; default: 4 of modes with elements, else 1.")] = None,
    method: Annotated[str | None, typer.Option(help="Method; default: frames.")] = None,
    damping: Annotated[float, typer.Option(help="Modal damping ratio; default: that of the modes.")] = 0.0,
    name: Annotated[str | None, typer.Option(help="Name of the body; default: that of the modes.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="FMU to write; default: NAME.fmu here.")] = None,
) -> None:
    """Make an FMU of modes that another program found (docs/given-modes.md), or of a modal file."""
    from ..given.packing import pack_file

    body = pack_file(file, interface or [], support or [], frames, method, damping, name, reporter())
    target = body.fmu(output or Path(f"{body.model.name}.fmu"))
    show_written(target)
