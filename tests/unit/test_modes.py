"""Normal modes: orthonormal, converged, reproducible, and with fixed axes where frequencies coincide."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from flexfmu.fe.assembly import mass, stiffness, unknowns
from flexfmu.files.basics import AccuracyError, BodyFileError, ModelError
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material, Mesh
from flexfmu.reduction.modes import (
    Modes,
    _rayleigh_ritz,
    chosen_modes,
    frequency_spread,
    normal_modes,
    with_residual_flexibility,
)
from flexfmu.reduction.supported import eliminated, supported
from meshes import EVERY_TYPE, STEEL, box, held, lattice, renumbered, with_sets

BRICK = ElementType.C3D20R
SIZE = (1.0, 0.1, 0.1)
BEAM = ((6, 2, 2), SIZE)
UNEQUAL = ((6, 2, 2), (1.0, 0.1, 0.13))
# Relative distance of the mass-normal shapes of two runs that differ by round-off alone.
ROUND_OFF = 1e-7


@dataclass
class Reduced:
    """Modes with what they came from."""

    mesh: Mesh
    stiffness: sp.csr_array
    mass: sp.csr_array
    modes: Modes


def reduced(mesh, count):
    k, m = stiffness(mesh), mass(mesh)
    motions = np.zeros((k.shape[0], 0))
    return Reduced(
        mesh, k, m, normal_modes(supported(eliminated(k, m, unknowns(mesh.fixed, mesh.equations)), motions), count)
    )


def clamped(kind, counts, size):
    return held(box(kind, counts, size), "ROOT")


def test_single_prisms_in_a_row_twist_without_energy_and_are_told_of():
    """Two points along the axis see no shear of a twist; with a second prism beside each, the row is a bar."""
    whole = box(ElementType.C3D6, (1, 1, 3), (0.1, 0.1, 0.6))
    whole = held(with_sets(whole, BASE=lambda p: p[:, 2]), "BASE")
    assert reduced(whole, 2).modes.angular_frequency[0] > 100.0
    (block,) = whole.blocks
    # One of the two of each cell.
    row = checked(replace(whole, blocks=(block.part(np.arange(len(block.labels)) % 2 == 0),), node_sets={}))
    with pytest.raises(ModelError, match="or single C3D6 in a row twist, which costs them no energy: take C3D15"):
        reduced(row, 2)


@pytest.mark.parametrize("kind", EVERY_TYPE, ids=lambda kind: kind.name)
def test_modes_are_mass_orthonormal_and_solve_the_eigenvalue_problem(kind):
    found = reduced(clamped(kind, *UNEQUAL), 8)
    shapes, squares = found.modes.shapes, found.modes.angular_frequency**2
    np.testing.assert_allclose(shapes.T @ found.mass @ shapes, np.eye(8), atol=1e-12)
    np.testing.assert_allclose(shapes.T @ found.stiffness @ shapes, np.diag(squares), atol=1e-10 * squares[-1])
    free = ~found.mesh.fixed.ravel()
    forces = (found.stiffness @ shapes)[free]
    residual = np.linalg.norm(forces - (found.mass @ shapes)[free] * squares, axis=0) / np.linalg.norm(forces, axis=0)
    assert residual.max() < 1e-7
    assert found.modes.frequency_error < 1e-10
    assert found.modes.orthonormality_error < 1e-12
    assert np.all(np.diff(found.modes.angular_frequency) >= 0.0)
    assert not shapes[~free].any()


@pytest.mark.parametrize("kind", EVERY_TYPE, ids=lambda kind: kind.name)
def test_modes_are_the_lowest_of_the_whole_dense_problem(kind):
    found = reduced(clamped(kind, (2, 2, 2), (0.3, 0.1, 0.13)), 5)
    free = np.flatnonzero(~found.mesh.fixed.ravel())
    k, m = (matrix[free][:, free].toarray() for matrix in (found.stiffness, found.mass))
    # The mass of reduced bricks is singular, so the inverse problem is the one to solve: Mφ = Kφ/ω².
    largest = scipy.linalg.eigh(m, k, eigvals_only=True)[::-1][:5]
    np.testing.assert_allclose(found.modes.angular_frequency, 1.0 / np.sqrt(largest), rtol=1e-9)


@pytest.mark.parametrize("kind", EVERY_TYPE, ids=lambda kind: kind.name)
def test_a_guided_rod_swings_lengthwise_at_a_quarter_wave(kind):
    # Without lateral contraction and with lateral motion held, the body is a rod: ω = (2 j − 1) π c / (2 L).
    material = Material("ROD", 2e11, 0.0, 8000.0)
    mesh = lattice(kind, [(i, 0, 0) for i in range(24)], lambda p: p / np.array([24.0, 10.0, 10.0]), (material,))
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 0])
    fixed = np.ones((len(mesh.points), 3), dtype=bool)
    fixed[:, 0] = False
    fixed[mesh.node_sets["ROOT"], 0] = True
    found = reduced(replace(mesh, fixed=fixed), 3).modes
    expected = np.array([0.5, 1.5, 2.5]) * np.pi * np.sqrt(2e11 / 8000.0)
    np.testing.assert_allclose(found.angular_frequency, expected, rtol=5e-3)
    # Displacement-based elements with their full mass can only be too stiff.
    assert np.all(found.angular_frequency > expected * (1.0 - 1e-9))


def test_first_bending_frequency_is_that_of_a_slender_beam():
    # Without lateral contraction, which the clamp would hinder; shear and turning inertia take a part in a thousand.
    size, material = (2.0, 0.05, 0.05), replace(STEEL, poissons_ratio=0.0)
    expected = 1.8751041**2 * np.sqrt(STEEL.youngs_modulus * 0.05**2 / (12.0 * STEEL.density)) / size[0] ** 2
    found = reduced(held(box(BRICK, (16, 1, 1), size, materials=(material,)), "ROOT"), 1).modes
    assert found.angular_frequency[0] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("kind", "order"), [(ElementType.C3D8, 2.0), (ElementType.C3D20, 4.0)])
def test_frequencies_fall_towards_the_limit_as_the_mesh_is_refined(kind, order):
    # Thick and guided sideways, so that the clamp's singular corners do not set the rate.
    def frequency(n):
        mesh = box(kind, (n, n, 1), (1.0, 1.0, 1.0), materials=(Material("SOFT", 1e9, 0.0, 1e3),))
        fixed = np.zeros((len(mesh.points), 3), dtype=bool)
        fixed[:, 2] = True
        for axis in (0, 1):
            rim = (np.abs(mesh.points[:, axis]) < 1e-9) | (np.abs(mesh.points[:, axis] - 1.0) < 1e-9)
            fixed[rim] = True
        return reduced(replace(mesh, fixed=fixed), 4).modes.angular_frequency[0]

    values = np.array([frequency(n) for n in (4, 8, 16)])
    assert values[0] > values[1] > values[2]
    assert np.log2((values[0] - values[1]) / (values[1] - values[2])) == pytest.approx(order, abs=0.4)


@pytest.mark.parametrize("counts", [(4, 2, 2), (8, 2, 2)])
def test_square_beam_bends_in_one_plane_alone_at_the_deciding_degree_of_freedom(counts):
    found = reduced(clamped(BRICK, counts, SIZE), 2)
    squares = found.modes.angular_frequency**2
    assert squares[1] - squares[0] < 1e-7 * squares[1]
    size = np.linalg.norm(found.modes.shapes, axis=1)
    row = int(np.argmax(size >= 0.9 * size.max()))
    assert found.modes.shapes[row, 0] == pytest.approx(size[row], rel=1e-12)
    assert abs(found.modes.shapes[row, 1]) < 1e-12 * size[row]
    # Of a tip node's three translations y comes before z.
    assert row % 3 == 1
    tip = found.modes.shapes.reshape(-1, 3, 2)[found.mesh.node_sets["TIP"]].mean(axis=0)
    assert abs(tip[2, 0]) < 0.05 * abs(tip[1, 0])


def test_every_mode_is_positive_where_it_is_first_large():
    shapes = reduced(clamped(BRICK, *UNEQUAL), 10).modes.shapes
    for shape in shapes.T:
        size = np.abs(shape)
        assert shape[np.argmax(size >= 0.9 * size.max())] > 0.0


def test_a_rebuild_gives_identical_numbers():
    first, second = (reduced(clamped(BRICK, *BEAM), 6).modes for _ in range(2))
    assert first.angular_frequency.tobytes() == second.angular_frequency.tobytes()
    assert first.shapes.tobytes() == second.shapes.tobytes()


def test_single_modes_do_not_depend_on_the_numbering_of_nodes_and_elements(random):
    mesh = clamped(BRICK, *UNEQUAL)
    other, old = renumbered(mesh, random)
    one, two = reduced(mesh, 6).modes, reduced(other, 6).modes
    np.testing.assert_allclose(two.angular_frequency, one.angular_frequency, rtol=1e-9)
    shapes = one.shapes.reshape(-1, 3, 6)[old].reshape(-1, 6)
    # The sign goes by the first large component, which is another node now.
    shapes = shapes * np.sign(np.sum(shapes * two.shapes, axis=0))
    assert np.abs(two.shapes - shapes).max() < ROUND_OFF * np.abs(shapes).max()


def test_a_pair_of_equal_frequency_spans_the_same_plane_in_any_numbering(random):
    mesh = clamped(BRICK, *BEAM)
    other, old = renumbered(mesh, random)
    one, two = reduced(mesh, 2), reduced(other, 2)
    before = one.modes.shapes.reshape(-1, 3, 2)[old].reshape(-1, 2)
    overlap = before.T @ two.mass @ two.modes.shapes
    assert np.abs(overlap.T @ overlap - np.eye(2)).max() < ROUND_OFF


def test_a_pair_torn_apart_by_the_number_of_modes_is_told():
    square = clamped(BRICK, *BEAM)
    assert [reduced(square, count).modes.splits_pair for count in (1, 2, 3, 4)] == [True, False, True, False]
    assert not reduced(clamped(BRICK, *UNEQUAL), 1).modes.splits_pair
    # As it is where the numbers are a list: of 0 and 1, and of 2 and 3, neither goes without the other.
    modes = reduced(square, 4).modes
    torn = {(0, 1): False, (0,): True, (1, 2, 3): True, (0, 1, 3): True, (2, 3): False}
    assert {chosen: chosen_modes(modes, np.array(chosen)).splits_pair for chosen in torn} == torn


def test_more_modes_than_degrees_of_freedom_are_refused_with_their_number():
    mesh = clamped(ElementType.C3D8, (1, 1, 1), (1.0, 1.0, 1.0))
    assert reduced(mesh, 10).modes.angular_frequency.size == 10
    with pytest.raises(BodyFileError, match=r"\[reduction\] modes = 11: the mesh has 12 free degrees of freedom"):
        reduced(mesh, 11)


def test_a_part_that_hangs_by_an_edge_is_refused():
    # Two bricks with one edge in common: the outer one swings about it without strain.
    for kind in EVERY_TYPE:
        mesh = held(with_sets(lattice(kind, [(0, 0, 0), (1, 1, 0)], lambda p: p), ROOT=lambda p: p[:, 0]), "ROOT")
        with pytest.raises((ModelError, AccuracyError), match=r"free to move|hang on the rest by a single edge"):
            reduced(mesh, 3)


class Noisy:
    """A model whose static solutions are off by round-off: each in its own way, by so much of its energy."""

    def __init__(self, model, share, random):
        self._model, self._share, self._random = model, share, random

    def __getattr__(self, name):
        return getattr(self._model, name)

    def static(self, loads):
        found, noise = self._model.static(loads), self._random.standard_normal(loads.shape)
        k = self._model.stiffness
        size = [np.sqrt(np.einsum("ij,ij->j", x, k @ x)) for x in (found, noise)]
        return found + np.sqrt(self._share) * noise * size[0] / size[1]


def test_one_load_given_twice_adds_a_shape_once_whatever_the_round_off_of_its_solution(random):
    mesh = clamped(ElementType.C3D20, (6, 1, 1), (1.0, 0.1, 0.1))
    k, m = stiffness(mesh), mass(mesh)
    model = supported(eliminated(k, m, unknowns(mesh.fixed, mesh.equations)), np.zeros((k.shape[0], 0)))
    load = np.zeros((k.shape[0], 1))
    load[3 * int(np.argmax(mesh.points.sum(axis=1))) + 1] = 1.0
    modes = normal_modes(model, 3)
    once = with_residual_flexibility(model, modes, load)
    twice = with_residual_flexibility(Noisy(model, 5e-12, random), modes, np.hstack([load, load]))
    assert once.angular_frequency.size == twice.angular_frequency.size == 4
    np.testing.assert_allclose(twice.angular_frequency, once.angular_frequency, rtol=1e-5)


def test_the_spread_of_a_mode_is_that_of_the_vibrations_it_is_made_of():
    """λ Σ c²/λ_i − 1 over all vibrations of a mesh, with λ = Σ c² λ_i: by the dense eigenproblem."""
    mesh = clamped(ElementType.C3D20, (2, 2, 2), (0.3, 0.1, 0.13))
    k, m = stiffness(mesh), mass(mesh)
    model = supported(eliminated(k, m, unknowns(mesh.fixed, mesh.equations)), np.zeros((k.shape[0], 0)))
    loads = np.random.default_rng(5).standard_normal((k.shape[0], 2))
    found = with_residual_flexibility(model, normal_modes(model, 3), loads)
    values, vectors = scipy.linalg.eigh(model.stiffness.toarray(), model.mass.toarray())
    share = (vectors.T @ (model.mass @ model.unknowns.of(found.shapes))) ** 2
    spread = frequency_spread(model, found.angular_frequency, found.shapes)
    np.testing.assert_array_equal(spread[:3], 0.0)
    assert np.all(spread[3:] > 0.01)
    np.testing.assert_allclose(spread, (values @ share) * (1.0 / values @ share) - 1.0, rtol=1e-6, atol=1e-8)


def test_soft_modes_are_exact_beside_motions_of_hardly_any_mass():
    """Of beams with masses at few nodes 16 digits do not part these from how other nodes turn."""
    stiff, few = 1e15, np.arange(1.0, 4.0)
    coupling = 0.3 * np.array([[1.0, 0.5, -0.7], [0.2, -1.0, 0.4], [0.9, 0.1, 0.6]])
    k, m = np.diag([*few, *(stiff * few)]), np.block([[np.eye(3), coupling], [coupling.T, np.eye(3)]])
    squares, modes = _rayleigh_ritz(sp.csr_array(k), sp.csr_array(m), np.eye(6))
    # Of a stiff part that follows the soft one without strain, as it does to one in 10¹⁵.
    np.testing.assert_allclose(squares[:3], few, rtol=1e-12)
    np.testing.assert_allclose(modes.T[:3] @ k @ modes[:, :3], np.diag(few), atol=1e-12)
