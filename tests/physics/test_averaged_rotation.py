"""The averaged rotation of a sub-domain: the mean over its material, by a chord, by a tetrahedron."""

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable
from flexfmu.files.basics import BodyFileError, UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from references import BEAM, body_without_error, calculix, displacement, relative
from turns import exponential

EXTRA = """*NSET, NSET=ALL
SEG1, SEG2, SEG3, SEG4, SEG5, SEG6, SEG7, SEG8
*NSET, NSET=CORNER1
{corners[0]}
*NSET, NSET=CORNER2
{corners[1]}
*NSET, NSET=CORNER3
{corners[2]}
*MATERIAL"""


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The clamped beam with one frame over all of it, its rotation told by the node sets given."""
    folder = tmp_path_factory.mktemp("points")
    deck = (BEAM / "beam.inp").read_text(encoding="utf-8")
    lines = deck.split("*NODE", 1)[1].split("\n", 1)[1].split("*")[0].strip().splitlines()
    nodes = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    tip = nodes[nodes[:, 1] > 1.0 - 1e-9]
    spots = [(0.015, 0.015), (0.015, -0.015), (-0.015, 0.0)]
    corners = [int(tip[np.argmin(np.hypot(tip[:, 2] - y, tip[:, 3] - z)), 0]) for y, z in spots]
    text = deck.replace("*MATERIAL", EXTRA.format(corners=corners), 1)
    (folder / "beam.inp").write_text(text, encoding="utf-8")
    config = body_without_error(BEAM / "body.toml")
    mesh = config.mesh.model_copy(update={"file": folder / "beam.inp"})

    def make(points, units=UnitSystem.SI):
        frame = FrameTable(name="all", nodes="ALL", rotation_points=points)
        read = mesh
        if units is UnitSystem.MM_T_S:
            small = text.replace("2e+11, 0.3", "2e+5, 0.3").replace("\n7850", "\n7.85e-9")
            (folder / "small.inp").write_text(small, encoding="utf-8")
            read = mesh.model_copy(update={"file": folder / "small.inp", "units": units})
        changed = config.model_copy(update={"frames": None, "frame": [frame], "mesh": read})
        return reduce_body(changed, Reporter())

    return make


WAYS = {"mean": None, "chord": ["TIP"], "tetrahedron": ["CORNER1", "CORNER2", "CORNER3"]}


@pytest.mark.slow
@pytest.mark.parametrize(("units", "length"), [(UnitSystem.SI, 1.0), (UnitSystem.MM_T_S, 1e-3)])
def test_chord_turns_by_the_tip_displacement_over_the_length(beam, units, length):
    model = beam(WAYS["chord"], units)
    tip = model.interface_displacement[0] / length
    expected = [np.zeros_like(tip[0]), -tip[2], tip[1]]
    np.testing.assert_allclose(model.frame_rotation[0], expected, atol=1e-9 * np.abs(tip).max())


@pytest.mark.slow
def test_tetrahedron_sees_the_twist_that_the_chord_does_not(beam):
    # The seventh mode is torsion: the section at the tip turns by all of it.
    torsion = 6
    twist = beam(WAYS["tetrahedron"]).interface_rotation[0, 0, torsion]
    assert abs(twist) > 1.0
    assert beam(WAYS["tetrahedron"]).frame_rotation[0, 0, torsion] == pytest.approx(twist, rel=0.6)
    assert abs(beam(WAYS["chord"]).frame_rotation[0, 0, torsion]) < 1e-6 * abs(twist)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_any_average_corrects_the_large_deflection(beam, way):
    row = calculix(BEAM / "calculix" / "static_y.csv")
    row = row[row["force_N"] == 10e3][0]
    body = FlexibleBody(beam(WAYS[way]))
    found = body.response(body.static({"tip": [0.0, 10e3, 0.0]})).displacement[0]
    assert relative(found, displacement(row)) < 0.04


@pytest.mark.slow
def test_mean_rotation_of_a_straight_beam_is_that_of_its_chord(beam):
    """The mean of the slope is the deflection over the length; shear, which turns sections back, is not in ½ curl u."""
    model = {way: beam(WAYS[way]) for way in ("mean", "chord")}
    bending = np.linalg.norm(model["chord"].interface_displacement[0, 1:], axis=0) > 1e-3
    mean, chord = (model[way].frame_rotation[0, 1:, bending] for way in ("mean", "chord"))
    # First bending modes of both planes.
    np.testing.assert_allclose(mean[:2], chord[:2], rtol=2e-3, atol=1e-3 * np.abs(chord).max())
    row = calculix(BEAM / "calculix" / "static_y.csv")
    row = row[row["force_N"] == 10e3][0]
    for method in (Method.MODAL_ROTATION, Method.HALF_ROTATION):
        errors = []
        for way in model:
            body = FlexibleBody(model[way], method)
            found = body.response(body.static({"tip": [0.0, 10e3, 0.0]})).displacement[0]
            errors.append(relative(found, displacement(row)))
        assert errors[0] == pytest.approx(errors[1], rel=0.02)


@pytest.mark.slow
def test_points_that_tell_no_rotation_are_refused(beam):
    with pytest.raises(BodyFileError, match="in a plane"):
        beam(["CORNER1", "CORNER2", "CORNER2"])
    with pytest.raises(BodyFileError, match="joint"):
        beam(["ROOT"])
    with pytest.raises(ValueError, match="expected one"):
        FrameTable(name="all", nodes="ALL", rotation_points=["TIP", "ROOT"])


@pytest.mark.slow
@pytest.mark.parametrize(("method", "expected"), [(Method.MODAL_ROTATION, 8.7), (Method.HALF_ROTATION, 2.6)])
def test_the_chord_s_finite_angle_differs_from_its_linear_one_by_the_arctangent_alone(beam, method, expected):
    """By hand and with the angle that the chord really turns by: errors within half a per cent of the body's own."""
    body = beam(WAYS["chord"])
    model = body
    force = np.array([0.0, 10e3, 0.0])
    along = model.interface_point[0] - model.joint_point[0]
    g, turn = model.interface_displacement[0], model.interface_rotation[0]
    share = 1.0 if method is Method.MODAL_ROTATION else 0.5
    moved = np.zeros(3)
    for _ in range(100):
        moment = np.cross(moved, force)
        linear = g @ ((g.T @ force + turn.T @ moment) / model.angular_frequency**2)
        axis = np.cross(along, along + linear)
        angle = np.arctan2(np.linalg.norm(axis), along @ (along + linear))
        moved = exponential(share * angle * axis / np.linalg.norm(axis)) @ linear
    table = calculix(BEAM / "calculix" / "static_y.csv")
    (reference,) = displacement(table)[np.abs(table["force_N"] - 10e3) < 1.0]
    assert 100.0 * relative(moved, reference) == pytest.approx(expected, abs=0.1)
    own = FlexibleBody(model, method)
    found = own.response(own.static({"tip": force})).displacement[0]
    assert 100.0 * relative(found, reference) == pytest.approx(expected, abs=0.5)
