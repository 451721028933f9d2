"""Time steps of a body whose cut parts ties join (docs/theory.md, section 10).

The modes of Λ hold the ties as they pull at q = 0; at turned frames these stiff springs pull in other directions. So
only the modes that a step resolves are propagated exactly. The others follow the rule of the middle,

    2 (q₁ − q₀ − h q̇₀)/h² + 2ζω (q₁ − q₀)/h + ω² q̄ = Q̄,     q̇₁ = 2 (q₁ − q₀)/h − q̇₀,                           (17)

which leaves the body where the springs want it. Either way a mode gains exactly the energy Q̄·Δq, with Q̄ the discrete
gradient (9) of all forces beyond Λ: energy is kept to round-off for any step, and the rule is of second order. Source
of (17): J. C. Simo, N. Tarnow, ZAMP 43 (1992) 757.

q₁ is found by a chord iteration. Of the ties' stiffness, which alone is large beyond Λ, it knows J (n, m), how their
ends move against each other in the middle that the velocity foresees, and S (n, n), what they resist it with. With C'
the damping between modes and B⁻¹ = g_q⁻¹ − ½ H + C'/h, the same for all steps of a length, its matrix has the inverse

    (B⁻¹ + ½ Jᵀ S J)⁻¹ = B − ½ (JB)ᵀ (1 + ½ S J B Jᵀ)⁻¹ S (JB),                                              (17a)

so that a step decomposes nothing larger than n, six a joint.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, between, configuration_at, force_work, modal_force, tangent_stiffness
from .indicators import interface_jacobian
from .propagation import Propagator, propagator
from .ties import TieForces, energy, foreseen_tension, relative_motion, relative_stiffness, resisting, tension
from .tree import Configuration, jacobians

FloatArray = NDArray[np.float64]

# Change of q over an iteration relative to q and to the way of a step.
_TOLERANCE = 1e-11
# A chord iteration that has not settled after this many rounds is slow: Newton takes over.
_CHORD_ROUNDS = 16
_NEWTON_ROUNDS = 12
# Angle by which a mode that the step resolves turns in it at the most, rad.
_RESOLVED = 1.5
# As in `stepping`.
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps
_MOST_RULES = 16


@dataclass(frozen=True, slots=True)
class TiedRule:
    """What all steps of a length have in common.

    Attributes
    ----------
    p : Propagator
        Exact for modes that the step resolves, (17) for the others; `ramp` is zero for these.
    response : (m, m) float
        B g_q⁻¹.
    lag : (m,) float
        Of `ramp` by g_q.
    """

    p: Propagator
    response: FloatArray
    lag: FloatArray


@dataclass(frozen=True, slots=True)
class _Pull:
    """How ties pull in one place, and what that makes of the response.

    Attributes
    ----------
    rows : (n, m) float
        J.
    answer : (n, m) float
        JB.
    hold : (n, n) float
        (1 + ½ S J B Jᵀ)⁻¹ S.
    """

    rows: FloatArray
    answer: FloatArray
    hold: FloatArray

    def respond(self, rule: TiedRule, x: FloatArray) -> FloatArray:
        """What q (m,) does under forces f, x = g_q f: the inverse (17a) times f."""
        free = rule.response @ x
        result: FloatArray = free - 0.5 * (self.hold @ (self.rows @ free)) @ self.answer
        return result


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
        # The same without H: of springs that turned frames stretch without any cause, it would leave round-off only.
        bare = replace(ties, initial=np.zeros_like(ties.initial))
        self._bare = replace(dynamics, ties=bare)
        self._resisting = resisting(ties)
        self.noise = ties.noise / math.sqrt(float(dynamics.stiffness.max()))
        # A mode is damped by way of the forces in its material. Those of the springs between the sections are left out:
        # they are there for the joint's sake, and turned frames stretch the modes' linear springs without any cause.
        omega = np.sqrt(dynamics.stiffness)
        share = np.eye(omega.size) - ties.welded / dynamics.stiffness
        self._damping: FloatArray = (share * (2.0 * damping_ratio * omega)) @ share.T
        self.coupled_damping: FloatArray = self._damping - np.diag(np.diag(self._damping))
        self._rules: dict[float, TiedRule] = {}

    def rule(self, step: float) -> TiedRule:
        """What all steps of a length (s) have in common."""
        found = self._rules.get(step)
        if found is None:
            if len(self._rules) >= _MOST_RULES:
                self._rules.clear()
            with np.errstate(all="ignore"):
                found = self._rules[step] = self._new_rule(step)
        return found

    def _new_rule(self, step: float) -> TiedRule:
        square, rate = self._dynamics.stiffness, np.diag(self._damping)
        omega = np.sqrt(square)
        p = propagator(omega, rate / (2.0 * omega), step)
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
        coupling = (p.gq / step)[:, None] * self.coupled_damping - 0.5 * p.gq[:, None] * self._ties.initial
        response: FloatArray = np.linalg.inv(np.eye(square.size) + coupling).astype(np.float64, copy=False)
        return TiedRule(p, response, np.where(p.ramp == 0.0, 0.0, p.ramp / p.gq))

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
        rule, mean, rounds, worst = self.rule(step), loads, 0, 0.0
        for number in range(substeps):
            if end_loads is not None:
                mean = between(loads, end_loads, (number + 0.5) / substeps)
            pull = self._pull(rule, q, v)
            solution, used = self._implicit_step(rule, pull, mean, q, v, here)
            rounds += used
            if solution is None:
                return None, rounds, np.inf
            q1, v1 = solution
            there = configuration_at(self._dynamics, q1)
            error = self._error(rule, pull, mean, here, there, v1)
            worst = max(worst, error)
            if not worst <= tolerance:
                return None, rounds, worst
            q, v, here = q1, v1, there
        return (q, v, here), rounds, worst

    def _pull(self, rule: TiedRule, q: FloatArray, v: FloatArray) -> _Pull:
        """How ties pull in the middle of a step that begins at q with the rate v."""
        middle = configuration_at(self._dynamics, q + 0.5 * rule.p.step * v)
        kept = self._resisting
        rows = relative_motion(self._ties, self._dynamics.tree, middle)[kept]
        stiffness = relative_stiffness(self._ties, middle)[np.ix_(kept, kept)]
        answer = (rows @ rule.response) * rule.p.gq
        matrix = np.eye(len(rows)) + 0.5 * stiffness @ (answer @ rows.T)
        return _Pull(rows, answer, np.linalg.solve(matrix, stiffness).astype(np.float64, copy=False))

    def _implicit_step(
        self, rule: TiedRule, pull: _Pull, loads: NodeLoads, q0: FloatArray, v0: FloatArray, here: Configuration
    ) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
        """Solve for q₁; return it with its rate, and the number of rounds."""
        d, bare, p = self._dynamics, self._bare, rule.p
        acting = loads if loads.forces_only is None else loads.forces_only
        work0 = force_work(bare, loads, here)
        reach = float(np.vdot(np.abs(loads.force), np.abs(d.tree.point)))
        free = p.p11 * q0 + p.p12 * v0
        q1 = q0 + p.step * v0
        # Of a round, and of the one before it: the first two need not come closer yet.
        last = earlier = np.inf
        newton = False
        for rounds in range(1, _CHORD_ROUNDS + _NEWTON_ROUNDS + 1):
            middle, there = configuration_at(d, 0.5 * (q0 + q1)), configuration_at(d, q1)
            way = q1 - q0
            force = modal_force(bare, loads, middle)
            potential = force
            square = float(way @ way)
            work1 = force_work(bare, loads, there)
            c = 0.0
            if square > 0.0 and work0 is not None and work1 is not None:
                potential = force if acting is loads else modal_force(bare, acting, middle)
                bracket = work1 - work0 - float(potential @ way)
                if abs(bracket) > _ROUND_OFF * (reach + abs(work0) + abs(work1)):
                    c = bracket / square
            mean = force + c * way + self._ties.initial @ middle.q - self.coupled_damping @ (way / p.step)
            residual = q1 - free - p.gq * mean
            if newton:
                slope = self._slope(acting, potential, middle, there, way, c)
                try:
                    change = self._newton_change(p, loads, middle, residual, c, np.outer(way, slope))
                except np.linalg.LinAlgError:
                    return None, rounds
            else:
                change = pull.respond(rule, residual)
            q1 = q1 - change
            size, scale = _norm(change), _norm(q1) + p.step * _norm(v0)
            if not math.isfinite(size):
                return None, rounds
            if size <= max(_TOLERANCE * scale, self.noise):
                return (q1, p.p21 * q0 + p.p22 * v0 + p.gv * mean), rounds
            newton = newton or size > 0.5 * earlier or rounds >= _CHORD_ROUNDS
            earlier, last = last, size
        return None, _CHORD_ROUNDS + _NEWTON_ROUNDS

    def _slope(
        self,
        acting: NodeLoads,
        potential: FloatArray,
        middle: Configuration,
        there: Configuration,
        way: FloatArray,
        c: float,
    ) -> FloatArray:
        """∂c/∂q₁ (m,) of the discrete gradient's factor c; `potential` is what has a potential in the middle."""
        if c == 0.0:
            return np.zeros_like(way)
        d = self._dynamics
        change = d.stiffness * way - tangent_stiffness(d, acting, middle) @ way - self._ties.initial @ way
        end = modal_force(self._bare, acting, there)
        result: FloatArray = (end - potential - 0.5 * change - 2.0 * c * way) / float(way @ way)
        return result

    def _newton_change(
        self,
        p: Propagator,
        loads: NodeLoads,
        middle: Configuration,
        residual: FloatArray,
        c: float,
        correction: FloatArray,
    ) -> FloatArray:
        """Newton's step (m,); `correction` (m, m) is what the factor c changes by itself."""
        d, one = self._dynamics, np.eye(residual.size)
        change_of_mean = 0.5 * (np.diag(d.stiffness) - tangent_stiffness(d, loads, middle)) + c * one + correction
        matrix = one - p.gq[:, None] * change_of_mean + (p.gq / p.step)[:, None] * self.coupled_damping
        result: FloatArray = np.linalg.solve(matrix, residual).astype(np.float64, copy=False)
        return result

    def _error(
        self,
        rule: TiedRule,
        pull: _Pull,
        loads: NodeLoads,
        here: Configuration,
        there: Configuration,
        v: FloatArray,
    ) -> float:
        """What the change of forces over the sub-step does beyond its mean, relative, in the energy norm."""
        d = self._dynamics
        way = there.q - here.q
        # Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in
        # truth: their tension is taken as it is in the middle, and how it changes from how the body gives way.
        tense = tension(self._ties, configuration_at(d, 0.5 * (here.q + there.q)))
        held = d.stiffness * way
        change = modal_force(d, loads, there, tense) - modal_force(d, loads, here, tense) - held
        moved = rule.lag * pull.respond(rule, rule.p.gq * change)
        # A mode of the straight body that the turned one only follows, at hardly any acceleration of its own, asks for
        # no shorter step, however its force changes.
        off = np.minimum(np.abs(moved), np.abs(moved + rule.p.ramp * held))
        strain = float(there.q @ (d.stiffness * there.q)) + 2.0 * energy(self._ties, there)
        size = abs(strain) + float(v @ v)
        return math.sqrt(float(d.stiffness @ off**2) / size) if size > 0.0 else 0.0

    def compliance(self, step: float, loads: NodeLoads, state: Configuration, interfaces: Sequence[int]) -> FloatArray:
        """As `indicators.compliance`, of this rule."""
        d, rule = self._dynamics, self.rule(step)
        motion = interface_jacobian(d, state, interfaces)
        # Between steps stiff springs ring; halfway through what they do next, their tension is that of the motion.
        force = modal_force(d, loads, state) - d.stiffness * state.q
        change = self._pull(rule, state.q, np.zeros_like(state.q)).respond(rule, rule.p.gq * force)
        tense = foreseen_tension(self._ties, state, *jacobians(d.tree, state), 0.5 * change)
        tangent = tangent_stiffness(d, loads, state, tense)
        gq = rule.p.gq[:, None]
        matrix = np.eye(len(tangent)) + gq * (0.5 * (tangent - np.diag(d.stiffness)))
        matrix += gq / step * self.coupled_damping
        result: FloatArray = motion @ np.linalg.solve(matrix, gq * motion.T)
        return result


def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector @ vector)
