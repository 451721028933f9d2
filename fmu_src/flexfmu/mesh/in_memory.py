"""Meshes that are in memory: of meshio and scikit-fem, or arrays."""

from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import meshio
import numpy as np
from meshio._mesh import topological_dimension

from flexfmu.files.basics import FloatArray, IntArray, MeshError, SheetError, UnitSystem, listed
from flexfmu.mesh.beams import Beam, with_beams
from flexfmu.mesh.elements import ASSUMED, ElementBlock, ElementType
from flexfmu.mesh.equations import MIDDLE, RigidLink, matrix_of, middles
from flexfmu.mesh.model import NO_MATERIAL, Material, Mesh, PointMass, SpringDamper
from flexfmu.mesh.other.file_sets import Group, cell_groups, node_sets_of
from flexfmu.mesh.shells import MOST_NODES, SHELLS, at_nodes, expanded

_NO_ELEMENT = -1
# meshio knows the number of nodes of this kind but not its dimension, and ends in a KeyError.
for _kind in ("wedge15", "pyramid13"):
    topological_dimension.setdefault(_kind, 3)
# Nodes within faces and elements that are left out, and the kind that is left.
_WHOLE = {
    "hexahedron27": "hexahedron20",
    "hexahedron24": "hexahedron20",
    "wedge18": "wedge15",
    "pyramid14": "pyramid13",
}
# Kinds of pyramids, and the tetrahedra of which each is two.
_PYRAMIDS = {"pyramid": "tetra", "pyramid13": "tetra10"}


@dataclass(frozen=True, slots=True)
class Contents:
    """What a file holds: a meshio.Mesh, and what that has no place for.

    Attributes
    ----------
    mesh : meshio.Mesh
        In the file's units.
    node_labels : (n,) int, optional
        The file's node numbers; default: counted from one.
    cell_labels : sequence of (k,) int, optional
        The file's cell numbers, for each of the mesh's cell blocks; default: counted from one.
    materials : tuple of Material
        SI units.
    material : sequence of (k,) int, optional
        Rows of `materials`, for each of the mesh's cell blocks; `NO_MATERIAL` where the file gives none.
    notes : tuple of str
        What was left unused.
    references : mapping of str to (3,) float
        Reference points of node sets, in the file's units.
    equations : sequence of mapping of int to float
        Between displacements, by unknown: 3 i + j is node i in direction j.
    masses : tuple of PointMass
        SI units.
    links : tuple of RigidLink
    shells : mapping of str to (2,) float
        Cell sets whose triangles and quads are shells, "" being all: heights of both faces over their nodes, in the
        file's units.
    faces : mapping of int to (k, 2) float
        By the cell number of shells whose heights are others, at their corners or all nodes; the file's units.
    beams : mapping of int to Beam
        By the cell number of lines; SI units.
    hinges : set of str
        Point sets that mean points of beams without their turns.
    axes : mapping of int to (3, 3) float
        By the cell number of shells whose material has a direction: its axes as columns.
    springs : tuple of SpringDamper
        SI units.
    """

    mesh: Any
    node_labels: IntArray | None = None
    cell_labels: Sequence[IntArray] | None = None
    materials: tuple[Material, ...] = ()
    material: Sequence[IntArray] | None = None
    notes: tuple[str, ...] = ()
    references: Mapping[str, FloatArray] = field(default_factory=dict)
    equations: Sequence[Mapping[int, float]] = ()
    masses: tuple[PointMass, ...] = ()
    links: tuple[RigidLink, ...] = ()
    shells: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    beams: Mapping[int, Beam] = field(default_factory=dict)
    hinges: Set[str] = frozenset()
    faces: Mapping[int, FloatArray] = field(default_factory=dict)
    axes: Mapping[int, FloatArray] = field(default_factory=dict)
    springs: tuple[SpringDamper, ...] = ()


class Member(NamedTuple):
    """An element of a file: its number, its nodes' numbers in meshio's order, and the number of what it is made of."""

    number: int
    nodes: list[int]
    material: int


def contents_of(
    nodes: tuple[IntArray, FloatArray],
    kinds: Mapping[str, Sequence[Member]],
    of_material: Mapping[int, int],
    missing: str,
    node_sets: Mapping[str, Iterable[int]],
    cell_sets: Mapping[str, Collection[int]],
    **more: Any,
) -> Contents:
    """Contents of nodes, elements and sets by their numbers.

    Parameters
    ----------
    nodes : (n,) int, (n, 3) float
        Numbers and places.
    kinds : mapping of str to sequence of Member
        By meshio's names.
    of_material : mapping of int to int
        Rows of the materials by the file's numbers.
    missing : str
        How the message on a node that is not there begins.
    node_sets, cell_sets : mapping of str to numbers
        Numbers that are not there are left out.
    **more
        As of `Contents`.
    """
    row = {label: place for place, label in enumerate(nodes[0].tolist())}
    cells, labels, material = [], [], []
    for name, members in kinds.items():
        try:
            cells.append((name, np.array([[row[node] for node in one.nodes] for one in members])))
        except KeyError as error:
            raise MeshError(f"{missing} {error}, which is not there; write the file again") from error
        labels.append(np.array([one.number for one in members], dtype=np.int64))
        material.append(np.array([of_material.get(one.material, NO_MATERIAL) for one in members], dtype=np.int64))
    points = {name: [row[int(one)] for one in numbers if int(one) in row] for name, numbers in node_sets.items()}
    sets = {name: [np.flatnonzero(np.isin(own, [*some])) for own in labels] for name, some in cell_sets.items()}
    mesh = meshio.Mesh(nodes[1].reshape(-1, 3), cells, point_sets=points, cell_sets=sets)
    return Contents(mesh, nodes[0], labels, material=material, **more)


def from_meshio(found: Any, title: str, units: UnitSystem) -> Mesh:
    """Mesh of one of meshio, without materials and labels; see `from_contents`."""
    return from_contents(Contents(found), title, units)


def from_contents(contents: Contents, title: str, units: UnitSystem) -> Mesh:
    """Mesh of a file's contents, without supports.

    Point sets are node sets. Cell sets, gmsh's physical groups and MED's groups are node sets (of the cells' nodes),
    those of volume cells element sets too; a physical group without a name is called after its kind and number, as in
    ``"Physical Surface 3"``. Whole numbers at cells or points make a set of each value. Cells of lower dimension serve
    sets only. 20-node bricks become C3D20R. Cells that are numbered the other way round are turned.

    Parameters
    ----------
    contents : Contents
    title : str
        What it is called in messages.
    units : UnitSystem
        What its coordinates are in.

    Returns
    -------
    Mesh
        SI units.

    Raises
    ------
    MeshError
        Volume cells of a kind that is not supported, or none.
    """
    contents = _in_known_kinds(contents)
    found = contents.mesh
    points = _points(found, title)
    places = _volume_blocks(found, title, bool(contents.shells or contents.beams))
    notes = [*contents.notes, *_turned(found, points, places)]
    blocks, positions = _element_blocks(contents, places)
    groups = cell_groups(found)
    solids = sum(len(block.labels) for block in blocks)
    shells, heights, on_shells = _shell_blocks(contents, groups, solids, title)
    bars, on_bars = _beam_blocks(contents, solids + len(heights))
    positions |= on_shells | on_bars
    node_sets, more = node_sets_of(found, groups)
    element_sets = {}
    for name, group in groups.items():
        members = [positions[place][group[place]] for place in positions if place in group]
        if members and len(joined := np.setdiff1d(np.concatenate(members), [_NO_ELEMENT])):
            element_sets[name] = joined
    labels = np.arange(1, len(points) + 1) if contents.node_labels is None else contents.node_labels
    mesh = Mesh(
        points=points * units.length,
        labels=labels,
        blocks=(*blocks, *shells, *bars),
        node_sets=node_sets,
        element_sets=element_sets,
        materials=contents.materials,
        fixed=np.zeros((len(points), 3), dtype=bool),
        notes=(*notes, *more),
        references={name: units.length * point for name, point in contents.references.items()},
        masses=contents.masses,
        springs=contents.springs,
        links=contents.links,
        equations=matrix_of(contents.equations, 3 * len(points)) if contents.equations else None,
    )
    return _filled(mesh, contents, units.length * heights, solids)


def _in_known_kinds(contents: Contents) -> Contents:
    """Contents without nodes in the middle of faces and bricks, and with two tetrahedra for each pyramid; notes."""
    found, notes = copy(contents.mesh), list(contents.notes)
    kinds = [block.type for block in found.cells]
    if not set(kinds) & {*_WHOLE, *_PYRAMIDS}:
        return contents
    lacking = "without the nodes in the middle of faces and elements"
    notes += [f"{kind} are taken as {_WHOLE[kind]}, {lacking}" for kind in sorted(set(kinds) & set(_WHOLE))]
    found.cells = [_without_middles(block) for block in found.cells]
    count = {kind: sum(len(b.data) for b in found.cells if b.type == kind) for kind in _PYRAMIDS}
    if count["pyramid"]:
        notes.append(f"{count['pyramid']} pyramids are taken as two linear tetrahedra each, which are stiff in bending")
    if count["pyramid13"]:
        notes.append(f"{count['pyramid13']} quadratic pyramids are taken as two tetrahedra each")
    copies = [2 if block.type in _PYRAMIDS else 1 for block in found.cells]
    bases, first = [np.zeros((0, 8), dtype=np.int64)], len(found.points)
    for place, block in enumerate(found.cells):
        if block.type in _PYRAMIDS:
            data = np.asarray(block.data, dtype=np.int64)
            found.cells[place] = meshio.CellBlock(_PYRAMIDS[block.type], _halves(data, first))
            if block.type == "pyramid13":
                bases.append(data[:, [0, 1, 2, 3, 5, 6, 7, 8]])
                first += len(data)
    base = np.concatenate(bases)
    found.points = np.concatenate([found.points, MIDDLE @ np.asarray(found.points, dtype=float)[base]])

    def each(columns: Any) -> list[Any]:
        return [None if one is None else np.repeat(one, n, axis=0) for one, n in zip(columns, copies, strict=True)]

    found.cell_data = {name: each(columns) for name, columns in found.cell_data.items()}
    found.cell_sets = {
        name: [
            None if rows is None else (n * np.asarray(rows, dtype=np.int64)[:, None] + np.arange(n)).ravel()
            for rows, n in zip(parts, copies, strict=True)
        ]
        for name, parts in found.cell_sets.items()
    }
    labels, material = (None if own is None else each(own) for own in (contents.cell_labels, contents.material))
    nodes = contents.node_labels
    if nodes is not None:
        nodes = np.concatenate([nodes, nodes.max(initial=0) + 1 + np.arange(len(base))])
    return replace(
        contents,
        mesh=found,
        notes=tuple(notes),
        node_labels=nodes,
        cell_labels=labels,
        material=material,
        equations=(*contents.equations, *middles(base, first - len(base) + np.arange(len(base)))),
    )


def _without_middles(block: Any) -> Any:
    """A block without nodes in the middle of faces and elements."""
    if block.type not in _WHOLE:
        return block
    kind = _WHOLE[block.type]
    return meshio.CellBlock(kind, np.asarray(block.data)[:, : ASSUMED[kind].node_count if kind in ASSUMED else 13])


def _halves(data: IntArray, first: int) -> IntArray:
    """Two tetrahedra (2k, 4 or 10) for each pyramid (k, 5 or 13); nodes in the middle of bases are `first` and on."""
    # The diagonal through the node of the lowest number, so that two pyramids on one base fit.
    turn = (data[:, :4].argmin(axis=1)[:, None] + np.arange(4)) % 4
    a, b, c, d = np.take_along_axis(data, turn, axis=1).T
    top = data[:, 4]
    halves = [[a, b, c, top], [a, c, d, top]]
    if data.shape[1] > 5:
        ab, bc, cd, da = np.take_along_axis(data, 5 + turn, axis=1).T
        up = np.take_along_axis(data, 9 + turn, axis=1).T
        ac = first + np.arange(len(data))
        halves[0] += [ab, bc, ac, up[0], up[1], up[2]]
        halves[1] += [ac, cd, da, up[0], up[2], up[3]]
    return np.array(halves).transpose(2, 0, 1).reshape(2 * len(data), -1)


def _filled(mesh: Mesh, contents: Contents, heights: FloatArray, solids: int) -> Mesh:
    """Give beams their sections, and shells their heights (k, 9, 2), of which elements `solids` and on are."""
    turning = np.zeros_like(mesh.fixed)
    if contents.beams:
        mesh, turning = with_beams(mesh, contents.beams, turning, contents.hinges)
    every = np.full((mesh.element_count, MOST_NODES, 2), np.nan)
    every[solids : solids + len(heights)] = heights
    return expanded(mesh, every, turning) if len(heights) else mesh


def _turned(found: Any, points: FloatArray, places: Sequence[int]) -> list[str]:
    """Turn cells that are numbered the other way round; say how many."""
    count = 0
    for place in places:
        block = found.cells[place]
        shape = ASSUMED[block.type].shape
        # Edges of the first corner, along the first coordinate, the second and the third.
        ends = [max(edge) for edge in shape.polytope.edges if 0 in edge]
        inverted = np.linalg.det(points[block.data[:, ends]] - points[block.data[:, :1]]) < 0.0
        if inverted.any():
            count += int(inverted.sum())
            data = np.array(block.data)
            data[inverted] = data[inverted][:, shape.mirrored]
            block.data = data
    return [f"{count} elements are numbered the other way round: their node order was turned"] if count else []


def as_mesh(given: object, units: UnitSystem) -> Mesh:
    """Mesh of what a script has.

    Parameters
    ----------
    given : Mesh, meshio.Mesh, skfem.Mesh, or pair of points (n, 3) and cells
        Cells are an array (k, 4), (k, 6), (k, 8), (k, 10), (k, 15) or (k, 20) of rows of the points in VTK's order, or
        such arrays by meshio's name of the kind, as in ``{"tetra10": array}``.
    units : UnitSystem
        What its coordinates are in; a `Mesh` is in SI units already.

    Returns
    -------
    Mesh
        SI units.

    Raises
    ------
    MeshError
        Something else, or cells that are not supported.
    """
    if isinstance(given, Mesh):
        return given
    if isinstance(given, meshio.Mesh):
        return from_meshio(given, "the mesh", units)
    if type(given).__module__.partition(".")[0] == "skfem":
        return from_meshio(_from_skfem(given), "the scikit-fem mesh", units)
    if isinstance(given, tuple | list) and len(given) == 2:
        return from_meshio(_from_arrays(*given), "the mesh", units)
    raise MeshError(
        f"mesh is a {type(given).__name__}, expected a meshio.Mesh, a mesh of scikit-fem, a pair (points, cells) of "
        "arrays, or a flexfmu.Mesh; a file is read by flexfmu.read_mesh(path)"
    )


def _from_arrays(points: Any, cells: Any) -> meshio.Mesh:
    by_kind = dict(cells) if isinstance(cells, Mapping) else {"": cells}
    widths = {kind.node_count: name for name, kind in ASSUMED.items()}
    blocks = []
    for name, rows in by_kind.items():
        array = np.asarray(rows)
        if array.ndim != 2 or not np.issubdtype(array.dtype, np.integer):
            found = f"cells {name!r} have shape {array.shape} and type {array.dtype}"
            raise MeshError(f"{found}, expected whole numbers (k, nodes of a cell)")
        kind = name or widths.get(array.shape[1])
        if kind is None or (kind in ASSUMED and ASSUMED[kind].node_count != array.shape[1]):
            known = ", ".join(f"{count} ({known})" for count, known in sorted(widths.items()))
            raise MeshError(f"cells {name!r} have {array.shape[1]} nodes, expected {known}")
        blocks.append((kind, array))
    return meshio.Mesh(np.asarray(points, dtype=float), blocks)


def _from_skfem(given: Any) -> meshio.Mesh:
    """The same mesh with its subdomains as cell sets, and its boundaries as point sets of whole facets."""
    from skfem.io.meshio import to_meshio

    try:
        found = to_meshio(given, encode_cell_data=False)
    except KeyError as error:
        raise MeshError(f"a {type(given).__name__} of scikit-fem is no solid mesh that meshio knows") from error
    found.point_sets = {
        name: np.unique(given.dofs.get_facet_dofs(facets).flatten())
        for name, facets in (given.boundaries or {}).items()
    }
    found.cell_sets = {name: [np.asarray(cells)] for name, cells in (given.subdomains or {}).items()}
    return found


def _volume_blocks(found: Any, title: str, shells: bool) -> list[int]:
    """Return the places of the volume cells among the file's cell blocks; none is right only where there are shells."""
    places = [place for place, block in enumerate(found.cells) if block.dim == 3 and len(block.data)]
    refused = sorted({found.cells[place].type for place in places} - set(ASSUMED))
    supported = ", ".join(f"{name} ({kind.name})" for name, kind in ASSUMED.items())
    if refused:
        fault = f"{title} holds cells of the kind {', '.join(refused)}, supported are {supported}"
        raise MeshError(f"{fault}; mesh the body with these kinds alone")
    if not places and not shells:
        kinds = {block.type for block in found.cells}
        held = ", ".join(sorted(kinds)) or "none"
        fault = (
            f"{title} holds no volume cells (found: {held}), expected {supported}; export the volume mesh too. "
            "Triangles and quads are shells where [[shell]] tables of the body file give their thickness"
        )
        sheets = bool(kinds & SHELLS.keys())
        raise SheetError(fault, float(np.ptp(found.points, axis=0).max())) if sheets else MeshError(fault)
    for block in found.cells:
        if len(block.data) and not 0 <= np.min(block.data) <= np.max(block.data) < len(found.points):
            raise MeshError(f"{title} holds {block.type} cells of points that it does not define; export it again")
    return places


def _points(found: Any, title: str) -> FloatArray:
    points: FloatArray = np.array(found.points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{title} holds points of shape {points.shape}, expected (n, 3); export a mesh in space")
    return points


def _element_blocks(contents: Contents, places: list[int]) -> tuple[tuple[ElementBlock, ...], dict[int, IntArray]]:
    """Return one block for each type, and the position of each cell of the file's blocks in them."""
    cells = contents.mesh.cells
    start = {place: sum(len(cells[before].data) for before in places if before < place) for place in places}
    blocks = []
    positions: dict[int, IntArray] = {}
    end = 0
    for kind in dict.fromkeys(ASSUMED[cells[place].type] for place in places):
        chosen = [place for place in places if ASSUMED[cells[place].type] is kind]
        labels, material = [], []
        for place in chosen:
            count = len(cells[place].data)
            counted = np.arange(start[place] + 1, start[place] + count + 1)
            labels.append(counted if contents.cell_labels is None else contents.cell_labels[place])
            none = np.full(count, NO_MATERIAL, dtype=np.int64)
            material.append(none if contents.material is None else contents.material[place])
            positions[place] = np.arange(end, end + count)
            end += count
        connectivity = np.concatenate([cells[place].data for place in chosen]).astype(np.int64)
        blocks.append(ElementBlock(kind, np.concatenate(labels), connectivity, np.concatenate(material)))
    return tuple(blocks), positions


def _shell_blocks(
    contents: Contents, groups: Mapping[str, Group], first: int, title: str
) -> tuple[list[ElementBlock], FloatArray, dict[int, IntArray]]:
    """Blocks of shells, heights (k, 9, 2) of their faces, and the positions of all cells of their blocks in the file.

    Positions go on from `first`; those of cells that are no shells are `_NO_ELEMENT`.
    """
    cells = contents.mesh.cells
    heights: dict[int, FloatArray] = {}
    if "" in contents.shells and not first:
        groups = {"": {n: np.arange(len(b.data)) for n, b in enumerate(cells) if b.dim == 2}, **groups}
    for name, faces in contents.shells.items():
        if not groups.get(name) or not faces[1] > faces[0]:
            raise MeshError(
                f"{title}: shells are asked for in set {name!r} with the thickness {faces[1] - faces[0]:g}, expected a "
                f"positive thickness and one of the cell sets {listed(groups)}, or '' for all of a file without solids"
            )
        for place, rows in groups[name].items():
            if cells[place].type not in SHELLS:
                fault = f"{title}: set {name!r} holds cells of the kind {cells[place].type}"
                raise MeshError(f"{fault}, shells are made of {', '.join(SHELLS)}; mesh this part with these")
            heights.setdefault(place, np.full((len(cells[place].data), 2), np.nan))[rows] = faces
    blocks, found, positions = [], [np.zeros((0, MOST_NODES, 2))], {}
    for place in sorted(heights):
        rows = np.flatnonzero(np.isfinite(heights[place][:, 0]))
        positions[place] = np.full(len(cells[place].data), _NO_ELEMENT)
        positions[place][rows] = np.arange(first, first + rows.size)
        first += rows.size
        labels = positions[place] + 1 if contents.cell_labels is None else contents.cell_labels[place]
        material = np.full(len(labels), NO_MATERIAL) if contents.material is None else contents.material[place]
        data = np.asarray(cells[place].data, dtype=np.int64)
        axes = [contents.axes.get(label, np.eye(3)) for label in labels[rows].tolist()]
        own = labels[rows], data[rows], material[rows], np.array(axes) if contents.axes else None
        blocks.append(ElementBlock(SHELLS[cells[place].type], *own))
        found.append(np.repeat(heights[place][rows, None], MOST_NODES, axis=1))
        for row, label in enumerate(labels[rows].tolist() if contents.faces else ()):
            if label in contents.faces:
                found[-1][row] = at_nodes(contents.faces[label][None], data.shape[1])[0]
    return blocks, np.concatenate(found), positions


def _beam_blocks(contents: Contents, first: int) -> tuple[list[ElementBlock], dict[int, IntArray]]:
    """Blocks of lines that are beams, and the positions of their cells, from `first` on."""
    blocks, positions = [], {}
    for place, cell in enumerate(contents.mesh.cells if contents.beams else ()):
        if cell.type == "line" and contents.cell_labels is not None and contents.material is not None:
            positions[place] = np.arange(first, first + len(cell.data))
            first += len(cell.data)
            data, own = np.asarray(cell.data, dtype=np.int64), (contents.cell_labels[place], contents.material[place])
            blocks.append(ElementBlock(ElementType.B31, own[0], data, own[1]))
    return blocks, positions
