"""Meshes of curved bars: writes `<name>.inp` for each beside this file.

All bars are 1 m long along their centre line, which starts at the origin, and have a square section. Most are meshed
with 30 layers of bricks, so that four equal levels split a layer. The corners of the tetrahedra are moved along the bar
at random, so that no set of their faces is a flat section.

Run from the repository's root: ``python -m demo.curved.make_mesh``.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

WIDTH = 0.03  # m, both ways
CELLS = (30, 2, 2)  # along the bar, across
TETRAHEDRA_CELLS = (24, 2, 2)
SHIFT = 0.3  # of a cell along the bar, at most
HELIX_RADIUS = 0.1  # m; one turn in 1 m of length

HERE = Path(__file__).parent

# Centre line (n, 3), m, and normals (n, 2, 3) of a bar at s (n,) in m along it.
Line = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def planar(angle: Callable[[np.ndarray], np.ndarray]) -> Line:
    """Centre line in the x-y plane whose tangent has turned by `angle(s)`, rad."""
    # Gauss points on each of many pieces make the integral exact to round-off.
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def line(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turn = angle(0.5 * s[:, None] * (nodes + 1.0))
        centre = 0.5 * s[:, None] * np.stack([np.cos(turn) @ weights, np.sin(turn) @ weights], axis=1)
        here = angle(s)
        normal = np.column_stack([-np.sin(here), np.cos(here), np.zeros_like(s)])
        upright = np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
        return np.column_stack([centre, np.zeros_like(s)]), np.stack([normal, upright], axis=1)

    return line


def arc(degrees: float) -> Line:
    """Arc of a circle that turns by an angle."""
    return planar(lambda s: np.radians(degrees) * s)


def helix(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One turn of a helix about the x axis, moved so that it starts at the origin."""
    turn = 2.0 * np.pi * s
    rise = np.sqrt(1.0 - (2.0 * np.pi * HELIX_RADIUS) ** 2)
    outward = np.column_stack([np.zeros_like(s), np.cos(turn), np.sin(turn)])
    tangent = np.column_stack(
        [np.full_like(s, rise), *(2.0 * np.pi * HELIX_RADIUS * np.array([-np.sin(turn), np.cos(turn)]))]
    )
    centre = HELIX_RADIUS * (outward - [0.0, 1.0, 0.0])
    centre[:, 0] = rise * s
    return centre, np.stack([outward, np.cross(tangent, outward)], axis=1)


LINES: dict[str, Line] = {
    "arc_20": arc(20.0),
    "arc_45": arc(45.0),
    "arc_90": arc(90.0),
    "s_curve": planar(lambda s: np.radians(45.0) * np.sin(2.0 * np.pi * s)),
    "helix": helix,
    "s_curve_tetrahedra": planar(lambda s: np.radians(45.0) * np.sin(2.0 * np.pi * s)),
}


def placed(line: Line, local: np.ndarray) -> np.ndarray:
    """Points (n, 3) at s along the bar and two coordinates across it, (n, 3), all in m."""
    centre, normals = line(local[:, 0])
    return centre + np.einsum("na,naj->nj", local[:, 1:], normals)


def bricks(line: Line) -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Mesh of 20-node bricks and its node sets."""
    across = [np.linspace(-0.5 * WIDTH, 0.5 * WIDTH, count + 1) for count in CELLS[1:]]
    mesh = box_mesh(np.linspace(0.0, 1.0, CELLS[0] + 1), *across)
    s = mesh.points[:, 0]
    sets = {"ROOT": mesh.nodes_where(np.isclose(s, 0.0)), "TIP": mesh.nodes_where(np.isclose(s, 1.0))}
    return BrickMesh(placed(line, mesh.points), mesh.bricks), sets


def tetrahedra(line: Line) -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Mesh of 10-node tetrahedra, six a cell, with corners moved along the bar, and its node sets."""
    cells = np.stack(np.meshgrid(*map(np.arange, TETRAHEDRA_CELLS), indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
    paths = []
    for order in permutations(range(3)):
        # From corner to opposite corner of the cell, one axis after the other.
        path = np.zeros((4, 3), dtype=int)
        for step, axis in enumerate(order, start=1):
            path[step:, axis] = 1
        paths.append(path if np.linalg.det(path[1:]) > 0.0 else path[[0, 2, 1, 3]])
    corners = (cells + np.array(paths)).reshape(-1, 4, 3)
    keys, connectivity = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    connectivity = connectivity.reshape(-1, 4)
    local = keys.astype(float)
    inside = (keys[:, 0] > 0) & (keys[:, 0] < TETRAHEDRA_CELLS[0])
    random = np.random.default_rng(20)
    local[inside, 0] += random.uniform(-SHIFT, SHIFT, inside.sum())
    local = local / TETRAHEDRA_CELLS * [1.0, WIDTH, WIDTH] - [0.0, 0.5 * WIDTH, 0.5 * WIDTH]
    pairs = np.sort(connectivity[:, [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]], axis=2)
    edges, middle = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    local = np.concatenate([local, local[edges].mean(axis=1)])
    every = np.hstack([connectivity, len(keys) + middle.reshape(-1, 6)])
    s = local[:, 0]
    sets = {"ROOT": np.flatnonzero(np.isclose(s, 0.0)), "TIP": np.flatnonzero(np.isclose(s, 1.0))}
    return BrickMesh(placed(line, local), every), sets


def build(name: str) -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return a bar's mesh and its node sets (indices counted from 0)."""
    return (tetrahedra if name.endswith("tetrahedra") else bricks)(LINES[name])


def main() -> None:
    """Write the model decks."""
    for name in LINES:
        mesh, sets = build(name)
        kind = "C3D10" if mesh.bricks.shape[1] == 10 else "C3D20R"
        title = name.replace("_", " ")
        heading = [
            f"Steel bar, {title}: 1 m along its centre line, {WIDTH:g} m x {WIDTH:g} m, {kind}. SI units.",
            "Node sets: ROOT (end at the origin, to be clamped) and TIP (the other end).",
        ]
        write_model(HERE / f"{name}.inp", mesh, sets, STEEL, heading)
        print(f"{name}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
