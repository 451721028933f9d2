"""The rear axle between car and road under the master: statics that it settles in, symmetry, and arcs of wheels."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from demo.rear_axle.road.scene import BEARING, COIL, GRAVITY, HERE, SIDES, Ride
from scipy.optimize import root

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import SupportTable
from flexfmu.files.outputs import Reporter
from references import body_without_error
from road import built, python

pytestmark = pytest.mark.long

RUN = """
import json, sys
from pathlib import Path
from demo.rear_axle.road.scene import SIDES, Ride, coupling, motion
from flexfmu.master import couple

ride = Ride(**json.loads(sys.argv[3]))
result = couple(coupling(ride, float(sys.argv[2]), Path(sys.argv[1])))
found = {side: motion(result, side).tolist() for side in SIDES}
found |= {name: result[name].tolist() for name in ("left.tyre.force", "right.tyre.force", "master.created_energy")}
print("RESULT", json.dumps({"time": result.time.tolist(), **found}))
"""
# Of the wheel's FMU.
TYRE, CORNERING, RADIUS = 200e3, 12.0, 0.3


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Folder of the FMUs, and what the coil springs bear before."""
    folder = tmp_path_factory.mktemp("road")
    return folder, built(folder)


@pytest.fixture(scope="module")
def drive(scene):
    def run(ride):
        found = python(RUN, *scene, json.dumps(asdict(ride)))
        return {name: np.array(values) for name, values in found.items()}

    return run


def standing(ride, preload):
    """Motion (2, 6) of both flanges in equilibrium, coil springs in the body's stiffness, the road's heights known."""
    config = body_without_error(HERE / "body.toml")
    coils = [SupportTable(nodes=f"SEAT_{side}", stiffness=[0.0, 0.0, COIL]) for side in "LR"]
    config = config.model_copy(update={"free": False, "support": [*config.support, *coils]})
    body = FlexibleBody(reduce_body(config, Reporter()))

    def motion(unknown):
        loads = {f"seat_{side}": [0.0, 0.0, -preload] for side in SIDES}
        for side, force, turn in zip(SIDES, *unknown.reshape(2, 2), strict=True):
            sideways = -CORNERING * 1e3 * force * turn
            loads[f"wheel_{side}"] = [
                0.0,
                sideways,
                1e3 * force - GRAVITY * ride.wheel_mass,
                RADIUS * sideways,
                0.0,
                0.0,
            ]
        response = body.response(body.static(body.loads(loads, (0.0, 0.0, GRAVITY))))
        order = [body.model.interface_names.index(f"wheel_{side}") for side in SIDES]
        return np.hstack([response.displacement[order], response.rotation[order]])

    def rest(unknown):
        moved, force = motion(unknown), 1e3 * unknown[:2]
        hub = moved[:, 2] + (force - GRAVITY * ride.wheel_mass) / BEARING
        wanted = ride.wheel_load + TYRE * (np.array([ride.bump[side] for side in SIDES]) - hub)
        return np.concatenate([1e-3 * (wanted - force), moved[:, 5] - unknown[2:]])

    found = root(rest, [3.0, 3.0, 0.0, 0.0], tol=1e-10)
    assert found.success
    return motion(found.x), 1e3 * found.x[:2]


def test_the_axle_settles_where_statics_put_it_with_the_left_wheel_on_a_kerb(scene, drive):
    # A bump of a thousand kilometres is a plateau. Strong dampers, to be there soon.
    far = {"begin": -62500.0, "length": 1e6}
    ride = Ride(bump={"left": 0.04, "right": 0.0}, stop=0.4, damper=3000.0, **far)
    found = drive(ride)
    expected, force = standing(ride, scene[1])
    assert 0.03 < expected[0, 2] < 0.04
    assert force[0] > 1.1 * force[1]
    late = found["time"] > 0.3
    for side, motion, tyre in zip(SIDES, expected, force, strict=True):
        settled = found[side][late].mean(axis=0)
        np.testing.assert_allclose(settled[:3], motion[:3], atol=5e-5)
        np.testing.assert_allclose(settled[3:], motion[3:], atol=2e-4)
        assert found[f"{side}.tyre.force"][late].mean() == pytest.approx(tyre, rel=2e-3)


@pytest.fixture(scope="module")
def level(drive):
    """Both wheels over the same bump."""
    return drive(Ride(bump={"left": 0.08, "right": 0.08}, begin=0.02, stop=0.14))


def test_the_same_bump_under_both_wheels_moves_them_alike(level):
    left, right = level["left"], level["right"]
    mirrored = right * [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    assert left[:, 2].max() > 0.08
    for part in (slice(0, 3), slice(3, 6)):  # m, rad
        assert np.abs(left - mirrored)[:, part].max() <= 1e-4 * np.abs(left[:, part]).max()


def test_wheels_swing_on_arcs_about_the_bushings_and_linear_ones_straight_up(drive, level):
    reach = 0.45
    top = level["left"][np.argmax(level["left"][:, 2])]
    assert top[0] == pytest.approx(np.sqrt(reach**2 - top[2] ** 2) - reach, rel=0.1)
    linear = {"method": "linear"}
    straight = drive(Ride(bump={"left": 0.08, "right": 0.08}, begin=0.02, stop=0.09, axle=linear))["left"]
    assert straight[:, 2].max() == pytest.approx(top[2], rel=0.02)
    assert np.abs(straight[:, 0]).max() < 0.1 * abs(top[0])


def test_the_coupling_feeds_no_motion(level):
    # Against what the wheels' motion costs: half the mass times the square of their speed.
    speed = np.gradient(level["left"][:, 2], level["time"])
    assert np.abs(level["master.created_energy"]).max() < 0.02 * 20.0 * np.max(speed**2)


def test_strong_dampers_where_the_body_vibrates_faster_than_steps_take_energy_all_the_same(drive):
    """At a spring seat a step of 1 ms resolves no mode: going by velocities such a damper feeds the motion."""
    found = drive(Ride(damper=4000.0, damper_at_seat=True, begin=0.02, stop=0.25))
    travel = found["left"][:, 2]
    assert found["time"][-1] == pytest.approx(0.25)
    assert 0.05 < travel.max() < 0.1
    # Behind the bump the wheel comes to rest instead of shaking ever more.
    late = found["time"] > 0.2
    assert np.abs(np.diff(travel[late])).max() < 1e-3
    assert np.abs(found["master.created_energy"]).max() < 5.0
