"""What the FMU watches for, how inputs are taken over a step, and the compliance of an interface."""

from dataclasses import replace

import numpy as np
import pytest

import fuzzed
from bodies import Beam, beam_body, random_body
from driven import STATE_HEAD, Driven
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.fmu.description import Runtime

BEAM = Beam()
# Turns the tip by half a radian.
BENDING = 1.2 * BEAM.bending_stiffness
STEP = 1e-3
OK, DISCARD, ERROR = 0, 2, 3
MISSED = "watch.stiffness_missed.limit"


@pytest.fixture(params=list(Runtime), ids=lambda runtime: runtime.value)
def runtime(request):
    """Each export."""
    return request.param


@pytest.fixture
def drive(runtime, tmp_path):
    """Start an FMU of each export."""

    def begin(model=None, **start):
        model = model or replace(beam_body(3, modes=4, damping=0.05), compliance_interfaces=("tip",))
        driven = Driven(model, tmp_path, runtime, **start)
        assert driven.began == OK
        return driven

    return begin


def tip(driven):
    """Displacement of the tip."""
    return driven.motion("tip")[:3]


def bent(drive, on_limit, **more):
    """A beam on which a force is about to turn the tip too far, and its state before."""
    driven = drive(**{"watch.rotation.limit": 0.05, "watch.rotation.on_limit": on_limit} | more)
    driven.set(**{"tip.force.y": BENDING})
    return driven


def test_rotation_beyond_the_limit_warns_once_and_goes_on(drive):
    driven = bent(drive, "warn")
    turned = []
    for _ in range(15):
        assert driven.taken()
        turned += driven.get("diagnostics.rotation_within_frame")
    assert turned[-1] > 0.05
    assert driven.get("status.code") == [2]
    ((status, text),) = driven.log
    assert status == 1
    assert "beyond the limit of 2.86 deg" in text
    assert "more frames" in text
    assert "frame" in text.split("within")[1]


def test_rotation_beyond_the_limit_discards_the_step_and_keeps_the_state(drive):
    driven = bent(drive, "discard")
    while driven.taken():
        before = tip(driven), driven.state
    assert driven.get("status.code") == [1]
    assert driven.get("diagnostics.rotation_within_frame")[0] <= 0.05
    # Behind identity and checksum only the status code differs.
    after = [np.frombuffer(block[STATE_HEAD:]) for block in (driven.state, before[1])]
    assert np.sum(after[0] != after[1]) == 1
    driven.set(**{"tip.force.y": 0.0})
    assert driven.taken()
    assert driven.get("status.code") == [1]


def test_rotation_beyond_the_limit_ends_the_simulation(drive):
    driven = bent(drive, "terminate")
    statuses = [driven.step()]
    while statuses[-1] == OK:
        statuses.append(driven.step())
    assert statuses[-1] == ERROR
    assert driven.log[-1][0] == ERROR
    assert "beyond the limit" in driven.log[-1][1]
    # Nothing but a reset leads on.
    assert driven.step() == ERROR
    assert "after an error" in driven.log[-1][1]


def test_a_limit_of_zero_is_none(drive):
    driven = drive(**dict.fromkeys(("watch.rotation.limit", "watch.stability.limit", MISSED), 0.0))
    driven.set(**{"tip.force.y": BENDING, "tip.force.x": -2.0 * BEAM.critical_load})
    for _ in range(40):
        assert driven.taken()
    assert driven.get("status.code") == [0]
    assert driven.log == []


def press(driven, share, steps=100):
    """Press the beam axially, slowly growing to a share of the critical load; whether every step was taken."""
    taken = []
    for k in range(steps):
        driven.set(**{"tip.force.x": -share * BEAM.critical_load * (k + 1) / steps})
        taken.append(driven.taken())
    return taken


def test_stability_falls_with_the_axial_load_as_eulers_formula_says(drive):
    driven = drive(**{"watch.stability.limit": 0.0})
    assert driven.get("diagnostics.stability")[0] == pytest.approx(1.0)
    press(driven, 0.5)
    # Three frames overestimate the critical load by 3 %.
    assert driven.get("diagnostics.stability")[0] == pytest.approx(0.5, abs=0.05)
    press(driven, 1.2)
    assert driven.get("diagnostics.stability")[0] < 0.0


@pytest.mark.parametrize("share", [0.9, 1.2])
def test_a_load_near_or_past_the_critical_one_is_named_before_numbers_are_wrong(drive, share):
    driven = drive(**{"watch.stability.limit": 0.2, "watch.rotation.limit": 0.0, MISSED: 0.0})
    driven.set(**{"tip.force.y": 1e-3, "tip.moment.x": 1e-6})
    assert all(press(driven, share))
    ((status, text),) = driven.log
    assert status == 1
    assert "near the critical load" in text
    assert "tip.force.x = -" in text
    # Bending modes about both axes have the lowest frequency.
    hertz = driven.model.angular_frequency[0] / (2.0 * np.pi)
    assert f"({hertz:.4g} Hz)" in text
    found = float(text.split("tip.force.x = ")[1].split()[0])
    assert 0.75 * BEAM.critical_load < -found < 0.93 * BEAM.critical_load
    assert driven.get("status.code") == [2]


def test_a_load_past_the_critical_one_is_refused_on_request(drive):
    driven = drive(**{"watch.stability.limit": 0.02, "watch.stability.on_limit": "discard", MISSED: 0.0})
    taken = press(driven, 1.3)
    refused = taken.index(False)
    assert not any(taken[refused:])
    # Three frames overestimate the critical load by 3 %; loads are looked at in steps of 5 %.
    assert 0.93 < 1.3 * (refused + 1) / 100 < 1.1
    assert "critical load" in driven.log[0][1]


def test_a_stiffening_pull_warns_of_nothing(drive):
    driven = drive()
    assert all(press(driven, -3.0))
    assert driven.get("diagnostics.stability")[0] >= 1.0 - 1e-9
    assert driven.log == []


def test_a_step_without_result_ends_the_simulation_on_request(drive):
    driven = drive(**{"watch.step.on_limit": "terminate"})
    driven.set(**{"tip.force.x": -1e12, "tip.force.y": 1e9})
    assert driven.step(0.1) == ERROR
    assert "lower the load" in driven.log[-1][1]


@pytest.mark.parametrize("kind", ["constant", "linear", "ramp"])
def test_inputs_are_taken_over_a_step_as_asked(drive, kind):
    driven = drive(**{"input.interpolation": kind})
    body = FlexibleBody(driven.model)
    forces, sizes, state = [0.0, 300.0, 500.0, 900.0], [STEP, 2 * STEP, 0.5 * STEP], body.rest()
    for k, size in enumerate(sizes):
        before, now = forces[k], forces[k + 1]
        driven.set(**{"tip.force.y": now})
        assert driven.taken(size)
        start, end = {
            "constant": (now, now),
            "ramp": (before, now),
            # Nothing is known of how it grew before the first step.
            "linear": (now, now + (now - before) * size / sizes[k - 1] if k else now),
        }[kind]
        state, _ = body.step_with_work(state, {"tip": [0.0, start, 0.0]}, size, {"tip": [0.0, end, 0.0]})
        np.testing.assert_allclose(tip(driven), body.response(state).displacement[0], rtol=1e-10, atol=1e-15)
    assert abs(tip(driven)[1]) > 1e-6


@pytest.mark.parametrize("kind", ["linear", "ramp"])
def test_a_replay_is_bit_exact_with_what_was_seen_and_set_before(drive, kind):
    driven = drive(**{"input.interpolation": kind, "watch.rotation.limit": 0.05})

    def tail():
        found = []
        for k in range(20):
            driven.set(**{"tip.force.y": 0.1 * k * BENDING, "tip.force.x": -0.1 * k * BEAM.critical_load})
            found += [driven.taken(), *tip(driven), *driven.get("status.code", "diagnostics.stability")]
        return found

    tail()
    kept, lines = driven.state, len(driven.log)
    first = tail()
    said = driven.log[lines:]
    driven.state = kept
    lines = len(driven.log)
    assert tail() == first
    assert driven.log[lines:] == said


def test_compliance_is_the_change_of_motion_by_a_load_held_over_the_step(drive):
    driven = drive()
    driven.set(**{"tip.force.y": 0.4 * BEAM.bending_stiffness, "tip.force.z": 900.0})
    for _ in range(8):
        driven.step()
    kept = driven.state

    def end(**more):
        driven.state = kept
        for name, value in more.items():
            driven.set(**{name: driven.get(name)[0] + value})
        driven.step()
        return np.array(tip(driven) + driven.get(*(f"tip.rotation.{axis}" for axis in "xyz")))

    rows, columns = [f"{k}{axis}" for k in "ur" for axis in "xyz"], [f"{k}{axis}" for k in "fm" for axis in "xyz"]
    end()
    found = np.array([driven.get(*(f"tip.compliance.{row}.{column}" for column in columns)) for row in rows])
    change = 1e-3 * BEAM.bending_stiffness
    for column, name in enumerate(f"tip.{kind}.{axis}" for kind in ("force", "moment") for axis in "xyz"):
        expected = (end(**{name: change}) - end(**{name: -change})) / (2.0 * change)
        # Of the tip's rotation vector, which the tip's spin follows while rotations are small.
        np.testing.assert_allclose(found[:3, column], expected[:3], atol=2e-2 * np.abs(found[:3]).max())
    assert found[1, 1] > 0.0
    np.testing.assert_allclose(found, found.T, atol=2e-2 * np.abs(found).max())


def test_compliance_of_two_interfaces_tells_how_each_moves_the_other(drive):
    model = replace(random_body(), compliance_interfaces=("port_0", "port_2"))
    driven = drive(model)
    driven.set(**{"port_0.force.x": 50.0, "port_2.force.z": -40.0})
    for _ in range(3):
        driven.step()
    kept = driven.state
    driven.step()
    rows = [f"{k}{axis}" for k in "ur" for axis in "xyz"]
    found = np.array(driven.get(*(f"port_0.compliance.port_2.{row}.fy" for row in rows)))
    back = np.array(driven.get(*(f"port_2.compliance.port_0.uy.f{axis}" for axis in "xyz")))

    def end(force):
        driven.state = kept
        driven.set(**{"port_2.force.y": force})
        driven.step()
        return np.array(driven.get(*(f"port_0.displacement.{axis}" for axis in "xyz")))

    expected = (end(0.01) - end(-0.01)) / 0.02
    np.testing.assert_allclose(found[:3], expected, atol=2e-2 * np.abs(expected).max())
    # Maxwell and Betti: what one does to the other, the other does to it.
    np.testing.assert_allclose(back, found[:3], atol=1e-2 * np.abs(found[:3]).max())


def test_a_step_takes_no_more_internal_steps_than_are_allowed_and_the_log_says_so(drive):
    driven = drive(**{"internal_step.most": 1.0, "internal_step.limit": 1e-4})
    driven.set(**{"tip.force.y": BENDING})
    before = driven.motion("tip")
    assert driven.step(0.5) == DISCARD
    assert driven.motion("tip") == before
    assert "internal_step.most" in driven.log[-1][1]
    driven.set(**{"tip.force.y": 0.0})
    assert driven.step(1e-4) == OK


# Derivatives, of the native export.


@pytest.fixture
def native(tmp_path):
    """Start a native FMU."""

    def begin(model=None, **start):
        model = model or replace(beam_body(3, modes=4, damping=0.05), compliance_interfaces=("tip",))
        return Driven(model, tmp_path, Runtime.NATIVE, **start)

    return begin


@pytest.mark.parametrize("method", ["linear", "frames", "modal_rotation", "stiffness_by_mode"])
def test_directional_derivatives_are_those_of_the_next_step_by_loads_held_over_it(native, method):
    by_mode = 2e3 * np.random.default_rng(2).standard_normal((6, 6, 6))
    driven = native(random_body(stiffness_by_mode=by_mode + by_mode.transpose(0, 2, 1)), method=method)
    loads = {"port_0.force.x": 30.0, "port_2.force.z": -20.0, "port_1.moment.y": 5.0}
    driven.set(**loads)
    for _ in range(3):
        driven.step()
    kept, outputs = (
        driven.state,
        [f"port_{k}.{q}.{a}" for k in range(3) for q in ("displacement", "rotation") for a in "xyz"],
    )
    names, along = list(loads), [1.0, -2.0, 0.5]
    status, found = driven.derivative(outputs, names, along)
    assert status == OK

    def end(change):
        driven.state = kept
        driven.set(**{name: loads[name] + change * part for name, part in zip(names, along, strict=True)})
        driven.step()
        return np.array(driven.get(*outputs))

    expected = (end(1e-2) - end(-1e-2)) / 2e-2
    size = np.max(np.abs(expected))
    # At the state before the step, of which a linear body's motion does not depend; rotations add as small ones.
    np.testing.assert_allclose(found, expected, rtol=0, atol=(1e-8 if method == "linear" else 2e-2) * size)
    assert size > 1e-9
    # They are linear in the direction, and asking has changed nothing.
    driven.state = kept
    parts = [driven.derivative(outputs, [name], [part])[1] for name, part in zip(names, along, strict=True)]
    np.testing.assert_allclose(np.sum(parts, axis=0), found, rtol=0, atol=1e-12 * size)
    assert driven.state == kept


def test_derivatives_of_or_by_what_has_none_are_refused_in_words(native):
    driven = native()
    for outputs, inputs, words in (
        (["diagnostics.stability"], ["tip.force.x"], "not of diagnostics.stability"),
        (["tip.displacement.x"], ["damping.scale"], "not by damping.scale"),
    ):
        assert driven.derivative(outputs, inputs, [1.0])[0] == ERROR
        assert words in driven.log[-1][1]
    assert driven.step() == OK


def test_inputs_with_derivatives_give_a_linear_body_the_exact_motion_under_growing_loads(native):
    body = FlexibleBody(beam_body(3, modes=4, damping=0.05), "linear")
    driven = native(method="linear")
    force, rate, state, size = 0.0, 4e5, body.rest(), 2e-3
    # Value and rate in either order, or the rate alone: the value stays where it has grown to.
    for k in range(6):
        if k < 2:
            driven.set(**{"tip.force.y": force})
        assert driven.rates(**{"tip.force.y": rate}) == OK
        if 2 <= k < 4:
            driven.set(**{"tip.force.y": force})
        assert driven.taken(size)
        end = force + rate * size
        state, _ = body.step_with_work(state, {"tip": [0.0, force, 0.0]}, size, {"tip": [0.0, end, 0.0]})
        force = end
        np.testing.assert_allclose(tip(driven), body.response(state).displacement[0], rtol=1e-12, atol=1e-18)
        assert driven.get("tip.force.y") == [pytest.approx(force, rel=1e-14)]
    # One step of all the time: exact, whatever its length.
    whole = body.step_with_work(body.rest(), {"tip": [0.0, 0.0, 0.0]}, 6 * size, {"tip": [0.0, force, 0.0]})[0]
    np.testing.assert_allclose(tip(driven), body.response(whole).displacement[0], rtol=1e-9)
    assert abs(tip(driven)[1]) > 1e-4
    # A rate holds for one step.
    driven.taken(size)
    state, _ = body.step_with_work(state, {"tip": [0.0, force, 0.0]}, size)
    np.testing.assert_allclose(tip(driven), body.response(state).displacement[0], rtol=1e-12)


@pytest.mark.parametrize(("name", "rate"), [("damping.scale", 1.0), ("tip.displacement.x", 1.0)])
def test_derivatives_of_what_is_no_input_are_refused(native, name, rate):
    driven = native()
    assert driven.rates(**{name: rate}) == ERROR
    assert name in driven.log[-1][1]


@pytest.mark.parametrize("rate", [np.nan, np.inf, 1e308])
def test_growth_beyond_all_numbers_discards_the_step(native, rate):
    driven = native()
    assert driven.rates(**{"tip.force.y": rate}) == OK
    assert driven.step(10.0) == DISCARD
    assert "derivative" in driven.log[-1][1]
    assert driven.rates(**{"tip.force.y": 1.0}) == OK
    assert driven.step() == OK


# Fixed interfaces.


@pytest.fixture(scope="module")
def free():
    """A free body of a mesh."""
    return fuzzed.fuzzed_body("free")


@pytest.mark.parametrize(
    ("method", "fixed"), [("linear", ["root"]), ("linear", ["root", "tip"]), ("linear", ["tip"]), ("frames", ["root"])]
)
def test_interfaces_that_are_fixed_before_the_start_stay_and_the_rest_moves_as_the_body_does(
    free, tmp_path, runtime, method, fixed
):
    driven = Driven(free, tmp_path, runtime, method=method, **{f"{name}.fixed": True for name in fixed})
    assert driven.began == OK
    body = FlexibleBody(free, method, fixed=fixed)
    loads = {"tip": [30.0, -200.0, 50.0], "root": [10.0, 20.0, 0.0]}
    given = {
        f"{name}.force.{axis}": value for name, force in loads.items() for axis, value in zip("xyz", force, strict=True)
    }
    driven.set(**given)
    state = body.rest()
    for _ in range(5):
        assert driven.taken(STEP)
        state = body.step(state, loads, STEP)
    response = body.response(state)
    for k, name in enumerate(("root", "tip")):
        found = driven.motion(name)
        np.testing.assert_allclose(found, [*response.displacement[k], *response.rotation[k]], rtol=0, atol=1e-13)
        assert (np.max(np.abs(found)) < 1e-12) == (name in fixed)


def test_interfaces_that_a_method_cannot_fix_are_refused_in_words(free, tmp_path, runtime):
    driven = Driven(free, tmp_path, runtime, **{"method": "frames", "tip.fixed": True})
    assert driven.began == ERROR
    text = driven.log[-1][1]
    assert "method 'frames'" in text
    assert "fix others, or choose another method" in text
