"""The order of calls that the standard asks for: set-up, communication points, stop time; of both exports."""

import pytest

from bodies import beam_body
from driven import Driven
from flexfmu.fmu.description import Runtime

OK, ERROR = 0, 3


@pytest.fixture(params=list(Runtime), ids=lambda runtime: runtime.value)
def driven(request, tmp_path):
    """A started beam under a load."""
    one = Driven(beam_body(2, modes=2), tmp_path, request.param)
    assert one.began == OK
    one.set(**{"tip.force.y": 10.0})
    return one


def calls(driven, *names):
    return [driven.side.status(*(name if isinstance(name, tuple) else (name,))) for name in names]


def test_initialisation_without_set_up_is_refused(driven):
    if driven.runtime is Runtime.PYTHON:
        pytest.skip("pythonfmu's library has no reset of its own")
    assert calls(driven, "reset", "enter") == [OK, ERROR]
    assert "after fmi2SetupExperiment" in driven.log[-1][1]
    assert calls(driven, "setup", "enter", "exit") == [OK, OK, OK]


@pytest.mark.parametrize("time", [5.0, 0.0, 1e-3 + 1e-8])
def test_a_step_from_another_point_is_refused_and_changes_nothing(driven, time):
    assert driven.taken(1e-3)
    before = driven.state
    assert driven.side.status("step", time, 1e-3) == ERROR
    assert "expected one from 0.001 s" in driven.log[-1][1]
    assert driven.state == before
    assert driven.taken(1e-3)


def test_points_that_differ_by_round_off_are_the_same(driven):
    """Sums of steps, products, and single precision."""
    for number in range(1000):
        assert driven.side.status("step", number * 1e-4, 1e-4) == OK
    assert driven.side.status("step", sum([1e-4] * 1000), 1e-4) == OK
    assert driven.side.status("step", 0.1001 * (1.0 + 2.0**-36), 1e-4) == OK


def test_no_step_goes_beyond_the_stop_time(driven):
    if driven.runtime is Runtime.PYTHON:
        pytest.skip("pythonfmu's library has no reset of its own")
    assert calls(driven, "reset", ("setup", 1.0, 1.01), "enter", "exit") == [OK] * 4
    assert driven.side.status("step", 1.0, 0.006) == OK
    assert driven.side.status("step", 1.006, 0.006) == ERROR
    assert "beyond the stop time" in driven.log[-1][1]
    assert driven.side.status("step", 1.006, 0.004) == OK


@pytest.mark.parametrize("stop", [None, 0.5e-3])
def test_a_state_handed_to_an_instance_that_is_not_set_up_goes_on_to_any_time(driven, stop):
    if driven.runtime is Runtime.PYTHON:
        pytest.skip("pythonfmu's library has no reset of its own")
    assert driven.taken(1e-3)
    block = driven.state
    assert driven.taken(1e-3)
    end = driven.state
    # The stop time of an earlier set-up, or none, is no part of it.
    assert calls(driven, "reset", ("setup", 0.0, stop), "reset") == [OK] * 3
    driven.state = block
    assert driven.taken(1e-3), driven.log[-1]
    assert driven.state == end
