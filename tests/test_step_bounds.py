"""Work of a call is bounded, and forces of any size act: nothing hangs, and nothing is refused for round-off."""

from dataclasses import replace

import numpy as np
import pytest

from bodies import COROTATED, LINEAR, Beam, beam_body, random_body
from flexfmu.runtime import kernel, statics, stepping
from flexfmu.body import FlexibleBody
from flexfmu.model.errors import EquilibriumError, OptionError, StepError
from flexfmu.model.reduced_body import Evaluation, Formulation
from flexfmu.body import StepLimits
from test_watch import Driven

BEAM = Beam()
HEAVY = {"tip": (-2e3, 0.6 * BEAM.bending_stiffness, 0.0)}
# Rounds of the iteration in an internal step of ordinary cost, and the most that one sub-step may add to the last.
ORDINARY, LAST = 5, 16
either = pytest.mark.parametrize("use_compiled", [False, True], ids=["numpy", "compiled"])


@pytest.fixture
def rounds(monkeypatch):
    """Rounds of every try, in order."""
    counted = []
    inner = stepping.Stepper._try

    def counting(*arguments):
        found = inner(*arguments)
        counted.append(found[1])
        return found

    monkeypatch.setattr(stepping.Stepper, "_try", counting)
    return counted


def beam(most, tolerance, use_compiled=False, formulation=COROTATED):
    model = beam_body(3, modes=3, planes="y")
    return FlexibleBody(model, formulation, limits=StepLimits(0.0, tolerance, most), use_compiled=use_compiled)


@either
@pytest.mark.parametrize("most", [20.0, 300.0])
def test_a_step_of_too_much_work_is_refused_within_its_bound_and_leaves_no_trace(most, use_compiled, rounds):
    body = beam(most, 1e-9, use_compiled)
    start = body.step(body.rest(), {"tip": (0.0, 1e-3, 0.0)}, 1e-5)
    before = start.q.tobytes(), start.v.tobytes(), start.substeps
    rounds.clear()
    with pytest.raises(StepError, match=rf"more work than {most:g} internal steps .*tolerance of 1e-09") as told:
        body.step(start, HEAVY, 0.3)
    assert 0 < sum(rounds) <= ORDINARY * most + LAST
    assert "raise internal_step.most" in str(told.value)
    assert (start.q.tobytes(), start.v.tobytes(), start.substeps) == before
    undisturbed = beam(most, 1e-9, use_compiled)
    expected = undisturbed.step(start, {"tip": (0.0, 1e-3, 0.0)}, 1e-5)
    assert body.step(start, {"tip": (0.0, 1e-3, 0.0)}, 1e-5).q.tobytes() == expected.q.tobytes()


@either
def test_what_one_bound_refuses_a_larger_one_lets_through(use_compiled):
    limits = [beam(most, 1e-4, use_compiled) for most in (16.0, 4096.0)]
    with pytest.raises(StepError, match=r"internal_step\.most"):
        limits[0].step(limits[0].rest(), HEAVY, 0.064)
    _, work = limits[1].step_with_work(limits[1].rest(), limits[1].loads(HEAVY), 0.064)
    assert work.substeps > 16
    assert work.iterations <= ORDINARY * 4096


def test_steps_that_do_not_settle_are_divided_not_iterated_to_the_end(rounds):
    """A try that fails does so at its first internal steps: all of them together cost less than the one that holds."""
    body = beam(4096.0, 1e-4)
    _, work = body.step_with_work(body.rest(), body.loads(HEAVY), 0.256)
    assert work.substeps >= 64
    assert len(rounds) > 5
    assert sum(rounds[:-1]) < rounds[-1]


@pytest.mark.skipif(kernel._library() is None, reason="built without a C compiler")
def test_a_compiled_body_steps_without_numpy_however_hard_the_step(monkeypatch):
    body = beam(4096.0, 1e-4, True)

    def never(*_):
        raise AssertionError("a step in NumPy")

    monkeypatch.setattr(stepping, "_implicit_step", never)
    _, work = body.step_with_work(body.rest(), body.loads(HEAVY), 0.256)
    assert work.substeps >= 64


def test_explicit_steps_by_the_billion_are_refused_before_the_first():
    formulation = Formulation(evaluation=Evaluation.EXPLICIT)
    model = beam_body(3, modes=3, planes="y")
    body = FlexibleBody(model, formulation, limits=StepLimits(1e-8))
    with pytest.raises(StepError, match=r"1 s needs 100000000 internal steps by internal_step.limit = 1e-08 s"):
        body.step(body.rest(), HEAVY, 1.0)


def test_statics_near_a_critical_load_end_within_the_bound(monkeypatch):
    counted = []
    inner = statics.tangent_stiffness
    monkeypatch.setattr(statics, "tangent_stiffness", lambda *a: counted.append(1) or inner(*a))
    column = {"tip": (-10.0 * BEAM.critical_load, 1e-2 * BEAM.critical_load, 0.0)}
    for most, refused in ((400.0, True), (4096.0, False)):
        counted.clear()
        body = beam(most, 1e-4)
        if refused:
            with pytest.raises(EquilibriumError, match=r"% of the load are reached after .*internal_step.most"):
                body.static(column)
        else:
            body.static(column)
        assert 0 < len(counted) <= most / 20.0 + 15.0


@pytest.mark.parametrize("most", [0.0, -1.0, np.nan, np.inf])
def test_a_bound_that_is_none_is_refused(most):
    with pytest.raises(OptionError, match=r"internal_step\.most"):
        beam(most, 1e-4)


def test_an_fmu_discards_a_step_of_too_much_work_and_goes_on_with_a_shorter_one(tmp_path):
    bounds = {"internal_step.most": 8.0, "internal_step.tolerance": 1e-6}
    driven = Driven(tmp_path, beam_body(3, modes=3, damping=0.01), **bounds)
    driven.set(**{"tip.force.y": HEAVY["tip"][1]})
    block = driven.slave._get_fmu_state()
    assert not driven.step(0.1)
    ((status, text),) = driven.log
    assert status == 2
    assert "internal_step.most" in text
    assert driven.tip() == [0.0, 0.0, 0.0]
    assert driven.step(1e-4)
    moved = driven.tip()
    driven.slave._set_fmu_state(block)
    assert driven.step(1e-4)
    assert driven.tip() == moved
    assert moved[1] > 0.0


@either
@pytest.mark.parametrize("size", [1e-14, 1e-11, 1e-9, 1e-7, 1e-4])
def test_forces_of_any_size_move_a_body_as_its_linear_modes_say(size, use_compiled):
    """Along an axis in which the interface has the coordinate zero, while the frames that carry it do not."""
    worked = 0
    for seed in (1, 2, 3):
        model = random_body(seed)
        model = replace(model, interface_point=model.interface_point * [1.0, 1.0, 0.0])
        loads = {"port_0": (0.0, 0.0, size)}
        body, linear = (FlexibleBody(model, f, use_compiled=use_compiled) for f in (COROTATED, LINEAR))
        state, expected = body.rest(), linear.rest()
        for step in (1e-4, 1e-3, 1e-2):
            state, work = body.step_with_work(state, body.loads(loads), step)
            expected = linear.step(expected, loads, step)
            worked = max(worked, work.substeps)
            np.testing.assert_allclose(state.q, expected.q, rtol=0.0, atol=1e-5 * np.abs(expected.q).max())
        assert np.abs(state.q).max() > 0.0
    assert worked == 1
