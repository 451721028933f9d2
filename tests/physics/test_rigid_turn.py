"""A stiff arm behind a soft neck turns far as a rigid body: finite elements, modes and frames together."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.model.methods import Method
from meshes import body_file, grid, lattice, with_sets
from references import relative

LENGTH, WIDTH, NECK = 1.0, 0.05, 0.01
SOFT = Material("SOFT", 2e7, 0.0, 7850.0)
STIFF = Material("STIFF", 2e11, 0.0, 7850.0)
# Bending stiffness of the neck over its length, N m/rad.
SPRING = SOFT.youngs_modulus * WIDTH**4 / 12.0 / NECK


def flexure(folder, **tables):
    """Clamped soft neck of 1 cm that ends in a stiff arm of 1 m; a frame for each."""
    x = np.array([0.0, NECK / 2.0, NECK, NECK + 0.25, NECK + 0.5, NECK + 0.75, NECK + LENGTH])

    def place(p):
        return np.column_stack([np.interp(p[:, 0], range(7), x), WIDTH * (p[:, 1:] / 2.0 - 0.5)])

    mesh = lattice(ElementType.C3D20R, grid(6, 2, 2), place, (SOFT, STIFF), lambda c: (c[:, 0] > 2.0).astype(int))
    mesh = with_sets(
        mesh,
        ROOT=lambda p: p[:, 0],
        TIP=lambda p: p[:, 0] - x[-1],
        NECK=lambda p: np.maximum(p[:, 0] - NECK, 0.0),
        ARM=lambda p: np.minimum(p[:, 0] - NECK, 0.0),
        HINGE=lambda p: np.abs(p[:, 0] - NECK) + np.abs(p[:, 1]),
    )
    frames = [{"name": "neck", "nodes": "NECK"}, {"name": "arm", "nodes": "ARM", "parent": "neck"}]
    # The neck's strain is of the order of one: its second order means nothing.
    tables = {
        "frame": frames,
        "reduction": {"modes": 8, "residual_flexibility": False},
        "formulation": {"method": "frames"},
    } | tables
    return reduce_body(body_file(mesh, folder, interface=["TIP"], **tables), Reporter())


def rigid_turn(rotation):
    """Displacement of the tip that turns about the middle of the neck."""
    arm = np.array([LENGTH + 0.5 * NECK, 0.0, 0.0])
    return Rotation.from_rotvec(rotation).apply(arm) - arm


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("degrees", [35.0, 80.0])
def test_arm_turns_rigidly_beyond_the_neck_under_a_moment(axis, degrees, tmp_path):
    body = FlexibleBody(flexure(tmp_path))
    angle = np.radians(degrees)
    load = np.zeros(6)
    load[3 + axis] = SPRING * angle
    response = body.response(body.static({"tip": load}))
    expected = np.zeros(3)
    expected[axis] = angle
    # What the arm itself bends is ten thousand times less per length.
    assert relative(response.rotation[0], expected) < 0.02
    turned = rigid_turn(response.rotation[0])
    # The neck bends, so that the centre of the turn is known to within half of it.
    assert np.linalg.norm(response.displacement[0] - turned) < 0.5 * NECK * angle
    assert np.linalg.norm(turned) > 0.55


def test_distance_from_neck_to_tip_is_kept_where_linear_kinematics_stretch_it(tmp_path):
    model = flexure(tmp_path)
    force = {"tip": [0.0, 0.8 * SPRING / LENGTH, 0.0]}
    start = np.array([LENGTH + 0.5 * NECK, 0.0, 0.0])

    def stretch(method):
        body = FlexibleBody(model, method)
        moved = start + body.response(body.static(force)).displacement[0]
        assert abs(moved[1]) > 0.5
        return np.linalg.norm(moved) / np.linalg.norm(start) - 1.0

    assert abs(stretch(Method.FRAMES)) < NECK / LENGTH
    assert stretch(Method.LINEAR) > 0.2


def test_force_of_fixed_direction_balances_the_neck_at_the_turned_arm(tmp_path):
    # SPRING φ = F L cos φ, the lever arm shortens as the arm turns.
    body = FlexibleBody(flexure(tmp_path))
    force = 1.2 * SPRING / LENGTH
    response = body.response(body.static({"tip": [0.0, force, 0.0]}))
    angle = response.rotation[0, 2]
    assert np.degrees(angle) > 30.0
    assert angle == pytest.approx(force * (LENGTH + 0.5 * NECK) * np.cos(angle) / SPRING, rel=0.02)


def test_one_frame_for_neck_and_arm_does_as_well(tmp_path):
    # Nearly all of the body's volume is the arm, so that the averaged rotation is the arm's.
    body = FlexibleBody(flexure(tmp_path, frame=[], frames=1))
    angle = np.radians(35.0)
    response = body.response(body.static({"tip": [0.0, 0.0, 0.0, 0.0, 0.0, SPRING * angle]}))
    assert np.linalg.norm(response.displacement[0] - rigid_turn([0.0, 0.0, angle])) < 0.02


def test_a_joint_on_a_line_turns_with_the_frame_that_hangs_on_it(tmp_path):
    frames = [{"name": "neck", "nodes": "NECK"}, {"name": "arm", "nodes": "ARM", "parent": "neck", "joint": "HINGE"}]
    model = flexure(tmp_path, frame=frames)
    np.testing.assert_array_equal(model.joint_rotation[1], model.frame_rotation[1])
    whole = flexure(tmp_path)
    assert np.abs(whole.joint_rotation[1] - whole.frame_rotation[1]).max() > 0.0
    np.testing.assert_allclose(model.joint_point[1], [NECK, 0.0, 0.0], atol=1e-12)
    body = FlexibleBody(model)
    response = body.response(body.static({"tip": [0.0, 0.0, 0.0, 0.0, 0.0, 0.6 * SPRING]}))
    assert np.linalg.norm(response.displacement[0] - rigid_turn(response.rotation[0])) < NECK
