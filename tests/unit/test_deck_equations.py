"""*EQUATION, *MPC and *TIE of decks: what they say, and what is refused."""

import numpy as np
import pytest
import scipy.sparse as sp

from decks import BODY, NODES, STEEL, read, refuse
from flexfmu.fe.assembly import unknowns
from flexfmu.mesh.checks import checked
from flexfmu.mesh.equations import matrix_of, solved, without
from flexfmu.mesh.ties import nearest_faces, weighted

# A second brick beside the first, 0.02 away and a third as high, whose lower face lies on that of the first.
SECOND = """*NODE
21, 0.5, 0.25, 1.02
22, 1.5, 0.25, 1.02
23, 1.5, 0.75, 1.02
24, 0.5, 0.75, 1.02
25, 0.5, 0.25, 1.5
26, 1.5, 0.25, 1.5
27, 1.5, 0.75, 1.5
28, 0.5, 0.75, 1.5
*ELEMENT, TYPE=C3D8, ELSET=Eall
12, 21, 22, 23, 24, 25, 26, 27, 28
*SURFACE, NAME=Main
11, S2
*SURFACE, NAME=Dependent
12, S1
"""
TIE = "*TIE, NAME=Glue, POSITION TOLERANCE=0.1\nDependent, Main\n"


def rows(mesh):
    """Equations by the labels of their nodes and directions, sorted."""
    found = []
    for row in mesh.equations.toarray():
        terms = [(int(mesh.labels[k // 3]), k % 3 + 1, round(float(row[k]), 12)) for k in np.flatnonzero(row)]
        found.append(terms)
    return found


def test_an_equation_is_read_with_all_its_terms_over_lines(tmp_path):
    text = BODY + "*EQUATION\n3\n1, 1, 1., 2, 1, -0.5\n3, 2, -0.5\n2\n4, 3, 1., 5, 3, -1.\n"
    assert rows(read(tmp_path, text)) == [[(1, 1, 1.0), (2, 1, -0.5), (3, 2, -0.5)], [(4, 3, 1.0), (5, 3, -1.0)]]


def test_an_equation_of_sets_stands_for_one_of_each_node(tmp_path):
    text = BODY + "*NSET, NSET=A\n5, 6, 7\n*EQUATION\n2\nA, 2, 1., 1, 2, -2.\n"
    assert rows(read(tmp_path, text)) == [[(1, 2, -2.0), (node, 2, 1.0)] for node in (5, 6, 7)]


@pytest.mark.parametrize(
    ("card", "expected"),
    [
        ("TIE, 1, 2", {1: -1.0, 2: 1.0}),
        ("PIN, 1, 2", {1: -1.0, 2: 1.0}),
        ("LINEAR, 30, 1, 2", {30: -1.0, 1: 0.75, 2: 0.25}),
        ("QUADRATIC, 30, 1, 31, 2", {30: -1.0, 1: 0.375, 31: 0.75, 2: -0.125}),
    ],
)
def test_multi_point_constraints_that_stay_linear_are_equations(tmp_path, card, expected):
    extra = "*NODE\n30, 0.5, 0., 0.\n31, 1., 0., 0.\n"
    found = rows(read(tmp_path, NODES + extra + BODY[len(NODES) :] + f"*MPC\n{card}\n"))
    assert found == [sorted((n, axis, w) for n, w in expected.items()) for axis in (1, 2, 3)]


def test_tied_nodes_are_moved_onto_their_face_and_move_as_its_place_does(tmp_path):
    mesh = read(
        tmp_path, NODES + SECOND + "*ELEMENT, TYPE=C3D8, ELSET=Eall\n11, 1, 2, 3, 4, 5, 6, 7, 8\n" + TIE + STEEL
    )
    row = {int(label): k for k, label in enumerate(mesh.labels)}
    np.testing.assert_allclose(mesh.points[[row[k] for k in (21, 22, 23, 24)], 2], 1.0, atol=1e-15)
    assert any("4 nodes of 'Dependent' are tied to faces of 'Main'; they were moved" in note for note in mesh.notes)
    assert mesh.equations.shape == (12, 48)
    # Any linear displacement meets them.
    linear = np.random.default_rng(0).standard_normal((3, 3))
    np.testing.assert_allclose(mesh.equations @ (mesh.points @ linear).ravel(), 0.0, atol=1e-14)
    found = rows(mesh)[0]
    assert sorted(found) == [(5, 1, 0.5625), (6, 1, 0.1875), (7, 1, 0.0625), (8, 1, 0.1875), (21, 1, -1.0)]


def test_tied_nodes_that_lie_on_their_face_but_for_round_off_are_not_called_moved(tmp_path):
    mesh = read(tmp_path, NODES + SECOND.replace("1.02", "1.0000000000000002") + BODY[len(NODES) :] + TIE)
    assert any(note.endswith("4 nodes of 'Dependent' are tied to faces of 'Main'") for note in mesh.notes)


def test_a_tie_without_adjustment_leaves_nodes_where_they_are_and_says_so(tmp_path):
    text = NODES + SECOND + BODY[len(NODES) :] + TIE.replace("*TIE", "*TIE, ADJUST=NO")
    mesh = read(tmp_path, text)
    assert np.isclose(mesh.points[:, 2], 1.02).sum() == 4
    assert any("ADJUST=NO: the joint resists turning" in note for note in mesh.notes)


def test_nodes_of_no_element_carry_equations_between_others(tmp_path):
    """A dummy node that a face follows makes the face's nodes move alike; held, it holds them."""
    follow = "*NODE\n100, 9., 9., 9.\n*NSET, NSET=A\n5, 6, 7, 8\n*EQUATION\n2\nA, 3, 1., 100, 3, -1.\n"
    free = checked(read(tmp_path, BODY + follow))
    assert len(free.points) == 8
    assert np.linalg.matrix_rank(free.equations.toarray()) == 3
    np.testing.assert_allclose(free.equations @ np.tile([0.0, 0.0, 1.0], 8), 0.0, atol=1e-15)
    held = checked(read(tmp_path, BODY + follow + "*BOUNDARY\n100, 3\n"))
    assert unknowns(held.fixed, held.equations).free.size == 20


def test_equations_that_chain_repeat_and_meet_supports_are_solved_exactly():
    random = np.random.default_rng(1)
    rows = [{0: 1.0, 1: -0.5, 2: -0.5}, {1: 2.0, 4: 1.0}, {2: 1.0, 5: -1.0}, {0: 2.0, 1: -1.0, 2: -1.0}, {6: 3.0}]
    equations = matrix_of(rows, 9)
    dependent, matrix = solved(equations)
    assert dependent.size == 4
    assert not np.isin(matrix.indices, dependent).any()
    fixed = np.zeros((3, 3), dtype=bool)
    fixed[2, 2] = True
    unknown = unknowns(fixed, equations)
    moved = unknown.whole(random.standard_normal((unknown.free.size, 2)))
    np.testing.assert_allclose(equations @ moved, 0.0, atol=1e-15)
    assert unknown.free.size == 9 - 4 - 1
    assert not moved[8].any()


def test_eliminating_an_unknown_keeps_what_equations_say_of_the_others():
    equations = matrix_of([{0: 1.0, 3: -1.0}, {1: 1.0, 3: -2.0}, {2: 1.0, 3: 0.5}], 4)
    left = without(equations, np.array([False, False, False, True]))
    assert left.shape == (2, 4)
    np.testing.assert_allclose(left @ np.array([1.0, 2.0, -0.5, 0.0]), 0.0, atol=1e-15)
    assert sp.csr_array(left)[:, 3].nnz == 0


@pytest.mark.parametrize(
    ("card", "culprit", "words"),
    [
        ("*EQUATION\n12\n1, 1, 1.\n", "12", "ends after 1"),
        ("*EQUATION\n2\n1, 1, 1., 2, 1, 1., 3\n", "1, 1, 1., 2, 1, 1., 3", "7 entries, expected 6"),
        ("*EQUATION\n2\n1, 4, 1., 2, 1, 1.\n", "1, 4, 1., 2, 1, 1.", "between rotations"),
        ("*EQUATION\n2\n1, 1, 1., 99, 1, 1.\n", "1, 1, 1., 99, 1, 1.", "99 is not defined"),
        ("*EQUATION\n1., 2.\n", "1., 2.", "whole number"),
        ("*MPC\nBEAM, 1, 2\n", "BEAM, 1, 2", "no linear constraint"),
        ("*MPC\nMEANROT, 1, 1, 1, 2, 2, 2, 5\n", "MEANROT", "held or belongs to elements"),
        ("*MPC\nPLANE, 1, 2, 3, 4\n", "PLANE, 1, 2, 3, 4", "not supported"),
        ("*MPC\nLINEAR, 1, 2\n", "LINEAR, 1, 2", "takes 3 nodes, found 2"),
        ("*MPC\nLINEAR, 1, 2, 2\n", "LINEAR, 1, 2, 2", "in one place"),
        ("*TIE, NAME=T\nA, B\n", "*TIE", "surface 'A' is not defined"),
        ("*TIE, NAME=T\nLone\n", "Lone", "found 1 names"),
    ],
)
def test_what_is_no_linear_constraint_of_translations_is_refused_at_its_line(tmp_path, card, culprit, words):
    refuse(tmp_path, BODY + card, culprit, words)


def test_a_mean_rotation_whose_node_is_free_holds_nothing_and_is_told(tmp_path):
    mesh = read(tmp_path, BODY + "*NODE\n9, 0., 0., 1.\n*MPC\nMEANROT, 1, 1, 1, 2, 2, 2, 9\n")
    assert not mesh.equations.shape[0]
    assert any("MEANROT is left to an interface" in note for note in mesh.notes)


def test_a_tie_that_reaches_no_node_is_refused(tmp_path):
    refuse(
        tmp_path,
        NODES + SECOND + BODY[len(NODES) :] + TIE.replace("0.1", "0.001"),
        "Dependent, Main",
        "parts stay apart",
    )


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
@pytest.mark.parametrize(
    ("place", "weights"),
    [
        ((0.05, 0.5, 0.02), {0: 0.475, 1: 0.025, 2: 0.025, 3: 0.475}),
        ((0.02, 0.5, 0.05), {0: 0.475, 3: 0.475, 4: 0.025, 5: 0.025}),
    ],
)
def test_a_node_near_two_faces_is_tied_to_the_nearer_one(place, weights, order):
    # A floor and a wall that meet in the edge from node 0 to node 3.
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), place])
    faces = np.array([(0, 1, 2, 3), (0, 3, 4, 5)])[order]
    for blocks in ([faces], [faces[:1], faces[1:]]):
        found = nearest_faces(points, np.array([6]), blocks, 0.1)
        assert {node: weighted(*one) for node, one in found.items()} == {6: pytest.approx(weights)}
