"""Mesh of the shallow arch: writes `shallow_arch.inp` beside this file.

The centre line is an arc of a circle in the x-y plane from (0, 0) over the crown (0.5, 0.045) to (1, 0); sections
are at right angles to it, so the clamped end faces lean.

Run from the repository's root: ``python -m demo.shallow_arch.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

SPAN = 1.0  # m, along x
RISE = 0.045  # m, of the centre line
HEIGHT = 0.02  # m, of the section, along the radius
WIDTH = 0.04  # m, of the section, along z: wide enough that the arch does not buckle sideways before it snaps
ELEMENTS = (40, 2, 2)  # along the arc, along the radius, along z

RADIUS = (SPAN**2 / 4 + RISE**2) / (2 * RISE)  # m, of the centre line
HALF_ANGLE = np.arcsin(SPAN / (2 * RADIUS))  # rad, from the crown to an end

MODEL_FILE = Path(__file__).with_name("shallow_arch.inp")

HEADING = [
    "Shallow circular steel arch to be clamped at both ends, span 1 m, rise 0.045 m, section 0.02 m high and",
    "0.04 m wide, C3D20R 40 x 2 x 2. SI units. Centre line from (0,0,0) over the crown (0.5,0.045,0) to (1,0,0).",
    "Node sets: ROOT (end at x = 0) and FAR (end at x = 1), to be clamped, CROWN (section x = 0.5).",
]


def build() -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    straight = box_mesh(
        np.linspace(-HALF_ANGLE, HALF_ANGLE, ELEMENTS[0] + 1),
        np.linspace(-HEIGHT / 2, HEIGHT / 2, ELEMENTS[1] + 1),
        np.linspace(-WIDTH / 2, WIDTH / 2, ELEMENTS[2] + 1),
    )
    angle, outward, z = straight.points.T
    x = SPAN / 2 + (RADIUS + outward) * np.sin(angle)
    y = (RADIUS + outward) * np.cos(angle) - RADIUS * np.cos(HALF_ANGLE)
    mesh = BrickMesh(points=np.stack([x, y, z], axis=1), bricks=straight.bricks)
    sections = {"ROOT": -HALF_ANGLE, "FAR": HALF_ANGLE, "CROWN": 0.0}
    return mesh, {name: mesh.nodes_where(np.isclose(angle, position)) for name, position in sections.items()}


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
