"""Weight and moving supports: accelerations as inputs."""

import numpy as np
import pytest

from driven import Driven
from elastica import MASS, STIFFNESS, heavy_elastica
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.tables import InputTable
from flexfmu.files.basics import LoadError
from flexfmu.fmu.description import Runtime
from flexfmu.model.methods import Method
from references import BEAM


def heavy_beam(bodies, **changes):
    """The clamped beam with its masses aboard."""
    return bodies.beam(input=InputTable(acceleration=True), **changes)


def sag(body, acceleration):
    """Tip displacement under an acceleration of the supports, m."""
    return body.response(body.static(body.loads({}, acceleration))).displacement[0]


@pytest.mark.slow
def test_masses_of_the_sub_domains_add_up_to_the_body(bodies):
    masses = heavy_beam(bodies, frames=8).model.masses
    np.testing.assert_allclose(masses.mass, MASS / 8.0, rtol=1e-9)
    np.testing.assert_allclose(masses.point[:, 0], (np.arange(8) + 0.5) / 8.0, atol=1e-9)


@pytest.mark.slow
def test_weight_bends_the_beam_as_beam_theory_says(bodies):
    # w = ρAgL⁴/8EI; slender enough for half a per cent of shear.
    found = sag(heavy_beam(bodies, modes=30), [0.0, 9.81, 0.0])
    assert -found[1] == pytest.approx(MASS * 9.81 / (8.0 * STIFFNESS), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("method", Method)
def test_small_acceleration_gives_the_same_sag_with_all_methods(bodies, method):
    wanted = {"second_order": True, "geometric_stiffness": ["by_load", "by_mode"]}
    model = heavy_beam(bodies, reduction=bodies.config(BEAM).reduction.model_copy(update=wanted)).model
    linear = FlexibleBody(model, Method.LINEAR)
    body = FlexibleBody(model, method)
    np.testing.assert_allclose(sag(body, [0, 1e-2, 2e-2]), sag(linear, [0, 1e-2, 2e-2]), rtol=1e-5, atol=1e-11)


@pytest.mark.slow
def test_large_acceleration_bends_the_beam_along_the_elastica(bodies):
    acceleration = 4.0 * STIFFNESS / MASS
    expected = heavy_elastica(acceleration)
    assert expected[1] < -0.3
    errors = []
    for frames in (0, 4, 8):
        found = sag(heavy_beam(bodies, frames=frames, modes=30), [0.0, acceleration, 0.0])[:2] + np.array([1.0, 0.0])
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected - [1.0, 0.0]))
    # Shear, which the elastica has not, is 0.2 % of the deflection.
    assert errors[0] > 0.15
    assert errors[1] < 0.006
    assert errors[2] < 0.004


def test_accelerated_supports_keep_the_energy_of_an_undamped_beam(bodies):
    body = FlexibleBody(heavy_beam(bodies, frames=4).model, damping_scale=0.0)
    acceleration = np.array([0.0, 2.0 * STIFFNESS / MASS, 0.0])
    loads, state, motion = body.loads({}, acceleration), body.rest(), []
    for _ in range(200):
        state = body.step(state, loads, 1e-3)
        motion.append(sum(body.energies(state)))
    assert max(motion) > 1000.0
    # The beam swings back to rest: all it took in, it gives back.
    assert min(motion) < 0.1 * max(motion)


@pytest.mark.parametrize("runtime", Runtime)
def test_fmu_takes_the_acceleration_as_input(bodies, tmp_path, runtime):
    body = heavy_beam(bodies, frames=4)
    start = {"body.acceleration.y": 9.81, "tip.force.z": 100.0, "initialization": "static"}
    driven = Driven(body.model, tmp_path, runtime, **start)
    assert driven.table["body.acceleration.y"][1].unit == "m/s2"
    expected = body.static(body.loads({"tip": [0.0, 0.0, 100.0]}, [0.0, 9.81, 0.0]))
    np.testing.assert_allclose(driven.motion("tip")[:3], body.response(expected).displacement[0], rtol=1e-12)


def test_acceleration_of_a_body_without_masses_is_refused(bodies):
    with pytest.raises(LoadError, match="acceleration = true"):
        bodies.beam().loads({}, [0.0, 9.81, 0.0])


@pytest.mark.parametrize("method", [Method.STIFFNESS_BY_LOAD, Method.FRAMES_STIFFNESS])
def test_stiffness_by_load_lets_a_column_buckle_under_its_own_weight(bodies, method):
    """Critical weight w L³ = 7.837 EI of a clamped column, A. G. Greenhill 1881."""
    reduction = bodies.config(BEAM).reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    body = FlexibleBody(heavy_beam(bodies, reduction=reduction, frames=4).model, method)
    critical = 7.837 * STIFFNESS / MASS
    for share, stable in ((0.97, True), (1.03, False)):
        tangent = body.tangent(body.rest(), body.loads({}, [share * critical, 0.0, 0.0]).packed(True))
        assert (np.linalg.eigvalsh(0.5 * (tangent + tangent.T))[0] > 0.0) == stable
