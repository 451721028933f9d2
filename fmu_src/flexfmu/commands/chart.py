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
        Path | None, typer.Argument(help="Body file (TOML); without it the records alone are drawn.")
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
    from ..files.plain_data import json_text
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
