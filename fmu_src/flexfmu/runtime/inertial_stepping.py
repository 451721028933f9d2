"""Time steps with the mass of the deformed body (docs/theory.md, section 9); the rule of `stepping` with one addition.

The modes feel what the mass has beyond that of the undeformed body, ΔM = M − I, as a force. Its mean over the step is

    Q̄ = Q(q̄) + ½ ∂(v̄ᵀ M v̄)/∂q (q̄) − (ΔM₁v₁ − ΔM₀v₀)/h + c Δq,     q̄ = ½(q₀ + q₁),   v̄ = ½(v₀ + v₁),

with the one number c for which Q̄·Δq = J₁ − J₀ − ½ (v₁ᵀΔM₁v₁ − v₀ᵀΔM₀v₀). An undamped mode gains exactly Q̄·Δq, so that
½ vᵀMv + strain energy − work of dead forces is the same after the step as before it, whatever its length. The rule is
symmetric and of second order. Momentum enters by its difference, not by impulses at the ends, so that modes which the
step does not resolve are pushed as they would be by a force that is spread over it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import (
    Dynamics,
    NodeLoads,
    between,
    configuration_at,
    force_work,
    modal_force,
    tangent_stiffness,
    work_reach,
)
from .inertia import InertiaIntegrals, convective_force, kinetic_gradient, mass_gradient, mass_matrix
from .propagation import Propagator
from .tree import Configuration

FloatArray = NDArray[np.float64]

# As in `stepping`, of which this is a branch.
_TOLERANCE = 1e-12
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps
# Change below which the gradient of M is left as it is: energy does not depend on it, and the rest far below the error.
_SETTLED = 1e-6
_FIXED_POINT_ROUNDS = 8
_NEWTON_ROUNDS = 12


@dataclass(frozen=True, slots=True)
class _Moment:
    """One end of a sub-step.

    Attributes
    ----------
    q, v : (m,) float
    here : Configuration
        At q.
    excess : (m, m) float
        M(q) − I.
    force : (m,) float
        All that acts on the modes there, inertia included: q̈ + Λq, damping apart.
    work : float or None
        J(q).
    """

    q: FloatArray
    v: FloatArray
    here: Configuration
    excess: FloatArray
    force: FloatArray
    work: float | None


def inertial_substeps(
    dynamics: Dynamics,
    inertia: InertiaIntegrals,
    p: Propagator,
    loads: NodeLoads,
    end_loads: NodeLoads | None,
    q: FloatArray,
    v: FloatArray,
    here: Configuration,
    substeps: int,
    tolerance: float,
    most: int,
) -> tuple[tuple[FloatArray, FloatArray, Configuration] | None, int, float]:
    """Equal sub-steps; None for the state where one of them fails or errs too much.

    Parameters
    ----------
    dynamics : Dynamics
    inertia : InertiaIntegrals
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
    tolerance : float
        Error accepted in a sub-step, relative, in the energy norm.
    most : int
        Rounds of the iteration after which no sub-step is begun.

    Returns
    -------
    state : tuple of (m,) float, (m,) float and Configuration, or None
    rounds : int
        Of the iteration.
    error : float
        The largest of a sub-step.
    """
    omega = np.sqrt(dynamics.stiffness)
    mean, growth = loads, None
    if end_loads is not None:
        growth = (end_loads.constant - loads.constant) / substeps
    start = _moment(dynamics, inertia, mean, q, v, here)
    rounds, worst = 0, 0.0
    for number in range(substeps):
        if rounds >= most:
            return None, rounds, np.inf
        if end_loads is not None:
            mean = between(loads, end_loads, (number + 0.5) / substeps)
            start = _moment(dynamics, inertia, mean, start.q, start.v, start.here)
        solution, used = _implicit_step(dynamics, inertia, p, mean, growth, start)
        rounds += used
        if solution is None:
            return None, rounds, np.inf
        end = _moment(dynamics, inertia, mean, *solution, configuration_at(dynamics, solution[0]))
        # As in `stepping`: what the force's change over the sub-step would do beyond its mean is the leading error.
        size = math.hypot(_norm(omega * end.q), _norm(end.v))
        error = _norm(dynamics.weight * p.ramp * (end.force - start.force)) / size if size > 0.0 else 0.0
        worst = max(worst, error)
        if not worst <= tolerance:
            return None, rounds, worst
        start = end
    return (start.q, start.v, start.here), rounds, worst


def _moment(
    dynamics: Dynamics, inertia: InertiaIntegrals, loads: NodeLoads, q: FloatArray, v: FloatArray, here: Configuration
) -> _Moment:
    mass = mass_matrix(dynamics.tree, inertia, here)
    internal = dynamics.stiffness * q
    total = modal_force(dynamics, loads, here) - internal - convective_force(dynamics.tree, inertia, here, v)
    acceleration = _solve(mass, total)
    force = total if acceleration is None else acceleration
    return _Moment(q, v, here, mass - np.eye(q.size), force + internal, force_work(dynamics, loads, here))


def _implicit_step(
    dynamics: Dynamics,
    inertia: InertiaIntegrals,
    p: Propagator,
    loads: NodeLoads,
    growth: FloatArray | None,
    start: _Moment,
) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
    """Solve the rule for q₁ and v₁, by fixed point, then by Newton's method; None where it fails; number of rounds."""
    tree, identity, kick = dynamics.tree, np.eye(start.q.size), p.gv / p.step
    q0, v0, momentum = start.q, start.v, start.excess @ start.v
    free_q, free_v = p.p11 * q0 + p.p12 * v0, p.p21 * q0 + p.p22 * v0
    if growth is not None:
        # What loads that grow over the sub-step do beyond their mean; exact on the undeformed body.
        free_q, free_v = free_q + p.ramp * growth, free_v + p.ramp_rate * growth
    q1, v1 = free_q + p.gq * start.force, free_v + p.gv * start.force
    gradient: FloatArray = np.zeros_like(q0)
    newton: FloatArray | None = None
    size = np.inf
    for rounds in range(1, _FIXED_POINT_ROUNDS + _NEWTON_ROUNDS + 1):
        here, middle = configuration_at(dynamics, q1), configuration_at(dynamics, 0.5 * (q0 + q1))
        excess = mass_matrix(tree, inertia, here) - identity
        if size > _SETTLED:
            gradient = kinetic_gradient(tree, inertia, middle, 0.5 * (v0 + v1))
        force = modal_force(dynamics, loads, middle) + gradient
        impulse, difference = excess @ v1 - momentum, q1 - q0
        kinetic = 0.5 * float(v1 @ impulse + (v1 - v0) @ momentum)
        bracket = float(impulse @ difference) / p.step - float(gradient @ difference) - kinetic
        reach = abs(float(v1 @ excess @ v1)) + abs(float(v0 @ momentum))
        work = force_work(dynamics, loads, here)
        # A load without potential keeps its value in the middle.
        if start.work is not None and work is not None:
            forces = loads if loads.forces_only is None else loads.forces_only
            bracket += work - start.work - float(modal_force(dynamics, forces, middle) @ difference)
            reach += work_reach(tree, loads.force) + abs(start.work) + abs(work)
        if abs(bracket) > _ROUND_OFF * reach:
            force = force + bracket / float(difference @ difference) * difference
        if rounds > _FIXED_POINT_ROUNDS:
            mean = force - impulse / p.step
            if newton is None:
                newton = _newton_matrix(dynamics, inertia, p, loads, middle, excess, 0.5 * (v0 + v1))
            change = _solve(newton, np.concatenate([q1 - free_q - p.gq * mean, v1 - free_v - p.gv * mean]))
            if change is None:
                return None, rounds
            change_q, change_v = change[: q0.size], change[q0.size :]
        else:
            velocity = _solve(identity + kick[:, None] * excess, free_v + p.gv * force + kick * momentum)
            if velocity is None:
                return None, rounds
            mean = force - (excess @ velocity - momentum) / p.step
            change_q, change_v = q1 - free_q - p.gq * mean, v1 - velocity
        q1, v1 = q1 - change_q, v1 - change_v
        scale = math.hypot(_norm(dynamics.weight * q1), _norm(v1))
        size = math.hypot(_norm(dynamics.weight * change_q), _norm(change_v)) / scale if scale > 0.0 else 0.0
        if not math.isfinite(size):
            return None, rounds
        if size <= _TOLERANCE:
            return (q1, v1), rounds
    return None, _FIXED_POINT_ROUNDS + _NEWTON_ROUNDS


def _newton_matrix(
    dynamics: Dynamics,
    inertia: InertiaIntegrals,
    p: Propagator,
    loads: NodeLoads,
    middle: Configuration,
    excess: FloatArray,
    rate: FloatArray,
) -> FloatArray:
    """Derivative (2m, 2m) of the rule's residual by q₁ and v₁, but for second derivatives of M."""
    m = rate.size
    load = 0.5 * (np.diag(dynamics.stiffness) - tangent_stiffness(dynamics, loads, middle))
    # ∂(M v)/∂q
    slope = mass_gradient(dynamics.tree, inertia, middle, np.eye(m), np.tile(rate, (m, 1)))
    by_q, by_v = load - slope / p.step, 0.5 * slope.T - excess / p.step
    result = np.eye(2 * m)
    for rows, mean in ((slice(m), p.gq), (slice(m, None), p.gv)):
        result[rows, :m] -= mean[:, None] * by_q
        result[rows, m:] -= mean[:, None] * by_v
    return result


def _norm(vector: FloatArray) -> float:
    """Euclidean norm, without the overhead of the general one."""
    return math.sqrt(vector @ vector)


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray | None:
    try:
        result: FloatArray = np.linalg.solve(matrix, right).astype(np.float64, copy=False)
        return result
    except np.linalg.LinAlgError:
        return None
