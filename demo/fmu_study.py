"""What the demos share: building FMUs of a body, driving them, comparing, drawing."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy
import matplotlib
import numpy as np
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FormulationTable
from flexfmu.files.figures import BLUE, GREEN, ORANGE, SKY, VERMILION
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

FloatArray = NDArray[np.float64]
AXES = ("x", "y", "z")
# One look for each number of frames, in every figure.
STYLES: dict[int, dict[str, object]] = {
    1: {"color": SKY, "linestyle": "--"},
    3: {"color": ORANGE, "linestyle": "-."},
    8: {"color": BLUE, "linestyle": "-"},
}
LINEAR = {"method": "linear"}
SECOND_ORDER_FRAMES = 2


@dataclass(frozen=True, slots=True)
class Variant:
    """A model that is compared: an FMU and the parameters that it is started with."""

    label: str
    fmu: Path
    parameters: dict[str, str]
    style: dict[str, object]


def reference(path: Path) -> NDArray[np.void]:
    """Table of a CalculiX result: columns by name."""
    return np.genfromtxt(path, delimiter=",", names=True)


def build_variants(body_file: Path, folder: Path, frames: Sequence[int], report: Reporter) -> list[Variant]:
    """FMUs of one body: `frames` with some numbers of them, the first serving for `linear` too, and `second_order`."""
    config = read_body_file(body_file)
    variants = []
    for count in frames:
        fmu = folder / f"{config.name}_{count}.fmu"
        package_fmu(reduce_body(config.model_copy(update={"frames": count}), report), fmu)
        label = f"{count} frame" + ("s" if count > 1 else "")
        variants.append(Variant(label, fmu, {}, STYLES[count]))
    linear = Variant("linear modes", variants[0].fmu, LINEAR, {"color": "0.55", "linestyle": ":"})
    second = config.model_copy(
        update={"frames": SECOND_ORDER_FRAMES, "formulation": FormulationTable(method=Method.SECOND_ORDER)}
    )
    fmu = folder / f"{config.name}_second_order.fmu"
    package_fmu(reduce_body(second, report), fmu)
    label = f"{SECOND_ORDER_FRAMES} frames, second order"
    return [linear, *variants, Variant(label, fmu, {}, {"color": VERMILION, "linestyle": "--"})]


def static_tip(variant: Variant, forces: FloatArray) -> FloatArray:
    """Tip displacement (n, 3) and rotation vector (n, 3) side by side, in equilibrium under tip forces (n, 3).

    For each force the FMU is initialised anew with initialization = "static"; no time passes.
    """
    description = fmpy.read_model_description(str(variant.fmu))
    references = {v.name: v.valueReference for v in description.modelVariables}
    inputs = [references[f"tip.force.{axis}"] for axis in AXES]
    outputs = [references[f"tip.{kind}.{axis}"] for kind in ("displacement", "rotation") for axis in AXES]
    folder = fmpy.extract(str(variant.fmu))
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName=variant.label,
    )
    slave.instantiate(loggingOn=True)
    result = np.empty((len(forces), 6))
    for k, force in enumerate(forces):
        if k:
            slave.reset()
        settings = {"initialization": "static", **variant.parameters}
        slave.setString([references[name] for name in settings], list(settings.values()))
        slave.setReal(inputs, list(force))
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        result[k] = slave.getReal(outputs)
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    return result


def relative_error(found: FloatArray, expected: FloatArray) -> FloatArray:
    """|found − expected| / |expected| of each row (n, 3)."""
    return np.linalg.norm(found - expected, axis=1) / np.linalg.norm(expected, axis=1)


def print_table(title: str, forces: FloatArray, expected: FloatArray, found: dict[str, FloatArray]) -> None:
    """Tip displacement and its error against CalculiX under a few forces (N)."""
    print(f"\n{title}\nerror = |tip displacement − CalculiX| / |CalculiX|\n")
    print(f"{'force':>8} {'model':<23} {'x / m':>11} {'y / m':>11} {'z / m':>11} {'error':>9}")
    for k, force in enumerate(forces):
        print(f"{force / 1e3:5.1f} kN {'CalculiX':<23} " + " ".join(f"{u + 0.0:11.5f}" for u in expected[k]))
        for label, motion in found.items():
            error = relative_error(motion[k : k + 1, :3], expected[k : k + 1])[0]
            # Round-off of a component that is zero by symmetry is not worth a minus sign.
            numbers = " ".join(f"{round(float(u), 9) + 0.0:11.5f}" for u in motion[k, :3])
            print(f"{'':>8} {label:<23} {numbers} {100 * error:7.3f} %")


def draw_against_load(
    path: Path,
    forces: FloatArray,
    curves: dict[str, FloatArray],
    variants: Sequence[Variant],
    expected: tuple[FloatArray, FloatArray],
    labels: tuple[str, str],
) -> None:
    """One displacement component (m) against load (N), models as lines and CalculiX as points."""
    figure, axes = plt.subplots(figsize=(4.8, 4.1), layout="constrained")
    for variant in variants:
        axes.plot(forces / 1e3, 1e3 * curves[variant.label], label=variant.label, **variant.style)
    axes.plot(expected[0] / 1e3, 1e3 * expected[1], "o", color="k", markersize=4, fillstyle="none", label="CalculiX")
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.grid(alpha=0.25)
    figure.legend(loc="outside upper center", ncols=2, fontsize="small", frameon=False)
    figure.savefig(path, dpi=160)
    plt.close(figure)


def draw_shapes(path: Path, body: FlexibleBody, force: dict[str, list[float]], tip: FloatArray, title: str) -> None:
    """Draw the body in the x-y plane at true scale, linear and with frames, and CalculiX's path (n, 2) of its tip."""
    surface = body.model.surface
    if surface is None:
        raise ValueError("the body was built without its surface: set surface = true in [output]")
    linear = FlexibleBody(body.model, Method.LINEAR)
    shapes = (
        ("undeformed", "0.88", surface.points),
        ("linear modes", "0.6", linear.surface_positions(linear.static(force))),
        (f"{body.model.frame_count} frames", GREEN, body.surface_positions(body.static(force))),
    )
    figure, axes = plt.subplots(figsize=(6.8, 3.6), layout="constrained")
    for label, color, points in shapes:
        faces = points[surface.faces][:, :, :2]
        axes.add_collection(PolyCollection(list(faces), facecolor=color, edgecolor=color, label=label))
    axes.plot(*tip.T, "o", color="k", markersize=4, fillstyle="none", label="CalculiX, path of the tip")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    axes.set_title(title, fontsize="medium")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(path, dpi=160)
    plt.close(figure)
