"""What a step at rest and calls with many references leave out changes nothing: all is as if it were done."""

import numpy as np
import pytest

from driven import Driven
from flexfmu.api import Body
from flexfmu.mesh.elements import ElementType
from meshes import box
from native_master.bare_fmi2 import OK

FORCE = "tip.force.z"
# Under a load a body comes to rest in steps of many periods: its own motion has died out in one.
STEP = 5.0


@pytest.fixture(scope="module")
def bar():
    mesh = box(ElementType.C3D20, (8, 1, 1), (0.4, 0.02, 0.01))
    return Body(mesh, supports=["ROOT"], interfaces={"tip": "TIP"}, name="bar").build(surface=False, modes=4).reduced


@pytest.mark.parametrize("method", ["linear", "second_order"])
@pytest.mark.parametrize("load", [0.0, 300.0])
def test_a_body_at_rest_goes_on_as_one_that_has_forgotten_that_it_rests(bar, method, load, tmp_path):
    start = {"method": method, FORCE: load, "damping.scale": 70.0, "watch.error.limit": 1e-3, "error.interval": 4.0}
    kept, forgets = (Driven(bar, tmp_path, **start) for _ in range(2))
    changes = {
        20: {FORCE: load + 1.0},
        25: {FORCE: -load},
        40: {"tip.moment.x": 2.0},
        50: {"tip.moment.x": 0.0, FORCE: 0.0},
        66: {"internal_step.fewest": 4.0},
        # The least that there is.
        70: {FORCE: 5e-324},
    }
    for number in range(75):
        size = STEP if number % 15 < 12 else 2.0 * STEP
        for driven in (kept, forgets):
            driven.set(**changes.get(number, {}))
        forgets.state = forgets.state
        assert kept.taken(size)
        assert forgets.taken(size)
        assert kept.state == forgets.state
    assert kept.log == forgets.log


def test_a_rate_set_at_rest_moves_the_body(bar, tmp_path):
    driven = Driven(bar, tmp_path, method="linear")
    assert all(driven.taken(STEP) for _ in range(5))
    assert driven.rates(**{FORCE: 10.0}) == OK
    assert driven.taken(STEP)
    assert driven.get(FORCE) == [50.0]
    assert driven.get("tip.displacement.z")[0] > 0.0


def test_values_do_not_depend_on_what_else_is_asked_for_and_in_which_order(bar, tmp_path):
    driven = Driven(bar, tmp_path)
    numbers = np.array([number for number, variable in driven.table.values() if variable.type == "Real"])
    inputs = numbers[:6]
    loads = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    rng = np.random.default_rng(1)
    for order in (np.arange(6), np.arange(6)[::-1], rng.permutation(6), np.array([0, 2, 1, 3, 4, 5])):
        assert driven.side.status("set_real", inputs[order].tolist(), loads[order].tolist()) == OK
        assert driven.side.status("get_real", inputs.tolist()) == (OK, loads.tolist())
        assert driven.taken(1e-3)
        loads = loads[::-1].copy()
    alone = {number: driven.side.status("get_real", [number])[1][0] for number in numbers.tolist()}
    assert len(set(alone.values())) > 20
    swapped = numbers.copy()
    swapped[7:9] = swapped[8:6:-1]
    for asked in (numbers, numbers[::-1], swapped, rng.permutation(np.tile(numbers, 3)), np.repeat(numbers, 2)):
        assert driven.side.status("get_real", asked.tolist()) == (OK, [alone[number] for number in asked.tolist()])
