"""What users get wrong: each mistake is answered with the key, what was found and what would do, and leaves no file."""

import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from flexfmu.api import Body
from flexfmu.body.loads import loads_from_mapping
from flexfmu.build.kept import build_fmu
from flexfmu.calls.functions import chart
from flexfmu.commands.cli import app
from flexfmu.files.basics import FlexfmuError, LoadError
from flexfmu.fmu.simulation import _tell_passed_over
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from meshes import BAR, box, write_deck
from scene_tools import Listening

SCENE = '[[static]]\nname = "bend"\nloads = { "tip.force.y" = 100.0 }\n'
COUPLING = """
[experiment]
stop = 0.01
step = 0.001
[[fmu]]
name = "arm"
file = "bar.fmu"
[[spring]]
a = "arm.tip"
stiffness = [1, 1, 1, 0, 0, 0]
"""
DECK_IN_T_AND_MM = """*NODE
1, 0, 0, 0
2, 10, 0, 0
3, 0, 10, 0
4, 0, 0, 10
*ELEMENT, TYPE=C3D4, ELSET=ALL
1, 1, 2, 3, 4
*MATERIAL, NAME=STEEL
*ELASTIC
210000, 0.3
*DENSITY
7.85e-9
*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL
"""
LOADS = "time,tip.force.y\n0,10\n0.01,10\n"


class Mistake(NamedTuple):
    """A command, the files that it needs, its exit code, and what the answer must say."""

    arguments: list[str]
    files: dict[str, str]
    words: list[str]
    code: int = 1
    runs: bool = False
    """Whether it gets as far as running an FMU, which needs a process of its own."""


def body(old, new, *words, code=1):
    """Build a body file with a change."""
    assert old in BAR
    return Mistake(["build", "body.toml", "-o", "out.fmu"], {"body.toml": BAR.replace(old, new)}, list(words), code)


def files(command, *words):
    """Give a command wrong files."""
    return Mistake(command.split(), {}, list(words))


def loads(table, *words, options="", code=1, runs=False):
    """Simulate with a table of loads."""
    command = f"simulate bar.fmu -i loads.csv -o out.csv {options}".split()
    return Mistake(command, {"loads.csv": table}, list(words), code, runs)


def options(text, *words, code=1, runs=False):
    """Simulate with options."""
    return loads(LOADS, *words, options=text, code=code, runs=runs)


def scene(old, new, *words):
    """Chart a scene with a change."""
    assert old in SCENE
    command = ["chart", "body.toml", "--scene", "scene.toml", "--records", "out.csv"]
    return Mistake(command, {"scene.toml": SCENE.replace(old, new)}, list(words))


def coupling(old, new, *words):
    """Run a coupling with a change."""
    assert old in COUPLING
    return Mistake(
        ["couple", "coupling.toml", "-o", "out.csv"], {"coupling.toml": COUPLING.replace(old, new)}, list(words)
    )


FIX, MESH, RATIO, TIP = 'fix = ["x", "y", "z"]', 'file = "bar.inp"', "ratio = 0.01", 'nodes = "TIP"'
MISTAKES = {
    # Keys and tables of the body file.
    "frame for frames": body("frames = 3", "frame = 8", "frame: found 8", "expected [[frame]]", "or the key frames"),
    "capital letters": body("frames", "Frames", "Frames: unknown key", "did you mean 'frames'"),
    "key below a table": body(
        MESH, f"{MESH}\nfree = true", "mesh.free: unknown key", "at the top, above the first table"
    ),
    "key below the last table": body(
        TIP, f"{TIP}\nframes = 2", "interface[1].frames: unknown key", "Or it belongs at the top, above the first table"
    ),
    "key of another table": body(RATIO, f"{RATIO}\nmodes = 5", "damping.modes: unknown key", "belongs to [reduction]"),
    "directions as one text": body(FIX, 'fix = "xyz"', "support[1].fix: found 'xyz'", 'such as fix = ["x", "y", "z"]'),
    "[interface]": body(
        "[[interface]]", "[interface]", "interface: found one table", "expected [[interface]], in double"
    ),
    "[[mesh]]": body("[mesh]", "[[mesh]]", "mesh: found several tables", "one table, [mesh], in single brackets"),
    "name with a blank": body(
        '"bar"', '"long bar"', "name: found 'long bar'", "letters, digits and _, beginning with a"
    ),
    "name that begins with a digit": body(
        '"tip"', '"1st"', "interface[1].name: found '1st'", "beginning with a letter"
    ),
    "no name": body('name = "bar"', "", "name: missing", 'such as name = "arm"'),
    "no mesh file": body(MESH, "", "mesh.file: missing", 'such as file = "arm.inp"'),
    "two stiffnesses": body(
        FIX, "stiffness = [1e6, 1e6]", "expected 3 values, there are 2", "such as stiffness = [1000000"
    ),
    "number of a node": body(
        TIP, "nodes = 12", "interface[1].nodes: found 12", "string", "a table { … }", 'such as nodes = "FLANGE"'
    ),
    "plane without normal": body(TIP, "nodes = { plane = [1, 0, 0] }", "interface[1].nodes", "goes with normal"),
    "a place off the body": body(
        TIP, "nodes = { plane = [9.0, 0, 0], normal = [1, 0, 0] }", "no node lies there", "misses it by 8 m"
    ),
    "text without quotes": body(TIP, "nodes = TIP", "not valid TOML", "line 11", "texts stand in quotes"),
    "a table twice": body(
        RATIO, f"{RATIO}\n[mesh]\nunits = 'm-kg-s'", "not valid TOML", "'mesh'", "a [table] stands once"
    ),
    "units by one word": body(MESH, f'{MESH}\nunits = "mm"', "mesh.units: found 'mm'", "'mm-t-s'"),
    "an interface on a support": body(
        TIP, 'nodes = "ROOT"', "interface 'tip' lies on a support", "it does not move", "if it is meant, add --force"
    ),
    "an interface over the whole body": body(
        TIP,
        "nodes = { box = [[-1, -1, -1], [2, 2, 2]] }",
        "of the body's 56 nodes",
        "an average over all of it",
        "--force",
    ),
    "a point in the mesh's millimetres": body(
        TIP,
        f"{TIP}\npoint = [1000.0, 50.0, 50.0]",
        "m outside the body, which measures 1 m",
        "points are in the mesh's units",
        "--force",
    ),
    "what is meant is built with a warning": Mistake(
        ["build", "body.toml", "-o", "out.fmu", "--force"],
        {"body.toml": BAR.replace(TIP, 'nodes = "ROOT"')},
        ["! interface 'tip' lies on a support"],
        code=0,
    ),
    "a geometry for a mesh": Mistake(
        ["build", "body.toml", "-o", "out.fmu"],
        {"body.toml": BAR.replace("bar.inp", "part.step"), "part.step": "ISO-10303-21;"},
        ["part.step: a geometry without elements; mesh it first", "gmsh part.step -3 -order 2"],
    ),
    "a set that is not there": body(TIP, 'nodes = "TOP"', "interface 'tip', nodes", "no node set 'TOP'", "ROOT, TIP"),
    # Sizes.
    "modes = 1e9": body("modes = 6", "modes = 1e9", "reduction.modes: found 1000000000.0", "at most 1000"),
    "a thousand million modes": body("modes = 6", "modes = 1_000_000_000", "reduction.modes", "equal to 1000"),
    "no modes": body("modes = 6", "modes = 0", "reduction.modes: found 0; should be greater than or equal to 1\n"),
    "a mode of that number": body("modes = 6", "modes = [1, 1_000_000_000]", "reduction.modes[2]", "equal to 1000"),
    "frames = 1e9": body("frames = 3", "frames = 1e9", "frames: found 1000000000.0", "at most 1000"),
    "a thousand million frames": body("frames = 3", "frames = 1_000_000_000", "frames: found", "equal to 1000"),
    "more frames than layers": body(
        "frames = 3", "frames = 900", "frames = 900", "layers of elements for 4 only", code=0
    ),
    # Values that mean something else.
    "damping of 2 percent as 2": body(RATIO, "ratio = 2", "damping.ratio: is 2", "a share from 0 to 1", "2 % is 0.02"),
    "damping of 1 percent as 1": body(RATIO, "ratio = 1", "damping.ratio = 1 of the first mode", "1 % is 0.01", code=0),
    "percent sign": body(RATIO, 'ratio = "1%"', "damping.ratio: found '1%'", "number", "such as ratio = 0.01"),
    "density in t/mm³": body(
        RATIO,
        f"{RATIO}\n[material]\nyoungs_modulus = 2e11\npoissons_ratio = 0.3\ndensity = 8e-9",
        "[material] is not used",
        "take one of them out",
        code=0,
    ),
    "a deck in t, mm and s as one in kg, m and s": Mistake(
        ["build", "body.toml", "-o", "out.fmu"],
        {"bar.inp": DECK_IN_T_AND_MM},
        ["density 7.85e-09 means 7.85e-09 kg/m³", 'in mm-t-s, where it is 7850 kg/m³, set units = "mm-t-s" in [mesh]'],
    ),
    # One file for another.
    "build a deck": files("build bar.inp -o out.fmu", "bar.inp is a mesh", "expected a body file", "in [mesh]"),
    "build an FMU": files("build bar.fmu -o out.fmu", "bar.fmu is an FMU", "expected a body file"),
    "build a scene": files("build scene.toml -o out.fmu", "scene.toml is a scene file", "chart` and `fit` as --scene"),
    "build nothing": files("build nobody.toml -o out.fmu", "nobody.toml: no such file", "expected a body file"),
    "FMU of another ending": files("build body.toml -o out.zip", "out.zip", "ends in .fmu"),
    "pack a body file": files("pack body.toml -o out.fmu", "body.toml is a body file, expected modes (.npz or .h5)"),
    "info on a body file": files(
        "info body.toml", "body.toml is a body file", "an FMU or a modal file", "`flexfmu build`"
    ),
    "info on a table": files("info loads.csv", "loads.csv is a table", "expected an FMU or a modal file"),
    "simulate a body file": files("simulate body.toml -i loads.csv -o out.csv", "is a body file, expected an FMU"),
    "simulate a modal file": files("simulate bar.h5 -i loads.csv -o out.csv", "is a modal file, expected an FMU"),
    "couple a body file": files("couple body.toml -o out.csv", "body.toml is a body file, expected a coupling file"),
    "body and scene exchanged": files(
        "fit scene.toml -s body.toml -o out.toml", "body.toml is a body file, expected a scene"
    ),
    "records as a picture": files("chart body.toml -s scene.toml -r out.png", "out.png", "ends in .csv"),
    "a folder as mesh": body(MESH, 'file = "."', "it is a folder", "expected a mesh"),
    # Tables of loads.
    "semicolons": loads(
        LOADS.replace(",", ";"), "loads.csv: its columns are separated by semicolons", '"time,NAME,…" (commas)'
    ),
    "tabs": loads(LOADS.replace(",", "\t"), "separated by tabs", "commas"),
    "decimal commas": loads("time,tip.force.y\n0,0,10,0\n0,01,10,0\n", "line 2: 4 columns", "decimal points"),
    "comma at the end of the header": loads(
        LOADS.replace("y\n", "y,\n"), "column 3 of the header has no name", "commas at the ends of lines"
    ),
    "no number": loads(LOADS.replace("10", "nan"), "line 2: tip.force.y is nan, expected a finite number"),
    "unit of time": loads(LOADS.replace("time", "time [kg]"), "time [kg]: the unit is 'kg'", "one of s, ms"),
    "unit of a force": loads(
        LOADS.replace("y", "y [mm]"), "tip.force.y [mm]: the unit is 'mm'", "expected one of N, mN, kN"
    ),
    "no header": loads("0,10\n1,10\n", "the first line is numbers", 'expected a header "time,NAME,…"'),
    "a word in a column": loads(
        LOADS.replace("0.01,10", "0.01,ten"), "line 3: tip.force.y is 'ten'", "expected numbers"
    ),
    "a pulse between communication points": loads(
        "time,tip.force.y\n0,0\n0.0051,0\n0.0055,9\n0.0059,0\n0.01,0\n",
        "pass over 100 % of tip.force.y (area over time), most of it at 0.0055 s",
        "rows are 0.0004 s apart",
        options="--step 0.001",
        code=0,
        runs=True,
    ),
    "one row": loads("time,tip.force.y\n0,10\n", "rows at one time only, 0 s", "add a later row, or give --stop"),
    "no row": loads("time,tip.force.y\n", "a header and nothing else", "at least one row"),
    "misspelt input": loads(LOADS.replace("force", "forse"), "'tip.forse.y' is no input", "did you mean 'tip.force.y'"),
    "output as input": loads(LOADS.replace("force", "rotation"), "'tip.rotation.y' is no input", "causality output"),
    "unit beside a number": loads(
        LOADS.replace("10", "10N"), "loads.csv, line 2", "'10N'", "expected numbers, units in the header"
    ),
    "no column but time": loads("time\n0\n0.01\n", "no column but time", "add inputs by name", code=0, runs=True),
    # Options of simulate.
    "value without parameter": options(
        "--set 0.5", "--set 0.5: lacks the parameter's name", "NAME=VALUE", "damping.scale=2"
    ),
    "parameter without value": options("--set damping.scale", "--set damping.scale: lacks a value", "NAME=VALUE"),
    "parameter twice": options("--set damping.scale=1 --set damping.scale=2", "damping.scale is set twice"),
    "misspelt parameter": options(
        "--set damping=2", "'damping' is no parameter of bar.fmu", "did you mean 'damping.scale'"
    ),
    "input as a parameter": options(
        "--set tip.force.y=3", "'tip.force.y' is no parameter of bar.fmu", "give it a column of the table"
    ),
    "text for a number": options("--set damping.scale=two", "--set damping.scale=two", "a finite number ≥ 0"),
    "negative damping": options("--set damping.scale=-1", "--set damping.scale=-1", "a finite number ≥ 0"),
    "unknown choice": options(
        "--set initialization=still", "is 'still'", "expected one of 'rest', 'static'", runs=True
    ),
    "contradicting starts": options("--static-start --set initialization=rest", "--static-start and --set", code=2),
    "step tolerance of 3": options(
        "--set internal_step.tolerance=3", "internal_step.tolerance = 3", "expected a share below 1", code=0, runs=True
    ),
    "stop beyond the table": options(
        "--stop 0.03", "ends at 0.03 s, its table at 0.01 s", "the last loads are held", code=0, runs=True
    ),
    "stop before the start": options("--stop -1", "from 0.0 s to -1.0 s", "expected a later end", "--stop"),
    "step longer than the run": options("--step 1", "--step is 1 s", "longer than the run from 0 s to 0.01 s"),
    # Scenes and couplings.
    "tolerance of 3": scene(
        SCENE, f"{SCENE}[tolerance.static]\ndisplacement = 3", "tolerance.static.displacement: is 3", "3 % is 0.03"
    ),
    "[static]": scene("[[static]]", "[static]", "static: found one table", "expected [[static]], in double brackets"),
    "factors as a text": scene(SCENE, f'{SCENE}factors = "half"\n', "found 'half'", "such as factors = [0.5, 1.0]"),
    "loads as a number": scene(
        '{ "tip.force.y" = 100.0 }', "100.0", "static[1].loads: found 100.0", '"tip.force.y" = 1000.0'
    ),
    "load without axis": scene("tip.force.y", "tip.force", "'tip.force' is no input of the body", '"tip.force.y"'),
    "modes of a sweep as a number": scene(
        SCENE, f"{SCENE}[sweep]\nmodes = 10", "sweep.modes: found 10", "modes = [10]"
    ),
    "three stiffnesses of six": coupling(
        "[1, 1, 1, 0, 0, 0]", "[1, 1, 1]", "spring[1].stiffness: found [1, 1, 1]", "expected 6 values, there are 3"
    ),
    "stiffness as a number": coupling(
        "[1, 1, 1, 0, 0, 0]", "1e3", "spring[1].stiffness: found 1000.0", "such as stiffness = ["
    ),
    "scheme with a hyphen": coupling(
        "[[fmu]]", 'scheme = "gauss-seidel"\n[[fmu]]', "experiment.scheme", "'gauss_seidel'"
    ),
    "tolerance of a coupling": coupling(
        "[[fmu]]", "tolerance = 3\n[[fmu]]", "experiment.tolerance: found 3", "less than 1"
    ),
    "interface without its FMU": coupling("arm.tip", "tip", "spring 1, a: found 'tip'", '"FMU.NAME" with one of arm'),
    "FMU that is a body file": coupling('"bar.fmu"', '"body.toml"', "fmu 'arm'", "is a body file, expected an FMU"),
    # What TOML makes of what people write.
    "True with a capital": body(
        "frames = 3", "free = True", "'free = True'; true and false are written in small letters"
    ),
    "comment of another language": body("frames = 3", "frames = 3 // levels", "line 3", "a comment begins with #"),
    "quotes of a word processor": body('"bar"', "“bar”", "line 2", "quotes are straight"),
    "colon for equals": body("frames = 3", "frames: 3", "Expected '='", "'frames: 3'"),
    "backslashes that are escapes": body(
        MESH, 'file = "C:\\new\\bar.inp"', "mesh.file: is 'C:", "a backslash in double quotes is an escape", "write /"
    ),
    "backslashes that are none": body(
        MESH, 'file = "C:\\Users\\x.inp"', "a backslash in double quotes", "'single quotes'"
    ),
    "a number for a file": body(
        MESH, "file = 3", "mesh.file: found 3; should be a file's name in quotes, such as file"
    ),
    "true as a text": body("frames = 3", 'free = "yes"', "free: found 'yes'; should be true or false without quotes"),
    "number with a unit": body(
        RATIO,
        f'{RATIO}\n[material]\ndensity = "7850 kg/m3"',
        "found '7850 kg/m3'; should be a number without quotes",
    ),
    "a word for a number": body("frames = 3", 'frames = "auto"', "should be a valid integer, such as frames = 4"),
    "nothing in the file": Mistake(
        ["build", "body.toml", "-o", "out.fmu"],
        {"body.toml": ""},
        ["name: missing", "mesh: missing", "interface: missing"],
    ),
    # Supports, interfaces, materials.
    "axis in capitals": body(FIX, 'fix = ["X"]', "support[1].fix[1]: found 'X'; should be 'x', 'y' or 'z'"),
    "rotation held": body(FIX, 'fix = ["x", "rx"]', "support[1].fix[2]: found 'rx'; should be 'x', 'y' or 'z'"),
    "support of nothing": body('nodes = "ROOT"', "", "support[1].nodes: missing", 'such as nodes = "CLAMP"'),
    "plural of a table": body("[[support]]", "[[supports]]", "supports: unknown key, did you mean 'support'?"),
    "too few supports": body(
        FIX, 'fix = ["x"]', "free to move in 3 rigid motions", "add a [[support]], or let it float"
    ),
    "floating and held": body("frames = 3", "free = true", "free = true, but the supports hold the body", "take out"),
    "two of a name": body(RATIO, f'{RATIO}\n[[interface]]\nname = "tip"\nnodes = "ROOT"', "have the name 'tip'"),
    "one of several sets": body(
        TIP, 'nodes = ["TIP", "TOP"]', "interface tip: the mesh has no node set 'TOP'", "ROOT, TIP"
    ),
    "bore without radius": body(TIP, "nodes = { cylinder = [[0, 0, 0], [1, 0, 0]] }", "cylinder", "go with radius"),
    "symbols for names": body(RATIO, f"{RATIO}\n[material]\nE = 2e11", "material.E: unknown key", "youngs_modulus"),
    "incompressible": body(RATIO, f"{RATIO}\n[material]\npoissons_ratio = 0.5", "found 0.5; should be less than 0.5"),
    "method by half its name": body(
        RATIO,
        f'{RATIO}\n[formulation]\nmethod = "nonlinear"',
        "found 'nonlinear'",
        "'frames_stiffness' or 'second_order'",
    ),
    "mesh that is not there": body(
        MESH, 'file = "bra.inp"', "bra.inp: no such file, expected a mesh; correct the path"
    ),
    # Tables, scenes, couplings, options.
    "a workbook": loads("PK\x03\x04", "loads.csv is a workbook or an archive, expected a table; save it as CSV"),
    "an empty cell": loads("time,tip.force.y\n0,\n1,2\n", "line 2: tip.force.y is ''; expected numbers"),
    "time with a capital": loads(LOADS.replace("time", "Time"), "called 'Time': call it \"time\", in s"),
    "time that goes back": loads("time,tip.force.y\n0,1\n1,2\n0.5,3\n", "line 4: time goes back from 1.0 to 0.5"),
    "results over the loads": files("simulate bar.fmu -i loads.csv -o loads.csv", "what the job reads", "another name"),
    "picture of another kind": files("simulate bar.fmu -i loads.csv -o out.csv --plot p.jpg", "ends in .png or .pdf"),
    "live under a load": files(
        "view bar.fmu --live out.html --load tip.force.y=1kN", "a live page begins at rest, without loads"
    ),
    "live and another page": Mistake(
        ["view", "bar.fmu", "--live", "live.html", "-o", "out.html"], {}, ["give one of them"], 2
    ),
    "load in mm": files("view bar.fmu --load tip.force.y=10mm -o p.html", "the unit is 'mm', expected one of N, mN"),
    "nothing happens": scene(SCENE, "", "nothing happens in the scene: give a [[static]] or a [[transient]] table"),
    "no step": scene(SCENE, '[[transient]]\nname = "a"\nloads = {}\n', "step: missing", "such as step = 0.001"),
    "results that are not there": scene(SCENE, f'{SCENE}results = "r.csv"', "r.csv: no such file, expected a table"),
    "FMU that is not there": coupling('"bar.fmu"', '"nix.fmu"', "fmu 'arm': nix.fmu: no such file, expected an FMU"),
    "interface of another name": coupling("arm.tip", "arm.top", "'top.displacement.x'", "did you mean 'tip."),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A folder in which nothing is wrong: deck, body file, FMU, modal file, scene, coupling and loads."""
    folder = tmp_path_factory.mktemp("sound")
    write_deck(box(ElementType.C3D20R, (4, 1, 1), (1.0, 0.1, 0.13)), folder / "bar.inp")
    for name, text in {"body": BAR, "scene": SCENE, "coupling": COUPLING}.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    (folder / "loads.csv").write_text(LOADS, encoding="utf-8")
    build_fmu(folder / "body.toml", folder / "bar.fmu", folder / "bar.h5")
    return folder


def answer(folder, mistake, monkeypatch):
    """Exit code and what is said on standard error."""
    if mistake.runs:
        command = [sys.executable, "-m", "flexfmu", *mistake.arguments]
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
            env={**os.environ, "COLUMNS": "400"},
        )
        # An FMU's library may disturb the interpreter's exit once all is written.
        return (0 if "out.csv" in done.stdout else done.returncode), done.stderr
    monkeypatch.chdir(folder)
    done = CliRunner(env={"COLUMNS": "400"}).invoke(app, mistake.arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_answered_with_what_was_found_and_what_would_do(case, sound, tmp_path, monkeypatch):
    mistake = MISTAKES[case]
    folder = tmp_path / "work"
    shutil.copytree(sound, folder)
    for name, text in mistake.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, said = answer(folder, mistake, monkeypatch)
    for word in mistake.words:
        assert word in said
    assert code == mistake.code
    assert "Traceback" not in said
    if code:
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("bar.inp", ["build", "body.toml", "-o", "out.fmu"]),
        pytest.param("bar.vtk", ["build", "body.toml", "-o", "out.fmu"], marks=pytest.mark.slow),
        pytest.param("body.toml", ["build", "body.toml", "-o", "out.fmu"], marks=pytest.mark.slow),
        ("loads.csv", ["simulate", "bar.fmu", "-i", "loads.csv", "-o", "out.csv"]),
        ("bar.fmu", ["info", "bar.fmu"]),
    ],
)
def test_a_pipe_that_never_ends_is_refused_instead_of_waited_for(name, arguments, sound, tmp_path):
    folder = tmp_path / "work"
    shutil.copytree(sound, folder)
    if name == "bar.vtk":
        (folder / "body.toml").write_text(BAR.replace("bar.inp", name), encoding="utf-8")
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    before = sorted(path.name for path in folder.iterdir())
    command = [sys.executable, "-m", "flexfmu", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert f"{name} cannot be read: it is a pipe or a device" in done.stderr
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("body.toml", ["build", "-o", "x.fmu"]), ("loads.csv", ["simulate", "bar.fmu", "-o", "x.csv", "-i"])],
)
def test_text_in_utf_16_is_named_as_such(name, arguments, sound, tmp_path, monkeypatch):
    text = (sound / name).read_text(encoding="utf-8")
    (tmp_path / name).write_text(text, encoding="utf-16")
    shutil.copy(sound / "bar.fmu", tmp_path)
    code, said = answer(tmp_path, Mistake([*arguments, name], {}, []), monkeypatch)
    assert code == 1
    assert f"{name} is text in UTF-16" in said


def test_a_ramp_and_a_wave_that_steps_follow_are_no_alarm():
    time = np.linspace(0.0, 1.0, 1001)
    report = Listening()
    loads = np.column_stack([time, np.sin(20.0 * time), np.minimum(time / 0.0015, 1.0)])
    _tell_passed_over(["wave", "jump"], loads, np.linspace(0.0, 1.0, 101), report)
    # A jump has a communication point of its own.
    times = np.array([0.0, 0.503, 0.503, 0.517, 0.517, 1.0])
    loads_at = np.column_stack([times, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]])
    _tell_passed_over(["pulse"], loads_at, np.linspace(0.0, 1.0, 101), report)
    assert report.warnings == []
    _tell_passed_over(["wave", "jump"], loads, np.linspace(0.0, 1.0, 5), report)
    assert [text.split(" (")[0].split(" of ")[1] for text in report.warnings] == ["wave", "jump"]


def test_a_body_of_half_a_kilometre_is_built_by_force_only(tmp_path, monkeypatch):
    write_deck(box(ElementType.C3D20R, (4, 2, 2), (500.0, 50.0, 65.0)), tmp_path / "bar.inp")
    (tmp_path / "body.toml").write_text(BAR, encoding="utf-8")
    command = ["build", "body.toml", "-o", "out.fmu"]
    code, said = answer(tmp_path, Mistake(command, {}, []), monkeypatch)
    assert code == 1
    assert "implausible" in said
    assert "add --force" in said
    code, said = answer(tmp_path, Mistake([*command, "--force"], {}, []), monkeypatch)
    assert code == 0
    assert "implausible" in said


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda mesh: Body(mesh, None, "ROOT", {"tip": "TIP"}), r"supports are 'ROOT'.* expected a list such as \["),
        (lambda _: chart(None, None, "records.csv", picture="chart.jpg"), "chart.jpg: expected a file name that ends"),
        (lambda mesh: Body(mesh, None, ["ROOT"], ["TIP"]), r"interfaces \['TIP'\], expected .* a mapping such as"),
        (lambda _: Body("bar.inp", None, ["ROOT"], {"tip": "TIP"}), r"mesh is a str.* flexfmu.read_mesh\(path\)"),
        (
            lambda _: loads_from_mapping(("tip",), [0.0, 1.0, 0.0]),
            r"loads are \[.*\], expected them by interface, such as",
        ),
    ],
)
def test_a_script_s_mistake_is_answered_likewise(call, words, sound):
    with pytest.raises((FlexfmuError, LoadError), match=words):
        call(read_mesh(sound / "bar.inp"))
