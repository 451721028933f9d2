"""Explicit evaluation: what it feeds in, against closed forms and finer steps, and that the watch says so in time."""

from dataclasses import replace

import numpy as np
import pytest
from flexfmu.runtime.evaluation import Feed, FeedRates

from bodies import COROTATED, Beam, beam_body
from flexfmu.body import FlexibleBody
from flexfmu.errors import FlexfmuError
from flexfmu.model.errors import OptionError, RuntimeBodyError
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.model.reduced_body import Evaluation, Formulation, Kinematics, LoadPlacement, Mass
from flexfmu.stability.slave import Aboard, Told

BEAM = Beam()
EXPLICIT = replace(COROTATED, evaluation=Evaluation.EXPLICIT)
# A single bending mode: the corrective moment of a pull is a linear spring, and all has a closed form.
ONE = {"modes": 1, "planes": "y"}
PULL = 0.5 * BEAM.critical_load
MOMENT = Formulation(Kinematics.LINEAR, LoadPlacement.CORRECTIVE_MOMENT, evaluation=Evaluation.EXPLICIT)


def amplification(slope, omega, step):
    """Exact factor of the amplitude a step of q̈ + ω² q = s q, s q held: determinant 1 − s (1 − cos ωh)/ω²."""
    return np.sqrt(1.0 - slope / omega**2 * (1.0 - np.cos(omega * step)))


def slope_of(body, force):
    """∂Q/∂q of the corrective moment under an axial force."""
    shape, turn = body.interface_displacement[0, 1, 0], body.interface_rotation[0, 2, 0]
    return -force * shape * turn


@pytest.mark.parametrize("pull", [PULL, -PULL])
def test_a_pull_feeds_and_a_push_takes_by_the_closed_form(pull):
    body = beam_body(0, **ONE)
    omega = body.angular_frequency[0]
    step = 2.0 * np.pi / omega / 20
    model = FlexibleBody(body, MOMENT)
    state = model.static({"tip": [0.0, 1.0, 0.0]})
    amplitudes = []
    loads = {"tip": [pull, 0.0, 0.0]}
    slope = slope_of(body, pull)
    for _ in range(400):
        state = model.step(state, loads, step)
        amplitudes.append(np.hypot(np.sqrt(omega**2 - slope) * state.q[0], state.v[0]))
    # From one maximum over a period to another: the ellipse of a lagging vibration is a little askew.
    grown = np.max(amplitudes[-40:]) / np.max(amplitudes[:40])
    factor = amplification(slope, omega, step)
    assert abs(factor - 1.0) > 1e-3
    assert grown == pytest.approx(factor ** (len(amplitudes) - 40), rel=0.05)
    rates = model.feed_rates(state, model.loads(loads).packed(False), step)
    assert (rates.fed, -rates.taken)[pull < 0.0] == pytest.approx(np.log(factor) / step, rel=1e-2)


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_feed_settles_at_its_share_of_the_damping_and_adds_up_without(damping):
    feed = Feed()
    for _ in range(4000):
        feed = feed.after(FeedRates(0.5, damping * 100.0), 0.01)
    assert feed.fed == pytest.approx(0.5 / (100.0 * damping) if damping else 0.5 * 40.0)


def test_the_warning_comes_between_a_right_step_and_a_wrong_one():
    # The same pull and damping, three steps: feed grows with the step, and so does what is off.
    body = beam_body(0, **ONE, damping=0.05, formulation=MOMENT)
    omega, seen = body.angular_frequency[0], []
    inputs = np.array([PULL, 1.0, 0.0, 0.0, 0.0, 0.0])
    stiff = omega**2 - slope_of(body, PULL)
    with Aboard(body) as aboard:
        for count in (400, 4):
            step = 2.0 * np.pi / omega / count
            told, off, size = Told(aboard, {"watch.stiffness_missed.limit": 0.0}, inputs), 0.0, 0.0
            for k in range(20 * count):
                assert told.step(step)
                # Sudden side load on the stiffened body, in closed form.
                time, decay = (k + 1) * step, 0.05 * omega
                swing = np.sqrt(stiff - decay**2)
                shape = np.cos(swing * time) + decay / swing * np.sin(swing * time)
                force = body.interface_displacement[0, 1, 0]
                right = force**2 / stiff * (1.0 - np.exp(-decay * time) * shape)
                off, size = off + (told.motion()[0, 0, 1] - right) ** 2, size + right**2
            seen.append((np.sqrt(off / size), told.warned, told.words, told.real("diagnostics.feed")))
    (fine, quiet, _, _), (coarse, warned, words, feed) = seen
    assert fine < 0.02
    assert not quiet
    assert coarse > 0.1
    assert warned
    assert feed > 0.25
    assert 'formulation.evaluation = "implicit"' in words


def test_the_warning_comes_while_the_motion_is_still_right():
    model = beam_body(4, modes=4, formulation=EXPLICIT)
    inputs = np.zeros(6)
    inputs[1] = 0.5 * BEAM.bending_stiffness
    step = 2.0 * np.pi / model.angular_frequency[0] / 20
    implicit = FlexibleBody(model, COROTATED)
    state, off, size = implicit.rest(), 0.0, 0.0
    with Aboard(model) as aboard:
        told = Told(aboard, {}, inputs)
        while not told.warned:
            assert told.step(step)
            for _ in range(10):
                state = implicit.step(state, {"tip": inputs[:3]}, step / 10)
            right = implicit.response(state).displacement[0]
            off, size = off + np.sum((told.motion()[0, 0] - right) ** 2), size + np.sum(right**2)
    assert size > 0.0
    assert np.sqrt(off / size) < 0.1


def test_explicit_and_implicit_steps_agree_to_first_order():
    body = beam_body(4, modes=4, damping=0.02)
    loads, span = {"tip": [0.0, 0.3 * BEAM.bending_stiffness, 0.0]}, 0.02
    implicit, explicit = (FlexibleBody(body, formulation) for formulation in (COROTATED, EXPLICIT))

    def end(model, count):
        state = model.rest()
        for _ in range(count):
            state = model.step(state, loads, span / count)
        return model.response(state).displacement[0]

    right = end(implicit, 3200)
    coarse, fine = (np.linalg.norm(end(explicit, count) - right) for count in (200, 400))
    assert coarse / fine == pytest.approx(2.0, rel=0.15)
    assert 1e-7 < fine / np.linalg.norm(right) < 1e-2


def test_without_loads_explicit_steps_are_exact():
    body = beam_body(2, modes=3)
    state = FlexibleBody(body).static({"tip": [0.0, 500.0, 0.0]})
    ends = [FlexibleBody(body, f).step(state, {}, 0.37) for f in (COROTATED, EXPLICIT)]
    np.testing.assert_array_equal(ends[0].q, ends[1].q)


def test_internal_steps_divide_an_explicit_step():
    body = beam_body(2, modes=3)
    inputs = np.array([0.0, 2000.0, 0.0, 0.0, 0.0, 0.0])
    with Aboard(body) as aboard:
        whole = Told(aboard, {"formulation.evaluation": "explicit", "internal_step.limit": 1e-4}, inputs)
        short = Told(aboard, {"formulation.evaluation": "explicit"}, inputs)
        assert whole.step(4e-4)
        assert all(short.step(1e-4) for _ in range(4))
        np.testing.assert_allclose(whole.motion(), short.motion(), rtol=1e-12)


def test_a_modal_file_keeps_the_evaluation(tmp_path):
    body = beam_body(2, formulation=EXPLICIT)
    write_modal_file(body, tmp_path / "modal.h5")
    assert read_modal_file(tmp_path / "modal.h5").formulation == EXPLICIT


def test_explicit_evaluation_of_the_deformed_bodys_mass_is_refused():
    with pytest.raises(OptionError, match='"explicit" does not go with mass'):
        Formulation(mass=Mass.CONFIGURATION, evaluation=Evaluation.EXPLICIT)
    assert issubclass(OptionError, RuntimeBodyError)
    assert not issubclass(OptionError, FlexfmuError)


def test_a_senseless_load_is_refused_without_thousands_of_internal_steps():
    body = FlexibleBody(beam_body(4, modes=4))
    with pytest.raises(RuntimeBodyError, match=r"does not converge: the loads would turn") as told:
        body.step(body.rest(), {"tip": [-1e9, 1e9, 0.0]}, 1e-2)
    assert "lower the load" in str(told.value)
