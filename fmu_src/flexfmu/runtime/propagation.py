"""Exact propagation of damped linear modes over a step of any length (docs/theory.md, section 6).

Each mode obeys q̈ + 2ζω q̇ + ω² q = Q. With Q constant over the step h its solution is

    q(h) = P₁₁ q + P₁₂ q̇ + g_q Q,      q̇(h) = P₂₁ q + P₂₂ q̇ + g_v Q,

without period error and without a limit on h. Source: e.g. M. Géradin, D. J. Rixen, Mechanical Vibrations, 3rd ed.,
section 2.8 (Duhamel's integral).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Below this h·ω the ramp response is taken from its series, where the closed form would cancel.
_SMALL_ANGLE = 1e-2


@dataclass(frozen=True, slots=True)
class Propagator:
    """Coefficients of one step for m modes.

    Attributes
    ----------
    step : float
        h, s.
    p11, p12, p21, p22 : (m,) float
        Free response.
    gq, gv : (m,) float
        Response at the step's end to a unit modal force that acts over it: s² and s.
    ramp, ramp_rate : (m,) float
        Response of q (s²) and of its rate (s) to a unit modal force growing from −1/2 to 1/2 over the step: what a
        force that varies over the step does beyond its mean.
    """

    step: float
    p11: FloatArray
    p12: FloatArray
    p21: FloatArray
    p22: FloatArray
    gq: FloatArray
    gv: FloatArray
    ramp: FloatArray
    ramp_rate: FloatArray


def propagator(angular_frequency: FloatArray, damping_ratio: FloatArray, step: float) -> Propagator:
    """Coefficients for modes of any damping, overdamped ones included.

    Parameters
    ----------
    angular_frequency : (m,) float
        ω ≥ 0, rad/s.
    damping_ratio : (m,) float
        ζ ≥ 0.
    step : float
        h > 0, s.

    Returns
    -------
    Propagator
    """
    w, z, h = angular_frequency, damping_ratio, step
    x = w * h
    decay = np.exp(-z * x)
    # Under-damped: cos and sin at the damped frequency; over-damped: the two real exponentials, which cannot overflow.
    root = np.sqrt(np.abs(1.0 - z * z)) * x
    over = z > 1.0
    near = root < 1e-5
    safe = np.where(near, 1.0, root)
    fast, slow = np.exp(-z * x - np.where(over, root, 0.0)), np.exp(-z * x + np.where(over, root, 0.0))
    cosine = np.where(over, 0.5 * (slow + fast), decay * np.cos(root))
    # Next to critical damping, and for the shortest steps, two terms of the series are exact.
    series = decay * (1.0 - (1.0 - z * z) * x * x / 6.0)
    sinc = np.where(near, series, np.where(over, -0.5 * slow * np.expm1(-2.0 * root), decay * np.sin(root)) / safe)

    p11 = cosine + z * x * sinc
    p12 = h * sinc
    p21 = -w * w * p12
    p22 = cosine - z * x * sinc
    # 1 − P₁₁ without cancelling for short steps: what the cosine lacks of the decay, then what the decay lacks of 1.
    lack = np.where(over, -0.5 * slow * np.expm1(-root) ** 2, 2.0 * decay * np.sin(0.5 * root) ** 2)
    free = w == 0.0
    square = np.where(free, 1.0, w * w)
    gq = np.where(free, 0.5 * h * h, (lack - np.expm1(-z * x) - z * x * sinc) / square)
    gv = p12
    ramp_end = np.where(x < _SMALL_ANGLE, h * h / 6.0 * (1.0 - z * x / 2.0), (h - gv - 2.0 * z * w * gq) / (square * h))
    return Propagator(h, p11, p12, p21, p22, gq, gv, ramp_end - 0.5 * gq, gq / h - 0.5 * gv)
