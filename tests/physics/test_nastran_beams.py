"""Beams and bars of bulk data: closed forms, offsets, trusses, hinges on solids, refusals; decks likewise."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse.linalg as spla

import flexfmu
from decks import read
from flexfmu.build.suggest import starting_body_file
from flexfmu.fe.assembly import stiffness
from flexfmu.files.basics import DeckError, MeshError, UnitSystem
from flexfmu.mesh.beams import CrossSection, channel, hat, i_section, l_section, walls, z_section
from flexfmu.mesh.checks import checked
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.options import BodyOptions

pynastran = pytest.importorskip("pyNastran.bdf.cards.properties.bars")
E, G, RHO = 2.1e11, 2.1e11 / 2.6, 7850.0
CHAIN = np.column_stack([np.linspace(0.0, 1.0, 5), np.zeros((5, 2))])
DIMENSIONS = {
    "ROD": (0.01,),
    "TUBE": (0.01, 0.008),
    "TUBE2": (0.01, 0.002),
    "BAR": (0.01, 0.02),
    "BOX": (0.05, 0.1, 0.005, 0.004),
    "I": (0.1, 0.06, 0.04, 0.005, 0.006, 0.007),
    "I1": (0.05, 0.005, 0.09, 0.1),
    "H": (0.08, 0.01, 0.1, 0.006),
    "T": (0.06, 0.1, 0.006, 0.005),
    "T2": (0.06, 0.1, 0.006, 0.005),
    "L": (0.05, 0.1, 0.005, 0.006),
    "CHAN": (0.05, 0.1, 0.005, 0.006),
    "T1": (0.1, 0.06, 0.005, 0.006),
    "Z": (0.04, 0.005, 0.088, 0.1),
    "HAT": (0.05, 0.001, 0.06, 0.03),
    "CHAN1": (0.045, 0.005, 0.088, 0.1),
}


def bulk(tmp_path, cards, points=CHAIN, **units):
    """The mesh of grid points and cards; SPC 1 is held, SET 1 loaded."""
    text = "BEGIN BULK\n" + "".join(f"GRID,{k},,{x},{y},{z}\n" for k, (x, y, z) in enumerate(points.tolist(), 1))
    (tmp_path / "body.bdf").write_text(f"{text}MAT1,1,{E},,0.3,{RHO}\n{cards}ENDDATA\n")
    return flexfmu.read_mesh(tmp_path / "body.bdf", **units)


def chain(cards, kind="CBAR", end=",0.,1.,0."):
    """Four elements along the points, held at the first."""
    return "".join(f"{kind},{k},1,{k},{k + 1}{end}\n" for k in range(1, 5)) + f"{cards}SPC1,1,123456,1\nSET1,1,5\n"


def moved(mesh, force, root="SPC 1", tip="SET 1"):
    """Displacement and turn of the tip's node under a force there."""
    held = mesh.fixed.copy()
    held[mesh.node_sets[root]] = True
    nodes = mesh.node_sets[tip]
    model = assemble_model(replace(mesh, fixed=held), BodyOptions("beam", ()))
    place = mesh.references.get(tip, mesh.points[nodes].mean(axis=0))
    arm = mesh.points[nodes] - mesh.points[nodes].mean(axis=0)
    inertia = np.eye(3) * np.sum(arm**2) - arm.T @ arm
    away = place - mesh.points[nodes].mean(axis=0)
    forces = np.zeros_like(mesh.points)
    forces[nodes] = np.array(force) / nodes.size + np.cross(np.linalg.solve(inertia, np.cross(away, force)), arm)
    matrix = model.unknowns.matrix(stiffness(model.mesh)).tocsc()
    found = model.unknowns.whole(spla.spsolve(matrix, model.unknowns.forces(forces.ravel()))).reshape(-1, 3)[nodes]
    turn = np.linalg.solve(inertia, np.cross(arm, found - found.mean(axis=0)).sum(axis=0))
    return found.mean(axis=0) + np.cross(turn, away), turn


def bent(section, force):
    """Deflection of a cantilever of unit length across it, shear left out."""
    _, first, second, *_ = section.constants
    return np.linalg.solve([[first, section.mixed], [section.mixed, second]], force) / (3.0 * E)


@pytest.mark.parametrize("shape", DIMENSIONS)
def test_shapes_have_the_area_that_another_reader_finds(tmp_path, shape):
    numbers = ",".join(map(str, DIMENSIONS[shape]))
    mesh = bulk(tmp_path, chain(f"PBARL,1,1,,{shape}\n,{numbers}\n"))
    card = pynastran.PBARL(1, 1, shape, list(DIMENSIONS[shape]))
    assert mesh.volumes.sum() == pytest.approx(card.Area(), rel=1e-9)
    (block,) = mesh.blocks
    assert (np.ptp(block.section, axis=0) == 0.0).all()
    assert not block.section[:, 6:].any()


@pytest.mark.parametrize(
    ("shape", "section"),
    [
        ("CHAN", channel(0.05, 0.1, 0.005, 0.006).transposed),
        ("L", l_section(0.05, 0.1, 0.005, 0.006).transposed),
        ("I", i_section(0.1, (0.06, 0.04), (0.006, 0.007), 0.005).transposed),
    ],
)
def test_a_force_at_the_shear_centre_bends_and_does_not_twist(tmp_path, shape, section):
    numbers = ",".join(map(str, DIMENSIONS[shape]))
    mesh = bulk(tmp_path, chain(f"PBEAML,1,1,,{shape}\n,{numbers}\n", "CBEAM"))
    found, turn = moved(mesh, (0.0, 1000.0, 0.0))
    sheared = np.array([1000.0 / (G * section.constants[4]), 0.0])
    np.testing.assert_allclose(found[1:], bent(section, (1000.0, 0.0)) + sheared, rtol=4e-3, atol=1e-9)
    assert abs(turn[0]) < 1e-7
    # Off the centroid, a pull bends.
    along, _ = moved(mesh, (1000.0, 0.0, 0.0))
    aside = np.subtract(section.centroid, section.shear_centre)
    by_moment = 1.5 * bent(section, 1000.0 * aside)
    np.testing.assert_allclose(np.abs(along[1:]), np.abs(by_moment), atol=1e-9)
    expected = 1000.0 / (E * section.constants[0]) + 2.0 * by_moment @ aside
    assert along[0] == pytest.approx(expected, rel=1e-6)


def test_products_of_inertia_bend_aside(tmp_path):
    section = CrossSection((1e-3, 2e-6, 1e-6, 1e-7, np.inf, np.inf), 0.5e-6)
    mesh = bulk(tmp_path, chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n,\n,,,.5e-6\n"))
    found, _ = moved(mesh, (0.0, 1000.0, 0.0))
    np.testing.assert_allclose(found[1:], bent(section, (1000.0, 0.0)), rtol=1e-6)
    # Of a deck, where I11 is about the first axis.
    text = "*NODE\n" + "".join(f"{k}, {x}, 0, 0\n" for k, x in enumerate(CHAIN[:, 0], 1))
    text += "*NSET, NSET=ROOT\n1\n*NSET, NSET=TIP\n5\n*ELEMENT, TYPE=B31, ELSET=B\n"
    text += "".join(f"{k}, {k}, {k + 1}\n" for k in range(1, 5))
    text += f"*BEAM GENERAL SECTION, ELSET=B, DENSITY={RHO}\n1e-3, 1e-6, .5e-6, 2e-6, 1e-7\n0, 1, 0\n{E}, {G}\n"
    also, _ = moved(read(tmp_path, text), (0.0, 1000.0, 0.0), "ROOT", "TIP")
    np.testing.assert_allclose(also[1:] - [1000.0 / (G * 1e-3), 0.0], found[1:], rtol=1e-6)


@pytest.mark.parametrize(
    ("shape", "numbers", "card"),
    [
        ("I", "0.05, 0.1, 0.06, 0.06, 0.006, 0.006, 0.005", "I1,0.055,0.005,0.088,0.1"),
        ("L", "0.05, 0.1, 0.005, 0.006", ""),
    ],
)
def test_open_sections_of_decks_are_those_of_bulk_data(tmp_path, shape, numbers, card):
    text = "*NODE\n" + "".join(f"{k}, {x}, 0, 0\n" for k, x in enumerate(CHAIN[:, 0], 1))
    text += "*NSET, NSET=ROOT\n1\n*NSET, NSET=TIP\n5\n*ELEMENT, TYPE=B31, ELSET=B\n"
    text += (
        "".join(f"{k}, {k}, {k + 1}\n" for k in range(1, 5)) + f"*MATERIAL, NAME=S\n*ELASTIC\n{E}, .3\n*DENSITY\n7850\n"
    )
    mesh = read(tmp_path, text + f"*BEAM SECTION, ELSET=B, MATERIAL=S, SECTION={shape}\n{numbers}\n0, 1, 0\n")
    found, turn = moved(mesh, (0.0, 300.0, 100.0), "ROOT", "TIP")
    # The deck's second axis is up in the pictures, and its first to the right: y is the other way round there.
    name, dimensions = ("I1", card[3:]) if card else ("L", numbers.replace(" ", ""))
    same = bulk(tmp_path, chain(f"PBEAML,1,1,,{name}\n,{dimensions}\n", "CBEAM", ",0.,0.,1."))
    mirrored, also = moved(same, (0.0, -300.0, 100.0))
    np.testing.assert_allclose(found, mirrored * [1.0, -1.0, 1.0], rtol=1e-6, atol=1e-12)
    assert max(abs(turn[0]), abs(also[0])) < 1e-7


def test_offsets_are_rigid_in_the_global_system_and_in_the_element_s(tmp_path):
    found = []
    for letters, away in (("GGG", "0.,0.1,0."), ("GOO", "0.,0.1,0."), ("BGG", "0.,0.1,0.")):
        end = f",0.,1.,0.,{letters}\n,,,{away},{away}"
        mesh = bulk(tmp_path, chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n", end=end))
        found.append(moved(mesh, (1000.0, 0.0, 1000.0))[0])
    expected = 1000.0 / (E * 1e-3) + 1000.0 * 0.01 / (E * 2e-6), 1000.0 / (3.0 * E * 1e-6) + 1000.0 * 0.01 / (G * 1e-7)
    np.testing.assert_allclose(np.array(found)[:, [0, 2]], [expected] * 3, rtol=1e-6)
    assert (found[0][1] > 0.0) == (found[1][1] > 0.0)


def test_offsets_and_sections_are_in_the_file_s_units(tmp_path):
    end = ",0.,1.,0.,GGG\n,,,0.,100.,0.,0.,100.,0."
    mesh = bulk(tmp_path, chain("PBARL,1,1,,BAR\n,10.,20.\n", end=end), 1e3 * CHAIN, units="mm-t-s")
    assert mesh.volumes.sum() == pytest.approx(2e-4)
    assert mesh.points[:, 1].max() == pytest.approx(0.11)


@pytest.mark.parametrize(("held", "share"), [("123", 48.0), ("123456", 192.0)])
def test_nodes_whose_turns_no_card_holds_are_hinges(tmp_path, held, share):
    cards = chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n").replace("SPC1,1,123456,1\nSET1,1,5", "SET1,1,3")
    # Nothing else keeps a bar on two hinges from turning about itself.
    mesh = bulk(tmp_path, f"{cards}SPC1,1,{held},1,5\nSPC1,2,456,4\n")
    held = {"SPC 1": "xyz", "SPC 2": "z"}
    supports = [flexfmu.Support(name, fix=list(axes)) for name, axes in held.items()]
    body = flexfmu.Body(mesh, interfaces={"pin": flexfmu.Interface("SET 1")}, supports=supports[:1])
    if share == 48.0:
        with pytest.raises(flexfmu.FlexfmuError, match=r"1 rigid motion \(turn about x through"):
            body.build(surface=False)
        body = flexfmu.Body(mesh, interfaces={"pin": flexfmu.Interface("SET 1")}, supports=supports)
    built = body.build(surface=False)
    found = built.response(built.static({"pin": [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]})).displacement[0]
    assert found[1] == pytest.approx(1.0 / (share * E * 2e-6), rel=1e-4)


TRIPOD = np.array([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0], [0.0, 0.0, 1.5]])


def tripod(force):
    """Displacement of the top of three bars of 1 cm²."""
    matrix = np.zeros((3, 3))
    for foot in TRIPOD[:3]:
        leg = TRIPOD[3] - foot
        matrix += E * 1e-4 * np.outer(leg, leg) / np.linalg.norm(leg) ** 3
    return np.linalg.solve(matrix, force)


def test_bars_are_hinged(tmp_path):
    cards = "CROD,1,1,1,4\nCROD,2,1,2,4\nPROD,1,1,1.e-4\nCONROD,3,3,4,1,1.e-4\nSPC1,1,123,1,2,3\nSET1,1,4\n"
    mesh = bulk(tmp_path, cards, TRIPOD)
    force = (100.0, 50.0, -200.0)
    np.testing.assert_allclose(moved(mesh, force)[0], tripod(force), rtol=5e-5)
    assert any("3 beams do not bend" in note for note in mesh.notes)
    assert mesh.volumes.sum() == pytest.approx(1e-4 * np.linalg.norm(TRIPOD[3] - TRIPOD[:3], axis=1).sum())
    text = "*NODE\n" + "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(TRIPOD.tolist(), 1))
    text += "*ELEMENT, TYPE=T3D2, ELSET=B\n1, 1, 4\n2, 2, 4\n3, 3, 4\n*SOLID SECTION, ELSET=B, MATERIAL=S\n1e-4,\n"
    text += f"*MATERIAL, NAME=S\n*ELASTIC\n{E}, .3\n*DENSITY\n7850\n*NSET, NSET=FEET\n1, 2, 3\n*NSET, NSET=TOP\n4\n"
    np.testing.assert_allclose(moved(read(tmp_path, text), force, "FEET", "TOP")[0], tripod(force), rtol=5e-5)


def test_a_bar_between_solids_does_not_spin(tmp_path):
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    points = 0.1 * np.concatenate([corners, corners + np.array([3.0, 0.0, 0.0])])
    cards = "CHEXA,1,2,1,2,3,4,5,6,\n,7,8\nCHEXA,2,2,9,10,11,12,13,14,\n,15,16\nPSOLID,2,1\n"
    cards += "".join(
        f"CONROD,{10 + k},{one},{other},1,1.e-4\n" for k, (one, other) in enumerate(((2, 9), (3, 12), (6, 13)))
    )
    mesh = bulk(tmp_path, cards + "SPC1,1,123,1,THRU,8\nSPC1,2,23,10,11,14,15\nSET1,1,9,12,13,16\n", points)
    free = np.zeros_like(mesh.fixed)
    free[mesh.node_sets["SPC 2"], 1:] = True
    found, _ = moved(replace(mesh, fixed=free), (3000.0, 0.0, 0.0))
    assert found[0] == pytest.approx(0.2 * 1000.0 / (E * 1e-4), rel=0.2)


def test_mass_beside_the_section_and_a_modulus_of_shear_count(tmp_path):
    plain = bulk(tmp_path, chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n"))
    heavy = bulk(tmp_path, chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7,2.15\n"))
    assert heavy.materials[0].density - plain.materials[0].density == pytest.approx(2150.0)
    stiff = bulk(tmp_path, chain("PBAR,1,2,1.e-3,2.e-6,1.e-6,1.e-7\n" + f"MAT1,2,{E},{2.0 * G},0.3,{RHO}\n"))
    assert stiff.blocks[0].section[0, 3] == pytest.approx(2e-7)
    assert stiff.element_sets["PBAR 1"].tolist() == [0, 1, 2, 3]


def test_shear_flow_of_a_hat_turns_about_its_shear_centre():
    """Shear flow of a force along the top, integrated along the middle line, has no moment there."""
    width, height, foot, wall = 0.06, 0.05, 0.03, 0.001
    side, end, low = 0.5 * (width - wall), 0.5 * width + foot, wall - height
    line = np.array([(-end, low), (-side, low), (-side, 0.0), (side, 0.0), (side, low), (end, low)])
    steps = np.repeat(np.diff(line, axis=0) / 1000, 1000, axis=0)
    places = line[0] + np.cumsum(steps, axis=0) - 0.5 * steps
    flow = -np.cumsum(places[:, 0] * np.linalg.norm(steps, axis=1))
    moment = flow @ (places[:, 0] * steps[:, 1] - places[:, 1] * steps[:, 0])
    section = hat(width, height, foot, wall)
    assert section.shear_centre[1] == pytest.approx(-moment / (flow @ steps[:, 0]), rel=1e-4)


def test_a_zed_falls_from_its_web_to_the_side_of_the_first_axis():
    found = z_section(0.04, 0.005, 0.006, 0.1)
    assert found.mixed == pytest.approx(-2.0 * 0.04 * 0.006 * 0.0225 * 0.047)


def test_a_torsion_constant_is_that_of_thin_walls():
    found = walls([(0.0, 0.0, 1.0, 0.1), (0.0, 1.0, 0.2, 2.0)], (0.0, 0.0))
    assert found.constants[3] == pytest.approx((0.001 + 2.0 * 0.008) / 3.0)


BAR = "PBAR,1,1,1.e-3,2.e-6,1.e-6,3.e-6\n"
TURNED = "CORD2R,7,,0.,0.,0.,0.,0.,1.,\n,0.6,0.8,0.\n"
# Cards at the tip of a cantilever, and what they add to its compliance's inverse there: stiffness (6, 6).
TURN = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
BUSH = np.array([1e5, 3e5, 2e5, 4e4, 1e4, 2e4])
SOFT = {
    "CELAS2": ("CELAS2,90,3.e5,5,2\n", np.diag([0.0, 3e5, 0.0, 0.0, 0.0, 0.0])),
    "CELAS1 of turns": ("CELAS1,90,8,5,6\nPELAS,8,2.e4\n", np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 2e4])),
    "CELAS2 to a held point": (
        "GRID,9,,1.,-1.,0.,,123\nCELAS2,90,3.e5,9,2,5,2\n",
        np.diag([0.0, 3e5, 0.0, 0.0, 0.0, 0.0]),
    ),
    "CBUSH": (
        f"CBUSH,90,8,5,,,,,7\nPBUSH,8,K,{','.join(map(str, BUSH))}\n" + TURNED,
        np.kron(np.eye(2), TURN).T @ np.diag(BUSH) @ np.kron(np.eye(2), TURN),
    ),
}


@pytest.mark.parametrize("name", SOFT)
def test_springs_at_the_tip_of_a_cantilever_add_their_stiffness(tmp_path, name):
    cards, stiff = SOFT[name]
    force, found = np.array([2e3, 3e3, -1e3]), []
    for more in ("", cards):
        mesh = bulk(tmp_path, chain(BAR + more))
        body = flexfmu.Body(mesh, supports=["SPC 1"], interfaces={"tip": flexfmu.Interface("SET 1", weights="node")})
        body = body.build(surface=False, frames=0, residual_flexibility=True)
        columns = []
        for load in np.eye(6) if not more else np.append(force, np.zeros(3))[None]:
            response = body.response(body.static({"tip": load}))
            columns.append(np.append(response.displacement[0], response.rotation[0]))
        found.append(np.array(columns).T)
    expected = np.linalg.solve(np.linalg.inv(found[0]) + stiff, np.append(force, np.zeros(3)))
    np.testing.assert_allclose(found[1][:, 0], expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def test_a_bush_between_two_points_pulls_along_its_line_and_damps(tmp_path):
    cards = "GRID,9,,1.,-1.,0.5,,123\nCBUSH,90,8,5,9,1.,0.,0.\nPBUSH,8,K,1.e5\n,,B,2.e3\nCDAMP2,91,40.,5,3\n"
    mesh = checked(bulk(tmp_path, chain(BAR + cards)))
    bush, damper = mesh.springs
    line = np.array([0.0, -1.0, 0.5]) / np.sqrt(1.25)
    np.testing.assert_allclose(bush.axes[0], line, atol=1e-12)
    assert bush.stiffness.tolist() == [1e5, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert bush.damping[0] == 2e3
    assert damper.damping.tolist() == [0.0, 0.0, 40.0, 0.0, 0.0, 0.0]
    held = replace(mesh, fixed=np.isin(np.arange(len(mesh.points)), mesh.node_sets["SPC 1"])[:, None].repeat(3, axis=1))
    rows = assemble_model(held, BodyOptions("beam", ())).bushings
    push = np.tile(np.eye(3), (len(mesh.points), 1))
    np.testing.assert_allclose((rows.rows @ push).T @ (rows.rows @ push), 1e5 * np.outer(line, line), atol=1e-6)


def test_a_section_whose_ends_differ_in_the_last_digits_of_the_file_does_not_change(tmp_path):
    row = ".25,.005{},.005{},,.0087949"
    ends = "PBEAM,1,1," + row.format(2083, 2083) + "\n,,,,,,,,\n,YES,1.," + row.format(208, 208) + "\n"
    assert bulk(tmp_path, chain(ends, "CBEAM")).blocks[0].section[0, 1] == pytest.approx(0.00520815)


REFUSED = {
    "pins": (chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n", end=",0.,1.,0.\n,45"), "pins PA = 45"),
    "taper": (
        chain("PBEAML,1,1,,BAR\n,0.01,0.02,0.,YES,1.,0.02,0.02\n", "CBEAM"),
        "changes along the beam",
    ),
    "shape": (chain("PBARL,1,1,,HEXA\n,0.01,0.02,.05\n"), "is a HEXA"),
    "gap": (chain("PBAR,1,1,1.,1.,1.,1.\nCGAP,90,2,1,5,0.,0.,1.\n"), "CGAP 90"),
    "spring from one direction to another": (chain("PBAR,1,1,1.,1.,1.,1.\nCELAS2,90,1.e5,5,1,1,2\n"), "CELAS2 90"),
    "spring to nothing": (chain("PBAR,1,1,1.,1.,1.,1.\nGRID,9,,9.,0.,0.\nCELAS2,90,1.e5,5,1,9,1\n"), "GRID 9"),
    "spring without property": (chain("PBAR,1,1,1.,1.,1.,1.\nCBUSH,90,7,5\n"), "property 7"),
    "spring over frequency": (
        chain("PBAR,1,1,1.,1.,1.,1.\nCBUSH,90,7,5\nPBUSH,7,K,1.\nPBUSHT,7,K,4\n"),
        "tables over frequency",
    ),
    "area": (chain("PROD,1,1,0.\n", "CROD", ""), "give it one"),
    "property": (chain("PROD,1,1,1.e-4\n"), "expected PBAR or PBARL"),
    "system": (
        "CORD2C,7,,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\nGRID,9,,2.,0.,0.,7\n"
        + chain("PBAR,1,1,1.,1.,1.,1.\n")
        + "CBAR,9,1,9,5,0.,1.,0.\n",
        "rectangular systems",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_supported_is_refused_with_words(tmp_path, name):
    cards, words = REFUSED[name]
    with pytest.raises(MeshError, match=re.escape(words)):
        bulk(tmp_path, cards)


def test_bars_of_another_type_are_refused(tmp_path):
    text = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT, TYPE=DC1D2, ELSET=B\n1, 1, 2\n"
    with pytest.raises(DeckError, match="T3D2"):
        read(tmp_path, text + "*SOLID SECTION, ELSET=B, MATERIAL=S\n1e-4\n*MATERIAL, NAME=S\n*ELASTIC\n1e9, .3\n")


@pytest.mark.parametrize(("fields", "told"), [("0.,0.,1e-3,0.,0.,1e-9", True), ("0.,0.,0.,0.,0.,0.", False)])
def test_warping_and_inertia_beside_a_section_are_told(tmp_path, fields, told):
    section = "PBEAM,1,1,1e-4,1e-9,1e-9,,2e-9,0.\n,0.,0.,0.,0.,0.,0.,0.,0.\n,1.,1.," + fields + "\n"
    notes = bulk(tmp_path, chain(section, "CBEAM")).notes
    assert any("PBEAM 1: warping" in note for note in notes) == told


@pytest.mark.parametrize(("held", "along"), [("123", 0.5), ("23", 1.0)])
def test_an_rbe2_of_translations_between_points_in_one_place_is_a_joint(tmp_path, held, along):
    """Two cantilevers that meet, pushed there: F L³ / 6 E I; along them E A / L each."""
    points = np.concatenate([CHAIN, CHAIN + np.array([1.0, 0.0, 0.0])])
    cards = (
        "".join(f"CBAR,{k},1,{k},{k + 1},0.,1.,0.\n" for k in (6, 7, 8, 9)) + f"RBE2,20,5,{held},6\nSPC1,1,123456,10\n"
    )
    mesh = bulk(tmp_path, chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n") + cards, points)
    assert not mesh.links or all("RBE2" not in one.name for one in mesh.links)
    across, _ = moved(mesh, (0.0, 1.0, 0.0))
    assert across[1] == pytest.approx(1.0 / (6.0 * E * 2e-6), rel=1e-5)
    pulled, _ = moved(mesh, (1.0, 0.0, 0.0))
    assert pulled[0] == pytest.approx(along / (E * 1e-3), rel=1e-5)


@pytest.mark.parametrize(("held", "all_of_it"), [("123456", True), ("123", False)])
def test_a_reference_held_in_all_directions_holds_the_nodes_of_its_rbe2(tmp_path, held, all_of_it):
    cards = chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n").replace(
        "SPC1,1,123456,1\n", f"RBE2,20,6,123456,1\nSPC1,1,{held},6\n"
    )
    mesh = bulk(tmp_path, cards, np.concatenate([CHAIN, [[-0.2, 0.0, 0.0]]]))
    assert (1 in mesh.labels[mesh.node_sets["SPC 1"]]) == all_of_it


def test_a_load_point_that_hangs_on_a_beam_s_end_by_an_rbe2_is_offered(tmp_path):
    """The card's dependent point is of no element: an arm of 0.2 beyond the end, FL³/3EI + FL²a/EI + FLa²/EI."""
    cards = chain("PBAR,1,1,1.e-3,2.e-6,1.e-6,1.e-7\n") + "RBE2,20,5,123456,6\n"
    mesh = bulk(tmp_path, cards, np.concatenate([CHAIN, [[1.2, 0.0, 0.0]]]))
    assert mesh.references["RBE2 20"].tolist() == [1.2, 0.0, 0.0]
    assert any("'RBE2 20', with its dependent node as point" in note for note in mesh.notes)
    assert '# SPC 1\nnodes = "SPC 1"' in starting_body_file(mesh, tmp_path / "body.bdf", UnitSystem.SI)
    # What another case holds of its point alone is no interface.
    both = mesh.node_sets | {"SPC 2": mesh.node_sets["RBE2 20"][:1]}, mesh.references | {"SPC 2": np.array([1.2, 0, 0])}
    other = starting_body_file(replace(mesh, node_sets=both[0], references=both[1]), tmp_path / "b.bdf", UnitSystem.SI)
    assert 'nodes = "RBE2 20"' in other
    assert 'nodes = "SPC 2"' not in other
    across, turned = moved(mesh, (0.0, 1.0, 0.0), tip="RBE2 20")
    assert across[1] == pytest.approx((1.0 / 3.0 + 0.2 + 0.04) / (E * 2e-6), rel=1e-4)
    assert turned[2] == pytest.approx(0.7 / (E * 2e-6), rel=1e-4)


PANEL = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 2.0], [0.0, 0.0, 2.0]])


def test_shear_panels_between_rods_carry_shear_alone(tmp_path):
    """Shear flow P/w over the panel; each node has half of what an edge gets, so rods beside it carry half of P L/w."""
    area, thick, long, wide = 1e-4, 2e-3, 2.0, 1.0
    rods = "".join(f"CONROD,{10 + k},{k},{k % 4 + 1},1,{area}\n" for k in range(1, 5))
    mesh = bulk(tmp_path, f"{rods}CSHEAR,1,7,1,2,3,4\nPSHEAR,7,1,{thick}\nSPC1,1,123456,1,2\nSET1,1,3,4\n", PANEL)
    found, _ = moved(mesh, (1.0, 0.0, 0.0))
    assert found[0] == pytest.approx(long / (G * thick * wide) + long**3 / (2.0 * wide**2 * E * area), rel=2e-5)
    assert mesh.volumes[:1] == pytest.approx(long * wide * thick)
    assert any("PSHEAR 7 only stretch or are sheared" in note for note in mesh.notes)
    skew = PANEL + 0.2 * PANEL[:, [2, 0, 0]] * [1.0, 0.0, 0.0]
    with pytest.raises(MeshError, match=r"CSHEAR 1 \(line \d+\) is no rectangle"):
        bulk(tmp_path, "CSHEAR,1,7,1,2,3,4\nPSHEAR,7,1,1e-3\n", skew)


STRIP = np.array([[0.1 * i, y, 0.0] for i in range(11) for y in (0.0, 0.1)])


def strip(tmp_path, shell, force):
    """Motion of the end of a clamped strip, 1 m by 0.1 m, and its mesh."""
    cards = "".join(f"CQUAD4,{k},1,{2 * k - 1},{2 * k + 1},{2 * k + 2},{2 * k}\n" for k in range(1, 11))
    mesh = bulk(
        tmp_path, f"{cards}{shell}\nMAT1,2,{E},,0.,{RHO}\nMAT1,3,1.+7,,0.\nSPC1,1,123456,1,2\nSET1,1,21,22\n", STRIP
    )
    return moved(mesh, force)[0], mesh


def test_shells_bend_shear_and_stretch_by_what_a_pshell_says_of_each(tmp_path):
    """Two faces of 0.2 mm on a core of 10 mm whose shear is soft: each part of PSHELL has its own closed form."""
    thick, core, wide = 4e-4, 1e-2, 0.1
    inertia = 12.0 * (thick * core**2 / 4.0) / thick**3
    shell = f"PSHELL,1,2,{thick},2,{inertia:.8e},3,{core / thick:.8e}"
    bending, shear = E * thick * core**2 / 4.0 * wide, 0.5e7 * core * wide
    tip, mesh = strip(tmp_path, shell, (0.0, 0.0, 1.0))
    assert tip[2] == pytest.approx(1.0 / (3.0 * bending) + 1.0 / shear, rel=3e-3)
    assert strip(tmp_path, shell, (1.0, 0.0, 0.0))[0][0] == pytest.approx(1.0 / (E * thick * wide), rel=1e-6)
    assert mesh.mass_matrices[0].sum() == pytest.approx(RHO * thick * wide)
    limp, mesh = strip(tmp_path, f"PSHELL,1,2,{thick}", (0.0, 0.0, 1.0))
    plate = strip(tmp_path, f"PSHELL,1,2,{thick},2", (0.0, 0.0, 1.0))[0]
    assert limp[2] == pytest.approx(1e3 * plate[2], rel=1e-3)
    assert any("PSHELL 1 only stretch" in note for note in mesh.notes)
