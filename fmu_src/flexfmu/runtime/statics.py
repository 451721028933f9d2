"""Equilibrium Λq = Q(q) under constant loads, by Newton's method with load increments where it needs them."""

import math

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, configuration_at, modal_force, spread, tangent_stiffness
from .errors import EquilibriumError
from .loads import Loads
from .ties import foreseen_tension
from .tree import jacobians

FloatArray = NDArray[np.float64]

# Newton converges in 4 to 6 iterations or not at all; more increments are cheaper than more iterations.
_MAX_ITERATIONS = 15
# ‖ΔΩq‖ / ‖Ωq‖; the last Newton iteration squares it.
_TOLERANCE = 1e-9
# Round-off leaves a tangent that has a potential symmetric to this.
_SYMMETRIC = 1e-9
# What an iteration costs, in internal steps of ordinary cost that are compiled.
_STEPS_PER_ITERATION = 20
# Halving the increment ten times: a load that still fails is at a limit point.
_SMALLEST_INCREMENT = 2.0**-10


def equilibrium(dynamics: Dynamics, loads: Loads, most: float = math.inf) -> tuple[FloatArray, int]:
    """Stable equilibrium on the path from the unloaded body.

    Parameters
    ----------
    dynamics : Dynamics
    loads : Loads
    most : float
        Work accepted, as of `StepLimits.most`.

    Returns
    -------
    q : (m,) float
        Modal coordinates, kg^1/2 m.
    iterations : int
        Newton iterations in all.

    Raises
    ------
    EquilibriumError
        The body is free to move, or the load exceeds what it can bear in a stable way, or bends it further than the
        kinematics reach, or the way there is more work than accepted.
    """
    free = int(np.sum(dynamics.stiffness == 0.0))
    if free:
        raise EquilibriumError(
            f"the body is free to move in {free} rigid motions and has no equilibrium of its own: fix an interface, or "
            "start at rest",
            0.0,
        )
    full = spread(dynamics, loads)
    q: FloatArray = np.zeros(dynamics.stiffness.size)
    if not full.active:
        return full.constant / dynamics.stiffness, 0
    reached, increment, iterations = 0.0, 1.0, 0
    while reached < 1.0:
        if iterations * _STEPS_PER_ITERATION >= most:
            raise EquilibriumError(
                f"{100.0 * reached:.3g} % of the load are reached after {iterations} iterations, which cost as much as "
                f"{most:.6g} internal steps (internal_step.most): the load is near the critical one, or bends the body "
                "very far; lower it, or raise internal_step.most",
                reached,
            )
        target = min(1.0, reached + increment)
        solution, used = _newton(dynamics, loads.scaled(target), q)
        iterations += used
        if solution is not None:
            q, reached = solution, target
            increment *= 2.0
            continue
        increment *= 0.5
        if increment < _SMALLEST_INCREMENT:
            raise EquilibriumError(
                f"no stable equilibrium beyond {100.0 * reached:.1f} % of the load: it is near or above the critical "
                "load of the reduced body; lower the load, or check its direction and units",
                reached,
            )
    return q, iterations


def _newton(dynamics: Dynamics, loads: Loads, start: FloatArray) -> tuple[FloatArray | None, int]:
    """Newton's method from `start`; None where it fails or ends in an unstable equilibrium."""
    at_nodes = spread(dynamics, loads)
    omega = np.sqrt(dynamics.stiffness)
    # Scaled by Ω the tangent is I minus something small, and errors are measured in energy.
    q, tense = start, None
    for iteration in range(1, _MAX_ITERATIONS + 1):
        state = configuration_at(dynamics, q)
        residual = dynamics.stiffness * q - modal_force(dynamics, at_nodes, state)
        tangent = tangent_stiffness(dynamics, at_nodes, state, tense) / np.outer(omega, omega)
        if not _stable(tangent):
            return None, iteration
        change = np.linalg.solve(tangent, residual / omega)
        q = q - change / omega
        if dynamics.ties is not None:
            tense = foreseen_tension(dynamics.ties, state, *jacobians(dynamics.tree, state), -change / omega)
        size = float(np.linalg.norm(change))
        if not np.isfinite(size):
            return None, iteration
        noise = 0.0 if dynamics.ties is None else dynamics.ties.noise
        if size <= max(_TOLERANCE * float(np.linalg.norm(omega * q)), noise):
            return q, iteration
    return None, _MAX_ITERATIONS


def _stable(tangent: FloatArray) -> bool:
    """Whether a tangent (m, m) gives way in no direction: no eigenvalue has lost its positive real part.

    Without a potential the tangent is not symmetric, and its symmetric part may be indefinite where the body is stable.
    """
    if not np.all(np.isfinite(tangent)):
        return False
    if np.max(np.abs(tangent - tangent.T)) <= _SYMMETRIC * np.max(np.abs(tangent)):
        return bool(np.linalg.eigvalsh(tangent)[0] > 0.0)
    return bool(np.min(np.linalg.eigvals(tangent).real) > 0.0)
