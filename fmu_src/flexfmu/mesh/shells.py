"""Shells as bricks and wedges of one layer: lines through the thickness, knots where lines meet.

A node has one line through the thickness for each group of elements around it that have nearly the same normal, and
the same faces. Where it has several, at folds, joints and steps of the thickness, they are one rigid body: a knot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..files import sparse as sp
from ..files.basics import BoolArray, FloatArray, IntArray, MeshError
from .elements import ElementBlock, ElementType
from .equations import MIDDLE, RigidLink, Row, matrix_of, middles, moved_by
from .model import NO_MATERIAL, Mesh, hung
from .shapes import FACE_SHAPES
from .ties import EdgeTie, OfShell, ShellTie, tie_rows

SHELLS = {
    "triangle": ElementType.S3,
    "quad": ElementType.S4,
    "triangle6": ElementType.S6,
    "quad8": ElementType.S8,
    "quad9": ElementType.S8,
}
"""Shells by meshio's names of their cells."""
MOST_NODES = 9
# Cosine of the angle between normals up to which elements share a line: 20 degrees.
_SMOOTH = np.cos(np.radians(20.0))
# Difference of the faces' heights, over the thickness, that is none.
_SAME = 1e-9
# Length of what is left of a direction that others span already.
_NOTHING = 1e-9


class FoldedShellError(MeshError):
    """A shell without area at a corner."""

    def __init__(self, label: int):
        super().__init__(f"shell {label} has no area at a corner: correct its nodes, or mesh again")
        self.label = label


@dataclass(frozen=True, slots=True)
class _Lines:
    """Lines through the thickness.

    Attributes
    ----------
    node : (l,) int
        Ascending.
    normal : (l, 3) float
    height : (l, 2) float
        Of both ends over the node along the normal, m, the lower first.
    ends : (l, 2) int
        Rows of the points there.
    """

    node: IntArray
    normal: FloatArray
    height: FloatArray
    ends: IntArray

    @property
    def share(self) -> FloatArray:
        """Parts (l, 2) of the ends' displacements that make that of the node."""
        low, high = self.height.T
        return np.stack([high, -low], axis=1) / (high - low)[:, None]


def shell_mesh(
    points: FloatArray, cells: Mapping[str, IntArray], thickness: float | FloatArray, **sets: IntArray
) -> Mesh:
    """Mesh of shells in memory.

    Parameters
    ----------
    points : (n, 3) float
        Of the middle surface, m.
    cells : mapping of str to (k, nodes) int
        "triangle", "quad", "triangle6", "quad8", "quad9": rows of points, in meshio's order.
    thickness : float or (n_elements,) float
        m.
    **sets : (k,) int
        Node sets: rows of points.

    Returns
    -------
    Mesh

    Examples
    --------
    >>> points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> flexfmu.shell_mesh(points, {"quad": [[0, 1, 2, 3]]}, 0.01, ROOT=[0, 3])
    <Mesh: 8 nodes, 1 S4; node sets ROOT; element sets none>
    """
    if unknown := [name for name in cells if name not in SHELLS]:
        raise MeshError(f"shells are made of cells {', '.join(SHELLS)}, found {', '.join(unknown)}")
    places = np.asarray(points, dtype=float)
    blocks, first = [], 1
    for name, given in cells.items():
        rows = np.asarray(given, dtype=np.int64)
        labels = np.arange(first, first + len(rows))
        first += len(rows)
        blocks.append(ElementBlock(SHELLS[name], labels, rows, np.full(len(rows), NO_MATERIAL)))
    mesh = Mesh(
        points=places,
        labels=np.arange(1, len(places) + 1),
        blocks=tuple(blocks),
        node_sets={name: np.unique(rows) for name, rows in sets.items()},
        element_sets={},
        materials=(),
        fixed=np.zeros((len(places), 3), dtype=bool),
    )
    half = 0.5 * np.broadcast_to(np.asarray(thickness, dtype=float), first - 1)
    return expanded(mesh, np.stack([-half, half], axis=1), np.zeros_like(mesh.fixed))


def expanded(mesh: Mesh, height: FloatArray, turning: BoolArray, ties: Sequence[OfShell] = ()) -> Mesh:
    """Give shells their thickness.

    Parameters
    ----------
    mesh : Mesh
        Whose shells have the nodes of a surface, three to nine.
    height : (n_elements, 2) or (n_elements, 9, 2) float
        Of both faces over that surface along the element's normal, m, the lower first, at each node; of solids any.
    turning : (n, 3) bool
        Rotations of nodes that are held at zero.
    ties : sequence of ShellTie or EdgeTie

    Returns
    -------
    Mesh
        Shells are bricks and wedges of one layer; sets, supports, links, masses and equations follow.

    Raises
    ------
    MeshError
        Shells are degenerate.
    """
    mesh, turning = _with_centres(mesh, turning)
    solid, shell = np.zeros((2, len(mesh.points)), dtype=bool)
    for block in mesh.blocks:
        (shell if block.type.shell else solid)[block.connectivity] = True
    kept = np.flatnonzero(solid | ~shell)
    row = np.full(len(mesh.points), -1)
    row[kept] = np.arange(kept.size)
    lines, blocks = _lines(mesh, height, kept.size)
    ends = mesh.points[lines.node][:, None] + lines.height[:, :, None] * lines.normal[:, None]

    def moved(nodes: IntArray) -> IntArray:
        return np.unique(np.concatenate([row[nodes][row[nodes] >= 0], lines.ends[np.isin(lines.node, nodes)].ravel()]))

    node, count = np.unique(lines.node, return_counts=True)
    knots = [RigidLink(f"knot {mesh.labels[one]}", moved(np.array([one]))) for one in node[count > 1].tolist()]
    origin = np.concatenate([kept, np.repeat(lines.node, 2)])
    fixed, held = _supports(mesh, turning, lines, row, len(origin))
    points = np.concatenate([mesh.points[kept], ends.reshape(-1, 3)])
    rows = _joined(lines, row) + _tied(ties, points, lines, row)
    total, given = len(origin), ((mesh.equations, rows), (mesh.supports, held))
    both = ([_on_lines(part, row, lines, total), matrix_of(own, 3 * total)] for part, own in given)
    equations, supports = (sp.csr_array(sp.vstack(parts)) for parts in both)
    return replace(
        mesh,
        points=points,
        labels=mesh.labels[origin],
        blocks=tuple(b if b.type.shell else replace(b, connectivity=row[b.connectivity]) for b in blocks),
        node_sets={name: moved(nodes) for name, nodes in mesh.node_sets.items()},
        fixed=fixed,
        **hung(mesh, moved),
        links=(*(RigidLink(one.name, moved(one.nodes)) for one in mesh.links), *knots),
        equations=equations,
        supports=supports,
        notes=(*_bent(mesh, height), *_notes(blocks, len(lines.node), len(knots), int((solid & shell).sum()))),
    )


def at_nodes(values: FloatArray, count: int = 0) -> FloatArray:
    """Values (e, 9, …) at so many nodes of shells, a ninth beside eight, of those at as many or corners (e, k, …)."""
    given = values.shape[1]
    nodes = MOST_NODES if (count or given) == 8 else count or given
    found = np.full((len(values), MOST_NODES, *values.shape[2:]), np.nan)
    found[:, :nodes] = np.einsum("nk,ek...->en...", FACE_SHAPES[given].value(FACE_SHAPES[nodes].nodes), values)
    return found


def _with_centres(mesh: Mesh, turning: BoolArray) -> tuple[Mesh, BoolArray]:
    """Give shells of eight nodes a ninth, which sets and supports hold that hold the eight, and `turning` likewise."""
    eight = [block.type is ElementType.S8 and block.connectivity.shape[1] == 8 for block in mesh.blocks]
    around = [block.connectivity for block, wanted in zip(mesh.blocks, eight, strict=True) if wanted]
    if not around:
        return mesh, turning
    every, count = np.concatenate(around), len(mesh.points)
    own = np.split(np.arange(count, count + len(every)), np.cumsum([len(rows) for rows in around])[:-1])
    points = np.einsum("a,eai->ei", MIDDLE, mesh.points[every])
    found = iter(own)

    def held(nodes: IntArray) -> IntArray:
        return np.concatenate([nodes, count + np.flatnonzero(np.isin(every, nodes).all(axis=1))])

    def wider(rows: "sp.csr_array") -> "sp.csr_array":
        return sp.csr_array((rows.data, rows.indices, rows.indptr), (rows.shape[0], 3 * total))

    total = count + len(every)
    # A skin on solids has no motion of its own in its middle.
    solid = [b.connectivity.ravel() for b in mesh.blocks if not b.type.natural]
    skin = np.flatnonzero(np.isin(every, np.concatenate([every[:0, 0], *solid])).all(axis=1))
    skin = skin[~mesh.fixed[every[skin]].all(axis=(1, 2))]
    tied = matrix_of(middles(every[skin], count + skin), 3 * total)
    result = replace(
        mesh,
        points=np.concatenate([mesh.points, points]),
        labels=np.concatenate([mesh.labels, mesh.labels.max() + 1 + np.arange(len(every))]),
        blocks=tuple(
            replace(b, connectivity=np.column_stack([b.connectivity, next(found)])) if wanted else b
            for b, wanted in zip(mesh.blocks, eight, strict=True)
        ),
        node_sets={name: held(nodes) for name, nodes in mesh.node_sets.items()},
        fixed=np.concatenate([mesh.fixed, mesh.fixed[every].all(axis=1)]),
        equations=sp.csr_array(sp.vstack([tied, wider(mesh.equations)])),
        supports=wider(mesh.supports),
    )
    return result, np.concatenate([turning, turning[every].all(axis=1)])


def _notes(blocks: tuple[ElementBlock, ...], lines: int, knots: int, shared: int) -> list[str]:
    """What shells have become."""
    found = [f"{lines} lines through the thickness of shells, {knots} knots"]
    if triangles := sum(len(block.labels) for block in blocks if block.type is ElementType.S3):
        found.append(f"{triangles} triangles (S3) have constant strain in their plane, too stiff in it: take S4 there")
    if shared:
        found.append(
            f"shells share {shared} nodes with solids, which have no rotations: they move together there, and may turn "
            "as on hinges. Where they shall not, let the shells reach one element into the solids, or use a coupling"
        )
    return found


def _bent(mesh: Mesh, height: FloatArray) -> list[str]:
    """Notes of the mesh, and that triangles have sides bent in their plane, if any, by more than their thickness."""
    count = 0
    for block, at in zip(mesh.blocks, mesh.starts, strict=False):
        if block.type is ElementType.S6:
            place = mesh.points[block.connectivity]
            normal = _corner_normals(mesh.points, block).reshape(place.shape)[:, 3:]
            aside = place[:, 3:] - 0.5 * (place[:, :3] + np.roll(place[:, :3], -1, axis=1))
            aside -= np.einsum("eai,eai->ea", aside, normal)[..., None] * normal
            thick = np.ptp(height[at : at + len(place)].reshape(len(place), -1, 2)[:, 0], axis=1)
            count += int((np.linalg.norm(aside, axis=2).max(axis=1) > thick).sum())
    if not count:
        return [*mesh.notes]
    return [
        *mesh.notes,
        f"{count} triangles (S6) have sides bent in their plane by more than the thickness: they bend too stiffly, by "
        "some 2 % there, 20 % at ten times the thickness; put the nodes into the middle of straight sides, or take S8",
    ]


def _lines(mesh: Mesh, height: FloatArray, first: int) -> tuple[_Lines, tuple[ElementBlock, ...]]:
    """Lines of all shells, and the blocks with shells between them; `first` is the row of the first end."""
    shells = [(block, at) for block, at in zip(mesh.blocks, mesh.starts, strict=False) if block.type.shell]
    # Corners of all shells, one after the other.
    nodes = np.concatenate([block.connectivity.ravel() for block, _ in shells])
    normals = np.concatenate([_corner_normals(mesh.points, block) for block, _ in shells])
    every = np.broadcast_to(height if height.ndim == 3 else height[:, None], (len(height), MOST_NODES, 2))
    parts = [every[at : at + len(b.labels), : b.connectivity.shape[1]].reshape(-1, 2) for b, at in shells]
    heights = np.concatenate(parts)
    order = np.argsort(nodes, kind="stable")
    line, along = np.zeros(nodes.size, dtype=np.int64), np.ones(nodes.size, dtype=bool)
    node: list[int] = []
    direction, faces = [], []
    for corners in np.split(order, np.flatnonzero(np.diff(nodes[order])) + 1):
        for total, own, members in _groups(normals[corners], heights[corners]):
            line[corners[members]] = len(node)
            along[corners[members]] = normals[corners[members]] @ total > 0.0
            node.append(int(nodes[corners[0]]))
            direction.append(total / np.linalg.norm(total))
            faces.append(own)
    ends = first + np.arange(2 * len(node)).reshape(-1, 2)
    lines = _Lines(np.array(node), np.array(direction), np.array(faces), ends)
    ends = np.where(along, lines.ends[line].T, lines.ends[line, ::-1].T)
    blocks, corner = [], 0
    for block in mesh.blocks:
        if block.type.shell:
            both = ends[:, corner : corner + block.connectivity.size].reshape(2, *block.connectivity.shape)
            corner += block.connectivity.size
            columns = np.argsort(block.type.sheet.halves.ravel())
            block = replace(block, connectivity=np.concatenate(list(both), axis=1)[:, columns])
        blocks.append(block)
    return lines, tuple(blocks)


def _corner_normals(points: FloatArray, block: ElementBlock) -> FloatArray:
    """Unit normals (e a, 3) of shells at their corners."""
    flat = FACE_SHAPES[block.connectivity.shape[1]]
    along, across = np.einsum("eni,anj->jeai", points[block.connectivity], flat.gradient(flat.nodes))
    found = np.cross(along, across)
    size = np.linalg.norm(found, axis=2, keepdims=True)
    if (folded := (size <= 0.0).any(axis=(1, 2))).any():
        raise FoldedShellError(int(block.labels[folded][0]))
    return (found / size).reshape(-1, 3)


def _groups(normals: FloatArray, heights: FloatArray) -> list[tuple[FloatArray, FloatArray, list[int]]]:
    """Corners at a node that share a line: sum of their normals, whichever way they point, heights, members."""
    found: list[tuple[FloatArray, FloatArray, list[int]]] = []
    for corner, (own, (low, high)) in enumerate(zip(normals, heights, strict=True)):
        for place, (total, other, members) in enumerate(found):
            cosine = float(own @ total) / float(np.linalg.norm(total))
            faces = np.array([low, high] if cosine > 0.0 else [-high, -low])
            if abs(cosine) > _SMOOTH and np.abs(faces - other).max() <= _SAME * (high - low):
                found[place] = (total + np.sign(cosine) * own, other, [*members, corner])
                break
        else:
            found.append((own, np.array([low, high]), [corner]))
    return found


def _supports(mesh: Mesh, turning: BoolArray, lines: _Lines, row: IntArray, count: int) -> tuple[BoolArray, list[Row]]:
    """Translations (count, 3) held at zero, and equations for what is held of lines otherwise.

    A line n turns by ω × n; held rotations leave it the directions of the free ones, and its length.
    """
    fixed, rows = np.zeros((count, 3), dtype=bool), []
    fixed[row[row >= 0]] = mesh.fixed[row >= 0]
    held, previous = mesh.fixed & (row < 0)[:, None], -1
    places = np.flatnonzero((held | turning)[lines.node].any(axis=1))
    for place, share in zip(places.tolist(), lines.share[places].tolist(), strict=True):
        node, ends = int(lines.node[place]), lines.ends[place].tolist()
        moves = [np.cross(unit, lines.normal[place]) for unit in np.eye(3)[~turning[node]]]
        # Orthonormal directions at right angles to all of these.
        _, sizes, sides = np.linalg.svd(np.array([*moves, lines.normal[place]]))
        still = sides[int(np.sum(sizes > _NOTHING)) :] if moves else np.eye(3)
        for axis, unit in enumerate(np.eye(3)):
            if held[node, axis] and np.linalg.norm(still @ unit) > 1.0 - _NOTHING:
                fixed[ends, axis] = True
            elif held[node, axis] and node != previous:
                rows.append({3 * end + axis: part for end, part in zip(ends, share, strict=True)})
        previous = node
        left = still * ~fixed[ends[0]]
        rows += [
            {
                3 * end + axis: sign * float(one[axis])
                for end, sign in zip(ends, (-1.0, 1.0), strict=True)
                for axis in axes
            }
            for one in left
            if np.linalg.norm(one) > _NOTHING and (axes := np.flatnonzero(one).tolist())
        ]
    return fixed, rows


def _joined(lines: _Lines, row: IntArray) -> list[Row]:
    """Equations by which nodes of solids move with the line of the shells that share them; knots hold several."""
    node, count = np.unique(lines.node, return_counts=True)
    alone = np.isin(lines.node, node[count == 1]) & (row[lines.node] >= 0)
    held = row[lines.node[alone]].tolist(), lines.ends[alone].tolist(), lines.share[alone].tolist()
    found: list[Row] = []
    for place, ends, share in zip(*held, strict=True):
        found += moved_by(place, dict(zip(ends, share, strict=True)))
    return found


def _tied(ties: Sequence[OfShell], points: FloatArray, lines: _Lines, row: IntArray) -> list[Row]:
    """Equations of ties to shells."""

    def through(node: int) -> IntArray:
        return lines.ends[slice(*np.searchsorted(lines.node, [node, node + 1]))]

    def carried(node: int) -> IntArray:
        # Of a knot one line: it is rigid.
        ends = through(node)[:1].ravel()
        return ends if ends.size else row[[node]]

    moved = [one if isinstance(one, ShellTie) else EdgeTie(one.node, tuple(row[f] for f in one.faces)) for one in ties]
    return tie_rows(moved, points, carried, through)


def _on_lines(equations: "sp.csr_array", row: IntArray, lines: _Lines, count: int) -> "sp.csr_array":
    """Equations of displacements of nodes as ones of those of the ends of lines."""
    node, first = np.unique(lines.node, return_index=True)
    node, first = node[row[node] < 0], first[row[node] < 0]
    parts = [(np.flatnonzero(row >= 0), row[row >= 0], np.ones(int((row >= 0).sum())))]
    parts += [(node, lines.ends[first, end], lines.share[first, end]) for end in (0, 1)]
    before, after, share = (np.concatenate(part) for part in zip(*parts, strict=True))
    spread = sp.csr_array(sp.coo_array((share, (before, after)), shape=(len(row), count)))
    return sp.csr_array(equations @ sp.kron(spread, sp.eye_array(3), format="csr"))
