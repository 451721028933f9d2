"""Tables of loads and results, and the `simulate` command from the shell."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from bodies import beam_body
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.files.basics import OutputError, SimulationError
from flexfmu.files.tables import read_table, write_table
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.simulation import parse_parameters

PNG = b"\x89PNG\r\n"


def table(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(
    scope="module",
    params=[Runtime.NATIVE, pytest.param(Runtime.PYTHON, marks=pytest.mark.slow)],
    ids=lambda runtime: runtime.value,
)
def fmu(request, tmp_path_factory):
    """The beam's FMU of each export."""
    path = tmp_path_factory.mktemp("fmu") / "beam.fmu"
    package_fmu(beam_body(2, modes=2), path, request.param)
    return path


def flexfmu(folder, *arguments):
    """Run the command; what it prints decides, since an FMU's library may disturb the interpreter's exit."""
    environment = {**os.environ, "MPLCONFIGDIR": str(folder), "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-m", "flexfmu", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=folder,
        env=environment,
    )


# Tables.


def test_a_table_comes_back_to_twelve_digits(tmp_path):
    values = np.column_stack([np.linspace(0.0, 1.0, 7), np.random.default_rng(3).standard_normal((7, 2)) * 1e-5])
    write_table(tmp_path / "t.csv", ["a", "b"], values)
    names, read = read_table(tmp_path / "t.csv")
    assert names == ["a", "b"]
    np.testing.assert_allclose(read, values, rtol=1e-11)


def test_empty_lines_and_blanks_do_no_harm(tmp_path):
    names, values = read_table(table(tmp_path / "t.csv", "time , a\n\n0, 1\n 0.5 ,2e3\n\n"))
    assert names == ["a"]
    np.testing.assert_array_equal(values, [[0.0, 1.0], [0.5, 2000.0]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,a\n0,1\n1,2,3\n", r"line 3: 3 columns, the header has 2; expected .* decimal points"),
        ("time,a\n0,1\n\n1,two\n", r"line 4: .*'two'.*expected numbers"),
        ("time,a\n0,1\n1,nan\n", r"line 3: a is nan, expected a finite number"),
        ("time,a\n0,inf\n", r"line 2: a is inf, expected a finite number"),
        ("time,a\n0,1\n2,1\n1,1\n", r"line 4: time goes back from 2\.0 to 1\.0"),
        ("a,time\n0,1\n", r"expected a header"),
        ("time,a\n", r"at least one row"),
        ("", r"expected a header"),
    ],
)
def test_a_wrong_table_is_refused_by_the_number_of_its_line(tmp_path, text, words):
    with pytest.raises(SimulationError, match=words) as caught:
        read_table(table(tmp_path / "loads.csv", text))
    assert "loads.csv" in str(caught.value)


def test_a_table_that_is_missing_or_no_text_is_named(tmp_path):
    with pytest.raises(SimulationError, match=r"nothing\.csv: no such file"):
        read_table(tmp_path / "nothing.csv")
    (tmp_path / "b.csv").write_bytes(b"time,a\n\xff\xfe,1\n")
    with pytest.raises(SimulationError, match=r"b\.csv: cannot be read"):
        read_table(tmp_path / "b.csv")


def test_a_table_is_written_whole_or_not_at_all(tmp_path):
    write_table(tmp_path / "t.csv", ["a"], np.array([[0.0, 1.0]]))
    before = (tmp_path / "t.csv").read_bytes()

    class Breaks(list):
        def __iter__(self):
            yield [0.0, 1.0]
            raise OSError("disk full")

    with pytest.raises(OutputError, match="disk full"):
        write_table(tmp_path / "t.csv", ["a"], Breaks())
    assert (tmp_path / "t.csv").read_bytes() == before
    with pytest.raises(OutputError, match="cannot be written"):
        write_table(tmp_path / "nowhere" / "t.csv", ["a"], np.array([[0.0, 1.0]]))
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_settings_become_numbers_where_they_are_numbers():
    found = parse_parameters(["damping.scale=2", "initialization = static", "x=-1e-3", "y=a=b"])
    assert found == {"damping.scale": 2.0, "initialization": "static", "x": -1e-3, "y": "a=b"}
    assert isinstance(found["damping.scale"], float)
    with pytest.raises(SimulationError, match="NAME=VALUE"):
        parse_parameters(["damping.scale"])


# The command.


@pytest.mark.slow
def test_simulate_writes_the_motion_of_the_body_and_a_picture(tmp_path, fmu):
    loads = table(tmp_path / "loads.csv", "time,tip.force.y\n0,3000\n0.02,3000\n")
    done = flexfmu(
        tmp_path, "simulate", fmu, "-i", loads, "-o", "motion.csv", "--step", "0.002", "--plot", "motion.png"
    )
    assert "motion.csv, motion.png" in done.stdout, done.stderr
    names, values = read_table(tmp_path / "motion.csv")
    flexible = FlexibleBody(beam_body(2, modes=2))
    state, expected = flexible.rest(), [0.0]
    for _ in range(10):
        state = flexible.step(state, {"tip": (0.0, 3000.0, 0.0)}, 0.002)
        expected.append(flexible.response(state).displacement[0, 1])
    np.testing.assert_allclose(values[:, 0], np.linspace(0.0, 0.02, 11), atol=1e-12)
    np.testing.assert_allclose(values[:, 1 + names.index("tip.displacement.y")], expected, rtol=1e-10, atol=1e-13)
    assert max(expected) > 0.01
    assert (tmp_path / "motion.png").read_bytes().startswith(PNG)
    assert not list(tmp_path.glob(".*"))


def test_simulate_starts_in_equilibrium_when_told_to(tmp_path, fmu):
    loads = table(tmp_path / "loads.csv", "time,tip.force.y\n0,3000\n0.01,3000\n")
    done = flexfmu(tmp_path, "simulate", fmu, "-i", loads, "-o", "motion.csv", "--static-start")
    assert "motion.csv" in done.stdout, done.stderr
    names, values = read_table(tmp_path / "motion.csv")
    flexible = FlexibleBody(beam_body(2, modes=2))
    at_rest = flexible.response(flexible.static({"tip": (0.0, 3000.0, 0.0)})).displacement[0, 1]
    np.testing.assert_allclose(values[:, 1 + names.index("tip.displacement.y")], at_rest, rtol=1e-9)


REFUSED = [
    ("tip.force.w", (), ["error:", "'tip.force.w' is no input", "tip.force.x", "tip.force.z"]),
    ("tip.force.y", ("--set", "damping=2"), ["error:", "'damping' is no parameter", "damping.scale"]),
    ("tip.force.y", ("--set", "damping.scale"), ["error:", "NAME=VALUE"]),
    ("tip.force.y", ("--set", "damping.scale=-1"), ["error:", "damping.scale=-1.0"]),
    ("tip.force.y", ("--set", "method=magic"), ["error:", "'magic'", "'frames'"]),
    ("tip.force.y", ("--stop", "-1"), ["error:", "expected a later end"]),
    ("tip.force.y", ("--step", "-1"), ["error:", "a step > 0"]),
    ("tip.force.y", ("--stop", "1e9"), ["steps of", "values each, expected at most"]),
    ("tip.force.y", ("--step", "1e-300"), ["steps of", "values each, expected at most"]),
]
# All in one process: starting one takes longer than what it then does.
REFUSALS = """
import json, os, sys
from typer.testing import CliRunner
from flexfmu.commands.cli import app

said = []
for folder, words in json.loads(sys.argv[1]):
    os.chdir(folder)
    said.append(CliRunner().invoke(app, words).stderr)
# Past the interpreter's exit, which an FMU's library may disturb.
print(json.dumps(said), flush=True)
os._exit(0)
"""


@pytest.fixture(scope="module")
def refusals(fmu, tmp_path_factory):
    """Folder of each refused run, and what was said."""
    folders = [tmp_path_factory.mktemp("refused") for _ in REFUSED]
    lines = []
    for folder, (header, options, _) in zip(folders, REFUSED, strict=True):
        table(folder / "loads.csv", f"time,{header}\n0,0\n0.01,10\n")
        lines.append((str(folder), ["simulate", str(fmu), "-i", "loads.csv", "-o", "motion.csv", *options]))
    environment = {**os.environ, "COLUMNS": "200"}
    command = [sys.executable, "-c", REFUSALS, json.dumps(lines)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True, env=environment)
    return list(zip(folders, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("number", range(len(REFUSED)), ids=[" ".join([row[0], *row[1]]) for row in REFUSED])
def test_simulate_refuses_what_it_cannot_do_in_words_and_writes_nothing(refusals, number):
    folder, said = refusals[number]
    for word in REFUSED[number][2]:
        assert word in said
    assert "Traceback" not in said
    assert [path.name for path in folder.iterdir() if path.suffix == ".csv"] == ["loads.csv"]


INTERRUPTED = """
import os, signal, sys, threading
from contextlib import contextmanager
from pathlib import Path
from flexfmu.files.basics import FlexfmuError
from flexfmu.fmu.simulation import simulate_csv
from flexfmu.files.outputs import Reporter

class Impatient(Reporter):
    # Presses Ctrl-C from outside once ten steps are done, so that it comes amid any code.
    @contextmanager
    def counted(self, title, total, unit=""):
        threads = []
        def tell(done):
            if done > 9.5e-3 and not threads:
                threads.append(threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT)))
                threads[0].start()
        yield tell

try:
    simulate_csv(Path(sys.argv[1]), Path("loads.csv"), Path("motion.csv"), 1e-3, 500.0, {}, Impatient())
except FlexfmuError as error:
    print(error, file=sys.stderr, flush=True)
    # Past the interpreter's exit, which an FMU's library may disturb.
    os._exit(error.exit_code)
"""


def test_ctrl_c_ends_a_run_between_two_steps_and_keeps_the_motion_so_far(tmp_path, fmu):
    table(tmp_path / "loads.csv", "time,tip.force.y\n0,3000\n500,3000\n")
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(fmu)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert done.returncode == 130, done.stderr
    assert re.search(r"stopped at [\d.]+ s of 500 s: ended by Ctrl-C", done.stderr), done.stderr
    assert "motion.partial.csv" in done.stderr
    assert not (tmp_path / "motion.csv").exists()
    names, values = read_table(tmp_path / "motion.partial.csv")
    assert 11 <= len(values) < 100_000
    np.testing.assert_allclose(values[:, 0], 1e-3 * np.arange(len(values)), atol=1e-9)
    flexible = FlexibleBody(beam_body(2, modes=2))
    state = flexible.rest()
    for _ in range(10):
        state = flexible.step(state, {"tip": (0.0, 3000.0, 0.0)}, 1e-3)
    expected = flexible.response(state).displacement[0, 1]
    assert values[10, 1 + names.index("tip.displacement.y")] == pytest.approx(expected, rel=1e-9)


def test_what_came_out_before_a_refused_step_is_kept(tmp_path, fmu):
    loads = table(tmp_path / "loads.csv", "time,tip.force.y\n0,3000\n0.01,3000\n0.01,1e300\n0.02,1e300\n")
    done = flexfmu(tmp_path, "simulate", fmu, "-i", loads, "-o", "motion.csv", "--step", "0.002")
    assert "stopped at 0.01 s of 0.02 s" in done.stderr, done.stderr
    _, values = read_table(tmp_path / "motion.partial.csv")
    np.testing.assert_allclose(values[:, 0], 0.002 * np.arange(6), atol=1e-12)


@pytest.mark.slow
def test_simulate_says_why_the_fmu_refused_a_step_and_writes_nothing(tmp_path, fmu):
    loads = table(tmp_path / "loads.csv", "time,tip.force.y\n0,1e300\n0.01,1e300\n")
    done = flexfmu(tmp_path, "simulate", fmu, "-i", loads, "-o", "motion.csv")
    assert "beam.fmu stopped" in done.stderr
    assert "load" in done.stderr
    assert "not converge" in done.stderr or "not finite" in done.stderr
    assert not (tmp_path / "motion.csv").exists()


@pytest.mark.slow
def test_simulate_refuses_a_file_that_is_no_fmu_and_a_folder_that_is_not_there(tmp_path, fmu):
    loads = table(tmp_path / "loads.csv", "time,tip.force.y\n0,0\n0.01,10\n")
    done = flexfmu(tmp_path, "simulate", loads, "-i", loads, "-o", "motion.csv")
    assert "is a table, expected an FMU" in done.stderr
    done = flexfmu(tmp_path, "simulate", fmu, "-i", loads, "-o", "nowhere/motion.csv")
    assert "does not exist" in done.stderr
    assert not (tmp_path / "motion.csv").exists()
