"""Mesh files of any kind: decks by our own reader, all else through meshio."""

import contextlib
import io
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from flexfmu.errors import MeshError
from flexfmu.inputs import Kind, check_input
from flexfmu.mesh.deck import read_deck
from flexfmu.mesh.file_sets import cell_groups, node_sets_of
from flexfmu.mesh.model import NO_MATERIAL, ElementBlock, ElementType, FloatArray, IntArray, Mesh
from flexfmu.mesh.units import UnitSystem

DECK_SUFFIX = ".inp"

# meshio's names. Its files do not tell full from reduced integration: reduced, as most 20-node models are run.
ELEMENT_TYPES = {
    "tetra": ElementType.C3D4,
    "tetra10": ElementType.C3D10,
    "hexahedron": ElementType.C3D8,
    "hexahedron20": ElementType.C3D20R,
}


def read_mesh(path: Path, units: UnitSystem) -> Mesh:
    """Read a body's mesh: a deck (.inp), or any format that meshio knows by its suffix (.msh, .vtk, .bdf ...).

    Files other than decks give no materials and no supports. Their point sets are node sets. Their cell sets and
    gmsh's physical groups are node sets (of the cells' nodes), those of volume cells element sets too; a group
    without a name is called after its kind and number, as in ``"Physical Surface 3"``. Cells of lower dimension
    serve sets only. 20-node bricks become C3D20R. Nodes and elements are numbered from one in the file's order.

    Parameters
    ----------
    path : Path
    units : UnitSystem
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
    check_input(path, MeshError, Kind.MESH)
    if path.suffix.lower() == DECK_SUFFIX:
        return read_deck(path, units)
    found = _read_with_meshio(path)
    places = _volume_blocks(found, path)
    blocks, positions = _element_blocks(found, places)
    groups = cell_groups(found)
    node_sets, notes = node_sets_of(found, groups)
    element_sets = {}
    for name, group in groups.items():
        members = [positions[place][group[place]] for place in places if place in group]
        if members and len(joined := np.unique(np.concatenate(members))):
            element_sets[name] = joined
    count = len(found.points)
    return Mesh(
        points=_points(found, path) * units.length,
        labels=np.arange(1, count + 1),
        blocks=blocks,
        node_sets=node_sets,
        element_sets=element_sets,
        materials=(),
        fixed=np.zeros((count, 3), dtype=bool),
        notes=notes,
    )


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


def _volume_blocks(found: Any, path: Path) -> list[int]:
    """Return the places of the volume cells among the file's cell blocks."""
    places = [place for place, block in enumerate(found.cells) if block.dim == 3 and len(block.data)]
    refused = sorted({found.cells[place].type for place in places} - set(ELEMENT_TYPES))
    supported = ", ".join(f"{name} ({kind.value})" for name, kind in ELEMENT_TYPES.items())
    if refused:
        raise MeshError(
            f"{path} holds cells of the kind {', '.join(refused)}, supported are {supported}; "
            f"mesh the body with these kinds alone"
        )
    if not places:
        kinds = ", ".join(sorted({block.type for block in found.cells})) or "none"
        raise MeshError(
            f"{path} holds no volume cells (found: {kinds}), expected {supported}; export the volume mesh too"
        )
    for block in found.cells:
        if len(block.data) and not 0 <= np.min(block.data) <= np.max(block.data) < len(found.points):
            raise MeshError(f"{path} holds {block.type} cells of points that it does not define; export it again")
    return places


def _points(found: Any, path: Path) -> FloatArray:
    points: FloatArray = np.array(found.points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path} holds points of shape {points.shape}, expected (n, 3); export a mesh in space")
    return points


def _element_blocks(found: Any, places: list[int]) -> tuple[tuple[ElementBlock, ...], dict[int, IntArray]]:
    """Return one block for each type, and the position of each cell of the file's blocks in them."""
    start = {place: sum(len(found.cells[before].data) for before in places if before < place) for place in places}
    kinds = list(dict.fromkeys(ELEMENT_TYPES[found.cells[place].type] for place in places))
    blocks = []
    positions: dict[int, IntArray] = {}
    end = 0
    for kind in kinds:
        chosen = [place for place in places if ELEMENT_TYPES[found.cells[place].type] is kind]
        labels = []
        for place in chosen:
            count = len(found.cells[place].data)
            labels.append(np.arange(start[place] + 1, start[place] + count + 1))
            positions[place] = np.arange(end, end + count)
            end += count
        connectivity = np.concatenate([found.cells[place].data for place in chosen]).astype(np.int64)
        material = np.full(len(connectivity), NO_MATERIAL, dtype=np.int64)
        blocks.append(ElementBlock(kind, np.concatenate(labels), connectivity, material))
    return tuple(blocks), positions
