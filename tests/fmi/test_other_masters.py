"""The same FMU in other masters gives the same numbers: Python packages, and a C program."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

import numpy as np
import pytest

from bodies import beam_body
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu

SCRIPTS = Path(__file__).parents[1] / "native_master"
MARK = "RESULT "
STEP, COUNT = 1e-3, 40
# Before the start, and from the middle of the run on.
LOADS = {"tip.force.x": -500.0, "tip.force.y": 2000.0}
LATER = {"tip.force.z": 1500.0, "tip.moment.x": 40.0}
OUTPUTS = [f"tip.{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz"]
STARTS = {"rest": {}, "static": {"initialization": "static"}}
# Those that set texts start in either way; the others know numbers only.
MASTERS = [(name, start) for name in ("fmpy", "libcosimpy", "ecospy") for start in STARTS]
MASTERS += [(name, "rest") for name in ("simulate_fmu", "pathsim_fmi", "cofmupy", "gemseo_fmu")]
MASTERS += [("fmusim", start) for start in STARTS]
# Their modules; what they want of an environment may be too much for that of the tests: "cofmupy=/path/to/python …".
MODULES = {"simulate_fmu": "fmpy"}
PYTHONS = dict(word.split("=") for word in os.environ.get("FLEXFMU_MASTERS", "").split())
# What each master does, as its row of the docs has it, and where fmusim differs by the export.
PAGE = Path(__file__).parents[2] / "docs" / "masters.md"
TITLES = {
    "simulate_fmu": "`fmpy.simulate_fmu`",
    "fmpy": "fmpy, `doStep`",
    "libcosimpy": "libcosimpy",
    "ecospy": "Ecos",
    "pathsim_fmi": "PathSim",
    "cofmupy": "CoFMUPy",
    "gemseo_fmu": "GEMSEO",
    "fmusim": "fmusim",
    "fmusim fmi3": "fmusim, FMI 3.0",
}
# Wall clock, s, for runs of some seconds.
DEADLINE = 120.0
RUNTIMES = {runtime.value: runtime for runtime in Runtime}
# Masters that are no Python programs would need a Python for its export; fmusim of the Reference FMUs reads FMI 3.0.
EXPORTS = {name: ("native", "fmi3") if name == "fmusim" else tuple(RUNTIMES) for name, _ in MASTERS}
EXPORTS["fmpy"] += ("fmi3",)
# What users do that no step can honour, from the middle of the run on; what they read then.
WRONG = {
    "too large a load": ({"tip.force.y": 1e12}, "does not converge"),
    "no number": ({"tip.force.y": float("nan")}, "expected a finite number"),
    "absurd motion": ({"tip.force.y": 1e6}, "where no method means anything"),
    # N/m, by explicit exchange each step: grows.
    "a stiff spring": ({"spring": ["tip.force.y", 1e7, 1]}, "where no method means anything"),
}
# Those whose loads can follow outputs, as a script exchanges them.
FOLLOWING = ("fmpy", "libcosimpy", "ecospy", "pathsim_fmi", "gemseo_fmu")
# Uses that these masters leave no choice in, and the test of each.
ELSEWHERE = {
    "a run without options": "fmi/test_plain_fmpy.py::test_a_refused_step_ends_the_run_and_says_why",
    "wrong point": "fmi/test_order_of_calls.py::test_a_step_from_another_point_is_refused_and_changes_nothing",
    "past the stop time": "fmi/test_order_of_calls.py::test_no_step_goes_beyond_the_stop_time",
    "both, of FMI 3.0": "fmi/test_fmi3.py::test_the_order_of_calls_is_that_of_the_standard",
    "derivatives before and after values": "physics/test_watch.py::"
    "test_inputs_with_derivatives_give_a_linear_body_the_exact_motion_under_growing_loads",
    "old glibc": "fmi/test_sources.py::test_the_core_asks_for_no_newer_c_library_than_wheels_know",
    "two in one program": "fmi/test_sources.py::test_two_fmus_stand_in_one_program_without_files",
    "early return": "fmi/test_fmi3.py::"
    "test_a_refused_step_is_taken_as_far_as_it_goes_where_the_master_allows_early_return",
}
USES = [
    (name, runtime, use)
    for name, found in EXPORTS.items()
    for runtime in found
    for use in WRONG
    if use != "a stiff spring" or name in FOLLOWING
]


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    """A damped beam, and its FMU of each export."""
    model, folder = beam_body(3, modes=3, damping=0.02), tmp_path_factory.mktemp("fmus")
    for name, runtime in RUNTIMES.items():
        package_fmu(model, folder / f"{name}.fmu", runtime)
    package_fmu(model, folder / "fmi3.fmu", fmi=3)
    return model, {name: folder / f"{name}.fmu" for name in (*RUNTIMES, "fmi3")}


@pytest.fixture(scope="module")
def beam(exports):
    """The beam and its native FMU."""
    return exports[0], exports[1]["native"]


@pytest.fixture(scope="module")
def expected(beam):
    """Outputs after every step by the body itself, by how it starts."""
    body = FlexibleBody(beam[0])
    found = {}
    for start in STARTS:
        loads = dict(LOADS)
        state = body.static(on_tip(loads)) if start == "static" else body.rest()
        found[start] = []
        for k in range(COUNT):
            if k == COUNT // 2:
                loads |= LATER
            state = body.step(state, on_tip(loads), STEP)
            response = body.response(state)
            found[start].append([*response.displacement[0], *response.rotation[0]])
    return found


def on_tip(loads):
    return {"tip": [loads.get(f"tip.{quantity}.{axis}", 0.0) for quantity in ("force", "moment") for axis in "xyz"]}


class Server:
    """Another master, imported once, and each run in a copy of that process."""

    def __init__(self, name):
        command = [PYTHONS.get(name, sys.executable), str(SCRIPTS / "python_masters.py"), name]
        self._job = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, arguments):
        """How the run ended, what it printed, and its errors."""
        with tempfile.TemporaryDirectory() as folder:
            said = [Path(folder) / "printed", Path(folder) / "errors"]
            print(json.dumps([arguments, [*map(str, said)], int(DEADLINE)]), file=self._job.stdin, flush=True)
            ending = self._job.stdout.readline()
            return int(ending), *(file.read_text(encoding="utf-8", errors="replace") for file in said)

    def close(self):
        """End it."""
        self._job.communicate()


SERVERS = {}


@pytest.fixture(scope="module", autouse=True)
def _servers():
    yield
    while SERVERS:
        SERVERS.popitem()[1].close()


def run_of(name, path, texts, later, step=STEP):
    """A run in another master, in a process with a deadline: outputs, or None, and all it says."""
    if name not in PYTHONS and importlib.util.find_spec(MODULES.get(name, name)) is None and shutil.which(name) is None:
        how = "build it from the Reference FMUs' sources, put it on the PATH"
        pytest.skip(f"{name} is not there: {how if name == 'fmusim' else 'pip install ' + name.replace('_', '-')}")
    if name not in SERVERS:
        SERVERS[name] = Server(name)
    code, printed, errors = SERVERS[name].run([str(path), texts, LOADS, later, step, COUNT, OUTPUTS])
    if code and "libtbb" in errors:
        pytest.skip("ecospy needs oneTBB: the package tbb, or Debian's libtbb12")
    rows = [json.loads(line[len(MARK) :]) for line in printed.splitlines() if line.startswith(MARK)]
    return rows[-1] if rows else None, f"{name} ended with {code}:\n{printed}\n{errors}"


def rows_of_the_page():
    """What the page says that masters do, by their titles and the uses."""
    text = PAGE.read_text(encoding="utf-8").partition("## What masters do")[2]
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if "|" in line]
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows[: len(TITLES)]}


def told(name, runtime, use):
    """The page's cell."""
    key = f"{name} {runtime}"
    return rows_of_the_page()[TITLES.get(key, TITLES[name])][use]


def seen(found, said):
    """What a master did with steps that were refused from the middle of the run on, or later."""
    if found is None:
        signs = {"FMICallException": "raises", "assert execution.step()": "answers false", "ended after": "ends"}
        return next((word for sign, word in signs.items() if sign in said), "error")
    refused = np.array(found[COUNT // 2 + COUNT // 4 :])
    return "stays" if np.all(refused == refused[0]) else "goes on"


def in_master(name, path, start):
    """Outputs after every step in a master that is a Python package."""
    found, said = run_of(name, path, STARTS[start], LATER)
    assert found, said
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "start", "runtime"), [(name, start, export) for name, start in MASTERS for export in EXPORTS[name]]
)
def test_masters_give_the_numbers_of_the_body_itself(exports, expected, name, start, runtime):
    found = in_master(name, exports[1][runtime], start)
    assert np.max(np.abs(expected[start])) > 0.05
    np.testing.assert_allclose(found, expected[start], rtol=0, atol=1e-12)


@pytest.mark.slow  # Two to five seconds each, which masters need to start.
@pytest.mark.parametrize(("name", "runtime", "use"), USES)
def test_what_no_step_can_honour_ends_the_run_with_a_word_or_leaves_the_body_as_it_was(exports, name, runtime, use):
    later, words = WRONG[use]
    found, said = run_of(name, exports[1][runtime], {}, later)
    assert words in said
    assert seen(found, said) == told(name, runtime, use), said
    if found is not None:
        assert np.all(np.isfinite(found))
        assert np.max(np.abs(found[-1])) > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("name", "runtime"), [(name, export) for name in FOLLOWING for export in EXPORTS[name]])
def test_a_spring_by_explicit_exchange_gives_the_numbers_of_the_body_itself(exports, name, runtime):
    stiffness, body = 2e4, FlexibleBody(exports[0])
    found, said = run_of(name, exports[1][runtime], {}, {"spring": ["tip.force.y", stiffness, 1]})
    assert found is not None, said
    state, loads, expected = body.rest(), dict(LOADS), []
    for _ in range(COUNT):
        if expected:
            loads["tip.force.y"] = -stiffness * expected[-1][1]
        state = body.step(state, on_tip(loads), STEP)
        response = body.response(state)
        expected.append([*response.displacement[0], *response.rotation[0]])
    assert np.ptp(np.array(expected)[:, 1]) > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "runtime"), [(name, export) for name, found in EXPORTS.items() for export in found])
def test_steps_of_a_second_end_where_the_body_rests_also_past_the_end_of_the_default_experiment(exports, name, runtime):
    found, said = run_of(name, exports[1][runtime], {}, LATER, 1.0)
    assert found is not None, said
    body = FlexibleBody(exports[0])
    rest = body.response(body.static(on_tip(LOADS | LATER)))
    right = np.allclose(found[-1], [*rest.displacement[0], *rest.rotation[0]], rtol=1e-4, atol=1e-9)
    assert told(name, runtime, "steps of 1 s") == ("right" if right else "wrong")


def test_every_use_has_its_test():
    for place in ELSEWHERE.values():
        file, _, name = place.partition("::")
        assert f"def {name}(" in (SCRIPTS.parent / file).read_text(encoding="utf-8")


def test_the_page_of_masters_has_a_row_for_each_and_a_cell_for_each_use():
    assert list(rows_of_the_page()) == list(TITLES.values())
    for name in EXPORTS:
        row = rows_of_the_page()[TITLES[name]]
        assert set(row) == {*WRONG, "steps of 1 s"}
        assert (row["a stiff spring"] == "") == (name not in FOLLOWING)


def test_every_output_is_a_real_number_as_masters_take_it_for(beam):
    with zipfile.ZipFile(beam[1]) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables = {v.get("name"): v for v in root.find("ModelVariables")}
    outputs = [v for v in variables.values() if v.get("causality") == "output"]
    assert [v.get("name") for v in outputs] == OUTPUTS
    assert {v[0].tag for v in outputs} == {"Real"}
    assert variables["status.code"].get("causality") == "local"
    assert variables["status.code"][0].tag == "Integer"


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("pathsim_fmi") is None, reason="PathSim is not installed")
def test_pathsims_blocks_show_at_each_time_what_holds_a_step_later(beam):
    """Their first step begins at the time 0: the last value is a step ahead, not wrong."""
    script = """
import json, sys
from pathsim import Connection, Simulation
from pathsim.blocks import Scope, Source
from pathsim_fmi import CoSimulationFMU
body, push, scope = CoSimulationFMU(sys.argv[1], dt=1e-3), Source(lambda time: 100.0), Scope()
wires = [Connection(push, body["tip.force.y"]), Connection(body["tip.displacement.y"], scope[0])]
Simulation([body, push, scope], wires, dt=1e-3, log=False).run(0.02)
print(json.dumps([list(found) for found in (scope.read()[0], scope.read()[1][0])]))
"""
    command = [sys.executable, "-c", script, str(beam[1])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=True)
    time, shown = np.array(json.loads(done.stdout.splitlines()[-1]))
    body, expected = FlexibleBody(beam[0]), [0.0]
    state = body.rest()
    for _ in range(21):
        state = body.step(state, {"tip": [0.0, 100.0, 0.0, 0.0, 0.0, 0.0]}, 1e-3)
        expected.append(body.response(state).displacement[0, 1])
    np.testing.assert_allclose(time, 1e-3 * np.arange(21), atol=1e-12)
    np.testing.assert_allclose(shown, expected[1:], rtol=0, atol=1e-15)
    assert abs(shown[-1] - expected[20]) > 1e-3 * abs(shown[-1])


# A master that is no Python program.


@pytest.fixture(scope="module")
def master(tmp_path_factory):
    """The compiled C master."""
    if sys.platform != "linux":
        pytest.skip("the C master is written for dlopen and binaries/linux64")
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("there is no C compiler")
    program = tmp_path_factory.mktemp("master") / "master"
    command = [compiler, "-std=c11", "-Wall", "-Wextra", str(SCRIPTS / "master.c"), "-o", str(program), "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return program


class Unpacked:
    """An FMU in a folder of its own, and the C master that runs it."""

    def __init__(self, master, fmu, folder):
        self.master, self.folder = master, folder
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.reference = {v.get("name"): v.get("valueReference") for v in root.find("ModelVariables")}
        self.guid, name = root.get("guid"), root.find("CoSimulation").get("modelIdentifier")
        self.library = folder / "binaries" / "linux64" / f"{name}.so"

    def run(self, count, texts=None, guid=None, resources=None, **environment):
        """Run the C master in an environment in which no Python is to be found."""
        place = resources or (self.folder / "resources").as_uri()
        words = [str(self.master), str(self.library), place, guid or self.guid, str(STEP), str(count)]
        words += [f"s:{self.reference[name]}={value}" for name, value in (texts or {}).items()]
        words += [f"r:{self.reference[name]}={value!r}" for name, value in LOADS.items()]
        words += [f"o:{self.reference[name]}" for name in OUTPUTS]
        return subprocess.run(
            words, capture_output=True, text=True, timeout=120, check=False, env={"PATH": "", **environment}
        )


def numbers_of(done):
    """Rows that the C master printed."""
    *rows, last = done.stdout.splitlines() or [""]
    assert last == "done", f"{done.returncode}\n{done.stdout}\n{done.stderr}"
    return np.array([[float(word) for word in row.split()] for row in rows])


@pytest.fixture
def unpacked(beam, master, tmp_path):
    """The beam's FMU in a folder whose path is hard to spell."""
    return Unpacked(master, beam[1], tmp_path / "Träger für 100 % Last #1" / "中")


@pytest.mark.parametrize("start", STARTS)
def test_a_master_in_c_without_python_agrees_with_fmpy_to_the_last_bit(unpacked, beam, expected, start):
    assert "%23" in (unpacked.folder / "resources").as_uri()
    found = numbers_of(unpacked.run(COUNT // 2, STARTS[start]))
    by_fmpy = np.array(in_master("fmpy", beam[1], start))
    # 17 digits tell every number from its neighbours.
    np.testing.assert_array_equal(found[1:], by_fmpy[: COUNT // 2])
    np.testing.assert_allclose(found[1:], expected[start][: COUNT // 2], rtol=0, atol=1e-12)
    assert np.max(np.abs(found)) > 0.05
    if start == "rest":
        np.testing.assert_array_equal(found[0], 0.0)


def test_no_python_is_in_the_process_of_a_master_in_c(unpacked):
    # The loader's own account of all libraries.
    done = unpacked.run(1, LD_DEBUG="libs")
    numbers_of(done)
    loaded = {
        Path(line.split("calling init: ")[1].strip()).name
        for line in done.stderr.splitlines()
        if "calling init:" in line
    }
    assert unpacked.library.name in loaded, done.stderr
    assert not [name for name in loaded if "python" in name.lower()]


def spelled(folder):
    """Addresses of a folder as masters spell them."""
    plain = str(folder)
    return {
        "plain path": plain,
        "one slash": f"file:{quote(plain)}",
        "host": f"file://localhost{quote(plain)}",
        "small letters": re.sub("%[0-9A-F]{2}", lambda code: code[0].lower(), folder.as_uri()),
        "slash at the end": folder.as_uri() + "/",
        # Not right, but common.
        "nothing escaped": f"file://{plain}",
    }


@pytest.mark.parametrize("spelling", spelled(Path("/x")))
def test_the_address_of_the_resources_may_be_spelled_in_any_way(beam, master, tmp_path, spelling):
    one = Unpacked(master, beam[1], tmp_path / "ü #1")
    assert numbers_of(one.run(1, resources=spelled(one.folder / "resources")[spelling])).shape == (2, 6)


def test_a_wrong_guid_is_refused_with_both_in_the_log(unpacked):
    wrong = "{01234567-0123-4567-89ab-0123456789ab}"
    done = unpacked.run(1, guid=wrong)
    assert done.returncode == 3
    assert "no instance" in done.stderr
    assert wrong in done.stderr
    assert unpacked.guid in done.stderr


@pytest.mark.parametrize("part", ["body.prog", "linear.prog"])
def test_the_data_of_another_body_are_refused(unpacked, tmp_path, part):
    package_fmu(beam_body(3, modes=3, damping=0.03), tmp_path / "other.fmu")
    with zipfile.ZipFile(tmp_path / "other.fmu") as archive:
        (unpacked.folder / "resources" / part).write_bytes(archive.read(f"resources/{part}"))
    done = unpacked.run(1, {"method": "linear"})
    assert done.returncode == 3
    assert ("different FMUs" if part == "body.prog" else "of another body") in done.stderr


def test_resources_that_are_not_there_are_named(unpacked):
    done = unpacked.run(1, resources=(unpacked.folder / "nowhere").as_uri())
    assert done.returncode == 3
    assert "nowhere" in done.stderr
    assert "body.prog" in done.stderr


def test_an_fmu_for_python_tells_the_loader_what_it_lacks(master, tmp_path):
    package_fmu(beam_body(3, modes=3), tmp_path / "python.fmu", Runtime.PYTHON)
    done = Unpacked(master, tmp_path / "python.fmu", tmp_path / "python").run(1)
    assert done.returncode == 2
    assert "undefined symbol" in done.stderr
    assert "Py" in done.stderr
