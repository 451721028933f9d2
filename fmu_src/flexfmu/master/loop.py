"""The loop over communication steps, which the core carries out: a coupling as its structures, and what comes back."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.library import library
from ..core.structures import Arrays, structures
from ..files.basics import FloatArray, SimulationError
from ..files.outputs import fields_of
from .config import ExperimentTable, Held, Scheme
from .layout import Recorded, Springs, Wiring
from .participants import Participant

_KINDS = structures("joints", "exchange", "participant", "doubts", "coupling")
# `Ending` of core/coupling.h.
_CALL_FAILED, _STEP_REFUSED, _NOT_FINITE, _UNSETTLED, _FAILURE_TOLD, GROWS = range(1, 7)
# `Asked` of core/participant.h; the step is told of with its time.
_ASKED = ("its start", "to take its inputs", "to give its values", "{}", "to save its state", "to go back to its state")
_HOLD = "to hold its internal steps"
_TYPES = ("Real", "Integer", "Boolean")


class Loop:
    """FMUs, what links them, and the loop that steps them.

    Parameters
    ----------
    wiring : Wiring
    participants : sequence of Participant
    settings : ExperimentTable
    every : int
        Communication points a row of results.

    Attributes
    ----------
    outcome : structure
        Of core/coupling.h, of the last call.
    notices : array of Notice
        So many as `outcome` says.
    times : (rows,) float
        s.
    rows : (rows, columns) float
        Recorded variables, iterations, energy created.

    Raises
    ------
    SimulationError
        There is not enough memory.
    """

    def __init__(self, wiring: Wiring, participants: Sequence[Participant], settings: ExperimentTable, every: int):
        self._wiring, self._participants, self._settings = wiring, tuple(participants), settings
        self._arrays = arrays = Arrays()
        self.outcome = _KINDS["Outcome"]()
        self.notices = (_KINDS["Notice"] * (len(participants) + 3))()
        most, columns = settings.steps // every + 3, len(wiring.recorded) + 2
        self._times, self._rows = np.empty(most), np.empty((most, columns))
        recorded = list(enumerate(wiring.recorded))
        ours = [
            participating(one, [pair for pair in recorded if pair[1].role == k], arrays)
            for k, one in enumerate(participants)
        ]
        placed = (_KINDS["Participant"] * len(participants))(*ours)
        for one, place in zip(participants, placed, strict=True):
            one.join(place)
        mean = settings.scheme is Scheme.ITERATED and settings.held is Held.MEAN
        self._setup = arrays.filled(
            _KINDS["Setup"],
            wiring=wired(wiring, settings.step, arrays),
            participants=arrays.place(placed),
            response_references=[r.references for r in wiring.responses],
            scheme=list(Scheme).index(settings.scheme),
            every=every,
            columns=columns,
            kinds=int(np.max(wiring.kind, initial=0)) + 1,
            most_iterations=settings.max_iterations,
            reuse=settings.reuse,
            mean_inputs=mean,
            tolerance=settings.tolerance,
            relaxation=settings.relaxation,
            share=0.5 if mean else 1.0,
            times=self._times,
            rows=self._rows,
            most_rows=most,
            notices=arrays.place(self.notices),
        )
        self._core = library()
        self._handle = self._core.coupling_open(ctypes.byref(self._setup))
        if not self._handle:
            raise SimulationError("a coupling needs more memory than there is: take a smaller max_iterations or reuse")

    @property
    def times(self) -> FloatArray:
        """Times (rows,) recorded so far, s."""
        return self._times[: self.outcome.rows]

    @property
    def rows(self) -> FloatArray:
        """Rows recorded so far."""
        return self._rows[: self.outcome.rows]

    def run(self, steps: int) -> None:
        """Go on until so many steps are taken.

        Raises
        ------
        SimulationError
            An FMU refuses or fails a step, or the coupled inputs do not settle. Where the motion grows without bound
            the loop ends, too, without one.
        """
        self.ask("run", steps, self._settings.steps)

    def slope(self) -> FloatArray | None:
        """Derivative (n, n) of the coupled inputs by themselves, of the step just taken; None where nothing is known.

        Raises
        ------
        SimulationError
            An FMU fails the call.
        """
        found = np.zeros((len(self._wiring.base),) * 2)
        return found if self.ask("slope", found) else None

    def close(self) -> None:
        """Drop the states kept."""
        if self._handle:
            broken = [k for k, participant in enumerate(self._participants) if not participant.usable]
            self._core.coupling_close(self._handle, *(broken or [-1]))
            self._handle = None

    def ask(self, call: str, *arguments: Any) -> int:
        """Have the core carry out a call: "begin", which ends the initialisation, "record", or those above.

        Parameters
        ----------
        call : str
        *arguments : int

        Returns
        -------
        int

        Raises
        ------
        SimulationError
            An FMU fails it.
        """
        answer = getattr(self._core, f"coupling_{call}")(self._handle, *arguments, ctypes.byref(self.outcome))
        for participant in self._participants:
            if participant.raised is not None:
                raise participant.raised
        if self.outcome.ending in (_CALL_FAILED, _STEP_REFUSED, _NOT_FINITE, _FAILURE_TOLD):
            raise self._failure(self._participants[self.outcome.who])
        if self.outcome.ending == _UNSETTLED:
            raise SimulationError(
                f"the coupled inputs do not settle in the step from {self._time:.9g} s: after "
                f"{self._settings.max_iterations} iterations {self._wiring.input_names[self.outcome.who]} still "
                f"changes by {self.outcome.figure:.1e} of its size, expected {self._settings.tolerance:g}; take a "
                "shorter step, a larger max_iterations or tolerance, or a smaller relaxation"
            )
        return int(answer or 0)

    @property
    def _time(self) -> float:
        """Of the point reached, s."""
        return float(self.outcome.steps * self._settings.step)

    def _failure(self, participant: Participant) -> SimulationError:
        """What an FMU did wrong, in words."""
        found, name, said = self.outcome, participant.name, participant.said
        where = f"the step from {self._time:.9g} s by {self._settings.step:g} s"
        if found.ending == _STEP_REFUSED:
            return SimulationError(f"fmu {name!r} refused {where}: {said or 'without a reason in its log'}")
        if found.ending == _FAILURE_TOLD:
            return SimulationError(f"fmu {name!r}: status.code is {found.what}, a failure: {said or 'no log'}")
        if found.ending == _NOT_FINITE:
            reference = participant.role.signals[found.what]
            variables = participant.role.description.variables.values()
            variable = next(v.name for v in variables if v.valueReference == reference)
            return SimulationError(
                f"fmu {name!r}: {variable} is {found.figure}, expected a finite value. A coupling that grows without "
                "bound ends so: take a shorter step, or the iterated scheme"
            )
        return participant.failed((*_ASKED, _HOLD)[found.what].format(where), found.status)


def wired(w: Wiring, step: float, arrays: Arrays) -> Any:
    """A coupling's layout as the core takes it.

    Parameters
    ----------
    w : Wiring
    step : float
        Communication step, s.
    arrays : Arrays
        Keeps what the structure points to.

    Returns
    -------
    Structure
    """
    ends, springs, tables, responses = w.ends, w.springs, w.tables, w.responses
    to, source = np.nonzero(w.matrix)
    alike = ("base", "coupled", "kind", "input_role", "signal_role", "nominal")
    return arrays.filled(
        _KINDS["Wiring"],
        **{name: getattr(w, name) for name in alike},
        inputs=len(w.base),
        signals=w.matrix.shape[1],
        participants=len(w.roles),
        tables=len(tables),
        links=len(to),
        responses=len(responses),
        step=step,
        table_rows=[len(rows) for _, rows in tables],
        table_columns=[len(inputs) for inputs, _ in tables],
        table_times=np.concatenate([np.zeros(0), *(rows[:, 0] for _, rows in tables)]),
        table_values=np.concatenate([np.zeros(0), *(rows[:, 1:].ravel() for _, rows in tables)]),
        table_inputs=np.concatenate([np.zeros(0), *(inputs for inputs, _ in tables)]),
        link_to=to,
        link_from=source,
        link_factor=w.matrix[to, source],
        joints=joined(springs, len(ends.names), arrays),
        end_motion=ends.motion,
        end_rates=ends.rates,
        end_loads=ends.loads,
        response_role=[r.role for r in responses],
        response_end=[r.end for r in responses],
        response_places=[r.places for r in responses],
    )


def joined(springs: Springs, ends: int, arrays: Arrays) -> Any:
    """Springs between so many ends as the core takes them."""
    return arrays.filled(_KINDS["Joints"], count=len(springs.a), ends=ends, **fields_of(springs))


def participating(one: Participant, variables: list[tuple[int, Recorded]], arrays: Arrays) -> Any:
    """An FMU as the core takes it; `variables`: recorded ones, with the columns that they fill."""
    variables = sorted(variables, key=lambda pair: _TYPES.index(pair[1].type))
    role = one.role
    return arrays.filled(
        _KINDS["Participant"],
        instance=one.instance,
        **{name: ctypes.cast(function, ctypes.c_void_p).value for name, function in one.functions.items()},
        first_input=role.first_input,
        inputs=len(role.inputs),
        first_signal=role.first_signal,
        signals=len(role.signals),
        recorded=(ctypes.c_int64 * 3)(*(sum(v.type == kind for _, v in variables) for kind in _TYPES)),
        input_references=role.inputs,
        signal_references=role.signals,
        recorded_references=[v.reference for _, v in variables],
        recorded_columns=[column for column, _ in variables],
        **one.bookkeeping,
        marks=one.marks,
        tried=1,
    )
