"""One turning coordinate on springs that frames carry: closed forms of their moment, stiffness, energy and damping.

A rigid body turns by θ about z on springs at three levers of length r along the axes. Two of the levers turn, each to a
stretch of 2 r sin(θ/2): the springs hold 2 k r² (1 − cos θ), resist with 2 k r² sin θ, and give way by 2 k r² cos θ.
"""

from dataclasses import replace

import numpy as np
import pytest

from bodies import random_body, random_ties
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.model.reduced_body import GROUND, Ties
from flexfmu.reduction.cut import joining

INERTIA, SPRING, LEVER = 0.5, 4000.0, 0.1
# Of all springs against a small turn, N m/rad.
STIFFNESS = 2.0 * SPRING * LEVER**2
SHAPES = (
    *("interface_displacement", "interface_rotation"),
    *("joint_displacement", "joint_rotation", "frame_rotation"),
)


def turning(shape, squares, ratio, ends):
    """Frames that turn about z by `shape` (frames, m) q, tied to each other or to the ground; ω² = `squares` (m,)."""
    frames, modes = shape.shape
    body = random_body(parents=(GROUND,) * frames, interface_frame=(ends[0],), modes=modes)
    still = np.zeros((frames, 3, modes))
    spin = still.copy()
    spin[:, 2] = shape
    rotation = np.stack([spin[end] if end != GROUND else 0.0 * spin[0] for end in ends])[None]
    ties = Ties(
        np.array([ends]),
        np.zeros((1, 2, 3)),
        np.zeros((1, 2, 3, modes)),
        rotation,
        np.full((1, 3), SPRING),
        LEVER * np.eye(3)[None],
    )
    return replace(
        body,
        angular_frequency=np.sqrt(squares),
        damping_ratio=np.full(modes, ratio),
        interface_point=np.zeros((1, 3)),
        interface_displacement=np.zeros((1, 3, modes)),
        interface_rotation=spin[[ends[0]]],
        joint_point=np.zeros((frames, 3)),
        joint_displacement=still,
        joint_rotation=spin,
        frame_rotation=spin,
        ties=ties,
    )


def on_springs(material=0.0, ratio=0.0, joined=False):
    """The body, its one coordinate being √I θ; `material` (N m/rad) turns it back as well.

    The springs pull from the ground, or, `joined`, from a second frame that does not move.
    """
    own = [1.0 / np.sqrt(INERTIA)]
    squares = [(material + STIFFNESS) / INERTIA]
    return turning(np.array([[0.0], own] if joined else [own]), squares, ratio, (1, 0) if joined else (0, GROUND))


def at(angle, speed=0.0):
    return State(np.sqrt([INERTIA]) * angle, np.sqrt([INERTIA]) * speed)


def angle(state):
    return float(state.q[0] / np.sqrt(INERTIA))


@pytest.mark.parametrize("joined", [False, True])
def test_turned_springs_hold_and_resist_by_the_cosine_and_sine_of_the_turn(joined):
    body = FlexibleBody(on_springs(joined=joined))
    assert body.energies(at(0.7))[0] == pytest.approx(STIFFNESS * (1.0 - np.cos(0.7)), rel=1e-12)
    found = body.static({"port_0": [0.0, 0.0, 0.0, 0.0, 0.0, STIFFNESS * np.sin(0.7)]})
    assert body.response(found).rotation[0] == pytest.approx([0.0, 0.0, 0.7], abs=1e-10)


@pytest.mark.parametrize("turn", [0.3, 0.7, 1.2])
@pytest.mark.parametrize("joined", [False, True])
def test_stiffness_of_turned_springs_falls_with_the_cosine_of_the_turn(joined, turn):
    body = FlexibleBody(on_springs(joined=joined))
    moment = np.array([0.0, 0.0, 0.0, 0.0, 0.0, STIFFNESS * np.sin(turn)])
    assert body.stability(at(turn), moment)[0] == pytest.approx(np.cos(turn), rel=1e-9)
    # A step far shorter than the period: the load's own impulse less what the springs give way by, ½ g K cos θ.
    step = 0.2 / body.model.angular_frequency[0]
    expected = (angle(body.step(at(turn), {"port_0": moment * [1, 1, 1, 1, 1, 1.0 + 1e-6]}, step)) - turn) / (
        1e-6 * moment[5]
    )
    found = body.compliance(at(turn), moment, step, [0])[5, 5]
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("joined", [False, True])
def test_what_a_mode_too_fast_for_the_step_loses_is_the_work_of_its_damper(joined):
    """Its constant is 2ζω times the square of the material's share of the stiffness: joints have no damping."""
    material, ratio = 0.6 * STIFFNESS, 0.08
    body = FlexibleBody(on_springs(material, ratio, joined), limits=StepLimits(tolerance=10.0))
    omega = body.model.angular_frequency[0]
    share = material / (material + STIFFNESS) if joined else 1.0
    damper = 2.0 * ratio * omega * INERTIA * share**2
    for step in (2.0 / omega, 5.0 / omega):
        state = at(0.8)
        for _ in range(6):
            before, state = state, body.step(state, {}, step)
            lost = damper * (angle(state) - angle(before)) ** 2 / step
            assert lost > 1e-6 * STIFFNESS
            assert sum(body.energies(before)) - sum(body.energies(state)) == pytest.approx(lost, rel=1e-8)


@pytest.mark.parametrize("joined", [False, True])
def test_a_step_that_does_not_resolve_the_only_vibration_tells_that_its_phase_is_lost(joined):
    body = FlexibleBody(on_springs(0.3 * STIFFNESS, 0.0, joined), limits=StepLimits(tolerance=1e9))
    omega = body.model.angular_frequency[0]
    for start in (at(0.3), at(0.0, 0.3 * omega)):
        told = [body.step_with_work(start, {}, step / omega)[1].error for step in (0.2, 5.0)]
        assert told[0] < 1e-3
        assert 0.5 < told[1] < 1.0


def test_two_bodies_on_a_joint_lose_what_the_material_of_both_takes():
    """C = Ĝ 2ZΩ Ĝᵀ, Ĝ the material's share of the modes' forces: modes that the joint couples are damped together."""
    inertia, material, ratio = np.array([0.5, 0.8]), np.array([0.7, 0.2]) * STIFFNESS, 0.07
    joint = STIFFNESS * np.array([[1.0, -1.0], [-1.0, 1.0]])
    root = np.sqrt(inertia)
    squares, modes = np.linalg.eigh((np.diag(material) + joint) / np.outer(root, root))
    shape = modes / root[:, None]
    share = shape.T @ np.diag(material) @ shape / squares
    damper = (share * (2.0 * ratio * np.sqrt(squares))) @ share.T
    assert abs(damper[0, 1]) > 0.1 * damper[0, 0]
    limits = StepLimits(tolerance=10.0)
    body = FlexibleBody(turning(shape, squares, ratio, (1, 0)), limits=limits)
    step = 2.0 / np.sqrt(squares[0])
    state = State(np.linalg.solve(shape, [0.4, -0.2]), np.zeros(2))
    for _ in range(6):
        before, state = state, body.step(state, {}, step)
        way = state.q - before.q
        lost = way @ damper @ way / step
        assert sum(body.energies(before)) - sum(body.energies(state)) == pytest.approx(lost, rel=1e-8)


def test_springs_between_sections_alone_take_no_energy_whatever_the_damping_of_the_material():
    body = FlexibleBody(on_springs(0.0, 0.1, joined=True))
    omega = body.model.angular_frequency[0]
    state = at(0.5)
    start = sum(body.energies(state))
    for _ in range(20):
        state = body.step(state, {}, 0.3 / omega)
    assert sum(body.energies(state)) == pytest.approx(start, rel=1e-10)
    assert abs(angle(state)) < 0.5


@pytest.mark.parametrize("joined", [False, True])
def test_the_error_of_a_step_is_that_of_the_motion_with_all_its_strain_energy(joined):
    """Springs turned by half a right angle hold most of the energy: what is told is the true error as a share of it."""
    body = FlexibleBody(on_springs(0.0, 0.01, joined), limits=StepLimits(tolerance=10.0))
    omega, loads, start = body.model.angular_frequency[0], {"port_0": [0, 0, 0, 0, 0, 5.0]}, at(0.8, 10.0)
    told = []
    for step in (0.5 / omega, 0.25 / omega, 0.125 / omega):
        found, work = body.step_with_work(start, loads, step)
        exact = start
        for _ in range(256):
            exact = body.step(exact, loads, step / 256)
        off = np.hypot(omega * (found.q - exact.q), found.v - exact.v)[0]
        true = off / np.sqrt(2.0 * sum(body.energies(exact)))
        assert 0.5 * true < work.error < 1.5 * true
        told.append(work.error)
    # Of one step, of third order.
    assert told[0] > 1e-3
    np.testing.assert_allclose(np.log2(np.array(told[:-1]) / told[1:]), 3.0, atol=0.15)


def test_springs_of_a_joint_take_their_share_of_what_a_load_moves():
    """Two bodies of six unit springs each, joined: half a load on one passes the joint, and both move by half of it."""
    gap = np.hstack([np.eye(6), -np.eye(6)])[None]
    for stiffness in joining._stiffness(np.eye(12), gap, np.eye(12)[:6]):
        # Forces and moments have half of the share each.
        assert 0.5**2 / stiffness / 0.5 == pytest.approx(0.5 * joining._SHARE, rel=1e-9)


def test_a_step_tells_the_same_error_whatever_the_unit_of_mass():
    """A spring along an axis says nothing of another one, however soft: all that it does goes with the mass."""
    limits, told, reached = StepLimits(tolerance=10.0), [], []
    for scale in (1.0, 1e-4):
        root = np.sqrt(scale)
        model = replace(random_ties(random_body(3, parents=(GROUND, 0), interface_frame=(1,)), 3), second=None)
        shapes = {name: getattr(model, name) / root for name in SHAPES}
        ties = model.ties
        ties = replace(
            ties,
            displacement=ties.displacement / root,
            rotation=ties.rotation / root,
            stiffness=scale * ties.stiffness,
        )
        body = FlexibleBody(replace(model, ties=ties, **shapes), limits=limits)
        start = State(root * np.full(6, 0.01), root * np.linspace(-1.0, 1.0, 6))
        state, work = body.step_with_work(start, {"port_0": scale * np.array([3.0, -2.0, 1.0, 0.2, 0.3, 0.1])}, 5e-3)
        told.append(work.error)
        reached.append(state.q / root)
    assert told[0] > 1e-4
    assert told[1] == pytest.approx(told[0], rel=1e-7)
    np.testing.assert_allclose(reached[1], reached[0], rtol=1e-8, atol=1e-12)
