"""Nastran's cards of bars, beams and rods (CBAR, CBEAM, CROD, CTUBE, CONROD), and of springs, dampers and bushes."""

from collections.abc import Callable, Mapping, Set
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexfmu.files.basics import FloatArray, IntArray, MeshError, UnitSystem
from flexfmu.mesh import beams
from flexfmu.mesh.beams import Beam, CrossSection, channel, i_section
from flexfmu.mesh.model import Along, SpringDamper, springs_note, unit_of
from flexfmu.mesh.nastran.node_cards import Bulk, carriers

PROPERTIES = {"CBAR": ("PBAR", "PBARL"), "CBEAM": ("PBEAM", "PBEAML"), "CROD": ("PROD",), "CTUBE": ("PTUBE",)}
CARDS = (*PROPERTIES, "CONROD")
# First axis y, up in the pictures of the manuals, second z, to the right.
_SHAPES: dict[str, Callable[..., CrossSection]] = {
    "ROD": lambda r: beams.ellipse(2.0 * r, 2.0 * r),
    "TUBE": lambda outer, inner: beams.pipe(outer, outer - inner),
    "TUBE2": lambda outer, wall: beams.pipe(outer, wall),
    "BAR": lambda width, height: beams.rectangle(height, width),
    "BOX": lambda width, height, flange, side: beams.box(height, width, flange, side),
    "I": lambda height, low, high, web, below, above: i_section(height, (low, high), (below, above), web).transposed,
    "I1": lambda over, web, inside, height: (
        i_section(height, (over + web,) * 2, (0.5 * (height - inside),) * 2, web).transposed
    ),
    "H": lambda inside, both, height, web: i_section(inside + both, (height,) * 2, (0.5 * both,) * 2, web),
    "T": lambda width, height, flange, web: i_section(height, (0.0, width), (0.0, flange), web).transposed,
    "T2": lambda width, height, flange, web: i_section(height, (width, 0.0), (flange, 0.0), web).transposed,
    "T1": lambda height, foot, web, flange: i_section(foot + web, (0.0, height), (0.0, web), flange),
    "Z": lambda foot, web, inside, height: beams.z_section(foot, web, 0.5 * (height - inside), height).transposed,
    "HAT": lambda height, wall, width, foot: beams.hat(width, height, foot, wall).transposed,
    "L": lambda width, height, foot, leg: beams.l_section(width, height, foot, leg).transposed,
    "CHAN": lambda width, height, web, flange: channel(width, height, web, flange).transposed,
    "CHAN1": lambda over, web, inside, height: channel(over + web, height, web, 0.5 * (height - inside)).transposed,
}


# Change of a section along a beam that comes from the digits of a file.
_ROUND_OFF = 0.01


class LineCard(NamedTuple):
    """A beam of bulk data: its numbers, what it is, and mass per volume beside that of its material, kg/m³."""

    number: int
    nodes: list[int]
    property: int
    material: int
    more: float
    beam: Beam


def is_line(element: Any, model: Any) -> bool:
    """Whether an element is a bar, beam or rod; without a property it has no stiffness."""
    return element.type == "CONROD" or (element.type in CARDS and element.pid in model.properties)


def lines(model: Any, path: Path, units: UnitSystem, weight: float) -> list[LineCard]:
    """Return all bars, beams and rods.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    path : Path
    units : UnitSystem
    weight : float
        What masses of the file are multiplied with.

    Returns
    -------
    list of LineCard
        A CONROD has its own number, negative, as property.

    Raises
    ------
    MeshError
        Tapered sections, pins, shapes that are not supported, or vectors in systems that are not rectangular.
    """
    found: list[LineCard] = []
    known: dict[int, tuple[CrossSection, tuple[float, float], float]] = {}
    for element in (one for one in model.elements.values() if is_line(one, model)):
        number = -element.eid if element.type == "CONROD" else element.pid
        given = element if number < 0 else model.properties[number]
        title = f"{path}: {given.type} {abs(number)}"
        if number > 0 and given.type not in PROPERTIES[element.type]:
            fault = f"{title} is the property of {element.type} {element.eid}"
            raise MeshError(f"{fault}, expected {' or '.join(PROPERTIES[element.type])}; give it one")
        if number not in known:
            known[number] = _section(given, title, model)
        section, place, more = known[number]
        scaled = place[0] * units.length, place[1] * units.length
        directed = not element.type.endswith(("ROD", "TUBE"))
        direction, offsets = _directed(element, model, path) if directed else (np.zeros(3), np.zeros(6))
        beam = Beam(section.scaled(units.length), tuple(direction), scaled, tuple(units.length * offsets))
        nodes = [element.ga, element.gb] if directed else list(element.nodes)
        found.append(LineCard(element.eid, nodes, number, given.mid, more * weight * units.density, beam))
    return found


def _section(given: Any, title: str, model: Any) -> tuple[CrossSection, tuple[float, float], float]:
    """Section of a property or a CONROD, where the grid points are in it, mass per volume beside the material."""
    place = 0.0, 0.0
    if given.type in ("PBARL", "PBEAML"):
        values, shape = np.atleast_2d(np.array(given.dim, dtype=float)), given.Type
        if shape not in _SHAPES:
            raise MeshError(f"{title} is a {shape}, supported are {', '.join(_SHAPES)}: give A, I, J by PBAR or PBEAM")
        section = _SHAPES[shape](*_constant(values, title).tolist())
        # Grid points are at the shear centre of a CBEAM, and where all centres are of a CBAR.
        place = section.shear_centre if given.type == "PBEAML" else section.centroid
        section = section._replace(shear_centre=place)
    elif given.type == "PBEAM":
        values = np.column_stack([given.A, given.i1, given.i2, given.j, given.i12])
        *constants, mixed = _constant(values, title).tolist()
        centres = np.array([[given.n1a, given.n2a], [given.n1b, given.n2b]], dtype=float)
        first, second = _constant(centres, title).tolist()
        section = CrossSection((*constants, *_sheared(given, constants[0])), mixed, (first, second))
    elif given.type == "PBAR":
        section = CrossSection((given.A, given.i1, given.i2, given.j, *_sheared(given, given.A)), given.i12)
    elif given.type == "PTUBE":
        outer = _constant(np.array([[given.OD1], [given.OD2]]), title).item()
        area, _, _, torsion, *_ = beams.pipe(0.5 * outer, given.t or 0.5 * outer).constants
        section = CrossSection((area, 0.0, 0.0, torsion, inf, inf))
    else:
        section = CrossSection((given.A, 0.0, 0.0, given.j, inf, inf))
    if not section.constants[0] > 0.0 or min(section.constants) < 0.0:
        area, *others, _, _ = section.constants
        raise MeshError(f"{title} has the area {area:g} and constants {others}: give it one")
    material = model.materials.get(given.mid)
    if material is not None and material.type == "MAT1" and material.g and material.e:
        # G may be given beside E and NU.
        over = 2.0 * material.g * (1.0 + material.nu) / material.e
        section = section._replace(constants=(*section.constants[:3], *(over * one for one in section.constants[3:])))
    more = float(_constant(np.reshape(given.nsm, (-1, 1)).astype(float), title).item())
    return section, place, more / section.constants[0]


def _constant(stations: FloatArray, title: str) -> FloatArray:
    """What all stations (s, k) along a beam have in common."""
    if (np.ptp(stations, axis=0) > _ROUND_OFF * np.abs(stations).max(axis=0)).any():
        raise MeshError(f"{title} changes along the beam: not supported; give several beams their mean sections")
    return stations.mean(axis=0)


def _sheared(given: Any, area: float) -> list[float]:
    """Shear areas; without a factor there is no shear."""
    return [factor * area if factor else inf for factor in (given.k1, given.k2)]


def _directed(element: Any, model: Any, path: Path) -> tuple[FloatArray, FloatArray]:
    """What the first axis is at right angles to the beam, and offsets (6,) of both ends, global."""
    title = f"{path}: {element.type} {element.eid}"
    if element.pa or element.pb:
        found = f"{title} has the pins PA = {element.pa or 0}, PB = {element.pb or 0}, which are not supported"
        raise MeshError(f"{found}: take CROD for a bar with hinges at both ends, or join grid points by MPC")
    ends = [model.nodes[node].get_position_no_xref(model) for node in (element.ga, element.gb)]
    systems = [model.nodes[node].cd for node in (element.ga, element.gb)]
    letters = element.offt if isinstance(element.offt, str) else "GGG"
    if element.g0:
        direction = model.nodes[element.g0].get_position_no_xref(model) - ends[0]
    else:
        direction = basic(np.array(element.x, dtype=float), 0 if letters[0] == "B" else systems[0], model, title)
    along = (ends[1] - ends[0]) / max(np.linalg.norm(ends[1] - ends[0]), 1e-300)
    third = np.cross(along, direction)
    third = third / max(np.linalg.norm(third), 1e-300)
    offsets = []
    for given, system, letter in zip((element.wa, element.wb), systems, letters[1:], strict=True):
        own = np.array(given, dtype=float)
        of_element = own @ np.array([along, np.cross(third, along), third])
        offsets.append(of_element if letter in "OE" else basic(own, 0 if letter == "B" else system, model, title))
    return direction, np.concatenate(offsets)


def basic(vector: FloatArray, system: int, model: Any, title: str) -> FloatArray:
    """A vector of a system in the basic one."""
    if not system or not vector.any():
        return vector
    known = model.coords[system]
    if not known.type.endswith("R"):
        raise MeshError(f"{title} has a vector in {known.type} {system}, expected rectangular systems")
    origin, there = (known.transform_node_to_global_no_xref(one, model) for one in (np.zeros(3), vector))
    return there - origin


SPRINGS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2", "CBUSH")
# Sine of the angle between a line and an orientation vector below which they span no plane.
_PARALLEL = 1e-6
_GROUND = np.zeros(0, dtype=np.int64)


def springs(bulk: Bulk) -> tuple[SpringDamper, ...]:
    """Return the springs and dampers between grid points, or from one to the ground.

    Parameters
    ----------
    bulk : Bulk

    Returns
    -------
    tuple of SpringDamper

    Raises
    ------
    MeshError
        Tables, other directions at both ends, or an end that nothing carries.
    """
    model, held, carried = bulk.model, _held(bulk.model), carriers(bulk.model)
    found, lossy = [], []
    for number, one in sorted(model.elements.items()):
        if one.type in SPRINGS:
            title = f"{bulk.path}: {one.type} {number}"
            given = _property(model, one, title)
            if getattr(given, "ge", 0.0) or any(getattr(given, "GEi", ())):
                lossy.append(f"{one.type} {number}")
            grids = [node or 0 for node in one.nodes]
            ends = [_end(grid, bulk, carried, held, title) for grid in grids]
            found.append(_spring(bulk, one, given, grids, ends, title))
    bulk.notes.extend(springs_note(found))
    if lossy:
        bulk.notes.append(f"structural damping GE of {', '.join(lossy)} is left out: give B")
    return tuple(found)


def _spring(bulk: Bulk, one: Any, given: Any, grids: list[int], ends: list[IntArray], title: str) -> SpringDamper:
    """What a card is, between ends of grid points, 0 on the ground."""
    model, _, units, points, row, *_ = bulk
    name, factor = f"{one.type} {one.eid}", np.array([unit_of(direction, units) for direction in range(6)])
    if not ends[0].size:
        ends, grids = ends[::-1], grids[::-1]
    first = points[row[grids[0]]]
    places = np.array([first, points[row[grids[1]]] if grids[1] else first])
    if one.type == "CBUSH":
        along, (axes, joint) = Along.END, _bush(bulk, one, places, title)
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
        raise MeshError(f"{title} has tables over frequency or force: give numbers in {model.properties[one.pid].type}")
    if getattr(model.properties[one.pid], "mass", None) and one.type == "CBUSH":
        raise MeshError(f"{title} has a mass (M of PBUSH {one.pid}), which is not supported: give it by CONM2")
    return model.properties[one.pid]


def _single(model: Any, one: Any, given: Any, grids: list[int], title: str) -> tuple[FloatArray, FloatArray]:
    """Stiffness and damping (6,) of a card of one direction."""
    directions = {c for grid, c in zip(one.nodes, (one.c1, one.c2), strict=True) if grid}
    if len(directions) != 1 or not 1 <= min(directions) <= 6:
        raise MeshError(f"{title} joins the directions {one.c1} and {one.c2}: both must be one of 1 to 6; use an MPC")
    if any(grid and model.nodes[grid].cd for grid in grids):
        raise MeshError(f"{title} is along axes of a GRID (CD): take a CBUSH with CID, or grids in the basic system")
    numbers, still = np.zeros(6), np.zeros(6)
    numbers[min(directions) - 1] = given.b if one.type.startswith("CDAMP") else given.k
    return (still, numbers) if one.type.startswith("CDAMP") else (numbers, still)


def _bush(bulk: Bulk, one: Any, places: FloatArray, title: str) -> tuple[FloatArray, FloatArray]:
    """Axes (3, 3), in rows, of a CBUSH, and the place of its joint."""
    line = places[1] - places[0]
    length = float(np.linalg.norm(line))
    if one.ocid is not None and one.ocid >= 0:
        raise MeshError(f"{title} lies beside the line of its grid points (OCID): move the grid points there")
    joint = places[0] + (0.5 if one.s is None else one.s) * line
    if one.cid is not None:
        system = bulk.model.coords[one.cid]
        if system.type[-1] != "R":
            raise MeshError(f"{title} is along the {system.type} {one.cid}, expected a rectangular system")
        return np.asarray(system.beta(), dtype=float), joint
    toward = bulk.points[bulk.row[one.g0]] - places[0] if one.g0 else None
    if not one.g0 and one.x[0] is not None:
        toward = np.array(one.x, dtype=float)
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


def _end(grid: int, bulk: Bulk, carried: Mapping[int, list[int]], held: Set[int], title: str) -> IntArray:
    """Rows of the points that carry an end; none on the ground."""
    nodes = [grid] if grid in bulk.used else carried.get(grid, [])
    if grid and not nodes and grid not in held:
        found = f"{title} ends at GRID {grid}, which belongs to no element, RBE2 or RBE3 and is not held"
        raise MeshError(f"{found}: join it to the body (RBE2), or hold it (SPC 123) as ground")
    return np.array(sorted({bulk.row[node] for node in nodes}), dtype=np.int64) if nodes else _GROUND


def _held(model: Any) -> set[int]:
    """Grid points whose three translations are held."""
    found = {number for number, one in model.nodes.items() if {"1", "2", "3"} <= set(str(one.ps))}
    for cards in model.spcs.values():
        for card in (one for one in cards if hasattr(one, "components")):
            given = card.components if isinstance(card.components, list) else [card.components] * len(card.nodes)
            found |= {node for node, held in zip(card.nodes, given, strict=True) if {"1", "2", "3"} <= set(str(held))}
    return found
