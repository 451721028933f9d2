"""Clamped beam: builds its FMUs, drives them through fmpy, compares with CalculiX and draws the figures.

Run from the repository's root: python -m demo.clamped_beam.run [--output FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from demo.fmu_study import (
    FloatArray,
    Variant,
    build_variants,
    draw_against_load,
    draw_shapes,
    print_table,
    reference,
    relative_error,
    static_tip,
)

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import OutputTable
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.simulation import simulate

HERE = Path(__file__).parent
FRAMES = (1, 8)
TABLE_FORCES = (2e3, 5e3, 10e3)
SUDDEN_FORCE = 5e3


def main(folder: Path, report: Reporter) -> dict[str, float]:
    """Run the demo; returns the error of each model at 10 kN."""
    folder.mkdir(parents=True, exist_ok=True)
    variants = build_variants(HERE / "body.toml", folder, FRAMES, report)
    errors = statics(folder, variants, report)
    dynamics(folder, variants, report)
    shapes(folder, report)
    print(f"\nFMUs and figures are in {folder}")
    return errors


def statics(folder: Path, variants: list[Variant], report: Reporter) -> dict[str, float]:
    """Tip displacement against load, 0 to 10 kN, dead force across the beam."""
    table = reference(HERE / "calculix" / "static_y.csv")
    table = table[table["force_N"] <= 10e3]
    forces = np.outer(table["force_N"], [0.0, 1.0, 0.0])
    expected = np.stack([table["ux_m"], table["uy_m"], table["uz_m"]], axis=1)
    with report.stage("Drive the FMUs statically, 0 to 10 kN"):
        motion = {variant.label: static_tip(variant, forces) for variant in variants}
    shown = np.flatnonzero(np.isin(table["force_N"], TABLE_FORCES))
    print_table(
        "Clamped beam, dead tip force along y",
        table["force_N"][shown],
        expected[shown],
        {label: values[shown] for label, values in motion.items()},
    )
    for number, axis in enumerate("xy"):
        draw_against_load(
            folder / f"tip_{axis}.png",
            table["force_N"],
            {label: values[:, number] for label, values in motion.items()},
            variants,
            (table["force_N"], expected[:, number]),
            ("tip force / kN", f"tip displacement in {axis.upper()} / mm"),
        )
    return {label: float(relative_error(values[-1:, :3], expected[-1:])[0]) for label, values in motion.items()}


def dynamics(folder: Path, variants: list[Variant], report: Reporter) -> None:
    """Undamped motion after a sudden tip force, against CalculiX's nonlinear transient."""
    table = reference(HERE / "calculix" / "sudden_load.csv")
    expected = np.stack([table["ux_m"], table["uy_m"]], axis=1)
    end = float(table["time_s"][-1])
    loads = np.array([[0.0, SUDDEN_FORCE], [end, SUDDEN_FORCE]])
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(6.4, 4.6), layout="constrained")
    print(
        f"\nSudden tip force of {SUDDEN_FORCE / 1e3:g} kN, undamped, {end:g} s\nrms position error / rms displacement\n"
    )
    for variant in variants:
        settings = {"damping.scale": 0.0, **variant.parameters}
        names, result = simulate(variant.fmu, ["tip.force.y"], loads, step=1e-3, parameters=settings, report=report)
        columns = [1 + names.index(f"tip.displacement.{axis}") for axis in "xy"]
        found: FloatArray = np.stack([np.interp(table["time_s"], result[:, 0], result[:, c]) for c in columns], axis=1)
        error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
        print(f"{variant.label:<23} {100 * error:6.2f} %")
        for panel, column in zip(axes, columns, strict=True):
            panel.plot(1e3 * result[:, 0], 1e3 * result[:, column], label=variant.label, **variant.style)
    for panel, axis, values in zip(axes, "XY", expected.T, strict=True):
        panel.plot(1e3 * table["time_s"], 1e3 * values, color="k", linewidth=0.9, label="CalculiX")
        panel.set_ylabel(f"tip, along {axis} / mm")
        panel.grid(alpha=0.25)
    axes[1].set_xlabel("time / ms")
    axes[0].legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize="small")
    figure.savefig(folder / "sudden_load.png", dpi=160)
    plt.close(figure)


def shapes(folder: Path, report: Reporter) -> None:
    """The beam itself at 20 kN."""
    config = read_body_file(HERE / "body.toml").model_copy(update={"output": OutputTable(surface=True)})
    body = FlexibleBody(reduce_body(config, Reporter()))
    table = reference(HERE / "calculix" / "static_y.csv")
    path = np.stack([1.0 + table["ux_m"], table["uy_m"]], axis=1)[::2]
    force = float(table["force_N"][-1])
    title = f"Clamped beam, 1 m, under a tip force of {force / 1e3:g} kN"
    with report.stage("Draw the deformed beam"):
        draw_shapes(folder / "shape.png", body, {"tip": [0.0, force, 0.0]}, path, title)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output/clamped_beam"), help="folder for FMUs and figures")
    main(parser.parse_args().output, ConsoleReporter())
