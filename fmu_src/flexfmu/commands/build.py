"""`flexfmu build`: a body file becomes an FMU."""

import math
from pathlib import Path
from typing import Annotated

import typer

from ..fmu.runtime import Runtime
from .common import reporter, show_written


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
    tolerance: Annotated[
        str, typer.Option(help="Build the plainest model with an error below this, such as 0.5%.")
    ] = "",
    scene: Annotated[
        Path | None, typer.Option("--scene", "-s", help="Loads at which --tolerance counts; default: reference loads.")
    ] = None,
) -> None:
    """Reduce a finite element body and write its FMU; modes are kept for the next build of the same mesh."""
    from ..build.config import read_body_file
    from ..build.reduce import build_fmu
    from ..files.basics import NOT_MET, plural
    from ..files.store import Store, default_folder
    from ..study.candidates import times
    from ..study.smallest import own_error, smallest

    config, share = read_body_file(body), 0.0
    target = output or Path(f"{config.name}.fmu")
    store = Store(None if fresh else default_folder())
    names = [name.strip() for name in platforms.split(",") if name.strip()]
    if tolerance:
        config, share = smallest(body, _share(tolerance), scene, reporter(not force), store)
    report = reporter(not force)
    built = build_fmu(config, target, modal_file, report, store, runtime, names, fmi)
    for text in filter(None, [own_error(built)]):
        report.note(text)
    show_written(target)
    if not tolerance:
        return
    typer.echo(
        f"{plural(built.frame_count, 'frame')}, {plural(built.mode_count, 'mode')}: {times(share)} × the tolerance"
    )
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
