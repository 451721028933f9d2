"""What springs read of their ends: nothing of a common motion, closed forms of one end's, forces that are slopes."""

import numpy as np
import pytest

from flexfmu.mesh.model import Along, SpringDamper
from flexfmu.model.rotations import rotation_vector, turned_by
from flexfmu.reduction.bushings import Bushings, SpringReading
from turns import exponential

NONE = np.zeros(0, dtype=np.int64)
TURN, SHIFT = np.array([0.7, -0.4, 0.9]), np.array([0.3, -0.2, 0.5])


@pytest.fixture(params=[0, 1, 2])
def points(request):
    """Nine nodes about one place, in a plane, and nine about another."""
    random = np.random.default_rng(request.param)
    found = random.normal(size=(18, 3))
    found[:9, 0] = 0.2
    return found + np.repeat([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5]], 9, axis=0)


def spring(points, along, second=True):
    first, other = np.arange(9), np.arange(9, 18) if second else NONE
    if along is Along.LINE:
        first, other = first[:1], other[:1]
    a = points[first].mean(axis=0)
    b = points[other].mean(axis=0) if other.size else a
    axes = exponential(np.array([0.3, 0.2, -0.6]))
    return SpringDamper(
        "s", (first, other), np.array([a, b]), 0.4 * a + 0.6 * b, axes, np.arange(1.0, 7.0), np.zeros(6), along
    )


def values(reading, displacement):
    return reading.values(reading.rows @ displacement.ravel()[reading.columns])


def moved(points, turn=TURN, shift=SHIFT):
    return points @ exponential(turn).T + shift - points


@pytest.mark.parametrize("along", [Along.END, Along.LINE])
def test_a_common_turn_of_both_ends_strains_no_spring(points, along):
    reading = SpringReading(points, spring(points, along))
    np.testing.assert_allclose(values(reading, moved(points)), 0.0, atol=1e-12)


def test_an_end_that_turns_against_the_ground_reads_its_shift_and_its_rotation_vector(points):
    one = spring(points, Along.END, second=False)
    reading = SpringReading(points, one)
    centre = one.places[0]
    whole = np.concatenate([centre @ exponential(TURN).T + SHIFT - centre, TURN])
    np.testing.assert_allclose(values(reading, moved(points)), np.kron(np.eye(2), one.axes) @ whole, atol=1e-12)


def test_a_spring_along_its_line_reads_the_change_of_its_length(points):
    change = np.random.default_rng(0).normal(size=points.shape)
    ends = points[[0, 9]], (points + change)[[0, 9]]
    length = [np.linalg.norm(both[1] - both[0]) for both in ends]
    found = values(SpringReading(points, spring(points, Along.LINE)), change)
    np.testing.assert_allclose(found, [length[1] - length[0], 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("along", Along)
def test_forces_are_the_slope_of_the_energy_and_their_derivative_theirs(points, along):
    reading, random, size = SpringReading(points, spring(points, along)), np.random.default_rng(5), 1e-5
    change, way = 0.1 * random.normal(size=54), random.normal(size=54)

    def energy(displacement):
        return 0.5 * reading.spring.stiffness @ values(reading, displacement) ** 2

    force, tangent = reading.force(change, 1.0)
    ahead, behind = change + size * way, change - size * way
    assert force @ way[reading.columns] == pytest.approx((energy(ahead) - energy(behind)) / (2.0 * size), rel=1e-6)
    slope = (reading.force(ahead, 1.0)[0] - reading.force(behind, 1.0)[0]) / (2.0 * size)
    np.testing.assert_allclose(tangent @ way[reading.columns], slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("along", Along)
def test_curvature_is_the_second_derivative_of_what_rows_read(points, along):
    one, size = spring(points, along), 1e-3
    reading, bushings, shapes = (
        SpringReading(points, one),
        Bushings(points, [one]),
        np.random.default_rng(6).normal(size=(54, 3)),
    )
    root = np.sqrt(one.stiffness)

    def found(q):
        return root * values(reading, shapes @ q)

    q = np.array([0.2, -0.3, 0.1])
    np.testing.assert_allclose(
        (found(size * q) - found(-size * q)) / (2.0 * size), bushings.rows @ shapes @ q, rtol=1e-5, atol=1e-6
    )
    second = (found(size * q) + found(-size * q)) / size**2
    expected = np.einsum("kab,a,b->k", bushings.curvature(shapes), q, q)
    np.testing.assert_allclose(second, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("size", [1e-12, 3e-5, 0.99e-4, 1.01e-4, 0.1, 2.0])
def test_turns_of_any_size_are_those_of_their_rotation_vectors(size):
    """Next to none they come from a series, which is as exact as what goes on from there."""
    vectors = np.random.default_rng(0).normal(size=(20, 3))
    vectors *= size / np.linalg.norm(vectors, axis=1)[:, None]
    np.testing.assert_allclose(turned_by(vectors), exponential(vectors), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(rotation_vector(exponential(vectors)), vectors, rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("size", [0.3, 30.0, 3e4])
def test_third_order_of_what_a_spring_reads_grows_with_the_cube_of_motions_far_beyond_its_ends(points, size):
    """Ends of thin beams go farther than they are wide, where no rotation fits them: builds ended in a traceback."""
    one, random = Bushings(points, [spring(points, Along.END)]), np.random.default_rng(7)
    shapes, amplitudes = random.normal(size=(54, 3)), random.normal(size=(3, 4))
    expected = 1e3 * size**3 * one.third(shapes, 0.1 * amplitudes)
    np.testing.assert_allclose(one.third(shapes, size * amplitudes), expected, atol=1e-6 * np.abs(expected).max())
