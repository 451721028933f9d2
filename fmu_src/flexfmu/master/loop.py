"""The loop over communication steps, which the core carries out: a coupling as its structures, and what comes back."""

import ctypes
from collections.abc import Sequence
from ctypes import Structure
from typing import Any

import numpy as np

from ..core.library import library
from ..files.array_types import FloatArray
from ..files.errors import SimulationError
from .config import ExperimentTable, Held, Scheme
from .layout import Ends, Recorded, Springs, Wiring
from .participants import FUNCTIONS, Participant, StepRefusedError

_PLACE, _NUMBER, _WHOLE = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
# `Ending` of core/coupling.h.
_CALL_FAILED, _STEP_REFUSED, _NOT_FINITE, _UNSETTLED, _FAILURE_TOLD, GROWS = range(1, 7)
# `Asked` of core/participant.h; the step is told of with its time.
_ASKED = ("its start", "to take its inputs", "to give its values", "{}", "to save its state", "to go back to its state")
_HOLD = "to hold its internal steps"
_TYPES = ("Real", "Integer", "Boolean")


def _named(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class _Joints(Structure):
    """`Joints` of core/joints.h."""

    _fields_ = [*_named(_WHOLE, "count ends"), *_named(_PLACE, "a b stiffness damping axes")]


class _Wiring(Structure):
    """`Wiring` of core/exchange.h."""

    _fields_ = [
        *_named(_WHOLE, "inputs signals participants tables links responses"),
        ("step", _NUMBER),
        *_named(_PLACE, "base coupled kind input_role signal_role nominal table_rows table_columns"),
        *_named(_PLACE, "table_times table_values table_inputs link_to link_from link_factor"),
        ("joints", _Joints),
        *_named(_PLACE, "end_motion end_rates end_loads response_role response_end response_places"),
    ]


class _Participant(Structure):
    """`Participant` of core/participant.h."""

    _fields_ = [
        ("instance", _PLACE),
        *_named(_PLACE, " ".join(FUNCTIONS)),
        *_named(_WHOLE, "first_input inputs first_signal signals"),
        ("recorded", _WHOLE * 3),
        *_named(_PLACE, "input_references signal_references recorded_references recorded_columns"),
        *_named(_WHOLE, "status substeps fewest"),
        ("fewest_start", _NUMBER),
        *_named(_PLACE, "marks state"),
        *_named(_WHOLE, "saved tried"),
    ]


class Notice(Structure):
    """`Notice` of core/doubts.h: what a run is told of, once each."""

    _fields_ = [*_named(_WHOLE, "kind step who"), ("figures", _NUMBER * 2)]


class _Setup(Structure):
    """`Setup` of core/coupling.h."""

    _fields_ = [
        ("wiring", _Wiring),
        *_named(_PLACE, "participants response_references"),
        *_named(_WHOLE, "scheme every columns kinds most_iterations reuse mean_inputs"),
        *_named(_NUMBER, "tolerance relaxation share"),
        *_named(_PLACE, "times rows"),
        ("most_rows", _WHOLE),
        ("notices", _PLACE),
    ]


class Outcome(Structure):
    """`Outcome` of core/coupling.h: why a call came back, and how far the run is."""

    _fields_ = [
        *_named(_WHOLE, "ending who what status"),
        ("figure", _NUMBER),
        *_named(_WHOLE, "steps rows rounds notices feeds"),
        *_named(_NUMBER, "created stored exchanged now"),
    ]


class Arrays:
    """Keeps what structures point to."""

    def __init__(self) -> None:
        self._kept: list[Any] = []

    def place(self, array: Any) -> int:
        """Address of an array of ctypes."""
        self._kept.append(array)
        return ctypes.addressof(array)

    def at(self, values: Any, kind: Any = np.float64) -> int:
        """Address of an array of numbers of a kind."""
        self._kept.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._kept[-1].ctypes.data)


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
    outcome : Outcome
        Of the last call.
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
        self.outcome = Outcome()
        self.notices = (Notice * (len(participants) + 3))()
        most, columns = settings.steps // every + 3, len(wiring.recorded) + 2
        self._times, self._rows = np.empty(most), np.empty((most, columns))
        recorded = list(enumerate(wiring.recorded))
        ours = [
            participating(one, [pair for pair in recorded if pair[1].role == k], arrays)
            for k, one in enumerate(participants)
        ]
        mean = settings.scheme is Scheme.ITERATED and settings.held is Held.MEAN
        self._setup = _Setup(
            wiring=wired(wiring, settings.step, arrays),
            participants=arrays.place((_Participant * len(participants))(*ours)),
            response_references=arrays.at([r.references for r in wiring.responses], np.uint32),
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
            times=self._times.ctypes.data,
            rows=self._rows.ctypes.data,
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

    def begin(self) -> None:
        """Hand outputs on along the connections, in the order listed, end the initialisation and record.

        Raises
        ------
        SimulationError
            An FMU fails a call.
        """
        self._ask("begin")

    def run(self, steps: int) -> None:
        """Go on until so many steps are taken.

        Raises
        ------
        SimulationError
            An FMU refuses or fails a step, or the coupled inputs do not settle. Where the motion grows without bound
            the loop ends, too, without one.
        """
        self._ask("run", steps, self._settings.steps)

    def record(self) -> None:
        """Record the point reached, unless it is.

        Raises
        ------
        SimulationError
            An FMU fails the call.
        """
        self._ask("record")

    def slope(self) -> FloatArray | None:
        """Derivative (n, n) of the coupled inputs by themselves, of the step just taken; None where nothing is known.

        Raises
        ------
        SimulationError
            An FMU fails the call.
        """
        found = np.zeros((len(self._wiring.base),) * 2)
        known = self._ask("slope", found.ctypes.data)
        return found if known else None

    def close(self) -> None:
        """Drop the states kept."""
        if self._handle:
            broken = [k for k, participant in enumerate(self._participants) if not participant.usable]
            self._core.coupling_close(self._handle, *(broken or [-1]))
            self._handle = None

    def _ask(self, call: str, *arguments: Any) -> int:
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
            return StepRefusedError(f"fmu {name!r} refused {where}: {said or 'without a reason in its log'}")
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


def wired(w: Wiring, step: float, arrays: "Arrays") -> Structure:
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
    ends, springs, whole = w.ends, w.springs, np.int64
    to, source = np.nonzero(w.matrix)
    return _Wiring(
        inputs=len(w.base),
        signals=w.matrix.shape[1],
        participants=len(w.roles),
        tables=len(w.tables),
        links=len(to),
        responses=len(w.responses),
        step=step,
        base=arrays.at(w.base),
        coupled=arrays.at(w.coupled, whole),
        kind=arrays.at(w.kind, whole),
        input_role=arrays.at(w.input_role, whole),
        signal_role=arrays.at(w.signal_role, whole),
        nominal=arrays.at(w.nominal),
        table_rows=arrays.at([len(table.time) for table in w.tables], whole),
        table_columns=arrays.at([len(table.inputs) for table in w.tables], whole),
        table_times=arrays.at(np.concatenate([np.zeros(0), *(table.time for table in w.tables)])),
        table_values=arrays.at(np.concatenate([np.zeros(0), *(table.values.ravel() for table in w.tables)])),
        table_inputs=arrays.at(np.concatenate([np.zeros(0), *(table.inputs for table in w.tables)]), whole),
        link_to=arrays.at(to, whole),
        link_from=arrays.at(source, whole),
        link_factor=arrays.at(w.matrix[to, source]),
        joints=joined(springs, len(ends.names), arrays),
        end_motion=arrays.at(ends.motion, whole),
        end_rates=arrays.at(ends.rates, whole),
        end_loads=arrays.at(ends.loads, whole),
        response_role=arrays.at([r.role for r in w.responses], whole),
        response_end=arrays.at([_end(ends, r.moved) if r.moved == r.loaded else -1 for r in w.responses], whole),
        response_places=arrays.at([(*r.motion, *r.rates, *r.loads) for r in w.responses], whole),
    )


def joined(springs: Springs, ends: int, arrays: "Arrays") -> Structure:
    """Springs between so many ends as the core takes them; arguments else as of `wired`."""
    return _Joints(
        count=len(springs.a),
        ends=ends,
        a=arrays.at(springs.a, np.int64),
        b=arrays.at(springs.b, np.int64),
        stiffness=arrays.at(springs.stiffness),
        damping=arrays.at(springs.damping),
        axes=arrays.at(np.tile(np.eye(3), (len(springs.a), 1, 1)) if springs.axes is None else springs.axes),
    )


def participating(one: Participant, variables: list[tuple[int, Recorded]], arrays: "Arrays") -> _Participant:
    """An FMU as the core takes it, with columns and variables of its results; arrays as of `wired`."""
    variables = sorted(variables, key=lambda pair: _TYPES.index(pair[1].type))
    role = one.role
    return _Participant(
        instance=one.instance,
        **{name: ctypes.cast(function, _PLACE).value for name, function in one.functions.items()},
        first_input=role.first_input,
        inputs=len(role.inputs),
        first_signal=role.first_signal,
        signals=len(role.signals),
        recorded=(_WHOLE * 3)(*(sum(v.type == kind for _, v in variables) for kind in _TYPES)),
        input_references=arrays.at(role.inputs, np.uint32),
        signal_references=arrays.at(role.signals, np.uint32),
        recorded_references=arrays.at([v.reference for _, v in variables], np.uint32),
        recorded_columns=arrays.at([column for column, _ in variables], np.int64),
        **one.bookkeeping,
        marks=one.marks.ctypes.data,
        tried=1,
    )


def _end(ends: Ends, name: str) -> int:
    """Number of an end by its name; −1 where no spring holds it."""
    return ends.names.index(name) if name in ends.names else -1
