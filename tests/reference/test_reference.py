"""The core against an independent account of places and energies, from which forces and tangents follow."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from bodies import body_of_everything, random_ties, turning_body
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import GROUND
from flexfmu.model.variants import missing
from reference import Reference
from turns import exponential

SEEDS = st.integers(0, 2**32 - 1)
# Angles: of the linear range, of a few tenths of a radian, of full turns.
SIZES = st.sampled_from([0.0, 1e-9, 1e-3, 0.05, 0.3, 1.0])
BODIES = {
    "one frame": {"frames": 1},
    "tree": {},
    "large": {"frames": 6, "modes": 7, "interfaces": 3},
    "free": {"free": True, "modes": 9},
    "cut": {},
}


def pair(kind, method, seed, mass=Mass.CONSTANT):
    """Core and reference of a random body; random q and loads of every kind."""
    model = body_of_everything(seed, **BODIES[kind])
    if kind == "cut":
        model = random_ties(model, seed)
    if missing(model, method, mass) is not None:
        return None
    rng = np.random.default_rng(seed + 1)
    inputs = rng.standard_normal(6 * model.interface_count + 3)
    return FlexibleBody(model, method, mass), Reference(model, method, mass), rng, inputs


def same(found, expected, tolerance):
    scale = max(1.0, np.max(np.abs(expected), initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * scale)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("method", Method)
@settings(max_examples=4, deadline=None, derandomize=True)
@given(seed=SEEDS, size=SIZES)
def test_places_forces_tangents_and_energies_are_those_of_the_theory(kind, method, seed, size):
    made = pair(kind, method, seed)
    if made is None:
        assert kind in ("cut", "free")
        return
    body, reference, rng, inputs = made
    q, v = size * rng.standard_normal(body.core.modes), rng.standard_normal(body.core.modes)
    state = State(q, v)
    position, rotation = reference.places(q)
    found = body.core.nodes_at(q)
    same(found[0], position.real, 1e-13)
    # Nothing turns with a centre of mass.
    turning = np.r_[: reference.masses.start, reference.masses.stop : len(position)]
    same(found[1][turning], rotation.real[turning], 1e-13)
    response, ports = body.response(state), reference.interfaces
    same(response.displacement, (position - [node.point for node in reference.nodes]).real[ports], 1e-13)
    same(exponential(response.rotation), rotation.real[ports], 1e-12)
    same(body.forces(state, inputs), reference.force(inputs, q), 1e-11)
    tangent, way = body.tangent(state, inputs), rng.standard_normal(body.core.modes)
    same(tangent @ way, reference.tangent(inputs, q, way), 1e-11)
    same(body.energies(state), [reference.strain(q).real, 0.5 * float(v @ v)], 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["one frame", "tree", "large", "free"])
@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
@settings(max_examples=6, deadline=None, derandomize=True)
@given(seed=SEEDS, size=SIZES)
def test_the_mass_is_that_of_what_each_frame_carries(kind, method, seed, size):
    body, reference, rng, _ = pair(kind, method, seed, Mass.CONFIGURATION)
    q, v = size * rng.standard_normal(body.core.modes), rng.standard_normal(body.core.modes)
    expected = reference.mass(q)
    same(body.mass(State(q, v)), expected, 1e-12)
    energy = body.energies(State(q, v))[1]
    assert abs(energy - 0.5 * float(v @ expected @ v)) < 1e-11 * np.linalg.norm(expected) * float(v @ v)


def test_to_second_order_places_are_those_of_the_data():
    """Whatever the frames: X + u + ½ w, of a body that nothing lets turn as a whole."""
    body, _, rng, _ = pair("large", Method.SECOND_ORDER, 5)
    way, step = rng.standard_normal(body.core.modes), 5e-5
    ends = [body.core.nodes_at(sign * step * way)[0] for sign in (1.0, 0.0, -1.0)]
    found = (ends[0] - 2.0 * ends[1] + ends[2]) / step**2
    membrane, moved = body.model.membrane, [body.model.joint_displacement, body.model.interface_displacement]
    shift = membrane.shift(body.model.angular_frequency**2) @ way @ way
    moved = np.concatenate([*moved, body.model.masses.displacement]) @ shift
    assert np.linalg.norm(moved) > 0.01 * np.linalg.norm(found)
    same(found, body.model.second.displacement @ way @ way + moved, 1e-6)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=SEEDS, method=st.sampled_from(list(Method)), size=SIZES)
def test_velocities_are_the_derivatives_of_places(seed, method, size):
    body, reference, rng, _ = pair("tree", method, seed)
    q, v = size * rng.standard_normal(body.core.modes), rng.standard_normal(body.core.modes)
    velocity, spin = body.rates(State(q, v))
    position, rotation = (values[reference.interfaces] for values in reference.places(q + 1e-100j * v))
    same(velocity, position.imag / 1e-100, 1e-12)
    turn = (rotation.imag / 1e-100) @ np.swapaxes(rotation.real, 1, 2)
    same(spin, np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1), 1e-12)


def test_what_is_compared_is_there():
    """A force that the place of loads changes, frames on the ground and on others, ties that pull."""
    body, _, rng, inputs = pair("large", Method.SECOND_ORDER, 3)
    q = 0.3 * rng.standard_normal(body.core.modes)
    straight = FlexibleBody(body.model, Method.LINEAR).forces(State(q, q), inputs)
    assert np.linalg.norm(body.forces(State(q, q), inputs) - straight) > 0.3 * np.linalg.norm(straight)
    assert {GROUND, 0} < set(FlexibleBody(body_of_everything(1, **BODIES["large"])).model.frame_parent.tolist())
    _, cut, _, _ = pair("cut", Method.FRAMES, 3)
    assert cut.held(q[:5]).real > 1.0


@pytest.mark.parametrize("size", [1e-9, 0.3, 2.0, 3.14159, np.pi, 5.0])
def test_rotation_vectors_are_right_for_any_angle(size):
    body, reference, rng, _ = pair("tree", Method.FRAMES, 4)
    q = rng.standard_normal(body.core.modes)
    # A pure turn of this size of the frame, whatever else the others do.
    q *= size / np.linalg.norm(body.model.frame_rotation[0] @ q)
    turned = body.response(State(q, q)).rotation
    assert np.all(np.linalg.norm(turned, axis=1) < np.pi + 1e-12)
    same(exponential(turned), reference.places(q)[1].real[reference.interfaces], 1e-11)
    arm = FlexibleBody(turning_body(np.array([0.0, 0.6, 0.8]), np.zeros(3)), Method.FRAMES)
    around = arm.response(State(np.array([size, 0.0]), q[:2])).rotation
    same(exponential(around), exponential(np.tile(size * np.array([0.0, 0.6, 0.8]), (3, 1))), 1e-13)
