"""Benchmarks of the field: published problems, our error and what a simulated second costs.

Run from the repository's root: python -m benchmarks.field [--output FILE.csv]. Prints the table of docs/benchmarks.md
and writes the records that it is made of. A problem is a function that returns its records; `PROBLEMS` lists them.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from flexfmu.body import FlexibleBody, State, StepLimits
from flexfmu.build import reduce_body
from flexfmu.config import BodyFile
from flexfmu.methods import Mass, Method
from flexfmu.model.reduced_body import ReducedBody
from flexfmu.progress import Reporter

HERE = Path(__file__).parent
SPIN_UP = "Spin-up of a beam"
TUMBLING = "Tumbling block"
FLUTTER = "Column under a follower force"
# Corners of a 20-node brick and the ends of its edges, in half cells.
_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]


@dataclass(frozen=True)
class Record:
    """One number of a problem.

    Attributes
    ----------
    problem, source : str
    quantity : str
    published : float
    ours : float
    error : float
        |ours − published| / |published|, or what the quantity says.
    cost : float
        s of computation per simulated second; 0 for statics.
    """

    problem: str
    source: str
    quantity: str
    published: float
    ours: float
    error: float
    cost: float


@dataclass(frozen=True)
class Section:
    """Square bar of 20-node bricks along x.

    Attributes
    ----------
    x, width : sequence of float
        m, at the ends of the cells.
    materials : sequence of (float, float, float)
        Young's modulus, Poisson's ratio, density.
    material : sequence of int
        Of each cell.
    """

    x: Sequence[float]
    width: Sequence[float]
    materials: Sequence[tuple[float, float, float]]
    material: Sequence[int]


def bar_deck(bar: Section, path: Path) -> Path:
    """Deck of a bar, two cells across y, with the sets HINGE (the line x = y = 0), ROOT (x = 0), TIP and BACK."""
    count = len(bar.material)
    cells = np.stack(np.meshgrid(range(count), range(2), [0], indexing="ij"), axis=-1).reshape(-1, 3)
    corners = 2 * cells[:, None] + np.array(_CORNERS)
    nodes = np.concatenate([corners, corners[:, _EDGES].sum(axis=2) // 2], axis=1)
    keys, connectivity = np.unique(nodes.reshape(-1, 3), axis=0, return_inverse=True)
    connectivity = connectivity.reshape(nodes.shape[:2]) + 1
    x, width = (np.interp(keys[:, 0] / 2.0, np.arange(count + 1), values) for values in (bar.x, bar.width))
    points = np.column_stack([x, (keys[:, 1] / 4.0 - 0.5) * width, (keys[:, 2] / 2.0 - 0.5) * width])
    small = 1e-9 * np.abs(points).max()
    sets = {
        "HINGE": np.hypot(points[:, 0], points[:, 1]) < small,
        "ROOT": np.abs(points[:, 0]) < small,
        "TIP": points[:, 0] > points[:, 0].max() - small,
        "BACK": points[:, 0] < points[:, 0].min() + small,
    }
    lines = ["*NODE", *(f"{n}, {a!r}, {b!r}, {c!r}" for n, (a, b, c) in enumerate(points.tolist(), start=1))]
    for index, (modulus, ratio, density) in enumerate(bar.materials):
        lines.append(f"*ELEMENT, TYPE=C3D20, ELSET=PART{index}")
        for label in np.flatnonzero(np.array(bar.material)[cells[:, 0]] == index):
            row = [str(label + 1), *map(str, connectivity[label])]
            lines += [", ".join(row[:11]) + ",", ", ".join(row[11:])]
        lines += [f"*MATERIAL, NAME=M{index}", "*ELASTIC", f"{modulus!r}, {ratio!r}", "*DENSITY", repr(density)]
        lines.append(f"*SOLID SECTION, ELSET=PART{index}, MATERIAL=M{index}")
    for name, chosen in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in np.flatnonzero(chosen) + 1)]
    path.write_text("\n".join(lines) + "\n")
    return path


def reduced(bar: Section, interfaces: Sequence[str], support: str | None, **tables: object) -> ReducedBody:
    """Reduced body of a bar, its supported nodes held in all directions."""
    with tempfile.TemporaryDirectory() as folder:
        content = {
            "name": "bar",
            "mesh": {"file": bar_deck(bar, Path(folder) / "bar.inp")},
            "support": [] if support is None else [{"nodes": support, "fix": ["x", "y", "z"]}],
            "interface": [{"name": name.lower(), "nodes": name} for name in interfaces],
            "damping": {"ratio": 0.0},
        }
        return reduce_body(BodyFile.model_validate(content | tables), Reporter())


def rotating_beam(cells: int = 16, modes: int = 24) -> ReducedBody:
    """The beam of Simo and Vu-Quoc on a hinge: EA 2.8e7 N, EI 1.4e4 N m², GA 1e7 N, ρA 1.2 kg/m, ρI 6e-4 kg m, 10 m.

    A square section has EI/EA = ρI/ρA = b²/12, which gives b, Young's modulus and density; 5/6 GA asks for
    Poisson's ratio 1/6. The hinge lies in the root's section. Behind it stands a stiff hub of 2000 times the beam's
    inertia, so that a moment turns the root as prescribed.
    """
    side = float(np.sqrt(12.0 * 1.4e4 / 2.8e7))
    area = side * side
    beam, hub = (2.8e7 / area, 1.0 / 6.0, 1.2 / area), (8.4e10 / area, 1.0 / 6.0, 9e4)
    x = [-2.0, -1.25, -0.5, -0.25, *np.linspace(0.0, 10.0, cells + 1).tolist()]
    width = [side * factor for factor in (25.0, 25.0, 25.0, 12.0, *np.ones(cells + 1))]
    bar = Section(x, width, [beam, hub], [1] * 4 + [0] * cells)
    reduction = {"modes": modes, "second_order": True, "inertia": True}
    return reduced(bar, ["ROOT", "TIP"], "HINGE", free=True, frames=1, reduction=reduction)


def spin_up(model: ReducedBody, mass: Mass, step: float = 0.02) -> tuple[dict[float, tuple[float, float]], float]:
    """Lag and stretch (m) of the tip in the root's axes at some times (s), and the cost of a simulated second.

    The root turns by ψ̈ = (6/15)(1 − cos 2πt/15) for 15 s, to 6 rad/s, and on.
    """
    body = FlexibleBody(model, Method.SECOND_ORDER, mass)
    inertia = 1.0 / float(model.frame_rotation[0][2, 0] ** 2)
    state, found, start = body.rest(), {}, time.perf_counter()
    for k in range(round(20.0 / step)):
        at = (k + 0.5) * step
        growth = 0.4 * (1.0 - np.cos(2.0 * np.pi * at / 15.0)) if at < 15.0 else 0.0
        state = body.step(state, {"root": [0.0, 0.0, 0.0, 0.0, 0.0, inertia * growth]}, step)
        response = body.response(state)
        angle, places = response.rotation[0, 2], model.interface_point + response.displacement
        arm = places[1] - places[0]
        own = np.cos(angle) * arm[:2] + np.sin(angle) * np.array([arm[1], -arm[0]])
        found[round((k + 1) * step, 6)] = (float(own[1]), float(own[0] - 10.0))
    return found, (time.perf_counter() - start) / 20.0


def rotating_beam_records() -> list[Record]:
    """Lag of the tip while it spins up beyond its first frequency, and the steady stretch."""
    model, records = rotating_beam(), []
    source = "Simo, Vu-Quoc, J. Appl. Mech. 53 (1986) 855"
    for mass in Mass:
        found, cost = spin_up(model, mass)
        for at, lag in ((5.0, -0.462), (7.5, -0.559), (10.0, -0.362), (12.5, -0.111)):
            ours = found[at][0]
            words = f"{mass.value} mass: lag at {at:g} s, m"
            records.append(Record(SPIN_UP, source, words, lag, ours, abs(ours / lag - 1.0), cost))
        stretch = float(np.mean([value[1] for at, value in found.items() if at > 15.0]))
        words = f"{mass.value} mass: steady stretch, m"
        records.append(Record(SPIN_UP, source, words, 5.13e-4, stretch, abs(stretch / 5.13e-4 - 1.0), cost))
    return records


def tumbling_records(turns: float = 50.0, step: float = 2e-3) -> list[Record]:
    """A free bar thrown about its middle axis: momentum, energy and attitude after many turns."""
    bar = Section(np.linspace(0.0, 0.3, 5).tolist(), [0.05] * 5, [(2e11, 0.3, 7850.0)], [0] * 4)
    model = reduced(
        bar, ["BACK", "TIP"], None, free=True, reduction={"modes": 6, "inertia": True, "second_order": True}
    )
    motion = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    v = np.zeros(model.mode_count)
    v[:6] = np.linalg.solve(motion, [0.5, -0.2, 0.1, 30.0, 40.0, 3.0])
    records = []
    for mass in Mass:
        body = FlexibleBody(model, Method.SECOND_ORDER, mass, limits=StepLimits(0.0, 1e300))
        state = State(np.zeros_like(v), v)

        def momentum(state: State, body: FlexibleBody = body) -> np.ndarray:
            # Of the root's displacement, and about the root on its own axes.
            linear, own = np.split(np.linalg.solve(motion.T, (body.mass(state) @ state.v)[:6]), 2)
            place, rotation = (motion @ state.q[:6])[:3], body.core.nodes_at(state.q)[1][0]
            return np.array([*linear, *(rotation @ own + np.cross(place, linear))])

        before, energy, start = momentum(state), sum(body.energies(state)), time.perf_counter()
        count = round(turns * 2.0 * np.pi / 50.0 / step)
        for _ in range(count):
            state = body.step(state, {}, step)
        cost = (time.perf_counter() - start) / (count * step)
        off = momentum(state) - before
        angular = float(np.linalg.norm(off[3:]) / np.linalg.norm(before[3:]))
        linear = float(np.linalg.norm(off[:3]) / np.linalg.norm(before[:3]))
        gained = sum(body.energies(state)) / energy - 1.0
        for words, error in (("momentum", linear), ("angular momentum", angular), ("energy", abs(gained))):
            text = f"{mass.value} mass: drift of {words} over {turns:g} turns"
            records.append(Record(TUMBLING, "conservation law", text, 0.0, error, error, cost))
    return records


def flutter_records() -> list[Record]:
    """Load at which a clamped column flutters under a force that follows its tip."""
    bar = Section(np.linspace(0.0, 1.0, 17).tolist(), [0.02] * 17, [(2e11, 0.0, 7850.0)], [0] * 16)
    bending, records = 2e11 * 0.02**4 / 12.0, []
    for method, frames in ((Method.SECOND_ORDER, 1), (Method.SECOND_ORDER, 2), (Method.FRAMES, 8)):
        model = reduced(bar, ["TIP"], "BACK", frames=frames, reduction={"modes": 12, "second_order": True})
        body = FlexibleBody(replace(model, following_interfaces=("tip",)), method, damping_scale=0.0)
        rest, low, high = body.rest(), 10.0, 30.0
        while high - low > 1e-4:
            load = 0.5 * (low + high)
            inputs = np.array([-load * bending, 0.0, 0.0, 0.0, 0.0, 0.0])
            low, high = (load, high) if body.stability(rest, inputs)[0] > 0.0 else (low, load)
        words = f"{method.label}, {frames} frame{'s' if frames > 1 else ''}: load, EI/L²"
        records.append(Record(FLUTTER, "Beck, ZAMP 3 (1952) 225", words, 20.05, low, abs(low / 20.05 - 1.0), 0.0))
    return records


PROBLEMS: tuple[Callable[[], list[Record]], ...] = (rotating_beam_records, tumbling_records, flutter_records)


def table(records: Sequence[Record]) -> str:
    """The records as a table of markdown."""
    lines = [
        "| problem (source) | quantity | published | ours | error | s per simulated s |",
        "|---|---|---|---|---|---|",
    ]
    for r in records:
        kept = r.published == 0.0
        shown = (
            ["0", f"{r.ours:.1e}", ""] if kept else [f"{r.published:.4g}", f"{r.ours:.4g}", f"{100.0 * r.error:.2g} %"]
        )
        cost = f"{r.cost:.2g}" if r.cost else ""
        lines.append(f"| {r.problem} ({r.source}) | {r.quantity} | {' | '.join(shown)} | {cost} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all problems, print the table and write the records."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--output", type=Path, default=HERE / "field.csv")
    chosen = parser.parse_args(arguments)
    records = [record for problem in PROBLEMS for record in problem()]
    print(table(records))
    with chosen.output.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(records[0])))
        writer.writeheader()
        writer.writerows(asdict(record) for record in records)
    return 0


if __name__ == "__main__":
    sys.exit(main())
