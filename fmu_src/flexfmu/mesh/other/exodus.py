"""Exodus II files: NetCDF of either kind, read by SciPy or h5py."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
from scipy.io import netcdf_file

from flexfmu.files.array_types import IntArray
from flexfmu.files.errors import MeshError
from flexfmu.mesh.in_memory import Contents
from flexfmu.mesh.other.extras import quiet

# meshio's kind by the first three letters and the number of nodes, and where its nodes stand in Exodus: mid-side nodes
# of bricks and wedges come around the bottom, up the sides, around the top.
_KINDS = {
    ("TET", 4): ("tetra", [*range(4)]),
    ("TET", 10): ("tetra10", [*range(10)]),
    ("HEX", 8): ("hexahedron", [*range(8)]),
    ("HEX", 20): ("hexahedron20", [*range(12), *range(16, 20), *range(12, 16)]),
    ("WED", 6): ("wedge", [*range(6)]),
    ("WED", 15): ("wedge15", [*range(9), 12, 13, 14, 9, 10, 11]),
    ("TRI", 3): ("triangle", [*range(3)]),
    ("TRI", 6): ("triangle6", [*range(6)]),
    ("QUA", 4): ("quad", [*range(4)]),
    ("QUA", 8): ("quad8", [*range(8)]),
    ("SHE", 4): ("quad", [*range(4)]),
    ("SHE", 8): ("quad8", [*range(8)]),
    ("BAR", 2): ("line", [*range(2)]),
    ("BAR", 3): ("line3", [*range(3)]),
}
# Corners of each side, in the order in which Exodus numbers them.
_SIDES = {
    "tetra": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "wedge": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "hexahedron": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
}
# Corners between which mid-side nodes lie, in meshio's order.
_EDGES = {
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
_HDF5 = b"\x89HDF"


def read_exodus(path: Path) -> Contents:
    """Read element blocks, node sets and side sets, by their names or as "block n", "node set n", "side set n".

    Parameters
    ----------
    path : Path

    Returns
    -------
    Contents

    Raises
    ------
    MeshError
        The file cannot be read, or has blocks of unknown kinds.
    """
    with quiet(path, "check the file; expected Exodus II"), path.open("rb") as start:
        if start.read(4) == _HDF5:
            with h5py.File(path) as file:
                return _contents(_from_hdf5(file), path)
        with netcdf_file(path, mmap=False) as file:
            return _contents(_from_netcdf(file), path)


def _contents(variables: Mapping[str, Any], path: Path) -> Contents:
    if "coord" in variables:
        points = np.asarray(variables["coord"]["data"], dtype=float).T
    else:
        points = np.stack([np.asarray(variables[f"coord{axis}"]["data"], dtype=float) for axis in "xyz"], axis=1)
    cells, names, sets = [], _names(variables, "eb_names"), {}
    count = sum(key.startswith("connect") for key in variables)
    for number in range(1, count + 1):
        given = variables[f"connect{number}"]
        rows = np.asarray(given["data"], dtype=np.int64) - 1
        title = given["elem_type"].upper()
        found = _KINDS.get((title[:3], rows.shape[1]))
        if found is None:
            raise MeshError(
                f"{path}: block {number} is of the kind {title} with {rows.shape[1]} nodes, expected TET, WEDGE or HEX "
                "of first or second order"
            )
        cells.append((found[0], rows[:, found[1]]))
    for number in range(count):
        name = names[number] if number < len(names) and names[number] else f"block {number + 1}"
        sets[name] = [np.arange(len(cells[k][1])) if k == number else np.zeros(0, int) for k in range(count)]
    point_sets = {}
    names = _names(variables, "ns_names")
    for number in range(1, 1 + sum(key.startswith("node_ns") for key in variables)):
        name = names[number - 1] if number <= len(names) and names[number - 1] else f"node set {number}"
        point_sets[name] = np.asarray(variables[f"node_ns{number}"]["data"], dtype=np.int64) - 1
    names = _names(variables, "ss_names")
    for number in range(1, 1 + sum(key.startswith("elem_ss") for key in variables)):
        name = names[number - 1] if number <= len(names) and names[number - 1] else f"side set {number}"
        elements = np.asarray(variables[f"elem_ss{number}"]["data"], dtype=np.int64) - 1
        sides = np.asarray(variables[f"side_ss{number}"]["data"], dtype=np.int64) - 1
        nodes = _side_nodes(cells, elements, sides)
        point_sets[name] = np.union1d(point_sets.get(name, nodes), nodes)
    labels = variables.get("node_num_map")
    mesh = meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=sets)
    return Contents(mesh, None if labels is None else np.asarray(labels["data"], dtype=np.int64))


def _side_nodes(cells: list[tuple[str, IntArray]], elements: IntArray, sides: IntArray) -> IntArray:
    """Nodes of sides of solids, mid-side nodes too; sides of other elements are all of their nodes."""
    found = []
    start = 0
    for kind, rows in cells:
        inside = (elements >= start) & (elements < start + len(rows))
        family = kind.rstrip("0123456789")
        for side in np.unique(sides[inside]).tolist():
            chosen = rows[elements[inside & (sides == side)] - start]
            if family in _SIDES:
                corners = _SIDES[family][side]
                first = max(max(face) for face in _SIDES[family]) + 1
                middle = [first + k for k, edge in enumerate(_EDGES[family]) if set(edge) <= set(corners)]
                chosen = chosen[:, [*corners, *(node for node in middle if node < rows.shape[1])]]
            found.append(chosen.ravel())
        start += len(rows)
    return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)


def _names(variables: Mapping[str, Any], key: str) -> list[str]:
    """Names of blocks or sets; rows of single characters."""
    if key not in variables:
        return []
    rows = np.asarray(variables[key]["data"])
    return [b"".join(row.tolist()).split(b"\0")[0].decode("latin-1").strip() for row in rows]


def _from_hdf5(file: Any) -> dict[str, dict[str, Any]]:
    return {key: {"data": value[()], "elem_type": _text(value.attrs.get("elem_type"))} for key, value in file.items()}


def _from_netcdf(file: Any) -> dict[str, dict[str, Any]]:
    return {
        key: {"data": value.data, "elem_type": _text(getattr(value, "elem_type", None))}
        for key, value in file.variables.items()
    }


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else "" if value is None else str(value)
