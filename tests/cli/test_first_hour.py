"""The first hour with parts that no demo has: STEP, gmsh, `init`, an edit, `build`, plain fmpy, `couple`, pages, `fit`.

Each step is a process of its own with a deadline; nothing is warned of, and what comes out is what CalculiX finds.
"""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest

from chromium import Tab, browser
from first_parts import FOLDER, LOADS, SHARES, edited, meshed, scene, write_mesh
from flexfmu.files.tables import read_table

resource = pytest.importorskip("resource", reason="no limits of processor time")
ROWS = list(csv.DictReader((FOLDER / "calculix.csv").read_text().splitlines()))
PLAIN = """
import sys, fmpy
start = dict(initialization="static", **{"INTERFACE.force." + k: v for k, v in LOAD.items()})
result = fmpy.simulate_fmu("part.fmu", start_values=start, stop_time=0.01, output_interval=1e-3)
names = ["INTERFACE.%s.%s" % (kind, axis) for kind in ("displacement", "rotation") for axis in "xyz"]
print(*(result[name][row] for row in (0, -1) for name in names))
"""


def run(folder, deadline, *words):
    """Standard output of a process that ends well within a deadline, s of processor; an exclamation marks warnings."""
    environment = {**os.environ, "MPLCONFIGDIR": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, *map(str, words)], cwd=folder, env=environment, capture_output=True, text=True,
        timeout=10 * deadline, check=False, encoding="utf-8",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (deadline, deadline)),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    said = (done.stdout + done.stderr).splitlines()
    assert not [line for line in said if line.startswith(("!", "[WARNING]"))], said
    return done.stdout


def flexfmu(folder, deadline, *words):
    return run(folder, deadline, "-m", "flexfmu", *words)


def expected(part, share):
    (row,) = [row for row in ROWS if row["part"] == part and float(row["share"]) == share]
    return np.array([[float(row[f"{kind}{axis}"]) for axis in "xyz"] for kind in "ur"])


def off(found, true):
    """Relative errors of displacement and rotation."""
    return np.linalg.norm(found - true, axis=1) / np.linalg.norm(true, axis=1)


def rests(folder, interface, load, fmu="part.fmu"):
    """Displacement and rotation (2, 3) under a load by plain fmpy; at rest from the first row to the last."""
    script = PLAIN.replace("INTERFACE", interface).replace("LOAD", str(load)).replace("part.fmu", fmu)
    first, last = np.array(run(folder, 60, "-c", script).split(), dtype=float).reshape(2, 2, 3)
    np.testing.assert_allclose(last, first, atol=1e-9)
    return first


def built(folder, mesh, part):
    """Body file and FMU of a mesh."""
    flexfmu(folder, 60, "init", mesh, "-o", "part.toml")
    body = folder / "part.toml"
    body.write_text(edited(part, body.read_text(encoding="utf-8")), encoding="utf-8")
    flexfmu(folder, 300, "build", "part.toml", "-o", "part.fmu")


def shown_alive(folder, deadline, widths=((1400, False), (400, True))):
    """The live page, pulled at its first interface, at some widths; skipped where nothing opens it."""
    flexfmu(folder, deadline, "view", "part.fmu", "--live", "alive.html")
    browser()
    for width, dark in widths:
        with Tab(folder / "alive.html", width, 800, dark) as tab:
            tab.until("document.body.dataset.live === 'yes'")
            tab.value("live.begin(0, { fixed: live.markNow[0].map((x, c) => x + 0.1 * live.size * turn[1][c]) })")
            tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.01 * live.size && live.bound > 0")
            assert tab.value("document.documentElement.scrollWidth") <= width
            assert tab.said == []


@pytest.fixture(scope="module", params=list(LOADS))
def part(request, tmp_path_factory):
    """A part and the folder of its body file and FMU: from its geometry where gmsh is there, else from its deck."""
    folder = tmp_path_factory.mktemp(request.param)
    try:
        import gmsh  # noqa: F401
    except (ImportError, OSError):
        mesh = write_mesh(request.param, folder)
    else:
        mesh = meshed(request.param, folder)
    built(folder, mesh, request.param)
    assert "mass" in flexfmu(folder, 60, "check", "part.toml")
    assert "second_order" in flexfmu(folder, 30, "info", "part.fmu")
    return request.param, folder


@pytest.mark.slow
def test_a_lever_from_its_geometry_bends_as_a_beam_does_and_answers_in_its_page(tmp_path):
    """Its eye under 300 N in the plane, 120 mm from the clamped end of 12 × 6 mm of steel: P L³ / 3 E I or so."""
    pytest.importorskip("gmsh", reason="no gmsh here to mesh the geometry with", exc_type=ImportError)
    built(tmp_path, meshed("lever", tmp_path), "lever")
    moved = rests(tmp_path, "bore_1", {"y": 300.0})[0]
    stiffness = 3.0 * 2.1e11 * 6e-3 * 12e-3**3 / 12.0 / 0.12**3
    # The eye is thicker than the bar, and the bar has shear.
    assert moved[1] == pytest.approx(300.0 / stiffness, rel=0.15)
    shown_alive(tmp_path, 60, [(400, True)])


@pytest.mark.long
def test_plain_fmpy_finds_what_calculix_finds(part):
    """On the mesh that is kept, that is: another version of gmsh makes another one."""
    name, folder = part
    interface, load = LOADS[name]
    for share in SHARES:
        found = rests(folder, interface, {k: share * v for k, v in load.items()})
        assert np.max(off(found, expected(name, share))) < 5e-3


@pytest.mark.long
def test_the_chart_of_a_few_models_is_drawn_and_names_the_fastest(part):
    name, folder = part
    (folder / "scene.toml").write_text(scene(name), encoding="utf-8")
    words = ["part.toml", "--scene", "scene.toml", "-r", "models.csv", "--picture", "chart.png", "--page", "chart.html"]
    assert "× tolerance" in flexfmu(folder, 900, "chart", *words)
    assert (folder / "chart.png").read_bytes().startswith(b"\x89PNG")
    assert "http" not in (folder / "chart.html").read_text(encoding="utf-8").replace("http://www.w3.org", "")


@pytest.mark.long
def test_the_smallest_model_is_within_the_tolerance(part):
    """From which on its FMU warns of its own bound, not before."""
    name, folder = part
    (folder / "fit.toml").write_text(scene(name).partition("[sweep]")[0], encoding="utf-8")
    assert "pass: " in flexfmu(folder, 900, "fit", "part.toml", "--scene", "fit.toml", "-o", "lean.toml")
    interface, load = LOADS[name]
    assert np.all(off(rests(folder, interface, load, "lean.fmu"), expected(name, 1.0)) < [0.01, 0.025])


@pytest.mark.long
def test_coupled_by_a_soft_spring_it_comes_to_rest_under_the_load(part):
    """To ground, so soft that it takes a thousandth of the load; shown as a page, and alive."""
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
    shown_alive(folder, 120)
