"""The examples in docstrings of what the package offers give what they say."""

import doctest
import importlib
import subprocess
import sys

import numpy as np
import pytest

import flexfmu
from flexfmu.files.outputs import Reporter
from given_bars import bar, eigenmodes
from meshes import write_deck

MODULES = (
    "api",
    "body.flexible_body",
    "given.modes",
    "given.linear",
    "mesh.formats",
    "mesh.shells",
    "given.packing",
)
BODY = """name = "arm"
frames = 2
support = [{ nodes = "ROOT", fix = ["x", "y", "z"] }]
interface = [{ name = "tip", nodes = "TIP" }]
reduction = { modes = 6, residual_flexibility = true }

[mesh]
file = "arm.inp"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A steel bar of 1 × 0.05 × 0.05 m, as the examples find it: deck, body file, FMU, modes, SID_FEM."""
    place, mesh = tmp_path_factory.mktemp("examples"), bar()
    write_deck(mesh, place / "arm.inp")
    (place / "body.toml").write_text(BODY, encoding="utf-8")
    flexfmu.Body.read(place / "body.toml", Reporter()).build().fmu(place / "arm.fmu")
    modes, frequency, mass = eigenmodes(mesh, mesh.node_sets["ROOT"])
    cells = {"hexahedron20": mesh.blocks[0].connectivity}
    given = flexfmu.GivenModes(mesh.points, modes, frequency, mass, mesh.node_sets, cells, name="arm")
    given.save(place / "modes.npz")
    flexfmu.write_sid(given, {"tip": "TIP"}, place / "given.SID_FEM")
    return place


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_examples_give_what_they_say(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    known = {"flexfmu": flexfmu, "np": np, "arm": flexfmu.load("arm.fmu")}
    tests = doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module(f"flexfmu.{name}"), extraglobs=known)
    told: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    for test in tests:
        runner.run(test, out=told.append)
    assert runner.tries > 0
    assert not runner.failures, "".join(told)


def test_each_function_that_is_offered_has_an_example():
    offered = [getattr(flexfmu, name) for name in flexfmu.__all__ if name != "__version__"]
    functions = [each for each in offered if callable(each) and not isinstance(each, type)]
    assert len(functions) > 5
    assert [each.__name__ for each in functions if ">>>" not in (each.__doc__ or "")] == []


def test_completion_shows_every_public_name():
    done = subprocess.run(
        [sys.executable, "-c", "import flexfmu; print(set(flexfmu.__all__) - set(dir(flexfmu)), len(flexfmu.__all__))"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("set() ")
    assert int(done.stdout.split()[-1]) > 20
