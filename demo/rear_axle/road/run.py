"""The rear axle over a bump: axle, wheels and road as FMUs under flexfmu's master: linear, corotated, cut.

Run from the repository's root: python -m demo.rear_axle.road.run [--output FOLDER]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from demo.rear_axle.alignment import LEFT, RIGHT, Alignment, FloatArray, alignment, arm_angle
from demo.rear_axle.road.scene import SIDES, Ride, build_axle, build_wheel, coil_preload, coupling, motion

from flexfmu.files.console import ConsoleReporter
from flexfmu.files.figures import BLUE, VERMILION
from flexfmu.files.outputs import Reporter
from flexfmu.master import Result, couple

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Joints of cut bodies ring at some 100 kHz: that need not be resolved.
LOOSE = {"internal_step.tolerance": 1e-2}
MODELS = {
    "linear modes": {"axle": {"method": "linear"}},
    "frames": {"axle": {"method": "frames"}},
    "cut, second order": {"axle": LOOSE, "cut": True},
}
STYLES = {
    "linear modes": {"color": "0.55", "linestyle": ":"},
    "frames": {"color": BLUE},
    "cut, second order": {"color": VERMILION, "linestyle": "--"},
}
SIGNS = {"left": LEFT, "right": RIGHT}


@dataclass(frozen=True, slots=True)
class Ridden:
    """What a ride gave.

    Attributes
    ----------
    result : Result
    seconds : float
        That it took.
    wheels : dict of str to Alignment
        By side; like what follows the change since before the bump.
    turned, rearward : dict of str to ndarray
        Angle of the arms, degrees, and rearward displacement of the wheels, m, by side.
    """

    result: Result
    seconds: float
    wheels: dict[str, Alignment]
    turned: dict[str, FloatArray]
    rearward: dict[str, FloatArray]


def ride_over(ride: Ride, preload: float, folder: Path, report: Reporter) -> Ridden:
    """Run a ride."""
    set_up = coupling(ride, preload, folder)
    begun = time.perf_counter()
    result = couple(set_up, report)
    seconds = time.perf_counter() - begun
    before = np.searchsorted(result.time, ride.begin) - 1
    wheels, turned, rearward = {}, {}, {}
    for side in SIDES:
        moved = motion(result, side)
        found = alignment(moved[:, :3], moved[:, 3:], SIGNS[side])
        angle = arm_angle(moved[:, 3:])
        wheels[side] = Alignment(*(x - x[before] for x in (found.toe, found.camber, found.travel)))
        turned[side] = angle - angle[before]
        rearward[side] = moved[:, 0] - moved[before, 0]
    return Ridden(result, seconds, wheels, turned, rearward)


def largest(values: FloatArray) -> float:
    """Value of the largest size, with its sign."""
    return float(values[np.argmax(np.abs(values))])


def print_table(rides: dict[str, Ridden], stop: float) -> None:
    """Print a Markdown table of extremes and costs."""
    head = (
        "",
        "travel left, mm",
        "right",
        "rearward left, mm",
        "left arm turns by, °",
        "toe left, °",
        "right",
        "tyre left, kN",
    )
    print("| " + " | ".join((*head, "iterations a step", "seconds a simulated second")) + " |\n" + "|---" * 10 + "|")
    for label, ridden in rides.items():
        travel = [f"{1e3 * largest(ridden.wheels[side].travel):.1f}" for side in SIDES]
        toe = [f"{largest(ridden.wheels[side].toe):+.2f}" for side in SIDES]
        tyre = ridden.result["left.tyre.force"]
        cells = (
            *travel,
            f"{1e3 * largest(ridden.rearward['left']):+.1f}",
            f"{largest(ridden.turned['left']):.1f}",
            *toe,
            f"{tyre.min() / 1e3:.1f} … {tyre.max() / 1e3:.1f}",
        )
        cost = f"{ridden.result['master.iterations'][1:].mean():.1f}", f"{ridden.seconds / stop:.0f}"
        print(f"| {label} | " + " | ".join((*cells, *cost)) + " |")


def draw(path: Path, rides: dict[str, Ridden], ride: Ride) -> None:
    """Draw travel and toe of both wheels over time."""
    figure, panels = plt.subplots(3, 2, figsize=(8.0, 7.0), sharex=True, sharey="row", layout="constrained")
    for column, side in enumerate(SIDES):
        for label, ridden in rides.items():
            when = 1e3 * (ridden.result.time - ride.begin)
            panels[0, column].plot(when, 1e3 * ridden.wheels[side].travel, label=label, **STYLES[label])
            panels[1, column].plot(when, 1e3 * ridden.rearward[side], **STYLES[label])
            panels[2, column].plot(when, ridden.wheels[side].toe, **STYLES[label])
        panels[0, column].fill_between(when, 1e3 * ridden.result[f"{side}.road.height"], color="0.9", label="road")
        panels[0, column].set_title(f"{side} wheel", fontsize="medium")
        panels[2, column].set_xlabel("time after reaching the bump / ms")
    panels[0, 0].set_xlim(-20.0, 1e3 * (ride.stop - ride.begin))
    panels[0, 0].set_ylabel("wheel travel / mm")
    panels[1, 0].set_ylabel("rearward / mm")
    panels[2, 0].set_ylabel("toe-in / degrees")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    for panel in panels.flat:
        panel.grid(alpha=0.25)
    figure.savefig(path, dpi=160)
    plt.close(figure)


def main(folder: Path, report: Reporter, ride: Ride | None = None) -> dict[str, Ridden]:
    """Run the demo; returns the rides by model."""
    ride = ride or Ride()
    folder.mkdir(parents=True, exist_ok=True)
    body = build_axle(folder, report)
    build_axle(folder, report, cut=True)
    build_wheel(folder)
    preload = coil_preload(body, ride)
    bump = f"{1e3 * max(ride.bump.values()):g} mm × {ride.length:g} m at {ride.speed:g} m/s"
    print(f"\nBump of {bump} under the left wheel, steps of {ride.step:g} s;")
    print(f"coil springs at {preload:.0f} N before. Largest changes:\n")
    rides = {}
    for label, choice in MODELS.items():
        rides[label] = ride_over(replace(ride, **choice), preload, folder, report)
    print_table(rides, ride.stop)
    draw(folder / "rear_axle_bump.png", rides, ride)
    print(f"\nFMUs and figures are in {folder}")
    return rides


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--output", type=Path, default=Path("output/rear_axle_road"), help="folder for FMUs and figures"
    )
    main(parser.parse_args().output, ConsoleReporter())
