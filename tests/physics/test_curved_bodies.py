"""Curved bodies, joints that split layers of elements, tetrahedra: the mean rotation and second order on them."""

from dataclasses import replace

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build import config as build
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import BranchTable, InterfaceTable, MeshTable, SupportTable
from flexfmu.fe.assembly import mean_gradient
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from flexfmu.model.methods import Method
from flexfmu.reduction.division import distance_along
from flexfmu.reduction.options import Basis
from flexfmu.reduction.subdomains import fitted_rotation, mean_rotation, volume_weighted
from meshes import arc, box, distorted
from references import DEMO, body_without_error, calculix, displacement, relative

pytestmark = pytest.mark.slow

CURVED = DEMO / "curved"
SECOND, BY_LOAD = Method.SECOND_ORDER, Method.STIFFNESS_BY_LOAD
# Name, and the largest error of the tip with 1, 2 and 4 frames, in %.
BARS = {
    "arc_20": (0.25, 0.03, 0.015),
    "arc_45": (0.65, 0.08, 0.05),
    "arc_90": (0.15, 0.03, 0.01),
    "s_curve": (0.1, 0.02, 0.005),
    "helix": (0.35, 0.08, 0.015),
    "s_curve_tetrahedra": (0.1, 0.025, 0.015),
}
# Four levels split the bricks' 30 layers; no faces of the tetrahedra make up a flat section.
RAGGED = ["s_curve", "s_curve_tetrahedra"]


@pytest.fixture(scope="module")
def bars(store):
    """Curved bars, each reduced once for a number of frames and other changes."""
    known = {}

    def make(name, frames, **changes):
        key = (name, frames, repr(changes))
        if key not in known:
            config = body_without_error(CURVED / "body.toml")
            wanted = config.reduction.model_copy(update=changes.pop("wanted", {}))
            mesh = MeshTable(file=CURVED / f"{name}.inp")
            changes |= {"frames": frames, "mesh": mesh, "reduction": wanted}
            known[key] = reduce_body(config.model_copy(update=changes), Reporter(), store)
        return known[key]

    return make


def load_and_tip(name):
    """Forces (n, 3) and tip displacements (n, 3) of CalculiX."""
    table = calculix(CURVED / "calculix" / f"{name}.csv")[1:]
    forces = np.zeros((len(table), 3))
    for axis, key in enumerate("xyz"):
        if f"f{key}_N" in table.dtype.names:
            forces[:, axis] = table[f"f{key}_N"]
    if "force_N" in table.dtype.names:
        forces[:, 2] = table["force_N"]
    return forces, displacement(table)


def tip_error(body, name, row=-1, method=SECOND):
    """Relative error of the tip's displacement under the forces of a row of CalculiX's table."""
    forces, moved = load_and_tip(name)
    model = FlexibleBody(body, method)
    return relative(model.response(model.static({"tip": list(forces[row])})).displacement[0], moved[row])


def tangent(body, method, force):
    """Change of the undeformed body's tangent stiffness by a force at the tip, over the unloaded one."""
    model = FlexibleBody(body, method)
    omega = body.angular_frequency
    whole = model.tangent(model.rest(), model.loads({"tip": list(force)}).packed(False))
    return (whole - np.diag(omega**2)) / np.outer(omega, omega)


@pytest.mark.parametrize("kind", [kind for kind in ElementType if not kind.shell])
def test_mean_rotation_is_half_the_mean_curl(kind):
    mesh = distorted(box(kind, (3, 2, 2), (3.0, 2.0, 1.0)), 0.1, np.random.default_rng(3))
    elements = np.arange(mesh.element_count)
    turn, rotation = mean_rotation(mesh, elements), np.array([0.3, -0.7, 1.1])
    gradient = np.random.default_rng(4).standard_normal((3, 3))
    stretch = gradient + gradient.T
    field = np.cross(rotation, mesh.points) + mesh.points @ stretch + [5.0, -6.0, 7.0]
    np.testing.assert_allclose(turn.of(field.reshape(-1, 1))[:, 0], rotation, atol=1e-12)
    nodes, mean = mean_gradient(mesh, elements)
    np.testing.assert_allclose(field[nodes].T @ mean, np.cross(rotation, np.eye(3)).T + stretch, atol=1e-12)


@pytest.mark.parametrize("kind", [ElementType.C3D20, ElementType.C3D20R, ElementType.C3D10])
def test_sideways_bending_of_an_arc_is_no_roll(kind):
    """Of u_z = a² across the plane of an arc, a being the angle along it, ½ curl u is a/r times the way outward."""
    angle = np.radians(20.0)
    mesh = arc(kind, (12, 2, 2), 1.0, 0.05, angle)
    field = np.zeros_like(mesh.points)
    field[:, 2] = np.arctan2(mesh.points[:, 1], mesh.points[:, 0]) ** 2
    turn = mean_rotation(mesh, np.arange(mesh.element_count)).of(field.reshape(-1, 1))[:, 0]
    sine, cosine = np.sin(angle), np.cos(angle)
    expected = np.array([cosine + angle * sine - 1.0, sine - angle * cosine, 0.0]) / angle
    assert relative(turn, expected) < 1e-3
    # A rigid fit sees a roll about the chord that is as large as the turn.
    fitted = fitted_rotation(mesh.points, volume_weighted(mesh, mesh.volume_matrices, np.arange(mesh.element_count)))
    assert relative(fitted.of(field.reshape(-1, 1))[:, 0], expected) > 0.5


@pytest.mark.parametrize("name", BARS)
def test_curved_bars_with_few_frames_of_second_order(bars, name):
    _, moved = load_and_tip(name)
    assert 0.2 < np.linalg.norm(moved[-1]) < 0.5
    for frames, limit in zip((1, 2, 4), BARS[name], strict=True):
        body = bars(name, frames)
        assert 100.0 * tip_error(body, name) < limit
        # As many frames without.
        assert tip_error(body, name, method=Method.FRAMES) > 8.0 * tip_error(body, name)


@pytest.mark.parametrize("name", RAGGED)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 8])
def test_error_falls_with_the_square_of_the_load_whatever_the_joints(bars, name, frames):
    body = bars(name, frames, wanted={"modes": 6})
    half, full = (tip_error(body, name, row) for row in (4, 9))
    assert full < 0.002
    assert 1.75 < np.log2(full / half) < 2.3


@pytest.mark.parametrize(("before", "within", "behind"), [(0.131, 0.1445, 0.160), (0.3895, 0.4063, 0.4195)])
def test_a_joint_within_a_layer_of_bricks_is_as_good_as_those_beside_it(bars, before, within, behind):
    mesh = read_mesh(CURVED / "s_curve.inp")
    distance = distance_along(mesh, mesh.node_sets["ROOT"])[mesh.blocks[0].connectivity].mean(axis=1)
    # A layer has four bricks: two go to either side of the joint.
    assert [np.count_nonzero(distance < joint) % 4 for joint in (before, within, behind)] == [0, 2, 0]
    errors = {}
    for joint in (before, within, behind):
        body = bars("s_curve", None, branch=[BranchTable(toward="TIP", joints=[joint])])
        errors[joint] = [tip_error(body, "s_curve", row) for row in (1, 4, 9)]
    # Over five times the load.
    assert np.log(errors[within][2] / errors[within][0]) / np.log(5.0) == pytest.approx(2.0, abs=0.2)
    for at_load in zip(*(errors[joint] for joint in (before, within, behind)), strict=True):
        assert at_load[1] < 1.06 * max(at_load[0], at_load[2])


@pytest.mark.parametrize("name", RAGGED)
def test_error_falls_with_the_square_of_the_frames_at_least(bars, name):
    errors = [tip_error(bars(name, frames), name) for frames in (1, 2, 4)]
    assert np.log2(errors[0] / errors[2]) / 2.0 > 1.4
    assert errors[2] < errors[1] < errors[0]
    first = [tip_error(bars(name, frames), name, method=Method.FRAMES) for frames in (1, 2, 4)]
    assert np.log2(first[0] / first[2]) / 2.0 == pytest.approx(1.8, abs=0.2)


@pytest.mark.parametrize("name", RAGGED)
@pytest.mark.parametrize("frames", [1, 4, 5])
def test_stiffness_by_loads_is_the_whole_model_s_to_round_off_whatever_the_joints(bars, name, frames):
    body = bars(name, frames, wanted={"modes": 5, "geometric_stiffness": ["by_load"]})
    for force in np.eye(3):
        expected = tangent(body, BY_LOAD, force)
        assert relative(tangent(body, SECOND, force), expected) < 1e-9
        assert relative(tangent(body, Method.FRAMES, force), expected) > 0.02


@pytest.mark.parametrize("frames", [1, 2])
def test_a_free_arc_fixed_by_the_scene_is_the_supported_one(bars, frames):
    basis = {"basis": Basis.CRAIG_BAMPTON, "modes": 8, "residual_flexibility": False}
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    free = bars("arc_45", frames, wanted=basis, free=True, support=[], interface=ends)
    models = FlexibleBody(free, SECOND, fixed=["root"]), FlexibleBody(bars("arc_45", frames, wanted=basis), SECOND)
    small, large = ([0.0, 0.0, 1.0], [3e3, 4e3, 18e3])
    off = []
    for load in (small, large):
        found = [model.response(model.static({"tip": load})) for model in models]
        np.testing.assert_allclose(found[0].displacement[0], 0.0, atol=1e-12)
        off.append(relative(found[0].displacement[1], found[1].displacement[0]))
    # The clamp holds each node, the interface the section's mean: softer by this much linearly too.
    assert off[0] < 4e-3
    assert off[1] < 1.5 * off[0]


def test_a_hinged_arc_turns_without_changing_its_shape(monkeypatch):
    """In the plane of the arc all rotations commute: turning by any angle about the hinge is exact."""
    original = build.read_mesh

    def with_hinge(*arguments):
        mesh = original(*arguments)
        line = np.flatnonzero(np.linalg.norm(mesh.points[:, :2], axis=1) < 1e-9)
        return replace(mesh, node_sets=dict(mesh.node_sets) | {"HINGE": line})

    monkeypatch.setattr(build, "read_mesh", with_hinge)
    hinge = [SupportTable(nodes="HINGE", fix=["x", "y", "z"])]
    config = body_without_error(CURVED / "body.toml")
    changes = {"frames": 2, "free": True, "support": hinge, "mesh": MeshTable(file=CURVED / "arc_45.inp")}
    body = reduce_body(config.model_copy(update=changes), Reporter())
    assert body.rigid_count == 1
    flat = np.abs(body.interface_displacement[0, 2]) < 1e-6 * np.abs(body.interface_displacement[0]).max()
    elastic = np.flatnonzero(flat & (body.angular_frequency > 0.0))[0]
    model = FlexibleBody(body, SECOND)
    reach = []
    for turn in (0.0, 0.5, -2.0):
        q = np.zeros(body.mode_count)
        q[elastic] = 0.1 / np.linalg.norm(body.interface_displacement[0, :, elastic])
        q[0] = turn / body.frame_rotation[0, 2, 0]
        tip = body.interface_point[0] + model.core.motion(q)[:3]
        reach.append(np.linalg.norm(tip))
    np.testing.assert_allclose(reach, reach[0], rtol=1e-12)
    assert abs(reach[0] - np.linalg.norm(body.interface_point[0])) > 1e-3
