"""Compliance over a step: closed form of a compressed column, and what loads do to the step's end."""

import numpy as np
import pytest

from bodies import LINEAR, Beam, beam_body, random_body
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.model.methods import Method

BEAM = Beam()
ONE_STEP = StepLimits(tolerance=1e300)


@pytest.mark.parametrize("share", [-2.0, 0.0, 0.5, 0.9])
def test_half_a_period_after_a_load_begins_a_column_has_moved_twice_its_static_way(share):
    """One mode φ on one frame, which bending shortens by ½ φ²/L: under an axial force P its stiffness is ω² − P φ²/L.

    By the rule of the middle, a load held over half a period of the unloaded column moves it by twice its static way.
    """
    model = beam_body(1, modes=1, planes="y")
    body = FlexibleBody(model, limits=ONE_STEP)
    omega, shape = model.angular_frequency[0], model.interface_displacement[0, 1, 0]
    push = share * BEAM.critical_load
    stiffness = omega**2 - push * shape**2 / BEAM.length
    inputs = np.array([-push, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert body.stability(body.rest(), inputs)[0] == pytest.approx(stiffness / omega**2, rel=1e-9)
    found = body.compliance(body.rest(), inputs, np.pi / omega, [0])
    assert found[1, 1] == pytest.approx(2.0 * shape**2 / stiffness, rel=1e-9)
    assert found[5, 1] == pytest.approx(found[1, 5], rel=1e-12)


@pytest.mark.parametrize("periods", [0.02, 0.2, 0.8])
@pytest.mark.parametrize("method", [Method.FRAMES, Method.HALF_ROTATION, Method.MODAL_ROTATION, Method.LINEAR])
def test_compliance_is_what_a_small_load_over_a_step_does_to_equilibrium(method, periods):
    """The step starts at equilibrium under a force that takes half of the stiffness: it ends there too."""
    model = beam_body(3, modes=3)
    body = FlexibleBody(model, method, limits=ONE_STEP)
    loads = np.array([-0.5 * BEAM.critical_load, 300.0, 0.0, 0.0, 0.0, 0.0])
    start, step = body.static({"tip": loads}), periods * 2.0 * np.pi / model.angular_frequency[0]
    found = body.compliance(start, loads, step, [0])
    size = 1e-3
    for column in range(6):
        extra = size * np.eye(6)[column]
        ends = [body.motion(body.step(start, {"tip": loads + sign * extra}, step)) for sign in (1.0, -1.0)]
        change = (ends[0] - ends[1])[:3] / (2.0 * size)
        np.testing.assert_allclose(found[:3, column], change, rtol=0.0, atol=1e-6 * np.abs(found[:3]).max())


def test_compliance_between_interfaces_is_what_a_load_on_one_does_to_the_other():
    model = random_body()
    body = FlexibleBody(model, limits=ONE_STEP)
    loads = {"port_0": [40.0, -20.0, 60.0], "port_2": [30.0, 50.0, -20.0]}
    start, step = body.static(loads), 3e-3
    inputs = body.loads(loads).packed(False)
    found = body.compliance(start, inputs, step, [0, 2])
    size = 1e-4
    for column in range(3):
        pushed = {"port_0": loads["port_0"], "port_2": loads["port_2"] + size * np.eye(3)[column]}
        change = (body.motion(body.step(start, pushed, step)) - body.motion(start)).reshape(3, 6)[0, :3] / size
        expected = found[:3, 6 + column]
        assert np.linalg.norm(change - expected) < 1e-3 * np.linalg.norm(expected)
    # Maxwell and Betti, under forces, which have a potential.
    np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-10 * np.abs(found).max())


def test_compliance_knows_that_stress_of_the_modes_stiffens_them(random):
    """Stiffness by mode, Σ q_j K_j: its derivative is K_j q as well, which is not symmetric."""
    by_mode = 2e4 * random.standard_normal((6, 6, 6))
    model = random_body(stiffness_by_mode=by_mode + by_mode.transpose(0, 2, 1))
    body = FlexibleBody(model, Method.STIFFNESS_BY_MODE, limits=ONE_STEP)
    forces, step = np.array([40.0, -20.0, 60.0]), 4e-3
    start = body.static({"port_0": forces})
    found = body.compliance(start, body.loads({"port_0": forces}).packed(False), step, [0])
    bare = FlexibleBody(model, LINEAR, limits=ONE_STEP).compliance(start, np.zeros(18), step, [0])
    assert np.linalg.norm(found[:3, :3] - bare[:3, :3]) > 5e-3 * np.linalg.norm(bare[:3, :3])
    for column, push in enumerate(1e-3 * np.eye(3)):
        ends = [body.motion(body.step(start, {"port_0": forces + sign * push}, step)) for sign in (1.0, -1.0)]
        change = (ends[0] - ends[1])[:3] / 2e-3
        np.testing.assert_allclose(found[:3, column], change, rtol=0.0, atol=1e-6 * np.abs(found[:3, :3]).max())
