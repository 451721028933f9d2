"""Static shapes of second and third order: they are those of the nonlinear finite element model."""

from dataclasses import replace

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.fe.gradients import quadratic_strain, stress_stiffness, stressed_gradients
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.outputs import Reporter, tell_nobody
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.model.inertia import Membrane
from flexfmu.reduction.basis import Matrices, _buckled_shapes, third_order_loads
from flexfmu.reduction.bodies import InterfaceFit, fit_interface
from flexfmu.reduction.fourth_order import FourthOrder
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.modes import normal_modes, with_residual_flexibility
from flexfmu.reduction.rigid_fit import by_node, rigid_fit
from flexfmu.reduction.third_order import (
    fitted_motion,
    lever_sums,
    missed_energy,
    third_order_motion,
    turning_forces,
)
from flexfmu.study.scene.whole_model import finite_motion
from meshes import STEEL, arc, body_file, box, grid, lattice
from references import relative

KINDS = [ElementType.C3D20, ElementType.C3D10, ElementType.C3D8I]


def matrices_and_loads(mesh, folder, support="ROOT", interface="TIP"):
    """Matrices of a body, and nodal forces of unit forces on its interface."""
    config = body_file(mesh, folder, interface=[interface], support=support).options
    model = assemble_model(checked(mesh), config)
    matrices = Matrices(model, Reporter())
    fit = fit_interface(config.interfaces[0], model.mesh, [])
    return matrices, fit.nodal_loads(len(model.mesh.points))


@pytest.mark.parametrize("kind", KINDS)
def test_forces_of_third_order_are_the_gradient_of_the_membrane_energy(kind, tmp_path):
    matrices, loads = matrices_and_loads(arc(kind, (4, 1, 1), 1.0, 0.2, angle=1.2), tmp_path)
    model = matrices.supported
    x, other, y = (
        shape / np.abs(shape).max() for shape in model.whole(model.static(model.forces(loads[:, [2, 1, 4]]))).T
    )
    fields, pairs = np.column_stack([x, other]), np.array([[0, 0], [0, 1], [1, 1]])
    strained, _ = quadratic_strain(matrices.model.mesh, fields, pairs, tell_nobody)
    responses = -model.whole(model.static(model.forces(strained)))
    force = stressed_gradients(matrices.model.mesh, fields, responses, pairs)[:, :, 2:].sum(axis=(1, 2))

    def energy(part):
        motion = (x + other + part * y)[:, None]
        return FourthOrder(matrices).stretching(motion, pairs[:1], motion)[0][0, 0]

    slope = (energy(1e-3) - energy(-1e-3)) / 2e-3
    assert slope != 0.0
    assert y @ force == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_forces_of_second_order_are_those_of_the_nonlinear_model(kind, tmp_path):
    matrices, loads = matrices_and_loads(arc(kind, (4, 1, 1), 1.0, 0.2, angle=1.2), tmp_path)
    model, mesh = matrices.supported, matrices.model.mesh
    load = 1e6 * loads[:, 0] + 2e6 * loads[:, 2]
    x = model.whole(model.static(model.forces(load[:, None])))
    size = 1e-3
    ends = [
        load_path(mesh, matrices.model.unknowns, matrices.model.spring, sign * load, [size], Reporter())
        for sign in (1.0, -1.0)
    ]
    # Half the second derivative of the displacement along the load.
    curved = sum(end.displacement[0] for end in ends) / (2.0 * size**2)
    pair = np.array([[0, 0]])
    strained, _ = quadratic_strain(mesh, x, pair, tell_nobody)
    force = stressed_gradients(mesh, x, np.zeros_like(x), pair)[:, 0, :1]
    expected = -model.whole(model.static(model.forces(strained + force)))[:, 0]
    assert np.linalg.norm(expected) > 1e-3 * np.linalg.norm(x)
    assert np.linalg.norm(curved - expected) < 1e-4 * np.linalg.norm(expected)


def test_shapes_of_third_order_are_what_a_basis_of_few_modes_lacks(tmp_path):
    matrices, loads = matrices_and_loads(box(ElementType.C3D20, (6, 4, 1), (1.0, 0.7, 0.02)), tmp_path)
    model = matrices.supported
    modes = with_residual_flexibility(model, normal_modes(model, 4), loads)
    forces = third_order_loads(matrices, modes, loads, 1e-6, (6, 2))
    # Six of all loads, and two of the only interface's, stiffer ones too.
    assert forces.shape[1] == 8

    def lacked(modes):
        """Energies of the shapes outside a basis."""
        static = model.static(model.forces(forces))
        held = (modes.shapes / modes.angular_frequency).T @ forces
        return model.forces(forces).T @ static - held.T @ held

    # Of unit energy outside the basis, each by itself; a basis that has them lacks none of them.
    np.testing.assert_allclose(lacked(modes), np.eye(8), atol=1e-6)
    completed = with_residual_flexibility(model, modes, forces)
    assert completed.angular_frequency.size == modes.angular_frequency.size + 8
    np.testing.assert_allclose(lacked(completed), np.zeros((8, 8)), atol=1e-6)


def test_shapes_of_buckling_are_those_of_a_strut(tmp_path):
    """Clamped at one end: π²EI/4l² about either axis, nine times as much for the next shape; none in tension."""
    long, wide, high = 1.0, 0.03, 0.02
    matrices, loads = matrices_and_loads(box(ElementType.C3D20R, (16, 1, 1), (long, wide, high)), tmp_path)
    model = matrices.supported
    first = np.pi**2 * STEEL.youngs_modulus * wide * high**3 / 12.0 / (4.0 * long**2)
    pressed = model.whole(model.static(model.forces(-20.0 * first * loads[:, :1])))[:, 0]
    stress = model.unknowns.matrix(stress_stiffness(matrices.model.mesh, pressed))
    shapes = _buckled_shapes(matrices, pressed)
    critical = [-(x @ (model.stiffness @ x)) / (x @ (stress @ x)) for x in shapes]
    # The third one shears.
    np.testing.assert_allclose(critical, np.array([1.0, (wide / high) ** 2, 9.0]) / 20.0, rtol=0.02)
    assert len(_buckled_shapes(matrices, 0.04 * pressed)) == 0


def crossed_leaves():
    """Two leaves that cross without touching and carry a block: a pivot of two supports."""
    high, wide, thin, leaf = 8, 0.06, 0.001, 0.06
    cells = [(0, j, 0) for j in range(high)] + [(4, j, 2) for j in range(high)]
    cells += [(i, high + j, k) for i in range(5) for j in range(2) for k in range(3)]

    def place(p):
        x = np.interp(p[:, 0], range(6), [0.0, thin, wide / 3, wide / 1.5, wide, wide + thin])
        x += np.where(p[:, 0] <= 1, wide, -wide) * (1.0 - np.clip(p[:, 1] / high, 0.0, 1.0))
        y = np.interp(p[:, 1], [0, high, high + 2], [0.0, leaf, leaf + 0.015])
        return np.column_stack([x, y, np.interp(p[:, 2], range(4), [0.0, 0.015, 0.019, 0.034])])

    mesh = lattice(ElementType.C3D20, cells, place)
    y = mesh.points[:, 1]
    return replace(mesh, node_sets={"ROOT": np.flatnonzero(y < 1e-9), "TIP": np.flatnonzero(y > leaf + 0.0149)})


def twisted_bar():
    """A flat bar that is twisted by a quarter of a turn."""

    def place(p):
        turn = 0.5 * np.pi * p[:, 0] / 12
        y, z = 0.5 * (p[:, 1] / 2 - 0.5), 0.25 * (p[:, 2] - 0.5)
        return np.column_stack(
            [p[:, 0] / 1.2, y * np.cos(turn) - z * np.sin(turn), y * np.sin(turn) + z * np.cos(turn)]
        )

    mesh = lattice(ElementType.C3D20, grid(12, 2, 1), place)
    x, (y, z) = mesh.points[:, 0], np.abs(mesh.points[:, 1:]).T
    root = (x < 1e-9) & (y < 0.26)
    return replace(mesh, node_sets={"ROOT": np.flatnonzero(root), "TIP": np.flatnonzero((x > 9.999) & (z < 0.26))})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "force", "limit", "without"),
    [(crossed_leaves, (25.0, 0.0, 0.0), 0.01, 0.05), (twisted_bar, (0.0, 4e6, 0.0), 0.003, 0.01)],
)
def test_the_shortest_body_file_follows_bodies_that_evade_their_stretch(make, force, limit, without, tmp_path):
    """Pivot turned by 18°, bar bent by 0.4 of its length; before, six static shapes and no membrane energy."""
    mesh = make()
    matrices, loads = matrices_and_loads(mesh, tmp_path)
    model, load = matrices.model, loads[:, :3] @ np.array(force)
    path = load_path(model.mesh, model.unknowns, model.spring, load, [1.0], Reporter())
    fit = fit_interface(body_file(mesh, tmp_path, interface=["TIP"]).options.interfaces[0], mesh, [])
    expected = fit.motion(path.displacement.T)[:3, 0]

    def error(**reduction):
        body = FlexibleBody(reduce_body(body_file(mesh, tmp_path, interface=["TIP"], reduction=reduction), Reporter()))
        return relative(body.response(body.static({"tip": list(force)})).displacement[0], expected)

    assert error() < limit
    assert error(residual_flexibility=True, membrane=False) > without


def slit_plate():
    """A flat ring, 3 cm thick and 20 m wide, cut open along a radius and held at one of the lips."""
    count = (48, 4, 1)

    def place(p):
        turn, radius = 2.0 * np.pi * p[:, 0] / count[0], 10.0 - p[:, 1]
        return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), 0.03 * p[:, 2]])

    mesh, along = lattice(ElementType.C3D20R, grid(*count), place), lattice(ElementType.C3D20R, grid(*count), np.array)
    lips = {"ROOT": 0, "TIP": count[0]}
    return replace(mesh, node_sets={name: np.flatnonzero(along.points[:, 0] == at) for name, at in lips.items()})


@pytest.mark.slow
def test_a_basis_that_holds_nearly_all_of_a_thin_body_s_static_shapes_is_completed_by_the_rest(tmp_path):
    matrices, loads = matrices_and_loads(slit_plate(), tmp_path)
    model = matrices.supported
    modes = with_residual_flexibility(model, normal_modes(model, 8), loads, 5e-3)
    forces = third_order_loads(matrices, modes, loads, 0.02, (6, 2))
    few = with_residual_flexibility(model, modes, forces)
    every = with_residual_flexibility(model, few, loads)
    assert few.angular_frequency.size < every.angular_frequency.size
    work = np.einsum("ij,ij->j", model.forces(loads), model.static(model.forces(loads)))
    held = ((loads.T @ every.shapes / every.angular_frequency) ** 2).sum(axis=1)
    # What round-off of so thin a body's stiffness leaves.
    np.testing.assert_allclose(held, work, rtol=2e-3)


class Heard(Reporter):
    """What a build warns of."""

    def __init__(self):
        self.warnings = []

    def warning(self, text):
        self.warnings.append(text)


@pytest.mark.slow
def test_a_bar_one_reduced_element_across_is_right_and_not_warned_of(tmp_path):
    """Under forces of third order, which would set off elements that move without energy."""
    heard, found = Heard(), []
    for across in (1, 2):
        mesh = box(ElementType.C3D20R, (8, across, across), (8.0, 1.0, 1.0))
        body = FlexibleBody(reduce_body(body_file(mesh, tmp_path, interface=["TIP"], name=f"bar{across}"), heard))
        found.append(body.response(body.static({"tip": [0.0, 0.0, 2e7]})).displacement[0])
    assert not heard.warnings
    # CalculiX 2.20, C3D20, NLGEOM: with C3D20R it finds no equilibrium beyond a hundredth of the load.
    assert relative(found[0], np.array([-3.073365e-3, 0.0, 0.2018490])) < 2e-3
    assert relative(*found) < 0.02


@pytest.mark.parametrize("kept", [False, True])
def test_places_of_third_order_are_those_that_the_tree_makes(kept, tmp_path):
    """And rotations; also with a shape of second order among the coordinates."""
    mesh = arc(ElementType.C3D20, (8, 1, 1), 1.0, 0.05, angle=1.2)
    reduced = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], frames=4), Reporter())
    assert reduced.frame_count == 4
    assert np.abs(reduced.second.displacement).max() > 0.0
    if kept:
        linear = np.eye(1, reduced.mode_count) * reduced.angular_frequency / np.sqrt(2.0)
        random = 1e3 * np.random.default_rng(1).standard_normal((1, reduced.mode_count, reduced.mode_count))
        reduced = replace(
            reduced,
            membrane=Membrane.of(np.eye(linear.size), random + random.swapaxes(1, 2), linear, np.ones(1), np.ones(1)),
        )
    core = FlexibleBody(reduced, "second_order").core
    # Out of the plane, too.
    q = 1e-2 / np.arange(1.0, reduced.mode_count + 1)

    def odd(size):
        return 0.5 * (core.motion(size * q) - core.motion(-size * q))

    third = (odd(2.0) - 2.0 * odd(1.0)) / 6.0
    found = third_order_motion(reduced, q[None], np.ones((1, 1)))[0, 0]
    assert found[:3] == pytest.approx(third[:3], rel=1e-2)
    assert found[3:] == pytest.approx(third[3:6], rel=1e-2, abs=1e-2 * np.abs(third[3:6]).max())


def section():
    """A section of seven nodes, read at a point off them, as an interface."""
    points = np.random.default_rng(3).standard_normal((7, 3))
    point = np.array([2.0, -1.0, 1.5])
    weights = by_node(np.arange(7), np.random.default_rng(8).uniform(1.0, 2.0, 7))
    return InterfaceFit(
        "point", point, weights.nodes, np.zeros(0), rigid_fit(points, weights, point)[0], False, 0
    ), points


def off_its_nodes(fit, points):
    return (fit.point - fit.operator[:3] @ points.ravel())[None]


def test_motions_of_a_point_off_its_section_are_right_to_third_order():
    fit, points = section()
    field = 0.02 * np.random.default_rng(4).standard_normal((7, 3))
    turned, sums = fit.operator[3:] @ field.ravel(), (lever_sums(fit.operator[3:].T, x[None]) for x in (points, field))
    third = fitted_motion(turned[None, None], *sums, off_its_nodes(fit, points))[0, 0]
    odd = [0.5 * (finite_motion(fit, points, k * field) - finite_motion(fit, points, -k * field)) for k in (1.0, 2.0)]
    exact = (odd[1] - 2.0 * odd[0]) / 6.0
    assert third == pytest.approx(exact, rel=2e-2, abs=2e-2 * np.abs(exact[3:]).max())


def test_forces_by_which_loads_turn_are_the_gradient_of_their_work():
    fit, points = section()
    fields, loads = np.random.default_rng(5).standard_normal((2, 7, 3)), fit.operator[3:].T
    acting = np.random.default_rng(6).standard_normal((2, 1, 6))
    turned = np.array([loads.T @ field.ravel() for field in fields])[:, None]
    sums = lever_sums(loads, points[None]), lever_sums(loads, fields)
    force = turning_forces(loads, acting, turned, *sums, off_its_nodes(fit, points))

    def second(field):
        size = 1e-3
        even = 0.5 * (finite_motion(fit, points, size * field) + finite_motion(fit, points, -size * field))
        return even / size**2

    for a, b in ((0, 0), (0, 1), (1, 0)):
        for other in fields:
            change = acting[a, 0] @ (second(fields[b] + other) - second(fields[b] - other)) / 2.0
            assert force[:, a, b] @ other.ravel() == pytest.approx(change, rel=1e-3)


def test_squares_of_forms_are_the_work_that_places_miss(tmp_path):
    mesh = arc(ElementType.C3D20, (8, 1, 1), 1.0, 0.05, angle=1.2)
    reduced = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], frames=2), Reporter())
    random = np.random.default_rng(2)
    motions, loads = 1e-2 * random.standard_normal((3, reduced.mode_count)), random.standard_normal((3, 8))
    work = np.diag(1e-6 * random.standard_normal(6))
    sums = [*(1e-2 * random.standard_normal((n, 1, 3, 3, 3)) for n in (1, 3)), random.standard_normal((1, 3))]

    def springs(amplitudes):
        return 1e-6 * np.stack([amplitudes[0] * amplitudes[1] * amplitudes[2], amplitudes[1] ** 3], axis=-1)

    forms, signs = missed_energy(reduced, motions, loads, 0, 0, sums, work, 0.0, springs)
    amplitudes = random.standard_normal(3)
    pairs = np.outer(amplitudes, amplitudes)[np.triu_indices(3)]
    q = (amplitudes @ motions)[None]
    third = third_order_motion(reduced, q, np.ones((1, 1)))[0, 0]
    moved = np.tensordot(amplitudes, sums[1], 1)[None]
    third -= fitted_motion((reduced.interface_rotation @ q[0])[None], sums[0], moved, sums[2])[0, 0]
    found = signs @ np.einsum("kij,i,j->k", forms, amplitudes, amplitudes) ** 2
    assert set(signs) == {-1.0, 1.0}
    assert found == pytest.approx(
        (amplitudes @ loads) @ np.concatenate([third, springs(amplitudes)]) - pairs @ work @ pairs, rel=1e-9
    )
    # Of a stiff motion the first power and what it does alone, however much its square would count with others.
    alone, small = amplitudes * [0.0, 1.0, 1.0], 1e-4 * amplitudes * [1.0, 0.0, 0.0]

    def energy(forms, signs, amplitudes):
        return signs @ np.einsum("kij,i,j->k", forms, amplitudes, amplitudes) ** 2

    change = 0.5e4 * (energy(forms, signs, alone + small) - energy(forms, signs, alone - small))
    once = missed_energy(reduced, motions, loads, 1, 1, sums, work, 0.0, springs)
    by_itself = energy(forms, signs, amplitudes - alone)
    assert energy(*once, amplitudes) == pytest.approx(energy(forms, signs, alone) + change + by_itself, rel=1e-5)
    assert energy(*once, amplitudes) != pytest.approx(found, rel=1e-2)


@pytest.mark.parametrize("part", [False, True])
def test_a_part_that_is_pressed_along_itself_has_the_shape_by_which_it_bends_more(part, tmp_path):
    """Of a bar in one piece its normal modes know it; what others press onto a part bends shapes that these are not."""
    matrices, loads = matrices_and_loads(box(ElementType.C3D20, (12, 1, 1), (1.0, 0.04, 0.04)), tmp_path)
    model, modes = matrices.supported, normal_modes(matrices.supported, 2)
    modes = with_residual_flexibility(model, modes, loads)
    forces = third_order_loads(matrices, modes, loads, 1e-3, (6, 4), part)
    along, bent = model.whole(model.static(model.forces(loads[:, [0, 2]]))).T
    force = model.forces((stress_stiffness(matrices.model.mesh, along) @ bent)[:, None])
    known = with_residual_flexibility(model, modes, forces) if forces.shape[1] else modes
    shapes = known.shapes / known.angular_frequency
    held, whole = model.unknowns.of(shapes).T @ force, force.T @ model.static(force)
    missed = 1.0 - (held**2).sum() / whole.item()
    assert (missed < 1e-5) == part


def test_displacements_of_second_order_that_are_known_do_no_work_of_third(tmp_path):
    """Nor does what stress that turns sets free, where the basis has it."""
    matrices, loads = matrices_and_loads(arc(ElementType.C3D20, (4, 1, 1), 1.0, 0.2, angle=1.2), tmp_path)
    model, mesh, pair = matrices.supported, matrices.model.mesh, np.array([[0, 0]])
    field = model.whole(model.static(model.forces(loads[:, [2]])))
    turned = stress_stiffness(mesh, field[:, 0]) @ field
    forces = np.hstack([quadratic_strain(mesh, field, pair, tell_nobody)[0], turned])
    moved = model.whole(model.static(model.forces(forces)))
    (strained, freed), pulled = (turned.T @ moved)[0], turned.T @ moved[:, 1:]
    assert 0.01 < abs(0.5 * freed / strained) < 100.0
    every = moved / np.sqrt(np.diag(forces.T @ moved))
    for basis, known, expected in (
        (every[:, :0], np.zeros((0, 0)), strained + 0.5 * pulled.item()),
        (every[:, 1:], np.zeros((1, 0)), strained),
        (every[:, :1], np.ones((1, 1)), 0.5 * (freed - (turned.T @ every[:, 0]).item() ** 2)),
    ):
        work = FourthOrder(matrices).third_order_work(field, pair, basis, known, np.zeros((1, 1, 1)))
        assert work.item() == pytest.approx(expected, rel=1e-6, abs=0.0)
