"""Structured meshes of 20-node bricks, their faces, and Abaqus/CalculiX model decks.

The node order of an element is that of Abaqus and CalculiX (C3D20R): four corners of the bottom, four of the
top, then the mid-side nodes of the bottom, of the top, and of the four upright edges. Lengths are in metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Corner and mid-side nodes of the brick, in half-element steps along x, y, z.
BRICK_STEPS = np.array(
    [
        [0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0],
        [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2],
        [1, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0],
        [1, 0, 2], [2, 1, 2], [1, 2, 2], [0, 1, 2],
        [0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 2, 1],
    ]
)  # fmt: skip

# The six faces as quad8: four corners in a ring, then the mid-side nodes after each corner.
BRICK_FACES = np.array(
    [
        [0, 1, 2, 3, 8, 9, 10, 11],
        [4, 7, 6, 5, 15, 14, 13, 12],
        [0, 4, 5, 1, 16, 12, 17, 8],
        [1, 5, 6, 2, 17, 13, 18, 9],
        [2, 6, 7, 3, 18, 14, 19, 10],
        [3, 7, 4, 0, 19, 15, 16, 11],
    ]
)

TETRAHEDRON_NODES = 10
TETRAHEDRON_FACES = np.array([[0, 1, 2, 4, 5, 6], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [2, 0, 3, 6, 7, 9]])

# Integrals of the quad8 shape functions over a parallelogram of unit area: corners, then mid-sides.
QUAD8_SHARES = np.array([-1 / 12] * 4 + [1 / 3] * 4)
# The same of the tria6 over a flat triangle with straight sides.
TRIA6_SHARES = np.array([0.0] * 3 + [1 / 3] * 3)

# Nodes closer than this part of the mesh's size are one node; far above round-off, far below an element.
MERGE_TOLERANCE = 1e-7

# A line of an Abaqus deck holds at most 16 numbers.
NUMBERS_PER_LINE = 16


@dataclass(frozen=True, slots=True)
class BrickMesh:
    """Mesh of 20-node bricks.

    Attributes
    ----------
    points : ndarray, shape (n_nodes, 3)
        Node coordinates, m.
    bricks : ndarray of int, shape (n_elements, 20)
        Node indices of each element, counted from 0; of 10-node tetrahedra, shape (n_elements, 10).
    """

    points: np.ndarray
    bricks: np.ndarray

    def nodes_where(self, condition: np.ndarray) -> np.ndarray:
        """Return the indices of the nodes for which a condition, shape (n_nodes,), is true."""
        return np.flatnonzero(condition)

    def nodes_of_bricks(self, condition: np.ndarray) -> np.ndarray:
        """Return the nodes of the elements for which a condition, shape (n_elements,), is true."""
        return np.unique(self.bricks[condition])

    def centres(self) -> np.ndarray:
        """Return the mean position of the corners of each element, shape (n_elements, 3)."""
        return self.points[self.bricks[:, :8]].mean(axis=1)


@dataclass(frozen=True, slots=True)
class Material:
    """Isotropic linear elastic material: name, modulus (N/m²), Poisson's ratio, density (kg/m³)."""

    name: str
    youngs_modulus: float
    poisson_ratio: float
    density: float


STEEL = Material(name="STEEL", youngs_modulus=2e11, poisson_ratio=0.3, density=7850.0)


def box_mesh(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> BrickMesh:
    """Mesh a box whose element corners lie at the given coordinates.

    Parameters
    ----------
    x, y, z : ndarray, shape (n + 1,)
        Increasing coordinates of the element boundaries along each axis, m.

    Returns
    -------
    BrickMesh
        Its nodes are numbered with x slowest, so that nodes of a range of x are contiguous.
    """
    lines = [_with_midpoints(axis) for axis in (x, y, z)]
    steps = np.stack(np.meshgrid(*(np.arange(line.size) for line in lines), indexing="ij"), axis=-1)
    # Serendipity elements have no node at face centres and inside: there two or three of the steps are odd.
    kept = (steps % 2).sum(axis=-1) <= 1
    number = np.full(kept.shape, -1)
    number[kept] = np.arange(kept.sum())
    points = np.stack([line[steps[kept][:, axis]] for axis, line in enumerate(lines)], axis=1)

    first = np.stack(
        np.meshgrid(*(2 * np.arange(axis.size - 1) for axis in (x, y, z)), indexing="ij"), axis=-1
    ).reshape(-1, 1, 3)
    i, j, k = np.moveaxis(first + BRICK_STEPS, -1, 0)
    return BrickMesh(points=points, bricks=number[i, j, k])


def merge(*meshes: BrickMesh) -> BrickMesh:
    """Join meshes, with coincident nodes made one; numbers follow the order of first appearance."""
    points = np.concatenate([mesh.points for mesh in meshes])
    offsets = np.cumsum([0] + [len(mesh.points) for mesh in meshes[:-1]])
    bricks = np.concatenate([mesh.bricks + start for mesh, start in zip(meshes, offsets, strict=True)])

    # Coordinates are counted from the lowest corner less half a cell, so that none falls between two cells.
    cell = MERGE_TOLERANCE * np.ptp(points, axis=0).max()
    cells = np.floor((points - points.min(axis=0)) / cell + 0.5).astype(np.int64)
    _, first, label = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    return BrickMesh(points=points[first[order]], bricks=rank[label.reshape(-1)][bricks])


def faces_within(mesh: BrickMesh, nodes: np.ndarray) -> np.ndarray:
    """Return the element faces all of whose nodes belong to a set, (n_faces, 8), or (n_faces, 6) of tetrahedra."""
    inside = np.zeros(len(mesh.points), dtype=bool)
    inside[nodes] = True
    table = TETRAHEDRON_FACES if mesh.bricks.shape[1] == TETRAHEDRON_NODES else BRICK_FACES
    faces = mesh.bricks[:, table].reshape(-1, table.shape[1])
    return faces[inside[faces].all(axis=1)]


def traction_weights(mesh: BrickMesh, nodes: np.ndarray) -> np.ndarray:
    """Share of each node in the resultant of a uniform traction on the faces within a node set.

    The same weights give the area mean of a displacement field over these faces, the work conjugate of the
    resultant force.

    Parameters
    ----------
    mesh : BrickMesh
        The mesh.
    nodes : ndarray of int, shape (n,)
        Node indices of a set that contains whole element faces.

    Returns
    -------
    ndarray, shape (n,)
        Weights in the order of `nodes`; their sum is 1.

    Raises
    ------
    ValueError
        If the set contains no face, has nodes outside the faces, or a face is no plain parallelogram (only
        for that are the shares −1/12 and 1/3 exact).
    """
    faces = faces_within(mesh, nodes)
    if len(faces) == 0 or not np.array_equal(np.unique(faces), np.sort(nodes)):
        raise ValueError("the node set has to consist of the nodes of whole element faces, each node once")
    if faces.shape[1] == len(TRIA6_SHARES):
        corner = mesh.points[faces[:, :3]]
        area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        return _shared(mesh, nodes, faces, area, TRIA6_SHARES)
    corner = mesh.points[faces[:, :4]]
    middle = mesh.points[faces[:, 4:]]
    size = np.ptp(corner, axis=1).max()
    skewed = corner[:, 0] - corner[:, 1] + corner[:, 2] - corner[:, 3]
    curved = middle - (corner + np.roll(corner, -1, axis=1)) / 2
    if max(np.abs(skewed).max(), np.abs(curved).max()) > MERGE_TOLERANCE * size:
        raise ValueError("the shares of a uniform traction are known for parallelogram faces only")

    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 3] - corner[:, 0]), axis=1)
    return _shared(mesh, nodes, faces, area, QUAD8_SHARES)


def _shared(mesh: BrickMesh, nodes: np.ndarray, faces: np.ndarray, area: np.ndarray, shares: np.ndarray) -> np.ndarray:
    weights = np.zeros(len(mesh.points))
    np.add.at(weights, faces, area[:, None] * shares)
    return weights[nodes] / area.sum()


def write_model(
    path: Path, mesh: BrickMesh, node_sets: dict[str, np.ndarray], material: Material, heading: list[str]
) -> None:
    """Write a model deck (nodes, elements, sets, material and section; no step) for Abaqus or CalculiX.

    Parameters
    ----------
    path : Path
        File to write.
    mesh : BrickMesh
        The mesh; numbers in the deck count from 1.
    node_sets : dict of str to ndarray of int
        Node indices of each set, counted from 0. Contiguous ranges longer than two lines are written with
        GENERATE.
    material : Material
        Material of all elements.
    heading : list of str
        Comment lines.
    """
    lines = [f"** {line}" for line in heading]
    lines.append("*NODE")
    lines += [f"{i}, {x:.10g}, {y:.10g}, {z:.10g}" for i, (x, y, z) in enumerate(mesh.points, start=1)]
    tetrahedra = mesh.bricks.shape[1] == TETRAHEDRON_NODES
    lines.append(f"*ELEMENT, TYPE={'C3D10' if tetrahedra else 'C3D20R'}, ELSET=EALL")
    for i, brick in enumerate(mesh.bricks + 1, start=1):
        # The element number and 15 nodes fill the first line; the comma at its end announces the second.
        lines.append(", ".join(map(str, [i, *brick[:15]])) + ("" if tetrahedra else ","))
        lines += [] if tetrahedra else [", ".join(map(str, brick[15:]))]
    for name, nodes in node_sets.items():
        lines += _node_set_lines(name, np.sort(nodes) + 1)
    lines += [
        f"*MATERIAL, NAME={material.name}",
        "*ELASTIC",
        f"{material.youngs_modulus:.6g}, {material.poisson_ratio:.6g}",
        "*DENSITY",
        f"{material.density:.6g}",
        f"*SOLID SECTION, ELSET=EALL, MATERIAL={material.name}",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _with_midpoints(axis: np.ndarray) -> np.ndarray:
    line = np.empty(2 * len(axis) - 1)
    line[::2] = axis
    line[1::2] = (axis[:-1] + axis[1:]) / 2
    return line


def _node_set_lines(name: str, numbers: np.ndarray) -> list[str]:
    contiguous = numbers[-1] - numbers[0] + 1 == numbers.size
    if contiguous and numbers.size > 2 * NUMBERS_PER_LINE:
        return [f"*NSET, NSET={name}, GENERATE", f"{numbers[0]}, {numbers[-1]}, 1"]
    rows = np.split(numbers, range(NUMBERS_PER_LINE, numbers.size, NUMBERS_PER_LINE))
    return [f"*NSET, NSET={name}"] + [", ".join(map(str, row)) + "," for row in rows]
