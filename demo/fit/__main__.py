"""Fit a model to each of four scenes, and print what was found as a Markdown table: the one of demo/fit/README.md.

Run from the repository's root: python -m demo.fit [--output FOLDER] [SCENE ...]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from demo.fit.scenes import DEMONSTRATIONS, Outcome, run

from flexfmu.files.console import ConsoleReporter
from flexfmu.files.store import Store
from flexfmu.study.scene.reference import SceneErrors

HEAD = (
    "scene",
    "as given: modes, frames",
    "found: modes, frames, method",
    "error / tolerance, expected",
    "against CalculiX",
    "as given",
    "step: given, found",
    "search, s",
)


def in_percent(found: SceneErrors) -> str:
    """Largest relative errors."""
    statics = found.static_displacement, found.static_rotation
    motion = found.transient_displacement, found.transient_rotation
    u, r = statics if not np.isnan(statics[0]) else motion
    return f"{100.0 * u:.2g} %, {100.0 * r:.2g} %"


def faster(given: float, found: float) -> str:
    """Times of a step as given and found, and their ratio."""
    unit, size = ("ms", 1e3) if given > 1e-3 else ("µs", 1e6)
    return f"{size * given:.3g}, **{size * found:.3g}** {unit}: {given / found:.2g} ×"


def row(title: str, outcome: Outcome) -> list[str]:
    """A row of the table."""
    fit, toe = outcome.fit, ["", ""]
    if not np.isnan(outcome.toe):
        toe = [f", toe {outcome.toe:.2g}°", f", toe {outcome.given_toe:.2g}°"]
    return [
        title,
        f"{fit.given_mode_count}, {fit.given_frame_count}",
        f"**{fit.mode_count}, {fit.frame_count}**, {fit.variant.words}",
        f"{fit.measured.share:.2f}",
        f"**{outcome.calculix.share:.2f}** ({in_percent(outcome.calculix)}{toe[0]})",
        f"{outcome.given.share:.2f} ({in_percent(outcome.given)}{toe[1]})",
        faster(fit.given_step, fit.step),
        f"{fit.seconds:.0f}",
    ]


def main(folder: Path, names: list[str]) -> None:
    """Fit, and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    # Nothing from earlier runs, so that the times of the searches are those of a first one.
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as kept:
        for name in names or list(DEMONSTRATIONS):
            outcome, target = run(name, folder, ConsoleReporter(), Store(Path(kept) / name))
            print("\n".join([f"{target}", *outcome.fit.summary]), flush=True)
            rows.append(row(DEMONSTRATIONS[name].title, outcome))
    print("\n| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    for cells in rows:
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output/fit"))
    parser.add_argument("scenes", nargs="*", choices=[[], *DEMONSTRATIONS], default=[])
    arguments = parser.parse_args()
    main(arguments.output, arguments.scenes)
