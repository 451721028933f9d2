"""Exact propagation of single modes against the matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from bodies import LINEAR, beam_body
from flexfmu.body.flexible_body import FlexibleBody, State

# Undamped, lightly damped, nearly critical from both sides, critical, overdamped.
DAMPING = [0.0, 1e-6, 0.02, 0.7, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.3, 20.0]
ANGLES = [1e-6, 1e-3, 9e-3, 1.1e-2, 0.1, 1.0, 7.0, 100.0]


def oracle(omega, damping, step):
    """End values of q and v (rows) from q, v, a constant force and one that grows from 0 to 1 over the step.

    Time is measured in steps and q in h²: then no entry is far from 1 for short steps.
    """
    x = omega * step
    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0
    matrix[1] = -x * x, -2.0 * damping * x, 1.0, 0.0
    matrix[2, 3] = 1.0
    scale = np.array([step**2, step])
    end = expm(matrix)[:2]
    # Columns: q/h², v/h, force, growth of the force per step.
    return np.column_stack(
        [
            end[:, 0] * scale / step**2,
            end[:, 1] * scale / step,
            end[:, 2] * scale,
            end[:, 3] * scale,
        ]
    )


class Mode:
    """One mode, which a force at the only interface drives by itself."""

    def __init__(self, omega, damping):
        one = np.zeros((1, 3, 1))
        one[0, 1, 0] = 1.0
        shape = {"interface_displacement": one, "interface_rotation": 0.0 * one}
        body = beam_body(0, 1, planes="y", angular_frequency=[omega], damping_ratio=[damping], **shape)
        self.body = FlexibleBody(body, LINEAR)

    def after(self, step, q=0.0, v=0.0, force=0.0, end_force=None):
        """State (2,) after a step."""
        ends = (None if f is None else {"tip": [0.0, f, 0.0]} for f in (force, end_force))
        state, _ = self.body.step_with_work(State(np.array([q]), np.array([v])), next(ends), step, next(ends))
        return np.array([state.q[0], state.v[0]])


def coefficients(omega, damping, step):
    """End values of q and v (rows) from q, v, and a constant force."""
    mode = Mode(omega, damping)
    return np.column_stack([mode.after(step, q=1.0), mode.after(step, v=1.0), mode.after(step, force=1.0)])


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("damping", DAMPING)
def test_one_step_is_the_matrix_exponential(damping, angle):
    step = 0.37
    omega = angle / step
    found = coefficients(omega, damping, step)
    expected = oracle(omega, damping, step)[:, :3]
    # In energy units, relative to the state's size: ωq and v; the exponential's own error grows with its norm.
    units = np.array([[1.0, omega, omega**2], [1.0 / omega, 1.0, omega]])
    np.testing.assert_allclose(found * units, expected * units, rtol=0, atol=1e-14 * (1.0 + angle) ** 2 + 1e-15)


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.1, 1.0])
@pytest.mark.parametrize("damping", [0.0, 1e-6, 0.02, 0.7, 1.0, 1.3, 20.0])
def test_a_short_step_answers_a_force_by_half_the_square_of_its_length(damping, angle):
    # 1 − P₁₁ would cancel here; what is left is the versine's own round-off, which grows as ζ/x.
    step = 2.0
    found = coefficients(angle / step, damping, step)
    expected = oracle(angle / step, damping, step)
    assert found[0, 2] == pytest.approx(expected[0, 2], rel=1e-13 + 2e-15 * damping / angle)
    assert found[1, 2] == pytest.approx(expected[1, 2], rel=1e-13)


@pytest.mark.parametrize("angle", [1e-3, 9e-3, 1.1e-2, 0.1, 1.0, 7.0, 100.0])
@pytest.mark.parametrize("damping", [0.0, 0.02, 0.7, 1.0, 1.3])
def test_ramp_is_the_response_to_a_force_that_grows_from_minus_to_plus_one_half(damping, angle):
    step = 0.37
    ramp = Mode(angle / step, damping).after(step, force=-0.5, end_force=0.5)[0]
    expected = oracle(angle / step, damping, step)
    # It serves to estimate errors only, and below ωh = 0.01 its series stops at first order in ζωh.
    series = angle**2 * (1.0 + damping**2) if angle < 1e-2 else 1e-9
    assert ramp == pytest.approx(expected[0, 3] - 0.5 * expected[0, 2], rel=series)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 0.01, 1.0, 3.0])
def test_one_step_of_a_thousand_periods_is_many_small_steps(damping):
    # There is no limit of stability or accuracy: the composition of the small steps is the large one.
    omega, periods, parts = 50.0, 1000, 2**14
    step = periods * 2.0 * np.pi / omega * 1.00037
    mode, force = Mode(omega, damping), 4000.0
    large = mode.after(step, 0.3, -20.0, force)
    small = np.array([0.3, -20.0])
    for _ in range(parts):
        small = mode.after(step / parts, *small, force)
    size = force / omega
    np.testing.assert_allclose(omega * large[0], omega * small[0], atol=1e-9 * size)
    np.testing.assert_allclose(large[1], small[1], atol=1e-9 * size)


def test_an_undamped_mode_gains_exactly_the_work_of_its_force():
    omega, force = 40.0, 900.0
    for step in (1e-5, 0.01, 1.0, 300.0):
        q, v = 0.2, 5.0
        q1, v1 = Mode(omega, 0.0).after(step, q, v, force)
        gain = 0.5 * (v1**2 - v**2) + 0.5 * omega**2 * (q1**2 - q**2)
        assert gain == pytest.approx(force * (q1 - q), abs=1e-12 * (v**2 + omega**2 * q**2))


def test_a_strongly_damped_mode_creeps_to_its_static_value_without_overflow():
    mode = Mode(1e3, 50.0)
    np.testing.assert_allclose(mode.after(1e4, force=1.0), [1e-6, 0.0], rtol=1e-12, atol=1e-12)
    for start in ({"q": 1.0}, {"v": 1.0}):
        np.testing.assert_allclose(mode.after(1e4, **start), 0.0, atol=1e-12)
