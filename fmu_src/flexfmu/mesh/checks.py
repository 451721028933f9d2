"""What a mesh must pass before it becomes a body: sound elements, no nodes left over; its connected parts."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import sparse

from flexfmu.files.array_types import BoolArray, FloatArray, IntArray
from flexfmu.files.errors import MeshError
from flexfmu.mesh.blocks import ElementBlock
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.equations import coupled_nodes, without
from flexfmu.mesh.links import RigidLink, merged
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import Mesh, hung

# Volume ratio, in units of the element's extent cubed, that is taken for zero: far below that of the thinnest
# sensible element (1e-6 for one of aspect 1000 to 1000 to 1), far above round-off of coordinates (1e-13).
DEGENERATE = 1e-10
# Opposite faces of a brick.
_OPPOSITE = np.array([(0, 1), (2, 4), (3, 5)])
# Coordinates, m, beyond which volumes overflow: no body is there.
_FARTHEST = 1e90


def checked(mesh: Mesh) -> Mesh:
    """Return the mesh without the nodes that no element uses, if its elements are sound.

    Elements without a material pass.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    Mesh
        Rows renumbered, sets reduced, and a note that names the nodes dropped; `mesh` itself if there are none.

    Raises
    ------
    MeshError
        There are no elements, a coordinate is not finite, or elements are inverted or degenerate.
    """
    if mesh.element_count == 0:
        raise MeshError("the mesh has no solid elements; give a file that holds the body's volume mesh")
    wrong = ~(np.abs(mesh.points) < _FARTHEST).all(axis=1)
    if wrong.any():
        raise MeshError(f"coordinates of nodes are not finite: {listed(mesh.labels[wrong])}; correct the mesh file")
    bad = np.concatenate([block.labels[_unsound(mesh.points, block)] for block in mesh.blocks])
    if len(bad):
        raise MeshError(
            f"{len(bad)} of {mesh.element_count} elements are inverted or degenerate (Jacobian determinant not "
            f"positive at a corner or quadrature point): {listed(bad)}; mesh again, or correct their node order"
        )
    return _without_unused_nodes(_once(mesh))


def _once(mesh: Mesh) -> Mesh:
    """Return the mesh with one solid of those between the same corners: that of the most nodes, the first of equals."""
    seen: dict[tuple[int, ...], int] = {}
    kept = np.ones(mesh.element_count, dtype=bool)
    numbers = np.concatenate([block.labels for block in mesh.blocks])
    for start, block in sorted(zip(mesh.starts, mesh.blocks, strict=False), key=lambda one: -one[1].type.node_count):
        if not block.type.natural:
            corners = np.sort(block.connectivity[:, : block.type.corner_count], axis=1)
            for place, key in enumerate(map(tuple, corners.tolist()), start=int(start)):
                kept[place] = seen.setdefault(key, place) == place
    if kept.all():
        return mesh
    left = f"{int((~kept).sum())} elements lie on others with the same corners and are left out"
    note = f"{left}, as their stiffness counts once: {listed(numbers[~kept])}"
    rows = np.cumsum(kept) - 1
    parts = [(b, kept[s : s + len(b.labels)]) for s, b in zip(mesh.starts, mesh.blocks, strict=False)]
    return replace(
        mesh,
        blocks=tuple(block.part(chosen) for block, chosen in parts if chosen.any()),
        element_sets={name: rows[members[kept[members]]] for name, members in mesh.element_sets.items()},
        notes=(*mesh.notes, note),
    )


def without_mechanisms(mesh: Mesh) -> Mesh:
    """Return the mesh with C3D20 for C3D20R elements of which two pairs of opposite faces are free.

    Each would move without energy, as in a bar one element across; those with one free pair at most hold each other.

    Parameters
    ----------
    mesh : Mesh
        Checked.

    Returns
    -------
    Mesh
        Elements in another order, sets likewise, and a note; `mesh` itself if there are none.
    """
    outer, element = (np.concatenate([getattr(faces, name) for faces in mesh.faces]) for name in ("outer", "element"))
    blocks, places, count = [], [], 0
    for block, start in zip(mesh.blocks, mesh.starts, strict=False):
        own = np.arange(start, start + len(block.labels))
        lone = np.zeros(len(own), dtype=bool)
        if block.type is ElementType.C3D20R:
            free = outer[np.isin(element, own)].reshape(-1, len(block.type.shape.faces))
            lone = free[:, _OPPOSITE].all(axis=2).sum(axis=1) > 1
            count += int(lone.sum())
        for chosen, kind in ((~lone, block.type), (lone, ElementType.C3D20)):
            if chosen.any():
                blocks.append(replace(block.part(chosen), type=kind))
                places.append(own[chosen])
    if not count:
        return mesh
    rows = np.argsort(np.concatenate(places))
    note = f"{count} C3D20R with two pairs of opposite faces free would move without energy: they are taken as C3D20"
    sets = {name: np.sort(rows[members]) for name, members in mesh.element_sets.items()}
    return replace(mesh, blocks=tuple(blocks), element_sets=sets, notes=(*mesh.notes, note))


def nodes_of_elements(mesh: Mesh) -> sparse.csr_array:
    """Which nodes each element has, ones (e, n)."""
    columns = np.concatenate([np.zeros(0, int), *(block.connectivity.ravel() for block in mesh.blocks)])
    ends = np.cumsum(np.concatenate([[0], *([block.type.node_count] * len(block.labels) for block in mesh.blocks)]))
    return sparse.csr_array((np.ones(columns.size), columns, ends), shape=(mesh.element_count, len(mesh.points)))


def connected_parts(mesh: Mesh) -> IntArray:
    """Return the part that each node belongs to; nodes of one element or equation belong together.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    (n,) int
        Counted from zero without gaps. A node that no element uses is a part of its own.
    """
    uses, count = nodes_of_elements(mesh), len(mesh.points)
    joined = sparse.csr_array((count, count)) if mesh.equations is None else coupled_nodes(mesh.equations)
    graph = sparse.block_array([[joined, None], [uses, sparse.csr_array((len(uses.indptr) - 1,) * 2)]])
    # Nodes and elements are the graph's vertices: far fewer edges than between the nodes themselves.
    _, parts = sparse.csgraph.connected_components(graph, directed=False)
    _, numbered = np.unique(parts[:count], return_inverse=True)
    return numbered.astype(np.int64)


def jacobian_determinants(points: FloatArray, block: ElementBlock) -> FloatArray:
    """Return the determinants of the map from the reference element, where soundness is asked for.

    Parameters
    ----------
    points : (n, 3) float
        m.
    block : ElementBlock

    Returns
    -------
    (n_elements, n_places) float
        m³; at the corners first, then at the quadrature points of the type.
    """
    shape = block.type.shape
    places = np.concatenate([shape.polytope.corners, block.type.stiffness.points])
    # Relative to the first node, so that a body far from the origin loses no digits.
    coordinates = points[block.connectivity] - points[block.connectivity[:, :1]]
    return np.linalg.det(np.einsum("ena,pnb->epab", coordinates, shape.gradient(places)))


def _unsound(points: FloatArray, block: ElementBlock) -> BoolArray:
    corners = points[block.connectivity]
    extent = np.linalg.norm(corners.max(axis=1) - corners.min(axis=1), axis=1)
    smallest: FloatArray = jacobian_determinants(points, block).min(axis=1)
    return smallest <= DEGENERATE * extent**3


def _without_unused_nodes(mesh: Mesh) -> Mesh:
    used = np.zeros(len(mesh.points), dtype=bool)
    for block in mesh.blocks:
        used[block.connectivity] = True
    # Nodes of beams that are points beside the corners there.
    used |= np.isin(mesh.labels, mesh.labels[used])
    # And of those that equations carry the ones on which something hangs.
    if mesh.equations is not None:
        hanging = [*(end for one in mesh.springs for end in one.ends), *(one.nodes for one in mesh.masses)]
        used[np.intersect1d(mesh.equations.indices // 3, np.concatenate([mesh.equations.indices[:0], *hanging]))] = True
    if used.all():
        return mesh
    rows = np.cumsum(used) - 1
    dropped = mesh.labels[~used]
    notes = [f"{len(dropped)} nodes that no element uses are left out: {listed(dropped)}"]
    node_sets = {name: rows[members[used[members]]] for name, members in mesh.node_sets.items()}
    if emptied := _emptied(mesh.node_sets, node_sets):
        notes.append(f"node sets that hold none but such nodes are empty now: {listed(emptied)}")
    equations = mesh.equations
    if equations is not None:
        # What the file holds of such a node is zero, the rest of it is eliminated.
        kept = equations @ sparse.diags_array((~(mesh.fixed & ~used[:, None])).ravel().astype(float))
        equations = sparse.csr_array(without(kept, np.repeat(~used, 3))[:, np.repeat(used, 3)])
    return replace(
        mesh,
        points=mesh.points[used],
        labels=mesh.labels[used],
        blocks=tuple(replace(block, connectivity=rows[block.connectivity]) for block in mesh.blocks),
        node_sets=node_sets,
        fixed=mesh.fixed[used],
        notes=(*mesh.notes, *notes),
        equations=equations,
        **hung(mesh, lambda nodes: rows[nodes[used[nodes]]]),
        # A reference point that several have makes one of them.
        links=tuple(
            RigidLink(one.name, rows[one.nodes[used[one.nodes]]])
            for one in merged(mesh.links, ~used)
            if used[one.nodes].any()
        ),
    )


def _emptied(before: Mapping[str, IntArray], after: Mapping[str, IntArray]) -> list[str]:
    return [name for name, members in after.items() if len(before[name]) and not len(members)]
