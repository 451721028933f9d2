"""*TRANSFORM, and what decks hold or couple along axes of their own; slips and cards of CalculiX that are forgiven."""

import numpy as np
import pytest

import flexfmu
from decks import BODY, BRICK, NODES, STEEL, read
from flexfmu.files.basics import DeckError

ANGLE = np.radians(30.0)
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE), 0.0], [np.sin(ANGLE), np.cos(ANGLE), 0.0], [0.0, 0.0, 1.0]])
RECTANGULAR = "*TRANSFORM, NSET=Nall, TYPE=R\n" + ", ".join(f"{x:.17g}" for x in TURN.T[:2].ravel()) + "\n"


def turned() -> str:
    """Nodes of the brick, turned about the third axis."""
    lines = NODES.splitlines()
    rows = [[float(text) for text in line.split(",")] for line in lines[1:]]
    places = [f"{row[0]:.0f}, " + ", ".join(f"{x:.17g}" for x in TURN @ row[1:]) for row in rows]
    return "\n".join([lines[0], *places]) + "\n"


def held_frequencies(tmp_path, text):
    mesh = read(tmp_path, text)
    return (
        flexfmu.Body(mesh, None, ["Root"], {"tip": "Tip"})
        .build("linear", modes=4, surface=False)
        .model.angular_frequency
    )


SETS = "*NSET, NSET=Root\n1, 4, 5, 8\n*NSET, NSET=Tip\n2, 3, 6, 7\n"
CARDS = "*BOUNDARY\n2, 2, 2\n*EQUATION\n2\n2, 1, 1., 3, 1, -1.\n"


def test_a_turned_body_with_turned_axes_vibrates_as_the_one_along_the_global_axes(tmp_path):
    straight = held_frequencies(tmp_path, BODY + SETS + CARDS)
    free = held_frequencies(tmp_path, BODY + SETS)
    oblique = held_frequencies(tmp_path, turned() + BRICK + STEEL + SETS + RECTANGULAR + CARDS)
    # Static shapes after the normal modes are of loads along the global axes.
    np.testing.assert_allclose(oblique[:4], straight[:4], rtol=1e-9)
    assert np.abs(free[:4] / straight[:4] - 1.0).max() > 0.01


def test_what_is_held_along_all_axes_or_a_global_one_is_a_support(tmp_path):
    cards = "*TRANSFORM, NSET=Nall, TYPE=C\n0., 0., 0., 0., 0., 1.\n*BOUNDARY\n2, 1, 1\n4, 1, 1\n5, 3, 3\n7, 1, 3\n"
    mesh = read(tmp_path, BODY + cards)
    # Radially: node 2 lies on the first axis, node 4 on the second.
    expected = np.zeros((8, 3), dtype=bool)
    expected[[1, 3, 4], [0, 1, 2]] = expected[6] = True
    np.testing.assert_array_equal(mesh.fixed, expected)
    assert not mesh.equations.shape[0]


def test_what_is_held_along_a_radius_is_an_equation_and_told(tmp_path):
    mesh = read(tmp_path, BODY + "*TRANSFORM, NSET=Nall, TYPE=C\n0., 0., 0., 0., 0., 1.\n*BOUNDARY\n3, 1, 1\n")
    assert mesh.equations.shape[0]
    row = mesh.equations.toarray()[0]
    np.testing.assert_allclose(row / np.linalg.norm(row[6:9]), np.eye(24)[6:8].T @ [2.0, 1.0] / np.sqrt(5.0))
    assert not mesh.fixed.any()
    assert any("1 inclined supports" in note for note in mesh.notes)


@pytest.mark.parametrize("kind", ["S", "X"])
def test_other_systems_are_refused(tmp_path, kind):
    with pytest.raises(DeckError, match=f"SYSTEM={kind}"):
        read(tmp_path, BODY + f"*TRANSFORM, NSET=Nall, TYPE={kind}\n0., 0., 0., 0., 0., 1.\n")


def test_prescribed_motion_and_other_unknowns_hold_nothing_and_are_told(tmp_path):
    mesh = read(tmp_path, BODY + "*BOUNDARY\n1, 1, 1, 0.1\n2, 11, 11\n3, 8, 8\n4, 2\n")
    assert mesh.fixed.sum() == 1
    assert any("1, 1, 1, 0.1" in note for note in mesh.notes)


def test_ties_of_sectors_and_pretension_are_told_and_hold_nothing(tmp_path):
    cards = "*TIE, CYCLIC SYMMETRY, NAME=T\nA, B\n*PRE-TENSION SECTION, SURFACE=A, NODE=1\n1., 0., 0.\n*\n"
    mesh = read(tmp_path, BODY + cards)
    assert any("one sector" in note for note in mesh.notes)
    assert any("*PRE-TENSION SECTION is left unused" in note for note in mesh.notes)
    assert not mesh.equations.shape[0]


def test_a_distributing_coupling_by_an_element_is_offered_as_an_interface(tmp_path):
    cards = "*NODE\n9, 3., .5, .5\n*ELEMENT, TYPE=DCOUP3D, ELSET=C\n12, 9\n*DISTRIBUTING COUPLING, ELSET=C\nTip, 1.\n"
    mesh = read(tmp_path, BODY + SETS + cards)
    name = next(iter(mesh.references))
    np.testing.assert_array_equal(mesh.node_sets[name], [1, 2, 5, 6])
    np.testing.assert_allclose(mesh.references[name], (3.0, 0.5, 0.5))
    assert not mesh.links
