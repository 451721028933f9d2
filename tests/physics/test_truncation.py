"""Vibrations that a basis holds only roughly are told, by as much as they put the motion out of phase."""

import numpy as np
import pytest

from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from references import L_FRAME

TOLD = "diagnostics.truncation"
STEP = 2e-4


@pytest.fixture(scope="module")
def frames(bodies):
    """The undamped L-frame with some normal modes and all static shapes, kept by their number."""
    config, found = bodies.config(L_FRAME), {}

    def made(modes):
        if modes not in found:
            reduction = config.reduction.model_copy(update={"modes": modes, "residual_flexibility": True})
            changes = {"frames": 1, "reduction": reduction, "damping": config.damping.model_copy(update={"ratio": 0.0})}
            found[modes] = reduce_body(config.model_copy(update=changes), Reporter())
        return found[modes]

    return made


def moved(model, course, count):
    """Displacements (n, 3) of the tip under forces along z, by the core alone."""
    body = FlexibleBody(model, limits=StepLimits(0.0, 1e-6))
    state, found = body.rest(), []
    for number in range(count):
        state = body.step(state, {"tip": [0.0, 0.0, course(number)]}, STEP)
        found.append(body.response(state).displacement[0])
    return np.array(found)


def told(folder, model, course, count):
    driven = Driven(model, folder)
    for number in range(count):
        driven.set(**{"tip.force.z": course(number)})
        assert driven.taken(STEP)
    return driven, driven.get(TOLD)[0]


COURSES = {
    "sudden": lambda _: 40.0,
    "a blow": lambda number: 400.0 * (number < 5),
    "slow": lambda number: 40.0 * min(number / 300, 1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("modes", [1, 2, 6])
def test_what_is_told_is_how_far_the_motion_is_off_that_of_many_modes(tmp_path, frames, modes, course):
    own, many = (moved(frames(count), COURSES[course], 400) for count in (modes, 30))
    error = np.sqrt(np.mean(np.sum((own - many) ** 2, axis=1))) / np.linalg.norm(many, axis=1).max()
    driven, found = told(tmp_path, frames(modes), COURSES[course], 400)
    assert 0.3 * error - 0.002 < found < 3.0 * error + 0.002
    assert len(driven.log) == (found > 0.01)
    for status, text in driven.log:
        assert status == 1
        assert "vibrations that the modes hold only roughly" in text


@pytest.mark.slow
def test_warnings_go_by_the_root_mean_square_of_the_motion(tmp_path, frames):
    """After a sudden load that is 0.6 of its largest."""
    found = told(tmp_path, frames(3), COURSES["sudden"], 400)[1]
    for share, warned in ((1.4, True), (2.0, False)):
        driven = Driven(frames(3), tmp_path, **{"watch.truncation.limit": share * found, "tip.force.z": 40.0})
        assert all(driven.taken(STEP) for _ in range(400))
        assert bool(driven.log) == warned


@pytest.mark.slow
def test_one_of_these_motions_is_wrong_and_another_right(tmp_path, frames):
    assert told(tmp_path, frames(3), COURSES["a blow"], 400)[1] > 0.03
    assert told(tmp_path, frames(3), COURSES["slow"], 400)[1] < 0.001


@pytest.mark.slow
@pytest.mark.parametrize("axis", "xyz")
def test_half_of_how_far_a_sudden_moment_s_turns_are_off_is_told(tmp_path, frames, axis):
    """Its displacement is off by far less: modes have a moment's sharp bend last."""
    load, turned = {f"tip.moment.{axis}": 2.0}, []
    for count in (6, 30):
        body = FlexibleBody(frames(count), limits=StepLimits(0.0, 1e-6))
        state, moment = body.rest(), np.concatenate([np.zeros(3), 2.0 * (np.array(list("xyz")) == axis)])
        turned.append([])
        for _ in range(400):
            state = body.step(state, {"tip": moment}, STEP)
            turned[-1].append(body.response(state).rotation[0])
    own, many = np.array(turned)
    error = np.sqrt(np.mean(np.sum((own - many) ** 2, axis=1))) / np.linalg.norm(many, axis=1).max()
    driven = Driven(frames(6), tmp_path, **load)
    assert all(driven.taken(STEP) for _ in range(400))
    assert driven.get(TOLD)[0] == pytest.approx(0.5 * error, rel=0.2)


@pytest.mark.slow
def test_nothing_is_told_in_the_first_moments_of_a_load_that_the_modes_hold(tmp_path, frames):
    driven = Driven(frames(6), tmp_path, **{"tip.force.z": 40.0})
    for _ in range(20):
        assert driven.taken(1e-6)
    assert driven.log == []


@pytest.mark.slow
def test_a_motion_beyond_the_limit_is_refused_on_request_and_leaves_what_was_told(tmp_path, frames):
    start = {"watch.truncation.limit": 0.005, "watch.truncation.on_limit": "discard"}
    driven, count = Driven(frames(1), tmp_path, **start), 0
    driven.set(**{"tip.force.z": 40.0})
    while driven.taken(STEP):
        count += 1
        assert count < 400
    assert driven.get(TOLD)[0] <= 0.005
    assert driven.get("status.code") == [1]


@pytest.mark.slow
def test_a_load_that_grows_slowly_is_not_warned_of_in_its_first_moments(tmp_path, frames):
    """What it excites is much of the motion there, and little of what it becomes."""
    driven, found = Driven(frames(1), tmp_path, **{"watch.truncation.limit": 0.0025}), []
    for number in range(2000):
        driven.set(**{"tip.force.x": 40.0 * number / 2000})
        assert driven.taken(STEP)
        found.append(driven.get(TOLD)[0])
    assert max(found) > 0.0025 > 0.002 > found[-1]
    assert driven.log == []


@pytest.mark.slow
def test_a_run_that_ends_while_its_motion_grows_is_warned_of_at_its_end(tmp_path, frames):
    driven = Driven(frames(1), tmp_path, **{"tip.force.z": 40.0})
    for _ in range(30):
        assert driven.taken(STEP)
    assert driven.get(TOLD)[0] > 0.01
    assert driven.log == []
    driven.side.status("terminate")
    assert len(driven.log) == 1
