"""`flexfmu build`: a body file becomes an FMU."""

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
    platforms: Annotated[
        str, typer.Option(help="Where it runs: all, or some of linux64,win64,darwin64,aarch64-linux; default: here.")
    ] = "",
) -> None:
    """Reduce a finite element body and write its FMU; modes are kept for the next build of the same mesh."""
    from ..build.config import read_body_file
    from ..build.pipeline import build_fmu
    from ..files.store import Store, default_folder

    target = output or Path(f"{read_body_file(body).name}.fmu")
    store = Store(None if fresh else default_folder())
    names = [name.strip() for name in platforms.split(",") if name.strip()]
    build_fmu(body, target, modal_file, reporter(), store, runtime, names)
    show_written(target)
