"""L-frame: bending and twisting out of its plane, bending in it; FMUs through fmpy against CalculiX.

Run from the repository's root: python -m demo.l_frame.run [--output FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from demo.fmu_study import (
    build_variants,
    draw_against_load,
    print_table,
    reference,
    relative_error,
    static_tip,
)

from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import Reporter

HERE = Path(__file__).parent
FRAMES = (1, 3, 8)
# Case, direction of the force, the components worth a figure and what to call it.
CASES = (
    ("static_z", np.array([0.0, 0.0, 1.0]), "xyz", "out of plane (bending and torsion)"),
    ("static_x", np.array([1.0, 0.0, 0.0]), "xy", "in the plane (bending)"),
)


def main(folder: Path, report: Reporter) -> dict[str, dict[str, float]]:
    """Run the demo; returns the error of each model at the largest load of each case."""
    folder.mkdir(parents=True, exist_ok=True)
    variants = build_variants(HERE / "body.toml", folder, FRAMES, report)
    errors: dict[str, dict[str, float]] = {}
    for case, direction, components, words in CASES:
        table = reference(HERE / "calculix" / f"{case}.csv")
        expected = np.stack([table["ux_m"], table["uy_m"], table["uz_m"]], axis=1)
        with report.stage(f"Drive the FMUs statically, {words}"):
            motion = {v.label: static_tip(v, np.outer(table["force_N"], direction)) for v in variants}
        shown = [len(table) // 2, len(table) - 1]
        print_table(
            f"L-frame, dead tip force {words}",
            table["force_N"][shown],
            expected[shown],
            {label: values[shown] for label, values in motion.items()},
        )
        for axis in components:
            number = "xyz".index(axis)
            draw_against_load(
                folder / f"{case}_tip_{axis}.png",
                table["force_N"],
                {label: values[:, number] for label, values in motion.items()},
                variants,
                (table["force_N"], expected[:, number]),
                ("tip force / kN", f"tip displacement in {axis.upper()} / mm"),
            )
        errors[case] = {
            label: float(relative_error(values[-1:, :3], expected[-1:])[0]) for label, values in motion.items()
        }
    print(f"\nFMUs and figures are in {folder}")
    return errors


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output/l_frame"), help="folder for FMUs and figures")
    main(parser.parse_args().output, ConsoleReporter())
