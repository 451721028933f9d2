"""Automatic division: the tree follows the body, and the answer converges with the number of frames."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import BodyFileError, MeshError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementBlock, ElementType
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import GROUND
from flexfmu.reduction.division import distance_along, divide, divide_branches
from flexfmu.reduction.subdomains import division_warnings
from meshes import EVERY_TYPE, arc, bars, body_file, box, grid, lattice, renumbered, with_sets
from references import relative

pytestmark = pytest.mark.slow

BRICK = ElementType.C3D20R
EVERY = pytest.mark.parametrize("kind", EVERY_TYPE, ids=lambda kind: kind.name)


def divided(mesh, levels):
    return divide(mesh, mesh.node_sets["ROOT"], levels)


def fork(kind, width=0.1):
    """Stem along x, a cross bar along y at its end, and a prong along x at each end of that; two cells thick."""
    runs = [((0, 0, 0), (7, 1, 1)), ((6, -6, 0), (7, 7, 1)), ((8, -6, 0), (15, -5, 1)), ((8, 6, 0), (15, 7, 1))]
    return with_sets(bars(kind, runs, width), ROOT=lambda p: p[:, 0])


def chessboard():
    """Bricks on a solid foot that only edges join to each other."""
    cells = np.array([c for c in grid(8, 3, 3) if c[0] == 0 or c.sum() % 2 == 0])
    return with_sets(lattice(ElementType.C3D8, cells, lambda p: 0.01 * p), ROOT=lambda p: p[:, 0])


def bricks_and_tetrahedra():
    """A bar whose two middle bricks are six tetrahedra each: faces of theirs are halves of those beside them."""
    mesh = box(ElementType.C3D8, (6, 1, 1), (0.6, 0.1, 0.1))
    (block,) = mesh.blocks
    order = np.argsort(mesh.points[block.connectivity].mean(axis=1)[:, 0])
    bricks, cut = block.connectivity[order[[0, 1, 4, 5]]], block.connectivity[order[2:4]]
    six = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
    own = replace(block, labels=np.arange(4), connectivity=bricks, material=block.material[:4])
    tetrahedra = ElementBlock(ElementType.C3D4, np.arange(4, 16), cut[:, six].reshape(-1, 4), np.zeros(12, np.int64))
    return checked(replace(mesh, blocks=(own, tetrahedra), element_sets={}))


def portal(kind, bays):
    """Feet at y = 0 under a beam; every bay closes a loop through the ground."""
    feet = [14 * k for k in range(bays + 1)]
    runs = [((x, 0, 0), (x + 1, 13, 1)) for x in feet] + [((0, 12, 0), (feet[-1] + 1, 13, 1))]
    return with_sets(bars(kind, runs, 0.1), ROOT=lambda p: p[:, 1])


def window(kind):
    """Closed ring, out of the middle at its far side, on a stem held at x = 0."""
    stem = [((0, 6, 0), (3, 7, 1))]
    ring = [((4, 0, 0), (5, 13, 1)), ((16, 0, 0), (17, 13, 1)), ((4, 0, 0), (17, 1, 1)), ((4, 12, 0), (17, 13, 1))]
    return with_sets(bars(kind, stem + ring, 0.1), ROOT=lambda p: p[:, 0])


@pytest.mark.parametrize("made", [chessboard, bricks_and_tetrahedra])
def test_what_hangs_together_by_edges_or_by_halves_of_faces_is_a_chain_of_pieces_that_touch(made):
    mesh = made()
    found = divided(mesh, 3).subdomains
    assert [one.parent for one in found] == [GROUND, 0, 1]
    for one in found[1:]:
        assert np.intersect1d(one.body.nodes, found[one.parent].body.nodes).size >= 4


BODIES = {
    "bar": lambda kind: box(kind, (12, 2, 2), (1.2, 0.2, 0.2)),
    "arc": lambda kind: arc(kind, (12, 2, 2), 1.0, 0.1),
    "fork": fork,
    "portal": lambda kind: portal(kind, 1),
    "window": window,
}


def depth_in_tree(division):
    result = []
    for domain in division.subdomains:
        result.append(0 if domain.parent == GROUND else result[domain.parent] + 1)
    return result


def children(division):
    parents = [domain.parent for domain in division.subdomains]
    return [parents.count(s) for s in range(len(parents))]


def test_elements_in_no_frame_or_in_two_are_counted_and_no_others_told_of():
    mesh = BODIES["bar"](BRICK)
    frames = divided(mesh, 3).subdomains
    assert division_warnings(mesh, frames) == ()
    assert division_warnings(mesh, frames[:2]) == ("16 elements are in no frame",)
    (told,) = division_warnings(mesh, [*frames, frames[1]])
    assert told.startswith("16 elements are in more than one frame")


@EVERY
@pytest.mark.parametrize("levels", [1, 2, 3, 4, 6])
def test_a_straight_bar_becomes_a_chain_of_equal_pieces(kind, levels):
    length = 1.2
    division = divided(box(kind, (12, 2, 2), (length, 0.2, 0.2)), levels)
    assert [domain.parent for domain in division.subdomains] == list(range(-1, levels - 1))
    assert len({domain.elements.size for domain in division.subdomains}) == 1
    joints = np.array([domain.joint_point for domain in division.subdomains])
    expected = np.column_stack([length * np.arange(levels) / levels, np.full((levels, 2), 0.1)])
    np.testing.assert_allclose(joints, expected, atol=1e-9)
    assert division.cuts == ()


@pytest.mark.parametrize("length", [1.2, 0.7, 1.3, 3.7, 120.0])
def test_round_off_does_not_decide_where_an_element_lies_in_the_middle_of_two_levels(length):
    # Twelve layers of elements in eight levels: the middle of every third layer lies on a boundary.
    for kind in (ElementType.C3D8, BRICK):
        division = divided(box(kind, (12, 2, 2), (length, 0.1, 0.1)), 8)
        assert [domain.elements.size for domain in division.subdomains] == [4, 8] * 4


@EVERY
def test_an_arc_becomes_a_chain_along_the_arc(kind):
    division = divided(arc(kind, (24, 2, 2), 1.0, 0.05), 4)
    assert [domain.parent for domain in division.subdomains] == [-1, 0, 1, 2]
    joints = np.array([domain.joint_point for domain in division.subdomains])
    turn = np.arctan2(joints[:, 1], joints[:, 0])
    np.testing.assert_allclose(turn, np.arange(4) * np.pi / 8.0, atol=0.05)
    np.testing.assert_allclose(np.linalg.norm(joints, axis=1), 1.0, atol=0.02)


@EVERY
@pytest.mark.parametrize("levels", [4, 8])
def test_branches_of_a_body_become_branches_of_the_tree(kind, levels):
    mesh = fork(kind)
    division = divided(mesh, levels)
    assert division.cuts == ()
    # One piece has two children, two have none: the prongs' ends; every other one hands on.
    count = children(division)
    assert sorted(set(count)) == [0, 1, 2]
    assert (count.count(2), count.count(0)) == (1, 2)
    assert sum(domain.parent == GROUND for domain in division.subdomains) == 1
    # Each prong's pieces hang on pieces of the same side.
    beyond = 0
    for domain in division.subdomains:
        middle = domain.body.centre(mesh.points)
        if middle[0] > 1.0:
            parent = division.subdomains[domain.parent].body.centre(mesh.points)
            # The cross bar may be the parent of both, never the other prong.
            assert (parent[1] - 0.1) * (middle[1] - 0.1) > 0.0 or abs(parent[1] - 0.1) < 0.05
            beyond += abs(parent[1] - 0.1) > 0.2
    assert beyond >= 2
    ends = [domain.body.centre(mesh.points)[1] for domain, c in zip(division.subdomains, count, strict=True) if c == 0]
    np.testing.assert_allclose(np.sort(ends), [-0.5, 0.7], atol=0.02)


@EVERY
def test_ragged_boundaries_of_a_level_leave_no_odd_elements(kind):
    division = divided(fork(kind), 8)
    assert len(division.subdomains) == 12
    cell = 6 if kind in (ElementType.C3D4, ElementType.C3D10) else 1
    assert min(domain.elements.size for domain in division.subdomains) >= 6 * cell


@EVERY
@pytest.mark.parametrize(("bays", "levels"), [(1, 2), (1, 4), (1, 8), (2, 4), (3, 8)])
def test_every_loop_through_the_ground_is_cut_once(kind, bays, levels):
    if kind is ElementType.C3D10 and bays > 1:
        kind = ElementType.C3D8
    division = divided(portal(kind, bays), levels)
    assert sum(domain.parent == GROUND for domain in division.subdomains) == bays + 1
    assert len(division.cuts) == bays


@EVERY
@pytest.mark.parametrize("levels", [4, 8])
def test_a_closed_ring_is_cut_once(kind, levels):
    division = divided(window(kind), levels)
    assert sum(domain.parent == GROUND for domain in division.subdomains) == 1
    assert len(division.cuts) == 1


def test_a_cut_tells_the_frames_and_the_place():
    mesh = portal(BRICK, 1)
    division = divided(mesh, 2)
    # The piece across the top hangs on the left foot and is cut from the right one.
    assert division.cuts == ("closed loop cut between frames frame_2 and frame_3 at (1.5, 0.9, 0.1) m",)
    assert [domain.parent for domain in division.subdomains] == [GROUND, GROUND, 0]
    np.testing.assert_allclose(division.subdomains[2].joint_point, [0.1, 0.9, 0.1], atol=1e-9)


def test_one_level_takes_a_closed_body_whole_and_cuts_nothing():
    division = divided(portal(BRICK, 1), 1)
    assert len(division.subdomains) == 1
    assert division.cuts == ()


def test_a_thin_end_of_the_body_that_is_a_sliver_of_a_level_joins_its_neighbour():
    # Twelve layers of 0.25 m and one of 0.05 m, alone in the last of twenty levels of 0.15 m.
    ends = np.array([*np.arange(13) * 0.25, 3.05])
    cells = [(i, 0, 0) for i in range(13)]
    mesh = lattice(ElementType.C3D8, cells, lambda p: np.column_stack([np.interp(p[:, 0], range(14), ends), p[:, 1:]]))
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0])
    assert (ends[11] + ends[12]) / 2.0 < 3.05 * 19.0 / 20.0 < (ends[12] + ends[13]) / 2.0
    assert [domain.elements.size for domain in divided(mesh, 20).subdomains] == [1] * 11 + [2]


@EVERY
@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("levels", [1, 3, 7])
def test_pieces_are_connected_share_out_all_elements_and_meet_at_their_joints(kind, name, levels):
    mesh = BODIES[name](kind)
    division = divided(mesh, levels)
    (block,) = mesh.blocks
    everything = np.concatenate([domain.elements for domain in division.subdomains])
    np.testing.assert_array_equal(np.sort(everything), np.arange(mesh.element_count))
    corners = 3 if kind in (ElementType.C3D4, ElementType.C3D10) else 4
    for domain in division.subdomains:
        nodes = np.unique(block.connectivity[domain.elements])
        np.testing.assert_array_equal(domain.body.nodes, nodes)
        part = block.connectivity[domain.elements]
        rows = np.repeat(np.arange(len(part)), part.shape[1])
        hold = coo_array((np.ones(rows.size), (rows, part.ravel())), shape=(len(part), len(mesh.points))).tocsr()
        # Elements that share a face share its corners at least.
        count, _ = connected_components((hold @ hold.T) >= corners, directed=False)
        assert count == 1
        beyond = mesh.node_sets["ROOT"]
        if domain.parent != GROUND:
            beyond = division.subdomains[domain.parent].body.nodes
        np.testing.assert_array_equal(domain.joint.nodes, np.intersect1d(nodes, beyond))
        assert domain.joint.nodes.size >= corners
    order = [domain.parent for domain in division.subdomains]
    assert all(parent < s for s, parent in enumerate(order))


@EVERY
@pytest.mark.parametrize("name", BODIES)
def test_division_does_not_depend_on_the_numbering_of_nodes_and_elements(kind, name, random):
    mesh = BODIES[name](kind)
    one = divided(mesh, 5)
    for _ in range(2):
        other, old = renumbered(mesh, random)
        two = divided(other, 5)
        assert two.cuts == one.cuts
        for left, right in zip(one.subdomains, two.subdomains, strict=True):
            assert (left.name, left.parent) == (right.name, right.parent)
            np.testing.assert_array_equal(left.body.nodes, np.sort(old[right.body.nodes]))
            np.testing.assert_array_equal(left.joint.nodes, np.sort(old[right.joint.nodes]))
            np.testing.assert_allclose(left.joint_point, right.joint_point, atol=1e-12)


def branched(mesh, *branches):
    found = [(name, mesh.node_sets[name], joints) for name, joints in branches]
    return divide_branches(mesh, mesh.node_sets["ROOT"], found)


@EVERY
def test_joints_at_equal_distances_are_the_equal_levels(kind):
    mesh = box(kind, (12, 2, 2), (1.2, 0.2, 0.2))
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0], TIP=lambda p: p[:, 0] - 1.2)
    one, two = divided(mesh, 3), branched(mesh, ("TIP", (0.4, 0.8)))
    for left, right in zip(one.subdomains, two.subdomains, strict=True):
        np.testing.assert_array_equal(left.elements, right.elements)
        assert left.parent == right.parent


def test_a_joint_of_one_branch_leaves_the_others_whole():
    mesh = slender_fork()
    # The stem ends at 0.48 m; from there the prongs go 0.2 m across and 0.48 m on.
    split = branched(mesh, ("LEFT", (0.55, 0.9)))
    assert [domain.parent for domain in split.subdomains] == [GROUND, 0, 1]
    places = [domain.body.centre(mesh.points)[1] for domain in split.subdomains]
    assert places[0] > places[1] > places[2]
    assert all(domain.joint_point[1] < -0.02 for domain in split.subdomains[1:])
    both = branched(mesh, ("LEFT", (0.2, 0.6)), ("RIGHT", (0.2, 0.9)))
    # The joint in the stem is that of both.
    assert [domain.parent for domain in both.subdomains] == [GROUND, 0, 1, 1]
    assert both.cuts == ()


def test_a_joint_beyond_the_end_of_its_branch_is_refused():
    with pytest.raises(BodyFileError, match=r"toward 'LEFT': a joint at 5 m .* where the branch ends at 1\.\d+ m"):
        branched(slender_fork(), ("LEFT", (5.0,)))


def test_the_distance_follows_the_body_and_not_the_air():
    mesh = fork(ElementType.C3D8)
    distance = distance_along(mesh, mesh.node_sets["ROOT"])
    tips = np.abs(mesh.points[:, 0] - mesh.points[:, 0].max()) < 1e-9
    straight = np.linalg.norm(mesh.points[tips] - [0.0, 0.1, 0.1], axis=1)
    assert np.all(distance[tips] > 1.1 * straight)
    np.testing.assert_allclose(distance[mesh.node_sets["ROOT"]], 0.0)


@pytest.mark.parametrize("kind", [ElementType.C3D6, ElementType.C3D4], ids=lambda kind: kind.name)
def test_levels_are_no_thinner_than_rows_of_elements(kind):
    """Wedges of a row that point up and down would be a frame each."""
    mesh = with_sets(box(kind, (5, 7, 1), (5.0, 7.0, 0.5)), ROOT=lambda p: p[:, 0])
    assert [len(divided(mesh, levels).subdomains) for levels in (3, 5, 6, 16)] == [3, 5, 5, 5]


def test_levels_of_bricks_may_be_thinner_than_their_diagonal():
    """From a corner of a plate each brick reaches further than its rows are apart."""
    mesh = with_sets(box(ElementType.C3D8, (6, 6, 1), (6.0, 6.0, 0.5)), ROOT=lambda p: p[:, 0] + p[:, 1])
    assert len(divided(mesh, 8).subdomains) > len(divided(mesh, 6).subdomains)


def test_a_body_without_supports_cannot_be_divided():
    mesh = box(ElementType.C3D8, (2, 1, 1), (2.0, 1.0, 1.0))
    with pytest.raises(BodyFileError, match=r"counts from the supports, and the body has none"):
        divide(mesh, np.zeros(0, dtype=np.int64), 2)


def test_a_part_that_no_way_leads_to_is_refused():
    mesh = lattice(ElementType.C3D8, [(0, 0, 0), (2, 0, 0)], lambda p: p)
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0])
    with pytest.raises(MeshError, match=r"8 nodes are not connected to any support"):
        divided(mesh, 2)


@dataclass
class Study:
    """Displacements of the interfaces by the number of levels, against many."""

    errors: np.ndarray
    linear: float
    size: float


def by_levels(mesh, interfaces, folder):
    """Reduce a mesh with 1, 2, 4, 8 and 24 levels of one modal basis."""

    def reduced(levels):
        tables = {"reduction": {"modes": 30}, "formulation": {"method": "frames"}}
        return reduce_body(body_file(mesh, folder, interface=interfaces, frames=levels, **tables), Reporter())

    return {levels: reduced(levels) for levels in (1, 2, 4, 8, 24)}


def convergence(bodies, loads, length):
    """Relative errors with 1, 2, 4 and 8 levels against 24."""

    def solution(levels, method=None):
        body = FlexibleBody(bodies[levels], method)
        state = body.static({name.lower(): load for name, load in loads.items()})
        return body.response(state).displacement

    limit = solution(24)
    errors = np.array([relative(solution(levels), limit) for levels in (1, 2, 4, 8)])
    linear = relative(solution(1, Method.LINEAR), limit)
    return Study(errors, linear, float(np.linalg.norm(limit, axis=1).max()) / length)


def slender_fork():
    """Fork of slender bars, 4 cm wide, with a face LEFT and a face RIGHT at the ends of its prongs."""
    runs = [
        ((0, 0, 0), (23, 1, 1)),
        ((22, -10, 0), (23, 11, 1)),
        ((24, -10, 0), (47, -9, 1)),
        ((24, 10, 0), (47, 11, 1)),
    ]
    mesh = with_sets(bars(BRICK, runs, 0.02), ROOT=lambda p: p[:, 0], END=lambda p: p[:, 0] - 0.96)
    end = mesh.node_sets["END"]
    left = mesh.points[end, 1] < 0.0
    mesh.node_sets.update(LEFT=end[left], RIGHT=end[~left])
    return mesh


@pytest.fixture(scope="module")
def arcs(tmp_path_factory):
    return by_levels(arc(BRICK, (48, 2, 2), 1.0, 0.04), ["TIP"], tmp_path_factory.mktemp("arc"))


@pytest.fixture(scope="module")
def forks(tmp_path_factory):
    return by_levels(slender_fork(), ["LEFT", "RIGHT"], tmp_path_factory.mktemp("fork"))


@pytest.mark.parametrize("force", [(0.0, 8000.0, 0.0), (0.0, 8000.0, 4000.0)], ids=["in plane", "out of plane"])
def test_an_arc_converges_with_the_square_of_the_number_of_frames(force, arcs):
    study = convergence(arcs, {"TIP": force}, 0.5 * np.pi)
    assert study.size > 0.1
    assert study.linear > 0.1
    assert study.errors[0] < 0.04
    assert study.errors[2] < 0.003
    assert 1.6 < np.log2(study.errors[0] / study.errors[3]) / 3.0 < 2.4, study.errors


@pytest.mark.parametrize(
    "loads",
    [
        {"LEFT": (0.0, 0.0, 14e3), "RIGHT": (0.0, 0.0, -4e3)},
        {"LEFT": (0.0, 12e3, 0.0), "RIGHT": (0.0, 8e3, 0.0)},
        {"LEFT": (0.0, 2e3, 10e3), "RIGHT": (0.0, -3e3, 7e3)},
    ],
    ids=["twisting", "in plane", "all ways"],
)
def test_a_branched_body_with_two_loaded_tips_converges_with_the_square_of_the_number_of_frames(loads, forks):
    study = convergence(forks, loads, 1.0)
    assert study.size > 0.1
    assert study.linear > 0.06
    assert study.errors[0] < 0.02
    assert study.errors[2] < 0.0015
    assert 1.6 < np.log2(study.errors[0] / study.errors[3]) / 3.0 < 2.4, study.errors
