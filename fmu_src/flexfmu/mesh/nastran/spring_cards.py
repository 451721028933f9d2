"""Springs and dampers of Nastran bulk data: CELAS1, CELAS2, CDAMP1, CDAMP2 and CBUSH with their properties."""

from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.files.errors import MeshError
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.nastran.node_cards import carriers
from flexfmu.mesh.springs import Along, SpringDamper, springs_note, unit_of

CARDS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2", "CBUSH")
# Sine of the angle between a line and an orientation vector below which they span no plane.
_PARALLEL = 1e-6
_GROUND = np.zeros(0, dtype=np.int64)


def springs(
    model: Any, points: FloatArray, row: Mapping[int, int], used: Set[int], path: Path, units: UnitSystem,
    notes: list[str],
) -> tuple[SpringDamper, ...]:  # fmt: skip
    """Return the springs and dampers between grid points, or from one to the ground.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    points : (n, 3) float
        In the file's units.
    row : mapping of int to int
        Rows of `points` by grid point.
    used : set of int
        Grid points of other elements.
    path : Path
    units : UnitSystem
    notes : list of str
        Gets what is found and what is left out.

    Returns
    -------
    tuple of SpringDamper

    Raises
    ------
    MeshError
        Tables, other directions at both ends, or an end that nothing carries.
    """
    held, carried = _held(model), carriers(model)
    found, lossy = [], []
    for number, one in sorted(model.elements.items()):
        if one.type in CARDS:
            title = f"{path}: {one.type} {number}"
            given = _property(model, one, title)
            if getattr(given, "ge", 0.0) or any(getattr(given, "GEi", ())):
                lossy.append(f"{one.type} {number}")
            grids = [node or 0 for node in one.nodes]
            ends = [_end(grid, row, used, carried, held, title) for grid in grids]
            found.append(_spring(model, one, given, grids, ends, points, row, title, units))
    notes.extend(springs_note(found))
    if lossy:
        notes.append(f"structural damping GE of {', '.join(lossy)} is left out: give B")
    return tuple(found)


def _spring(
    model: Any, one: Any, given: Any, grids: list[int], ends: list[IntArray], points: FloatArray,
    row: Mapping[int, int], title: str, units: UnitSystem,
) -> SpringDamper:  # fmt: skip
    """What a card is, between ends of grid points, 0 on the ground."""
    name, factor = f"{one.type} {one.eid}", np.array([unit_of(direction, units) for direction in range(6)])
    if not ends[0].size:
        ends, grids = ends[::-1], grids[::-1]
    first = points[row[grids[0]]]
    places = np.array([first, points[row[grids[1]]] if grids[1] else first])
    if one.type == "CBUSH":
        along, (axes, joint) = Along.END, _bush(model, one, places, points, row, title)
        numbers = [np.array([k or 0.0 for k in (*part, *[0.0] * 6)][:6]) for part in (given.Ki, given.Bi)]
    else:
        along, axes, joint = Along.FIXED, np.eye(3), places.mean(axis=0)
        numbers = [*_single(model, one, given, grids, title)]
    made = units.length * places, units.length * joint, axes, factor * numbers[0], factor * numbers[1], along
    return SpringDamper(name, (ends[0], ends[1]), *made)


def _property(model: Any, one: Any, title: str) -> Any:
    """What tells the numbers of a card: its property, or itself."""
    if one.type in ("CELAS2", "CDAMP2"):
        return one
    if one.pid not in model.properties:
        raise MeshError(f"{title} names the property {one.pid}, which is not there")
    if any(one.pid in getattr(model, name, {}) for name in ("pbusht", "pelast", "pdampt")):
        raise MeshError(
            f"{title} has tables over frequency or force: give its numbers in {model.properties[one.pid].type}"
        )
    if getattr(model.properties[one.pid], "mass", None) and one.type == "CBUSH":
        raise MeshError(f"{title} has a mass (M of PBUSH {one.pid}), which is not supported: give it by CONM2")
    return model.properties[one.pid]


def _single(model: Any, one: Any, given: Any, grids: list[int], title: str) -> tuple[FloatArray, FloatArray]:
    """Stiffness and damping (6,) of a card of one direction."""
    directions = {c for grid, c in zip(one.nodes, (one.c1, one.c2), strict=True) if grid}
    if len(directions) != 1 or not 1 <= min(directions) <= 6:
        raise MeshError(
            f"{title} joins the directions {one.c1} and {one.c2}: both must be the same, 1 to 6; use an MPC"
        )
    if any(grid and model.nodes[grid].cd for grid in grids):
        raise MeshError(
            f"{title} is along axes of a GRID (CD): take a CBUSH with CID, or grid points in the basic system"
        )
    numbers, still = np.zeros(6), np.zeros(6)
    numbers[min(directions) - 1] = given.b if one.type.startswith("CDAMP") else given.k
    return (still, numbers) if one.type.startswith("CDAMP") else (numbers, still)


def _bush(
    model: Any, one: Any, places: FloatArray, points: FloatArray, row: Mapping[int, int], title: str
) -> tuple[FloatArray, FloatArray]:
    """Axes (3, 3), in rows, of a CBUSH, and the place of its joint."""
    line = places[1] - places[0]
    length = float(np.linalg.norm(line))
    if one.ocid is not None and one.ocid >= 0:
        raise MeshError(f"{title} lies beside the line of its grid points (OCID): move the grid points there")
    joint = places[0] + (0.5 if one.s is None else one.s) * line
    if one.cid is not None:
        system = model.coords[one.cid]
        if system.type[-1] != "R":
            raise MeshError(f"{title} is along the {system.type} {one.cid}, expected a rectangular system")
        return np.asarray(system.beta(), dtype=float), joint
    toward = points[row[one.g0]] - places[0] if one.g0 else None if one.x[0] is None else np.array(one.x, dtype=float)
    if not length:
        if toward is not None:
            raise MeshError(f"{title} joins one place, which has no line: give its axes by CID")
        return np.eye(3), joint
    first = line / length
    if toward is None:
        # Without a vector springs along and about the line alone are meant.
        toward = np.eye(3)[np.argmin(np.abs(first))]
    third = np.cross(first, toward)
    if np.linalg.norm(third) <= _PARALLEL * np.linalg.norm(toward):
        raise MeshError(f"{title}: its orientation vector lies along its line, which gives no axes; correct it")
    third /= np.linalg.norm(third)
    return np.array([first, np.cross(third, first), third]), joint


def _end(
    grid: int, row: Mapping[int, int], used: Set[int], carried: Mapping[int, list[int]], held: Set[int], title: str
) -> IntArray:
    """Rows of the points that carry an end; none on the ground."""
    nodes = [grid] if grid in used else carried.get(grid, [])
    if grid and not nodes and grid not in held:
        raise MeshError(
            f"{title} ends at GRID {grid}, which belongs to no element, RBE2 or RBE3 and is not held: join it to the "
            "body (RBE2), or hold it (SPC 123) as ground"
        )
    return np.array(sorted({row[node] for node in nodes}), dtype=np.int64) if nodes else _GROUND


def _held(model: Any) -> set[int]:
    """Grid points whose three translations are held."""
    found = {number for number, one in model.nodes.items() if {"1", "2", "3"} <= set(str(one.ps))}
    for cards in model.spcs.values():
        for card in (one for one in cards if hasattr(one, "components")):
            given = card.components if isinstance(card.components, list) else [card.components] * len(card.nodes)
            found |= {node for node, held in zip(card.nodes, given, strict=True) if {"1", "2", "3"} <= set(str(held))}
    return found
