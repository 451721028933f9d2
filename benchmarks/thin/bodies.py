"""Thin bodies of shells and beams that bend far, and what CalculiX says of them with S8R or solids, NLGEOM.

``python -m benchmarks.thin.bodies [body ...]`` with ``ccx`` on the PATH writes the results anew; ``bent`` instead of
bodies: frequencies of two that are bent, for the mass of the deformed body.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from demo.calculix_results import read_displacements
from demo.mesh_tools import Material, box_mesh, merge, traction_weights, write_model

RESULTS, BENT = (Path(__file__).with_name(name) for name in ("calculix.csv", "bent.csv"))
_BENT = "*END STEP\n*STEP, PERTURBATION\n*FREQUENCY\n6\n*END STEP\n"
MODULUS, POISSON, DENSITY = 2.1e11, 0.3, 7850.0
STEEL = Material("STEEL", MODULUS, POISSON, DENSITY)


def flat(origin, along, across):
    """A patch from a corner, by its sides."""
    return lambda a, b: np.array(origin) + a * np.array(along) + b * np.array(across)


def tube(radius, length):
    """Half of a tube along x: its two halves are patches."""
    return [
        lambda a, b, s=s: np.array([length * a, radius * np.cos(np.pi * (b + s)), radius * np.sin(np.pi * (b + s))])
        for s in (0.0, 1.0)
    ]


def channel(length, width, depth):
    """A web and two flanges along x."""
    sides = [((0, 0, 0), (0, width, 0)), ((0, 0, 0), (0, 0, depth)), ((0, width, 0), (0, 0, depth))]
    return [(flat(origin, (length, 0, 0), across), 48, 4) for origin, across in sides]


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
    "long channel": (channel(1.2, 0.04, 0.02), 0.003, (0.0, 0.0, -1200.0)),
    "twisted channel": (channel(1.2, 0.04, 0.02), 0.003, (0.0, 1500.0, -750.0)),
    "long tee": (
        [
            (flat((0, 0, 0), (1, 0, 0), (0, 0.04, 0)), 40, 4),
            (flat((0, 0.04, 0), (1, 0, 0), (0, 0.04, 0)), 40, 4),
            (flat((0, 0.04, 0), (1, 0, 0), (0, 0, 0.02)), 40, 2),
        ],
        0.003,
        (0.0, 240.0, -1200.0),
    ),
    "long tube": ([(half, 64, 24) for half in tube(0.03, 2.0)], 0.0015, (0.0, 0.0, 5000.0)),
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
        text = _nodes(self.points) + _elements(self.kind, "SHELL", self.cells)
        lines = [text + _set("ROOT", self.root) + _set("TIP", self.tip).rstrip()]
        if self.layers:
            # Directions in the plane of the first patch, 0.6 and 0.8 being the sides of its unit across.
            for angle in self.layers:
                a, b = np.cos(np.radians(angle)), np.sin(np.radians(angle))
                lines += [f"*ORIENTATION, NAME=AT{angle:g}"]
                lines += [f"{a:.12f}, {0.6 * b:.12f}, {0.8 * b:.12f}, {-b:.12f}, {0.6 * a:.12f}, {0.8 * a:.12f}"]
            lines += [PLY, "*SHELL SECTION, ELSET=SHELL, COMPOSITE"]
            lines += [f"{self.thickness / len(self.layers)}, , PLY, AT{angle:g}" for angle in self.layers]
        else:
            lines += [_steel().rstrip(), "*SHELL SECTION, ELSET=SHELL, MATERIAL=STEEL", f"{self.thickness}"]
        lines += ["*BOUNDARY", "ROOT, 1, 6"]
        return "\n".join(lines) + "\n"


def results(name):
    """Mean displacement (3,) of the tip under the body's force, bent far and linear; six natural frequencies, Hz."""
    if name in BESIDE_SOLIDS:
        return BESIDE_SOLIDS[name].results()
    middle = Middle(name, "S8R")
    shares = middle.shares()
    asked = f"*NODE FILE, OUTPUT={'3D' if middle.layers else '2D'}\nU\n*END STEP\n"
    printed = run(middle.deck(), loads(np.flatnonzero(shares), shares[shares != 0.0], middle.force), asked, "frd")
    moved = [shares @ displacements(text, middle) for text in printed[:2]]
    return [*moved, frequencies(printed[2])]


def loads(nodes, shares, force):
    """Cards of a force spread over nodes."""
    return "*CLOAD\n" + "".join(
        f"{node + 1}, {axis + 1}, {float(size * share)!r}\n"
        for node, share in zip(nodes, shares, strict=True)
        for axis, size in enumerate(force)
        if size
    )


def run(deck, load, asked, suffix):
    """What CalculiX writes of a body bent far, of the linear one, and of its modes."""
    steps = {
        "far": f"*STEP, NLGEOM, INC=500\n*STATIC\n0.1, 1.\n{load}{asked}",
        "linear": f"*STEP\n*STATIC\n{load}{asked}",
    }
    steps["modes"] = "*STEP\n*FREQUENCY\n6\n*END STEP\n"
    with tempfile.TemporaryDirectory() as folder:
        for job, step in steps.items():
            (Path(folder) / f"{job}.inp").write_text(deck + step)
            subprocess.run(["ccx", job], cwd=folder, check=False, capture_output=True)
        return [(Path(folder) / f"{job}.{'dat' if job == 'modes' else suffix}").read_text() for job in steps]


def frequencies(text):
    """Six of them, Hz."""
    rows = [line.split() for line in text.splitlines()]
    return [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()][:6]


class BesideSolids:
    """A body whose reference is of solids: C3D20R.

    The mesh of solids, its root and tip as conditions on points (n, 3), the force, and the body's own deck.
    """

    def __init__(self, mesh, root, tip, force, deck):
        self.mesh, self.force, self.deck = mesh, force, deck
        self.root, self.tip = np.flatnonzero(root(mesh.points)), np.flatnonzero(tip(mesh.points))

    def solids(self):
        """Deck of the solids."""
        with tempfile.TemporaryDirectory() as folder:
            write_model(Path(folder) / "solid.inp", self.mesh, {"ROOT": self.root, "TIP": self.tip}, STEEL, [])
            return (Path(folder) / "solid.inp").read_text() + "*BOUNDARY\nROOT, 1, 3\n"

    def results(self):
        """As of shells."""
        # A section within has faces on both of its sides.
        shares = traction_weights(self.mesh, self.tip)
        asked = "*NODE PRINT, NSET=TIP\nU\n*END STEP\n"
        printed = run(self.solids(), loads(self.tip, shares, self.force), asked, "dat")
        return [*(shares @ read_displacements(one, "TIP")[1][-1] for one in printed[:2]), frequencies(printed[2])]


def block(inside=(-0.025, -0.0125)):
    """A plate, 400 × 60 × 5 mm, on the face of a clamped block; its shells reach one element into the block."""
    # Fine where the plate bends into the block: the clamp's own softness is a hundredth of the deflection.
    near = np.array([0.0, 0.00125, 0.0025, 0.005, 0.01, 0.02])
    wide, thin = np.linspace(-0.03, 0.03, 9), np.array([-0.0025, 0.0, 0.0025])
    up = np.array([0.00375, 0.005, 0.01, 0.02, 0.03])
    solid = merge(
        box_mesh(
            np.array([-0.1, -0.06, -0.035, *-near[::-1]]),
            np.array([-0.05, *wide, 0.05]),
            np.array([*-up[::-1], *thin, *up]),
        ),
        box_mesh(np.concatenate([near, np.linspace(0.03, 0.4, 38)]), wide, thin),
    )
    # The own deck: bricks of 12.5 mm in the block, shells on its middle plane.
    grid = box_mesh(np.linspace(-0.1, 0.0, 9), np.linspace(-0.05, 0.05, 11), np.linspace(-0.03, 0.03, 5))
    corners, bricks = np.unique(grid.bricks[:, :8], return_inverse=True)
    points, bricks = grid.points[corners], bricks.reshape(-1, 8)
    x, across = np.concatenate([inside, np.linspace(0.0, 0.4, 33)]), np.linspace(-0.03, 0.03, 7)
    plate = np.array([(a, b, 0.0) for a in x for b in across])
    key = {tuple(place): k for k, place in enumerate(np.rint(1e7 * points).astype(int).tolist())}
    number = []
    for place in plate:
        key.setdefault(tuple(np.rint(1e7 * place).astype(int).tolist()), len(key))
        number.append(key[tuple(np.rint(1e7 * place).astype(int).tolist())])
    points = np.array(list(key)) * 1e-7
    at = np.array(number).reshape(len(x), len(across))
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    text = _nodes(points) + _elements("C3D8I", "BLOCK", bricks) + _elements("S4", "PLATE", quads, len(bricks))
    text += _set("ROOT", np.flatnonzero(points[:, 0] < -0.1 + 1e-9)) + _set("TIP", at[-1]) + _steel()
    text += "*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n*SHELL SECTION, ELSET=PLATE, MATERIAL=STEEL\n0.005\n"
    return BesideSolids(
        solid,
        lambda p: np.isclose(p[:, 0], -0.1),
        lambda p: np.isclose(p[:, 0], 0.4),
        (0.0, 0.0, 850.0),
        text + "*BOUNDARY\nROOT, 1, 3\n",
    )


def portal():
    """A portal of three beams of 1 m, 6 mm in its plane and 12 mm across, pushed at a corner."""
    half = 0.003
    across, wide = np.array([-half, 0.0, half]), np.array([-0.006, 0.006])
    leg, top = np.linspace(0.0, 1.0 - half, 41), np.linspace(half, 1.0 - half, 41)
    solid = merge(
        *(box_mesh(across + x, wide, z) for x in (0.0, 1.0) for z in (leg, 1.0 + across)),
        box_mesh(top, wide, 1.0 + across),
    )
    up = np.linspace(0.0, 1.0, 21)
    line = [(0.0, 0.0, z) for z in up] + [(x, 0.0, 1.0) for x in up[1:]] + [(1.0, 0.0, z) for z in up[-2::-1]]
    count = len(line)
    pairs = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    text = _nodes(np.array(line)) + _elements("B31", "BARS", pairs) + _set("ROOT", [0, count - 1]) + _set("TIP", [20])
    text += _steel() + "*BEAM SECTION, ELSET=BARS, MATERIAL=STEEL, SECTION=RECT\n0.012, 0.006\n0., 1., 0.\n"
    return BesideSolids(
        solid,
        lambda p: np.isclose(p[:, 2], 0.0),
        lambda p: np.isclose(p[:, 0], 0.0) & (p[:, 2] > 1.0 - 1.01 * half),
        (210.0, 0.0, 0.0),
        text + "*BOUNDARY\nROOT, 1, 6\n",
    )


def _nodes(points):
    rows = [f"{k}, {x:.10g}, {y:.10g}, {z:.10g}" for k, (x, y, z) in enumerate(points, start=1)]
    return "\n".join(["*NODE, NSET=ALL", *rows]) + "\n"


def _elements(kind, name, rows, before=0):
    found = [f"{k}, " + ", ".join(str(n + 1) for n in row) for k, row in enumerate(rows, start=before + 1)]
    return "\n".join([f"*ELEMENT, TYPE={kind}, ELSET={name}", *found]) + "\n"


def _set(name, rows):
    return "\n".join([f"*NSET, NSET={name}", *(f"{row + 1}," for row in rows)]) + "\n"


def _steel():
    return f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{MODULUS}, {POISSON}\n*DENSITY\n{DENSITY}\n"


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


def bar():
    """A bar of 1 m × 20 mm × 20 mm, bent by a third of its length."""
    side = np.linspace(-0.01, 0.01, 3)
    line = np.array([(x, 0.0, 0.0) for x in np.linspace(0.0, 1.0, 17)])
    text = _nodes(line) + _elements("B31", "BARS", np.column_stack([np.arange(16), np.arange(1, 17)])) + _steel()
    text += _set("ROOT", [0]) + _set("TIP", [16])
    text += "*BEAM SECTION, ELSET=BARS, MATERIAL=STEEL, SECTION=RECT\n0.02, 0.02\n0., 1., 0.\n*BOUNDARY\nROOT, 1, 6\n"
    mesh = box_mesh(np.linspace(0.0, 1.0, 41), side, side)
    ends = [lambda p, x=x: np.isclose(p[:, 0], x) for x in (0.0, 1.0)]
    return BesideSolids(mesh, *ends, (0.0, 0.0, 2800.0), text)


def bent():
    """Write four frequencies of the strip and of the bar, bent by their forces; Hz."""
    middle, solid = Middle("strip", "S8R"), bar()
    shares = middle.shares()
    cards = loads(np.flatnonzero(shares), shares[shares != 0.0], middle.force)
    found = {"strip": frequencies(run(middle.deck(), cards, _BENT, "dat")[0])[:4]}
    cards = loads(solid.tip, traction_weights(solid.mesh, solid.tip), solid.force)
    found["bar"] = frequencies(run(solid.solids(), cards, _BENT, "dat")[0])[:4]
    rows = [f"{name},{','.join(f'{x:.7g}' for x in row)}" for name, row in found.items()]
    BENT.write_text("\n".join(["body,f1_hz,f2_hz,f3_hz,f4_hz", *rows]) + "\n")


BESIDE_SOLIDS = {"plate on a block": block(), "portal": portal()}


def main(names):
    """Write results of all bodies, or of some."""
    rows = dict(line.split(",", 1) for line in RESULTS.read_text().splitlines()[1:]) if RESULTS.exists() else {}
    every = [*BODIES, *BESIDE_SOLIDS]
    for name in names or every:
        rows[name] = ",".join(f"{x:.7e}" for part in results(name) for x in part)
    heads = ["body", *("ux_m", "uy_m", "uz_m"), *("vx_m", "vy_m", "vz_m"), *(f"f{k}_hz" for k in range(1, 7))]
    RESULTS.write_text("\n".join([",".join(heads), *(f"{name},{rows[name]}" for name in every if name in rows)]) + "\n")


if __name__ == "__main__":
    bent() if sys.argv[1:] == ["bent"] else main(sys.argv[1:])
