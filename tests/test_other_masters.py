"""The same FMU in other masters gives the same numbers: Python packages, and a C program."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from bodies import beam_body
from flexfmu.body import FlexibleBody
from flexfmu.fmu.package import package_fmu

SCRIPTS = Path(__file__).with_name("native_master")
MARK = "RESULT "
STEP, COUNT = 1e-3, 40
# Before the start, and from the middle of the run on.
LOADS = {"tip.force.x": -500.0, "tip.force.y": 2000.0}
LATER = {"tip.force.z": 1500.0, "tip.moment.x": 40.0}
OUTPUTS = [f"tip.{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz"]
STARTS = {"rest": {}, "static": {"initialization": "static"}}
# Those that set texts start in either way; the others know numbers only.
MASTERS = [(name, start) for name in ("fmpy", "libcosimpy", "ecospy") for start in STARTS]
MASTERS += [(name, "rest") for name in ("pathsim_fmi", "cofmupy", "gemseo_fmu")]


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """Body and FMU of a damped beam."""
    model = beam_body(3, modes=3, damping=0.02)
    path = tmp_path_factory.mktemp("fmus") / "beam.fmu"
    package_fmu(model, path)
    return model, path


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


def in_master(name, path, start):
    """Outputs after every step in a master that is a Python package, in a process of its own."""
    arguments = json.dumps([str(path), STARTS[start], LOADS, LATER, STEP, COUNT, OUTPUTS])
    command = [sys.executable, str(SCRIPTS / "python_masters.py"), name, arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if not lines and "libtbb" in done.stderr:
        pytest.skip("ecospy needs oneTBB: the package tbb, or Debian's libtbb12")
    assert lines, f"{name} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}"
    return json.loads(lines[-1][len(MARK) :])


@pytest.mark.parametrize(("name", "start"), MASTERS)
def test_masters_give_the_numbers_of_the_body_itself(beam, expected, name, start):
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed: pip install {name.replace('_', '-')}")
    found = in_master(name, beam[1], start)
    assert np.max(np.abs(expected[start])) > 0.05
    np.testing.assert_allclose(found, expected[start], rtol=0, atol=1e-12)


def test_every_output_is_a_real_number_as_masters_take_it_for(beam):
    with zipfile.ZipFile(beam[1]) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables = {v.get("name"): v for v in root.find("ModelVariables")}
    outputs = [v for v in variables.values() if v.get("causality") == "output"]
    assert [v.get("name") for v in outputs] == OUTPUTS
    assert {v[0].tag for v in outputs} == {"Real"}
    assert variables["status.code"].get("causality") == "local"
    assert variables["status.code"][0].tag == "Integer"


# A master that is no Python program.


@pytest.fixture(scope="module")
def libpython():
    """The shared library of this Python."""
    if sys.platform == "win32":
        pytest.skip("the C master is written for dlopen")
    names = [sysconfig.get_config_var(name) for name in ("INSTSONAME", "LDLIBRARY")]
    folders = [sysconfig.get_config_var("LIBDIR"), str(Path(sys.base_prefix) / "lib")]
    for folder in folders:
        for name in names:
            path = Path(folder or "", name or "")
            if path.is_file() and ".so" in path.name:
                return path
    pytest.skip(f"this Python has no shared library: no {' or '.join(map(str, names))} in {folders[0]}")


@pytest.fixture(scope="module")
def master(tmp_path_factory):
    """The compiled C master."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("there is no C compiler")
    program = tmp_path_factory.mktemp("master") / "master"
    command = [compiler, "-std=c11", "-Wall", "-Wextra", str(SCRIPTS / "master.c"), "-o", str(program), "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return program


@pytest.fixture
def run(beam, master, tmp_path):
    """Run the C master on the beam's FMU, unpacked: its standard output and error."""
    with zipfile.ZipFile(beam[1]) as archive:
        archive.extractall(tmp_path)
    root = ElementTree.parse(tmp_path / "modelDescription.xml").getroot()
    reference = {v.get("name"): v.get("valueReference") for v in root.find("ModelVariables")}
    library = tmp_path / "binaries" / "linux64" / f"{root.find('CoSimulation').get('modelIdentifier')}.so"

    def call(count, texts=None, **environment):
        words = [str(master), str(library), (tmp_path / "resources").as_uri(), root.get("guid"), str(STEP), str(count)]
        words += [f"s:{reference[name]}={value}" for name, value in (texts or {}).items()]
        words += [f"r:{reference[name]}={value!r}" for name, value in LOADS.items()]
        words += [f"o:{reference[name]}" for name in OUTPUTS]
        outside = {k: v for k, v in os.environ.items() if k not in ("LD_PRELOAD", "PYTHONPATH", "PYTHONHOME")}
        # The interpreter is found like any program: by the path.
        found = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        return subprocess.run(
            words, capture_output=True, text=True, timeout=120, check=False, env=outside | found | environment
        )

    return call


@pytest.mark.parametrize("start", STARTS)
def test_a_master_in_c_gives_the_same_numbers(run, libpython, expected, start):
    done = run(COUNT // 2, STARTS[start], LD_PRELOAD=str(libpython))
    *rows, last = done.stdout.splitlines() or [""]
    assert last == "done", f"{done.returncode}\n{done.stdout}\n{done.stderr}"
    found = np.array([[float(word) for word in row.split()] for row in rows])
    np.testing.assert_allclose(found[1:], expected[start][: COUNT // 2], rtol=0, atol=1e-12)
    if start == "rest":
        np.testing.assert_array_equal(found[0], 0.0)


def test_a_master_in_c_is_told_by_the_loader_when_libpython_is_missing(run):
    done = run(1)
    assert done.returncode == 2
    assert "undefined symbol" in done.stderr
    assert "Py" in done.stderr


def test_a_master_in_c_is_told_in_the_log_when_numpy_and_h5py_are_missing(run, libpython, tmp_path):
    # Any interpreter without packages stands for a PATH that leads to the wrong one.
    bare = tmp_path / "bare"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(bare)], check=True)
    done = run(1, PATH=f"{bare / 'bin'}{os.pathsep}{os.environ['PATH']}", LD_PRELOAD=str(libpython))
    assert "ModuleNotFoundError" in done.stderr
    assert "done" not in done.stdout.splitlines()
