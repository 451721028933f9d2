"""FMILibrary's compliance checker on both exports, from an ordinary folder and from one of difficult letters.

Run from the repository's root: python -m benchmarks.compliance CHECKER [--output FILE.csv], where CHECKER is fmuCheck,
built from github.com/modelica-tools/FMUComplianceChecker (2.0.4) with FMILibrary 2.0.3. It checks the description and
every call against the standard, and drives the clamped beam under a constant load for 200 steps; its outputs are
compared with the body's own. FMU, inputs, results and the unpacked FMU lie in the folder under test. Linux.
"""

import argparse
import csv
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy as np

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu

from .records import write_records

ROOT = Path(__file__).parents[1]
STEP, COUNT = 1e-3, 200
LOADS = {"tip.force.x": -500.0, "tip.force.y": 4000.0}
FOLDERS = {"plain": "checked", "difficult": "prüf ung 中 #1"}
COLUMNS = ("checker", "export", "folder", "exit", "warnings", "errors", "difference", "failure")


def libpython() -> Path | None:
    """Python's library, which a process that is no Python has to load before pythonfmu's."""
    path = Path(sysconfig.get_config_var("LIBDIR"), sysconfig.get_config_var("LDLIBRARY"))
    return path if path.suffix == ".so" else None


def by_the_body(body: FlexibleBody) -> np.ndarray:
    """Displacement of the tip after every step."""
    names = [f"tip.{quantity}.{axis}" for quantity in ("force", "moment") for axis in "xyz"]
    state, rows = body.rest(), []
    for _ in range(COUNT):
        state = body.step(state, {"tip": [LOADS.get(name, 0.0) for name in names]}, STEP)
        rows.append(body.response(state).displacement[0])
    return np.array(rows)


def check(checker: Path, fmu: Path, runtime: Runtime, expected: np.ndarray) -> dict[str, object]:
    """What the checker says of an FMU."""
    place = fmu.parent
    inputs, results = place / "loads.csv", place / "results.csv"
    rows = [["time", *LOADS]] + [[time, *LOADS.values()] for time in (0.0, COUNT * STEP)]
    inputs.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n", encoding="utf-8")
    command = [checker, "-h", STEP, "-s", COUNT * STEP, "-n", "0", "-i", inputs, "-o", results, "-t", place, fmu]
    environment = dict(os.environ)
    library = libpython()
    if runtime is Runtime.PYTHON and library:
        environment["LD_PRELOAD"] = str(library)
    done = subprocess.run(list(map(str, command)), capture_output=True, check=False, env=environment)
    said = (done.stdout + done.stderr).decode(errors="replace")
    version = re.search(r"checker (\S+) \[FMILibrary: (\S+)\]", said)
    row: dict[str, object] = {"checker": " / ".join(version.groups()) if version else "", "export": runtime.value}
    row |= {"exit": done.returncode}
    for kind in ("warnings", "errors"):
        counts = re.findall(rf"^\s+(\d+) {kind[:-1]}", said, re.MULTILINE | re.IGNORECASE)
        row[kind] = sum(map(int, counts)) if counts else ""
    try:
        with results.open(encoding="utf-8") as file:
            found = list(csv.DictReader(file))[1:]
        moved = np.array([[float(line[f"tip.displacement.{axis}"]) for axis in "xyz"] for line in found])
        return row | {"difference": f"{np.max(np.abs(moved - expected)):.1e}", "failure": ""}
    except (OSError, ValueError, KeyError):
        wrong = [line for line in said.splitlines() if "FATAL" in line or "ERROR" in line]
        return row | {"difference": "", "failure": (wrong or [f"the process ended with {done.returncode}"])[0]}


def main() -> None:
    """Run as a script."""
    if sys.platform != "linux":
        raise SystemExit("the paths of this check are those of Linux")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checker", type=Path)
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("compliance.csv"))
    options = parser.parse_args()
    reduced = reduce_body(read_body_file(ROOT / "demo" / "clamped_beam" / "body.toml"), Reporter())
    expected = by_the_body(FlexibleBody(reduced))
    rows = []
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as name:
        for label, folder in FOLDERS.items():
            for runtime in Runtime:
                place = Path(name) / runtime.value / folder
                place.mkdir(parents=True)
                package_fmu(reduced, place / "beam.fmu", runtime)
                row = check(options.checker.resolve(), place / "beam.fmu", runtime, expected)
                rows.append({"checker": row["checker"], "export": runtime.value, "folder": label} | row)
                print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    write_records(options.output, rows)


if __name__ == "__main__":
    main()
