"""Work of a call is bounded, and forces of any size act: nothing hangs, and nothing is refused for round-off."""

from dataclasses import replace

import numpy as np
import pytest

from bodies import COROTATED, LINEAR, Beam, beam_body, random_body, with_polynomial, with_second_order
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.files.basics import EquilibriumError, OptionError, StepError
from flexfmu.model.methods import Method

BEAM = Beam()
HEAVY = {"tip": (-2e3, 0.6 * BEAM.bending_stiffness, 0.0)}
# Rounds of the iteration in an internal step of ordinary cost, and the most that one sub-step may add to the last.
ORDINARY, LAST = 5, 16
# Internal steps of ordinary cost for a round of the equilibrium, and rounds of one increment.
STATIC, INCREMENT = 20, 15


def beam(most, tolerance):
    return FlexibleBody(beam_body(3, modes=3, planes="y"), COROTATED, limits=StepLimits(0.0, tolerance, most))


def refused_rounds(body, start, loads, step):
    """Rounds of the iteration that a refused step took in all."""
    answer, *_, work = body.core.step(start.q, start.v, body.loads(loads).packed(False), step)
    assert answer
    return work[1]


@pytest.mark.parametrize("most", [20.0, 300.0])
def test_a_step_of_too_much_work_is_refused_within_its_bound_and_leaves_no_trace(most):
    body = beam(most, 1e-9)
    start = body.step(body.rest(), {"tip": (0.0, 1e-3, 0.0)}, 1e-5)
    before = start.q.tobytes(), start.v.tobytes(), start.substeps
    with pytest.raises(StepError, match=rf"more work than {most:g} internal steps .*tolerance of 1e-09") as told:
        body.step(start, HEAVY, 0.3)
    assert 0 < refused_rounds(body, start, HEAVY, 0.3) <= ORDINARY * most + LAST
    assert "raise internal_step.most" in str(told.value)
    assert (start.q.tobytes(), start.v.tobytes(), start.substeps) == before
    undisturbed = beam(most, 1e-9)
    expected = undisturbed.step(start, {"tip": (0.0, 1e-3, 0.0)}, 1e-5)
    assert body.step(start, {"tip": (0.0, 1e-3, 0.0)}, 1e-5).q.tobytes() == expected.q.tobytes()


def test_what_one_bound_refuses_a_larger_one_lets_through():
    limits = [beam(most, 1e-4) for most in (1.0, 4096.0)]
    with pytest.raises(StepError, match=r"internal_step\.most"):
        limits[0].step(limits[0].rest(), HEAVY, 0.256)
    _, work = limits[1].step_with_work(limits[1].rest(), limits[1].loads(HEAVY), 0.256)
    assert work.substeps > 16
    assert work.iterations <= ORDINARY * 4096


def test_steps_that_do_not_settle_are_divided_not_iterated_to_the_end():
    """A try that fails does so at its first internal steps: all of them together cost less than the one that holds."""
    body = beam(4096.0, 1e-4)
    _, work = body.step_with_work(body.rest(), body.loads(HEAVY), 0.256)
    assert work.substeps >= 64
    *_, alone = body.core.step(
        body.rest().q, body.rest().v, body.loads(HEAVY).packed(False), 0.256, None, work.substeps
    )
    assert alone[0] == work.substeps
    assert work.iterations - alone[1] < alone[1]


def test_internal_steps_by_the_billion_are_refused_before_the_first():
    body = FlexibleBody(beam_body(3, modes=3, planes="y"), COROTATED, limits=StepLimits(1e-8))
    with pytest.raises(StepError, match=r"1 s needs 100000000 internal steps by internal_step.limit"):
        body.step(body.rest(), HEAVY, 1.0)
    assert refused_rounds(body, body.rest(), HEAVY, 1.0) == 0


def large(frames, most):
    """A body of so many modes that a round reads more than an ordinary one works, and how much a call may take."""
    model = with_second_order(beam_body(frames, modes=45), 1e-9)
    return FlexibleBody(model, Method.SECOND_ORDER, limits=StepLimits(0.0, 1e-4, most))


def bent(body, share, step):
    """Answer, internal steps and rounds of a step from rest under a force across, over its stiffness."""
    rest, loads = body.rest(), body.loads({"tip": (-2e3 * share, share * BEAM.bending_stiffness, 0.0)})
    answer, *_, work = body.core.step(rest.q, rest.v, loads.packed(False), step)
    return answer.name, *work[:2]


def test_a_large_body_takes_a_step_that_keeps_its_pace():
    """Most of its rounds are those of the last try, more than are let go in vain."""
    answer, _, rounds = bent(large(6, 170.0), 0.6, 0.05)
    assert answer == "OK"
    assert rounds > 0.8 * ORDINARY * 170


@pytest.mark.parametrize(("share", "step"), [(0.6, 0.05), (2.0, 0.01)])
def test_a_large_body_gives_up_where_the_pace_of_a_step_is_too_slow(share, step):
    """It went on to the last of 500 rounds."""
    answer, _, rounds = bent(large(6, 100.0), share, step)
    assert answer == "TOO_MUCH_WORK"
    assert 0 < rounds < 0.7 * ORDINARY * 100


@pytest.mark.parametrize(("frames", "share", "step"), [(14, 2.0, 0.1), (10, 0.3, 0.05)])
def test_a_large_body_gives_up_where_many_tries_have_been_in_vain(frames, share, step):
    """It went on to the finest division; the second body's tries all come as far, in vain."""
    answer, substeps, _ = bent(large(frames, 60.0), share, step)
    assert answer == "TOO_MUCH_WORK"
    assert substeps < 64


def test_a_mass_polynomial_of_many_terms_counts_by_what_it_reads():
    """It went on to the last of 700 rounds but for a few."""
    model = with_polynomial(beam_body(2, modes=45), 1e-7)
    terms = {name: np.repeat(getattr(model.polynomial, name), 40, axis=0) for name in ("form", "linear", "square")}
    model = with_second_order(replace(model, polynomial=replace(model.polynomial, **terms)), 1e-9)
    body = FlexibleBody(model, Method.SECOND_ORDER, "polynomial", limits=StepLimits(0.0, 1e-4, 140.0))
    answer, _, rounds = bent(body, 1.0, 0.05)
    assert answer == "TOO_MUCH_WORK"
    assert 0 < rounds < 0.7 * ORDINARY * 140


def test_statics_near_a_critical_load_end_within_the_bound():
    column = {"tip": (-10.0 * BEAM.critical_load, 1e-2 * BEAM.critical_load, 0.0)}
    for most, refused in ((400.0, True), (4096.0, False)):
        body = beam(most, 1e-4)
        *_, rounds = body.core.static(body.loads(column).packed(False))
        assert 0 < rounds <= most / STATIC + INCREMENT
        if refused:
            with pytest.raises(EquilibriumError, match=r"% of the load within the work of 400 .*internal_step.most"):
                body.static(column)
        else:
            body.static(column)


@pytest.mark.parametrize("most", [0.0, -1.0, np.nan, np.inf])
def test_a_bound_that_is_none_is_refused(most):
    with pytest.raises(OptionError, match=r"internal_step\.most"):
        beam(most, 1e-4)


@pytest.mark.parametrize("size", [1e-14, 1e-11, 1e-9, 1e-7, 1e-4])
def test_forces_of_any_size_move_a_body_as_its_linear_modes_say(size):
    """Along an axis in which the interface has the coordinate zero, while the frames that carry it do not."""
    worked = 0
    for seed in (1, 2, 3):
        model = random_body(seed)
        model = replace(model, interface_point=model.interface_point * [1.0, 1.0, 0.0])
        loads = {"port_0": (0.0, 0.0, size)}
        body, linear = (FlexibleBody(model, method) for method in (COROTATED, LINEAR))
        state, expected = body.rest(), linear.rest()
        for step in (1e-4, 1e-3, 1e-2):
            state, work = body.step_with_work(state, body.loads(loads), step)
            expected = linear.step(expected, loads, step)
            worked = max(worked, work.substeps)
            np.testing.assert_allclose(state.q, expected.q, rtol=0.0, atol=1e-5 * np.abs(expected.q).max())
        assert np.abs(state.q).max() > 0.0
    assert worked == 1
