"""The commands of `flexfmu`, each of which imports what it needs when it runs, and what they share.

These are options, and what is said on standard error.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..fmu.runtime import Runtime
from .plain import LOUDNESS, show_info

if TYPE_CHECKING:
    from ..files.console import ConsoleReporter
    from ..study.chart.draw import Drawn


Json = Annotated[bool, typer.Option("--json", help="Write the result as JSON.")]
Parameters = Annotated[
    list[str] | None, typer.Option("--set", help="A parameter of the FMU, NAME=VALUE; may be repeated.")
]
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="Processes that measure errors; -1: one a core.")]


def reporter(strict: bool = False) -> "ConsoleReporter":
    """What tells of the job, as loud as the user asked for, and perhaps ends it in doubt."""
    from ..files.console import ConsoleReporter

    loudness = LOUDNESS.get()
    return ConsoleReporter(quiet=loudness == "quiet", strict=strict, verbose=loudness == "verbose")


def show_written(path: Path) -> None:
    """Name a file that was written, and its size."""
    typer.echo(f"{path} ({path.stat().st_size / 1024:.0f} KiB)")


def build(
    body: Annotated[Path, typer.Argument(help="Body file (TOML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="FMU to write; default: NAME.fmu here.")] = None,
    modal_file: Annotated[Path | None, typer.Option(help="Keep the modal file (.h5) here as well.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Find everything anew, and keep nothing.")] = False,
    runtime: Annotated[
        Runtime, typer.Option(help="What runs the body: the core in C, or pythonfmu and a Python over the same core.")
    ] = Runtime.NATIVE,
    force: Annotated[bool, typer.Option("--force", help="Build what is hardly meant, too, with a warning.")] = False,
    platforms: Annotated[
        str, typer.Option(help="Where it runs: all, or some of linux64,win64,darwin64,aarch64-linux; default: here.")
    ] = "",
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Version of FMI.")] = 2,
    tolerance: Annotated[str, typer.Option(help="Build the plainest model with less error, such as 0.5%.")] = "",
    scene: Annotated[
        Path | None, typer.Option("--scene", "-s", help="Loads at which --tolerance counts; default: reference loads.")
    ] = None,
) -> None:
    """Reduce a finite element body and write its FMU; modes are kept for the next build of the same mesh."""
    from ..build.config import read_body_file
    from ..build.kept import build_fmu
    from ..files.basics import NOT_MET
    from ..files.store import Store, default_folder

    config, share = read_body_file(body), 0.0
    target = output or Path(f"{config.name}.fmu")
    store = Store(None if fresh else default_folder())
    names = [name.strip() for name in platforms.split(",") if name.strip()]
    if tolerance:
        from ..study.candidates import times
        from ..study.smallest import smallest

        config, share = smallest(body, _share(tolerance), scene, reporter(not force), store)
    build_fmu(config, target, modal_file, reporter(not force), store, runtime, names, fmi)
    show_written(target)
    if tolerance:
        typer.echo(f"{times(share)} × the tolerance")
    if share > 1.0:
        raise typer.Exit(NOT_MET)


def _share(text: str) -> float:
    """A share from its words: 0.5% or 0.005."""
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        raise typer.BadParameter(f"--tolerance is {text!r}, expected a share of the motion such as 0.5% or 0.005")
    return value


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
    show_written(body.fmu(output or Path(f"{body.model.name}.fmu")))


def info(
    file: Annotated[Path, typer.Argument(help="FMU or modal file.")],
    cost: Annotated[bool, typer.Option("--cost", help="Time a step of each method that it has data for.")] = False,
    as_json: Json = False,
) -> None:
    """Show what is in an FMU or a modal file: modes, interfaces, tree of frames, origin."""
    show_info(file, as_json, reporter() if cost else None)


def check(
    file: Annotated[Path, typer.Argument(help="Body file (TOML), or a mesh alone.")],
    units: Annotated[str, typer.Option(help="Units of a mesh alone.")] = "m-kg-s",
) -> None:
    """List what a mesh holds: mass, sets, materials, plane ends, bores; of a body file its supports and interfaces."""
    from ..calls.functions import check as found

    for line in found(file, units).lines:
        typer.echo(line)


def init(
    mesh: Annotated[Path, typer.Argument(help="Mesh.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Body file; default: beside the mesh.")] = None,
    units: Annotated[str, typer.Option(help="Units of the mesh; default: those in which the body is likely.")] = "",
) -> None:
    """Write a body file to start from: supports and interfaces at reference points and plane ends of a mesh."""
    from ..calls.functions import init as write

    typer.echo(str(write(mesh, output, units)))


def simulate(
    fmu: Annotated[Path, typer.Argument(help="FMU made by flexfmu.")],
    loads: Annotated[Path, typer.Option("--input", "-i", help="Loads over time (CSV: time, then FMU inputs by name).")],
    output: Annotated[Path, typer.Option("--output", "-o", help=r"Results to write (CSV, with units: time \[s]).")],
    step: Annotated[float | None, typer.Option(help="Communication step, s; default: the FMU's own.")] = None,
    stop: Annotated[float | None, typer.Option(help="End, s; default: the last time in the input.")] = None,
    static_start: Annotated[bool, typer.Option(help="Start in equilibrium under the first loads.")] = False,
    parameter: Parameters = None,
    plot: Annotated[Path | None, typer.Option(help="Draw displacements and rotations (PNG, PDF or SVG).")] = None,
    shape: Annotated[
        Path | None, typer.Option("--view", help="Show the body as it moves (.html, .pvd, .png; see `flexfmu view`).")
    ] = None,
) -> None:
    """Drive an FMU by a table of loads and write its motion."""
    from ..files.outputs import PICTURE_SUFFIXES, check_target
    from ..fmu.simulation import outcome, parse_parameters, simulate_csv

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
    parameter: Parameters = None,
    shapes: Annotated[int, typer.Option(min=2, help="Most shapes of a motion.")] = 100,
    live: Annotated[Path | None, typer.Option(help="Page (.html) whose body answers to the pointer.")] = None,
) -> None:
    """Show a mesh, a body, its modes, an equilibrium or a motion: a page to turn and play, or a picture."""
    from ..calls.showing import Request, show
    from ..fmu.simulation import parse_parameters

    if live and output:
        raise typer.BadParameter("it is a page, and --output another: give one of them", param_hint="--live")
    target = live or output or Path(f"{file.stem}.html")
    more = modes, colour, scale, method, parse_parameters(parameter or []), shapes, live is not None
    seen = show(Request(file, target, table, tuple(load or ()), *more), reporter())
    for case in seen.view.cases[:1]:
        typer.echo(f"{case.name}: {case.note}")
    show_written(target)


def couple(
    file: Annotated[Path, typer.Argument(help="Coupling file (TOML): FMUs, connections, springs, scheme.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Results to write (CSV or HDF5).")] = None,
    ssp: Annotated[Path | None, typer.Option(help="System to write for other masters (SSP 1.0).")] = None,
) -> None:
    """Run several FMUs together, linked by connections and by springs between interfaces."""
    from ..calls.functions import couple as run
    from ..master.coupling import write_ssp

    if output is None and ssp is None:
        raise typer.BadParameter("give --output, --ssp or both")
    if ssp is not None:
        write_ssp(file, ssp, reporter())
        typer.echo(f"{ssp}")
    if output is not None:
        run(file, output, reporter())
        typer.echo(f"{output}")


def chart(
    records: Annotated[
        list[Path],
        typer.Option(
            "--records", "-r", help="Records (CSV), a row a model; none is run again, more files are drawn beside."
        ),
    ],
    body: Annotated[Path | None, typer.Argument(help="Body file (TOML); default: the records alone are drawn.")] = None,
    scene: Annotated[Path | None, typer.Option("--scene", "-s", help="Scene file (TOML): loads, tolerance.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Picture to draw (PNG, PDF or SVG).")] = None,
    page: Annotated[Path | None, typer.Option(help="Page to look into (HTML).")] = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="Map where each method stops working instead (docs/scenes.md).")
    ] = False,
    bare: Annotated[bool, typer.Option("--bare", help="Time the models without their FMUs.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help=r"Try every combination of \[sweep], not only those near the best.")
    ] = False,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Try models of a body on a scene, draw error against cost, and name those that nothing beats.

    Begins with few models and draws them at once; goes on where the best are.
    """
    if (body is None) != (scene is None):
        raise typer.BadParameter("a body file and --scene go together; give both, or neither to draw records")
    with _kept(records[0]):
        if stability:
            _map_stability(body, scene, records[0], picture, jobs)
        else:
            from ..calls.functions import chart as draw

            drawn = draw(
                body, scene, records,
                picture=picture, page=page, bare=bare, every=every, jobs=jobs, report=reporter(),
            )  # fmt: skip
            _show(drawn, len(records) > 1, as_json)


@contextmanager
def _kept(records: Path) -> Iterator[None]:
    """Say what is left after Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"what was tried is in {records}, and the same command goes on from there") from error


def _show(shown: "Drawn", several: bool, as_json: bool) -> None:
    from ..files.outputs import json_text
    from ..study.front import describe

    if as_json:
        typer.echo(json_text(shown.named))
        return
    for number, row in enumerate(shown.named, start=1):
        typer.echo(f"#{number:<2} {row.share:8.2g} × tolerance, {describe(row, shown.axis, several=several)}")
    typer.echo(shown.finding)


def _map_stability(body: Path | None, scene: Path | None, records: Path, picture: Path | None, jobs: int) -> None:
    """Run and draw a map of stability; without a body the records are drawn as they are."""
    from ..calls.functions import stability

    if body is None and picture is None:
        raise typer.BadParameter("--stability draws records where no body is given: name a --picture")
    finding = stability(body, scene, records, picture=picture, jobs=jobs, report=reporter()).finding
    for text in filter(None, (finding, picture and str(picture))):
        typer.echo(text)


def fit(
    body: Annotated[Path, typer.Argument(help="Body file (TOML).")],
    scene: Annotated[Path, typer.Option("--scene", "-s", help="Scene file (TOML): loads, tolerance.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Body file to write (TOML).")],
    fmu: Annotated[Path | None, typer.Option(help="FMU to write; default: beside the body file.")] = None,
    verify: Annotated[bool, typer.Option("--verify", help="Compare it with the whole finite element model.")] = False,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Find the smallest, fastest model of a body within a scene's tolerance; write its body file and FMU.

    The last line says pass or fail; the exit code is 0 or 3.
    """
    from ..calls.functions import fit as find
    from ..files.basics import NOT_MET
    from ..files.outputs import fields_of, json_text

    target = fmu or output.with_suffix(".fmu")
    found = find(body, scene, output, fmu=target, verify=verify, jobs=jobs, report=reporter())
    if as_json:
        typer.echo(json_text({"pass": found.met, "verdict": found.verdict, **fields_of(found)}))
    else:
        took = f"{found.tried} models, {found.seconds:.1f} s."
        typer.echo("\n".join([f"{output}, {target}", *found.summary, took, found.verdict]))
    if not found.met:
        raise typer.Exit(NOT_MET)


def damping(
    file: Annotated[Path, typer.Argument(help="Free decay at equal steps (CSV: time, motion).")],
    column: Annotated[str, typer.Option(help="Column of the motion; default: the first after time.")] = "",
) -> None:
    """Find frequencies and damping ratios in a measured decay, as a table for the body file."""
    from ..calls.decay import decay

    for line in decay(file, column).words:
        typer.echo(line)
