"""Structured meshes made in memory, of any element type: boxes, arcs, frames of square bars; and a deck of them."""

from dataclasses import replace
from itertools import permutations

import numpy as np

from flexfmu.build.config import BodyFile
from flexfmu.mesh.elements import ElementBlock, ElementType
from flexfmu.mesh.model import Material, Mesh

STEEL = Material("STEEL", 2.0e11, 0.3, 7850.0)
BAR = """
name = "bar"
frames = 3
[mesh]
file = "bar.inp"
[[support]]
nodes = "ROOT"
fix = ["x", "y", "z"]
[[interface]]
name = "tip"
nodes = "TIP"
[reduction]
modes = 6
residual_flexibility = false
[damping]
ratio = 0.01
[output]
surface = true
error = false
"""
"""Body file of a bar whose deck has these sets; without its error the bar is reduced once."""
HEXAHEDRA = (ElementType.C3D8, ElementType.C3D20, ElementType.C3D20R)
TETRAHEDRA = (ElementType.C3D4, ElementType.C3D10)
EVERY_TYPE = (*HEXAHEDRA, *TETRAHEDRA)
WEDGES = (ElementType.C3D6, ElementType.C3D15)
# Of decks only; tests of what depends on elements take these too.
DECK_TYPES = (ElementType.C3D8I, *WEDGES)
QUADRATIC = (ElementType.C3D20, ElementType.C3D20R, ElementType.C3D10, ElementType.C3D15)

# A cell is two units wide, so that mid-side nodes have whole numbers too.
_HEX = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)])
_HEX_EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
_WEDGE_EDGES = np.array([(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)])
_TET_EDGES = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)])


def _corners(kind):
    """Corners (elements per cell, corners, 3) of the elements that make up a cell."""
    if kind.corner_count == 8:
        return _HEX[None]
    if kind in WEDGES:
        return np.array([_HEX[[0, 1, 2, 4, 5, 6]], _HEX[[0, 2, 3, 4, 6, 7]]])
    result = []
    for order in permutations(range(3)):
        path = np.zeros((4, 3), dtype=int)
        for step, axis in enumerate(order, start=1):
            path[step:, axis] = 2
        if np.linalg.det(path[1:]) < 0.0:
            path[[1, 2]] = path[[2, 1]]
        result.append(path)
    return np.array(result)


def edges(kind):
    """Corners (mid-side nodes, 2) between which an element type has its mid-side nodes."""
    table = {8: _HEX_EDGES, 6: _WEDGE_EDGES, 4: _TET_EDGES}[kind.corner_count]
    return table if kind in QUADRATIC else table[:0]


def lattice(kind, cells, place, materials=(STEEL,), material=None):
    """Mesh of lattice cells (n, 3) whose corners `place` (points (k, 3) of the lattice) puts into space.

    `material` tells the material's index from the element centres (n, 3) in the lattice.
    """
    cells = np.asarray(cells)
    corners = (2 * cells[:, None, None, :] + _corners(kind)[None]).reshape(-1, _corners(kind).shape[1], 3)
    middle = edges(kind)
    nodes = np.concatenate([corners, corners[:, middle].sum(axis=2) // 2], axis=1)
    keys, connectivity = np.unique(nodes.reshape(-1, 3), axis=0, return_inverse=True)
    connectivity = connectivity.reshape(nodes.shape[:2]).astype(np.int64)
    count = len(connectivity)
    index = np.zeros(count, dtype=np.int64) if material is None else material(corners.mean(axis=1) / 2.0)
    return Mesh(
        points=np.asarray(place(keys / 2.0), dtype=float),
        labels=np.arange(1, len(keys) + 1),
        blocks=(ElementBlock(kind, np.arange(1, count + 1), connectivity, np.asarray(index, dtype=np.int64)),),
        node_sets={},
        element_sets={},
        materials=tuple(materials),
        fixed=np.zeros((len(keys), 3), dtype=bool),
    )


def grid(nx, ny, nz):
    """Cells (n, 3) of a box."""
    return np.stack(np.meshgrid(range(nx), range(ny), range(nz), indexing="ij"), axis=-1).reshape(-1, 3)


def box(kind, counts, size, **options):
    """Box from the origin to `size`, with the node sets ROOT (x = 0) and TIP (the far end)."""
    mesh = lattice(kind, grid(*counts), lambda p: p / counts * np.array(size), **options)
    return with_sets(mesh, ROOT=lambda p: p[:, 0], TIP=lambda p: p[:, 0] - size[0])


def arc(kind, counts, radius, width, angle=0.5 * np.pi):
    """Square bar along a circular arc about the origin, from ROOT at (radius, 0, 0) to TIP, in the plane z = 0."""

    def place(p):
        s = p / counts
        turn, r = s[:, 0] * angle, radius - (s[:, 1] - 0.5) * width
        return np.column_stack([r * np.cos(turn), r * np.sin(turn), (s[:, 2] - 0.5) * width])

    end = np.array([-np.sin(angle), np.cos(angle), 0.0])
    return with_sets(lattice(kind, grid(*counts), place), ROOT=lambda p: p[:, 1], TIP=lambda p: p @ end)


def bars(kind, runs, width=1.0):
    """Frame of square bars; each run is the first and last cell, both in, of a straight row of cells."""
    cells = np.concatenate([first + grid(*(np.array(last) - first + 1)) for first, last in runs])
    return lattice(kind, np.unique(cells, axis=0), lambda p: width * p)


def with_sets(mesh, **sets):
    """Mesh with node sets of the points where a function of the points is zero."""
    size = np.abs(mesh.points).max()
    found = {name: np.flatnonzero(np.abs(f(mesh.points)) < 1e-9 * size) for name, f in sets.items()}
    return replace(mesh, node_sets={**mesh.node_sets, **found})


def held(mesh, *names):
    """Mesh whose file holds the nodes of some sets in all directions."""
    fixed = mesh.fixed.copy()
    for name in names:
        fixed[mesh.node_sets[name]] = True
    return replace(mesh, fixed=fixed)


def distorted(mesh, amount, random):
    """Mesh with corners moved at random by up to `amount`, mid-side nodes in the middle of straight edges."""
    points = mesh.points.copy()
    shift = random.uniform(-amount, amount, points.shape)
    (block,) = mesh.blocks
    count = block.type.corner_count
    corners = np.unique(block.connectivity[:, :count])
    points[corners] += shift[corners]
    for local, pair in enumerate(edges(block.type), start=count):
        points[block.connectivity[:, local]] = points[block.connectivity[:, pair]].mean(axis=1)
    return replace(mesh, points=points)


def renumbered(mesh, random):
    """The same mesh with its nodes and its elements in another order, and the old row (n,) of each new node."""
    old = random.permutation(len(mesh.points))
    new = np.argsort(old)
    (block,) = mesh.blocks
    order = random.permutation(len(block.labels))
    shuffled = replace(
        block,
        labels=block.labels[order],
        connectivity=new[block.connectivity[order]],
        material=block.material[order],
    )
    sets = {name: np.sort(new[nodes]) for name, nodes in mesh.node_sets.items()}
    other = replace(
        mesh,
        points=mesh.points[old],
        labels=mesh.labels[old],
        blocks=(shuffled,),
        node_sets=sets,
        fixed=mesh.fixed[old],
    )
    return other, old


def write_deck(mesh, path, *, materials=True):
    """Write a mesh with its node sets, and its materials, as a deck."""
    lines = ["*NODE"]
    lines += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(mesh.labels, mesh.points.tolist(), strict=True)]
    for block in mesh.blocks:
        for index in np.unique(block.material):
            lines.append(f"*ELEMENT, TYPE={block.type.name}, ELSET=PART{index}")
            chosen = block.material == index
            for label, nodes in zip(block.labels[chosen], mesh.labels[block.connectivity[chosen]], strict=True):
                row = [str(label), *map(str, nodes)]
                lines += [", ".join(row[:11]) + ("," if row[11:] else "")] + ([", ".join(row[11:])] if row[11:] else [])
    for name, nodes in mesh.node_sets.items():
        lines.append(f"*NSET, NSET={name}")
        lines += [f"{label}," for label in mesh.labels[nodes]]
    if materials:
        for index, material in enumerate(mesh.materials):
            elastic = f"{material.youngs_modulus!r}, {material.poissons_ratio!r}"
            lines += [f"*MATERIAL, NAME={material.name}", "*ELASTIC", elastic, "*DENSITY", repr(material.density)]
            lines.append(f"*SOLID SECTION, ELSET=PART{index}, MATERIAL={material.name}")
    path.write_text("\n".join(lines) + "\n")
    return path


def body_file(mesh, folder, *, interface, support="ROOT", name="body", **tables):
    """Checked body file of a mesh whose deck is written to `folder`: interfaces by their sets, `support` clamped.

    The body does not tell its error, which would take twice as long, and has no surface, unless `output` says so.
    """
    deck = write_deck(mesh, folder / f"{name}.inp")
    content = {
        "name": name,
        "mesh": {"file": deck},
        "support": [] if support is None else [{"nodes": support, "fix": ["x", "y", "z"]}],
        "interface": [{"name": each.lower(), "nodes": each} for each in interface],
    }
    output = {"error": False, "surface": False} | tables.pop("output", {})
    return BodyFile.model_validate(content | tables | {"output": output})
