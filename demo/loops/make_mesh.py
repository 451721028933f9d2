"""Meshes of bodies whose supports close a loop: writes `portal.inp` and `ring.inp` beside this file.

- `portal`: two columns 0.5 m high and a beam between them, 0.6 m from axis to axis, section 0.02 m x 0.02 m;
  both feet are clamped. It lies in the x-z plane.
- `ring`: a circular ring, mean radius 0.25 m, section 0.02 m x 0.02 m, on two feet 40° to either side of its lowest
  point: patches of its outer surface, clamped. It lies in the x-z plane.

Run from the repository's root: ``python -m demo.loops.make_mesh``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, box_mesh, merge, write_model

HALF = 0.01  # m, half the side of the square section
HEIGHT = 0.5  # m, of the portal's columns, to the beam's axis
SPAN = 0.6  # m, between the columns' axes
RADIUS = 0.25  # m, of the ring's centre line
FOOT = 40.0  # degrees from the ring's lowest point
AROUND = 72  # elements of the ring, 5° each

HERE = Path(__file__).parent
Sets = dict[str, np.ndarray]


def portal() -> tuple[BrickMesh, Sets]:
    """The portal frame: feet FEET_LEFT, FEET_RIGHT; interface CORNER, the outer side of the left corner."""
    across = np.array([-HALF, 0.0, HALF])
    columns = [box_mesh(x + across, across, np.linspace(0.0, HEIGHT - HALF, 25)) for x in (0.0, SPAN)]
    corners = [box_mesh(x + across, across, HEIGHT + across) for x in (0.0, SPAN)]
    beam = box_mesh(np.linspace(HALF, SPAN - HALF, 30), across, HEIGHT + across)
    mesh = merge(columns[0], corners[0], beam, corners[1], columns[1])
    x, _, z = mesh.points.T
    foot = np.isclose(z, 0.0)
    return mesh, {
        "FOOT_LEFT": mesh.nodes_where(foot & (x < SPAN / 2)),
        "FOOT_RIGHT": mesh.nodes_where(foot & (x > SPAN / 2)),
        "CORNER": mesh.nodes_where(np.isclose(x, -HALF) & (z > HEIGHT - 1.01 * HALF)),
    }


def ring() -> tuple[BrickMesh, Sets]:
    """The ring: feet FOOT_LEFT, FOOT_RIGHT; interface TOP, the section at its highest point."""
    across = np.array([-HALF, 0.0, HALF])
    turns = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    # In two halves, so that the ends meet when nodes that coincide are made one.
    halves = [box_mesh(part, across, across) for part in (turns[: AROUND // 2 + 1], turns[AROUND // 2 :])]
    bent = []
    for half in halves:
        angle, outward, depth = half.points.T
        # From the lowest point, towards positive x.
        place = np.column_stack([(RADIUS + outward) * np.sin(angle), depth, -(RADIUS + outward) * np.cos(angle)])
        bent.append(BrickMesh(place, half.bricks))
    mesh = merge(*bent)
    x, _, z = mesh.points.T
    angle = np.degrees(np.arctan2(x, -z))
    outer = np.isclose(np.hypot(x, z), RADIUS + HALF)
    return mesh, {
        "FOOT_LEFT": mesh.nodes_where(outer & (np.abs(angle + FOOT) < 5.01)),
        "FOOT_RIGHT": mesh.nodes_where(outer & (np.abs(angle - FOOT) < 5.01)),
        "TOP": mesh.nodes_where(np.isclose(np.abs(x), 0.0, atol=1e-9) & (z > 0.0)),
    }


BODIES = {"portal": portal, "ring": ring}


def main() -> None:
    """Write both model decks."""
    for name, build in BODIES.items():
        mesh, sets = build()
        heading = [
            f"Steel {name}, C3D20R, 2 x 2 elements over the section. SI units.",
            f"Node sets: {', '.join(sets)}.",
        ]
        write_model(HERE / f"{name}.inp", mesh, sets, STEEL, heading)
        print(f"{name}.inp: {len(mesh.points)} nodes, {len(mesh.bricks)} elements")


if __name__ == "__main__":
    main()
