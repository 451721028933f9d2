"""Node sets and cell groups of a meshio.Mesh."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...files.basics import IntArray

# Data under such names describe gmsh's geometry, not groups that the user made.
GMSH_PREFIX = "gmsh:"
PHYSICAL = "gmsh:physical"
# meshio's names of MED's families.
MED_CELLS, MED_POINTS = "cell_tags", "point_tags"
# Different whole numbers at cells or points that are still taken for groups.
MOST_VALUES = 200
KIND_BY_DIMENSION = ("Point", "Curve", "Surface", "Volume")

# Cells of a group: rows of the file's cell block, by the block's place in the file.
Group = dict[int, IntArray]


def cell_groups(found: Any) -> dict[str, Group]:
    """Return cell sets, gmsh's physical groups, MED's groups and whole numbers at cells, of any dimension.

    Parameters
    ----------
    found : meshio.Mesh

    Returns
    -------
    dict of str to Group
        By the file's name; physical groups without a name are called after their kind and number.
    """
    groups: dict[str, Group] = {}
    for name, parts in found.cell_sets.items():
        if not name.startswith(GMSH_PREFIX):
            for place, cells in enumerate(parts):
                _extend(groups, name, place, cells)
    for tag, given in getattr(found, "cell_tags", {}).items():
        # MED: a family of cells belongs to several groups.
        for place, tags in enumerate(found.cell_data.get(MED_CELLS, ())):
            for name in given:
                _extend(groups, name, place, np.flatnonzero(np.asarray(tags) == tag))
    for key, columns in found.cell_data.items():
        if not key.startswith(GMSH_PREFIX) and key not in (MED_CELLS, *groups):
            for place, values in enumerate(columns):
                for name, cells in _by_value(key, values):
                    _extend(groups, name, place, cells)
    if PHYSICAL not in found.cell_data:
        return groups
    names = {(int(entry[1]), int(entry[0])): name for name, entry in found.field_data.items() if len(entry) == 2}
    for place, tags in enumerate(found.cell_data[PHYSICAL]):
        dimension = found.cells[place].dim
        # Zero stands for cells in no group.
        for tag in np.unique(tags[tags != 0]).tolist():
            name = names.get((dimension, tag), f"Physical {KIND_BY_DIMENSION[dimension]} {tag}")
            _extend(groups, name, place, np.flatnonzero(tags == tag))
    return groups


def node_sets_of(found: Any, groups: Mapping[str, Group]) -> tuple[dict[str, IntArray], tuple[str, ...]]:
    """Return the point sets, of marked points too, and the nodes of the cell groups.

    Parameters
    ----------
    found : meshio.Mesh
    groups : mapping of str to Group

    Returns
    -------
    node_sets : dict of str to (k,) int
        Ascending rows of the points.
    notes : tuple of str
        Cell groups whose name is taken by a point set.
    """
    node_sets = {name: np.unique(np.asarray(rows, dtype=np.int64)) for name, rows in found.point_sets.items()}
    for tag, given in getattr(found, "point_tags", {}).items():
        rows = np.flatnonzero(np.asarray(found.point_data[MED_POINTS]) == tag)
        for name in given:
            node_sets[name] = np.union1d(node_sets.get(name, rows), rows).astype(np.int64)
    for key, values in found.point_data.items():
        if not key.startswith(GMSH_PREFIX) and key != MED_POINTS:
            node_sets |= {name: rows for name, rows in _by_value(key, values) if name not in node_sets}
    taken, notes = set(node_sets), []
    for name, group in groups.items():
        if name in taken:
            notes.append(f"the nodes of cell set '{name}' are left unused: a point set has its name")
            continue
        nodes = [np.asarray(found.cells[place].data)[cells].ravel() for place, cells in group.items()]
        node_sets[name] = np.unique(np.concatenate(nodes)).astype(np.int64)
    return node_sets, tuple(notes)


def _by_value(key: str, values: Any) -> list[tuple[str, IntArray]]:
    """Sets of whole numbers: those that are not zero of marks 0 and 1, else one for each value."""
    array = np.asarray(values)
    if array.ndim != 1 or not (np.issubdtype(array.dtype, np.integer) or array.dtype == bool):
        return []
    found = np.unique(array)
    if set(found.tolist()) <= {0, 1}:
        return [(key, np.flatnonzero(array))] if found.any() else []
    # Numbers of nodes or cells are no groups.
    return [] if len(found) > MOST_VALUES else [(f"{key} {value}", np.flatnonzero(array == value)) for value in found]


def _extend(groups: dict[str, Group], name: str, place: int, cells: Any) -> None:
    if cells is None or not len(cells):
        return
    group = groups.setdefault(name, {})
    group[place] = np.union1d(group.get(place, np.zeros(0, dtype=np.int64)), np.asarray(cells, dtype=np.int64))
