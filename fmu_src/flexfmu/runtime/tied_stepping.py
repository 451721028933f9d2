"""Time steps of a body whose cut parts ties join (docs/theory.md, section 10).

At turned frames stiff springs pull in other directions than the modes hold them in. Modes propagated exactly, and
springs by their mean force over a step, would then be at odds wherever a step does not resolve the springs' own
vibration. So both enter in the middle of the step,

    2 (q₁ − q₀ − h v₀)/h² + C (q₁ − q₀)/h + Λq̄ = Q̄,     v₁ = 2 (q₁ − q₀)/h − v₀,                                  (17)

with Q̄ the discrete gradient (9): energy is kept to round-off for any step, the rule is symmetric and of second order,
and what is too fast for the step is kept where the springs want it. Source: J. C. Simo, N. Tarnow, ZAMP 43 (1992) 757.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, between, configuration_at, force_work, modal_force, tangent_stiffness
from .ties import TieForces, energy, foreseen_tension, tension
from .tree import Configuration, jacobians

FloatArray = NDArray[np.float64]

# Change of q over an iteration relative to q and to the way of a step.
_TOLERANCE = 1e-11
_ROUNDS = 15
# As in `stepping`.
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps


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
            solution, used = self._implicit_step(step, mean, q, v, here)
            rounds += used
            if solution is None:
                return None, rounds, np.inf
            q1, matrix, tangent = solution
            v = 2.0 / step * (q1 - q) - v
            there = configuration_at(self._dynamics, q1)
            error = self._error(step, mean, here, there, v, matrix, tangent)
            worst = max(worst, error)
            if not worst <= tolerance:
                return None, rounds, worst
            q, here = q1, there
        return (q, v, here), rounds, worst

    def _implicit_step(
        self, step: float, loads: NodeLoads, q0: FloatArray, v0: FloatArray, here: Configuration
    ) -> tuple[tuple[FloatArray, FloatArray, FloatArray] | None, int]:
        """Solve (17) for q₁; return it with the last matrix and tangent stiffness, and the number of rounds."""
        d, ties = self._dynamics, self._ties
        inertia = 2.0 / step**2 * np.eye(q0.size) + self._damping / step
        acting = loads if loads.forces_only is None else loads.forces_only
        work0 = self._work(loads, here)
        reach = float(np.vdot(np.abs(loads.force), np.abs(d.tree.point)))
        tense = tension(ties, here)
        q1 = q0 + step * v0
        for rounds in range(1, _ROUNDS + 1):
            middle, there = configuration_at(d, 0.5 * (q0 + q1)), configuration_at(d, q1)
            way = q1 - q0
            force = modal_force(d, loads, middle)
            tangent = tangent_stiffness(d, loads, middle, tense)
            matrix = inertia + 0.5 * tangent
            residual = inertia @ way - 2.0 / step * v0 + d.stiffness * middle.q - force
            newton = matrix
            square = float(way @ way)
            work1 = self._work(loads, there)
            if square > 0.0 and work0 is not None and work1 is not None:
                # H is linear: the middle of the step is exact for it, and it would only add round-off here.
                potential = force if acting is loads else modal_force(d, acting, middle)
                potential = potential - ties.initial @ middle.q
                bracket = work1 - work0 - float(potential @ way)
                if abs(bracket) <= _ROUND_OFF * (reach + abs(work0) + abs(work1)):
                    bracket = 0.0
                c = bracket / square
                residual = residual - c * way
                # ∂c/∂q₁
                end = modal_force(d, acting, there) - ties.initial @ q1
                half = 0.5 * ((d.stiffness * way - tangent @ way) - ties.initial @ way)
                slope = (end - potential - half - 2.0 * c * way) / square
                newton = matrix - c * np.eye(q0.size) - np.outer(way, slope)
            try:
                change: FloatArray = np.linalg.solve(newton, residual).astype(np.float64, copy=False)
            except np.linalg.LinAlgError:
                return None, rounds
            tense = foreseen_tension(ties, middle, *jacobians(d.tree, middle), -0.5 * change)
            q1 = q1 - change
            size, scale = _norm(change), _norm(q1) + step * _norm(v0)
            if not math.isfinite(size):
                return None, rounds
            if size <= _TOLERANCE * scale:
                return (q1, matrix, tangent), rounds
        return None, _ROUNDS

    def _work(self, loads: NodeLoads, state: Configuration) -> float | None:
        """Potential of the forces and of the ties without what the modes hold of them."""
        work = force_work(self._dynamics, loads, state)
        return None if work is None else work - 0.5 * float(state.q @ self._ties.initial @ state.q)

    def _error(
        self,
        step: float,
        loads: NodeLoads,
        here: Configuration,
        there: Configuration,
        v: FloatArray,
        matrix: FloatArray,
        tangent: FloatArray,
    ) -> float:
        """What the change of all forces over the sub-step does beyond its mean, relative, in the energy norm.

        What vibrates faster than the step can tell is filtered out: no shorter step is wanted for it.
        """
        d = self._dynamics
        change = modal_force(d, loads, there) - modal_force(d, loads, here) - d.stiffness * (there.q - here.q)
        off = np.linalg.solve(matrix, np.linalg.solve(matrix, change)) / (3.0 * step**2)
        strain = float(there.q @ (d.stiffness * there.q)) + 2.0 * energy(self._ties, there)
        size = abs(strain) + float(v @ v)
        return math.sqrt(abs(float(off @ tangent @ off)) / size) if size > 0.0 else 0.0

    def compliance(self, step: float, loads: NodeLoads, state: Configuration, interface: int) -> FloatArray:
        """As `indicators.compliance`, of this rule."""
        translation, spin = jacobians(self._dynamics.tree, state)
        node = self._dynamics.tree.frame_count + interface
        motion = np.concatenate([translation[node], spin[node]])
        tangent = tangent_stiffness(self._dynamics, loads, state)
        matrix = 2.0 / step**2 * np.eye(len(tangent)) + self._damping / step + 0.5 * tangent
        result: FloatArray = motion @ np.linalg.solve(matrix, motion.T)
        return result


def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector @ vector)
