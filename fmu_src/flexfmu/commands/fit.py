"""`flexfmu fit`: the smallest model within a tolerance."""

from pathlib import Path
from typing import Annotated

import typer

from .common import Jobs, Json, reporter


def fit(
    body: Annotated[Path, typer.Argument(help="Body file (TOML).")],
    scene: Annotated[Path, typer.Option("--scene", "-s", help="Scene file (TOML): loads, tolerance.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Body file to write (TOML).")],
    fmu: Annotated[Path | None, typer.Option(help="FMU to write; default: beside the body file.")] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compare the result with the whole finite element model.")
    ] = False,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Find the smallest, fastest model of a body within a scene's tolerance; write its body file and FMU.

    The last line says pass or fail; the exit code is 0 or 3.
    """
    from ..calls.functions import fit as find
    from ..files.basics import NOT_MET
    from ..files.plain_data import fields_of, json_text

    target = fmu or output.with_suffix(".fmu")
    found = find(body, scene, output, fmu=target, verify=verify, jobs=jobs, report=reporter())
    if as_json:
        typer.echo(json_text({"pass": found.met, "verdict": found.verdict, **fields_of(found)}))
    else:
        took = f"{found.tried} models, {found.seconds:.1f} s."
        typer.echo("\n".join([f"{output}, {target}", *found.summary, took, found.verdict]))
    if not found.met:
        raise typer.Exit(NOT_MET)
