"""Mass of the deformed body: against the finite element model's own, closed forms, conservation laws and CalculiX."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.defaults.bodies import fork, twisted_blade
from benchmarks.defaults.published import twisted_cantilever
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from bodies import beam_body, random_lumps
from flexfmu.body import reference_loads
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.body.reference_loads import keeps_its_mass, mass_modes
from flexfmu.build import reduce as build
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import read_body_model, reduce_body
from flexfmu.build.tables import FormulationTable, InputTable, InterfaceTable, MeshTable, OutputTable
from flexfmu.fe import nonlinear
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import ModalFileError, OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.mesh.elements import ElementType
from flexfmu.model.inertia import without_frames
from flexfmu.model.methods import Mass, Method, Variant, masses_of
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.program.mechanics import inertial_modes
from flexfmu.reduction import masses as lumping, piece
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.options import Basis
from flexfmu.reduction.rigid_fit import model_mass
from meshes import grid, lattice
from reference import Reference
from references import BEAM, DEMO, L_FRAME, calculix, displacement, relative
from turns import exponential

HEAVY = Mass.CONFIGURATION
CURVED = DEMO / "curved"
# Whatever the error, the step is taken in one.
ONE_STEP = StepLimits(0.0, 1e300)
LENGTH, SIDE, DENSITY, YOUNG = 1.0, 0.03, 7850.0, 2.0e11
ROOT_AND_TIP = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]


@pytest.fixture(scope="module")
def beam(bodies):
    """The clamped beam with its lumps, undamped."""

    def make(frames, modes=10, limits=None, mass=Mass.CONFIGURATION, method=Method.FRAMES, known=0):
        stored = {"modes": modes, "inertia": True, "second_order": True}
        reduction = bodies.config(BEAM).reduction.model_copy(update=stored)
        model = replace(bodies.beam(frames=frames, reduction=reduction).model, mass_modes=known)
        return FlexibleBody(model, method, mass, damping_scale=0.0, limits=limits)

    return make


@pytest.fixture(scope="module")
def floating(bodies):
    """The beam that nothing holds."""

    def make(frames=4, modes=8, mass=HEAVY, **options):
        changes = {"basis": Basis.CRAIG_BAMPTON, "modes": modes, "inertia": True}
        reduction = bodies.config(BEAM).reduction.model_copy(update=changes)
        body = bodies.beam(
            free=True,
            support=[],
            reduction=reduction,
            frames=frames,
            interface=ROOT_AND_TIP,
            input=InputTable(acceleration=True),
        )
        return FlexibleBody(body.model, Method.FRAMES, mass, **options)

    return make


@pytest.fixture(scope="module")
def whole(bodies):
    """The L-frame with four frames and some number of lumps, and the finite element model that it was made of."""

    @cache
    def make(count=lumping.LUMPS):
        known = {}
        original = piece.lumped_mass

        def watched(mesh, shapes, lumps, frames, carried):
            # The first lumps are the body's own, those of the fine tree follow.
            found = {"mesh": mesh, "volumes": mesh.volume_matrices, "shapes": shapes, "lumps": lumps}
            known.update({} if known else found)
            return original(mesh, shapes, lumps, frames, carried)

        config = bodies.config(L_FRAME)
        reduction = config.reduction.model_copy(update={"modes": 6, "inertia": True})
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(piece, "lumped_mass", watched)
            patch.setattr(lumping, "LUMPS", count)
            body = config.model_copy(update={"frames": 4, "reduction": reduction})
            return build.reduce_body(body, Reporter(), Store(None)), known

    return make


def mass_at(model, q):
    return FlexibleBody(model, Method.FRAMES, HEAVY).mass(State(q, q))


def kinetic(body, state):
    return body.energies(state)[1]


def bent(model, random, size=30.0):
    """Modal coordinates that turn frames by tenths of a radian against each other."""
    return size * random.standard_normal(model.mode_count) / model.angular_frequency


def element_places(model, finite, q):
    """Nodes (elements, nodes, 3) of each block's elements, moved by the frames that own the elements."""
    mesh, shapes = finite["mesh"], finite["shapes"]
    position, rotation = FlexibleBody(model, Method.FRAMES).core.nodes_at(q)
    owner = np.full(mesh.element_count, -1)
    for s, elements in finite["lumps"]:
        owner[elements] = s
    assert np.all(owner >= 0)
    u = (shapes @ q).reshape(-1, 3)
    result, first = [], 0
    for block in mesh.blocks:
        s = owner[first : first + len(block.labels)]
        arm = mesh.points[block.connectivity] - model.joint_point[s][:, None]
        turn = np.cross((model.frame_rotation @ q)[s][:, None], arm)
        local = arm + u[block.connectivity] - (model.joint_displacement @ q)[s][:, None] - turn
        result.append(position[s][:, None] + np.einsum("eij,eaj->eai", rotation[s], local))
        first += len(block.labels)
    return result


@pytest.mark.slow
def test_the_mass_comes_to_that_of_all_finite_element_nodes_with_the_square_of_the_lumps_size(whole, random):
    model, finite = whole()
    q, step = bent(model, random), 1e-5
    expected = np.zeros((model.mode_count, model.mode_count))
    density = finite["mesh"].materials[0].density
    slopes = []
    for unit in np.eye(model.mode_count):
        ends = (element_places(model, finite, q + sign * step * unit) for sign in (1.0, -1.0))
        slopes.append([(a - b) / (2.0 * step) for a, b in zip(*ends, strict=True)])
    for number, volumes in enumerate(finite["volumes"]):
        jacobian = np.array([slope[number] for slope in slopes])
        expected += density * np.einsum("meai,eab,nebi->mn", jacobian, volumes, jacobian, optimize=True)
    change = np.max(np.abs(expected - np.eye(model.mode_count)))
    assert change > 0.1
    errors = {n: np.max(np.abs(mass_at(whole(n)[0], q) - expected)) / change for n in (8, lumping.LUMPS, 32)}
    assert errors[8] < 0.05
    assert errors[lumping.LUMPS] < 0.01
    assert errors[8] / errors[32] > 8.0


@pytest.mark.slow
def test_every_lump_is_a_connected_share_of_one_frame_and_together_they_are_the_body(whole):
    model, finite = whole()
    every = np.concatenate([elements for _, elements in finite["lumps"]])
    np.testing.assert_array_equal(np.sort(every), np.arange(finite["mesh"].element_count))
    assert model.inertia.mass.size == lumping.LUMPS
    assert model.inertia.mass.sum() == pytest.approx(model.properties.mass, rel=1e-12)
    np.testing.assert_array_equal(np.unique(model.inertia.frame), np.arange(4))


def test_lumps_of_a_graded_bar_weigh_the_same_whatever_the_sizes_of_its_elements():
    """A uniform bar halved four times at its centres of mass, with elements of 0.3 to 35 % of a lump."""
    count = 240

    def place(p):
        return np.column_stack([(1.02 ** p[:, 0] - 1.0) / (1.02**count - 1.0), 0.01 * p[:, 1:]])

    mesh = lattice(ElementType.C3D8I, grid(count, 1, 1), place)
    lumps = lumping.element_lumps(mesh, [SimpleNamespace(elements=np.arange(count), floating=False)])
    volume = np.concatenate([each.sum(axis=(1, 2)) for each in mesh.volume_matrices])
    shares = lumping.LUMPS * np.array([volume[elements].sum() for _, elements in lumps]) / volume.sum()
    np.testing.assert_allclose(shares, np.ones(lumping.LUMPS), atol=0.2)


@pytest.mark.slow
def test_the_undeformed_body_has_unit_modal_mass(whole, beam, floating):
    for model in (whole()[0], beam(8).model, floating().model):
        np.testing.assert_allclose(mass_at(model, np.zeros(model.mode_count)), np.eye(model.mode_count), atol=1e-9)


@pytest.mark.slow
def test_lumps_in_another_basis_are_those_of_the_turned_modes(whole, random):
    model, _ = whole()
    turn = np.linalg.qr(random.standard_normal((model.mode_count, 4)))[0]
    z = 0.1 * random.standard_normal(4)
    moved = {name: getattr(model.inertia, name) @ turn for name in ("displacement", "sweep")}
    turned = replace(
        model,
        angular_frequency=np.arange(1.0, 5.0),
        damping_ratio=np.zeros(4),
        frequency_spread=None,
        inertia=without_frames(replace(model.inertia, curvature=None, **moved), 0),
        whole=None,
        surface=None,
        polynomial=None,
        shadow=None,
        **{
            name: getattr(model, name) @ turn
            for name in (
                "interface_displacement",
                "interface_rotation",
                "joint_displacement",
                "joint_rotation",
                "frame_rotation",
                "watched_rotation",
                "watched_strain",
            )
        },
    )
    np.testing.assert_allclose(mass_at(turned, z), turn.T @ mass_at(model, turn @ z) @ turn, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
@pytest.mark.parametrize("push", [[0.0, 0.0, 0.0], [300.0, -200.0, 500.0]])
def test_the_motion_is_that_of_an_independent_integrator(beam, push, method):
    """(14) as it stands: d(M q̇)/dt − ½ ∂(q̇ᵀ M q̇)/∂q + 2ZΩ q̇ + Λq = Q, derivatives of M by differences."""
    model = beam(2, modes=3).model
    body = FlexibleBody(model, method, HEAVY, limits=StepLimits(0.0, 1e-9))
    reference, m = Reference(model, method), model.mode_count

    def mass(q):
        return body.mass(State(q, q))

    omega, zeta, small = model.angular_frequency, model.damping_ratio, 1e-5
    inputs = np.array([*push, 0.0, 0.0, 20.0])
    # Bent far and swinging: inertia is that of the deformed body.
    start = np.array([0.5, -0.3, 0.02]), np.array([60.0, -40.0, 25.0])

    def rate(_, y):
        q, v = y[:m], y[m:]
        slope = [mass(q + small * e) - mass(q - small * e) for e in np.eye(m)]
        slope = np.array(slope) / (2.0 * small)
        convective = np.einsum("kij,k,j->i", slope, v, v) - 0.5 * np.einsum("kij,i,j->k", slope, v, v)
        force = reference.force(inputs, q) - omega**2 * q - 2.0 * zeta * omega * v - convective
        return np.concatenate([v, np.linalg.solve(mass(q), force)])

    end = 4e-3
    exact = solve_ivp(rate, (0.0, end), np.concatenate(start), method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
    found = body.step_packed(State(*start), inputs, end)[0]
    assert np.linalg.norm(mass(exact[:m]) - np.eye(m)) > 0.05
    scale = np.linalg.norm([omega * exact[:m], exact[m:]])
    assert np.linalg.norm([omega * (found.q - exact[:m]), found.v - exact[m:]]) < 1e-5 * scale


def rigid_rotation(model, rate):
    """Modal velocities (m,) of a spin about the centre of mass."""
    v = np.zeros(model.mode_count)
    motions = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    v[:6] = np.linalg.solve(motions, [0.0, 0.0, 0.0, *rate])
    return v


def rigid_shift(model, velocity):
    """Modal velocities (m,) of a translation."""
    v = np.zeros(model.mode_count)
    motions = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    v[:6] = np.linalg.solve(motions, [*velocity, 0.0, 0.0, 0.0])
    return v


@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0])
def test_a_rigid_spin_has_the_kinetic_energy_of_a_block_however_far_it_has_turned(floating, angle):
    body = floating()
    direction = rigid_rotation(body.model, [0.0, 0.0, 1.0])
    mass = DENSITY * LENGTH * SIDE**2
    inertia = mass * (LENGTH**2 + SIDE**2) / 12.0
    assert kinetic(body, State(angle * direction, 7.0 * direction)) == pytest.approx(0.5 * inertia * 49.0, rel=1e-9)


def momenta(body, state):
    """Linear momentum, and angular momentum about the origin from which the root frame's displacement counts."""
    model = body.model
    motion = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    # Rates are those of the root's displacement, and its spin in its own axes.
    linear, own = np.split(np.linalg.solve(motion.T, (body.mass(state) @ state.v)[:6]), 2)
    displacement, angle = np.split(motion @ state.q[:6], 2)
    return linear, exponential(angle) @ own + np.cross(displacement, linear)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 15), marks=pytest.mark.long)])
@pytest.mark.parametrize("mass", [Mass.CONSTANT, HEAVY])
def test_a_free_body_that_bends_while_it_spins_keeps_its_momenta_and_energy_to_round_off(floating, mass, seeds):
    """About all axes and for any turn: 0.5 s at 34 rad/s are 2.7 turns.

    Momenta hold for any iterate. Energy holds at the solution: an iterate within ε = 1e-12 of it, in the energy norm,
    gains or loses 2ε of the energy. Of either sign, n of them add up to some 2ε√n, here to less than three times that.
    """
    body = floating(damping_scale=0.0, limits=ONE_STEP, mass=mass)
    for seed in seeds:
        v = rigid_rotation(body.model, [15.0, 5.0, 30.0]) + rigid_shift(body.model, [1.0, -2.0, 3.0])
        # Bending in both planes, some 5 cm of it.
        v[6:10] = 10.0 * np.random.default_rng(seed).standard_normal(4)
        state, internal = State(np.zeros_like(v), v), 0
        (linear, angular), energy = momenta(body, state), sum(body.energies(state))
        for _ in range(250):
            state, work = body.step_with_work(state, {}, 2e-3)
            internal += work.substeps
        now = momenta(body, state)
        np.testing.assert_allclose(now[0], linear, atol=1e-11 * np.linalg.norm(linear))
        np.testing.assert_allclose(now[1], angular, atol=1e-10 * np.linalg.norm(angular))
        assert sum(body.energies(state)) == pytest.approx(energy, rel=6e-12 * np.sqrt(internal))
        bent = 0.5 * float(np.sum((body.model.angular_frequency * state.q) ** 2))
        assert bent > 1e-3 * energy


def test_the_error_told_of_a_short_step_is_the_true_one_of_a_free_body_that_spins_and_bends(floating):
    body = floating(damping_scale=0.0, limits=ONE_STEP, mass=HEAVY)
    omega = body.model.angular_frequency
    v = rigid_rotation(body.model, [15.0, 5.0, 30.0])
    v[6:10] = 10.0 * np.random.default_rng(3).standard_normal(4)
    start, step = State(np.zeros_like(v), v), 1e-5
    for _ in range(20):
        start = body.step(start, {}, 2e-4)
    end, work = body.step_with_work(start, {}, step)
    exact = start
    for _ in range(10):
        exact = body.step(exact, {}, step / 10)
    off = np.concatenate([omega * (end.q - exact.q), end.v - exact.v])
    assert work.error == pytest.approx(np.linalg.norm(off) / np.sqrt(2.0 * sum(body.energies(exact))), rel=0.05)


def test_a_spinning_rod_stretches_under_centrifugal_force(floating):
    """u(L/2) = ρ ω² L³/(24 E) at each end, from E u″ = −ρ ω² x with free ends."""
    body = floating(damping_scale=70.0)
    rate = 60.0
    state = State(np.zeros(body.model.mode_count), rigid_rotation(body.model, [0.0, 0.0, rate]))
    for _ in range(20):
        state = body.step(state, {}, 5e-4)
    ends = body.model.interface_point + body.response(state).displacement
    stretch = np.linalg.norm(ends[1] - ends[0]) - LENGTH
    assert np.linalg.norm(body.response(state).rotation[1]) == pytest.approx(0.6, rel=1e-3)
    assert 0.5 * stretch == pytest.approx(DENSITY * rate**2 * LENGTH**3 / (24.0 * YOUNG), rel=5e-3)


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
@pytest.mark.parametrize("step", [2e-4, 1e-3])
@pytest.mark.parametrize("known", [0, 8])
def test_a_sudden_dead_load_changes_no_energy_at_any_step_length(beam, step, method, known):
    # The tenth mode's period is 0.8 ms; the seventh twists, and its mass becomes five times as large.
    body = beam(4, limits=ONE_STEP, method=method, known=known)
    state, force, largest, worst = body.rest(), np.array([0.0, 5e3, 1e3]), 0.0, 0.0
    for _ in range(100):
        state = body.step(state, {"tip": force}, step)
        total = kinetic(body, state) + 0.5 * float(np.sum((body.model.angular_frequency * state.q) ** 2))
        largest = max(largest, total)
        worst = max(worst, abs(total - force @ body.response(state).displacement[0]))
    assert largest > 500.0
    assert worst < 1e-11 * largest


def test_the_step_is_of_second_order_and_reversible(beam):
    body = beam(2, modes=5, limits=ONE_STEP)
    loads, end = {"tip": [0.0, 10e3, 2e3, 0.0, 0.0, 100.0]}, 0.016

    def run(count, state, sign=1.0):
        for _ in range(count):
            state = body.step(state, loads, end / count)
        return np.concatenate([body.model.angular_frequency * state.q, sign * state.v]), state

    fine, _ = run(1024, body.rest())
    errors = np.array([np.linalg.norm(run(n, body.rest())[0] - fine) for n in (32, 64, 128)]) / np.linalg.norm(fine)
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.15)
    _, there = run(64, body.rest())
    back, _ = run(64, State(there.q, -there.v))
    # Twice as far from round-off as the iteration's tolerance allows in 128 steps.
    assert np.linalg.norm(back) < 1e-8 * np.linalg.norm(fine)


def test_the_step_is_divided_until_the_tolerance_holds(beam):
    loads, end = {"tip": [0.0, 10e3, 0.0]}, 8e-3
    fine = beam(2, modes=5, limits=StepLimits(0.0, 1e-8))
    rough = beam(2, modes=5, limits=StepLimits(0.0, 1e-4))
    exact = fine.step(fine.rest(), loads, end)
    found, work = rough.step_with_work(rough.rest(), loads, end)
    assert work.error <= 1e-4
    assert work.substeps > 2
    omega = fine.model.angular_frequency
    difference = np.concatenate([omega * (found.q - exact.q), found.v - exact.v])
    assert np.linalg.norm(difference) < 1e-4 * work.substeps * np.linalg.norm([*(omega * exact.q), *exact.v])


def test_static_equilibria_know_nothing_of_mass(beam):
    loads = {"tip": [0.0, 10e3, 0.0]}
    both = [body.static(loads).q for body in (beam(4), beam(4, mass=Mass.CONSTANT))]
    np.testing.assert_allclose(*both, rtol=0.0, atol=1e-13 * np.max(np.abs(both)))


def followed(model, method, mass, table, course):
    """Tip displacements (n, 3) of an undamped motion from rest; loads are linear between the table's times."""
    body = FlexibleBody(model, method, mass, damping_scale=0.0)
    state, times = body.rest(), table["time_s"]
    found = [np.zeros(3)]
    for start, end in pairwise(times):
        state, _ = body.step_with_work(state, {"tip": course(start)}, end - start, {"tip": course(end)})
        found.append(body.response(state).displacement[0])
    return np.array(found)


# Of each motion: folder, mesh, results, modes, static shapes, force (N), frequency (Hz, none for a sudden load), how
# far the tip moves (m), and errors in % with one and two frames.
MOTIONS = {
    "beam": (BEAM, "beam.inp", "sudden_load", 10, False, (0.0, 5e3, 0.0), None, 0.23, (2.5, 0.4)),
    "L-frame": (L_FRAME, "l_frame.inp", "sudden_load", 20, False, (0.0, 0.0, 1.7e3), None, 0.14, (0.6, 0.25)),
    "quarter arc": (CURVED, "arc_90.inp", "arc_90_shaken", 10, True, (0.0, 300.0, 600.0), 22.0, 0.13, (0.1, 0.03)),
}


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["quarter arc", "beam", "L-frame"])
def test_to_second_order_the_deformed_body_s_mass_follows_the_nonlinear_transient(bodies, motion):
    """CalculiX's, with one and two frames; the constant mass leaves what frames cannot mend."""
    folder, mesh, results, modes, residual, force, hertz, far, errors = MOTIONS[motion]
    table = calculix(folder / "calculix" / f"{results}.csv")
    expected = displacement(table)
    assert np.max(np.linalg.norm(expected, axis=1)) > far
    config = bodies.config(folder)
    stored = {"modes": modes, "residual_flexibility": residual, "inertia": True, "second_order": True}
    changes = {"reduction": config.reduction.model_copy(update=stored), "mesh": MeshTable(file=folder / mesh)}

    def course(time):
        return np.array(force) * (1.0 if hertz is None else np.sin(2.0 * np.pi * hertz * time))

    for frames, most in zip((1, 2), errors, strict=True):
        model = reduce_body(config.model_copy(update=changes | {"frames": frames}), Reporter())
        found = followed(model, Method.SECOND_ORDER, HEAVY, table, course)
        assert 100.0 * relative(found, expected) < most
    assert 100.0 * relative(followed(model, Method.SECOND_ORDER, Mass.CONSTANT, table, course), expected) > 0.8


def test_with_frames_alone_the_deformed_body_s_mass_follows_the_sudden_load(beam):
    table = calculix(BEAM / "calculix" / "sudden_load.csv")
    expected = displacement(table)
    for frames, most in ((4, 0.0035), (8, 0.003)):
        found = followed(beam(frames).model, Method.FRAMES, HEAVY, table, lambda _: (0.0, 5e3, 0.0))
        assert relative(found, expected) < most


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
@pytest.mark.parametrize("step", [1e-5, 1e-4])
def test_a_sudden_load_from_rest_takes_no_more_internal_steps_for_round_off(beam, step, method):
    body = beam(8 if method is Method.FRAMES else 2, method=method)
    state = body.rest()
    for _ in range(5):
        state, work = body.step_with_work(state, {"tip": [0.0, 5e3, 0.0]}, step)
        assert work.substeps == 1
        assert work.iterations <= 6


@pytest.mark.slow
def test_a_bent_blade_vibrates_as_the_bent_finite_element_model(tmp_path):
    """A twisted one: where the mass of six coordinates changes alone, its fifth frequency is 3.2 % off."""
    blade, force = twisted_blade(), np.array([0.0, -160.0, 160.0])
    config = read_body_file(blade.write(tmp_path))
    found = read_body_model(config, Reporter())
    mesh, unknowns = found.model.mesh, found.model.unknowns
    load = fit_interface(found.options.interfaces[0], mesh, []).nodal_loads(len(mesh.points))[:, :3] @ force
    bent = load_path(mesh, unknowns, found.model.spring, load, [1.0], Reporter()).displacement[0]
    tangent = nonlinear._Body(mesh, unknowns, found.model.spring, None).tangent(bent, 0.0 * bent)
    pair = (unknowns.matrix(one).tocsc() for one in (tangent, model_mass(mesh)))
    whole = np.sort(eigsh(next(pair), 8, next(pair), sigma=0.0, return_eigenvectors=False))
    output = OutputTable(surface=False, error=False)
    body = FlexibleBody(reduce_body(config.model_copy(update={"output": output}), Reporter()))
    assert body.variant.mass is Mass.CONFIGURATION
    state = body.static({"tip": force})
    stiffness = body.tangent(state, np.concatenate([force, np.zeros(3)]))
    own = eigh(stiffness, body.mass(state), eigvals_only=True)[:8]
    assert np.abs(whole[3] / body.model.angular_frequency[3] ** 2 - 1.0) > 0.3
    np.testing.assert_allclose(np.sqrt(own), np.sqrt(whole), rtol=5e-3)


def test_lumps_know_of_as_many_coordinates_as_frequencies_of_the_bent_body_need(beam, monkeypatch):
    """The seventh twists: bent, the beam swings about its own root, by five times the inertia that it has straight."""
    model = replace(beam(4).model, mass=Mass.CONFIGURATION)
    assert mass_modes(model, model, dear=True) == 6
    monkeypatch.setattr(reference_loads, "_SMALL", 1e-3)
    found = mass_modes(model, model, dear=True)
    assert 6 < found < model.mode_count
    polynomial = replace(model, method=Method.SECOND_ORDER, mass=Mass.POLYNOMIAL)
    assert mass_modes(polynomial, model, dear=False) == found
    assert mass_modes(polynomial, model, dear=True) == 6
    with monkeypatch.context() as dear:
        dear.setattr(reference_loads, "_DEAR", 0.5)
        assert mass_modes(model, model, dear=True) == 6

    with monkeypatch.context() as wrong:
        wrong.setattr(FlexibleBody, "mass", lambda body, _: -np.eye(body.model.mode_count))
        assert mass_modes(model, model, dear=True) == 6

    def frequencies(known):
        body = FlexibleBody(replace(model, mass_modes=known), Method.SECOND_ORDER, Mass.CONFIGURATION)
        force = np.array([0.0, 4e3, 0.0])
        stiffness = body.tangent(state := body.static({"tip": force}), np.concatenate([force, np.zeros(3)]))
        return np.sqrt(eigh(stiffness, body.mass(state), eigvals_only=True)[:3])

    whole = frequencies(model.mode_count)
    assert np.abs(frequencies(6) / whole - 1.0).max() > 1.5e-3
    np.testing.assert_allclose(frequencies(found), whole, rtol=1e-3)


@pytest.mark.slow
def test_a_twisted_cantilever_swings_as_with_the_mass_of_all_coordinates(tmp_path):
    """By six of them, or the polynomial, the motion was 16 % off in silence, within three periods."""
    body = twisted_cantilever()
    config = read_body_file(body.write(tmp_path)).model_copy(update={"output": OutputTable(surface=False, error=False)})
    default = reduce_body(config, Reporter())
    assert default.mass is Mass.CONFIGURATION
    finer = {"frames": 16, "formulation": FormulationTable(method=Method.SECOND_ORDER, mass=Mass.CONFIGURATION)}
    fine = replace(reduce_body(config.model_copy(update=finer), Reporter()), mass_modes=default.mode_count)
    models = FlexibleBody(default), FlexibleBody(fine, limits=StepLimits(0.0, 1e-5))
    loads = {name: [0.5 * one for one in force] for name, force in body.cases["down"].items()}
    step, states = 2.0 * np.pi / (50.0 * default.angular_frequency[0]), [one.rest() for one in models]
    moved = []
    for _ in range(150):
        states = [one.step(state, loads, step) for one, state in zip(models, states, strict=True)]
        moved.append([one.response(state).displacement[0] for one, state in zip(models, states, strict=True)])
    own, whole = np.swapaxes(moved, 0, 1)
    assert np.abs(whole).max() > 2.0
    assert np.linalg.norm(own - whole) < 0.015 * np.linalg.norm(whole)


def test_stiff_coordinates_whose_mass_counts_do_not_ring_where_steps_pass_over_them(tmp_path):
    """A force that is constant over each internal step of T/50 set them ringing: the motion was 17 % off."""
    body = twisted_cantilever()
    config = read_body_file(body.write(tmp_path)).model_copy(update={"output": OutputTable(surface=False, error=False)})
    found = reduce_body(config, Reporter())
    stiff = found.angular_frequency[inertial_modes(found) : inertial_modes(found, rates=True)]
    step = 2.0 * np.pi / (50.0 * found.angular_frequency[0])
    assert stiff.size == 5
    assert stiff.min() * step > 3.0
    models = [FlexibleBody(found, limits=StepLimits(0.0, tolerance)) for tolerance in (1e300, 1e-4)]
    loads = {name: [0.2 * one for one in force] for name, force in body.cases["down"].items()}
    states, moved, internal = [one.rest() for one in models], [], 0
    for _ in range(100):
        both = [one.step_with_work(state, loads, step) for one, state in zip(models, states, strict=True)]
        states, internal = [state for state, _ in both], internal + both[0][1].substeps
        moved.append([one.response(state).displacement[0] for one, state in zip(models, states, strict=True)])
    own, exact = np.swapaxes(moved, 0, 1)
    assert internal < 110
    assert np.linalg.norm(own - exact) < 0.02 * np.linalg.norm(exact)


def test_where_lumps_are_too_coarse_the_polynomial_of_few_rates_stays_which_reaches_further(tmp_path, monkeypatch):
    config = read_body_file(twisted_cantilever().write(tmp_path))
    config = config.model_copy(update={"output": OutputTable(surface=False, error=False)})
    monkeypatch.setattr(build, "lumps_are_fine", lambda _: False)
    found = reduce_body(config, Reporter())
    assert found.mass is Mass.POLYNOMIAL
    assert inertial_modes(found, rates=True) == inertial_modes(found)
    assert keeps_its_mass(found)


@pytest.mark.slow
def test_stiff_coordinates_that_lumps_move_do_not_ring_between_steps(tmp_path):
    """Of a fork whose tines are bent aside: with errors weighed as by steps that resolve them it was 11 % off."""
    body = fork()
    formulation = FormulationTable(method=Method.SECOND_ORDER, mass=Mass.CONFIGURATION)
    given = {"output": OutputTable(surface=False, error=False), "formulation": formulation, "frames": 15}
    config = read_body_file(body.write(tmp_path)).model_copy(update=given)
    found = replace(reduce_body(config, Reporter()), mass_modes=18)
    models = [FlexibleBody(found, limits=limits) for limits in (None, StepLimits(0.0, 1e-5))]
    loads = {name: [0.2 * one for one in force] for name, force in body.cases["bent"].items()}
    step, states, moved = 2.0 * np.pi / (50.0 * found.angular_frequency[0]), [one.rest() for one in models], []
    for _ in range(150):
        states = [one.step(state, loads, step) for one, state in zip(models, states, strict=True)]
        moved.append([one.response(state).displacement for one, state in zip(models, states, strict=True)])
    own, exact = np.swapaxes(moved, 0, 1)
    assert np.linalg.norm(own - exact) < 0.01 * np.linalg.norm(exact)


def test_stiff_coordinates_are_propagated_as_with_constant_mass(beam):
    """The axial mode, 52 times the first frequency, is none whose inertia changes."""
    body = beam(4)
    omega, q = body.model.angular_frequency, body.model.mode_count
    slow = omega <= 20.0 * omega[0]
    assert 2 < np.sum(slow) < q
    state = body.static({"tip": [0.0, 10e3, 2e3]})
    change = body.mass(state) - np.eye(q)
    assert np.max(np.abs(change[np.ix_(slow, slow)])) > 0.02
    np.testing.assert_array_equal(change[~slow], 0.0)
    np.testing.assert_array_equal(change[:, ~slow], 0.0)


@pytest.mark.slow
def test_a_body_with_its_lumps_comes_back_from_its_file(whole, tmp_path):
    model = replace(whole()[0], mass=HEAVY)
    write_modal_file(model, tmp_path / "body.h5")
    back = read_modal_file(tmp_path / "body.h5")
    assert back.mass is HEAVY
    for name in ("frame", "mass", "point", "displacement", "turning", "sweep"):
        np.testing.assert_array_equal(getattr(back.inertia, name), getattr(model.inertia, name))


@pytest.mark.parametrize("method", [m for m in Method if HEAVY not in masses_of(m)])
def test_other_methods_are_refused_with_the_reason(method):
    known = 'goes with methods "frames" and "second_order" only'
    with pytest.raises(OptionError, match=f'{known}, not with "{method.value}"'):
        Variant(method, HEAVY)


def test_a_body_built_without_its_lumps_is_refused():
    with pytest.raises(OptionError, match=r"inertia = true in \[reduction\]"):
        FlexibleBody(beam_body(2), mass=HEAVY)


def test_lumps_of_another_body_are_refused(random):
    with pytest.raises(ModalFileError, match=r"inertia: displacement has shape \(16, 3, 6\), expected \(16, 3, 12\)"):
        beam_body(4, inertia=random_lumps(random, 8, 6))


@pytest.mark.slow
def test_the_body_file_stores_lumps_where_the_mass_asks_for_them(bodies):
    config = bodies.config(BEAM).model_dump(exclude_unset=True)
    config["formulation"] = {"method": "frames", "mass": "configuration"}
    reduction = bodies.config(BEAM).reduction.model_copy(update={"modes": 2})
    heavy = BodyFile.model_validate(config).model_copy(update={"reduction": reduction})
    assert reduce_body(heavy, Reporter()).inertia is not None
    assert bodies.beam(modes=2).model.inertia is None
    config["reduction"] |= {"inertia": False}
    with pytest.raises(ValueError, match=r"needs inertia = true, and \[reduction\] says otherwise"):
        BodyFile.model_validate(config)
