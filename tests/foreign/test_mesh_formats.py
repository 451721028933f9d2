from dataclasses import replace
from itertools import product
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from flexfmu.fe.assembly import stiffness
from flexfmu.files.basics import BodyFileError, MeshError, UnitSystem
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from flexfmu.mesh.in_memory import from_meshio
from flexfmu.mesh.model import NO_MATERIAL, Material
from flexfmu.reduction.model import completed
from flexfmu.reduction.options import BodyOptions, MaterialConstants
from meshes import box

# Two unit cubes in a row along x; nodes by x, then the square's corners.
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
POINTS = np.array([(x, y, z) for x in (0.0, 1.0, 2.0) for y, z in SQUARE])
BRICKS = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]])
ROOT, TIP = [0, 1, 2, 3], [8, 9, 10, 11]
DECK = (
    "*NODE\n"
    + "".join(f"{label}, {x}, {y}, {z}\n" for label, (x, y, z) in enumerate(POINTS, 1))
    + "*ELEMENT, TYPE=C3D8I, ELSET=Body\n"
    + "".join(f"{label}, {', '.join(str(node + 1) for node in row)}\n" for label, row in enumerate(BRICKS, 1))
    + "*NSET, NSET=Root\n1, 2, 3, 4\n*NSET, NSET=Tip, GENERATE\n9, 12\n"
)


def cubes_with_physical_groups(named: bool = True) -> meshio.Mesh:
    """Make the cubes with their end faces, in gmsh's physical groups."""
    cells = [("quad", np.array([ROOT, TIP])), ("hexahedron", BRICKS)]
    tags = [np.array([1, 2]), np.array([7, 7])]
    # The written file keeps one geometrical entity for each block and tag.
    geometry = [np.array([1, 2]), np.array([1, 1])]
    names = {"Root": np.array([1, 2]), "Tip": np.array([2, 2]), "Body": np.array([7, 3])} if named else {}
    return meshio.Mesh(POINTS, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": geometry}, field_data=names)


def write_gmsh(folder: Path, mesh: meshio.Mesh) -> Path:
    path = folder / "body.msh"
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


def write(folder: Path, kind: str, data: np.ndarray, points: np.ndarray = POINTS) -> Path:
    path = folder / "body.vtk"
    meshio.write(path, meshio.Mesh(points, [(kind, data)]))
    return path


def test_gmsh_physical_groups_give_the_sets_of_the_deck(tmp_path):
    deck = tmp_path / "body.inp"
    deck.write_text(DECK)
    expected = read_mesh(deck, UnitSystem.SI)
    mesh = read_mesh(write_gmsh(tmp_path, cubes_with_physical_groups()), UnitSystem.SI)
    np.testing.assert_array_equal(mesh.points, expected.points)
    np.testing.assert_array_equal(mesh.labels, expected.labels)
    (block,), (expected_block,) = mesh.blocks, expected.blocks
    assert block.type is expected_block.type
    np.testing.assert_array_equal(block.connectivity, expected_block.connectivity)
    np.testing.assert_array_equal(block.labels, expected_block.labels)
    for name in ("Root", "Tip"):
        np.testing.assert_array_equal(mesh.node_sets[name], expected.node_sets[name])
    np.testing.assert_array_equal(mesh.element_sets["Body"], expected.element_sets["Body"])


def test_groups_of_surfaces_are_no_element_sets(tmp_path):
    mesh = read_mesh(write_gmsh(tmp_path, cubes_with_physical_groups()), UnitSystem.SI)
    assert list(mesh.element_sets) == ["Body"]
    assert sorted(mesh.node_sets) == ["Body", "Root", "Tip"]
    assert mesh.node_sets["Body"].tolist() == list(range(12))


def test_physical_groups_without_names_are_called_after_kind_and_number(tmp_path):
    mesh = read_mesh(write_gmsh(tmp_path, cubes_with_physical_groups(named=False)), UnitSystem.SI)
    assert mesh.node_sets["Physical Surface 2"].tolist() == TIP
    assert mesh.element_sets["Physical Volume 7"].tolist() == [0, 1]


def test_cells_in_no_physical_group_are_in_no_set(tmp_path):
    cubes = cubes_with_physical_groups()
    cubes.cell_data["gmsh:physical"][1] = np.array([7, 0])
    cubes.cell_data["gmsh:geometrical"][1] = np.array([1, 2])
    mesh = read_mesh(write_gmsh(tmp_path, cubes), UnitSystem.SI)
    assert mesh.element_count == 2
    assert {name: rows.tolist() for name, rows in mesh.element_sets.items()} == {"Body": [0]}
    assert sorted(mesh.node_sets) == ["Body", "Root", "Tip"]


def test_volume_groups_of_a_mesh_file_have_their_own_materials(tmp_path):
    cubes = cubes_with_physical_groups()
    cubes.cell_data["gmsh:physical"][1] = np.array([7, 8])
    cubes.cell_data["gmsh:geometrical"][1] = np.array([1, 2])
    cubes.field_data["Glue"] = np.array([8, 3])
    mesh = read_mesh(write_gmsh(tmp_path, cubes), UnitSystem.SI)
    soft, stiff = MaterialConstants(None, 1e9, 0.4, 1000.0), MaterialConstants("glue", 2e11, 0.3, 7850.0)
    made, notes = completed(mesh, BodyOptions("b", (), materials=(soft, stiff)))
    assert [made.materials[k].youngs_modulus for k in made.blocks[0].material] == [1e9, 2e11]
    assert notes == ()
    with pytest.raises(BodyFileError, match=r"1 of 2 elements have no material.*for each element set, with its name"):
        completed(mesh, BodyOptions("b", (), materials=(stiff,)))
    with pytest.raises(
        BodyFileError, match=r"no such material; it has: none.*no element set 'wood'; it has: Body, Glue"
    ):
        completed(mesh, BodyOptions("b", (), materials=(soft, replace(stiff, name="wood"))))


# Two tetrahedra and a triangle in two groups, as gmsh's current format has it.
MSH41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
2 1 "Root"
2 2 "Sealed"
3 3 "Body"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 1 1 0 2 1 2 0
1 0 0 0 1 1 1 1 3 1 1
$EndEntities
$Nodes
1 5 1 5
3 1 0 5
1
2
3
4
5
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
$EndNodes
$Elements
2 3 1 3
2 1 2 1
1 1 2 3
3 1 4 2
2 1 2 3 4
3 2 3 4 5
$EndElements
"""


def test_a_surface_in_two_groups_of_the_current_gmsh_format_is_in_both_sets(tmp_path):
    path = tmp_path / "body.msh"
    path.write_text(MSH41)
    mesh = read_mesh(path, UnitSystem.SI)
    assert mesh.node_sets["Root"].tolist() == [0, 1, 2]
    assert mesh.node_sets["Sealed"].tolist() == [0, 1, 2]
    assert mesh.element_sets["Body"].tolist() == [0, 1]
    assert not any(name.startswith("gmsh:") for name in mesh.node_sets)


def test_point_sets_are_node_sets(tmp_path, monkeypatch):
    with_sets = meshio.Mesh(
        POINTS, [("hexahedron", BRICKS)], point_sets={"Tip": np.array([11, 9, 8, 10, 8])}, cell_sets={"Tip": [[0]]}
    )
    path = write(tmp_path, "hexahedron", BRICKS)
    monkeypatch.setattr(meshio, "read", lambda _: with_sets)
    mesh = read_mesh(path, UnitSystem.SI)
    assert mesh.node_sets["Tip"].tolist() == TIP
    assert mesh.element_sets["Tip"].tolist() == [0]
    assert any("'Tip'" in note for note in mesh.notes)


def test_a_vtk_mesh_has_no_sets_no_materials_and_no_supports(tmp_path):
    mesh = read_mesh(write(tmp_path, "hexahedron", BRICKS), UnitSystem.SI)
    assert mesh.node_sets == {}
    assert mesh.element_sets == {}
    assert mesh.materials == ()
    assert mesh.blocks[0].material.tolist() == [NO_MATERIAL, NO_MATERIAL]
    assert not mesh.fixed.any()


def test_millimetres_become_metres(tmp_path):
    mesh = read_mesh(write(tmp_path, "hexahedron", BRICKS, 1000.0 * POINTS), UnitSystem.MM_T_S)
    np.testing.assert_allclose(mesh.points, POINTS, rtol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".msh", ".xdmf", ".bdf"])
def test_every_kind_of_element_keeps_its_node_order_through_a_file(tmp_path, suffix):
    for cells, kind, points in quadratic_and_linear_cells():
        path = tmp_path / f"{cells}{suffix}"
        row = np.arange(len(points)).reshape(1, -1)
        # The suffix .msh is another program's too.
        file_format = "gmsh" if suffix == ".msh" else None
        meshio.write(path, meshio.Mesh(points, [(cells, row)]), file_format=file_format)
        mesh = read_mesh(path, UnitSystem.SI)
        (block,) = mesh.blocks
        assert block.type is kind
        np.testing.assert_allclose(mesh.points[block.connectivity[0]], points, atol=1e-12)
        checked(mesh)


def quadratic_and_linear_cells():
    tetra = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    brick = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in SQUARE])
    tetra_edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    brick_edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    middles = [corners[edges].mean(axis=1) for corners, edges in ((tetra, tetra_edges), (brick, brick_edges))]
    return [
        ("tetra", ElementType.C3D4, tetra),
        ("tetra10", ElementType.C3D10, np.vstack([tetra, middles[0]])),
        ("hexahedron", ElementType.C3D8I, brick),
        ("hexahedron20", ElementType.C3D20R, np.vstack([brick, middles[1]])),
    ]


def test_blocks_of_one_kind_are_joined_and_elements_numbered_in_the_files_order(tmp_path, monkeypatch):
    tetra = np.array([[0, 1, 3, 4]])
    cells = [("hexahedron", BRICKS[:1]), ("tetra", tetra), ("hexahedron", BRICKS[1:])]
    found = meshio.Mesh(POINTS, cells, cell_sets={"Last": [None, None, np.array([0])], "Tets": [[], [0], []]})
    path = write(tmp_path, "hexahedron", BRICKS)
    monkeypatch.setattr(meshio, "read", lambda _: found)
    mesh = read_mesh(path, UnitSystem.SI)
    assert [block.type for block in mesh.blocks] == [ElementType.C3D8I, ElementType.C3D4]
    assert [block.labels.tolist() for block in mesh.blocks] == [[1, 3], [2]]
    assert mesh.element_sets["Last"].tolist() == [1]
    assert mesh.element_sets["Tets"].tolist() == [2]
    assert mesh.node_sets["Last"].tolist() == sorted(BRICKS[1].tolist())


def test_other_volume_cells_are_refused_by_name():
    with pytest.raises(MeshError, match="kind tetra20, supported are tetra"):
        from_meshio(meshio.Mesh(np.zeros((20, 3)), [("tetra20", np.arange(20)[None])]), "body", UnitSystem.SI)


def test_bricks_with_nodes_in_their_faces_are_those_of_20_nodes(tmp_path):
    own = box(ElementType.C3D20, (2, 1, 1), (0.2, 0.1, 0.1))
    rows = own.blocks[0].connectivity
    middle = len(own.points) + np.arange(7 * len(rows)).reshape(-1, 7)
    points = np.concatenate([own.points, np.zeros((middle.size, 3))])
    path = tmp_path / "body.vtu"
    meshio.Mesh(points, [("hexahedron27", np.hstack([rows, middle]))], cell_data={"part": [np.array([1, 2])]}).write(
        path
    )
    mesh = checked(read_mesh(path, UnitSystem.SI))
    assert mesh.volumes.tolist() == pytest.approx(own.volumes.tolist())
    assert mesh.element_sets["part 2"].tolist() == [1]
    assert any("hexahedron27 are taken as hexahedron20" in note for note in mesh.notes)


def test_pyramids_pass_the_patch_test_and_keep_their_sets():
    # Two cubes of six pyramids each, the second numbered otherwise: the diagonals of the common face agree.
    corners = np.array(list(product(range(3), range(2), range(2))), dtype=float)
    numbers = np.random.default_rng(3).permutation(len(corners))
    faces = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
    points = np.zeros((len(corners) + 2, 3))
    points[numbers], points[-2:] = corners, [(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)]
    cells = []
    for cube in range(2):
        unit = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
        places = unit + np.array([cube, 0, 0])
        rows = [int(numbers[np.flatnonzero((corners == place).all(axis=1))[0]]) for place in places]
        cells += [[*(rows[k] for k in face[::-1]), len(corners) + cube] for face in faces]
    marks = [np.repeat([1, 2], 6)]
    found = meshio.Mesh(points, [("pyramid", np.array(cells))], cell_data={"cube": marks})
    mesh = checked(from_meshio(found, "cubes", UnitSystem.SI))
    assert mesh.element_count == 24
    assert mesh.volumes[mesh.element_sets["cube 2"]].sum() == pytest.approx(1.0)
    assert any("12 pyramids are taken as two linear tetrahedra each" in note for note in mesh.notes)
    materials = (Material("steel", 2e11, 0.3, 7850.0),)
    blocks = tuple(replace(b, material=np.zeros(len(b.labels), dtype=np.int64)) for b in mesh.blocks)
    forces = stiffness(replace(mesh, materials=materials, blocks=blocks)) @ (mesh.points * [1e-3, 2e-3, 3e-3]).ravel()
    # Of uniform strain each of the four nodes around the common face takes what tractions on outer faces give.
    across = forces.reshape(-1, 3)[np.isclose(mesh.points[:, 0], 1.0), 0]
    np.testing.assert_allclose(across, 0.0, atol=1e-6 * np.abs(forces).max())
    assert np.abs(forces.reshape(-1, 3)[-2:]).max() < 1e-9 * np.abs(forces).max()


def test_quadratic_pyramids_bend_as_a_beam_does():
    """A cube of six: its middle nodes feel no force in pure bending, and its bases are those of quadratic bricks."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    points, known = [*corners, np.array([0.45, 0.55, 0.5])], {}
    cells = []
    for face in ((3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)):
        row = [*face, 8]
        for one, other in [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]:
            edge = tuple(sorted((row[one], row[other])))
            if edge not in known:
                known[edge] = len(points)
                points.append(0.5 * (points[edge[0]] + points[edge[1]]))
            row.append(known[edge])
        cells.append(row)
    mesh = checked(from_meshio(meshio.Mesh(np.array(points), [("pyramid13", np.array(cells))]), "cube", UnitSystem.SI))
    assert mesh.volumes.sum() == pytest.approx(1.0)
    assert mesh.blocks[0].type is ElementType.C3D10
    blocks = tuple(replace(b, material=np.zeros(len(b.labels), dtype=np.int64)) for b in mesh.blocks)
    steel = replace(mesh, materials=(Material("steel", 2e11, 0.3, 7850.0),), blocks=blocks)
    x, y, z = mesh.points.T
    bent = np.column_stack([x * y, -0.5 * (x**2 + 0.3 * (y**2 - z**2)), -0.3 * y * z])
    forces = np.linalg.norm((stiffness(steel) @ bent.ravel()).reshape(-1, 3), axis=1)
    inside = [8, *(row for edge, row in known.items() if 8 in edge)]
    assert forces[inside].max() < 1e-9 * forces.max()
    np.testing.assert_allclose(mesh.equations @ bent.ravel(), 0.0, atol=1e-12)
    assert mesh.equations.shape[0] == 18


def test_elements_between_the_same_corners_count_once():
    quadratic = box(ElementType.C3D20, (2, 1, 1), (0.2, 0.1, 0.1))
    rows = quadratic.blocks[0].connectivity
    cells = [("hexahedron", rows[:, :8]), ("hexahedron20", rows), ("hexahedron20", rows[1:])]
    found = meshio.Mesh(quadratic.points, cells, cell_sets={"last": [np.array([1]), np.array([1]), np.array([0])]})
    mesh = checked(from_meshio(found, "body", UnitSystem.SI))
    assert [(block.type, len(block.labels)) for block in mesh.blocks] == [(ElementType.C3D20R, 2)]
    assert mesh.volumes.sum() == pytest.approx(0.2 * 0.1 * 0.1)
    assert mesh.element_sets["last"].tolist() == [1]
    assert any("3 elements lie on others" in note for note in mesh.notes)


def test_med_files_without_groups_are_read(tmp_path):
    path = tmp_path / "body.med"
    path.write_bytes(Path(__file__).with_name("gmsh_tets.med").read_bytes())
    with h5py.File(path, "a") as file:
        found = []
        file.visititems(lambda name, _: found.append(name) if name.endswith("/GRO") else None)
        for name in found:
            del file[name]
    assert found
    mesh = read_mesh(path, UnitSystem.SI)
    assert mesh.element_count == 202
    assert not mesh.node_sets


def test_a_surface_mesh_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"no volume cells \(found: quad\)"):
        read_mesh(write(tmp_path, "quad", np.array([ROOT])), UnitSystem.SI)


def test_cells_of_points_that_are_not_defined_are_refused(tmp_path, monkeypatch):
    path = write(tmp_path, "hexahedron", BRICKS)
    monkeypatch.setattr(meshio, "read", lambda _: meshio.Mesh(POINTS, [("hexahedron", BRICKS + 1)]))
    with pytest.raises(MeshError, match="points that it does not define"):
        read_mesh(path, UnitSystem.SI)


@pytest.mark.parametrize("name", ["body.msh", "body.vtk", "body.vtu", "body.bdf", "body.unknown", "body"])
def test_a_file_that_cannot_be_read_is_a_mesh_error_and_nothing_is_printed(tmp_path, capsys, name):
    path = tmp_path / name
    path.write_text("this is no mesh\n")
    with pytest.raises(MeshError, match=name):
        read_mesh(path, UnitSystem.SI)
    assert capsys.readouterr() == ("", "")


def test_a_truncated_file_is_a_mesh_error(tmp_path):
    path = write_gmsh(tmp_path, cubes_with_physical_groups())
    path.write_text(path.read_text()[:400])
    with pytest.raises(MeshError, match=r"body\.msh"):
        read_mesh(path, UnitSystem.SI)


def test_a_missing_file_is_a_mesh_error(tmp_path):
    with pytest.raises(MeshError, match="no such file"):
        read_mesh(tmp_path / "gone.vtk", UnitSystem.SI)


@pytest.mark.parametrize("suffix", [".g", ".gen"])
def test_geometry_files_of_cubit_are_exodus(tmp_path, suffix):
    path = tmp_path / f"body{suffix}"
    path.write_bytes((Path(__file__).parent / "exodus_bricks.e").read_bytes())
    assert read_mesh(path).element_count == 24
