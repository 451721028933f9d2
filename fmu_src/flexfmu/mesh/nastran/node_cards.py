"""Nastran's cards at nodes that move together (RBE2, RBE3, MPC), are held (single-point constraints), or heavy."""

import contextlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from flexfmu.files.basics import FloatArray, MeshError, UnitSystem, listed
from flexfmu.mesh.equations import RigidLink, Row
from flexfmu.mesh.model import PointMass, masses_note

# Cards of nodes that move with a reference point: which of their nodes are on the body, and the reference.
SPIDERS = {"RBE2": ("dependent_nodes", "gn"), "RBE3": ("independent_nodes", "refgrid")}
# Translations in a grid point's own constraints, and of an MPC's terms.
_TRANSLATIONS, _ROTATIONS = "123", "456"
# What an RBE2 holds of another one's reference point if both are one rigid body.
_ALL = set("123456")
# Distance over the size of the body below which grid points are in one place.
_SAME_PLACE = 1e-9
# Cards by name and number in messages (coordinate systems by number alone), and files that others include.
_NAMED = re.compile(r"\b([A-Z][A-Z0-9]{2,}) (\d+)|\['(\w+)\*?', '(\w+)'|\b(?:Cp = |shell )(\d+)")
_UNNAMED = r"C(?:ORD|QUAD|TRIA)\w+"
_INCLUDE = re.compile(r"^\s*INCLUDE\s+'([^']+)'", re.MULTILINE | re.IGNORECASE)


class Bulk(NamedTuple):
    """Bulk data, and what is said of them.

    Attributes
    ----------
    model : pyNastran.bdf.bdf.BDF
    path : Path
    units : UnitSystem
    points : (n, 3) float
        In the file's units.
    row : mapping of int to int
        Rows of `points` by grid point.
    turning, used : set of int
        Grid points of shells and beams, and of all elements.
    notes : list of str
        Gets what is found and what is left out.
    """

    model: Any
    path: Path
    units: UnitSystem
    points: FloatArray
    row: Mapping[int, int]
    turning: Set[int]
    used: Set[int]
    notes: list[str]


def spiders(bulk: Bulk) -> tuple[dict[str, list[int]], dict[str, FloatArray]]:
    """Return the nodes of RBE2 and RBE3 on the body, and their reference points.

    Parameters
    ----------
    bulk : Bulk

    Returns
    -------
    nodes : dict of str to list of int
        Grid points, by "RBE2 n".
    references : dict of str to (3,) float

    Raises
    ------
    MeshError
        Some that are not rigid share a reference, hang on another or on an element: they join the body's parts.
    """
    model, path, _, points, row, turning, used, notes = bulk
    ends = spider_ends(model)
    uses = Counter(reference for _, reference in ends.values())
    loose: set[int] = set()
    for number, (nodes, reference) in ends.items():
        rigid = holds_rigid(element := model.rigid_elements[number])
        if not (rigid and set(str(element.cm)) >= _ALL):
            loose |= {*nodes} if rigid else {*nodes, reference}
    members = {node for nodes, _ in ends.values() for node in nodes}
    joining = [
        number
        for number, (_, reference) in ends.items()
        if (reference in loose and (uses[reference] > 1 or reference in members))
        or (reference in used and not holds_rigid(model.rigid_elements[number]))
    ]
    if joining:
        names = ", ".join(f"{model.rigid_elements[one].type} {one}" for one in joining)
        raise MeshError(
            f"{path}: {names} share their reference points with each other or with elements, and one of them is no "
            "RBE2 that holds all directions, 123456: not supported; join these parts by solids, MPC or such RBE2"
        )
    sets, references = {}, {}
    for number, (nodes, reference) in ends.items():
        element = model.rigid_elements[number]
        name, point = f"{element.type} {number}", "reference node"
        if holds_rigid(element) and len(nodes) == 1 and nodes[0] not in used and reference in used:
            # A load point that hangs on the body: the card has it the other way round.
            (reference,), nodes, point = nodes, [reference], "dependent node"
        sets[name] = nodes
        if reference in row:
            references[name] = points[row[reference]]
        holds = f"{point} as point{_holding(element, bool(turning & {*nodes}))}"
        notes.append(f"{name} is offered as an interface: nodes = '{name}', with its {holds}")
    return sets, references


def _holding(element: Any, turning: bool) -> str:
    """What is said of how an RBE2 or RBE3 holds its nodes, of which some may turn."""
    if holds_rigid(element):
        free = turning and not set(str(element.cm)) >= _ALL
        return "; its nodes are rigid" + ", and shells and beams turn with it, though 456 are free" * free
    if element.type == "RBE2":
        return f"; that it holds directions {element.cm} alone is left out: they may deform"
    return "; its weights are left out: the interface spreads loads evenly" * (len({*element.weights}) > 1)


def holds_rigid(element: Any) -> bool:
    """Whether an element lets its nodes move as a rigid body only."""
    return element.type == "RBE2" and set(_TRANSLATIONS) <= set(str(element.cm))


def rigid_links(model: Any, row: Mapping[int, int]) -> tuple[RigidLink, ...]:
    """What RBE2 make rigid; each with its reference, which joins those that share it."""
    return tuple(
        RigidLink(f"RBE2 {number}", np.array(sorted({row[node] for node in (*nodes, reference) if node in row})))
        for number, (nodes, reference) in spider_ends(model).items()
        if holds_rigid(model.rigid_elements[number])
    )


def lines_of(path: Path, card: str, number: str | int = "") -> str:
    """Where in the file, or one it includes, the cards of a name, or one by its number, are; empty elsewhere."""
    start = re.compile(rf"\s*{card}[*\s,=]\s*[,=]?\s*{number}\b", re.IGNORECASE)
    text = path.read_text(encoding="latin-1")
    rows = [k for k, line in enumerate(text.splitlines(), start=1) if start.match(line)]
    if rows:
        return f" (line {listed(rows)})"
    included = [path.parent / one.strip() for one in _INCLUDE.findall(text)]
    found = ((one.name, lines_of(one, card, number)) for one in included if one.is_file() and one != path)
    return next((f" ({name},{where[2:]}" for name, where in found if where), "")


@contextlib.contextmanager
def placed(path: Path) -> Iterator[None]:
    """Let errors that name a card and its number say in which line it is."""
    try:
        yield
    except MeshError as error:
        text = str(error) if str(path) in str(error) else f"{path}: {error}"
        if "(line" in text:
            raise
        for named in _NAMED.finditer(text):
            if where := lines_of(path, named[1] or named[3] or _UNNAMED, named[2] or named[4] or named[5]):
                raise MeshError(f"{text[: named.end()]}{where}{text[named.end() :]}") from error
        rows = [" ".join(line.split()) for line in path.read_text(encoding="latin-1").splitlines()]
        # Libraries quote what they could not read.
        for text_of_row in re.split("['\"]|line = |; check", text.removeprefix(str(path)).replace("\\n", "")):
            quoted = text_of_row.rpartition("/")[2]
            found = [number for number, line in enumerate(rows, start=1) if len(quoted) > 4 and quoted in line]
            if found:
                raise MeshError(f"{text} (line {listed(found)})") from error
        raise


def spider_ends(model: Any) -> dict[int, tuple[list[int], int]]:
    """Grid points on the body and reference of each RBE2 and RBE3, by its number."""
    return {
        number: (list(getattr(element, SPIDERS[element.type][0])), int(getattr(element, SPIDERS[element.type][1])))
        for number, element in sorted(model.rigid_elements.items())
    }


def joints(model: Any, points: FloatArray, row: Mapping[int, int]) -> list[Row]:
    """Equations of the RBE2 that hold translations alone between grid points in one place; they are taken out."""
    near, found = _SAME_PLACE * float(np.ptp(points, axis=0).max(initial=0.0)), []
    for number, (nodes, reference) in spider_ends(model).items():
        element = model.rigid_elements[number]
        held = [int(axis) - 1 for axis in _TRANSLATIONS if axis in str(element.cm)] if element.type == "RBE2" else []
        global_axes = len(held) == 3 or not any(model.nodes[node].cd for node in nodes if node in row)
        if not held or set(_ROTATIONS) & set(str(element.cm)) or not global_axes or not {*nodes, reference} <= {*row}:
            continue
        if max(float(np.linalg.norm(points[row[node]] - points[row[reference]])) for node in nodes) <= near:
            found += [{3 * row[node] + k: 1.0, 3 * row[reference] + k: -1.0} for node in nodes for k in held]
            del model.rigid_elements[number]
    return found


def carriers(model: Any) -> dict[int, list[int]]:
    """Grid points that carry what hangs on others: on references, and on any grid point of an RBE2 that is rigid."""
    ends = spider_ends(model)
    rigid = [[*nodes, at] for number, (nodes, at) in ends.items() if holds_rigid(model.rigid_elements[number])]
    return {key: nodes for nodes in rigid for key in nodes[:-1]} | {at: nodes for nodes, at in ends.values()}


def multi_point_rows(bulk: Bulk) -> list[Row]:
    """Return the equations of the MPC set that the case control chooses, or of the only one.

    Parameters
    ----------
    bulk : Bulk

    Returns
    -------
    list of dict of int to float
        Coefficients by unknown, 3 i + j for node i in direction j.

    Raises
    ------
    MeshError
        Several sets and none that is chosen, or terms that are no translations in the global system.
    """
    model, path, row = bulk.model, bulk.path, bulk.row
    if not model.mpcs:
        return []
    cards = [card for number in _chosen_set(model, path, bulk.notes) for card in model.mpcs.get(number, ())]
    found: list[Row] = []
    for card in cards:
        terms: dict[int, float] = {}
        for node, component, factor in zip(card.nodes, card.components, card.coefficients, strict=True):
            if node not in row or str(component) not in tuple(_TRANSLATIONS) or model.nodes[node].cd:
                fault = f"{path}: MPC {card.conid} has the term {node}, {component}"
                raise MeshError(f"{fault}: supported are translations 1 to 3 of grid points, along the global axes")
            key = 3 * row[node] + int(component) - 1
            terms[key] = terms.get(key, 0.0) + float(factor)
        found.append(terms)
    return found


def _chosen_set(model: Any, path: Path, notes: list[str]) -> list[int]:
    """Numbers of the MPC cards that count."""
    subcases = [] if model.case_control_deck is None else model.case_control_deck.subcases.values()
    chosen = {int(subcase.params["MPC"][0]) for subcase in subcases if "MPC" in subcase.params}
    known = {*model.mpcs, *model.mpcadds}
    if not chosen and len(known) == 1:
        chosen = known
        notes += [f"MPC {min(known)} is taken, which the case control does not choose"] if subcases else []
    if len(chosen) != 1:
        raise MeshError(
            f"{path}: the MPC sets {listed(sorted(known))} are there, and the case control chooses "
            f"{listed(sorted(chosen))}: expected one, MPC = n for all subcases"
        )
    (number,) = chosen
    return [int(one) for card in model.mpcadds[number] for one in card.mpc_ids] if number in model.mpcadds else [number]


def single_point_sets(model: Any, notes: list[str]) -> tuple[dict[str, list[int]], set[str]]:
    """Return the nodes of single-point constraints, and the names of those sets that hold no rotation.

    Grid points' own constraints count as set 0. Nodes of a rigid RBE2 are among them where its reference is held in all
    directions.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    notes : list of str
        Get a line on each.

    Returns
    -------
    sets : dict of str to list of int
    hinges : set of str
    """
    sets: dict[str, list[int]] = {}
    rigid = {at: of for number, (of, at) in spider_ends(model).items() if holds_rigid(model.rigid_elements[number])}
    held = {"SPC 0": set("".join(str(grid.ps) for grid in model.nodes.values()))}
    for name, card in ((f"SPC {number}", card) for number, cards in model.spcs.items() for card in cards):
        nodes, own = getattr(card, "nodes", ()), set("".join(map(str, getattr(card, "components", ""))))
        held.setdefault(name, set()).update(own)
        sets.setdefault(name, []).extend([*nodes, *[one for at in nodes if own >= _ALL for one in rigid.get(at, ())]])
    sets["SPC 0"] = [label for label, grid in model.nodes.items() if set(str(grid.ps)) & set(_TRANSLATIONS)]
    hinges = {name for name, directions in held.items() if not directions & set(_ROTATIONS)}
    for name in (one for one in sets if sets[one]):
        hinge = " and no others, so that ends of beams may turn" if name in hinges else ""
        notes.append(f"{name} is a node set and holds nothing by itself: give a [[support]] of its nodes{hinge}")
    return sets, hinges


def unit_of_mass(model: Any) -> float:
    """What densities and masses of a file are multiplied with: PARAM,WTMASS."""
    return float(model.params["WTMASS"].values[0]) if "WTMASS" in model.params else 1.0


def _heavy(model: Any, path: Path) -> dict[int, Any]:
    """CONM2 by number, and what CMASS1 and CMASS2 at one grid point are together, in their likeness."""
    found, at = {}, defaultdict[int, dict[int, Any]](dict)
    for number, one in sorted(model.masses.items()):
        if one.type == "CONM2":
            found[number] = one
            continue
        ends = [(node, axis) for node, axis in zip(one.nodes, (one.c1, one.c2), strict=False) if node]
        if len(ends) != 1 or not 1 <= (ends[0][1] or 0) <= 6 or ends[0][1] in at[ends[0][0]]:
            raise MeshError(f"{path}: {one.type} {number} is no mass at one direction of one grid point: take a CONM2")
        at[ends[0][0]][ends[0][1]] = one
    for grid, parts in at.items():
        own = {axis: (model.properties_mass[k.pid] if k.type == "CMASS1" else k).mass for axis, k in parts.items()}
        first = next(iter(parts.values()))
        mass, alike = own.get(1, 0.0), {own.get(axis, 0.0) for axis in (1, 2, 3)}
        if len(alike) > 1 or min(own.values()) < 0.0 or model.nodes[grid].cd:
            fault = f"{path}: {first.type} {first.eid} at GRID {grid}"
            expected = "masses that are the same in 1, 2 and 3, and not negative, along the basic axes"
            raise MeshError(f"{fault}: supported are {expected}: take a CONM2")
        inertia = [own.get(4, 0.0), 0.0, own.get(5, 0.0), 0.0, 0.0, own.get(6, 0.0)]
        found[first.eid] = SimpleNamespace(type=first.type, nid=grid, cid=0, mass=mass, X=np.zeros(3), I=inertia)
    return found


def point_masses(bulk: Bulk) -> tuple[PointMass, ...]:
    """Return the masses of CONM2, and of CMASS1 and CMASS2 that are alike in all directions.

    Parameters
    ----------
    bulk : Bulk

    Returns
    -------
    tuple of PointMass

    Raises
    ------
    MeshError
        A mass in another coordinate system, or on a grid point that nothing carries.
    """
    model, path, units, points, row, turning, used, notes = bulk
    weight = unit_of_mass(model) * units.density * units.length**3
    carried = carriers(model)
    found = []
    for number, one in sorted(_heavy(model, path).items()):
        nodes = [one.nid] if one.nid in used else carried.get(one.nid, [])
        if one.cid != 0 or not nodes or one.nid not in row or any(node not in row for node in nodes):
            fault = f"{path}: {one.type} {number} at GRID {one.nid}: supported are masses in the basic system"
            raise MeshError(f"{fault}, on grid points of solids and on reference points of RBE2 and RBE3")
        offset = np.asarray(one.X, dtype=float)
        i11, i21, i22, i31, i32, i33 = (float(value) for value in one.I)
        inertia = np.array([[i11, -i21, -i31], [-i21, i22, -i32], [-i31, -i32, i33]])
        if nodes == [one.nid] and one.nid not in turning and (offset.any() or inertia.any()):
            notes.append(f"{one.type} {number}: GRID {one.nid} of a solid does not turn: offset and inertia do nothing")
            offset, inertia = np.zeros(3), np.zeros((3, 3))
        rows = np.array(sorted({row[node] for node in nodes}), dtype=np.int64)
        at = (points[row[one.nid]] + offset) * units.length
        inertia = inertia * weight * units.length**2
        found.append(PointMass(f"{one.type} {number}", at, rows, float(one.mass) * weight, inertia))
    notes.extend(masses_note(found, "points"))
    return tuple(found)
