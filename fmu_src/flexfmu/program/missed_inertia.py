"""What constant mass leaves out of the kinetic energy, to second order in q (docs/theory.md, section 9).

A body with constant mass is watched for it: v·(M(q) − 1) v is a polynomial of the slow coordinates. Its coefficients
follow once from the mass of the lumps that frames carry.
"""

import numpy as np

from ..core import Core
from ..files.array_types import FloatArray
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from .compile import compile_program
from .mechanics import inertial_modes

# Largest turn of a frame in the differences, rad: their error is its square, and round-off over it.
_TURN = 1e-3


def missed_inertia(body: ReducedBody) -> FloatArray:
    """Coefficients (p, r + p) of v·(M(q) − 1) v by pairs of rates, and by coordinates and pairs of them.

    Parameters
    ----------
    body : ReducedBody
        With frames and lumps, and without rigid motions.

    Returns
    -------
    (p, r + p) float
        p = r (r + 1)/2 pairs a ≤ b of the r slow coordinates, row by row.
    """
    count, core = inertial_modes(body), Core(compile_program(body, Method.FRAMES, Mass.CONFIGURATION))
    first, second = np.triu_indices(count)
    # v_a v_b stands for both halves of the matrix.
    weight = np.where(first == second, 1.0, 2.0)
    turn = np.linalg.norm(body.frame_rotation, axis=1).max(axis=0)
    ways = np.eye(body.mode_count)[:count] * (_TURN / np.maximum(turn, 1e-12 * turn.max()))[:count, None]
    size = ways.diagonal()

    def change(q: FloatArray) -> FloatArray:
        """M(q) by pairs."""
        result: FloatArray = weight * core.mass(q)[first, second]
        return result

    ahead, back = (np.array([change(sign * way) for way in ways]) for sign in (1.0, -1.0))
    linear = (ahead - back) / (2.0 * size[:, None])
    still, quadratic = change(np.zeros(body.mode_count)), []
    for a, b in zip(first, second, strict=True):
        if a == b:
            quadratic.append((ahead[a] + back[a] - 2.0 * still) / (2.0 * size[a] ** 2))
            continue
        both = sum(
            sign * change(ways[a] + sign * ways[b]) + sign * change(-ways[a] - sign * ways[b]) for sign in (1, -1)
        )
        quadratic.append(both / (4.0 * size[a] * size[b]))
    return np.concatenate([linear, np.array(quadratic)]).T
