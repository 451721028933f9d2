"""Loads that turn with their interface: deflections and flutter of a cantilever under a follower force, and flight."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from bodies import Beam, body_of_everything
from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import InterfaceTable
from flexfmu.files.basics import EquilibriumError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.program.variable_table import variable_table
from references import BEAM
from turns import exponential

BENDING = Beam().bending_stiffness


def following(model):
    return replace(model, following_interfaces=model.interface_names)


@pytest.fixture(scope="module")
def cantilever(bodies):
    """The clamped beam of the demo with loads that turn with its tip."""

    def make(frames, modes=10, **reduction):
        given = bodies.config(BEAM).reduction.model_copy(update={"modes": modes, "second_order": True} | reduction)
        return following(bodies.beam(frames=frames, reduction=given).model)

    return make


def elastica(load):
    """Tip (x, y) over the length of an inextensible cantilever under a transverse follower force load EI/L²."""

    def rates(s, y):
        # Angle, curvature, place. The force stays normal to the tip: θ'' = −load cos(θ(1) − θ).
        return np.array([y[1], -load * np.cos(y[4] - y[0]), np.cos(y[0]), np.sin(y[0]), np.zeros_like(s)])

    def ends(a, b):
        return np.array([a[0], a[2], a[3], b[1], b[4] - b[0]])

    s = np.linspace(0.0, 1.0, 101)
    guess = np.array([0.5 * load * s, 0.5 * load * (1.0 - s), s, 0.2 * load * s, np.full_like(s, 0.5 * load)])
    solved = solve_bvp(rates, ends, s, guess, tol=1e-8)
    assert solved.success
    return solved.y[2:4, -1]


@pytest.mark.slow
@pytest.mark.parametrize(("method", "frames", "error"), [(Method.SECOND_ORDER, 2, 5e-3), (Method.FRAMES, 8, 5e-3)])
@pytest.mark.parametrize("load", [1.0, 2.0])
def test_a_transverse_follower_force_bends_a_cantilever_as_the_elastica_says(cantilever, method, frames, error, load):
    body = FlexibleBody(cantilever(frames), method)
    moved = body.response(body.static({"tip": [0.0, load * BENDING, 0.0]})).displacement[0]
    expected = elastica(load) - [1.0, 0.0]
    assert np.linalg.norm(moved[:2] - expected) < error * np.linalg.norm(expected)
    # A force of fixed direction is another load.
    dead = FlexibleBody(replace(body.model, following_interfaces=()), method)
    other = dead.response(dead.static({"tip": [0.0, load * BENDING, 0.0]})).displacement[0]
    assert np.linalg.norm(moved - other) > 0.05 * np.linalg.norm(moved)


def largest_growth(body, load, step=2e-4, time=0.12):
    """Rate (1/s) at which the envelope of a small vibration grows under a push along the tip's own axis."""
    state, sizes = State(np.zeros(body.model.mode_count), np.full(body.model.mode_count, 1e-6)), []
    for _ in range(round(time / step)):
        state = body.step(state, {"tip": [-load * BENDING, 0.0, 0.0]}, step)
        sizes.append(abs(body.response(state).displacement[0][1]))
    halves = np.split(np.array(sizes), 2)
    return np.log(halves[1].max() / halves[0].max()) / (0.5 * time)


@pytest.mark.parametrize(("method", "frames"), [(Method.SECOND_ORDER, 2), (Method.FRAMES, 8)])
def test_a_column_under_a_follower_force_flutters_at_beck_s_load(cantilever, method, frames):
    """M. Beck, ZAMP 3 (1952) 225: 20.05 EI/L². Vibrations grow beyond, none below; there is no buckling."""
    body = FlexibleBody(cantilever(frames), method, damping_scale=0.0)
    rest = State(np.zeros(body.model.mode_count), np.zeros(body.model.mode_count))

    def margin(load):
        return body.stability(rest, np.array([-load * BENDING, 0.0, 0.0, 0.0, 0.0, 0.0]))[0]

    low, high = 15.0, 25.0
    assert margin(low) > 0.0 > margin(high)
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if margin(middle) > 0.0 else (low, middle)
    assert low == pytest.approx(20.05, rel=0.025)
    # A tenth beyond, vibrations double in 5 ms; a tenth below, their size stays.
    assert abs(largest_growth(body, 0.9 * low)) < 15.0
    assert largest_growth(body, 1.1 * low) == pytest.approx(139.0, rel=0.1)
    # What is told is the rate of growth over the lowest frequency; dampers that all modes share take half their rate.
    omega = body.model.angular_frequency
    assert -omega[0] * margin(1.1 * low) == pytest.approx(139.0, rel=0.1)
    damped = FlexibleBody(replace(body.model, damping_ratio=60.0 / omega), method)
    force = np.array([-1.1 * low * BENDING, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert -omega[0] * damped.stability(rest, force)[0] == pytest.approx(139.0 - 60.0, rel=0.15)


@pytest.mark.slow
def test_flutter_is_told_by_the_watch_and_a_column_far_above_euler_s_load_is_not(tmp_path, cantilever):
    model = replace(cantilever(2), method=Method.SECOND_ORDER)
    for load, told in ((10.0, False), (21.0, True)):
        driven = Driven(model, tmp_path)
        driven.set(**{"tip.force.x": -load * BENDING})
        for _ in range(3):
            assert driven.taken(1e-4)
        assert any("critical load" in text for _, text in driven.log) is told
    # A force of fixed direction cannot be borne there.
    dead = FlexibleBody(replace(model, following_interfaces=()))
    with pytest.raises(EquilibriumError):
        dead.static({"tip": [-10.0 * BENDING, 0.0, 0.0]})


@pytest.mark.parametrize(("method", "frames"), [(Method.SECOND_ORDER, 2), (Method.FRAMES, 8)])
def test_a_moment_about_an_axis_that_stays_is_the_same_whether_it_follows_or_not(cantilever, method, frames):
    """In the plane a moment turns about its own axis: of the loads it is the only one, in a step and at rest."""
    body = FlexibleBody(cantilever(frames), method)
    dead = FlexibleBody(replace(body.model, following_interfaces=()), method)
    state, moment = body.rest(), {"tip": [0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * BENDING]}
    expected = state
    for _ in range(20):
        state, expected = body.step(state, moment, 1e-3), dead.step(expected, moment, 1e-3)
        np.testing.assert_allclose(
            body.response(state).displacement, dead.response(expected).displacement, rtol=1e-9, atol=1e-10
        )
    assert abs(body.response(state).displacement[0, 1]) > 0.05


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER, Method.FLOATING_FRAME, Method.FRAMES_STIFFNESS])
@pytest.mark.parametrize("free", [False, True])
def test_modal_forces_are_those_of_the_turned_loads_and_the_tangent_is_their_derivative(method, free, random):
    model = body_of_everything(3, modes=9, free=free)
    if free and method is Method.FRAMES_STIFFNESS:
        pytest.skip("a free body has no stress of a load by itself")
    body, dead = FlexibleBody(following(model), method), FlexibleBody(model, method)
    inputs = random.standard_normal(6 * model.interface_count + 3)
    q, way = 0.3 * random.standard_normal((2, model.mode_count))
    rotation = body.core.nodes_at(q)[1][body.core.frames : body.core.frames + model.interface_count]

    def turned():
        loads = inputs.copy()
        wrench = loads[: 6 * model.interface_count].reshape(-1, 2, 3)
        wrench[:] = np.einsum("kij,kcj->kci", rotation, wrench)
        return loads

    if method is not Method.FRAMES_STIFFNESS:
        # Stiffness by load goes by the loads on the undeformed body's axes.
        np.testing.assert_allclose(
            body.forces(State(q, q), inputs), dead.forces(State(q, q), turned()), rtol=1e-11, atol=1e-11
        )
    if free:
        # Rates of rigid motions are no derivatives away from rest.
        q = np.concatenate([np.zeros(model.rigid_count), q[model.rigid_count :]])
    h = 1e-5
    ends = [body.forces(State(q + sign * h * way, q), inputs) for sign in (1.0, -1.0)]
    slope = model.angular_frequency**2 * way - body.tangent(State(q, q), inputs) @ way
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2.0 * h), rtol=1e-6, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
@pytest.mark.parametrize("seed", range(3))
def test_each_component_of_a_load_follows_whichever_interface_it_acts_on(method, seed):
    model = body_of_everything(seed, interfaces=3)
    body, dead = FlexibleBody(following(model), method), FlexibleBody(model, method)
    q = 0.3 * np.random.default_rng(seed).standard_normal(model.mode_count)
    rotation, differ = body.core.nodes_at(q)[1][body.core.frames :], 0
    for alone in np.eye(6 * model.interface_count, 6 * model.interface_count + 3):
        turned = alone.copy()
        wrench = turned[: 6 * model.interface_count].reshape(-1, 2, 3)
        wrench[:] = np.einsum("kij,kcj->kci", rotation[: model.interface_count], wrench)
        found, expected = body.forces(State(q, q), alone), dead.forces(State(q, q), turned)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)
        differ += np.linalg.norm(found - dead.forces(State(q, q), alone)) > 1e-2
    assert differ == 6 * model.interface_count


@pytest.mark.slow
@pytest.mark.parametrize("engine", [("root",), ("tip",), ("root", "tip")])
@pytest.mark.parametrize("mass", [Mass.CONSTANT, Mass.CONFIGURATION])
def test_a_rocket_that_pushes_itself_flies_a_circle(bodies, mass, engine):
    """A force along a stiff body, on whichever ends follow, and a moment: it turns at the rate that it gains.

    Closed form of a rigid body: ψ = ½ αt², v = (F/m) ∫ (cos ψ, sin ψ) dt.
    """
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    given = bodies.config(BEAM).reduction.model_copy(update={"modes": 4, "inertia": True, "second_order": True})
    model = bodies.beam(free=True, support=[], interface=ends, frames=1, reduction=given).model
    model = replace(model, following_interfaces=engine)
    body = FlexibleBody(model, Method.SECOND_ORDER, mass, damping_scale=100.0, limits=StepLimits(5e-3))
    density, side = 7850.0, 0.03
    weight, inertia = density * side**2, density * side**2 * (1.0 + side**2) / 12.0
    force, alpha, end = 5.0, 2.0, 4.0
    state, step = body.rest(), 0.02
    for _ in range(round(end / step)):
        state = body.step(state, {engine[-1]: [force, 0.0, 0.0, 0.0, 0.0, alpha * inertia]}, step)
    t = np.linspace(0.0, end, 40001)
    angle = 0.5 * alpha * t**2
    pace = force / weight * np.array([np.cos(angle), np.sin(angle)])
    speed = np.concatenate([[[0.0], [0.0]], np.cumsum(0.5 * (pace[:, 1:] + pace[:, :-1]) * np.diff(t), axis=1)], axis=1)
    centre = np.trapezoid(speed, t, axis=1)
    places = model.interface_point + body.response(state).displacement
    turned = exponential(body.response(state).rotation[1])
    np.testing.assert_allclose(turned[:2, 0], [np.cos(angle[-1]), np.sin(angle[-1])], atol=0.02)
    moved = places.mean(axis=0) - model.interface_point.mean(axis=0)
    np.testing.assert_allclose(moved[:2], centre, rtol=0.01)


@pytest.mark.slow
def test_a_load_that_follows_is_asked_for_in_the_body_file_and_kept_in_the_modal_file(tmp_path, bodies):
    config = bodies.config(BEAM)
    given = config.model_dump(exclude_unset=True) | {"frames": 1, "reduction": {"modes": 2}}
    given["interface"][0]["follows"] = True
    model = reduce_body(type(config).model_validate(given), Reporter())
    assert model.following_interfaces == ("tip",)
    write_modal_file(model, tmp_path / "body.h5")
    assert read_modal_file(tmp_path / "body.h5").following_interfaces == ("tip",)
    words = {variable.name: variable.description for variable in variable_table(model)}
    assert "own x axis" in words["tip.force.x"]
    assert "global x axis" in words["tip.displacement.x"]
