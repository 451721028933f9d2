"""One FMU in other masters, against the numbers of the body itself.

Run from the repository's root: python -m benchmarks.masters MASTER[=PYTHON] … [--output FILE.csv]. A master that is too
large for the environment of the tests lies in one of its own: cofmupy=/path/to/venv/bin/python. Both exports are run.
fmusim, a program of the Reference FMUs that must be on the PATH, runs the native ones of FMI 2.0
and 3.0. Prints a table and writes it.
"""

import argparse
import json
import subprocess
import sys
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

HERE = Path(__file__).parent
ROOT = HERE.parent
DRIVERS = ROOT / "tests" / "native_master" / "python_masters.py"
MARK = "RESULT "
STEP, COUNT = 1e-3, 200
# From the start, and from the middle of the run on.
FIRST = {"tip.force.x": -500.0, "tip.force.y": 4000.0}
LATER = {"tip.force.z": 1500.0, "tip.moment.x": 40.0}
OUTPUTS = [f"tip.{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz"]
COLUMNS = ("master", "version", "fmpy", "numpy", "python", "export", "steps", "motion", "difference", "failure")
EXPORTS = (("native", Runtime.NATIVE, 2), ("python", Runtime.PYTHON, 2), ("fmi3", Runtime.NATIVE, 3))
VERSIONS = """
import platform, subprocess, sys
from importlib.metadata import version
name = sys.argv[1]
own = subprocess.getoutput("fmusim --version").split()[1] if name == "fmusim" else version(name.replace("_", "-"))
print(own, version("fmpy"), version("numpy"), platform.python_version())
"""


def by_the_body(body):
    """Outputs after every step, without FMI."""
    names = [f"tip.{quantity}.{axis}" for quantity in ("force", "moment") for axis in "xyz"]
    state, rows = body.rest(), []
    for k in range(COUNT):
        loads = FIRST | (LATER if k >= COUNT // 2 else {})
        state = body.step(state, {"tip": [loads.get(name, 0.0) for name in names]}, STEP)
        response = body.response(state)
        rows.append([*response.displacement[0], *response.rotation[0]])
    return np.array(rows)


def record(master, python, fmu, export, expected):
    """A row of the table."""
    found = subprocess.run([python, "-c", VERSIONS, master], capture_output=True, text=True, check=True)
    versions = dict(zip(COLUMNS[1:5], found.stdout.split(), strict=True))
    arguments = json.dumps([str(fmu), {}, FIRST, LATER, STEP, COUNT, OUTPUTS])
    done = subprocess.run([python, str(DRIVERS), master, arguments], capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    row = {
        "master": master,
        **versions,
        "export": export,
        "steps": COUNT,
        "motion": f"{np.max(np.abs(expected)):.3g}",
    }
    if not lines:
        return row | {"failure": (done.stderr.splitlines() or [f"ended with {done.returncode}"])[-1]}
    difference = np.max(np.abs(np.array(json.loads(lines[-1][len(MARK) :])) - expected))
    return row | {"difference": f"{difference:.1e}"}


def main():
    """Run the masters that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("masters", nargs="+", metavar="MASTER[=PYTHON]")
    parser.add_argument("--output", type=Path, default=HERE / "masters.csv")
    options = parser.parse_args()
    reduced = reduce_body(read_body_file(ROOT / "demo" / "clamped_beam" / "body.toml"), Reporter())
    expected = by_the_body(FlexibleBody(reduced))
    rows = []
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        for export, runtime, version in EXPORTS:
            fmu = Path(folder) / f"beam_{export}.fmu"
            package_fmu(reduced, fmu, runtime, fmi=version)
            for name in options.masters:
                master, _, python = name.partition("=")
                if export not in (("native", "fmi3") if master == "fmusim" else ("native", "python")):
                    continue
                rows.append(record(master, python or sys.executable, fmu, export, expected))
                print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    write_records(options.output, rows)


if __name__ == "__main__":
    main()
