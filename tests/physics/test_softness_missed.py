"""How wrong a motion is by the stiffness of the bent body is told: a frequency that is off a little adds up."""

import numpy as np
from test_certificate import LENGTH, strip

from driven import Driven
from references import relative

MISSED = "diagnostics.softness_missed"
# Steps a slow period, and periods.
STEPS, PERIODS = 60, 5


def swung(folder, frames, share=1.0, start=None):
    """A strip after a sudden force across it, with the same mass whatever its frames: places, what is told, its log."""
    formulation = {"method": "second_order", "mass": "constant"}
    body = strip(frames=frames, formulation=formulation).build(surface=False, modes=6)
    driven = Driven(body.reduced, folder, **(start or {}))
    driven.set(**{"tip.force.z": 700.0 * share})
    found, told = [], []
    for _ in range(PERIODS * STEPS):
        assert driven.taken(2.0 * np.pi / body.reduced.angular_frequency[0] / STEPS)
        found.append(driven.get(*(f"tip.displacement.{axis}" for axis in "xyz")))
        told.append(driven.get(MISSED)[0])
    return np.array(found), np.array(told), [text for _, text in driven.log if "stiffness of the bent body" in text]


def test_the_drift_of_a_frame_that_bends_far_is_told(tmp_path):
    true, finest, _ = swung(tmp_path, 8)
    found, told, _ = swung(tmp_path, 1)
    assert np.linalg.norm(true, axis=1).max() > 0.2 * LENGTH
    assert finest[-1] < 1e-3
    for periods in (2, PERIODS):
        end = periods * STEPS
        assert 0.9 * relative(found[:end], true[:end]) < told[end - 1] < 2.0 * relative(found[:end], true[:end])
    # It grows from period to period, and as the square of the motion.
    assert told[-1] > 1.5 * told[2 * STEPS - 1]
    _, less, _ = swung(tmp_path, 1, 0.5)
    assert 0.15 * told[-1] < less[-1] < 0.4 * told[-1]


def test_drift_beyond_the_limit_is_warned_of_and_not_where_looks_are_off(tmp_path):
    _, told, log = swung(tmp_path, 1, start={"watch.softness_missed.limit": 3e-3})
    assert told[-1] > 3e-3
    assert len(log) == 1
    _, told, log = swung(tmp_path, 1, start={"watch.softness_missed.limit": 3e-3, "watch.error.limit": 0.0})
    assert not told.any()
    assert not log
