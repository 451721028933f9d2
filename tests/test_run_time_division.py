"""Frames as a tree, each by itself, or one for all: chosen when the FMU starts."""

import numpy as np
import pytest

from flexfmu.body import FlexibleBody
from flexfmu.model.errors import OptionError
from flexfmu.model.reduced_body import Division, Formulation, Kinematics, LoadPlacement, Mass
from references import BEAM, calculix, displacement, relative

LOADS = {"tip": [-1e3, 8e3, 3e3, 40.0, -150.0, 200.0]}


def motion(model, **choices):
    body = FlexibleBody(model, Formulation(**choices))
    return body.motion(body.static(LOADS))


@pytest.mark.parametrize("kinematics", [Kinematics.COROTATED, Kinematics.SECANT])
def test_one_frame_at_run_time_is_the_body_built_with_one(bodies, kinematics):
    built, chosen = bodies.beam(frames=1).model, bodies.beam(frames=8).model
    expected = motion(built, kinematics=kinematics)
    found = motion(chosen, kinematics=kinematics, division=Division.ONE)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert relative(motion(chosen, kinematics=kinematics), expected) > 1e-2


def test_separate_frames_of_the_source_turn_each_part_about_its_own_linear_place(bodies):
    """x = X + u_a + (R − I)(X − X_a) + R e: the joint's displacement is not carried by the parent."""
    model = bodies.beam(frames=4).model
    body = FlexibleBody(model, Formulation(loads=LoadPlacement.REFERENCE, division=Division.SEPARATE))
    state = body.static(LOADS)
    q, last = state.q, model.frame_count - 1
    angle = model.frame_rotation[last] @ q
    axis, size = angle / np.linalg.norm(angle), np.linalg.norm(angle)
    hat = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(size) * hat + (1.0 - np.cos(size)) * hat @ hat
    arm = model.interface_point[0] - model.joint_point[last]
    joint = model.joint_displacement[last] @ q
    remainder = model.interface_displacement[0] @ q - joint - np.cross(angle, arm)
    expected = joint + turn @ (arm + remainder) - arm
    np.testing.assert_allclose(body.response(state).displacement[0], expected, rtol=1e-9, atol=1e-12)


def test_only_the_tree_gets_better_with_more_frames(bodies):
    force = 10e3
    table = calculix(BEAM / "calculix" / "static_y.csv")
    (expected,) = displacement(table)[np.abs(table["force_N"] - force) < 1.0]

    def error(frames, division):
        body = FlexibleBody(bodies.beam(frames=frames).model, Formulation(division=division))
        return relative(body.response(body.static({"tip": [0.0, force, 0.0]})).displacement[0], expected)

    assert error(8, Division.TREE) < 1e-3
    # The last part alone turns, and the joints before it have moved on straight lines.
    assert error(8, Division.SEPARATE) > error(2, Division.SEPARATE) > error(2, Division.ONE)


def test_the_deformed_body_s_mass_follows_the_tree_alone(bodies):
    with pytest.raises(OptionError, match="follows the tree"):
        FlexibleBody(bodies.beam().model, Formulation(mass=Mass.CONFIGURATION, division=Division.ONE))


def test_a_free_body_on_one_frame_has_its_floating_one(bodies):
    body = bodies.beam(free=True, support=[], frames=4)
    one = FlexibleBody(body.model, Formulation(division=Division.ONE))
    assert one.model.frame_names == ("floating",)
    state = one.step(one.rest(), {"tip": [0.0, 100.0, 0.0]}, 1e-2)
    assert np.linalg.norm(one.motion(state)[:3]) > 1e-4
