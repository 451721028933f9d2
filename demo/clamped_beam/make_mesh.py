"""Mesh of the clamped beam: writes `beam.inp` beside this file.

Run from the repository's root: ``python -m demo.clamped_beam.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

LENGTH = 1.0  # m, along x
SIDE = 0.03  # m, square section centred on the x axis
ELEMENTS = (40, 2, 2)  # along x, y, z
SEGMENTS = 8  # node sets of equal length, for frames given by hand

MODEL_FILE = Path(__file__).with_name("beam.inp")

HEADING = [
    "Clamped steel beam, 1 m x 0.03 m x 0.03 m, axis y = z = 0, C3D20R 40 x 2 x 2. SI units (m, N, kg, s).",
    "Node sets: ROOT (x = 0, to be clamped), TIP (x = 1), SEG1 ... SEG8 (eight equal lengths from root to",
    "tip; neighbours share the nodes of their common section).",
]


def build() -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    half = SIDE / 2
    mesh = box_mesh(
        np.linspace(0.0, LENGTH, ELEMENTS[0] + 1),
        np.linspace(-half, half, ELEMENTS[1] + 1),
        np.linspace(-half, half, ELEMENTS[2] + 1),
    )
    x = mesh.points[:, 0]
    sets = {"ROOT": mesh.nodes_where(x == 0.0), "TIP": mesh.nodes_where(x == LENGTH)}
    segment = np.floor(mesh.centres()[:, 0] * SEGMENTS / LENGTH).astype(int)
    for i in range(SEGMENTS):
        sets[f"SEG{i + 1}"] = mesh.nodes_of_bricks(segment == i)
    return mesh, sets


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
