"""Explicit evaluation: loads on the moving body as at a step's start, held over it (docs/theory.md, section 6).

Modes are propagated exactly, so that nothing but the lag of the loads makes a difference: a load that stiffens the body
feeds energy in, one that softens it takes energy away, at any step. How much, against what the body's own damping takes
care of, follows from the step's amplification matrix.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, between, configuration_at, modal_force, tangent_stiffness
from .propagation import Propagator
from .tree import Configuration

FloatArray = NDArray[np.float64]

# Motions that die within a step are not told apart from each other: their rates say nothing.
_DYING = 1.0


def explicit_substeps(
    dynamics: Dynamics,
    p: Propagator,
    loads: NodeLoads,
    end_loads: NodeLoads | None,
    q: FloatArray,
    v: FloatArray,
    here: Configuration,
    substeps: int,
) -> tuple[FloatArray, FloatArray, Configuration, float]:
    """Equal sub-steps, each under the modal force at its start.

    Parameters
    ----------
    dynamics : Dynamics
    p : Propagator
        Of a sub-step.
    loads : NodeLoads
        Over the step, or at its start.
    end_loads : NodeLoads or None
        At its end, where they are others.
    q, v : (m,) float
    here : Configuration
        At q.
    substeps : int

    Returns
    -------
    q, v : (m,) float
    there : Configuration
    error : float
        What the change of the modal force over a sub-step would do, relative, in the energy norm; the largest.
    """
    mean, worst = loads, 0.0
    growth = None if end_loads is None else (end_loads.constant - loads.constant) / substeps
    omega = np.sqrt(dynamics.stiffness)
    for number in range(substeps):
        if end_loads is not None:
            mean = between(loads, end_loads, (number + 0.5) / substeps)
        force = modal_force(dynamics, mean, here)
        q, v = p.p11 * q + p.p12 * v + p.gq * force, p.p21 * q + p.p22 * v + p.gv * force
        if growth is not None:
            q, v = q + p.ramp * growth, v + p.ramp_rate * growth
        here = configuration_at(dynamics, q)
        change = modal_force(dynamics, mean, here) - force
        size = math.hypot(float(np.linalg.norm(omega * q)), float(np.linalg.norm(v)))
        error = float(np.linalg.norm(dynamics.weight * p.gq * change))
        worst = max(worst, error / size if size > 0.0 else 0.0)
    return q, v, here, worst


@dataclass(frozen=True, slots=True)
class FeedRates:
    """How fast explicit evaluation feeds vibrations, and how fast the body damps the ones in question.

    Attributes
    ----------
    fed, fed_damping : float
        Growth beyond the true one in the vibration that is fed most, and its true decay; 1/s.
    taken, taken_damping : float
        The same of the vibration from which most is taken.
    """

    fed: float = 0.0
    fed_damping: float = 0.0
    taken: float = 0.0
    taken_damping: float = 0.0


@dataclass(frozen=True, slots=True)
class Feed:
    """Share of the motion's amplitude that evaluation has added and taken so far, what damping ate left out.

    A share x grows by dx/dt = rate − damping x: without damping it adds up, with damping it settles at the part of the
    damping ratio that evaluation makes up for.

    Attributes
    ----------
    fed, taken : float
    """

    fed: float = 0.0
    taken: float = 0.0

    @property
    def largest(self) -> float:
        """The larger of both."""
        return max(self.fed, self.taken)

    def after(self, rates: FeedRates, time: float) -> "Feed":
        """Return what it is after some time (s) at given rates."""
        return Feed(
            _grown(self.fed, rates.fed, rates.fed_damping, time),
            _grown(self.taken, rates.taken, rates.taken_damping, time),
        )


def _grown(share: float, rate: float, damping: float, time: float) -> float:
    x = damping * time
    decay, gain = math.exp(-x), (-math.expm1(-x) / x if x > 0.0 else 1.0)
    return max(0.0, share * decay + rate * time * gain)


def feed_rates(
    dynamics: Dynamics, p: Propagator, loads: NodeLoads, state: Configuration, damping_ratio: FloatArray
) -> FeedRates:
    """What explicit evaluation does to the vibrations about a configuration.

    With S = ∂Q/∂q the state (q, q̇) of small vibrations goes over a step by

        A = [[P₁₁ + g_q S, P₁₂], [P₂₁ + g_v S, P₂₂]],    in truth by exp(hC), C = [[0, 1], [S − Λ, −2ZΩ]].

    Rates are those of A in the vibrations of C, and those of A itself where these are faster.

    Parameters
    ----------
    dynamics : Dynamics
    p : Propagator
        Of a sub-step.
    loads : NodeLoads
    state : Configuration
    damping_ratio : (m,) float

    Returns
    -------
    FeedRates
        All zero where no load depends on q.
    """
    if not loads.active:
        return FeedRates()
    elastic = dynamics.stiffness > 0.0
    every = np.diag(dynamics.stiffness) - tangent_stiffness(dynamics, loads, state)
    # In terms of Ωq both halves of the state are of one size.
    omega = np.sqrt(dynamics.stiffness[elastic])
    slope = every[np.ix_(elastic, elastic)] / omega
    diagonal = [np.diag(values[elastic]) for values in (p.p11, p.p12, p.p21, p.p22)]
    upper = [diagonal[0] + omega[:, None] * p.gq[elastic, None] * slope, omega[:, None] * diagonal[1]]
    lower = [diagonal[2] / omega + p.gv[elastic, None] * slope, diagonal[3]]
    amplification = np.block([upper, lower])
    if not np.all(np.isfinite(amplification)):
        return FeedRates(math.inf)
    turn = np.diag(omega)
    rate = np.block([[np.zeros_like(turn), turn], [slope - turn, -np.diag(2.0 * damping_ratio[elastic] * omega)]])
    true, shapes = np.linalg.eig(rate)
    growth = _growth(float(np.max(np.abs(np.linalg.eigvals(amplification)))), p.step)
    worst = float(np.max(true.real))
    found = FeedRates(growth - worst, max(-worst, 0.0))
    try:
        within = np.diag(np.linalg.solve(shapes, amplification @ shapes))
    except np.linalg.LinAlgError:
        return found
    slow = -true.real * p.step < _DYING
    if not np.any(slow):
        return found
    excess = np.array([_growth(abs(value), p.step) for value in within[slow]]) - true.real[slow]
    damping = np.maximum(-true.real[slow], 0.0)
    most, least = int(np.argmax(excess)), int(np.argmin(excess))
    if excess[most] >= found.fed:
        found = FeedRates(float(excess[most]), float(damping[most]))
    return FeedRates(found.fed, found.fed_damping, max(float(-excess[least]), 0.0), float(damping[least]))


def _growth(factor: float, step: float) -> float:
    """Rate (1/s) of what is multiplied by a factor in each step."""
    return math.log(max(factor, 1e-300)) / step
