"""`flexfmu check`: what a mesh holds, and what a body file chooses of it."""

from pathlib import Path
from typing import Annotated

import typer


def check(
    file: Annotated[Path, typer.Argument(help="Body file (TOML), or a mesh alone.")],
    units: Annotated[str, typer.Option(help="Units of a mesh alone.")] = "m-kg-s",
) -> None:
    """List what a mesh holds: mass, sets, materials, plane ends, bores; of a body file its supports and interfaces."""
    from ..build.body_model import body_model
    from ..build.config import read_body_file
    from ..build.suggest import chosen_nodes, mass_lines, mesh_lines
    from ..files.units import unit_system
    from ..mesh.checks import checked
    from ..mesh.formats import read_mesh

    config = read_body_file(file) if file.suffix.lower() == ".toml" else None
    path, system = (file, unit_system(units)) if config is None else (config.mesh.file, config.mesh.units)
    mesh = checked(read_mesh(path, system))
    for line in mesh_lines(mesh):
        typer.echo(line)
    if config is not None:
        for title, rows in chosen_nodes(mesh, config).items():
            typer.echo(f"{title}: {len(rows)} nodes")
        model = body_model(mesh, config).model
        mesh = model.mesh
        typer.echo(f"{model.free.size} free degrees of freedom")
    for line in mass_lines(mesh):
        typer.echo(line)
