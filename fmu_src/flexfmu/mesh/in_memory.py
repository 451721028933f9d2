"""Meshes that are in memory: of meshio and scikit-fem, or arrays."""

from collections.abc import Mapping
from typing import Any

import meshio
import numpy as np

from flexfmu.errors import MeshError
from flexfmu.mesh.file_sets import cell_groups, node_sets_of
from flexfmu.mesh.model import NO_MATERIAL, ElementBlock, ElementType, FloatArray, IntArray, Mesh
from flexfmu.mesh.units import UnitSystem

# meshio's names. They do not tell full from reduced integration: reduced, as most 20-node models are run.
ELEMENT_TYPES = {
    "tetra": ElementType.C3D4,
    "tetra10": ElementType.C3D10,
    "hexahedron": ElementType.C3D8,
    "hexahedron20": ElementType.C3D20R,
}

# Nodes of a tetrahedron whose first two corners change places.
_MIRRORED = {"tetra": [1, 0, 2, 3], "tetra10": [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]}


def from_meshio(found: Any, title: str, units: UnitSystem) -> Mesh:
    """Mesh of one of meshio.

    It gives no materials and no supports. Its point sets are node sets. Its cell sets and gmsh's physical groups are
    node sets (of the cells' nodes), those of volume cells element sets too; a group without a name is called after its
    kind and number, as in ``"Physical Surface 3"``. Cells of lower dimension serve sets only. 20-node bricks become
    C3D20R. Nodes and elements are numbered from one in the mesh's order.

    Parameters
    ----------
    found : meshio.Mesh
    title : str
        What it is called in messages.
    units : UnitSystem
        What its coordinates are in.

    Returns
    -------
    Mesh
        SI units.

    Raises
    ------
    MeshError
        Volume cells of a kind that is not supported, or none.
    """
    places = _volume_blocks(found, title)
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
        points=_points(found, title) * units.length,
        labels=np.arange(1, count + 1),
        blocks=blocks,
        node_sets=node_sets,
        element_sets=element_sets,
        materials=(),
        fixed=np.zeros((count, 3), dtype=bool),
        notes=notes,
    )


def as_mesh(given: object, units: UnitSystem) -> Mesh:
    """Mesh of what a script has.

    Parameters
    ----------
    given : Mesh, meshio.Mesh, skfem.Mesh, or pair of points (n, 3) and cells
        Cells are an array (k, 4), (k, 8), (k, 10) or (k, 20) of rows of the points in VTK's order, or such arrays by
        meshio's name of the kind, as in ``{"tetra10": array}``.
    units : UnitSystem
        What its coordinates are in; a `Mesh` is in SI units already.

    Returns
    -------
    Mesh
        SI units.

    Raises
    ------
    MeshError
        Something else, or cells that are not supported.
    """
    if isinstance(given, Mesh):
        return given
    if isinstance(given, meshio.Mesh):
        return from_meshio(given, "the mesh", units)
    if type(given).__module__.partition(".")[0] == "skfem":
        return from_meshio(_from_skfem(given), "the scikit-fem mesh", units)
    if isinstance(given, tuple | list) and len(given) == 2:
        return from_meshio(_from_arrays(*given), "the mesh", units)
    raise MeshError(
        f"mesh is a {type(given).__name__}, expected a meshio.Mesh, a mesh of scikit-fem, a pair (points, cells) of "
        "arrays, or a flexfmu.Mesh; a file is read by flexfmu.read_mesh(path)"
    )


def _from_arrays(points: Any, cells: Any) -> meshio.Mesh:
    by_kind = dict(cells) if isinstance(cells, Mapping) else {"": cells}
    widths = {kind.node_count: name for name, kind in ELEMENT_TYPES.items()}
    blocks = []
    for name, rows in by_kind.items():
        array = np.asarray(rows)
        if array.ndim != 2 or not np.issubdtype(array.dtype, np.integer):
            raise MeshError(
                f"cells {name!r} have shape {array.shape} and type {array.dtype}, expected whole numbers (k, nodes of "
                "a cell)"
            )
        kind = name or widths.get(array.shape[1])
        if kind is None or (kind in ELEMENT_TYPES and ELEMENT_TYPES[kind].node_count != array.shape[1]):
            known = ", ".join(f"{count} ({known})" for count, known in sorted(widths.items()))
            raise MeshError(f"cells {name!r} have {array.shape[1]} nodes, expected {known}")
        blocks.append((kind, array))
    return meshio.Mesh(np.asarray(points, dtype=float), blocks)


def _from_skfem(given: Any) -> meshio.Mesh:
    """The same mesh with its subdomains as cell sets, and its boundaries as point sets of whole facets."""
    from skfem.io.meshio import to_meshio

    try:
        found = to_meshio(given, encode_cell_data=False)
    except KeyError as error:
        raise MeshError(f"a {type(given).__name__} of scikit-fem is no solid mesh that meshio knows") from error
    for block in found.cells:
        if block.type in _MIRRORED:
            # scikit-fem sorts the corners of tetrahedra by number: every other one is inside out.
            corners = found.points[block.data[:, :4]]
            inverted = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
            block.data[inverted] = block.data[inverted][:, _MIRRORED[block.type]]
    found.point_sets = {
        name: np.unique(given.dofs.get_facet_dofs(facets).flatten())
        for name, facets in (given.boundaries or {}).items()
    }
    found.cell_sets = {name: [np.asarray(cells)] for name, cells in (given.subdomains or {}).items()}
    return found


def _volume_blocks(found: Any, title: str) -> list[int]:
    """Return the places of the volume cells among the file's cell blocks."""
    places = [place for place, block in enumerate(found.cells) if block.dim == 3 and len(block.data)]
    refused = sorted({found.cells[place].type for place in places} - set(ELEMENT_TYPES))
    supported = ", ".join(f"{name} ({kind.value})" for name, kind in ELEMENT_TYPES.items())
    if refused:
        raise MeshError(
            f"{title} holds cells of the kind {', '.join(refused)}, supported are {supported}; "
            f"mesh the body with these kinds alone"
        )
    if not places:
        kinds = ", ".join(sorted({block.type for block in found.cells})) or "none"
        raise MeshError(
            f"{title} holds no volume cells (found: {kinds}), expected {supported}; export the volume mesh too"
        )
    for block in found.cells:
        if len(block.data) and not 0 <= np.min(block.data) <= np.max(block.data) < len(found.points):
            raise MeshError(f"{title} holds {block.type} cells of points that it does not define; export it again")
    return places


def _points(found: Any, title: str) -> FloatArray:
    points: FloatArray = np.array(found.points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{title} holds points of shape {points.shape}, expected (n, 3); export a mesh in space")
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
