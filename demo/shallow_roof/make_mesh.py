"""Mesh of the shallow roof: writes `shallow_roof.inp` beside this file.

A cylindrical shell over the x-y plane, its axis along y, clamped at its two straight edges, loaded at its crown.

Run from the repository's root: ``python -m demo.shallow_roof.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, write_model

SPAN = 0.3  # m, along x
RISE = 0.012  # m, of the mid-surface
LENGTH = 0.2  # m, along y, centred
THICKNESS = 0.003  # m, along the radius
ELEMENTS = (20, 12)  # along the arc, along y

RADIUS = (SPAN**2 / 4 + RISE**2) / (2 * RISE)  # m, of the mid-surface
HALF_ANGLE = np.arcsin(SPAN / (2 * RADIUS))  # rad, from the crown to an edge

MODEL_FILE = Path(__file__).with_name("shallow_roof.inp")

HEADING = [
    "Shallow cylindrical steel roof to be clamped at its straight edges, span 0.3 m, rise 0.012 m, length 0.2 m,",
    "thickness 0.003 m, C3D20R 20 x 12 x 1. SI units. Crown along the y axis.",
    "Node sets: ROOT and FAR (edges), to be clamped; CROWN (section x = 0, the middle two elements along y).",
]


def build() -> tuple[BrickMesh, dict[str, np.ndarray]]:
    """Return the mesh and its node sets (indices counted from 0)."""
    arc = np.linspace(-HALF_ANGLE, HALF_ANGLE, ELEMENTS[0] + 1)
    along = np.linspace(-LENGTH / 2, LENGTH / 2, ELEMENTS[1] + 1)
    flat = box_mesh(arc, along, np.array([-THICKNESS / 2, THICKNESS / 2]))
    angle, y, outward = flat.points.T
    points = [(RADIUS + outward) * np.sin(angle), y, (RADIUS + outward) * np.cos(angle) - RADIUS]
    mesh = BrickMesh(points=np.stack(points, axis=1), bricks=flat.bricks)
    small = 1e-6
    middle = np.isclose(angle, 0.0) & (np.abs(y) <= along[1] - along[0] + small)
    sets = {
        "ROOT": mesh.nodes_where(np.isclose(angle, -HALF_ANGLE)),
        "FAR": mesh.nodes_where(np.isclose(angle, HALF_ANGLE)),
        "CROWN": mesh.nodes_where(middle),
    }
    return mesh, sets


def main() -> None:
    """Write the model deck."""
    mesh, sets = build()
    write_model(MODEL_FILE, mesh, sets, STEEL, HEADING)
    print(f"{MODEL_FILE}: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
