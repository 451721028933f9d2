"""Shells of layers: A, B and D of laminate theory, published plates, angles and orientations, stress, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.thin.bodies import LAYERS, Middle

import flexfmu
from decks import read
from flexfmu.fe.assembly import stiffness, unknowns
from flexfmu.fe.gradients import nodal_stress, point_stress
from flexfmu.files.basics import DeckError, MeshError
from flexfmu.mesh.model import Material, laminate
from physics.test_shells import KINDS, bulk_data, grid, shell, solved
from turns import exponential

PLANE = np.array([0, 1, 3])


def orthotropic(first, second, ratio, shear, across, other):
    """Material of fibres along the first axis; across them Poisson's ratio is 0.25."""
    soft = np.diag([1 / first, 1 / second, 1 / second, 1 / shear, 1 / other, 1 / across])
    for i, j, value in ((0, 1, ratio / first), (0, 2, ratio / first), (1, 2, 0.25 / second)):
        soft[i, j] = soft[j, i] = -value
    return Material("ply", second, 0.25, 1.0, tuple(np.linalg.inv(soft).ravel().tolist()))


# A ply of Pagano's plates, and one of carbon fibres.
PAGANO = orthotropic(25.0, 1.0, 0.25, 0.5, 0.5, 0.2)
CARBON = orthotropic(140e9, 10e9, 0.3, 5e9, 5e9, 3.5e9)


def in_plane(ply, angle):
    """Plane stress (3, 3) of a ply turned by an angle, by the formulas of the textbooks."""
    q = np.linalg.inv(np.linalg.inv(ply.elasticity)[PLANE[:, None], PLANE])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c * c, s * s, -2 * s * c], [s * s, c * c, 2 * s * c], [s * c, -s * c, c * c - s * s]])
    return turn @ q @ turn.T


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("by_normal", "sense"), [(True, 1.0), (False, 1.0), (False, -1.0)])
def test_energy_of_stretched_and_bent_patches_is_that_of_laminate_theory(kind, by_normal, sense):
    points, cells = grid(4, 4, lambda a, b: (0.24 * a, 0.12 * b, 0.0), kind, 0.3)
    thickness, angles, turn = 0.003, np.radians([10.0, -40.0, 75.0]), exponential(np.array([0.3, 1.0, -2.0]))
    heights, direction = thickness * np.array([0.5, 0.2, 0.3]), np.radians(25.0)
    plies = [(h, a, CARBON) for h, a in zip(heights, angles, strict=True)]
    # The material's axes are turned about the normal, and maybe upside down; tilted, their first one is projected.
    c, s = np.cos(direction), np.sin(direction)
    own = np.array([[c, -s * sense, 0.0], [s, c * sense, 0.0], [0.0, 0.0, sense]])
    flat, mesh = shell(points, cells, thickness), shell(points @ turn.T, cells, thickness)
    axes = np.tile(turn @ own, (len(cells), 1, 1))
    made = laminate("layers", plies, by_normal=by_normal)
    mesh = replace(mesh, materials=(made,), blocks=(replace(mesh.blocks[0], axes=axes),))
    x, y, z = flat.points.T
    # Strains e + z k, shear twice: u = (e − z …) so that w = −½ (k₀ x² + k₂ x y + k₁ y²).
    e, k = np.array([1.0, -0.6, 0.8]) * 1e-3, np.array([0.5, 1.2, -0.7])
    moved = np.column_stack(
        [
            e[0] * x + 0.5 * e[2] * y + z * (k[0] * x + 0.5 * k[2] * y),
            e[1] * y + 0.5 * e[2] * x + z * (k[1] * y + 0.5 * k[2] * x),
            -0.5 * (k[0] * x**2 + k[2] * x * y + k[1] * y**2),
        ]
    )
    whole = unknowns(np.zeros((len(x), 3), dtype=bool), mesh.equations, mesh.mixed)
    u = whole.of((moved @ turn.T).ravel())
    z = np.cumsum([-0.5 * thickness, *heights])
    plane = np.array([in_plane(CARBON, direction + (a if by_normal else sense * a)) for a in angles])
    a, b, d = (np.einsum("lij,l->ij", plane, np.diff(z**n) / n) for n in (1, 2, 3))
    expected = 0.5 * 0.24 * 0.12 * (e @ a @ e + 2.0 * e @ b @ k + k @ d @ k)
    assert abs(e @ b @ k) > 0.1 * (e @ a @ e)
    assert 0.5 * u @ stiffness(mesh) @ u == pytest.approx(expected, rel=1e-6)


def deflection(angles, ratio, kind="quad8", n=8):
    """Middle of a square plate, simply supported, under a load of one half wave each way: 100 w E₂ t³/q L⁴."""
    points, cells = grid(n, n, lambda a, b: (0.5 * a, 0.5 * b, 0.0), kind)
    fixed, turning = np.zeros((2, len(points), 3), dtype=bool)
    for side, moves in ((points < 1e-9, False), (points > 0.5 - 1e-9, True)):
        for axis in (0, 1):
            along = np.arange(3) == axis
            fixed[side[:, axis]] |= along if moves else ~along
            turning[side[:, axis]] |= ~along if moves else along
    mesh = shell(points, cells, 1.0 / ratio, fixed, turning)
    mesh = replace(mesh, materials=(laminate("plate", [(1.0, np.radians(a), PAGANO) for a in angles], by_normal=True),))
    forces, wave = np.zeros_like(mesh.points), np.prod(np.sin(np.pi * mesh.points[:, :2]), axis=1)
    for nodes, matrix in zip(mesh.blocks[0].connectivity, mesh.volume_matrices[0], strict=True):
        forces[nodes, 2] += ratio * matrix @ wave[nodes]
    middle = (mesh.points[:, :2] > 0.5 - 1e-9).all(axis=1)
    return 100.0 * solved(mesh, forces)[middle, 2].mean() / ratio**3


@pytest.mark.parametrize(
    ("angles", "ratio", "expected", "bound"),
    [
        # In three dimensions: N. J. Pagano, S. J. Hatfield, AIAA J. 10 (1972) 931.
        ((0, 90, 90, 0), 10.0, 0.743, 0.005),
        ((0, 90, 90, 0), 20.0, 0.517, 0.008),
        # Of first order, shear by 5/6: J. N. Reddy, Mechanics of Laminated Composite Plates and Shells, 2004.
        ((0, 90, 90, 0), 100.0, 0.4337, 0.004),
        ((0, 90), 10.0, 1.2373, 0.004),
        ((0, 90), 100.0, 1.0651, 0.002),
    ],
)
def test_plates_of_crossed_layers_bend_as_published(angles, ratio, expected, bound):
    assert deflection(angles, ratio) == pytest.approx(expected, rel=bound)


def test_one_layer_is_what_the_material_by_itself_is():
    points, cells = grid(4, 2, lambda a, b: (a, 0.3 * b, 0.1 * a * b))
    plain = shell(points, cells, 0.02, constants=(2e11, 0.3))
    steel = plain.materials[0]
    for made in (
        replace(steel, constants=tuple(steel.elasticity.ravel())),
        laminate("s", [(1, 0.3, steel)] * 3, by_normal=True),
    ):
        difference = stiffness(replace(plain, materials=(made,))) - stiffness(plain)
        # Of a warped shell the three layers' own points differ from those of the whole by the change of its area.
        assert abs(difference).max() < 1e-6 * abs(stiffness(plain)).max()


def test_stress_of_each_layer_is_that_of_its_own_elasticity_and_pictures_show_the_outer_ones():
    points, cells = grid(2, 2, lambda a, b: (0.2 * a, 0.1 * b, 0.0), "quad8", 0.2)
    angles = np.radians([0.0, 30.0, 60.0])
    mesh = shell(points, cells, 0.002)
    mesh = replace(mesh, materials=(laminate("l", [(1.0, a, CARBON) for a in angles], by_normal=True),))
    strain = np.array([1e-3, -2e-4, 5e-4])
    x, y, _ = mesh.points.T
    moved = np.column_stack([strain[0] * x + 0.5 * strain[2] * y, strain[1] * y + 0.5 * strain[2] * x, 0.0 * x])
    places, stress = point_stress(mesh, np.arange(len(cells)), moved.reshape(-1, 1))
    # Both faces of three layers, four points on each, which come layer by layer.
    assert len(places) == len(cells) * 3 * 2 * 4
    by_layer = stress.reshape(len(cells), 3, 8, 6)
    heights = places.reshape(len(cells), 3, 2, 4, 3)[..., 2]
    np.testing.assert_allclose(heights[0, :, :, 0], 1e-3 * np.array([[-1, -1 / 3], [-1 / 3, 1 / 3], [1 / 3, 1]]))
    for own, angle in zip(by_layer.swapaxes(0, 1), angles, strict=True):
        expected = in_plane(CARBON, angle) @ strain
        np.testing.assert_allclose(own[..., PLANE], np.broadcast_to(expected, own[..., PLANE].shape), rtol=1e-6)
    nodes = np.unique(mesh.blocks[0].connectivity)
    shown = nodal_stress(mesh, nodes, moved.reshape(-1, 1))[:, PLANE, 0]
    for node, found in zip(nodes, shown, strict=True):
        expected = in_plane(CARBON, angles[2 if mesh.points[node, 2] > 0.0 else 0]) @ strain
        np.testing.assert_allclose(found, expected, rtol=1e-6)


DECK = """*NODE
1, 0., 0., 0.
2, 2., 0., 0.
3, 2., 1., 0.
4, 0., 1., 0.
*ELEMENT, TYPE=S4, ELSET=E
1, 1, 2, 3, 4
*MATERIAL, NAME=A
*ELASTIC, TYPE=ENGINEERING CONSTANTS
140.E9, 10.E9, 10.E9, 0.3, 0.3, 0.4, 5.E9, 5.E9
3.5E9
*DENSITY
1600.
*MATERIAL, NAME=B
*ELASTIC
70.E9, 0.3
*DENSITY
2800.
*ORIENTATION, NAME=U
0.8, 0.6, 0., -0.6, 0.8, 0.{}
*ORIENTATION, NAME=V
0.6, 0.8, 0., -0.8, 0.6, 0.
*ORIENTATION, NAME=W
1., 0., 0., 0., 0., 1.
*SHELL SECTION, ELSET=E, COMPOSITE{}
"""
TURN = np.degrees(np.arctan2(0.6, 0.8))


def difference(first, second):
    """Largest difference of stiffnesses over the larger."""
    a, b = stiffness(first), stiffness(second)
    return abs(a - b).max() / abs(a).max()


def test_layers_of_decks_have_angles_or_orientations_and_may_be_mirrored(tmp_path):
    third = f"\n3, {90.0 - 2.0 * TURN}"
    meshes = [
        read(tmp_path, DECK.format(own, more) + rows)
        for own, more, rows in (
            ("", "", f"0.01, 3, A, {TURN}\n0.02, 3, B\n0.01, , A, {90.0 - TURN}\n"),
            ("", "", "0.01, , A, U\n0.02, , B, U\n0.01, , A, V\n"),
            ("", ", ORIENTATION=U", f"0.01, , A, 0.\n0.02, , B, 0.\n0.01, , A, {90.0 - 2.0 * TURN}\n"),
            # The card's turn is one about the third axis.
            (third, ", ORIENTATION=U", f"0.01, , A, {2.0 * TURN - 90.0}\n0.02, , B, 0.\n0.01, , A, 0.\n"),
        )
    ]
    for other in meshes[1:]:
        assert difference(meshes[0], other) < 1e-9
    material = meshes[0].materials[0]
    assert (material.density, len(material.layers)) == (pytest.approx(0.5 * (1600.0 + 2800.0)), 3)
    assert not any("no section uses" in note for note in meshes[0].notes)
    mirrored = read(tmp_path, DECK.format("", ", SYMMETRIC") + "0.01, , A, 30.\n0.01, , B, 0.\n")
    written = read(tmp_path, DECK.format("", "") + "0.01, , A, 30.\n0.01, , B\n0.01, , B\n0.01, , A, 30.\n")
    assert difference(mirrored, written) < 1e-12


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("", "should have a row for each layer"),
        ("0.01, 3\n", "a positive thickness, then, third, its material"),
        ("0., 3, A\n", "a positive thickness, then, third, its material"),
        ("0.01, 3, A, 30.\n0.01, 3, A, U\n", "angles and orientations; give them one or the other"),
        ("0.01, 3, A, U\n0.01, 3, A, W\n", "should differ by turns about one axis"),
        ("0.01, 3, A, X\n", "orientation"),
    ],
)
def test_layers_that_say_too_little_or_too_much_are_refused_with_their_line(tmp_path, rows, message):
    with pytest.raises(DeckError, match=message):
        read(tmp_path, DECK.format("", "") + rows)


MAT8 = "MAT8,2,140.+9,10.+9,0.3,5.+9,5.+9,3.5+9,1600."


@pytest.mark.slow
def test_layers_of_bulk_data_are_those_of_the_deck(tmp_path):
    pytest.importorskip("pyNastran")
    middle = Middle("laminate")
    (tmp_path / "body.inp").write_text(middle.deck())
    deck = flexfmu.read_mesh(tmp_path / "body.inp")
    thick, angles = middle.thickness / 4.0, LAYERS["laminate"]
    plies = [f"2,{thick},{angle},NO" for angle in angles]
    forces = np.zeros_like(deck.points)
    forces[middle.tip] = 1.0, -2.0, 3.0
    held = np.tile(deck.points[:, :1] < 1e-6, (1, 3))
    expected = solved(replace(deck, fixed=held), forces)
    system = "CORD2R,9,,0.,0.,0.,0.,-.8,.6\n,1.,.0,0."
    for card, own in (
        ("PCOMP,1\n" + "".join(f",{ply}\n" for ply in plies), ""),
        ("PCOMP,1\n" + "".join(f",2,{thick},{angle - 20.0},NO\n" for angle in angles), ",20."),
        ("PCOMP,1\n" + "".join(f",{ply}\n" for ply in plies), ",9"),
        ("PCOMPG,1\n" + "".join(f",{k},{ply}\n" for k, ply in enumerate(plies, 1)), ""),
    ):
        (tmp_path / "body.bdf").write_text(bulk_data(middle, shell=f"{card}{MAT8}\n{system}", own=own))
        found = flexfmu.read_mesh(tmp_path / "body.bdf")
        np.testing.assert_allclose(found.points, deck.points, atol=1e-5)
        # What keeps the thickness is no constant of these materials.
        np.testing.assert_allclose(
            solved(replace(found, fixed=held), forces), expected, atol=2e-4 * abs(expected).max()
        )
        assert found.materials[0].density == pytest.approx(1600.0)
    name = card[: card.index(",")]
    assert found.element_sets[f"{name} 1"].size == len(middle.cells)
    mirrored = f"PCOMP,1,,7.8,,,,,SYM\n,2,{thick},30.,NO\n,2,{thick},60.,NO\n{MAT8}"
    (tmp_path / "body.bdf").write_text(bulk_data(middle, shell=mirrored))
    material = flexfmu.read_mesh(tmp_path / "body.bdf").materials[0]
    np.testing.assert_allclose(np.degrees([one.angle for one in material.layers]), [30.0, 60.0, 60.0, 30.0])
    assert material.density == pytest.approx(1600.0 + 7.8 / (4.0 * thick))


@pytest.mark.parametrize(
    ("shell", "message"),
    [
        ("PCOMP,1,,,,,,,SMEAR\n,2,0.001,30.,NO\n" + MAT8, "LAM = SMEAR, expected none or SYM"),
        ("PCOMP,1\n,2,0.001,30.,NO\nMAT9,2,1.,,,,,,1.", r"MAT9 2 \(line \d+\) is the material"),
        ("PCOMP,1\n,2,0.001,30.,NO\nMAT8,2,1.,1.,1.5,1.,1.,1.,1.", "belong to no material"),
    ],
)
def test_layers_of_bulk_data_that_are_no_laminate_are_refused(tmp_path, shell, message):
    pytest.importorskip("pyNastran")
    (tmp_path / "body.bdf").write_text(bulk_data(Middle("strip"), shell=shell))
    with pytest.raises(MeshError, match=message):
        flexfmu.read_mesh(tmp_path / "body.bdf")


def test_a_plate_of_one_directed_material_is_one_layer_of_it(tmp_path):
    pytest.importorskip("pyNastran")
    found = []
    for card in ("PSHELL,1,2,0.005,2,,2", "PCOMP,1\n,2,0.005,0.,NO"):
        (tmp_path / "body.bdf").write_text(bulk_data(Middle("strip"), shell=f"{card}\n{MAT8}", own=",30."))
        found.append(flexfmu.read_mesh(tmp_path / "body.bdf"))
    assert difference(*found) < 1e-12
