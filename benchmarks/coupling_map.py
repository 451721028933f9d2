"""Which steps a coupling may take: a mass on a spring at a body's interface, against stiffness, mass and scheme.

FMUs and master are the real ones; the linear equations of both in continuous time are the truth. Run from the
repository's root: python -m benchmarks.coupling_map [--output FILE.csv] [--picture FILE.png] [BODY …]
Without --output the records that are kept are drawn.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import FloatArray, StoppedError
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.master import couple
from flexfmu.master.config import parse_coupling
from flexfmu.master.coupling import Result
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import ReducedBody
from flexfmu.study.pictures import percent_words
from flexfmu.study.records import verdict

from .records import read_records, write_records

HERE = Path(__file__).parent
DEMO = HERE.parent / "demo"
# Interface and direction of the force, masses and springs over those of the interface, steps a period of the body.
BODIES = {
    "clamped_beam": ("tip", [0.0, 1.0, 0.0], [0.1, 1.0, 10.0], [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]),
    "l_frame": ("tip", [0.0, 0.0, 1.0], [0.1, 1.0, 10.0], [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]),
    "rear_axle": ("wheel_left", [0.0, 0.0, 1.0], [1.0, 10.0], [0.1, 1.0, 10.0, 100.0]),
}
STEPS = (160.0, 40.0, 10.0, 2.5)
SCHEMES: dict[str, dict[str, str]] = {
    "jacobi": {"scheme": "jacobi"},
    "gauss_seidel": {"scheme": "gauss_seidel"},
    "iterated, end": {"scheme": "iterated", "held": "end"},
    "iterated, mean": {"scheme": "iterated", "held": "mean"},
}
TOLERANCE = 0.1
# Static displacement of the interface, as part of the body's size: small enough for a linear answer to be the truth.
_SMALL = 1e-4
# Periods of the slowest coupled vibration, steps at the least and at the most.
_PERIODS, _FEWEST, _MOST = 3.0, 40, 400
_POINT = "point"


class Warned(Reporter):
    """Keeps the first warning."""

    def __init__(self) -> None:
        self.words = ""

    def warning(self, text: str) -> None:
        """Keep it."""
        self.words = self.words or text


def rows_of(name: str, folder: Path, report: Reporter) -> list[dict[str, object]]:
    """Run all couplings of a demo body."""
    interface, direction, masses, springs = BODIES[name]
    body = reduce_body(read_body_file(DEMO / name / "body.toml"), report)
    bench = bench_of(body, interface, np.array(direction), folder)
    package_fmu(body, folder / "body.fmu")
    period = 2.0 * np.pi / body.angular_frequency[body.rigid_count]
    cells = list(product(masses, SCHEMES, STEPS, springs))
    rows = []
    with report.counted(f"Couple {name}", len(cells), "runs") as tell:
        for done, (mass_ratio, scheme, count, ratio) in enumerate(cells, start=1):
            package_fmu(_point_mass(mass_ratio * bench.mass), folder / "mass.fmu")
            found = bench.couple(mass_ratio * bench.mass, ratio * bench.stiffness, period / count, scheme)
            where = {"body": name, "scheme": scheme, "mass": f"{mass_ratio:g}", "spring": f"{ratio:g}"}
            rows.append({**where, "steps": f"{count:g}", **found})
            tell(done)
    return rows


def bench_of(body: ReducedBody, interface: str, along: FloatArray, folder: Path) -> "Bench":
    """A body with one interface, along a direction."""
    place = body.interface_names.index(interface)
    shape = along @ body.interface_displacement[place]
    elastic = body.angular_frequency > 0.0
    give = float(np.sum((shape[elastic] / body.angular_frequency[elastic]) ** 2))
    points = np.concatenate([body.interface_point, body.joint_point])
    size = float(np.max(np.linalg.norm(points - body.interface_point[place], axis=1)))
    return Bench(folder, body, interface, along, shape, 1.0 / give, 1.0 / float(shape @ shape), size)


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
class Bench:
    """A body with one interface, along a direction, on which a mass hangs by a spring.

    Attributes
    ----------
    folder : Path
        Of the FMUs.
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
    body: ReducedBody
    name: str
    along: FloatArray
    shape: FloatArray
    stiffness: float
    mass: float
    size: float

    def couple(self, mass: float, stiffness: float, step: float, scheme: str) -> dict[str, object]:
        """Let a mass (kg) on a spring (N/m) swing under a sudden force, coupled in steps (s)."""
        force = _SMALL * self.size * self.stiffness
        rate, source = self._system(mass, stiffness, force)
        growth, shapes = np.linalg.eig(rate)
        slowest = float(np.min(np.abs(growth[np.abs(growth) > 0.0])))
        steps = int(np.clip(np.ceil(_PERIODS * 2.0 * np.pi / slowest / step), _FEWEST, _MOST))
        ends = f"body.{self.name}", f"mass.{_POINT}"
        pushed = {f"{_POINT}.force.{axis}": float(force * x) for axis, x in zip("xyz", self.along, strict=True)}
        axes = [f"{name}.displacement.{axis}" for name in ends for axis in "xyz"]
        heard, refused = Warned(), ""
        coupling = parse_coupling(
            {
                "experiment": {"stop": steps * step, "step": step, **SCHEMES[scheme]},
                "fmu": [{"name": "body", "file": "body.fmu"}, {"name": "mass", "file": "mass.fmu", "start": pushed}],
                "spring": [{"a": ends[0], "b": ends[1], "stiffness": [float(stiffness)] * 3 + [0.0] * 3}],
                "output": {"variables": axes},
            },
            self.folder,
        )
        try:
            result = couple(coupling, heard)
        except StoppedError as stopped:
            refused, result = str(stopped), stopped.result
        error = self._error(np.stack([result[name] for name in axes], axis=1), result, growth, shapes, source)
        found = verdict(error, bool(heard.words), bool(refused), TOLERANCE)
        kappa = self._kappa(mass, stiffness, step)
        words = (refused or heard.words).replace("\n", " ")
        return {"verdict": found, "error": f"{error:.4g}", "kappa": f"{kappa:.4g}", "words": words}

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


def draw(rows: list[dict[str, str]], picture: Path) -> None:
    """Draw the runs of a body: a panel a scheme and mass, errors in %, W: warned, x: stopped."""
    panels = list(dict.fromkeys((row["mass"], row["scheme"]) for row in rows))
    # Two beside each other: readable at the width of a page.
    lines = len(panels) // 2
    figure, grid = plt.subplots(lines, 2, figsize=(7.5, 2.2 * lines), squeeze=False, layout="constrained")
    for panel, (mass, scheme) in zip(grid.flat, panels, strict=True):
        some = [row for row in rows if (row["mass"], row["scheme"]) == (mass, scheme)]
        across, up = (sorted({row[key] for row in some}, key=float) for key in ("spring", "steps"))
        errors = np.full((len(up), len(across)), np.nan)
        for row in some:
            x, y, error = across.index(row["spring"]), up.index(row["steps"]), float(row["error"])
            refused = row["verdict"] == "refused"
            errors[y, x] = np.nan if refused else error
            mark = {"right": "", "warned": " W", "silent": " !"}.get(row["verdict"], "")
            words = "x" if refused else f"{percent_words(error)}{mark}"
            panel.text(x, y, words, ha="center", va="center", fontsize=7)
        panel.imshow(errors, norm=LogNorm(1e-3, 1.0), cmap="Blues", alpha=0.7, aspect="auto", origin="lower")
        panel.set_xticks(range(len(across)), across)
        panel.set_yticks(range(len(up)), up)
        panel.set(xlabel="spring / interface stiffness", ylabel="steps a period")
        panel.set_title(f"{scheme}, mass × {mass}", fontsize="medium")
    figure.suptitle(f"{rows[0]['body']}: errors in %; W: warned, !: wrong in silence, x: stopped")
    figure.savefig(picture, dpi=110)
    plt.close(figure)


def main() -> None:
    """Run the bodies that are named, or draw what is kept."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bodies", nargs="*", choices=[[], *BODIES], default=[])
    parser.add_argument("--output", type=Path)
    parser.add_argument("--pictures", type=Path, default=HERE.parent / "docs" / "figures", help="folder")
    options = parser.parse_args()
    kept = options.output or HERE / "coupling_map.csv"
    if options.output is not None:
        rows: list[dict[str, object]] = []
        for name in options.bodies or BODIES:
            with tempfile.TemporaryDirectory() as folder:
                rows += rows_of(name, Path(folder), ConsoleReporter())
        write_records(kept, rows)
    every = read_records(kept)
    for name in dict.fromkeys(row["body"] for row in every):
        draw([row for row in every if row["body"] == name], options.pictures / f"coupling_{name}.png")


if __name__ == "__main__":
    main()
