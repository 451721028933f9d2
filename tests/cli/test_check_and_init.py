"""`flexfmu check` tells what a mesh offers; `flexfmu init` writes a body file that builds."""

import tomllib
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from decks import BODY, COUPLING
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.suggest import bores, likely_mesh, starting_body_file
from flexfmu.commands.cli import app
from flexfmu.files.basics import AccuracyError, BodyFileError, UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from flexfmu.reduction.options import Place, node_set
from meshes import body_file, box, grid, lattice, write_deck
from scene_tools import Listening


@pytest.fixture
def bar(tmp_path):
    """A bar without sets, materials or supports; two elements across."""
    mesh = box(ElementType.C3D20R, (2, 2, 1), (0.5, 0.05, 0.02))
    path = write_deck(mesh, tmp_path / "bar.inp", materials=False)
    path.write_text(path.read_text().split("*NSET")[0])
    return path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_init_writes_a_body_file_of_a_bare_mesh_that_is_held_and_loaded_at_its_ends(bar):
    assert run("init", bar).exit_code == 0
    config = read_body_file(bar.with_suffix(".toml"))
    body = reduce_body(config, Reporter())
    assert body.properties.mass == pytest.approx(7850.0 * 0.5 * 0.05 * 0.02)
    assert body.interface_point[0] == pytest.approx([0.5, 0.025, 0.01])
    again = run("init", bar)
    assert again.exit_code == 1
    assert "is there already" in again.output


@pytest.mark.slow
@pytest.mark.parametrize(("size", "units", "modulus"), [(120.0, "mm-t-s", 2.1e5), (0.5, "m-kg-s", 2.1e11)])
def test_init_guesses_units_by_the_size_and_avoids_words_of_c(tmp_path, size, units, modulus):
    path = tmp_path / "double.inp"
    write_deck(box(ElementType.C3D10, (4, 2, 2), (size, size / 5.0, size / 5.0)), path, materials=False)
    assert run("init", path).exit_code == 0
    config = read_body_file(tmp_path / "double.toml")
    assert config.name == "body_double"
    assert config.mesh.units.value == units
    assert f"youngs_modulus = {modulus:.6g}" in (tmp_path / "double.toml").read_text()
    assert run("build", tmp_path / "double.toml", "-o", tmp_path / "out.fmu").exit_code == 0


def test_init_guesses_units_by_materials_that_the_mesh_tells(tmp_path):
    """Half a metre is as likely as half a millimetre is not; steel of 7.85e-9 is steel in t and mm alone."""
    path = tmp_path / "part.inp"
    write_deck(box(ElementType.C3D10, (4, 2, 2), (9.0, 2.0, 2.0)), path)
    tables = path.read_text().split("*ELASTIC")
    tables[1] = "\n210000, 0.3\n*DENSITY\n7.85e-9\n*SOLID" + tables[1].split("*SOLID")[1]
    path.write_text("*ELASTIC".join(tables))
    assert run("init", path).exit_code == 0
    assert read_body_file(tmp_path / "part.toml").mesh.units.value == "mm-t-s"


def test_check_lists_sets_materials_ends_and_what_a_body_file_chooses(bar):
    assert run("init", bar).exit_code == 0
    text = run("check", bar.with_suffix(".toml")).output
    for words in (
        "4 C3D20R",
        "no material",
        "plane end x_min: 13 nodes",
        "support 1: 13 nodes",
        "interface x_max: 13 nodes",
        "volume 0.0005 m³",
        "mass 3.925 kg",
        "centre of mass (0.25, 0.025, 0.01) m",
    ):
        assert words in text


def test_check_weighs_masses_at_points(bar):
    assert run("init", bar).exit_code == 0
    rows = (line.split(",") for line in bar.read_text().splitlines() if line.count(",") == 3 and line[0].isdigit())
    node = next(int(row[0]) for row in rows if [float(x) for x in row[1:]] == [0.5, 0.0, 0.0])
    with bar.open("a") as deck:
        deck.write(f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {node}\n*MASS, ELSET=LUMP\n3.925\n")
    text = run("check", bar.with_suffix(".toml")).output
    assert "mass 7.85 kg, 3.925 kg of it at points" in text
    assert "centre of mass (0.375, 0.0125, 0.005) m" in text


def test_reference_points_of_a_deck_are_offered(tmp_path):
    deck = tmp_path / "deck.inp"
    deck.write_text(BODY + COUPLING)
    assert "node set Flange: 4 nodes, reference point (2, 0.5, 0.5) m" in run("check", deck).output
    assert run("init", deck).exit_code == 0
    assert 'nodes = "Flange"' in deck.with_suffix(".toml").read_text()


def lug(kind, counts=(16, 2, 2), turn=0.0):
    """A plate of 60 × 60 × 10 mm with a bore of 12 mm radius in the middle, turned about x."""

    def place(p):
        angle, out, up = -2.0 * np.pi * p[:, 0] / counts[0], p[:, 1] / counts[1], p[:, 2] / counts[2]
        ray = np.column_stack([np.cos(angle), np.sin(angle)])
        inner, outer = 0.012 * ray, 0.03 * ray / np.abs(ray).max(axis=1, keepdims=True)
        flat = inner + out[:, None] * (outer - inner)
        c, s = np.cos(turn), np.sin(turn)
        z = 0.01 * up
        return np.column_stack([flat[:, 0], c * flat[:, 1] - s * z, s * flat[:, 1] + c * z])

    mesh = lattice(kind, grid(*counts), place)
    # The ends of the ring are one.
    _, first, row = np.unique(mesh.points.round(9), axis=0, return_index=True, return_inverse=True)
    row = row.ravel()
    blocks = tuple(replace(block, connectivity=row[block.connectivity]) for block in mesh.blocks)
    return replace(mesh, points=mesh.points[first], labels=1 + np.arange(len(first)), blocks=blocks,
                   fixed=mesh.fixed[first], node_sets={})  # fmt: skip


def twice(mesh, way, turn=None):
    """The mesh and itself moved by `way`, nodes at one place joined; all of it turned."""
    points = np.concatenate([mesh.points, mesh.points + way])
    _, first, row = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    (block,) = mesh.blocks
    rows = np.concatenate([block.connectivity, len(mesh.points) + block.connectivity])
    labels, material = 1 + np.arange(len(rows)), np.concatenate([block.material] * 2)
    block = replace(block, labels=labels, material=material, connectivity=row.ravel()[rows])
    points, fixed = points[first] @ (np.eye(3) if turn is None else turn), np.concatenate([mesh.fixed] * 2)[first]
    return replace(mesh, points=points, labels=1 + np.arange(len(first)), fixed=fixed, blocks=(block,), node_sets={})


@pytest.mark.parametrize("kind", [ElementType.C3D8, ElementType.C3D20R, ElementType.C3D10])
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_a_bore_is_found_with_its_axis_and_radius(kind, turn):
    mesh = lug(kind, turn=turn)
    ((name, place),) = bores(mesh).items()
    assert name == "bore_1"
    assert place.radius == pytest.approx(0.012)
    axis = np.array([0.0, -np.sin(turn), np.cos(turn)])
    ends = np.array(place.cylinder) @ axis
    assert sorted(ends.tolist()) == pytest.approx([0.0, 0.01], abs=1e-8)
    np.testing.assert_allclose(np.cross(np.array(place.cylinder), axis), 0.0, atol=1e-8)
    away = np.linalg.norm(np.cross(mesh.points, axis), axis=1)
    assert node_set(mesh, place, "bore").tolist() == np.flatnonzero(away < 0.01201).tolist()


@pytest.mark.parametrize("seed", range(5))
def test_a_bore_is_found_where_faces_of_tetrahedra_lie_askew(seed):
    """Nodes within the bore slide along it, so that its triangles have normals along the axis, too."""
    mesh, random = lug(ElementType.C3D10), np.random.default_rng(seed)
    away, height = np.hypot(mesh.points[:, 0], mesh.points[:, 1]), mesh.points[:, 2]
    inside = (abs(away - 0.012) < 1e-6) & (height > 1e-6) & (height < 0.01 - 1e-6)
    assert inside.sum() > 20
    points = mesh.points.copy()
    slide = random.uniform(-0.25, 0.25, (int(inside.sum()), 2))
    turn = np.exp(0.4 * 1j * slide[:, 0]) * (points[inside, 0] + 1j * points[inside, 1])
    points[inside] = np.column_stack([turn.real, turn.imag, points[inside, 2] + 0.01 * slide[:, 1]])
    (place,) = bores(replace(mesh, points=points)).values()
    assert place.radius == pytest.approx(0.012, rel=1e-6)
    np.testing.assert_allclose(np.sort(np.array(place.cylinder), axis=0), [[0, 0, 0], [0, 0, 0.01]], atol=1e-7)


def test_a_shaft_and_a_box_have_no_bore():
    assert bores(box(ElementType.C3D8, (4, 2, 2), (1.0, 0.2, 0.2))) == {}
    ring = lug(ElementType.C3D8)
    # Inside out: what was the bore is the outer face of a round bar.
    away = np.linalg.norm(ring.points[:, :2], axis=1)
    turned = ring.points.copy()
    turned[:, :2] *= (0.012**2 / away**2)[:, None]
    turned[:, 2] *= -1.0
    found = bores(replace(ring, points=turned))
    assert all(place.radius < 0.0119 for place in found.values())


@pytest.mark.slow
def test_init_holds_a_body_without_plane_ends_where_its_longest_side_begins(tmp_path):
    mesh = box(ElementType.C3D10, (8, 2, 2), (0.4, 0.1, 0.1))
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    leaning = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
    mesh = replace(mesh, points=mesh.points @ (leaning @ turn).T)
    path = write_deck(replace(mesh, node_sets={}), tmp_path / "bar.inp", materials=False)
    assert run("init", path).exit_code == 0
    body = reduce_body(read_body_file(path.with_suffix(".toml")), Reporter())
    assert body.interface_names == ("x_max",)
    assert run("init", write_deck(mesh, tmp_path / "named.inp", materials=False)).exit_code == 0
    config = read_body_file(tmp_path / "named.toml")
    assert (config.support[0].nodes, config.interface[0].nodes) == ("ROOT", "TIP")
    assert body.interface_point[0, 0] > 0.9 * (mesh.points @ turn.T)[:, 0].max()


def test_init_holds_one_bore_of_a_link_without_plane_ends_and_loads_the_other(tmp_path):
    turn = Rotation.from_euler("xyz", [0.3, 0.4, 0.5]).as_matrix().T
    both = twice(lug(ElementType.C3D10), np.array([0.06, 0.0, 0.0]), turn)
    assert run("init", write_deck(both, tmp_path / "link.inp", materials=False)).exit_code == 0
    config = read_body_file(tmp_path / "link.toml")
    assert [table.name for table in config.interface] == ["bore_2"]
    assert config.support[0].nodes.radius == pytest.approx(0.012, rel=1e-6)


def test_init_finds_the_eyes_of_the_wishbone_and_holds_one_of_them():
    """An end of the box is the end of an eye only: the eye's bore is held, not its rim."""
    folder = Path(__file__).parents[2] / "demo/wishbone"
    mesh, units, _ = likely_mesh(folder / "wishbone.msh")
    written = tomllib.loads(starting_body_file(checked(mesh), folder / "wishbone.msh", units))
    body = tomllib.loads((folder / "body.toml").read_text(encoding="utf-8"))
    assert (len(written["support"]), len(written["interface"])) == (1, 2)
    eyes = [table["nodes"] for table in (*written["support"], *written["interface"])]
    for table in (*body["support"], *body["interface"]):
        assert any(same_eye(table["nodes"], eye) for eye in eyes)


def same_eye(one, other):
    ends = np.array(one["cylinder"]), np.array(other["cylinder"])
    return one["radius"] == pytest.approx(other["radius"]) and np.allclose(*ends, atol=1e-7)


@pytest.mark.slow
def test_init_offers_bores_as_interfaces(tmp_path):
    path = write_deck(lug(ElementType.C3D8), tmp_path / "lug.inp", materials=False)
    assert "bore_1: 48 nodes, radius 0.012 m" in run("check", path).output
    assert run("init", path).exit_code == 0
    config = read_body_file(path.with_suffix(".toml"))
    assert config.interface[0].name == "bore_1"
    assert reduce_body(config, Reporter()).interface_point[0] == pytest.approx([0.0, 0.0, 0.005], abs=1e-9)


@pytest.mark.parametrize("count", [1, 3])
def test_of_single_elements_of_reduced_integration_init_writes_what_build_accepts(tmp_path, count):
    path = write_deck(box(ElementType.C3D20R, (count, 1, 1), (3.0, 0.3, 0.4)), tmp_path / "bar.inp")
    assert run("init", path).exit_code == 0
    config, listening = read_body_file(path.with_suffix(".toml")), Listening()
    more = config.model_copy(update={"reduction": config.reduction.model_copy(update={"modes": 12})})
    first = [reduce_body(each, listening).angular_frequency[0] / (2.0 * np.pi) for each in (config, more)]
    assert sum(f"{count} C3D20R with two pairs of opposite faces free" in note for note in listening.notes) == 2
    # Euler and Bernoulli: 1.875² / 2π √(EI/ρA) / L²; few elements are stiff.
    np.testing.assert_allclose(first, 27.2, rtol=0.3 if count == 1 else 0.06)


def test_init_holds_what_the_first_step_of_a_deck_holds(tmp_path):
    mesh = box(ElementType.C3D20R, (3, 1, 1), (3.0, 0.3, 0.4))
    path = write_deck(mesh, tmp_path / "bar.inp")
    corners = "".join(f"{mesh.labels[row]}, 2, 3\n" for row in np.flatnonzero(mesh.points[:, 0] == 0.0))
    with path.open("a") as deck:
        deck.write(f"*STEP\n*STATIC\n*END STEP\n*STEP\n*STATIC\n*BOUNDARY\n{corners}TIP, 1, 3\n*END STEP\n")
    assert run("init", path).exit_code == 0
    written = tomllib.loads(path.with_suffix(".toml").read_text())
    held = [(each["nodes"], each["fix"]) for each in written["support"]]
    assert held == [("STEP 2", ["x", "y", "z"]), ("STEP 2 yz", ["y", "z"])]
    assert all("STEP" not in str(each["nodes"]) for each in written["interface"])
    config = read_body_file(path.with_suffix(".toml"))
    assert reduce_body(config, Listening()).angular_frequency[0] > 0.0


@pytest.mark.slow
def test_more_modes_than_those_with_mass_are_refused(tmp_path):
    """Eight points of an element hold its mass, so that 216 of 270 motions have any: as many frequencies are found."""
    mesh = box(ElementType.C3D20R, (3, 2, 2), (3.0, 0.3, 0.4))

    def reduced(modes):
        return reduce_body(body_file(mesh, tmp_path, interface=["TIP"], reduction={"modes": modes}), Reporter())

    with pytest.raises(AccuracyError, match=r"221 modes are wanted, and 216 have mass.*ask for fewer modes"):
        reduced(220)
    few, many = (reduced(modes).angular_frequency[:60] for modes in (60, 200))
    assert few == pytest.approx(many, rel=1e-9)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ({"box": [[0.0, 0.0, 0.0], [0.25, 0.05, 0.0]]}, lambda p: (p[:, 0] < 0.2501) & (p[:, 2] < 1e-9)),
        ({"box": [[0.25, 0.05, 0.0], [0.0, 0.0, 0.0]]}, lambda p: (p[:, 0] < 0.2501) & (p[:, 2] < 1e-9)),
        ({"plane": [0.5, 0.0, 0.0], "normal": [2.0, 0.0, 0.0]}, lambda p: p[:, 0] > 0.4999),
        (
            {"cylinder": [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]], "radius": 0.05},
            lambda p: np.abs(np.hypot(p[:, 1], p[:, 2]) - 0.05) < 5e-5,
        ),
        (
            {"patch": [0.25, 0.025, 0.02], "radius": 0.07},
            lambda p: np.linalg.norm(p - [0.25, 0.025, 0.02], axis=1) < 0.07005,
        ),
        ({"nearest": [0.51, 0.06, 0.03]}, lambda p: (p > [0.4999, 0.0499, 0.0199]).all(axis=1)),
        (
            {"nearest": [0.51, 0.06, 0.03], "plane": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]},
            lambda p: (np.abs(p - [0.0, 0.05, 0.02]) < 1e-9).all(axis=1),
        ),
        (
            {"plane": [0.49, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "tolerance": 0.011},
            lambda p: p[:, 0] > 0.4999,
        ),
    ],
)
def test_nodes_are_chosen_by_box_plane_cylinder_patch_and_nearest(place, expected):
    mesh = box(ElementType.C3D20R, (4, 1, 1), (0.5, 0.05, 0.02))
    rows = np.flatnonzero(expected(mesh.points))
    assert rows.size
    assert node_set(mesh, Place(**place), "nodes").tolist() == rows.tolist()


def test_a_patch_holds_nodes_of_the_surface_only():
    mesh = box(ElementType.C3D8, (4, 4, 4), (1.0, 1.0, 1.0))
    rows = node_set(mesh, Place(patch=[0.5, 0.5, 1.0], radius=0.3), "nodes")
    assert rows.size == 5
    assert np.all(mesh.points[rows, 2] == 1.0)


def test_a_place_without_nodes_says_how_far_the_body_is():
    mesh = box(ElementType.C3D8, (2, 2, 1), (0.5, 0.05, 0.02))
    with pytest.raises(BodyFileError, match=r"reaches from \(0, 0, 0\) to \(0.5, 0.05, 0.02\) m.*misses it by 0.1 m"):
        node_set(mesh, Place(plane=[0.6, 0.0, 0.0], normal=[1.0, 0.0, 0.0]), "tip")


def test_the_nearest_node_is_not_taken_from_another_place():
    """Millimetres where metres are meant took the body's farthest corner without a word."""
    mesh = box(ElementType.C3D8, (2, 2, 1), (0.5, 0.05, 0.02))
    with pytest.raises(
        BodyFileError, match=r"no node lies there.*its nearest node is 5.. m away; .* if they are in mm"
    ):
        node_set(mesh, Place(nearest=[500.0, 25.0, 20.0]), "tip")
    assert node_set(mesh, Place(nearest=[0.9, 0.05, 0.02]), "tip").size == 1


def test_units_that_are_none_are_answered_with_those_that_are(bar):
    with pytest.raises(BodyFileError, match=r"units are 'mm', expected one of 'm-kg-s', 'mm-t-s', 'in-lbf-s'"):
        read_mesh(bar, "mm")
    assert "expected one of 'm-kg-s'" in run("init", bar, "--units", "mm").output


def test_init_takes_nodes_that_a_file_names_twice_once():
    """As gmsh does of physical groups: the group's name, and the surface's."""
    mesh = box(ElementType.C3D20, (4, 1, 1), (0.4, 0.04, 0.04))
    again = {"Surface2": mesh.node_sets["TIP"][::-1], "Surface1": mesh.node_sets["ROOT"]}
    sets = {name: mesh.node_sets[name] for name in ("ROOT", "TIP")} | again
    written = tomllib.loads(starting_body_file(checked(replace(mesh, node_sets=sets)), Path("bar.inp"), UnitSystem.SI))
    assert [table["nodes"] for name in ("support", "interface") for table in written[name]] == ["ROOT", "TIP"]


def test_init_takes_beams_with_a_corner_for_one_body(tmp_path):
    """Beams of different directions share no points of their sections: a rigid link joins them."""
    (tmp_path / "frame.inp").write_text(
        "*NODE\n1, 0, 0, 0\n2, 0, 0, 1\n3, 1, 0, 1\n*ELEMENT, TYPE=B31, ELSET=ALL\n1, 1, 2\n2, 2, 3\n"
        "*MATERIAL, NAME=STEEL\n*ELASTIC\n2e11, 0.3\n*DENSITY\n7850\n"
        "*BEAM SECTION, ELSET=ALL, MATERIAL=STEEL, SECTION=RECT\n0.03, 0.04\n0, 1, 0\n",
        encoding="utf-8",
    )
    mesh, units, _ = likely_mesh(tmp_path / "frame.inp")
    written = tomllib.loads(starting_body_file(checked(mesh), tmp_path / "frame.inp", units))
    assert len(written["support"]) == len(written["interface"]) == 1


def test_init_holds_no_long_side_of_an_arch_of_beams(tmp_path):
    """All of an arch in one plane lies in the planes of its sides; its feet are aslant."""
    angle = np.linspace(-1.0, 1.0, 21)
    nodes = "".join(f"{i}, {np.sin(a):.9g}, 0, {np.cos(a):.9g}\n" for i, a in enumerate(angle, start=1))
    cells = "".join(f"{k}, {2 * k - 1}, {2 * k}, {2 * k + 1}\n" for k in range(1, 11))
    (tmp_path / "arch.inp").write_text(
        f"*NODE\n{nodes}*ELEMENT, TYPE=B32, ELSET=ALL\n{cells}*MATERIAL, NAME=STEEL\n*ELASTIC\n2e11, 0.3\n*DENSITY\n"
        "7850\n*BEAM SECTION, ELSET=ALL, MATERIAL=STEEL, SECTION=RECT\n0.02, 0.03\n0, 1, 0\n",
        encoding="utf-8",
    )
    assert run("init", tmp_path / "arch.inp").exit_code == 0
    written = tomllib.loads((tmp_path / "arch.toml").read_text(encoding="utf-8"))
    (low, high) = np.array(written["support"][0]["nodes"]["box"])[:, 0]
    assert low < -np.sin(1.0) < high < -0.8 * np.sin(1.0)
    assert [table["name"] for table in written["interface"]] == ["x_max"]


def test_init_takes_sets_whose_names_say_what_is_held(tmp_path):
    """Other sets on the surface are interfaces, but those of whole elements, of joints, and beside what is held."""
    mesh = box(ElementType.C3D8, (6, 2, 2), (0.6, 0.1, 0.1))
    x, y, z = mesh.points.T
    mesh = replace(mesh, node_sets={})
    path = write_deck(mesh, tmp_path / "part.inp")
    seam = (z == z.max()) & (y == 0.05) & (x > 0.15) & (x < 0.45)
    sets = {"LOAD": x == x.max(), "SIDE": (y == y.max()) & (x > 0.3), "ALL": x > -1.0, "Clamped end": x == 0.0,
            "BESIDE": (z == 0.0) & (x < 0.3), "SEAM": seam}  # fmt: skip
    with path.open("a") as deck:
        for name, chosen in sets.items():
            deck.write(f"*NSET, NSET={name}\n" + "".join(f"{label},\n" for label in mesh.labels[chosen]))
        first, *others = mesh.labels[sets["SEAM"]]
        for other in others:
            deck.write(f"*EQUATION\n2\n{other}, 1, 1., {first}, 1, -1.\n")
    assert run("init", path).exit_code == 0
    written = tomllib.loads(path.with_suffix(".toml").read_text(encoding="utf-8"))
    assert [table["nodes"].upper() for table in written["support"]] == ["CLAMPED END"]
    assert written["support"][0]["fix"] == ["x", "y", "z"]
    assert [table["nodes"] for table in written["interface"]] == ["LOAD", "SIDE"]
    path.with_suffix(".toml").unlink()
    path.write_text(path.read_text().replace("Clamped end", "END"))
    assert run("init", path).exit_code == 0
    assert "plane = [0.0, 0.0, 0.0]" in path.with_suffix(".toml").read_text(encoding="utf-8")


def test_no_length_that_is_told_is_round_off(tmp_path):
    """The plate about its bore has its centre at zero; a plane end beside zero is at zero."""
    told = run("check", write_deck(lug(ElementType.C3D10, turn=2.0 * np.pi), tmp_path / "lug.inp")).output
    assert "centre of mass (0, 0, 0.005) m" in told
    assert "e-1" not in told


def test_init_holds_and_loads_no_set_without_nodes():
    """SPC of grid points that no element has, as of springs' ends."""
    mesh = box(ElementType.C3D20R, (2, 2, 1), (0.5, 0.05, 0.02))
    none, point = np.zeros(0, dtype=np.int64), np.zeros(3)
    mesh = replace(mesh, node_sets={"SPC 1": none, "RBE2 7": none}, references={"RBE2 7": point})
    found = tomllib.loads(starting_body_file(checked(mesh), Path("bar.bdf"), UnitSystem.SI))
    assert [table["nodes"] for table in found["support"]] == [{"plane": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}]
    assert [table["name"] for table in found["interface"]] == ["x_max"]


def test_init_refuses_a_mesh_in_parts_and_says_how_many(tmp_path):
    """Build would hold one of them alone."""
    apart = twice(lug(ElementType.C3D10), np.array([0.2, 0.0, 0.0]))
    found = run("init", write_deck(apart, tmp_path / "two.inp", materials=False))
    assert found.exit_code == 1
    assert "in 2 parts that share no nodes (of 800, 800 nodes)" in " ".join(found.output.split())
    assert not (tmp_path / "two.toml").exists()


def test_bores_that_the_held_end_cuts_are_held_with_it(tmp_path):
    """A tube on end: its bore begins in the foot."""
    flat = lug(ElementType.C3D10)
    path = write_deck(replace(flat, points=flat.points * [1.0, 1.0, 8.0]), tmp_path / "foot.inp", materials=False)
    assert run("init", path).exit_code == 0
    config = read_body_file(tmp_path / "foot.toml")
    assert config.support[0].nodes.normal == [0.0, 0.0, 1.0]
    assert [table.name for table in config.interface] == ["z_max"]


def test_an_open_ring_is_no_bore_and_a_slotted_eye_is():
    """A third of the ring gone; and 20° of it."""
    ring = lug(ElementType.C3D10, counts=(36, 1, 1))
    (block,) = ring.blocks
    middle = ring.points[block.connectivity].mean(axis=1)
    angle = np.abs(np.arctan2(middle[:, 1], middle[:, 0]))
    for half, count in ((60.0, 0), (10.0, 1)):
        kept = angle > np.radians(half)
        assert len(bores(replace(ring, blocks=(block.part(kept),)))) == count


@pytest.mark.parametrize("suffix", ["vtk", "msh", "med", "xdmf"])
@pytest.mark.parametrize("size", [0.4, 400.0])
def test_init_takes_a_sheet_without_thickness_for_a_shell_of_a_hundredth_of_its_size(tmp_path, suffix, size):
    x, y = np.meshgrid(np.linspace(0.0, size, 9), np.linspace(0.0, 0.25 * size, 3))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (9 * np.arange(2)[:, None] + np.arange(8)).ravel()
    cells = np.stack([corner, corner + 1, corner + 10, corner + 9], axis=1)
    path = tmp_path / f"sheet.{suffix}"
    how = {"file_format": "gmsh22", "binary": False} if suffix == "msh" else {}
    meshio.write_points_cells(path, points, [("quad", cells)], **how)
    said = run("init", path, *(["--units", "mm-t-s"] if size > 1.0 and suffix == "msh" else []))
    assert said.exit_code == 0, said.output
    config = read_body_file(tmp_path / "sheet.toml")
    assert config.shell[0].thickness == pytest.approx(0.01 * size)
    assert config.mesh.units is (UnitSystem.MM_T_S if size > 1.0 else UnitSystem.SI)
    report = Listening()
    body = reduce_body(config, report)
    assert body.properties.mass == pytest.approx(7850.0 * 0.4 * 0.1 * 0.004)
    assert body.interface_point[0, 0] == pytest.approx(0.4)


def test_init_of_a_file_without_any_cells_tells_what_it_found(tmp_path):
    meshio.write_points_cells(tmp_path / "line.vtk", np.eye(3), [("line", np.array([[0, 1], [1, 2]]))])
    said = run("init", tmp_path / "line.vtk")
    assert said.exit_code == 1
    assert "holds no volume cells (found: line)" in " ".join(said.output.split())


def test_init_tells_what_is_wrong_in_the_units_that_a_density_may_have(tmp_path):
    """In kg, m and s steel of mm and t is lighter than air: what hinders in any units was hidden by that."""
    path = write_deck(box(ElementType.C3D8, (4, 1, 1), (400.0, 40.0, 40.0)), tmp_path / "bar.inp")
    text = path.read_text().replace("7850.0", "7.85e-9") + "*NSET, NSET=WRONG\n123456\n"
    path.write_text(text)
    said = " ".join(run("init", path).output.split())
    assert "node 123456 is not defined" in said
    assert "density" not in said
    path.write_text(text.replace("123456", "1").replace("7.85e-9", "7.85e30"))
    assert "expected 0.0001 to 100000" in " ".join(run("init", path).output.split())


def test_nodes_that_miss_a_bore_s_cylinder_by_more_than_places_may_are_within_its_tolerance():
    """As those of shells along straight sides do."""
    mesh = lug(ElementType.C3D8)
    radius = np.linalg.norm(mesh.points[:, :2], axis=1)
    inner = np.flatnonzero(np.isclose(radius, 0.012))
    off = replace(mesh, points=mesh.points.copy())
    off.points[inner, :2] *= np.where(np.arange(inner.size) % 2, 1.004, 0.996)[:, None]
    for one, wide in ((mesh, False), (off, True)):
        (place,) = bores(one).values()
        assert (place.tolerance is not None) == wide
        assert node_set(one, place, "bore").tolist() == inner.tolist()
        written = tomllib.loads(starting_body_file(checked(one), Path("lug.inp"), UnitSystem.SI))
        every = [table["nodes"] for name in ("support", "interface") for table in written[name]]
        assert any("tolerance" in nodes for nodes in every) == wide


def test_a_deck_of_plane_elements_is_refused_by_their_name(tmp_path):
    (tmp_path / "plane.inp").write_text("*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n*ELEMENT, TYPE=CPS3, ELSET=E\n1, 1, 2, 3\n")
    assert "outside its steps (found: CPS3)" in " ".join(run("init", tmp_path / "plane.inp").output.split())
