"""A clamped plate with a bore that is rigid, and what CalculiX says of it: RIGID BODY, NLGEOM.

``python tests/reference/rigid_bore.py`` with ``ccx`` on the PATH, writes the deck and the
results anew.
"""

import re
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "calculix"
# m; the bore's centre is its reference point.
LENGTH, WIDTH, THICKNESS, RADIUS = 0.3, 0.06, 0.004, 0.022
CENTRE = (0.25, 0.03, 0.002)
AROUND, ALONG, OUTWARD = 16, 12, 2
REFERENCE, ROTATION = 90001, 90002
LOADS = {
    "force": (0.0, 0.0, 300.0, 0.0, 0.0, 0.0),
    "moment": (0.0, 0.0, 0.0, 0.0, -60.0, 0.0),
    "twist": (0.0, 0.0, 0.0, 25.0, 0.0, 0.0),
    "in_plane": (0.0, 3000.0, 0.0, 0.0, 0.0, 150.0),
    "both": (0.0, 0.0, 160.0, 0.0, -20.0, 0.0),
    "all": (0.0, 500.0, 80.0, 15.0, -10.0, 30.0),
}
"""Force (N) and moment (N m) on the reference point."""
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


def _quads():
    """Quadrilaterals (q, 4, 2) of the plate's middle plane."""
    quarter = AROUND // 4
    across = np.linspace(0.0, WIDTH, quarter + 1)
    left, right = CENTRE[0] - WIDTH / 2.0, CENTRE[0] + WIDTH / 2.0

    def patch(xs, ys):
        g = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1)
        return np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], axis=2).reshape(-1, 4, 2)

    ring = np.concatenate(
        [
            np.stack([np.linspace(left, right, quarter + 1), np.zeros(quarter + 1)], axis=1)[:-1],
            np.stack([np.full(quarter + 1, right), across], axis=1)[:-1],
            np.stack([np.linspace(right, left, quarter + 1), np.full(quarter + 1, WIDTH)], axis=1)[:-1],
            np.stack([np.full(quarter + 1, left), across[::-1]], axis=1)[:-1],
        ]
    )
    arm = ring - CENTRE[:2]
    bore = CENTRE[:2] + RADIUS * arm / np.linalg.norm(arm, axis=1)[:, None]
    layers = [bore + (ring - bore) * k / OUTWARD for k in range(OUTWARD + 1)]
    around = [
        np.stack([inner, outer, np.roll(outer, -1, axis=0), np.roll(inner, -1, axis=0)], axis=1)
        for inner, outer in pairwise(layers)
    ]
    strip = [patch(np.linspace(0.0, left, ALONG + 1), across), patch(np.linspace(right, LENGTH, 3), across)]
    return np.concatenate([*around, *strip])


def mesh():
    """Points (n, 3), m, and 20-node bricks (e, 20) in CalculiX's order."""
    quads = _quads()
    flat = quads.reshape(-1, 2)
    low = np.column_stack([flat, np.zeros(len(flat))]).reshape(-1, 4, 3)
    corners = np.concatenate([low, low + np.array([0.0, 0.0, THICKNESS])], axis=1)
    nodes = np.concatenate([corners, np.stack([corners[:, list(e)].mean(axis=1) for e in _EDGES], axis=1)], axis=1)
    keys = np.round(nodes.reshape(-1, 3) * 1e8).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return nodes.reshape(-1, 3)[first], inverse.reshape(len(nodes), 20)


def deck():
    """The body: its bore is a rigid body."""
    points, bricks = mesh()
    away = np.hypot(points[:, 0] - CENTRE[0], points[:, 1] - CENTRE[1])
    # Mid-side nodes lie on chords.
    bore = np.flatnonzero(away < RADIUS * 1.0001)
    sets = {"ROOT": np.flatnonzero(points[:, 0] < 1e-9), "BORE": bore}
    lines = ["*NODE", *(f"{k}, {x:.10g}, {y:.10g}, {z:.10g}" for k, (x, y, z) in enumerate(points, start=1))]
    lines += [f"{node}, {CENTRE[0]}, {CENTRE[1]}, {CENTRE[2]}" for node in (REFERENCE, ROTATION)]
    lines += ["*ELEMENT, TYPE=C3D20, ELSET=PLATE"]
    for k, row in enumerate(bricks + 1, start=1):
        lines += [f"{k}, " + ", ".join(map(str, row[:10])) + ",", ", ".join(map(str, row[10:]))]
    for name, rows in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{row + 1}," for row in rows)]
    lines += [
        "*NSET, NSET=PIN",
        f"{REFERENCE}",
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        "2.1e11, 0.3",
        "*DENSITY",
        "7850.",
    ]
    lines += ["*SOLID SECTION, ELSET=PLATE, MATERIAL=STEEL"]
    lines += [f"*RIGID BODY, NSET=BORE, REF NODE={REFERENCE}, ROT NODE={ROTATION}", "*BOUNDARY", "ROOT, 1, 3"]
    return "\n".join(lines) + "\n"


def _run(step):
    with tempfile.TemporaryDirectory() as folder:
        text = f"*INCLUDE, INPUT={FOLDER / 'rigid_bore.inp'}\n" if len(str(FOLDER)) < 60 else deck()
        (Path(folder) / "job.inp").write_text(text + step)
        subprocess.run(["ccx", "job"], cwd=folder, check=False, capture_output=True)
        return (Path(folder) / "job.dat").read_text()


def static(load):
    """Displacement and rotation vector (6,) of the reference point under a load, with all of its nonlinearity."""
    forces = "".join(
        f"{REFERENCE if k < 3 else ROTATION}, {k % 3 + 1}, {value}\n" for k, value in enumerate(load) if value
    )
    printed = _run(
        "*NSET, NSET=ENDS\n90001, 90002\n*STEP, NLGEOM, INC=500\n*STATIC\n0.2, 1.\n*CONTROLS, PARAMETERS=FIELD\n1e-5,\n"
        f"*CLOAD\n{forces}*NODE PRINT, NSET=ENDS, FREQUENCY=1\nU\n*END STEP\n"
    )
    rows = {int(line.split()[0]): line.split()[1:] for line in printed.splitlines() if len(line.split()) == 4}
    return [float(x) for node in (REFERENCE, ROTATION) for x in rows[node]]


def frequencies(count):
    """First natural frequencies, Hz."""
    printed = _run(f"*STEP\n*FREQUENCY\n{count}\n*END STEP\n").split("PARTICIPATION")[0]
    return [float(line.split()[3]) for line in printed.splitlines() if re.match(r"\s+\d+(\s+\S+){4}\s*$", line)]


def main():
    """Write deck and results."""
    (FOLDER / "rigid_bore.inp").write_text(deck())
    names = ("ux_m", "uy_m", "uz_m", "rx_rad", "ry_rad", "rz_rad")
    rows = [",".join(("load", *names))]
    rows += [",".join((name, *(f"{x:.7e}" for x in static(load)))) for name, load in LOADS.items()]
    (FOLDER / "rigid_bore.csv").write_text("\n".join(rows) + "\n")
    found = ["frequency_Hz", *(f"{x:.7e}" for x in frequencies(6))]
    (FOLDER / "rigid_bore_frequencies.csv").write_text("\n".join(found) + "\n")


if __name__ == "__main__":
    main()
