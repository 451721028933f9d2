"""A body on a bushing: closed forms of a rigid body on six springs, a beam's own bending, and what is refused."""

import dataclasses
from functools import partial
from itertools import product

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from scipy.linalg import eigh

import flexfmu
from flexfmu.body.reference_loads import own_error
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import BodyFileError, ModelError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Mesh
from flexfmu.model.methods import Method, recipe_of
from flexfmu.program.mechanics import against_error
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.bushings import resisted
from flexfmu.reduction.model import assemble_model
from flexfmu.study.scene.whole_model import TurningLoad, finite_motion
from meshes import bars, box, with_sets
from turns import exponential

STIFFNESS, TURNING = np.array([2e4, 5e4, 9e4]), np.array([30.0, 70.0, 110.0])
# Axes of the bushing in its columns.
AXES = exponential(np.array([0.4, -0.7, 0.3]))
LENGTH = 0.3
BUSHING = flexfmu.Support("ROOT", stiffness=STIFFNESS, rotational_stiffness=TURNING, axes=AXES.T[:2])
TENSORS = [AXES @ np.diag(k) @ AXES.T for k in (STIFFNESS, TURNING)]
LOAD = np.array([60.0, -90.0, 40.0, 3.0, 2.0, -4.0])


def bar() -> Mesh:
    """Bar of steel, as good as rigid, of which the first face is ROOT and the last TIP."""
    return box(ElementType.C3D20R, (3, 1, 1), (LENGTH, 0.04, 0.04))


def built(support=BUSHING, **options):
    body = flexfmu.Body(bar(), supports=[support], interfaces={"tip": "TIP"})
    return body.build(surface=False, **options)


def equilibrium(load: np.ndarray) -> np.ndarray:
    """Tip's displacement and rotation of a rigid bar on the bushing whose axes stay, (6,)."""
    arm, (pull, turn) = np.array([LENGTH, 0.0, 0.0]), TENSORS

    def residual(rotation: np.ndarray) -> np.ndarray:
        # Virtual rotations about fixed axes: the moment of a rotation vector is conjugate by the right Jacobian.
        turned = exponential(rotation) @ arm
        return moment_of(turn, rotation) - load[3:] - np.cross(turned, load[:3])

    rotation = scipy.optimize.fsolve(residual, np.linalg.solve(turn, load[3:] + np.cross(arm, load[:3])), xtol=1e-8)
    return np.append(np.linalg.solve(pull, load[:3]) + exponential(rotation) @ arm - arm, rotation)


def moment_of(turn: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Moment whose work on every further turn is that of the energy ½ θᵀKθ of the rotation vector."""
    gradient, size = turn @ rotation, 1e-6
    further = [log(exponential(size * axis) @ exponential(rotation)) - rotation for axis in np.eye(3)]
    return np.array([gradient @ each for each in further]) / size


def log(matrix: np.ndarray) -> np.ndarray:
    angle = np.arccos(np.clip((np.trace(matrix) - 1.0) / 2.0, -1.0, 1.0))
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    return 0.5 * angle / np.sin(angle) * skew


def tip(body, load) -> np.ndarray:
    found = body.response(body.static({"tip": load}))
    return np.append(found.displacement[0], found.rotation[0])


def test_a_small_load_moves_a_rigid_body_as_its_bushing_yields():
    size, found = 1e-4, tip(built(), 1e-4 * LOAD)
    np.testing.assert_allclose(found, equilibrium(size * LOAD), rtol=2e-3, atol=2e-4 * np.abs(found).max())


@pytest.mark.parametrize("factor", [0.3, 1.0])
def test_large_turns_on_a_bushing_are_those_of_a_rigid_body(factor):
    expected, found = equilibrium(factor * LOAD), tip(built(), factor * LOAD)
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-3 * np.linalg.norm(expected[:3]))
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-3 * np.linalg.norm(expected[3:]))


@pytest.mark.parametrize("turning", [TURNING, [9.0, 90.0, 90.0]])
def test_a_body_on_a_bushing_knows_that_it_turns_rightly(turning):
    """As far as 0.4 rad. Without what bushings do at third order it told 0.7 of the angle's square."""
    bushing = dataclasses.replace(BUSHING, rotational_stiffness=turning)
    body = built(bushing)
    for way in np.eye(3):
        load = {"tip": [*np.zeros(3), *(0.4 * AXES @ np.diag(turning) @ way)]}
        state = body.static(load)
        assert body.response(state).rotation[0] == pytest.approx(0.4 * AXES @ way, abs=3e-4)
        error = body.error(state, load)
        assert error.rotation[0] < 2e-4
        assert error.relative < 1e-3


def on_springs(*ends, **more):
    """A stiff bar on springs at its ends' nodes that keep their directions; their moment about its axis over sin θ."""
    mesh = with_sets(bar(), MIDDLE=lambda p: p[:, 0] - LENGTH / 3.0)
    around = mesh.points[mesh.node_sets["ROOT"]][:, 1:]
    arms = ((around - around.mean(axis=0)) ** 2).sum(axis=1).mean()
    supports = [flexfmu.Support(end, stiffness=[1e4] * 3) for end in ends]
    return flexfmu.Body(mesh, supports=supports, **more), len(ends) * 1e4 * arms


def test_a_cut_body_turns_on_springs_of_nodes_as_a_rigid_one():
    """About its axis by k Σ (y² + z²) sin θ / n; 9 % too stiff where the joints' energy counts twice."""
    config, stiffness = on_springs("ROOT", "TIP", interfaces={"tip": "TIP"}, cuts=["MIDDLE"])
    body = config.build(surface=False)
    assert body.model.ties is not None
    turn = tip(body, [0.0, 0.0, 0.0, 0.4 * stiffness, 0.0, 0.0])[3]
    assert turn == pytest.approx(np.arcsin(0.4), rel=2e-3)


def test_a_body_in_one_piece_knows_how_far_springs_of_nodes_turn_it():
    """They are linear: of a bar that a moment turns by 0.4 rad, they resist 9 % too much."""
    config, _ = on_springs("ROOT", interfaces={"tip": "TIP"})
    body = config.build(surface=False)
    mesh = bar()
    arms = 1e4 * (mesh.points[mesh.node_sets["ROOT"]][:, 1] - mesh.points[mesh.node_sets["ROOT"]][:, 1].mean()) ** 2
    loads = {"tip": [0.0, 0.0, 0.0, 0.0, 0.0, 0.4 * arms.mean()]}
    state = body.static(loads)
    missed = np.arcsin(0.4) - body.response(state).rotation[0, 2]
    assert missed > 0.02
    assert 0.7 * missed < body.error(state, loads).rotation[0] < 1.3 * missed
    assert body.error(state, loads).relative > 0.02
    assert "rotational_stiffness" in against_error(body.model, recipe_of(Method.SECOND_ORDER))
    assert "rotational_stiffness of its supports or --tolerance" in own_error(body.model)[0]


def test_springs_are_no_opened_loops_where_a_load_is_near_a_critical_one():
    """Pressed by 0.7 of what tips it over its springs, a bar knows its error to 1.25/0.3."""
    config, _ = on_springs("ROOT", interfaces={"tip": "TIP"})
    body, mesh = config.build(surface=False), config.mesh
    across = mesh.points[mesh.node_sets["ROOT"]][:, 1]
    critical = 1e4 * np.var(across) / LENGTH
    loads = {"tip": [-0.7 * critical, 0.02 * critical, 0.0, 0.0, 0.0, 0.0]}
    error = body.error(body.static(loads), loads)
    assert error.bound == pytest.approx(1.25 / 0.3 * error.relative, rel=0.05)


def whole_model(config, loads):
    """Displacement of the only interface under a force by finite elements."""
    spec, mesh = config.spec, config.mesh
    model = assemble_model(mesh, spec.options)
    interface = fit_interface(spec.options.interfaces[0], model.mesh, [])
    load = interface.nodal_loads(len(mesh.points)) @ loads[interface.name]
    path = load_path(model.mesh, model.unknowns, model.spring, load, [1.0], Reporter())
    return finite_motion(interface, model.mesh.points, path.displacement[0])[:3]


@pytest.mark.parametrize(("held", "force", "off"), [(["ROOT"], 30.0, 0.018), ([], 200.0, 0.004)])
def test_a_strip_on_a_bed_knows_how_far_its_springs_turn_it(held, force, off):
    """Nodes of one frame pull together; where all nodes lie on springs there is no way along the body to count."""
    mesh = with_sets(box(ElementType.C3D20R, (16, 1, 1), (1.0, 0.02, 0.004)), BED=lambda p: np.zeros(len(p)))
    bed = flexfmu.Support("BED", stiffness=[1e2 if held else 1e4] * 3)
    config = flexfmu.Body(mesh, supports=[*held, bed], interfaces={"tip": "TIP"})
    body, loads = config.build(surface=False), {"tip": [0.0, 0.0, force, 0.0, 0.0, 0.0]}
    state, expected = body.static(loads), whole_model(config, loads)
    missed = np.linalg.norm(body.response(state).displacement[0] - expected)
    assert missed == pytest.approx(off * np.linalg.norm(expected), rel=0.15)
    assert 0.3 * missed < body.error(state, loads).displacement[0] < 1.2 * missed


def test_a_hinged_body_on_springs_knows_its_error():
    mesh = with_sets(bar(), AXIS=lambda p: np.abs(p[:, 1] - p[:, 1].min()) + np.abs(p[:, 2] - p[:, 2].min()))
    supports = [flexfmu.Support("AXIS", fix=["y", "z"]), flexfmu.Support("ROOT", stiffness=[1e5, 0.0, 0.0])]
    body = flexfmu.Body(mesh, supports=supports, interfaces={"tip": "TIP"}, free=True).build(surface=False)
    loads = {"tip": [500.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    assert body.error(body.step(body.rest(), loads, 1e-3), loads).relative < 1e-4


def test_frequencies_are_those_of_a_rigid_body_on_six_springs():
    mesh, body = bar(), built()
    rho = mesh.materials[0].density
    sides = np.array([LENGTH, 0.04, 0.04])
    mass = rho * sides.prod()
    inertia = mass / 12.0 * np.diag(sides @ sides - sides**2)
    away = np.array([-0.5 * LENGTH, 0.0, 0.0])
    skew = np.array([[0.0, -away[2], away[1]], [away[2], 0.0, -away[0]], [-away[1], away[0], 0.0]])
    at_root = np.block([[np.eye(3), -skew], [np.zeros((3, 3)), np.eye(3)]])
    stiff = at_root.T @ np.block([[TENSORS[0], np.zeros((3, 3))], [np.zeros((3, 3)), TENSORS[1]]]) @ at_root
    weight = np.block([[mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), inertia]])
    expected = np.sqrt(eigh(stiff, weight)[0])
    np.testing.assert_allclose(body.reduced.angular_frequency[:6], expected, rtol=2e-3)


REFUSED = {
    "axes alone": ({"stiffness": STIFFNESS, "axes": np.eye(3)[:2]}, BodyFileError, "take rotational_stiffness"),
    "parallel": ({"rotational_stiffness": TURNING, "axes": np.ones((2, 3))}, BodyFileError, "not parallel"),
    "negative": ({"rotational_stiffness": -TURNING}, BodyFileError, "greater than or equal to 0"),
    "free": (
        {"stiffness": STIFFNESS, "rotational_stiffness": (0.0, 1.0, 1.0)},
        ModelError,
        "motion .turn about x t",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bushings_that_cannot_be_are_refused(name):
    keys, kind, text = REFUSED[name]
    with pytest.raises(kind, match=text):
        built(flexfmu.Support("ROOT", **keys))


def test_nodes_on_a_line_take_no_moment():
    line = flexfmu.Support(lambda p: (p[:, 0] < 1e-9) & (p[:, 1] < p[:, 1].min() + 1e-9), rotational_stiffness=TURNING)
    with pytest.raises(ModelError, match="on a line"):
        built(line)
    assert built().reduced.properties.spring.min() > 0.0


DAMPING, TURN_DAMPING = np.array([300.0, 900.0, 1800.0]), np.array([0.6, 1.5, 0.9])
KINDS = {
    "linear": {"method": "linear"},
    "constant": {"method": "second_order", "mass": "constant"},
    "polynomial": {"method": "second_order", "mass": "polynomial"},
    "configuration": {"method": "second_order", "mass": "configuration"},
}


def damped(factor: float = 1.0) -> flexfmu.Support:
    return dataclasses.replace(BUSHING, damping=factor * DAMPING, rotational_damping=factor * TURN_DAMPING)


def rigid_bar() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, stiffness and damping (6, 6) of a rigid bar about its bushing."""
    sides = np.array([LENGTH, 0.04, 0.04])
    mass = bar().materials[0].density * sides.prod()
    inertia = mass / 12.0 * np.diag(sides @ sides - sides**2)
    arm = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.5 * LENGTH], [0.0, 0.5 * LENGTH, 0.0]])
    weight = np.block([[mass * np.eye(3), -mass * arm], [mass * arm, inertia - mass * arm @ arm]])
    dampers = [AXES @ np.diag(c) @ AXES.T for c in (DAMPING, TURN_DAMPING)]
    return weight, scipy.linalg.block_diag(*TENSORS), scipy.linalg.block_diag(*dampers)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("factor", [1.0, 30.0])
def test_a_rigid_body_on_spring_dampers_decays_as_its_closed_form(kind, factor):
    weight, stiff, damper = rigid_bar()
    flow = np.block(
        [[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(weight, stiff), -np.linalg.solve(weight, factor * damper)]]
    )
    body, step, count = built(damped(factor), **KINDS[kind]), 1e-3, 40
    state, arm = body.static({"tip": 1e-3 * LOAD}), np.array([LENGTH, 0.0, 0.0])
    lever = scipy.linalg.block_diag(np.eye(3), np.eye(3))
    lever[:3, 3:] = -np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
    start = np.linalg.solve(stiff, lever.T @ (1e-3 * LOAD))
    for _ in range(count):
        state = body.step(state, {}, step)
    expected = lever @ (scipy.linalg.expm(flow * step * count) @ np.append(start, np.zeros(6)))[:6]
    found = body.response(state)
    size = np.abs(lever @ start)
    np.testing.assert_allclose(found.displacement[0], expected[:3], atol=0.01 * size[:3].max())
    np.testing.assert_allclose(found.rotation[0], expected[3:], atol=0.01 * size[3:].max())


def test_energy_falls_by_the_work_of_the_dampers_as_the_body_turns_far():
    body = built(damped(), method="second_order", mass="polynomial")
    state, rows, step = body.static({"tip": LOAD}), body.reduced.damper, 2e-5
    before, taken = sum(body.energies(state)), 0.0
    first = before
    for _ in range(1500):
        after = body.step(state, {}, step)
        # The force of a step is that of its mean rate.
        taken += np.sum((rows @ (after.q - state.q)) ** 2) / step
        state = after
    left = sum(body.energies(state))
    assert left < 0.97 * first
    assert first - left == pytest.approx(taken, rel=1e-6)


@pytest.mark.slow
def test_a_body_on_bushings_at_both_ends_may_be_cut():
    """A bar on a bushing at each end: the cut one is as compliant as the one in one piece, and knows it as it turns."""
    mesh = box(ElementType.C3D20R, (6, 1, 1), (LENGTH, 0.04, 0.04))
    x = mesh.points[:, 0]
    far = flexfmu.Support(
        "TIP", stiffness=STIFFNESS, rotational_stiffness=TURNING, damping=DAMPING, rotational_damping=TURN_DAMPING
    )
    load, found = {"middle": [30.0, 40.0, -50.0]}, []
    for cuts in ([], ["section"]):
        sets = {**mesh.node_sets, "section": np.flatnonzero(np.abs(x - LENGTH / 3.0) < 1e-9)}
        own = dataclasses.replace(mesh, node_sets=sets)
        interface = {"middle": np.abs(x - 2.0 * LENGTH / 3.0) < 1e-9}
        body = flexfmu.Body(own, supports=[damped(), far], interfaces=interface, cuts=cuts).build(surface=False)
        state = body.static(load)
        motion = [body.response(state).displacement[0]]
        for _ in range(20):
            state = body.step(state, {}, 1e-3)
        found.append(np.concatenate([*motion, body.response(state).displacement[0]]))
        turning = {"middle": [0.0, 0.0, 0.0, 20.0, 0.0, 0.0]}
        assert body.error(body.static(turning), turning).bound < 5e-3
    np.testing.assert_allclose(found[1], found[0], atol=2e-3 * np.abs(found[0]).max())


def test_dampers_on_a_body_that_floats_are_refused():
    body = flexfmu.Body(
        bar(), supports=[flexfmu.Support("ROOT", damping=DAMPING)], interfaces={"tip": "TIP"}, free=True
    )
    with pytest.raises(ModelError, match="dampers act on a body that is held"):
        body.build(surface=False)


def test_an_interface_may_lie_on_a_bushing():
    body = flexfmu.Body(bar(), supports=[damped()], interfaces={"root": "ROOT", "tip": "TIP"}).build(surface=False)
    found = body.response(body.static({"root": 1e-3 * LOAD}))
    np.testing.assert_allclose(found.displacement[0], np.linalg.solve(TENSORS[0], 1e-3 * LOAD[:3]), rtol=2e-3)
    np.testing.assert_allclose(found.rotation[0], np.linalg.solve(TENSORS[1], 1e-3 * LOAD[3:]), rtol=2e-3)


@pytest.mark.slow
def test_the_whole_model_on_a_bushing_turns_far_as_a_rigid_body_does():
    """What scenes and `fit --verify` compare with: the bushing's own forces, and moments, in turns of any size."""
    config = flexfmu.Body(bar(), supports=[BUSHING], interfaces={"tip": "TIP"}).spec
    model = assemble_model(bar(), config.options)
    interface = fit_interface(config.options.interfaces[0], model.mesh, [])
    load = interface.nodal_loads(len(model.mesh.points))[:, :3] @ LOAD[:3]
    others = [*model.bushings.readings, TurningLoad(interface, model.mesh.points, np.stack([np.zeros(3), LOAD[3:]]))]
    how = model.mesh, model.unknowns, model.spring, load, [1.0], Reporter()
    path = load_path(*how, partial(resisted, others), True)
    expected = equilibrium(LOAD)
    assert np.linalg.norm(expected[3:]) > 0.4
    found = finite_motion(interface, model.mesh.points, path.displacement[0])
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-3 * np.linalg.norm(expected[:3]))
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-3 * np.linalg.norm(expected[3:]))


@pytest.mark.slow
def test_an_arm_pressed_beyond_its_critical_load_goes_where_it_is_pushed():
    """It turns on its bushings: Newton's method for all of the load at once at times found the opposite equilibrium."""
    rows = [(0, 0, 0), (7, 0, 0)], [(0, 6, 0), (7, 6, 0)], [(8, 0, 0), (8, 6, 0)], [(9, 3, 0), (11, 3, 0)]
    mesh = bars(ElementType.C3D20, rows, 0.02)
    x, y, _ = mesh.points.T
    feet = [np.flatnonzero((x == 0.0) & half) for half in (y < 0.07, y > 0.07)]
    bushing = {"fix": (), "stiffness": (2e7, 2e7, 2e7), "rotational_stiffness": (400.0, 60.0, 400.0)}
    held = [flexfmu.Support(foot, **bushing) for foot in feet]
    body = flexfmu.Body(mesh, supports=held, interfaces={"tip": np.flatnonzero(x > 0.239)}).build(surface=False)
    for force, aside in product(np.linspace(600.0, 3000.0, 17), (0.1, 0.3)):
        found = body.response(body.static({"tip": (-force, 0.0, aside * force)}))
        assert found.displacement[0, 2] > 0.05
