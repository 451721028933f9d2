"""Time stepping: exact modes, energy-conserving nonlinear loads, automatic sub-steps (docs/theory.md, section 6).

Within a step the modal force is replaced by a mean Q̄ and each mode is propagated exactly under it. An undamped mode
then gains exactly the energy Q̄·Δq. Q̄ is the discrete gradient of the loads' work J(q),

    Q̄ = Q(q̄) + [J(q₁) − J(q₀) − Q(q̄)·Δq] Δq/|Δq|²,     q̄ = (q₀ + q₁)/2,     Δq = q₁ − q₀,

so that Q̄·Δq = J(q₁) − J(q₀): the total energy under dead forces is the same at the end of the step, whatever its
length. The rule is symmetric and of second order. Sources: O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449 (discrete
gradient); Y.-W. Li, X. Wu, SIAM J. Sci. Comput. 38 (2016) A1876 (in an exponential integrator).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, between, configuration_at, force_work, modal_force, spread, work_reach
from .errors import StepError
from .evaluation import FeedRates, explicit_substeps, feed_rates
from .inertial_stepping import inertial_substeps
from .kernel import compiled
from .loads import Loads
from .propagation import Propagator, propagator
from .reduced_body import Evaluation
from .tied_stepping import TiedSteps
from .tree import Configuration

FloatArray = NDArray[np.float64]

# Change of Ωq over an iteration relative to its size; two decades above round-off.
_TOLERANCE = 1e-12
# Change below which the discrete gradient's bracket joins the iteration: its own error is then far below the tolerance.
_SETTLED = 1e-5
# A fixed point that has not settled after this many rounds is slow: the step is divided. Newton's method would settle
# some of these steps, but hardly one of them to the tolerance.
_MOST_ROUNDS = 16
# The discrete gradient's bracket is skipped where it is round-off: it is cubic in Δq, and would be divided by |Δq|.
# Where it is not, part of that bound is how uncertain it is: no change below what that makes means anything.
_ROUND_OFF, _NOISE = 64.0 * np.finfo(np.float64).eps, 1.0 / 16.0
# Steps (s) below this would vanish when divided, and numbers of steps above this are all alike.
_INDIVISIBLE, _UNCOUNTED = 1e-300, 1e18
# Sub-steps from which on it is looked at whether more of them can help, and rotation within a frame, rad, of the linear
# body at the step's end from which on they cannot.
_SUSPECT, _SENSELESS = 32, 4.0 * math.pi
# Rounds of the iteration in an internal step of ordinary cost.
_ORDINARY_ROUNDS = 5


@dataclass(frozen=True, slots=True)
class StepLimits:
    """What bounds the internal step.

    Attributes
    ----------
    longest : float
        Longest internal step, s; zero for no limit.
    tolerance : float
        Error accepted per step in the energy norm, relative to the motion's; sub-steps are halved until it is met.
    most : float
        Work accepted per step, discarded tries included, in internal steps of ordinary cost; a step that takes more is
        refused.
    """

    longest: float = 0.0
    tolerance: float = 1e-4
    most: float = 4096.0


@dataclass(frozen=True, slots=True)
class State:
    """The evolving state of a body.

    Attributes
    ----------
    q, v : (m,) float
        Modal coordinates (kg^1/2 m) and their rates.
    substeps : int
        Sub-steps that the last step took; where the next one starts to look.
    """

    q: FloatArray
    v: FloatArray
    substeps: int = 1


@dataclass(frozen=True, slots=True)
class Work:
    """What a step cost.

    Attributes
    ----------
    substeps : int
    iterations : int
        Rounds of the implicit iteration over all sub-steps, discarded tries included.
    error : float
        Estimated error of the step, relative, as `StepLimits.tolerance` bounds it.
    """

    substeps: int
    iterations: int
    error: float


class PropagatorCache:
    """Propagators of the last few step lengths, since a master hardly ever changes its step."""

    def __init__(self, angular_frequency: FloatArray, damping_ratio: FloatArray, size: int = 16):
        self._modes = angular_frequency, damping_ratio
        self._size = size
        self._known: dict[float, Propagator] = {}

    def __call__(self, step: float) -> Propagator:
        """Return the propagator for a step (s)."""
        found = self._known.get(step)
        if found is None:
            if len(self._known) >= self._size:
                self._known.clear()
            # Steps of any length are asked for; what overflows or vanishes on the way is not used.
            with np.errstate(all="ignore"):
                found = self._known[step] = propagator(*self._modes, step)
        return found


class ConfigurationMemo:
    """The configuration of the q last seen: a step begins, and outputs are read, where the step before it ended."""

    def __init__(self, dynamics: Dynamics):
        self._dynamics = dynamics
        self._q: FloatArray | None = None
        self._known: Configuration | None = None

    def __call__(self, q: FloatArray) -> Configuration:
        """Return the configuration at q (m,); the same array object is taken for the same q."""
        known = self._known
        if known is None or q is not self._q:
            known = configuration_at(self._dynamics, q)
            self.remember(q, known)
        return known

    def remember(self, q: FloatArray, configuration: Configuration) -> None:
        """Keep the configuration at q, which may not be written to from now on."""
        q.flags.writeable = False
        self._q, self._known = q, configuration


class Stepper:
    """Steps of a body under one formulation, with what they have in common at hand.

    Parameters
    ----------
    dynamics : Dynamics
    angular_frequency, damping_ratio : (m,) float
    limits : StepLimits
    turning : (3n, m) float
        Rotations within frames.
    use_compiled : bool
        Whether compiled code is used where there is some; the results are the same to round-off.
    evaluation : Evaluation
        When loads on the moving body are evaluated; explicitly there is no compiled code, and no error control.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        angular_frequency: FloatArray,
        damping_ratio: FloatArray,
        limits: StepLimits,
        turning: FloatArray,
        use_compiled: bool = True,
        evaluation: Evaluation = Evaluation.IMPLICIT,
    ):
        self.kernel = None
        self.tied = None if dynamics.ties is None else TiedSteps(dynamics, dynamics.ties, damping_ratio)
        if use_compiled and dynamics.inertia is None:
            self.kernel = compiled(dynamics, turning, self.tied)
        self.configuration = ConfigurationMemo(dynamics)
        self._explicit = evaluation is Evaluation.EXPLICIT
        self._damping_ratio = damping_ratio
        self._turning = turning
        self._dynamics = dynamics
        self._limits = limits
        self._cache = PropagatorCache(angular_frequency, damping_ratio)

    def propagator(self, step: float) -> Propagator:
        """Propagator of a step (s)."""
        return self._cache(step)

    def advance(
        self, state: State, inputs: FloatArray, step: float, end_inputs: FloatArray | None = None
    ) -> tuple[State, Work]:
        """State after a step under loads that are constant over it, or grow linearly.

        Parameters
        ----------
        state : State
            Left untouched.
        inputs : (6I,) or (6I + 3,) float
            Loads over the step, or at its start, as of `Loads.packed`.
        step : float
            s, positive.
        end_inputs : like inputs, or None
            Loads at the step's end, where they are others.

        Returns
        -------
        state : State
        work : Work

        Raises
        ------
        StepError
            No sub-step within reason converges: the load is beyond what the body can bear.
        """
        # By mode, loads of zero depend on q as well: the exact step finds out.
        if not self._dynamics.nonlinear or not (inputs.any() or (end_inputs is not None and end_inputs.any())):
            exact = self._exact(state, inputs, step, end_inputs)
            if exact is not None:
                return State(*exact, state.substeps), Work(1, 0, 0.0)
        tolerance, most, fewest = self._limits.tolerance, self._limits.most, self._fewest(step)
        if fewest > most:
            reason = f"internal_step.limit = {self._limits.longest:.6g} s"
            if self.tied is not None and fewest == math.ceil(step / self.tied.longest):
                reason = f"the slowest vibration, which allows {self.tied.longest:.3g} s"
            raise StepError(
                f"the step of {step:.6g} s needs {fewest} internal steps by {reason}, more than internal_step.most = "
                f"{most:.6g}: take a shorter communication step, or raise these limits"
            )
        if self._explicit:
            return self._held(state, inputs, end_inputs, step, fewest)
        # The shortest of numbers cannot be divided.
        substeps = min(max(fewest, state.substeps), int(most)) if step > _INDIVISIBLE else 1
        iterations, within, tried = 0, int(_ORDINARY_ROUNDS * most), []
        while substeps <= most and iterations < within:
            end, rounds, error = self._try(state, inputs, end_inputs, step, substeps, within - iterations)
            iterations += rounds
            if end is not None:
                # The error falls with the cube of the internal step: try half as many next time only when that would
                # do.
                suggestion = substeps // 2 if 16.0 * error < tolerance and substeps > fewest else substeps
                return State(*end, max(suggestion, 1)), Work(substeps, iterations, error)
            tried.append(f"{substeps} (error {error:.2g})" if math.isfinite(error) else f"{substeps} (unsettled)")
            substeps *= 2
            if substeps >= _SUSPECT and self._beyond_reach(state, inputs, end_inputs, step):
                raise StepError(
                    f"the step of {step:.6g} s does not converge: the loads would turn the linear body by more than "
                    "two turns within a frame; lower the load or the communication step"
                )
        raise StepError(
            f"the step of {step:.6g} s needs more work than {most:.6g} internal steps of ordinary cost take "
            f"(internal_step.most): tried {', '.join(tried[-2:])} internal steps for a tolerance of {tolerance:.2g}, "
            f"{iterations} rounds in all; take a shorter communication step, raise internal_step.most or "
            "internal_step.tolerance, or lower the load, which may exceed what the body can bear"
        )

    def _fewest(self, step: float) -> int:
        """Internal steps that a step (s) has at least."""
        longest = self._limits.longest
        fewest = 1.0 if longest <= 0.0 else step / longest * (1.0 - 1e-9)
        # An error as large as the motion is none that anyone asks for.
        if self.tied is not None and self._limits.tolerance < 1.0:
            fewest = max(fewest, step / self.tied.longest)
        return math.ceil(min(fewest, _UNCOUNTED))

    def _held(
        self, state: State, inputs: FloatArray, end_inputs: FloatArray | None, step: float, substeps: int
    ) -> tuple[State, Work]:
        """Step with the modal force of each sub-step's start."""
        start, end = self._spread(inputs, end_inputs)
        with np.errstate(all="ignore"):
            here, p = self.configuration(state.q), self._cache(step / substeps)
            q, v, there, error = explicit_substeps(self._dynamics, p, start, end, state.q, state.v, here, substeps)
        self.configuration.remember(q, there)
        return State(q, v, 1), Work(substeps, 0, error)

    def feed_rates(self, state: State, inputs: FloatArray, step: float) -> FeedRates:
        """What explicit evaluation does to vibrations about a state under loads (6I,) or (6I + 3,), at a step (s)."""
        loads, _ = self._spread(inputs, None)
        p = self._cache(step / self._fewest(step))
        return feed_rates(self._dynamics, p, loads, self.configuration(state.q), self._damping_ratio)

    def _beyond_reach(self, state: State, inputs: FloatArray, end_inputs: FloatArray | None, step: float) -> bool:
        """Whether the loads would turn the linear body within a frame beyond all sense: more steps are no use then."""
        p = self._cache(step)
        start, end = self._spread(inputs, end_inputs)
        with np.errstate(all="ignore"):
            force = modal_force(
                self._dynamics, start if end is None else between(start, end, 0.5), self.configuration(state.q)
            )
            turned = self._turning @ (p.p11 * state.q + p.p12 * state.v + p.gq * force)
            return not float(np.max(np.abs(turned), initial=0.0)) < _SENSELESS

    def _exact(
        self, state: State, inputs: FloatArray, step: float, end_inputs: FloatArray | None
    ) -> tuple[FloatArray, FloatArray] | None:
        """State (q, v) after a step of any length where no load depends on q: nothing to iterate, nothing to divide."""
        p = self._cache(step)
        if self.kernel is not None:
            return self.kernel.linear_step(p, inputs, end_inputs, state.q, state.v)
        start, end = self._spread(inputs, end_inputs)
        if self._dynamics.inertia is not None or start.active or (end is not None and end.active):
            return None
        force = (start if end is None else between(start, end, 0.5)).constant
        q = p.p11 * state.q + p.p12 * state.v + p.gq * force
        v = p.p21 * state.q + p.p22 * state.v + p.gv * force
        return (q, v) if end is None else _ramped(p, q, v, start, end, 1)

    def _try(
        self, state: State, inputs: FloatArray, end_inputs: FloatArray | None, step: float, substeps: int, most: int
    ) -> tuple[tuple[FloatArray, FloatArray] | None, int, float]:
        """Try a number of equal sub-steps, at most so many rounds; None for the state where one fails or errs."""
        p, tolerance = self._cache(step / substeps), self._limits.tolerance
        if self.kernel is not None:
            rule = None if self.tied is None else self.tied.rule(p.step)
            return self.kernel.substeps(p, inputs, end_inputs, state.q, state.v, substeps, tolerance, most, rule)
        start, end = self._spread(inputs, end_inputs)
        here = self.configuration(state.q)
        with np.errstate(all="ignore"):
            if self.tied is not None:
                q, v = state.q, state.v
                result = self.tied.substeps(p.step, start, end, q, v, here, substeps, tolerance, most)
            else:
                result = _substeps(self._dynamics, p, start, end, state, here, substeps, tolerance, most)
        state_there, rounds, error = result
        if state_there is None:
            return None, rounds, error
        self.configuration.remember(state_there[0], state_there[2])
        return state_there[:2], rounds, error

    def _spread(self, inputs: FloatArray, end_inputs: FloatArray | None) -> tuple[NodeLoads, NodeLoads | None]:
        interfaces = self._dynamics.tree.interface_count
        start = spread(self._dynamics, Loads.unpacked(inputs, interfaces))
        return start, None if end_inputs is None else spread(self._dynamics, Loads.unpacked(end_inputs, interfaces))


def _substeps(
    dynamics: Dynamics,
    p: Propagator,
    loads: NodeLoads,
    end_loads: NodeLoads | None,
    state: State,
    here: Configuration,
    substeps: int,
    tolerance: float,
    most: int,
) -> tuple[tuple[FloatArray, FloatArray, Configuration] | None, int, float]:
    """Equal sub-steps within so many rounds; None for the state where one does not settle or errs too much."""
    if dynamics.inertia is not None:
        return inertial_substeps(
            dynamics, dynamics.inertia, p, loads, end_loads, state.q, state.v, here, substeps, tolerance, most
        )
    omega = np.sqrt(dynamics.stiffness)
    q, v = state.q, state.v
    mean = loads
    start_force, start_work = modal_force(dynamics, mean, here), force_work(dynamics, mean, here)
    iterations, worst = 0, 0.0
    for number in range(substeps):
        if iterations >= most:
            return None, iterations, np.inf
        if end_loads is not None:
            mean = between(loads, end_loads, (number + 0.5) / substeps)
            start_force, start_work = modal_force(dynamics, mean, here), force_work(dynamics, mean, here)
        solution, rounds = _implicit_step(dynamics, p, mean, q, v, start_force, start_work)
        iterations += rounds
        if solution is None:
            return None, iterations, np.inf
        q1, mean_force = solution
        v = p.p21 * q + p.p22 * v + p.gv * mean_force
        if end_loads is not None:
            q1, v = _ramped(p, q1, v, loads, end_loads, substeps)
        here = configuration_at(dynamics, q1)
        end_force, end_work = modal_force(dynamics, mean, here), force_work(dynamics, mean, here)
        # What the force's change over the sub-step would do beyond its mean is the leading error.
        size = math.hypot(_norm(omega * q1), _norm(v))
        error = _norm(dynamics.weight * p.ramp * (end_force - start_force)) / size if size > 0.0 else 0.0
        worst = max(worst, error)
        if not worst <= tolerance:
            return None, iterations, worst
        q, start_force, start_work = q1, end_force, end_work
    return (q, v, here), iterations, worst


def _ramped(
    p: Propagator, q: FloatArray, v: FloatArray, loads: NodeLoads, end_loads: NodeLoads, substeps: int
) -> tuple[FloatArray, FloatArray]:
    """Add what loads that grow over a sub-step do beyond their mean: exact on the undeformed body.

    On the deformed one it is wrong by the third power of the step, as the rule itself is.
    """
    growth = (end_loads.constant - loads.constant) / substeps
    return q + p.ramp * growth, v + p.ramp_rate * growth


def _implicit_step(
    dynamics: Dynamics,
    p: Propagator,
    loads: NodeLoads,
    q0: FloatArray,
    v0: FloatArray,
    force0: FloatArray,
    work0: float | None,
) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
    """Solve q₁ = P q₀ + g_q Q̄(q₀, q₁); return q₁ and Q̄, or None, and the number of rounds."""
    weight = dynamics.weight
    free = p.p11 * q0 + p.p12 * v0
    q1 = free + p.gq * force0
    correction = uncertain = 0.0
    size, corrected = np.inf, False
    for rounds in range(1, _MOST_ROUNDS + 1):
        middle = configuration_at(dynamics, 0.5 * (q0 + q1))
        force = modal_force(dynamics, loads, middle)
        difference = q1 - q0
        # The correction is cubic in Δq: it can wait until q₁ has nearly settled, but has to be there when it has.
        corrected = size <= _SETTLED
        if corrected and difference.any():
            correction, uncertain = _correction(dynamics, loads, middle, force, q1, work0, difference)
        mean_force = force + correction * difference
        change = q1 - free - p.gq * mean_force
        q1 = q1 - change
        scale = _norm(weight * q1) + _norm(v0)
        size = _norm(weight * change) / scale if scale > 0.0 else 0.0
        if not np.isfinite(size):
            return None, rounds
        if corrected and size * scale <= max(_TOLERANCE * scale, uncertain * _norm(weight * p.gq * difference)):
            return (q1, mean_force), rounds
    return None, _MOST_ROUNDS


def _norm(vector: FloatArray) -> float:
    """Euclidean norm, without the overhead of the general one."""
    return math.sqrt(vector @ vector)


def _correction(
    dynamics: Dynamics,
    loads: NodeLoads,
    middle: Configuration,
    force: FloatArray,
    q1: FloatArray,
    work0: float | None,
    difference: FloatArray,
) -> tuple[float, float]:
    """Discrete gradient's factor [J(q₁) − J(q₀) − Q(q̄)·Δq]/|Δq|², zero where the bracket is round-off, and that of it.

    J and Q are those of the forces: moments enter the step by their value in the middle alone.
    """
    work1 = force_work(dynamics, loads, configuration_at(dynamics, q1))
    if work0 is None or work1 is None:
        return 0.0, 0.0
    if loads.forces_only is not None:
        force = modal_force(dynamics, loads.forces_only, middle)
    bracket = work1 - work0 - float(np.vdot(force, difference))
    round_off = _ROUND_OFF * (work_reach(dynamics.tree, loads.force) + abs(work0) + abs(work1))
    if not abs(bracket) > round_off:
        return 0.0, 0.0
    square = float(np.vdot(difference, difference))
    return bracket / square, _NOISE * round_off / square
