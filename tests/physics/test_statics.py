"""Equilibria: closed forms of beams, the exact elastica, stability."""

import numpy as np
import pytest
from scipy.integrate import simpson, solve_bvp

from bodies import COROTATED, LINEAR, Beam, beam_body, random_body
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.body.loads import Loads
from flexfmu.files.basics import EquilibriumError, LoadError, OptionError

BEAM = Beam()


def elastica(load):
    """Tip displacement (x, y) and rotation of an inextensible cantilever of unit length under F L²/(EI) = load.

    θ″ = −load cos θ with θ(0) = 0 and θ′(1) = 0 (the force keeps its direction across the undeformed axis).
    """
    s = np.linspace(0.0, 1.0, 51)
    solution = solve_bvp(
        lambda _, y: np.array([y[1], -load * np.cos(y[0])]),
        lambda start, end: np.array([start[0], end[1]]),
        s,
        min(load, 2.8) * np.array([s - s**2 / 2, 1 - s]),
        tol=1e-10,
        max_nodes=10**5,
    )
    assert solution.success
    fine = np.linspace(0.0, 1.0, 4001)
    angle = solution.sol(fine)[0]
    return np.array([simpson(np.cos(angle), x=fine) - 1.0, simpson(np.sin(angle), x=fine), angle[-1]])


def tip(flexible, loads):
    """Tip displacement (x, y) and rotation about z in equilibrium."""
    response = flexible.response(flexible.static({"tip": loads}))
    return np.array([*response.displacement[0, :2], response.rotation[0, 2]])


def test_the_elastica_of_the_tests_is_that_of_the_tables():
    # K. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145, table I: w/L, u/L and the angle.
    np.testing.assert_allclose(elastica(1.0), [-0.05643, 0.30172, 0.46135], atol=6e-6)
    np.testing.assert_allclose(elastica(2.0), [-0.16064, 0.49346, 0.78175], atol=6e-6)


@pytest.mark.parametrize("load", [1.0, 2.0, 4.0])
def test_a_beam_of_many_frames_bends_as_the_exact_elastica(load):
    force = (0.0, load * BEAM.bending_stiffness / BEAM.length**2, 0.0)
    exact = elastica(load)
    found = tip(FlexibleBody(beam_body(16, modes=12, planes="y"), COROTATED), force)
    # What is left is of second order in the frames' length; in the angle the truncation of modes, in its tip curvature.
    np.testing.assert_allclose(found[:2], exact[:2], atol=4e-4 * np.hypot(*exact[:2]))
    assert found[2] == pytest.approx(exact[2], rel=1e-3)
    straight = tip(FlexibleBody(beam_body(16, modes=12, planes="y"), LINEAR), force)
    assert np.hypot(*(straight - exact)[:2]) > 0.2 * np.hypot(*exact[:2])
    assert straight[0] == 0.0


def test_the_elastica_is_approached_with_the_square_of_the_number_of_frames():
    force = (0.0, 2.0 * BEAM.bending_stiffness, 0.0)
    exact = elastica(2.0)

    def error(frames):
        found = tip(FlexibleBody(beam_body(frames, modes=24, planes="y"), COROTATED), force)
        return np.hypot(*(found - exact)[:2])

    errors = np.array([error(frames) for frames in (2, 4, 8, 16)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 1.9) & (orders < 2.2)), orders


@pytest.mark.parametrize("direction", ["y", "z"])
def test_linear_kinematics_give_the_textbook_cantilever(direction):
    force = np.where(np.array(list("xyz")) == direction, 100.0, 0.0)
    flexible = FlexibleBody(beam_body(4, modes=12), LINEAR)
    response = flexible.response(flexible.static({"tip": force}))
    deflection = 100.0 * BEAM.length**3 / (3.0 * BEAM.bending_stiffness)
    slope = 100.0 * BEAM.length**2 / (2.0 * BEAM.bending_stiffness)
    # The modes left out hold Σ_{k>12} 4/a⁴ of the deflection: 2.4e-5 of a third.
    axis = "xyz".index(direction)
    assert response.displacement[0, axis] == pytest.approx(deflection, rel=3e-5)
    assert response.displacement[0, axis] < deflection
    turn = response.rotation[0, 2] if direction == "y" else -response.rotation[0, 1]
    assert turn == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("moment", [0.1, 1.0])
def test_an_end_moment_bends_the_beam_into_an_arc(moment):
    # Curvature is M/EI everywhere; modes converge slowly at the end, where theirs is zero.
    flexible = FlexibleBody(beam_body(16, modes=40, planes="y"), COROTATED)
    found = tip(flexible, (0.0, 0.0, 0.0, 0.0, 0.0, moment * BEAM.bending_stiffness / BEAM.length))
    arc = np.array([np.sin(moment) / moment - 1.0, (1.0 - np.cos(moment)) / moment, moment])
    np.testing.assert_allclose(found[:2], arc[:2], atol=5e-3 * np.hypot(*arc[:2]))
    assert found[2] == pytest.approx(arc[2], rel=1.5e-2)


@pytest.mark.parametrize("loads", [(0, 9e3, 4e3), (3e3, 9e3, 4e3, 0, 500.0, -800.0), (-8e3, 5e3, 1e3)])
def test_in_equilibrium_elastic_and_modal_forces_cancel(loads):
    model = beam_body(5)
    body = FlexibleBody(model, COROTATED)
    state = body.static({"tip": loads})
    elastic = model.angular_frequency**2 * state.q
    modal = body.forces(state, body.loads({"tip": loads}).packed(False))
    assert np.linalg.norm(elastic - modal) < 1e-9 * np.linalg.norm(elastic)
    assert np.linalg.norm(elastic) > 100.0


def test_modal_superposition_makes_statics_linear_in_the_load():
    model = random_body()
    flexible = FlexibleBody(model, LINEAR)
    loads = {"port_1": (40.0, -30.0, 20.0, 1.0, 2.0, 3.0)}
    q = flexible.static(loads).q
    expected = (
        np.array(loads["port_1"][:3]) @ model.interface_displacement[1]
        + np.array(loads["port_1"][3:]) @ model.interface_rotation[1]
    ) / model.angular_frequency**2
    np.testing.assert_allclose(q, expected, rtol=1e-13)
    twice = flexible.static({"port_1": 2.0 * np.array(loads["port_1"])}).q
    np.testing.assert_allclose(twice, 2.0 * q, rtol=1e-14)


def test_damped_motion_comes_to_rest_in_the_static_equilibrium():
    model = beam_body(4, modes=4, planes="y", damping=0.3)
    flexible = FlexibleBody(model, COROTATED)
    loads = {"tip": (-1e4, 3e4, 0.0)}
    state = flexible.rest()
    for _ in range(400):
        state = flexible.step(state, loads, 2e-3)
    rest = flexible.static(loads)
    omega = model.angular_frequency
    np.testing.assert_allclose(omega * state.q, omega * rest.q, atol=1e-9 * np.linalg.norm(omega * rest.q))
    assert np.linalg.norm(state.v) < 1e-9 * np.linalg.norm(omega * rest.q)
    straight = FlexibleBody(model, LINEAR).static(loads)
    assert np.linalg.norm(omega * (straight.q - rest.q)) > 0.05 * np.linalg.norm(omega * rest.q)


def test_a_load_too_large_for_one_newton_solution_is_reached_in_increments():
    flexible = FlexibleBody(beam_body(16, modes=12, planes="y"), COROTATED)
    force = np.array([0.0, 20.0 * BEAM.bending_stiffness, 0.0])
    exact = elastica(20.0)
    np.testing.assert_allclose(tip(flexible, force)[:2], exact[:2], atol=6e-4 * np.hypot(*exact[:2]))


# S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 2nd ed., table 2-4: end angle, P/P_cr, x/L, y/L.
@pytest.mark.parametrize(
    ("degrees", "ratio", "x", "y"),
    [(40, 1.063, 0.881, 0.422), (80, 1.293, 0.560, 0.719), (100, 1.518, 0.349, 0.792), (120, 1.884, 0.123, 0.803)],
)
def test_an_imperfect_column_buckles_along_the_exact_elastica(degrees, ratio, x, y):
    flexible = FlexibleBody(beam_body(32, modes=24, planes="y"), COROTATED)
    found = tip(flexible, (-ratio * BEAM.critical_load, 1e-3 * BEAM.critical_load, 0.0))
    # The table's last digit in P moves the tip by up to a hundredth near the critical load.
    np.testing.assert_allclose(found[:2], [x - 1.0, y], atol=4e-3)
    assert np.degrees(found[2]) == pytest.approx(degrees, abs=0.5)


def test_a_column_under_compression_deflects_by_the_amplification_of_its_imperfection():
    # Transverse deflection grows as 1/(1 − P/P_cr) to within a few percent (Timoshenko), and P_cr is Euler's.
    flexible = FlexibleBody(beam_body(16, modes=8, planes="y"), COROTATED)
    small = 1e-3 * BEAM.critical_load
    alone = tip(flexible, (0.0, small, 0.0))[1]
    for ratio in (0.3, 0.6, -1.0):
        loaded = tip(flexible, (-ratio * BEAM.critical_load, small, 0.0))[1]
        u = 0.5 * np.pi * np.sqrt(abs(ratio))
        tangent = np.tan(u) if ratio > 0 else np.tanh(u)
        exact = 3.0 * abs(tangent - u) / u**3
        assert loaded / alone == pytest.approx(exact, rel=1e-2)


@pytest.mark.parametrize("ratio", [1.5, 5.0])
def test_compression_far_beyond_the_critical_load_has_no_equilibrium_near_the_straight_column(ratio):
    flexible = FlexibleBody(beam_body(8, modes=6, planes="y"), COROTATED)
    with pytest.raises(EquilibriumError, match="critical") as caught:
        flexible.static({"tip": (-ratio * BEAM.critical_load, 0.0, 0.0)})
    # A perfect column bears the critical load itself, up to the size of the last load increment.
    assert caught.value.load_factor * ratio == pytest.approx(1.0, abs=0.02)


def test_a_perfect_column_bears_ninety_nine_hundredths_of_its_critical_load():
    flexible = FlexibleBody(beam_body(16, modes=6, planes="y"), COROTATED)
    assert tip(flexible, (-0.99 * BEAM.critical_load, 0.0, 0.0)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_no_load_leaves_the_body_undeformed():
    flexible = FlexibleBody(random_body(), COROTATED)
    np.testing.assert_array_equal(flexible.static({}).q, 0.0)


@pytest.mark.parametrize(
    ("loads", "words"),
    [
        ({"nowhere": (1, 0, 0)}, "nowhere.*'tip'"),
        ({"tip": (1, 0)}, "3 forces"),
        ({"tip": (1, np.nan, 0)}, "not finite"),
        ({"tip": (1, 0, np.inf)}, "not finite"),
    ],
)
def test_a_wrong_load_is_refused_by_name(loads, words):
    with pytest.raises(LoadError, match=words):
        FlexibleBody(beam_body(2), COROTATED).static(loads)


OTHERS = Loads(np.ones((1, 3)), np.zeros((1, 3)))
CALLS = {
    "static": lambda body, _: body.static(OTHERS),
    "step": lambda body, rest: body.step(rest, OTHERS, 1e-3),
    "step to loads at its end": lambda body, rest: body.step_with_work(rest, {}, 1e-3, OTHERS),
}


@pytest.mark.parametrize("call", CALLS)
def test_loads_of_a_body_with_fewer_interfaces_are_refused(call):
    """The core would read what lies behind them."""
    body = random_body()
    assert len(body.interface_names) > 1
    flexible = FlexibleBody(body, COROTATED)
    with pytest.raises(LoadError, match=r"shapes \(1, 3\) and \(1, 3\), expected \(3, 3\).*port_0.*`loads`"):
        CALLS[call](flexible, flexible.rest())


def test_arrays_of_another_body_are_refused():
    """As packed loads and as states, which the core reads, too."""
    flexible = FlexibleBody(random_body(), COROTATED)
    rest, inputs, few = flexible.rest(), np.zeros(18), np.zeros(3)
    for ask in (flexible.forces, flexible.tangent, flexible.stability, lambda *a: flexible.is_stable(*a, 0.1)):
        with pytest.raises(OptionError, match="3 inputs were given, expected 18"):
            ask(rest, few)
    with pytest.raises(OptionError, match="3 inputs"):
        flexible.step_packed(rest, inputs, 1e-3, few)
    with pytest.raises(OptionError, match="3 inputs"):
        flexible.stiffness_missed(few)
    other = State(few, few)
    for ask in (
        flexible.motion,
        flexible.motion_and_rates,
        flexible.energies,
        flexible.mass,
        flexible.largest_rotation,
    ):
        with pytest.raises(OptionError, match=f"3 coordinates were given, expected {rest.q.size}"):
            ask(other)
