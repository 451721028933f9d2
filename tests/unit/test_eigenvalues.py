"""Eigenvalues that tell whether a body is stable: those of any matrix, and the smallest of a symmetric one."""

import numpy as np
import pytest

from coupling_core import congruent, smallest_eigen, smallest_real_part

SIZES = pytest.mark.parametrize("size", [1, 2, 3, 4, 7, 12])


def with_blocks(blocks, random):
    """A matrix of no symmetry that has the eigenvalues of 1 x 1 and 2 x 2 blocks."""
    size = sum(len(block) for block in blocks)
    matrix, at = np.triu(random.standard_normal((size, size)), 1), 0
    for block in blocks:
        matrix[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    basis = np.linalg.qr(random.standard_normal((size, size)))[0]
    return basis @ matrix @ basis.T


@SIZES
def test_the_smallest_of_real_eigenvalues_is_found(size, random):
    values = random.uniform(0.5, 2.0, size)
    for k in range(size):
        values[k] = -1.0
        matrix = with_blocks([[[value]] for value in values], random)
        assert smallest_real_part(matrix.copy()) == pytest.approx(-1.0, rel=1e-9)
        values[k] = 1.0


@pytest.mark.parametrize("real", [0, 1, 4])
def test_a_pair_that_vibrates_counts_by_how_it_grows(real, random):
    pairs = [np.array([[rate, fast], [-fast, rate]]) for rate, fast in ((0.3, 5.0), (-0.2, 40.0), (0.1, 2.0))]
    matrix = with_blocks([*pairs, *([[value]] for value in random.uniform(0.0, 1.0, real))], random)
    assert smallest_real_part(matrix.copy()) == pytest.approx(-0.2, rel=1e-9)


@SIZES
@pytest.mark.parametrize("shift", [0.0, 3.0, -1e3])
def test_eigenvalues_on_a_circle_are_found_wherever_it_lies(size, shift):
    """Steps that such a matrix suggests lead nowhere: all of its eigenvalues have the same size."""
    matrix = np.roll(np.eye(size), 1, axis=0) + shift * np.eye(size)
    expected = shift + np.cos(2.0 * np.pi * np.arange(size) / size).min()
    assert smallest_real_part(matrix.copy()) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@SIZES
def test_the_smallest_eigenvalue_of_a_symmetric_matrix_and_its_vector(size, random):
    matrix = random.standard_normal((size, size))
    matrix += matrix.T
    values, vectors = np.linalg.eigh(matrix)
    value, vector = smallest_eigen(matrix.copy())
    assert value == pytest.approx(values[0], rel=1e-12)
    assert abs(vector @ vectors[:, 0]) == pytest.approx(1.0, rel=1e-12)


@SIZES
def test_a_stiffness_over_another_is_symmetric_and_has_the_eigenvalues_of_both(size, random):
    roots = random.standard_normal((2, size, size))
    tangent, unloaded = roots @ roots.swapaxes(1, 2) + [[[-1.0]], [[1.0]]] * np.eye(size)
    lower = np.linalg.cholesky(unloaded)
    found = congruent(lower, tangent)
    np.testing.assert_allclose(found, found.T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(lower @ found @ lower.T, tangent, rtol=1e-10, atol=1e-12)


@SIZES
def test_done_by_several_calls_it_is_the_same_and_costs_what_was_counted_before(size, random):
    matrix = random.standard_normal((size, size))
    matrix += matrix.T
    value, vector = smallest_eigen(matrix.copy())
    for calls in (1, 3, 10):
        found, along, taken, (counted, spent) = smallest_eigen(matrix.copy(), calls)
        assert found == value
        np.testing.assert_array_equal(along, vector)
        assert calls <= taken <= calls + 2
        assert spent == pytest.approx(counted, rel=1e-9)
        assert counted < 1e6
