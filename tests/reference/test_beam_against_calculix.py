"""The clamped beam: frequencies, statics and motion against CalculiX."""

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from references import BEAM, body_without_error, calculix, displacement, relative, rotation


def tip_error(body, force):
    """Relative error of the tip displacement under a force (N) along y."""
    table = calculix(BEAM / "calculix" / "static_y.csv")
    row = table[table["force_N"] == force][0]
    response = body.response(body.static({"tip": [0.0, force, 0.0]}))
    return relative(response.displacement[0], displacement(row))


def by_hand(count):
    """The beam with `count` (1, 2, 4 or 8) frames made of its eight segments, named in the body file."""
    config = body_without_error(BEAM / "body.toml")
    names = [f"SEG{k}" for k in range(1, 9)][:count]
    assert count == 8, "the deck names eight segments"
    frames = [
        FrameTable(name=f"part{k}", nodes=name, parent=f"part{k - 1}" if k else None) for k, name in enumerate(names)
    ]
    changes = {"frames": None, "frame": frames, "reduction": config.reduction.model_copy(update={"modes": 10})}
    return FlexibleBody(reduce_body(config.model_copy(update=changes), Reporter()))


def test_first_ten_frequencies_agree_with_calculix_within_a_tenth_of_a_percent(bodies):
    expected = calculix(BEAM / "calculix" / "frequencies.csv")["frequency_Hz"][:10]
    found = bodies.beam().model.angular_frequency / (2.0 * np.pi)
    # CalculiX prints seven digits; the element is the same, so all of them agree.
    assert np.max(np.abs(found / expected - 1.0)) < 2e-6


def test_first_bending_frequency_is_that_of_beam_theory():
    # Euler-Bernoulli, λ = 1.8751: slender enough for half a per cent.
    table = calculix(BEAM / "calculix" / "frequencies.csv")["frequency_Hz"][0]
    stiffness, mass = 2e11 * 0.03**4 / 12.0, 7850.0 * 0.03**2
    assert table == pytest.approx(1.8751041**2 * np.sqrt(stiffness / mass) / (2.0 * np.pi), rel=5e-3)


@pytest.mark.parametrize(("frames", "bound"), [(1, 0.03), (4, 0.003), (8, 0.001)])
def test_tip_at_ten_kilonewton_is_right_with_frames(bodies, frames, bound):
    assert tip_error(bodies.beam(frames=frames), 10e3) <= bound


def test_tip_at_ten_kilonewton_is_wrong_by_fifteen_percent_without_frames(bodies):
    assert tip_error(bodies.beam(frames=0), 10e3) == pytest.approx(0.152, abs=0.003)


def test_linear_kinematics_equal_a_body_without_frames(bodies):
    linear = FlexibleBody(bodies.beam().model, Method.LINEAR)
    without = bodies.beam(frames=0)
    loads = {"tip": [1e3, 5e3, -2e3, 10.0, 20.0, 30.0]}
    np.testing.assert_allclose(
        linear.response(linear.static(loads)).displacement,
        without.response(without.static(loads)).displacement,
        rtol=1e-12,
    )


@pytest.mark.slow
def test_error_falls_with_the_square_of_the_number_of_frames(bodies):
    # Thirty modes, so that truncation does not hide the frames' own error.
    errors = np.array([tip_error(bodies.beam(frames=n, modes=30), 10e3) for n in (1, 2, 4, 8)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 1.8), orders
    assert np.all(orders < 2.2), orders


@pytest.mark.slow
def test_frames_given_by_hand_equal_the_same_frames_found_automatically(bodies):
    hand, automatic = by_hand(8).model, bodies.beam(frames=8).model
    np.testing.assert_allclose(hand.frame_rotation, automatic.frame_rotation, atol=1e-9)
    np.testing.assert_allclose(hand.joint_displacement, automatic.joint_displacement, atol=1e-9)
    np.testing.assert_array_equal(hand.frame_parent, automatic.frame_parent)


def test_rotation_of_the_tip_agrees_with_calculix(bodies):
    table = calculix(BEAM / "calculix" / "static_y.csv")
    row = table[table["force_N"] == 10e3][0]
    body = bodies.beam(frames=8, modes=30)
    response = body.response(body.static({"tip": [0.0, 10e3, 0.0]}))
    assert relative(response.rotation[0], rotation(row)) < 2e-3


def test_forces_in_all_directions_at_once_agree_with_calculix(bodies):
    table = calculix(BEAM / "calculix" / "static_combined.csv")
    body = bodies.beam(frames=8, modes=30)
    for row in table[[5, -1]]:
        loads = {"tip": [row["fx_N"], row["fy_N"], row["fz_N"]]}
        response = body.response(body.static(loads))
        assert relative(response.displacement[0], displacement(row)) < 1e-3
        linear = FlexibleBody(body.model, Method.LINEAR)
        assert relative(linear.response(linear.static(loads)).displacement[0], displacement(row)) > 0.05


@pytest.mark.slow
def test_linear_static_response_equals_the_finite_element_model_within_truncation(bodies):
    table = calculix(BEAM / "calculix" / "linear_y.csv")
    loads = {"tip": [0.0, 1e3, 0.0]}
    errors = []
    for modes in (10, 30, 60):
        body = FlexibleBody(bodies.beam(modes=modes).model, Method.LINEAR)
        found = body.response(body.static(loads)).displacement[0]
        errors.append(relative(found, displacement(table)))
        # Truncated modes can only make the body stiffer.
        assert found[1] < table["uy_m"]
    assert errors[0] < 1e-3
    assert errors[1] < 1e-4
    assert errors[2] < errors[1] < errors[0]


def test_sudden_load_follows_the_nonlinear_transient(bodies):
    table = calculix(BEAM / "calculix" / "sudden_load.csv")
    expected = displacement(table)
    model = bodies.beam(frames=8).model
    errors = {}
    for method in (Method.LINEAR, Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.FRAMES):
        body = FlexibleBody(model, method, damping_scale=0.0)
        state, found = body.rest(), [np.zeros(3)]
        for step in np.diff(table["time_s"]):
            state = body.step(state, {"tip": [0.0, 5e3, 0.0]}, step)
            found.append(body.response(state).displacement[0])
        errors[method] = relative(found, expected)
    assert errors[Method.FRAMES] < 0.025
    assert errors[Method.LINEAR] > 0.15


def test_undamped_energy_under_a_sudden_load_is_kept(bodies):
    body = FlexibleBody(bodies.beam(frames=8).model, damping_scale=0.0)
    loads, state, energies = {"tip": [0.0, 10e3, 0.0]}, body.rest(), []
    for _ in range(500):
        state = body.step(state, loads, 1e-3)
        strain, kinetic = body.energies(state)
        energies.append((strain, kinetic, strain + kinetic - 10e3 * body.response(state).displacement[0, 1]))
    strain, kinetic, total = np.array(energies).T
    assert strain.max() > 1000.0
    assert kinetic.max() > 500.0
    assert np.max(np.abs(total)) < 1e-9 * strain.max()
