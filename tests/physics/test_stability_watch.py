"""Across each boundary of buckling and rotation: right and silent on this side, warned or refused on the other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodies import COROTATED, LINEAR, Beam, beam_body, source_of_judgement
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import EquilibriumError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Method
from flexfmu.study.stability import BodyPrograms, DrivenSlave
from meshes import arc, bars, body_file, box, with_sets
from references import body_without_error

BEAM = Beam()
SIDE = 10.0
STATIC = {"initialization": "static"}
DEMO = Path(__file__).parents[2] / "demo"


def column(press):
    """Tip deflection of the clamped column under an axial press and SIDE, in closed form (Timoshenko and Gere)."""
    u = BEAM.length * np.sqrt(press / BEAM.bending_stiffness)
    return SIDE * BEAM.length / press * (np.tan(u) / u - 1.0)


def pressed(body, share):
    inputs = np.zeros(6)
    inputs[:2] = -share * BEAM.critical_load, SIDE
    with BodyPrograms(body) as aboard:
        return DrivenSlave(aboard, STATIC, inputs)


@pytest.mark.parametrize(
    ("frames", "method", "right", "wrong"),
    [
        (0, LINEAR, 0.07, 0.3),
        (2, LINEAR, 0.07, 0.3),
        (1, COROTATED, 0.2, 0.7),
        (2, COROTATED, 0.5, 0.93),
        (4, COROTATED, 0.7, 0.93),
    ],
)
def test_a_column_is_right_until_the_fmu_says_that_stiffness_is_missed(frames, method, right, wrong):
    body = beam_body(frames, modes=6, method=method)
    below, above = pressed(body, right), pressed(body, wrong)
    assert below.motion()[0, 0, 1] == pytest.approx(column(right * BEAM.critical_load), rel=0.1)
    assert not below.warned
    assert below.words == ""
    assert above.motion()[0, 0, 1] != pytest.approx(column(wrong * BEAM.critical_load), rel=0.1)
    assert above.warned
    assert "the method misses what the loads do to the stiffness" in above.words
    assert "tip.force.x" in above.words
    assert above.real("diagnostics.stiffness_missed") > 0.1 > below.real("diagnostics.stiffness_missed")


def test_a_linear_column_beyond_eulers_load_says_so():
    above = pressed(beam_body(4, method=LINEAR), 1.3)
    assert "beyond the critical load" in above.words
    assert above.real("diagnostics.stiffness_missed") == 1.0


def test_a_column_beyond_its_critical_load_is_refused_where_the_formulation_knows():
    # Straight, since it is not pushed aside: there is a stable equilibrium below, and none above.
    body = FlexibleBody(beam_body(8, method=COROTATED))
    body.static({"tip": [-0.97 * BEAM.critical_load, 0.0, 0.0]})
    with pytest.raises(EquilibriumError, match="critical load"):
        body.static({"tip": [-1.05 * BEAM.critical_load, 0.0, 0.0]})


def test_a_boom_on_a_stay_is_near_its_critical_load_where_it_is_pressed_and_not_where_it_is_blown_aside(tmp_path):
    """Aside, what bends stay and boom lies in what was their stiff plane: no frequency falls; the tangent does."""
    mesh = bars(ElementType.C3D20, [((0, 0, 0), (10, 0, 0)), ((0, 0, 2), (10, 0, 2)), ((10, 0, 1), (10, 0, 1))])
    x, y, z = mesh.points.T
    between = np.clip(z - 1.0, 0.0, 1.0) * (0.004 + 0.16 * np.clip(1.0 - 0.1 * x, 0.0, 1.0))
    height = 0.012 * np.clip(z, 0.0, 1.0) + between + 0.006 * np.clip(z - 2.0, 0.0, 1.0)
    mesh = replace(mesh, points=np.stack([0.05 * x, 0.014 * y, height], axis=1))
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0], TIP=lambda p: p[:, 0] - 0.55)
    body = FlexibleBody(reduce_body(body_file(mesh, tmp_path, interface=["TIP"], cut=[]), Reporter()))
    found = {}
    for case, force in {"aside": [0.0, 500.0, 0.0], "pressed": [-6000.0, 0.0, 0.0]}.items():
        state, inputs = body.static({"tip": force}), np.array([*force, 0.0, 0.0, 0.0])
        squares, omega = np.linalg.eigvalsh(body.tangent(state, inputs)), body.model.angular_frequency
        over_rest = np.linalg.eigvalsh(body.tangent(state, inputs) / np.outer(omega, omega))[0]
        found[case] = body.stability(state, inputs)[0], squares[0] / omega[0] ** 2, over_rest
    margin, square, over_rest = found["aside"]
    assert over_rest < 0.05
    assert square > 0.98
    assert margin > 0.5
    margin, square, _ = found["pressed"]
    assert margin == pytest.approx(square, rel=0.1)
    assert margin < 0.1


def test_a_static_start_beyond_a_limit_fails_where_it_is_to_end_the_simulation():
    body = beam_body(4, method=LINEAR)
    inputs = np.array([-0.5 * BEAM.critical_load, 0.0, 0.0, 0.0, 0.0, 0.0])
    with BodyPrograms(body) as aboard:
        assert DrivenSlave(aboard, {**STATIC, "watch.stiffness_missed.on_limit": "terminate"}, inputs).refused
        assert not DrivenSlave(aboard, STATIC, inputs).refused


@pytest.mark.parametrize(
    ("frames", "source"), [(0, "the displacement of the loaded interfaces, an estimate"), (4, "the frames")]
)
def test_the_second_opinion_knows_eulers_load(frames, source):
    body = FlexibleBody(beam_body(frames, modes=8), LINEAR)
    assert source_of_judgement(body.model, LINEAR) == source
    load = np.array([-BEAM.critical_load, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert body.core._filled(1, "missed", 0.9 * load)[0] > 0.0
    assert body.core._filled(1, "missed", 1.1 * load)[0] < 0.0
    # The bound that costs nothing never hides what is there.
    for share in (0.01, 0.05, 0.1, 0.5):
        assert body.core._ask("may_miss", share * load, 0.1) or body.stiffness_missed(share * load) <= 0.1


@pytest.mark.slow
def test_geometric_stiffness_aboard_is_the_second_opinion_of_the_demo_beam():
    config = body_without_error(DEMO / "clamped_beam" / "body.toml")
    reduction = config.reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    body = reduce_body(config.model_copy(update={"reduction": reduction}), Reporter())
    model = FlexibleBody(body, LINEAR)
    assert source_of_judgement(body, LINEAR) == "geometric stiffness by load"
    lines = (DEMO / "clamped_beam" / "calculix" / "buckling.csv").read_text(encoding="utf-8").splitlines()
    critical = next(-float(line.split(",")[1]) for line in lines if line.startswith("1,"))
    load = np.zeros(6)
    load[0] = -1.0
    assert model.core._filled(1, "missed", critical * load)[0] == pytest.approx(0.0, abs=5e-3)
    # A linear body is as wrong as what it misses: x of the critical load, x of the deflection.
    assert model.stiffness_missed(0.3 * critical * load) == pytest.approx(0.3, rel=0.01)


def turned(body, angle):
    """Static start under the end moment that bends the beam into an arc of an angle (rad)."""
    inputs = np.zeros(6)
    inputs[5] = BEAM.bending_stiffness * angle / BEAM.length
    with BodyPrograms(body) as aboard:
        return DrivenSlave(aboard, {**STATIC, "watch.stiffness_missed.limit": 0.0}, inputs)


@pytest.mark.parametrize(("frames", "right", "beyond"), [(0, 10, 45), (1, 35, 100), (2, 80, 150)])
def test_an_arc_is_right_until_the_fmu_says_that_material_turns_too_far_within_a_frame(frames, right, beyond):
    body = beam_body(frames, modes=8, method=COROTATED if frames else LINEAR)
    for angle, warned in ((np.radians(right), False), (np.radians(beyond), True)):
        told = turned(body, angle)
        radius = BEAM.length / angle
        arc = np.array([radius * np.sin(angle) - BEAM.length, radius * (1.0 - np.cos(angle)), 0.0])
        error = np.linalg.norm(told.motion()[0, 0] - arc) / np.linalg.norm(arc)
        assert told.warned == warned
        assert error < 0.1 or warned
    assert "within" in told.words
    assert "frames" in told.words


def test_what_was_seen_is_part_of_the_state():
    body = replace(beam_body(3, modes=3), method=LINEAR)
    inputs = np.array([-0.5 * BEAM.critical_load, SIDE, 0.0, 0.0, 0.0, 0.0])
    with BodyPrograms(body) as aboard:
        told = DrivenSlave(aboard, {}, inputs)
        kept = told._slave._get_fmu_state()
        steps = 0
        while not told.warned:
            assert told._slave.do_step(1e-3 * steps, 1e-3)
            steps += 1
        lines = len(told._slave._get_log_queue())
        assert lines == 1
        assert steps < 40
        told._slave._set_fmu_state(kept)
        assert not told.warned
        # Time is part of the state, too.
        assert all(told._slave.do_step(1e-3 * number, 1e-3) for number in range(steps))
        assert len(told._slave._get_log_queue()) == 2 * lines


def test_kinematics_that_are_wrong_by_the_angle_are_watched_more_closely():
    body = beam_body(1, modes=6)
    inputs = np.zeros(6)
    inputs[5] = BEAM.bending_stiffness * np.radians(30.0)
    with BodyPrograms(body) as aboard:
        found = {
            method: DrivenSlave(aboard, {**STATIC, "method": method.value}, inputs).warned
            for method in (Method.LINEAR, Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.FRAMES)
        }
    assert found == {
        Method.LINEAR: True,
        Method.MODAL_ROTATION: True,
        Method.HALF_ROTATION: False,
        Method.FRAMES: False,
    }


@pytest.mark.parametrize("share", [0.02, 0.08, 0.099, 0.101, 0.5, 0.95, 1.2, -0.05, -0.099, -0.2, -3.0])
def test_the_quick_look_hides_nothing_and_agrees_with_the_error_of_the_only_deflection(share):
    body = FlexibleBody(beam_body(4, modes=5), LINEAR)
    load = np.zeros(6)
    load[0] = -share * BEAM.critical_load
    error, may_miss = body.stiffness_missed(load), body.core._ask("may_miss", load, 0.1)
    assert error <= 0.1 or may_miss
    # Pressed straight, the column has no deflection but that of a disturbance: nearly that of its softest shape.
    if share != 0.101:
        assert may_miss == (error > 0.1)


def reduced_mesh(mesh, folder, interface, **tables):
    return reduce_body(body_file(mesh, folder, interface=interface, **tables), Reporter())


@pytest.mark.slow
def test_a_column_pressed_at_its_end_is_judged_so_however_many_interfaces_it_has(tmp_path):
    size = (BEAM.length, BEAM.width, BEAM.width)
    mesh = with_sets(box(ElementType.C3D20R, (16, 2, 2), size), MIDDLE=lambda points: points[:, 0] - 0.5 * BEAM.length)
    body = reduced_mesh(mesh, tmp_path, ["MIDDLE", "TIP"], frames=4, reduction={"modes": 8})
    model, load = FlexibleBody(body, LINEAR), np.zeros(12)
    load[6] = -BEAM.critical_load
    assert model.core._filled(1, "missed", load)[0] == pytest.approx(0.0, abs=0.02)
    assert model.stiffness_missed(0.3 * load) == pytest.approx(0.3, rel=0.05)
    # In the middle, the half of the column below bears four times as much.
    load = np.roll(load, -6)
    assert model.core._filled(1, "missed", load)[0] == pytest.approx(0.75, abs=0.02)


@pytest.fixture(scope="module")
def arcs(tmp_path_factory):
    """An arc of 45° with two and four frames, and the finest model of it."""
    mesh = arc(ElementType.C3D20R, (16, 2, 2), 4.0 / np.pi, 0.03, 0.25 * np.pi)
    reduction = {"modes": 8, "residual_flexibility": True, "second_order": True}
    folder = tmp_path_factory.mktemp("arc")
    return {n: reduced_mesh(mesh, folder, ["TIP"], frames=n, reduction=reduction) for n in (2, 4, 16)}


@pytest.mark.parametrize("frames", [2, 4])
@pytest.mark.parametrize("across", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
def test_an_arc_bent_in_its_plane_is_told_the_error_of_its_deflection_not_of_one_across(arcs, frames, across):
    """Stiffness against bending out of the plane changes far more, but no load in the plane asks for it."""
    body, fine = FlexibleBody(arcs[frames], COROTATED), FlexibleBody(arcs[16], Method.SECOND_ORDER)
    for force in (3e3, 9e3):
        load = force * np.array(across)
        found, expected = (each.response(each.static({"tip": load})).displacement[0] for each in (body, fine))
        error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
        assert error < 0.015
        assert 0.2 * error < body.stiffness_missed(np.append(load, np.zeros(3))) < 4.0 * error


def test_a_soft_body_under_a_small_load_misses_what_a_stiff_one_misses_under_a_large_load(arcs):
    """The disturbance that counts beside the loads is a share of them, not a load of its own: only ratios are seen."""
    stiff = FlexibleBody(arcs[2], COROTATED)
    soft = FlexibleBody(replace(arcs[2], angular_frequency=arcs[2].angular_frequency * 2.0**-20), COROTATED)
    load = np.array([0.0, 9e3, 0.0, 0.0, 0.0, 0.0])
    assert stiff.stiffness_missed(load) > 1e-3
    assert soft.stiffness_missed(load * 2.0**-40) == pytest.approx(stiff.stiffness_missed(load), rel=1e-9)


def test_of_one_mode_every_deflection_misses_the_same_share_of_stiffness():
    """A linear column of one mode φ under a press P: its tip's moment P φ takes 8/π² P φ φ' of the stiffness ω²."""
    model = beam_body(0, modes=1, planes="y", method=LINEAR)
    body = FlexibleBody(model)
    shape, slope = model.interface_displacement[0, 1, 0], model.interface_rotation[0, 2, 0]
    for press in (0.05, 0.1, 0.3):
        force = press * BEAM.critical_load
        share = 8.0 / np.pi**2 * force * shape * slope / model.angular_frequency[0] ** 2
        assert share == pytest.approx(press, rel=0.2)
        # Its numbers have 16 bits.
        assert body.stiffness_missed(np.array([-force, SIDE, 0.0, 0.0, 0.0, 0.0])) == pytest.approx(share, rel=2e-5)
