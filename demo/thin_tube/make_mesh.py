"""Mesh of the thin tube: writes `thin_tube.inp` beside this file.

Run from the repository's root: ``python -m demo.thin_tube.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, merge, write_model

LENGTH = 0.1  # m, along x
RADIUS = 0.005  # m, outer
WALL = 0.001  # m
ELEMENTS = (20, 16)  # along x, around

MODEL_FILE = Path(__file__).with_name("thin_tube.inp")

HEADING = [
    "Thin steel tube to be clamped at one end, 0.1 m long, 0.01 m outer diameter, wall 0.001 m, axis x,",
    "C3D20R 20 x 16 x 1. SI units. Node sets: ROOT (x = 0), to be clamped, TIP (x = 0.1).",
]


def build() -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    flat = box_mesh(
        np.linspace(0.0, LENGTH, ELEMENTS[0] + 1),
        np.linspace(0.0, 2.0 * np.pi, ELEMENTS[1] + 1),
        np.array([RADIUS - WALL, RADIUS]),
    )
    x, angle, radius = flat.points.T
    points = np.stack([x, radius * np.sin(angle), radius * np.cos(angle)], axis=1)
    # Closed where the angle comes round.
    mesh = merge(BrickMesh(points=points, bricks=flat.bricks))
    x = mesh.points[:, 0]
    return mesh, {name: mesh.nodes_where(np.isclose(x, end)) for name, end in (("ROOT", 0.0), ("TIP", LENGTH))}


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
