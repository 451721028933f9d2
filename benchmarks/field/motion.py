"""Published problems of motion: spin-up, tumbling, free flight, flutter."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.field.exudyn_results import SPUN, kept
from benchmarks.field.records import Record, label
from flexfmu.body.flexible_body import FlexibleBody, Response, State, StepLimits
from flexfmu.build.config import BodyFile
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import StepError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

SPIN_UP = "Spin-up of a beam"
KANES = "Kane's beam, spun up to twice its first frequency"
FLIGHT = "Free flight of a beam"
TUMBLING = "Tumbling block"
# Of the lag, s.
# Of free bodies too.
MASSES = (Mass.CONSTANT, Mass.CONFIGURATION, Mass.POLYNOMIAL)
TIMES = (5.0, 7.5, 10.0, 12.5)
FLUTTER = "Column under a follower force"
# Error of a prescribed turn, rad, and how often a moment is corrected for it.
_SPUN, _MOST_TRIES = 1e-8, 20
# Corners of a 20-node brick and the ends of its edges, in half cells.
_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]


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
        for number in np.flatnonzero(np.array(bar.material)[cells[:, 0]] == index):
            row = [str(number + 1), *map(str, connectivity[number])]
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


@dataclass(frozen=True)
class Rod:
    """Slender beam, as papers give it: length (m), EI (N m²), EA (N), ρA (kg/m), Poisson's ratio.

    A square section has EI/EA = ρI/ρA = b²/12, which gives b, Young's modulus and density.
    """

    length: float
    bending: float
    axial: float
    mass: float
    poisson: float = 0.0

    @property
    def side(self) -> float:
        """Side of the square section, m."""
        return float(np.sqrt(12.0 * self.bending / self.axial))

    @property
    def material(self) -> tuple[float, float, float]:
        """Young's modulus, Poisson's ratio, density."""
        return self.axial / self.side**2, self.poisson, self.mass / self.side**2


# Simo and Vu-Quoc: 5/6 GA = 1e7 N asks for Poisson's ratio 1/6. Kane, Ryan and Banerjee.
SIMO = Rod(10.0, 1.4e4, 2.8e7, 1.2, 1.0 / 6.0)
KANE = Rod(8.0, 6.8952e10 * 8.2181e-9, 6.8952e10 * 7.2968e-5, 2766.67 * 7.2968e-5)
FLYING = Rod(10.0, 500.0, 1e4, 1.0)


def rotating_beam(rod: Rod, cells: int = 16, modes: int = 24) -> ReducedBody:
    """A beam on a hinge in its root's section, with a stiff hub of some four times its inertia behind it.

    A heavy hub turns as prescribed by itself, but the moment on it and its centrifugal force are then thousands of
    times those of the beam, and so is what they make of the round-off of modes.
    """
    _, poisson, density = rod.material
    hub = (3000.0 * rod.axial / rod.side**2, poisson, 0.45 * density)
    x = [-2.0, -1.25, -0.5, -0.25, *np.linspace(0.0, rod.length, cells + 1).tolist()]
    width = [rod.side * factor for factor in (25.0, 25.0, 25.0, 12.0, *np.ones(cells + 1))]
    bar = Section(x, width, [rod.material, hub], [1] * 4 + [0] * cells)
    reduction = {"modes": modes, "second_order": True, "inertia": True, "residual_flexibility": ["tip.force.x"]}
    return reduced(bar, ["ROOT", "TIP"], "HINGE", free=True, frames=1, reduction=reduction)


def spun(at: float) -> tuple[float, float]:
    """Prescribed angle (rad) and spin (rad/s): ψ̈ = (6/15)(1 − cos 2πt/15) for 15 s, 6 rad/s from then on."""
    pace, t = 2.0 * np.pi / 15.0, min(at, 15.0)
    angle = 0.4 * (0.5 * t**2 - (1.0 - np.cos(pace * t)) / pace**2) + 6.0 * (at - t)
    return float(angle), float(0.4 * (t - np.sin(pace * t) / pace))


def spin_up(
    model: ReducedBody, length: float, mass: Mass, step: float = 0.02
) -> tuple[dict[float, tuple[float, float]], float]:
    """Lag and stretch (m) of the tip in the root's axes at some times (s), and the cost of a simulated second.

    The moment of each step is the one after which the root's angle, and half a step's turn by the error of its spin,
    are as prescribed.
    """
    body, spin = FlexibleBody(model, Method.SECOND_ORDER, mass), model.interface_rotation[0][2]
    # Angle by moment of the rigid body.
    slope = (step * float(model.frame_rotation[0][2, 0])) ** 2
    state, moments, found, start = body.rest(), [0.0, 0.0], {}, time.perf_counter()

    def tried(moment: float, end: float) -> tuple[State, Response, float]:
        after = body.step(state, {"root": [0.0, 0.0, 0.0, 0.0, 0.0, moment]}, step)
        response, (angle, rate) = body.response(after), spun(end)
        off = float(response.rotation[0, 2]) - angle
        turns = round(off / (2.0 * np.pi))
        return after, response, off - 2.0 * np.pi * turns + 0.5 * step * (float(spin @ after.v) - rate)

    for k in range(round(20.0 / step)):
        moment = 2.0 * moments[-1] - moments[-2]
        after, response, off = tried(moment, (k + 1) * step)
        for _ in range(_MOST_TRIES):
            if abs(off) < _SPUN:
                break
            moment -= off / slope
            after, response, off = tried(moment, (k + 1) * step)
        else:
            raise RuntimeError(f"no moment turns the root as prescribed at {(k + 1) * step:g} s: {off:.1e} rad off")
        state, moments = after, [moments[-1], moment]
        angle, places = response.rotation[0, 2], model.interface_point + response.displacement
        arm = places[1] - places[0]
        own = np.cos(angle) * arm[:2] + np.sin(angle) * np.array([arm[1], -arm[0]])
        found[round((k + 1) * step, 6)] = (float(own[1]), float(own[0] - length))
    return found, (time.perf_counter() - start) / 20.0


def rotating_beam_records() -> list[Record]:
    """Lag of the tip while it spins up beyond its first frequency, and the steady stretch."""
    source = "Simo, Vu-Quoc, J. Appl. Mech. 53 (1986) 855"
    return _spun(SPIN_UP, source, SIMO, SPUN)


def kane_lag(rod: Rod, times: Sequence[float], shapes: int = 8, lowest: int = 4) -> FloatArray:
    """Lag of the tip (m) in Kane's linear theory with the stiffening by tension, by Ritz's method.

    ρA (d²v/dt² − Ω² v + x dΩ/dt) + EI d⁴v/dx⁴ − d/dx (N dv/dx) = 0, N = ½ ρA Ω² (L² − x²): good to (v/L)².
    """
    x, weight = np.polynomial.legendre.leggauss(30)
    x, weight = 0.5 * (x + 1.0), 0.5 * weight
    k = np.arange(2, shapes + 2)[:, None]
    v, slope, bend = x**k, k * x ** (k - 1), k * (k - 1) * x ** (k - 2)
    length, mass = rod.length, rod.mass
    inertia = mass * length * (v * weight) @ v.T
    stiffness = rod.bending / length**3 * (bend * weight) @ bend.T
    # Per Ω²: tension, less what the rotating axes add.
    spin = mass * length * (slope * weight * 0.5 * (1.0 - x**2)) @ slope.T - inertia
    squares, modes = scipy.linalg.eigh(stiffness, inertia)
    squares, modes = squares[:lowest], modes[:, :lowest]
    spin, push = modes.T @ spin @ modes, -mass * length**2 * modes.T @ (v * weight @ x)

    def rate(t: float, state: FloatArray) -> FloatArray:
        turned = 2.0 * np.pi * min(t, 15.0) / 15.0
        growth, speed = 0.4 * (1.0 - np.cos(turned)), 0.4 * (min(t, 15.0) - 15.0 / (2.0 * np.pi) * np.sin(turned))
        q = state[:lowest]
        return np.concatenate([state[lowest:], push * growth - squares * q - speed**2 * (spin @ q)])

    span = (0.0, max(times))
    found = solve_ivp(rate, span, np.zeros(2 * lowest), t_eval=times, rtol=1e-8, atol=1e-10)
    lag: FloatArray = modes.sum(axis=0) @ found.y[:lowest]
    return lag


def kane_records() -> list[Record]:
    """The same of Kane's beam, to twice its first frequency."""
    lags = kane_lag(KANE, TIMES)
    known = {f"lag at {at:g} s, m": float(lag) for at, lag in zip(TIMES, lags, strict=True)}
    known["steady stretch, m"] = KANE.mass * 36.0 * KANE.length**3 / (3.0 * KANE.axial)
    return _spun(KANES, "Kane, Ryan, Banerjee, J. Guidance 10 (1987) 139", KANE, known)


def _spun(problem: str, source: str, rod: Rod, published: dict[str, float]) -> list[Record]:
    model, records = rotating_beam(rod), []
    for mass in MASSES:
        found, cost = spin_up(model, rod.length, mass)
        name = f"second order, 1 frame, {mass.value} mass"
        ours = {f"lag at {at:g} s, m": found[at][0] for at in TIMES}
        ours["steady stretch, m"] = float(np.mean([value[1] for at, value in found.items() if at > 15.0]))
        for words, value in ours.items():
            records.append(Record(problem, source, words, name, (value,), (published[words],), (), cost))
    return records


def flight(model: ReducedBody, mass: Mass, step: float = 0.01) -> tuple[FloatArray, FloatArray, float]:
    """Displacement of both ends of a free beam at some times, its momenta and energy then, and the cost.

    Parameters
    ----------
    model : ReducedBody
        Along x, with interfaces back and tip; the root frame carries no load.
    mass : Mass
    step : float
        s.

    Returns
    -------
    places : (n, 4) float
        Tip and back, x and y, at 1, 1.5, … 8 s, m.
    kept : (n, 3) float
        Momentum along x and y and energy.
    cost : float
        s a simulated second.
    """
    body = FlexibleBody(model, Method.SECOND_ORDER, mass)
    push: dict[str, list[float]] = {"back": [-4.8, -6.4, 0.0, 0.0, 0.0, 80.0]}
    motion = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    state, places, kept, start = body.rest(), [], [], time.perf_counter()
    for k in range(round(8.0 / step)):
        state = body.step(state, push if k * step < 2.5 else {}, step)
        if (k + 1) % round(0.5 / step) == 0 and k * step > 0.9:
            moved = body.response(state).displacement
            momentum = np.linalg.solve(motion.T, (body.mass(state) @ state.v)[:6])
            places.append([*moved[1, :2], *moved[0, :2]])
            kept.append([*momentum[:2], sum(body.energies(state))])
    return np.array(places), np.array(kept), (time.perf_counter() - start) / 8.0


def flight_records(numbers: Sequence[int] = (1, 2, 4)) -> list[Record]:
    """Free flight of a flexible beam that a force and a moment on one end have thrown."""
    source, records = "after Simo, Vu-Quoc, J. Appl. Mech. 53 (1986) 855; Exudyn", []
    reference = {model: values for _, model, values, _ in kept("flight")}
    finest = next(values for model, values in reference.items() if model.endswith(" 32 elements"))
    bar = Section(np.linspace(0.0, 10.0, 17).tolist(), [FLYING.side] * 17, [FLYING.material], [0] * 16)
    for frames in numbers:
        reduction = {"modes": 20, "second_order": True, "inertia": True, "residual_flexibility": True}
        model = reduced(bar, ["BACK", "TIP"], None, free=True, root="back", frames=frames, reduction=reduction)
        for mass in MASSES:
            name = f"{label(Method.SECOND_ORDER, frames)}, {mass.value} mass"
            try:
                places, momenta, cost = flight(model, mass)
            except StepError:
                records.append(Record(FLIGHT, source, "ends over 8 s, rms", name, (), (), finest))
                continue
            ours = tuple(map(float, places.ravel()))
            records.append(Record(FLIGHT, source, "ends over 8 s, rms", name, ours, (), finest, cost))
            drift = float(np.ptp(momenta[4:, :2], axis=0).max() / 20.0)
            records.append(Record(FLIGHT, "conservation law", "drift of momentum", name, (drift,), (0.0,), (), cost))
            drift = float(np.ptp(momenta[4:, 2]) / momenta[4:, 2].mean())
            records.append(Record(FLIGHT, "conservation law", "drift of energy", name, (drift,), (0.0,), (), cost))
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
    for mass in MASSES:
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
            text, name = f"drift of {words} over {turns:g} turns", f"second order, {mass.value} mass"
            records.append(Record(TUMBLING, "conservation law", text, name, (error,), (0.0,), (), cost))
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
        source, words = "Beck, ZAMP 3 (1952) 225", "load, EI/L²"
        records.append(Record(FLUTTER, source, words, label(method, frames), (low,), (20.05,)))
    return records
