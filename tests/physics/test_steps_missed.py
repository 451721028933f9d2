"""How wrong the length of the steps makes a motion is told: errors of single steps add up."""

import numpy as np
import pytest

from driven import Driven
from flexfmu.build.tables import FormulationTable
from references import relative

MISSED = "diagnostics.steps_missed"
# Any error of a step is accepted, and no other watch speaks.
LONG = {"internal_step.tolerance": 1.0} | {
    f"watch.{name}.limit": 0.0 for name in ("rotation", "strain", "stability", "stiffness_missed")
}
# Some seven swings, s; a force that bends the beam by a third of its length, N; a step as good as exact, s.
WHOLE, FORCE, SHORT = 0.15, 3000.0, 5e-4


def swung(folder, body, step, **start):
    """An instance after a sudden force across it, what it tells after each step, displacements of its tip (n, 3)."""
    driven = Driven(body, folder, **(LONG | start))
    driven.set(**{"tip.force.z": FORCE})
    found, told = [], []
    for _ in range(round(WHOLE / step)):
        assert driven.taken(step)
        found.append(driven.get(*(f"tip.displacement.{axis}" for axis in "xyz")))
        told.append(driven.get(MISSED)[0])
    return driven, np.array(told), np.array(found)


def beam(bodies, method, mass):
    return bodies.beam(frames=2, formulation=FormulationTable(method=method, mass=mass)).model


@pytest.mark.parametrize("mass", ["constant", "polynomial"])
def test_what_is_told_is_the_error_of_steps_or_a_little_more(bodies, tmp_path, mass):
    body = beam(bodies, "second_order", mass)
    _, _, true = swung(tmp_path, body, SHORT)
    known = []
    for step in (0.01, 0.005, 0.0025):
        driven, told, found = swung(tmp_path, body, step)
        every = round(step / SHORT)
        error = relative(found, true[every - 1 :: every])
        assert 0.9 * error < told[-1] < 3.0 * error
        known.append(told[-1])
        assert len(driven.log) == (told.max() > 0.01)
        for status, text in driven.log:
            assert status == 1
            assert (
                f"the length of the steps makes the motion wrong by some {100.0 * told[told > 0.01][0]:.3g} %" in text
            )
    # Of second order.
    assert known[0] > 0.01
    assert known[1] < known[0] / 2.5
    assert known[2] < known[1] / 2.5


def test_steps_that_are_exact_miss_nothing(bodies, tmp_path):
    driven, told, _ = swung(tmp_path, beam(bodies, "linear", "constant"), 0.01)
    assert not told.any()
    assert not driven.log


def test_steps_that_are_repeated_or_refused_between_change_nothing_of_it(bodies, tmp_path):
    driven, told, _ = swung(tmp_path, beam(bodies, "second_order", "constant"), 0.01)
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
    start = {"watch.steps_missed.limit": 0.005, "watch.steps_missed.on_limit": "discard"}
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
