"""Ansys archives (.cdb, input files of Workbench) through mapdl-archive: solids, shells, components, materials."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexfmu.files.basics import FloatArray, IntArray, MeshError, UnitSystem, listed
from flexfmu.mesh.beams import Beam, CrossSection, box, ellipse, i_section, l_section, pipe, rectangle
from flexfmu.mesh.in_memory import Contents, Member, contents_of
from flexfmu.mesh.model import Material
from flexfmu.mesh.other.exchange import imported, quiet

# Solids by their numbers: corners and mid-side nodes stand as meshio has them.
_BRICKS = {45: 8, 185: 8, 95: 20, 186: 20}
_TETRAHEDRA = {285: 4, 92: 10, 187: 10}
# Shells likewise.
_SHELLS = (181, 281)
# And beams.
_BEAMS = (188,)
# Surface effects, contact and its targets, meshes alone, follower loads: no stiffness and no mass by themselves.
_PASSED = {*range(151, 157), *range(169, 179), 200, 201}
_CONTACT = {*range(169, 179)}
# Bricks whose nodes coincide: which corners do, and the nodes of what is left.
_WEDGE = ([(2, 3), (6, 7)], [0, 1, 2, 4, 5, 6], [8, 9, 11, 12, 13, 15, 16, 17, 18])
_TETRA = ([(2, 3), (4, 5), (4, 6), (4, 7)], [0, 1, 2, 4], [8, 9, 11, 16, 17, 18])
_PYRAMID = [(4, 5), (4, 6), (4, 7)]
_QUADRATIC = [*range(5), *range(8, 12), *range(16, 20)]
# Of nodes: how many whole numbers, and their width; then the others.
_FORM = re.compile(r"\((\d+)I(\d+),\d+E\d+", re.IGNORECASE)
_REAL = re.compile(r"[-+]?[\d.]+(?:E[-+]?\d+)?", re.IGNORECASE)
_NAME = "SECTION {}"
_ATTRIBUTES = 10
"""Numbers of an element before its nodes."""
_CONSTANTS = {"EX": "youngs_modulus", "NUXY": "poissons_ratio", "PRXY": "poissons_ratio", "DENS": "density"}
# Commands that join nodes, add elements or make materials anisotropic.
_JOINS = re.compile(
    r"\s*((CE|CP)(|RIG|INTF|LGEN|NGEN|SGEN|GEN|CYC)|RBE3|PSPRNG|EN?|E(GEN|INTF|SYM)|TB\s*,\s*(ANEL|ELAS)\w*)\s*"
    r"(,(?!R[\d.]+,ATTR,\s*-1)|$)",
    re.IGNORECASE,
)


def read_ansys(path: Path, units: UnitSystem) -> Contents:
    """Read an archive as CDWRITE writes it: components are sets, MP and MPDATA are materials.

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
        mapdl-archive is not there or cannot read the file, or the body has parts that are no solids.
    """
    library = imported("mapdl_archive", path, "mapdl-archive", "ansys")
    text = path.read_text(encoding="latin-1").splitlines()
    _refuse_cut_short(text, path)
    with quiet(path, "check the file; expected what CDWRITE writes, with NBLOCK and EBLOCK"):
        return _contents(library.Archive(path, parse_vtk=False), text, path, units)


def _refuse_cut_short(text: list[str], path: Path) -> None:
    """Refuse blocks without their end, beyond which the library would read."""
    names = [line.partition(",")[0].strip().upper() for line in text]
    if "NBLOCK" not in names or "EBLOCK" not in names:
        raise MeshError(f"{path} holds no NBLOCK and EBLOCK: no blocked archive, or cut short; write it with CDWRITE")


def _nodes(text: list[str], path: Path) -> tuple[IntArray, FloatArray]:
    """Numbers and places of the nodes, which the library misreads where a row holds three numbers only."""
    labels, places = [], []
    rows = iter(text)
    for line in rows:
        if line.strip().upper().startswith("NBLOCK,"):
            form = _FORM.match(next(rows, "").strip())
            if form is None:
                raise MeshError(f"{path}: NBLOCK without a format such as (3i9,6e21.13e3) after it; write it again")
            count, width = (int(one) for one in form.groups())
            for row in rows:
                if not row[:width].strip().isdigit():
                    break
                labels.append(int(row[:width]))
                # Zeros at the end of a row may be left out.
                places.append([*map(float, _REAL.findall(row[count * width :])), 0.0, 0.0, 0.0][:3])
    return np.array(labels, dtype=np.int64), np.array(places, dtype=float).reshape(-1, 3)


def _refuse_what_is_missing(archive: Any, nodes: int, text: list[str], path: Path) -> None:
    """Refuse blocks that hold fewer nodes or elements than their heads say, where they say it."""
    for block, found in (("NBLOCK", nodes), ("EBLOCK", len(archive.enum))):
        heads = [line.upper().split(",") for line in text if line.strip().upper().startswith(f"{block},")]
        if block == "EBLOCK":
            # Others hold surface effects, which the library passes over.
            heads = [head for head in heads if len(head) > 2 and head[2].strip() == "SOLID"]
        told = [int(head[-1]) for head in heads if len(head) > 4 and head[-1].strip().isdigit()]
        if len(told) == len(heads) and told and sum(told) != found:
            raise MeshError(f"{path}: {block} holds {found} entries, its head says {sum(told)}: cut short? write anew")


def _contents(archive: Any, text: list[str], path: Path, units: UnitSystem) -> Contents:
    labels, places = _nodes(text, path)
    _refuse_what_is_missing(archive, len(labels), text, path)
    kind_of_type = {int(number): int(kind) for number, kind in archive.ekey}
    known, shells, faces = sections(text), defaultdict(list), dict[str, tuple[float, float]]()
    beams: dict[int, Beam] = {}
    row = {label: place for place, label in enumerate(labels.tolist())}

    def at(numbers: list[int]) -> FloatArray:
        return places[[row[one] for one in numbers if one]]

    kinds: dict[str, list[Member]] = {}
    refused: dict[str, list[int]] = {}
    notes = []
    passed: dict[int, int] = {}
    for number, element in zip(np.asarray(archive.enum).tolist(), archive.elem, strict=True):
        values = np.asarray(element).tolist()
        kind, nodes = kind_of_type.get(values[1], 0), values[_ATTRIBUTES:]
        # Of shells and beams: that bend, and whose warping is no unknown.
        plain = all(value == 0 for key, value, *_ in archive.key_option.get(values[1], []) if key == 1)
        if kind in _PASSED:
            passed[kind] = passed.get(kind, 0) + 1
        elif kind in _SHELLS and plain and (own := shell_section(known.get(values[3]))):
            name, chosen = _shell(kind, nodes)
            kinds.setdefault(name, []).append(Member(number, chosen, own[2] or values[0]))
            shells[values[3]].append(number)
            faces[_NAME.format(values[3])] = own[:2]
        elif kind in _BEAMS and plain and (beam := beam_of(known.get(values[3]), at(nodes[:3]), units.length)):
            kinds.setdefault("line", []).append(Member(number, nodes[:2], values[0]))
            beams[number] = beam
        elif (found := _solid(kind, nodes)) is None:
            name = f"element type {kind}"
            name += f" with section {values[3]}" if kind in (*_SHELLS, *_BEAMS) else ""
            type_of = re.compile(rf"\s*ET\s*,\s*\w+\s*,\s*{kind}\b", re.IGNORECASE)
            name += next((f" (line {k})" for k, line in enumerate(text, 1) if type_of.match(line)), "")
            refused.setdefault(name, []).append(number)
        else:
            kinds.setdefault(found[0], []).append(Member(number, found[1], values[0]))
    _refuse_others(refused, path)
    for kind, count in passed.items():
        joins = "; parts that only contact joins come apart" if kind in _CONTACT else ""
        notes.append(f"{count} elements of type {kind} are left unused: they have no stiffness of their own{joins}")
    notes += _joined(text, path, kind_of_type)
    materials, of_number = _materials(text, path, units)
    points, cells = (
        {name.strip(): found for name, found in some.items()}
        for some in (archive.node_components, archive.element_components)
    )
    cells |= {_NAME.format(k): members for k, members in shells.items()}
    given = (labels, places), kinds, of_number, f"{path}: an element names node", points, cells
    return contents_of(*given, materials=materials, notes=tuple(notes), shells=faces, beams=beams)


def _refuse_others(refused: dict[str, list[int]], path: Path) -> None:
    """Refuse elements by what they are."""
    if refused:
        parts = "; ".join(f"{name}: elements {listed(numbers)}" for name, numbers in refused.items())
        raise MeshError(
            f"{path} holds what cannot be read as a solid: {parts}; supported are SOLID45, 92, 95, 185, 186, 187 and "
            "285 as bricks, wedges and tetrahedra, SHELL181 and 281 that bend, with a section of one layer "
            "and SECOFFSET MID, TOP or BOT, BEAM188 without warping, of RECT, CSOLID, CTUBE, HREC (walls alike on both "
            "sides), I or L and SECOFFSET CENT; model these parts by them"
        )


def _shell(kind: int, nodes: list[int]) -> tuple[str, list[int]]:
    """Kind and the nodes of a shell."""
    quadratic = kind == _SHELLS[1] and len(nodes) >= 8 and all(nodes[:8])
    triangle = nodes[2] == nodes[3]
    # K = L = O of triangles.
    chosen = [0, 1, 2, 4, 5, 7] if quadratic and triangle else range(8 if quadratic else 3 if triangle else 4)
    name = ("triangle" if triangle else "quad") + (str(6 if triangle else 8) if quadratic else "")
    return name, [nodes[k] for k in chosen]


def _solid(kind: int, nodes: list[int]) -> tuple[str, list[int]] | None:
    """Kind and the nodes of an element; None for what is no solid that is known."""
    if kind in _TETRAHEDRA:
        whole = len(nodes) >= 10 and all(nodes[:10])
        return ("tetra10", nodes[:10]) if whole else ("tetra", nodes[:4]) if len(nodes) >= 4 else None
    if kind not in _BRICKS or len(nodes) < 8:
        return None
    quadratic = len(nodes) >= 20 and all(nodes[:20])
    for same, corners, middle, name in ((*_TETRA, "tetra"), (*_WEDGE, "wedge")):
        if all(nodes[a] == nodes[b] for a, b in same):
            chosen = [*corners, *middle] if quadratic else corners
            return f"{name}{len(chosen)}" if quadratic else name, [nodes[k] for k in chosen]
    if all(nodes[a] == nodes[b] for a, b in _PYRAMID):
        return ("pyramid13", [nodes[k] for k in _QUADRATIC]) if quadratic else ("pyramid", nodes[:5])
    return ("hexahedron20", nodes[:20]) if quadratic else ("hexahedron", nodes[:8])


def _joined(text: list[str], path: Path, kind_of_type: dict[int, int]) -> list[str]:
    """Refuse equations between nodes; say where constraints were left out."""
    first = [line.partition(",")[0].strip().upper() for line in text]
    joins: dict[str, int] = {}
    passed = False
    for number, (line, name) in enumerate(zip(text, first, strict=True), start=1):
        if name == "TYPE":
            # Parameters stand for contact's elements, as Workbench writes them.
            own = line.split(",")[-1].strip()
            passed = not own.isdigit() or kind_of_type.get(int(own), 0) in _PASSED
        if _JOINS.match(line) and not (passed and name in ("E", "EN")):
            joins.setdefault(name, number)
    if joins:
        found = ", ".join(f"{name} (line {number})" for name, number in joins.items())
        raise MeshError(
            f"{path} joins nodes, or says more of elements, by {found}, which would be lost: mesh the parts so that "
            "they share nodes, or let them be interfaces (node components) and write the archive without these commands"
        )
    return ["constraints (D) are left out: give a [[support]]"] if "D" in first else []


def _materials(text: list[str], path: Path, units: UnitSystem) -> tuple[tuple[Material, ...], dict[int, int]]:
    """Isotropic materials at their first temperature, and their rows by Ansys' numbers."""
    known: dict[int, dict[str, float]] = {}
    where: dict[tuple[int, str], int] = {}
    for place, line in enumerate(text, start=1):
        fields = [field.strip() for field in re.split(r"[,!]", line)]
        command = fields[0].upper()
        if command == "MPDATA" and len(fields) > 6 and fields[1].upper().startswith("R"):
            label, number, value = fields[3].upper(), fields[4], fields[6]
            if fields[5] != "1":
                continue
        elif command == "MP" and len(fields) > 3:
            label, number, value = fields[1].upper(), fields[2], fields[3]
        else:
            continue
        if label in _CONSTANTS or label in ("EY", "EZ"):
            known.setdefault(int(number), {}).setdefault(_CONSTANTS.get(label, label), float(value))
            where.setdefault((int(number), label), place)
    materials: list[Material] = []
    rows = {}
    for number, constants in sorted(known.items()):
        for label in ("EY", "EZ"):
            if constants.get(label, constants.get("youngs_modulus")) != constants.get("youngs_modulus"):
                found = f"{path}: material {number} is orthotropic ({label} ≠ EX, line {where[number, label]})"
                raise MeshError(f"{found}, expected isotropic elasticity")
        if all(key in constants for key in set(_CONSTANTS.values())):
            rows[number] = len(materials)
            modulus, density = constants["youngs_modulus"] * units.stress, constants["density"] * units.density
            materials.append(Material(f"MAT {number}", modulus, constants["poissons_ratio"], density))
    return tuple(materials), rows


# Heights of both faces of shells over the nodes, over the thickness.
_SIDES = {"": (-0.5, 0.5), "MID": (-0.5, 0.5), "TOP": (-1.0, 0.0), "BOT": (0.0, 1.0)}
# Numbers of a beam's section, and what they make: the first axis is the element's y, the second its z.
_SHAPES: dict[str, tuple[int, Callable[[list[float]], CrossSection | None]]] = {
    "RECT": (2, lambda n: rectangle(*n[:2])),
    "CSOLID": (1, lambda n: ellipse(2.0 * n[0], 2.0 * n[0])),
    "CTUBE": (2, lambda n: pipe(n[1], n[1] - n[0])),
    "HREC": (6, lambda n: box(n[0], n[1], n[2], n[4]) if n[2:6:2] == n[3:6:2] else None),
    "I": (6, lambda n: i_section(n[2], (n[0], n[1]), (n[3], n[4]), n[5])),
    "L": (4, lambda n: l_section(*n[:4])),
}
# Beams within this part of their length of the global Z have their y along Y.
_UPRIGHT = 1e-4


class ArchiveSection(NamedTuple):
    """A section: kind (four letters), shape of a beam's, offset, and its rows of numbers."""

    kind: str
    shape: str
    offset: str
    rows: list[list[float]]


def sections(text: Iterable[str]) -> dict[int, ArchiveSection]:
    """Sections of an archive by their numbers."""
    found: dict[int, ArchiveSection] = {}
    number, left = 0, 0
    for line in text:
        command, *fields = [field.strip().upper() for field in line.partition("!")[0].split(",")]
        if command == "SECTYPE" and len(fields) > 1 and fields[0].isdigit():
            number = int(fields[0])
            found[number] = ArchiveSection(fields[1][:4], fields[2] if len(fields) > 2 else "", "", [])
        elif command == "SECOFFSET" and number:
            found[number] = found[number]._replace(offset=fields[0])
        elif command == "SECBLOCK" and number:
            left = int(fields[0])
        elif (left or command == "SECDATA") and number:
            row = fields if command == "SECDATA" else [command, *fields]
            found[number].rows.append([float(one or 0) for one in row])
            left -= left > 0
    return found


def shell_section(known: ArchiveSection | None) -> tuple[float, float, int] | None:
    """Heights of a shell's faces over its nodes and the material's number, 0 for that of the element.

    None where it has several layers or an offset that is not known.
    """
    if known is None or known.kind != "SHEL" or len(known.rows) != 1 or known.offset not in _SIDES:
        return None
    (thickness, *more), (below, above) = known.rows[0], _SIDES[known.offset]
    return below * thickness, above * thickness, int(more[0]) if more else 0


def beam_of(known: ArchiveSection | None, nodes: FloatArray, length: float) -> Beam | None:
    """A beam with the nodes at its centroid; None where the section is none that is known.

    Parameters
    ----------
    known : ArchiveSection, optional
    nodes : (2, 3) or (3, 3) float
        Its ends, and its orientation node in the plane of its x and z.
    length : float
        m of the archive's unit.

    Returns
    -------
    Beam or None
    """
    if known is None or known.kind != "BEAM" or known.shape not in _SHAPES or known.offset not in ("", "CENT"):
        return None
    numbers = [one for row in known.rows for one in row]
    count, make = _SHAPES[known.shape]
    section = make(numbers) if len(numbers) >= count else None
    if section is None:
        return None
    along = nodes[1] - nodes[0]
    if len(nodes) > 2:
        first = np.cross(nodes[2] - nodes[0], along)
    elif np.hypot(*along[:2]) <= _UPRIGHT * np.linalg.norm(along):
        first = np.array([0.0, 1.0, 0.0])
    else:
        first = np.array([-along[1], along[0], 0.0])
    section = section.scaled(length)
    return Beam(section, tuple(first.tolist()), section.centroid)
