"""What people expect of commands: help, quiet, JSON, completion, a line of summary, units in tables."""

import io
import json
import os
import re
import subprocess
import sys
from inspect import isfunction

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from bodies import random_body, with_second_order
from flexfmu.calls.describing import cost_table, describe
from flexfmu.commands import jobs
from flexfmu.commands.cli import COMMANDS, app
from flexfmu.files.basics import FlexfmuError
from flexfmu.files.outputs import json_text
from flexfmu.files.tables import factor, named, quantity, read_table, unit_of
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.model.methods import Method, Variant, masses_of
from flexfmu.study.cost import StepCost
from references import BEAM


@pytest.fixture(scope="module")
def fmu(tmp_path_factory, bodies):
    path = tmp_path_factory.mktemp("commands") / "beam.fmu"
    package_fmu(bodies.beam().model, path)
    return path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(word) for word in arguments])
    assert result.exit_code == code, result.output
    return result


def test_help_is_short_or_long():
    assert run("-h").stdout == run("--help").stdout
    assert "--input" in run("simulate", "-h").stdout


def test_python_runs_the_package_as_the_command():
    done = subprocess.run([sys.executable, "-m", "flexfmu", "--version"], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"flexfmu \d+\.\d+\.\d+\S*\n", done.stdout)


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_info_of_a_file_needs_no_typer_and_says_the_same(fmu, more):
    code = "import sys\nfrom flexfmu.commands.entry import main\nmain()\nprint(*sys.modules, file=sys.stderr)"
    arguments = [sys.executable, "-c", code, "info", str(fmu), *more]
    done = subprocess.run(arguments, capture_output=True, text=True, encoding="utf-8", check=True)
    assert done.stdout == run("info", fmu, *more).stdout
    assert not {"typer", "pydantic"} & set(done.stderr.split())


@pytest.mark.parametrize("words", [["--json"], [], ["--cost"]])
def test_a_command_whose_reader_has_gone_ends_without_words(fmu, words):
    """As after `| head`."""
    reader, writer = os.pipe()
    os.close(reader)
    arguments = [sys.executable, "-m", "flexfmu", "info", str(fmu), *words]
    done = subprocess.run(arguments, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_shells_complete_the_commands():
    words = {"_FLEXFMU_COMPLETE": "complete_bash", "COMP_WORDS": "flexfmu si", "COMP_CWORD": "1"}
    code = "from flexfmu.commands.entry import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**words, "PATH": ""})
    assert "simulate" in done.stdout


# What takes long to import, and rooms that a running body does without.
HEAVY = {"felupe", "fmpy", "joblib", "matplotlib", "meshio", "pymetis", "pythonfmu", "scipy"}
# What makes an FMU.
MAKING = {"flexfmu.fmu.package", "flexfmu.fmu.description", "flexfmu.program"}
# What drives one.
USED = {"fmpy", "flexfmu.fmu.description", "flexfmu.program"}
ROOMS = {f"flexfmu.{room}" for room in ("build", "fe", "given", "master", "mesh", "reduction", "study")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (["--help"], {*HEAVY, *ROOMS, "flexfmu.model", "h5py", "numpy"}),
        (["--version"], {*HEAVY, *ROOMS, "flexfmu.model", "h5py", "numpy"}),
        (["info", "FMU"], {*HEAVY, *ROOMS, *MAKING}),
        (["info", "FMU", "--json"], {*HEAVY, *ROOMS, *MAKING}),
        (["simulate", "FMU", "-i", "LOADS", "-o", "OUT/motion.csv"], {*HEAVY, *ROOMS, *MAKING, "h5py"} - USED),
        (["build", "BODY", "-o", "OUT/beam.fmu"], {"felupe", "fmpy", "joblib", "matplotlib", "pythonfmu"}),
    ],
)
def test_commands_import_what_they_use_and_nothing_else(fmu, tmp_path, words, unused):
    code = (
        "import sys\nfrom flexfmu.commands.cli import app\n"
        "app(sys.argv[1:], standalone_mode=False)\nprint(*sys.modules, file=sys.stderr)"
    )
    (tmp_path / "loads.csv").write_text("time,tip.force.x\n0,0\n0.01,1\n", encoding="utf-8")
    files = {"FMU": fmu, "LOADS": tmp_path / "loads.csv", "BODY": BEAM / "body.toml"}
    words = [str(files.get(word, word)).replace("OUT", str(tmp_path)) for word in words]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert "flexfmu.commands" in loaded
    assert loaded & unused == set()


def test_every_job_is_a_command():
    helpers = {jobs.reporter, jobs.show_written}
    own = [one for one in vars(jobs).values() if isfunction(one) and one.__module__ == jobs.__name__]
    assert {one.__name__ for one in own if one not in helpers and not one.__name__.startswith("_")} == set(COMMANDS)


def test_info_as_json_holds_the_frequencies(fmu):
    data = json.loads(run("info", fmu, "--json").stdout)
    body = read_packaged_body(fmu)
    found = [mode["frequency"] for mode in data["modes"]]
    np.testing.assert_allclose(found, body.angular_frequency / (2.0 * np.pi), rtol=1e-15)
    assert data["interfaces"] == [{"name": "tip", "point": body.interface_point[0].tolist(), "frame": "frame_8"}]
    assert data["frames"][0]["parent"] is None
    assert data["properties"]["material_names"] == ["STEEL"]


def test_results_as_json_have_null_where_there_is_no_number():
    row = {"share": float("nan"), "method": Method.FRAMES, "shape": np.eye(2)}
    assert json.loads(json_text(row)) == {"share": None, "method": "frames", "shape": [[1.0, 0.0], [0.0, 1.0]]}


def test_tables_of_a_body_fit_a_terminal_of_80_columns():
    body = with_second_order(random_body(name="a_body_with_a_name_of_usual_length"))
    cost = StepCost(1e-3, 1.2345e-3, 12.3, 1.0)
    costs = {Variant(method, mass): cost for method in Method for mass in masses_of(method)}
    console = Console(file=io.StringIO(), width=80)
    console.print(cost_table(costs))
    text = console.file.getvalue()
    assert "frames, mass configuration" in text
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    # Nothing is folded over two lines.
    assert len(text.splitlines()) == len(costs) + 5
    for part in describe(body):
        console.print(part)
    assert "…" not in console.file.getvalue()


LOADS = "time,tip.force.y\n0,0\n0.01,2000\n0.02,2000\n"


def simulate(fmu, folder, text, *options):
    (folder / "loads.csv").write_text(text)
    result = run("simulate", fmu, "-i", folder / "loads.csv", "-o", folder / "result.csv", *options)
    return result, read_table(folder / "result.csv")


def test_a_run_ends_with_its_largest_motion_and_its_warnings(fmu, tmp_path):
    result, (names, values) = simulate(fmu, tmp_path, LOADS)
    moved = np.linalg.norm(values[:, [1 + names.index(f"tip.displacement.{axis}") for axis in "xyz"]], axis=1)
    turned = np.linalg.norm(values[:, [1 + names.index(f"tip.rotation.{axis}") for axis in "xyz"]], axis=1)
    line = result.stdout.splitlines()[0]
    assert f"{1e3 * moved.max():.4g} mm of tip at {values[moved.argmax(), 0]:.4g} s" in line
    assert f"{np.degrees(turned.max()):.4g}° of tip" in line
    assert line.endswith("no warnings")
    result, _ = simulate(fmu, tmp_path, LOADS, "--stop", "0.03")
    assert result.stdout.splitlines()[0].endswith("1 warning")


@pytest.mark.parametrize("place", ["before", "after"])
def test_quiet_leaves_warnings_and_results(fmu, tmp_path, place):
    (tmp_path / "loads.csv").write_text(LOADS)
    words = ["simulate", fmu, "-i", tmp_path / "loads.csv", "-o", tmp_path / "r.csv", "--stop", "0.03"]
    usual = run(*words, "--verbose")
    assert "✓" in usual.stderr
    quiet = run(*(["-q", *words] if place == "before" else [*words, "--quiet"]))
    assert "✓" not in quiet.stderr
    assert "the last loads are held" in quiet.stderr
    assert quiet.stdout == usual.stdout


def test_verbose_shows_where_an_error_arose(tmp_path):
    usual, verbose = (run("info", tmp_path / "none.fmu", *more, code=1).stderr for more in ((), ("-v",)))
    assert "no such file" in usual
    assert "Traceback" not in usual
    assert "Traceback" in verbose


def test_units_in_a_header_are_converted(fmu, tmp_path):
    _, (_, plain) = simulate(fmu, tmp_path, LOADS)
    _, (_, units) = simulate(fmu, tmp_path, "time [ms],tip.force.y (kN)\n0,0\n10,2\n20,2\n")
    np.testing.assert_allclose(units, plain, rtol=1e-9, atol=1e-15)


def test_units_that_are_written_are_read_again(fmu, tmp_path):
    """`couple` writes the same header (`test_master`)."""
    _, (names, _) = simulate(fmu, tmp_path, LOADS)
    head = (tmp_path / "result.csv").read_text().splitlines()[0].split(",")
    assert head[:2] == ["time [s]", "tip.displacement.x [m]"]
    assert "tip.rotation.z [rad]" in head
    assert [named(cell)[0] for cell in head[1:]] == names


@pytest.mark.parametrize(
    ("header", "name", "value"),
    [
        ("tip.force.x", "tip.force.x", 1.0),
        ("tip.force.x [kN]", "tip.force.x", 1e3),
        ("tip.moment.x [N mm]", "tip.moment.x", 1e-3),
        ("tip.moment.x (N·m)", "tip.moment.x", 1.0),
        ("tip.displacement.x[mm]", "tip.displacement.x", 1e-3),
        ("tip.rotation.x [deg]", "tip.rotation.x", np.pi / 180.0),
        ("tip.angular_velocity.z [rpm]", "tip.angular_velocity.z", np.pi / 30.0),
        ("body.acceleration.z [g]", "body.acceleration.z", 9.80665),
        ("body.acceleration.z [m/s^2]", "body.acceleration.z", 1.0),
        ("web.von_mises [MPa]", "web.von_mises", 1e6),
        ("time [min]", "time", 60.0),
        ("motor.current [A]", "motor.current", 1.0),
    ],
)
def test_headers_tell_names_and_units(header, name, value):
    assert named(header) == (name, pytest.approx(value, rel=1e-12))


def test_a_unit_of_another_quantity_is_refused():
    with pytest.raises(FlexfmuError, match="'mm', expected one of N, mN, kN"):
        named("tip.force.y [mm]")
    with pytest.raises(FlexfmuError, match="expected a number"):
        quantity("much", "tip.force.y")
    assert quantity("5kN", "tip.force.y") == quantity("5e3", "tip.force.y") == 5000.0
    assert quantity("-1.5e-2 N m", "tip.moment.y") == -0.015


def test_every_variable_of_an_fmu_with_a_unit_tells_the_same_by_its_name(bodies):
    from flexfmu.program.variable_table import variable_table

    shown = ("INPUT", "MOTION", "RATE", "STRESS")
    variables = [v for v in variable_table(bodies.beam().model) if v.role in shown]
    assert len(variables) >= 12
    for variable in variables:
        assert unit_of(variable.name) == variable.unit
        assert factor(variable.unit, variable.unit, "") == 1.0
        assert named(f"{variable.name} [{unit_of(variable.name)}]") == (variable.name, 1.0)
