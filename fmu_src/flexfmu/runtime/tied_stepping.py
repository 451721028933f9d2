"""Time steps of a body whose cut parts ties join (docs/theory.md, section 10).

At turned frames stiff springs pull in other directions than the modes hold them in: the modes' linear part Λ is then no
measure of how the body vibrates. A step is therefore taken in the vibrations about the place where it is, those of the
tangent stiffness K in the middle that the velocity foresees. What the step resolves of them is propagated exactly, what
is too fast for it by the rule of the middle,

    2 (z₁ − z₀ − h ż₀)/h² + 2ζω (z₁ − z₀)/h + ω² z̄ = Q̄,     ż₁ = 2 (z₁ − z₀)/h − ż₀,                           (17)

which leaves it where the springs want it. Either way a vibration gains exactly the energy Q̄·Δz, with Q̄ the discrete
gradient (9) of what is left of the forces, Q(q) + (K − Λ) q: energy is kept to round-off for any step, and the rule is
of second order. Source of (17): J. C. Simo, N. Tarnow, ZAMP 43 (1992) 757.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, between, configuration_at, force_work, modal_force, tangent_stiffness
from .indicators import interface_jacobian
from .propagation import Propagator, propagator
from .ties import TieForces, energy, tension
from .tree import Configuration

FloatArray = NDArray[np.float64]

# Change of q over an iteration relative to q and to the way of a step.
_TOLERANCE = 1e-11
# A fixed point that has not settled after this many rounds is slow: Newton takes over.
_FIXED_POINT_ROUNDS = 8
_NEWTON_ROUNDS = 12
# Angle by which a vibration that the step resolves turns in it at the most, rad.
_RESOLVED = 1.5
# As in `stepping`.
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class _Local:
    """Vibrations about a place, and their step.

    Attributes
    ----------
    shapes : (m, m) float
        V, orthonormal, in columns.
    square : (m,) float
        ω², 1/s²; zero where the tangent gives way.
    linear : (m, m) float
        K = V diag(ω²) Vᵀ, 1/s².
    p : Propagator
    """

    shapes: FloatArray
    square: FloatArray
    linear: FloatArray
    p: Propagator


class TiedSteps:
    """Sub-steps of a body with ties.

    Parameters
    ----------
    dynamics : Dynamics
    ties : TieForces
    damping_ratio : (m,) float
    """

    def __init__(self, dynamics: Dynamics, ties: TieForces, damping_ratio: FloatArray):
        self._dynamics = dynamics
        self._ties = ties
        self._noise = ties.noise / math.sqrt(float(dynamics.stiffness.max()))
        # A mode is damped by way of the forces in its material. Those of the springs between the sections are left out:
        # they are there for the joint's sake, and turned frames stretch the modes' linear springs without any cause.
        omega = np.sqrt(dynamics.stiffness)
        share = np.eye(omega.size) - ties.welded / dynamics.stiffness
        self._damping: FloatArray = (share * (2.0 * damping_ratio * omega)) @ share.T

    def substeps(
        self,
        step: float,
        loads: NodeLoads,
        end_loads: NodeLoads | None,
        q: FloatArray,
        v: FloatArray,
        here: Configuration,
        substeps: int,
        tolerance: float,
    ) -> tuple[tuple[FloatArray, FloatArray, Configuration] | None, int, float]:
        """Equal sub-steps; None for the state where one of them fails or errs too much.

        Parameters
        ----------
        step : float
            Of a sub-step, s.
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

        Returns
        -------
        state : tuple of (m,) float, (m,) float and Configuration, or None
        rounds : int
            Of the iteration.
        error : float
            The largest of a sub-step.
        """
        mean, rounds, worst = loads, 0, 0.0
        for number in range(substeps):
            if end_loads is not None:
                mean = between(loads, end_loads, (number + 0.5) / substeps)
            local = self._local(step, mean, q, v, here)
            solution, used = self._implicit_step(local, mean, q, v, here)
            rounds += used
            if solution is None:
                return None, rounds, np.inf
            q1, v1 = solution
            there = configuration_at(self._dynamics, q1)
            error = self._error(local, mean, here, there, v1)
            worst = max(worst, error)
            if not worst <= tolerance:
                return None, rounds, worst
            q, v, here = q1, v1, there
        return (q, v, here), rounds, worst

    def _local(self, step: float, loads: NodeLoads, q: FloatArray, v: FloatArray, here: Configuration) -> _Local:
        """Vibrations about the middle of a step that begins at q with the rate v."""
        middle = configuration_at(self._dynamics, q + 0.5 * step * v)
        # Where stiff springs do not quite fit their tension is not what it will be there: that at the start is nearer.
        tangent = tangent_stiffness(self._dynamics, loads, middle, tension(self._ties, here))
        square, shapes = np.linalg.eigh(0.5 * (tangent + tangent.T))
        square = np.maximum(square, 0.0)
        omega = np.sqrt(square)
        rate = np.einsum("ij,ij->j", shapes, self._damping @ shapes)
        ratio = rate / (2.0 * np.where(omega > 0.0, omega, np.inf))
        p = propagator(omega, ratio, step)
        fast = omega * step > _RESOLVED
        a, b = 0.25 * square * step**2, 0.5 * rate * step
        whole = 1.0 + a + b
        p = Propagator(
            step,
            np.where(fast, (1.0 - a + b) / whole, p.p11),
            np.where(fast, step / whole, p.p12),
            np.where(fast, -square * step / whole, p.p21),
            np.where(fast, (1.0 - a - b) / whole, p.p22),
            np.where(fast, 0.5 * step**2 / whole, p.gq),
            np.where(fast, step / whole, p.gv),
            # No shorter step is wanted for what vibrates faster than the step can tell: there is always more of it.
            np.where(fast, 0.0, p.ramp),
            p.ramp_rate,
        )
        return _Local(shapes, square, (shapes * square) @ shapes.T, p)

    def _implicit_step(
        self, local: _Local, loads: NodeLoads, q0: FloatArray, v0: FloatArray, here: Configuration
    ) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
        """Solve for q₁; return it with its rate, and the number of rounds."""
        d, ties, p, shapes = self._dynamics, self._ties, local.p, local.shapes
        acting = loads if loads.forces_only is None else loads.forces_only
        work0 = self._work(loads, here)
        reach = float(np.vdot(np.abs(loads.force), np.abs(d.tree.point)))
        z0, rate0 = shapes.T @ q0, shapes.T @ v0
        free = shapes @ (p.p11 * z0 + p.p12 * rate0)
        # The vibrations' linear part, less that of the modes.
        rest = local.linear - np.diag(d.stiffness)
        q1 = q0 + p.step * v0
        last = np.inf
        newton = False
        for rounds in range(1, _FIXED_POINT_ROUNDS + _NEWTON_ROUNDS + 1):
            middle, there = configuration_at(d, 0.5 * (q0 + q1)), configuration_at(d, q1)
            way = q1 - q0
            force = modal_force(d, loads, middle)
            square = float(way @ way)
            work1 = self._work(loads, there)
            c, slope = 0.0, np.zeros_like(way)
            if square > 0.0 and work0 is not None and work1 is not None:
                # H is linear: the middle of the step is exact for it, and it would only add round-off here.
                potential = force if acting is loads else modal_force(d, acting, middle)
                potential = potential - ties.initial @ middle.q
                bracket = work1 - work0 - float(potential @ way)
                if abs(bracket) > _ROUND_OFF * (reach + abs(work0) + abs(work1)):
                    c = bracket / square
            mean = force + rest @ middle.q + c * way
            residual = q1 - free - shapes @ (p.gq * (shapes.T @ mean))
            if newton:
                tangent = tangent_stiffness(d, loads, middle)
                if c != 0.0:
                    # ∂c/∂q₁
                    end = modal_force(d, acting, there) - ties.initial @ q1
                    half = 0.5 * (d.stiffness * way - tangent @ way - ties.initial @ way)
                    slope = (end - potential - half - 2.0 * c * way) / square
                change_of_mean = 0.5 * (local.linear - tangent) + c * np.eye(q0.size) + np.outer(way, slope)
                matrix = np.eye(q0.size) - shapes @ (p.gq[:, None] * (shapes.T @ change_of_mean))
                try:
                    change: FloatArray = np.linalg.solve(matrix, residual).astype(np.float64, copy=False)
                except np.linalg.LinAlgError:
                    return None, rounds
            else:
                change = residual
            q1 = q1 - change
            size, scale = _norm(change), _norm(q1) + p.step * _norm(v0)
            if not math.isfinite(size):
                return None, rounds
            if size <= max(_TOLERANCE * scale, self._noise):
                z_mean = shapes.T @ mean
                return (q1, shapes @ (p.p21 * z0 + p.p22 * rate0 + p.gv * z_mean)), rounds
            newton = newton or size > 0.5 * last or rounds >= _FIXED_POINT_ROUNDS
            last = size
        return None, _FIXED_POINT_ROUNDS + _NEWTON_ROUNDS

    def _work(self, loads: NodeLoads, state: Configuration) -> float | None:
        """Potential of the forces and of the ties without what the modes hold of them."""
        work = force_work(self._dynamics, loads, state)
        return None if work is None else work - 0.5 * float(state.q @ self._ties.initial @ state.q)

    def _error(
        self, local: _Local, loads: NodeLoads, here: Configuration, there: Configuration, v: FloatArray
    ) -> float:
        """What the change of forces over the sub-step does beyond its mean, relative, in the energy norm."""
        d = self._dynamics
        way = there.q - here.q
        # Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in
        # truth: their tension is taken as it is in the middle.
        tense = tension(self._ties, configuration_at(d, 0.5 * (here.q + there.q)))
        change = modal_force(d, loads, there, tense) - modal_force(d, loads, here, tense) - d.stiffness * way
        off = local.p.ramp * (local.shapes.T @ change + local.square * (local.shapes.T @ way))
        strain = float(there.q @ (d.stiffness * there.q)) + 2.0 * energy(self._ties, there)
        size = abs(strain) + float(v @ v)
        return math.sqrt(float(local.square @ off**2) / size) if size > 0.0 else 0.0

    def compliance(self, step: float, loads: NodeLoads, state: Configuration, interfaces: Sequence[int]) -> FloatArray:
        """As `indicators.compliance`, of this rule."""
        motion = interface_jacobian(self._dynamics, state, interfaces)
        tangent = tangent_stiffness(self._dynamics, loads, state)
        matrix = 2.0 / step**2 * np.eye(len(tangent)) + self._damping / step + 0.5 * tangent
        result: FloatArray = motion @ np.linalg.solve(matrix, motion.T)
        return result


def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector @ vector)
