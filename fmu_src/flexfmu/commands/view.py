"""`flexfmu view`: pages and pictures of a body."""

from pathlib import Path
from typing import Annotated

import typer

from .common import reporter, show_written


def view(
    file: Annotated[Path, typer.Argument(help="FMU, modal file, body file or mesh.")],
    table: Annotated[Path | None, typer.Argument(help="Results of a run (CSV): the motion of which they tell.")] = None,
    load: Annotated[
        list[str] | None,
        typer.Option("--load", "-l", help="A load that holds still, such as tip.force.y=5kN; may be repeated."),
    ] = None,
    modes: Annotated[int, typer.Option("--modes", "-m", min=0, help="Show so many mode shapes.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Page (.html), ParaView (.vtu, .pvd) or picture (.png, .pdf, .svg)."),
    ] = None,
    colour: Annotated[str, typer.Option(help="displacement, von mises stress, frames, interfaces and supports.")] = "",
    scale: Annotated[
        float, typer.Option(min=0.0, help="Factor on displacements; default: 1 where they show, else a larger one.")
    ] = 0.0,
    method: Annotated[str | None, typer.Option(help="Method; default: the body's own.")] = None,
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter of the FMU, NAME=VALUE; may be repeated.")
    ] = None,
    shapes: Annotated[int, typer.Option(min=2, help="Most shapes of a motion.")] = 100,
    live: Annotated[Path | None, typer.Option(help="Page (.html) whose body answers to the pointer.")] = None,
) -> None:
    """Show a mesh, a body, its modes, an equilibrium or a motion: a page to turn and play, or a picture."""
    from ..calls.showing import Request, show
    from ..fmu.simulation import parse_parameters

    if live and output:
        raise typer.BadParameter("it is a page, and --output another: give one of them", param_hint="--live")
    target = live or output or Path(f"{file.stem}.html")
    settings = parse_parameters(parameter or [])
    more = modes, colour, scale, method, settings, shapes, live is not None
    seen = show(Request(file, target, table, tuple(load or ()), *more), reporter())
    for case in seen.view.cases[:1]:
        typer.echo(f"{case.name}: {case.note}")
    show_written(target)
