"""`flexfmu chart`: error and cost of many models of a body."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .common import Jobs, Json, reporter

if TYPE_CHECKING:
    from ..study.chart.draw import Drawn


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
        bool, typer.Option("--stability", help="Map where each method stops working instead (docs/scenes.md).")
    ] = False,
    bare: Annotated[bool, typer.Option("--bare", help="Time the models without their FMUs.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help=r"Try every combination of \[sweep], not only those near the best.")
    ] = False,
    jobs: Jobs = "1",
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
            _show(_try_models(body, scene, records, picture, page, bare, every, jobs), len(records) > 1, as_json)


@contextmanager
def _kept(records: Path) -> Iterator[None]:
    """Say what is left after Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"what was tried is in {records}, and the same command goes on from there") from error


def _try_models(
    body: Path | None,
    scene: Path | None,
    records: list[Path],
    picture: Path | None,
    page: Path | None,
    bare: bool,
    every: bool,
    jobs: str,
) -> "Drawn":
    """Try models and draw them; without a body the records are drawn as they are."""
    from ..files.store import Store, default_folder
    from ..study.chart.draw import chart as draw
    from ..study.chart.draw import check_targets
    from ..study.chart.sweep import sweep
    from ..study.jobs import Crew
    from ..study.scene.scene import read_scene

    check_targets(records, picture, page)
    drawn: list[Drawn] = []
    if body is not None and scene is not None:
        report, found = reporter(), read_scene(scene, body)

        def look(extent: str) -> None:
            drawn[:] = [draw(records, picture, page, extent if len(records) == 1 else "")]
            if extent.startswith("coarse"):
                report.note(f"{extent}: {drawn[0].finding}")

        with Crew(jobs) as crew:
            sweep(found, records[0], report, Store(default_folder()), not bare, crew, every, look)
    return drawn[0] if drawn else draw(records, picture, page)


def _show(shown: "Drawn", several: bool, as_json: bool) -> None:
    from ..files.plain_data import json_text
    from ..study.front import describe

    if as_json:
        typer.echo(json_text(shown.named))
        return
    for number, row in enumerate(shown.named, start=1):
        typer.echo(f"#{number:<2} {row.share:8.2g} × tolerance, {describe(row, shown.axis, several=several)}")
    typer.echo(shown.finding)


def _map_stability(body: Path | None, scene: Path | None, records: Path, picture: Path | None, jobs: str) -> None:
    """Run and draw a map of stability; without a body the records are drawn as they are."""
    from ..files.store import Store, default_folder
    from ..study.jobs import Crew
    from ..study.scene.scene import read_scene
    from ..study.stability import draw_map, map_stability

    if body is not None and scene is not None:
        with Crew(jobs) as crew:
            found = read_scene(scene, body)
            typer.echo(map_stability(found, records, picture, reporter(), Store(default_folder()), crew))
    elif picture is not None:
        draw_map(records, picture)
    else:
        raise typer.BadParameter("--stability draws records where no body is given: name a --picture")
    if picture is not None:
        typer.echo(str(picture))
