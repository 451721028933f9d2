"""Exodus II files: NetCDF of either kind, read by SciPy or h5py."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
from scipy.io import netcdf_file

from flexfmu.files.basics import IntArray, MeshError
from flexfmu.mesh.elements import ASSUMED
from flexfmu.mesh.in_memory import Contents
from flexfmu.mesh.other.extras import quiet
from flexfmu.mesh.shapes import FACE_SHAPES

# Shapes by the first three letters and the number of nodes.
_SOLIDS = [kind.shape for kind in ASSUMED.values()]
_KINDS = {(shape.polytope.exodus, len(shape.nodes)): shape for shape in (*_SOLIDS, *FACE_SHAPES.values())}
_KINDS |= {("SHE", count): FACE_SHAPES[count] for count in (4, 8, 9)}
_EDGES = {("BAR", 2): "line", ("BAR", 3): "line3"}
# Where the faces of solids stand in Exodus' order of sides.
_SIDES = {"TET": (1, 2, 3, 0), "WED": (2, 3, 4, 0, 1), "HEX": (2, 3, 4, 5, 0, 1)}
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
    cells = []
    blocks = _titles(variables, "connect", "eb_names", "block")
    for number in range(1, len(blocks) + 1):
        given = variables[f"connect{number}"]
        rows = np.asarray(given["data"], dtype=np.int64) - 1
        title = given["elem_type"].upper()
        key = title[:3], rows.shape[1]
        if key not in _KINDS and key not in _EDGES:
            raise MeshError(
                f"{path}: block {number} is of the kind {title} with {rows.shape[1]} nodes, expected TET, WEDGE or HEX "
                "of first or second order"
            )
        cells.append((_KINDS[key].name, rows[:, _KINDS[key].layered]) if key in _KINDS else (_EDGES[key], rows))
    none = np.zeros(0, int)
    sets = {name: [np.arange(len(rows)) if k == place else none for k, (_, rows) in enumerate(cells)]
            for place, name in enumerate(blocks)}  # fmt: skip
    point_sets = {
        name: np.asarray(variables[f"node_ns{number}"]["data"], dtype=np.int64) - 1
        for number, name in enumerate(_titles(variables, "node_ns", "ns_names", "node set"), start=1)
    }
    for number, name in enumerate(_titles(variables, "elem_ss", "ss_names", "side set"), start=1):
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
        for side in np.unique(sides[inside]).tolist():
            chosen = rows[elements[inside & (sides == side)] - start]
            if kind in ASSUMED:
                shape = ASSUMED[kind].shape
                chosen = chosen[:, shape.faces[_SIDES[shape.polytope.exodus][side]]]
            found.append(chosen.ravel())
        start += len(rows)
    return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)


def _titles(variables: Mapping[str, Any], key: str, names: str, kind: str) -> list[str]:
    """Names of the blocks or sets with a variable each, called after their kind and number where they have none."""
    rows = np.asarray(variables[names]["data"]) if names in variables else ()
    given = [b"".join(row.tolist()).split(b"\0")[0].decode("latin-1").strip() for row in rows]
    count = sum(name.startswith(key) for name in variables)
    return [name or f"{kind} {number}" for number, name in enumerate([*given, *[""] * count][:count], start=1)]


def _from_hdf5(file: Any) -> dict[str, dict[str, Any]]:
    return {key: {"data": value[()], "elem_type": _text(value.attrs.get("elem_type"))} for key, value in file.items()}


def _from_netcdf(file: Any) -> dict[str, dict[str, Any]]:
    return {
        key: {"data": value.data, "elem_type": _text(getattr(value, "elem_type", None))}
        for key, value in file.variables.items()
    }


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else "" if value is None else str(value)
