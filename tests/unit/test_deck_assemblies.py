"""Decks of parts and instances, as Abaqus/CAE writes them; faces and names of other elements; materials left open."""

import re

import numpy as np
import pytest

from decks import ASSEMBLY, BODY, BRICK, CAE, COUPLING, MATERIAL, NODES, PART, STEEL, line_of, read, refuse, set_labels
from flexfmu.api import Body
from flexfmu.build.config import BodySpec
from flexfmu.files.basics import BodyFileError, DeckError, UnitSystem
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.mesh.elements import ElementType
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.options import node_set


def test_instances_are_moved_and_then_turned_about_their_axis(tmp_path):
    mesh = read(tmp_path, CAE)
    first, second = mesh.points[:8], mesh.points[8:16]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(second, first @ turn.T + [10.0, 0.0, 0.0], atol=1e-12)
    assert [block.labels.tolist() for block in mesh.blocks] == [[11, 111]]
    assert mesh.labels.tolist() == [*range(1, 9), *range(101, 109), 201]
    assert mesh.blocks[0].material.tolist() == [0, 0]


def test_sets_of_instances_carry_their_name_and_those_of_the_assembly_do_not(tmp_path):
    mesh = read(tmp_path, CAE)
    assert set_labels(mesh, "Bar-1.Root") == [1, 2, 3, 4]
    assert set_labels(mesh, "Bar-2.Root") == [101, 102, 103, 104]
    assert set_labels(mesh, "Both") == [1, 2, 3, 4, 105, 106]
    assert set_labels(mesh, "Face") == [101, 102, 103, 104]
    assert set_labels(mesh, "Bar-2.Top") == [105, 106, 107, 108]
    assert set_labels(mesh, "Point") == [201]
    assert mesh.element_sets["Bar-2.Solid"].tolist() == [1]


def test_a_set_is_found_without_its_instance_where_one_only_has_it(tmp_path):
    mesh = read(tmp_path, CAE)
    with pytest.raises(BodyFileError, match=r"several node sets: Bar-1\.Root, Bar-2\.Root"):
        node_set(mesh, "Root", "nodes")
    single = CAE.replace(ASSEMBLY, "*Assembly, name=A\n*Instance, name=Bar-1, part=Bar\n*End Instance\n*End Assembly\n")
    assert node_set(read(tmp_path, single), "root", "nodes").tolist() == [0, 1, 2, 3]


def test_supports_of_the_model_name_instances_and_their_numbers(tmp_path):
    mesh = read(tmp_path, CAE + "*Boundary\nBar-1.Root, 1, 3\nBar-2.8, 2\nBoth, 3\n")
    assert mesh.labels[mesh.fixed[:, 0]].tolist() == [1, 2, 3, 4]
    assert mesh.labels[mesh.fixed[:, 1]].tolist() == [1, 2, 3, 4, 108]


def test_meshes_may_stand_in_the_instance_and_parts_without_one_are_told(tmp_path):
    spare = PART.replace("name=Bar", "name=Spare")
    moved = PART.split("\n", 1)[1].replace("*End Part\n", "")
    text = "*Part, name=Bar\n*End Part\n" + spare + MATERIAL
    text += f"*Assembly, name=A\n*Instance, name=I, part=Bar\n0., 0., 3.\n{moved}*End Instance\n*End Assembly\n"
    mesh = read(tmp_path, text)
    assert mesh.points[0].tolist() == [0.0, 0.0, 3.0]
    assert any("part 'Spare' has no *INSTANCE" in note for note in mesh.notes)


@pytest.mark.parametrize(
    ("before", "after", "culprit", "words"),
    [
        ("*End Part\n", "", "*Part", "no *END PART"),
        ("*End Assembly\n", "", "*Assembly", "no *END ASSEMBLY"),
        ("name=Bar-2, part=Bar", "name=Bar-2, part=Bat", "name=Bar-2", "part 'Bat' is not defined (known: Bar)"),
        ("name=Bar-2, part=Bar", "name=bar-1, part=Bar", "name=bar-1", "defined again"),
        ("10., 0., 0., 10., 0., 1., 90.", "10., 0., 0., 10., 0., 0., 90.", "name=Bar-2", "two equal points"),
        ("10., 0., 0., 10., 0., 1., 90.", "1., 2.", "name=Bar-2", "up to two rows"),
        ("internal, instance=Bar-2", "internal, instance=Bar-3", "instance=Bar-3", "no instance 'Bar-3'"),
        (PART, "*End Part\n" + PART, "*End Part", "outside"),
    ],
)
def test_a_malformed_assembly_is_refused_at_its_line(tmp_path, before, after, culprit, words):
    refuse(tmp_path, CAE.replace(before, after, 1), culprit, words)


def test_the_only_part_of_a_whole_deck_stands_as_it_is(tmp_path):
    """Materials follow the assembly: without them the deck was cut short."""
    alone = CAE.replace(ASSEMBLY, "", 1)
    mesh = read(tmp_path, alone)
    assert mesh.element_count == read(tmp_path, CAE).element_count // 2
    assert "there is no *ASSEMBLY: the only part stands as it is" in mesh.notes
    refuse(tmp_path, alone.split("*Material")[0], "*Part", "cut short?")
    twice = alone.replace("*Material", PART.replace("name=Bar", "name=Bat") + "*Material", 1)
    refuse(tmp_path, twice, "*Part", "cut short?")


def test_faces_without_a_section_serve_sets(tmp_path):
    faces = "*ELEMENT, TYPE=CPS4, ELSET=Surface1\n21, 1, 2, 3, 4\n*ELEMENT, TYPE=T3D2, ELSET=Line1\n31, 1, 2\n"
    mesh = read(tmp_path, NODES + faces + BRICK + STEEL + "*NSET, NSET=Named, ELSET=Surface1\n")
    assert set_labels(mesh, "Surface1") == set_labels(mesh, "Named") == [1, 2, 3, 4]
    assert set_labels(mesh, "Line1") == [1, 2]
    assert list(mesh.element_sets) == ["Eall"]
    assert any("2 elements of type CPS4, T3D2 without a section are no solids" in note for note in mesh.notes)


def test_membranes_beside_solids_are_refused_instead_of_lost(tmp_path):
    section = "*MEMBRANE SECTION, ELSET=Skin"
    refuse(tmp_path, BODY + "*ELEMENT, TYPE=S4, ELSET=Skin\n21, 1, 2, 3, 4\n" + section, section.split(",")[0], "shell")


def test_bars_of_a_solid_section_are_refused_instead_of_lost(tmp_path):
    text = BODY + "*ELEMENT, TYPE=T2D2, ELSET=Rod\n21, 1, 2\n*SOLID SECTION, ELSET=Rod, MATERIAL=Steel\n1.\n"
    refuse(tmp_path, text, "*SOLID SECTION, ELSET=Rod", "T3D2", "T2D2")


@pytest.mark.parametrize(
    ("name", "kind"),
    [("C3D8R", "C3D8I"), ("C3D8RH", "C3D8I"), ("C3D8H", "C3D8"), ("C3D8IH", "C3D8I"), ("C3D8T", "C3D8")],
)
def test_other_names_are_read_as_an_element_of_small_strains_with_a_note(tmp_path, name, kind):
    mesh = read(tmp_path, BODY.replace("C3D8", name))
    assert mesh.blocks[0].type is ElementType(kind)
    assert any(f"elements of type {name} are read as {kind}" in note for note in mesh.notes)


def completed(body, **tables):
    spec = BodySpec.model_validate(
        {"name": "b", "interface": [{"name": "tip", "nodes": {"plane": [2.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}}],
         "support": [{"nodes": {"numbers": [1, 4, 5, 8]}, "fix": ["x", "y", "z"]}], **tables}
    )  # fmt: skip
    return assemble_model(checked(body), spec.options)


def test_a_body_file_completes_and_replaces_what_a_deck_says_of_materials(tmp_path):
    without = read(tmp_path, BODY.replace("*DENSITY\n7850.\n", ""))
    with pytest.raises(BodyFileError, match=r"does not tell density of the material 'Steel'.*kg/m³"):
        completed(without)
    assert completed(without, material={"density": 8000.0}).mesh.materials[0].density == 8000.0
    named = {"name": "STEEL", "youngs_modulus": 7e10}
    steel = completed(read(tmp_path, BODY), material=named).mesh.materials[0]
    assert (steel.youngs_modulus, steel.poissons_ratio, steel.density) == (7e10, 0.3, 7850.0)
    with pytest.raises(BodyFileError, match="'brass': the mesh file names no such material; it has: Steel"):
        completed(read(tmp_path, BODY), material=[{"name": "brass", "density": 1.0}])
    undefined = BODY[: BODY.index("*MATERIAL")] + "*SOLID SECTION, ELSET=Eall, MATERIAL=Steel\n"
    constants = {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 7850.0}
    assert completed(read(tmp_path, undefined), material=constants).mesh.materials[0].name == "Steel"


def test_the_supports_of_a_deck_can_be_left_out(tmp_path):
    mesh = read(tmp_path, BODY + "*BOUNDARY\n7, 1, 3\n")
    assert completed(mesh).fixed[6].all()
    assert not completed(mesh, mesh={"boundary": False}).fixed[6].any()


def test_cards_that_do_not_bear_on_the_body_are_passed_over_with_a_note(tmp_path):
    text = BODY + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNall, 20.\n*PLASTIC\n2e8, 0.\n"
    notes = read(tmp_path, text).notes
    assert [f"line {line_of(text, card)}: {card} is left unused" in note for card, note in
            zip(("*INITIAL CONDITIONS", "*PLASTIC"), notes, strict=True)] == [True, True]  # fmt: skip


def test_a_range_mistyped_by_many_digits_does_not_hang(tmp_path):
    text = BODY + "*NSET, NSET=Tail, GENERATE\n7, 1200000000000\n"
    assert set_labels(read(tmp_path, text), "Tail") == [7, 8]
    with pytest.raises(DeckError, match="whole number"):
        read(tmp_path, BODY + "*NSET, NSET=A\n+-5\n")


def test_an_assembly_becomes_a_body(tmp_path):
    single = CAE.replace(ASSEMBLY, "*Assembly, name=A\n*Instance, name=Bar-1, part=Bar\n*End Instance\n*End Assembly\n")
    path = tmp_path / "cae.inp"
    path.write_text(single)
    body = Body(
        read_deck(path, UnitSystem.SI),
        supports=[{"plane": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}],
        interfaces={"tip": "Top"},
    )
    assert body.build(modes=3).model.properties.mass == pytest.approx(7850.0 * 2.0)


def test_a_coupling_is_an_interface_under_its_names_at_its_reference_node(tmp_path):
    mesh = read(tmp_path, BODY + COUPLING)
    assert set_labels(mesh, "Flange") == set_labels(mesh, "RP") == [2, 3, 6, 7]
    spec = BodySpec.model_validate({"name": "b", "interface": [{"name": "tip", "nodes": "flange"}]})
    moved = read(tmp_path, BODY + COUPLING.replace("100, 2.,", "100, 3.,"))
    for body, x in ((mesh, 2.0), (moved, 3.0)):
        body = checked(body)
        assert not any("no element uses" in note for note in body.notes)
        interface = fit_interface(spec.options.interfaces[0], body, ())
        np.testing.assert_allclose(interface.point, [x, 0.5, 0.5])
    assert any(note.endswith("; its nodes are rigid") for note in mesh.notes)


def test_a_rigid_body_whose_reference_node_is_held_is_a_support(tmp_path):
    rigid = (
        COUPLING[: COUPLING.index("*COUPLING")] + "*NSET, NSET=Face\n2, 3, 6, 7\n*RIGID BODY, NSET=Face, REF NODE=100\n"
    )
    mesh = read(tmp_path, BODY + rigid + "*BOUNDARY\nRP, 1, 6\n")
    assert mesh.labels[mesh.fixed.all(axis=1)].tolist() == [2, 3, 6, 7, 100]
    # It is no node that was forgotten.
    assert not any("no element uses" in note for note in checked(mesh).notes)
    partly = read(tmp_path, BODY + rigid + "*BOUNDARY\nRP, 1, 3\nRP, 6, 6\n")
    assert not partly.fixed.any()
    assert partly.equations.shape[0] == 3
    assert any("is left out: hold the nodes with a [[support]]" in note for note in partly.notes)


POINT = COUPLING[: COUPLING.index("*COUPLING")] + "*NSET, NSET=Face\n2, 3, 6, 7\n"


@pytest.mark.parametrize(
    ("cards", "words", "labels"),
    [
        ("*COUPLING, REF NODE=100, SURFACE=End, INFLUENCE RADIUS=0.8\n*KINEMATIC", "are rigid", [2, 3, 6, 7]),
        ("*COUPLING, REF NODE=8, SURFACE=End, INFLUENCE RADIUS=2.1\n*KINEMATIC", "are rigid", [7]),
        ("*COUPLING, REF NODE=100, SURFACE=End\n*KINEMATIC\n1, 2", "rigid in some directions", [2, 3, 6, 7]),
        ("*COUPLING, REF NODE=100, SURFACE=End\n*DISTRIBUTING, WEIGHTING METHOD=LINEAR", "weights", [2, 3, 6, 7]),
        ("*KINEMATIC COUPLING, REF NODE=100\nFace, 1, 1\nFace, 2, 3", "are rigid", [2, 3, 6, 7]),
        ("*KINEMATIC COUPLING, REF NODE=100\n2, 1, 1\n3, 2, 3", "rigid in some directions", [2, 3]),
        ("*RIGID BODY, NSET=Face, PIN NSET=Root, REF NODE=100\n*NSET, NSET=Root\n1, 4", "rigid", [1, 2, 3, 4, 6, 7]),
        ("*RIGID BODY, NSET=Face", "are rigid", [3, 6, 7]),
    ],
)
def test_what_a_coupling_says_of_nodes_directions_and_weights_is_honoured_or_told(tmp_path, cards, words, labels):
    mesh = read(tmp_path, BODY + POINT + cards + "\n")
    name = next(iter(mesh.references))
    assert [label for label in set_labels(mesh, name) if label < 100] == labels
    assert any(re.search(words, note) for note in mesh.notes if "offered" in note)
    assert bool(mesh.links) == ("rigid" in words and "some" not in words)


@pytest.mark.parametrize(
    ("cards", "culprit", "words"),
    [
        (
            "*COUPLING, REF NODE=100, SURFACE=End\n*DISTRIBUTING\n*EQUATION\n2\n100, 1, 1., 1, 1, -1.",
            "*COUPLING",
            "lost",
        ),
        ("*COUPLING, REF NODE=1, SURFACE=End\n*DISTRIBUTING", "*COUPLING", "would be lost"),
        ("*RIGID BODY, NSET=Face, REF NODE=100, POSITION=CENTER OF MASS", "*RIGID", "centre of mass"),
        ("*COUPLING, REF NODE=100, SURFACE=End, INFLUENCE RADIUS=0.1\n*KINEMATIC", "*COUPLING", "no node"),
        ("*NSET, NSET=P, UNSORTED\n3, 2\n*EQUATION\n2\nP, 1, 1., 1, 1, -1.", "P, 1", "UNSORTED"),
        ("*TRANSFORM, NSET=Nall, TYPE=C\n0., 0., 0., 0., 0., 1.\n*BOUNDARY\n1, 1, 1", "*TRANSFORM", "lies on the axis"),
    ],
)
def test_what_would_be_lost_of_couplings_sets_and_axes_is_refused_at_its_line(tmp_path, cards, culprit, words):
    refuse(tmp_path, BODY + POINT + cards + "\n", culprit, words)


@pytest.mark.parametrize(
    "cards", ["*BOUNDARY\n100, 1, 3\n", "*EQUATION\n1\n100, 1, 1.\n1\n100, 2, 1.\n1\n100, 3, 1.\n"]
)
def test_what_holds_the_reference_node_of_a_rigid_body_holds_the_body_there(tmp_path, cards):
    """As at a node of it in the same place."""
    rigid = POINT.replace("100, 2., 0.5, 0.5", "100, 2., 0., 0.") + "*RIGID BODY, NSET=Face, REF NODE=100\n"
    held = [read(tmp_path, BODY + rigid + one) for one in (cards, "*BOUNDARY\n2, 1, 3\n")]
    found, expected = (
        Body(mesh, None, [{"plane": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}], {"tip": "Face"})
        .build("linear", modes=3, surface=False)
        .model.angular_frequency[:3]
        for mesh in held
    )
    np.testing.assert_allclose(found, expected, rtol=3e-4)


def test_rotations_held_at_the_rotation_node_of_a_rigid_body_are_held(tmp_path):
    rigid = POINT + "*NODE\n101, 2., 0., 0.\n*RIGID BODY, NSET=Face, REF NODE=100, ROT NODE=101\n*BOUNDARY\n"
    mesh = read(tmp_path, BODY + rigid + "100, 1, 3\n101, 1, 3\n")
    assert mesh.labels[mesh.fixed.all(axis=1)].tolist() == [2, 3, 6, 7, 100, 101]


def test_two_couplings_of_one_reference_node_are_refused_instead_of_lost(tmp_path):
    second = "*SURFACE, NAME=Root\n11, S6\n*COUPLING, REF NODE=100, SURFACE=Root\n*DISTRIBUTING\n"
    refuse(tmp_path, BODY + COUPLING + second, "SURFACE=Root", "line 24", "one of them lets its nodes deform")
