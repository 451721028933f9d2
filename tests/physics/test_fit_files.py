"""What a fit writes: modes that are left out, body files, loads that its scene lacks, demo scenes, the command."""

import io
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from demo.fit.scenes import DEMONSTRATIONS, judging_scene, run
from rich.console import Console
from typer.testing import CliRunner

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.calls.describing import describe
from flexfmu.commands.cli import app
from flexfmu.files.basics import OutputError
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Mass, Method, Variant
from flexfmu.study.candidates import Reduction, reduction_config
from flexfmu.study.fit import fit
from flexfmu.study.fitted import body_text
from flexfmu.study.scene.config import BasisChoice
from flexfmu.study.scene.reference import errors, references
from flexfmu.study.scene.scene import read_scene
from flexfmu.study.workshop import subset
from meshes import body_file, box
from references import BEAM, DEMO
from scene_tools import FIT, Listening, with_results

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("counted")]

FRAMES = Variant(Method.FRAMES)
# E I / L² of the beam, N.
BENDING = 13.5e3
# s, of the motion under a sudden load: six periods.
SUDDEN_END = 0.25


@pytest.mark.parametrize("basis", BasisChoice)
def test_leaving_modes_out_of_a_body_makes_the_body_of_so_many_modes(bodies, basis):
    config = bodies.config(BEAM)

    def build(modes):
        variants = [Variant(Method.FRAMES_STIFFNESS), Variant(Method.SECOND_ORDER, Mass.POLYNOMIAL)]
        reduction = reduction_config(config, Reduction(basis, modes, 2), variants)
        table = reduction.reduction.model_copy(update={"inertia": True, "second_order": True, "membrane": False})
        return reduce_body(reduction.model_copy(update={"reduction": table}), Reporter())

    few, kept = build(4), subset(build(12), basis, 4)
    np.testing.assert_allclose(kept.angular_frequency, few.angular_frequency, rtol=1e-7)
    loads = {"tip": [500.0, 3e3, 1e3, 20.0, 30.0, 40.0]}
    for variant, agree in (
        (Variant(Method.FRAMES_STIFFNESS), 1e-7),
        (Variant(Method.FRAMES, Mass.CONFIGURATION), 1e-7),
        (Variant(Method.SECOND_ORDER), 1e-7),
        # Another basis keeps other combinations of the mass.
        (Variant(Method.SECOND_ORDER, Mass.POLYNOMIAL), 1e-4),
    ):
        models = [FlexibleBody(body, variant.method, variant.mass) for body in (kept, few)]
        motions = [model.motion(model.step(model.static(loads), {"tip": [0.0, 1e3, 0.0]}, 1e-3)) for model in models]
        np.testing.assert_allclose(*motions, rtol=agree, atol=1e-3 * agree)


@pytest.mark.long
def test_chosen_modes_come_from_the_store_whatever_is_chosen(tmp_path, bodies):
    config, store = bodies.config(BEAM), Store(tmp_path)

    def build(modes):
        listening = Listening()
        reduction = config.reduction.model_copy(update={"modes": modes})
        reduce_body(config.model_copy(update={"reduction": reduction}), listening, store)
        return listening

    assert not any("earlier build" in text for text in build(6).notes)
    again = build([1, 2, 5, 6])
    assert any("normal modes: taken from an earlier build" in text for text in again.notes)
    assert not again.warnings
    assert any("take both modes or none" in text for text in build([1, 6]).warnings)


def test_info_counts_modes_as_a_body_file_names_them(bodies):
    config = bodies.config(BEAM)
    reduction = config.reduction.model_copy(update={"modes": [1, 2, 5, 6]})
    body = reduce_body(config.model_copy(update={"reduction": reduction}), Reporter())
    console = Console(record=True, width=100, file=io.StringIO())
    for part in describe(body):
        console.print(part)
    rows = [line.split()[1] for line in console.export_text().splitlines() if line.startswith("│") and "0.01" in line]
    assert [row for row in rows if row.isdigit()] == ["1", "2", "5", "6"]


def test_a_body_file_that_is_written_says_what_was_meant(tmp_path):
    config = read_body_file(DEMO / "rear_axle" / "body_bushings.toml")
    reduction = Reduction(BasisChoice.RESIDUAL, 7, 3)
    wanted = reduction_config(config, reduction, [FRAMES])
    text = body_text(wanted, tmp_path, ["A line.", "Another " + 40 * "long " + "line."], {"frames": "Why three."})
    (tmp_path / "b.toml").write_text(text, encoding="utf-8")
    assert tomllib.loads(text)["frames"] == 3
    assert "# Why three.\nframes = 3" in text
    found = read_body_file(tmp_path / "b.toml")
    assert found.mesh.file.resolve() == config.mesh.file.resolve()
    assert (found.support, found.interface, found.reduction.modes) == (wanted.support, wanted.interface, 7)
    assert found.reduction.residual_flexibility
    assert found.formulation == wanted.formulation


def written(mesh, folder, interfaces, scene):
    """Scene of a mesh with a body file of eight levels and twenty modes."""
    config = body_file(mesh, folder, interface=interfaces, frames=8, reduction={"modes": 20})
    (folder / "body.toml").write_text(body_text(config, folder, [], {}), encoding="utf-8")
    (folder / "scene.toml").write_text(scene, encoding="utf-8")
    return read_scene(folder / "scene.toml", folder / "body.toml")


# --- loads that the scene does not have


ONE_WAY = """
[[static]]
name = "up"
loads = { "tip.force.y" = 300.0 }

[tolerance.static]
displacement = 0.02

[sweep]
modes = [10]
frames = [4]
"""
# Of a bar of 1 m × 30 mm × 20 mm: how far 1 N, or 1 N m, moves the end along itself. Torsion: S. Timoshenko,
# J. N. Goodier, Theory of Elasticity, section 109 (0.196 for sides of 3 to 2). The scene bends the bar along y.
CLOSED_FORM = {
    "tip.force.x": 1.0 / (2e11 * 6e-4),
    "tip.force.y": 1.0 / (3.0 * 2e11 * 4.5e-8),
    "tip.force.z": 1.0 / (3.0 * 2e11 * 2e-8),
    "tip.moment.x": 2.0 * 1.3 / (2e11 * 0.196 * 0.03 * 0.02**3),
    "tip.moment.y": 1.0 / (2e11 * 2e-8),
    "tip.moment.z": 1.0 / (2e11 * 4.5e-8),
}


def bar_fitted(folder, text):
    """Outcome of a scene that loads the bar one way, what was said, and the answers to small loads of every kind."""
    scene = written(box(ElementType.C3D20R, (10, 2, 2), (1.0, 0.03, 0.02)), folder, ["TIP"], text)
    report = Listening()
    found = fit(scene, folder / "fitted.toml", report, Store(folder / "kept"))
    body = FlexibleBody(reduce_body(read_body_file(folder / "fitted.toml"), Reporter()))
    answers = {}
    for place, name in enumerate(CLOSED_FORM):
        load = 1e-3 * np.eye(6)[place]
        moved = body.response(body.static({"tip": load}))
        answers[name] = 1e3 * np.concatenate([moved.displacement[0], moved.rotation[0]])[place]
    return found, report, answers


def test_a_fitted_body_gives_way_to_loads_that_its_scene_does_not_have(tmp_path):
    found, report, answers = bar_fitted(tmp_path, ONE_WAY)
    assert found.met
    # The mesh and the clamp's edge take two hundredths.
    for name, expected in CLOSED_FORM.items():
        assert answers[name] == pytest.approx(expected, rel=0.02), name
    assert not report.warnings
    assert found.mode_count < found.given_mode_count


# --- four scenes, against CalculiX


def linear_share(judge, target):
    """Error over tolerance of the fitted model, were it linear."""
    body = reduce_body(read_body_file(target), Reporter())
    return errors(judge, references(judge, Reporter()), FlexibleBody(body, Method.LINEAR)).share


@pytest.fixture(scope="module")
def fitted(tmp_path_factory, store):
    """Outcome and folder of a scene, found once."""
    known = {}

    def find(name, fmu=False):
        if name not in known:
            folder = tmp_path_factory.mktemp(name)
            known[name] = run(name, folder, Reporter(), store, fmu)[0], folder
        return known[name]

    return find


def check_scene(name, outcome, folder):
    """What holds of all scenes; error over tolerance of the model that was found, if it were linear."""
    found = outcome.fit
    assert found.met
    assert outcome.calculix.share <= 1.0
    # The default would do as well: what is saved is not accuracy that the scene asks for.
    assert outcome.given.share <= 1.0
    assert found.mode_count < found.given_mode_count
    assert found.frame_count < found.given_frame_count
    assert found.step > 0.0
    assert found.given_step > 0.0
    demonstration = DEMONSTRATIONS[name]
    judge = judging_scene(demonstration, read_scene(demonstration.scene, demonstration.body), folder)
    return linear_share(judge, folder / f"{name}.toml")


@pytest.mark.long
def test_scene_of_a_small_load_is_met_by_a_linear_model_and_its_fmu(fitted):
    outcome, folder = fitted("small_load", fmu=True)
    assert check_scene("small_load", outcome, folder) <= 1.0
    assert outcome.fit.variant.method is Method.LINEAR
    assert outcome.fit.frame_count == 0
    body = reduce_body(read_body_file(folder / "small_load.toml"), Reporter())
    packaged = read_packaged_body(folder / "small_load.fmu")
    np.testing.assert_allclose(packaged.angular_frequency, body.angular_frequency, rtol=1e-9)
    assert Variant(packaged.method, packaged.mass) == outcome.fit.variant


@pytest.mark.long
@pytest.mark.parametrize("name", ["large_load", "sudden_load"])
def test_scene_of_a_large_load_is_met_with_fewer_modes_and_frames(name, fitted):
    outcome, folder = fitted(name)
    assert check_scene(name, outcome, folder) > 2.0
    assert outcome.fit.variant.method is not Method.LINEAR
    # At the levels and times that CalculiX has, not those of the search: no worse than foreseen.
    assert outcome.calculix.share < 1.1 * outcome.fit.measured.share


@pytest.mark.long
def test_scene_of_the_axle_in_torsion_is_met_with_fewer_modes_and_frames(fitted):
    outcome, folder = fitted("torsion")
    assert check_scene("torsion", outcome, folder) > 2.0
    assert outcome.toe < 0.02
    assert outcome.fit.variant.method is Method.SECOND_ORDER


# --- the command


@pytest.mark.usefixtures("bent_beam")
def test_the_command_writes_a_body_file_and_its_fmu(tmp_path):
    command = ["fit", "body.toml", "--scene", "scene.toml", "--output", "lean.toml"]
    program = str(Path(sys.executable).parent / "flexfmu")
    result = subprocess.run([program, *command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "lean.toml, lean.fmu" in result.stdout
    assert re.fullmatch(r"pass: [\d.e-]+ × the tolerance", result.stdout.splitlines()[-1])
    written = reduce_body(read_body_file(tmp_path / "lean.toml"), Reporter())
    assert read_packaged_body(tmp_path / "lean.fmu").mode_count == written.mode_count


def test_the_command_fails_by_exit_code_last_line_and_json_where_no_model_meets_the_tolerance(tmp_path, monkeypatch):
    with_results(
        tmp_path, FIT.replace("[1, 2, 4, 8]", '[1]\nbasis = ["normal"]').replace("[10]", "[4]").replace("0.005", "1e-6")
    )
    program = str(Path(sys.executable).parent / "flexfmu")
    command = ["fit", "body.toml", "--scene", "scene.toml", "--output", "lean.toml"]
    plain = subprocess.run([program, *command], cwd=tmp_path, capture_output=True, text=True, check=False)
    monkeypatch.chdir(tmp_path)
    data = CliRunner().invoke(app, [*command, "--json"])
    assert (plain.returncode, data.exit_code) == (3, 3), plain.stderr
    assert plain.stdout.splitlines()[-1].startswith("fail: ")
    found = json.loads(data.stdout)
    assert found["pass"] is False
    assert found["measured"]["share"] > 1.0


def test_nothing_is_left_where_the_fmu_cannot_be_written(bent_beam, tmp_path, store, monkeypatch):
    target = tmp_path / "lean.toml"
    with pytest.raises(OutputError, match="expected a file name that ends in"):
        fit(bent_beam, target, Reporter(), store, tmp_path / "lean.zip")

    def refuse(*_):
        raise OutputError("no room")

    monkeypatch.setattr("flexfmu.study.fit.package_fmu", refuse)
    with pytest.raises(OutputError, match="no room"):
        fit(bent_beam, target, Reporter(), store, tmp_path / "lean.fmu")
    assert not list(tmp_path.glob("*lean*"))
