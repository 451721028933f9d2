"""Spring-dampers between interfaces that move and turn far, as energies of six relative coordinates.

End a moves by u_a and turns by R_a, end b by u_b and R_b; both lay at the same place. Seen from b, the relative
coordinates are

    e = (R_bᵀ (u_a − u_b), log(R_bᵀ R_a)).

The spring has the energy ½ eᵀ K e, the damper the power ėᵀ D ė, and rates and loads follow from one matrix,

    ė = Bᵀ (v_a, ω_a, v_b, ω_b),   (f_a, m_a, f_b, m_b) = −B (K e + D ė).

The axes of K and D are the global ones at first and turn with b; the ground does not turn. A motion that both ends
share leaves e as it is, so forces and moments balance, about any point: b also bears the moment of the force at a.
"""

from dataclasses import dataclass

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..model.rotations import exponential, exponential_and_jacobian, rotation_vector, skew


@dataclass(frozen=True, slots=True)
class Springs:
    """N spring-dampers between E ends.

    Attributes
    ----------
    a, b : (N,) int
        Ends; E is the ground.
    stiffness : (N, 6) float
        N/m, then N m/rad; along the axes that turn with b.
    damping : (N, 6) float
        N s/m, then N m s/rad.
    """

    a: IntArray
    b: IntArray
    stiffness: FloatArray
    damping: FloatArray


def relative_motion(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relative coordinates e and matrix B of the module's docstring.

    Parameters
    ----------
    a, b : (..., 6) float
        Displacement (m) and rotation vector (rad) of the ends, global axes.

    Returns
    -------
    relative : (..., 6) float
        m, rad.
    matrix : (..., 12, 6) float
        B: rows are force and moment on a, then on b.
    """
    turn_a, turn_b = exponential(np.stack([a[..., 3:], b[..., 3:]]))
    back = np.swapaxes(turn_b, -1, -2)
    distance = a[..., :3] - b[..., :3]
    angles = rotation_vector(back @ turn_a)
    relative = np.concatenate([(back @ distance[..., None])[..., 0], angles], axis=-1)
    jacobian = exponential_and_jacobian(angles)[1]
    moment = turn_b @ np.swapaxes(np.linalg.inv(jacobian), -1, -2)
    matrix = np.zeros((*relative.shape[:-1], 12, 6))
    matrix[..., :3, :3] = turn_b
    matrix[..., 6:9, :3] = -turn_b
    matrix[..., 9:, :3] = -skew(distance) @ turn_b
    matrix[..., 3:6, 3:] = moment
    matrix[..., 9:, 3:] = -moment
    return relative, matrix


def backward_rates(motion: FloatArray, before: FloatArray, step: float) -> FloatArray:
    """Velocity and angular velocity from the motion at two communication points.

    Parameters
    ----------
    motion, before : (..., 6) float
        Displacement (m) and rotation vector (rad), now and a step ago.
    step : float
        s.

    Returns
    -------
    (..., 6) float
        m/s, rad/s; global axes.
    """
    turn = exponential(motion[..., 3:]) @ np.swapaxes(exponential(before[..., 3:]), -1, -2)
    return np.concatenate([motion[..., :3] - before[..., :3], rotation_vector(turn)], axis=-1) / step


def loads(springs: Springs, motion: FloatArray, rates: FloatArray) -> FloatArray:
    """Forces and moments of all springs on the ends.

    Parameters
    ----------
    springs : Springs
    motion : (E, 6) float
        Displacement (m) and rotation vector (rad).
    rates : (E, 6) float
        Velocity (m/s) and angular velocity (rad/s).

    Returns
    -------
    (E, 6) float
        N, N m.
    """
    a, b = _ends(springs, motion)
    relative, matrix = relative_motion(a, b)
    speed = np.einsum("nij,ni->nj", matrix, np.concatenate(_ends(springs, rates), axis=-1))
    stress = springs.stiffness * relative + springs.damping * speed
    result = np.zeros((len(motion) + 1, 6))
    each = -np.einsum("nij,nj->ni", matrix, stress)
    np.add.at(result, springs.a, each[:, :6])
    np.add.at(result, springs.b, each[:, 6:])
    return result[:-1]


def tangent(springs: Springs, motion: FloatArray, rates_by_motion: FloatArray) -> FloatArray:
    """Derivative of the loads with respect to small displacements and turns of the ends.

    The change of B is left out: it is the loads over the size of the body, against the stiffness.

    Parameters
    ----------
    springs : Springs
    motion : (E, 6) float
        Displacement (m) and rotation vector (rad).
    rates_by_motion : (E,) float
        By how much an end's rates change with its motion, 1/s.

    Returns
    -------
    (6E, 6E) float
        N/m, N/rad, N m/m, N m/rad; row by column of ends, six each.
    """
    a, b = _ends(springs, motion)
    _, matrix = relative_motion(a, b)
    ground = np.append(rates_by_motion, 0.0)
    by_motion = np.repeat(np.stack([ground[springs.a], ground[springs.b]], axis=-1), 6, axis=-1)
    inner = springs.stiffness[:, :, None] + springs.damping[:, :, None] * by_motion[:, None, :]
    each = -matrix @ (inner * np.swapaxes(matrix, -1, -2))
    count = 6 * (len(motion) + 1)
    result = np.zeros((count, count))
    for k, block in enumerate(each):
        place = np.concatenate([6 * springs.a[k] + np.arange(6), 6 * springs.b[k] + np.arange(6)])
        result[np.ix_(place, place)] += block
    return result[:-6, :-6]


def energy(springs: Springs, motion: FloatArray) -> float:
    """Energy ½ eᵀ K e of all springs.

    Parameters
    ----------
    springs : Springs
    motion : (E, 6) float
        Displacement (m) and rotation vector (rad).

    Returns
    -------
    float
        J.
    """
    relative, _ = relative_motion(*_ends(springs, motion))
    return 0.5 * float(np.sum(springs.stiffness * relative**2))


def losses(springs: Springs, motion: FloatArray, before: FloatArray, step: float) -> float:
    """Energy that the dampers take over a step in which the relative coordinates change evenly.

    Parameters
    ----------
    springs : Springs
    motion, before : (E, 6) float
        Displacement (m) and rotation vector (rad) at the step's end and beginning.
    step : float
        s.

    Returns
    -------
    float
        J.
    """
    now, _ = relative_motion(*_ends(springs, motion))
    then, _ = relative_motion(*_ends(springs, before))
    return float(np.sum(springs.damping * (now - then) ** 2)) / step


def _ends(springs: Springs, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (N, 6) at a and at b; the ground's are zero."""
    grounded = np.vstack([values, np.zeros((1, 6))])
    return grounded[springs.a], grounded[springs.b]
