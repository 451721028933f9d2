"""Files that other programs' libraries wrote (tests/foreign/make.py): each is the same bar as a deck has it."""

import sys
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from benchmarks.thin.bodies import Middle

import flexfmu
import flexfmu.mesh.checks
from flexfmu.fe.assembly import stiffness
from flexfmu.files.basics import MeshError
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from meshes import box

FOREIGN = Path(__file__).parent
STEEL = (2.0e11, 0.3, 7850.0)
# Sets of each file: the clamped end, the loaded end, all elements.
SETS = {
    "deck_{}.inp": ("ROOT", "TIP", "BAR"),
    "gmsh_{}_msh41.msh": ("ROOT", "TIP", "BAR"),
    "gmsh_{}_msh22.msh": ("ROOT", "TIP", "BAR"),
    "gmsh_{}_binary.msh": ("ROOT", "TIP", "BAR"),
    "gmsh_{}.med": ("ROOT", "TIP", "BAR"),
    "gmsh_{}.unv": ("ROOT", "TIP", "BAR"),
    "gmsh_{}.bdf": ("Faces 1", "Faces 2", "PSOLID 1"),
    "nastran_{}.bdf": ("SET 11", "RBE3 9001", "PSOLID 7"),
    "ansys_{}.cdb": ("ROOT", "TIP", "BAR"),
    "exodus_{}.e": ("ROOT", "TIP", "BAR"),
    "meshio_{}.vtk": ("ROOT", "TIP", "BAR"),
    "meshio_{}.vtu": ("ROOT", "TIP", "BAR"),
    "meshio_{}.xdmf": ("ROOT", "TIP", "BAR"),
}
WITH_MATERIAL = ("deck_{}.inp", "nastran_{}.bdf", "ansys_{}.cdb")
LARGE = 200.0
LOAD = [1.0e3, 2.0e3, 3.0e3, 400.0, 500.0, 600.0]


def mass(mesh):
    """Mass of a mesh with materials, kg."""
    from flexfmu.reduction.masses import body_properties

    return body_properties(mesh).mass


def answer(mesh, root, tip, material=STEEL):
    """Linear displacement and rotation of the tip under a force and a moment."""
    end = flexfmu.Interface(tip, point=[1.0, 0.05, 0.05])
    body = flexfmu.Body(mesh, material, [root], {"tip": end}).build("linear", modes=2, residual_flexibility=True)
    response = body.response(body.static({"tip": LOAD}))
    return np.concatenate([response.displacement[0], response.rotation[0]])


@pytest.fixture(scope="module", params=["tets", "bricks"])
def bar(request):
    """Kind of the bar, and the linear answer of its deck."""
    return request.param, answer(read_mesh(FOREIGN / f"deck_{request.param}.inp"), "ROOT", "TIP", None)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SETS)[1:])
def test_a_foreign_file_is_the_bar_of_the_deck_with_its_sets(bar, name):
    kind, expected = bar
    mesh = read_mesh(FOREIGN / name.format(kind))
    root, tip, whole = SETS[name]
    assert np.ptp(mesh.points[mesh.node_sets[root]], axis=0) == pytest.approx([0.0, 0.1, 0.1], abs=1e-9)
    assert mesh.points[mesh.node_sets[tip], 0] == pytest.approx(1.0)
    assert len(mesh.element_sets[whole]) == mesh.element_count
    material = STEEL
    if name in WITH_MATERIAL:
        assert mass(flexfmu.mesh.checks.checked(mesh)) == pytest.approx(78.5, rel=1e-9)
        material = None
    # Coordinates have 9 digits where formats have fields of 16 characters.
    np.testing.assert_allclose(answer(mesh, root, tip, material), expected, rtol=1e-6)


def calculix(kind, load):
    """Mean displacement of the tip."""
    rows = np.genfromtxt(FOREIGN / "calculix.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    (row,) = rows[(rows["bar"] == kind) & (rows["load"] == load)]
    return np.array([row[f"u{axis}_m"] for axis in "xyz"])


def test_the_linear_answer_of_both_bars_is_calculixs(bar):
    kind, _ = bar
    body = flexfmu.Body(read_mesh(FOREIGN / f"deck_{kind}.inp"), None, ["ROOT"], {"tip": "TIP"})
    body = body.build("linear", modes=2, residual_flexibility=True)
    found = body.response(body.static({"tip": LOAD[:3]})).displacement[0]
    np.testing.assert_allclose(found, calculix(kind, "linear"), rtol=1e-5)


# Quick is the bar of the deck, which all files give.
BARS = [pytest.param(name, marks=() if name.startswith("deck") else pytest.mark.slow) for name in SETS]


@pytest.mark.parametrize("name", BARS)
@pytest.mark.parametrize("kind", ["tets", "bricks"])
def test_the_bar_of_every_file_bends_far_as_in_calculix(kind, name):
    root, tip, _ = SETS[name]
    end = flexfmu.Interface(tip, point=[1.0, 0.05, 0.05])
    material = None if name in WITH_MATERIAL else STEEL
    body = flexfmu.Body(read_mesh(FOREIGN / name.format(kind)), material, [root], {"tip": end})
    body = body.build("second_order", modes=2, residual_flexibility=True, surface=False)
    found = body.response(body.static({"tip": LARGE * np.array(LOAD[:3])})).displacement[0]
    expected = calculix(kind, "large")
    assert np.linalg.norm(expected - LARGE * calculix(kind, "linear")) > 0.05 * np.linalg.norm(expected)
    assert np.linalg.norm(found - expected) < 2e-3 * np.linalg.norm(expected)


def nastran(folder, *bulk):
    """Read bulk data of a tetrahedron and whatever else is given."""
    corners = ("0.,0.,0.", "1.,0.,0.", "0.,1.,0.", "0.,0.,1.")
    lines = [f"GRID,{k},,{place}" for k, place in enumerate(corners, 1)]
    lines += ["CTETRA,1,1,1,2,3,4", "PSOLID,1,1", "MAT1,1,2.+11,,.3,7850."]
    path = folder / "body.bdf"
    path.write_text("\n".join([*lines, *bulk]) + "\n")
    return read_mesh(path)


@pytest.mark.parametrize(
    ("bulk", "message"),
    [
        (("CQUAD4,5,2,1,2,3,4", "PSHELL,2,,.001,1"), r"PSHELL 2 \(line \d+\) should have a thickness, MID1"),
        (
            ("CMASS2,5,1.,1,1",),
            r"CMASS2 5 \(line \d+\) at GRID 1: supported are masses that are the same in 1, 2 and 3",
        ),
        (("CGAP,6,2,1,2,0.,0.,1.",), "no solid: CGAP 6"),
        (("MPC,1,1,1,1.,2,4,-1.",), r"MPC 1 \(line \d+\) has the term 2, 4: supported are translations"),
        (
            ("MPC,1,1,1,1.,2,1,-1.", "MPC,2,1,1,1.,3,1,-1."),
            "MPC sets 1, 2 are there, and the case control chooses none",
        ),
        (
            ("RBE2,4,9,123,1,2", "RBE2,5,9,12,3,4", "GRID,9,,2.,2.,2."),
            r"RBE2 4 \(line \d+\), RBE2 5 share their reference points",
        ),
        (("RBE3,4,,1,123456,1.,123,2,3,4",), r"RBE3 4 \(line \d+\) share their reference points"),
        (("CTETRA,2,1,1,2,3,4,9,", ",,,,,,"), "CTETRA 2"),
        (("CTETRA,2,1,1,2,3,99",), "names GRID 99, which is not there"),
        (("PLSOLID,2,1", "CTETRA,2,2,1,2,3,4"), r"PLSOLID 2 \(line \d+\) is no property"),
        (("MAT9,2,1.", "PSOLID,2,2", "CTETRA,2,2,1,2,3,4"), r"MAT9 2 \(line \d+\) is the material"),
        (("INCLUDE 'gone.bdf'",), "gone.bdf"),
    ],
)
def test_what_nastran_has_beyond_solids_is_refused_by_card_and_number(tmp_path, bulk, message):
    with pytest.raises(MeshError, match=message):
        nastran(tmp_path, *bulk)


def test_constraints_and_rigid_elements_of_nastran_are_sets_and_are_told_of(tmp_path):
    mesh = nastran(tmp_path, "SPC1,3,123,1,2", "RBE2,4,9,123456,3,4", "GRID,9,,2.,2.,2.", "GRID,10,,3.,3.,3.,,12")
    assert mesh.labels[mesh.node_sets["SPC 3"]].tolist() == [1, 2]
    assert mesh.labels[mesh.node_sets["RBE2 4"]].tolist() == [3, 4]
    np.testing.assert_allclose(mesh.references["RBE2 4"], [2.0, 2.0, 2.0])
    assert any("RBE2 4 is offered as an interface" in note and "are rigid" in note for note in mesh.notes)
    (link,) = mesh.links
    assert mesh.labels[link.nodes].tolist() == [3, 4, 9]
    assert any("SPC 3" in note and "holds nothing" in note for note in mesh.notes)
    assert not mesh.fixed.any()


def test_a_missing_include_leaves_no_file_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MeshError, match=r"gone\.bdf"):
        nastran(tmp_path, "INCLUDE 'gone.bdf'")
    assert [path.name for path in tmp_path.iterdir()] == ["body.bdf"]


def test_rigid_elements_of_nastran_are_interfaces_about_their_reference(bar):
    kind, expected = bar
    mesh = read_mesh(FOREIGN / f"nastran_{kind}.bdf")
    out = mesh.references["RBE3 9001"] - [1.0, 0.05, 0.05]
    assert np.linalg.norm(out) > 0.1
    body = flexfmu.Body(mesh, None, ["SET 11"], {"tip": "RBE3 9001"})
    body = body.build("linear", modes=2, residual_flexibility=True)
    # A load at the point farther out is one at the centre with a moment more.
    shifted = np.array(LOAD)
    shifted[3:] -= np.cross(out, LOAD[:3])
    response = body.response(body.static({"tip": shifted}))
    moved = response.displacement[0] - np.cross(response.rotation[0], out)
    np.testing.assert_allclose(np.concatenate([moved, response.rotation[0]]), expected, rtol=1e-6)


@pytest.mark.parametrize(("control", "expected"), [("", 1), ("SOL 101\nCEND\nMPC = 7\nBEGIN BULK\n", 2)])
def test_multi_point_constraints_of_nastran_are_equations(tmp_path, control, expected):
    corners = ("0.,0.,0.", "1.,0.,0.", "0.,1.,0.", "0.,0.,1.")
    lines = [f"GRID,{k},,{place}" for k, place in enumerate(corners, 1)]
    lines += ["CTETRA,1,1,1,2,3,4", "PSOLID,1,1", "MAT1,1,2.+11,,.3,7850.", "MPC,5,1,1,1.,2,1,-1.", ",,3,2,.5"]
    if control:
        lines += ["MPC,6,4,3,2.,1,3,-2.", "MPCADD,7,5,6", "ENDDATA"]
    path = tmp_path / "body.bdf"
    path.write_text(control + "\n".join(lines) + "\n")
    equations = read_mesh(path).equations.toarray()
    assert equations.shape == (expected, 12)
    assert {k: equations[0, k] for k in np.flatnonzero(equations[0])} == {0: 1.0, 3: -1.0, 7: 0.5}


CUBE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def ansys(folder, kind, elements, tail="", places=CUBE):
    """Read an archive of nodes, by default a cube's corners, with elements of a type."""
    lines = [
        "/COM,ANSYS RELEASE 2024 R1",
        "/PREP7",
        f"ET,  1,{kind}",
        f"NBLOCK,6,SOLID,{len(places):6d},{len(places):6d}",
        "(3i9,6e21.13e3)",
    ]
    lines += [
        f"{k:9d}{0:9d}{0:9d}" + "".join(f"{x:20.13E}".replace("E+", "E+0") for x in p)
        for k, p in enumerate(np.array(places, dtype=float), 1)
    ]
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{len(elements):10d},{len(elements):10d}", "(19i9)"]
    for number, nodes in enumerate(elements, 1):
        lines.append("".join(f"{value:9d}" for value in (1, 1, 1, 1, 0, 0, 0, 0, len(nodes), 0, number, *nodes)))
    path = folder / "body.cdb"
    path.write_text("\n".join([*lines, "       -1", tail, ""]))
    return read_mesh(path)


def test_bricks_of_ansys_whose_nodes_coincide_are_tetrahedra(tmp_path):
    mesh = ansys(tmp_path, 185, [(1, 2, 4, 4, 5, 5, 5, 5)], "MP,EX,1,2e11\nMP,PRXY,1,.3\nMP,DENS,1,7850")
    assert mesh.blocks[0].type.name == "C3D4"
    assert mass(flexfmu.mesh.checks.checked(mesh)) == pytest.approx(7850.0 / 6.0)


SECTION = "SECTYPE, 1,SHELL, ,\nSECOFFSET, {}\nSECBLOCK, 1\n 5.000E-03, 1, 0.0, 3\n" + (
    "MP,EX,1,2.1e11\nMP,PRXY,1,.3\nMP,DENS,1,7850\n"
)


@pytest.mark.parametrize(
    ("kind", "number", "order"),
    [
        ("S4", 181, [0, 1, 2, 3]),
        ("S3", 181, [0, 1, 2, 2]),
        ("S8R", 281, range(8)),
        ("S8R", 281, [0, 1, 2, 2, 4, 5, 2, 7]),
    ],
)
@pytest.mark.parametrize(("offset", "lowest"), [("MID", -0.0025), ("TOP", -0.005), ("BOT", 0.0)])
def test_shells_of_ansys_have_the_thickness_of_their_section(tmp_path, kind, number, order, offset, lowest):
    middle = Middle("strip", kind)
    rows = [[row[k] + 1 for k in order] for row in middle.cells]
    mesh = ansys(tmp_path, number, rows, SECTION.format(offset), middle.points)
    nodes = len(set(order))
    assert {(block.type.name, len(block.labels)) for block in mesh.blocks} == {(f"S{nodes}", len(rows))}
    np.testing.assert_allclose([mesh.points[:, 2].min(), np.ptp(mesh.points[:, 2])], [lowest, 0.005], atol=1e-12)
    assert mesh.materials[0].youngs_modulus == 2.1e11
    np.testing.assert_array_equal(mesh.node_sets["SECTION 1"], np.unique(mesh.blocks[0].connectivity))
    assert (flexfmu.mesh.checks.checked(mesh).volumes > 0.0).all()


BEAMS = """*NODE
1, 0, 0, 0
2, {}
*ELEMENT, TYPE=B31, ELSET=ALL
1, 1, 2
*MATERIAL, NAME=M
*ELASTIC
2e11, .3
*DENSITY
7850
*BEAM SECTION, ELSET=ALL, MATERIAL=M, SECTION={}
{}
{}
"""


@pytest.mark.parametrize(
    ("theirs", "numbers", "section", "row"),
    [
        ("RECT", ".02,.05", "RECT", ".02, .05"),
        ("CSOLID", ".02", "CIRC", ".02"),
        ("CTUBE", ".018,.02", "PIPE", ".02, .002"),
        ("HREC", ".04,.06,.003,.003,.002,.002", "BOX", ".04, .06, .003, .002, .003, .002"),
        ("I", ".04,.04,.08,.004,.004,.003", "I", ".04, .08, .04, .04, .004, .004, .003"),
    ],
)
@pytest.mark.parametrize(
    ("end", "towards", "first"),
    [((1.0, 0.0, 0.0), None, "0, 1, 0"), ((0.0, 0.0, 1.0), None, "0, 1, 0"), ((1, 0, 0), (0, 1, 0), "0, 0, -1")],
)
def test_beams_of_ansys_are_those_of_the_deck(tmp_path, theirs, numbers, section, row, end, towards, first):
    """Their y is level unless a third node says where z is."""
    tail = f"SECTYPE,1,BEAM,{theirs},,0\nSECOFFSET,CENT\nSECDATA,{numbers}\nMP,EX,1,2e11\nMP,PRXY,1,.3\nMP,DENS,1,7850"
    places = [(0.0, 0.0, 0.0), end, *([towards] if towards else [])]
    mesh = ansys(tmp_path, 188, [tuple(range(1, len(places) + 1))], tail, places)
    deck = tmp_path / "beam.inp"
    deck.write_text(BEAMS.format(", ".join(map(str, end)), section, row, first))
    same = read_mesh(deck)
    used = np.unique(mesh.blocks[0].connectivity)
    np.testing.assert_allclose(mesh.points[used], same.points[np.unique(same.blocks[0].connectivity)], atol=1e-15)
    np.testing.assert_allclose(mesh.blocks[0].section, same.blocks[0].section, rtol=1e-12)


# Values at the first three temperatures, and at the fourth.
TEMPERATURES = ("MPDATA,R5.0, 1,EX  ,  1, 1, 2.1E+11, 2.0E+11, 1.9E+11,", "MPDATA,R5.0, 1,EX  ,  1, 4, 1.8E+11,")


@pytest.mark.parametrize("lines", [TEMPERATURES, TEMPERATURES[::-1]])
def test_materials_of_ansys_are_those_at_their_first_temperature(tmp_path, lines):
    tail = "\n".join(["MPTEMP,R5.0, 1, 1, 20., 100., 200.,", *lines, "MP,PRXY,1,.3", "MP,DENS,1,7850"])
    mesh = ansys(tmp_path, 185, [(1, 2, 3, 4, 5, 6, 7, 8)], tail)
    assert [material.youngs_modulus for material in mesh.materials] == [2.1e11]


@pytest.mark.parametrize(
    ("kind", "elements", "tail", "message"),
    [
        (63, [(1, 2, 3, 4)], "", r"element type 63 \(line 3\): elements 1; supported are SOLID45"),
        (181, [(1, 2, 3, 4)], "", r"element type 181 with section 1 \(line 3\): elements 1; supported"),
        (181, [(1, 2, 3, 4)], "SECTYPE,1,SHELL\nSECDATA,.1,1\nSECDATA,.1,2", "181 with section 1"),
        (181, [(1, 2, 3, 4)], "SECTYPE,1,SHELL\nSECOFFSET,USER,.1\nSECDATA,.1,1", "181 with section 1"),
        (181, [(1, 2, 3, 4)], "KEYOPT,1,1,1\nSECTYPE,1,SHELL\nSECDATA,.1,1", "181 with section 1"),
        (188, [(1, 2)], "SECTYPE,1,BEAM,CHAN\nSECDATA,1,1,1,1,1,1", "188 with section 1"),
        (188, [(1, 2)], "KEYOPT,1,1,1\nSECTYPE,1,BEAM,RECT\nSECDATA,1,1", "188 with section 1"),
        (188, [(1, 2)], "SECTYPE,1,BEAM,RECT\nSECOFFSET,ORIG\nSECDATA,1,1", "188 with section 1"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 8)], "CE,R5.0,DEFI, 1, 1,  0.0", "by CE \\(line"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 8)], "CPCYC,ALL,,1,0.1", "by CPCYC \\(line"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 8)], "ET,9,21\nTYPE,9\nEN,998,1", "by EN \\(line"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 8)], "TB,ANEL,1", "by TB \\(line"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 8)], "MP,EX,1,2e11\nMP,EY,1,1e11", "material 1 is orthotropic"),
        (185, [(1, 2, 3, 4, 5, 6, 7, 99)], "", "names node 99, which is not there"),
    ],
)
def test_what_ansys_has_beyond_isotropic_solids_is_refused(tmp_path, kind, elements, tail, message):
    with pytest.raises(MeshError, match=message):
        ansys(tmp_path, kind, elements, tail)


@pytest.mark.parametrize(
    "tail", ["EN,R5.5,ATTR,       -1,", "ET,9,170\nTYPE,9\nEN,998,1", "TYPE,tid\nE,1", "F,1,FX,1."]
)
def test_ends_of_blocks_and_elements_of_contact_are_passed_over(tmp_path, tail):
    assert ansys(tmp_path, 185, [(1, 2, 3, 4, 5, 6, 7, 8)], tail).element_count == 1


@pytest.mark.parametrize(
    ("module", "file", "words"),
    [
        ("pyNastran.bdf.bdf", "nastran_tets.bdf", r'needs pyNastran .*pip install "flexfmu\[nastran\]"'),
        ("mapdl_archive", "ansys_tets.cdb", r'needs mapdl-archive .*pip install "flexfmu\[ansys\]"'),
    ],
)
def test_a_library_that_is_not_there_is_named_with_its_extra(monkeypatch, module, file, words):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MeshError, match=words):
        read_mesh(FOREIGN / file)


def test_input_files_of_any_program_are_told_apart_by_their_first_commands(tmp_path):
    for source, suffix in (("ansys_bricks.cdb", ".inp"), ("ansys_bricks.cdb", ".dat"), ("gmsh_bricks.bdf", ".dat")):
        path = tmp_path / f"body{suffix}"
        path.write_bytes((FOREIGN / source).read_bytes())
        assert read_mesh(path).element_count == 24


def test_a_part_of_a_deck_that_cgx_calls_msh_is_a_deck(tmp_path):
    (tmp_path / "all.msh").write_bytes((FOREIGN / "deck_bricks.inp").read_bytes())
    assert read_mesh(tmp_path / "all.msh").element_count == 24


def test_universal_files_that_are_cut_short_or_hold_other_elements_are_refused(tmp_path):
    text = (FOREIGN / "gmsh_bricks.unv").read_text()
    for changed, words in (
        (text[: len(text) // 2], "cut short"),
        (text.replace("       116 ", "       161 "), "descriptor 161: elements"),
    ):
        (tmp_path / "body.unv").write_text(changed)
        with pytest.raises(MeshError, match=words):
            read_mesh(tmp_path / "body.unv")


WORKBENCH = """/batch
/prep7
/nopr
nblock,3,,8
(1i9,3e20.9e3)
{nodes}
-1
/wb,elem,start
et,1,185
keyo,1,2,3
eblock,19,solid,,1
(19i9)
{brick}
-1
et,2,154
type,2
real,2
mat,2
keyo,2,4,1
eblock,10,,,1
(15i9)
{face}
-1
MP,EX,1,2e11,
MP,NUXY,1,0.3,
MP,DENS,1,7850,
CMBLOCK,ROOT,NODE,       4
(8i10)
         1         2         3         4
/solu
"""


def test_input_files_of_workbench_with_surfaces_in_blocks_of_their_own_are_read(tmp_path):
    places = [(0, 0, 0), (2, 0, 0), (2, 3, 0), (0, 3, 0), (0, 0, 5), (2, 0, 5), (2, 3, 5), (0, 3, 5)]
    fields = {
        "nodes": "\n".join(
            f"{k:9d}" + "".join(f"{x:20.9E}".replace("E+", "E+0") for x in place) for k, place in enumerate(places, 1)
        ),
        "brick": "".join(f"{value:9d}" for value in (1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, *range(1, 9))),
        "face": "".join(f"{value:9d}" for value in (2, 2, 2, 2, 0, 5, 6, 7, 8)),
    }
    (tmp_path / "ds.dat").write_text(WORKBENCH.format(**fields))
    mesh = read_mesh(tmp_path / "ds.dat")
    assert mesh.element_count == 1
    assert mass(flexfmu.mesh.checks.checked(mesh)) == pytest.approx(30.0 * 7850.0)
    assert mesh.node_sets["ROOT"].tolist() == [0, 1, 2, 3]


def test_cells_that_are_numbered_the_other_way_round_are_turned_and_counted():
    mesh = flexfmu.read_mesh(FOREIGN / "gmsh_bricks.med")
    assert any("24 elements are numbered the other way round" in note for note in mesh.notes)


@pytest.mark.parametrize(("kind", "name"), [(ElementType.C3D6, "wedge"), (ElementType.C3D15, "wedge15")])
@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_wedges_keep_their_nodes_in_order(tmp_path, kind, name, suffix):
    """A wedge whose nodes come in another order has another volume, or another stiffness."""
    own = box(kind, (2, 1, 1), (0.2, 0.1, 0.1))
    path = tmp_path / f"wedges{suffix}"
    meshio.Mesh(own.points, [(name, own.blocks[0].connectivity)]).write(path)
    read = replace(read_mesh(path), materials=own.materials)
    blocks = tuple(replace(block, material=np.zeros_like(block.labels)) for block in read.blocks)
    read = replace(read, blocks=blocks)
    assert [block.type for block in read.blocks] == [kind]
    assert sum(part.sum() for part in read.volume_matrices) == pytest.approx(0.2 * 0.1 * 0.1)
    found, expected = (np.sort(np.linalg.eigvalsh(stiffness(mesh).toarray())) for mesh in (read, own))
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected[-1])
