"""Finite element matrices against closed forms, for every element type."""

from ctypes import POINTER, c_int32, cast
from dataclasses import replace
from itertools import product
from math import factorial

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks import large
from scipy.sparse.linalg import splu

from flexfmu.fe import factorisation
from flexfmu.fe.assembly import mass, stiffness, summed, unknowns
from flexfmu.fe.factorisation import Factorisation, factor_entries
from flexfmu.fe.gradients import mean_spin, own_spin
from flexfmu.files.basics import ModelError
from flexfmu.mesh.checks import without_mechanisms
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.mesh.shapes import FACE_SHAPES, Sheet, brick_rule, rectangle_rule, tetrahedron_rule, triangle_rule
from flexfmu.reduction.supported import eliminated
from meshes import DECK_TYPES, EVERY_TYPE, QUADRATIC, STEEL, box, distorted, grid, lattice
from references import relative

SIZE = (1.5, 1.0, 0.8)
EVERY = pytest.mark.parametrize("kind", EVERY_TYPE + DECK_TYPES, ids=lambda kind: kind.name)


def skewed(kind, random):
    """Box of 2 × 2 × 2 cells none of which is a brick any more."""
    return distorted(box(kind, (2, 2, 2), SIZE), 0.12, random)


def elasticity(material, gradient):
    """Stress (3, 3), N/m², of an isotropic body with a constant displacement gradient."""
    strain = 0.5 * (gradient + gradient.T)
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio))
    lame = 2.0 * shear * material.poissons_ratio / (1.0 - 2.0 * material.poissons_ratio)
    return lame * np.trace(strain) * np.eye(3) + 2.0 * shear * strain, strain


def spread_evenly(mesh, name, force):
    """Nodal forces (3n,): each node of a set takes the same share, for checks of the resultant alone."""
    result = np.zeros((len(mesh.points), 3))
    nodes = mesh.node_sets[name]
    result[nodes] = np.asarray(force) / nodes.size
    return result.ravel()


def solve(mesh, fixed, force):
    """Displacements (n, 3) with some translations (n, 3) held."""
    k = stiffness(mesh)
    free = np.flatnonzero(~fixed.ravel())
    result = np.zeros(3 * len(mesh.points))
    result[free] = Factorisation(k[free][:, free], free // 3).solve(force[free])
    return result.reshape(-1, 3)


def cantilever_tip(kind, counts, size, force=1.0):
    """Mean tip deflection along y under a tip force along y; the root keeps plane and may contract."""
    mesh = box(kind, counts, size)
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    root = mesh.node_sets["ROOT"]
    fixed[root, 0] = True
    for axis in (1, 2):
        fixed[root, axis] = np.abs(mesh.points[root, axis] - 0.5 * size[axis]) < 1e-9
    u = solve(mesh, fixed, spread_evenly(mesh, "TIP", (0.0, force, 0.0)))
    return u[mesh.node_sets["TIP"], 1].mean()


def monomials(points, degree):
    """Values (k, n) and gradients (k, n, d) of all monomials up to a degree at points (n, d)."""
    count = points.shape[1]
    powers = [p for p in product(range(degree + 1), repeat=count) if sum(p) <= degree]
    value = np.array([np.prod(points ** np.array(p), axis=1) for p in powers])
    gradient = []
    for p in powers:
        lower = np.maximum(np.array(p) - np.eye(count, dtype=int), 0)
        gradient.append(np.stack([p[i] * np.prod(points ** lower[i], axis=1) for i in range(count)], axis=1))
    return value, np.array(gradient)


def check_completeness(value, gradient, nodes, points, degree):
    """Shape functions (p, n) and their gradients (p, n, d) give back every polynomial of their degree."""
    at_nodes, _ = monomials(nodes, degree)
    expected, slope = monomials(points, degree)
    np.testing.assert_allclose(value @ at_nodes.T, expected.T, atol=1e-12)
    np.testing.assert_allclose(np.einsum("pnd,kn->kpd", gradient, at_nodes), slope, atol=1e-12)


SHAPES = {shape.name: shape for shape in (*(kind.shape for kind in ElementType), *FACE_SHAPES.values())}
# Rules of the table by what they are exact for: all polynomials up to a degree, in all coordinates together or in each.
TOGETHER = [(triangle_rule(degree), degree) for degree in (1, 2, 5)]
TOGETHER += [(tetrahedron_rule(degree), degree) for degree in (1, 2, 4)]
EACH = [(brick_rule(2), 3), (brick_rule(3), 5), (rectangle_rule(), 5)]


@pytest.mark.parametrize("name", SHAPES)
def test_shape_functions_and_their_gradients_are_complete(name, random):
    shape = SHAPES[name]
    points = random.uniform(-1.0, 1.0, (20, shape.nodes.shape[1]))
    check_completeness(
        shape.value(points),
        shape.gradient(points),
        shape.nodes,
        points,
        2 if shape.quadratic and not isinstance(shape, Sheet) else 1,
    )


@pytest.mark.parametrize("name", SHAPES)
def test_shape_functions_are_one_at_their_node_and_zero_at_the_others(name):
    shape = SHAPES[name]
    np.testing.assert_allclose(shape.value(shape.nodes), np.eye(len(shape.nodes)), atol=1e-15)


@pytest.mark.parametrize(("rule", "degree"), TOGETHER)
def test_rules_of_triangles_and_tetrahedra_integrate_polynomials_exactly(rule, degree):
    dimension = rule.points.shape[1]
    for power in product(range(degree + 2), repeat=dimension):
        found = rule.weights @ np.prod(rule.points ** np.array(power), axis=1)
        # ∫ xᵃ yᵇ zᶜ dV = a! b! c! / (a + b + c + 3)!, of triangles alike.
        exact = np.prod([factorial(p) for p in power]) / factorial(sum(power) + dimension)
        if sum(power) <= degree:
            assert found == pytest.approx(exact, rel=2e-15)
    # And no further.
    highest = rule.weights @ rule.points[:, 0] ** (degree + 1)
    assert highest != pytest.approx(factorial(degree + 1) / factorial(degree + 1 + dimension), rel=1e-4)


@pytest.mark.parametrize(("rule", "degree"), EACH)
def test_rules_of_bricks_and_rectangles_integrate_polynomials_exactly(rule, degree):
    for power in product(range(degree + 1), repeat=rule.points.shape[1]):
        exact = np.prod([2.0 / (p + 1) if p % 2 == 0 else 0.0 for p in power])
        assert rule.weights @ np.prod(rule.points ** np.array(power), axis=1) == pytest.approx(exact, abs=1e-14)


@EVERY
def test_the_rules_of_an_element_lie_within_it_and_weigh_its_volume(kind):
    volume = {4: 1.0 / 6.0, 6: 1.0, 8: 8.0}[kind.corner_count]
    for rule in (kind.stiffness, kind.mass):
        assert rule.weights.sum() == pytest.approx(volume, rel=1e-15)
        assert (kind.shape.nodes.min(axis=0) <= rule.points).all()
        assert (rule.points <= kind.shape.nodes.max(axis=0)).all()


@EVERY
def test_faces_of_an_element_close_it_and_hold_the_mid_side_nodes_of_their_edges(kind):
    shape = kind.shape
    edges = [frozenset(pair) for face in shape.polytope.faces for pair in zip(face, face[1:] + face[:1], strict=True)]
    assert sorted(map(sorted, edges)) == sorted(2 * [sorted(edge) for edge in shape.polytope.edges])
    for face in shape.faces:
        corners = len(face) // 2 if shape.quadratic else len(face)
        places = shape.nodes[list(face)]
        middle = 0.5 * (places[:corners] + np.roll(places[:corners], -1, axis=0))
        np.testing.assert_array_equal(places[corners:], middle[: len(places) - corners])


@EVERY
def test_an_element_in_mirrored_order_is_one_inside_out(kind):
    shape = kind.shape
    turned = shape.nodes[shape.mirrored]
    slope = shape.gradient(kind.stiffness.points)
    assert (np.linalg.det(np.einsum("ai,qaJ->qiJ", turned, slope)) < 0.0).all()
    np.testing.assert_allclose(np.linalg.det(np.einsum("ai,qaJ->qiJ", shape.nodes, slope)), 1.0, rtol=1e-14)


@EVERY
def test_mass_and_centre_of_a_box_are_exact(kind):
    mesh = box(kind, (3, 2, 2), SIZE)
    m = mass(mesh)
    total = STEEL.density * np.prod(SIZE)
    moving = np.kron(np.ones(len(mesh.points)), np.array([1.0, 0.0, 0.0]))
    assert moving @ m @ moving == pytest.approx(total, rel=1e-12)
    centre = (m @ moving).reshape(-1, 3)[:, 0] @ mesh.points / total
    np.testing.assert_allclose(centre, np.array(SIZE) / 2.0, rtol=1e-12)


@EVERY
def test_turning_inertia_of_a_box_is_exact(kind):
    mesh = box(kind, (3, 2, 2), SIZE)
    spin = np.cross([0.0, 0.0, 1.0], mesh.points).ravel()
    expected = STEEL.density * np.prod(SIZE) * (SIZE[0] ** 2 + SIZE[1] ** 2) / 3.0
    assert spin @ mass(mesh) @ spin == pytest.approx(expected, rel=1e-13)


@EVERY
def test_matrices_are_symmetric_and_mass_is_positive(kind, random):
    mesh = skewed(kind, random)
    k, m = stiffness(mesh), mass(mesh)
    assert abs(k - k.T).max() == 0.0
    assert abs(m - m.T).max() < 1e-14 * abs(m).max()
    # Reduced integration leaves the mass of a single brick singular, never negative.
    assert np.linalg.eigvalsh(m.toarray())[0] > -1e-12 * abs(m).max()


@EVERY
def test_rigid_motions_give_no_force(kind, random):
    mesh = skewed(kind, random)
    k = stiffness(mesh)
    motions = [np.tile(axis, (len(mesh.points), 1)) for axis in np.eye(3)]
    motions += [np.cross(axis, mesh.points) for axis in np.eye(3)]
    scale = abs(k).max()
    for motion in motions:
        assert np.abs(k @ motion.ravel()).max() < 1e-13 * scale
    assert np.linalg.matrix_rank(k.toarray(), tol=1e-9 * scale) == 3 * len(mesh.points) - 6


@EVERY
def test_linear_displacements_give_the_exact_constant_stress_on_a_distorted_mesh(kind, random):
    mesh = skewed(kind, random)
    k = stiffness(mesh)
    gradient = 1e-3 * random.standard_normal((3, 3))
    displacement = mesh.points @ gradient.T
    force = (k @ displacement.ravel()).reshape(-1, 3)
    stress, strain = elasticity(STEEL, gradient)

    outer = np.zeros(len(mesh.points), dtype=bool)
    for faces in mesh.faces:
        outer[faces.nodes[faces.outer]] = True
    assert (~outer).sum() > 0
    assert np.abs(force[~outer]).max() < 1e-12 * np.abs(force).max()

    # ∫ t ⊗ x dA over the surface is stress times volume, and so is the energy stress : strain.
    volume = float(mesh.volumes.sum())
    np.testing.assert_allclose(force.T @ mesh.points, stress * volume, atol=1e-11 * np.abs(stress).max() * volume)
    energy = 0.5 * displacement.ravel() @ force.ravel()
    assert energy == pytest.approx(0.5 * np.sum(stress * strain) * volume, rel=1e-11)


@pytest.mark.parametrize("kind", QUADRATIC, ids=lambda kind: kind.name)
def test_quadratic_elements_bend_as_a_timoshenko_beam(kind):
    length, width = 1.0, 0.1
    inertia, area = width**4 / 12.0, width**2
    shear = STEEL.youngs_modulus / (2.0 * (1.0 + STEEL.poissons_ratio))
    theory = length**3 / (3.0 * STEEL.youngs_modulus * inertia) + 1.2 * length / (shear * area)
    assert cantilever_tip(kind, (10, 2, 2), (length, width, width)) == pytest.approx(theory, rel=0.01)


def test_linear_elements_lock_in_bending_and_tetrahedra_most():
    counts, size = (10, 2, 2), (1.0, 0.1, 0.1)
    tip = {kind: cantilever_tip(kind, counts, size) for kind in EVERY_TYPE + DECK_TYPES}
    assert tip[ElementType.C3D6] < 0.6 * tip[ElementType.C3D8]
    # Incompatible modes bend as quadratic elements do.
    assert tip[ElementType.C3D8I] == pytest.approx(tip[ElementType.C3D20], rel=0.015)
    assert tip[ElementType.C3D4] < 0.6 * tip[ElementType.C3D8]
    assert tip[ElementType.C3D8] < 0.9 * tip[ElementType.C3D20]
    # Full integration is the stiffer one, by little.
    assert tip[ElementType.C3D20] < (1.0 - 1e-5) * tip[ElementType.C3D20R]
    assert tip[ElementType.C3D20] > 0.98 * tip[ElementType.C3D20R]


def test_reduced_integration_is_that_of_both_matrices():
    full, reduced = (box(kind, (1, 1, 1), SIZE) for kind in (ElementType.C3D20, ElementType.C3D20R))
    ranks = [np.linalg.matrix_rank(stiffness(mesh).toarray(), tol=1e-3) for mesh in (full, reduced)]
    # Eight points with six strains each leave twelve motions of 60, six of them rigid.
    assert ranks == [54, 48]
    scalar = [mesh.volume_matrices[0][0] for mesh in (full, reduced)]
    assert [np.linalg.matrix_rank(matrix) for matrix in scalar] == [20, 8]


def motions_without_energy(mesh):
    return int(np.sum(np.linalg.eigvalsh(stiffness(mesh).toarray()) < 1e-3))


@pytest.mark.parametrize(
    ("cells", "lone", "mechanisms"),
    [
        (grid(1, 1, 1), 1, 6),
        (grid(4, 1, 1), 4, 5),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0)], 4, 4),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 2, 0)], 4, 4),
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 1), (2, 2, 1)], 2, 2),
        ([*grid(2, 2, 1), (2, 0, 0), (3, 0, 0)], 2, 2),
        (grid(3, 2, 1), 0, 0),
        (np.concatenate([grid(3, 1, 1), np.add(grid(3, 2, 1), (0, 0, 1))]), 0, 0),
        (grid(2, 2, 2), 0, 0),
    ],
    ids=["element", "bar", "corner", "branch", "stairs", "plate and bar", "plate", "angle", "block"],
)
def test_elements_of_reduced_integration_that_move_without_energy_are_integrated_fully(cells, lone, mechanisms):
    mesh = lattice(ElementType.C3D20R, cells, lambda p: p * SIZE)
    mesh = replace(mesh, element_sets={"LAST": np.array([len(cells) - 1])})
    sound = without_mechanisms(mesh)
    assert (motions_without_energy(mesh), motions_without_energy(sound)) == (6 + mechanisms, 6)
    assert sum(len(block.labels) for block in sound.blocks if block.type is ElementType.C3D20) == lone
    assert [block.labels[rows].tolist() for block, rows in sound.by_block(sound.element_sets["LAST"])] == [[len(cells)]]
    assert sorted(np.concatenate([block.labels for block in sound.blocks])) == list(range(1, len(cells) + 1))
    assert len(sound.notes) == (lone > 0)


@EVERY
def test_two_materials_in_series_stretch_as_springs_do(kind):
    # Without lateral contraction the state is uniaxial, whatever the element.
    soft = Material("SOFT", 1e9, 0.0, 1000.0)
    stiff = Material("STIFF", 4e9, 0.0, 2000.0)
    mesh = box(
        kind, (3, 2, 2), (3.0, 0.5, 0.5), materials=(soft, stiff), material=lambda c: (c[:, 0] > 1.0).astype(int)
    )
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.node_sets["ROOT"]] = True
    k = stiffness(mesh)
    x = mesh.points[:, 0]
    # 1 N: 1 m of the soft one, then 2 m of the stiff one.
    u = np.zeros((len(x), 3))
    u[:, 0] = np.minimum(x, 1.0) / (1e9 * 0.25) + np.maximum(x - 1.0, 0.0) / (4e9 * 0.25)
    force = (k @ u.ravel()).reshape(-1, 3)
    assert force[mesh.node_sets["TIP"], 0].sum() == pytest.approx(1.0, rel=1e-12)
    ends = np.concatenate([mesh.node_sets["ROOT"], mesh.node_sets["TIP"]])
    assert np.abs(np.delete(force, ends, axis=0)).max() < 1e-12
    assert relative(solve(mesh, fixed, force.ravel()), u) < 1e-10
    m = mass(mesh)
    assert m.sum() / 3.0 == pytest.approx(0.25 * (1.0 * 1000.0 + 2.0 * 2000.0), rel=1e-12)


@pytest.fixture(params=["SuperLU", "PARDISO"])
def solver(request, monkeypatch):
    """Each solver in turn; PARDISO where pypardiso is installed."""
    if request.param == "SuperLU":
        monkeypatch.setattr(factorisation, "_pardiso", lambda: None)
    elif factorisation.solver_name() != request.param:
        pytest.skip("pypardiso is not installed")
    return request.param


@pytest.mark.usefixtures("solver")
@EVERY
def test_factorisation_solves_one_or_several_right_sides_to_round_off(kind, random):
    mesh = skewed(kind, random)
    free = np.setdiff1d(np.arange(3 * len(mesh.points)), 3 * mesh.node_sets["ROOT"][:, None] + np.arange(3))
    k = stiffness(mesh)[free][:, free]
    factor = Factorisation(k, free // 3)
    expected = random.standard_normal((free.size, 3))
    assert relative(factor.solve(k @ expected), expected) < 1e-10
    assert relative(factor.solve(k @ expected[:, 0]), expected[:, 0]) < 1e-10
    assert factor.solve(np.zeros((free.size, 0))).shape == (free.size, 0)


@pytest.mark.usefixtures("solver")
def test_an_exactly_singular_matrix_is_refused_with_its_cause():
    chain = sp.diags_array([[1.0, *[2.0] * 4, 1.0], [-1.0] * 5, [-1.0] * 5], offsets=[0, 1, -1]).tocsr()
    with pytest.raises(ModelError, match=r"singular.*free to move"):
        Factorisation(chain, np.arange(6))
    held = chain[1:][:, 1:].tocsr()
    np.testing.assert_allclose(Factorisation(held, np.arange(5)).solve(np.ones(5)), [5.0, 9.0, 12.0, 14.0, 15.0])


@pytest.mark.usefixtures("solver")
@pytest.mark.parametrize("large", [80_000, 100])
def test_static_response_to_many_loads_is_that_to_each(large, monkeypatch):
    """Of large models SuperLU's factors are given up for blocks of them."""
    monkeypatch.setattr(factorisation, "_LARGE", large)
    mesh = box(ElementType.C3D10, (3, 2, 2), (1.0, 0.3, 0.3))
    free = np.flatnonzero(np.repeat(mesh.points[:, 0] > 0.0, 3))
    k = sp.csr_array(stiffness(mesh)[free][:, free])
    factor = Factorisation(k, free // 3)
    # More than are solved at a time, and none.
    loads = np.random.default_rng(0).standard_normal((free.size, 2 * factorisation.AT_A_TIME + 3))
    found = factor.solve(loads)
    np.testing.assert_allclose(k @ found, loads, atol=1e-9)
    for column in (0, factorisation.AT_A_TIME, loads.shape[1] - 1):
        np.testing.assert_allclose(factor.solve(loads[:, column]), found[:, column], rtol=1e-9, atol=1e-24)
    assert factor.solve(loads[:, :0]).shape == (free.size, 0)


@pytest.mark.usefixtures("solver")
def test_the_same_matrix_gets_the_same_bits_each_time():
    mesh = box(ElementType.C3D10, (10, 4, 4), (1.0, 0.3, 0.3))
    free = np.flatnonzero(np.repeat(mesh.points[:, 0] > 0.0, 3))
    k = sp.csr_array(stiffness(mesh)[free][:, free])
    found = [Factorisation(k, free // 3).solve(np.ones((free.size, 4))) for _ in range(3)]
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


@pytest.mark.usefixtures("solver")
def test_a_stiffness_under_a_load_beyond_the_critical_one_is_told_to_be_indefinite():
    chain = sp.diags_array([[2.0] * 5, [-1.0] * 4, [-1.0] * 4], offsets=[0, 1, -1]).tocsr()
    assert Factorisation(chain, np.arange(5)).positive_definite
    # Smallest eigenvalue of the chain: 2 − 2 cos(π/6).
    below, above = (chain - x * sp.eye_array(5, format="csr") for x in (0.267, 0.269))
    assert Factorisation(sp.csr_array(below), np.arange(5)).positive_definite
    beyond = Factorisation(sp.csr_array(above), np.arange(5))
    assert not beyond.positive_definite
    np.testing.assert_allclose(above @ beyond.solve(np.ones(5)), np.ones(5), rtol=1e-9)


@pytest.mark.parametrize("kind", [ElementType.C3D10, ElementType.C3D20R])
def test_the_size_of_the_factor_is_known_before_it_is_made(kind):
    mesh = box(kind, (6, 3, 2), (2.0, 1.0, 1.0))
    free = np.flatnonzero(np.repeat(mesh.points[:, 0] > 0.0, 3))
    k = sp.csr_array(stiffness(mesh)[free][:, free])
    order = factorisation.dissection_order(k, free // 3)
    # The pattern of the graph's factor: with numbers that cannot cancel.
    full = sp.csc_matrix(abs(k) + sp.diags_array(np.asarray(abs(k).sum(axis=1)).ravel()))[order][:, order]
    made = splu(full, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).L.nnz
    assert factor_entries(k, free // 3, order) == pytest.approx(made, rel=0.05)


def test_what_does_not_fit_into_memory_is_refused_with_its_size_before_it_is_begun(monkeypatch, solver):
    mesh = box(ElementType.C3D8, (6, 6, 6), (1.0, 1.0, 1.0))
    free = np.flatnonzero(np.repeat(mesh.points[:, 0] > 0.0, 3))
    k = sp.csr_array(stiffness(mesh)[free][:, free])
    monkeypatch.setattr(factorisation, "_LARGE", 100)
    told = []
    Factorisation(k, free // 3, tell=told.append)
    monkeypatch.setattr(factorisation, "free_memory", lambda: 1e5)
    with pytest.raises(
        ModelError, match=rf"factors of {free.size} unknowns and what follows take 0.0 GB of memory, 0.0 GB are"
    ):
        Factorisation(k, free // 3)
    if solver == "SuperLU":
        assert 'pip install "flexfmu[fast]"' in told[0]


def test_a_search_for_an_order_that_a_signal_has_ended_does_not_count_as_a_singular_matrix(monkeypatch):
    # METIS catches SIGTERM; pymetis throws what Python cannot name.
    def ended(**_):
        raise RuntimeError("Caught an unknown exception!")

    monkeypatch.setattr(factorisation, "_pardiso", lambda: None)
    monkeypatch.setattr(factorisation.pymetis, "nested_dissection", ended)
    with pytest.raises(ModelError, match="METIS has not ordered the unknowns: a signal"):
        Factorisation(sp.eye_array(5, format="csr"), np.arange(5))


def test_a_solver_that_lacks_memory_says_so_and_not_that_the_body_is_free_to_move(monkeypatch):
    def pardiso(*given):
        phase, error = (cast(given[place], POINTER(c_int32)) for place in (4, -1))
        error[0] = -2 if phase[0] == 22 else 0

    monkeypatch.setattr(factorisation, "_pardiso", lambda: {"pardiso": pardiso})
    with pytest.raises(ModelError, match="no memory for the factors of 5 unknowns"):
        Factorisation(sp.eye_array(5, format="csr"), np.arange(5))


def test_stiffness_and_mass_take_twelve_bytes_a_number():
    mesh = box(ElementType.C3D10, (3, 2, 2), (1.0, 0.3, 0.3))
    held = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    matrices = eliminated(stiffness(mesh), mass(mesh), unknowns(held, mesh.equations))
    for one in (matrices.stiffness, matrices.mass, factorisation.upper_triangle(matrices.stiffness)):
        assert one.indices.dtype == one.indptr.dtype == np.int32
    # Those of all displacements are not kept.
    assert matrices.whole_stiffness is None


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 8, 11])
def test_matrices_are_summed_in_pairs_whatever_their_number(number):
    parts = [sp.csr_array(np.diag([1.0, float(k)])) for k in range(number)]
    np.testing.assert_array_equal(summed(iter(parts)).toarray(), np.diag([number, sum(range(number))]))


@pytest.mark.parametrize("unknowns", [10_000, 40_000])
def test_the_arm_whose_build_is_timed_is_a_quarter_ring_of_any_size(unknowns):
    arm = large.body(unknowns)
    mesh = arm.mesh
    assert not mesh.notes
    held = int((np.abs(mesh.points[:, 0]) < 1e-9).sum())
    # A layer of elements more would be too many.
    assert unknowns <= 3 * (len(mesh.points) - held) < unknowns + 6 * held
    volume = float(mesh.volumes.sum())
    # Guldin's rule, less what quadratic sides leave of the arc.
    assert volume == pytest.approx(0.5 * np.pi * large.RADIUS * large.WIDTH * large.THICKNESS, rel=1e-4)


def test_records_of_a_build_that_was_ended_are_kept_and_completed(tmp_path):
    path = tmp_path / "1000_pardiso.csv"
    first = large.StageRecords(path, 1000, "pardiso")
    for title in ("mesh", "modes"):
        first.add(title, 1.0, 0.5, 0.25)
    second = large.StageRecords(path, 1000, "pardiso")
    second.add("mesh", 2.0, 0.5, 0.125)
    assert [(row["stage"], row["seconds"]) for row in large.records(path)] == [("mesh", "2.0"), ("modes", "1.0")]
    assert second.largest_peak == 0.25
    assert "| 1000 | pardiso | modes | 1.0 | 0.5 | 0.25 |" in large.table(tmp_path)


@EVERY
def test_a_rigid_turn_spins_all_material_alike(kind, random):
    """The mean of ω_a·ω_b over two turns, and the mean of |ω|² where a motion turns the material."""
    mesh, turns = skewed(kind, random), random.standard_normal((2, 3))
    fields = np.cross(turns[:, None], mesh.points).reshape(2, -1).T
    np.testing.assert_allclose(mean_spin(mesh, fields), turns @ turns.T, rtol=1e-10)
    np.testing.assert_allclose(own_spin(mesh, fields), (turns**2).sum(axis=1), rtol=1e-10)
