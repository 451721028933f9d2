"""Cards with stiffness, mass or constraints are never dropped in silence; those without meaning never refused."""

from pathlib import Path

import numpy as np
import pytest

from flexfmu import read_mesh
from flexfmu.files.basics import MeshError
from flexfmu.mesh.model import NO_MATERIAL

pytest.importorskip("pyNastran")

BULK = """GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,1,1,1,2,3,4
PSOLID,1,1
MAT1,1,2.1e11,,.3,7800.
"""
LAST = len(BULK.splitlines()) + 1


def _file(folder: Path, card: str, control: str = "") -> Path:
    path = folder / "body.bdf"
    head = f"SOL 101\nCEND\n{control}\nBEGIN BULK\n" if control else ""
    path.write_text(f"{head}{BULK}{card}\nENDDATA\n")
    return path


@pytest.mark.parametrize(
    "card",
    [
        "CWELD,6,3,1,2", "CSEAM,7,1,1,2", "CBUSH1D,9,9,1,2\nPBUSH1D,9,1e5", "CGAP,17,2,1,2,0.,0.,1.",
        "CFAST,7,3,PROP,1,1,5",
        "CMASS2,9,1.,1,1", "CONM1,2,1,0,22.9", "CDAMP3,16,5,1,2", "CSUPEXT,1,1", "RJOINT,7,1,2,12", "RROD,5,1,2,1",
        "RBE1,59,1,123,2,456\n,UM,3,246", "RSSCON,110,GRID,1,2,3", "RTRPLT,7,1,2,3",
        "GENEL,629,,1,1,2,1\n,UD,,3,1\n,Z,1.,2.,3.",
        "BGSET,4,6,1,1,.1", "DMIG,STIF,0,6,1\nDMIG,STIF,1,1,,1,1,3.+5", "NSM1,3,PSOLID,1,.5,1",
    ],
)  # fmt: skip
def test_a_card_with_stiffness_mass_or_constraint_is_refused_by_name_and_line(tmp_path, card):
    with pytest.raises(MeshError, match=rf"{card.split(',')[0]}.*line {LAST}\b"):
        read_mesh(_file(tmp_path, card))


@pytest.mark.parametrize("card", ["MAT1           1                              0.      0.      0.", "MAT1,1,,,,0."])
def test_a_material_without_numbers_is_none(tmp_path, card):
    """As of exporters that have a mesh alone: the body file tells."""
    path = tmp_path / "body.bdf"
    path.write_text("".join(f"{card}\n" if line.startswith("MAT1") else f"{line}\n" for line in BULK.splitlines()))
    (block,) = read_mesh(path).blocks
    assert block.material.tolist() == [NO_MATERIAL]


def test_a_file_without_grid_points_is_refused_in_words(tmp_path):
    path = tmp_path / "body.bdf"
    path.write_text("SOL 101\nCEND\nBEGIN BULK\nPARAM,POST,-1\nENDDATA\n")
    with pytest.raises(MeshError, match=r"body\.bdf defines no grid points \(GRID\)"):
        read_mesh(path)


@pytest.mark.parametrize(
    "card",
    [
        "PLOTEL,99,1,2", "CHBDYG,2,,AREA3\n,1,2,3", "ASET1,123,1,2", "SUPORT,1,123", "FORCE,1,1,,1.,1.,0.,0.",
        "CORD2R,7,,1.,0.,0.,1.,0.,1.\n,2.,0.,0.", "EIGRL,1,,,10", "PLOAD4,1,1,1.",
        "FLUTTER,1,SYM,1,0,0", "QSET,2",
        "CREEP,1,0.,1.e-9,CRLAW,,,,\n,300,1.,1.,1.",
    ],
)  # fmt: skip
def test_cards_without_meaning_to_a_body_at_rest_are_passed_over(tmp_path, card):
    assert read_mesh(_file(tmp_path, card)).element_count == 1


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("PARAM,K6ROT,100.", "PARAM K6ROT = 100.0 is left out: shells have no stiffness"),
        ("PARAM,AUTOSPC,YES", "PARAM AUTOSPC = YES is left out"),
        ("PARAM,AUTOSPC,NO", ""),
        ("PARAM,G,.02", "PARAM G = 0.02 is left out: give [damping]"),
        ("MATT1,1,7", "MATT1 1 are left out"),
    ],
)
def test_parameters_and_tables_that_change_results_elsewhere_are_said(tmp_path, card, words):
    notes = " ".join(read_mesh(_file(tmp_path, card)).notes)
    assert words in notes if words else "PARAM" not in notes


def test_matrices_and_masses_that_the_case_control_does_not_choose_are_not_part_of_the_body(tmp_path):
    card = "DMIG,STIF,0,6,1\nDMIG,STIF,1,1,,1,1,3.+5"
    assert read_mesh(_file(tmp_path, card, "SPC = 1")).element_count == 1
    with pytest.raises(MeshError, match="DMIG"):
        read_mesh(_file(tmp_path, card, "K2GG = STIF"))


def test_a_card_of_no_known_name_is_named_in_a_note(tmp_path):
    notes = " ".join(read_mesh(_file(tmp_path, "XYZZY,1,2")).notes)
    assert f"XYZZY (line {LAST})" in notes


@pytest.mark.parametrize("card", ["CTETRA,2,1,1,2", "CTETRA,2,1,1,x,3,4", "MAT1,2,foo", "SPC1,1,a,1"])
def test_a_card_with_wrong_fields_is_named_with_its_line(tmp_path, card):
    with pytest.raises(MeshError, match=rf"{card.split(',')[0]}.*line {LAST}\b"):
        read_mesh(_file(tmp_path, card))


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("1054,1002,1025", rf"misparsed.*line {LAST}\b"),
        ("CTETRA,1,1,1,2,3,3", rf"CTETRA 1 .line 5, {LAST}\b"),
        ("INCLUDE 'gone.bdf'", rf"line {LAST}\b"),
        ("GRID,7,,0.,0.,0.\n=,  *(1),  =, *(14.8),=(2)\n=(2)", rf"\*\(14.8\).*line {LAST + 1}\b"),
        ("CORD2R,7,,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\nGRID,8,7,0.,0.,0.", rf"Cp = 7 .line {LAST}\b"),
        (
            "CQUAD4,9,3,1,7,2,3\nGRID,7,,.5,0.,0.\nPSHELL,3,1,.1",
            rf"body.bdf: shell 9 .line {LAST}. has no area at a corner",
        ),
    ],
)
def test_what_the_library_cannot_read_is_named_with_its_line(tmp_path, card, words):
    with pytest.raises(MeshError, match=words):
        read_mesh(_file(tmp_path, card))


def test_bulk_data_without_an_end_are_read_unless_grid_points_are_left_over(tmp_path):
    path = _file(tmp_path, "", "SPC = 1")
    path.write_text(path.read_text().replace("ENDDATA\n", ""))
    assert read_mesh(path).element_count == 1
    path.write_text(path.read_text() + "GRID,9,,5.,5.,5.\n")
    with pytest.raises(MeshError, match=r"no ENDDATA, and 1 of its 5 grid points belong to no element \(9\)"):
        read_mesh(path)


@pytest.mark.parametrize("bar", ["RBAR,5,1,5,123456", "RBAR,5,5,1,,123456", "RBAR,5,1,5"])
def test_a_rigid_bar_is_a_rigid_element_of_two_points(tmp_path, bar):
    grid = "GRID,5,,0.,0.,2.\n"
    found, expected = (read_mesh(_file(tmp_path, grid + card)) for card in (bar, "RBE2,5,1,123456,5"))
    assert [one.nodes.tolist() for one in found.links] == [one.nodes.tolist() for one in expected.links] == [[0, 4]]
    np.testing.assert_array_equal(found.node_sets["RBE2 5"], expected.node_sets["RBE2 5"])


def test_masses_and_springs_on_any_point_of_a_rigid_bar_hang_on_all_of_it(tmp_path):
    bar = "GRID,5,,0.,0.,2.\nRBAR,5,1,5,123456\nCONM2,7,5,,3.,0.1,0.,0.\nCELAS2,8,1.+5,5,1\n"
    mesh = read_mesh(_file(tmp_path, bar))
    assert mesh.masses[0].nodes.tolist() == mesh.springs[0].ends[0].tolist() == [0, 4]
    np.testing.assert_allclose(mesh.masses[0].point, (0.1, 0.0, 2.0))


def test_damping_and_weights_that_are_left_out_are_told(tmp_path):
    card = "GRID,9,,0.3,0.3,0.3\nRBE3,4,,9,123456,1.,123,2,3,\n,2.,123,4\nMPC,3,2,1,1.,3,1,-1.\nMAT1,2,1.,,.3,,,,.02"
    notes = " ".join(read_mesh(_file(tmp_path, card, "SPC = 1")).notes)
    assert all(words in notes for words in ("weights are left out", "GE of materials 2", "MPC 3 is taken"))


def test_a_rigid_bar_that_lets_its_points_turn_is_refused(tmp_path):
    with pytest.raises(MeshError, match="RBAR 5"):
        read_mesh(_file(tmp_path, "RBAR,5,1,2,123,456"))


def test_defaults_of_grid_points_hold_where_these_say_nothing(tmp_path):
    moved = _file(tmp_path, "CORD2R,7,,10.,0.,0.,10.,0.,1.\n,11.,0.,0.\nGRDSET,,7")
    np.testing.assert_allclose(read_mesh(moved).points[0], (10.0, 0.0, 0.0), atol=1e-12)
