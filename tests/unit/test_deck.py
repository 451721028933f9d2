import numpy as np
import pytest

from decks import BODY, BRICK, NODES, STEEL, line_of, read, refuse, set_labels
from flexfmu.files.basics import DeckError, MeshError, UnitSystem
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import NO_MATERIAL


def test_a_brick_with_its_material_is_read_as_written(tmp_path):
    mesh = read(tmp_path, BODY)
    (block,) = mesh.blocks
    assert block.type is ElementType.C3D8
    assert mesh.labels.tolist() == list(range(1, 9))
    np.testing.assert_array_equal(mesh.points[6], [2.0, 1.0, 1.0])
    assert block.labels.tolist() == [11]
    assert block.connectivity.tolist() == [list(range(8))]
    assert block.material.tolist() == [0]
    (steel,) = mesh.materials
    assert (steel.name, steel.youngs_modulus, steel.poissons_ratio, steel.density) == ("Steel", 2.1e11, 0.3, 7850.0)
    assert set_labels(mesh, "Nall") == list(range(1, 9))
    assert mesh.element_sets["Eall"].tolist() == [0]
    assert not mesh.fixed.any()
    assert mesh.notes == ()


def test_millimetre_tonne_decks_give_the_same_body_as_metre_kilogram_decks(tmp_path):
    metres = read(tmp_path, BODY)
    text = BODY.replace("2., ", "2000., ").replace("1., ", "1000., ").replace(" 1.\n", " 1000.\n")
    text = text.replace("2.1e11", "2.1e5").replace("7850.", "7.85e-9")
    millimetres = read(tmp_path, text, UnitSystem.MM_T_S)
    np.testing.assert_allclose(millimetres.points, metres.points, rtol=1e-15)
    (steel,) = millimetres.materials
    assert steel.youngs_modulus == pytest.approx(2.1e11, rel=1e-14)
    assert steel.density == pytest.approx(7850.0, rel=1e-14)
    assert steel.poissons_ratio == 0.3


def test_a_density_that_the_declared_units_make_absurd_is_refused(tmp_path):
    path = tmp_path / "body.inp"
    path.write_text(BODY)
    with pytest.raises(DeckError, match=r"7\.85e\+15 kg/m³ in the declared units mm-t-s"):
        read_deck(path, UnitSystem.MM_T_S)


def test_keywords_and_set_names_are_found_whatever_their_case_and_kept_as_spelt(tmp_path):
    text = BODY.replace("*NODE, NSET", "*Node , nset ").replace("*SOLID SECTION", "*solidSection")
    text = text.replace("ELSET=Eall, MATERIAL=Steel", "elset=EALL, material=STEEL")
    mesh = read(tmp_path, text + "*NSET, NSET=More\nNALL\n")
    assert list(mesh.node_sets) == ["Nall", "More"]
    assert len(mesh.node_sets["More"]) == 8
    assert mesh.blocks[0].material.tolist() == [0]


def test_comments_blank_lines_carriage_returns_and_a_byte_order_mark_do_not_count(tmp_path):
    text = "\ufeff** made by hand\n" + BODY.replace("3, 2.", "** between\n\n  3, 2.")
    path = tmp_path / "body.inp"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    assert len(read_deck(path, UnitSystem.SI).points) == 8


def test_a_keyword_line_that_ends_with_a_comma_goes_on(tmp_path):
    mesh = read(tmp_path, NODES + BRICK.replace("C3D8, ELSET", "C3D8,\n** comment\nELSET") + STEEL)
    assert mesh.element_sets["Eall"].tolist() == [0]


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [
        ("6, 7, 8\n", "6, 7, 8, 1, 2,\n", "rows of C3D8 name more than 8 nodes: the rest is left out"),
        ("*NODE, NSET", ">** a title\n*NODE, NSET", ""),
        ("NSET=Nall\n", "NSET=Nall,\n", ""),
        ("*MATERIAL", "*EQUATION\n2\n1, 11, 1., 2, 11, -1.\n*MATERIAL", ""),
        ("*MATERIAL", "*ELEMENT, TYPE=GAPUNI, ELSET=G\n20, 1, 2\n*GAP, ELSET=G\n0.\n*MATERIAL", "*GAP is left unused"),
        ("*DENSITY", "*MOHR COULOMB HARDENING\n0., 0.\n*DENSITY", "*MOHR COULOMB HARDENING is left unused"),
    ],
)
def test_what_solvers_pass_over_changes_no_body(tmp_path, before, after, word):
    assert BODY.count(before) == 1
    plain, mesh = read(tmp_path, BODY), read(tmp_path, BODY.replace(before, after))
    np.testing.assert_array_equal(mesh.points, plain.points)
    np.testing.assert_array_equal(mesh.blocks[0].connectivity, plain.blocks[0].connectivity)
    assert (mesh.materials, mesh.equations.shape[0]) == (plain.materials, 0)
    assert any(word in note for note in mesh.notes) if word else not mesh.notes


def test_missing_coordinates_are_zero_and_fortran_exponents_are_read(tmp_path):
    mesh = read(tmp_path, BODY.replace("2, 2., 0., 0.", "2, 0.2D+1"))
    np.testing.assert_array_equal(mesh.points[1], [2.0, 0.0, 0.0])


@pytest.mark.parametrize("rows", ["1,{a},\n{b}\n", "1,{a}\n{b}\n", "1, {a}, {b}\n"])
def test_twenty_node_rows_go_on_in_the_next_line(tmp_path, rows):
    nodes = "*NODE\n" + "".join(f"{label}, {label}., 0., 0.\n" for label in range(1, 21))
    row = rows.format(a=",".join(map(str, range(20, 5, -1))), b=",".join(map(str, range(5, 0, -1))))
    mesh = read(tmp_path, f"{nodes}*ELEMENT, TYPE=C3D20R\n{row}")
    assert mesh.blocks[0].type is ElementType.C3D20R
    assert mesh.blocks[0].connectivity.tolist() == [list(range(19, -1, -1))]


def test_full_and_reduced_integration_stay_apart(tmp_path):
    nodes = "*NODE\n" + "".join(f"{label}, {label}., 0., 0.\n" for label in range(1, 21))
    row = ", ".join(map(str, range(1, 21)))
    mesh = read(tmp_path, f"{nodes}*ELEMENT, TYPE=C3D20R\n1, {row}\n*ELEMENT, TYPE=C3D20\n2, {row}\n")
    assert [block.type for block in mesh.blocks] == [ElementType.C3D20R, ElementType.C3D20]


def test_element_sets_count_positions_over_the_blocks_laid_end_to_end(tmp_path):
    tetra = "*ELEMENT, TYPE=C3D4, ELSET=Tets\n1, 1, 2, 3, 5\n"
    text = NODES + BRICK + tetra + BRICK.replace("11,", "12,").replace("Eall", "Second")
    mesh = read(tmp_path, text + "*ELSET, ELSET=Mixed\n12, Tets\n")
    assert [block.labels.tolist() for block in mesh.blocks] == [[11, 12], [1]]
    assert mesh.element_sets["Tets"].tolist() == [2]
    assert mesh.element_sets["Second"].tolist() == [1]
    assert mesh.element_sets["Mixed"].tolist() == [1, 2]


def test_sets_grow_by_labels_names_ranges_and_repeated_cards(tmp_path):
    sets = """*NSET, NSET=Ends
8, 1, 1,
*NSET, NSET=Odd, GENERATE
3, 7, 2
*NSET, NSET=ENDS
Odd, 2
*NSET, NSET=Brick, ELSET=Eall
"""
    mesh = read(tmp_path, BODY + sets)
    assert set_labels(mesh, "Odd") == [3, 5, 7]
    assert set_labels(mesh, "Ends") == [1, 2, 3, 5, 7, 8]
    assert "ENDS" not in mesh.node_sets
    assert set_labels(mesh, "Brick") == list(range(1, 9))


def test_sets_may_stand_before_the_nodes_they_name(tmp_path):
    assert set_labels(read(tmp_path, "*NSET, NSET=Tip\n7\n" + BODY), "Tip") == [7]


def test_gaps_in_a_generated_range_are_passed_over_with_a_note(tmp_path):
    mesh = read(tmp_path, BODY + "*NSET, NSET=Tail, GENERATE\n7, 12\n")
    assert set_labels(mesh, "Tail") == [7, 8]
    assert any("4 numbers from 7 to 12 belong to no node" in note for note in mesh.notes)


@pytest.mark.parametrize(
    ("face", "labels"),
    [
        ("S1", [1, 2, 3, 4]),
        ("S2", [5, 6, 7, 8]),
        ("S3", [1, 2, 5, 6]),
        ("S4", [2, 3, 6, 7]),
        ("S5", [3, 4, 7, 8]),
        ("S6", [1, 4, 5, 8]),
    ],
)
def test_a_surface_of_element_faces_is_the_set_of_their_nodes(tmp_path, face, labels):
    mesh = read(tmp_path, BODY + f"*SURFACE, NAME=Face\nEall, {face}\n")
    assert set_labels(mesh, "Face") == labels


def test_faces_of_quadratic_elements_take_the_mid_sides_that_lie_in_them(tmp_path):
    corners = {kind: np.array(points, float) for kind, points in CORNERS.items()}
    for kind, edges in EDGES.items():
        points = np.vstack([corners[kind], [corners[kind][list(edge)].mean(axis=0) for edge in edges]])
        nodes = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(points, 1))
        row = ", ".join(map(str, range(1, len(points) + 1)))
        faces = 6 if kind == "C3D20" else 4
        cards = "".join(f"*SURFACE, NAME=F{face}, TYPE=ELEMENT\n1, S{face}\n" for face in range(1, faces + 1))
        mesh = read(tmp_path, f"{nodes}*ELEMENT, TYPE={kind}\n1, {row}\n{cards}")
        for face in range(1, faces + 1):
            on_face = mesh.points[mesh.node_sets[f"F{face}"]]
            spread = np.linalg.svd(on_face - on_face.mean(axis=0), compute_uv=False)
            assert len(on_face) == (8 if kind == "C3D20" else 6)
            assert spread[-1] < 1e-12
        assert len({tuple(rows) for rows in mesh.node_sets.values()}) == faces


CORNERS = {
    "C3D10": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "C3D20": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
}
EDGES = {
    "C3D10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "C3D20": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
}


def test_a_node_set_takes_precedence_over_a_surface_of_its_name_with_a_note(tmp_path):
    mesh = read(tmp_path, BODY + "*NSET, NSET=Tip\n7\n*SURFACE, NAME=TIP, TYPE=NODE\n8\n")
    assert set_labels(mesh, "Tip") == [7]
    assert any("surface 'TIP' is left unused" in note for note in mesh.notes)


def test_homogeneous_supports_of_the_model_part_are_kept(tmp_path):
    sets = "*NSET, NSET=Root\n1, 4\n"
    mesh = read(tmp_path, BODY + sets + "*BOUNDARY\nROOT, 1, 2\n5, 3\n6, 2, 6, 0.\n7, ENCASTRE\n8, Ysymm\n")
    expected = np.zeros((8, 3), dtype=bool)
    expected[[0, 3], :2] = True
    expected[4, 2] = True
    expected[5, 1:] = True
    expected[6] = True
    expected[7, 1] = True
    np.testing.assert_array_equal(mesh.fixed, expected)


def test_included_files_stand_in_place_of_their_card_relative_to_the_including_file(tmp_path):
    (tmp_path / "parts" / "deep").mkdir(parents=True)
    (tmp_path / "parts" / "mesh.inp").write_text("*NODE, NSET=Nall\n*INCLUDE, INPUT=deep/nodes.txt\n" + BRICK)
    (tmp_path / "parts" / "deep" / "nodes.txt").write_text(NODES.split("\n", 1)[1])
    mesh = read(tmp_path, "*INCLUDE,\nINPUT='parts/mesh.inp'\n" + STEEL)
    assert len(mesh.points) == 8
    assert len(mesh.node_sets["Nall"]) == 8


def test_an_error_in_an_included_file_names_that_file_and_its_line(tmp_path):
    included = tmp_path / "nodes.inp"
    included.write_text(NODES.replace("5, 0.", "5, zero"))
    with pytest.raises(DeckError, match="coordinate x of node 5") as caught:
        read(tmp_path, "*HEADING\nA body\n*INCLUDE, INPUT=nodes.inp\n" + BRICK)
    assert (caught.value.file, caught.value.line) == (str(included), 6)


def test_an_include_cycle_is_refused(tmp_path):
    (tmp_path / "other.inp").write_text("*INCLUDE, INPUT=body.inp\n")
    with pytest.raises(DeckError, match="cannot include itself") as caught:
        read(tmp_path, BODY + "*INCLUDE, INPUT=other.inp\n")
    assert caught.value.file == str(tmp_path / "other.inp")


def test_including_a_file_twice_is_no_cycle(tmp_path):
    (tmp_path / "nodes.inp").write_text(NODES)
    assert len(read(tmp_path, "*INCLUDE, INPUT=nodes.inp\n" * 2 + BRICK).points) == 8


def test_a_missing_included_file_is_named_with_the_including_line(tmp_path):
    refuse(tmp_path, BODY + "*INCLUDE, INPUT=gone.inp\n", "gone.inp", "does not exist")


def test_a_step_is_left_unused_and_said_so_with_its_lines(tmp_path):
    step = "*STEP, NLGEOM\n*STATIC\n*BOUNDARY\n7, 1, 1, 0.5\n*CLOAD\n7, 1, 1.\n*END STEP\n"
    mesh = read(tmp_path, BODY + step)
    begin = BODY.count("\n") + 1
    (note,) = mesh.notes
    assert note == (
        f"{tmp_path / 'body.inp'}, lines {begin} to {begin + 6}: a step is analysis and left unused: "
        "*STATIC, *BOUNDARY, *CLOAD"
    )


def test_what_steps_hold_is_offered_as_sets_and_holds_nothing_by_itself(tmp_path):
    step = "*STEP\n*STATIC\n*BOUNDARY\n{}*END STEP\n"
    first = step.format("5, 1, 3\n6, ENCASTRE\n7, 1, 1, 0.5\n8, 1\n8, 3\n4, 11, 11\nNOWHERE, 1\n")
    mesh = read(tmp_path, BODY + first + step.format("1, 2\n"))
    assert not mesh.fixed.any()
    assert {name for name in mesh.node_sets if name.startswith("STEP")} == {"STEP 1", "STEP 1 xz", "STEP 2 y"}
    assert set_labels(mesh, "STEP 1") == [5, 6]
    assert set_labels(mesh, "STEP 1 xz") == [8]
    assert set_labels(mesh, "STEP 2 y") == [1]
    note = mesh.notes[-1]
    assert note == "steps hold the node sets STEP 1, STEP 1 xz, STEP 2 y: hold them by [[support]]"


def test_the_model_part_goes_on_after_a_step(tmp_path):
    mesh = read(tmp_path, BODY + "*STEP\n*STATIC\n*END STEP\n*NSET, NSET=Late\n3\n")
    assert set_labels(mesh, "Late") == [3]


def test_headings_are_passed_over_silently_and_thermal_constants_with_a_note(tmp_path):
    text = "*HEADING\nbody, with, commas\n" + BODY.replace("*DENSITY", "*EXPANSION\n1.2e-5\n*DENSITY")
    mesh = read(tmp_path, text)
    (note,) = mesh.notes
    assert f"line {line_of(text, '*EXPANSION')}: *EXPANSION is left unused" in note


def test_elements_without_a_section_have_no_material(tmp_path):
    extra = "*ELEMENT, TYPE=C3D8\n12, 1, 2, 3, 4, 5, 6, 7, 8\n"
    assert read(tmp_path, BODY + extra).blocks[0].material.tolist() == [0, NO_MATERIAL]


def test_sections_give_each_block_its_own_materials(tmp_path):
    aluminium = STEEL.replace("Steel", "Alu").replace("2.1e11", "7e10").replace("7850", "2700").replace("Eall", "Tets")
    mesh = read(tmp_path, BODY + "*ELEMENT, TYPE=C3D4, ELSET=Tets\n1, 1, 2, 3, 5\n" + aluminium)
    assert [material.name for material in mesh.materials] == ["Steel", "Alu"]
    assert [block.material.tolist() for block in mesh.blocks] == [[0], [1]]


def test_a_material_that_no_section_uses_is_left_out_with_a_note(tmp_path):
    mesh = read(tmp_path, BODY + "*MATERIAL, NAME=Spare\n*ELASTIC\n1e9, 0.3\n")
    assert [material.name for material in mesh.materials] == ["Steel"]
    assert any("no section uses the material 'Spare'" in note for note in mesh.notes)


@pytest.mark.parametrize(
    "keyword",
    [
        "*SUBSTRUCTURE PROPERTY",
        "*MADE UP",
    ],
)
def test_a_keyword_that_would_change_the_model_is_refused(tmp_path, keyword):
    name = keyword.split(",")[0]
    refuse(
        tmp_path, BODY + keyword + "\n1., 2.\n", keyword, f"{name} is not supported", "*SOLID SECTION", "take it out"
    )


@pytest.mark.parametrize("kind", ["C3D27", "COH3D8", "GK3D8", "CONN3D2", "F3D8", "X"])
def test_other_element_types_are_refused(tmp_path, kind):
    refuse(tmp_path, BODY.replace("C3D8", kind), "*ELEMENT", f"element type {kind} is not supported", "C3D20R")


@pytest.mark.parametrize(
    ("before", "after", "culprit", "words"),
    [
        ("*NODE, NSET=Nall", "*NODE, NSET=Nall, SYSTEM=C", "*NODE", "parameter SYSTEM"),
        ("3, 2., 1., 0.", "3, 2., 1,0, 0.", "1,0, 0.", "4 coordinates"),
        ("3, 2., 1., 0.", "3, 2., nan, 0.", "nan", "finite number"),
        ("3, 2., 1., 0.", "3, 2., 1., inf", "inf", "finite number"),
        ("3, 2., 1., 0.", "3.5, 2., 1., 0.", "3.5", "whole number"),
        ("3, 2., 1., 0.", "-3, 2., 1., 0.", "-3,", "positive"),
        ("3, 2., 1., 0.", "2, 2., 1., 0.", "2, 2., 1.", "node 2 is defined again"),
        ("6, 7, 8\n", "6, 7, 9\n", "11, 1", "element 11 names nodes that are not defined: 9"),
        ("6, 7, 8\n", "6, 7\n", "11, 1", "has 7 nodes, expected 8"),
        ("6, 7, 8\n", "6, 7\n12, 1, 2, 3, 4, 5, 6, 7, 8\n", "11, 1", "has 7 nodes, expected 8"),
        ("6, 7, 8\n", "6, 7,\n", "11, 1", "has 7 nodes, expected 8"),
        ("6, 7, 8\n", "6, 7, 8, 1\n", "11, 1", "has 9 nodes, expected 8"),
        ("6, 7, 8\n", "6, 7, x\n", "11, 1", "whole number, found 'x'"),
        ("6, 7, 8\n", "6, 7, 8\n11, 2, 1, 3, 4, 5, 6, 7, 8\n", "11, 2", "element 11 is defined again"),
        ("*ELASTIC\n", "*ELASTIC, TYPE=LAMINA\n", "*ELASTIC", "TYPE=LAMINA is not supported"),
        ("*ELASTIC\n", "*ELASTIC, TYPE=ORTHO\n", "2.1e11", "nine constants, found 2 numbers"),
        ("2.1e11, 0.3\n", "2.1e11\n", "2.1e11", "Poisson's ratio"),
        ("2.1e11, 0.3\n", "-2.1e11, 0.3\n", "-2.1e11", "should be positive"),
        ("2.1e11, 0.3\n", "2.1e11, 0.5\n", "2.1e11", "between -1 and 0.5"),
        ("2.1e11, 0.3\n", "2.1e11, high\n", "high", "found 'high'"),
        ("7850.", "0.0 ", "0.0 ", "density 0 means 0 kg/m³"),
        ("*MATERIAL, NAME=Steel\n", "", "*ELASTIC", "before any *MATERIAL"),
        ("*MATERIAL, NAME=Steel", "*MATERIAL", "*MATERIAL", "needs the parameter NAME"),
        ("ELSET=Eall, MATERIAL", "ELSET=Gone, MATERIAL", "*SOLID", "element set 'Gone' is not defined"),
        ("MATERIAL=Steel", "MATERIAL=Steel, ORIENTATION=O", "*SOLID", "orientation 'O' is not defined"),
        ("MATERIAL=Steel", "MATERIAL=Steel, COMPOSITE", "*SOLID", "parameter COMPOSITE"),
        ("*NODE, NSET=Nall", "1, 2, 3\n*NODE, NSET=Nall", "1, 2, 3", "before the first keyword"),
    ],
)
def test_a_faulty_line_is_refused_with_its_number(tmp_path, before, after, culprit, words):
    assert before in BODY
    refuse(tmp_path, BODY.replace(before, after), culprit, words)


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("*NSET, NSET=A\n99 !\n", "node set '99 !' is not defined"),
        ("*NSET, NSET=A\n 99\n", "node 99 is not defined"),
        ("*NSET, NSET=A\nEall\n", "node set 'Eall' is not defined"),
        ("*ELSET, ELSET=A\n 99\n", "element 99 is not defined"),
        ("*ELSET, ELSET=A\nNall\n", "element set 'Nall' is not defined"),
        ("*NSET, NSET=A, GENERATE\n5, 1\n", "cannot go from 5 to 1"),
        ("*NSET, NSET=A, GENERATE\n20, 30\n", "no node from 20 to 30"),
        ("*NSET, NSET=A, GENERATE\n5\n", "'first, last, increment'"),
        ("*SURFACE, NAME=A\nEall, S7\n", "found 'S7'"),
        ("*SURFACE, NAME=A\nEall\n", "face of C3D8"),
        ("*BOUNDARY\nNall, 7\n", "degrees of freedom 7 to 7"),
        ("*TRANSFORM, NSET=Nall\n1., 2.\n", "takes two points"),
        ("*BOUNDARY\nGone, 1\n", "node set 'Gone' is not defined"),
        ("*BOUNDARY\nNall, CLAMPED\n", "'CLAMPED'"),
        ("*BOUNDARY\nNall\n", "ENCASTRE"),
    ],
)
def test_a_faulty_set_surface_or_support_is_refused_at_its_data_line(tmp_path, card, words):
    with pytest.raises(DeckError) as caught:
        read(tmp_path, BODY + card)
    assert caught.value.line == BODY.count("\n") + 2
    assert words in str(caught.value)


def test_an_element_in_sections_of_two_materials_is_refused(tmp_path):
    text = BODY + STEEL.replace("Steel", "Iron").replace("ELSET=Eall", "ELSET=EALL")
    refuse(tmp_path, text, "MATERIAL=Iron", "have the material 'Steel' already: 11")


def test_an_element_in_two_sections_of_one_material_is_accepted(tmp_path):
    mesh = read(tmp_path, BODY + "*SOLID SECTION, ELSET=Eall, MATERIAL=steel\n")
    assert mesh.blocks[0].material.tolist() == [0]


def test_a_node_repeated_with_the_same_coordinates_is_one_node(tmp_path):
    assert len(read(tmp_path, BODY + "*NODE, NSET=Tip\n7, 2., 1., 1.\n").points) == 8


def test_a_step_without_an_end_is_refused(tmp_path):
    refuse(tmp_path, BODY + "*STEP\n*STATIC\n", "*STEP", "no *END STEP")


@pytest.mark.parametrize(("text", "missing"), [("", "nodes"), (STEEL, "nodes"), (NODES, "elements")])
def test_a_deck_without_nodes_or_elements_is_refused(tmp_path, text, missing):
    with pytest.raises(MeshError, match=f"defines no {missing}"):
        read(tmp_path, text)


def test_a_missing_deck_is_a_mesh_error(tmp_path):
    with pytest.raises(MeshError, match=r"gone\.inp cannot be read"):
        read_deck(tmp_path / "gone.inp", UnitSystem.SI)


def test_a_binary_file_is_no_deck(tmp_path):
    path = tmp_path / "body.inp"
    path.write_bytes(b"\x7fELF\x00\x01")
    with pytest.raises(MeshError, match="binary data"):
        read_deck(path, UnitSystem.SI)


def test_names_in_an_older_encoding_are_read(tmp_path):
    path = tmp_path / "body.inp"
    path.write_bytes((BODY + "*NSET, NSET=Träger\n1\n").encode("latin-1"))
    assert "Träger" in read_deck(path, UnitSystem.SI).node_sets


def test_elements_that_a_distribution_names_have_its_directions(tmp_path):
    """The others have those of its first row."""
    text = BODY.replace("2.1e11, 0.3", "1e11, 1e10, 1e10, .3, .3, .3, 4e9, 4e9\n4e9").replace(
        "*ELASTIC", "*ELASTIC, TYPE=ENGINEERING CONSTANTS"
    )
    text = text.replace("MATERIAL=Steel", "MATERIAL=Steel, ORIENTATION=O") + "*NODE\n9, 2, 0, 2\n10, 2, 1, 2\n"
    text = "*DISTRIBUTION, NAME=D\n, 1, 0, 0, 0, 1, 0\n11, 0, 0, 1, 1, 0, 0\n*ORIENTATION, NAME=O\nD\n" + text
    text += "*NODE\n21, 0, 0, 2\n22, 0, 1, 2\n*ELEMENT, TYPE=C3D8, ELSET=Eall\n12, 5, 6, 7, 8, 21, 9, 10, 22\n"
    axes = read(tmp_path, text).blocks[0].axes
    np.testing.assert_allclose(axes[0], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(axes[1], np.eye(3), atol=1e-12)
    refuse(tmp_path, text.replace("\nD\n", "\nDX7\n"), "DX7", "distribution 'DX7' is not defined")
