"""How wrong the length of the steps makes a motion is told: errors of single steps add up."""

import numpy as np
import pytest

from driven import Driven
from flexfmu.build.tables import FormulationTable
from references import relative

MISSED, LIMIT = "diagnostics.steps_missed", "watch.steps_missed.limit"
# Any error of a step is accepted, and no other watch speaks.
LONG = {"internal_step.tolerance": 1.0} | {
    f"watch.{name}.limit": 0.0 for name in ("rotation", "strain", "stability", "stiffness_missed")
}
# Some seven swings, s; a force that bends the beam by a third of its length, N; a step as good as exact, s.
WHOLE, FORCE, SHORT = 0.15, 3000.0, 5e-4


def swung(folder, body, step, force=FORCE, **start):
    """An instance after a sudden force across it; of steps what is told, displacements of the tip, internal steps."""
    driven = Driven(body, folder, **(LONG | start))
    driven.set(**{"tip.force.z": force})
    found, told, internal = [], [], []
    for _ in range(round(WHOLE / step)):
        assert driven.taken(step)
        found.append(driven.get(*(f"tip.displacement.{axis}" for axis in "xyz")))
        told.append(driven.get(MISSED)[0])
        internal += driven.get("diagnostics.substeps")
    return driven, np.array(told), np.array(found), internal


def beam(bodies, method, mass):
    return bodies.beam(frames=2, formulation=FormulationTable(method=method, mass=mass)).model


def off(true, found):
    """Error of a motion, root mean square, beside the same in short steps."""
    every = len(true) // len(found)
    return relative(found, true[every - 1 :: every])


@pytest.mark.parametrize("mass", ["constant", pytest.param("polynomial", marks=pytest.mark.slow)])
def test_what_is_told_is_the_error_of_steps_or_a_little_more(bodies, tmp_path, mass):
    body = beam(bodies, "second_order", mass)
    _, _, true, _ = swung(tmp_path, body, SHORT)
    known = []
    for step in (0.01, 0.005, 0.0025):
        driven, told, found, _ = swung(tmp_path, body, step, **{LIMIT: 0.0})
        assert 0.9 * off(true, found) < told[-1] < 3.0 * off(true, found)
        known.append(told[-1])
        assert not driven.log
    # Of second order.
    assert known[0] > 0.01
    assert known[1] < known[0] / 2.5
    assert known[2] < known[1] / 2.5


@pytest.mark.parametrize("mass", [pytest.param("configuration", marks=pytest.mark.slow), "polynomial"])
def test_what_steps_miss_of_a_mass_that_changes_is_told(bodies, tmp_path, mass):
    """Nothing loads the released body: all that its steps miss is of its own mass."""
    bent = {"initialization": "static", "tip.force.z": 2.0 * FORCE, LIMIT: 0.0}
    body = beam(bodies, "second_order", mass)
    _, _, true, _ = swung(tmp_path, body, SHORT, force=0.0, **bent)
    for step in (0.01, 0.005):
        _, told, found, _ = swung(tmp_path, body, step, force=0.0, **bent)
        assert 0.9 * off(true, found) < told[-1] < 3.0 * off(true, found)


def test_what_passes_the_limit_is_told_once(bodies, tmp_path):
    driven, told, _, _ = swung(tmp_path, beam(bodies, "second_order", "constant"), 0.01, **{LIMIT: 0.005})
    first = told[told > 0.005][0]
    [(status, text)] = driven.log
    assert status == 1
    assert f"the length of the steps makes the motion wrong by some {100.0 * first:.3g} %" in text


@pytest.mark.slow
def test_internal_steps_are_shorter_where_what_they_miss_nears_its_limit(bodies, tmp_path):
    body = beam(bodies, "second_order", "polynomial")
    _, _, true, _ = swung(tmp_path, body, SHORT)
    _, free, usual, _ = swung(tmp_path, body, 0.01, **{LIMIT: 0.0})
    driven, told, finer, taken = swung(tmp_path, body, 0.01, **{LIMIT: 0.02})
    assert not driven.log
    assert off(true, finer) < 0.5 * off(true, usual)
    # As long as what is told is far below the limit nothing differs.
    far = np.argmax(free > 0.1 * 0.02)
    assert far > 1
    assert (told[: far + 1] == free[: far + 1]).all()
    assert set(taken) == {1, 4}
    # Once the limit is passed they are as long as before.
    *_, taken = swung(tmp_path, body, 0.01, **{LIMIT: 0.0005})
    assert max(taken) > 1
    assert taken[-1] == 1


def test_steps_that_are_exact_miss_nothing(bodies, tmp_path):
    driven, told, _, _ = swung(tmp_path, beam(bodies, "linear", "constant"), 0.01)
    assert not told.any()
    assert not driven.log


def test_steps_that_are_repeated_or_refused_between_change_nothing_of_it(bodies, tmp_path):
    driven, told, _, _ = swung(tmp_path, beam(bodies, "second_order", "constant"), 0.01)
    before, following = driven.state, []
    for refused in (0, 1, 2):
        driven.state = before
        for _ in range(refused):
            driven.set(**{"tip.force.z": 1e12})
            assert not driven.taken(0.01)
            driven.set(**{"tip.force.z": FORCE})
        assert driven.taken(0.01)
        following.append(driven.get(MISSED)[0])
    assert following == 3 * [following[0]]
    assert following[0] != told[-1]


def test_a_step_whose_end_is_refused_is_not_counted(bodies, tmp_path):
    """It was taken, and found beyond a limit."""
    start = {LIMIT: 0.005, "watch.steps_missed.on_limit": "discard"}
    driven = Driven(beam(bodies, "second_order", "constant"), tmp_path, **(LONG | start))
    driven.set(**{"tip.force.z": FORCE})
    while driven.taken(0.01):
        before = driven.get(MISSED)[0]
    assert 0.0 < before <= 0.005
    kept, after = driven.state, []
    for refused in (0, 1, 2):
        driven.state = kept
        for _ in range(refused):
            assert not driven.taken(0.01)
        assert driven.taken(1e-4)
        after.append(driven.get(MISSED)[0])
    assert after == 3 * [after[0]]
