"""The surface for pictures goes where the method takes the body: interfaces, lengths, rigid turns, stress."""

from dataclasses import replace

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.body.recovery import surface_von_mises
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import OutputTable
from flexfmu.fe.gradients import nodal_stress, quadratic_strain
from flexfmu.files.basics import OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Method
from flexfmu.reduction import surface
from flexfmu.reduction.basis import Matrices
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.modes import normal_modes
from meshes import EVERY_TYPE, arc, body_file, box
from references import BEAM, relative
from turns import exponential

# Every node of these bricks is on a corner, so that the surface holds all nodes of an interface on it.
BRICK = ElementType.C3D8
PLACES = (Method.LINEAR, Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.FRAMES, Method.SECOND_ORDER)
# The second-order part is kept to a thousandth of itself, which is some hundredths of the displacement.
CLOSE = 1e-4


def by_node(mesh, folder, *sets, **tables):
    """Reduced body whose interfaces count every node the same."""
    config = body_file(mesh, folder, interface=sets, output={"surface": True}, **tables)
    return reduce_body(
        config.model_copy(
            update={"interface": [table.model_copy(update={"weights": "node"}) for table in config.interface]}
        ),
        Reporter(),
    )


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A quarter arc of linear bricks, reduced once for each number of frames."""
    known = {}

    def make(frames):
        if frames not in known:
            mesh = arc(BRICK, (24, 2, 2), 1.0, 0.04)
            tables = {"reduction": {"modes": 8, "residual_flexibility": True, "second_order": True}}
            known[frames] = by_node(mesh, tmp_path_factory.mktemp("arc"), "TIP", frames=frames, **tables)
        return known[frames]

    return make


@pytest.mark.parametrize("method", PLACES)
@pytest.mark.parametrize("frames", [1, 3])
def test_the_mean_of_an_interfaces_nodes_moves_as_the_fmu_says(bent, method, frames):
    body = FlexibleBody(bent(frames), method)
    state = body.static({"tip": [2000.0, 6000.0, 4000.0]})
    on = body.model.surface.interface == 0
    assert on.sum() == 9
    moved = (body.surface_positions(state) - body.model.surface.points)[on].mean(axis=0)
    expected = body.response(state).displacement[0]
    assert np.linalg.norm(expected) > 0.1
    assert relative(moved, expected) < CLOSE
    # Not by chance: without its second-order part the surface of that method misses the interface.
    if method is Method.SECOND_ORDER:
        frames_only = FlexibleBody(bent(frames), Method.FRAMES).surface_positions(state)
        assert relative((frames_only - body.model.surface.points)[on].mean(axis=0), expected) > 5 * CLOSE


def fibre(points, start):
    """Length of the line through the middles of a straight bar's sections."""
    levels = np.round(start[:, 0], 9)
    middles = np.array([points[levels == level].mean(axis=0) for level in np.unique(levels)])
    return np.linalg.norm(np.diff(middles, axis=0), axis=1).sum()


@pytest.mark.slow
def test_a_bar_that_bends_far_keeps_its_length(tmp_path):
    mesh = box(BRICK, (40, 2, 2), (1.0, 0.03, 0.03))
    tables = {"frames": 1, "reduction": {"modes": 8, "residual_flexibility": True}}
    model = by_node(mesh, tmp_path, "TIP", **tables)
    stretch = {}
    for method in (Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER):
        body = FlexibleBody(model, method)
        state = FlexibleBody(model).static({"tip": [0.0, 10e3, 0.0]})
        stretch[method] = fibre(body.surface_positions(state), model.surface.points) - 1.0
    assert stretch[Method.LINEAR] > 0.018
    assert stretch[Method.FRAMES] > 0.003
    assert abs(stretch[Method.SECOND_ORDER]) < 4e-4


@pytest.fixture(scope="module")
def free_bar(tmp_path_factory):
    mesh = box(BRICK, (16, 2, 2), (0.5, 0.04, 0.03))
    tables = {"free": True, "frames": 2, "root": "root", "reduction": {"modes": 6, "basis": "craig_bampton"}}
    return by_node(mesh, tmp_path_factory.mktemp("free"), "ROOT", "TIP", support=None, **tables)


@pytest.mark.parametrize("method", [Method.FRAMES, Method.SECOND_ORDER])
def test_a_free_body_that_turns_as_one_stays_rigid(free_bar, method):
    body = FlexibleBody(free_bar, method)
    angle = np.array([0.3, -0.5, 0.9])
    q = np.zeros(free_bar.mode_count)
    rigid = np.concatenate([free_bar.joint_displacement[0], free_bar.frame_rotation[0]])[:, :6]
    q[:6] = np.linalg.solve(rigid, [0.1, 0.2, -0.3, *angle])
    start = free_bar.surface.points
    centre = free_bar.joint_point[0]
    expected = centre + [0.1, 0.2, -0.3] + (start - centre) @ exponential(angle).T
    np.testing.assert_allclose(body.surface_positions(State(q, q)), expected, atol=1e-6)


def test_a_bar_whose_root_the_scene_fixes_is_a_clamped_one(free_bar):
    body = FlexibleBody(free_bar, Method.SECOND_ORDER, fixed=["root"])
    state = body.static({"tip": [0.0, 24e3, 12e3]})
    surface = body.model.surface
    moved = body.surface_positions(state) - surface.points
    expected = body.response(state).displacement[1]
    assert np.linalg.norm(expected) > 0.03
    assert relative(moved[surface.interface == 1].mean(axis=0), expected) < CLOSE
    assert np.abs(moved[surface.interface == 0].mean(axis=0)).max() < CLOSE * np.linalg.norm(expected)


@pytest.mark.parametrize("kind", EVERY_TYPE)
def test_uniform_strain_gives_hookes_stress_at_every_corner(kind):
    mesh = box(kind, (2, 2, 1), (0.2, 0.2, 0.1))
    gradient = np.array([[1e-3, 4e-4, 0.0], [2e-4, -5e-4, 3e-4], [0.0, 1e-4, 7e-4]])
    corners = np.unique(
        np.concatenate(
            [b.connectivity[:, : 4 if "10" in kind.name or kind.name == "C3D4" else 8].ravel() for b in mesh.blocks]
        )
    )
    stress = nodal_stress(mesh, corners, (mesh.points @ gradient.T).reshape(-1, 1))[:, :, 0]
    strain = 0.5 * (gradient + gradient.T)
    expected = 2e11 / 1.3 * (strain + 0.3 / 0.4 * np.trace(strain) * np.eye(3))
    voigt = [expected[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]
    np.testing.assert_allclose(stress, np.broadcast_to(voigt, stress.shape), rtol=1e-9, atol=1e-3)


def test_the_surface_of_a_bent_bar_is_stressed_as_beam_theory_has_it(tmp_path):
    mesh = box(ElementType.C3D20R, (20, 2, 2), (1.0, 0.03, 0.03))
    tables = {
        "frames": 1,
        "output": {"stress": True, "surface": True},
        "reduction": {"modes": 6, "residual_flexibility": True},
    }
    body = FlexibleBody(reduce_body(body_file(mesh, tmp_path, interface=["TIP"], **tables), Reporter()))
    state = body.static({"tip": [0.0, 100.0, 0.0]})
    points = body.model.surface.points
    outer = (points[:, 0] > 0.2) & (points[:, 0] < 0.8) & (points[:, 1] == 0.0)
    expected = 100.0 * (1.0 - points[outer, 0]) * 0.015 / (0.03**4 / 12.0)
    np.testing.assert_allclose(surface_von_mises(body.model, state.q)[outer], expected, rtol=0.02)


def test_pairs_of_modes_are_answered_a_few_at_a_time_with_the_same_surface(tmp_path, monkeypatch):
    mesh = arc(BRICK, (8, 2, 2), 1.0, 0.08)
    model = assemble_model(mesh, body_file(mesh, tmp_path, interface=["TIP"]).options)
    matrices = Matrices(model, Reporter())
    modes = normal_modes(matrices.supported, 8)
    arguments = matrices, modes, modes.shapes[:, :0], mesh.node_sets["TIP"]
    counts = []

    def counted(mesh, fields, pairs, tell):
        counts.append(len(pairs))
        return quadratic_strain(mesh, fields, pairs, tell)

    monkeypatch.setattr(surface, "quadratic_strain", counted)
    fields, forms = surface.second_order_fields(*arguments)
    # All nodes' responses to all 36 pairs at once would take more than the factorisation of a large mesh.
    assert sum(counts) == 36
    assert max(counts) <= 16
    monkeypatch.setattr(surface, "_AT_A_TIME", 1000)
    whole_fields, whole_forms = surface.second_order_fields(*arguments)
    assert counts[-1] == 36
    moved, expected = (np.einsum("nr,rab->nab", *pair) for pair in ((fields, forms), (whole_fields, whole_forms)))
    np.testing.assert_allclose(moved, expected, atol=1e-9 * np.abs(expected).max())


def test_a_body_without_the_stress_of_its_surface_says_how_to_store_it(bent):
    body = FlexibleBody(bent(1))
    with pytest.raises(OptionError, match="stress = true"):
        surface_von_mises(body.model, body.rest().q)


@pytest.mark.slow
def test_all_of_the_surface_is_where_calculix_has_it(bodies):
    # 20 kN at the beam's tip, which moves by 42 % of the length: nodes on all edges, not the tip alone.
    reduction = bodies.config(BEAM).reduction.model_copy(update={"residual_flexibility": True, "second_order": True})
    model = bodies.beam(frames=2, reduction=reduction, output=OutputTable(error=False)).model
    table = np.genfromtxt(BEAM / "calculix" / "static_y_outline.csv", delimiter=",", skip_header=1)
    rest, moved = table[:, :3], table[:, 3:]
    apart = np.linalg.norm(model.surface.points[:, None] - rest, axis=2)
    assert apart.min(axis=0).max() < 1e-6
    errors = {}
    for method in (Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER):
        body = FlexibleBody(model, method)
        found = body.surface_positions(body.static({"tip": [0.0, 20e3, 0.0]})) - model.surface.points
        errors[method] = np.linalg.norm(found[apart.argmin(axis=0)] - moved, axis=1).max() / np.abs(moved).max()
    assert errors[Method.LINEAR] > 0.3
    assert errors[Method.FRAMES] > 0.01
    assert errors[Method.SECOND_ORDER] < 2e-3


def test_directions_of_the_surface_are_those_that_turn_the_material_most(random):
    """A displacement turns a body of half the size twice as far."""
    mesh = box(ElementType.C3D20, (4, 1, 1), (1.0, 0.1, 0.2))
    phi, loads = random.standard_normal((2, 3 * len(mesh.points), 7))
    phi *= np.arange(1, 8)
    omega = np.linspace(10.0, 50.0, 7)
    axes, turned, size = surface._turning_directions(mesh, phi, omega, loads)
    half = surface._turning_directions(replace(mesh, points=0.5 * mesh.points), phi, omega, loads)
    np.testing.assert_allclose(half[1], 2.0 * turned, rtol=1e-9)
    np.testing.assert_allclose(half[2], 2.0 * size, rtol=1e-9)
    # Of random displacements the larger ones turn it more.
    assert size[4:].min() > 1.5 * size[:2].max()
    np.testing.assert_allclose(axes @ axes.T, np.eye(7), atol=1e-9)
