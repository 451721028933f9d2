"""`flexfmu init`: a body file to start from."""

from pathlib import Path
from typing import Annotated

import typer


def init(
    mesh: Annotated[Path, typer.Argument(help="Mesh.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Body file; default: beside the mesh.")] = None,
    units: Annotated[str, typer.Option(help="Units of the mesh; default: those in which the body is likely.")] = "",
) -> None:
    """Write a body file to start from: supports and interfaces at reference points and plane ends of a mesh."""
    from ..build.suggest import likely_mesh, starting_body_file
    from ..files.errors import OutputError
    from ..files.units import unit_system
    from ..mesh.checks import checked
    from ..mesh.formats import read_mesh

    target = output or mesh.with_suffix(".toml")
    if target.exists():
        raise OutputError(f"{target} is there already: name another with --output")
    if units:
        system = unit_system(units)
        found = read_mesh(mesh, system)
    else:
        found, system = likely_mesh(mesh)
    found = checked(found)
    named = Path(mesh.name) if target.parent.resolve() == mesh.parent.resolve() else mesh.resolve()
    target.write_text(starting_body_file(found, named, system), encoding="utf-8")
    typer.echo(str(target))
