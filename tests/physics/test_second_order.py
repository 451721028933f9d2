"""Motions within frames to second order, against geometric stiffness, closed forms and CalculiX."""

from dataclasses import replace

import numpy as np
import pytest

import flexfmu
from bodies import source_of_judgement
from elastica import MASS, STIFFNESS, heavy_elastica
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import InputTable, InterfaceTable
from flexfmu.files.basics import OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import PointMass
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import GROUND
from flexfmu.reduction import membrane, second_order
from flexfmu.reduction.options import Basis
from flexfmu.reduction.rigid_fit import by_node
from flexfmu.reduction.second_order import node_readings
from flexfmu.reduction.subdomains import Subdomain, fitted_rotation
from meshes import arc, body_file, box
from references import BEAM, L_FRAME, calculix, displacement, relative, rotation
from turns import exponential, rotation_vector

SECOND, BY_LOAD = Method.SECOND_ORDER, Method.STIFFNESS_BY_LOAD
# Six normal modes and the residual flexibility of the tip: statics are right linearly.
LEAN = {"modes": 6, "residual_flexibility": True, "second_order": True}


@pytest.fixture(scope="module")
def reduced(bodies):
    """A demo body with second-order data aboard."""

    def make(folder, frames, wanted=LEAN, **changes):
        reduction = bodies.config(folder).reduction.model_copy(update=wanted)
        return bodies(folder, reduction=reduction, frames=frames, frame=[], **changes).model

    return make


def tip_errors(body, method, table, loads):
    """Relative error of displacement and rotation vector of the tip under loads (n, 3), against rows of a table."""
    model = FlexibleBody(body, method)
    found = [model.response(model.static({"tip": load})) for load in loads]
    moved, turned = displacement(table), rotation(table)
    return (
        max(relative(r.displacement[0], u) for r, u in zip(found, moved, strict=True)),
        max(relative(r.rotation[0], w) for r, w in zip(found, turned, strict=True)),
    )


def tangent(body, method, force):
    """Tangent stiffness of the undeformed body under a force at the tip, over that without."""
    model, omega = FlexibleBody(body, method), body.angular_frequency
    whole = model.tangent(model.rest(), model.loads({"tip": force}).packed(False))
    return (whole - np.diag(omega**2)) / np.outer(omega, omega)


@pytest.mark.slow
@pytest.mark.parametrize("folder", [BEAM, L_FRAME])
@pytest.mark.parametrize("frames", [2, *(pytest.param(count, marks=pytest.mark.slow) for count in (1, 4))])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_forces_stiffen_and_soften_as_the_whole_model_s_geometric_stiffness(reduced, folder, frames, axis):
    """Loads on the deformed body *are* the geometric stiffness of their stress, with motions right to second order."""
    body = reduced(folder, frames, LEAN | {"geometric_stiffness": ["by_load"]})
    expected = tangent(body, BY_LOAD, np.eye(3)[axis])
    assert relative(tangent(body, SECOND, np.eye(3)[axis]), expected) < 1e-9
    assert relative(tangent(body, Method.FRAMES, np.eye(3)[axis]), expected) > 0.02


@pytest.mark.parametrize(("frames", "limit"), [pytest.param(1, 0.004, marks=pytest.mark.slow), (2, 5e-4), (3, 2.5e-4)])
def test_bent_beam(reduced, frames, limit):
    table = calculix(BEAM / "calculix" / "static_y.csv")
    table = table[(table["force_N"] > 0.0) & (table["force_N"] <= 10e3)]
    loads = [[0.0, force, 0.0] for force in table["force_N"]]
    body = reduced(BEAM, frames)
    found = tip_errors(body, SECOND, table, loads)
    assert max(found) < limit
    # As many frames without.
    assert tip_errors(body, Method.FRAMES, table, loads)[0] > 5.0 * found[0]


@pytest.mark.slow
@pytest.mark.parametrize(("case", "axis"), [("static_z", 2), ("static_x", 0)])
@pytest.mark.parametrize(
    ("frames", "limit"),
    [(2, 3e-4), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((1, 0.0065), (3, 2e-4), (4, 2e-4)))],
)
def test_bent_and_twisted_frame(reduced, case, axis, frames, limit):
    table = calculix(L_FRAME / "calculix" / f"{case}.csv")[-1:]
    loads = table["force_N"][:, None] * np.eye(3)[axis]
    assert max(tip_errors(reduced(L_FRAME, frames, LEAN | {"modes": 20}), SECOND, table, loads)) < limit


def test_pressed_and_bent_in_two_planes(reduced):
    table = calculix(BEAM / "calculix" / "static_combined.csv")
    table = table[np.abs(table["fx_N"]) > 0.0]
    loads = np.stack([table["fx_N"], table["fy_N"], table["fz_N"]], axis=1)
    body = reduced(BEAM, 2)
    found = tip_errors(body, SECOND, table, loads)
    assert max(found) < 2e-3
    assert tip_errors(body, Method.FRAMES, table, loads)[0] > 5.0 * found[0]


@pytest.mark.slow
def test_weight_bends_the_beam_along_the_elastica(reduced):
    acceleration = 4.0 * STIFFNESS / MASS
    expected = heavy_elastica(acceleration)
    errors = []
    for frames in (1, 2):
        heavy = InputTable(acceleration=True)
        body = FlexibleBody(reduced(BEAM, frames, LEAN | {"modes": 20}, input=heavy), SECOND)
        response = body.response(body.static(body.loads({}, [0.0, acceleration, 0.0])))
        found = response.displacement[0, :2] + np.array([1.0, 0.0])
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected - [1.0, 0.0]))
    # Shear, which the elastica has not, is 0.3 % of the deflection. Without the second order: 8 and 2 %.
    assert errors[0] < 0.03
    assert errors[1] < 0.008


@pytest.mark.slow
def test_a_point_off_its_nodes_moves_on_an_arc_about_them():
    """As a rigid arm carries it; a weight that hangs there loads the body as a force at the point does."""
    point, mesh = np.array([1.0, 0.3, 0.1]), box(ElementType.C3D20, (8, 2, 2), (1.0, 0.05, 0.08))
    weight = PointMass("weight", point, mesh.node_sets["TIP"], 2000.0, 20.0 * np.eye(3))
    (steel,) = mesh.materials
    mesh = replace(mesh, materials=(replace(steel, density=785.0),), masses=(weight,))
    ends = {"tip": flexfmu.Interface("TIP"), "beside": flexfmu.Interface("TIP", point=point.tolist())}
    body = flexfmu.Body(mesh, None, ["ROOT"], ends, tables={"input": {"acceleration": True}})
    for frames in (1, 3):
        model = FlexibleBody(body.build("second_order", frames=frames, report=Reporter()).model, SECOND)
        heavy = model.response(model.static(model.loads({}, [0.0, 20.0, 20.0])))
        pushed = model.response(model.static({"beside": [0.0, -40e3, -40e3]}))
        turned = exponential(pushed.rotation[0])
        arc = pushed.displacement[0] + (turned - np.eye(3)) @ (point - [1.0, 0.025, 0.04])
        size = np.linalg.norm(pushed.rotation[0]) ** 2 * 0.3
        assert size > 0.004
        np.testing.assert_allclose(pushed.displacement[1], arc, atol=0.01 * size)
        np.testing.assert_allclose(heavy.displacement, pushed.displacement, atol=0.01 * size)


@pytest.mark.slow
def test_energy_is_kept_whatever_the_step(reduced):
    body = FlexibleBody(reduced(L_FRAME, 2), SECOND, damping_scale=0.0)
    loads, state = body.loads({"tip": [500.0, -800.0, 900.0]}), body.rest()
    tip = body.model.interface_names.index("tip")
    energies = []
    for _ in range(500):
        state = body.step(state, loads, 2e-3)
        work = float(loads.force[tip] @ body.response(state).displacement[tip])
        energies.append(sum(body.energies(state)) - work)
    assert np.max(np.abs(energies)) < 1e-9 * abs(work)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "force"), [(BEAM, [-2e3, 8e3, 3e3]), (L_FRAME, [2e3, 0.0, 0.0]), (L_FRAME, [0.0, 0.0, 2e3])]
)
@pytest.mark.parametrize("frames", [2, pytest.param(1, marks=pytest.mark.slow)])
def test_a_free_body_fixed_by_the_scene_is_the_supported_one(reduced, folder, force, frames):
    """The L-frame's root turns at second order when its legs bend: only there it matters where the body is fixed."""
    basis = {"basis": Basis.CRAIG_BAMPTON, "modes": 8, "second_order": True}
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    free = reduced(folder, frames, basis, free=True, support=[], interface=ends)
    models = FlexibleBody(free, SECOND, fixed=["root"]), FlexibleBody(reduced(folder, frames, basis), SECOND)
    found = [model.response(model.static({"tip": force})) for model in models]
    np.testing.assert_allclose(found[0].displacement[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[0].rotation[0], 0.0, atol=1e-12)
    # The clamp holds each node, the interface the section's mean: 0.3 % softer, linearly too.
    assert relative(found[0].displacement[1], found[1].displacement[0]) < 4e-3
    assert relative(found[0].rotation[1], found[1].rotation[0]) < 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1, 2])
def test_a_bent_free_body_keeps_its_shape_however_it_is_turned(reduced, frames):
    """Bent by what its modes hold, then turned by a radian: its ends stay as far apart, and turned by as much."""
    basis = {"basis": Basis.CRAIG_BAMPTON, "modes": 4, "second_order": True}
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    model = reduced(L_FRAME, frames, basis, free=True, support=[], interface=ends)
    body = FlexibleBody(model, SECOND)
    bent = np.zeros(model.mode_count)
    bent[6:12] = 30.0 / model.angular_frequency[6:12]
    rigid = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    turned = bent.copy()
    turned[:6] = np.linalg.solve(rigid, [0.0, 0.0, 0.0, 0.5, -0.7, 0.6])
    apart, against = [], []
    for q in (bent, turned):
        found = body.response(State(q, np.zeros_like(q)))
        apart.append(np.linalg.norm(np.diff(model.interface_point + found.displacement, axis=0)))
        first, second = exponential(found.rotation)
        against.append(np.linalg.norm(rotation_vector(first.T @ second)))
    assert against[0] > 0.05
    np.testing.assert_allclose(apart[1], apart[0], rtol=1e-9)
    np.testing.assert_allclose(against[1], against[0], rtol=1e-8)


def test_rigid_motions_make_no_strain(reduced):
    basis = {"basis": Basis.CRAIG_BAMPTON, "modes": 4, "second_order": True}
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    body = reduced(BEAM, 2, basis, free=True, support=[], interface=ends)
    assert body.rigid_count == 6
    for part in (body.second.displacement, body.second.rotation):
        # Of unit rotations, in coordinates of unit kinetic energy.
        assert np.max(np.abs(part[:, :, :6])) < 1e-7 * np.max(np.abs(part))


def test_what_second_order_needs_and_what_it_does_not_go_with(reduced, bodies):
    with pytest.raises(OptionError, match="second_order = true"):
        FlexibleBody(bodies.beam().model, SECOND)
    with pytest.raises(OptionError, match=r"mass configuration.* needs inertia = true"):
        FlexibleBody(reduced(BEAM, 2), SECOND, Mass.CONFIGURATION)
    stored = {"inertia": True, "second_order": True}
    model = bodies.beam(reduction=bodies.config(BEAM).reduction.model_copy(update=stored), frames=2).model
    with pytest.raises(OptionError, match="inertia = true and second_order = true"):
        FlexibleBody(replace(model, inertia=replace(model.inertia, curvature=None)), SECOND, Mass.CONFIGURATION)


def test_stiffness_that_other_methods_miss_is_judged_by_it(reduced):
    """A column under half of Euler's load; the finite element model's own geometric stiffness agrees."""
    inputs = np.array([-16.7e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    body = reduced(BEAM, 1, LEAN | {"geometric_stiffness": ["by_load"]})
    by_load = replace(body, second=None)
    for method in (Method.FRAMES, Method.LINEAR):
        sources = [source_of_judgement(model, method) for model in (body, by_load)]
        assert sources == ["the frames to second order", "geometric stiffness by load"]
        first, second = (FlexibleBody(model, method).stiffness_missed(inputs) for model in (body, by_load))
        assert 0.1 < first < 0.6
        assert first == pytest.approx(second, rel=0.02)
    assert source_of_judgement(body, SECOND) == ""
    assert FlexibleBody(body, SECOND).stiffness_missed(inputs) == 0.0


def test_the_method_stores_its_data(bodies):
    table = bodies.config(BEAM).formulation.model_copy(update={"method": SECOND})
    assert bodies.beam(formulation=table).model.second is not None
    # For other methods only where it is asked for.
    table = bodies.config(BEAM).formulation.model_copy(update={"method": Method.FRAMES})
    assert bodies.beam(formulation=table).model.second is None
    document = bodies.config(BEAM).model_dump() | {"formulation": {"method": "second_order"}}
    document["reduction"]["second_order"] = False
    with pytest.raises(ValueError, match=r"needs second_order = true, and \[reduction\] says otherwise"):
        type(bodies.config(BEAM)).model_validate(document)


def test_springs_on_a_line_turn_as_the_frame_that_carries_them(random):
    """Nodes on a line tell no turn about it; without a frame they are read by themselves, as are those in a plane."""
    points = box(ElementType.C3D8, (4, 2, 2), (1.0, 0.2, 0.2)).points
    shapes, ends = random.standard_normal((points.size, 2)), points[:, 0] == 1.0
    whole, joint = by_node(np.arange(len(points))), by_node(np.flatnonzero(points[:, 0] == 0.0))
    none = np.zeros(0, dtype=np.int64)
    frame = Subdomain("arm", GROUND, none, whole, fitted_rotation(points, whole), joint, joint.centre(points))
    angle = frame.rotation.of(shapes)
    springs = [by_node(np.flatnonzero(ends & (points[:, 1] == 0.0))), by_node(np.flatnonzero(ends))]
    _, line, plane, *_ = node_readings(points, shapes, [frame], angle[None], [], [], springs, np.ones(2))
    assert line.turn is frame.rotation
    np.testing.assert_array_equal(line.angle, angle)
    alone = node_readings(points, shapes, [], np.zeros((0, 3, 2)), [], [], springs, np.ones(2))[0]
    for reading in (plane, alone):
        assert reading.turn is not frame.rotation
        np.testing.assert_array_equal(reading.angle, reading.turn.of(shapes))
        assert np.abs(reading.angle - angle).max() > 0.1


@pytest.mark.parametrize("support", ["ROOT", None])
def test_places_move_at_second_order_as_pairs_are_answered_and_as_unit_loads_stress_the_body(
    support, tmp_path, monkeypatch
):
    mesh = arc(ElementType.C3D8I, (8, 2, 2), 1.0, 0.1)
    tables = {"reduction": {"modes": 5, "residual_flexibility": True, "membrane": False}, "output": {"surface": True}}
    config = body_file(
        mesh,
        tmp_path,
        interface=["ROOT", "TIP"][support is not None :],
        support=support,
        free=support is None,
        **tables,
    )
    with monkeypatch.context() as few:
        # Of few coordinates all pairs are answered, once: nothing else is found for places.
        few.setattr(second_order, "geometric_stiffness", None)
        answered = reduce_body(config, Reporter(), Store(None))
    monkeypatch.setattr(membrane, "_FEW", 0)
    plain = reduce_body(config, Reporter(), Store(None))
    for name in ("displacement", "rotation"):
        found, expected = (getattr(body.second, name) for body in (answered, plain))
        assert np.abs(expected).max() > 0.0
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
    moved = [np.einsum("nir,rab->niab", b.surface.second, b.surface.form, optimize=True) for b in (answered, plain)]
    np.testing.assert_allclose(moved[0], moved[1], rtol=0.0, atol=1e-4 * np.abs(moved[1]).max())
