"""Bodies that turn as a whole: what constant mass leaves out is told before it shows, and nothing where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bodies import clamped_free_roots, clamped_free_shapes
from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Mass, Method
from meshes import STEEL, body_file, box, with_sets
from turns import exponential

BLOCK = np.array([0.3, 0.1, 0.04])
MASS = STEEL.density * BLOCK.prod()
INERTIA = MASS / 12.0 * np.diag(BLOCK @ BLOCK - BLOCK**2)
MOTION = [f"tip.{quantity}.{axis}" for quantity in ("rotation", "angular_velocity") for axis in "xyz"]
DRIFT, SPIN = "diagnostics.angular_momentum", "diagnostics.spin"


def reduced(mesh, folder, held, **reduction):
    tables = {
        "frames": 2,
        "free": True,
        "formulation": {"mass": "constant"},
        "reduction": {"modes": 4, "residual_flexibility": False} | reduction,
        "output": {"velocities": True},
    }
    config = body_file(mesh, folder, interface=["ROOT", "TIP"], support="ROOT", **tables)
    support = [{"nodes": name, "fix": ["x", "y", "z"]} for name in held]
    return reduce_body(type(config).model_validate(config.model_dump() | {"support": support}), Reporter())


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A free block with three different moments of inertia."""
    return reduced(box(ElementType.C3D20, (4, 2, 1), BLOCK), tmp_path_factory.mktemp("block"), [])


def turned(folder, model, moment, push=0.2, end=2.0, step=0.01, **start):
    """A block that a moment (N m) turns for a while and then nothing; impulse and true angular momentum after steps."""
    driven = Driven(model, folder, **start)
    told, momenta = [], []
    for k in range(round(end / step)):
        acts = float(k < round(push / step))
        half = 0.5 * acts * np.asarray(moment)
        driven.set(**{f"{name}.moment.{axis}": half[i] for name in ("root", "tip") for i, axis in enumerate("xyz")})
        if not driven.taken(step):
            break
        values = np.array(driven.get(*MOTION))
        turn = exponential(values[:3])
        momenta.append(turn @ INERTIA @ turn.T @ values[3:])
        told.append(driven.get(DRIFT)[0])
    return driven, np.array(told), np.array(momenta)


@pytest.mark.parametrize("moment", [[0.1, 0.15, 0.3], [0.02, 2.0, 0.02]])
def test_a_block_that_tumbles_keeps_its_angular_momentum(tmp_path, block, moment):
    """Closed form: no moment acts after the push, so that angular momentum stays the impulse. By default settings.

    The second push is nearly about the middle axis, about which it turns over and over.
    """
    driven, told, momenta = turned(tmp_path, block, moment, end=4.0)
    after = momenta[20:]
    assert np.linalg.norm(after - 0.2 * np.array(moment), axis=1).max() < 1e-2 * np.linalg.norm(after[0])
    assert np.max(told) == 0.0
    assert driven.log == []


@pytest.mark.slow
def test_a_body_that_tumbles_turns_by_euler_s_equations(block):
    """Over 50 turns and more; the reference integrates quaternion and spin to 1e-12."""
    body = FlexibleBody(block, Method.SECOND_ORDER, damping_scale=0.0, limits=StepLimits(2e-4))
    spin, end, step = np.array([2.0, 60.0, 3.0]), 6.0, 1e-2
    motion = np.concatenate([block.joint_displacement[0], block.frame_rotation[0]])[:, :6]
    inertia = np.linalg.inv(block.frame_rotation[0][:, :6] @ block.frame_rotation[0][:, :6].T)

    def rate(_, y):
        a, w = y[:4], y[4:]
        turn = 0.5 * np.array([-a[1:] @ w, *(a[0] * w + np.cross(a[1:], w))])
        return np.concatenate([turn, np.linalg.solve(inertia, np.cross(inertia @ w, w))])

    v = np.zeros(block.mode_count)
    v[:6] = np.linalg.solve(motion, [0.0, 0.0, 0.0, *spin])
    state = State(np.zeros_like(v), v)
    angular, energy = inertia @ spin, sum(body.energies(state))
    exact = solve_ivp(rate, (0.0, end), [1.0, 0.0, 0.0, 0.0, *spin], method="DOP853", rtol=1e-12, atol=1e-12)
    assert np.linalg.norm(exact.y[4:], axis=0).mean() * end > 50.0 * 2.0 * np.pi
    # It turns over about the middle axis.
    assert exact.y[5].min() < -30.0
    for _ in range(round(end / step)):
        state = body.step(state, {}, step)
    turn = exponential(block.frame_rotation[0][:, :6] @ state.q[:6])
    own = block.frame_rotation[0][:, :6] @ state.v[:6]
    np.testing.assert_allclose(turn @ inertia @ own, angular, atol=1e-9 * np.linalg.norm(angular))
    assert sum(body.energies(state)) == pytest.approx(energy, rel=1e-10)
    a, b, c, d = exact.y[:4, -1] / np.linalg.norm(exact.y[:4, -1])
    expected = np.array(
        [
            [1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)],
        ]
    )
    assert np.degrees(np.arccos(0.5 * (np.trace(turn.T @ expected) - 1.0))) < 1.0


def test_a_method_that_loses_angular_momentum_tells_by_how_much(tmp_path, block):
    model = replace(block, method=Method.HALF_ROTATION)
    driven, told, momenta = turned(tmp_path, model, [0.1, 0.15, 0.3], **{"watch.angular_momentum.on_limit": "discard"})
    assert driven.get("status.code") == [1]
    assert 5 < len(told) < 100
    direction = momenta[-1] / np.linalg.norm(momenta[-1])
    impulse = np.array([0.1, 0.15, 0.3])
    assert np.degrees(np.arccos(direction @ impulse / np.linalg.norm(impulse))) < 10.0


def test_a_free_body_at_rest_has_lost_no_angular_momentum(tmp_path, block):
    driven, told, _ = turned(tmp_path, replace(block, method=Method.HALF_ROTATION), np.zeros(3), end=0.05)
    np.testing.assert_array_equal(told, np.zeros(5))
    assert driven.log == []


def test_spin_about_changing_axes_is_the_rate_of_the_turn_not_of_its_vector(tmp_path, block):
    """Set going about y when it has half turned about z: there 2/π of the rotation vector's rate across it is turn."""
    driven, step, first = Driven(block, tmp_path), 0.01, block.angular_frequency[block.rigid_count]
    impulses = {0: [0.0, 0.0, 2.0 * np.pi * INERTIA[2, 2]], 50: [0.0, 4.0 * np.pi * INERTIA[0, 0], 0.0]}
    turns, spins = [], []
    for k in range(100):
        half = 0.5 * np.array(impulses.get(k, np.zeros(3))) / step
        driven.set(**{f"{name}.moment.{axis}": half[i] for name in ("root", "tip") for i, axis in enumerate("xyz")})
        assert driven.taken(step)
        turns.append(exponential(np.array(driven.get(*MOTION[:3]))))
        spins.append(first * driven.get(SPIN)[0])
    # The angle from the end of the step before to the end of the next one.
    between = [after @ before.T for before, after in zip(turns, turns[2:], strict=False)]
    angles = [np.arccos(0.5 * np.trace(turn) - 0.5) for turn in between]
    steady = np.array([k not in (0, 1, 49, 50, 51) for k in range(1, 99)])
    np.testing.assert_allclose(np.array(spins[1:-1])[steady], (np.array(angles) / (2.0 * step))[steady], rtol=1e-3)
    # Where nothing acts any more the spin still changes.
    assert abs(spins[-1] / spins[51] - 1.0) > 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("moment", [[0.1, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 2.0]])
@pytest.mark.parametrize("step", [0.01, 0.1])
def test_turns_about_one_principal_axis_are_right_and_nothing_is_said(tmp_path, block, moment, step):
    driven, told, momenta = turned(tmp_path, block, moment, end=3.0, step=step)
    assert np.max(told) < 1e-9
    np.testing.assert_allclose(momenta[-1], 0.2 * np.array(moment), rtol=0.02, atol=1e-6)
    assert driven.log == []


@pytest.mark.parametrize(("push", "kick", "told"), [(400.0, 1e-8, 1), (400.0, 1.0, 0), (-400.0, 1e-8, 0)])
def test_a_free_body_that_dead_forces_push_together_turns_round_as_a_rigid_one_and_says_so(
    tmp_path, block, push, kick, told
):
    """Closed form: a disturbance grows by sqrt(F L / I), up to half a turn; pulled, the body stays along the forces."""
    driven = Driven(block, tmp_path)
    driven.set(**{"tip.moment.z": kick})
    assert driven.taken(1e-3)
    driven.set(**{"tip.moment.z": 0.0, "root.force.x": push, "tip.force.x": -push})
    angles = [driven.get("tip.rotation.z")[0] for _ in range(900) if driven.taken(1e-3)]
    assert [text.startswith("loads in balance push the free body together") for _, text in driven.log] == [True] * told
    if push < 0.0:
        assert np.max(np.abs(angles)) < 1e-8
        return
    grown = np.log(np.abs(angles[60 : np.argmax(np.abs(angles) > 0.1)]))
    assert np.polyfit(1e-3 * np.arange(len(grown)), grown, 1)[0] == pytest.approx(
        np.sqrt(push * BLOCK[0] / INERTIA[2, 2]), rel=0.01
    )
    assert np.max(np.abs(angles)) > 0.9 * np.pi


LENGTH, THICKNESS, WIDTH = 1.0, 0.01, 0.06


@pytest.fixture(scope="module")
def hinged(tmp_path_factory):
    """A strip on a hinge along its root's middle, about which it bends."""
    mesh = box(ElementType.C3D20, (10, 2, 1), (LENGTH, THICKNESS, WIDTH))
    mesh = with_sets(mesh, HINGE=lambda points: np.hypot(points[:, 0], points[:, 1] - 0.5 * THICKNESS))
    return reduced(mesh, tmp_path_factory.mktemp("hinged"), ["HINGE"])


def lag_error(spin):
    """Error of the lag of a beam whose root turns at a spin (rad/s) and ever faster, for want of centrifugal forces.

    Deflections v from the turning root's tangent: (K + spin² (G − M)) v = −α ∫ρA x φ, G being the stiffness of the pull
    ½ρA spin² (L² − x²); constant mass knows of K alone.
    """
    x = np.linspace(0.0, LENGTH, 401)
    roots = clamped_free_roots(4)
    shape, slope = clamped_free_shapes(roots, x, LENGTH)
    stiffness = roots**4 * STEEL.youngs_modulus * THICKNESS**2 / (12.0 * STEEL.density) / LENGTH**4
    pull = 0.5 * (LENGTH**2 - x**2)
    geometric = np.trapezoid(pull[:, None, None] * slope[:, :, None] * slope[:, None, :], x, axis=0) / LENGTH
    force = np.trapezoid(x[:, None] * shape, x, axis=0)
    lags = [
        shape[-1] @ np.linalg.solve(np.diag(stiffness) + s**2 * (geometric - np.eye(4)), force) for s in (0.0, spin)
    ]
    return abs(lags[0] / lags[1] - 1.0)


def spun(folder, model, spin, turn=6.0, count=400, **start):
    """A strip spun up to a spin (rad/s) over an angle (rad); spins after the steps."""
    driven, time = Driven(model, folder, **start), 2.0 * turn / spin
    inertia = STEEL.density * LENGTH * THICKNESS * WIDTH * (LENGTH**2 / 3.0 + THICKNESS**2 / 12.0)
    spins = []
    for k in range(count):
        growth = spin / time * (1.0 - np.cos(2.0 * np.pi * (k + 0.5) / count))
        driven.set(**{"root.moment.z": inertia * growth})
        if not driven.taken(time / count):
            break
        spins.append(driven.get(SPIN)[0])
    return driven, np.array(spins)


def test_a_strip_on_a_hinge_is_told_of_its_spin_before_its_lag_is_off_by_a_tenth(tmp_path, hinged):
    first = hinged.angular_frequency[hinged.rigid_count]
    bending = np.sqrt(STEEL.youngs_modulus / 12.0 / STEEL.density) * THICKNESS / LENGTH**2
    assert first == pytest.approx(15.418 * bending, rel=0.03)
    driven, spins = spun(tmp_path, hinged, 0.36 * first)
    assert spins[-1] == pytest.approx(0.36, rel=1e-3)
    (text,) = (text for _, text in driven.log if "centrifugal" in text)
    told = float(text.split("spins at ")[1].split()[0])
    assert told == pytest.approx(spins[np.argmax(spins > 0.15)] * first, rel=1e-2)
    assert 0.05 < lag_error(told) < 0.1
    # What it goes on to: the spin-up of J. C. Simo and L. Vu-Quoc, J. Appl. Mech. 53 (1986) 855, ends at this ratio.
    assert lag_error(0.35 * first) == pytest.approx(0.42, abs=0.05)


def test_a_slow_spin_says_nothing(tmp_path, hinged):
    driven, spins = spun(tmp_path, hinged, 0.1 * hinged.angular_frequency[hinged.rigid_count])
    assert 0.05 < spins[-1] < 0.15
    assert driven.log == []


def test_a_spin_beyond_the_limit_is_refused_on_request(tmp_path, hinged):
    limits = {"watch.spin.limit": 0.05, "watch.spin.on_limit": "discard"}
    driven, spins = spun(tmp_path, hinged, 0.1 * hinged.angular_frequency[hinged.rigid_count], **limits)
    assert 0.045 < np.max(spins) <= 0.05
    assert driven.get("status.code") == [1]


def test_what_knows_the_deformed_body_s_mass_is_not_told(tmp_path):
    mesh = box(ElementType.C3D20, (4, 2, 1), BLOCK)
    model = reduced(mesh, tmp_path, [], inertia=True)
    model = replace(model, method=Method.FRAMES, mass=Mass.CONFIGURATION)
    driven, told, momenta = turned(tmp_path, model, [0.1, 0.15, 0.3], end=0.8, step=0.01)
    assert driven.log == []
    assert np.max(told) == 0.0
    np.testing.assert_allclose(momenta[-1], 0.2 * np.array([0.1, 0.15, 0.3]), rtol=0.02)
