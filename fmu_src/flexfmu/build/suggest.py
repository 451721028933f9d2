"""What a mesh offers to a body file: its sets, materials and reference points, plane ends and bores by place."""

import contextlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ..fe.assembly import select
from ..files.basics import FloatArray, IntArray, MeshError, SheetError, UnitsError, UnitSystem
from ..files.toml_files import toml_value
from ..mesh.checks import connected_parts, is_likely, linked_pieces, node_groups
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..model.summary import point as point_words
from ..reduction.model import KEYS, elements_without_material, missing
from ..reduction.options import MISS, Nodes, Place, node_set
from ..reduction.subdomains import elements_within
from ..reduction.surface import face_edges, face_normals, surface_nodes
from .config import C_KEYWORDS, BodyFile

# Faces whose normals differ by less belong to one smooth piece: coarse bores of eight elements have 45° between them.
_SMOOTH = np.cos(np.radians(50.0))
# Share of normals along the axis, which faces of tetrahedra have too, of those across it in the lesser direction, and
# share of the radius by which nodes miss it, up to which a piece is a cylinder.
_ALONG, _ACROSS, _ROUND = 0.15, 1e-2, 1e-2
# The widest gap as seen from the axis that no face spans, a keyway's or a slot's: more is a fillet or an open ring.
_GAP = np.radians(40.0)
_DIGITS = 9


def bores(mesh: Mesh) -> dict[str, Place]:
    """Bores by a name such as ``"bore_1"``.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    dict of str to Place
        Cylinders, the widest first.
    """
    nodes, faces = surface_nodes(mesh)
    points = mesh.points[nodes]
    normal = face_normals(points, faces)
    piece = _smooth_pieces(faces, normal)
    found = [_bore(points, faces[piece == k], normal[piece == k]) for k in range(int(piece.max()) + 1)]
    places = sorted((place for place in found if place is not None), key=lambda place: -(place.radius or 0.0))
    return {f"bore_{k}": place for k, place in enumerate(places, start=1)}


def _smooth_pieces(faces: IntArray, normal: FloatArray) -> IntArray:
    """Piece (f,) that each face belongs to: connected over edges without a kink."""
    edges, owner = face_edges(faces)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    same = np.flatnonzero(np.all(edges[1:] == edges[:-1], axis=1))
    first, second = owner[same], owner[same + 1]
    kept = np.einsum("ei,ei->e", normal[first], normal[second]) > _SMOOTH
    return linked_pieces(np.column_stack([first, second])[kept], len(faces))


def _bore(points: FloatArray, faces: IntArray, normal: FloatArray) -> Place | None:
    """The cylinder that a smooth piece of the surface is, if it is a bore."""
    values, turn = np.linalg.eigh(normal.T @ normal / len(normal))
    # A plane has one direction of normals only, a cylinder two.
    if values[0] > _ALONG or values[1] < _ACROSS:
        return None
    at = points[np.unique(faces)]
    turn = _axes(at, turn)
    axis, flat = turn[:, 0], at @ turn[:, 1:]
    x, y, radius = _circle(flat)
    arm = flat - [x, y]
    miss = float(np.abs(np.linalg.norm(arm, axis=1) - radius).max())
    if miss > _ROUND * radius:
        return None
    angle = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
    gap = np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()
    towards = np.einsum("fi,fi->f", points[faces].mean(axis=1) @ turn[:, 1:] - [x, y], normal @ turn[:, 1:])
    chord = np.linalg.norm(np.ptp(points[faces] @ turn[:, 1:], axis=1), axis=1).max()
    span = 2.0 * np.arcsin(min(0.5 * chord / radius, 1.0))
    if gap > max(_GAP, span) + 1e-9 or not np.all(towards < 0.0):
        return None
    low, high = (at @ axis).min(), (at @ axis).max()
    # Adding zero takes the sign of −0.
    ends = [tuple(((turn[:, 1:] @ [x, y] + axis * along).round(_DIGITS) + 0.0).tolist()) for along in (low, high)]
    # Nodes within a shell's thickness, or in the middle of straight sides, lie off it.
    wide = None if miss < 0.5 * MISS * np.ptp(points, axis=0).max() else float(f"{1.1 * miss:.2g}")
    return Place(cylinder=(ends[0], ends[1]), radius=round(radius, _DIGITS), tolerance=wide)


def _axes(points: FloatArray, start: FloatArray) -> FloatArray:
    """Directions (3, 3) of a cylinder, its axis first, by points on it and directions nearby."""

    def turned(tilt: FloatArray) -> FloatArray:
        return Rotation.from_rotvec(start[:, 1:] @ tilt).as_matrix() @ start

    def missed(tilt: FloatArray) -> FloatArray:
        flat = points @ turned(tilt)[:, 1:]
        x, y, radius = _circle(flat)
        return np.hypot(*(flat - [x, y]).T) - radius

    return turned(least_squares(missed, np.zeros(2), xtol=1e-15, ftol=1e-15, gtol=1e-15).x)


def _circle(flat: FloatArray) -> tuple[float, float, float]:
    """Centre and radius of the circle that fits points (k, 2) best."""
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    return float(x), float(y), float(np.sqrt(max(rest + x * x + y * y, 0.0)))


_AXES = ("x", "y", "z")
_Ends = tuple[list[tuple[str, str]], list[tuple[str, str]]]
# Distance from a plane end of the body, over its longest side, of nodes that lie in it.
_ON_END = 1e-6
# How deep a round end is, over that side, and how far a box goes beyond its nodes, over that depth.
_DEEP, _MARGIN = 0.05, 0.01
# Sets of nodes that steps of a deck hold, or single-point constraints.
_HELD = ("STEP ", "SPC ")
# Words in the names of sets that are held.
_FIXED = re.compile("fix|held|hold|clamp|root|ground|support|encast|foot|feet", re.IGNORECASE)
# Share of a set's nodes in joints between parts from which it is such a joint.
_JOINED = 0.5
# How far a plane face of the body reaches along it, over the side across it, at most: else it is no end but a side.
_SIDE = 3.0
# Outer radius of an eye over its bore's, at most.
_EYE = 2.5
# Thickness of sheets over the longest side, where nothing tells it.
_SHEET = 0.01


def plane_ends(mesh: Mesh) -> dict[str, Place]:
    """Plane faces of the body at the ends of its bounding box.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    dict of str to Place
        By a name such as ``"x_min"``; those of the longest side first.
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    side, faces = high - low, mesh.faces
    found = []
    for axis, name in enumerate(_AXES):
        for end, value in (("min", low[axis]), ("max", high[axis])):
            rows = np.flatnonzero(np.abs(mesh.points[:, axis] - value) <= _ON_END * side.max())
            if not any(len(block) for block in select(faces, rows, outer=True)):
                continue
            normal = [float(axis == other) for other in range(3)]
            point = [round(float(value), _DIGITS) + 0.0 if axis == other else 0.0 for other in range(3)]
            found.append((float(side[axis]), f"{name}_{end}", Place(plane=tuple(point), normal=tuple(normal))))
    # The sort is stable: of an axis the lower end comes first.
    return {name: place for _, name, place in sorted(found, key=lambda one: -one[0])}


def mesh_lines(mesh: Mesh, units: UnitSystem) -> list[str]:
    """What is in a mesh, in words: size, elements, sets, materials, reference points, plane ends, bores, notes.

    Parameters
    ----------
    mesh : Mesh
        Checked.
    units : UnitSystem
        Its own: lengths are given in them, as the body file takes them.

    Returns
    -------
    list of str
    """
    mesh, unit = _in_units(mesh, units), units.length_name
    size = " × ".join(f"{side:.4g}" for side in np.ptp(mesh.points, axis=0))
    kinds = ", ".join(f"{len(block.labels)} {block.type.name}" for block in mesh.blocks)
    lines = [f"{len(mesh.points)} nodes, elements: {kinds}; {size} {unit}"]
    bare = elements_without_material(mesh)
    for material in mesh.materials:
        lacking = missing(material)
        lines.append(f"material {material.name}" + (f": lacks {', '.join(lacking)}" if lacking else ""))
    if bare:
        lines.append(f"{bare} elements have no material in the mesh file: [material] gives them {', '.join(KEYS)}")
    if mesh.fixed.any():
        lines.append(f"the file holds {int(mesh.fixed.any(axis=1).sum())} nodes; [mesh] boundary = false lets them go")
    for name, rows in mesh.node_sets.items():
        point = {key.upper(): point for key, point in mesh.references.items()}.get(name.upper())
        kind, at = ("centre", mesh.points[rows]) if point is None else ("reference point", point[None])
        about = f", {kind} {point_words(at.mean(axis=0))} {unit}" if len(rows) else ""
        lines.append(f"node set {name}: {len(rows)} nodes{about}")
    lines += [f"element set {name}: {len(rows)} elements" for name, rows in mesh.element_sets.items()]
    lines += [
        f"plane end {name}: {len(node_set(mesh, place, name))} nodes, nodes = {_toml(place)}"
        for name, place in plane_ends(mesh).items()
    ]
    for name, place in bores(mesh).items():
        count = len(node_set(mesh, place, name))
        lines.append(f"{name}: {count} nodes, radius {place.radius:.5g} {unit}, nodes = {_toml(place)}")
    return [*lines, *mesh.notes]


def mass_lines(mesh: Mesh) -> list[str]:
    """Volume, mass with masses at points, and centre in words; the mass where every element has a density.

    Parameters
    ----------
    mesh : Mesh
        Checked.

    Returns
    -------
    list of str
    """
    density = np.array([*(material.density for material in mesh.materials), np.nan])
    weighed = not any(np.isnan(density[block.material]).any() for block in mesh.blocks)
    weights = [matrices.sum(axis=2) for matrices in (mesh.mass_matrices if weighed else mesh.volume_matrices)]
    pairs = zip(mesh.blocks, weights, strict=True)
    total = sum(float(weight.sum()) for weight in weights)
    moment = sum(np.einsum("ea,eai->i", weight, mesh.points[block.connectivity]) for block, weight in pairs)
    lines = [f"volume {mesh.volumes.sum():.5g} m³"]
    if weighed:
        at_points = sum(one.mass for one in mesh.masses)
        total += at_points
        moment += sum((one.mass * one.point for one in mesh.masses), np.zeros(3))
        lines.append(f"mass {total:.5g} kg" + (f", {at_points:.5g} kg of it at points" if mesh.masses else ""))
    return [*lines, f"centre of {'mass' if weighed else 'volume'} {point_words(moment / total)} m"]


def chosen_nodes(mesh: Mesh, config: BodyFile) -> dict[str, IntArray]:
    """Nodes of each support and interface of a body file.

    Parameters
    ----------
    mesh : Mesh
    config : BodyFile

    Returns
    -------
    dict of str to (k,) int
        By "support 1", "interface tip" and so on.

    Raises
    ------
    BodyFileError
        A set or place without nodes.
    """
    options = config.options
    choices: list[tuple[str, Nodes]] = [(f"support {n}", table.nodes) for n, table in enumerate(options.supports, 1)]
    choices += [(f"interface {table.name}", table.nodes) for table in options.interfaces]
    return {title: node_set(mesh, nodes, title, options.units) for title, nodes in choices}


def likely_mesh(path: Path, units: UnitSystem | None = None) -> tuple[Mesh, UnitSystem, float]:
    """Read a mesh in the units in which it is likely, kg, m and s if in none.

    Parameters
    ----------
    path : Path
    units : UnitSystem, optional
        Where they are known.

    Returns
    -------
    mesh : Mesh
    units : UnitSystem
    thickness : float
        That its sheets got, in its units, as the file does not tell; 0 where it does.
    """
    for system in UnitSystem if units is None else ():
        with contextlib.suppress(UnitsError):
            found = _with_sheets(path, system)
            if is_likely(found[0]):
                return found
    return _with_sheets(path, units or UnitSystem.SI)


def _with_sheets(path: Path, units: UnitSystem) -> tuple[Mesh, UnitSystem, float]:
    try:
        return read_mesh(path, units), units, 0.0
    except SheetError as error:
        thickness = float(f"{_SHEET * error.size:.1g}")
        return read_mesh(path, units, {"": thickness}), units, thickness


def starting_body_file(mesh: Mesh, file: Path, units: UnitSystem, thickness: float = 0.0) -> str:
    """Body file to begin with: what the mesh names, its bores, or its plane ends, as support and interfaces.

    Parameters
    ----------
    mesh : Mesh
        Checked.
    file : Path
        Of the mesh, as the body file is to name it.
    units : UnitSystem
    thickness : float
        Of shells, where the mesh file does not tell.

    Returns
    -------
    str
        TOML.

    Raises
    ------
    MeshError
        The mesh is in parts that do not hang together.
    """
    part = connected_parts(mesh)
    # Corners of shells and beams are rigid links.
    pairs = part[np.array([(one.nodes[0], node) for one in mesh.links for node in one.nodes], np.int64).reshape(-1, 2)]
    parts = np.sort(np.bincount(linked_pieces(pairs, int(part.max()) + 1)[part]))[::-1]
    if len(parts) > 1:
        raise MeshError(
            f"the mesh is in {len(parts)} parts that share no nodes (of {', '.join(map(str, parts[:3]))}"
            f"{' …' if len(parts) > 3 else ''} nodes): join them in the mesher, by *TIE or by *EQUATION, or leave out "
            "what does not belong to the body"
        )
    mesh = _in_units(mesh, units)
    held, places = _named_ends(mesh) or _ends_and_bores(mesh) or _round_ends(mesh)
    # No set without nodes, nor one of whole elements, nor what is held.
    sets = {name: mesh.node_sets[name] for name in mesh.references if not name.startswith(_HELD)}
    spoken = [name for name, own in sets.items() if len(own) and not elements_within(mesh, own).size]
    named = [(_name(n), toml_value(n)) for n in spoken if toml_value(n) not in dict(held).values()]
    interfaces = named or places or _round_ends(mesh)[1]
    lines = [f'name = "{_name(file.stem)}"', "", "[mesh]", f'file = "{file.as_posix()}"']
    others = ", ".join(one.value for one in UnitSystem if one is not units)
    lines.append(f'units = "{units.value}"   # of the mesh; or: {others}')
    lines += ["", "[[shell]]   # the mesh file does not tell", f"thickness = {thickness:g}"] if thickness else []
    bare = elements_without_material(mesh)
    lacking = [key for key in KEYS if bare or any(key in missing(material) for material in mesh.materials)]
    if lacking:
        steel = {"youngs_modulus": 2.1e11 / units.stress, "poissons_ratio": 0.3, "density": 7850.0 / units.density}
        lines += ["", "[material]   # steel: the mesh file does not tell"]
        lines += [f"{key} = {steel[key]:.6g}" for key in lacking]
    for name, nodes in [] if mesh.fixed.any() else held:
        fix = toml_value([*"".join(name.split()[2:])] or _AXES)
        lines += ["", f"[[support]]   # {name}", f"nodes = {nodes}", f"fix = {fix}"]
    for name, nodes in interfaces:
        lines += ["", "[[interface]]", f'name = "{name}"', f"nodes = {nodes}"]
    return "\n".join([*lines, "", f"# node sets of the mesh: {', '.join(mesh.node_sets) or 'none'}", ""])


def _named_ends(mesh: Mesh) -> _Ends | None:
    """Sets on the surface whose names say that they are held, and others apart from these and from joints, by name."""
    # Exporters write a named set's nodes once more as those of a face.
    once = {np.unique(rows).tobytes(): (name, rows) for name, rows in [*mesh.node_sets.items()][::-1] if len(rows)}
    ends = {name: rows for name, rows in reversed(once.values()) if not elements_within(mesh, rows).size}
    held = [name for name in ends if _FIXED.search(name)]
    apart = [name for name, rows in ends.items() if not np.isin(rows, [n for one in held for n in ends[one]]).any()]
    free = [name for name in apart if np.isin(ends[name], mesh.equations.indices // 3).mean() < _JOINED]
    stepped = any(name.startswith(_HELD) and len(rows) for name, rows in mesh.node_sets.items())
    texts = [[(_name(name), toml_value(name)) for name in names] for names in (held, free)]
    return (texts[0], texts[1]) if held and free and not stepped else None


def _ends_and_bores(mesh: Mesh) -> _Ends | None:
    """What to hold, and interfaces that share no nodes with it, by name.

    What the first step that holds something holds; or a plane end, or the bores that it surrounds where it is no more
    than the ends of eyes. Then the other bores, or one plane end more.
    """
    holes = bores(mesh)
    side, places = np.ptp(mesh.points, axis=0), plane_ends(mesh)
    reach = {name: np.ptp(mesh.points[node_set(mesh, place, name)], axis=0).max() for name, place in places.items()}
    places = {name: place for name, place in places.items() if reach[name] <= _SIDE * (side @ place.normal)} | holes
    rows = dict(mesh.node_sets) | {name: node_set(mesh, place, name) for name, place in places.items()}
    steps = [name for name, own in mesh.node_sets.items() if name.startswith(_HELD) and len(own)]
    held = [name for name in steps if name.split()[1] == steps[0].split()[1]] or list(places)[:1]
    apart = [name for name in places if not any(np.isin(rows[name], rows[end]).any() for end in held)]
    eyes = [name for name in holes if name not in apart and not steps]
    if eyes and np.all(np.min([_of_eye(mesh, rows[held[0]], holes[name]) for name in eyes], axis=0) < _EYE):
        held = eyes
    chosen = [name for name in apart if name in holes] or apart[:1]
    chosen_text = [(name, _toml(places[name]) if name in places else toml_value(name)) for name in held]
    return (chosen_text, [(name, _toml(places[name])) for name in chosen]) if held else None


def _of_eye(mesh: Mesh, rows: IntArray, bore: Place) -> FloatArray:
    """Distances of nodes from the axis of a bore over its radius; infinite where it is half as long as the body."""
    start, end = np.array(bore.cylinder, dtype=np.float64)
    length = np.linalg.norm(end - start)
    if 2.0 * length > np.ptp(mesh.points, axis=0).max():
        return np.full(len(rows), np.inf)
    away = np.linalg.norm(np.cross(mesh.points[rows] - start, (end - start) / length), axis=1)
    return np.asarray(away / bore.radius, dtype=np.float64)


def _round_ends(mesh: Mesh) -> _Ends:
    """Boxes about the ends of the longest side, by name, of a body that has no plane one; about one of several tips."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    axis = int(np.argmax(high - low))
    depth, along, found = _DEEP * (high[axis] - low[axis]), mesh.points[:, axis], []
    for end, near in (("min", along < low[axis] + depth), ("max", along > high[axis] - depth)):
        rows = np.flatnonzero(near)
        tip = node_groups(mesh, rows)
        points = mesh.points[rows[tip == np.bincount(tip).argmax()]]
        box = [(points.min(axis=0) - _MARGIN * depth), (points.max(axis=0) + _MARGIN * depth)]
        found.append((f"{_AXES[axis]}_{end}", toml_value({"box": [corner.round(9).tolist() for corner in box]})))
    return [found[0]], [found[1]]


def _name(text: str) -> str:
    """Letters, digits and _ of a text, a letter first."""
    found = "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in text).strip("_")
    return found if found[:1].isalpha() and found not in C_KEYWORDS.split() else f"body_{found}"


def _in_units(mesh: Mesh, units: UnitSystem) -> Mesh:
    """The same geometry in other units than m."""
    references = {name: point / units.length for name, point in mesh.references.items()}
    return replace(mesh, points=mesh.points / units.length, references=references)


def _toml(place: Place) -> str:
    keys = ("plane", "normal") if place.cylinder is None else ("cylinder", "radius", "tolerance")
    return toml_value({key: value for key in keys if (value := getattr(place, key)) is not None})
