"""The methods: what each is right for, where it fails, and which data it needs."""

import dataclasses
import re

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from bodies import beam_body
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import (
    DEFAULT,
    Mass,
    Method,
    Variant,
    conflict,
    masses_of,
    needs,
)
from flexfmu.model.reduced_body import ReducedBody
from flexfmu.model.variants import lean, missing, offered
from references import BEAM, DEMO, body_without_error, calculix, displacement, relative

EULER = np.pi**2 * 2e11 * 0.03**4 / 12.0 / 4.0
BY_LOAD = Method.STIFFNESS_BY_LOAD


@pytest.fixture(scope="module")
def beam():
    """The clamped beam by frames and modes, with the data of all methods."""
    config = body_without_error(BEAM / "body.toml")
    known = {}

    def make(frames=1, modes=10):
        if (frames, modes) not in known:
            wanted = {
                "modes": modes,
                "geometric_stiffness": ["by_load", "by_mode"],
                "second_order": True,
                "inertia": True,
            }
            reduction = config.reduction.model_copy(update=wanted)
            changed = config.model_copy(update={"frames": frames, "reduction": reduction})
            known[frames, modes] = reduce_body(changed, Reporter())
        return known[frames, modes]

    return make


def tangent(body, method, axial):
    """Tangent stiffness of the undeformed beam under an axial tip force, N (tension positive)."""
    model = FlexibleBody(body, method)
    return model.tangent(model.rest(), np.array([axial, 0.0, 0.0, 0.0, 0.0, 0.0]))


def critical_load(body, method):
    """Smallest compression at which the tangent is singular, over Euler's load."""
    stiffness = np.diag(body.angular_frequency**2)
    change = tangent(body, method, -1.0) - stiffness
    values = scipy.linalg.eigvals(-change, stiffness)
    real = values.real[np.abs(values.imag) < 1e-9 * np.abs(values).max()]
    return 1.0 / real.max() / EULER


def tip_error(body, method, force):
    """Relative error of the tip displacement under a force (N) along y."""
    row = calculix(BEAM / "calculix" / "static_y.csv")
    row = row[row["force_N"] == force][0]
    model = FlexibleBody(body, method)
    return relative(model.response(model.static({"tip": [0.0, force, 0.0]})).displacement[0], displacement(row))


@pytest.mark.parametrize(
    ("modes", "low", "high"),
    [(1, 1.06, 1.09), (3, 1.0, 1.01), *(pytest.param(n, 1.0, 1.01, marks=pytest.mark.slow) for n in (5, 10))],
)
def test_geometric_stiffness_by_load_buckles_at_eulers_load(beam, modes, low, high):
    assert low < critical_load(beam(modes=modes), BY_LOAD) < high


@pytest.mark.slow
@pytest.mark.parametrize("method", [Method.MODAL_ROTATION, Method.HALF_ROTATION])
def test_corrective_moment_alone_buckles_at_two_ei_over_l_squared(beam, method):
    found = critical_load(beam(modes=30), method)
    # A moment P u(L) at the tip bends the tip by P u L²/(2EI): critical at 2EI/L². Shear makes half a per cent.
    assert found == pytest.approx(8.0 / np.pi**2, rel=1e-2)


@pytest.mark.parametrize("frames", [1, 4])
def test_geometric_stiffness_is_never_counted_twice(beam, frames):
    both = critical_load(beam(frames=frames), Method.FRAMES_STIFFNESS)
    assert both == pytest.approx(critical_load(beam(frames=frames), BY_LOAD), rel=1e-9)


@pytest.mark.slow
def test_adding_both_as_they_stand_would_buckle_at_less_than_half(beam):
    body = beam(modes=30)
    stiffness = np.diag(body.angular_frequency**2)
    change = tangent(body, Method.MODAL_ROTATION, -1.0) + tangent(body, BY_LOAD, -1.0) - 2.0 * stiffness
    values = scipy.linalg.eigvals(-change, stiffness)
    real = values.real[np.abs(values.imag) < 1e-9 * np.abs(values).max()]
    assert 1.0 / real.max() / EULER == pytest.approx(0.445, rel=0.015)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_of_second_order_any_frames_buckle_at_eulers_load(beam, frames):
    assert critical_load(beam(frames=frames), Method.SECOND_ORDER) == pytest.approx(1.0015, abs=1.5e-3)


def test_critical_load_of_the_tree_converges_to_eulers_from_above(beam):
    found = np.array([critical_load(beam(frames=n), Method.FRAMES) for n in (1, 2, 4, 8)])
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


@pytest.mark.slow
def test_frequencies_under_axial_force_agree_with_calculix(beam):
    for row in calculix(BEAM / "calculix" / "axial_frequencies.csv"):
        squares = np.linalg.eigvalsh(tangent(beam(modes=20), BY_LOAD, row["force_N"]))
        expected = [row[f"f{k}_Hz"] for k in range(1, 7)]
        np.testing.assert_allclose(np.sqrt(squares[:6]) / (2.0 * np.pi), expected, rtol=2e-3)


@pytest.mark.slow
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


def test_turning_displacements_by_the_whole_rotation_is_half_as_good_as_by_half_of_it(beam):
    methods = (Method.LINEAR, Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.FLOATING_FRAME, Method.FRAMES)
    errors = {method: tip_error(beam(), method, 10e3) for method in methods}
    assert errors[Method.LINEAR] == pytest.approx(0.152, abs=2e-3)
    assert errors[Method.MODAL_ROTATION] > 0.5 * errors[Method.LINEAR]
    assert errors[Method.HALF_ROTATION] < 0.06
    assert errors[Method.FRAMES] < 0.06
    # One frame for the whole body is the tree of one.
    assert errors[Method.FLOATING_FRAME] == pytest.approx(errors[Method.FRAMES], rel=1e-6)


def rigid_arm(length=1.0):
    """An arm of unit mode θ = q that turns rigidly about the origin."""
    spin, shift = np.array([[[0.0], [0.0], [1.0]]]), np.array([[[0.0], [length], [0.0]]])
    return ReducedBody(
        "arm", [1.0], [0.0], ("tip",), [[length, 0.0, 0.0]], shift, spin, [0], ("arm",), [-1], np.zeros((1, 3)),
        np.zeros((1, 3, 1)), spin, spin,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("method", "shortening"),
    [
        (Method.LINEAR, np.zeros_like),
        (Method.MODAL_ROTATION, lambda angle: angle * np.sin(angle)),
        (Method.HALF_ROTATION, lambda angle: angle * np.sin(angle / 2.0)),
        (Method.FRAMES, lambda angle: 1.0 - np.cos(angle)),
    ],
)
def test_rigid_arm_shortens_as_each_reading_has_it(method, shortening):
    body = FlexibleBody(rigid_arm(), method)
    for angle in (0.1, 0.5, 1.0):
        state = dataclasses.replace(body.rest(), q=np.array([angle]))
        response = body.response(state)
        assert -response.displacement[0, 0] == pytest.approx(shortening(angle), abs=1e-14)
        np.testing.assert_allclose(response.rotation[0], [0.0, 0.0, angle], atol=1e-14)


@pytest.mark.parametrize("method", [method for method in Method if needs(method)])
def test_a_method_whose_data_is_not_stored_is_refused_with_the_key_that_stores_it(bodies, method):
    with pytest.raises(OptionError, match=rf'method "{method.value}" needs .* in \[reduction\]'):
        FlexibleBody(bodies.beam().model, method)


def test_each_method_needs_just_the_data_that_it_is_said_to_need(beam):
    body = beam(frames=2)
    assert offered(body) == tuple(Method)
    for method in Method:
        for mass in masses_of(method):
            slim = lean(body, Variant(method, mass))
            given, found = FlexibleBody(body, method, mass), FlexibleBody(slim)
            assert (found.method, found.variant.mass) == (method, mass)
            loads = {"tip": [-500.0, 800.0, 300.0]}
            states = [one.step(one.rest(), loads, 1e-3) for one in (given, found)]
            np.testing.assert_array_equal(states[0].q, states[1].q)
            for data in needs(method, mass):
                assert missing(dataclasses.replace(slim, **{data.attribute: None}), method, mass) is not None


def test_names_will_do_for_methods_and_masses(beam):
    body = beam(frames=2)
    by_name, by_member = FlexibleBody(body, "frames", "configuration"), FlexibleBody(body, DEFAULT, Mass.CONFIGURATION)
    state = dataclasses.replace(by_name.rest(), q=0.1 * np.ones(body.mode_count))
    np.testing.assert_array_equal(by_name.mass(state), by_member.mass(state))
    assert np.linalg.norm(by_name.mass(state) - np.eye(body.mode_count)) > 1e-3
    with pytest.raises(OptionError, match=r"method is 'corotated', expected one of linear, .*second_order"):
        FlexibleBody(body, "corotated")
    with pytest.raises(OptionError, match=r"mass is 'lumped', expected one of constant, configuration"):
        FlexibleBody(body, mass="lumped")


@pytest.mark.parametrize("method", [method for method in Method if Mass.CONFIGURATION not in masses_of(method)])
def test_the_deformed_body_s_mass_goes_with_trees_of_frames_alone(beam, method):
    with pytest.raises(OptionError, match='goes with methods "frames" and "second_order" only'):
        FlexibleBody(beam(frames=2), method, Mass.CONFIGURATION)
    # The body's own mass is no reason to refuse another method.
    inertial = lean(beam(frames=2), Variant(Method.FRAMES, Mass.CONFIGURATION))
    if not needs(method):
        assert FlexibleBody(inertial, method).variant.mass is Mass.CONSTANT


def test_a_body_without_frames_is_linear_and_refuses_methods_that_have_them():
    body = beam_body(0)
    assert FlexibleBody(body).method is Method.LINEAR
    assert offered(body) == (Method.LINEAR,)
    with pytest.raises(OptionError, match='method "frames" needs frames'):
        FlexibleBody(body, Method.FRAMES)


def test_kinds_of_bodies_refuse_methods_that_have_no_meaning_for_them():
    free = {m for m in Method if conflict(Variant(m), free=True, cut=False) is not None}
    cut = {m for m in Method if conflict(Variant(m), free=False, cut=True) is not None}
    assert free == {Method.STIFFNESS_BY_LOAD, Method.FRAMES_STIFFNESS}
    assert cut == {
        Method.STIFFNESS_BY_LOAD, Method.STIFFNESS_BY_MODE, Method.FRAMES_STIFFNESS, Method.FLOATING_FRAME
    }  # fmt: skip
    assert conflict(Variant(Method.FRAMES, Mass.CONFIGURATION), free=False, cut=True) is not None


@pytest.mark.slow
def test_stiffness_by_mode_stiffens_under_tension_as_by_load_does(beam):
    # The few axial modes carry the tension: near the root, where it stiffens most, they hold almost all of it.
    body = beam(modes=40)
    loads = {"tip": [0.5 * EULER, 100.0, 0.0]}
    found = {}
    for method in (Method.LINEAR, BY_LOAD, Method.STIFFNESS_BY_MODE):
        model = FlexibleBody(body, method)
        found[method] = model.response(model.static(loads)).displacement[0, 1]
    assert found[BY_LOAD] < 0.75 * found[Method.LINEAR]
    assert found[Method.STIFFNESS_BY_MODE] == pytest.approx(found[BY_LOAD], rel=0.05)


def test_moment_does_its_work_in_every_step(beam):
    model = FlexibleBody(beam(frames=4), damping_scale=30.0)
    loads = {"tip": [0.0, 1e3, 500.0, 200.0, 1000.0, 4000.0]}
    state = model.rest()
    for _ in range(400):
        state = model.step(state, loads, 2e-3)
    static = model.static(loads)
    assert np.linalg.norm(model.response(static).rotation) > 0.2
    np.testing.assert_allclose(model.response(state).displacement, model.response(static).displacement, rtol=1e-6)


PAGE = (DEMO / "RESULTS.md").read_text(encoding="utf-8")


def rows_at_four_loads():
    """Methods and the errors (%) that the page gives for them at 2, 5, 10 and 20 kN."""
    table = PAGE.split("| method | 2 kN | 5 kN | 10 kN | 20 kN |", 1)[1].split("\n\n", 1)[0]
    for line in table.strip().splitlines()[1:]:
        method, *errors = (cell.strip() for cell in line.strip("|").split("|"))
        yield Method(method.strip("`")), [float(cell) for cell in errors]


def test_errors_at_two_to_twenty_kilonewton_are_those_of_the_page(beam):
    rows = list(rows_at_four_loads())
    assert len({method for method, _ in rows}) == 5
    for method, expected in rows:
        found = [100.0 * tip_error(beam(), method, force) for force in (2e3, 5e3, 10e3, 20e3)]
        # The page has three digits.
        np.testing.assert_allclose(found, expected, rtol=5e-3, atol=6e-3, err_msg=method.value)


def test_the_page_of_methods_has_a_row_for_each_and_no_other():
    page = (DEMO.parent / "docs" / "methods.md").read_text(encoding="utf-8")
    table = page.split("| method | what it is |", 1)[1].split("\n\n", 1)[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.M) == [method.value for method in Method]
