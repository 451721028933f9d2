"""What constant mass leaves out of a held body's kinetic energy is told where vibrations begin to run early or late."""

from dataclasses import replace

import numpy as np
import pytest

from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.build.reduce import reduce_body
from flexfmu.files.progress import Reporter
from flexfmu.model.errors import ModalFileError
from flexfmu.model.methods import Mass, Method
from flexfmu.program.variable_table import variable_table
from references import L_FRAME, relative

MISSED = "diagnostics.inertia_missed"
STEP = 5e-4


@pytest.fixture(scope="module")
def l_frame(bodies):
    """The L-frame, undamped, two frames to second order, with its lumps."""
    config = bodies.config(L_FRAME)
    stored = {"modes": 8, "inertia": True, "second_order": True}
    changes = {"frames": 2, "reduction": config.reduction.model_copy(update=stored)}
    body = reduce_body(config.model_copy(update=changes), Reporter())
    return replace(body, damping_ratio=np.zeros(body.mode_count), method=Method.SECOND_ORDER)


def swung(folder, model, force, count=60, **start):
    """An instance after a sudden force (N) out of the plane has swung it; what was told after each step."""
    driven = Driven(model, folder, **start)
    driven.set(**{"tip.force.z": force})
    told = []
    for _ in range(count):
        if not driven.taken(STEP):
            break
        told.append(driven.get(MISSED)[0])
    return driven, np.array(told)


def test_what_is_told_is_the_largest_kinetic_energy_that_the_lumps_add_over_the_largest_there_is(tmp_path, l_frame):
    _, told = swung(tmp_path, l_frame, 800.0)
    body, lumps = FlexibleBody(l_frame), FlexibleBody(l_frame, Method.FRAMES, Mass.CONFIGURATION)
    state, kinetic, missed = body.rest(), [], []
    for _ in told:
        state = body.step(state, {"tip": [0.0, 0.0, 800.0]}, STEP)
        kinetic.append(state.v @ state.v)
        missed.append(abs(state.v @ lumps.mass(state) @ state.v - kinetic[-1]))
    expected = np.maximum.accumulate(missed) / np.maximum.accumulate(kinetic)
    assert expected[-1] > 0.005
    np.testing.assert_allclose(told, expected, rtol=0.05, atol=1e-6)


def test_it_is_told_where_a_few_swings_are_off_by_a_per_cent_and_not_where_they_are_right(tmp_path, l_frame):
    for number, (force, warned) in enumerate(((1.7e3, True), (200.0, False))):
        folder = tmp_path / str(number)
        folder.mkdir()
        driven, told = swung(folder, l_frame, force)
        motions = []
        for mass in Mass:
            body = FlexibleBody(l_frame, mass=mass)
            state, found = body.rest(), []
            for _ in range(200):
                state = body.step(state, {"tip": [0.0, 0.0, force]}, STEP)
                found.append(body.response(state).displacement[0])
            motions.append(np.array(found))
        error = relative(*motions)
        assert (error > 0.01) == warned
        assert (told[-1] > 0.01) == warned
        assert len(driven.log) == warned
        if warned:
            ((status, text),) = driven.log
            assert status == 1
            assert f"constant mass leaves out {100.0 * told[told > 0.01][0]:.3g} % of the kinetic energy" in text
            assert 'mass = "configuration"' in text


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


def test_bodies_with_the_deformed_body_s_mass_are_not_watched_for_it(l_frame):
    heavy = replace(l_frame, mass=Mass.CONFIGURATION)
    assert MISSED not in {variable.name for variable in variable_table(heavy)}
    assert MISSED in {variable.name for variable in variable_table(l_frame)}
    with pytest.raises(ModalFileError, match="missed_inertia"):
        replace(l_frame, missed_inertia=l_frame.missed_inertia[:-1])


def test_the_mass_that_is_left_out_is_that_of_the_lumps_to_second_order(l_frame, random):
    """Of the size of the displacement the error is of third order."""
    table = l_frame.missed_inertia
    slow = table.shape[1] - len(table)
    first, second = np.triu_indices(slow)
    lumps = FlexibleBody(l_frame, Method.FRAMES, Mass.CONFIGURATION)
    v = random.standard_normal(l_frame.mode_count)
    way = np.where(np.arange(v.size) < slow, random.standard_normal(v.size), 0.0) / l_frame.angular_frequency
    errors = []
    for size in (4.0, 8.0):
        q = size * way
        exact = v @ lumps.mass(State(q, v)) @ v - v @ v
        found = (v[first] * v[second]) @ table @ np.concatenate([q[:slow], q[first] * q[second]])
        errors.append(abs(found - exact) / abs(exact))
    assert errors[1] < 0.01
    assert errors[0] < 0.4 * errors[1]
