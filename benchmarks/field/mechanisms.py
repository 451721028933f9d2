"""Mechanisms by `flexfmu couple`: a double pendulum and a slider-crank, near-rigid and flexible.

References: rigid bodies integrated by SciPy, and Exudyn's geometrically exact beams (kept results).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.field.exudyn_results import kept
from benchmarks.field.motion import Rod, Section, reduced
from benchmarks.field.records import Record
from flexfmu.fmu.package import package_fmu

FloatArray = NDArray[np.float64]
PENDULUM, CRANK = "Double pendulum", "Slider-crank"
GRAVITY = 9.81
# Steel of 20 mm x 20 mm, and a soft bar of 1 kg/m, 40 mm x 40 mm, that its weight bends by a fifth of its length.
STIFF = Rod(1.0, 2e11 * 0.02**4 / 12.0, 2e11 * 0.02**2, 7850.0 * 0.02**2)
SOFT = Rod(1.0, 5.0, 12.0 * 5.0 / 0.04**2, 1.0)
RADIUS, TORQUE = 0.3, 2.0
HELD = 1e8  # N/m, of hinges


def link(rod: Rod, start: float, length: float, folder: Path, name: str, hinged: bool, cells: int = 10) -> Path:
    """FMU of a bar along x that begins at `start`; hinged there to the ground, or free."""
    bar = Section(
        np.linspace(start, start + length, cells + 1).tolist(), [rod.side] * (cells + 1), [rod.material], [0] * cells
    )
    ends = ["TIP"] if hinged else ["BACK", "TIP"]
    body = reduced(
        bar, ends, "HINGE" if hinged else None, free=True, frames=2, name=name,
        interface=[{"name": end.lower(), "nodes": end, "compliance": True} for end in ends],
        reduction={"modes": 16, "second_order": True, "inertia": True, "residual_flexibility": True},
        formulation={"method": "second_order", "mass": "configuration"},
        input={"acceleration": True}, output={"surface": False},
    )  # fmt: skip
    file = folder / f"{name}.fmu"
    package_fmu(body, file)
    return file


def coupled(folder: Path, text: str) -> Mapping[str, FloatArray]:
    """Results of a coupling file, by column."""
    (folder / "coupling.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "flexfmu", "--quiet", "couple", "coupling.toml", "--output", "motion.csv"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    with (folder / "motion.csv").open(encoding="utf-8") as file:
        names = [name.split(" [")[0] for name in file.readline().strip().split(",")]
        values = np.loadtxt(file, delimiter=",", comments="#")
    return dict(zip(names, values.T, strict=True))


def scheme(stop: float, step: float) -> str:
    """Head of a coupling file."""
    return f'[experiment]\nstop = {stop}\nstep = {step}\nscheme = "iterated"\nheld = "mean"\n'


def fmu(name: str, start: str) -> str:
    """An FMU of a coupling file."""
    return f'[[fmu]]\nname = "{name}"\nfile = "{name}.fmu"\nstart = {{ {start} }}\n'


def spring(ends: str, stiffness: tuple[float, ...]) -> str:
    """A spring of a coupling file."""
    return f"[[spring]]\n{ends}\nstiffness = {list(stiffness)}\n"


def pendulum(rod: Rod, stop: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Times (n,) and displacement (n, 4) of the hinge and the end of two bars that fall from the horizontal."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        link(rod, 0.0, 1.0, folder, "upper", hinged=True)
        link(rod, 1.0, 1.0, folder, "lower", hinged=False)
        weight = f'"body.acceleration.y" = {GRAVITY}'
        found = coupled(
            folder,
            scheme(stop, step) + fmu("upper", weight) + fmu("lower", weight)
            + spring('a = "lower.back"\nb = "upper.tip"', (HELD,) * 3 + (0.0,) * 3),
        )  # fmt: skip
    columns = [f"{end}.tip.displacement.{axis}" for end in ("upper", "lower") for axis in "xy"]
    return found["time"], np.stack([found[name] for name in columns], axis=1)


def rigid_pendulum(rod: Rod, times: FloatArray) -> FloatArray:
    """The same of rigid bars, (n, 4)."""
    mass, own = rod.mass, rod.mass * (1.0 + rod.side**2) / 12.0

    def rate(_: float, y: FloatArray) -> FloatArray:
        a, b, va, vb = y
        c, s = 0.5 * mass * np.cos(a - b), 0.5 * mass * np.sin(a - b)
        matrix = [[own + 1.25 * mass, c], [c, own + 0.25 * mass]]
        push = [-1.5 * mass * GRAVITY * np.cos(a) - s * vb**2, -0.5 * mass * GRAVITY * np.cos(b) + s * va**2]
        return np.array([va, vb, *np.linalg.solve(matrix, push)])

    a, b = solve_ivp(rate, (0.0, times[-1]), np.zeros(4), t_eval=times, rtol=1e-10, atol=1e-12).y[:2]
    x, y = np.cos(a), np.sin(a)
    return np.stack([x - 1.0, y, x + np.cos(b) - 2.0, y + np.sin(b)], axis=1)


def crank(rod: Rod, stop: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Times and displacement along x of a slider that a crank of 0.3 m moves by a rod of 1 m, (n, 1)."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        link(STIFF, 0.0, RADIUS, folder, "crank", hinged=True, cells=4)
        link(rod, RADIUS, 1.0, folder, "rod", hinged=False)
        found = coupled(
            folder,
            scheme(stop, step) + fmu("crank", f'"tip.moment.z" = {TORQUE}') + fmu("rod", "")
            + spring('a = "rod.back"\nb = "crank.tip"', (HELD,) * 3 + (0.0,) * 3)
            + spring('a = "rod.tip"', (0.0, HELD, HELD, 0.0, 0.0, 0.0)),
        )  # fmt: skip
    return found["time"], found["rod.tip.displacement.x"][:, None]


def rigid_crank(rod: Rod, times: FloatArray) -> FloatArray:
    """The same of rigid bars: from the work of the moment, ½ m(θ) θ̇² = M θ."""
    own = rod.mass * (1.0 + rod.side**2) / 12.0
    hinged = STIFF.mass * RADIUS * (RADIUS**2 / 3.0 + STIFF.side**2 / 12.0)

    def shape(angle: float) -> tuple[float, float]:
        sine = -RADIUS * np.sin(angle)
        cosine = np.sqrt(1.0 - sine**2)
        return float(np.arcsin(sine)), float(-RADIUS * np.cos(angle) / cosine)

    def mass(angle: float) -> float:
        tilt, turn = shape(angle)
        x = -RADIUS * np.sin(angle) - 0.5 * np.sin(tilt) * turn
        y = RADIUS * np.cos(angle) + 0.5 * np.cos(tilt) * turn
        return float(hinged + rod.mass * (x * x + y * y) + own * turn**2)

    def rate(_: float, state: FloatArray) -> FloatArray:
        angle, small = state[0], 1e-6
        slope = (mass(angle + small) - mass(angle - small)) / (2.0 * small)
        return np.array([state[1], (TORQUE - 0.5 * slope * state[1] ** 2) / mass(angle)])

    angle = solve_ivp(rate, (0.0, times[-1]), np.zeros(2), t_eval=times, rtol=1e-9, atol=1e-11).y[0]
    tilt = np.arcsin(-RADIUS * np.sin(angle))
    moved: FloatArray = (RADIUS * np.cos(angle) + np.cos(tilt) - RADIUS - 1.0)[:, None]
    return moved


def mechanism_records(stop: float = 1.2, step: float = 2e-3) -> list[Record]:
    """Both mechanisms, near-rigid and flexible."""
    records = []
    words, name = f"motion over {stop:g} s, rms", "second order, 2 frames, configuration mass, coupled"
    for problem, run, rigid in ((PENDULUM, pendulum, rigid_pendulum), (CRANK, crank, rigid_crank)):
        times, found = run(STIFF, stop, step)
        expected = rigid(STIFF, times)
        records.append(_record(f"{problem}, near-rigid", "rigid bodies by SciPy", words, name, found, expected))
        times, found = run(SOFT, stop, step)
        rows = np.round(np.arange(0.1, stop + 1e-9, 0.1) / step).astype(int)
        key = "pendulum" if run is pendulum else "crank"
        finest = np.array([values for _, _, values, _ in kept(key)][-1]).reshape(-1, found.shape[1])
        records.append(_record(f"{problem}, flexible", "Exudyn", words, name, found[rows], finest[: len(rows)]))
        stiff = rigid(SOFT, times)
        records.append(_record(f"{problem}, flexible", "Exudyn", words, "rigid", stiff[rows], finest[: len(rows)]))
    return records


def _record(problem: str, source: str, words: str, name: str, found: FloatArray, expected: FloatArray) -> Record:
    values = tuple(map(float, np.ravel(found))), tuple(map(float, np.ravel(expected)))
    return Record(problem, source, words, name, values[0], values[1])
