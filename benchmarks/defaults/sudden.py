"""Motion after a sudden load by the shortest body file, beside CalculiX's (undamped, from rest, two slow periods).

``python -m benchmarks.defaults.sudden [body ...]`` keeps ``sudden.csv``; others keep their rows. With ``--calculix`` it
runs `ccx` instead (some minutes a body) and keeps ``sudden_calculix.csv``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import fmpy
import numpy as np
from demo.calculix_results import read_displacements
from demo.calculix_tools import FORCE_TOLERANCE, find_ccx

from benchmarks.defaults.body import Body
from benchmarks.defaults.published import EVERY
from benchmarks.defaults.run_calculix import MOTION, motion, weights
from benchmarks.defaults.run_fmu import Built
from benchmarks.defaults.shapes import FloatArray
from benchmarks.records import numbers, read_records, write_records

RECORDS, RESULTS = (Path(__file__).with_name(name) for name in ("sudden.csv", "sudden_calculix.csv"))
# Case of each body, part of its load that acts suddenly, and the slowest period, s.
CASES = {
    "mast": ("aside", 0.5, 0.4286),
    "fork": ("one tine", 0.5, 0.01013),
    "parallelogram": ("aside", 0.5, 0.01574),
    "cranked_arm": ("z", 0.5, 0.01987),
    "hook": ("aside", 0.5, 0.00884),
    "sandwich": ("bent", 0.5, 0.01175),
    "leaf_spring": ("opposite", 0.5, 0.02256),
    "twisted_blade": ("both", 0.5, 0.03178),
    "coil_spring": ("pushed aside", 0.5, 0.00977),
    "chain_link": ("aside", 0.5, 0.003517),
    "ladder_frame": ("bent", 0.5, 0.0799),
    "cap": ("aslant", 0.4, 0.0002201),
    "twisted_cantilever": ("down", 0.5, 0.4799),
}
# What the FMU says of its own error, by column.
TOLD = {"estimate": "error", "truncation": "truncation", "softness": "softness_missed"}
# Steps of CalculiX a period, and how many of them lie between two that are kept.
STEPS, KEPT, PERIODS = 200, 5, 2


def deck(body: Body, case: str, share: float, period: float, weight: dict[str, FloatArray]) -> str:
    """Deck of a run: forces that jump at the start; a trace of numerical damping, without which thin bodies diverge."""
    lines = [f"*INCLUDE, INPUT={body.name}.inp", "*AMPLITUDE, NAME=SUDDEN", f"0., 1., {10 * period:g}, 1."]
    lines += ["*BOUNDARY", "HELD, 1, 3", *(f"GUIDE_{axis.upper()}, {'xyz'.index(axis) + 1}" for axis in body.guides)]
    lines += [f"*STEP, NLGEOM, INC={10 * PERIODS * STEPS}", "*DYNAMIC, ALPHA=-0.05, DIRECT"]
    lines += [f"{period / STEPS:.9g}, {PERIODS * period:.9g}", "*CONTROLS, PARAMETERS=FIELD", f"{FORCE_TOLERANCE:g}"]
    lines += ["*CLOAD, AMPLITUDE=SUDDEN"]
    for name, force in body.cases[case].items():
        nodal = weight[name].sum(axis=1) / weight[name].sum()
        lines += [
            f"{node + 1}, {axis + 1}, {share * size * part:.9e}"
            for axis, size in enumerate(force)
            for node, part in zip(body.sets[name.upper()], nodal, strict=True)
            if size
        ]
    for name in body.interfaces:
        lines += [f"*NODE PRINT, NSET={name.upper()}, FREQUENCY={KEPT}", "U"]
    return "\n".join([*lines, "*END STEP", ""])


def run(body: Body) -> list[dict[str, object]]:
    """CalculiX's motion, a row a time and interface."""
    case, share, period = CASES[body.name]
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top)
        body.write(folder)
        weight = weights(body, folder / f"{body.name}.inp")
        (folder / "run.inp").write_text(deck(body, case, share, period, weight), encoding="ascii")
        command = [find_ccx(), "-i", "run"]
        subprocess.run(command, cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, check=True)
        printed = (folder / "run.dat").read_text()
        for name in body.interfaces:
            times, displacements = read_displacements(printed, name)
            if len(times) != PERIODS * STEPS // KEPT:
                raise RuntimeError(f"{body.name}: CalculiX kept {len(times)} of {PERIODS * STEPS // KEPT} times")
            nodes = body.sets[name.upper()]
            for time, field in zip(times, displacements, strict=True):
                moved = motion(body.mesh.points[nodes], field, weight[name])
                columns = {key: f"{value:.7g}" for key, value in zip(MOTION, moved, strict=True)}
                rows.append({"body": body.name, "interface": name, "time": f"{time:.9g}", **columns})
    return [row | {"deck": body.digest(case)} for row in rows]


def measure(body: Body) -> list[dict[str, object]]:
    """Error of the FMU's motion: rms over time of the distance, over rms of the motion; the worst interface."""
    case, share, period = CASES[body.name]
    rows = [row for row in read_records(RESULTS) if row["body"] == body.name]
    if not rows or any(row["deck"] != body.digest(case) for row in rows):
        raise ValueError(f"{RESULTS.name} has {body.name} not, or with another mesh or load: run with --calculix")
    names = list(body.interfaces)
    log: list[str] = []
    with tempfile.TemporaryDirectory() as top, Built(body.write(Path(top))) as built:
        start = {
            f"{name}.force.{axis}": share * size
            for name, force in body.cases[case].items()
            for axis, size in zip("xyz", force, strict=True)
        }
        shown = [f"{name}.{what}.{axis}" for name in names for what in ("displacement", "rotation") for axis in "xyz"]
        found = fmpy.simulate_fmu(
            str(Path(top) / f"{body.name}.fmu"),
            stop_time=PERIODS * period,
            output_interval=period * KEPT / STEPS / 2,
            start_values=start,
            output=[*shown, *(f"diagnostics.{word}" for word in TOLD.values())],
            logger=lambda *words: log.append(words[-1].decode() if isinstance(words[-1], bytes) else str(words[-1])),
        )
        own = np.stack([found[name] for name in shown], axis=1)[2::2].reshape(-1, len(names), 6)
        told = {key: f"{found[f'diagnostics.{word}'].max():.3g}" for key, word in TOLD.items()}
    expected = np.stack([[numbers([r for r in rows if r["interface"] == n], c) for c in MOTION] for n in names])
    expected = expected.transpose(2, 0, 1)
    whole = len(own) == len(expected)
    own, count = own[: len(expected)], min(len(own), len(expected))
    off = [np.sqrt(((own - expected[:count])[..., part] ** 2).sum(-1).mean(0)) for part in (slice(3), slice(3, 6))]
    size = [np.sqrt((expected[..., part] ** 2).sum(-1).mean(0)).max() for part in (slice(3), slice(3, 6))]
    peak = np.linalg.norm(expected[..., :3], axis=-1).max() / float(np.ptp(body.mesh.points, axis=0).max())
    errors = {
        f"{key}_error": f"{o.max() / s:.3g}" for key, o, s in zip(("displacement", "rotation"), off, size, strict=True)
    }
    said = " | ".join(log)[:200] if whole else "refused: " + " | ".join(log)[:200]
    row: dict[str, object] = {"body": body.name, "case": case, "moved": f"{peak:.3g}", **errors}
    return [row | told | {"log": said, "build": f"{built.seconds:.3g}"}]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bodies named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("body", nargs="*", help=f"any of {', '.join(CASES)} (default: all)")
    parser.add_argument("--calculix", action="store_true", help="run ccx and keep its motions")
    chosen = parser.parse_args(arguments)
    known = {make.__name__: make for make in EVERY if make.__name__ in CASES}
    path, work = (RESULTS, run) if chosen.calculix else (RECORDS, measure)
    rows: dict[str, list[dict[str, object]]] = {}
    for row in read_records(path) if path.exists() else []:
        rows.setdefault(row["body"], []).append((dict.fromkeys(TOLD, "") if path == RECORDS else {}) | dict(row))
    for name in chosen.body or CASES:
        rows[name] = work(known[name]())
        print(*(f"{key} {value}" for key, value in rows[name][0].items()), sep=", ", flush=True)
        write_records(path, [row for key in CASES for row in rows.get(key, [])])
    return 0


if __name__ == "__main__":
    sys.exit(main())
