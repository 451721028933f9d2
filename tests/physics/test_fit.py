"""The smallest model that a scene allows."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.body.reference_loads import reference_loads
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method, Variant
from flexfmu.study.cost import StepCost
from flexfmu.study.fit import fit
from flexfmu.study.smallest import reference_scene, smallest
from flexfmu.study.workshop import Crew, Workshop
from references import BEAM, DEMO, L_FRAME, calculix, displacement, relative
from scene_tools import BEND, FIT, Listening, calculix_results, scene_of, with_results

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("counted")]

FRAMES = Variant(Method.FRAMES)
# E I / L² of the beam, N.
BENDING = 13.5e3
# s, of the motion under a sudden load: six periods.
SUDDEN_END = 0.25


def static_error(body_file, force):
    """Error of a body file's model of the beam against CalculiX under a tip force (N)."""
    table = calculix(BEAM / "calculix" / "static_y.csv")
    row = table[table["force_N"] == force]
    body = FlexibleBody(reduce_body(read_body_file(body_file), Reporter()))
    found = body.response(body.static({"tip": [0.0, force, 0.0]})).displacement[0]
    return relative(found, displacement(row)[0])


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


def test_reference_loads_do_not_hang_on_round_off_and_go_both_ways(bodies, random):
    """A bar of square section is equally soft along all axes across it, and each of them has two signs."""
    body = bodies(BEAM).model
    found = {name: force for name, _, force, _ in reference_loads(FlexibleBody(body))}
    model = FlexibleBody(body)
    for _, name, force, state in reference_loads(model):
        assert state.q == pytest.approx(model.static({name: force.tolist()}).q, rel=1e-12)
    assert list(found) == ["tip_1", "tip_1_back", "tip_2", "tip_2_back"]
    across = found["tip_1"][2]
    assert across > 0.0
    for sign, end in ((1.0, ""), (-1.0, "_back")):
        np.testing.assert_allclose(found[f"tip_1{end}"], [0.0, 0.0, sign * across], atol=1e-3 * across)
        np.testing.assert_allclose(found[f"tip_2{end}"], [0.0, sign * across, 0.0], rtol=1e-3, atol=1e-3 * across)
    for _ in range(5):
        noise = 1.0 + 1e-12 * random.standard_normal(body.interface_displacement.shape)
        noisy = replace(body, interface_displacement=noise * body.interface_displacement)
        for name, _, force, _ in reference_loads(FlexibleBody(noisy)):
            np.testing.assert_allclose(force, found[name], atol=1e-3 * across)
