"""`flexfmu simulate`: an FMU under a table of loads."""

from pathlib import Path
from typing import Annotated

import typer

from .common import reporter


def simulate(
    fmu: Annotated[Path, typer.Argument(help="FMU made by flexfmu.")],
    loads: Annotated[Path, typer.Option("--input", "-i", help="Loads over time (CSV: time, then FMU inputs by name).")],
    output: Annotated[Path, typer.Option("--output", "-o", help=r"Results to write (CSV, with units: time \[s]).")],
    step: Annotated[float | None, typer.Option(help="Communication step, s; default: the FMU's own.")] = None,
    stop: Annotated[float | None, typer.Option(help="End, s; default: the last time in the input.")] = None,
    static_start: Annotated[bool, typer.Option(help="Start in equilibrium under the first loads.")] = False,
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="A parameter, NAME=VALUE; may come again.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw displacements and rotations (PNG, PDF or SVG).")] = None,
    shape: Annotated[
        Path | None, typer.Option("--view", help="Show the body as it moves (.html, .pvd, .png; see `flexfmu view`).")
    ] = None,
) -> None:
    """Drive an FMU by a table of loads and write its motion."""
    from ..files.targets import PICTURE_SUFFIXES, check_target
    from ..fmu.simulation import outcome, parse_parameters, simulate_csv

    if plot is not None:
        check_target(plot, PICTURE_SUFFIXES, inputs=(fmu, loads, output))
    if shape is not None:
        from ..calls.showing import show_simulation
        from ..view.shown import SUFFIXES

        check_target(shape, SUFFIXES, inputs=(fmu, loads, output))
    settings = parse_parameters(parameter or [])
    if static_start:
        if settings.get("initialization", "static") != "static":
            raise typer.BadParameter("--static-start and --set initialization=… contradict each other; give one")
        settings["initialization"] = "static"
    report = reporter()
    outputs, result = simulate_csv(fmu, loads, output, step, stop, settings, report)
    if plot is not None:
        from ..fmu.curves import plot_result

        plot_result(output, plot)
    if shape is not None:
        show_simulation(fmu, loads, output, shape, settings, report)
    typer.echo(outcome(outputs, result, report.warnings))
    typer.echo(", ".join(str(path) for path in (output, plot, shape) if path is not None))
