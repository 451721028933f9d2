"""Rotations that take complex arguments."""

import numpy as np

# Below this square of the angle the series is exact to round-off with so many terms.
SMALL, TERMS = 0.25, 9


def hat(a):
    """Matrix of the vector product, (..., 3) → (..., 3, 3)."""
    zero = np.zeros_like(a[..., 0])
    rows = [[zero, -a[..., 2], a[..., 1]], [a[..., 2], zero, -a[..., 0]], [-a[..., 1], a[..., 0], zero]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def axial(a):
    """Vector of the antisymmetric part of a matrix; `hat` backwards."""
    return 0.5 * np.array([a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]])


def exponential(vector):
    """exp of `hat` of a vector (3,), by O. Rodrigues' formula: its coefficients are entire in the square."""
    square = np.sum(vector * vector)
    if abs(square) < SMALL:
        first, second, term = 0.0, 0.0, 1.0 + 0.0j
        for k in range(TERMS):
            # term = (−s)^k / (2k)!
            first, second = first + term / (2 * k + 1), second + term / ((2 * k + 1) * (2 * k + 2))
            term = -term * square / ((2 * k + 1) * (2 * k + 2))
    else:
        angle = np.sqrt(square + 0.0j)
        first, second = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    turn = hat(vector)
    return np.eye(3) + first * turn + second * turn @ turn
