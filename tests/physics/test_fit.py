"""The smallest model that a scene allows."""

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

from driven import Driven
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
from flexfmu.study.cost import StepCost
from flexfmu.study.fit import fit
from flexfmu.study.fitted import body_text
from flexfmu.study.scene.config import BasisChoice
from flexfmu.study.scene.reference import errors, references
from flexfmu.study.scene.scene import read_scene
from flexfmu.study.smallest import reference_scene, smallest
from flexfmu.study.workshop import Crew, Workshop, subset
from meshes import body_file, box
from references import BEAM, DEMO, L_FRAME, calculix, displacement, relative
from scene_tools import BEND, Listening, calculix_results, scene_of, with_results

pytestmark = pytest.mark.slow

FRAMES = Variant(Method.FRAMES)
# E I / L² of the beam, N.
BENDING = 13.5e3
# s, of the motion under a sudden load: six periods.
SUDDEN_END = 0.25


@pytest.fixture(autouse=True)
def counted(monkeypatch):
    """Steps are not timed but counted, so that no choice depends on what else the machine does."""

    def cost(_, body, variant):
        work = body.mode_count * (1 + body.frame_count + list(Method).index(variant.method))
        return StepCost(1e-6 * work, 1e-6 * work, 1.0, 1.0)

    monkeypatch.setattr(Workshop, "cost", cost)


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


def static_error(body_file, force):
    """Error of a body file's model of the beam against CalculiX under a tip force (N)."""
    table = calculix(BEAM / "calculix" / "static_y.csv")
    row = table[table["force_N"] == force]
    body = FlexibleBody(reduce_body(read_body_file(body_file), Reporter()))
    found = body.response(body.static({"tip": [0.0, force, 0.0]})).displacement[0]
    return relative(found, displacement(row)[0])


FIT = """
[tolerance.static]
displacement = 0.005

[sweep]
modes = [10]
frames = [1, 2, 4, 8]
"""


def test_a_large_load_is_given_frames_and_holds_where_it_was_not_looked_at(tmp_path, store):
    scene = scene_of(tmp_path, BEND + FIT)
    target, report = tmp_path / "fitted.toml", Listening()
    found = fit(scene, target, report, store)
    stages = [title[:6] for title, *_ in report.counts]
    assert [stage for stage in stages if stage.endswith("of 3")] == ["1 of 3", "2 of 3"]
    for title, total, _, told in report.counts:
        assert told == sorted(told)
        assert 0 < told[-1] <= total, (title, told)
    assert found.met
    assert found.measured.share <= 1.0
    assert 1 <= found.frame_count <= 8
    # Of a pair of equal frequency both or none: (1, 2), (3, 4), (5, 6), (8, 9) are pairs.
    assert found.reduction.modes in (2, 4, 6, 7, 10)
    for force in (2e3, 5e3, 8e3):
        assert static_error(target, force) < 0.005
    text = target.read_text(encoding="utf-8")
    assert not warned(reduce_body(read_body_file(target), Reporter()), tmp_path, {"tip.force.y": 10e3}, 1.0)
    assert "Error over tolerance with 10 modes, by the number of frames: linear" in text
    assert tomllib.loads(text)["formulation"]["method"] != "linear"


@pytest.mark.long
def test_what_the_search_compares_with_is_as_good_as_the_finite_element_model(tmp_path, store):
    scene = scene_of(tmp_path, BEND + FIT)
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store, verify=True)
    assert found.met
    assert 0.05 < found.verified.share <= 1.0
    assert found.measured.share == pytest.approx(found.verified.share, rel=0.3)


@pytest.mark.long
def test_a_moment_is_judged_without_finite_elements(tmp_path, store):
    """Under an end moment the beam is an arc: M L / E I = π/4 at the load."""
    scene = scene_of(tmp_path, BEND.replace("tip.force.y", "tip.moment.z").replace("10e3", "10620.0") + FIT)
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store)
    assert found.met
    body = FlexibleBody(reduce_body(read_body_file(tmp_path / "fitted.toml"), Reporter()))
    moved = body.response(body.static({"tip": [0.0, 0.0, 0.0, 0.0, 0.0, 10620.0]})).displacement[0]
    arc = np.array([np.sin(np.pi / 4.0), 1.0 - np.cos(np.pi / 4.0), 0.0]) / (np.pi / 4.0) - [1.0, 0.0, 0.0]
    assert np.linalg.norm(moved - arc) < 0.01 * np.linalg.norm(arc)


def warned(body, folder, loads, factor):
    """Whether the body's FMU, as a master finds it, tells of its error under a multiple of loads."""
    start = {name: factor * load for name, load in loads.items()}
    driven = Driven(body, folder, initialization="static", **start)
    return any("off by" in text for _, text in driven.log)


@pytest.mark.parametrize(("tolerance", "frames"), [(0.3, 0), (0.02, 1), (0.001, 2)])
def test_a_tolerance_alone_is_met_by_the_fewest_frames_at_a_large_deflection(tmp_path, store, tolerance, frames):
    scene_of(tmp_path, BEND, changes=[("frames = 8\n", ""), ("residual_flexibility = false\n", "")])
    config, share = smallest(tmp_path / "body.toml", tolerance, None, Reporter(), store)
    assert (config.frames, share <= 1.0) == (frames, True)
    (load, *_) = reference_scene(config, store).static
    across = np.hypot(load.loads["tip.force.y"], load.loads["tip.force.z"])
    # Linear theory: a tip that turns by θ = F L² / 2 E I moves by 2/3 θ L, more than 0.2 L.
    assert across == pytest.approx(0.2 * 3.0 * BENDING, rel=0.02)
    body = reduce_body(config, Reporter())
    assert not warned(body, tmp_path, load.loads, 1.0)
    if frames > 1:
        assert warned(body, tmp_path, load.loads, 3.0)


def test_the_bound_in_a_scene_is_that_under_its_loads_whatever_other_interfaces_there_are(tmp_path, store):
    other = '[[interface]]\nname = "middle"\nnodes = { box = [[0.4, -1.0, -1.0], [0.6, 1.0, 1.0]] }\n\n'
    changes = [("[[interface]]\n", f"{other}[[interface]]\n"), ("frames = 8\n", "frames = 1\n")]
    scene_of(tmp_path, BEND, changes=changes)
    model = FlexibleBody(reduce_body(read_body_file(tmp_path / "body.toml").certified, Reporter(), store))
    assert model.model.interface_names == ("middle", "tip")
    loads = {"tip": [0.0, 10e3, 0.0]}
    bound = model.error(model.static(loads), loads).bound
    scene = scene_of(
        tmp_path, f'read = ["tip"]\n{BEND}[tolerance.static]\ndisplacement = {bound / 1.5}\n', changes=changes
    )
    assert scene.names == ("tip",)
    assert Workshop(scene, Reporter(), store).accepted(model.model, True) == pytest.approx(1.05 * bound, rel=1e-2)


def test_a_small_load_is_left_linear(tmp_path, store):
    scene = scene_of(tmp_path, BEND.replace("10e3", "200.0") + FIT)
    target = tmp_path / "fitted.toml"
    found = fit(scene, target, Reporter(), store)
    assert found.met
    assert found.variant.method is Method.LINEAR
    assert found.reduction.frames == 0
    assert "Linear is enough" in target.read_text(encoding="utf-8")


def clamped_at_both_ends(folder, changes=()):
    """The beam clamped at both ends under a load that moves its middle by more than its height."""
    body = DEMO / "clamped_clamped" / "body.toml"
    results = calculix_results(folder, body.parent / "calculix" / "static_y.csv", 200e3, (0.5, 1.0), "middle")
    case = BEND.replace("tip", "middle").replace("10e3", "200e3").replace("0.3", "0.5") + results
    return scene_of(folder, case + FIT.replace("[1, 2, 4, 8]", "[1, 3]"), body, changes)


@pytest.mark.long
def test_a_beam_held_at_both_ends_is_fitted_without_a_cut(tmp_path, store, monkeypatch):
    # A busy machine's timings would choose between bases that cost nearly the same.
    monkeypatch.setattr(
        Workshop, "cost", lambda _, body, __: StepCost(1e-6 * body.mode_count, 1e-6 * body.mode_count, 1.0, 1.0)
    )
    found = fit(clamped_at_both_ends(tmp_path), tmp_path / "fitted.toml", Reporter(), store)
    assert found.met
    assert found.variant.method is Method.SECOND_ORDER
    assert found.frame_count == 1
    body = FlexibleBody(reduce_body(read_body_file(tmp_path / "fitted.toml"), Reporter()))
    table = calculix(DEMO / "clamped_clamped" / "calculix" / "static_y.csv")[-1]
    moved = body.response(body.static({"middle": [0.0, 200e3, 0.0]})).displacement[0, 1]
    assert moved == pytest.approx(table["uy_m"], rel=0.005)


@pytest.mark.long
def test_processes_that_share_the_search_find_the_same_model(bent_beam, tmp_path, store, monkeypatch):
    # Timings are the machine's: here they grow with the modes.
    monkeypatch.setattr(
        Workshop, "cost", lambda _, body, __: StepCost(1e-6 * body.mode_count, 1e-6 * body.mode_count, 1.0, 1.0)
    )
    found = []
    for jobs in (1, 2):
        with Crew(jobs) as crew:
            found.append(fit(bent_beam, tmp_path / "fitted.toml", Reporter(), store, crew=crew))
    one, two = found
    assert (one.reduction, one.variant, one.tried, one.met) == (two.reduction, two.variant, two.tried, two.met)
    assert repr(one.measured) == repr(two.measured)
    assert one.reasons == two.reasons


def two_forces(folder, body, table, interfaces, modes, changes):
    """A demo body whose two interfaces are pressed against each other along z, with CalculiX's results at full load."""
    row = calculix(DEMO / body.parent.name / "calculix" / table)[-1]
    peaks = ", ".join(f'"{name}.force.z" = {row[f"{name}_fz_N"]}' for name in interfaces)
    columns = [(f"{name}.displacement.{axis}", row[f"{name}_u{axis}_m"]) for name in interfaces for axis in "xyz"]
    lines = [",".join(["factor", *(name for name, _ in columns)]), ",".join(["1.0", *(str(x) for _, x in columns)])]
    (folder / "results.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    scene = f"""
read = [{", ".join(f'"{name}"' for name in interfaces)}]
[[static]]
name = "twist"
loads = {{ {peaks} }}
factors = [1.0]
results = "results.csv"
[tolerance.static]
displacement = 0.01
[sweep]
basis = ["residual"]
modes = [{modes}]
frames = [1]
methods = ["linear", "second_order"]
finite_elements = false
"""
    return scene_of(folder, scene, body, changes)


@pytest.mark.long
def test_a_twisted_plate_is_fitted_with_fewer_coordinates(tmp_path, store):
    body = DEMO / "plate" / "body.toml"
    plain = [("frames = 8\n", ""), ('method = "frames"', 'method = "second_order"')]
    scene = two_forces(tmp_path, body, "static_twist.csv", ("corner_left", "corner_right"), 10, plain)
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store)
    assert found.met
    assert (found.variant.method, found.frame_count) == (Method.SECOND_ORDER, 1)
    assert found.mode_count < found.given_mode_count


@pytest.mark.long
def test_a_twist_beam_axle_is_cut_where_one_piece_falls_short(tmp_path, store):
    """Its body file says nothing of cuts; one piece is off by 2 %."""
    body = DEMO / "rear_axle" / "body_whole.toml"
    scene = two_forces(tmp_path, body, "opposite.csv", ("wheel_left", "wheel_right"), 6, [("frames = 4\n", "")])
    listening = Listening()
    found = fit(scene, tmp_path / "fitted.toml", listening, store)
    assert any("tried cut" in text for text in listening.notes)
    assert found.met
    assert read_body_file(tmp_path / "fitted.toml").cut == "auto"
    assert found.mode_count < found.given_mode_count


CURVED = DEMO / "curved"
# Body file, CalculiX's motion and how much of it (s), force (N) and its frequency (Hz; 0: sudden), changes of the file.
SHAKEN = {
    "beam": (BEAM, "sudden_load", SUDDEN_END, (0.0, 5e3, 0.0), 0.0, ()),
    "L-frame": (L_FRAME, "sudden_load", 0.1, (0.0, 0.0, 1.7e3), 0.0, ()),
    "quarter arc": (CURVED, "arc_90_shaken", 0.1, (0.0, 300.0, 600.0), 22.0, [("arc_45.inp", "arc_90.inp")]),
}


def shaken(folder, name, tolerance):
    """A demo body's motion by CalculiX as a scene with a tolerance of rms displacement."""
    body, results, end, force, hertz, changes = SHAKEN[name]
    table = calculix(body / "calculix" / f"{results}.csv")
    moved = displacement(table)[table["time_s"] <= end]
    times = table["time_s"][: len(moved)]
    header = "time," + ",".join(f"tip.displacement.{axis}" for axis in "xyz")
    rows = np.column_stack([times, moved])
    np.savetxt(folder / "motion.csv", rows, delimiter=",", header=header, comments="")
    course = np.sin(2.0 * np.pi * hertz * times) if hertz else np.ones(len(times))
    names = "time," + ",".join(f"tip.force.{axis}" for axis in "xyz")
    loads = np.column_stack([times, np.outer(course, force)])
    np.savetxt(folder / "loads.csv", loads, delimiter=",", header=names, comments="")
    text = f"""
[[transient]]
name = "shaken"
loads = "loads.csv"
duration = {times[-1]}
step = 5e-4
results = "motion.csv"
[tolerance.transient]
displacement = {tolerance}
[sweep]
basis = ["{"residual" if name == "quarter arc" else "normal"}"]
modes = [{20 if name == "L-frame" else 10}]
frames = [1, 2, 3]
methods = ["linear", "frames", "second_order"]
finite_elements = false
"""
    return scene_of(folder, text, body / "body.toml", [("ratio = 0.01", "ratio = 0.0"), *changes])


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("beam", 0.006),
        pytest.param("L-frame", 0.006, marks=pytest.mark.long),
        pytest.param("quarter arc", 0.004, marks=pytest.mark.long),
    ],
)
def test_a_motion_that_constant_mass_does_not_meet_is_given_the_deformed_body_s(tmp_path, store, name, tolerance):
    """No frames bring constant mass within it."""
    found = fit(shaken(tmp_path, name, tolerance), tmp_path / "fitted.toml", Reporter(), store)
    assert found.met
    assert found.variant == Variant(Method.SECOND_ORDER, Mass.POLYNOMIAL)
    written = (tmp_path / "fitted.toml").read_text(encoding="utf-8")
    assert 'mass = "polynomial"' in written
    assert "second_order, mass polynomial" in written


@pytest.mark.parametrize(("name", "tolerance"), [("beam", 0.03), pytest.param("L-frame", 0.05, marks=pytest.mark.long)])
def test_a_motion_that_constant_mass_meets_is_left_with_it(tmp_path, store, name, tolerance):
    found = fit(shaken(tmp_path, name, tolerance), tmp_path / "fitted.toml", Reporter(), store)
    assert found.met
    assert found.variant.mass is Mass.CONSTANT


@pytest.mark.long
def test_where_no_model_meets_the_tolerance_that_is_said(tmp_path, store):
    scene = with_results(tmp_path, FIT.replace("[1, 2, 4, 8]", "[1]").replace("0.005", "1e-6"))
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store)
    assert not found.met
    assert "out of reach with these frames and modes" in (tmp_path / "fitted.toml").read_text(encoding="utf-8")
    assert found.variant.method is not Method.LINEAR


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
