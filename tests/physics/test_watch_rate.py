"""Looks that are left out: over random loads the FMU says what looks at every step would say, within its rate."""

from dataclasses import replace

import numpy as np
import pytest

from bodies import COROTATED, Beam, beam_body
from driven import Driven
from flexfmu.api import Body
from flexfmu.mesh.elements import ElementType
from meshes import box
from native_master.bare_fmi2 import OK

STEPS, STEP = 400, 1e-3
# Of `linear` two looks: each takes two steps of Newton's method, in slices that cost less than a step of the body.
MOST_WAITED = {"second_order": 100, "linear": 400}
FORCES = [f"tip.force.{axis}" for axis in "xyz"]
# Other watches say nothing.
QUIET = {f"watch.{name}.limit": 0.0 for name in ("rotation", "strain", "stiffness_missed")}


@pytest.fixture(scope="module")
def bar():
    mesh = box(ElementType.C3D20, (8, 1, 1), (0.4, 0.02, 0.01))
    body = Body(mesh, supports=["ROOT"], interfaces={"tip": "TIP"}, name="bar")
    body = body.build(surface=False, modes=4, mass="polynomial").reduced
    # Vibrations would pass limits for moments, between any looks.
    return replace(body, damping_ratio=np.full(body.damping_ratio.shape, 0.7))


def walk(seed, size, steps=STEPS):
    """Loads (steps, 3) that grow to `size` while their direction wanders."""
    rng = np.random.default_rng(seed)
    way = rng.standard_normal(3) + np.cumsum(0.15 * rng.standard_normal((steps, 3)), axis=0)
    growth = np.linspace(0.0, 1.0, steps + 1)[1:] ** rng.uniform(0.5, 2.0)
    return size * growth[:, None] * way / np.linalg.norm(way, axis=1)[:, None]


def warned(driven, loads, asked=()):
    """The step with the first warning, how many there are where there is none, and values asked for after each."""
    found = []
    for number, load in enumerate(loads):
        driven.set(**dict(zip(FORCES, load, strict=True)))
        assert driven.taken(STEP)
        found.append(driven.get(*asked))
        if driven.get("status.code") != [0]:
            return number, found
    return len(loads), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "seed", "limit"),
    [("linear", 0, 0.01), ("linear", 1, 0.005), ("linear", 2, 0.02), ("second_order", 2, 6e-4)],
)
def test_an_error_is_told_when_a_look_at_every_step_would_have_told_it(bar, method, seed, limit, tmp_path):
    start = QUIET | {"method": method, "watch.stability.limit": 0.0, "watch.error.limit": limit}
    loads = walk(seed, 300.0, 2 * STEPS) if method == "linear" else walk(seed, 1000.0)
    (every, _), (some, _) = (
        warned(Driven(bar, tmp_path, **start, **{"error.interval": interval}), loads) for interval in (1.0, 20.0)
    )
    assert 0 < every < len(loads)
    assert every <= some <= every + MOST_WAITED[method]


def test_a_replay_from_amidst_a_look_tells_the_same_at_the_same_step(bar, tmp_path):
    """What slices have found so far is no state: after other motions it is found again."""
    start = QUIET | {"method": "linear", "watch.stability.limit": 0.0, "watch.error.limit": 0.01}
    loads = walk(0, 300.0, 2 * STEPS)
    told, _ = warned(Driven(bar, tmp_path, **start), loads)
    assert told < len(loads)
    driven = Driven(bar, tmp_path, **start)
    before = told - 3
    assert warned(driven, loads[:before])[0] == before
    state = driven.state
    for following in (loads[before:], loads[::-1]):
        driven.state = state
        assert warned(driven, following)[0] == told - before
        # Other looks in the meantime.
        warned(driven, loads[::-1][:50])


@pytest.mark.parametrize("end", ["stop", "terminate", "close", "reset", "fail"])
def test_what_is_still_looked_at_is_told_however_a_run_ends(bar, end, tmp_path):
    start = QUIET | {
        "method": "linear",
        "watch.stability.limit": 0.0,
        "watch.error.limit": 0.01,
        "watch.step.on_limit": "terminate",
    }
    driven = Driven(bar, tmp_path, **start)
    if end == "stop":
        assert driven.side.status("reset") == OK
        driven.set(**start)
        assert [driven.side.status(*call) for call in (("setup", 0.0, 9 * STEP), ("enter",), ("exit",))] == [OK] * 3
    driven.set(**{"tip.force.z": 600.0})
    assert all(driven.taken(STEP) for _ in range(8))
    assert not driven.log
    if end == "fail":
        driven.set(**{"tip.force.z": 1e12})
    if end in ("stop", "fail"):
        assert driven.taken(STEP) == (end == "stop")
    elif end == "close":
        driven.side.close()
    else:
        assert driven.side.status(end) == OK
    assert "off by" in driven.log[0][1]
    assert len(driven.log) == 1 + (end == "fail")


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.05, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_stability_is_told_as_soon_as_loads_have_changed_by_a_twentieth(seed, limit, tmp_path):
    beam = Beam()
    loads = walk(seed, 0.5 * beam.critical_load)
    # Pressed along its axis, which the bound cannot leave out.
    loads[:, 0] = -1.3 * beam.critical_load * np.linspace(0.0, 1.0, STEPS)
    loads[:, 1:] *= 0.02
    driven = Driven(
        beam_body(3, modes=4, method=COROTATED, damping=0.2), tmp_path, **QUIET, **{"watch.stability.limit": limit}
    )
    told, seen = warned(driven, loads, ["diagnostics.stability"])
    first = next(number for number, (value,) in enumerate(seen) if value < limit)
    assert first > 100
    assert first <= told < STEPS
    assert np.linalg.norm(loads[told] - loads[first]) <= 0.05 * np.linalg.norm(loads[told]) + np.linalg.norm(
        loads[1] - loads[0]
    )


def test_steps_that_take_longer_do_less_of_a_look(bar, tmp_path):
    """No step is to take much longer for its watches: where steps are divided once more a look takes more of them."""
    ringing = replace(bar, damping_ratio=np.full(bar.damping_ratio.shape, 0.02))
    start = QUIET | {"internal_step.tolerance": 1.0, "watch.stability.limit": 0.0, "watch.error.limit": 1e-9}
    known, looks = 1e3, []
    for _ in range(2):
        driven = Driven(ringing, tmp_path, **start, **{"watch.steps_missed.limit": known})
        driven.set(**{"tip.force.z": 1000.0})
        internal, missed = [], []
        while not driven.log:
            assert driven.taken(STEP)
            internal += driven.get("diagnostics.substeps")
            missed += driven.get("diagnostics.steps_missed")
        looks.append((len(internal), sum(count > 1 for count in internal), driven.log[0][1]))
        known = 1.2 * max(missed)
    (plain, never, said), (longer, divided, again) = looks
    assert never == 0
    assert divided > 20
    assert longer > plain + divided / 3
    assert "off by" in said
    assert said == again


def test_a_look_goes_on_with_internal_steps(bar, tmp_path):
    """Beside eight of them eight slices are as little as one beside one."""
    start = QUIET | {"watch.stability.limit": 0.0, "watch.steps_missed.limit": 0.0, "watch.error.limit": 1e-9}
    took = []
    for fewest in (1.0, 8.0):
        driven = Driven(bar, tmp_path, **start, **{"internal_step.fewest": fewest, "internal_step.tolerance": 1.0})
        driven.set(**{"tip.force.z": 1000.0})
        took.append(0)
        while not driven.log:
            assert driven.taken(STEP)
            took[-1] += 1
        assert "off by" in driven.log[0][1]
    assert took[0] > 20
    assert took[1] < took[0] / 4
