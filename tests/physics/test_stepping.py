"""Time steps: conservation of energy, order, tolerance, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bodies import COROTATED, LINEAR, Beam, beam_body, body_of_everything, random_body
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.files.basics import OptionError, StepError
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import GROUND
from reference import Reference

BEAM = Beam()
# Bends the beam by 0.4 L at the first overshoot.
HEAVY = (-2e3, 0.6 * BEAM.bending_stiffness, 0.0)
# One and a half periods of the lowest mode, s.
END = 0.064
# Whatever the error, the step is taken in one.
ONE_STEP = StepLimits(0.0, 1e300)


def swinging_beam(limits=None, damping=0.0, method=COROTATED):
    return FlexibleBody(beam_body(3, modes=3, planes="y", damping=damping), method, limits=limits or StepLimits())


def phase(flexible, state):
    """State in units of the square root of energy."""
    return np.concatenate([flexible.model.angular_frequency * state.q, state.v])


def distance(flexible, a, b):
    return np.linalg.norm(phase(flexible, a) - phase(flexible, b)) / np.linalg.norm(phase(flexible, b))


def run(flexible, loads, step, count, state=None):
    loads = flexible.loads(loads)
    state = state or flexible.rest()
    for _ in range(count):
        state = flexible.step(state, loads, step)
    return state


@pytest.fixture(scope="module")
def fine():
    """The beam under the heavy load after `END`, by steps that resolve every mode hundreds of times."""
    return run(swinging_beam(ONE_STEP), {"tip": HEAVY}, END / 2**13, 2**13)


def energy_drift(steps, step, every=1):
    """Largest |strain + kinetic − work of the force| relative to the largest energy, seen at `every` so many steps."""
    flexible = swinging_beam(ONE_STEP)
    inputs = flexible.loads({"tip": HEAVY}).packed(False)
    state, worst, energy, deflection = flexible.rest(), 0.0, 0.0, 0.0
    for number in range(steps):
        state, work = flexible.step_packed(state, inputs, step)
        if number % every:
            continue
        assert work.substeps == 1
        total = sum(flexible.energies(state))
        moved = flexible.motion(state)[:3]
        worst = max(worst, abs(total - float(np.vdot(HEAVY, moved))))
        energy, deflection = max(energy, total), max(deflection, abs(moved[1]))
    assert energy > 1e3
    assert deflection > 0.35 * BEAM.length
    return worst / energy


@pytest.mark.parametrize("step", [5e-4, 2e-3, 8e-3])
def test_a_sudden_dead_load_changes_no_energy_at_any_step_length(step):
    # The third mode's period is 2.3 ms: the longest step is far from resolving it.
    assert energy_drift(1500, step) < 1e-11


@pytest.mark.long
def test_energy_is_kept_over_two_hundred_thousand_steps():
    drift = energy_drift(200_000, 1e-3, every=100)
    print(f"drift {drift:.1e} of the largest energy")
    assert drift < 2e-10


def test_energy_is_kept_where_the_branches_of_a_tree_turn_by_a_radian():
    model = random_body(damping_ratio=np.zeros(6))
    flexible = FlexibleBody(model, COROTATED, limits=ONE_STEP)
    loads = flexible.loads({"port_0": (300.0, -200.0, 500.0), "port_1": (-400.0, 100.0, 300.0)})
    state, energy, turn = flexible.rest(), 0.0, 0.0
    for _ in range(1000):
        state = flexible.step(state, loads, 1e-3)
        energy = max(energy, total := sum(flexible.energies(state)))
        response = flexible.response(state)
        turn = max(turn, np.max(np.linalg.norm(response.rotation, axis=1)))
        assert abs(total - np.vdot(loads.force, response.displacement)) < 1e-11 * max(energy, 1.0)
    assert energy > 10.0
    assert turn > 1.0


def test_damping_takes_energy_away():
    flexible = swinging_beam(ONE_STEP, damping=0.05)
    loads = flexible.loads({"tip": HEAVY})
    state, balances = flexible.rest(), [0.0]
    for _ in range(200):
        state = flexible.step(state, loads, 1e-3)
        work = float(np.vdot(loads.force, flexible.response(state).displacement))
        balances.append(sum(flexible.energies(state)) - work)
    assert balances[-1] < -100.0
    # Over a step that one period of the third mode does not resolve the balance may rise a little, but never overall.
    assert all(b < a + 1.0 for a, b in pairwise(balances))


def test_the_internal_step_is_of_second_order(fine):
    flexible = swinging_beam(ONE_STEP)
    errors = np.array(
        [distance(flexible, run(flexible, {"tip": HEAVY}, END / 2**k, 2**k), fine) for k in (7, 8, 9, 10)]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders[1:] > 1.9) & (orders[1:] < 2.1)), orders
    assert errors[-1] < 1e-4


@pytest.mark.slow
def test_the_motion_is_that_of_an_independent_integrator():
    model = beam_body(3, modes=2, planes="y", damping=0.02)
    flexible = FlexibleBody(model, COROTATED, limits=StepLimits(0.0, 1e-8))
    loads = {"tip": (*HEAVY, 0.0, 0.0, -800.0)}
    reference, inputs = Reference(model, COROTATED), np.array(loads["tip"])
    omega, zeta = model.angular_frequency, model.damping_ratio

    def rate(_, y):
        q, v = y[:2], y[2:]
        acceleration = reference.force(inputs, q)
        return np.concatenate([v, acceleration - omega**2 * q - 2.0 * zeta * omega * v])

    exact = solve_ivp(rate, (0.0, 0.05), np.zeros(4), method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    found = run(flexible, loads, 0.05 / 4, 4)
    assert distance(flexible, found, State(exact[:2], exact[2:])) < 1e-5


@pytest.mark.parametrize("step", [END, 0.016, 0.001])
def test_large_communication_steps_are_divided_until_the_tolerance_holds(step, fine):
    count = round(END / step)
    flexible = swinging_beam()
    state, loads, substeps = flexible.rest(), flexible.loads({"tip": HEAVY}), 0
    for _ in range(count):
        state, work = flexible.step_with_work(state, loads, step)
        assert work.error <= 1e-3
        substeps += work.substeps
    # The tolerance bounds an internal step's error, of modes by how far a step resolves them; they add up at worst.
    resolved = np.minimum(1.0, work.substeps / (flexible.model.angular_frequency * step))
    off = np.concatenate([resolved, resolved]) * (phase(flexible, state) - phase(flexible, fine))
    assert np.linalg.norm(off) < 1e-3 * substeps * np.linalg.norm(phase(flexible, fine))
    assert distance(flexible, state, fine) < 0.02


def test_a_tighter_tolerance_gives_a_smaller_error(fine):
    errors = [
        distance(flexible, run(flexible, {"tip": HEAVY}, 0.004, 16), fine)
        for flexible in (swinging_beam(StepLimits(0.0, tolerance)) for tolerance in (1e-3, 1e-5, 1e-7))
    ]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]


def test_the_error_of_a_mode_that_a_step_does_not_resolve_counts_the_less_for_it_follows_its_force():
    """By 1/ωh; what a growing force does beyond its mean is (h − sin(ωh)/ω)/(ω²h) − (1 − cos ωh)/2ω² of its growth."""
    flexible, step = swinging_beam(ONE_STEP), 1e-3
    omega, loads = flexible.model.angular_frequency, flexible.loads({"tip": HEAVY})
    start, x = run(flexible, {"tip": HEAVY}, step, 8), omega * step
    end, work = flexible.step_with_work(start, loads, step)
    grown = np.subtract(*(flexible.forces(at, loads.packed(False)) for at in (end, start)))
    lost = omega * grown * ((1.0 - np.sin(x) / x) / omega**2 - 0.5 * (1.0 - np.cos(x)) / omega**2)
    expected = np.linalg.norm(lost / np.maximum(x, 1.0)) / np.linalg.norm(phase(flexible, end))
    assert (x.max() > 2.0, work.substeps) == (True, 1)
    assert abs(lost[-1]) > 0.2 * np.linalg.norm(lost)
    assert work.error == pytest.approx(expected, rel=1e-6)


def test_a_step_of_modal_superposition_is_exact_whatever_its_length():
    flexible = FlexibleBody(random_body(), LINEAR)
    loads = {"port_0": (30.0, 20.0, -10.0, 1.0, 2.0, 3.0)}
    start = run(flexible, {"port_1": (5.0, 6.0, 7.0)}, 0.013, 3)
    once, work = flexible.step_with_work(start, flexible.loads(loads), 3.0)
    many = run(flexible, loads, 3.0 / 1024, 1024, start)
    assert distance(flexible, once, many) < 1e-11
    assert (work.substeps, work.iterations) == (1, 0)
    assert np.linalg.norm(phase(flexible, once)) > 0.5


def test_an_unloaded_step_is_exact_whatever_the_kinematics():
    flexible = swinging_beam(damping=0.01)
    start = run(flexible, {"tip": HEAVY}, 1e-3, 10)
    once = flexible.step(start, {}, 0.7)
    many = run(flexible, {}, 0.7 / 512, 512, start)
    assert distance(flexible, once, many) < 1e-10


@pytest.mark.parametrize(("longest", "expected"), [(0.0, 1), (1e-3, 1), (0.9e-3, 2), (1e-4, 10)])
def test_the_step_limit_sets_how_many_internal_steps_there_are(longest, expected):
    flexible = swinging_beam(StepLimits(longest, 1e300))
    _, work = flexible.step_with_work(flexible.rest(), flexible.loads({"tip": HEAVY}), 1e-3)
    assert work.substeps == expected


def test_internal_steps_are_those_of_shorter_communication_steps():
    divided = swinging_beam(StepLimits(1e-4, 1e300))
    whole = swinging_beam(ONE_STEP)
    a = run(divided, {"tip": HEAVY}, 1.6e-3, 5)
    b = run(whole, {"tip": HEAVY}, 1e-4, 80)
    assert distance(divided, a, b) < 1e-9


def test_no_load_leaves_a_body_at_rest():
    flexible = FlexibleBody(random_body(), COROTATED)
    state = run(flexible, {"port_0": (0.0, 0.0, 0.0)}, 0.01, 5)
    np.testing.assert_array_equal(phase(flexible, state), 0.0)
    response = flexible.response(state)
    np.testing.assert_array_equal([response.displacement, response.rotation], 0.0)


@pytest.mark.parametrize("size", [1e5, 1e7, 1e12, 1e100, 1e300])
def test_a_load_far_beyond_reason_is_refused_or_borne_but_never_gives_nan(size):
    flexible = FlexibleBody(random_body(), COROTATED)
    loads = flexible.loads({"port_0": (size, -size, size, size, 0.0, 0.0), "port_2": (0.0, size, -size)})
    refusals = 0
    with np.errstate(all="ignore"):
        for step in (1e-6, 1e-2):
            try:
                state = flexible.step(flexible.rest(), loads, step)
            except StepError as error:
                refusals += 1
                assert "load" in str(error)  # noqa: PT017 (either outcome is sound)
            else:
                assert np.all(np.isfinite(phase(flexible, state)))
                response = flexible.response(state)
                assert np.all(np.isfinite([response.displacement, response.rotation]))
    if size >= 1e12:
        assert refusals > 0


@pytest.mark.parametrize("size", [1e12, 1e300])
def test_a_refused_step_leaves_no_trace(size):
    flexible = swinging_beam()
    state = run(flexible, {"tip": HEAVY}, 1e-3, 20)
    before = state.q.copy(), state.v.copy()
    with np.errstate(all="ignore"), pytest.raises(StepError):
        flexible.step(state, {"tip": (size, size, 0.0)}, 1e-2)
    np.testing.assert_array_equal((state.q, state.v), before)
    after = flexible.step(state, {"tip": HEAVY}, 1e-3)
    undisturbed = run(swinging_beam(), {"tip": HEAVY}, 1e-3, 21)
    np.testing.assert_array_equal(phase(flexible, after), phase(flexible, undisturbed))


def test_a_refusal_names_the_step_and_the_number_of_internal_steps():
    flexible = swinging_beam(StepLimits(1e-8))
    words = "0.01 s needs 1000000 internal steps by internal_step.limit, more than internal_step.most = 4096"
    with pytest.raises(StepError, match=words):
        flexible.step(flexible.rest(), {"tip": HEAVY}, 1e-2)


@pytest.mark.parametrize("step", [0.0, -1e-3, np.nan, np.inf])
def test_a_step_that_is_not_positive_is_refused(step):
    flexible = swinging_beam()
    with pytest.raises(StepError, match="positive"):
        flexible.step(flexible.rest(), {}, step)


@pytest.mark.parametrize(
    ("scale", "limits", "words"),
    [
        (-1.0, StepLimits(), "damping scale"),
        (np.nan, StepLimits(), "damping scale"),
        (1.0, StepLimits(-1e-3), "step limit"),
        (1.0, StepLimits(0.0, 0.0), "tolerance"),
        (1.0, StepLimits(0.0, np.nan), "tolerance"),
    ],
)
def test_options_out_of_range_are_refused(scale, limits, words):
    with pytest.raises(OptionError, match=words):
        FlexibleBody(random_body(), COROTATED, damping_scale=scale, limits=limits)


def test_the_damping_scale_multiplies_every_ratio():
    model = random_body()
    doubled = random_body(damping_ratio=2.0 * model.damping_ratio)
    loads = {"port_0": (30.0, 20.0, -10.0)}
    a = run(FlexibleBody(model, LINEAR, damping_scale=2.0), loads, 0.01, 20)
    b = run(FlexibleBody(doubled, LINEAR), loads, 0.01, 20)
    c = run(FlexibleBody(model, LINEAR), loads, 0.01, 20)
    np.testing.assert_array_equal(a.q, b.q)
    assert np.linalg.norm(a.q - c.q) > 1e-3 * np.linalg.norm(c.q)


def harmonic(end_too, step, method, count):
    """State of the damped beam after `count` steps under a force that grows and falls, known at each step's ends."""
    flexible = swinging_beam(ONE_STEP, damping=0.01, method=method)
    state = flexible.rest()
    for k in range(count):
        start, end = ({"tip": (0.0, HEAVY[1] * np.sin(40.0 * t), 0.0)} for t in (k * step, (k + 1) * step))
        state, _ = flexible.step_with_work(state, start, step, end if end_too else None)
    return flexible, state


@pytest.mark.parametrize("method", [LINEAR, COROTATED])
def test_loads_that_grow_over_a_step_make_it_second_order_where_constant_ones_are_first(method):
    flexible, exact = harmonic(True, END / 2**11, method, 2**11)
    errors = {
        ramp: [distance(flexible, harmonic(ramp, END / 2**k, method, 2**k)[1], exact) for k in (6, 7, 8)]
        for ramp in (False, True)
    }
    orders = {ramp: np.log2(np.array(e[:-1]) / e[1:]) for ramp, e in errors.items()}
    np.testing.assert_allclose(orders[False], 1.0, atol=0.15)
    np.testing.assert_allclose(orders[True], 2.0, atol=0.15)
    assert errors[True][2] < 0.05 * errors[False][2]


def test_a_linear_body_under_a_force_linear_in_time_is_exact_for_any_step():
    one = swinging_beam(method=LINEAR, damping=0.02)
    force = np.array([*HEAVY])
    whole, _ = one.step_with_work(one.rest(), {}, END, {"tip": force})
    parts = one.rest()
    for k in range(7):
        parts, _ = one.step_with_work(parts, {"tip": k / 7 * force}, END / 7, {"tip": (k + 1) / 7 * force})
    assert distance(one, whole, parts) < 1e-12


def test_loads_that_grow_over_many_internal_steps_grow_as_over_as_many_short_ones():
    """A step in 64 parts is 64 steps, whether the master or the body divides it; short enough for a fixed point."""
    model, count = beam_body(3, modes=3, planes="y", damping=0.01), 64
    first, last = (np.array([scale * f for f in HEAVY]) for scale in (0.1, 0.5))
    limits = StepLimits(END / count, 1e300)
    flexible = FlexibleBody(model, COROTATED, limits=limits)
    whole, work = flexible.step_with_work(flexible.rest(), {"tip": first}, END, {"tip": last})
    assert work.substeps == count
    assert work.iterations <= 6 * count
    parts = flexible.rest()
    for k in range(count):
        start, end = (first + share / count * (last - first) for share in (k, k + 1))
        parts, work = flexible.step_with_work(parts, {"tip": start}, END / count, {"tip": end})
        assert work.substeps == 1
    assert distance(flexible, whole, parts) < 1e-10


@pytest.mark.parametrize(("free", "most"), [(False, 7.0), (True, 3.7)])
def test_an_iteration_ends_where_its_rate_says_that_it_has_settled(free, most):
    """Rounds a step, 6.5 and 3.4; to the same tolerance by changes alone 7.6 and 4.1."""
    rounds = steps = 0
    for seed in range(6):
        model = body_of_everything(seed, modes=9, free=free)
        body = FlexibleBody(model, Method.SECOND_ORDER, damping_scale=0.0, limits=StepLimits(tolerance=1e9))
        q = 0.5 * np.random.default_rng(seed).standard_normal(9 - model.rigid_count)
        q = np.concatenate([np.zeros(model.rigid_count), q])
        for step in (1e-3, 4e-3):
            state = State(q, 0.0 * q)
            for _ in range(10):
                state, work = body.step_with_work(state, {}, step)
                rounds, steps = rounds + work.iterations, steps + work.substeps
    assert rounds < most * steps


def test_with_dampers_a_step_takes_as_many_rounds_whatever_the_unit_of_time():
    rows, reached, rounds = np.random.default_rng(3).normal(size=(3, 6)), [], []
    for second in (1.0, 1e4):
        model = random_body(3, parents=(GROUND, 0), interface_frame=(1,))
        model = replace(model, angular_frequency=model.angular_frequency / second, damper=2.0 * rows / np.sqrt(second))
        body = FlexibleBody(model, limits=StepLimits(tolerance=10.0))
        start = State(np.full(6, 0.01), np.linspace(-1.0, 1.0, 6) / second)
        load = {"port_0": np.array([3.0, -2.0, 1.0, 0.2, 0.3, 0.1]) / second**2}
        state, work = body.step_with_work(start, load, 5e-3 * second)
        reached.append(state.q)
        rounds.append(work.iterations)
    np.testing.assert_allclose(reached[1], reached[0], rtol=1e-9)
    assert rounds[1] == rounds[0] < 12
