"""The rear axle with more than 300 000 degrees of freedom, from the mesh to the FMU: time and memory of every stage.

Meshes; builds modes, frames, modal file and FMU of the body in one piece; builds again with other frames, which takes
the modes from the store; builds the body as body.toml has it, cut in the middle of its cross-beam. Steps the FMUs and
solves the static cases that CalculiX solved on the same mesh. Prints a Markdown table. Needs 10 GB and
some minutes. Run from the repository's root: python -m demo.rear_axle.full_size [--output FOLDER] [--size coarse]
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import resource
import shutil
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from demo.rear_axle import make_mesh
from demo.rear_axle.run import read_reference, solve
from fmpy.fmi2 import FMU2Slave

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FormulationTable, MeshTable
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method
from flexfmu.model.modal_file import read_modal_file, write_modal_file

HERE = Path(__file__).parent
# Direction of a force that the table calls only force_N, and words.
STATIC_CASES = {
    "left": ("z", "1.8 kN at the left wheel"),
    "side": ("y", "7 kN of side force"),
    "opposite": ("z", "±2.4 kN"),
}
# Stages shorter than this count in the sum only, s.
SHORT = 0.5
STEP, STEPS, FORCE = 1e-3, 2000, 1500.0


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage: seconds, those of the processor, and the process's peak of memory until its end, GiB."""

    title: str
    seconds: float
    processor: float
    peak: float


def peak_memory() -> float:
    """Peak of this process's memory, GiB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


@dataclass
class StageRecorder(Reporter):
    """Keeps time and memory of each stage, and the notes."""

    stages: list[Stage] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:
        """Measure a stage."""
        print(f"… {title}", file=sys.stderr, flush=True)
        begun, spent = time.perf_counter(), time.process_time()
        yield
        self.stages.append(Stage(title, time.perf_counter() - begun, time.process_time() - spent, peak_memory()))

    def note(self, text: str) -> None:
        """Keep what was found or chosen."""
        self.notes.append(text)


def apart(job: Callable[..., Any], *arguments: object) -> Any:
    """Do a job in a process of its own, so that its peak of memory is its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(job, *arguments).result()


def mesh(deck: Path, size: str) -> StageRecorder:
    """Write the deck."""
    report = StageRecorder()
    with report.stage("Mesh and write the deck"):
        make_mesh.write(deck, make_mesh.build(make_mesh.SIZES[size]))
    return report


def build(deck: Path, folder: Path, name: str, frames: int | None, cut: bool = False) -> StageRecorder:
    """Build modal file and FMU; `frames`: automatic ones instead of the body file's."""
    report = StageRecorder()
    config = read_body_file(HERE / "body.toml").model_copy(update={"mesh": MeshTable(file=deck)})
    if not cut:
        # What the loop is off by, the second order does not mend.
        config = config.model_copy(update={"cut": [], "formulation": FormulationTable(method=Method.FRAMES)})
    if frames is not None:
        config = config.model_copy(update={"frame": [], "frames": frames})
    body = reduce_body(config, report, Store(folder / "store"))
    with report.stage("Write the modal file"):
        write_modal_file(body, folder / f"{name}.h5")
    with report.stage("Write the FMU"):
        package_fmu(body, folder / f"{name}.fmu")
    return report


def step_cost(fmu: Path) -> tuple[float, float]:
    """Median seconds of a step with its inputs and outputs, and the largest travel of the left wheel, m."""
    description = fmpy.read_model_description(str(fmu))
    folder = fmpy.extract(str(fmu))
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="timed",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    references = {v.name: v.valueReference for v in description.modelVariables}
    force = [references["wheel_left.force.z"]]
    outputs = [v.valueReference for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    rise, times, travel = outputs.index(references["wheel_left.displacement.z"]), [], 0.0
    for number in range(STEPS):
        begun = time.perf_counter()
        slave.setReal(force, [FORCE * np.sin(10.0 * number * STEP)])
        slave.doStep(currentCommunicationPoint=number * STEP, communicationStepSize=STEP)
        values = slave.getReal(outputs)
        times.append(time.perf_counter() - begun)
        travel = max(travel, abs(values[rise]))
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    return statistics.median(times), travel


def statics(modal_file: Path) -> dict[str, tuple[float, float]]:
    """Seconds of an equilibrium and relative error of the displacement at the largest load, by case."""
    body = FlexibleBody(read_modal_file(modal_file))
    found = {}
    for case, (axis, _) in STATIC_CASES.items():
        reference = read_reference(HERE / "calculix" / f"full_{case}.csv", axis)
        begun = time.perf_counter()
        motion = solve(body, reference)
        seconds = (time.perf_counter() - begun) / len(motion)
        off, size = motion[-1, :, :3] - reference.motion[-1, :, :3], reference.motion[-1, :, :3]
        found[case] = seconds, float(np.linalg.norm(off, axis=1).max() / np.linalg.norm(size, axis=1).max())
    return found


def calculix_effort(case: str) -> tuple[float, str]:
    """Seconds and the words on increments that the head of a kept result tells."""
    head = (HERE / "calculix" / f"full_{case}.csv").read_text(encoding="utf-8")
    match = re.search(r"; ([\d.]+) s wall time on one core[^;]*(?:; (.*))?", head)
    if match is None:
        raise ValueError(f"full_{case}.csv: no line on the wall time in its head")
    return float(match[1]), match[2] or "linear"


def print_build(title: str, report: StageRecorder) -> None:
    """Print the longer stages of a build and the sum of all."""
    for stage in dict.fromkeys(stage.title for stage in report.stages):
        same = [s for s in report.stages if s.title == stage]
        seconds, processor = sum(s.seconds for s in same), sum(s.processor for s in same)
        if seconds > SHORT:
            times = f" ({len(same)} ×)" if len(same) > 1 else ""
            print(f"| {title}: {stage}{times} | {seconds:.1f} | {processor:.1f} | {same[-1].peak:.1f} |")
    for note in report.notes:
        if "earlier build" in note:
            print(f"| {title}: {note} | | | |")
    seconds, processor = sum(s.seconds for s in report.stages), sum(s.processor for s in report.stages)
    print(f"| **{title}, together** | **{seconds:.1f}** | **{processor:.1f}** | **{report.stages[-1].peak:.1f}** |")


def main(folder: Path, size: str) -> None:
    """Run all of it and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    # Nothing is known at first.
    shutil.rmtree(folder / "store", ignore_errors=True)
    deck = folder / f"rear_axle_{size}.inp"
    meshing = apart(mesh, deck, size)
    titles = {"whole": "in one piece", "other": "the same, 4 frames", "cut": "cut in the middle"}
    reports = {name: apart(build, deck, folder, name, 4 if name == "other" else None, name == "cut") for name in titles}
    print(f"\n{reports['whole'].notes[0]}\n\n| | s | of the processor, s | peak until then, GiB |\n|---|---|---|---|")
    print_build("mesh", meshing)
    for name, title in titles.items():
        print_build(title, reports[name])
    for name in ("whole", "cut"):
        seconds, travel = apart(step_cost, folder / f"{name}.fmu")
        words = f"{titles[name]}: a step of {STEP:g} s, left wheel moving by {1e3 * travel:.0f} mm"
        print(f"| {words} | {seconds:.2g} | | |")
        if size == "full":
            for case, (each, error) in apart(statics, folder / f"{name}.h5").items():
                words = f"an equilibrium, {STATIC_CASES[case][1]}, {100 * error:.2g} % off CalculiX"
                print(f"| {titles[name]}: {words} | {each:.2g} | | |")
    if size == "full":
        cases = {case: words for case, (_, words) in STATIC_CASES.items()}
        for case, words in ({"linear_left": "1 kN at the left wheel"} | cases).items():
            wall, effort = calculix_effort(case)
            print(f"| CalculiX, {words}: {effort} | {wall:.0f} | | |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output/rear_axle_full"), help="folder for decks and FMUs")
    parser.add_argument("--size", choices=make_mesh.SIZES, default="full", help="element size (default: full)")
    choice = parser.parse_args()
    main(choice.output, choice.size)
