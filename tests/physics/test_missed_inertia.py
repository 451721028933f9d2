"""How wrong its mass makes a held body's motion is told: by as much as vibrations run early or late."""

from dataclasses import replace

import numpy as np
import pytest

from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method
from flexfmu.program.variable_table import variable_table
from references import L_FRAME, missed_share, relative

MISSED = "diagnostics.inertia_missed"
STEP = 5e-4


@pytest.fixture(scope="module")
def l_frame(bodies):
    """The L-frame, undamped, two frames to second order, with its lumps, and constant mass."""
    config = bodies.config(L_FRAME)
    stored = {"modes": 8, "inertia": True, "second_order": True}
    changes = {"frames": 2, "reduction": config.reduction.model_copy(update=stored)}
    body = reduce_body(config.model_copy(update=changes), Reporter())
    return replace(body, damping_ratio=np.zeros(body.mode_count), method=Method.SECOND_ORDER)


def constant(_):
    return 1.0


def swung(folder, model, force, count=60, course=constant, **start):
    """An instance after a force (N) out of the plane has swung it; what was told after each step."""
    driven = Driven(model, folder, **start)
    told = []
    for number in range(count):
        driven.set(**{"tip.force.z": force * course(number * STEP)})
        if not driven.taken(STEP):
            break
        told.append(driven.get(MISSED)[0])
    return driven, np.array(told)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [Mass.CONSTANT, Mass.POLYNOMIAL])
def test_what_is_told_is_the_motion_that_follows_from_what_the_mass_omits(tmp_path, l_frame, mass):
    """x'' + Λx = ½ ∂(v·δM v)/∂q − d(δM v)/dt, linear; its displacement over the body's, rms."""
    model = replace(l_frame, mass=mass)
    _, told = swung(tmp_path, model, 800.0)
    body = FlexibleBody(model)
    states = [body.rest()]
    for _ in told:
        states.append(body.step(states[-1], {"tip": [0.0, 0.0, 800.0]}, STEP))
    expected = missed_share(model, states, STEP)
    assert expected > (2e-3 if mass is Mass.CONSTANT else 1e-5)
    assert told[-1] == pytest.approx(expected, rel=1e-6)


# Force (N), its course, and whether constant mass is wrong by more than a per cent.
MOTIONS = {
    "far": (1.7e3, constant, True),
    "not so far": (200.0, constant, False),
    "far but slowly": (1.7e3, lambda time: min(time / 0.1, 1.0), False),
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_it_is_told_where_a_few_swings_are_off_by_a_per_cent_and_not_where_they_are_right(tmp_path, l_frame, motion):
    force, course, wrong = MOTIONS[motion]
    driven, told = swung(tmp_path, l_frame, force, 200, course)
    motions = []
    for mass in (Mass.CONSTANT, Mass.CONFIGURATION):
        body = FlexibleBody(l_frame, mass=mass, limits=StepLimits(0.0, 1e-5))
        state, found = body.rest(), []
        for number in range(200):
            state = body.step(state, {"tip": [0.0, 0.0, force * course(number * STEP)]}, STEP)
            found.append(body.response(state).displacement[0])
        motions.append(np.array(found))
    error = relative(*motions)
    assert (error > 0.01) == wrong
    said = [line for line in driven.log if "constant mass" in line[1]]
    assert len(said) == wrong
    # Small errors are told as they are; larger ones up to two and a half times: what varies twice is of second order.
    assert 0.9 * error - 5e-5 < told[-1] < (2.5 if wrong else 1.1) * error + 5e-5
    if wrong:
        ((status, text),) = said
        assert status == 1
        assert f"constant mass makes the motion wrong by some {100.0 * told[told > 0.01][0]:.3g} %" in text
        assert 'mass = "polynomial"' in text


def test_nothing_is_told_of_a_body_that_stands_still_however_far_it_is_bent(tmp_path, l_frame):
    driven = Driven(l_frame, tmp_path, initialization="static", **{"tip.force.z": 1.7e3})
    for _ in range(100):
        assert driven.taken(STEP)
    assert driven.get("tip.displacement.z")[0] > 0.05
    assert driven.get(MISSED)[0] < 1e-9
    assert driven.log == []


def test_a_swing_beyond_the_limit_is_refused_on_request(tmp_path, l_frame):
    start = {"watch.inertia_missed.limit": 0.005, "watch.inertia_missed.on_limit": "discard"}
    driven, told = swung(tmp_path, l_frame, 1.7e3, **start)
    assert 2 < len(told) < 60
    assert told[-1] <= 0.005
    assert driven.get("status.code") == [1]


def test_a_step_that_is_repeated_is_looked_at_as_if_it_were_the_first(tmp_path, l_frame):
    driven, told = swung(tmp_path, l_frame, 1.7e3, count=40)
    kept = driven.state
    driven.taken(STEP)
    after = driven.get(MISSED)
    driven.state = kept
    assert driven.get(MISSED)[0] == told[-1]
    driven.taken(STEP)
    assert driven.get(MISSED) == after


@pytest.mark.slow
@pytest.mark.parametrize(("force", "wrong"), [(1.7e3, False), (5.1e3, True)])
def test_of_the_polynomial_it_is_told_where_products_that_it_omits_count(tmp_path, l_frame, force, wrong):
    """Against lumps. Three times the load bends the frame by some 0.4 rad."""
    driven, told = swung(tmp_path, replace(l_frame, mass=Mass.POLYNOMIAL), force, 200)
    motions = []
    for mass in (Mass.POLYNOMIAL, Mass.CONFIGURATION):
        body = FlexibleBody(l_frame, mass=mass, limits=StepLimits(0.0, 1e-5))
        state, found = body.rest(), []
        for _ in told:
            state = body.step(state, {"tip": [0.0, 0.0, force]}, STEP)
            found.append(body.response(state).displacement[0])
        motions.append(np.array(found))
    error = relative(*motions)
    assert (error > 0.01) == wrong
    said = [text for _, text in driven.log if "the mass polynomial makes the motion wrong" in text]
    assert len(said) == wrong
    if wrong:
        assert 0.4 * error < told[-1] < 2.0 * error
        assert 'mass = "configuration"' in said[0]


def test_bodies_with_the_lumps_mass_are_not_watched_for_it(l_frame):
    for mass in Mass:
        names = {variable.name for variable in variable_table(replace(l_frame, mass=mass))}
        assert (MISSED in names) == (mass is not Mass.CONFIGURATION)
