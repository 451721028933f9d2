"""Published static problems: large deflection, buckling, limit loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.field import bodies
from benchmarks.field.bodies import DEMO, FOLDER, INCH, POUND, Body
from benchmarks.field.records import Record, label, linear_cost, median_time
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.files.basics import EquilibriumError
from flexfmu.model.methods import Method

FloatArray = NDArray[np.float64]
# What is tried: the default with few frames, first order with more.
MODELS = ((Method.LINEAR, 1), *((Method.SECOND_ORDER, n) for n in (1, 2, 4)), (Method.FRAMES, 8))
ROLLING = (*((Method.SECOND_ORDER, n) for n in (1, 2, 4, 8)), *((Method.FRAMES, n) for n in (1, 2, 4, 8, 16)))

# Tip of the bend by load, lbf: its place, in (Simo, Vu-Quoc).
BEND = {300.0: (22.33, 58.84, 40.08), 450.0: (18.62, 52.32, 48.39), 600.0: (15.79, 47.23, 53.37)}
# Elastica: PL²/EI, and the tip's displacement across and along the beam over its length (Mattiasson).
ELASTICA = {1.0: (0.30172, 0.05643), 2.0: (0.49346, 0.16064), 4.0: (0.66996, 0.32894), 10.0: (0.81061, 0.55500)}
# Displacement of the Princeton beam's tip under 13.345 N at 45°, m: beam elements (solid ones: 0.014851, 0.153554).
PRINCETON = (0.0151862, 0.1564672)


def results(name: str) -> FloatArray:
    """A kept result of CalculiX, columns by name."""
    return np.genfromtxt(FOLDER / "calculix" / f"{name}.csv", delimiter=",", names=True)


def displacement(row: FloatArray) -> tuple[float, ...]:
    """Displacement of CalculiX's interface, m."""
    return tuple(float(row[f"u{axis}_m"]) for axis in "xyz")


class Models:
    """Models of one body, each made once."""

    def __init__(self, body: Body, models: Sequence[tuple[Method, int]] = MODELS, modes: int = 10, **tables: object):
        reduced = {frames: body.reduced(frames, modes, **tables) for frames in {frames for _, frames in models}}
        self.interface = body.interface.lower()
        words = " a part, cut" if "cut" in tables else ""
        self.known = [(label(m, n) + words, FlexibleBody(reduced[n], m)) for m, n in models]

    def records(
        self,
        problem: str,
        source: str,
        quantity: str,
        load: Sequence[float],
        published: tuple[float, ...] = (),
        calculix: tuple[float, ...] = (),
        offset: Sequence[float] = (0.0, 0.0, 0.0),
        axes: Sequence[int] = (0, 1, 2),
        unit: float = 1.0,
    ) -> list[Record]:
        """One record of each model: displacement plus `offset` along some axes, in a unit (m), under a load."""
        loads, found = {self.interface: list(load)}, []
        base = linear_cost(self.known[0][1], loads)
        for name, body in self.known:
            try:
                moved = body.response(body.static(loads)).displacement[0]
            except EquilibriumError:
                found.append(Record(problem, source, quantity, name, (), published, calculix))
                continue
            ours = tuple(float((moved[axis] + offset[axis]) / unit) for axis in axes)
            cost = median_time(lambda body=body: body.static(loads))  # type: ignore[misc]
            found.append(Record(problem, source, quantity, name, ours, published, calculix, cost, cost / base))
        return found


def limit_load(body: FlexibleBody, interface: str, load: Sequence[float], accuracy: float = 1e-4) -> float:
    """Largest part of a load that static equilibrium bears, by bisection."""
    low, high = 0.0, 1.0
    while high - low > accuracy:
        middle = 0.5 * (low + high)
        try:
            body.static({interface: [middle * x for x in load]})
        except EquilibriumError:
            high = middle
        else:
            low = middle
    return low


def critical_load(body: FlexibleBody, load: FloatArray, accuracy: float = 1e-4) -> float:
    """Smallest part of a load on the only interface at which the undeformed body's tangent is not definite."""
    rest, low, high = body.rest(), 0.0, 1.0
    while high - low > accuracy:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if body.stability(rest, middle * load)[0] > 0.0 else (low, middle)
    return low


def bend_records(models: Sequence[tuple[Method, int]] = MODELS) -> list[Record]:
    """Bathe's bend: bending out of the plane with torsion."""
    tried, expected = Models(bodies.bend(), models), results("bend")
    radius, source = 100.0 * INCH, "Bathe, Bolourchi, IJNME 14 (1979) 961; Simo, Vu-Quoc, CMAME 58 (1986) 79"
    start = (radius * (1.0 - 0.5**0.5), radius * 0.5**0.5, 0.0)
    records = []
    for pounds, place in BEND.items():
        row = expected[np.argmin(abs(expected["force_N"] - pounds * POUND))]
        moved = tuple(p - s / INCH for p, s in zip(place, start, strict=True))
        found = tuple(u / INCH for u in displacement(row))
        load, words = (0.0, 0.0, pounds * POUND), f"displacement under {pounds:g} lbf, in"
        records += tried.records("45° bend", source, words, load, moved, found, unit=INCH)
    return records


def elastica_records() -> list[Record]:
    """A cantilever under a force at its tip."""
    models, expected, bending = Models(bodies.strip()), results("strip"), bodies.STRIP
    records = []
    for load, (across, along) in ELASTICA.items():
        row = expected[np.argmin(abs(expected["force_N"] - load * bending))]
        records += models.records(
            "Elastica", "Mattiasson, IJNME 17 (1981) 145", f"displacement over length, PL²/EI = {load:g}",
            (0.0, load * bending, 0.0), (-along, across), displacement(row)[:2], axes=(0, 1),
        )  # fmt: skip
    return records


def rolling_records(degrees: Sequence[float] = (30.0, 90.0, 180.0, 270.0, 330.0)) -> list[Record]:
    """A cantilever rolled up by a moment at its tip."""
    models, bending, records = Models(bodies.strip(), ROLLING), bodies.STRIP, []
    for turn in degrees:
        angle = np.radians(turn)
        exact = (float(np.sin(angle) / angle - 1.0), float((1.0 - np.cos(angle)) / angle))
        records += models.records(
            "Cantilever rolled up", "closed form: a circle of radius EI/M", f"displacement over length at {turn:g}°",
            (0.0, 0.0, 0.0, 0.0, 0.0, angle * bending), exact, axes=(0, 1),
        )  # fmt: skip
    return records


def princeton_records() -> list[Record]:
    """The Princeton beam under the largest load at 45° to its section."""
    expected = displacement(results("princeton")[-1])
    force = 13.345 * 0.5**0.5
    words, source = "displacement across the beam, 13.345 N at 45°, m", "Obrezkov et al., Nonlinear Dyn. 109 (2022) 31"
    models = Models(bodies.princeton(), modes=24)
    return models.records(
        "Princeton beam", source, words, (0.0, force, force), PRINCETON, expected[1:], axes=(1, 2)
    )  # fmt: skip


def right_angle_records() -> list[Record]:
    """Argyris' frame: the load in its plane at which it goes sideways."""
    source, records = "Argyris et al., CMAME 17/18 (1979) 1", []
    models = Models(bodies.right_angle(), MODELS[1:], 16).known
    for name, sign, published in (("right_angle_pull", 1.0, (1.088,)), ("right_angle_push", -1.0, ())):
        expected = (abs(float(results(name)["force_N"][0])),)
        words = f"critical force {'away from' if sign > 0.0 else 'towards'} the support, N"
        for model, body in models:
            ours = 3.0 * critical_load(body, np.array([3.0 * sign, 0.0, 0.0, 0.0, 0.0, 0.0]))
            records.append(Record("Right-angle frame", source, words, model, (ours,), published, expected))
    return records


@dataclass(frozen=True)
class Path:
    """Equilibria of CalculiX, led by a displacement along an axis, up to the limit load.

    Attributes
    ----------
    axis : int
    force : (n,) float
        N, along the axis, growing.
    displacement : (n, 3) float
        m.
    limit : float
        The largest force, from the parabola through the three points about it, N.
    """

    axis: int
    force: FloatArray
    displacement: FloatArray
    limit: float

    @classmethod
    def read(cls, table: FloatArray, axis: int) -> Path:
        """Up to the first limit point of a table of results."""
        force, moved = -table["force_N"], np.stack([table[f"u{a}_m"] for a in "xyz"], axis=1)
        top = int(np.flatnonzero(np.diff(force) < 0.0)[0])
        curve = np.polyfit(moved[top - 1 : top + 2, axis] - moved[top, axis], force[top - 1 : top + 2], 2)
        return cls(axis, force[: top + 1], moved[: top + 1], float(curve[2] - 0.25 * curve[1] ** 2 / curve[0]))

    def load(self, force: float) -> list[float]:
        """Force on the interface."""
        load = [0.0, 0.0, 0.0]
        load[self.axis] = -force
        return load

    def records(
        self,
        problem: str,
        source: str,
        models: Models,
        part: float,
        published: tuple[float, ...] = (),
        unit: float = 1.0,
    ) -> list[Record]:
        """Displacement at the last point under a part of the limit load, and the limit load over a unit (N)."""
        row = int(np.flatnonzero(self.force < part * self.limit)[-1])
        words = f"displacement at {100.0 * self.force[row] / self.limit:.0f} % of the limit load, m"
        expected = tuple(map(float, self.displacement[row]))
        records = models.records(problem, source, words, self.load(float(self.force[row])), (), expected)
        for model, body in models.known:
            ours = 1.5 * self.limit / unit * limit_load(body, models.interface, self.load(1.5 * self.limit))
            words = "limit load" + (", N" if unit == 1.0 else "")
            records.append(Record(problem, source, words, model, (ours,), published, (self.limit / unit,)))
        return records


def arch_records() -> list[Record]:
    """Shallow arches under a force at the crown: hinged and clamped."""
    source, names = "CalculiX", ((Method.SECOND_ORDER, 1), (Method.SECOND_ORDER, 2))
    hinged = Path.read(results("hinged_arch"), 1)
    records = hinged.records("Hinged arch", source, Models(bodies.hinged_arch(), names), 0.9)
    clamped = Path.read(np.genfromtxt(DEMO / "calculix" / "path_y.csv", delimiter=",", names=True), 1)
    return records + clamped.records("Clamped arch", source, Models(bodies.clamped_arch(), names), 0.9)


def roof_records() -> list[Record]:
    """Hinged cylindrical roof under a force at its middle."""
    models = Models(bodies.hinged_roof(), ((Method.SECOND_ORDER, 1), (Method.SECOND_ORDER, 2)))
    path, source = Path.read(results("hinged_roof"), 2), "Sabir, Lock (1972); CalculiX"
    return path.records("Hinged roof", source, models, 0.9)


def lee_records() -> list[Record]:
    """Lee's frame: a loop whose parts turn far against each other."""
    path, source = Path.read(results("lee"), 1), "Lee, Manuel, Rossow, J. Eng. Mech. Div. ASCE 94 (1968) 521"
    unit = bodies.LEE / 1.2**2
    few = ((Method.SECOND_ORDER, 1), (Method.SECOND_ORDER, 2))
    records = []
    for models in (Models(bodies.lee(), few), Models(bodies.lee(), (*few, (Method.SECOND_ORDER, 4)), cut="auto")):
        records += path.records("Lee's frame", source, models, 0.65, (18.55,), unit)
    return [replace(r, quantity="limit load, EI/L²") if r.quantity == "limit load" else r for r in records]
