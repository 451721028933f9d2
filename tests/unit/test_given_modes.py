"""Bodies of modes that another program found."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from typer.testing import CliRunner

import flexfmu
from flexfmu.commands.cli import app
from flexfmu.fe.assembly import mass, stiffness
from flexfmu.files.basics import BodyFileError, FlexfmuError, OptionError
from flexfmu.given.modes import GivenModesError
from given_bars import LENGTH, MODES, SIDE, bar, eigenmodes, motion

FOREIGN = Path(__file__).parents[1] / "foreign"


@pytest.fixture(scope="module")
def reference():
    """The same body built from its mesh."""
    body = flexfmu.Body(bar(), None, ["ROOT"], {"tip": "TIP"}, name="bar")
    return {frames: body.build("frames", modes=MODES, residual_flexibility=False, frames=frames) for frames in (1, 4)}


@pytest.mark.parametrize("frames", [1, 4])
def test_given_modes_bend_far_as_the_body_that_is_built_from_its_mesh(clamped, reference, frames):
    packed = flexfmu.pack(clamped, {"tip": "TIP"}, frames=frames)
    assert abs(motion(packed)[1]) > 0.05
    np.testing.assert_allclose(motion(packed), motion(reference[frames]), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(packed.reduced.angular_frequency, reference[frames].reduced.angular_frequency, rtol=1e-6)


def test_modes_without_cells_in_other_units_and_of_any_size_make_one_frame(clamped, reference):
    scaled = flexfmu.GivenModes(
        1000.0 * clamped.nodes,
        clamped.modes * np.arange(2.0, 2.0 + MODES)[:, None, None],
        clamped.frequency,
        # Lumped, in tonnes.
        1e-3 * clamped.nodal_mass,
        clamped.sets,
        units="mm-t-s",
    )
    with pytest.warns(UserWarning, match="lumped masses are coarse here"):
        packed = flexfmu.pack(scaled, {"tip": flexfmu.Interface("TIP", weights="node")})
    assert packed.model.frame_count == 1
    # Lumped masses and weights by node cost some %.
    np.testing.assert_allclose(motion(packed)[1], motion(reference[1])[1], rtol=0.05)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("lumped", [False, True])
def test_files_of_given_modes_keep_everything(clamped, tmp_path, suffix, lumped):
    given = clamped
    if lumped:
        given = flexfmu.GivenModes(
            clamped.nodes, clamped.modes, clamped.frequency, np.full(len(clamped.nodes), 0.1), clamped.sets,
            damping=np.full(MODES, 0.02), units="in-lbf-s", name="lumped",
        )  # fmt: skip
    back = flexfmu.read_given(given.save(tmp_path / f"modes{suffix}"))
    for key in ("nodes", "modes", "frequency", "damping", "units", "name"):
        np.testing.assert_array_equal(getattr(back, key), getattr(given, key))
    assert set(back.sets) == set(given.sets)
    assert set(back.cells) == set(given.cells)
    assert abs(back.mass - given.mass).max() == 0.0


@pytest.mark.parametrize("with_rigid", [True, False])
def test_a_free_body_keeps_its_momentum_whether_or_not_its_rigid_motions_are_given(with_rigid):
    mesh = bar()
    modes, frequency, mass = eigenmodes(mesh, np.zeros(0, dtype=int))
    chosen = slice(None) if with_rigid else slice(6, None)
    cells = {"hexahedron20": mesh.blocks[0].connectivity}
    given = flexfmu.GivenModes(mesh.points, modes[chosen], frequency[chosen], mass, mesh.node_sets, cells)
    body = flexfmu.pack(given, {"tip": "TIP", "root": "ROOT"}, frames=2)
    assert body.reduced.rigid_count == 6
    state, force, step = body.rest(), 50.0, 1e-3
    for _ in range(40):
        state = body.step(state, {"tip": [0.0, force, 0.0], "root": [0.0, force, 0.0]}, step)
    # Centre of mass: half the acceleration times the time squared.
    weight = 7850.0 * LENGTH * SIDE**2
    expected = 0.5 * 2.0 * force / weight * (40 * step) ** 2
    assert body.response(state).displacement[:, 1].mean() == pytest.approx(expected, rel=0.02)


def changed(given, **changes):
    """The same modes with changes."""
    from dataclasses import replace

    return replace(given, **changes)


def test_a_mass_that_is_not_that_of_the_modes_is_refused(clamped, random):
    order = random.permutation(len(clamped.nodes))
    wrong = np.asarray(clamped.mass.sum(axis=1)).reshape(-1, 3)[order, 0] ** 2
    with pytest.raises(GivenModesError, match=r"have the product .* the mass is not that of these"):
        flexfmu.pack(changed(clamped, mass=np.abs(wrong) * np.linspace(0.0, 9.0, len(order)) ** 3), {"tip": "TIP"})


def test_slow_modes_that_are_no_rigid_motions_are_refused(clamped):
    frequency = clamped.frequency.copy()
    frequency[:6] = 1e-4
    loose = clamped.modes + 1e-3
    with pytest.raises(GivenModesError, match=r"no rigid motions|have the product"):
        flexfmu.pack(changed(clamped, modes=loose, frequency=frequency), {"tip": "TIP"})
    frequency[1:6] = clamped.frequency[1:6]
    with pytest.raises(GivenModesError, match=r"1 modes below 0\.01 of the next frequency"):
        flexfmu.pack(changed(clamped, frequency=frequency), {"tip": "TIP"})


def test_units_that_make_no_body_are_warned_of(clamped):
    with pytest.warns(UserWarning, match=r"implausible. Give the units of the modes \(found m-kg-s"):
        flexfmu.pack(changed(clamped, nodes=1000.0 * clamped.nodes), {"tip": "TIP"}, frames=1)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({}, {"method": "second_order"}, "needs the body's stiffness"),
        ({}, {"interfaces": {"tip": "NOSE"}}, "no node set 'NOSE'; it has: ROOT, TIP"),
        ({"cells": {}}, {"frames": 3}, "come without cells"),
        ({"cells": {}, "sets": {}}, {"frames": 1}, "no node set 'TIP'"),
    ],
)
def test_what_modes_alone_cannot_do_is_said(clamped, changes, options, message):
    with pytest.raises(FlexfmuError if "method" not in options else OptionError, match=message):
        flexfmu.pack(changed(clamped, **changes), **({"interfaces": {"tip": "TIP"}} | options))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"modes": np.zeros((2, 3, 3))}, r"modes has shape \(2, 3, 3\), expected \(2, \d+, 3\)"),
        ({"mass": np.ones(5)}, r"mass has shape \(5,\)"),
        ({"sets": {"TIP": [10**6]}}, "counted from zero, not the other program's numbers"),
        ({"frequency": -np.ones(MODES)}, "negative values"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(clamped, changes, message):
    with pytest.raises(GivenModesError, match=message):
        changed(clamped, **changes)


def test_a_file_that_lacks_something_says_what_it_has(tmp_path):
    np.savez(tmp_path / "modes.npz", nodes=np.zeros((2, 3)), eigenvectors=np.zeros((1, 2, 3)))
    with pytest.raises(GivenModesError, match="lacks modes, frequency, mass; it holds nodes, eigenvectors"):
        flexfmu.read_given(tmp_path / "modes.npz")


def test_frames_of_node_sets_need_no_cells(clamped, reference):
    x = clamped.nodes[:, 0]
    sets = {**clamped.sets, "NEAR": np.flatnonzero(x <= 0.5 + 1e-9), "FAR": np.flatnonzero(x >= 0.5 - 1e-9)}
    frames = [{"name": "near", "nodes": "NEAR"}, {"name": "far", "nodes": "FAR", "parent": "near"}]
    packed = flexfmu.pack(changed(clamped, cells={}, sets=sets), {"tip": flexfmu.Interface("TIP")}, frames=frames)
    assert packed.model.frame_names == ("near", "far")
    assert motion(packed)[1] == pytest.approx(motion(reference[4])[1], rel=0.02)


@pytest.mark.slow
def test_loads_that_follow_an_interface_do_so_on_given_modes(clamped, reference):
    """The same body built from its mesh: a following force bends it less than one that keeps its direction."""
    ends = {"tip": flexfmu.Interface("TIP", follows=True)}
    packed = flexfmu.pack(clamped, ends, frames=4)
    assert packed.reduced.following_interfaces == ("tip",)
    built = flexfmu.Body(bar(), None, ["ROOT"], ends).build("frames", modes=MODES, residual_flexibility=False, frames=4)
    np.testing.assert_allclose(motion(packed), motion(built), rtol=1e-5, atol=1e-7)
    assert abs(motion(packed)[0] - motion(reference[4])[0]) > 0.02 * abs(motion(reference[4])[0])


def test_damping_ratios_are_listed_one_for_each_given_mode(clamped):
    few, ratios = changed(clamped, modes=clamped.modes[:5], frequency=clamped.frequency[:5]), np.linspace(0.01, 0.1, 5)
    packed = flexfmu.pack(few, {"tip": "TIP"}, frames=1, damping=ratios)
    np.testing.assert_array_equal(packed.model.damping_ratio, ratios)
    with pytest.raises(BodyFileError, match="lists 2 values, and the basis has 5"):
        flexfmu.pack(few, {"tip": "TIP"}, frames=1, damping=[0.1, 0.2])


def test_springs_need_a_place_where_frames_hang(clamped):
    loose = changed(clamped, modes=clamped.modes + 1e-6 * np.abs(clamped.modes).max(axis=(1, 2), keepdims=True))
    with pytest.raises(BodyFileError, match="no node is held by all modes"):
        flexfmu.pack(loose, {"tip": "TIP"})
    assert flexfmu.pack(loose, {"tip": "TIP"}, ["ROOT"]).model.frame_count == 4


def test_modes_of_a_mesh_by_node_number_in_any_order_bring_cells_sets_and_mass(clamped, random):
    order = random.permutation(len(clamped.nodes))
    mesh = bar()
    given = flexfmu.GivenModes.of_mesh(mesh, mesh.labels[order], 3.0 * clamped.modes[:, order], clamped.frequency)
    whole, parts = flexfmu.pack(clamped, {"tip": "TIP"}, frames=4), flexfmu.pack(given, {"tip": "TIP"}, frames=4)
    np.testing.assert_allclose(motion(parts), motion(whole), rtol=1e-9)
    with pytest.raises(GivenModesError, match="the modes lack nodes of the mesh: "):
        flexfmu.GivenModes.of_mesh(mesh, mesh.labels[order[1:]], clamped.modes[:, order[1:]], clamped.frequency)


def recipe(title, units):
    """The script of docs/given-modes.md for a program, with the units of the file at hand."""
    page = (Path(__file__).parents[2] / "docs" / "given-modes.md").read_text(encoding="utf-8")
    script = page[page.index(f"## From {title}") :].split("```")[1]
    return script.removeprefix("python").replace("mm-t-s", units)


def test_the_recipe_for_calculix_reads_its_modes(tmp_path, monkeypatch):
    """Of tests/foreign/modes_bar.inp, by ccx 2.20: those of flexfmu, but for the file's digits."""
    (tmp_path / "arm.dat").write_bytes(gzip.decompress((FOREIGN / "modes_bar.dat.gz").read_bytes()))
    (tmp_path / "arm.inp").write_bytes((FOREIGN / "modes_bar.inp").read_bytes())
    monkeypatch.chdir(tmp_path)
    exec(recipe("CalculiX", "m-kg-s"), {})
    given = flexfmu.pack("arm.npz", {"tip": "TIP"}, frames=4)
    own = flexfmu.Body(flexfmu.read_mesh("arm.inp"), None, [], {"tip": "TIP"}, name="arm")
    own = own.build("frames", modes=4, residual_flexibility=False, frames=4)
    np.testing.assert_allclose(given.model.angular_frequency, own.model.angular_frequency[:4], rtol=1e-6)
    np.testing.assert_allclose(motion(given), motion(own), rtol=1e-4)


@pytest.mark.filterwarnings("ignore:`np.chararray` is deprecated")
def test_the_recipe_for_nastran_reads_its_modes(tmp_path, monkeypatch):
    """Of the same bar in bulk data, by MYSTRAN 18.0.0, whose bricks are 0.8 to 4.5 % stiffer: one across.

    Newer NumPy than what the extra `op2` takes lacks the name by which the reader calls one of its functions.
    """
    monkeypatch.setattr(np, "in1d", np.isin, raising=False)
    for suffix in ("bdf", "op2"):
        packed = FOREIGN / f"modes_bar.{suffix}.gz"
        (tmp_path / f"arm.{suffix}").write_bytes(gzip.decompress(packed.read_bytes()))
    monkeypatch.chdir(tmp_path)
    exec(recipe("Nastran", "m-kg-s"), {})
    given = flexfmu.pack("arm.npz", {"tip": "SET 7"}, frames=4)
    # In the text that the solver printed: Hz.
    printed = [43.08847, 84.66676, 278.4047, 513.3963]
    np.testing.assert_allclose(given.model.angular_frequency / (2.0 * np.pi), printed, rtol=1e-5)
    own = flexfmu.Body(flexfmu.read_mesh("arm.bdf"), None, ["SPC 1"], {"tip": "SET 7"}, name="arm")
    own = own.build("frames", modes=4, residual_flexibility=False, frames=4)
    np.testing.assert_allclose(given.model.angular_frequency, own.model.angular_frequency[:4], rtol=0.05)
    np.testing.assert_allclose(motion(given), motion(own), rtol=0.05, atol=5e-4)


def test_the_recipe_for_ansys_reads_its_modes(tmp_path, monkeypatch):
    """Of the example that ansys-mapdl-reader (MIT) brings, whose archive has another material than its result.

    Elastic modes of a free beam, titanium in inches: those of flexfmu.
    """
    examples = pytest.importorskip("ansys.mapdl.reader.examples", reason="needs ansys-mapdl-reader")
    text = Path(examples.hexarchivefile).read_text(encoding="utf-8")
    for old, new in (("7.000000000E+10", "16.9E+6"), ("0.350000000", "0.31"), (" 2700.00000", "4.1408E-4")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "arm.cdb").write_text(text, encoding="utf-8")
    (tmp_path / "file.rst").write_bytes(Path(examples.rstfile).read_bytes())
    monkeypatch.chdir(tmp_path)
    exec(recipe("Ansys", "in-lbf-s"), {})
    given = flexfmu.read_given("arm.npz")
    own = flexfmu.Body(
        flexfmu.read_mesh("arm.cdb", "in-lbf-s"), None, [], {"tip": "NODE_SELECTION"}, name="arm", free=True
    )
    own = own.build("frames", modes=6, residual_flexibility=False, frames=1)
    found = own.model.angular_frequency[own.model.angular_frequency > 1.0][:6] / (2.0 * np.pi)
    np.testing.assert_allclose(given.frequency, found, rtol=2e-3)
    assert flexfmu.pack("arm.npz", {"tip": "NODE_SELECTION"}, frames=1).reduced.rigid_count == 6


def coordinates(matrix, name, held=()):
    """A matrix as Abaqus writes it: all entries by row and column from 1, blank lines, 1e36 where a support holds."""
    matrix = matrix.tocoo()
    free = ~(np.isin(matrix.row, held) | np.isin(matrix.col, held))
    row, column, value = (part[free] for part in (matrix.row, matrix.col, matrix.data))
    lines = [f"{r + 1} {c + 1}  {v:.15e}\n" for r, c, v in zip(row, column, value, strict=True)]
    name.write_text("".join([*lines, *(f"{one + 1} {one + 1}  1.000000000000000e+36\n" for one in held), "\n"]))


def test_the_recipe_for_abaqus_reads_its_matrices(tmp_path, monkeypatch):
    """Of CalculiX's bar, written here in Abaqus' format: the modes of flexfmu's own build."""
    (tmp_path / "arm.inp").write_bytes((FOREIGN / "modes_bar.inp").read_bytes())
    mesh = flexfmu.read_mesh(tmp_path / "arm.inp")
    order = (3 * np.argsort(mesh.labels)[:, None] + np.arange(3)).ravel()
    held = np.flatnonzero(mesh.fixed.ravel()[order])
    coordinates(stiffness(mesh)[order][:, order], tmp_path / "arm_STIF1.mtx", held)
    coordinates(mass(mesh)[order][:, order], tmp_path / "arm_MASS1.mtx")
    monkeypatch.chdir(tmp_path)
    exec(recipe("Abaqus", "m-kg-s"), {})
    given = flexfmu.pack("arm.npz", {"tip": "TIP"}, frames=4)
    own = flexfmu.Body(mesh, None, [], {"tip": "TIP"}, name="arm")
    own = own.build("frames", modes=20, residual_flexibility=False, frames=4)
    np.testing.assert_allclose(given.model.angular_frequency, own.model.angular_frequency, rtol=1e-8)
    np.testing.assert_allclose(motion(given), motion(own), rtol=1e-4)


@pytest.mark.skipif("FLEXFMU_ABAQUS" not in os.environ, reason="needs matrices by Abaqus (CONTRIBUTING.md)")
@pytest.mark.parametrize("kind", ["C3D4", "C3D10", "C3D20", "C3D20R"])
def test_stiffness_is_that_of_abaqus_and_so_are_the_modes_of_its_matrices(kind, tmp_path, monkeypatch):
    """Of a free block by Abaqus 2021. Its C3D4 have lumped masses, and its C3D20R those of C3D20."""
    folder = Path(os.environ["FLEXFMU_ABAQUS"])
    for name in ("{}.inp", "{}_STIF1.mtx", "{}_MASS1.mtx"):
        (tmp_path / name.format("arm")).write_bytes((folder / name.format(f"block{kind}")).read_bytes())
    monkeypatch.chdir(tmp_path)
    script, mesh = {}, flexfmu.read_mesh("arm.inp")
    exec(recipe("Abaqus", "m-kg-s"), script)
    theirs = script["matrix"]("arm_STIF1.mtx")
    assert abs(stiffness(mesh) - theirs).max() < 1e-12 * abs(theirs).max()
    if kind in ("C3D10", "C3D20"):
        squares = eigsh(stiffness(mesh), 20, mass(mesh), sigma=-1e5)[0]
        own = np.sqrt(np.maximum(squares[6:], 0.0)) / (2.0 * np.pi)
        np.testing.assert_allclose(flexfmu.read_given("arm.npz").frequency[6:], own, rtol=1e-6)


def test_modes_of_shells_are_refused_since_their_nodes_turn(tmp_path):
    (tmp_path / "plate.inp").write_text(
        "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n*ELEMENT, TYPE=S4, ELSET=E\n1, 1, 2, 3, 4\n"
        "*SHELL SECTION, ELSET=E, MATERIAL=M\n0.01\n*MATERIAL, NAME=M\n*ELASTIC\n2e11, 0.3\n*DENSITY\n7850\n"
    )
    shells = flexfmu.read_mesh(tmp_path / "plate.inp")
    modes = np.zeros((1, len(shells.points), 3))
    with pytest.raises(GivenModesError, match="the mesh holds S4: nodes of shells and beams turn"):
        flexfmu.GivenModes.of_mesh(shells, shells.labels, modes, [1.0])


@pytest.mark.slow
def test_the_command_packs_modes_and_modal_files_alike(clamped, tmp_path):
    clamped.save(tmp_path / "bar.npz")
    run = CliRunner().invoke(
        app,
        ["pack", str(tmp_path / "bar.npz"), "--interface=tip=TIP", "--frames=4", "-o", str(tmp_path / "a.fmu")],
    )
    assert run.exit_code == 0, run.output
    body = flexfmu.load(tmp_path / "a.fmu")
    assert body.model.frame_count == 4
    body.save(tmp_path / "modal.h5")
    run = CliRunner().invoke(app, ["pack", str(tmp_path / "modal.h5"), "-o", str(tmp_path / "b.fmu")])
    assert run.exit_code == 0, run.output
    assert (tmp_path / "b.fmu").read_bytes() == (tmp_path / "a.fmu").read_bytes()
    run = CliRunner().invoke(app, ["pack", str(tmp_path / "bar.npz")])
    assert run.exit_code == 1
    assert "sets of" in run.output
    assert "ROOT, TIP" in run.output
