"""Mistakes that are easy to make and must not pass in silence."""

import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.kept import build_fmu
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable, InterfaceTable, ReductionTable
from flexfmu.files.basics import BodyFileError, OutputError, PackagingError, SimulationError
from flexfmu.files.outputs import Reporter
from flexfmu.files.tables import read_table
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.fmu.simulation import simulate, simulate_csv
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Method
from flexfmu.reduction.options import Basis
from meshes import body_file, box, with_sets
from references import BEAM, body_without_error


class Warnings(Reporter):
    """Keeps what it is warned of."""

    def __init__(self):
        self.said = []

    def warning(self, text):
        """Keep it."""
        self.said.append(text)


def build(**changes):
    """Reduce the clamped beam with changes to its body file; the body and the warnings."""
    report = Warnings()
    return reduce_body(body_without_error(BEAM / "body.toml").model_copy(update=changes), report), report.said


def halves(**second):
    """Two frames by hand, made of two segments each, the second with more keys."""
    outer = {"name": "outer", "nodes": "SEG2", "parent": "inner", **second}
    return [FrameTable(name="inner", nodes="SEG1"), FrameTable(**outer)]


@pytest.mark.parametrize("joint", ["ROOT", "TIP", [0.5, 0.0, 0.0]])
def test_joint_away_from_the_section_is_refused(joint):
    with pytest.raises(BodyFileError, match="joint"):
        build(frames=None, frame=halves(joint=joint))


@pytest.mark.slow
def test_joint_in_the_section_is_taken():
    body, _ = build(frames=None, frame=halves(joint=[0.125, 0.01, 0.0]))
    np.testing.assert_allclose(body.joint_point[1], [0.125, 0.01, 0.0])


@pytest.mark.slow
def test_frames_that_overlap_leave_out_or_hold_nothing_are_told():
    frames = [*halves(), FrameTable(name="again", nodes="SEG2", parent="inner")]
    _, said = build(frames=None, frame=frames)
    assert any("in more than one frame" in text for text in said)
    assert any("in no frame" in text for text in said)
    _, said = build(frames=None, frame=[FrameTable(name="face", nodes="ROOT")])
    assert any("holds no whole element" in text for text in said)


@pytest.mark.slow
def test_interface_that_reaches_beyond_its_frame_is_told():
    half = {"box": [[0.3, -1.0, -1.0], [0.8, 1.0, 1.0]]}
    _, said = build(interface=[InterfaceTable(name="middle", nodes=half)], frames=16)
    assert any("lie outside frame" in text and text.endswith("take a smaller set") for text in said)


def test_a_bore_that_reaches_over_frames_is_not_asked_to_be_smaller(tmp_path):
    plate = box(ElementType.C3D8I, (8, 4, 1), (0.16, 0.08, 0.01))
    (block,) = plate.blocks
    middle = plate.points[block.connectivity].mean(axis=1)
    holed = replace(plate, blocks=(block.part(np.abs(middle[:, :2] - [0.08, 0.04]).max(axis=1) > 0.025),))
    # On the edges of the square hole: of its sides' planes.
    sides = {"BORE": lambda p: np.abs(np.abs(p[:, :2] - [0.08, 0.04]).max(axis=1) - 0.02)}
    holed = with_sets(holed, ROOT=lambda p: p[:, 0], **sides)
    report, plain = Warnings(), {"reduction": {"modes": 2, "residual_flexibility": False, "second_order": False}}
    reduce_body(body_file(holed, tmp_path, interface=["BORE"], frames=8, **plain, output={"surface": False}), report)
    (told,) = [text for text in report.said if "lie outside frame" in text]
    assert told.endswith("take fewer frames, or rigid = true")


@pytest.mark.slow
def test_interface_over_a_short_stretch_of_several_frames_moves_as_in_one_and_no_alarm_is_given():
    """An eighth of the length: 8 frames hold it in one, of 16 and 32 most of its nodes are outside its own."""
    file, moved = read_body_file(BEAM / "body.toml"), []
    formulation = file.formulation.model_copy(update={"method": Method.SECOND_ORDER})
    reduction = file.reduction.model_copy(update={"residual_flexibility": True})
    middle = {"interface": [InterfaceTable(name="middle", nodes="SEG4")], "formulation": formulation}
    for frames in (8, 32):
        body, said = build(**middle, reduction=reduction, frames=frames)
        assert not said
        one = FlexibleBody(body)
        moved.append(one.response(one.static({"middle": [0.0, 60e3, 0.0]})).displacement[0])
    assert np.linalg.norm(moved[1] - moved[0]) < 1e-4 * np.linalg.norm(moved[0])


@pytest.mark.slow
def test_interface_on_a_support_is_told_or_refused():
    support = [InterfaceTable(name="wall", nodes="ROOT")]
    _, said = build(interface=support)
    assert any("lies on a support" in text for text in said)
    reduction = read_body_file(BEAM / "body.toml").reduction
    body, _ = build(interface=support, reduction=reduction.model_copy(update={"residual_flexibility": True}))
    assert body.mode_count == 10
    with pytest.raises(BodyFileError, match="support"):
        build(interface=support, reduction=reduction.model_copy(update={"basis": Basis.CRAIG_BAMPTON}))


@pytest.mark.slow
def test_interface_on_a_support_beside_another_has_no_shapes_of_third_order():
    both = [InterfaceTable(name="tip", nodes="TIP"), InterfaceTable(name="wall", nodes="ROOT")]
    config = read_body_file(BEAM / "body.toml").model_copy(update={"interface": both, "reduction": ReductionTable()})
    body = reduce_body(config, Warnings())
    assert body.interface_displacement[0].any()
    assert not body.interface_displacement[1].any()


@pytest.mark.slow
def test_two_interfaces_on_the_same_nodes_cannot_be_held_apart():
    twins = [InterfaceTable(name="one", nodes="TIP"), InterfaceTable(name="two", nodes="TIP")]
    reduction = read_body_file(BEAM / "body.toml").reduction.model_copy(update={"basis": Basis.CRAIG_BAMPTON})
    with pytest.raises(BodyFileError, match="share their nodes"):
        build(interface=twins, reduction=reduction)


def test_too_many_modes_for_the_mesh_are_refused_in_words():
    reduction = read_body_file(BEAM / "body.toml").reduction.model_copy(update={"modes": 3600})
    with pytest.raises(BodyFileError, match="free degrees of freedom"):
        build(reduction=reduction)


@pytest.fixture(scope="module", params=list(Runtime), ids=lambda runtime: runtime.value)
def fmu(request, tmp_path_factory):
    """The beam's FMU of each export; it is not run in this process."""
    path = tmp_path_factory.mktemp("fmu") / "beam.fmu"
    package_fmu(build()[0], path, request.param)
    return path


def test_damaged_archives_are_refused_with_their_path(fmu, tmp_path):
    data = bytearray(fmu.read_bytes())
    with zipfile.ZipFile(fmu) as archive:
        place = archive.getinfo("resources/modal.h5").header_offset + 200
    data[place : place + 200] = bytes(200)
    (tmp_path / "crc.fmu").write_bytes(data)
    with pytest.raises(PackagingError, match=r"crc\.fmu.*damaged"):
        read_packaged_body(tmp_path / "crc.fmu")
    (tmp_path / "cut.fmu").write_bytes(data[:1000])
    with pytest.raises(PackagingError, match=r"cut\.fmu: not an archive"):
        read_packaged_body(tmp_path / "cut.fmu")
    with pytest.raises(PackagingError, match="it is a folder"):
        read_packaged_body(tmp_path)


def test_inputs_are_never_overwritten(fmu, tmp_path):
    loads = tmp_path / "loads.csv"
    loads.write_text("time,tip.force.y\n0,0\n1,1\n", encoding="utf-8")
    before = loads.read_bytes(), fmu.read_bytes()
    for target in (loads, fmu):
        with pytest.raises(OutputError):
            simulate_csv(fmu, loads, target, None, None, {}, Reporter())
    assert (loads.read_bytes(), fmu.read_bytes()) == before


def test_targets_that_cannot_be_written_are_found_before_the_work(tmp_path):
    (tmp_path / "folder.fmu").mkdir()
    (tmp_path / "folder.h5").mkdir()
    for fmu, modal in ((tmp_path / "folder.fmu", None), (tmp_path / "a.fmu", tmp_path / "folder.h5")):
        with pytest.raises(OutputError, match="is a folder"):
            build_fmu(tmp_path / "no_such_body.toml", fmu, modal)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.fmu", "folder.h5"]


@pytest.mark.parametrize(("step", "stop"), [(0.0, None), (np.inf, None), (None, np.inf), (None, np.nan), (-1.0, None)])
def test_endless_and_standing_simulations_are_refused(fmu, step, stop):
    with pytest.raises(SimulationError, match="expected a later end"):
        simulate(fmu, [], np.array([[0.0], [1.0]]), step=step, stop=stop)


def test_columns_of_the_same_name_are_refused_and_byte_order_marks_are_not(tmp_path):
    (tmp_path / "a.csv").write_text("time,f,f\n0,1,2\n", encoding="utf-8")
    with pytest.raises(SimulationError, match="two columns"):
        read_table(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("time,f\n0,1\n", encoding="utf-8-sig")
    assert read_table(tmp_path / "b.csv")[0] == ["f"]


@pytest.mark.slow
def test_load_that_jumps_at_the_start_acts_from_the_start(fmu, tmp_path):
    # In a process of its own: the FMU's code ends up in the process that runs it.
    (tmp_path / "jump.csv").write_text("time,tip.force.y\n0,0\n0,1000\n1,1000\n", encoding="utf-8")
    command = [sys.executable, "-m", "flexfmu", "simulate", str(fmu), "-i", "jump.csv", "-o", "out.csv"]
    command += ["--step", "0.5", "--static-start"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "out.csv" in done.stdout, done.stderr
    rows = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [float(row.split(",")[2]) for row in rows] == pytest.approx([0.0246] * 3, rel=1e-2)
