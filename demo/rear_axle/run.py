"""Rear axle: displacement, toe and camber of the wheels by several reduced models, against CalculiX.

Prints a Markdown table for each case; with --output, draws toe against wheel travel. Run from the repository's root:
python -m demo.rear_axle.run [--output FOLDER]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from demo.rear_axle.alignment import LEFT, RIGHT, Alignment, FloatArray, alignment, arm_angle
from demo.tip_face import MOTION_COLUMNS

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FormulationTable
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method

HERE = Path(__file__).parent
WHEELS = ("wheel_left", "wheel_right")
SIDES = (LEFT, RIGHT)
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Reference:
    """CalculiX's results of a case: n loads, forces by wheel (n, 3), motion (n, 2, 6) of both wheels."""

    forces: dict[str, FloatArray]
    motion: FloatArray

    def loads(self) -> list[dict[str, list[float]]]:
        """Return the loads as `FlexibleBody.static` takes them."""
        count = len(self.motion)
        return [{wheel: list(force[k]) for wheel, force in self.forces.items()} for k in range(count)]


# Case: file of the body, direction of a force that the CSV file calls only force_N.
CASES = {
    "left": ("body.toml", "z", "vertical force at the left wheel"),
    "side": ("body.toml", "y", "side force at the left wheel"),
    "opposite": ("body.toml", "z", "opposite vertical forces"),
    "left_bushings": ("body_bushings.toml", "z", "vertical force at the left wheel, on bushings"),
    "opposite_bushings": ("body_bushings.toml", "z", "opposite vertical forces, on bushings"),
}

# Label, frames (None: the body file's arms and pieces of the beam), method; all but the last in one piece.
CUT, SECOND = "cut in the middle", "cut, second order"
MODELS = (
    ("linear modes", None, Method.LINEAR),
    ("frames = 1", 1, Method.FRAMES),
    ("arms and beam", None, Method.FRAMES),
    ("frames = 4", 4, Method.FRAMES),
    ("arms and beam, by load", None, Method.FRAMES_STIFFNESS),
    (CUT, None, Method.FRAMES),
    (SECOND, None, Method.SECOND_ORDER),
)


def read_reference(path: Path, axis: str) -> Reference:
    """Read a CSV file of `calculix/`; `axis` is the direction of a single force, which acts at the left wheel."""
    table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True))
    motion = np.stack([np.stack([table[f"{w}_{c}"] for c in MOTION_COLUMNS], axis=1) for w in WHEELS], axis=1)
    forces = {}
    for wheel in WHEELS:
        force = np.zeros((len(table), 3))
        for number, letter in enumerate(AXES):
            single = "force_N" if wheel == WHEELS[0] and letter == axis else ""
            for name in (f"{wheel}_f{letter}_N", single):
                if name in (table.dtype.names or ()):
                    force[:, number] = table[name]
        forces[wheel] = force
    return Reference(forces, motion)


def solve(body: FlexibleBody, reference: Reference) -> FloatArray:
    """Motion (n, 2, 6) of both wheels in equilibrium under the loads of a reference."""
    rows = []
    for loads in reference.loads():
        response = body.response(body.static(loads))
        rows.append(np.hstack([response.displacement, response.rotation]))
    return np.array(rows)


def align(motion: FloatArray) -> list[Alignment]:
    """Alignment of both wheels from their motion (n, 2, 6)."""
    return [alignment(motion[:, i, :3], motion[:, i, 3:], side) for i, side in enumerate(SIDES)]


def print_table(reference: Reference, found: dict[str, FloatArray]) -> None:
    """Print the errors at two thirds of the load and at all of it.

    Displacement: of the wheel that is farther off, in per cent of the larger displacement of the two.
    """
    expected, angles = align(reference.motion), [arm_angle(reference.motion[:, i, 3:]) for i in range(2)]
    rows = sorted({2 * (len(reference.motion) - 1) // 3, len(reference.motion) - 1})
    for k in rows:
        load = max(np.abs(force[k]).max() for force in reference.forces.values())
        print(f"\n{load:g} N: arms at {angles[0][k]:.1f} and {angles[1][k]:.1f} degrees,", end=" ")
        print(f"toe {expected[0].toe[k]:.3f} and {expected[1].toe[k]:.3f} degrees\n")
        print("| | displacement, % | toe left, degrees | toe right | camber left | camber right |\n" + "|---" * 6 + "|")
        for label, motion in found.items():
            size = np.linalg.norm(reference.motion[k, :, :3], axis=1).max()
            error = np.linalg.norm(motion[k, :, :3] - reference.motion[k, :, :3], axis=1).max() / size
            got = align(motion)
            off = [g.toe[k] - e.toe[k] for g, e in zip(got, expected, strict=True)]
            off += [g.camber[k] - e.camber[k] for g, e in zip(got, expected, strict=True)]
            print(f"| {label} | {100 * error:.2f} | " + " | ".join(f"{value:+.3f}" for value in off) + " |")


def draw(path: Path, reference: Reference, found: dict[str, FloatArray], title: str) -> None:
    """Draw toe against wheel travel of both wheels."""
    figure, panels = plt.subplots(1, 2, figsize=(8.0, 3.6), layout="constrained")
    for i, (panel, name) in enumerate(zip(panels, ("left", "right"), strict=True)):
        for label, motion in found.items():
            wheel = align(motion)[i]
            panel.plot(wheel.toe, 1e3 * wheel.travel, label=label)
        wheel = align(reference.motion)[i]
        panel.plot(wheel.toe, 1e3 * wheel.travel, "ko", markersize=3.5, fillstyle="none", label="CalculiX")
        panel.set_xlabel(f"toe-in of the {name} wheel / degrees")
        panel.grid(alpha=0.25)
    panels[0].set_ylabel("wheel travel / mm")
    panels[0].legend(frameon=False, fontsize="small")
    figure.suptitle(title, fontsize="medium")
    figure.savefig(path, dpi=160)
    plt.close(figure)


def models(body_file: Path, report: Reporter) -> dict[str, FlexibleBody]:
    """Build the reduced models of a body file."""
    config = read_body_file(body_file)
    by_load = config.reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    stiff = config.model_copy(update={"reduction": by_load, "cut": [], "formulation": FormulationTable()})
    joined = reduce_body(config, report)
    reduced = {None: reduce_body(stiff, report)}
    for count in {frames for _, frames, _ in MODELS if frames}:
        reduced[count] = reduce_body(stiff.model_copy(update={"frame": [], "frames": count}), report)
    return {
        label: FlexibleBody(joined if label in (CUT, SECOND) else reduced[frames], method)
        for label, frames, method in MODELS
    }


def main(folder: Path | None, report: Reporter) -> dict[str, dict[str, FloatArray]]:
    """Run all cases; returns the motion of both wheels by case and model."""
    results: dict[str, dict[str, FloatArray]] = {}
    bodies: dict[str, dict[str, FlexibleBody]] = {}
    for case, (body_file, axis, words) in CASES.items():
        if body_file not in bodies:
            bodies[body_file] = models(HERE / body_file, report)
        reference = read_reference(HERE / "calculix" / f"{case}.csv", axis)
        found = {label: solve(body, reference) for label, body in bodies[body_file].items()}
        print(f"\n### {words}")
        print_table(reference, found)
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
            draw(folder / f"{case}_toe.png", reference, found, words)
        results[case] = found
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="folder for figures")
    main(parser.parse_args().output, ConsoleReporter())
