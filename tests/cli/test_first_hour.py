"""The first hour with parts that no demo has: CAD, gmsh, `init`, an edit, `build`, plain fmpy, `couple`, `view`, `fit`.

Each step is a process of its own with a deadline; nothing is warned of, and what comes out is what CalculiX finds.
"""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest

from first_parts import FOLDER, LOADS, SHARES, edited, scene, write_mesh
from flexfmu.files.tables import read_table

pytestmark = pytest.mark.slow
ROWS = list(csv.DictReader((FOLDER / "calculix.csv").read_text().splitlines()))
PLAIN = """
import sys, fmpy
start = dict(initialization="static", **{"INTERFACE.force." + k: v for k, v in LOAD.items()})
result = fmpy.simulate_fmu("part.fmu", start_values=start, stop_time=0.01, output_interval=1e-3)
names = ["INTERFACE.%s.%s" % (kind, axis) for kind in ("displacement", "rotation") for axis in "xyz"]
print(*(result[name][row] for row in (0, -1) for name in names))
"""


def run(folder, deadline, *words):
    """Standard output of a process that ends well within a deadline, s; its warnings are marked by an exclamation."""
    environment = {**os.environ, "MPLCONFIGDIR": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, *map(str, words)], cwd=folder, env=environment, capture_output=True, text=True,
        timeout=deadline, check=False, encoding="utf-8",
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert not [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("!")], done.stderr
    return done.stdout


def flexfmu(folder, deadline, *words):
    return run(folder, deadline, "-m", "flexfmu.commands.cli", *words)


def expected(part, share):
    (row,) = [row for row in ROWS if row["part"] == part and float(row["share"]) == share]
    return np.array([[float(row[f"{kind}{axis}"]) for axis in "xyz"] for kind in "ur"])


def off(found, true):
    """Relative errors of displacement and rotation."""
    return np.linalg.norm(found - true, axis=1) / np.linalg.norm(true, axis=1)


@pytest.fixture(scope="module", params=list(LOADS))
def part(request, tmp_path_factory):
    """A part and the folder of its body file and FMU."""
    folder = tmp_path_factory.mktemp(request.param)
    flexfmu(folder, 60, "init", write_mesh(request.param, folder), "-o", "part.toml")
    body = folder / "part.toml"
    body.write_text(edited(request.param, body.read_text(encoding="utf-8")), encoding="utf-8")
    assert "mass" in flexfmu(folder, 60, "check", "part.toml")
    flexfmu(folder, 300, "build", "part.toml", "-o", "part.fmu")
    assert "second_order" in flexfmu(folder, 30, "info", "part.fmu")
    return request.param, folder


def test_plain_fmpy_finds_what_calculix_finds(part):
    name, folder = part
    interface, load = LOADS[name]
    for share in SHARES:
        script = PLAIN.replace("INTERFACE", interface).replace("LOAD", str({k: share * v for k, v in load.items()}))
        found = np.array(run(folder, 60, "-c", script).split(), dtype=float).reshape(2, 2, 3)
        # At rest from the first row to the last, and there within 0.3 %.
        np.testing.assert_allclose(found[1], found[0], atol=1e-9)
        assert np.max(off(found[0], expected(name, share))) < 3e-3


@pytest.mark.parametrize("part", ["pedal"], indirect=True)
def test_the_smallest_model_is_within_the_tolerance(part):
    name, folder = part
    (folder / "scene.toml").write_text(scene(name), encoding="utf-8")
    told = flexfmu(folder, 400, "fit", "part.toml", "--scene", "scene.toml", "-o", "lean.toml")
    assert "pass: " in told
    interface, load = LOADS[name]
    script = PLAIN.replace("INTERFACE", interface).replace("LOAD", str(load)).replace("part.fmu", "lean.fmu")
    found = np.array(run(folder, 60, "-c", script).split(), dtype=float).reshape(2, 2, 3)[0]
    assert np.all(off(found, expected(name, 1.0)) < [0.01, 0.02])


def test_coupled_by_a_soft_spring_it_comes_to_rest_under_the_load(part):
    """To ground, so soft that it takes a thousandth of the load; shown as a page."""
    name, folder = part
    interface, load = LOADS[name]
    header = ",".join(f"{interface}.force.{axis}" for axis in load)
    third = ",".join(str(size / 3.0) for size in load.values())
    nothing = ",".join("0" for _ in load)
    (folder / "loads.csv").write_text(f"time,{header}\n0,{nothing}\n0.3,{third}\n0.4,{third}\n", encoding="utf-8")
    (folder / "coupling.toml").write_text(
        '[experiment]\nstop = 0.4\nstep = 1e-3\n\n[[fmu]]\nname = "part"\nfile = "part.fmu"\ninput = "loads.csv"\n\n'
        f'[[spring]]\na = "part.{interface}"\nstiffness = [10.0, 10.0, 10.0, 0.0, 0.0, 0.0]\n',
        encoding="utf-8",
    )
    flexfmu(folder, 120, "couple", "coupling.toml", "-o", "motion.csv")
    names, rows = read_table(folder / "motion.csv")
    last = np.array([rows[-1, 1 + names.index(f"part.{interface}.displacement.{axis}")] for axis in "xyz"])
    flexfmu(folder, 60, "simulate", "part.fmu", "--input", "loads.csv", "-o", "alone.csv", "--step", "1e-3")
    names, rows = read_table(folder / "alone.csv")
    alone = np.array([rows[-1, 1 + names.index(f"{interface}.displacement.{axis}")] for axis in "xyz"])
    assert 1e-5 < np.linalg.norm(last - alone) / np.linalg.norm(alone) < 0.01
    flexfmu(folder, 60, "view", "part.fmu", "alone.csv", "-o", "page.html")
    assert "http" not in (folder / "page.html").read_text(encoding="utf-8").replace("http://www.w3.org", "")
