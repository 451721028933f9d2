"""Mesh of the L-frame: writes `l_frame.inp` beside this file.

Two legs of square section meet in a cubic corner block. The centre line runs from the clamped face at the
origin 0.5 m along x to the centre of the block, and from there 0.3 m along y to the tip face:

    leg 1    0    <= x <= 0.49,  -0.01 <= y <= 0.01
    corner   0.49 <= x <= 0.51,  -0.01 <= y <= 0.01
    leg 2    0.49 <= x <= 0.51,   0.01 <= y <= 0.3        and -0.01 <= z <= 0.01 throughout (metres).

Run from the repository's root: ``python -m demo.l_frame.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, merge, write_model

LEG1 = 0.5  # m, along x, from the clamped face to the centre of the corner block
LEG2 = 0.3  # m, along y, from the centre of the corner block to the tip face
HALF = 0.01  # m, half the side of the square section
ELEMENTS_LEG1 = 28  # 17.5 mm long
ELEMENTS_LEG2 = 16  # 18.1 mm long

MODEL_FILE = Path(__file__).with_name("l_frame.inp")

HEADING = [
    "Steel L-frame, section 0.02 m x 0.02 m, C3D20R, 2 x 2 elements over the section. SI units.",
    "Centre line: (0,0,0) clamped - (0.5,0,0) centre of the cubic corner block - (0.5,0.3,0) tip face.",
    "Node sets: ROOT (x = 0, to be clamped), TIP (y = 0.3); LEG1A, LEG1B (halves of leg 1), LEG2 (corner",
    "block and leg 2), LEG2A, LEG2B (corner block and first half of leg 2; its second half). Neighbours",
    "share the nodes of their common section. The body is LEG1A, LEG1B, LEG2 (or LEG2A, LEG2B).",
]


def build() -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    across = np.array([-HALF, 0.0, HALF])
    mesh = merge(
        box_mesh(np.linspace(0.0, LEG1 - HALF, ELEMENTS_LEG1 + 1), across, across),
        box_mesh(LEG1 + across, across, across),
        box_mesh(LEG1 + across, np.linspace(HALF, LEG2, ELEMENTS_LEG2 + 1), across),
    )
    x, y = mesh.centres()[:, :2].T
    in_leg1 = x < LEG1 - HALF
    first_of_leg1 = x < (LEG1 - HALF) / 2
    first_of_leg2 = y < (LEG2 + HALF) / 2
    sets = {
        "ROOT": mesh.nodes_where(np.isclose(mesh.points[:, 0], 0.0)),
        "TIP": mesh.nodes_where(np.isclose(mesh.points[:, 1], LEG2)),
        "LEG1A": mesh.nodes_of_bricks(in_leg1 & first_of_leg1),
        "LEG1B": mesh.nodes_of_bricks(in_leg1 & ~first_of_leg1),
        "LEG2": mesh.nodes_of_bricks(~in_leg1),
        "LEG2A": mesh.nodes_of_bricks(~in_leg1 & first_of_leg2),
        "LEG2B": mesh.nodes_of_bricks(~in_leg1 & ~first_of_leg2),
    }
    return mesh, sets


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
