"""Mesh of the beam clamped at both ends: writes `clamped_clamped.inp` beside this file.

Run from the repository's root: ``python -m demo.clamped_clamped.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

LENGTH = 1.0  # m, along x
SIDE = 0.03  # m, square section centred on the x axis
ELEMENTS = (40, 2, 2)  # along x, y, z

MODEL_FILE = Path(__file__).with_name("clamped_clamped.inp")

HEADING = [
    "Steel beam to be clamped at both ends, 1 m x 0.03 m x 0.03 m, axis y = z = 0, C3D20R 40 x 2 x 2. SI units.",
    "Node sets: ROOT (x = 0) and FAR (x = 1), to be clamped, MIDDLE (section x = 0.5).",
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
    sections = {"ROOT": 0.0, "FAR": LENGTH, "MIDDLE": LENGTH / 2}
    return mesh, {name: mesh.nodes_where(np.isclose(x, position)) for name, position in sections.items()}


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
