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
from .indicators import interface_jacobian
from .propagation import Propagator, propagator
from .ties import TieForces, energy, foreseen_tension, relative_motion, relative_stiffness, resisting, tension
from .tree import Configuration, jacobians

FloatArray = NDArray[np.float64]

# Change of q over an iteration relative to q and to the way of a step.
_TOLERANCE = 1e-11
# A chord iteration that has not settled after this many rounds is slow: the step is divided.
_CHORD_ROUNDS = 16
# Part of the change before it that a round may leave at the most, else the ties' pull is taken anew in the present
# middle. The one that the velocity foresees is far off where stiff modes ring.
_FAST = 0.02
# Angle by which a mode that the step resolves turns in it at the most, rad.
_RESOLVED = 1.5
# As in `stepping`.
_ROUND_OFF, _NOISE = 64.0 * np.finfo(np.float64).eps, 1.0 / 16.0
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
        self._loads_alone = replace(dynamics, ties=None)
        # A step that resolves no mode at all has no estimate of its error.
        self.longest = _RESOLVED / math.sqrt(float(dynamics.stiffness.min()))
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
        most: int,
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
        rule, mean, rounds, worst = self.rule(step), loads, 0, 0.0
        energy = self._energy(here, v)
        for number in range(substeps):
            if rounds >= most:
                return None, rounds, np.inf
            if end_loads is not None:
                mean = between(loads, end_loads, (number + 0.5) / substeps)
            solution, used = self._implicit_step(rule, mean, q, v, here)
            rounds += used
            if solution is None:
                return None, rounds, np.inf
            q1, v1, pull = solution
            there = configuration_at(self._dynamics, q1)
            end_energy = self._energy(there, v1)
            error = self._error(rule, pull, mean, here, there, energy, end_energy)
            # Not a number is no error to be accepted either.
            worst = worst if error <= worst else error
            if not worst <= tolerance:
                return None, rounds, worst
            q, v, here, energy = q1, v1, there, end_energy
        return (q, v, here), rounds, worst

    def _pull(self, rule: TiedRule, middle: Configuration) -> _Pull:
        """How ties pull in the middle of a step."""
        kept = self._resisting
        rows = relative_motion(self._ties, self._dynamics.tree, middle)[kept]
        stiffness = relative_stiffness(self._ties, middle)[np.ix_(kept, kept)]
        answer = (rows @ rule.response) * rule.p.gq
        matrix = np.eye(len(rows)) + 0.5 * stiffness @ (answer @ rows.T)
        return _Pull(rows, answer, np.linalg.solve(matrix, stiffness).astype(np.float64, copy=False))

    def _implicit_step(
        self, rule: TiedRule, loads: NodeLoads, q0: FloatArray, v0: FloatArray, here: Configuration
    ) -> tuple[tuple[FloatArray, FloatArray, _Pull] | None, int]:
        """Solve for q₁; return it with its rate and how ties pull there, and the number of rounds."""
        d, bare, p = self._dynamics, self._bare, rule.p
        acting = loads if loads.forces_only is None else loads.forces_only
        work0 = force_work(bare, loads, here)
        reach = work_reach(d.tree, loads.force)
        free = p.p11 * q0 + p.p12 * v0
        q1 = q0 + p.step * v0
        # Of a round, and of the one before it: the first two need not come closer yet.
        last = earlier = np.inf
        pull: _Pull | None = None
        for rounds in range(1, _CHORD_ROUNDS + 1):
            middle, there = configuration_at(d, 0.5 * (q0 + q1)), configuration_at(d, q1)
            if pull is None:
                pull = self._pull(rule, middle)
            way = q1 - q0
            force = modal_force(bare, loads, middle)
            square = float(way @ way)
            work1 = force_work(bare, loads, there)
            c = blur = 0.0
            if square > 0.0 and work0 is not None and work1 is not None:
                potential = force if acting is loads else modal_force(bare, acting, middle)
                bracket = work1 - work0 - float(potential @ way)
                # The springs' strain is a difference of places.
                strained = work_reach(d.tree, tension(self._ties, there).reshape(-1, 3))
                round_off = _ROUND_OFF * (reach + abs(work0) + abs(work1) + strained)
                if abs(bracket) > round_off:
                    c, blur = bracket / square, _NOISE * round_off / square
            mean = force + c * way + self._ties.initial @ middle.q - self.coupled_damping @ (way / p.step)
            residual = q1 - free - p.gq * mean
            change = pull.respond(rule, residual)
            q1 = q1 - change
            size, scale = _norm(change), _norm(q1) + p.step * _norm(v0)
            if not math.isfinite(size):
                return None, rounds
            if size <= max(_TOLERANCE * scale, self.noise, blur * _norm(p.gq * way)):
                return (q1, p.p21 * q0 + p.p22 * v0 + p.gv * mean, pull), rounds
            if size > 0.5 * earlier:
                return None, rounds
            if size > _FAST * last:
                pull = None
            earlier, last = last, size
        return None, _CHORD_ROUNDS

    def _energy(self, state: Configuration, v: FloatArray) -> float:
        """Twice the strain and kinetic energy, J."""
        strain = float(state.q @ (self._dynamics.stiffness * state.q)) + 2.0 * energy(self._ties, state)
        return abs(strain) + float(v @ v)

    def _error(
        self,
        rule: TiedRule,
        pull: _Pull,
        loads: NodeLoads,
        here: Configuration,
        there: Configuration,
        start: float,
        end: float,
    ) -> float:
        """What the change of forces over the sub-step does beyond its mean, relative, in the energy norm.

        Energy that neither was there at the start (twice it, J) nor came from the loads is error as well.
        """
        d = self._dynamics
        middle = configuration_at(d, 0.5 * (here.q + there.q))
        way = there.q - here.q
        # Stiff springs that vibrate faster than the step can tell are strained by it at its ends as they never are in
        # truth: their tension is taken as it is in the middle, and how it changes from how the body gives way.
        tense = tension(self._ties, middle)
        held = d.stiffness * way
        change = modal_force(d, loads, there, tense) - modal_force(d, loads, here, tense) - held
        moved = rule.lag * pull.respond(rule, rule.p.gq * change)
        # A mode of the straight body that the turned one only follows, at hardly any acceleration of its own, asks for
        # no shorter step, however its force changes.
        off = np.minimum(np.abs(moved), np.abs(moved + rule.p.ramp * held))
        work = self._work(loads, here, middle, there)
        round_off = (
            2.0 * _ROUND_OFF * (work_reach(d.tree, loads.force) + abs(force_work(self._bare, loads, here) or 0.0) + end)
        )
        # No change of q below `noise` means anything, nor the rates that follow from it.
        noise = self.noise * (math.sqrt(float(d.stiffness.max())) + 2.0 / rule.p.step)
        bound = start + 2.0 * abs(work) + noise * noise + round_off
        created = 0.0 if end <= bound else math.sqrt(end) - math.sqrt(bound)
        error = math.sqrt(float(d.stiffness @ off**2)) + created
        return 0.0 if error <= noise else error / math.sqrt(min(end, bound))

    def _work(self, loads: NodeLoads, here: Configuration, middle: Configuration, there: Configuration) -> float:
        """Work of the loads over a sub-step: of forces by their potential, of moments by their value in the middle."""
        d = self._loads_alone
        before, after = force_work(d, loads, here), force_work(d, loads, there)
        if before is None or after is None:
            return float(modal_force(d, loads, middle) @ (there.q - here.q))
        if loads.forces_only is None:
            return after - before
        moments = modal_force(d, loads, middle) - modal_force(d, loads.forces_only, middle)
        return after - before + float(moments @ (there.q - here.q))

    def compliance(self, step: float, loads: NodeLoads, state: Configuration, interfaces: Sequence[int]) -> FloatArray:
        """As `indicators.compliance`, of this rule."""
        d, rule = self._dynamics, self.rule(step)
        motion = interface_jacobian(d, state, interfaces)
        # Between steps stiff springs ring; halfway through what they do next, their tension is that of the motion.
        force = modal_force(d, loads, state) - d.stiffness * state.q
        change = self._pull(rule, state).respond(rule, rule.p.gq * force)
        tense = foreseen_tension(self._ties, state, *jacobians(d.tree, state), 0.5 * change)
        tangent = tangent_stiffness(d, loads, state, tense)
        gq = rule.p.gq[:, None]
        matrix = np.eye(len(tangent)) + gq * (0.5 * (tangent - np.diag(d.stiffness)))
        matrix += gq / step * self.coupled_damping
        result: FloatArray = motion @ np.linalg.solve(matrix, gq * motion.T)
        return result


def _norm(vector: FloatArray) -> float:
    return math.sqrt(vector @ vector)
