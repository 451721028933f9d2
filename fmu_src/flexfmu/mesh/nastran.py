"""Nastran bulk data through pyNastran: solids, sets, properties, MAT1, coordinate systems, included files."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from flexfmu.errors import MeshError
from flexfmu.mesh.extras import imported, quiet
from flexfmu.mesh.in_memory import Contents
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import NO_MATERIAL, IntArray, Material
from flexfmu.mesh.units import UnitSystem

# meshio's kind by card and number of nodes, and where its nodes stand on the card: mid-side nodes of bricks and wedges
# come around the bottom, up the sides, around the top.
_BRICK = [*range(12), *range(16, 20), *range(12, 16)]
_WEDGE = [*range(9), 12, 13, 14, 9, 10, 11]
_SOLIDS = {
    ("CTETRA", 4): ("tetra", [*range(4)]),
    ("CTETRA", 10): ("tetra10", [*range(10)]),
    ("CHEXA", 8): ("hexahedron", [*range(8)]),
    ("CHEXA", 20): ("hexahedron20", _BRICK),
    ("CPENTA", 6): ("wedge", [*range(6)]),
    ("CPENTA", 15): ("wedge15", _WEDGE),
}
# Faces that belong to no property have no stiffness: mesh generators mark groups by them.
_FACES = {
    ("CTRIA3", 3): "triangle",
    ("CTRIA6", 6): "triangle6",
    ("CQUAD4", 4): "quad",
    ("CQUAD8", 8): "quad8",
}
_CORNERS = {"CTETRA": 4, "CPENTA": 6, "CHEXA": 8}
# They hold or load nothing.
_DRAWN = ("PLOTEL", "PLOTEL3", "PLOTEL4")
# Cards of nodes that move together, and which of their nodes are on the body.
_SPIDERS = {"RBE2": "dependent_nodes", "RBE3": "independent_nodes"}
# Translations in a grid point's own constraints.
_TRANSLATIONS = "123"


def read_nastran(path: Path, units: UnitSystem) -> Contents:
    """Read bulk data, with or without the sections before it.

    Sets of the case control and SET1 and SET3 are node sets and element sets "SET n"; each property's elements are the
    element set "PSOLID n"; faces without a property are node sets "Faces n"; nodes of RBE2 and RBE3 are node sets
    "RBE2 n"; single-point constraints are node sets "SPC n" and hold nothing by themselves.

    Parameters
    ----------
    path : Path
    units : UnitSystem
        What the file's numbers are in.

    Returns
    -------
    Contents

    Raises
    ------
    MeshError
        pyNastran is not there or cannot read the file, or the body has parts that are no solids.
    """
    if _by_meshio(path):
        with quiet(path, "check the file"):
            return Contents(meshio.read(path))
    bdf = imported("pyNastran.bdf.bdf", path, "pyNastran", "nastran")
    source, punch = _source(path)
    with quiet(path, "check the file, and what it includes"):
        model = bdf.BDF(debug=None)
        model.read_bdf(source, xref=False, punch=punch, encoding="latin-1")
    with quiet(path, "check its coordinate systems and materials"):
        return _contents(model, path, units)


def _by_meshio(path: Path) -> bool:
    """Whether meshio wrote the file: its elements have no property, which nothing but meshio reads."""
    with path.open(encoding="latin-1") as file:
        return "written by meshio" in file.readline()


def _source(path: Path) -> tuple[str | io.StringIO, bool]:
    """What pyNastran shall read, and whether it is bulk data alone."""
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    words = [line.upper().split("$")[0].split() for line in lines]
    begin = next((k for k, found in enumerate(words) if found[:2] == ["BEGIN", "BULK"]), None)
    if begin is None:
        return str(path), True
    if not any(found[:1] == ["ENDDATA"] for found in words):
        raise MeshError(f"{path} has BEGIN BULK and no ENDDATA: cut short? export it again")
    if any(found[:1] == ["CEND"] for found in words[:begin]):
        return str(path), False
    if any(found[:1] == ["INCLUDE"] for found in words):
        raise MeshError(f"{path} includes files and has BEGIN BULK without CEND: take out the line BEGIN BULK")
    return io.StringIO("".join(lines[begin + 1 :])), True


def _contents(model: Any, path: Path, units: UnitSystem) -> Contents:
    _refuse_others(model, path)
    labels = np.array(sorted(model.nodes), dtype=np.int64)
    row = {label: place for place, label in enumerate(labels.tolist())}
    points = np.array([model.nodes[label].get_position_no_xref(model) for label in labels.tolist()], dtype=float)
    notes: list[str] = []
    node_sets, element_numbers = _numbered_sets(model)
    node_sets |= _spiders(model, notes) | _constraints(model, notes)
    materials, of_property = _materials(model, path, units)
    kinds: dict[tuple[str, int], list[Any]] = {}
    for element in model.elements.values():
        if _is_face(element, model):
            kinds.setdefault((element.type, len(element.nodes)), []).append(element)
        elif element.type not in _DRAWN:
            kinds.setdefault((element.type, _node_count(element, path)), []).append(element)
    cells, cell_labels, material, properties = [], [], [], []
    for key, members in kinds.items():
        kind, order = _SOLIDS[key] if key in _SOLIDS else (_FACES[key], [*range(key[1])])
        try:
            rows = [[row[element.nodes[k]] for k in order] for element in members]
        except KeyError as error:
            raise MeshError(
                f"{path}: an element names GRID {error}, which is not there; export the file again"
            ) from error
        cells.append((kind, np.array(rows)))
        cell_labels.append(np.array([element.eid for element in members], dtype=np.int64))
        properties.append(np.array([element.pid for element in members], dtype=np.int64))
        material.append(np.array([of_property.get(element.pid, NO_MATERIAL) for element in members], dtype=np.int64))
    sets: dict[str, list[IntArray]] = {}
    for name, kept in (("PSOLID", _SOLIDS), ("Faces", _FACES)):
        inside = [key in kept for key in kinds]
        for number in np.unique(np.concatenate([np.zeros(0, dtype=int), *properties])).tolist():
            sets[f"{name} {number}"] = [
                np.flatnonzero((pids == number) & use) for pids, use in zip(properties, inside, strict=True)
            ]
    for name, numbers in element_numbers.items():
        sets[name] = [np.flatnonzero(np.isin(eids, numbers)) for eids in cell_labels]
    points_by_name = {
        name: np.array(sorted(row[label] for label in set(members) if label in row), dtype=np.int64)
        for name, members in node_sets.items()
    }
    mesh = meshio.Mesh(
        points.reshape(-1, 3),
        cells,
        point_sets={name: rows for name, rows in points_by_name.items() if rows.size},
        cell_sets={name: parts for name, parts in sets.items() if any(part.size for part in parts)},
    )
    return Contents(mesh, labels, cell_labels, materials, material, tuple(notes))


def _refuse_others(model: Any, path: Path) -> None:
    """Refuse what has stiffness or mass and is no solid."""
    found: dict[str, list[int]] = {}
    for number, element in [*model.elements.items(), *model.masses.items()]:
        if element.type not in (*_DRAWN, *_CORNERS) and not _is_face(element, model):
            found.setdefault(element.type, []).append(number)
    for number, element in model.rigid_elements.items():
        if element.type not in _SPIDERS:
            found.setdefault(element.type, []).append(number)
    if model.mpcs:
        found["MPC"] = list(model.mpcs)
    if model.superelement_models:
        found["BEGIN SUPER"] = list(model.superelement_models)
    if found:
        parts = "; ".join(f"{name} {listed(numbers)}" for name, numbers in found.items())
        raise MeshError(
            f"{path} holds what is no solid: {parts}; supported are {', '.join(_CORNERS)} (RBE2 and RBE3 become node "
            "sets). Model these parts by solids; what only shows results (a skin of shells) can go"
        )


def _is_face(element: Any, model: Any) -> bool:
    nodes = getattr(element, "nodes", ())
    return (element.type, len(nodes)) in _FACES and element.pid not in model.properties and all(nodes)


def _node_count(element: Any, path: Path) -> int:
    nodes = element.nodes
    count = sum(node not in (None, 0) for node in nodes)
    if (element.type, len(nodes)) not in _SOLIDS or count not in (_CORNERS[element.type], len(nodes)):
        raise MeshError(
            f"{path}: {element.type} {element.eid} has {count} of {len(nodes)} nodes, expected all of its mid-side "
            "nodes or none; export the file again"
        )
    return count


def _numbered_sets(model: Any) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Numbers in sets by their names, as node numbers and as element numbers: a set does not always say which."""
    nodes: dict[str, list[int]] = {}
    elements: dict[str, list[int]] = {}
    subcases = [] if model.case_control_deck is None else model.case_control_deck.subcases.values()
    for subcase in subcases:
        for key, (members, *_) in subcase.params.items():
            if key.startswith("SET "):
                numbers = [number for number in members if isinstance(number, int)]
                nodes[key], elements[key] = numbers, numbers
    for number, given in model.sets.items():
        kind = getattr(given, "desc", "")
        if kind != "ELEM":
            nodes[f"SET {number}"] = list(given.ids)
        if kind != "GRID":
            elements[f"SET {number}"] = list(given.ids)
    return nodes, elements


def _spiders(model: Any, notes: list[str]) -> dict[str, list[int]]:
    """Nodes of RBE2 and RBE3 on the body."""
    sets = {}
    for number, element in sorted(model.rigid_elements.items()):
        name = f"{element.type} {number}"
        sets[name] = list(getattr(element, _SPIDERS[element.type]))
        holds = "; that it holds them rigid is left out" if element.type == "RBE2" else ""
        notes.append(f"{name}: its nodes on the body are node set '{name}', for an interface or a support{holds}")
    return sets


def _constraints(model: Any, notes: list[str]) -> dict[str, list[int]]:
    """Nodes of single-point constraints; grid points' own constraints count as set 0."""
    sets: dict[str, list[int]] = {}
    for number, cards in model.spcs.items():
        for card in cards:
            sets.setdefault(f"SPC {number}", []).extend(getattr(card, "nodes", ()))
    own = [label for label, grid in model.nodes.items() if set(str(grid.ps)) & set(_TRANSLATIONS)]
    if own:
        sets["SPC 0"] = own
    notes.extend(
        f"{name}: its nodes are a node set, and it holds nothing: give a [[support]]" for name in sets if sets[name]
    )
    return sets


def _materials(model: Any, path: Path, units: UnitSystem) -> tuple[tuple[Material, ...], Mapping[int, int]]:
    """Materials, and the material of each property by its number."""
    weight = model.params["WTMASS"].values[0] if "WTMASS" in model.params else 1.0
    materials: list[Material] = []
    rows: dict[int, int] = {}
    of_property: dict[int, int] = {}
    for number in {element.pid for element in model.elements.values() if element.type in _CORNERS}:
        given = model.properties.get(number)
        if given is None:
            of_property[number] = NO_MATERIAL
            continue
        if given.type != "PSOLID":
            raise MeshError(f"{path}: property {number} is a {given.type}, expected PSOLID for solids")
        found = model.materials.get(given.mid)
        if found is not None and found.type != "MAT1":
            raise MeshError(f"{path}: material {given.mid} is a {found.type}, expected MAT1 (isotropic)")
        if found is None or not found.rho:
            of_property[number] = NO_MATERIAL
            continue
        if given.mid not in rows:
            rows[given.mid] = len(materials)
            density = found.rho * weight * units.density
            materials.append(Material(f"MAT1 {given.mid}", found.e * units.stress, found.nu, density))
        of_property[number] = rows[given.mid]
    return tuple(materials), of_property
