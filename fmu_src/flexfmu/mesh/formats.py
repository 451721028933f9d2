"""Mesh files of any kind: decks by our own reader, all else through meshio."""

import contextlib
import hashlib
import io
from pathlib import Path
from typing import Any

import meshio

from flexfmu.errors import MeshError
from flexfmu.inputs import Kind, check_input
from flexfmu.mesh.deck import read_deck
from flexfmu.mesh.in_memory import from_meshio
from flexfmu.mesh.model import Mesh
from flexfmu.mesh.units import UnitSystem

DECK_SUFFIX = ".inp"


def read_mesh(path: Path | str, units: UnitSystem | str = UnitSystem.SI) -> Mesh:
    """Read a body's mesh: a deck (.inp), or any format that meshio knows by its suffix (.msh, .vtk, .bdf ...).

    What files other than decks give is told of in `from_meshio`.

    Parameters
    ----------
    path : path
    units : UnitSystem or str
        What the file's numbers are in.

    Returns
    -------
    Mesh
        SI units. Formats without sets give a mesh without sets.

    Raises
    ------
    MeshError
        The file cannot be read, or holds volume cells of a kind that is not supported, or none.
    DeckError
        A deck's line cannot be honoured.
    """
    path, units = Path(path), UnitSystem(units)
    check_input(path, MeshError, Kind.MESH)
    if path.suffix.lower() == DECK_SUFFIX:
        return read_deck(path, units)
    return from_meshio(_read_with_meshio(path), str(path), units)


def file_origin(path: Path) -> dict[str, str]:
    """Where a mesh file's contents are from, for a body's provenance: name and hash."""
    return {"mesh_file": path.name, "mesh_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _read_with_meshio(path: Path) -> Any:
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(path)
    # meshio ends the interpreter where it cannot read, and lets any exception of its parsers through.
    except (Exception, SystemExit) as failure:
        reason = str(failure) if isinstance(failure, Exception) else ""
        told = " ".join(f"{said.getvalue()} {reason}".split()) or type(failure).__name__
        raise MeshError(f"{path} cannot be read as a mesh: {told}; check the file and its suffix") from failure
