"""Nastran bulk data through pyNastran: elements, sets, properties, MAT1, coordinate systems, included files."""

import contextlib
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np

from flexfmu.files.basics import MeshError, UnitSystem, listed
from flexfmu.mesh.elements import ASSUMED
from flexfmu.mesh.in_memory import Contents, Member, contents_of
from flexfmu.mesh.model import NO_MATERIAL, Material
from flexfmu.mesh.nastran import node_cards, shell_cards
from flexfmu.mesh.nastran.line_cards import CARDS, SPRINGS, LineCard, is_line, lines, springs
from flexfmu.mesh.nastran.shell_cards import LAYERED, OF_SHELLS, SHELLS, plate
from flexfmu.mesh.other.exchange import imported, quiet
from flexfmu.mesh.shapes import FACE_SHAPES

# Solids and faces by card and number of nodes. Faces that belong to no property have no stiffness: mesh generators
# mark groups by them.
_SOLIDS: dict[tuple[str, int], Any] = {
    (kind.shape.polytope.nastran, kind.node_count): kind.shape for kind in ASSUMED.values()
}
_FACES = {(f"{shape.polytope.nastran}{count}", count): shape for count, shape in FACE_SHAPES.items()}
_CORNERS = {shape.polytope.nastran: len(shape.polytope.corners) for shape in _SOLIDS.values()}
# Cells that are made of others.
_SOLIDS |= {("CPYRAM", 5): SimpleNamespace(name="pyramid", layered=range(5))}
_SOLIDS |= {("CPYRAM", 13): SimpleNamespace(name="pyramid13", layered=range(13))}
_CORNERS |= {"CPYRAM": 5}
_OF_PROPERTY = attrgetter("material")
_OF_SUPER = r"\s+(?:BULK\s+)?"
# They hold or load nothing.
_IDLE = ("PLOTEL", "PLOTEL3", "PLOTEL4", "CHBDYE", "CHBDYG", "CHBDYP")
# Cards with stiffness, mass or constraints by their names, whether pyNastran knows them or not.
_HEAVY = re.compile(
    r"C(?!ORD|REEP|AERO|SSCHD|HBDY|ONV|ONTRLT|NTRLT|SET|BARAO|LOAD|Y|AMPBLL)|R(BAR|BE\d|ROD|SPLINE|SSCON|TRPLT|JOINT)|"
    "GENEL|DMIG|NSM|BG(SET|ADD)|SEBULK"
)
# Analysis of others, whose fields need not be right: air, optimization, roots, loads over time, sets of unknowns.
_UNREAD = re.compile(
    r"AEROS?|FL(UTTER|FACT)|GUST|MKAERO\d|TRIM|DIVERG|EIG\w+|D(ESVAR|CON\w+|OPTPRM|RESP\d|V\w+REL\d|VGRID|SCREEN|TABLE|"
    r"LINK|EQATN|AREA|PHASE|ELAY)|([QABC]SET|OMIT|USET|SUPORT)1?|NLP\w+|TSTEP\w*|FREQ\d?|[TR]LOAD\d|TIC|"
    r"R(OTOR\w|GYRO|SPIN\w|AND\w+)|ACMODL|TAB\w+|MONPNT\d"
)
# What changes results elsewhere, and has no place here.
_PARAMETERS = {
    "AUTOSPC": "what has no stiffness is not held by itself, but by supports",
    "K6ROT": "shells have no stiffness against turns about their normals",
} | dict.fromkeys(("G", "ALPHA1", "ALPHA2"), "give [damping]")
# pyNastran 1.3 knows no MYSTRAN, and no MAT1 without numbers, which exporters write where there is no material.
_UNKNOWN = re.compile(r"(?i)\$\s*pynastran\s*:\s*version\s*=\s*mystran|mat1 {4}.{8} {24}|mat1 *, *\d+ *(, *){4}")
# Those that count where the case control chooses them.
_CHOSEN = {"DMIG": {"K2GG", "M2GG", "K2PP", "M2PP"}, "NSM": {"NSM"}}


def read_nastran(path: Path, units: UnitSystem) -> Contents:
    """Read bulk data, with or without the sections before it.

    Sets of the case control and SET1 and SET3 are node sets and element sets "SET n"; each property's elements are the
    element set "PSOLID n", "PSHELL n", "PBAR n" and so on; faces without a property are node sets "Faces n"; nodes of
    RBE2 and RBE3 are node sets "RBE2 n" with their reference point; MPC are equations; single-point constraints are
    node sets "SPC n" and hold nothing by themselves.

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
        pyNastran is not there or cannot read the file, or the body has parts that are no solids, shells or beams.
    """
    with path.open(encoding="latin-1") as file:
        first = file.readline()
    # Its elements have no property, which nothing but meshio reads.
    if "written by meshio" in first:
        with quiet(path, "check the file"):
            return Contents(meshio.read(path))
    bdf = imported("pyNastran.bdf.bdf", path, "pyNastran", "nastran")
    source, punch, ended = _source(path)
    with node_cards.placed(path), _without_dump(), quiet(path, "check the file, and what it includes"):
        model = bdf.BDF(debug=None)
        model.disable_cards({name for name in model.cards_to_read if _UNREAD.fullmatch(name)})
        model.read_bdf(source, xref=False, punch=punch, encoding="latin-1")
    if not model.nodes:
        raise MeshError(f"{path} defines no grid points (GRID); give a file that holds the body's mesh")
    with node_cards.placed(path), quiet(path, "check its coordinate systems and materials"):
        contents = _contents(model, path, units)
    if not ended:
        _refuse_early_end(contents, path)
    return contents


def _source(path: Path) -> tuple[str | io.StringIO, bool, bool]:
    """What pyNastran shall read, whether it is bulk data alone, and whether it says where it ends."""
    lines = path.read_text(encoding="latin-1").splitlines(keepends=True)
    words = [line.upper().split("$")[0].split() for line in lines]
    begins = [k for k, found in enumerate(words) if found[:2] == ["BEGIN", "BULK"]]
    ended = any(found[:1] == ["ENDDATA"] for found in words)
    control = any(found[:1] == ["CEND"] for found in words[: max(begins, default=0)])
    if any(found[:1] == ["INCLUDE"] for found in words):
        if begins and not control:
            raise MeshError(f"{path} includes files and has BEGIN BULK without CEND: take out the line BEGIN BULK")
        return str(path), not control, ended
    start = begins[0] + 1 if begins and not control else 0
    # Neither a BEGIN BULK that comes again, nor what pyNastran refuses.
    idle = {k for k in begins[1:] if len(words[k]) == 2}
    kept = [line for k, line in enumerate(lines) if k >= start and k not in idle and not _UNKNOWN.match(line)]
    return io.StringIO("".join(kept)), not control, ended


# What pyNastran writes into the current folder where an included file is not there.
_DUMP = Path("pyNastran_crash.bdf")


@contextlib.contextmanager
def _without_dump() -> Iterator[None]:
    """Take away the file that pyNastran leaves behind, unless one of its name was there before."""
    before = _DUMP.exists()
    try:
        yield
    finally:
        if not before:
            _DUMP.unlink(missing_ok=True)


def _refuse_early_end(contents: Contents, path: Path) -> None:
    """Refuse bulk data without an end where nodes are left over: elements may be missing."""
    mesh = contents.mesh
    named = [block.data.ravel() for block in mesh.cells] + [*mesh.point_sets.values()]
    named.append(np.array([key // 3 for row in contents.equations for key in row], dtype=int))
    used = np.isin(np.arange(len(mesh.points)), np.concatenate(named))
    # Reference points are of no element.
    for point in contents.references.values():
        used |= np.all(mesh.points == point, axis=1)
    if not used.all():
        raise MeshError(
            f"{path} has no ENDDATA, and {int(np.sum(~used))} of its {len(used)} grid points belong to no element "
            f"({listed(np.asarray(contents.node_labels)[~used])}): cut short? export it again, or add the line ENDDATA"
        )


def _contents(model: Any, path: Path, units: UnitSystem) -> Contents:
    _fill_defaults(model)
    _refuse_others(model, path)
    labels = np.array(sorted(model.nodes), dtype=np.int64)
    row = {label: place for place, label in enumerate(labels.tolist())}
    points = np.array([model.nodes[label].get_position_no_xref(model) for label in labels.tolist()], dtype=float)
    rejected = [name for name in model.reject_count if name.upper() != name.lower() and not _UNREAD.fullmatch(name)]
    unknown = [f"{name}{node_cards.lines_of(path, name)}" for name in rejected]
    notes = [f"cards of names that pyNastran does not know are left out: {listed(unknown)}"] if unknown else []
    node_sets, element_numbers = _numbered_sets(model)
    turning, solid = (_nodes_of(model, kinds) for kinds in ((*SHELLS, *CARDS), (*_CORNERS,)))
    pinned = node_cards.joints(model, points, row)
    bulk = node_cards.Bulk(model, path, units, points, row, turning, turning | solid, notes)
    on_body, references = node_cards.spiders(bulk)
    held, hinges = node_cards.single_point_sets(model, notes)
    node_sets |= on_body | held
    found: dict[str, Any] = {"references": references, "equations": pinned + node_cards.multi_point_rows(bulk)}
    found |= {"links": node_cards.rigid_links(model, row), "springs": springs(bulk)}
    found |= {"masses": node_cards.point_masses(bulk), "hinges": hinges}
    shells, faces = shell_cards.faces_of_shells(model, path, notes)
    place = dict(zip(labels.tolist(), points, strict=True))
    found |= {"shells": shells, "faces": faces, "axes": shell_cards.directions(model, place, path)}
    bars = lines(model, path, units, node_cards.unit_of_mass(model))
    materials, of_property = _materials(model, bars, path, units)
    kinds: dict[tuple[str, int], list[Member]] = {}
    for element in model.elements.values():
        if element.type not in (*_IDLE, *CARDS, *SPRINGS):
            card = SHELLS.get(element.type, element.type)
            count = len(element.nodes) if _is_face(element, model) else _node_count(element, card, path)
            card = f"{card[:-1]}{count}" if card in SHELLS else card
            nodes = [element.nodes[k] for k in (_SOLIDS | _FACES)[card, count].layered]
            kinds.setdefault((card, count), []).append(Member(element.eid, nodes, element.pid))
    named = {(_SOLIDS | _FACES)[key].name: members for key, members in kinds.items()}
    named |= {"line": [Member(one.number, one.nodes, one.property) for one in bars]} if bars else {}
    notes += _bars_left_out(model)
    sets: dict[str, list[int]] = {}
    for usual, kept in (("PSOLID", _SOLIDS), ("Faces", _FACES)):
        inside = [one for key, members in kinds.items() if key in kept for one in members]
        for number, members in groupby(sorted(inside, key=_OF_PROPERTY), key=_OF_PROPERTY):
            shell = next((one for one in OF_SHELLS if f"{one} {number}" in shells and kept is _FACES), usual)
            sets[f"{shell} {number}"] = [one.number for one in members]
    for one in bars:
        if one.property > 0:
            sets.setdefault(f"{model.properties[one.property].type} {one.property}", []).append(one.number)
    sets |= element_numbers
    there = {name: members for name, members in node_sets.items() if not row.keys().isdisjoint(members)}
    found |= {"materials": materials, "notes": tuple(notes), "beams": {one.number: one.beam for one in bars}}
    return contents_of((labels, points), named, of_property, f"{path}: an element names GRID", there, sets, **found)


def _nodes_of(model: Any, kinds: Sequence[str]) -> set[int]:
    """Grid points of elements of some types."""
    return {node for one in model.elements.values() if one.type in kinds for node in one.nodes}


def _refuse_others(model: Any, path: Path) -> None:
    """Refuse what has stiffness or mass and is no solid."""
    found: dict[str, list[int]] = {}
    masses = [(number, one) for number, one in model.masses.items() if one.type not in ("CONM2", "CMASS1", "CMASS2")]
    for number, element in [*model.elements.items(), *masses]:
        shell = element.type in SHELLS and element.pid in model.properties
        idle = element.type in (*_IDLE, *_CORNERS, *CARDS, *SPRINGS)
        if not idle and not shell and not _is_face(element, model):
            found.setdefault(element.type, []).append(number)
    for number, element in model.rigid_elements.items():
        if element.type not in node_cards.SPIDERS:
            found.setdefault(element.type, []).append(number)
    given = model.elements, model.masses, model.rigid_elements
    known = {"RBAR", *(one.type for part in given for one in part.values())}
    control = model.case_control_deck
    chosen = {key for one in control.subcases.values() for key in one.params} if control else set()
    for name in model.card_count:
        needs = next((keys for start, keys in _CHOSEN.items() if name.startswith(start)), None)
        if _HEAVY.match(name) and name not in known and (not chosen or not needs or needs & chosen):
            found[name] = []
    if model.superelement_models:
        found["BEGIN SUPER"] = list(model.superelement_models)
    if found:
        places = (node_cards.lines_of(path, name.replace(" ", _OF_SUPER), *some[:1]) for name, some in found.items())
        every = zip(found.items(), places, strict=True)
        parts = "; ".join(f"{name} {listed(some) if some else ''}{place}" for (name, some), place in every)
        raise MeshError(
            f"{path} holds what is no solid: {parts}; supported are "
            f"{', '.join([*_CORNERS, *SHELLS, *CARDS, *SPRINGS])} (RBE2, "
            "RBAR and RBE3 become node sets). Model these parts by these; what only shows results can go"
        )


def _fill_defaults(model: Any) -> None:
    """Give grid points what GRDSET says of those that say nothing; an RBAR between all six directions is an RBE2."""
    for grid in model.nodes.values() if model.grdset else ():
        for name in ("cp", "cd", "ps"):
            setattr(grid, name, getattr(grid, name) or getattr(model.grdset, name))
    for bar in [one for one in model.rigid_elements.values() if one.type == "RBAR"]:
        for leading, other, ends in ((bar.cna, bar.cnb, bar.nodes), (bar.cnb, bar.cna, bar.nodes[::-1])):
            if leading == "123456" and other in ("", "0") and bar.eid in model.rigid_elements:
                del model.rigid_elements[bar.eid]
                model.add_rbe2(bar.eid, ends[0], "123456", ends[1:])


def _is_face(element: Any, model: Any) -> bool:
    nodes = getattr(element, "nodes", ())
    return (element.type, len(nodes)) in _FACES and element.pid not in model.properties and all(nodes)


def _node_count(element: Any, card: str, path: Path) -> int:
    nodes = element.nodes
    count = sum(node not in (None, 0) for node in nodes)
    corners = _CORNERS[card] if card in _CORNERS else 3 if card.startswith("CTRIA") else 4
    if (card, len(nodes)) not in _SOLIDS | _FACES or count not in (corners, len(nodes)) or not all(nodes[:corners]):
        found = f"{path}: {element.type} {element.eid} has {count} of {len(nodes)} nodes"
        raise MeshError(f"{found}, expected all of its mid-side nodes or none; export the file again")
    return count


def _numbered_sets(model: Any) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Numbers in sets by their names, as node numbers and as element numbers: a set does not always say which."""
    nodes: dict[str, list[int]] = {}
    elements: dict[str, list[int]] = {}
    subcases = [] if model.case_control_deck is None else model.case_control_deck.subcases.values()
    for subcase in subcases:
        for key, (members, *_) in subcase.params.items():
            if key.startswith("SET "):
                nodes[key] = elements[key] = [number for number in members if isinstance(number, int)]
    for number, given in model.sets.items():
        kind = getattr(given, "desc", "")
        if kind != "ELEM":
            nodes[f"SET {number}"] = list(given.ids)
        if kind != "GRID":
            elements[f"SET {number}"] = list(given.ids)
    return nodes, elements


def _materials(
    model: Any, bars: Sequence[LineCard], path: Path, units: UnitSystem
) -> tuple[tuple[Material, ...], Mapping[int, int]]:
    """Materials, and the material of each property by its number."""
    weight = node_cards.unit_of_mass(model) * units.density
    materials: list[Material] = []
    rows: dict[tuple[int, float], int] = {}
    of_property: dict[int, int] = {}
    wanted = {one.property: (one.material, one.more) for one in bars}
    for number in {element.pid for element in model.elements.values() if element.type in (*_CORNERS, *SHELLS)}:
        given = model.properties.get(number)
        if given is not None and given.type not in ("PSOLID", *OF_SHELLS):
            raise MeshError(f"{path}: {given.type} {number} is no property of solids or shells (PSOLID, PSHELL, PCOMP)")
        if given is not None and given.type in LAYERED and set(given.mids) <= set(model.materials):
            of_property[number] = len(materials)
            materials.append(_weighed(shell_cards.layers(model, given, units, weight, path)))
        elif given is not None and given.type in OF_SHELLS[:2] and (own := plate(model, given, units, weight, path)):
            of_property[number] = len(materials)
            materials.append(_weighed(own))
        elif given is None or given.type not in LAYERED:
            more = given.nsm * weight / given.t if given is not None and given.type == "PSHELL" else 0.0
            wanted[number] = (0 if given is None else given.mid if given.type == "PSOLID" else given.mid1), more
    flat = {number for number in wanted if getattr(model.properties.get(number), "type", "") == "PSHELL"}
    for number, (mid, more) in wanted.items():
        found = model.materials.get(mid)
        if found is not None and found.type != "MAT1" and number not in flat:
            raise MeshError(f"{path}: {found.type} {mid} is the material of solids or beams, expected MAT1 (isotropic)")
        if found is None or (found.type == "MAT1" and not (found.rho or more)):
            of_property[number] = NO_MATERIAL
            continue
        if (mid, more) not in rows:
            rows[mid, more] = len(materials)
            materials.append(_weighed(shell_cards.material(model, mid, units, weight, path, more)))
        of_property[number] = rows[mid, more]
    return tuple(materials), of_property


def _weighed(found: Material) -> Material:
    """A material whose density the file does not tell where it is zero."""
    return found if found.density else replace(found, density=math.nan)


def _bars_left_out(model: Any) -> list[str]:
    """What is said of bars without property, and of properties that are read in part."""
    idle = [one.eid for one in model.elements.values() if one.type in CARDS and not is_line(one, model)]
    notes = [f"bars {listed(idle)} have no property: they hold nothing"] if idle else []
    unread = ("cwa", "cwb", "nsia", "nsib", "m1a", "m2a", "m1b", "m2b")
    sections = [one for one in model.properties.values() if one.type == "PBEAM"]
    if few := [one.pid for one in sections if any(getattr(one, name) for name in unread)]:
        notes.append(f"PBEAM {listed(few)}: warping and inertia and place of extra mass (CW, NSI, M) are left out")
    if lossy := [number for number, one in model.materials.items() if getattr(one, "ge", 0.0)]:
        notes.append(f"structural damping GE of materials {listed(lossy)} is left out: give [damping]")
    for name, why in _PARAMETERS.items():
        given = model.params[name].values[0] if name in model.params else 0
        notes += [f"PARAM {name} = {given} is left out: {why}"] if given not in (0, 0.0, "NO", "N") else []
    for name in ("MATT1", "MATT2", "MATT8", "MATT9", "MATS1"):
        if found := getattr(model, name, None):
            notes.append(f"{name} {listed(found)} are left out: constants are those of the MAT, the body is elastic")
    return notes
