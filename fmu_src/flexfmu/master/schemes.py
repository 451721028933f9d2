"""How the FMUs of a coupling take a communication step together; docs/master.md says which scheme is stable when."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..files.array_types import FloatArray
from ..files.errors import SimulationError
from .acceleration import KnownResponse, Secants, joined, no_secants, quasi_newton_update
from .config import ExperimentTable, Held, Scheme
from .exchange import Dampers, base_inputs, coupled_inputs, interface_response, noise
from .layout import Wiring
from .participants import Participant, StepRefusedError

# Rounds after which a residual that falls no more, by so much a round, is as small as it gets.
_STALLED, _FALLS = 5, 0.5
# Change of inputs, of their sizes, beside which the error of internal steps counts for nothing.
_NEAR = 0.01
# Halvings of a change of inputs with which an FMU refuses the step.
_HALVINGS = 10


@dataclass(frozen=True, slots=True)
class Point:
    """A communication point.

    Attributes
    ----------
    number : int
        Steps taken so far.
    signals : (m,) float
    before : (m,) float
        A step earlier.
    held : (n,) float
        What the coupling fed to the inputs over the step that led here.
    iterations : int
        Times that this step was taken.
    """

    number: int
    signals: FloatArray
    before: FloatArray
    held: FloatArray
    iterations: int = 0


Advance = Callable[[Point], Point]


class Stage:
    """The FMUs and what links them.

    Parameters
    ----------
    wiring : Wiring
    participants : sequence of Participant
    step : float
        Communication step, s.
    """

    def __init__(self, wiring: Wiring, participants: Sequence[Participant], step: float):
        self.wiring, self.participants, self.step = wiring, tuple(participants), step
        self.coupled = tuple(p for p in self.participants if np.any(wiring.coupled[p.role.input_share]))
        self.free = tuple(p for p in self.participants if p not in self.coupled)

    def initial(self) -> Point:
        """Hand outputs on along the connections, in the order listed, and end the initialisation."""
        signals = np.zeros(self.wiring.matrix.shape[1])
        base = base_inputs(self.wiring, 0.0, self.step)
        for participant in self.participants:
            participant.set_inputs((base + self.wiring.matrix @ signals)[participant.role.input_share])
            signals[participant.role.signal_share] = participant.signals()
        for participant in self.participants:
            participant.begin()
            signals[participant.role.signal_share] = participant.signals()
        return Point(0, signals, signals.copy(), np.zeros(len(base)))

    def step_participant(self, participant: Participant, number: int, inputs: FloatArray, signals: FloatArray) -> None:
        """Let an FMU step with its share of inputs; its share of signals is renewed."""
        participant.set_inputs(inputs[participant.role.input_share])
        participant.step(number * self.step, self.step)
        signals[participant.role.signal_share] = participant.signals()

    def requested(self, signals: FloatArray, before: FloatArray, dampers: Dampers = Dampers.NOW) -> FloatArray:
        """What connections and springs ask the inputs to be."""
        return coupled_inputs(self.wiring, signals, before, self.step, dampers)

    def response(
        self, signals: FloatArray, before: FloatArray, share: float = 1.0, dampers: Dampers = Dampers.NOW
    ) -> KnownResponse | None:
        """What the interfaces' compliance, of the step just taken, tells beforehand."""
        compliance = [
            self.participants[response.role].reals(response.references).reshape(6, 6)
            for response in self.wiring.responses
        ]
        return interface_response(self.wiring, signals, before, self.step, compliance, share, dampers)


def jacobi(stage: Stage, point: Point) -> Point:
    """All FMUs step with the inputs of the last communication point.

    Parameters
    ----------
    stage : Stage
    point : Point

    Returns
    -------
    Point
        A step later.
    """
    base = base_inputs(stage.wiring, point.number * stage.step, stage.step)
    held = stage.requested(point.signals, point.before)
    signals = point.signals.copy()
    for participant in stage.participants:
        stage.step_participant(participant, point.number, base + held, signals)
    return Point(point.number + 1, signals, point.signals, held, 1)


def gauss_seidel(stage: Stage, point: Point) -> Point:
    """One FMU steps after the other; the later ones get the fresh outputs of the earlier.

    Parameters
    ----------
    stage : Stage
    point : Point

    Returns
    -------
    Point
        A step later.
    """
    base = base_inputs(stage.wiring, point.number * stage.step, stage.step)
    signals, before, held = point.signals.copy(), point.before.copy(), np.zeros(len(base))
    for participant in stage.participants:
        role = participant.role
        held[role.input_share] = stage.requested(signals, before)[role.input_share]
        stage.step_participant(participant, point.number, base + held, signals)
        before[role.signal_share] = point.signals[role.signal_share]
    return Point(point.number + 1, signals, point.signals, held, 1)


class Iterated:
    """Steps are taken back and repeated until the inputs held over them are those that the outputs ask for.

    Parameters
    ----------
    stage : Stage
    settings : ExperimentTable
    """

    def __init__(self, stage: Stage, settings: ExperimentTable):
        self._stage, self._settings = stage, settings
        self._share = 1.0 if settings.held is Held.END else 0.5
        size = len(stage.wiring.base)
        self._kept: list[Secants] = []
        self._held: list[FloatArray] = []
        self._largest = np.zeros(int(np.max(stage.wiring.kind, initial=0)) + 1)
        self._none = no_secants(size)

    def __call__(self, point: Point) -> Point:
        """Take a step.

        Parameters
        ----------
        point : Point

        Returns
        -------
        Point
            A step later.

        Raises
        ------
        SimulationError
            The inputs do not settle, or an FMU refuses the step also with small changes of its inputs.
        """
        stage, settings = self._stage, self._settings
        base, first = self._base(point), stage.requested(point.signals, point.before, Dampers.NONE)
        for participant in stage.coupled:
            participant.save()
        signals = point.signals.copy()
        for participant in stage.free:
            stage.step_participant(participant, point.number, base, signals)
        here = self._none
        model: KnownResponse | None = None
        held, guess = (first if not self._held else self._held[-1]), self._predicted(first)
        past: tuple[FloatArray, FloatArray, list[int]] | None = None
        least = np.inf
        for iteration in range(1, settings.max_iterations + 1):
            near = past is not None and self._is_near(guess, past[0])
            held = self._evaluate(point, base, held, guess, signals, iteration > 1, near)
            asked = self._asked(first, signals, point)
            residual = asked - held
            if iteration == 1:
                model = stage.response(signals, point.signals, self._share, Dampers.MEAN)
            substeps = [participant.substeps for participant in stage.coupled]
            # Beside a small change of inputs, what other internal steps make of the answer is not small.
            if past is not None and (past[2] == substeps or not near):
                differences = ((residual - past[1])[:, None], (held - past[0])[:, None])
                here = joined(Secants(*differences), here)
            past = held, residual, substeps
            earlier = self._none
            # What earlier steps tell is older than a model that tells all.
            for older in [] if model is not None and model.whole else self._kept:
                earlier = joined(earlier, older)
            scale = self._scale(asked)
            delta, error = quasi_newton_update(residual, here, scale, settings.relaxation, model, earlier)
            size = float(np.linalg.norm(residual / scale))
            stalled, least = iteration >= _STALLED and size > _FALLS * least, min(least, size)
            if self._settled(held, error, residual, signals, stalled):
                self._remember(held, here)
                for participant in stage.coupled:
                    participant.forget()
                return Point(point.number + 1, signals, point.signals, held, iteration)
            guess = held + delta
        raise SimulationError(self._unsettled(point, held, error))

    def _base(self, point: Point) -> FloatArray:
        """What tables give over the step: at its beginning, or the mean of its ends."""
        time, step = point.number * self._stage.step, self._stage.step
        start = base_inputs(self._stage.wiring, time, step)
        if self._settings.held is Held.END:
            return start
        return 0.5 * (start + base_inputs(self._stage.wiring, time + step, step, before=True))

    def _asked(self, first: FloatArray, signals: FloatArray, point: Point) -> FloatArray:
        """What the inputs held over the step should be: of springs at its ends, of dampers by the motion over it."""
        springs = self._stage.requested(signals, point.signals, Dampers.NONE)
        both = self._stage.requested(signals, point.signals, Dampers.MEAN)
        return (1.0 - self._share) * first + self._share * springs + (both - springs)

    def _predicted(self, first: FloatArray) -> FloatArray:
        """Inputs to begin with: on the line through the last two steps."""
        if len(self._held) < 2:
            return first if not self._held else self._held[-1]
        return 2.0 * self._held[-1] - self._held[-2]

    def _evaluate(
        self,
        point: Point,
        base: FloatArray,
        safe: FloatArray,
        guess: FloatArray,
        signals: FloatArray,
        again: bool,
        near: bool,
    ) -> FloatArray:
        """Step with the inputs guessed, or, where an FMU refuses those, nearer to the ones that it took; which ones."""
        for halving in range(_HALVINGS + 1):
            if again or halving:
                for participant in self._stage.coupled:
                    participant.restore()
                    if near:
                        participant.hold_substeps()
            held = safe + 0.5**halving * (guess - safe)
            try:
                for participant in self._stage.coupled:
                    self._stage.step_participant(participant, point.number, base + held, signals)
                break
            except StepRefusedError:
                # Nearer to inputs that equal the guess there is nothing to try.
                if halving == _HALVINGS or np.array_equal(guess, safe):
                    raise
        return held

    def _is_near(self, inputs: FloatArray, held: FloatArray) -> bool:
        """Whether inputs are so near to those held at the last try that other internal steps would be seen."""
        return float(np.max(np.abs(inputs - held) / self._scale(held), initial=0.0)) < _NEAR

    def _scale(self, values: FloatArray) -> FloatArray:
        """Size of each input's kind: the largest so far, in this step or before."""
        kind = self._stage.wiring.kind
        largest = self._largest.copy()
        np.maximum.at(largest, kind, np.abs(values))
        return np.where(largest > 0.0, largest, 1.0)[kind]

    def _settled(
        self, held: FloatArray, error: FloatArray, residual: FloatArray, signals: FloatArray, stalled: bool
    ) -> bool:
        """Whether what the inputs are off by does not count, or is round-off: of nominal values where it stalls."""
        small = np.abs(error) <= self._settings.tolerance * self._scale(held + error)
        if np.all(small):
            return True
        return bool(np.all(small | (np.abs(residual) <= noise(self._stage.wiring, signals, self._stage.step, stalled))))

    def _remember(self, held: FloatArray, secants: Secants) -> None:
        np.maximum.at(self._largest, self._stage.wiring.kind, np.abs(held))
        self._held = [*self._held[-1:], held]
        if self._settings.reuse and secants.inputs.size:
            self._kept = [secants, *self._kept][: self._settings.reuse]

    def _unsettled(self, point: Point, held: FloatArray, error: FloatArray) -> str:
        ratio = np.abs(error) / self._scale(held)
        worst = int(np.argmax(ratio))
        return (
            f"the coupled inputs do not settle in the step from {point.number * self._stage.step:.9g} s: after "
            f"{self._settings.max_iterations} iterations {self._stage.wiring.input_names[worst]} still changes by "
            f"{ratio[worst]:.1e} of its size, expected {self._settings.tolerance:g}; take a shorter step, a larger "
            "max_iterations or tolerance, or a smaller relaxation"
        )


def scheme(stage: Stage, settings: ExperimentTable) -> Advance:
    """The scheme that the experiment asks for.

    Parameters
    ----------
    stage : Stage
    settings : ExperimentTable

    Returns
    -------
    callable
        From a point to the next.
    """
    if settings.scheme is Scheme.ITERATED:
        return Iterated(stage, settings)
    explicit = jacobi if settings.scheme is Scheme.JACOBI else gauss_seidel
    return lambda point: explicit(stage, point)
