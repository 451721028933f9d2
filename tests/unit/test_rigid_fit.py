"""The distributing coupling: rigid motions are read exactly, loads are spread without loss, and over area."""

import numpy as np
import pytest
import scipy.sparse as sp

from flexfmu.fe.assembly import area_matrix, select
from flexfmu.mesh.elements import ElementType
from flexfmu.reduction.rigid_fit import Weighted, by_node, modal_fit, rigid_fit
from meshes import EVERY_TYPE, arc, box, grid, lattice, with_sets

# Consistent shares of a uniform traction on a flat face: of each corner and of each mid-side node.
SHARES = {
    ElementType.C3D8: (4, 1 / 4, 0.0),
    ElementType.C3D20: (4, -1 / 12, 1 / 3),
    ElementType.C3D20R: (4, -1 / 12, 1 / 3),
    ElementType.C3D4: (3, 1 / 3, 0.0),
    ElementType.C3D10: (3, 0.0, 1 / 3),
}
EVERY = pytest.mark.parametrize("kind", EVERY_TYPE, ids=lambda kind: kind.name)


def graded(kind):
    """Box whose face x = 0 has 2 × 2 cells of four different sizes: 0.3 or 0.7 by 0.4 or 1.6."""
    steps = (np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.15, 0.3, 0.65, 1.0]), np.array([0.0, 0.2, 0.4, 1.2, 2.0]))
    at = [np.arange(len(values)) / 2.0 for values in steps]
    mesh = lattice(
        kind, grid(1, 2, 2), lambda p: np.column_stack([np.interp(p[:, i], at[i], steps[i]) for i in range(3)])
    )
    return with_sets(mesh, FACE=lambda p: p[:, 0])


def by_area(mesh, name):
    nodes = mesh.node_sets[name]
    return Weighted(nodes, area_matrix(mesh.points, select(mesh.faces, nodes, outer=True), nodes))


def rigid_motion(points, origin, displacement, rotation):
    return (displacement + np.cross(rotation, points - origin)).ravel()


def some_weights(mesh, random):
    """By node, by numbers, by area, and by a full matrix."""
    nodes = mesh.node_sets["FACE"]
    root = random.standard_normal((nodes.size, nodes.size))
    full = Weighted(nodes, sp.csr_array(root @ root.T + nodes.size * np.eye(nodes.size)))
    return [by_node(nodes), by_node(nodes, random.uniform(0.1, 3.0, nodes.size)), by_area(mesh, "FACE"), full]


@EVERY
@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (1e-3, 0.0), (1e-3, 1.0), (1e3, 0.0), (1.0, 1e3)])
def test_a_rigid_motion_is_read_exactly_with_any_weights_and_at_any_size(kind, scale, shift, random):
    mesh = graded(kind)
    points = scale * mesh.points + shift
    origin = points.mean(axis=0) + scale * np.array([0.3, -0.2, 0.5])
    displacement, rotation = scale * random.standard_normal(3), random.standard_normal(3)
    for weighted in some_weights(mesh, random):
        operator, rank = rigid_fit(points, weighted, origin)
        found = operator @ rigid_motion(points[weighted.nodes], origin, displacement, rotation)
        assert rank == 6
        # Round-off of coordinates far away is what is left.
        loss = 1e-12 * max(1.0, shift / scale)
        np.testing.assert_allclose(found[:3], displacement, atol=loss * scale * 10.0)
        np.testing.assert_allclose(found[3:], rotation, atol=loss * 10.0)


@EVERY
def test_spread_loads_have_the_resultant_and_the_moment_of_the_load(kind, random):
    mesh = graded(kind)
    points, origin = mesh.points, np.array([0.4, 1.1, -0.3])
    for weighted in some_weights(mesh, random):
        operator, _ = rigid_fit(points, weighted, origin)
        wrench = random.standard_normal(6)
        nodal = (operator.T @ wrench).reshape(-1, 3)
        np.testing.assert_allclose(nodal.sum(axis=0), wrench[:3], atol=1e-12)
        moment = np.cross(points[weighted.nodes] - origin, nodal).sum(axis=0)
        np.testing.assert_allclose(moment, wrench[3:], atol=1e-12)


@EVERY
def test_virtual_work_of_spread_loads_is_that_of_the_load_on_the_fit(kind, random):
    mesh = graded(kind)
    for weighted in some_weights(mesh, random):
        operator, _ = rigid_fit(mesh.points, weighted, np.array([0.1, 0.2, 0.3]))
        displacement, wrench = random.standard_normal(operator.shape[1]), random.standard_normal(6)
        nodal = operator.T @ wrench
        assert nodal @ displacement == pytest.approx(wrench @ (operator @ displacement), rel=1e-12)
        # The fit of a spread is one to one: no direction is lost.
        assert np.linalg.matrix_rank(operator) == 6


@EVERY
def test_a_central_force_becomes_the_consistent_nodal_forces_of_a_uniform_traction(kind):
    mesh = graded(kind)
    nodes = mesh.node_sets["FACE"]
    (faces,) = select(mesh.faces, nodes, outer=True)
    corners, at_corner, at_middle = SHARES[kind]
    expected = np.zeros(len(mesh.points))
    total = 0.0
    for face in faces:
        ring = mesh.points[face[:corners]]
        area = 0.5 * np.linalg.norm(sum(np.cross(ring[i], ring[(i + 1) % corners]) for i in range(corners)))
        expected[face[:corners]] += at_corner * area
        expected[face[corners:]] += at_middle * area
        total += area
    assert total == pytest.approx(2.0, rel=1e-12)
    weighted = by_area(mesh, "FACE")
    centre = weighted.centre(mesh.points)
    np.testing.assert_allclose(centre, [0.0, 0.5, 1.0], atol=1e-9)
    operator, _ = rigid_fit(mesh.points, weighted, centre)
    for axis in range(3):
        nodal = operator[axis].reshape(-1, 3)
        np.testing.assert_allclose(nodal[:, axis], expected[nodes] / total, atol=1e-9)
        np.testing.assert_allclose(np.delete(nodal, axis, axis=1), 0.0, atol=1e-12)
    # Counting nodes instead of area gives another spread on these unequal faces.
    other, _ = rigid_fit(mesh.points, by_node(nodes), centre)
    assert np.abs(other - operator).max() > 0.01


def test_one_quadratic_face_takes_a_minus_twelfth_at_corners_and_a_third_at_mid_sides():
    mesh = box(ElementType.C3D20R, (1, 1, 1), (1.0, 1.0, 1.0))
    weighted = by_area(mesh, "TIP")
    operator, _ = rigid_fit(mesh.points, weighted, weighted.centre(mesh.points))
    shares = np.sort(operator[2].reshape(-1, 3)[:, 2])
    np.testing.assert_allclose(shares, [-1 / 12] * 4 + [1 / 3] * 4, atol=1e-14)


@EVERY
def test_the_fit_over_an_area_does_not_depend_on_how_fine_the_mesh_is(kind):
    def fit(counts, field):
        mesh = box(kind, counts, (0.5, 1.0, 0.8))
        weighted = by_area(mesh, "TIP")
        operator, _ = rigid_fit(mesh.points, weighted, np.array([0.5, 0.0, 0.0]))
        return operator @ field(mesh.points[weighted.nodes]).ravel()

    # Any linear field is in the span of all meshes, so that its best rigid motion is one and the same.
    gradient = np.random.default_rng(3).standard_normal((3, 3))

    def field(points):
        return points @ gradient.T

    np.testing.assert_allclose(fit((1, 1, 1), field), fit((1, 5, 3), field), atol=1e-9)


@pytest.mark.parametrize(("kind", "order"), [(ElementType.C3D4, 2), (ElementType.C3D10, 4), (ElementType.C3D20, 4)])
def test_the_area_of_a_curved_face_converges_to_that_of_the_surface(kind, order):
    def error(count):
        mesh = with_sets(arc(kind, (count, 2, 2), 1.0, 0.2), OUTSIDE=lambda p: np.hypot(p[:, 0], p[:, 1]) - 1.1)
        return abs(by_area(mesh, "OUTSIDE").weight.sum() / (0.5 * np.pi * 1.1 * 0.2) - 1.0)

    assert error(16) < (5e-4 if order == 2 else 2e-7)
    assert np.log2(error(8) / error(16)) == pytest.approx(order, abs=0.1)


@EVERY
def test_nodes_on_a_line_tell_five_motions_and_a_single_node_three(kind, random):
    mesh = with_sets(graded(kind), EDGE=lambda p: np.hypot(p[:, 0], p[:, 1]), POINT=lambda p: np.linalg.norm(p, axis=1))
    origin = np.zeros(3)
    for name, rank, known in (("EDGE", 5, [0, 1, 2, 3, 4]), ("POINT", 3, [0, 1, 2])):
        nodes = by_node(mesh.node_sets[name])
        operator, found = rigid_fit(mesh.points, nodes, origin)
        assert found == rank
        displacement, rotation = random.standard_normal(3), random.standard_normal(3)
        fit = operator @ rigid_motion(mesh.points[nodes.nodes], origin, displacement, rotation)
        np.testing.assert_allclose(fit[known], np.concatenate([displacement, rotation])[known], atol=1e-12)
        # What cannot be told is zero, not noise.
        np.testing.assert_allclose(np.delete(fit, known), 0.0, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_rank_does_not_depend_on_the_size_of_the_set(scale):
    mesh = with_sets(graded(ElementType.C3D10), EDGE=lambda p: np.hypot(p[:, 0], p[:, 1]))
    ranks = [rigid_fit(scale * mesh.points, by_node(mesh.node_sets[name]), np.zeros(3))[1] for name in ("FACE", "EDGE")]
    assert ranks == [6, 5]


@EVERY
def test_moving_the_origin_moves_the_displacement_by_rotation_times_arm(kind, random):
    mesh = graded(kind)
    weighted = by_area(mesh, "FACE")
    first, second = random.standard_normal((2, 3))
    shapes = random.standard_normal((3 * len(mesh.points), 4))
    at_first, turn, _ = modal_fit(mesh.points, shapes, weighted, first)
    at_second, same_turn, _ = modal_fit(mesh.points, shapes, weighted, second)
    np.testing.assert_allclose(same_turn, turn, atol=1e-12)
    moved = at_first + np.cross(turn, (second - first)[:, None], axis=0)
    np.testing.assert_allclose(at_second, moved, atol=1e-12)
    assert np.abs(at_second - at_first).max() > 0.1


def test_a_set_that_is_no_union_of_faces_has_no_area():
    mesh = graded(ElementType.C3D20R)
    nodes = mesh.node_sets["FACE"]
    faces = mesh.faces
    assert area_matrix(mesh.points, select(faces, nodes, outer=True), nodes) is not None
    # A node that no whole face holds, of the other end.
    more = np.union1d(nodes, [np.argmax(mesh.points[:, 0])])
    assert area_matrix(mesh.points, select(faces, more, outer=True), more) is None
    less = nodes[1:]
    assert area_matrix(mesh.points, select(faces, less, outer=True), less) is None


def test_a_section_inside_the_body_counts_once_and_only_where_inner_faces_are_wanted():
    mesh = with_sets(box(ElementType.C3D8, (2, 2, 2), (2.0, 1.0, 0.5)), MIDDLE=lambda p: p[:, 0] - 1.0)
    nodes = mesh.node_sets["MIDDLE"]
    faces = mesh.faces
    inner = area_matrix(mesh.points, select(faces, nodes, outer=False), nodes)
    assert inner.sum() == pytest.approx(0.5, rel=1e-12)
    assert area_matrix(mesh.points, select(faces, nodes, outer=True), nodes) is None
