"""Rigid links: a bore that is rigid in CalculiX; links that join nodes, turn far, carry masses, or are equations."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh, expm

import flexfmu
from flexfmu.fe.assembly import elastic_cells
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.equations import RigidLink, recognised
from flexfmu.mesh.model import PointMass
from flexfmu.model.rotations import skew
from flexfmu.reduction.model import _link_strains, assemble_model
from flexfmu.reduction.options import BodyOptions
from flexfmu.reduction.rigid_nodes import _surroundings, _with_links
from meshes import box, with_sets
from reference.rigid_bore import FOLDER, LOADS, RADIUS
from turns import exponential

RESULTS = np.genfromtxt(FOLDER / "rigid_bore.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
EXPECTED = {row["load"]: np.array([row[name] for name in RESULTS.dtype.names[1:]]) for row in RESULTS}


def plate(rigid=None, **options):
    """The plate of the deck with the interface at the bore's reference node."""
    mesh = flexfmu.read_mesh(FOLDER / "rigid_bore.inp")
    return flexfmu.Body(mesh, interfaces={"pin": flexfmu.Interface("PIN", rigid=rigid)}).build(surface=False, **options)


def errors(body, load):
    """Relative errors of the rim's motion and of the rotation vector under a load of CalculiX.

    A moment of CalculiX does its work on the components of the rotation vector, ours on the rotation itself.
    """
    expected = EXPECTED[load]
    # The mean of exp(s φ̂) over s from 0 to 1 stands in the corner of the exponential of a block matrix (Van Loan 1978).
    turn = expm(np.block([[skew(expected[3:]), np.eye(3)], [np.zeros((3, 6))]]))[:3, 3:]
    moment = np.linalg.solve(turn.T, LOADS[load][3:])
    found = body.response(body.static({"pin": [*LOADS[load][:3], *moment]}))
    miss = np.append(found.displacement[0], found.rotation[0]) - expected
    rim = np.repeat([1.0, RADIUS], 3)
    return float(np.linalg.norm(rim * miss) / np.linalg.norm(rim * expected)), float(
        np.linalg.norm(miss[3:]) / np.linalg.norm(expected[3:])
    )


@pytest.fixture(scope="module")
def bore():
    """With all static shapes: of itself the build leaves out what moves a load by less than 0.5 %."""
    return plate(residual_flexibility=True)


@pytest.mark.parametrize("load", LOADS)
def test_a_rigid_bore_moves_and_turns_as_in_calculix(bore, load):
    assert max(errors(bore, load)) < 2e-3


@pytest.mark.slow
def test_linear_theory_is_off_under_the_same_loads():
    linear = plate(method="linear")
    assert all(errors(linear, load)[0] > 0.02 for load in ("force", "moment", "both", "all"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:interface 'pin'")
def test_a_bore_that_deforms_gives_way_by_far_more():
    soft = plate(rigid=False)
    assert errors(soft, "twist")[1] > 0.1


def test_frequencies_of_the_plate_with_a_rigid_bore_are_calculixs(bore):
    expected = np.genfromtxt(FOLDER / "rigid_bore_frequencies.csv", skip_header=1)
    found = bore.reduced.angular_frequency[: len(expected)] / (2.0 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def bar(**sets):
    """Slender bar that is held at ROOT."""
    mesh = box(ElementType.C3D8I, (12, 2, 2), (0.6, 0.03, 0.03))
    mesh = with_sets(mesh, MIDDLE=lambda p: np.minimum(np.abs(p[:, 0] - 0.3), 1.0), **sets)
    fixed = mesh.fixed.copy()
    fixed[mesh.node_sets["ROOT"]] = True
    return replace(mesh, fixed=fixed)


LOAD = (0.0, 500.0, 200.0, 30.0, 0.0, 0.0)


def tip(mesh, load=LOAD, rigid=None, **options):
    """Displacement of the tip under a load, with all that methods have by default."""
    body = flexfmu.Body(mesh, interfaces={"tip": flexfmu.Interface("TIP", rigid=rigid)}).build(surface=False, **options)
    return body.response(body.static({"tip": load})).displacement[0]


@pytest.mark.slow
def test_an_interface_that_the_body_file_makes_rigid_is_that_of_a_rigid_coupling():
    mesh = bar()
    linked = replace(mesh, links=(RigidLink("coupling", mesh.node_sets["TIP"]),))
    np.testing.assert_array_equal(tip(mesh, rigid=True), tip(linked))
    np.testing.assert_array_equal(tip(mesh), tip(linked, rigid=False))


@pytest.mark.slow
def test_links_that_share_a_reference_point_are_one_rigid_body():
    mesh = bar()
    top, end = mesh.node_sets["MIDDLE"], mesh.node_sets["TIP"]
    alone = len(mesh.points)
    points = np.vstack([mesh.points, [[0.45, 0.2, 0.0]]])
    shared = replace(
        mesh,
        points=points,
        labels=np.arange(1, alone + 2),
        fixed=np.vstack([mesh.fixed, np.zeros((1, 3), dtype=bool)]),
        links=tuple(RigidLink(name, np.append(rows, alone)) for name, rows in (("a", top), ("b", end))),
    )
    one = replace(mesh, links=(RigidLink("both", np.union1d(top, end)),))
    np.testing.assert_allclose(tip(shared), tip(one), rtol=1e-9)
    apart = replace(mesh, links=(RigidLink("a", top), RigidLink("b", end)))
    assert abs(tip(apart)[1]) > 1.1 * abs(tip(one)[1])


def test_links_between_plane_faces_join_parts_of_a_body():
    near, far = bar(), box(ElementType.C3D8I, (4, 2, 2), (0.2, 0.03, 0.03))
    count = len(near.points)
    ends = near.node_sets["TIP"], count + far.node_sets["ROOT"]
    (block,), (other,) = near.blocks, far.blocks
    joined = replace(
        near,
        points=np.vstack([near.points, far.points + np.array([0.65, 0.0, 0.0])]),
        labels=np.arange(1, count + len(far.points) + 1),
        fixed=np.vstack([near.fixed, far.fixed]),
        blocks=(
            replace(
                block,
                labels=np.arange(1, len(block.labels) + len(other.labels) + 1),
                connectivity=np.vstack([block.connectivity, count + other.connectivity]),
                material=np.append(block.material, other.material),
            ),
        ),
        node_sets={"ROOT": near.node_sets["ROOT"], "TIP": count + far.node_sets["TIP"]},
        links=(RigidLink("flange", np.concatenate(ends)),),
    )
    # Cantilever of 0.85 m, rigid from 0.6 to 0.65 m: ∫ M² dx; faces that cannot contract stiffen it by 1.3 %.
    arm = [(0.25, 0.85), (0.0, 0.2)]
    expected = sum(b**3 - a**3 for a, b in arm) / (3.0 * 2.0e11 * 0.03**4 / 12.0)
    assert tip(joined, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0), method="linear")[1] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("where", ["volume", "face", "edge"])
def test_a_body_with_links_turns_far_without_strain_and_they_stay_rigid(where):
    mesh = box(ElementType.C3D8, (4, 2, 2), (0.4, 0.2, 0.2))
    x, y, z = mesh.points.T
    nodes = {"volume": x > 0.29, "face": x > 0.39, "edge": (x > 0.39) & (y > 0.19)}[where]
    mesh = replace(mesh, links=(RigidLink("end", np.flatnonzero(nodes & (z > -1.0))),))
    model = assemble_model(mesh, BodyOptions("body", (), free=True))
    turn = exponential(np.array([1.0, -2.0, 0.5]))
    far = (mesh.points @ (turn - np.eye(3)).T).ravel()
    # What follows is where the turn has put it.
    np.testing.assert_allclose(model.unknowns.whole(far[model.free]), far, atol=1e-12)
    # Held where the turn puts three nodes, nothing else is needed: the load path's first residual is zero.
    forces = internal_forces(model, far)
    strained = internal_forces(model, np.where(np.arange(far.size) % 3 == 1, 1.01 * far, far))
    assert np.abs(forces).max() < 1e-8 * np.abs(strained).max()


def internal_forces(model, displacement):
    """Forces on the unknowns that hold a displacement."""
    total = np.zeros((len(model.mesh.points), 3))
    for some in elastic_cells(model.mesh, 100):
        field = displacement.reshape(-1, 3, 1)
        slopes = some.slopes(field)
        work = some.work(some.strains(field) + some.products(slopes, np.zeros((1, 2), dtype=int)))
        forces = some.operator(some.undeformed + slopes[..., 0]).swapaxes(1, 2) @ work
        np.add.at(total, some.nodes, forces.reshape(*some.nodes.shape, 3))
    return model.unknowns.forces(total.ravel())


def rigid_equations(
    points,
    nodes,
):
    """Equations by which nodes turn with the first four linearly, whatever small motion these six unknowns make."""
    arms = points[nodes] - points[nodes].mean(axis=0)
    motions = np.zeros((len(nodes), 3, 6))
    motions[:, :, :3] = np.eye(3)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    left, _, _ = np.linalg.svd(motions.reshape(-1, 6))
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    rows = np.zeros((3 * len(nodes) - 6, 3 * len(points)))
    rows[:, columns] = left[:, 6:].T
    return sp.csr_array(rows)


@pytest.mark.slow
def test_equations_of_a_linear_rigid_body_become_one_that_is_rigid_in_large_turns():
    mesh = bar()
    nodes = mesh.node_sets["TIP"]
    tied = replace(mesh, equations=rigid_equations(mesh.points, nodes))
    links, rest = recognised(tied.points, tied.equations)
    assert [one.nodes.tolist() for one in links] == [nodes.tolist()]
    assert rest.shape[0] == 0
    np.testing.assert_allclose(tip(tied), tip(mesh, rigid=True), rtol=1e-6)


@pytest.mark.slow
def test_equations_of_distances_that_make_no_rigid_body_are_warned_of_by_number(recwarn):
    mesh = bar()
    nodes = mesh.node_sets["TIP"]
    tied = replace(mesh, equations=rigid_equations(mesh.points, nodes)[:-2])
    tip(tied, method="frames")
    assert [str(one.message) for one in recwarn if "equations of the mesh file keep distances" in str(one.message)]


def test_equations_that_follow_stretches_pass_without_a_word():
    mesh = bar()
    second = mesh.node_sets["TIP"]
    # The middle of two nodes: right for every affine motion.
    ends = mesh.points[second[[0, -1]]]
    row = np.zeros((1, 3 * len(mesh.points)))
    row[0, 3 * second[[0, -1]]] = 0.5
    at = np.flatnonzero(np.linalg.norm(mesh.points - ends.mean(axis=0), axis=1) < 1e-9)
    assert at.size == 1
    row[0, 3 * at[0]] = -1.0
    links, rest = recognised(mesh.points, sp.csr_array(row))
    assert (len(links), rest.shape[0]) == (0, 1)


@pytest.mark.slow
def test_a_mass_on_a_rigid_link_moves_with_all_of_it():
    mesh = bar()
    nodes = mesh.node_sets["TIP"]
    mass = PointMass("motor", np.array([0.7, 0.1, 0.0]), nodes, 3.0, 0.01 * np.eye(3))
    heavy = replace(mesh, links=(RigidLink("end", nodes),), masses=(mass,))
    # All nodes of the link follow these three.
    (hung,) = assemble_model(checked(heavy), BodyOptions("body", ())).mesh.masses
    assert hung.nodes.size == 3
    # A rigid body at the end of a beam: K = EI/L³ [[12, −6L], [−6L, 4L²]] of deflection and slope at the end, with the
    # beam's own mass as of its cubic shapes. Shear and the mesh leave less than 1 %.
    length, arm = 0.6, 0.1
    bending, line = 2.0e11 * 0.03**4 / 12.0, 7850.0 * 0.03**2
    stiff = bending / length**3 * np.array([[12.0, -6.0 * length], [-6.0 * length, 4.0 * length**2]])
    own = line * length / 420.0 * np.array([[156.0, -22.0 * length], [-22.0 * length, 4.0 * length**2]])
    hang = mass.mass * np.array([[1.0, arm], [arm, arm**2]]) + np.array([[0.0, 0.0], [0.0, 0.01]])
    expected = np.sqrt(eigh(stiff, own + hang, eigvals_only=True)[0])
    slender = replace(heavy, masses=(replace(mass, point=np.array([0.7, 0.015, 0.015])),))
    body = flexfmu.Body(slender, interfaces={"tip": "TIP"}).build(surface=False, modes=7)
    np.testing.assert_allclose(body.reduced.angular_frequency[:2], expected, rtol=0.01)


@pytest.mark.slow
def test_nonlinear_equilibrium_of_the_finite_element_model_keeps_links_rigid():
    mesh = bar()
    nodes = mesh.node_sets["TIP"]
    model = assemble_model(replace(mesh, links=(RigidLink("end", nodes),)), BodyOptions("body", ()))
    load = np.zeros((len(mesh.points), 3))
    load[nodes, 1] = 20e3 / nodes.size
    u = load_path(model.mesh, model.unknowns, model.spring, load.ravel(), [1.0], Reporter()).displacement[-1]
    moved = (mesh.points + u.reshape(-1, 3))[nodes]
    before, after = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (mesh.points[nodes], moved))
    np.testing.assert_allclose(after, before, atol=1e-6 * before.max())
    assert abs(u.reshape(-1, 3)[nodes, 1].mean()) > 0.08


def test_a_link_reads_its_strain_times_its_size_and_is_stiff_beside_its_surroundings(random):
    """E V R / h of what takes part: a cube of steel, and a half of the next one's, whose corners they share."""
    mesh = box(ElementType.C3D8, (2, 1, 1), (2.0, 1.0, 1.0))
    cube = RigidLink("cube", np.flatnonzero(mesh.points[:, 0] < 1.5))
    modulus = mesh.materials[0].youngs_modulus
    assert _surroundings(mesh, [cube]) == pytest.approx([modulus * 1.5 * 0.5 * np.sqrt(3.0)])
    linked = _with_links(mesh, [cube])
    slope = random.standard_normal((3, 3))
    (found,) = _link_strains(linked, (mesh.points @ slope.T).reshape(-1, 1))
    size = 1.0 / np.linalg.norm(linked.simplices[0].gradient)
    np.testing.assert_allclose(found.reshape(3, 3), size * 0.5 * (slope + slope.T), atol=1e-12)
