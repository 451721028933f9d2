"""Frames of beams and bars as bulk data and decks, with the shortest body file, against solids and closed forms.

Run from the repository's root: python -m benchmarks.field.frames_of_beams. It writes ``frames_of_beams.csv``: the error
of the loaded node's displacement over what it is, the body's own estimate of it, and whether 1 % is told, right or
silent. References are CalculiX's results for the same bodies of solids (``calculix/``, ``demo/loops/calculix``), the
exact equations of hinged bars, and closed forms; none of them is from this package's beams.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve

import flexfmu
from flexfmu.files.basics import EquilibriumError

HERE = Path(__file__).parent
LOOPS = HERE.parents[1] / "demo" / "loops" / "calculix"
LIMIT = 0.01


@dataclass(frozen=True)
class Case:
    """A body as text, the node of its interface "load", and displacements there by force."""

    name: str
    reference: str
    text: str
    points: list[tuple[np.ndarray, np.ndarray]]
    supports: tuple[str, ...] = ("SPC 1",)
    load: str = "SET 1"
    suffix: str = ".bdf"


def of_solids(path: Path, axes: str, rows: tuple[int, ...]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Force and displacement of some rows of CalculiX's results."""
    lines = [line for line in path.read_text().splitlines() if line[:1] not in "#f" and "," in line]
    table = np.array([[float(one) for one in line.split(",")] for line in lines])
    found = []
    for row in rows:
        force = np.zeros(3)
        force[["xyz".index(axis) for axis in axes]] = table[row, : len(axes)]
        found.append((force, table[row, len(axes) : len(axes) + 3]))
    return found


def bulk(
    points: np.ndarray, pairs: list[tuple[int, int]], section: str, material: str, roots, tip, vector, more=""
) -> str:
    """Bulk data of CBAR between points."""
    text = "BEGIN BULK\n" + "".join(
        f"GRID,{k},,{x:.9f},{y:.9f},{z:.9f}\n" for k, (x, y, z) in enumerate(points.tolist(), 1)
    )
    text += "".join(f"CBAR,{k},1,{a + 1},{b + 1},{vector}\n" for k, (a, b) in enumerate(pairs, 1))
    held = "".join(f"SPC1,1,123456,{k + 1}\n" for k in roots)
    return f"{text}PBARL,1,1,,{section}\nMAT1,1,{material}\n{held}SET1,1,{tip + 1}\n{more}ENDDATA\n"


def chain(*corners, count=16) -> np.ndarray:
    """Points along legs."""
    legs = [np.linspace(a, b, count + 1)[1:] for a, b in pairwise(corners)]
    return np.concatenate([np.array(corners[:1], dtype=float), *legs])


def pairs_of(points: np.ndarray) -> list[tuple[int, int]]:
    """Along the points."""
    return [(k, k + 1) for k in range(len(points) - 1)]


def cases() -> Iterator[Case]:
    """All of them."""
    solid = HERE / "calculix"
    line = chain((0, 0, 0), (0.508, 0, 0), count=24)
    text = bulk(line, pairs_of(line), "BAR\n,3.2024e-3,12.3777e-3", "71.7e9,,.31,2810.", [0], 24, "0.,1.,0.")
    yield Case("Princeton beam", "solids", text, of_solids(solid / "princeton.csv", "yz", (1, 3, -1)))
    angle, inch = np.linspace(0.0, np.pi / 4.0, 25), 0.0254
    arc = 100.0 * inch * np.column_stack([1.0 - np.cos(angle), np.sin(angle), 0.0 * angle])
    steel = f"{1e7 * 4.4482216152605 / inch**2:.9g},,0.,7850."
    text = bulk(arc, pairs_of(arc), f"BAR\n,{inch},{inch}", steel, [0], 24, "0.,0.,1.")
    yield Case("Bend of 45 degrees", "solids", text, of_solids(solid / "bend.csv", "z", (2, 5, -1)))
    line = chain((0, 0, 0), (1, 0, 0), count=32)
    text = bulk(line, pairs_of(line), "BAR\n,.03,.01", "2.e11,,0.,7850.", [0], 32, "0.,1.,0.")
    yield Case("Strip", "solids", text, of_solids(solid / "strip.csv", "y", (2, 8, -1)))
    legs = chain((0, 0, 0), (0, 1.2, 0), (1.2, 1.2, 0), count=20)
    yield Case("Lee's frame", "solids", lee(legs), of_solids(solid / "lee.csv", "y", (1, 4, 8)), (), "LOAD", ".inp")
    portal = chain((0, 0, 0), (0, 0, 0.5), (0.6, 0, 0.5), (0.6, 0, 0))
    text = bulk(portal, pairs_of(portal), "BAR\n,.02,.02", "2.1e11,,.3,7850.", [0, 48], 16, "0.,1.,0.")
    yield Case("Portal", "solids", text, of_solids(LOOPS / "portal.csv", "x", (2, 5, -1)))
    yield offset_bar()
    yield tower()
    yield mast()
    yield grid()
    yield lumped()


def lee(points: np.ndarray) -> str:
    """A deck, as bulk data cannot hold hinges without holding turns."""
    text = "*NODE\n" + "".join(f"{k}, {x!r}, {y!r}, {z!r}\n" for k, (x, y, z) in enumerate(points.tolist(), 1))
    text += "*ELEMENT, TYPE=B31, ELSET=B\n" + "".join(f"{k}, {k}, {k + 1}\n" for k in range(1, len(points)))
    text += f"*NSET, NSET=LOAD\n25\n*NSET, NSET=ENDS\n1, {len(points)}\n*MATERIAL, NAME=S\n*ELASTIC\n72e9, .3\n"
    return (
        text
        + "*DENSITY\n2700\n*BEAM SECTION, ELSET=B, MATERIAL=S, SECTION=RECT\n.02, .12\n1, 1, 0\n*BOUNDARY\nENDS, 1, 5\n"
    )


def offset_bar() -> Case:
    """A bar 0.02 beside its grid points, pulled: the tip rises by e (1 − 1 / cosh kL), as of a beam-column."""
    away, length, modulus = 0.02, 1.0, 2e11
    line = chain((0, 0, 0), (length, 0, 0))
    text = bulk(
        line,
        pairs_of(line),
        "BAR\n,.01,.01",
        f"{modulus},,.3,7850.",
        [0],
        16,
        f"0.,1.,0.,GGG\n,,,0.,{away},0.,0.,{away},0.",
    )
    found = []
    for force in (100.0, 1000.0, 4000.0):
        k = np.sqrt(force / (modulus * 0.01**4 / 12.0))
        slope = away * k * np.tanh(k * length)
        v = away * (1.0 - 1.0 / np.cosh(k * length))
        # Shortening by bending, stretch, and the arm that turns.
        x = np.linspace(0.0, length, 2001)
        along = away * k * np.sinh(k * x) / np.cosh(k * length)
        drawn = -0.5 * np.trapezoid(along**2, x) + force * length / (modulus * 1e-4)
        found.append(
            (
                np.array([force, 0.0, 0.0]),
                np.array([drawn + away * np.sin(slope), v + away * (1.0 - np.cos(slope)), 0.0]),
            )
        )
    return Case("Bar with offsets, pulled", "beam-column", text, found)


def bars(points: np.ndarray, pairs: list[tuple[int, int]], area: float, fixed: list[int], force: np.ndarray, node: int):
    """Displacement of a node of hinged bars, exactly."""
    modulus, free = 2.1e11, [k for k in range(len(points)) if k not in fixed]

    def rest(moved: np.ndarray) -> np.ndarray:
        place = points.copy()
        place[free] += moved.reshape(-1, 3)
        out = np.zeros_like(points)
        out[node] += force
        for a, b in pairs:
            own, was = place[b] - place[a], np.linalg.norm(points[b] - points[a])
            pull = modulus * area * 0.5 * (own @ own / was**2 - 1.0) / was * own
            out[a] += pull
            out[b] -= pull
        return out[free].ravel() / np.linalg.norm(force)

    return fsolve(rest, np.zeros(3 * len(free))).reshape(-1, 3)[free.index(node)]


def rods(points, pairs, area, fixed, node, extra="") -> str:
    """Bulk data of CROD."""
    text = "BEGIN BULK\n" + "".join(
        f"GRID,{k},,{x:.9f},{y:.9f},{z:.9f}\n" for k, (x, y, z) in enumerate(points.tolist(), 1)
    )
    text += "".join(f"CROD,{k},1,{a + 1},{b + 1}\n" for k, (a, b) in enumerate(pairs, 1))
    held = "".join(f"SPC1,1,123,{k + 1}\n" for k in fixed)
    return f"{text}PROD,1,1,{area}\nMAT1,1,2.1e11,,.3,7850.\n{held}SET1,1,{node + 1}\n{extra}ENDDATA\n"


def tower() -> Case:
    """A slender tower of eight bays of hinged bars."""
    corners = 0.1 * np.array([(1, 0), (-0.5, 0.75**0.5), (-0.5, -(0.75**0.5))])
    points = np.array([(*corners[j], 0.3 * i) for i in range(9) for j in range(3)])
    pairs = []
    for i in range(8):
        for j in range(3):
            k = (j + 1) % 3
            pairs += [(3 * i + j, 3 * i + 3 + j), (3 * i + j, 3 * i + 3 + k), (3 * i + 3 + j, 3 * i + 3 + k)]
    fixed = [0, 1, 2]
    forces = [np.array([s, 0.3 * s, 0.0]) for s in (200.0, 1000.0, 3000.0)]
    text = rods(points, pairs, 2e-5, fixed, 24)
    found = [(force, bars(points, pairs, 2e-5, fixed, force, 24)) for force in forces]
    return Case("Tower of hinged bars", "bars, exact", text, found)


def mast() -> Case:
    """A mast of one bar on three guys: as stiff as four bars whose lower ends are held."""
    feet = [(0.6 * np.cos(a), 0.6 * np.sin(a), 0.0) for a in 2.0 * np.pi / 3.0 * np.arange(3)]
    points = np.array([(0.0, 0.0, 0.0), *feet, (0.0, 0.0, 1.0)])
    pairs = [(k, 4) for k in range(4)]
    forces = [np.array([s, 0.0, -s]) for s in (1e3, 5e3, 2e4)]
    text = rods(points, pairs, 1e-4, [0, 1, 2, 3], 4)
    found = [(force, bars(points, pairs, 1e-4, [0, 1, 2, 3], force, 4)) for force in forces]
    return Case("Mast on guys", "bars, exact", text, found)


def grid() -> Case:
    """Two crossing cantilevers of I section joined at their tips by offsets: halves of one load, small deflections."""
    one = chain((0, 0, 0), (1, 0, 0), count=8)
    points = np.concatenate([one, [(1.0, 1.0, 0.0)], chain((1, 1, 0), (1, 0, 0), count=8)[1:-1]])
    pairs = [(k, k + 1) for k in range(8)] + [(9, 10), *((k, k + 1) for k in range(10, 16)), (16, 8)]
    text = bulk(points, pairs, "TUBE\n,.02,.018", "2.1e11,,.3,7850.", [0, 9], 8, "0.,0.,1.")
    # Symmetric: each carries half, and its tip turns as the other twists: S = 2 (M + T balance), by hand.
    inertia = np.pi / 4.0 * (0.02**4 - 0.018**4)
    bend, twist, area = 2.1e11 * inertia, 2.1e11 / 2.6 * 2.0 * inertia, np.pi * (0.02**2 - 0.018**2)
    force = 20.0
    # Tip of one under F/2 down and moment m against its slope; the other twists by this slope.
    slope = (0.5 * force / (2.0 * bend)) / (1.0 + twist / bend)
    sinks = 0.5 * force / (3.0 * bend) - twist * slope / (2.0 * bend) + 0.5 * force / (2.1e11 / 2.6 * 0.53 * area)
    return Case(
        "Grid of two tubes", "closed form", text, [(np.array([0.0, 0.0, -force]), np.array([0.0, 0.0, -sinks]))]
    )


def lumped() -> Case:
    """A bar with a mass at its tip, on an arm: the tip sinks as without, its frequency is in the table below."""
    line = chain((0, 0, 0), (0.5, 0, 0))
    text = bulk(line, pairs_of(line), "TUBE\n,.01,.008", "2.1e11,,.3,7850.", [0], 16, "0.,1.,0.", "CONM2,90,17,,5.\n")
    inertia, force = np.pi / 4.0 * (0.01**4 - 0.008**4), 50.0
    area = np.pi * (0.01**2 - 0.008**2)
    sinks = force * 0.125 / (3.0 * 2.1e11 * inertia) + force * 0.5 / (2.1e11 / 2.6 * 0.53 * area)
    return Case(
        "Bar with a mass at its tip", "closed form", text, [(np.array([0.0, force, 0.0]), np.array([0.0, sinks, 0.0]))]
    )


def measured(case: Case) -> Iterator[tuple]:
    """Rows of the table."""
    with tempfile.TemporaryDirectory() as top:
        path = Path(top) / f"body{case.suffix}"
        path.write_text(case.text)
        body = flexfmu.Body(
            flexfmu.read_mesh(path),
            supports=[flexfmu.Support(name) for name in case.supports],
            interfaces={"load": flexfmu.Interface(case.load)},
        ).build(surface=False)
    for force, expected in case.points:
        loads = {"load": [*force, 0.0, 0.0, 0.0]}
        size = np.linalg.norm(expected)
        try:
            state = body.static(loads)
        except EquilibriumError as refusal:
            yield case.name, case.reference, np.linalg.norm(force), size, "", "", f"refused: {str(refusal)[:40]}"
            continue
        error = np.linalg.norm(body.response(state).displacement[0] - expected) / size
        own = body.error(state, loads).relative
        word = "right" if error <= LIMIT else "told" if own > LIMIT else "silent"
        yield case.name, case.reference, np.linalg.norm(force), size, error, own, word


def main() -> None:
    """Measure all."""
    with (HERE / "frames_of_beams.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["body", "reference", "force_N", "displacement_m", "error", "own_estimate", "word"])
        for case in cases():
            for row in measured(case):
                row = [f"{one:.4g}" if isinstance(one, float) else one for one in row]
                table.writerow(row)
                print(*row, sep=" | ", flush=True)


if __name__ == "__main__":
    main()
