"""The `flexfmu` command: build, pack, info, simulate, view, couple, chart and fit."""

from collections.abc import Callable
from contextvars import ContextVar
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperGroup

from .. import __version__
from ..files.errors import INTERRUPTED, NOT_MET, FlexfmuError
from ..files.progress import ConsoleReporter, keeps_interrupts
from ..fmu.runtime import Runtime
from ..model.errors import RuntimeBodyError


class _Loudness(Enum):
    """How much a command says on standard error."""

    USUAL = ""
    QUIET = "quiet"
    VERBOSE = "verbose"


_LOUDNESS = ContextVar("loudness", default=_Loudness.USUAL)
_FLAGS = {
    "-q": _Loudness.QUIET,
    "--quiet": _Loudness.QUIET,
    "-v": _Loudness.VERBOSE,
    "--verbose": _Loudness.VERBOSE,
}


class _Commands(TyperGroup):
    """Commands whose common options stand before or after the command's name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        found = [_FLAGS[word] for word in args if word in _FLAGS]
        _LOUDNESS.set(found[-1] if found else _Loudness.USUAL)
        return super().parse_args(ctx, [word for word in args if word not in _FLAGS])


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    help="Turn finite element models of flexible bodies into FMI 2.0 co-simulation FMUs that stay right when the body "
    "bends far.",
)
Json = Annotated[bool, typer.Option("--json", help="Write the result as JSON.")]


def _reporter() -> ConsoleReporter:
    return ConsoleReporter(quiet=_LOUDNESS.get() is _Loudness.QUIET)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"flexfmu {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show it.")] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say nothing but warnings, errors and results; also after a command.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show where in the code an error arose; also after a command.")
    ] = False,
) -> None:
    """Options of all commands."""


def _run(job: Callable[[], None], kept: str = "nothing was written") -> None:
    """Turn a user's errors, and Ctrl-C, into a message and an exit code; `kept` says what is left after Ctrl-C."""
    try:
        with keeps_interrupts():
            job()
    except (FlexfmuError, RuntimeBodyError, OSError) as error:
        console = Console(stderr=True, highlight=False)
        if _LOUDNESS.get() is _Loudness.VERBOSE:
            console.print_exception()
        console.print(f"[red]error:[/] {escape(str(error))}", soft_wrap=True)
        raise typer.Exit(error.exit_code if isinstance(error, FlexfmuError) else 1) from error
    except KeyboardInterrupt as error:
        Console(stderr=True, highlight=False).print(f"[red]ended by Ctrl-C;[/] {escape(kept)}")
        raise typer.Exit(INTERRUPTED) from error


@app.command()
def build(
    body: Annotated[Path, typer.Argument(help="Body file (TOML).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="FMU to write; default: NAME.fmu here.")] = None,
    modal_file: Annotated[Path | None, typer.Option(help="Keep the modal file (.h5) here as well.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Find everything anew, and keep nothing.")] = False,
    runtime: Annotated[
        Runtime, typer.Option(help="What runs the body: the core in C, or pythonfmu and a Python over the same core.")
    ] = Runtime.NATIVE,
    platforms: Annotated[
        str, typer.Option(help="Where it runs: all, or some of linux64,win64,darwin64,aarch64-linux; default: here.")
    ] = "",
) -> None:
    """Reduce a finite element body and write its FMU; modes are kept for the next build of the same mesh."""
    from ..build.config import read_body_file
    from ..files.store import Store, default_folder
    from .pipeline import build_fmu

    def job() -> None:
        target = output or Path(f"{read_body_file(body).name}.fmu")
        store = Store(None if fresh else default_folder())
        names = [name.strip() for name in platforms.split(",") if name.strip()]
        build_fmu(body, target, modal_file, _reporter(), store, runtime, names)
        typer.echo(f"{target} ({target.stat().st_size / 1024:.0f} KiB)")

    _run(job)


@app.command()
def pack(
    file: Annotated[Path, typer.Argument(help="Modes of another program (.npz, .h5), SID_FEM, or a modal file (.h5).")],
    interface: Annotated[list[str] | None, typer.Option(help="NAME=SET; may be repeated.")] = None,
    support: Annotated[list[str] | None, typer.Option(help="SET where frames hang if no node is held.")] = None,
    frames: Annotated[int | None, typer.Option(help="Frames; default: 1.")] = None,
    method: Annotated[str | None, typer.Option(help="Method; default: frames.")] = None,
    damping: Annotated[float, typer.Option(help="Modal damping ratio; default: that of the modes.")] = 0.0,
    name: Annotated[str | None, typer.Option(help="Name of the body; default: that of the modes.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="FMU to write; default: NAME.fmu here.")] = None,
) -> None:
    """Make an FMU of modes that another program found (docs/given-modes.md), or of a modal file."""
    from ..given.packing import pack_file

    def job() -> None:
        body = pack_file(file, interface or [], support or [], frames, method, damping, name, ConsoleReporter())
        target = body.fmu(output or Path(f"{body.model.name}.fmu"))
        typer.echo(f"{target} ({target.stat().st_size / 1024:.0f} KiB)")

    _run(job)


@app.command()
def info(
    file: Annotated[Path, typer.Argument(help="FMU or modal file.")],
    cost: Annotated[
        bool, typer.Option("--cost", help="Time a step of every method that the body has the data for.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show what is in an FMU or a modal file: modes, interfaces, tree of frames, origin."""
    from ..files.plain_data import json_text
    from ..fmu.package import read_packaged_body
    from ..study.cost import step_costs
    from .info import cost_table, data, describe

    def job() -> None:
        body = read_packaged_body(file)
        costs = step_costs(body, _reporter()) if cost else []
        if as_json:
            typer.echo(json_text({**data(body), **({"cost": costs} if cost else {})}))
            return
        console = Console(highlight=False)
        for part in describe(body):
            console.print(part)
        if cost:
            console.print(cost_table(costs))

    _run(job)


@app.command()
def check(
    file: Annotated[Path, typer.Argument(help="Body file (TOML), or a mesh alone.")],
    units: Annotated[str, typer.Option(help="Units of a mesh alone.")] = "m-kg-s",
) -> None:
    """List what a mesh holds: mass, sets, materials, plane ends, bores; of a body file its supports and interfaces."""
    from ..build.choices import unit_system
    from ..build.config import read_body_file
    from ..build.suggest import chosen_nodes, mass_lines, mesh_lines
    from ..mesh.checks import checked
    from ..mesh.formats import read_mesh
    from ..reduction.model import assemble_model

    def job() -> None:
        config = read_body_file(file) if file.suffix.lower() == ".toml" else None
        path, system = (file, unit_system(units)) if config is None else (config.mesh.file, config.mesh.units)
        mesh = checked(read_mesh(path, system))
        for line in mesh_lines(mesh):
            typer.echo(line)
        if config is not None:
            for title, rows in chosen_nodes(mesh, config).items():
                typer.echo(f"{title}: {len(rows)} nodes")
            model = assemble_model(mesh, config)
            mesh = model.mesh
            typer.echo(f"{model.free.size} free degrees of freedom")
        for line in mass_lines(mesh):
            typer.echo(line)

    _run(job)


@app.command()
def init(
    mesh: Annotated[Path, typer.Argument(help="Mesh.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Body file; default: beside the mesh.")] = None,
    units: Annotated[str, typer.Option(help="Units of the mesh.")] = "m-kg-s",
) -> None:
    """Write a body file to start from: supports and interfaces at reference points and plane ends of a mesh."""
    from ..build.choices import unit_system
    from ..build.suggest import starting_body_file
    from ..files.errors import OutputError
    from ..mesh.checks import checked
    from ..mesh.formats import read_mesh

    def job() -> None:
        target = output or mesh.with_suffix(".toml")
        if target.exists():
            raise OutputError(f"{target} is there already: name another with --output")
        system = unit_system(units)
        found = checked(read_mesh(mesh, system))
        named = Path(mesh.name) if target.parent.resolve() == mesh.parent.resolve() else mesh.resolve()
        target.write_text(starting_body_file(found, named, system), encoding="utf-8")
        typer.echo(str(target))

    _run(job)


@app.command()
def simulate(
    fmu: Annotated[Path, typer.Argument(help="FMU made by flexfmu.")],
    loads: Annotated[Path, typer.Option("--input", "-i", help="Loads over time (CSV: time, then FMU inputs by name).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Results to write (CSV).")],
    step: Annotated[float | None, typer.Option(help="Communication step, s; default: the FMU's own.")] = None,
    stop: Annotated[float | None, typer.Option(help="End, s; default: the last time in the input.")] = None,
    static_start: Annotated[bool, typer.Option(help="Start in equilibrium under the first loads.")] = False,
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter, NAME=VALUE; may be repeated.")
    ] = None,
    units: Annotated[bool, typer.Option("--units", help=r"Write units into the header: time \[s].")] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw displacements and rotations (PNG, PDF or SVG).")] = None,
    shape: Annotated[
        Path | None, typer.Option("--view", help="Show the body as it moves (.html, .pvd, .png; see `flexfmu view`).")
    ] = None,
) -> None:
    """Drive an FMU by a table of loads and write its motion."""
    from ..files.targets import PICTURE_SUFFIXES, check_target
    from ..fmu.outcome import outcome
    from ..fmu.simulation import parse_parameters, simulate_csv

    def job() -> None:
        if plot is not None:
            check_target(plot, PICTURE_SUFFIXES, inputs=(fmu, loads, output))
        if shape is not None:
            from ..view.command import SUFFIXES, show_simulation

            check_target(shape, SUFFIXES, inputs=(fmu, loads, output))
        settings = parse_parameters(parameter or [])
        if static_start:
            if settings.get("initialization", "static") != "static":
                raise typer.BadParameter("--static-start and --set initialization=… contradict each other; give one")
            settings["initialization"] = "static"
        report = _reporter()
        outputs, result = simulate_csv(fmu, loads, output, step, stop, settings, report, units)
        if plot is not None:
            from .plots import plot_result

            plot_result(output, plot)
        if shape is not None:
            show_simulation(fmu, loads, output, shape, settings, report)
        typer.echo(outcome(outputs, result, report.warnings))
        typer.echo(", ".join(str(path) for path in (output, plot, shape) if path is not None))

    _run(job)


@app.command()
def view(
    file: Annotated[Path, typer.Argument(help="FMU, modal file, body file or mesh.")],
    table: Annotated[
        Path | None, typer.Argument(help="Loads over time (CSV), as for simulate: the motion under them.")
    ] = None,
    load: Annotated[
        list[str] | None,
        typer.Option("--load", "-l", help="A load that holds still, such as tip.force.y=5kN; may be repeated."),
    ] = None,
    modes: Annotated[int, typer.Option("--modes", "-m", min=0, help="Show so many mode shapes.")] = 0,
    static: Annotated[bool, typer.Option("--static", help="Each row of the table by its equilibrium.")] = False,
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
    step: Annotated[float | None, typer.Option(help="Communication step, s; default: the FMU's own.")] = None,
    stop: Annotated[float | None, typer.Option(help="End, s; default: the last time in the table.")] = None,
    shapes: Annotated[int, typer.Option(min=2, help="Most shapes of a motion.")] = 100,
) -> None:
    """Show a mesh, a body, its modes, an equilibrium or a motion: a page to turn and play, or a picture."""
    from ..fmu.simulation import parse_parameters
    from ..view.command import Request, show

    def job() -> None:
        target = output or Path(f"{file.stem}.html")
        settings = parse_parameters(parameter or [])
        request = Request(
            file, target, table, tuple(load or ()), static, modes, colour, scale, method, settings, step, stop, shapes
        )
        seen = show(request, _reporter())
        for case in seen.cases[:1]:
            typer.echo(f"{case.name}: {case.note}")
        typer.echo(f"{target} ({target.stat().st_size / 1024:.0f} KiB)")

    _run(job)


@app.command()
def couple(
    file: Annotated[Path, typer.Argument(help="Coupling file (TOML): FMUs, connections, springs, scheme.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Results to write (CSV or HDF5).")],
) -> None:
    """Run several FMUs together, linked by connections and by springs between interfaces."""
    from ..master import run

    def job() -> None:
        run(file, output, _reporter())
        typer.echo(f"{output}")

    _run(job)


Jobs = Annotated[
    str,
    typer.Option(
        "--jobs",
        "-j",
        help="Processes that measure errors (-1: one a core), or a Dask scheduler (tcp://host:8786).",
    ),
]
Scene = Annotated[Path, typer.Option("--scene", "-s", help="Scene file (TOML): loads, tolerance.")]


@app.command()
def chart(
    records: Annotated[
        list[Path],
        typer.Option(
            "--records",
            "-r",
            help="Records (CSV), one row a model; what is in them is not run again. Given more than once, the others "
            "are drawn beside the first.",
        ),
    ],
    body: Annotated[
        Path | None, typer.Argument(help="Body file (TOML); without it the records are drawn as they are.")
    ] = None,
    scene: Annotated[Path | None, typer.Option("--scene", "-s", help="Scene file (TOML): loads, tolerance.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Picture to draw (PNG, PDF or SVG).")] = None,
    page: Annotated[Path | None, typer.Option(help="Page to look into (HTML).")] = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="Map where each method stops working instead (docs/stability.md).")
    ] = False,
    bare: Annotated[bool, typer.Option("--bare", help="Time the models without their FMUs.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help="Try every combination of [sweep], not only those near the best.")
    ] = False,
    jobs: Jobs = "1",
    as_json: Json = False,
) -> None:
    """Try models of a body on a scene, draw error against cost, and name those that nothing beats.

    Begins with few models and draws them at once; goes on where the best are.
    """
    from ..files.plain_data import json_text
    from ..files.store import Store, default_folder
    from ..study.chart.draw import Drawn, check_targets
    from ..study.chart.draw import chart as draw
    from ..study.chart.front import describe
    from ..study.chart.sweep import sweep
    from ..study.scenes.jobs import Crew
    from ..study.scenes.scene import read_scene

    def job() -> None:
        if (body is None) != (scene is None):
            raise typer.BadParameter("a body file and --scene go together; give both, or neither to draw records")
        if stability:
            _map_stability(body, scene, records[0], picture, jobs)
            return
        check_targets(records, picture, page)
        drawn: list[Drawn] = []
        if body is not None and scene is not None:
            report, found = _reporter(), read_scene(scene, body)

            def look(extent: str) -> None:
                drawn[:] = [draw(records, picture, page, extent if len(records) == 1 else "")]
                if extent.startswith("coarse"):
                    report.note(f"{extent}: {drawn[0].finding}")

            with Crew(jobs) as crew:
                sweep(found, records[0], report, Store(default_folder()), not bare, crew, every, look)
        shown = drawn[0] if drawn else draw(records, picture, page)
        if as_json:
            typer.echo(json_text(shown.named))
            return
        for number, row in enumerate(shown.named, start=1):
            words = describe(row, shown.axis, several=len(records) > 1)
            typer.echo(f"#{number:<2} {row.share:8.2g} × tolerance, {words}")
        typer.echo(shown.finding)

    _run(job, f"what was tried is in {records[0]}, and the same command goes on from there")


def _map_stability(body: Path | None, scene: Path | None, records: Path, picture: Path | None, jobs: str) -> None:
    """Run and draw the maps of stability; without a body the records are drawn as they are."""
    from ..files.store import Store, default_folder
    from ..study.scenes.jobs import Crew
    from ..study.stability.maps import chart_stability
    from ..study.stability.picture import pictures

    if body is not None and scene is not None:
        with Crew(jobs) as crew:
            lines = chart_stability(body, scene, records, picture, _reporter(), Store(default_folder()), crew)
    elif picture is not None:
        lines = [str(path) for path in pictures(records, picture)]
    else:
        raise typer.BadParameter("--stability draws records where no body is given: name a --picture")
    typer.echo("\n".join(lines))


@app.command()
def fit(
    body: Annotated[Path, typer.Argument(help="Body file (TOML).")],
    scene: Scene,
    output: Annotated[Path, typer.Option("--output", "-o", help="Body file to write (TOML).")],
    fmu: Annotated[Path | None, typer.Option(help="FMU to write; default: beside the body file.")] = None,
    jobs: Jobs = "1",
    as_json: Json = False,
) -> None:
    """Find the smallest, fastest model of a body within a scene's tolerance; write its body file and FMU.

    The last line says pass or fail; the exit code is 0 or 3.
    """
    from ..files.plain_data import fields_of, json_text
    from ..files.store import Store, default_folder
    from ..study.fit.search import fit as find
    from ..study.scenes.jobs import Crew
    from ..study.scenes.scene import read_scene

    def job() -> None:
        target = fmu or output.with_suffix(".fmu")
        with Crew(jobs) as crew:
            found = find(read_scene(scene, body), output, _reporter(), Store(default_folder()), target, crew)
        if as_json:
            typer.echo(json_text({"pass": found.met, "verdict": found.verdict, **fields_of(found)}))
        else:
            took = f"{found.tried} models, {found.seconds:.1f} s."
            typer.echo("\n".join([f"{output}, {target}", *found.summary, took, found.verdict]))
        if not found.met:
            raise typer.Exit(NOT_MET)

    _run(job)


def main() -> None:
    """Entry point of the console command."""
    app(prog_name="flexfmu")


if __name__ == "__main__":
    main()
