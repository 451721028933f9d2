from dataclasses import replace

import numpy as np
import pytest

from flexfmu.files.basics import MeshError
from flexfmu.mesh.checks import checked, connected_parts, jacobian_determinants
from flexfmu.mesh.elements import ElementBlock, ElementType
from flexfmu.mesh.formats import read_mesh
from flexfmu.mesh.model import NO_MATERIAL, Mesh

TETRA = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
BRICK = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
TETRA_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
BRICK_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
SOLIDS = {
    ElementType.C3D4: TETRA,
    ElementType.C3D8: BRICK,
    ElementType.C3D10: np.vstack([TETRA, TETRA[TETRA_EDGES].mean(axis=1)]),
    ElementType.C3D20: np.vstack([BRICK, BRICK[BRICK_EDGES].mean(axis=1)]),
    ElementType.C3D20R: np.vstack([BRICK, BRICK[BRICK_EDGES].mean(axis=1)]),
}
KINDS = list(SOLIDS)


def mesh_of(kind: ElementType, *bodies: np.ndarray) -> Mesh:
    """Make a mesh of separate elements, labelled 101, 102, ..., their nodes 1, 2, ..."""
    points = np.vstack(bodies)
    count = len(points)
    connectivity = np.arange(count).reshape(len(bodies), -1)
    labels = np.arange(101, 101 + len(bodies))
    block = ElementBlock(kind, labels, connectivity, np.full(len(bodies), NO_MATERIAL))
    return Mesh(points, np.arange(1, count + 1), (block,), {}, {}, (), np.zeros((count, 3), dtype=bool))


@pytest.mark.parametrize("kind", KINDS)
def test_a_sound_element_passes_unchanged(kind):
    mesh = mesh_of(kind, SOLIDS[kind])
    assert checked(mesh) is mesh


@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_of_a_straight_element_is_its_volume_over_that_of_the_reference(kind):
    mesh = mesh_of(kind, SOLIDS[kind] * [2.0, 3.0, 5.0] + 100.0)
    reference = 1.0 if kind in (ElementType.C3D4, ElementType.C3D10) else 8.0
    np.testing.assert_allclose(jacobian_determinants(mesh.points, mesh.blocks[0]), 30.0 / reference, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_mirrored_element_is_refused_by_its_label(kind):
    mesh = mesh_of(kind, SOLIDS[kind], SOLIDS[kind] * [1.0, 1.0, -1.0], SOLIDS[kind] + 5.0)
    with pytest.raises(MeshError, match=r"1 of 3 elements are inverted or degenerate .*: 102;"):
        checked(mesh)


@pytest.mark.parametrize("kind", KINDS)
def test_an_element_pressed_flat_is_refused(kind):
    normal = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    flat = SOLIDS[kind] - np.outer(SOLIDS[kind] @ normal, normal)
    with pytest.raises(MeshError, match="degenerate"):
        checked(mesh_of(kind, flat + 0.1))


@pytest.mark.parametrize("kind", KINDS)
def test_an_element_that_is_flat_but_for_round_off_is_refused(kind):
    with pytest.raises(MeshError, match="degenerate"):
        checked(mesh_of(kind, SOLIDS[kind] * [1.0, 1.0, 1e-13]))


@pytest.mark.parametrize("kind", KINDS)
def test_an_element_with_two_coinciding_corners_is_refused(kind):
    points = SOLIDS[kind].copy()
    points[1] = points[0]
    with pytest.raises(MeshError, match="101"):
        checked(mesh_of(kind, points))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stretch", [(1e3, 1e3, 1.0), (1.0, 1.0, 1e3)])
@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_thin_slender_tiny_and_huge_elements_pass(kind, stretch, size):
    mesh = mesh_of(kind, SOLIDS[kind] * stretch * size)
    assert checked(mesh) is mesh


@pytest.mark.parametrize(("kind", "edge"), [(ElementType.C3D10, 4), (ElementType.C3D20, 8), (ElementType.C3D20R, 8)])
def test_a_mid_side_node_beyond_the_quarter_point_inverts_the_corner(kind, edge):
    points = SOLIDS[kind].copy()
    points[edge] = [0.3, 0.0, 0.0]
    checked(mesh_of(kind, points))
    points[edge] = [0.2, 0.0, 0.0]
    with pytest.raises(MeshError, match="inverted"):
        checked(mesh_of(kind, points))


@pytest.mark.parametrize("kind", [ElementType.C3D20, ElementType.C3D20R])
def test_faces_that_bulge_through_each_other_are_found_at_the_quadrature_points(kind):
    points = SOLIDS[kind].copy()
    # Mid-sides of bottom and top change places; the three edges at each corner still make a sound corner.
    points[8:12, 2], points[12:16, 2] = 0.8, 0.2
    determinants = jacobian_determinants(points, mesh_of(kind, points).blocks[0])[0]
    assert determinants[:8].min() > 0.0
    assert determinants[8:].min() < 0.0
    with pytest.raises(MeshError, match="inverted"):
        checked(mesh_of(kind, points))


def test_only_the_first_ten_bad_elements_are_named():
    mirrored = TETRA * [1.0, 1.0, -1.0]
    with pytest.raises(MeshError, match=r"12 of 12 .*: 101, .*, 110 and 2 more"):
        checked(mesh_of(ElementType.C3D4, *[mirrored + shift for shift in range(12)]))


def test_nodes_without_elements_are_left_out_and_all_rows_follow():
    sound = mesh_of(ElementType.C3D4, TETRA)
    points = np.insert(TETRA, [0, 2], [[9.0, 9.0, 9.0], [8.0, 8.0, 8.0]], axis=0)
    fixed = np.zeros((6, 3), dtype=bool)
    fixed[[3, 4], [0, 1]] = True
    mesh = replace(
        sound,
        points=points,
        labels=np.array([50, 10, 20, 60, 30, 40]),
        blocks=(replace(sound.blocks[0], connectivity=np.array([[1, 2, 4, 5]])),),
        node_sets={"Mixed": np.array([0, 2, 5]), "Stray": np.array([0, 3]), "Empty": np.zeros(0, dtype=np.int64)},
        fixed=fixed,
        notes=("read",),
    )
    reduced = checked(mesh)
    np.testing.assert_array_equal(reduced.points, TETRA)
    assert reduced.labels.tolist() == [10, 20, 30, 40]
    assert reduced.blocks[0].connectivity.tolist() == [[0, 1, 2, 3]]
    assert reduced.node_sets["Mixed"].tolist() == [1, 3]
    assert reduced.node_sets["Stray"].tolist() == []
    assert np.argwhere(reduced.fixed).tolist() == [[2, 1]]
    assert reduced.notes == (
        "read",
        "2 nodes that no element uses are left out: 50, 60",
        "node sets that hold none but such nodes are empty now: Stray",
    )


def test_a_mesh_without_elements_is_refused():
    with pytest.raises(MeshError, match="no solid elements"):
        checked(replace(mesh_of(ElementType.C3D4, TETRA), blocks=()))


def test_a_coordinate_that_is_not_finite_is_refused_by_its_label():
    points = TETRA.copy()
    points[2, 1] = np.nan
    with pytest.raises(MeshError, match="not finite: 3;"):
        checked(mesh_of(ElementType.C3D4, points))


def test_elements_that_share_a_node_are_one_part_and_others_are_not():
    mesh = mesh_of(ElementType.C3D4, TETRA, TETRA + 5.0, TETRA + 10.0)
    assert connected_parts(mesh).tolist() == [0] * 4 + [1] * 4 + [2] * 4
    connectivity = mesh.blocks[0].connectivity.copy()
    connectivity[2, 0] = 3
    joined = replace(mesh, blocks=(replace(mesh.blocks[0], connectivity=connectivity),))
    # Node 8 is left without an element: a part of its own.
    assert connected_parts(joined).tolist() == [0] * 4 + [1] * 4 + [2] + [0] * 3


def test_parts_reach_across_blocks():
    mesh = mesh_of(ElementType.C3D4, TETRA, TETRA + 5.0)
    first, second = (
        replace(mesh.blocks[0], labels=np.array([label]), connectivity=rows, material=np.array([NO_MATERIAL]))
        for label, rows in ((1, np.array([[0, 1, 2, 3]])), (2, np.array([[3, 4, 5, 6]])))
    )
    assert connected_parts(replace(mesh, blocks=(first, second))).tolist() == [0] * 7 + [1]


def test_nodes_left_out_leave_rotations_that_shells_are_held_by(tmp_path):
    """They are equations of the same width as others."""
    deck = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n9,5,5,5\n*ELEMENT,TYPE=S4,ELSET=E\n1,1,2,3,4\n"
    deck += "*SHELL SECTION,ELSET=E,MATERIAL=M\n.1\n*MATERIAL,NAME=M\n*ELASTIC\n2e11,.3\n*BOUNDARY\n1,1,4\n"
    path = tmp_path / "sheet.inp"
    path.write_text(deck)
    mesh = read_mesh(path)
    held = checked(mesh)
    assert 0 < held.supports.shape[0] == mesh.supports.shape[0]
    assert held.supports.shape[1] == held.points.size < mesh.points.size
    own, before = (one.points[np.unique(one.supports.indices // 3)] for one in (held, mesh))
    np.testing.assert_array_equal(own, before)
