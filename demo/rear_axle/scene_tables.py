"""Rear axle: the tables of results that scene.toml takes, from CalculiX and from a tight model of the cut body.

Run from the repository's root: python -m demo.rear_axle.scene_tables
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.store import Store, default_folder

HERE = Path(__file__).parent
WHEELS = ("wheel_left", "wheel_right")
COLUMNS = tuple(f"{wheel}.{kind}.{axis}" for wheel in WHEELS for kind in ("displacement", "rotation") for axis in "xyz")
KEPT = tuple(f"{wheel}_{axis}_{unit}" for wheel in WHEELS for axis, unit in (
    ("ux", "m"), ("uy", "m"), ("uz", "m"), ("rx", "rad"), ("ry", "rad"), ("rz", "rad")
))  # fmt: skip
# Table of CalculiX's results, and the column of its load.
STATIC = {"left": "force_N", "side": "force_N", "opposite": "wheel_left_fz_N"}
# The tight model: modes of each part, error of an internal step; and the load (N), duration and step (s) of `sudden`.
MODES, TOLERANCE = 40, 1e-6
FORCE, DURATION, STEP = 800.0, 0.12, 1e-3


def static_table(name: str) -> str:
    """Text of a static case's table: factors of the largest load, without the unloaded row."""
    table = np.genfromtxt(HERE / "calculix" / f"{name}.csv", delimiter=",", names=True)
    load = table[STATIC[name]]
    lines = [f"# CalculiX 2.20, calculix/{name}.csv", ",".join(["factor", *COLUMNS])]
    for factor, row in zip(load / load[-1], table, strict=True):
        if factor > 0.0:
            lines.append(",".join([f"{factor:.12g}", *(f"{row[column]:.8g}" for column in KEPT)]))
    return "\n".join(lines) + "\n"


def sudden_table() -> str:
    """Text of the table of the sudden load."""
    config = read_body_file(HERE / "body.toml")
    config = config.model_copy(update={"reduction": config.reduction.model_copy(update={"modes": MODES})})
    body = FlexibleBody(
        reduce_body(config, ConsoleReporter(), Store(default_folder())), limits=StepLimits(tolerance=TOLERANCE)
    )
    state, load = body.rest(), {"wheel_left": [0.0, 0.0, FORCE]}
    title = (
        f"# body.toml with {MODES} modes a part, internal steps to {TOLERANCE:g}: {body.model.mode_count} coordinates"
    )
    lines = [title, ",".join(["time", *COLUMNS])]
    for number in range(round(DURATION / STEP) + 1):
        if number:
            state = body.step(state, load, STEP)
        lines.append(",".join(f"{value:.7g}" for value in (number * STEP, *body.motion(state))))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write all tables."""
    for name in STATIC:
        (HERE / "scene" / f"{name}.csv").write_text(static_table(name), encoding="utf-8")
    (HERE / "scene" / "sudden.csv").write_text(sudden_table(), encoding="utf-8")


if __name__ == "__main__":
    main()
