"""Thin bodies of shells that bend far, and what CalculiX says of them with S8R, NLGEOM.

``python tests/reference/shell_bodies.py`` with ``ccx`` on the PATH writes the results anew.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "calculix"
MODULUS, POISSON, DENSITY = 2.1e11, 0.3, 7850.0


def flat(origin, along, across):
    """A patch from a corner, by its sides."""
    return lambda a, b: np.array(origin) + a * np.array(along) + b * np.array(across)


def tube(radius, length):
    """Half of a tube along x: its two halves are patches."""
    return [
        lambda a, b, s=s: np.array([length * a, radius * np.cos(np.pi * (b + s)), radius * np.sin(np.pi * (b + s))])
        for s in (0.0, 1.0)
    ]


# Patches with their elements along and across (of S4; S8R takes half), thickness, and the force at the far end, N.
BODIES = {
    "strip": ([(flat((0, 0, 0), (1, 0, 0), (0, 0.1, 0)), 48, 4)], 0.005, (0.0, 0.0, 185.0)),
    "channel": (
        [
            (flat((0, 0, 0), (0.6, 0, 0), (0, 0.06, 0)), 24, 4),
            (flat((0, 0, 0), (0.6, 0, 0), (0, 0, 0.04)), 24, 4),
            (flat((0, 0.06, 0), (0.6, 0, 0), (0, 0, 0.04)), 24, 4),
        ],
        0.002,
        (0.0, 0.0, -2700.0),
    ),
    "tee": (
        [
            (flat((0, 0, 0), (0.5, 0, 0), (0, 0.04, 0)), 20, 2),
            (flat((0, 0.04, 0), (0.5, 0, 0), (0, 0.04, 0)), 20, 2),
            (flat((0, 0.04, 0), (0.5, 0, 0), (0, 0, 0.02)), 20, 2),
        ],
        0.003,
        (0.0, 600.0, 1800.0),
    ),
    "laminate": ([(flat((0, 0, 0), (1, 0, 0), (0, 0.06, 0.08)), 48, 4)], 0.005, (0.0, 0.0, 55.0)),
    "tube": ([(half, 32, 24) for half in tube(0.03, 0.8)], 0.0015, (0.0, 0.0, 10000.0)),
}

# Angles of layers of the same thickness, degrees, and their constants in place of the isotropic ones.
LAYERS = {"laminate": (0.0, 45.0, 90.0, -30.0)}
PLY = """*MATERIAL, NAME=PLY
*ELASTIC, TYPE=ENGINEERING CONSTANTS
140.E9, 10.E9, 10.E9, 0.3, 0.3, 0.4, 5.E9, 5.E9
3.5E9
*DENSITY
1600."""


class Middle:
    """Nodes and elements of a middle surface, of S3 and S4 or, quadratic, of S8R."""

    def __init__(self, name, kind="S4"):
        patches, self.thickness, self.force = BODIES[name]
        self.layers = LAYERS.get(name, ())
        self.kind, self.points, self.cells, known = kind, [], [], {}

        def node(place):
            key = tuple(np.round(place * 1e7).astype(int).tolist())
            if key not in known:
                known[key] = len(self.points)
                self.points.append(place)
            return known[key]

        for place, along, across in patches:
            n, m = (along // 2, across // 2) if kind == "S8R" else (along, across)
            for i in range(n):
                for j in range(m):
                    steps = [(0, 0), (1, 0), (1, 1), (0, 1)]
                    steps += [(0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5)] if kind == "S8R" else []
                    row = [node(place((i + a) / n, (j + b) / m)) for a, b in steps]
                    self.cells += [[row[0], row[1], row[2]], [row[0], row[2], row[3]]] if kind == "S3" else [row]
        self.points = np.array(self.points)
        low, high = self.points[:, 0].min(), self.points[:, 0].max()
        self.root = np.flatnonzero(self.points[:, 0] < low + 1e-9)
        self.tip = np.flatnonzero(self.points[:, 0] > high - 1e-9)

    def shares(self):
        """Weights of the tip's nodes in a mean along its edge."""
        total = np.zeros(len(self.points))
        for row in self.cells:
            corners = row[:4] if self.kind == "S8R" else row
            for k, first in enumerate(corners):
                second = corners[(k + 1) % len(corners)]
                if first in self.tip and second in self.tip:
                    length = np.linalg.norm(self.points[first] - self.points[second])
                    if self.kind == "S8R":
                        total[[first, second]] += length / 6.0
                        total[row[4 + k]] += length * 4.0 / 6.0
                    else:
                        total[[first, second]] += length / 2.0
        return total / total.sum()

    def deck(self):
        """Deck with the sets ROOT, clamped, and TIP."""
        lines = ["*NODE, NSET=ALL"]
        lines += [f"{k}, {x:.10g}, {y:.10g}, {z:.10g}" for k, (x, y, z) in enumerate(self.points, start=1)]
        lines += [f"*ELEMENT, TYPE={self.kind}, ELSET=SHELL"]
        lines += [f"{k}, " + ", ".join(str(n + 1) for n in row) for k, row in enumerate(self.cells, start=1)]
        for name, rows in (("ROOT", self.root), ("TIP", self.tip)):
            lines += [f"*NSET, NSET={name}", *(f"{row + 1}," for row in rows)]
        if self.layers:
            # Directions in the plane of the first patch, 0.6 and 0.8 being the sides of its unit across.
            for angle in self.layers:
                a, b = np.cos(np.radians(angle)), np.sin(np.radians(angle))
                lines += [f"*ORIENTATION, NAME=AT{angle:g}"]
                lines += [f"{a:.12f}, {0.6 * b:.12f}, {0.8 * b:.12f}, {-b:.12f}, {0.6 * a:.12f}, {0.8 * a:.12f}"]
            lines += [PLY, "*SHELL SECTION, ELSET=SHELL, COMPOSITE"]
            lines += [f"{self.thickness / len(self.layers)}, , PLY, AT{angle:g}" for angle in self.layers]
        else:
            lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{MODULUS}, {POISSON}", "*DENSITY", f"{DENSITY}"]
            lines += ["*SHELL SECTION, ELSET=SHELL, MATERIAL=STEEL", f"{self.thickness}"]
        lines += ["*BOUNDARY", "ROOT, 1, 6"]
        return "\n".join(lines) + "\n"


def results(name):
    """Mean displacement (3,) of the tip under the body's force, bent far and linear; six natural frequencies, Hz."""
    middle = Middle(name, "S8R")
    shares = middle.shares()
    loads = "*CLOAD\n" + "".join(
        f"{n + 1}, {axis + 1}, {float(force * shares[n])!r}\n"
        for n in np.flatnonzero(shares)
        for axis, force in enumerate(middle.force)
        if force
    )
    asked = f"*NODE FILE, OUTPUT={'3D' if middle.layers else '2D'}\nU\n*END STEP\n"
    static = f"*STEP\n*STATIC\n{loads}{asked}"
    steps = {"far": f"*STEP, NLGEOM, INC=500\n*STATIC\n0.1, 1.\n{loads}{asked}", "linear": static}
    steps["modes"] = "*STEP\n*FREQUENCY\n6\n*END STEP\n"
    moved = []
    with tempfile.TemporaryDirectory() as folder:
        for job, step in steps.items():
            (Path(folder) / f"{job}.inp").write_text(middle.deck() + step)
            subprocess.run(["ccx", job], cwd=folder, check=False, capture_output=True)
            if job != "modes":
                moved.append(shares @ displacements((Path(folder) / f"{job}.frd").read_text(), middle))
        rows = [line.split() for line in (Path(folder) / "modes.dat").read_text().splitlines()]
    return [*moved, [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()][:6]]


def displacements(text, middle):
    """Last displacements (n, 3) of a result file; of layers the mean across the thickness."""
    known = {"    2C": {}, " -4  DISP": {}}
    for line in text.splitlines():
        begun = next((head for head in known if line.startswith(head)), None)
        inside = begun or (inside if line[:3] in (" -1", " -5", " -4") and line[:8] != " -4  " else None)  # noqa: F821
        if inside and line.startswith(" -1"):
            known[inside][int(line[3:13])] = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)]
    places, moved = (np.array([known[head][label] for label in known[" -4  DISP"]]) for head in known)
    near = np.linalg.norm(middle.points[:, None] - places, axis=2) < 0.51 * middle.thickness
    return near @ moved / near.sum(axis=1, keepdims=True)


def main(names):
    """Write results of all bodies, or of some."""
    file = FOLDER / "shell_bodies.csv"
    rows = dict(line.split(",", 1) for line in file.read_text().splitlines()[1:]) if file.exists() else {}
    for name in names or BODIES:
        rows[name] = ",".join(f"{x:.7e}" for part in results(name) for x in part)
    heads = ["body", *("ux_m", "uy_m", "uz_m"), *("vx_m", "vy_m", "vz_m"), *(f"f{k}_hz" for k in range(1, 7))]
    file.write_text("\n".join([",".join(heads), *(f"{name},{rows[name]}" for name in BODIES if name in rows)]) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
