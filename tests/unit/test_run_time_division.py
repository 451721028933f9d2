"""Frames as a tree, each by itself, or one for all: what the method has, chosen when the body is used."""

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.build.tables import InterfaceTable
from flexfmu.model.methods import Method
from references import BEAM, calculix, displacement, relative

LOADS = {"tip": [-1e3, 8e3, 3e3, 40.0, -150.0, 200.0]}


def motion(model, method):
    body = FlexibleBody(model, method)
    return body.motion(body.static(LOADS))


@pytest.mark.slow
def test_the_floating_frame_of_any_body_is_the_tree_of_one_frame(bodies):
    built, chosen = bodies.beam(frames=1).model, bodies.beam(frames=8).model
    expected = motion(built, Method.FRAMES)
    found = motion(chosen, Method.FLOATING_FRAME)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert relative(motion(chosen, Method.FRAMES), expected) > 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1, 3])
def test_a_free_body_moves_on_its_floating_frame_alone_whatever_frames_hang_on_it(bodies, frames, random):
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    model = bodies.beam(free=True, support=[], interface=ends, frames=frames).model
    bare = FlexibleBody(bodies.beam(free=True, support=[], interface=ends, frames=0).model, Method.FRAMES)
    body = FlexibleBody(model, Method.FLOATING_FRAME)
    q = 0.5 * random.standard_normal(model.mode_count)
    found, expected = (one.response(State(q, q)).displacement for one in (body, bare))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert relative(FlexibleBody(model, Method.FRAMES).response(State(q, q)).displacement, expected) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("method", [Method.MODAL_ROTATION, Method.HALF_ROTATION])
def test_sub_domains_turn_about_the_linear_place_of_their_joint_as_the_source_has_it_or_in_a_tree(bodies, method):
    """x = X + u_a + R (u − u_a), with the joint's linear displacement, or with that of the tree."""
    model = bodies.beam(frames=4).model
    body = FlexibleBody(model, method)
    state = body.static(LOADS)
    q = state.q
    alone = method is Method.MODAL_ROTATION
    joint, rotation, linear, before = np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3)
    for s in range(model.frame_count):
        angle = model.frame_rotation[s] @ q
        # In a tree each part turns against the one before it.
        turn, before = angle if alone else 0.5 * (angle - before), angle
        size = np.linalg.norm(turn)
        x, y, z = turn / size
        hat = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        own = model.joint_displacement[s] @ q
        joint, linear = own if alone else joint + rotation @ (own - linear), own
        exponential = np.eye(3) + np.sin(size) * hat + (1.0 - np.cos(size)) * hat @ hat
        rotation = exponential if alone else rotation @ exponential
    expected = joint + rotation @ (model.interface_displacement[0] @ q - linear)
    np.testing.assert_allclose(body.response(state).displacement[0], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_only_the_tree_gets_better_with_more_frames(bodies):
    force = 10e3
    table = calculix(BEAM / "calculix" / "static_y.csv")
    (expected,) = displacement(table)[np.abs(table["force_N"] - force) < 1.0]

    def error(frames, method):
        body = FlexibleBody(bodies.beam(frames=frames).model, method)
        return relative(body.response(body.static({"tip": [0.0, force, 0.0]})).displacement[0], expected)

    assert error(8, Method.FRAMES) < 1e-3
    # The last part alone turns, and the joints before it have moved on straight lines.
    found = [error(frames, Method.MODAL_ROTATION) for frames in (1, 2, 4, 8)]
    np.testing.assert_allclose(found, [0.090, 0.080, 0.020, 0.078], atol=1e-3)
    assert found[3] > 3.0 * found[2]


def test_a_free_body_on_one_frame_has_its_floating_one(bodies):
    body = bodies.beam(free=True, support=[], frames=4)
    one = FlexibleBody(body.model, Method.FLOATING_FRAME)
    assert one.model.frame_names == ("floating",)
    state = one.step(one.rest(), {"tip": [0.0, 100.0, 0.0]}, 1e-2)
    assert np.linalg.norm(one.motion(state)[:3]) > 1e-4
