"""The clamped beam as a line that bends and does not stretch."""

import numpy as np
import scipy.integrate

MASS = 7850.0 * 0.03**2
STIFFNESS = 2e11 * 0.03**4 / 12.0


def heavy_elastica(acceleration):
    """Tip (x, y) of an inextensible cantilever of length 1 under its own weight along −y."""
    load = MASS * acceleration / STIFFNESS

    def slope(s, state):
        return [state[1], load * (1.0 - s) * np.cos(state[0])]

    def ends(left, right):
        return [left[0], right[1]]

    s = np.linspace(0.0, 1.0, 201)
    guess = np.array([-load / 6.0 * (1 - (1 - s) ** 3), -load / 2.0 * (1 - s) ** 2])
    solution = scipy.integrate.solve_bvp(slope, ends, s, guess, tol=1e-8)
    assert solution.success
    angle = solution.sol(s)[0]
    return np.array([scipy.integrate.simpson(np.cos(angle), x=s), scipy.integrate.simpson(np.sin(angle), x=s)])
