"""Mesh of the plate: writes `plate.inp` beside this file.

Run from the repository's root: ``python -m demo.plate.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

LENGTH = 0.3  # m, along x
WIDTH = 0.2  # m, along y, centred
THICKNESS = 0.003  # m, along z, centred
ELEMENTS = (24, 16)  # along x, y
LAYERS = 1  # elements through the thickness

MODEL_FILE = Path(__file__).with_name("plate.inp")

HEADING = [
    "Steel plate to be clamped at one edge, 0.3 m x 0.2 m x 0.003 m, mid-plane z = 0, C3D20R 24 x 16 x 1. SI units.",
    "Node sets: ROOT (edge face x = 0, to be clamped); CORNER_LEFT and CORNER_RIGHT, the end faces, at x = 0.3, of",
    "the elements in the corners at y = 0.1 and y = -0.1: patches of 0.0125 m x 0.003 m.",
]


def build(layers: int = LAYERS) -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    across = np.linspace(-WIDTH / 2, WIDTH / 2, ELEMENTS[1] + 1)
    mesh = box_mesh(
        np.linspace(0.0, LENGTH, ELEMENTS[0] + 1),
        across,
        np.linspace(-THICKNESS / 2, THICKNESS / 2, layers + 1),
    )
    x, y, _ = mesh.points.T
    at_end = np.isclose(x, LENGTH)
    sets = {
        "ROOT": mesh.nodes_where(np.isclose(x, 0.0)),
        "CORNER_LEFT": mesh.nodes_where(at_end & (y >= across[-2])),
        "CORNER_RIGHT": mesh.nodes_where(at_end & (y <= across[1])),
    }
    return mesh, sets


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
