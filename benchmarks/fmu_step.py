"""What a step of an FMU costs against the empty pythonfmu slave of the same variables, in one run.

Run from the repository's root: python -m benchmarks.fmu_step [--output FILE.csv]. Both are driven by fmpy: set all
inputs, step, get all outputs. Prints a table and writes the records that it is made of.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path

from .records import write_records

HERE = Path(__file__).parent
ROOT = HERE.parent
BLOCKS, STEPS = 15, 200
STEP = 1e-3
# 24 inputs and 48 outputs.
INTERFACES = {"tip": "TIP", "a": "SEG2", "b": "SEG4", "c": "SEG6"}
MODES, FRAMES = 20, 8
# N along y at every interface, growing and falling: bends the beam by some 5 % of its length.
FORCE = 500.0


@dataclass(frozen=True)
class Record:
    """One method's cost.

    Attributes
    ----------
    method : str
        "" for the empty slave.
    runtime : str
        Of the FMU: "native" or "python".
    median, fastest : float
        s per step, of blocks of steps.
    iterations : float
        Rounds of the implicit iteration per step.
    ratio : float
        Median over that of the empty slave, measured just before and just after.
    """

    method: str
    runtime: str
    median: float
    fastest: float
    iterations: float
    ratio: float


def build_body(folder: Path) -> dict[str, Path]:
    """The clamped beam with four interfaces: its FMU by runtime."""
    from flexfmu.build.config import read_body_file
    from flexfmu.build.reduce import reduce_body
    from flexfmu.build.tables import InterfaceTable, OutputTable
    from flexfmu.files.outputs import Reporter
    from flexfmu.fmu.description import Runtime
    from flexfmu.fmu.package import package_fmu

    config = read_body_file(ROOT / "demo" / "clamped_beam" / "body.toml")
    stored = {"geometric_stiffness": ["by_load", "by_mode"], "second_order": True}
    reduction = config.reduction.model_copy(update={"modes": MODES, **stored})
    changes = {
        "interface": [InterfaceTable(name=name, nodes=nodes) for name, nodes in INTERFACES.items()],
        "reduction": reduction,
        "frames": FRAMES,
        "output": OutputTable(velocities=True),
    }
    body = reduce_body(config.model_copy(update=changes), Reporter())
    paths = {runtime.value: folder / f"{runtime.value}.fmu" for runtime in Runtime}
    for runtime in Runtime:
        package_fmu(body, paths[runtime.value], runtime)
    return paths


def build_empty(folder: Path, inputs: list[str], outputs: list[str]) -> Path:
    """An FMU by pythonfmu alone that has the variables and does nothing."""
    from pythonfmu.builder import FmuBuilder

    script = folder / "emptyslave.py"
    script.write_text(
        "from pythonfmu import Fmi2Causality, Fmi2Slave, Real\n\n\n"
        "def zero():\n    return 0.0\n\n\ndef ignore(value):\n    pass\n\n\n"
        "class EmptySlave(Fmi2Slave):\n"
        "    def __init__(self, **kwargs):\n"
        "        super().__init__(**kwargs)\n"
        f"        self.inputs, self.outputs = [0.0] * {len(inputs)}, [0.0] * {len(outputs)}\n"
        f"        for name in {inputs!r}:\n"
        "            variable = Real(name, causality=Fmi2Causality.input, start=0.0, getter=zero, setter=ignore)\n"
        "            self.register_variable(variable)\n"
        f"        for name in {outputs!r}:\n"
        "            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=zero))\n\n"
        "    def get_real(self, vrs):\n"
        "        return self.outputs[: len(vrs)]\n\n"
        "    def set_real(self, vrs, values):\n"
        "        self.inputs[: len(vrs)] = values\n\n"
        "    def do_step(self, current_time, step_size):\n"
        "        return True\n",
        encoding="utf-8",
    )
    return Path(FmuBuilder.build_FMU(script, dest=folder))


def compiled(folder: Path, source: str, name: str, *flags: str) -> Path:
    """A program or library from one of the C files beside this one."""
    target = folder / name
    command = ["cc", "-O2", "-std=c99", str(HERE / source), "-o", str(target), *flags]
    subprocess.run(command, check=True)
    return target


def empty_native(folder: Path, like: Path) -> Path:
    """The FMU `like` with a library that does nothing."""
    library = compiled(folder, "empty.c", "empty.so", "-shared", "-fPIC")
    target = folder / "empty_native.fmu"
    with zipfile.ZipFile(like) as source, zipfile.ZipFile(target, "w") as archive:
        for name in source.namelist():
            data = library.read_bytes() if name.startswith("binaries/linux64/") else source.read(name)
            archive.writestr(name, data)
    return target


def drive(fmu: str, choices: dict[str, str]) -> dict[str, float]:
    """Time blocks of steps of one FMU, in a process of its own."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    description = fmpy.read_model_description(fmu)
    folder = fmpy.extract(fmu)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="timed",
    )
    slave.instantiate()
    variables = {v.name: v.valueReference for v in description.modelVariables}
    for name, value in choices.items():
        slave.setString([variables[name]], [value])
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    references = [v.valueReference for v in inputs]
    outputs = [v.valueReference for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    share = [1.0 if v.name.endswith("force.y") else 0.0 for v in inputs]
    number, times, rounds = 0, [], 0
    for _ in range(BLOCKS):
        values = []
        for k in range(number, number + STEPS):
            force = FORCE * (1.0 - abs((k / 400) % 2.0 - 1.0))
            values.append([force * s for s in share])
        start = time.perf_counter()
        for row in values:
            slave.setReal(references, row)
            slave.doStep(currentCommunicationPoint=number * STEP, communicationStepSize=STEP)
            slave.getReal(outputs)
            number += 1
        times.append((time.perf_counter() - start) / STEPS)
        if "diagnostics.iterations" in variables:
            rounds += slave.getInteger([variables["diagnostics.iterations"]])[0]
    return {"median": statistics.median(times), "fastest": min(times), "iterations": rounds / BLOCKS}


def in_process(fmu: Path, choices: dict[str, str]) -> dict[str, float] | None:
    """Result of `drive` in a fresh process; None where the FMU refuses the choices."""
    command = [sys.executable, "-m", "benchmarks.fmu_step", "--drive", str(fmu), json.dumps(choices)]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=ROOT)
    lines = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    return json.loads(lines[-1].removeprefix("RESULT ")) if lines else None


def empty_slave(fmu: Path) -> dict[str, float]:
    """Result of `drive` for the empty slave."""
    found = in_process(fmu, {})
    if found is None:
        raise SystemExit("the empty slave does not run")
    return found


def measure(output: Path) -> list[Record]:
    """Build everything, time everything, write the records."""
    import fmpy

    from flexfmu.model.methods import Method

    records: list[Record] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmus = build_body(folder)
        variables = fmpy.read_model_description(str(next(iter(fmus.values())))).modelVariables
        inputs = [v.name for v in variables if v.causality == "input"]
        outputs = [v.name for v in variables if v.causality == "output" and v.type == "Real"]
        empty = build_empty(folder, inputs, outputs)
        print(f"{len(inputs)} inputs, {len(outputs)} outputs, {MODES} modes, {FRAMES} frames, steps of {STEP} s\n")
        base = empty_slave(empty)
        records.append(Record("", "python", base["median"], base["fastest"], 0.0, 1.0))
        print("| method | runtime | µs | of the empty slave | rounds |")
        print("|---|---|---|---|---|")
        print(f"| empty slave | python | {1e6 * base['median']:.0f} | 1.0 | |")
        for method in Method:
            for runtime, fmu in fmus.items():
                found = in_process(fmu, {"method": method.value})
                if found is None:
                    continue
                before, base = base, empty_slave(empty)
                ratio = 2.0 * found["median"] / (before["median"] + base["median"])
                own = found["median"], found["fastest"], found["iterations"]
                records.append(Record(method.value, runtime, *own, ratio))
                print(
                    f"| `{method.value}` | {runtime} | {1e6 * own[0]:.0f} | {ratio:.1f} | {own[2]:.1f} |",
                    flush=True,
                )
    write_records(output, map(asdict, records))
    return records


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("fmu_step.csv"))
    parser.add_argument("--drive", nargs=2, metavar=("FMU", "CHOICES"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.drive:
        print("RESULT " + json.dumps(drive(arguments.drive[0], json.loads(arguments.drive[1]))), flush=True)
        os._exit(0)
    measure(arguments.output)


if __name__ == "__main__":
    main()
