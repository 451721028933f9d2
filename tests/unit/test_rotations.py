"""Finite rotations against SciPy and against the exponential series of their matrices."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from flexfmu.model.rotations import exponential, exponential_and_jacobian, rotation_vector, skew

# The series hands over to the closed forms at |φ|² = 0.05.
SWITCH = np.sqrt(0.05)
ANGLES = [
    0.0,
    1e-300,
    1e-12,
    1e-8,
    1e-4,
    1e-2,
    SWITCH * (1 - 1e-9),
    SWITCH * (1 + 1e-9),
    0.5,
    2.0,
    3.1,
    np.pi - 1e-9,
]
AXES = [np.array(a) / np.linalg.norm(a) for a in ([1.0, 2.0, -0.5], [-1.0, 0.0, 0.0], [0.1, -1.0, 1.0])]

axes = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda a: np.linalg.norm(a) > 1e-3)


def test_the_skew_matrix_makes_the_vector_product():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((5, 3)), rng.standard_normal((5, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(a), b), np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("angle", [*ANGLES, np.pi, 4.0, 20.0])
def test_exponential_is_the_rotation_that_scipy_makes(axis, angle):
    expected = Rotation.from_rotvec(angle * axis).as_matrix()
    np.testing.assert_allclose(exponential(angle * axis), expected, atol=3e-15)


def test_exponential_is_orthogonal_with_determinant_one():
    vectors = np.random.default_rng(1).uniform(-4.0, 4.0, (200, 3))
    rotation = exponential(vectors)
    np.testing.assert_allclose(
        rotation @ np.swapaxes(rotation, -1, -2), np.broadcast_to(np.eye(3), (200, 3, 3)), atol=3e-15
    )
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-14)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm_undoes_the_exponential(axis, angle):
    vector = rotation_vector(exponential(angle * axis))
    # A matrix near 1 holds a small rotation to its own round-off only relative to the vector: both are asked for.
    np.testing.assert_allclose(vector, angle * axis, rtol=1e-14, atol=max(3e-15 * angle, 1e-300))


@given(axes, st.floats(0.0, np.pi - 1e-6))
def test_logarithm_undoes_the_exponential_for_any_axis_and_angle(axis, angle):
    vector = angle * np.array(axis) / np.linalg.norm(axis)
    np.testing.assert_allclose(rotation_vector(exponential(vector)), vector, atol=5e-15)


@pytest.mark.parametrize("axis", AXES)
def test_half_a_turn_keeps_its_axis_but_for_the_sign(axis):
    vector = rotation_vector(exponential(np.pi * axis))
    assert np.linalg.norm(vector) == pytest.approx(np.pi, abs=1e-14)
    np.testing.assert_allclose(np.abs(vector), np.pi * np.abs(axis), atol=1e-14)


def test_beyond_half_a_turn_the_logarithm_turns_the_short_way_back():
    np.testing.assert_allclose(
        rotation_vector(exponential(np.array([4.0, 0.0, 0.0]))), [4.0 - 2.0 * np.pi, 0.0, 0.0], atol=1e-14
    )


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("angle", ANGLES)
def test_left_jacobian_is_the_mean_of_the_rotation_from_zero_to_its_angle(axis, angle):
    # ∫₀¹ exp(s φ̂) ds stands in the corner of the exponential of a block matrix (Van Loan 1978).
    block = np.zeros((6, 6))
    block[:3, :3] = skew(angle * axis)
    block[:3, 3:] = np.eye(3)
    np.testing.assert_allclose(exponential_and_jacobian(angle * axis)[1], expm(block)[:3, 3:], atol=5e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-3, SWITCH - 1e-7, SWITCH + 1e-7, 1.0, 3.0, 5.0])
def test_left_jacobian_turns_rates_of_the_vector_into_angular_velocity(angle):
    vector, h = angle * AXES[0], 1e-5
    rotation, jacobian = exponential_and_jacobian(vector)
    for j, unit in enumerate(np.eye(3)):
        rate = (exponential(vector + h * unit) - exponential(vector - h * unit)) / (2.0 * h)
        np.testing.assert_allclose(rate @ rotation.T, skew(jacobian[:, j]), atol=3e-10)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_series_and_closed_forms_meet(side):
    # A jump of either would show as a difference far above the tiny step between the two points.
    step = 1e-12
    for axis in AXES:
        here, there = SWITCH * axis, (SWITCH + side * step) * axis
        for a, b in zip(exponential_and_jacobian(here), exponential_and_jacobian(there), strict=True):
            np.testing.assert_allclose(a, b, atol=2e-12)


def test_a_stack_of_small_and_large_rotations_gives_what_each_gives_alone():
    vectors = np.array([angle * axis for angle in ANGLES for axis in AXES]).reshape(len(ANGLES), 3, 3)
    stack = exponential_and_jacobian(vectors)
    logarithm = rotation_vector(stack[0])
    for index in np.ndindex(vectors.shape[:2]):
        alone = exponential_and_jacobian(vectors[index])
        for a, b in zip(stack, alone, strict=True):
            np.testing.assert_allclose(a[index], b, atol=1e-15)
        np.testing.assert_allclose(logarithm[index], rotation_vector(alone[0]), atol=1e-15)
