"""Map of coupling step against stiffness and mass of what hangs on an interface, by FMUs and the master."""

import time
from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import FloatArray
from ...files.errors import INTERRUPTED
from ...fmu.package import package_fmu
from ...master import couple
from ...master.config import parse_coupling
from ...master.coupling import CouplingStoppedError
from ...master.results import Result
from ...model.methods import Method
from ...model.reduced_body import ReducedBody
from ..records import Run, verdict
from ..scene.config import Map
from ..workshop import Heard
from .subject import Subject, Task, linear_response, period, unit

SCHEMES: dict[str, dict[str, str]] = {
    "jacobi": {"scheme": "jacobi"},
    "gauss_seidel": {"scheme": "gauss_seidel"},
    "iterated, end": {"scheme": "iterated", "held": "end"},
    "iterated, mean": {"scheme": "iterated", "held": "mean"},
}
# Static displacement of the interface, as part of the body's size: small enough for a linear answer to be the truth.
_SMALL = 1e-4
# Periods of the slowest coupled vibration, steps at the least and at the most.
_PERIODS, _FEWEST, _MOST = 3.0, 40, 400
_POINT = "point"


def obstacle(subject: Subject) -> str | None:
    """Why the map has no meaning for a body."""
    if subject.config.free:
        return "a free body and a mass on it fly away under the load that the map puts on"
    return None


def _cells(subject: Subject, mass_ratio: float) -> Iterator[tuple[Run, str, float, float]]:
    """Runs of which nothing is known yet, with scheme, steps a period and stiffness ratio."""
    table = subject.table
    for scheme, count, ratio in product(SCHEMES, table.coupling_steps_per_period, table.stiffness_ratios):
        run = subject.blank(Map.COUPLING, f"{scheme}, mass × {mass_ratio:g}", f"{ratio:g}", f"{count:g}")
        yield run, scheme, count, ratio


def planned(subject: Subject) -> list[Run]:
    """Runs of the whole map, of which nothing is known yet."""
    return [run for mass_ratio in subject.table.mass_ratios for run, *_ in _cells(subject, mass_ratio)]


def tasks(subject: Subject, done: Container[object], folder: Path) -> list[Task]:
    """What is not done, a task a run.

    Parameters
    ----------
    subject : Subject
    done : container of keys
    folder : Path
        For the FMUs while they are needed.

    Returns
    -------
    list of Task
    """
    bench = _bench(subject, folder)
    body = bench.body
    subject.report.note(
        f"{bench.name}: {bench.stiffness:.4g} N/m, {bench.mass:.4g} kg within a step; lowest period "
        f"{period(body):.4g} s"
    )
    package_fmu(body, folder / "body.fmu")
    found: list[Task] = []
    for mass_ratio in subject.table.mass_ratios:
        mass, file = mass_ratio * bench.mass, f"mass{mass_ratio:g}.fmu"
        package_fmu(_point_mass(mass), folder / file)
        found += [
            partial(bench.couple, run, file, mass, ratio * bench.stiffness, period(body) / count, scheme)
            for run, scheme, count, ratio in _cells(subject, mass_ratio)
            if run.key not in done
        ]
    return found


def _bench(subject: Subject, folder: Path) -> "_Bench":
    body = subject.reduced()
    place = subject.interface(body)
    given = subject.table.direction
    along = unit(np.array(given) if given is not None else linear_response(body, subject.peak(body))[place, 0])
    shape = along @ body.interface_displacement[place]
    elastic = body.angular_frequency > 0.0
    give = float(np.sum((shape[elastic] / body.angular_frequency[elastic]) ** 2))
    points = np.concatenate([body.interface_point, body.joint_point])
    size = float(np.max(np.linalg.norm(points - body.interface_point[place], axis=1))) or 1.0
    tolerance, mass = subject.table.tolerance, 1.0 / float(shape @ shape)
    return _Bench(folder, tolerance, body, body.interface_names[place], along, shape, 1.0 / give, mass, size)


def _point_mass(mass: float) -> ReducedBody:
    """Mass (kg) that moves freely; a body must have an elastic mode, which takes no part."""
    zero = np.zeros((1, 3, 4))
    displacement = zero.copy()
    displacement[0, :, :3] = np.eye(3) / np.sqrt(mass)
    return ReducedBody(
        name="point_mass",
        angular_frequency=np.array([0.0, 0.0, 0.0, 1.0]),
        damping_ratio=np.zeros(4),
        interface_names=(_POINT,),
        interface_point=np.zeros((1, 3)),
        interface_displacement=displacement,
        interface_rotation=zero,
        interface_frame=np.array([-1]),
        method=Method.LINEAR,
        velocity_outputs=True,
    )


@dataclass(frozen=True, slots=True)
class _Bench:
    """A body with one interface, along a direction, on which a mass hangs by a spring.

    Attributes
    ----------
    folder : Path
        Of the FMUs.
    tolerance : float
        Error that counts as right.
    body : ReducedBody
    name : str
        Of the interface.
    along : (3,) float
    shape : (m,) float
        Displacement along that direction per unit modal coordinate.
    stiffness, mass : float
        That a held force, and a sudden one, meet: N/m, kg.
    size : float
        Of the body, m.
    """

    folder: Path
    tolerance: float
    body: ReducedBody
    name: str
    along: FloatArray
    shape: FloatArray
    stiffness: float
    mass: float
    size: float

    def couple(
        self, run: Run, file: str, mass: float, stiffness: float, step: float, scheme: str
    ) -> tuple[list[Run], list[str]]:
        """Let a mass (kg) on a spring (N/m) swing under a sudden force, coupled in steps (s)."""
        start = time.perf_counter()
        force = _SMALL * self.size * self.stiffness
        rate, source = self._system(mass, stiffness, force)
        growth, shapes = np.linalg.eig(rate)
        slowest = float(np.min(np.abs(growth[np.abs(growth) > 0.0])))
        steps = int(np.clip(np.ceil(_PERIODS * 2.0 * np.pi / slowest / step), _FEWEST, _MOST))
        ends = f"body.{self.name}", f"mass.{_POINT}"
        pushed = {f"{_POINT}.force.{axis}": float(force * x) for axis, x in zip("xyz", self.along, strict=True)}
        axes = [f"{name}.displacement.{axis}" for name in ends for axis in "xyz"]
        heard = Heard()
        coupling = parse_coupling(
            {
                "experiment": {"stop": steps * step, "step": step, **SCHEMES[scheme]},
                "fmu": [{"name": "body", "file": "body.fmu"}, {"name": "mass", "file": file, "start": pushed}],
                "spring": [{"a": ends[0], "b": ends[1], "stiffness": [float(stiffness)] * 3 + [0.0] * 3}],
                "output": {"variables": axes},
            },
            self.folder,
        )
        refused = ""
        try:
            result = couple(coupling, heard)
        except CouplingStoppedError as stopped:
            if stopped.exit_code == INTERRUPTED:
                # Of the user, not of the coupling.
                raise
            refused, result = str(stopped), stopped.result
        error = self._error(np.stack([result[name] for name in axes], axis=1), result, growth, shapes, source)
        found = verdict(error, bool(heard.warnings), bool(refused), self.tolerance)
        words = refused or (heard.warnings[0] if heard.warnings else "")
        run = replace(run, verdict=found.value, error=error, measure=self._kappa(mass, stiffness, step), words=words)
        return [replace(run, taken=len(result.time) - 1, seconds=time.perf_counter() - start)], []

    def _system(self, mass: float, stiffness: float, force: float) -> tuple[FloatArray, FloatArray]:
        """Linear equations ẏ = A y + s of modes and mass in continuous time, y = (q, x, q̇, ẋ)."""
        omega, m = self.body.angular_frequency, self.body.mode_count
        spring = np.append(self.shape, -1.0)
        inertia = np.append(np.ones(m), mass)
        pull = np.diag(np.append(omega**2, 0.0)) + stiffness * np.outer(spring, spring)
        damping = np.diag(np.append(2.0 * self.body.damping_ratio * omega, 0.0))
        size = m + 1
        rate = np.zeros((2 * size, 2 * size))
        rate[:size, size:] = np.eye(size)
        rate[size:, :size], rate[size:, size:] = -pull / inertia[:, None], -damping / inertia[:, None]
        source = np.zeros(2 * size)
        source[-1] = force / mass
        return rate, source

    def _error(
        self, moved: FloatArray, result: Result, growth: FloatArray, shapes: FloatArray, source: FloatArray
    ) -> float:
        """Rms error of the interface's and the mass's displacement over its rms, the larger."""
        moved = moved.reshape(-1, 2, 3) @ self.along
        # y(t) = ∫ exp(A t') dt' s, mode by mode.
        weight = np.linalg.solve(shapes, source)
        gain = np.expm1(growth * result.time[:, None]) / growth
        y = ((gain * weight) @ shapes.T).real
        half = y.shape[1] // 2
        true = np.stack([y[:, : half - 1] @ self.shape, y[:, half - 1]], axis=1)
        with np.errstate(all="ignore"):
            off = np.linalg.norm(moved - true, axis=0) / np.linalg.norm(true, axis=0)
        return float(np.max(off)) if len(moved) > 1 else float("nan")

    def _kappa(self, mass: float, stiffness: float, step: float) -> float:
        """κ = h²k/m: twice what the spring answers its own load with within a step."""
        model = FlexibleBody(replace(self.body, compliance_interfaces=()))
        inputs = np.zeros(6 * self.body.interface_count + (0 if self.body.masses is None else 3))
        place = self.body.interface_names.index(self.name)
        give = model.compliance(model.rest(), inputs, step, [place])[:3, :3]
        return float(2.0 * stiffness * (self.along @ give @ self.along + 0.5 * step**2 / mass))
