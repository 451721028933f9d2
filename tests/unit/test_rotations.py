"""The matrix of the vector product."""

import numpy as np

from flexfmu.model.rotations import skew


def test_the_skew_matrix_makes_the_vector_product():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((5, 3)), rng.standard_normal((5, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(a), b), np.cross(a, b), atol=1e-15)
