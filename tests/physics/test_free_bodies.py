"""Bodies that nothing holds, or a hinge: rigid motions of any size, interfaces that the scene fixes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.special import ellipk

from bodies import body_of_everything
from flexfmu.api import Body
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.body.loads import Loads
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import DampingTable, FrameTable, InputTable, InterfaceTable, SupportTable
from flexfmu.files.basics import EquilibriumError, ModelError, OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.model.methods import Mass, Method
from flexfmu.reduction.options import Basis
from flexfmu.reduction.subdomains import hinge_frame
from meshes import STEEL, arc, body_file, box
from references import BEAM, relative
from turns import exponential

LENGTH, SIDE, DENSITY, YOUNG = 1.0, 0.03, 7850.0, 2.0e11
MASS = LENGTH * SIDE**2 * DENSITY
ROOT_AND_TIP = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]


@pytest.fixture(scope="module")
def floating(bodies):
    """The clamped beam without its clamp."""

    def make(basis=Basis.CRAIG_BAMPTON, modes=8, frames=4, **changes):
        reduction = bodies.config(BEAM).reduction.model_copy(update={"basis": basis, "modes": modes})
        changes = {"interface": ROOT_AND_TIP} | changes
        return bodies.beam(free=True, support=[], reduction=reduction, frames=frames, **changes)

    return make


def spinning(body, rate):
    """Spin about the axis through the centre of mass, rad/s about x, y, z."""
    model = body.model
    v = np.zeros(model.mode_count)
    v[:6] = np.linalg.solve(
        np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6], [0, 0, 0, *rate]
    )
    return State(np.zeros_like(v), v)


@pytest.mark.slow
@pytest.mark.parametrize("basis", Basis)
def test_a_free_beam_has_six_rigid_motions_and_the_frequencies_of_beam_theory(floating, basis):
    model = floating(basis, 12).model
    assert model.rigid_count == 6
    # Bending of a free-free beam, twice each; shear and rotary inertia take off what a slender beam has.
    stiffness, line = YOUNG * SIDE**4 / 12.0, SIDE**2 * DENSITY
    expected = np.array([4.730041, 7.853205]) ** 2 / LENGTH**2 * np.sqrt(stiffness / line)
    found = model.angular_frequency[6:10].reshape(2, 2)
    np.testing.assert_allclose(found, np.repeat(expected, 2).reshape(2, 2), rtol=2e-2)
    assert np.all(found < expected[:, None])


@pytest.mark.slow
@pytest.mark.parametrize("frames", [0, 1, 4])
def test_fixed_by_the_scene_the_free_body_is_the_supported_one(bodies, floating, frames):
    free = floating(frames=frames)
    fixed = FlexibleBody(free.model, fixed=["root"])
    reduction = bodies.config(BEAM).reduction.model_copy(update={"basis": Basis.CRAIG_BAMPTON, "modes": 8})
    supported = bodies.beam(reduction=reduction, frames=frames)
    np.testing.assert_allclose(fixed.model.angular_frequency[:6], supported.model.angular_frequency[:6], rtol=3e-3)
    np.testing.assert_allclose(fixed.model.damping_ratio, free.model.damping_ratio[0])
    loads = {"tip": [-2e3, 8e3, 3e3, 50.0, -200.0, 300.0]}
    found = [body.response(body.static(loads)) for body in (fixed, supported)]
    assert np.linalg.norm(found[1].displacement) > 0.15
    np.testing.assert_allclose(found[0].displacement[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[0].rotation[0], 0.0, atol=1e-12)
    # A distributing coupling holds the section's mean, a support each node.
    assert relative(found[0].displacement[1], found[1].displacement[0]) < 5e-3


@pytest.mark.slow
def test_ratios_of_damping_are_listed_for_elastic_modes_and_fixed_by_their_share_of_strain_energy(floating):
    ratios = np.linspace(0.01, 0.14, 14)
    model = floating(modes=8, damping=DampingTable(ratio=ratios.tolist())).model
    np.testing.assert_array_equal(model.damping_ratio, [*np.zeros(6), *ratios])
    fixed = FlexibleBody(model, Method.LINEAR, fixed=["root"]).model
    held = null_space(np.concatenate([model.interface_displacement[0], model.interface_rotation[0]]))
    stiffness = np.diag(model.angular_frequency**2)
    squares, turn = np.linalg.eigh(held.T @ stiffness @ held)
    energy = (model.angular_frequency[:, None] * (held @ turn)) ** 2
    np.testing.assert_allclose(fixed.angular_frequency, np.sqrt(squares), rtol=1e-9)
    expected = model.damping_ratio @ energy / energy.sum(axis=0)
    # Modes of equal frequency may be turned: their sum is the same.
    ends = np.flatnonzero(np.diff(squares, append=np.inf) > 1e-6 * squares)
    np.testing.assert_allclose(np.cumsum(fixed.damping_ratio)[ends], np.cumsum(expected)[ends], rtol=1e-6)
    # The ratios differ, so that shares count.
    assert np.ptp(fixed.damping_ratio) > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
def test_fixed_by_the_scene_it_has_the_deformed_body_s_mass_too(bodies, method):
    reduction = {"basis": Basis.CRAIG_BAMPTON, "modes": 8, "inertia": True, "second_order": True}
    reduction = bodies.config(BEAM).reduction.model_copy(update=reduction)
    free = bodies.beam(free=True, support=[], interface=ROOT_AND_TIP, reduction=reduction, frames=4).model
    fixed = FlexibleBody(free, method, Mass.CONFIGURATION, fixed=["root"])
    supported = FlexibleBody(bodies.beam(reduction=reduction, frames=4).model, method, Mass.CONFIGURATION)
    states = [body.rest() for body in (fixed, supported)]
    for _ in range(10):
        states = [b.step(s, {"tip": [0.0, 5e3, 0.0]}, 2e-3) for b, s in zip((fixed, supported), states, strict=True)]
    moved = [b.response(s).displacement[-1] for b, s in zip((fixed, supported), states, strict=True)]
    assert np.linalg.norm(moved[1]) > 0.1
    assert relative(moved[0], moved[1]) < 1e-2
    masses = [np.linalg.eigvalsh(b.mass(b.static({"tip": [0.0, 5e3, 0.0]}))) for b in (fixed, supported)]
    assert masses[1][-1] > 1.01
    np.testing.assert_allclose(masses[0][-3:], masses[1][-3:], rtol=2e-3)


@pytest.mark.slow
def test_what_hung_on_the_floating_frame_keeps_its_mass_where_the_scene_fixes_the_root(bodies):
    """One frame at the root, the rest of the beam on none: undeformed, its modes have unit mass in any case."""
    wanted = {"basis": Basis.CRAIG_BAMPTON, "modes": 4, "inertia": True}
    reduction = bodies.config(BEAM).reduction.model_copy(update=wanted)
    frame = [FrameTable(name="first", nodes="SEG1")]
    changes = {"free": True, "support": [], "interface": ROOT_AND_TIP, "frames": None, "frame": frame}
    free = bodies.beam(reduction=reduction, **changes).model
    body = FlexibleBody(free, mass=Mass.CONFIGURATION, fixed=["root"])
    assert set(body.model.inertia.frame) == {0}
    assert body.model.inertia.mass.sum() < 0.5 * free.inertia.mass.sum()
    count = body.model.mode_count
    for v in [*np.eye(count), np.ones(count)]:
        assert sum(body.energies(State(np.zeros(count), v))) == pytest.approx(0.5 * float(v @ v), rel=1e-9)


@pytest.mark.slow
def test_a_free_body_falls_as_one(floating):
    body = floating(input=InputTable(acceleration=True))
    loads = Loads(np.zeros((2, 3)), np.zeros((2, 3)), np.array([0.0, 9.81, 0.0]))
    state = body.rest()
    for _ in range(10):
        state = body.step(state, loads, 0.05)
    moved = body.response(state).displacement
    np.testing.assert_allclose(moved, np.tile([0.0, -0.5 * 9.81 * 0.25, 0.0], (2, 1)), atol=1e-9)


def test_a_spinning_body_turns_about_its_centre_of_mass_without_growing(floating):
    body = floating()
    # Slow against the first bending frequency: no centrifugal force in this model to stretch it.
    state = spinning(body, [0.0, 0.0, 1.0])
    for angle in (0.5, 1.0, 2.0):
        state = body.step(state, {}, 0.5 if angle < 2.0 else 1.0)
        points = body.model.interface_point + body.response(state).displacement
        along = LENGTH * np.array([np.cos(angle), np.sin(angle), 0.0])
        np.testing.assert_allclose(points[1] - points[0], along, atol=1e-9)
        np.testing.assert_allclose(points.mean(axis=0), body.model.interface_point.mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(body.response(state).rotation[1], [0.0, 0.0, angle], atol=1e-9)


def test_a_push_moves_the_centre_of_mass_as_newton_says_while_the_body_turns(floating):
    body = floating()
    state, step, count = body.rest(), 2e-3, 100
    force = np.array([0.0, 20.0, 0.0])
    for _ in range(count):
        state = body.step(state, {"tip": force}, step)
    centre = body.model.joint_displacement[0] @ state.q
    np.testing.assert_allclose(centre, 0.5 * force / MASS * (count * step) ** 2, rtol=1e-6, atol=1e-12)
    assert body.response(state).rotation[1, 2] > 0.3


@pytest.mark.parametrize("count", [1, 3])
def test_a_push_that_grows_moves_the_centre_of_mass_exactly_in_any_number_of_steps(floating, count):
    """m x″ = F (1 + t/T) gives x(T) = (½ + ⅙) F T²/m, whatever the body does about its centre."""
    body = floating()
    state, end, push = body.rest(), 6e-3, np.array([30.0, 20.0, -10.0])
    for k in range(count):
        first, last = (1.0 + (k + part) / count for part in (0, 1))
        state, _ = body.step_with_work(state, {"tip": first * push}, end / count, {"tip": last * push})
    centre = body.model.joint_displacement[0] @ state.q
    np.testing.assert_allclose(centre, (0.5 + 1.0 / 6.0) * push / MASS * end**2, rtol=1e-9)
    # The tip is elsewhere: the body turns and bends.
    assert relative(body.response(state).displacement[1], centre) > 0.1


def test_a_free_body_keeps_its_energy_under_a_dead_force(floating):
    body = FlexibleBody(floating().model, damping_scale=0.0)
    loads, state = {"tip": [0.0, 200.0, 100.0]}, body.rest()
    start = body.response(state).displacement
    for _ in range(400):
        state = body.step(state, loads, 1e-3)
        work = np.vdot([0.0, 200.0, 100.0], body.response(state).displacement[1] - start[1])
        assert sum(body.energies(state)) == pytest.approx(work, rel=1e-9, abs=1e-12)
    assert np.linalg.norm(body.response(state).rotation[1]) > 1.0


@pytest.mark.parametrize("size", [1e-12, 1e-8])
def test_a_light_push_at_the_origin_throws_a_free_body_in_proportion(size):
    """What round-off of places makes of its work was taken for zero there, and steps never settled."""
    mesh = arc(ElementType.C3D20, (12, 1, 1), 0.3, 0.02)
    mesh = replace(mesh, points=mesh.points - np.array([0.3, 0.0, 0.0]))
    body = Body(mesh, free=True, interfaces={"here": "ROOT", "far": "TIP"}, name="thrown").build(surface=False)
    assert np.linalg.norm(body.model.interface_point[0]) < 1e-12
    found = []
    for share in (1.0, 1e4 * size):
        state = body.rest()
        for step in range(20):
            state = body.step(state, {"here": np.array([10.0, -5.0, 8.0]) * share * 1e-4 * step / 20}, 2e-4)
        found.append(body.response(state).displacement / share)
    assert np.linalg.norm(found[0][0]) > 1e-9
    # Round-off of the places, over the push.
    np.testing.assert_allclose(found[1], found[0], atol=1e-4 * np.linalg.norm(found[0]) + 3e-16 / (1e4 * size))


@pytest.mark.slow
def test_a_hinged_beam_swings_like_the_large_angle_pendulum(bodies):
    """Period 4 √(I/(m g l)) K(sin²(θ₀/2)) of a rigid pendulum that swings from 90°."""
    config = bodies.config(BEAM)
    mesh_support = [SupportTable(nodes="ROOT_LINE", fix=["x", "y", "z"])]
    body = hinged_beam(config, mesh_support)
    gravity = 9.81
    # The beam lies along x; weight along −y swings it from the horizontal to the horizontal on the other side.
    loads = Loads(np.zeros((1, 3)), np.zeros((1, 3)), np.array([0.0, gravity, 0.0]))
    inertia = MASS * (LENGTH**2 / 3.0 + SIDE**2 / 12.0)
    period = 4.0 * np.sqrt(inertia / (MASS * gravity * LENGTH / 2.0)) * ellipk(0.5)
    state, count = body.rest(), 400
    tips = []
    for _ in range(count):
        state = body.step(state, loads, period / count)
        tips.append(body.response(state).displacement[0])
    tips = np.array(tips)
    assert np.ptp(tips[:, 0]) == pytest.approx(2.0, abs=5e-3)
    # Hanging down after a quarter, on the other side after a half, back after a period.
    np.testing.assert_allclose(tips[count // 4 - 1], [-1.0, -1.0, 0.0], atol=1e-2)
    np.testing.assert_allclose(tips[count // 2 - 1], [-2.0, 0.0, 0.0], atol=1e-2)
    np.testing.assert_allclose(tips[count - 1], [0.0, 0.0, 0.0], atol=1e-2)
    with pytest.raises(EquilibriumError, match="free to move in 1 rigid motion and"):
        body.static(loads)


def hinged_beam(config, support):
    """The beam held on the line across its root's middle."""
    from flexfmu.build import config as build
    from flexfmu.files.outputs import Reporter

    original = build.read_mesh

    def with_line(*arguments):
        mesh = original(*arguments)
        x, y, _ = (mesh.points - mesh.points.min(axis=0)).T
        line = np.flatnonzero((x < 1e-9) & (np.abs(y - 0.5 * SIDE) < 1e-9))
        return replace(mesh, node_sets=dict(mesh.node_sets) | {"ROOT_LINE": line})

    build.read_mesh = with_line
    try:
        changes = {"support": support, "free": True, "frames": 2, "input": InputTable(acceleration=True)}
        return FlexibleBody(reduce_body(config.model_copy(update=changes), Reporter()))
    finally:
        build.read_mesh = original


def test_the_frame_of_a_body_on_a_hinge_turns_with_it_and_what_is_no_hinge_has_none():
    mesh = box(ElementType.C3D20, (4, 1, 1), (1.0, 0.1, 0.2))
    x, y, z = mesh.points.T
    axis = np.array([0.0, 0.0, 3.0])
    turning, slide = np.cross(axis, mesh.points), np.tile([0.0, 1.0, 0.0], (len(x), 1))
    found = hinge_frame(mesh, turning.reshape(-1, 1))
    np.testing.assert_allclose(found.rotation.of(turning.reshape(-1, 1)).ravel(), axis, atol=1e-9)
    assert sorted(found.joint.nodes) == list(np.flatnonzero((x == 0.0) & (y == 0.0)))
    # All nodes move; and nodes at x = 0 stand still while all else bends or stretches away from them.
    bent, stretched = np.column_stack([0.0 * x, x**2, 0.0 * z]), np.column_stack([x, 0.0 * y, 0.0 * z])
    for motion in (slide, turning + slide, bent, stretched):
        assert hinge_frame(mesh, motion.reshape(-1, 1)) is None


def test_no_equilibrium_is_promised_to_a_body_that_can_float_away(floating):
    with pytest.raises(EquilibriumError, match="free to move in 6 rigid motions"):
        floating().static({"tip": [0.0, 1.0, 0.0]})


@pytest.mark.slow
def test_what_cannot_be_fixed_is_refused_with_the_reason(floating, bodies):
    with pytest.raises(OptionError, match="frames hang on 'root'"):
        FlexibleBody(floating().model, fixed=["tip"])
    both = FlexibleBody(floating().model, Method.LINEAR, fixed=["tip", "root"])
    moved = both.response(both.static({"tip": [0.0, 1e5, 0.0]})).displacement
    np.testing.assert_allclose(moved, 0.0, atol=1e-12)
    with pytest.raises(OptionError, match="Craig-Bampton"):
        FlexibleBody(floating(Basis.NORMAL).model, fixed=["root"])
    with pytest.raises(OptionError, match="Craig-Bampton"):
        FlexibleBody(bodies.beam().model, fixed=["tip"])


def test_a_body_floats_only_when_its_file_says_so(bodies):
    with pytest.raises(ModelError, match=r"free to move in 6 rigid motions.*free = true"):
        bodies.beam(support=[])
    with pytest.raises(ModelError, match="the supports hold the body"):
        bodies.beam(free=True)


@pytest.mark.slow
def test_a_support_on_springs_gives_by_force_over_stiffness(bodies):
    stiffness = np.array([2e7, 5e6, 1e7])
    reduction = bodies.config(BEAM).reduction.model_copy(update={"residual_flexibility": True})
    clamped = bodies.beam(reduction=reduction, frames=0)
    # Springs at every node of the section hold it against turning too, far less stiffly than a clamp.
    springs = [SupportTable(nodes="ROOT", stiffness=list(stiffness))]
    sprung = bodies.beam(reduction=reduction, frames=0, support=springs)
    found = [body.response(body.static({"tip": [1e4, 0.0, 0.0]})).displacement[0, 0] for body in (clamped, sprung)]
    assert found[1] - found[0] == pytest.approx(1e4 / stiffness[0], rel=1e-2)
    with pytest.raises(ModelError, match=r"in 3 rigid motions \(slide along y, slide along z, turn about x\)"):
        bodies.beam(support=[SupportTable(nodes="ROOT", stiffness=[1e6, 0.0, 0.0])])


# Steel at the one end, aluminium at the other: the centre of mass lies well off the middle.
ALLOY = Material("ALLOY", 7e10, 0.33, 2700.0)
HALVES = ((0.5, STEEL), (1.5, ALLOY))


@pytest.fixture(scope="module")
def two_materials(tmp_path_factory):
    """A free bar of 2 × 0.1 × 0.1 m along x, the first metre of steel, the second of aluminium."""
    mesh = box(
        ElementType.C3D20,
        (8, 1, 1),
        (2.0, 0.1, 0.1),
        materials=(STEEL, ALLOY),
        material=lambda centres: (centres[:, 0] > 4.0).astype(int),
    )
    config = body_file(
        mesh,
        tmp_path_factory.mktemp("two"),
        interface=["ROOT", "TIP"],
        support="ROOT",
        free=True,
        frames=2,
        input={"acceleration": True},
        reduction={"basis": "craig_bampton", "modes": 6, "inertia": True},
    ).model_copy(update={"support": []})
    return FlexibleBody(reduce_body(config, Reporter()))


def test_a_free_body_of_two_materials_turns_about_its_centre_of_mass(two_materials):
    """With constant mass, which centrifugal forces do not stretch (here by 4e-8 m)."""
    two_materials = FlexibleBody(two_materials.model, two_materials.method, Mass.CONSTANT)
    centre = sum(x * part.density for x, part in HALVES) / sum(part.density for _, part in HALVES)
    assert centre < 0.8
    for axis in (1, 2):
        spin = np.zeros(3)
        spin[axis] = 1.0
        state = spinning(two_materials, spin)
        for angle in (0.5, 1.0, 2.0):
            state = two_materials.step(state, {}, 0.5 if angle < 2.0 else 1.0)
            points = two_materials.model.interface_point + two_materials.response(state).displacement
            # Each end stays as far from the centre of mass as it was, on the two sides of it.
            middle = np.array([centre, 0.05, 0.05])
            along = exponential(angle * spin) @ [1.0, 0.0, 0.0]
            np.testing.assert_allclose(points, middle + np.outer([-centre, 2.0 - centre], along), atol=1e-8)


def test_a_free_body_of_two_materials_falls_without_turning_or_bending(two_materials):
    loads = Loads(np.zeros((2, 3)), np.zeros((2, 3)), np.array([0.0, 9.81, 3.0]))
    state = two_materials.rest()
    for _ in range(5):
        state = two_materials.step(state, loads, 0.1)
    found = two_materials.response(state)
    np.testing.assert_allclose(found.displacement, np.tile([0.0, -0.5 * 9.81 * 0.25, -0.375], (2, 1)), atol=1e-8)
    np.testing.assert_allclose(found.rotation, 0.0, atol=1e-8)


@pytest.mark.parametrize("mass", [Mass.CONSTANT, Mass.CONFIGURATION])
def test_a_spinning_body_of_two_materials_has_the_energy_of_both(two_materials, mass):
    """½ J ω², J of two blocks, each about its own centre and then about the common one."""
    blocks = [(0.01 * part.density, x) for x, part in HALVES]
    centre = sum(m * x for m, x in blocks) / sum(m for m, _ in blocks)
    moment = sum(m * ((1.0 + 0.1**2) / 12.0 + (x - centre) ** 2) for m, x in blocks)
    body = FlexibleBody(two_materials.model, Method.FRAMES, mass)
    state = spinning(body, [0.0, 0.0, 3.0])
    assert sum(body.energies(state)) == pytest.approx(0.5 * moment * 9.0, rel=1e-6)
    turned = State(0.3 * state.v, state.v)
    assert sum(body.energies(turned)) == pytest.approx(0.5 * moment * 9.0, rel=1e-6)


def test_lumps_of_two_materials_have_the_mass_of_their_own(two_materials):
    lumps = two_materials.model.inertia
    for part, half in ((STEEL, lumps.point[:, 0] < 1.0), (ALLOY, lumps.point[:, 0] > 1.0)):
        assert lumps.mass[half].sum() == pytest.approx(0.01 * part.density, rel=1e-9)


def test_a_push_along_a_free_body_of_two_materials_moves_its_mass_as_newton_says(two_materials):
    """Sideways at the steel end, while the bar turns by half a radian."""
    mass = 0.01 * sum(part.density for _, part in HALVES)
    centre = sum(x * part.density for x, part in HALVES) / sum(part.density for _, part in HALVES)
    state, force = two_materials.rest(), np.array([0.0, 500.0, 0.0])
    for _ in range(50):
        state = two_materials.step(state, {"root": force}, 1e-2)
    found = two_materials.response(state)
    turn = found.rotation[0]
    assert abs(turn[2]) > 0.5
    # Bending is a thousandth of the motion: the centre of mass lies on the line between the ends.
    place = two_materials.model.interface_point + found.displacement
    share = centre / 2.0
    moved = (1.0 - share) * place[0] + share * place[1] - [centre, 0.05, 0.05]
    np.testing.assert_allclose(moved, 0.5 * force / mass * 0.25, atol=2e-3)


def test_a_free_body_has_its_rigid_motions_once_in_a_craig_bampton_basis(floating):
    """Of 6 constraint modes an interface, 6 are the rigid motions: as many modes as of the supported body."""
    body = floating(modes=8).model
    assert body.mode_count == 8 + 6 * len(ROOT_AND_TIP)
    assert body.rigid_count == 6
    assert FlexibleBody(body, fixed=["root"]).model.mode_count == 8 + 6


@pytest.mark.parametrize("seed", range(4))
def test_the_error_of_a_free_body_s_step_is_told_in_proportion_where_membrane_energy_alone_makes_it(seed):
    """From rest, by a step far below any period; without membrane energy the step is exact."""
    model = body_of_everything(seed, modes=9, free=True)
    rigid, step, shares = model.rigid_count, 4e-3, []
    q = np.concatenate([np.zeros(rigid), 0.5 * np.random.default_rng(seed).standard_normal(9 - rigid)])
    for body in (model, replace(model, membrane=None)):
        run = FlexibleBody(body, Method.SECOND_ORDER, damping_scale=0.0, limits=StepLimits(tolerance=1e9))
        end, work = run.step_with_work(State(q, 0.0 * q), {}, step)
        assert work.substeps == 1
        exact = State(q, 0.0 * q)
        for _ in range(50):
            exact = run.step(exact, {}, step / 50)
        off = [*(body.angular_frequency * (end.q - exact.q))[rigid:], *(end.v - exact.v)[rigid:]]
        true = np.linalg.norm(off) / np.sqrt(2.0 * sum(run.energies(exact)))
        shares.append((work.error, true))
    (told, true), (none, exact) = shares
    assert true > 1e-4
    assert 0.35 < told / true < 0.45
    assert max(none, exact) < 1e-9
