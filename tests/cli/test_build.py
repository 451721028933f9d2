"""From body file to FMU: what is refused before the work begins, reproducible bytes, and what `flexfmu info` shows."""

import json
import os
import re
import shutil
import subprocess
import sys
import zlib
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import fmpy
import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import flexfmu.build.reduce
import flexfmu.reduction.basis
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.kept import build_fmu
from flexfmu.build.reduce import reduce_body
from flexfmu.commands import entry
from flexfmu.commands.cli import app
from flexfmu.files.basics import BodyFileError, FlexfmuError, MeshError, ModelError, OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.mesh.elements import ElementType
from flexfmu.model.modal_file import read_modal_file
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.options import InterfaceNodes
from meshes import BAR, arc, bars, body_file, box, lattice, with_sets, write_deck
from references import relative

ROOT = Path(__file__).parents[2]
BRICK = ElementType.C3D20R
SIZE = (1.0, 0.1, 0.13)
TURNS = "turn about x, turn about y, turn about z"


class Recorder(Reporter):
    """Keeps what it is told."""

    def __init__(self):
        self.stages, self.notes, self.warnings = [], [], []

    @contextmanager
    def stage(self, title):
        self.stages.append(title)
        yield

    def note(self, text):
        self.notes.append(text)

    def warning(self, text):
        self.warnings.append(text)


def bar(counts=(6, 2, 2)):
    """Bar with an edge and one end of its far face as sets too."""
    mesh = box(BRICK, counts, SIZE)
    return with_sets(
        mesh,
        EDGE=lambda p: np.hypot(p[:, 0] - SIZE[0], p[:, 1]),
        CORNER=lambda p: np.linalg.norm(p - [SIZE[0], 0.0, 0.0], axis=1),
        INSIDE=lambda p: p[:, 0] - 0.5,
    )


@pytest.fixture
def folder(tmp_path):
    """Folder with the bar's deck and body file."""
    write_deck(bar(), tmp_path / "bar.inp")
    (tmp_path / "body.toml").write_text(BAR)
    return tmp_path


@pytest.fixture
def no_factorisation(monkeypatch):
    """Fail as soon as the stiffness is assembled: what is refused must be refused before."""

    def refuse(*_):
        raise AssertionError("the expensive work has begun")

    monkeypatch.setattr(flexfmu.reduction.basis, "stiffness", refuse)


def refused(mesh, folder, error, **changes):
    """Message with which a body is refused."""
    with pytest.raises(error) as caught:
        reduce_body(body_file(mesh, folder, **({"interface": ["TIP"]} | changes)), Reporter())
    return str(caught.value)


@pytest.mark.usefixtures("no_factorisation")
@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"support": "CLAMP"}, "support[1].nodes"),
        ({"interface": ["TIP", "CLAMP"]}, "interface 'clamp', nodes"),
        ({"frame": [{"name": "a", "nodes": "CLAMP"}]}, "frame 'a', nodes"),
        ({"frame": [{"name": "a", "nodes": "ROOT", "joint": "CLAMP"}]}, "frame 'a', joint"),
    ],
    ids=["support", "interface", "frame", "joint"],
)
def test_a_set_that_is_not_there_is_named_with_those_that_are_before_the_work_begins(changes, key, tmp_path):
    text = refused(bar(), tmp_path, BodyFileError, **changes)
    assert text == f"{key}: the mesh has no node set 'CLAMP'; it has: CORNER, EDGE, INSIDE, ROOT, TIP"


@pytest.mark.usefixtures("no_factorisation")
def test_an_empty_set_is_refused_by_name(tmp_path):
    config = body_file(bar(), tmp_path, interface=["TIP", "LOOSE"])
    # The set's only node is none of the body's.
    with config.mesh.file.open("a") as deck:
        deck.write("*NODE\n9999, 5.0, 5.0, 5.0\n*NSET, NSET=LOOSE\n9999,\n")
    with pytest.raises(BodyFileError, match=r"interface 'loose', nodes: node set 'LOOSE' is empty, expected at least"):
        reduce_body(config, Reporter())


def test_set_names_count_the_same_in_upper_and_lower_case(tmp_path):
    tables = {"reduction": {"modes": 2, "residual_flexibility": False}, "formulation": {"method": "linear"}}
    config = body_file(bar(), tmp_path, interface=["TIP"], support="root", **tables)
    assert reduce_body(config, Reporter()).mode_count == 2


@pytest.mark.parametrize("name", ["EDGE", "CORNER"])
def test_nodes_of_a_line_or_point_take_all_of_its_force_but_a_thousandth(name):
    """A board moved 0.8 % less under a force on a node, of which 50 neighbours took a twentieth."""
    mesh = bar((12, 2, 2))
    loads = fit_interface(InterfaceNodes(name, name), mesh, ()).nodal_loads(len(mesh.points)).reshape(-1, 3, 6)
    own = loads[mesh.node_sets[name], :, :3].sum(axis=0)
    np.testing.assert_allclose(own, np.eye(3), atol=1.1e-3)


@pytest.mark.parametrize(
    ("name", "count", "added"), [("EDGE", 5, 27), pytest.param("CORNER", 1, 19, marks=pytest.mark.slow)]
)
def test_an_interface_on_a_line_or_point_takes_moments_by_its_elements(name, count, added, tmp_path):
    mesh, report = bar((12, 2, 2)), Recorder()
    body = FlexibleBody(reduce_body(body_file(mesh, tmp_path, interface=["TIP", name]), report))
    told = next(note for note in report.notes if f"interface '{name.lower()}'" in note)
    assert f"{count} nodes in a line or point, and {added} more of their elements, which take the moment" in told
    # Far from there a load is what it is about any other point: the tip moves as under the moved load.
    places = [fit_interface(InterfaceNodes(name, name), mesh, ()).point for name in ("TIP", name)]
    scale = np.repeat([1.0, 0.1], 3)
    for load in np.eye(6):
        moved = [*load[:3], *(load[3:] + np.cross(places[1] - places[0], load[:3]))]
        there, here = (
            body.motion(body.static({one: 1e-3 * np.array(row)}))[:6] * scale
            for one, row in ((name.lower(), load), ("tip", moved))
        )
        assert relative(there, here) < 0.02


def test_weights_by_area_are_refused_for_a_piece_of_the_body(tmp_path):
    mesh = with_sets(bar(), PIECE=lambda p: np.minimum(p[:, 0] - 0.5, 0.0))
    path = write_deck(mesh, tmp_path / "bar.inp")
    content = BAR.replace('nodes = "TIP"', 'nodes = "PIECE"\nweights = "area"').replace("bar.inp", str(path))
    (tmp_path / "body.toml").write_text(content)
    with pytest.raises(BodyFileError, match=r"weights = \"area\" needs .* whole element faces, .* 'PIECE' does not"):
        build_fmu(tmp_path / "body.toml", tmp_path / "bar.fmu")
    # Left to itself the same set is weighted by node, and the log says so.
    (tmp_path / "body.toml").write_text(content.replace('"area"', '"auto"'))
    report = Recorder()
    build_fmu(tmp_path / "body.toml", tmp_path / "bar.fmu", report=report)
    assert any("interface 'tip'" in note and "loads spread by node" in note for note in report.notes)


def test_a_force_on_a_section_inside_the_body_is_a_uniform_traction():
    mesh = bar()
    interface = fit_interface(InterfaceNodes("inside", "INSIDE"), mesh, ())
    assert interface.by_area
    forces = interface.nodal_loads(len(mesh.points)).reshape(-1, 3, 6)[interface.nodes, 0, 0]
    # Of four 8-node faces around one corner: a third of a face's share between corners, twice that where two meet.
    np.testing.assert_allclose(np.unique(np.round(48.0 * forces, 9)), [-4.0, -2.0, -1.0, 4.0, 8.0])


@pytest.mark.usefixtures("no_factorisation")
def test_elements_without_material_are_refused_with_the_keys_to_give(tmp_path):
    mesh = bar()
    config = body_file(mesh, tmp_path, interface=["TIP"])
    write_deck(mesh, config.mesh.file, materials=False)
    with pytest.raises(BodyFileError) as caught:
        reduce_body(config, Reporter())
    assert "24 of 24 elements have no material" in str(caught.value)
    for key in ("[material]", "youngs_modulus", "poissons_ratio", "density"):
        assert key in str(caught.value)


@pytest.mark.slow
def test_material_of_the_body_file_serves_elements_without_one(tmp_path):
    mesh = bar()
    frequencies = []
    for factor in (1.0, 4.0):
        table = {"youngs_modulus": factor * 2e11, "poissons_ratio": 0.3, "density": 7850.0}
        config = body_file(mesh, tmp_path, interface=["TIP"], material=table, reduction={"modes": 3})
        write_deck(mesh, config.mesh.file, materials=False)
        frequencies.append(reduce_body(config, Reporter()).angular_frequency)
    own = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], reduction={"modes": 3}), Reporter())
    np.testing.assert_allclose(frequencies[0], own.angular_frequency, rtol=1e-9)
    np.testing.assert_allclose(frequencies[1], 2.0 * frequencies[0], rtol=1e-9)


@pytest.mark.usefixtures("no_factorisation")
@pytest.mark.parametrize(
    ("nodes", "fix", "free", "held"),
    [
        ("ROOT", ["x"], "3 rigid motions (slide along y, slide along z, turn about x)", 21),
        ("CORNER", ["x", "y", "z"], f"3 rigid motions ({TURNS} through (1, 0, 0) m)", 3),
        ("EDGE", ["x", "y", "z"], "1 rigid motion (turn about z through (1, 0, 0.065) m)", 15),
        ("EDGE", ["z"], f"5 rigid motions (slide along x, slide along y, {TURNS})", 5),
    ],
)
def test_a_body_free_to_move_is_refused_with_its_rigid_motions(nodes, fix, free, held, tmp_path):
    tables = [{"nodes": nodes, "fix": fix}]
    config = body_file(bar(), tmp_path, interface=["TIP"])
    config = type(config).model_validate(config.model_dump() | {"support": tables})
    with pytest.raises(ModelError, match=rf"the body is free to move in {re.escape(free)}: .* hold {held} of its"):
        reduce_body(config, Reporter())


@pytest.mark.usefixtures("no_factorisation")
def test_a_body_without_supports_has_six_rigid_motions_and_notes_say_what_its_file_holds(tmp_path):
    config = body_file(bar(), tmp_path, interface=["TIP"]).model_copy(update={"support": []})
    with config.mesh.file.open("a") as deck:
        deck.write("*STEP\n*STATIC\n*BOUNDARY\nROOT, 1, 3\n*END STEP\n")
    report = Recorder()
    with pytest.raises(ModelError, match=r"the body is free to move in 6 rigid motions: the supports hold 0 of its"):
        reduce_body(config, report)
    assert any("STEP 1: hold them by [[support]]" in note for note in report.notes)


@pytest.mark.parametrize(("frames", "drifts"), [(2, True), (1, False)])
def test_nodes_that_a_support_holds_in_some_directions_are_said_to_drift_with_frames(tmp_path, frames, drifts):
    config = body_file(bar(), tmp_path, interface=["TIP"], frames=frames)
    held = [{"nodes": "ROOT", "fix": ["x", "y", "z"]}, {"nodes": "CORNER", "fix": ["z"]}]
    report = Recorder()
    reduce_body(type(config).model_validate(config.model_dump() | {"support": held}), report)
    assert any("nodes are held in some directions" in note for note in report.notes) == drifts


@pytest.mark.usefixtures("no_factorisation")
def test_of_two_parts_the_one_that_nothing_holds_is_named_by_a_node(tmp_path):
    mesh = lattice(ElementType.C3D8, [(0, 0, 0), (2, 0, 0)], lambda p: p)
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0], TIP=lambda p: p[:, 0] - 3.0)
    mesh = replace(mesh, labels=mesh.labels + 100)
    text = refused(mesh, tmp_path, ModelError)
    label = int(
        re.search(r"the part of the mesh with node (\d+) \(8 nodes of 16\) is free to move in 6 rigid motions", text)[1]
    )
    assert mesh.points[label - 101, 0] >= 2.0
    assert "share nodes" in text


@pytest.mark.slow
def test_what_deserves_a_look_is_warned_of(tmp_path):
    portal = bars(BRICK, [((0, 0, 0), (1, 9, 1)), ((10, 0, 0), (11, 9, 1)), ((0, 8, 0), (11, 9, 1))], 0.1)
    portal = with_sets(portal, ROOT=lambda p: p[:, 1], TOP=lambda p: p[:, 1] - 1.0)
    report = Recorder()
    reduce_body(body_file(portal, tmp_path, interface=["TOP"], frames=4, reduction={"modes": 4}), report)
    assert sum(text.startswith("closed loop cut between frames") for text in report.warnings) == 1

    square = box(BRICK, (4, 2, 2), (1.0, 0.1, 0.1))
    report = Recorder()
    reduce_body(body_file(square, tmp_path, interface=["TIP"], reduction={"modes": 1}), report)
    assert sum(text.startswith("a mode that is left out has the frequency") for text in report.warnings) == 1

    report = Recorder()
    half = with_sets(bar(), NEAR=lambda p: np.maximum(p[:, 0] - 0.5, 0.0))
    frame = [{"name": "near", "nodes": "NEAR"}]
    reduce_body(body_file(half, tmp_path, interface=["TIP"], frame=frame, reduction={"modes": 2}), report)
    assert sum(text.startswith("interface 'tip' touches no frame") for text in report.warnings) == 1

    report = Recorder()
    reduce_body(body_file(bar(), tmp_path, interface=["TIP"], reduction={"modes": 2}), report)
    assert report.warnings == []
    assert len(report.stages) >= 5


@pytest.mark.slow
def test_building_twice_gives_the_same_bytes(folder):
    outputs = [folder / "one.fmu", folder / "two.fmu"]
    for output in outputs:
        build_fmu(folder / "body.toml", output, output.with_suffix(".h5"), store=Store(None))
    for suffix in (".fmu", ".h5"):
        assert len({output.with_suffix(suffix).read_bytes() for output in outputs}) == 1
    # Another body gives other bytes.
    (folder / "body.toml").write_text(BAR.replace("modes = 6", "modes = 5"))
    build_fmu(folder / "body.toml", folder / "three.fmu")
    assert (folder / "three.fmu").read_bytes() != outputs[0].read_bytes()


def test_a_second_build_writes_and_says_the_same_and_imports_nothing_that_reduces(folder):
    (folder / "body.toml").write_text(BAR.replace("error = false", "error = true"))
    environment = os.environ | {"FLEXFMU_CACHE": str(folder / "cache"), "PYTHONPROFILEIMPORTTIME": "1"}
    said, imported = [], []
    for name in ("one", "two"):
        files = ["body.toml", "-o", f"{name}.fmu", "--modal-file", f"{name}.h5"]
        command = [sys.executable, "-m", "flexfmu", "build", *files]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
        lines = done.stderr.splitlines()
        said.append([line for line in lines if line.startswith("  ")])
        imported.append({line.split("|")[-1].strip() for line in lines if line.startswith("import time")})
    for suffix in (".fmu", ".h5"):
        assert (folder / f"one{suffix}").read_bytes() == (folder / f"two{suffix}").read_bytes()
    assert said[0] == said[1]
    assert any("own estimate of its error" in line for line in said[0])
    needless = {"flexfmu.reduction.modes", "flexfmu.program.compile", "scipy.sparse", "scipy.linalg", "h5py"}
    assert needless <= imported[0]
    assert not needless & imported[1]


@pytest.mark.parametrize(
    "edit",
    [
        lambda path: (path / "body.toml").write_text(BAR.replace("ratio = 0.01", "ratio = 0.02")),
        lambda path: write_deck(replace(bar(), points=1.01 * bar().points), path / "bar.inp"),
    ],
)
def test_what_is_kept_of_another_body_is_not_taken(folder, edit):
    store = Store(folder / "cache")
    build_fmu(folder / "body.toml", folder / "one.fmu", store=store)
    edit(folder)
    build_fmu(folder / "body.toml", folder / "two.fmu", store=store)
    build_fmu(folder / "body.toml", folder / "fresh.fmu")
    assert (folder / "two.fmu").read_bytes() == (folder / "fresh.fmu").read_bytes()
    assert (folder / "two.fmu").read_bytes() != (folder / "one.fmu").read_bytes()


def test_what_is_hardly_meant_ends_a_build_of_what_is_kept_too_unless_it_is_forced(folder):
    (folder / "body.toml").write_text(BAR.replace('nodes = "TIP"', 'nodes = "ROOT"'))
    command = ["build", str(folder / "body.toml"), "-o", str(folder / "bar.fmu")]
    environment = {"FLEXFMU_CACHE": str(folder / "cache")}
    forced, held, again = (
        CliRunner().invoke(app, [*command, *more], env=environment) for more in (["--force"], [], ["--force"])
    )
    assert (forced.exit_code, held.exit_code, again.exit_code) == (0, 1, 0)
    assert all("lies on a support" in " ".join(one.stderr.split()) for one in (forced, held, again))


@pytest.mark.slow
def test_processes_with_other_hash_seeds_and_working_directories_build_the_same_bytes(folder, monkeypatch):
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(folder / "body.toml", elsewhere)
    shutil.copy(folder / "bar.inp", elsewhere)
    script = [sys.executable, str(ROOT / "build_fmu.py")]
    program = [shutil.which("flexfmu", path=str(Path(sys.executable).parent)), "build"]
    # build_fmu.py and `flexfmu build` are the same; the second takes the default output.
    jobs = [
        (folder, "1", [*script, "body.toml", "--output", "bar.fmu"], folder / "bar.fmu"),
        (elsewhere, "2", [*program, str(elsewhere / "body.toml")], elsewhere / "bar.fmu"),
        (Path("/"), "3", [*script, str(folder / "body.toml"), "-o", str(folder / "c.fmu")], folder / "c.fmu"),
    ]
    contents = set()
    for where, seed, command, output in jobs:
        environment = os.environ | {"PYTHONHASHSEED": seed, "FLEXFMU_CACHE": ""}
        done = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(output.name if where != Path("/") else str(output))
        assert "closed loop" not in done.stderr
        assert "first frequency" in done.stderr
        contents.add(output.read_bytes())
    assert len(contents) == 1
    # As outside of tests.
    monkeypatch.setattr(zlib, "Z_DEFAULT_COMPRESSION", -1)
    build_fmu(folder / "body.toml", folder / "here.fmu")
    assert (folder / "here.fmu").read_bytes() in contents


@pytest.mark.parametrize(
    ("edit", "error"),
    [
        (lambda path: path.joinpath("body.toml").write_text("name = 3"), BodyFileError),
        (lambda path: path.joinpath("bar.inp").write_text("*NODE\n1, 0, 0, x\n"), MeshError),
        (lambda path: path.joinpath("bar.inp").unlink(), MeshError),
        (lambda path: path.joinpath("body.toml").write_text(BAR.replace('"x", "y", "z"', '"x"')), ModelError),
        (
            lambda path: path.joinpath("body.toml").write_text(BAR.replace("modes = 6", "modes = 6000")),
            BodyFileError,
        ),
    ],
    ids=["body", "mesh", "no mesh", "free body", "too many modes"],
)
def test_a_failed_build_leaves_no_file_behind_and_keeps_what_was_there(folder, edit, error):
    edit(folder)
    (folder / "old.fmu").write_bytes(b"old")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    for output in ("new.fmu", "old.fmu"):
        with pytest.raises(error):
            build_fmu(folder / "body.toml", folder / output, folder / "new.h5")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.usefixtures("no_factorisation")
@pytest.mark.parametrize(
    ("output", "modal", "words"),
    [
        ("bar.zip", None, "bar.zip: expected a file name that ends in .fmu"),
        ("bar.fmu", "bar.hdf", "bar.hdf: expected a file name that ends in .h5"),
        ("away/bar.fmu", None, "away does not exist; make it first"),
        ("bar.fmu", "away/bar.h5", "away does not exist; make it first"),
    ],
)
def test_a_wrong_name_or_folder_of_the_output_is_refused_before_the_work_begins(folder, output, modal, words):
    before = sorted(folder.iterdir())
    with pytest.raises(FlexfmuError, match=re.escape(words)):
        build_fmu(folder / "body.toml", folder / output, folder / modal if modal else None)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("suffix", [".fmu", ".h5"])
def test_of_fmu_and_modal_file_both_are_written_or_none(folder, suffix, monkeypatch):
    write = Path.write_bytes

    def fail(path, data):
        if path.suffix == suffix:
            raise OSError("no space left")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", fail)
    before = sorted(folder.iterdir())
    with pytest.raises((OSError, FlexfmuError), match="no space left"):
        build_fmu(folder / "body.toml", folder / "bar.fmu", folder / "bar.h5")
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("words", ["Unable to allocate 7.69 MiB", ""])
def test_a_lack_of_memory_ends_the_command_in_words(folder, words, monkeypatch):
    def fail(*_, **__):
        raise MemoryError(words)

    monkeypatch.setattr("flexfmu.build.kept.file_origin", fail)
    result = CliRunner().invoke(app, ["build", str(folder / "body.toml"), "-o", str(folder / "bar.fmu")])
    assert (result.exit_code, result.stderr) == (1, f"error: {words or 'the memory does not suffice'}\n")


def test_commands_have_no_threads_for_small_matrices(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setattr(sys, "argv", ["flexfmu", "--version"])
    with pytest.raises(SystemExit):
        entry.main()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_an_error_of_the_user_ends_the_command_in_words_without_a_traceback(folder):
    (folder / "body.toml").write_text(BAR.replace('nodes = "TIP"', 'nodes = "TOP[1]"'))
    result = CliRunner().invoke(app, ["build", str(folder / "body.toml"), "-o", str(folder / "bar.fmu")])
    assert result.exit_code == 1
    assert "error: interface 'tip', nodes: the mesh has no node set 'TOP[1]'; it has: CORNER" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (folder / "bar.fmu").exists()


def test_a_build_says_in_a_dozen_lines_what_a_user_wants_and_all_else_when_asked(folder):
    (folder / "body.toml").write_text(BAR.replace("error = false", ""))
    short, long = (
        CliRunner().invoke(app, ["build", str(folder / "body.toml"), "-o", str(folder / "x.fmu"), "--fresh", *more])
        for more in ((), ("--verbose",))
    )
    assert short.exit_code == long.exit_code == 0, short.stderr
    said = " ".join(short.stderr.split())
    for word in (
        "mass ",
        "size 1 ×",
        "first frequency",
        "(body file)",
        "own estimate of its error: up to ",
        "N on tip, which moves by",
    ):
        assert word in said
    assert len(short.stderr.splitlines()) <= 14
    # Its few modes were given by hand: of which load they miss most is said, by `info` and to scripts as well.
    missed = re.search(r"the basis misses \d+ % of the linear displacement under (tip\.moment\.\w) \(limit 1 %", said)
    assert missed is not None
    told, plain = (CliRunner().invoke(app, ["info", str(folder / "x.fmu"), *more]).stdout for more in ((), ("--json",)))
    assert missed[0] in " ".join(told.split())
    assert next(iter(json.loads(plain)["missed_by_basis"])) == missed[1]
    assert "✓" not in said
    assert "ΦᵀMΦ" in long.stderr
    assert long.stderr.count("✓") > 4


@pytest.mark.parametrize("file", ["bar.fmu", "bar.h5"])
def test_info_shows_modes_interfaces_tree_and_origin(folder, file):
    build_fmu(folder / "body.toml", folder / "bar.fmu", folder / "bar.h5")
    body = read_modal_file(folder / "bar.h5")
    result = CliRunner().invoke(app, ["info", str(folder / file)])
    assert result.exit_code == 0
    assert "bar: 6 modes, 1 interface, 3 frames; method second_order" in " ".join(result.stdout.split())
    assert "methods: linear; modal_rotation; " in " ".join(result.stdout.split())
    for frequency in body.angular_frequency / (2.0 * np.pi):
        assert f"{frequency:.6g}" in result.stdout
    assert re.search(r"tip .*\(1, 0\.05, 0\.065\).* frame_3", result.stdout)
    tree = [line for line in result.stdout.splitlines() if "── frame_" in line]
    assert [line.index("frame_") for line in tree] == [4, 8, 12]
    assert "frame_3  (0.66667, 0.05, 0.065)  carries tip" in tree[2]
    assert "carries" not in tree[0] + tree[1]
    for value in body.provenance.values():
        assert value in "".join(re.split(r"[\s│]+", result.stdout))


def test_info_refuses_what_is_no_body(folder):
    result = CliRunner().invoke(app, ["info", str(folder / "bar.inp")])
    assert result.exit_code == 1
    assert "error:" in result.stderr


def test_the_body_in_the_fmu_is_the_body_that_was_built(folder):
    build_fmu(folder / "body.toml", folder / "bar.fmu", folder / "bar.h5")
    body = reduce_body(read_body_file(folder / "body.toml"), Reporter())
    for found in (read_packaged_body(folder / "bar.fmu"), read_modal_file(folder / "bar.h5")):
        np.testing.assert_array_equal(found.interface_displacement, body.interface_displacement)
        assert found.provenance == body.provenance
        assert found.frame_names == body.frame_names


@pytest.mark.parametrize("frames", [0, 1, 4])
def test_points_of_the_surface_go_where_the_interface_goes(frames, tmp_path):
    mesh = arc(BRICK, (12, 2, 2), 1.0, 0.05)
    # Of second order within frames the surface knows nothing.
    tables = {"output": {"surface": True}, "reduction": {"second_order": False}}
    config = body_file(mesh, tmp_path, interface=["TIP"], frames=frames, **tables)
    model = reduce_body(config, Reporter())
    body = FlexibleBody(model)
    state = body.static({"tip": [0.0, 16e3, 8e3]})
    moved, start = body.surface_positions(state), model.surface.points
    np.testing.assert_allclose(body.surface_positions(body.rest()), start, atol=1e-15)
    tip = np.abs(start[:, 0]) < 1e-9
    assert tip.sum() == 9
    displacement = body.response(state).displacement[0]
    assert np.linalg.norm(displacement) > 0.1
    # The nine corner nodes lie evenly about the centre of the face, which stays nearly plane.
    assert relative((moved - start)[tip].mean(axis=0), displacement) < 1e-3
    held = np.abs(start[:, 1]) < 1e-9
    # Up to the square of the root frame's turn over half the width.
    assert np.abs((moved - start)[held]).max() < 3e-3 * np.linalg.norm(displacement)
    # Neighbouring points stay neighbours: no frame tears the surface.
    edges = np.concatenate([model.surface.faces[:, [i, (i + 1) % 4]] for i in range(4)])
    before, after = (np.linalg.norm(np.diff(p[edges], axis=1)[:, 0], axis=1) for p in (start, moved))
    assert np.abs(after / before - 1.0).max() < (0.25 if frames == 0 else 0.1)


@pytest.mark.parametrize("kind", [BRICK, ElementType.C3D10, ElementType.C3D4])
def test_the_surface_is_closed_and_has_corner_nodes_alone(kind, tmp_path):
    mesh = box(kind, (3, 2, 2), SIZE)
    model = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], output={"surface": True}), Reporter())
    faces = model.surface.faces
    # 3 × 2 × 2 cells have 2 (3·2 + 3·2 + 2·2) squares, or twice as many triangles.
    assert len(faces) == 32 * (1 if kind is BRICK else 2)
    assert len(model.surface.points) == 4 * 3 * 3 - 2
    edges = {}
    for face in faces:
        ring = list(dict.fromkeys(face.tolist()))
        for first, second in zip(ring, [*ring[1:], ring[0]], strict=True):
            key = frozenset((first, second))
            edges[key] = edges.get(key, 0) + 1
    assert set(edges.values()) == {2}


def datasets(path):
    """Shape of every dataset in a modal file."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item.shape}) if hasattr(item, "shape") else None)
    return found


@pytest.mark.slow
def test_without_its_surface_a_body_is_as_large_whatever_its_mesh(folder):
    found, sizes, counts = {}, {}, {"coarse": (6, 2, 2), "fine": (12, 3, 3)}
    for surface in (False, True):
        text = BAR.replace("surface = true\nerror = false", f"surface = {str(surface).lower()}")
        (folder / "body.toml").write_text(text)
        for name in counts:
            write_deck(bar(counts[name]), folder / "bar.inp")
            build_fmu(folder / "body.toml", folder / f"{name}.fmu", folder / f"{name}.h5")
            found[surface, name] = datasets(folder / f"{name}.h5")
            sizes[surface, name] = (folder / f"{name}.h5").stat().st_size
    # Elements that are watched, and stretches of the shadow, are found in the mesh, but few.
    few = ("watched/", "shadow/membrane/")
    coarse, fine = ({path: n for path, n in found[False, name].items() if not path.startswith(few)} for name in counts)
    assert coarse == fine
    assert len(coarse) >= 10
    assert sizes[False, "fine"] < 1.1 * sizes[False, "coarse"]
    surfaces = {name: sizes[True, name] - sizes[False, name] for name in counts}
    assert surfaces["fine"] > 1.5 * surfaces["coarse"]
    body = FlexibleBody(read_modal_file(folder / "coarse.h5"))
    assert body.model.surface is not None
    (folder / "body.toml").write_text(BAR.replace("surface = true", "surface = false"))
    build_fmu(folder / "body.toml", folder / "bare.fmu")
    bare = FlexibleBody(read_packaged_body(folder / "bare.fmu"))
    with pytest.raises(OptionError, match="surface = true"):
        bare.surface_positions(bare.rest())


def test_an_fmu_of_fmi_3_is_built_when_asked_for(folder):
    result = CliRunner().invoke(app, ["build", str(folder / "body.toml"), "-o", str(folder / "bar.fmu"), "--fmi", "3"])
    assert result.exit_code == 0, result.output
    assert fmpy.read_model_description(str(folder / "bar.fmu")).fmiVersion == "3.0"
    result = CliRunner().invoke(app, ["info", str(folder / "bar.fmu")])
    assert result.exit_code == 0, result.output
    assert "tip" in result.output
