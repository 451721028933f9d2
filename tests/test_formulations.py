"""Kinematics, loads and geometric stiffness, alone and together: what each is right for, and where it fails."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from flexfmu.runtime.dynamics import build_dynamics, configuration_at, spread, tangent_stiffness

from flexfmu.body import FlexibleBody
from flexfmu.build import reduce_body
from flexfmu.config import FormulationTable, read_body_file
from flexfmu.loads import Loads
from flexfmu.model.errors import OptionError
from flexfmu.model.reduced_body import Formulation, Kinematics, LoadPlacement, ReducedBody, Stiffness
from flexfmu.progress import Reporter
from references import BEAM, DEMO, calculix, displacement, relative

EULER = np.pi**2 * 2e11 * 0.03**4 / 12.0 / 4.0
BY_LOAD = Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_LOAD)


@pytest.fixture(scope="module")
def beam():
    """The clamped beam by frames and modes, with all geometric stiffness aboard."""
    config = read_body_file(BEAM / "body.toml")
    known = {}

    def make(frames=1, modes=10):
        if (frames, modes) not in known:
            wanted = {"modes": modes, "geometric_stiffness": ["by_load", "by_mode"], "second_order": True}
            reduction = config.reduction.model_copy(update=wanted)
            changed = config.model_copy(update={"frames": frames, "reduction": reduction})
            known[frames, modes] = reduce_body(changed, Reporter())
        return known[frames, modes]

    return make


def tangent(body, formulation, axial):
    """Tangent stiffness of the undeformed beam under an axial tip force, N (tension positive)."""
    dynamics = build_dynamics(body, formulation)
    loads = spread(dynamics, Loads(np.array([[axial, 0.0, 0.0]]), np.zeros((1, 3))))
    return tangent_stiffness(dynamics, loads, configuration_at(dynamics, np.zeros(body.mode_count)))


def critical_load(body, formulation):
    """Smallest compression at which the tangent is singular, over Euler's load."""
    stiffness = np.diag(body.angular_frequency**2)
    change = tangent(body, formulation, -1.0) - stiffness
    values = scipy.linalg.eigvals(-change, stiffness)
    real = values.real[np.abs(values.imag) < 1e-9 * np.abs(values).max()]
    return 1.0 / real.max() / EULER


def tip_error(body, formulation, force):
    """Relative error of the tip displacement under a force (N) along y."""
    row = calculix(BEAM / "calculix" / "static_y.csv")
    row = row[row["force_N"] == force][0]
    model = FlexibleBody(body, formulation)
    return relative(model.response(model.static({"tip": [0.0, force, 0.0]})).displacement[0], displacement(row))


@pytest.mark.parametrize(("modes", "low", "high"), [(1, 1.06, 1.09), (3, 1.0, 1.01), (5, 1.0, 1.01), (10, 1.0, 1.01)])
def test_geometric_stiffness_by_load_buckles_at_eulers_load(beam, modes, low, high):
    assert low < critical_load(beam(modes=modes), BY_LOAD) < high


def test_corrective_moment_alone_buckles_at_two_ei_over_l_squared(beam):
    found = critical_load(beam(modes=30), Formulation(Kinematics.LINEAR, LoadPlacement.CORRECTIVE_MOMENT))
    # A moment P u(L) at the tip bends the tip by P u L²/(2EI): critical at 2EI/L². Shear makes half a per cent.
    assert found == pytest.approx(8.0 / np.pi**2, rel=1e-2)


@pytest.mark.parametrize("placement", [LoadPlacement.CORRECTIVE_MOMENT, LoadPlacement.DEFORMED])
@pytest.mark.parametrize("kinematics", [k for k in Kinematics if k is not Kinematics.LINEAR])
def test_geometric_stiffness_is_never_counted_twice(beam, placement, kinematics):
    both = critical_load(beam(), Formulation(kinematics, placement, Stiffness.BY_LOAD))
    assert both == pytest.approx(critical_load(beam(), BY_LOAD), rel=1e-9)


def test_adding_both_as_they_stand_would_buckle_at_less_than_half(beam):
    body = beam(modes=30)
    stiffness = np.diag(body.angular_frequency**2)
    moment = Formulation(Kinematics.LINEAR, LoadPlacement.CORRECTIVE_MOMENT)
    change = tangent(body, moment, -1.0) + tangent(body, BY_LOAD, -1.0) - 2.0 * stiffness
    values = scipy.linalg.eigvals(-change, stiffness)
    real = values.real[np.abs(values.imag) < 1e-9 * np.abs(values).max()]
    assert 1.0 / real.max() / EULER == pytest.approx(0.445, rel=0.015)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_of_second_order_any_frames_buckle_at_eulers_load(beam, frames):
    assert critical_load(beam(frames=frames), Formulation(Kinematics.SECOND_ORDER)) == pytest.approx(1.0015, abs=1.5e-3)


def test_critical_load_of_the_tree_converges_to_eulers_from_above(beam):
    found = np.array([critical_load(beam(frames=n), Formulation()) for n in (1, 2, 4, 8)])
    limit = critical_load(beam(), BY_LOAD)
    assert np.all(np.diff(found) < 0.0)
    assert np.all(found > limit)
    assert np.log2((found[0] - limit) / (found[3] - limit)) / 3.0 == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("share", [-0.5, -0.25, 0.25, 0.5, 1.0])
def test_axial_force_changes_the_first_frequency_as_beam_theory_says(beam, share):
    body = beam()
    found = np.sqrt(np.linalg.eigvalsh(tangent(body, BY_LOAD, share * EULER))[0])
    assert found == pytest.approx(first_frequency_under_axial_force(share * EULER), rel=1e-2)
    assert (found > body.angular_frequency[0]) == (share > 0.0)


def test_frequencies_under_axial_force_agree_with_calculix(beam):
    for row in calculix(BEAM / "calculix" / "axial_frequencies.csv"):
        squares = np.linalg.eigvalsh(tangent(beam(modes=20), BY_LOAD, row["force_N"]))
        expected = [row[f"f{k}_Hz"] for k in range(1, 7)]
        np.testing.assert_allclose(np.sqrt(squares[:6]) / (2.0 * np.pi), expected, rtol=2e-3)


def test_critical_load_agrees_with_calculix(beam):
    expected = -calculix(BEAM / "calculix" / "buckling.csv")["force_N"][0] / EULER
    assert critical_load(beam(modes=30), BY_LOAD) == pytest.approx(expected, rel=1e-3)


def first_frequency_under_axial_force(force):
    """Euler-Bernoulli cantilever under a dead axial tip force, rad/s: lowest root of its characteristic equation."""
    ei, mass = 2e11 * 0.03**4 / 12.0, 7850.0 * 0.03**2

    def characteristic(omega):
        half = force / (2.0 * ei)
        root = np.sqrt(half**2 + mass * omega**2 / ei)
        a, b = np.sqrt(root + half), np.sqrt(root - half)
        # w = A (cosh ax − cos bx) + B (sinh ax − (a/b) sin bx); tip: w'' = 0 and EI w''' = P w'.
        rows = [
            [a**2 * np.cosh(a) + b**2 * np.cos(b), a**2 * np.sinh(a) + a * b * np.sin(b)],
            [
                a**3 * np.sinh(a) - b**3 * np.sin(b) - 2.0 * half * (a * np.sinh(a) + b * np.sin(b)),
                a**3 * np.cosh(a) + a * b**2 * np.cos(b) - 2.0 * half * a * (np.cosh(a) - np.cos(b)),
            ],
        ]
        return np.linalg.det(rows)

    grid = np.linspace(5.0, 600.0, 2000)
    values = np.array([characteristic(omega) for omega in grid])
    first = int(np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0])
    return scipy.optimize.brentq(characteristic, grid[first], grid[first + 1])


def test_beam_theory_knows_the_unloaded_beam():
    assert first_frequency_under_axial_force(1e-6) == pytest.approx(
        1.8751041**2 * np.sqrt(2e11 * 0.03**4 / 12.0 / (7850.0 * 0.03**2)), rel=1e-6
    )


def test_turning_displacements_by_the_whole_rotation_is_hardly_better_than_linear(beam):
    errors = {k: tip_error(beam(), Formulation(k, LoadPlacement.REFERENCE), 10e3) for k in Kinematics}
    assert errors[Kinematics.LINEAR] == pytest.approx(0.152, abs=2e-3)
    assert errors[Kinematics.LITERAL] > 0.75 * errors[Kinematics.LINEAR]
    assert errors[Kinematics.SECANT] < 0.06
    assert errors[Kinematics.COROTATED] < 0.06


@pytest.mark.parametrize("kinematics", [Kinematics.LITERAL, Kinematics.SECANT, Kinematics.COROTATED])
def test_loads_on_the_deformed_body_are_better_than_on_the_reference(beam, kinematics):
    reference = tip_error(beam(), Formulation(kinematics, LoadPlacement.REFERENCE), 10e3)
    for placement in (LoadPlacement.CORRECTIVE_MOMENT, LoadPlacement.DEFORMED):
        assert tip_error(beam(), Formulation(kinematics, placement), 10e3) < 0.85 * reference


def rigid_arm(length=1.0):
    """An arm of unit mode θ = q that turns rigidly about the origin."""
    spin, shift = np.array([[[0.0], [0.0], [1.0]]]), np.array([[[0.0], [length], [0.0]]])
    return ReducedBody(
        "arm", [1.0], [0.0], ("tip",), [[length, 0.0, 0.0]], shift, spin, [0], ("arm",), [-1], np.zeros((1, 3)),
        np.zeros((1, 3, 1)), spin, spin,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kinematics", "shortening"),
    [
        (Kinematics.LINEAR, np.zeros_like),
        (Kinematics.LITERAL, lambda angle: angle * np.sin(angle)),
        (Kinematics.SECANT, lambda angle: angle * np.sin(angle / 2.0)),
        (Kinematics.COROTATED, lambda angle: 1.0 - np.cos(angle)),
    ],
)
def test_rigid_arm_shortens_as_each_reading_has_it(kinematics, shortening):
    body = FlexibleBody(rigid_arm(), Formulation(kinematics))
    for angle in (0.1, 0.5, 1.0):
        state = dataclasses.replace(body.rest(), q=np.array([angle]))
        response = body.response(state)
        assert -response.displacement[0, 0] == pytest.approx(shortening(angle), abs=1e-14)
        np.testing.assert_allclose(response.rotation[0], [0.0, 0.0, angle], atol=1e-14)


@pytest.mark.parametrize("placement", [LoadPlacement.CORRECTIVE_MOMENT, LoadPlacement.DEFORMED])
def test_stiffness_by_mode_with_loads_that_move_is_refused(placement):
    with pytest.raises(OptionError, match="twice"):
        Formulation(Kinematics.LINEAR, placement, Stiffness.BY_MODE)
    with pytest.raises(ValueError, match="twice"):
        FormulationTable(loads=placement, stiffness=Stiffness.BY_MODE)


@pytest.mark.parametrize("stiffness", [Stiffness.BY_LOAD, Stiffness.BY_MODE])
def test_stiffness_that_is_not_aboard_is_refused(bodies, stiffness):
    formulation = Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, stiffness)
    with pytest.raises(OptionError, match="geometric_stiffness"):
        FlexibleBody(bodies.beam().model, formulation)


def test_stiffness_by_mode_stiffens_under_tension_as_by_load_does(beam):
    # The few axial modes carry the tension: near the root, where it stiffens most, they hold almost all of it.
    body = beam(modes=40)
    loads = {"tip": [0.5 * EULER, 100.0, 0.0]}
    found = {}
    for stiffness in Stiffness:
        model = FlexibleBody(body, Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, stiffness))
        found[stiffness] = model.response(model.static(loads)).displacement[0, 1]
    assert found[Stiffness.BY_LOAD] < 0.75 * found[Stiffness.CONSTANT]
    assert found[Stiffness.BY_MODE] == pytest.approx(found[Stiffness.BY_LOAD], rel=0.05)


def test_moment_does_its_work_in_every_step(beam):
    model = FlexibleBody(beam(frames=4), damping_scale=30.0)
    loads = {"tip": [0.0, 1e3, 500.0, 200.0, 1000.0, 4000.0]}
    state = model.rest()
    for _ in range(400):
        state = model.step(state, loads, 2e-3)
    static = model.static(loads)
    assert np.linalg.norm(model.response(static).rotation) > 0.2
    np.testing.assert_allclose(model.response(state).displacement, model.response(static).displacement, rtol=1e-6)


PAGE = (DEMO.parent / "docs" / "theory.md").read_text(encoding="utf-8")


def rows_at_four_loads():
    """Kinematics, loads and the errors (%) that the page gives for them at 2, 5, 10 and 20 kN."""
    table = PAGE.split("| kinematics | loads | 2 kN | 5 kN | 10 kN | 20 kN |", 1)[1].split("\n\n", 1)[0]
    for line in table.strip().splitlines()[1:]:
        kinematics, loads, *errors = (cell.strip() for cell in line.strip("|").split("|"))
        placement = "reference" if loads == "any" else loads.replace(" ", "_")
        yield Kinematics(kinematics), LoadPlacement(placement), [float(cell) for cell in errors]


def test_errors_at_two_to_twenty_kilonewton_are_those_of_the_page(beam):
    rows = list(rows_at_four_loads())
    assert len(rows) == 11
    assert {kinematics for kinematics, _, _ in rows} == set(Kinematics)
    for kinematics, placement, expected in rows:
        formulation = Formulation(kinematics, placement)
        found = [100.0 * tip_error(beam(frames=1), formulation, force) for force in (2e3, 5e3, 10e3, 20e3)]
        # The page has three digits.
        np.testing.assert_allclose(found, expected, rtol=5e-3, atol=6e-3, err_msg=str(formulation))
