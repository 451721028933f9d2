"""Motion of bodies of every kind: against independent integration, the matrix exponential, energy and fresh copies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from bodies import beam_body, body_of_everything, random_body, random_ties, with_polynomial
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.core.interface import read_image
from flexfmu.core.library import Core
from flexfmu.files.basics import OptionError
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import GROUND
from flexfmu.program.compile import compile_program
from reference import Reference

# One internal step, whatever its error.
ONE_STEP = StepLimits(0.0, 1e300)
# Two interfaces that frames carry, masses, and a force that turns frames by some tenths of a radian.
FORCE, TURN = (300.0, -500.0, 400.0), 600.0


def model_of(kind, damped=True):
    model = body_of_everything(5, frames=4)
    if kind == "cut":
        model = random_ties(model, 5)
    elif "deformed mass" in kind:
        model = with_unit_mass(model)
    elif kind == "polynomial mass":
        model = with_polynomial(model)
    return model if damped else replace(model, damping_ratio=np.zeros(model.mode_count))


def with_unit_mass(model, share=0.002):
    """Lumps have a share of their mass, so that less than the undeformed body's unit mass is theirs."""
    data = model.inertia
    light = replace(data, mass=share * data.mass, turning=share * data.turning, sweep=share * data.sweep)
    assert np.linalg.eigvalsh(light.at_rest(model.frame_rotation))[-1] < 1.0
    return replace(model, inertia=light)


KINDS = {
    "frames": (Method.FRAMES, Mass.CONSTANT),
    "second order": (Method.SECOND_ORDER, Mass.CONSTANT),
    "cut": (Method.FRAMES, Mass.CONSTANT),
    "deformed mass": (Method.FRAMES, Mass.CONFIGURATION),
    "second order, deformed mass": (Method.SECOND_ORDER, Mass.CONFIGURATION),
    "polynomial mass": (Method.SECOND_ORDER, Mass.POLYNOMIAL),
}


def body_of(kind, limits=None, damped=True):
    method, mass = KINDS[kind]
    return FlexibleBody(model_of(kind, damped), method, mass, limits=limits)


def phase(body, state):
    return np.concatenate([body.model.angular_frequency * state.q, state.v])


def damping(model):
    """Matrix of the forces that damp modes; springs between the parts of a cut body have none."""
    rates = np.diag(2.0 * model.damping_ratio * model.angular_frequency)
    if model.ties is None:
        return rates
    ties, between = model.ties, model.ties.frame[:, 1] >= 0
    joints = replace(ties, **{name: getattr(ties, name)[between] for name in ties.__dataclass_fields__})
    share = np.eye(model.mode_count) - Reference(replace(model, ties=joints, second=None), Method.FRAMES).joined() / (
        model.angular_frequency**2
    )
    return share @ rates @ share.T


def acceleration(body, inputs, q, v):
    """From d(M v)/dt − ∂(v·M v/2)/∂q + C v + Λ q = Q, derivatives of M by differences."""
    omega = body.model.angular_frequency
    force = body.forces(State(q, v), inputs) - omega**2 * q - damping(body.model) @ v
    if body.variant.mass is Mass.CONSTANT:
        return force
    size = 1e-5
    slopes = [
        (body.mass(State(q + size * unit, v)) - body.mass(State(q - size * unit, v))) / (2.0 * size)
        for unit in np.eye(q.size)
    ]
    momentum = np.array([0.5 * v @ slope @ v for slope in slopes]) - np.einsum("kab,k,b->a", slopes, v, v)
    return np.linalg.solve(body.mass(State(q, v)), force + momentum)


@pytest.mark.parametrize("kind", KINDS)
def test_the_motion_under_growing_loads_is_that_of_an_independent_integrator(kind):
    """A force on one interface and a moment about one axis on the other, both from nothing."""
    body, end, count = body_of(kind, StepLimits(0.0, 1e-9)), 0.03, 3
    first, second = body.model.interface_names
    modes = body.core.modes

    def loads(share):
        return {first: tuple(share * f for f in FORCE), second: (0.0, 0.0, 0.0, share * TURN, 0.0, 0.0)}

    whole = body.loads(loads(1.0)).packed(True)

    def rate(t, y):
        return np.concatenate([y[modes:], acceleration(body, t / end * whole, y[:modes], y[modes:])])

    exact = solve_ivp(rate, (0.0, end), np.zeros(2 * modes), method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    state = body.rest()
    for k in range(count):
        state, _ = body.step_with_work(state, loads(k / count), end / count, loads((k + 1) / count))
    assert np.max(np.abs(body.response(state).rotation)) > 0.1
    expected = phase(body, State(exact[:modes], exact[modes:]))
    assert np.linalg.norm(phase(body, state) - expected) < 2e-5 * np.linalg.norm(expected)


@pytest.mark.parametrize("step", [1e-5, 0.05])
def test_a_linear_step_under_growing_loads_is_the_matrix_exponential(step):
    body = FlexibleBody(random_body(), Method.LINEAR, damping_scale=10.0)
    omega, zeta = body.model.angular_frequency, 10.0 * body.model.damping_ratio
    m = omega.size
    start, end = ({"port_0": tuple(scale * f for f in FORCE), "port_2": (0.0, 40.0, 0.0)} for scale in (0.0, 1.0))
    f0, f1 = (body.forces(body.rest(), body.loads(load).packed(False)) for load in (start, end))
    # y' = A y, of q, v, the force, its growth.
    matrix = np.zeros((4 * m, 4 * m))
    matrix[:m, m : 2 * m] = np.eye(m)
    matrix[m : 2 * m, : 2 * m] = np.hstack([-np.diag(omega**2), -np.diag(2.0 * zeta * omega)])
    matrix[m : 2 * m, 2 * m : 3 * m] = matrix[2 * m : 3 * m, 3 * m :] = np.eye(m)
    for before, after, q, v in ((f0 - f1, f1 - f0, 0.0, 0.0), (f0, f1, 1e-3, 0.1)):
        # Of a force that grows from its negative, as of the difference of two steps.
        y = expm(step * matrix) @ np.concatenate([np.full(m, q), np.full(m, v), before, (after - before) / step])
        rest = State(np.full(m, q), np.full(m, v))
        if q == 0.0:
            turned = {name: tuple(-np.array(f)) for name, f in end.items()}
            opposite = {name: tuple(-np.array(f)) for name, f in start.items()}
            begins = {name: tuple(np.array(start[name]) + np.array(turned[name])) for name in start}
            ends = {name: tuple(np.array(end[name]) + np.array(opposite[name])) for name in start}
        else:
            begins, ends = start, end
        found, _ = body.step_with_work(rest, begins, step, ends)
        # For short steps the series of the response to growth leaves out (ω h)²/20.
        tolerance = 1e-5 if step < 1e-4 else 1e-9
        np.testing.assert_allclose(found.q, y[:m], rtol=tolerance, atol=1e-14 * np.max(np.abs(y[:m])))
        np.testing.assert_allclose(found.v, y[m : 2 * m], rtol=tolerance, atol=1e-9 * np.max(np.abs(y[m : 2 * m])))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [1e-3, 8e-3])
def test_sudden_dead_forces_change_no_energy_of_an_undamped_body(kind, step):
    body = body_of(kind, ONE_STEP, damped=False)
    loads = body.loads(dict.fromkeys(body.model.interface_names, FORCE))
    state, largest = body.rest(), 0.0
    for _ in range(50):
        state = body.step(state, loads, step)
        energy, work = sum(body.energies(state)), np.vdot(loads.force, body.response(state).displacement)
        largest = max(largest, energy)
        assert abs(energy - work) < 1e-9 * largest
    assert largest > 1.0


def test_geometric_stiffness_by_load_has_a_potential():
    """Undamped, under forces that nearly make it buckle, the body keeps strain energy, ½ q·K q and what forces lose."""
    model = replace(beam_body(0, modes=3, planes="y"), stiffness_by_load=np.zeros((6, 3, 3)))
    given = np.zeros((6, 3, 3))
    given[0] = np.outer([30.0, 20.0, 10.0], [30.0, 20.0, 10.0])
    body = FlexibleBody(replace(model, stiffness_by_load=given), Method.STIFFNESS_BY_LOAD, limits=ONE_STEP)
    inputs = body.loads({"tip": (5.0, 300.0, 0.0)}).packed(False)
    constant = body.forces(body.rest(), inputs)
    geometric = body.tangent(body.rest(), inputs) - np.diag(body.model.angular_frequency**2)
    state, largest = body.rest(), 0.0
    for _ in range(200):
        state, _ = body.step_packed(state, inputs, 2e-3)
        held = 0.5 * state.q @ geometric @ state.q
        energy = sum(body.energies(state)) + held
        largest = max(largest, energy)
        assert abs(energy - constant @ state.q) < 1e-9 * largest
    assert abs(held) > 0.0


@pytest.mark.parametrize("asks", [False, True])
@pytest.mark.parametrize("kind", ["frames", "second order", "second order, deformed mass", "polynomial mass"])
def test_a_step_and_its_motion_do_not_depend_on_what_was_asked_before(kind, asks):
    """To the last bit, whatever the loads need to know of the body, and whatever it was asked about other states."""
    body = body_of(kind)
    first, second = body.model.interface_names
    still, heavy = {}, {first: FORCE, second: (*FORCE, 0.0, TURN, 0.0)}
    one, other = {first: FORCE}, {second: FORCE}
    turning, pair = {first: (0.0, 0.0, 0.0, TURN, 0.0, 0.0)}, {first: (0.0, 0.0, 0.0, 0.0, TURN, 50.0), second: FORCE}
    rng = np.random.default_rng(3)
    away = State(0.1 * rng.standard_normal(body.core.modes), rng.standard_normal(body.core.modes))
    state = body.rest()
    for start, end in ((one, None), (other, None), (turning, None), (still, pair), (still, turning), (heavy, one)):
        fresh = body_of(kind)
        expected, _ = fresh.step_with_work(state, start, 2e-3, end)
        found, _ = body.step_with_work(state, start, 2e-3, end)
        np.testing.assert_array_equal(found.q, expected.q)
        np.testing.assert_array_equal(found.v, expected.v)
        state = found
        for asked in (found, away, found) if asks else ():
            fresh = body_of(kind)
            for mine, its in zip(body.motion_and_rates(asked), fresh.motion_and_rates(asked), strict=True):
                np.testing.assert_array_equal(mine, its)
        if asks:
            # The next step starts at its own state, not where the body was asked about last.
            elsewhere, _ = body.step_with_work(away, one, 1e-3)
            np.testing.assert_array_equal(elsewhere.q, body_of(kind).step_with_work(away, one, 1e-3)[0].q)


@pytest.mark.parametrize("kind", ["frames", "second order", "deformed mass", "second order, deformed mass"])
def test_the_error_of_a_step_is_what_the_change_of_all_forces_does_beyond_their_mean(kind):
    """Of a short step h²/12 of that change, in the energy norm: with all energy there is, and forces of inertia."""
    body, step = body_of(kind, ONE_STEP, damped=False), 1e-4
    loads, omega = body.loads(dict.fromkeys(body.model.interface_names, FORCE)), body.model.angular_frequency
    inputs = loads.packed(True)
    rng = np.random.default_rng(8)
    for q, v in ((0.0, 20.0), (0.05, 20.0), (0.05, 0.0), (0.05, 300.0)):
        start = State(q * rng.standard_normal(omega.size), v * rng.standard_normal(omega.size))
        end, work = body.step_with_work(start, loads, step)
        before, after = (acceleration(body, inputs, at.q, at.v) + omega**2 * at.q for at in (start, end))
        expected = step**2 / 12.0 * np.linalg.norm(omega * (after - before)) / np.linalg.norm(phase(body, end))
        assert work.error == pytest.approx(expected, rel=0.01)


def test_a_step_settles_in_a_few_rounds_where_all_rates_change_the_momentum():
    """Each round goes by the mass where the step is foreseen to end."""
    body = body_of("deformed mass", StepLimits(tolerance=1e9))
    for seed in range(8):
        _, start = np.random.default_rng(seed).standard_normal((2, body.core.modes))
        _, work = body.step_with_work(State(np.zeros_like(start), 300.0 * start), {}, 3e-4)
        assert work.substeps == 1
        assert work.iterations <= 10


@pytest.mark.parametrize("step", [1e-7, 1e-5])
@pytest.mark.parametrize("kind", KINDS)
def test_a_step_far_shorter_than_any_period_answers_by_half_its_square(kind, step):
    """In two or three rounds, although what forces do over so short a way is below the round-off of places."""
    body = body_of(kind)
    loads = body.loads(dict.fromkeys(body.model.interface_names, FORCE))
    expected = np.linalg.solve(body.mass(body.rest()), body.forces(body.rest(), loads.packed(True)))
    found, work = body.step_with_work(body.rest(), loads, step)
    assert work.substeps == 1
    assert work.iterations <= 3
    assert np.linalg.norm(found.q - 0.5 * step**2 * expected) < 1e-4 * 0.5 * step**2 * np.linalg.norm(expected)
    assert np.linalg.norm(found.v - step * expected) < 1e-3 * step * np.linalg.norm(expected)


@pytest.mark.parametrize("kind", ["frames", "second order", "cut"])
@pytest.mark.parametrize("size", [1.0, -2.0])
def test_each_component_of_a_load_moves_the_body_in_a_step_of_its_own(kind, size):
    """From a bent shape at rest: what moves it in a short step beyond its own forces is that load's modal force."""
    body, step = body_of(kind, ONE_STEP, damped=False), 1e-6
    q = 0.1 * np.random.default_rng(1).standard_normal(body.core.modes)
    state, names = State(q, np.zeros(q.size)), body.model.interface_names
    unloaded = body.step(state, {}, step).v
    for name in names:
        for load in size * np.eye(6):
            loads = {name: tuple(load)}
            push = body.forces(state, body.loads(loads).packed(True)) - body.forces(state, body.loads({}).packed(True))
            found = (body.step(state, loads, step).v - unloaded) / step
            np.testing.assert_allclose(found, push, rtol=0.0, atol=1e-4 * np.linalg.norm(push))


def test_moments_may_leave_a_body_stable_whose_tangent_is_indefinite_in_its_symmetric_part():
    body = FlexibleBody(body_of_everything(26, modes=3, frames=2), Method.FRAMES)
    moments = 1000.0 * np.random.default_rng(26).standard_normal((2, 3))
    loads = body.loads({name: (0.0, 0.0, 0.0, *m) for name, m in zip(body.model.interface_names, moments, strict=True)})
    inputs, omega = loads.packed(True), body.model.angular_frequency
    state = body.static(loads)
    tangent = body.tangent(state, inputs) / np.outer(omega, omega)
    assert np.linalg.eigvalsh(0.5 * (tangent + tangent.T))[0] < -1.0
    assert np.min(np.linalg.eigvals(tangent).real) > 0.1
    # A slow motion about it stays there.
    assert np.linalg.norm(omega**2 * state.q - body.forces(state, inputs)) < 1e-6 * np.linalg.norm(omega**2 * state.q)


def test_to_second_order_the_parts_of_a_cut_body_bend_by_coordinates_of_their_own():
    """Two parts of two frames each, three of six coordinates each: forces and tangents as of all coordinates."""
    model = body_of_everything(11, modes=6, frames=4)
    rng = np.random.default_rng(11)
    parent, carrier = np.array([GROUND, 0, GROUND, 2]), np.array([1, 3])
    turns = [np.linalg.qr(rng.standard_normal((6, 3)))[0] for _ in range(2)]
    own = [turn @ turn.T for turn in turns]

    def frames(values):
        return np.stack([values[k] @ own[k // 2] for k in range(4)])

    def ports(values):
        return np.stack([values[k] @ own[k] for k in range(2)])

    def bent(values):
        return np.stack([own[k] @ values[i] @ own[k] for i, k in enumerate((0, 0, 1, 1, 0, 1, 0, 0, 1, 1))])

    masses = replace(model.masses, displacement=frames(model.masses.displacement))
    second = replace(model.second, displacement=bent(model.second.displacement), rotation=bent(model.second.rotation))
    model = replace(
        model,
        frame_parent=parent,
        interface_frame=carrier,
        interface_displacement=ports(model.interface_displacement),
        interface_rotation=ports(model.interface_rotation),
        joint_displacement=frames(model.joint_displacement),
        joint_rotation=frames(model.joint_rotation),
        frame_rotation=frames(model.frame_rotation),
        masses=masses,
        second=second,
        # Its shapes would bend both parts by all coordinates.
        membrane=None,
    )
    body, reference = FlexibleBody(model, Method.SECOND_ORDER), Reference(model, Method.SECOND_ORDER)
    inputs = body.loads({"port_0": (*FORCE, 3.0, -2.0, 4.0), "port_1": FORCE}, (1.0, 2.0, 3.0)).packed(True)
    q, way = 0.2 * rng.standard_normal(6), rng.standard_normal(6)
    force, tangent = reference.force(inputs, q), reference.tangent(inputs, q, way)
    np.testing.assert_allclose(body.forces(State(q, q), inputs), force, rtol=0.0, atol=1e-11 * np.abs(force).max())
    found = body.tangent(State(q, q), inputs) @ way
    np.testing.assert_allclose(found, tangent, rtol=0.0, atol=1e-10 * np.abs(tangent).max())
    assert read_image(compile_program(model, Method.SECOND_ORDER)).arrays["extent"].tolist() == [3, 3]
    assert np.linalg.norm(force - FlexibleBody(model, Method.FRAMES).forces(State(q, q), inputs)) > 1.0


def stiff_ties(factor=1e4):
    """A cut body whose ties are far stiffer than its material, under loads that turn its frames."""
    model = model_of("cut", damped=False)
    model = replace(model, ties=replace(model.ties, stiffness=factor * model.ties.stiffness))
    joined = Reference(model, Method.FRAMES).joined()
    # Modes hold the ties as they pull at rest.
    squares, turn = np.linalg.eigh(np.diag(model.angular_frequency**2) + joined)
    ties = replace(model.ties, displacement=model.ties.displacement @ turn, rotation=model.ties.rotation @ turn)
    moved = {
        name: getattr(model, name) @ turn
        for name in (
            "interface_displacement",
            "interface_rotation",
            "joint_displacement",
            "joint_rotation",
            "frame_rotation",
        )
    }
    masses = replace(model.masses, displacement=model.masses.displacement @ turn)
    return replace(model, angular_frequency=np.sqrt(squares), ties=ties, masses=masses, second=None, **moved)


@pytest.mark.parametrize(("factor", "share", "most"), [(1e2, 1.0, 6), (1e2, 4.0, 30), (1e4, 4.0, 5)])
def test_stiff_ties_turned_by_a_load_are_in_equilibrium_after_a_few_rounds(factor, share, most):
    body = FlexibleBody(stiff_ties(factor), Method.FRAMES)
    loads = body.loads(dict.fromkeys(body.model.interface_names, tuple(share * f for f in FORCE)))
    state = body.static(loads)
    inputs = loads.packed(True)
    off = body.model.angular_frequency**2 * state.q - body.forces(state, inputs)
    assert np.linalg.norm(off / body.model.angular_frequency) < 1e-6 * np.linalg.norm(phase(body, state))
    _, _, _, rounds = body.core.static(inputs)
    assert rounds <= most


@pytest.mark.parametrize(("step", "most"), [(1e-3, 2e-5), (3e-3, 1e-3)])
def test_a_cut_body_that_hardly_turns_is_propagated_exactly(step, most):
    """Its modes follow their own vibration, however their forces change: that is no error."""
    body = body_of("cut", ONE_STEP, damped=False)
    q = 1e-7 * np.random.default_rng(1).standard_normal(body.core.modes)
    _, work = body.step_with_work(State(q, 0.0 * q), {}, step)
    assert work.error < most


def test_steps_that_resolve_no_stiff_tie_settle_in_a_few_rounds():
    body = FlexibleBody(stiff_ties(), Method.FRAMES)
    loads = body.loads(dict.fromkeys(body.model.interface_names, FORCE))
    state, rounds, steps = (
        body.static({name: tuple(-0.5 * np.array(FORCE)) for name in body.model.interface_names}),
        0,
        0,
    )
    for _ in range(30):
        state, work = body.step_with_work(state, loads, 5e-4)
        rounds, steps = rounds + work.iterations, steps + work.substeps
    assert rounds <= 5 * steps
    assert steps <= 150


def test_compliance_of_stiffness_by_load_counts_what_a_load_does_to_the_bent_body():
    """Symmetric stiffness of every load: at equilibrium a little more of one moves the step's end so."""
    model = body_of_everything(5, frames=4)
    model = replace(model, stiffness_by_load=20.0 * model.stiffness_by_load)
    body = FlexibleBody(model, Method.STIFFNESS_BY_LOAD, limits=ONE_STEP)
    names, step, size = body.model.interface_names, 2e-3, 1e-3
    loads = {name: np.array([*FORCE, 0.0, 0.0, 0.0]) / 20.0 for name in names}
    start = body.static(loads)
    found = body.compliance(start, body.loads(loads).packed(True), step, [0, 1])
    for column in range(12):
        extra = size * np.eye(12)[column].reshape(2, 6)
        ends = [
            body.motion(body.step(start, {n: loads[n] + sign * e for n, e in zip(names, extra, strict=True)}, step))
            for sign in (1.0, -1.0)
        ]
        change = (ends[0] - ends[1]).reshape(2, 6)[:, :3] / (2.0 * size)
        expected = found[:, column].reshape(2, 6)[:, :3]
        np.testing.assert_allclose(expected, change, rtol=0.0, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("short", ["q", "v", "loads"])
def test_a_step_of_arrays_that_are_too_short_is_an_error(short):
    core = Core(compile_program(beam_body(2, 2), Method.FRAMES))
    given = {"q": np.zeros(core.modes), "v": np.zeros(core.modes), "loads": np.zeros(core.loads)}
    with pytest.raises((ValueError, OptionError), match=r"reshape|inhomogeneous|expected 6"):
        core.step(**given | {short: given[short][:-1]}, step=1e-3)


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
def test_a_free_body_whose_mass_is_not_positive_is_refused(method):
    """Random masses leave it none round an axis: the error of such a step was told to be nothing."""
    model = body_of_everything(1, modes=10, frames=2, interfaces=2, free=True)
    core = Core(compile_program(model, method, Mass.CONFIGURATION))
    q = np.concatenate([np.zeros(6), 0.05 * np.random.default_rng(0).standard_normal(core.modes - 6)])
    answer, *_ = core.step(q, np.zeros(core.modes), np.zeros(core.loads), 1e-3)
    assert answer.name == "BEYOND_MASS"
