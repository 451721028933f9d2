"""The L-frame: bending and torsion out of its plane, bending in it, against CalculiX."""

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from references import L_FRAME, body_without_error, calculix, displacement, relative

CASES = {"static_z": np.array([0.0, 0.0, 1.0]), "static_x": np.array([1.0, 0.0, 0.0])}


def tip_error(body, case):
    """Relative error of the tip displacement at the largest load of a case."""
    row = calculix(L_FRAME / "calculix" / f"{case}.csv")[-1]
    response = body.response(body.static({"tip": row["force_N"] * CASES[case]}))
    return relative(response.displacement[0], displacement(row))


@pytest.mark.slow
def test_frequencies_agree_with_calculix(bodies):
    expected = calculix(L_FRAME / "calculix" / "frequencies.csv")["frequency_Hz"][:10]
    found = bodies.l_frame().model.angular_frequency[:10] / (2.0 * np.pi)
    assert np.max(np.abs(found / expected - 1.0)) < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("frames", [3, 4, 5, 8])
def test_bending_with_torsion_is_right_within_half_a_percent(bodies, frames):
    assert tip_error(bodies.l_frame(frames=frames), "static_z") <= 0.005


@pytest.mark.parametrize("frames", [pytest.param(4, marks=pytest.mark.slow), 5, 8])
def test_bending_in_the_plane_is_right_within_half_a_percent(bodies, frames):
    assert tip_error(bodies.l_frame(frames=frames), "static_x") <= 0.005


@pytest.mark.parametrize(("case", "error"), [("static_z", 0.0896), ("static_x", 0.109)])
def test_linear_body_is_wrong(bodies, case, error):
    assert tip_error(bodies.l_frame(frames=0), case) == pytest.approx(error, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_error_falls_with_the_square_of_the_number_of_frames(bodies, case):
    # The levels do not end at the corner, so single halvings scatter; three of them together do not.
    coarse, fine = (tip_error(bodies.l_frame(frames=n, modes=40), case) for n in (1, 8))
    assert 1.5 < np.log2(coarse / fine) / 3.0 < 2.5


@pytest.mark.slow
def test_frames_given_by_hand_follow_the_legs():
    config = body_without_error(L_FRAME / "body.toml")
    frames = [
        FrameTable(name="inner", nodes="LEG1A"),
        FrameTable(name="middle", nodes="LEG1B", parent="inner"),
        FrameTable(name="outer", nodes="LEG2", parent="middle"),
    ]
    body = FlexibleBody(reduce_body(config.model_copy(update={"frames": None, "frame": frames}), Reporter()))
    assert body.model.frame_parent.tolist() == [-1, 0, 1]
    assert tip_error(body, "static_z") <= 0.003
    assert tip_error(body, "static_x") <= 0.0065


@pytest.mark.slow
def test_three_frames_and_the_stress_of_the_loads_are_enough_in_the_plane(bodies):
    # A force in the plane presses along a leg: geometric stiffness by load takes most of what three frames leave.
    reduction = bodies.config(L_FRAME).reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    model = bodies.l_frame(frames=3, reduction=reduction).model
    methods = Method.FRAMES, Method.FRAMES_STIFFNESS
    errors = [tip_error(FlexibleBody(model, method), "static_x") for method in methods]
    assert errors[0] > 0.006
    assert errors[1] < 0.003
