"""Rear axle: toe against wheel travel by seven models, the figures of this folder's README.

Run from the repository's root: python -m demo.rear_axle.travel_toe [--output FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from demo.rear_axle import make_mesh
from demo.rear_axle.run import HERE, align, read_reference, solve

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable, MeshTable
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.figures import GREEN, ORANGE, PINK, SKY, VERMILION
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, default_folder
from flexfmu.model.methods import Method

matplotlib.use("Agg")
import matplotlib.pyplot as plt

CASES = {
    "left": ("z", "vertical force at the left wheel, 0 to 1.8 kN"),
    "side": ("y", "side force at the left wheel, inboard, 0 to 7 kN"),
    "opposite": ("z", "opposite vertical forces, 0 to ±2.4 kN"),
}
STYLES = {
    "linear": {"color": "0.55", "linestyle": ":"},
    "one floating frame": {"color": SKY, "linestyle": "--"},
    "arms as separate sub-domains": {"color": ORANGE, "linestyle": "-."},
    "tree: arms and beam": {"color": PINK, "linestyle": "-"},
    "cut in the middle": {"color": VERMILION, "linestyle": "--"},
    "cut, second order": {"color": GREEN, "linestyle": "-"},
}
# Corners of each arm's tetrahedron with the joint: places on the right arm, m; the nearest nodes are taken.
CORNERS = ((0.45, 0.615, 0.0), (0.30, 0.525, 0.035), (0.30, 0.575, -0.035))


def with_corners(config: BodyFile, deck: Path) -> BodyFile:
    """Body of two arms whose rotations are averaged by four points, on a deck that has these as node sets."""
    axle = make_mesh.build(make_mesh.SIZES["coarse"])
    frames = []
    for side, sign in (("L", -1.0), ("R", 1.0)):
        for number, corner in enumerate(CORNERS):
            away = np.linalg.norm(axle.mesh.points - np.array(corner) * [1.0, sign, 1.0], axis=1)
            axle.node_sets[f"CORNER_{side}{number}"] = np.array([np.argmin(away)])
        points = [f"CORNER_{side}{number}" for number in range(len(CORNERS))]
        frames.append(FrameTable(name=f"arm_{side}", nodes=f"ARM_{side}", rotation_points=points))
    make_mesh.write(deck, axle)
    return config.model_copy(update={"frame": frames, "mesh": MeshTable(file=deck)})


def models(folder: Path, report: Reporter) -> dict[str, FlexibleBody]:
    """Build the models."""
    store = Store(default_folder())
    cut = read_body_file(HERE / "body.toml")
    whole = cut.model_copy(update={"cut": []})
    tree = reduce_body(whole, report, store)
    halves = reduce_body(cut, report, store)
    points = reduce_body(with_corners(whole, folder / "rear_axle_corners.inp"), report, store)
    return {
        "linear": FlexibleBody(tree, Method.LINEAR),
        "one floating frame": FlexibleBody(tree, Method.FLOATING_FRAME),
        "arms as separate sub-domains": FlexibleBody(points, Method.MODAL_ROTATION),
        "tree: arms and beam": FlexibleBody(tree, Method.FRAMES),
        "cut in the middle": FlexibleBody(halves, Method.FRAMES),
        "cut, second order": FlexibleBody(halves),
    }


def main(folder: Path, report: Reporter) -> None:
    """Draw a figure for each case and print the errors at the largest load."""
    folder.mkdir(parents=True, exist_ok=True)
    bodies = models(folder, report)
    print("| | " + " | | ".join(words for _, words in CASES.values()) + " | |\n" + "|---" * (1 + 2 * len(CASES)) + "|")
    rows: dict[str, list[str]] = {label: [] for label in bodies}
    for case, (axis, words) in CASES.items():
        reference = read_reference(HERE / "calculix" / f"{case}.csv", axis)
        expected = align(reference.motion)
        figure, panels = plt.subplots(1, 2, figsize=(8.0, 4.6), layout="constrained")
        for label, body in bodies.items():
            motion = solve(body, reference)
            found = align(motion)
            off = np.linalg.norm(motion[-1, :, :3] - reference.motion[-1, :, :3], axis=1).max()
            size = np.linalg.norm(reference.motion[-1, :, :3], axis=1).max()
            toe = [f.toe[-1] - e.toe[-1] for f, e in zip(found, expected, strict=True)]
            rows[label] += [f"{100 * off / size:.2g} %", f"{toe[0]:+.2f}, {toe[1]:+.2f}"]
            for panel, wheel in zip(panels, found, strict=True):
                panel.plot(wheel.toe, 1e3 * wheel.travel, label=label, **STYLES[label])
        for panel, wheel, name in zip(panels, expected, ("left", "right"), strict=True):
            panel.plot(
                wheel.toe, 1e3 * wheel.travel, "ko", markersize=3.5, fillstyle="none", label="CalculiX, nonlinear"
            )
            panel.set_xlabel(f"toe-in of the {name} wheel / degrees")
            panel.grid(alpha=0.25)
        panels[0].set_ylabel("wheel travel / mm")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
        figure.suptitle(words, fontsize="medium")
        figure.savefig(folder / f"rear_axle_case_{case}.png", dpi=160)
        plt.close(figure)
    for label, cells in rows.items():
        print(f"| {label} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output/rear_axle"), help="folder for figures")
    main(parser.parse_args().output, ConsoleReporter())
