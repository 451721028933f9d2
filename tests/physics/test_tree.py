"""Kinematics and loads of the tree of frames against difference quotients and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from bodies import COROTATED, LINEAR, random_body, turning_body, with_second_order
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import GROUND, Masses, WholeFrame
from flexfmu.model.rotations import skew
from turns import exponential

H = 1e-5
# Rotations of a few tenths of a radian in every node, near a full one in some: nothing is small.
SIZES = [0.0, 0.02, 0.4]


def central(function, q):
    """Derivative of an array-valued function, last axis over q."""
    return np.stack([(function(q + H * unit) - function(q - H * unit)) / (2.0 * H) for unit in np.eye(q.size)], axis=-1)


MASS = 2.0
# Those whose loads act on the deformed body: forces then have a potential.
CONSERVATIVE = [Method.FRAMES, Method.SECOND_ORDER, Method.FLOATING_FRAME]
# Those in which places depend on q other than linearly.
TURNED = [*CONSERVATIVE, Method.HALF_ROTATION, Method.MODAL_ROTATION]


@pytest.fixture(params=["branched", "with an interface on the ground"])
def body(request):
    """A tree with a mass on one frame, for loads of every kind."""
    lump = Masses(np.array([MASS]), [[0.2, 0.3, -0.1]], np.random.default_rng(2).standard_normal((1, 3, 6)), [1])
    whole = WholeFrame(np.full(3, 0.1), *np.random.default_rng(9).standard_normal((3, 3, 6)))
    if request.param == "branched":
        return with_second_order(random_body(masses=lump, whole=whole), 0.1)
    return with_second_order(random_body(3, interface_frame=(2, GROUND, 0), masses=lump, whole=whole), 0.1)


@pytest.fixture(params=SIZES)
def q(request, body):
    return request.param * np.random.default_rng(5).standard_normal(body.mode_count)


@pytest.fixture
def loads():
    """Force and moment at every interface, and an acceleration."""
    return np.random.default_rng(6).standard_normal(21)


def only(loads, which):
    """Forces or moments alone."""
    kept = loads.copy()
    wrench = kept[:18].reshape(3, 2, 3)
    if which == "forces":
        wrench[:, 1] = 0.0
    if which == "moments":
        wrench[:, 0] = kept[18:] = 0.0
    return kept


def at(q):
    return State(q, np.zeros_like(q))


def jacobians(flexible, q):
    """Of the interfaces' places and spins, each (3, 3, m): rates under unit rates of each coordinate."""
    rates = [flexible.rates(State(q, unit)) for unit in np.eye(q.size)]
    return (np.stack([rate[k] for rate in rates], axis=-1) for k in (0, 1))


@pytest.mark.parametrize("method", TURNED)
def test_jacobian_of_positions_is_their_derivative(body, method, q):
    flexible = FlexibleBody(body, method)
    expected = central(lambda q: flexible.response(at(q)).displacement, q)
    np.testing.assert_allclose(next(jacobians(flexible, q)), expected, atol=2e-8)


@pytest.mark.parametrize("method", TURNED)
def test_jacobian_of_rotations_gives_the_angular_velocity(body, method, q):
    flexible = FlexibleBody(body, method)
    _, spin = jacobians(flexible, q)
    rotation = flexible.core.nodes_at(q)[1]
    rate = central(lambda q: flexible.core.nodes_at(q)[1], q)
    nodes = slice(flexible.core.frames, flexible.core.frames + 3)
    angular = np.einsum("kijm,klj->kilm", rate[nodes], rotation[nodes])
    expected = np.moveaxis(skew(np.moveaxis(spin, 1, -1)), 1, -1)
    np.testing.assert_allclose(angular, expected, atol=2e-8)


@pytest.mark.parametrize("method", CONSERVATIVE)
def test_forces_are_the_gradient_of_their_work(body, method, q, loads):
    flexible, forces = FlexibleBody(body, method), only(loads, "forces")

    def work(q):
        place = flexible.core.nodes_at(q)[0][flexible.core.frames :]
        return np.vdot(forces[:18].reshape(3, 2, 3)[:, 0], place[:3]) - MASS * forces[18:] @ place[3]

    found = flexible.forces(at(q), forces)
    np.testing.assert_allclose(found, central(work, q), atol=1e-7)
    assert np.linalg.norm(found) > 1.0


@pytest.mark.parametrize("method", CONSERVATIVE)
def test_virtual_work_of_forces_and_moments_is_that_of_the_modal_force(body, method, q, loads):
    flexible = FlexibleBody(body, method)
    translation, spin = jacobians(flexible, q)
    wrench = loads[:18].reshape(3, 2, 3)
    expected = np.einsum("ki,kim->m", wrench[:, 0], translation) + np.einsum("ki,kim->m", wrench[:, 1], spin)
    on_interfaces = np.append(loads[:18], np.zeros(3))
    np.testing.assert_allclose(flexible.forces(at(q), on_interfaces), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("method", TURNED)
@pytest.mark.parametrize("which", ["forces", "moments", "both"])
def test_load_stiffness_is_the_derivative_of_the_modal_force(body, method, q, loads, which):
    flexible, given = FlexibleBody(body, method), only(loads, which)
    expected = central(lambda q: flexible.forces(at(q), given), q)
    found = np.diag(body.angular_frequency**2) - flexible.tangent(at(q), given)
    np.testing.assert_allclose(found, expected, atol=3e-7)
    if which == "forces" or method in CONSERVATIVE:
        assert np.linalg.norm(found) > 1.0


@pytest.mark.parametrize("method", CONSERVATIVE)
def test_load_stiffness_is_symmetric_under_forces_and_unsymmetric_under_moments(body, method, q, loads):
    flexible, square = FlexibleBody(body, method), np.diag(body.angular_frequency**2)
    symmetric = flexible.tangent(at(q), only(loads, "forces")) - square
    np.testing.assert_allclose(symmetric, symmetric.T, atol=1e-13 * np.linalg.norm(square))
    by_moment = flexible.tangent(at(q), only(loads, "moments")) - square
    assert np.linalg.norm(by_moment - by_moment.T) > 0.1 * np.linalg.norm(by_moment)


def test_a_pair_of_forces_is_the_moment_of_its_arm():
    """Two interfaces that one frame carries rigidly, pulled opposite ways: the moment about what the arm has become."""
    model = turning_body(np.array([1.0, 2.0, 2.0]) / 3.0, np.zeros(3))
    flexible, q = FlexibleBody(model, COROTATED), np.array([0.8, 0.0])
    place = model.interface_point + flexible.response(at(q)).displacement
    force, pair = np.array([3.0, -4.0, 5.0]), np.zeros((2, 18))
    pair[0, :3], pair[0, 6:9] = force, -force
    pair[1, 3:6] = np.cross(place[0] - place[1], force)
    moment = [flexible.forces(at(q), each)[0] for each in pair]
    assert moment[0] == pytest.approx(moment[1], rel=1e-12)
    assert abs(moment[0]) > 0.5


def test_interface_rates_are_the_rates_of_displacement_and_rotation(body):
    flexible = FlexibleBody(body, COROTATED)
    rng = np.random.default_rng(8)
    q, v = 0.2 * rng.standard_normal((2, body.mode_count))
    velocity, angular = flexible.rates(State(q, v))

    def after(t):
        return flexible.response(State(q + t * v, v))

    ahead, behind = after(H), after(-H)
    np.testing.assert_allclose(velocity, (ahead.displacement - behind.displacement) / (2 * H), atol=1e-8)
    turn = (exponential(ahead.rotation) - exponential(behind.rotation)) / (2 * H)
    here = exponential(after(0.0).rotation)
    np.testing.assert_allclose(turn @ np.swapaxes(here, 1, 2), skew(angular), atol=1e-8)


@pytest.mark.parametrize("degrees", [1.0, 60.0, 170.0])
def test_a_body_that_turns_rigidly_moves_on_an_exact_circle(degrees):
    axis, pivot = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([0.2, -0.1, 0.4])
    model = turning_body(axis, pivot)
    angle = np.radians(degrees)
    turned = FlexibleBody(model, COROTATED).response(State(np.array([angle, 0.0]), np.zeros(2)))
    arm = model.interface_point - pivot
    expected = arm @ exponential(angle * axis).T - arm
    np.testing.assert_allclose(turned.displacement, expected, atol=1e-13)
    np.testing.assert_allclose(turned.rotation, np.broadcast_to(angle * axis, (3, 3)), atol=1e-13)


def test_linear_kinematics_leave_the_circle_along_its_tangent():
    axis, pivot = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    model = turning_body(axis, pivot)
    angle = np.radians(60.0)
    moved = FlexibleBody(model, LINEAR).response(State(np.array([angle, 0.0]), np.zeros(2)))
    np.testing.assert_allclose(moved.displacement, angle * np.cross(axis, model.interface_point), atol=1e-13)
    radius = np.linalg.norm(model.interface_point[:, :2], axis=1)
    stretched = np.linalg.norm((model.interface_point + moved.displacement)[:, :2], axis=1)
    assert np.all(stretched > 1.4 * radius)


def test_a_rigid_turn_carries_the_elastic_deformation_along():
    axis, pivot = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([0.2, -0.1, 0.4])
    model = turning_body(axis, pivot)
    flexible = FlexibleBody(model, COROTATED)
    angle, elastic = 1.0, 0.3
    bent = flexible.response(State(np.array([0.0, elastic]), np.zeros(2)))
    both = flexible.response(State(np.array([angle, elastic]), np.zeros(2)))
    turn = exponential(angle * axis)
    expected = (model.interface_point + bent.displacement - pivot) @ turn.T + pivot
    np.testing.assert_allclose(model.interface_point + both.displacement, expected, atol=1e-13)
    np.testing.assert_allclose(exponential(both.rotation), turn @ exponential(bent.rotation), atol=1e-13)
    assert np.min(np.linalg.norm(bent.displacement, axis=1)) > 1e-3


def test_without_frames_displacements_are_modal_superposition():
    model = random_body(parents=(), interface_frame=(GROUND,) * 3)
    q = 0.1 * np.random.default_rng(4).standard_normal(model.mode_count)
    response = FlexibleBody(model).response(State(q, np.zeros_like(q)))
    np.testing.assert_allclose(response.displacement, model.interface_displacement @ q, atol=1e-15)
    np.testing.assert_allclose(response.rotation, model.interface_rotation @ q, atol=1e-14)


def test_linear_kinematics_take_no_notice_of_the_frames():
    framed = random_body()
    bare = replace(
        framed,
        interface_frame=np.full(3, GROUND),
        frame_names=(),
        frame_parent=np.zeros(0, dtype=int),
        joint_point=np.zeros((0, 3)),
        **{n: np.zeros((0, 3, 6)) for n in ("joint_displacement", "joint_rotation", "frame_rotation")},
    )
    state = State(0.3 * np.random.default_rng(4).standard_normal(6), np.zeros(6))
    a, b = (FlexibleBody(model, LINEAR).response(state) for model in (framed, bare))
    np.testing.assert_array_equal(a.displacement, b.displacement)
    np.testing.assert_array_equal(a.rotation, b.rotation)


def test_one_frame_turns_all_that_hangs_on_it():
    model = random_body(2, parents=(GROUND,), interface_frame=(0, 0))
    q = 0.4 * np.random.default_rng(4).standard_normal(model.mode_count)
    response = FlexibleBody(model, COROTATED).response(State(q, np.zeros_like(q)))
    theta = model.frame_rotation[0] @ q
    joint = model.joint_displacement[0] @ q
    turn = exponential(theta)
    for k in range(2):
        arm = model.interface_point[k] - model.joint_point[0]
        # What the modes say beyond the frame's own motion is the deformation seen from the frame.
        local = model.interface_displacement[k] @ q - joint - np.cross(theta, arm)
        position = model.joint_point[0] + joint + turn @ (arm + local)
        np.testing.assert_allclose(model.interface_point[k] + response.displacement[k], position, atol=1e-14)
        twist = turn @ exponential(model.interface_rotation[k] @ q - theta)
        np.testing.assert_allclose(exponential(response.rotation[k]), twist, atol=1e-14)


def test_small_motions_are_modal_superposition_to_second_order():
    model = random_body()
    corotated, linear = FlexibleBody(model, COROTATED), FlexibleBody(model, LINEAR)
    direction = np.random.default_rng(4).standard_normal(model.mode_count)

    def gap(size):
        state = State(size * direction, np.zeros_like(direction))
        a, b = corotated.response(state), linear.response(state)
        return np.linalg.norm(a.displacement - b.displacement), np.linalg.norm(a.rotation - b.rotation)

    for coarse, fine in zip(gap(1e-3), gap(5e-4), strict=True):
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.02)


def test_rotation_within_frames_is_that_of_the_material_against_its_frame():
    model = random_body()
    body, state = FlexibleBody(model, COROTATED), State(0.05 * np.random.default_rng(4).standard_normal(6), np.zeros(6))
    found = np.zeros(5)
    np.maximum.at(found, body.core.turning_frame, body.core.rotations(state.q))
    frame = model.frame_rotation @ state.q
    for s in range(5):
        sections = [model.joint_rotation[s] @ state.q]
        sections += [model.joint_rotation[c] @ state.q for c in range(5) if model.frame_parent[c] == s]
        sections += [model.interface_rotation[i] @ state.q for i in range(3) if model.interface_frame[i] == s]
        largest = max(np.linalg.norm(section - frame[s]) for section in sections)
        assert found[s] == pytest.approx(largest, rel=1e-12)
    assert body.largest_rotation(state) == pytest.approx(found.max(), rel=1e-15)
