"""Bodies cut at sections: the mesh opened there, and the parts that it falls into (docs/theory.md, section 10).

Elements on one side of a section keep its nodes, those on the other get copies of them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...fe.assembly import stiffness
from ...files.basics import BodyFileError, BoolArray, FloatArray, IntArray, listed
from ...mesh.checks import connected_parts, nodes_of_elements
from ...mesh.equations import coupled_nodes, renumbered
from ...mesh.model import Mesh, moved_springs
from ...model.summary import point
from ..bushings import Bushings
from ..division import neighbours
from ..model import Model, free_motions, stays_free
from ..options import Basis, BodyOptions, Branch, InterfaceNodes, SupportNodes, node_set
from ..rigid_fit import by_node, rigid_fit, rigid_motions
from ..subdomains import elements_within, section as section_weights
from .loops import LoopSection

SIDES = ("a", "b")
_RIGID_MOTIONS = 6
# Of the forces that make a section warp, those below this share of the largest are left out.
_WARPING = 3e-3


@dataclass(frozen=True, slots=True)
class Spring:
    """Springs of a support, as they hold a part.

    Attributes
    ----------
    nodes : (k,) int
        Of the part.
    stiffness : (3,) float
        Of all of them together, N/m.
    interface : str or None
        The node set at which they are a force; None where they are in the part's stiffness.
    """

    nodes: IntArray
    stiffness: FloatArray
    interface: str | None


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a cut body.

    Attributes
    ----------
    model : Model
        With the node sets and element sets that are in it, renumbered.
    nodes, elements : (k,) int
        Where they are in the opened mesh.
    sections : tuple of str
        Node sets of the cuts' sides that it has, as of `side_set`.
    springs : tuple of Spring
    origin : (k,) int
        Where its nodes are in the mesh in one piece.
    """

    model: Model
    nodes: IntArray
    elements: IntArray
    sections: tuple[str, ...]
    springs: tuple[Spring, ...]
    origin: IntArray


def side_set(cut: str, side: str) -> str:
    """Name of the node set of one side, "a" or "b", of a cut through a node set."""
    return f"{cut}, side {side}"


def interface_sets(config: BodyOptions, mesh: Mesh) -> dict[str, IntArray]:
    """Nodes of the interfaces, by their names: no section may touch them."""
    return {one.name: node_set(mesh, one.nodes, f"interface {one.name!r}, nodes") for one in config.interfaces}


def cut_at(config: BodyOptions, model: Model, found: Sequence[LoopSection]) -> tuple[BodyOptions, Model, list[str]]:
    """Cut a body at sections.

    Parameters
    ----------
    config : BodyOptions
    model : Model
        In one piece.
    found : sequence of LoopSection

    Returns
    -------
    config : BodyOptions
        With a table for each section.
    model : Model
        With a node set for each.
    notes : list of str
        Where they are, in words.
    """
    mesh = model.mesh
    sets, names, notes = dict(mesh.node_sets), [], []
    for k, one in enumerate(found, start=1):
        # A name that no mesh file has.
        name = f"loop {k}"
        sets[name] = one.nodes
        names.append(name)
        notes.append(f'cut = "auto": cut {k} at {point(one.place)} m, {one.nodes.size} nodes, {one.width:.3g} m')
    if not found:
        notes.append('cut = "auto": no loop that a slender section opens; the body stays in one piece')
    opened = replace(model, mesh=replace(mesh, node_sets=sets))
    return replace(config, cuts=tuple(names), find_cuts=False), opened, notes


def cut_parts(model: Model, cuts: Sequence[str], supports: Sequence[SupportNodes]) -> tuple[Mesh, list[Part]]:
    """Open a body at sections.

    Parameters
    ----------
    model : Model
        In one piece.
    cuts : sequence of str
        Node sets of the sections.
    supports : sequence of SupportNodes

    Returns
    -------
    mesh : Mesh
        The opened mesh, with the node sets of both sides of each cut.
    parts : list of Part
        In the order of their first nodes.

    Raises
    ------
    BodyFileError
        A section that is missing, that is no section across the body, or that leaves a part without any support.
    """
    mesh, fixed, spring, damper = model.mesh, model.fixed, model.spring, model.damper
    first = np.arange(len(mesh.points))
    for cut in cuts:
        mesh, origin = _opened(mesh, cut)
        first = first[origin]
        copied = origin[len(fixed) :]
        if model.placed[first[len(fixed) :]].any() or spring[copied].any():
            raise BodyFileError(f"[[cut]] nodes = {cut!r}: a support holds nodes of it; cut away from supports")
        fixed, spring, damper = fixed[origin], spring[origin], damper[origin]
    part = connected_parts(mesh)
    if torn := [one.name for one in mesh.masses if np.unique(part[one.nodes]).size > 1]:
        raise BodyFileError(f"[[cut]] goes through the nodes of the masses {listed(torn)}: cut elsewhere")
    if torn := [one.name for one in mesh.springs if np.unique(part[np.concatenate(one.ends)]).size > 1]:
        raise BodyFileError(f"[[cut]] parts the ends of the springs {listed(torn)}: cut elsewhere")
    names = [side_set(cut, side) for cut in cuts for side in SIDES]
    parts = []
    for number in range(int(part.max()) + 1):
        nodes = np.flatnonzero(part == number)
        inside, elements = _sub_mesh(mesh, nodes)
        soft = Bushings(inside.points, inside.springs).unit_rows
        motions = free_motions(inside.points, (fixed | (spring > 0.0))[nodes], soft)
        fault = "turns freely, but not far: hold nodes on a line along it at one only, or leave the loop closed"
        if motions.shape[1] == _RIGID_MOTIONS:
            fault = "no support holds: frames have nothing there to hang from; cut so that each part has a support"
        if motions.shape[1] == _RIGID_MOTIONS or not stays_free(inside.points, fixed[nodes], motions):
            place = point(inside.points.mean(axis=0))
            raise BodyFileError(f"[[cut]] leaves a part of {len(elements)} elements about {place} m that {fault}")
        sections = tuple(name for name in names if name in inside.node_sets)
        part_model, springs = _springs(Model(inside, fixed[nodes], spring[nodes], motions, damper[nodes]), supports)
        parts.append(Part(part_model, nodes, elements, sections, springs, first[nodes]))
    return mesh, parts


def _opened(mesh: Mesh, cut: str) -> tuple[Mesh, IntArray]:
    """The mesh with the nodes of a section doubled, and the node (n',) of `mesh` that each one was."""
    key = f"[[cut]] nodes = {cut!r}"
    nodes = node_set(mesh, cut, key)
    member = np.zeros(len(mesh.points), dtype=bool)
    member[nodes] = True
    faces = mesh.faces
    across = [np.all(member[block.nodes], axis=1) & ~block.outer for block in faces]
    if not any(chosen.any() for chosen in across):
        found = f"{key}: its {nodes.size} nodes make up no face between two elements"
        raise BodyFileError(f"{found}; take all nodes of a section along element faces, across the whole body")
    shared = [block.nodes[chosen] for block, chosen in zip(faces, across, strict=True)]
    loose = nodes.size - np.unique(np.concatenate([block.ravel() for block in shared])).size
    if loose:
        found = f"{key}: {loose} of its {nodes.size} nodes lie on no face between two elements that the set holds"
        raise BodyFileError(f"{found}; take just the nodes of the section")
    closed = tuple(replace(b, beyond=np.where(chosen, -1, b.beyond)) for b, chosen in zip(faces, across, strict=True))
    touching = np.flatnonzero(np.concatenate([np.any(member[b.connectivity], axis=1) for b in mesh.blocks]))
    link = sp.csr_array(neighbours(mesh.points, closed, mesh.element_count))[touching][:, touching]
    # Sheets of shells that meet beside the section.
    uses = nodes_of_elements(mesh)[touching] @ sp.diags_array((~member).astype(float))
    link = link + uses @ coupled_nodes(mesh.equations) @ uses.T
    count, side = connected_components(link, directed=False)
    if count != 2:
        fault = f"{key}: the elements at this section make up {count} connected piece{'s'[: count > 1]}, expected two"
        raise BodyFileError(f"{fault}, one on either side: a cut goes through the whole of one section of the body")
    # Side b begins where the numbering of the mesh is higher.
    second = np.zeros(mesh.element_count, dtype=bool)
    second[touching[side != side[0]]] = True
    copy = np.arange(len(mesh.points))
    copy[nodes] = len(mesh.points) + np.arange(nodes.size)
    origin = np.concatenate([np.arange(len(mesh.points)), nodes])
    blocks = [
        replace(block, connectivity=np.where(here[:, None], copy[block.connectivity], block.connectivity))
        for block, here in zip(mesh.blocks, mesh.split(second), strict=True)
    ]
    opened = replace(mesh, points=mesh.points[origin], labels=mesh.labels[origin], blocks=tuple(blocks))
    opened = _tied(replace(opened, fixed=mesh.fixed[origin]), member, copy, key)
    sets = {name: _on_its_side(mesh, opened, members, copy) for name, members in mesh.node_sets.items()}
    sets |= {side_set(cut, "a"): nodes, side_set(cut, "b"): copy[nodes]}
    return replace(opened, node_sets=sets), origin


def _tied(opened: Mesh, member: BoolArray, copy: IntArray, key: str) -> Mesh:
    """The opened mesh with equations and rigid links among the nodes of the section on both of its sides."""
    equations, count = opened.equations.copy(), 3 * len(copy)
    size = abs(equations[:, :count]) @ np.stack([member, ~member]).repeat(3, axis=1).T > 0.0
    if size.all(axis=1).any():
        raise BodyFileError(f"{key}: equations or rigid links join nodes of the section with others; cut elsewhere")
    equations.resize(equations.shape[0], 3 * len(opened.points))
    again = equations[np.flatnonzero(size[:, 0])]
    again.indices = (3 * copy[again.indices // 3] + again.indices % 3).astype(again.indices.dtype)
    simplices = (*opened.simplices, *renumbered(opened.simplices, np.where(member, copy, -1)))
    return replace(opened, equations=sp.csr_array(sp.vstack([equations, again])), simplices=simplices)


def _on_its_side(before: Mesh, after: Mesh, members: IntArray, copy: IntArray) -> IntArray:
    """Nodes of a set in the opened mesh: on the side where whole elements of it are, or on both."""
    doubled = members[copy[members] != members]
    if not doubled.size:
        return members
    used = np.zeros(len(after.points), dtype=bool)
    used[nodes_of_elements(after)[elements_within(before, members)].indices] = True
    either = used[doubled] | used[copy[doubled]]
    single = members[copy[members] == members]
    kept = [single, doubled[used[doubled] | ~either], copy[doubled][used[copy[doubled]] | ~either]]
    return np.unique(np.concatenate(kept))


def _sub_mesh(mesh: Mesh, nodes: IntArray) -> tuple[Mesh, IntArray]:
    """The connected part of a mesh that has these nodes, and its elements (k,) in the whole."""
    place = np.full(len(mesh.points), -1)
    place[nodes] = np.arange(nodes.size)
    inside = np.concatenate([place[block.connectivity[:, 0]] >= 0 for block in mesh.blocks])
    number = np.where(inside, np.cumsum(inside) - 1, -1)
    blocks = [
        replace(block.part(here), connectivity=place[block.connectivity[here]])
        for block, here in zip(mesh.blocks, mesh.split(inside), strict=True)
        if here.any()
    ]

    def kept(sets: dict[str, IntArray], places: IntArray) -> dict[str, IntArray]:
        found = {name: places[members][places[members] >= 0] for name, members in sets.items()}
        return {name: members for name, members in found.items() if members.size}

    springs = [one for one in mesh.springs if np.all(place[np.concatenate(one.ends)] >= 0)]
    part = replace(
        mesh, points=mesh.points[nodes], labels=mesh.labels[nodes], blocks=tuple(blocks), fixed=mesh.fixed[nodes],
        node_sets=kept(dict(mesh.node_sets), place), element_sets=kept(dict(mesh.element_sets), number), notes=(),
        masses=tuple(replace(one, nodes=place[one.nodes]) for one in mesh.masses if np.all(place[one.nodes] >= 0)),
        springs=moved_springs(springs, lambda rows: place[rows]),
        links=tuple(replace(one, nodes=place[one.nodes]) for one in mesh.links if place[one.nodes[0]] >= 0),
        simplices=renumbered(mesh.simplices, place),
    )  # fmt: skip
    own = mesh.equations[:, (3 * nodes[:, None] + np.arange(3)).ravel()]
    part = replace(part, equations=sp.csr_array(own[np.flatnonzero(np.diff(own.indptr))]))
    return part, np.flatnonzero(inside)


def part_configs(config: BodyOptions, opened: Mesh, parts: Sequence[Part]) -> list[BodyOptions]:
    """Body files of the parts: each with its own interfaces, the sides of the cuts after them, frames and stress sets.

    Parameters
    ----------
    config : BodyOptions
        Of the whole body.
    opened : Mesh
    parts : sequence of Part

    Returns
    -------
    list of BodyOptions

    Raises
    ------
    BodyFileError
        An interface in several parts, or a frame whose parent is in another one.
    """
    owner = np.zeros(len(opened.points), dtype=np.int64)
    part_of_element = np.zeros(opened.element_count, dtype=np.int64)
    for number, part in enumerate(parts):
        owner[part.nodes] = number
        part_of_element[part.elements] = number
    interfaces = _interfaces(config, opened, parts, owner)
    home: dict[str, int] = {}
    for frame in config.frames:
        nodes = node_set(opened, frame.nodes, f"frame {frame.name!r}, nodes")
        elements = elements_within(opened, nodes)
        held = part_of_element[elements] if elements.size else owner[nodes]
        home[frame.name] = int(np.argmax(np.bincount(held, minlength=len(parts))))
    for frame in config.frames:
        if frame.parent is not None and home[frame.parent] != home[frame.name]:
            found = f"frame {frame.name!r} hangs on {frame.parent!r} beyond a [[cut]]"
            raise BodyFileError(f"{found}: each part's frames hang on each other and on its own supports")
    basis, levels = config.basis, config.levels
    if basis.kind is Basis.NORMAL:
        # Normal modes alone would leave the sections too stiff against each other.
        basis = replace(basis, residual=True)
    if not config.levels_asked:
        levels = 1 if config.frames or config.branches else max(2, levels // len(parts))
    return [
        replace(
            config,
            interfaces=tuple(interfaces[number]),
            levels=levels,
            frames=tuple(frame for frame in config.frames if home[frame.name] == number),
            branches=tuple(_branches(config.branches, [one.name for one in interfaces[number]])),
            stress=tuple((name, own) for name, own in config.stress if _has(part.model.mesh.element_sets, own)),
            basis=basis,
        )
        for number, part in enumerate(parts)
    ]


def _interfaces(config: BodyOptions, mesh: Mesh, parts: Sequence[Part], owner: IntArray) -> list[list[InterfaceNodes]]:
    """Interfaces of each part, the sides of the cuts after its own, then its loose springs; `owner`: part of a node."""
    interfaces: list[list[InterfaceNodes]] = [[] for _ in parts]
    for table in config.interfaces:
        found = np.unique(owner[node_set(mesh, table.nodes, f"interface {table.name!r}, nodes")])
        if found.size > 1:
            fault = f"interface {table.name!r}: its nodes are in {found.size} of the parts that [[cut]] makes"
            raise BodyFileError(f"{fault}, expected one; take a smaller set, or cut elsewhere")
        interfaces[found[0]].append(table)
    for own, part in zip(interfaces, parts, strict=True):
        # Names that no body file can have.
        own += [InterfaceNodes(name=name, nodes=name) for name in part.sections]
        loose = [spring.interface for spring in part.springs if spring.interface is not None]
        own += [InterfaceNodes(name=name, nodes=name, weights="node") for name in loose]
    return interfaces


def _branches(tables: Sequence[Branch], interfaces: Sequence[str]) -> list[Branch]:
    """Branches that lead to a part's interfaces, or to its side of a cut."""
    sides = {side_set(toward, side): joints for toward, joints in tables for side in SIDES}
    found = [(toward, joints) for toward, joints in tables if toward in interfaces]
    return found + [(name, sides[name]) for name in interfaces if name in sides]


def _has(sets: Mapping[str, IntArray], name: str) -> bool:
    """Whether a set is there, in upper or lower case."""
    return any(known.lower() == name.lower() for known in sets)


def ground_springs(model: Model, supports: Sequence[SupportNodes]) -> Iterator[tuple[int, Spring]]:
    """Springs of supports, no node twice, with the supports' numbers.

    Parameters
    ----------
    model : Model
    supports : sequence of SupportNodes
        Places are names by now.

    Yields
    ------
    int, Spring
    """
    mesh, done = model.mesh, np.zeros(len(model.mesh.points), dtype=bool)
    for number, table in enumerate(supports, start=1):
        if table.stiffness is None or not isinstance(table.nodes, str) or not _has(mesh.node_sets, table.nodes):
            continue
        members = node_set(mesh, table.nodes, f"support[{number}].nodes")
        # What several supports put on a node is all with the first.
        nodes = members[~done[members] & (model.spring[members] > 0.0).any(axis=1)]
        done[nodes] = True
        if nodes.size:
            yield number, Spring(nodes, model.spring[nodes].sum(axis=0), None)


def _springs(model: Model, supports: Sequence[SupportNodes]) -> tuple[Model, tuple[Spring, ...]]:
    """Springs of a part, and the model without those that its frames do not hang on.

    Stiff meshes on soft springs make poor matrices, and nothing is lost: a spring is an internal interface then.
    """
    mesh, sets, stays, found = model.mesh, dict(model.mesh.node_sets), model.spring.copy(), []
    for number, spring in ground_springs(model, supports):
        fitted = by_node(spring.nodes)
        _, rank = rigid_fit(mesh.points, fitted, fitted.centre(mesh.points))
        if rank == _RIGID_MOTIONS and not np.intersect1d(spring.nodes, model.held).size:
            name = f"springs of support[{number}] at {supports[number - 1].nodes}"
            sets[name] = spring.nodes
            stays[spring.nodes] = 0.0
            spring = replace(spring, interface=name)
        found.append(spring)
    motions = free_motions(mesh.points, model.fixed | (stays > 0.0), model.bushings.unit_rows)
    return Model(replace(mesh, node_sets=sets), model.fixed, stays, motions, model.damper), tuple(found)


def section_tractions(part: Part, section: str, fields: FloatArray) -> FloatArray:
    """Nodal forces by which a section warps: what a part's section feels beyond its resultants.

    Joined by those shapes too, the parts are the whole body as far as these loads go.

    Parameters
    ----------
    part : Part
    section : str
        Node set of its side of the cut.
    fields : (3N, l) float
        Displacements of the body in one piece under unit loads, each over the root of its work.

    Returns
    -------
    (3k, j) float
        At the section's nodes; orthonormal, without resultants.
    """
    mesh = part.model.mesh
    nodes = mesh.node_sets[section]
    own = fields.reshape(-1, 3, fields.shape[1])[part.origin].reshape(3 * part.origin.size, -1)
    rows = (3 * nodes[:, None] + np.arange(3)).ravel()
    force = (part.model.unknowns.nodal(stiffness(mesh), own)[rows]).astype(np.float64)
    # The fit of the interface that the section is.
    fitted = section_weights(mesh, nodes)
    fit, _ = rigid_fit(mesh.points, fitted, fitted.centre(mesh.points))
    # Self-equilibrated forces do no work on rigid motions; G R = 1.
    motions = rigid_motions(mesh.points[nodes] - fitted.centre(mesh.points)).reshape(-1, 6)
    force -= fit.T @ (motions.T @ force)
    shapes, size, _ = np.linalg.svd(force, full_matrices=False)
    return shapes[:, size > _WARPING * size[0]]


def on_section(part: Part, section: str, shapes: FloatArray) -> FloatArray:
    """Nodal forces (3n, j) of a part from those at a section's nodes (3k, j)."""
    mesh = part.model.mesh
    result = np.zeros((len(mesh.points), 3, shapes.shape[1]))
    result[mesh.node_sets[section]] = shapes.reshape(-1, 3, shapes.shape[1])
    return result.reshape(-1, shapes.shape[1])
