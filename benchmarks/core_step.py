"""What a step of a native FMU costs from a C program, against an empty native FMU and the empty pythonfmu one.

Run from the repository's root: python -m benchmarks.core_step [--output FILE.csv]. Set inputs, step, get outputs:
24 inputs and 48 outputs (four interfaces with velocities), 20 modes; and one interface. A build of the core with
FLEX_COUNT counts the floating-point operations of products and rotations. Needs a C compiler and Linux.
Prints a table and writes the records that it is made of.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import fmpy

from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import DampingTable, FormulationTable, InterfaceTable, OutputTable
from flexfmu.core import building
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import ReducedBody

from .fmu_step import INTERFACES, build_empty, compiled, empty_native
from .records import write_records

HERE = Path(__file__).parent
ROOT = HERE.parent
MODES = 20
STEP = 1e-3
PASSES = 3
# N along y at every interface, growing and falling: bends the beam by some 5 % of its length.
FORCE = 500.0


@dataclass(frozen=True)
class Record:
    """One FMU's cost.

    Attributes
    ----------
    what : str
    inputs, outputs : int
    median, fastest : float
        s per step, of blocks of steps.
    iterations : float
        Rounds of the implicit iteration in a step.
    operations : float
        Floating-point operations of a step; zero where nobody counts.
    """

    what: str
    inputs: int
    outputs: int
    median: float
    fastest: float
    iterations: float
    operations: float

    @property
    def rate(self) -> float:
        """Operations a second of the fastest block."""
        return self.operations / self.fastest


def beam(interfaces: dict[str, str], frames: int, method: Method = Method.FRAMES, **wanted: object) -> ReducedBody:
    """The clamped beam with some interfaces and frames, and the data that methods timed here need."""
    config = read_body_file(ROOT / "demo" / "clamped_beam" / "body.toml")
    wanted = {"modes": MODES, "second_order": True} | wanted
    changes = {
        "interface": [InterfaceTable(name=name, nodes=nodes) for name, nodes in interfaces.items()],
        "reduction": config.reduction.model_copy(update=wanted),
        "frames": frames,
        "frame": [],
        "damping": DampingTable(ratio=0.01),
        "output": OutputTable(velocities=True),
        "formulation": FormulationTable(method=method),
    }
    return reduce_body(config.model_copy(update=changes), Reporter(), Store())


class Driver:
    """The C program that drives an FMU's library.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._program = compiled(folder, "drive.c", "drive", "-ldl")
        self._counting = folder / "counting.so"
        subprocess.run(building.command(["cc"], self._counting, extra=["-DFLEX_COUNT"]), check=True)

    def time(self, fmu: Path, what: str, method: str = "", force: float = FORCE) -> Record:
        """Time one FMU with one of its methods."""
        description = fmpy.read_model_description(str(fmu), validate=False)
        place = self._folder / fmu.stem
        if not place.exists():
            with zipfile.ZipFile(fmu) as archive:
                archive.extractall(place)
        variables = {v.name: v.valueReference for v in description.modelVariables}
        counts = [sum(v.causality == kind for v in description.modelVariables) for kind in ("input", "output")]
        library = place / "binaries" / "linux64" / f"{description.coSimulation.modelIdentifier}.so"
        choice = f"{variables['method']}={method}" if method else ""
        rounds = variables.get("diagnostics.iterations", 0)
        words = [description.guid, f"file://{place}/resources", choice, *counts, STEP, force, rounds]
        python = (place / "resources" / "slavemodule.txt").exists()
        median, fastest, iterations, _ = self._run(what, library, words, python)
        operations = 0.0 if python or not method else self._run(what, self._counting, words, python)[3]
        return Record(what, *counts, median, fastest, iterations, operations)

    def _run(self, what: str, library: Path, words: list[object], python: bool) -> list[float]:
        environment = {"LD_PRELOAD": _libpython()} if python else None
        command = list(map(str, [self._program, library, *words]))
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        if done.returncode:
            raise SystemExit(f"{what} does not run: {done.stderr}")
        return [float(word) for word in done.stdout.split()]


def _libpython() -> str:
    """Python's library, which a process that is no Python has to load before pythonfmu's."""
    folder, name = sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("LDLIBRARY")
    return str(Path(folder) / name) if name and name.endswith(".so") else ""


def beams(folder: Path) -> list[tuple[str, Path, str]]:
    """Names, FMUs and methods of beams with constant mass, and of the default."""
    cases = []
    for label, interfaces in (("4 interfaces", INTERFACES), ("1 interface", {"tip": "TIP"})):
        for frames in (8, 2):
            fmu = folder / f"beam{frames}_{len(interfaces)}.fmu"
            package_fmu(beam(interfaces, frames), fmu)
            if frames == 8:
                cases.append((f"linear, {label}", fmu, "linear"))
            cases.append((f"frames, {frames} frames, {label}", fmu, "frames"))
            cases.append((f"second_order, {frames} frames, {label}", fmu, "second_order"))
        usual = folder / f"usual_{len(interfaces)}.fmu"
        package_fmu(beam(interfaces, 2, Method.SECOND_ORDER), usual)
        cases.append((f"second_order, 2 frames, mass polynomial, {label}", usual, "second_order"))
    return cases


def measure(output: Path) -> None:
    """Build everything, time everything in turns with the empty native FMU, write the records."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        driver = Driver(folder)
        cases = beams(folder)
        every = folder / "every_method.fmu"
        package_fmu(beam(INTERFACES, 8, geometric_stiffness=["by_load", "by_mode"]), every)
        others = [one for one in Method if one not in (Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER)]
        cases += [(f"{one.value}, 8 frames, 4 interfaces", every, one.value) for one in others]
        for frames in (8, 2):
            body = beam(INTERFACES, frames, inertia=True)
            for method in (Method.FRAMES, Method.SECOND_ORDER):
                heavy = folder / f"heavy_{method.value}_{frames}.fmu"
                package_fmu(replace(body, method=method, mass=Mass.CONFIGURATION), heavy)
                what = f"{method.value}, {frames} frames, deformed body's mass, 4 interfaces"
                cases.append((what, heavy, method.value))
        axle = folder / "axle.fmu"
        config = read_body_file(ROOT / "demo" / "rear_axle" / "body.toml")
        package_fmu(reduce_body(config, Reporter(), Store()), axle)
        cases.append(("rear axle, cut, second_order, 86 coordinates", axle, "second_order"))
        lean = config.reduction.model_copy(update={"modes": 2})
        few = folder / "axle_few.fmu"
        package_fmu(
            reduce_body(config.model_copy(update={"reduction": lean, "frame": [], "frames": 1}), Reporter(), Store()),
            few,
        )
        cases.append(("rear axle, cut, second_order, one frame a part", few, "second_order"))

        nothing = empty_native(folder, cases[0][1])
        records = [driver.time(nothing, "empty native FMU")]
        description = fmpy.read_model_description(str(cases[0][1]))
        names = [[v.name for v in description.modelVariables if v.causality == kind] for kind in ("input", "output")]
        if _libpython():
            empty = build_empty(folder, *names)
            cases.append(("empty pythonfmu FMU", empty, ""))
            python = folder / "python.fmu"
            package_fmu(beam(INTERFACES, 8), python, Runtime.PYTHON)
            cases.append(("frames, 8 frames, 4 interfaces, --runtime python", python, "frames"))
        # In turns, since other programs disturb a machine for a while.
        passes = [[driver.time(fmu, what, method) for what, fmu, method in cases] for _ in range(PASSES)]
        records += [min(found, key=lambda record: record.fastest) for found in zip(*passes, strict=True)]
    print("| | inputs, outputs | µs, median | µs, least | rounds | kflop | Gflop/s | over empty: native | pythonfmu |")
    print("|---|---|---|---|---|---|---|---|---|")
    still = {record.what: record.fastest for record in records}
    slave = still.get("empty pythonfmu FMU", float("nan"))
    for r in records:
        times = f"{1e6 * r.median:.3g} | {1e6 * r.fastest:.3g}"
        work = f"{1e-3 * r.operations:.3g} | {1e-9 * r.rate:.3g}"
        ratios = f"{r.fastest / still['empty native FMU']:.3g} | {r.fastest / slave:.2g}"
        print(f"| {r.what} | {r.inputs}, {r.outputs} | {times} | {r.iterations:.1f} | {work} | {ratios} |")
    write_records(output, [asdict(record) | {"rate": record.rate} for record in records])


def main() -> None:
    """Run as a script."""
    if sys.platform != "linux":
        raise SystemExit("the driver is written for Linux")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("core_step.csv"))
    measure(parser.parse_args().output)


if __name__ == "__main__":
    main()
