"""The FMI 2.0 side of a flexible body: values by reference, life cycle, state as one block, failures as statuses.

pythonfmu's library calls the methods; it finds the class in a generated module that derives from this one and from
pythonfmu's base class. Only what follows from the standard is here: the body itself knows nothing of FMI.
"""

import math
from collections.abc import Callable, Sequence
from ctypes import py_object, pythonapi
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, ClassVar, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from .body import FlexibleBody
from .contents import DESCRIPTION, Contents, described_guid
from .errors import OptionError, RuntimeBodyError, StepError
from .loads import Loads
from .lookout import Lookout, Seen
from .modal_file import read_modal_file
from .parameters import Parameters
from .state_block import identity, seal, unseal
from .stepping import State, Work
from .variables import (
    FEED,
    FRAME_ROTATION,
    ITERATIONS,
    KINETIC_ENERGY,
    MISSED,
    MOMENTUM,
    SPIN,
    STABILITY,
    STATUS_CODE,
    STEP_ERROR,
    STRAIN_ENERGY,
    SUBSTEPS,
    Group,
    Initialization,
    Interpolation,
    variable_table,
)
from .watch import Finding, OnLimit, OnRefusal

FloatArray = NDArray[np.float64]

MODAL_FILE = "modal.h5"
# FMI status numbers.
_WARNING, _DISCARD, _ERROR = 1, 2, 3
_CATEGORY = {_WARNING: "logStatusWarning", _DISCARD: "logStatusDiscard", _ERROR: "logStatusError"}
# Values of status.code.
_SOUND, _REFUSED, _PASSED = 0, 1, 2


class LogMessage:
    """A line for the master's logger, in the form that pythonfmu's library reads."""

    def __init__(self, status: int, text: str):
        self.status = status
        self.category = _CATEGORY[status]
        # The library hands the text on as a printf format.
        self.msg = text.replace("%", "%%")


class _ToldError(OptionError):
    """A failure that is in the log already."""


class _EndOfSimulationError(Exception):
    """A limit was passed or a step refused whose `on_limit` asks for the end of the simulation."""


P = ParamSpec("P")
R = TypeVar("R")


def _guarded(call: Callable[P, R]) -> Callable[P, R]:
    """Let no exception out that the library has not been made ready for: a second one would end the process."""

    @wraps(call)
    def guarded(*arguments: P.args, **named: P.kwargs) -> R:
        try:
            return call(*arguments, **named)
        except _ToldError:
            raise
        except Exception as error:
            words = str(error) if isinstance(error, RuntimeBodyError) else f"unexpected {type(error).__name__}: {error}"
            raise cast("BodySlave", arguments[0])._failure(words) from error

    return guarded


class BodySlave:
    """A flexible body behind the FMI 2.0 co-simulation calls.

    Parameters
    ----------
    **kwargs
        `instance_name` and `resources` (the folder of the unpacked FMU's resources), from pythonfmu's library.

    Raises
    ------
    ModalFileError
        The modal file is missing, damaged, altered or of an unknown version: instantiation fails.
    ContentsError
        The modal file or the model description is that of another FMU: instantiation fails.
    """

    packed: ClassVar[Contents | None] = None
    """What the archive was packed with; None outside of one."""

    def __init__(self, **kwargs: Any):
        self.instance_name = str(kwargs["instance_name"])
        self._log: list[LogMessage] = []
        resources = Path(str(kwargs["resources"]))
        path = resources / MODAL_FILE
        self._model = read_modal_file(path)
        self._identity = identity(path.read_bytes())
        if self.packed is not None:
            # Masters may unpack the resources only: then there is no guid to compare.
            description = resources.parent / DESCRIPTION
            found = described_guid(description.read_bytes()) if description.is_file() else None
            self.packed.check(self._identity, found)
        self._variables = variable_table(self._model)
        groups = [variable.group for variable in self._variables]
        self._motion = groups.index(Group.MOTION)
        self._rate = self._motion + groups.count(Group.MOTION)
        self._stress = self._rate + groups.count(Group.RATE)
        self._status_reference = groups.index(Group.STATUS)
        self._compliance = groups.index(Group.COMPLIANCE) if Group.COMPLIANCE in groups else len(groups)
        self._inputs = np.zeros(groups.count(Group.INPUT))
        self._every_motion = list(range(self._motion, self._stress))
        self._every_input = list(range(self._inputs.size))
        self._names = tuple(v.name for v in self._variables[: self._inputs.size])
        # Inputs of the step before.
        self._previous = self._inputs.copy()
        self._last_step = 0.0
        self._seen = Seen.nothing(self._inputs.size, self._model.mode_count)
        self._parameters = Parameters(self._variables)
        self._lookout = Lookout(self._parameters.limits, self._names)
        self._interpolation = self._parameters.interpolation
        self._status = _SOUND
        self._body: FlexibleBody | None = None
        self._state: State | None = None
        self._work = Work(0, 0, 0.0)
        self._running = False
        self._outputs: dict[str, list[float]] = {}

    # Life cycle.

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Nothing to do: state follows from the state before and the inputs alone, not from time."""

    def enter_initialization_mode(self) -> None:
        """Nothing to do: initial values are found when first asked for."""

    @_guarded
    def exit_initialization_mode(self) -> None:
        """Fix the parameters and the initial state."""
        body, state = self._start()
        self._previous = np.where(np.isfinite(self._inputs), self._inputs, 0.0)
        if self._parameters.initialization is Initialization.STATIC:
            findings, self._seen = self._lookout.look(body, state, self._previous, 0.0, self._seen)
            for finding in findings:
                if finding.action is not OnLimit.WARN:
                    raise self._failure(f"static initialisation: {finding.text}")
                self._warn(finding)
        self._running = True

    def terminate(self) -> None:
        """Nothing to do: no files or processes are held."""

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by a step; False (discard) leaves the state as it was and says why in the log."""
        try:
            return self._stepped(current_time, step_size)
        except _EndOfSimulationError as end:
            raise self._failure(str(end)) from end
        except RuntimeBodyError as error:
            return self._refuse(str(error))
        except Exception as error:  # an exception that got out would be fatal to the master's whole process
            return self._refuse(f"unexpected {type(error).__name__}: {error}")

    # Values.

    @_guarded
    def get_real(self, vrs: list[int]) -> list[float]:
        """Values of real variables."""
        # Most masters ask for motions alone, many for all at once.
        if vrs == self._every_motion:
            return self._moving()
        first = self._motion
        if vrs and min(vrs) >= first and max(vrs) < self._stress:
            moving = self._moving()
            return [moving[vr - first] for vr in vrs]
        return [self._real(vr) for vr in vrs]

    @_guarded
    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set inputs, and parameters before initialisation ends."""
        if vrs == self._every_input:
            self._inputs[:] = values
        else:
            count = self._inputs.size
            self._check_settable([vr for vr in vrs if not 0 <= vr < count], "Real")
            for vr, value in zip(vrs, values, strict=True):
                if vr < count:
                    self._inputs[vr] = value
                else:
                    self._set_parameter(vr, value)
        self._changed()

    @_guarded
    def get_integer(self, vrs: list[int]) -> list[int]:
        """Values of integer variables."""
        integers = {
            STATUS_CODE: self._status,
            ITERATIONS: self._work.iterations,
            SUBSTEPS: self._work.substeps,
        }
        return [integers[self._named(vr, "Integer")] for vr in vrs]

    @_guarded
    def set_integer(self, vrs: list[int], values: list[int]) -> None:  # noqa: ARG002
        """No integer can be set."""
        self._check_settable(vrs, "Integer")

    @_guarded
    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Values of Boolean parameters."""
        return [bool(self._parameters[self._named(vr, "Boolean")]) for vr in vrs]

    @_guarded
    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Set Boolean parameters before initialisation ends."""
        self._check_settable(vrs, "Boolean")
        for vr, value in zip(vrs, values, strict=True):
            self._set_parameter(vr, value)
        self._changed()

    @_guarded
    def get_string(self, vrs: list[int]) -> list[str]:
        """Values of string parameters."""
        return [str(self._parameters[self._named(vr, "String")]) for vr in vrs]

    @_guarded
    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """Set string parameters before initialisation ends."""
        self._check_settable(vrs, "String")
        if not self._running:
            for vr, value in zip(vrs, values, strict=True):
                self._parameters.check(self._variables[vr].name, value)
        for vr, value in zip(vrs, values, strict=True):
            self._set_parameter(vr, value)
        self._changed()

    # State.

    @_guarded
    def _get_fmu_state(self) -> bytes:
        """Everything that the future depends on, as one block of bytes."""
        modes = self._model.mode_count
        state = self._state or State(np.zeros(modes), np.zeros(modes))
        # With interfaces fixed the body has fewer modes; the block keeps its length.
        rest = np.zeros(modes - state.q.size)
        flags: list[float] = [self._state is not None, self._running, self._status, state.substeps, state.q.size]
        work = [self._work.substeps, self._work.iterations, self._work.error]
        numbers = np.array([*self._parameters.numbers(), *flags, self._last_step, *work], dtype=np.float64)
        parts = [self._inputs, self._previous, state.q, rest, state.v, rest, numbers, self._seen.numbers()]
        return seal(np.concatenate(parts).tobytes(), self._identity)

    @_guarded
    def _set_fmu_state(self, block: bytes) -> None:
        """Go back to a state taken from this or another instance of the same FMU."""
        modes, inputs = self._model.mode_count, self._inputs.size
        sizes = [inputs, inputs, modes, modes, len(self._parameters.numbers()), 6, 3, Seen.count(inputs, modes)]
        values = np.frombuffer(unseal(block, self._identity, 8 * sum(sizes)), dtype=np.float64)
        now, previous, q, v, numbers, flags, work, seen = np.split(values, np.cumsum(sizes)[:-1])
        if self._parameters.restore(numbers.tolist()):
            self._body = None
        self._inputs, self._previous = now.copy(), previous.copy()
        known, running, status, substeps, count = (int(flag) for flag in flags[:5])
        self._last_step = float(flags[5])
        self._state = State(q[:count].copy(), v[:count].copy(), substeps) if known else None
        self._running, self._status = bool(running), status
        self._seen = Seen.of(seen, inputs)
        self._work = Work(int(work[0]), int(work[1]), float(work[2]))
        self._outputs.clear()

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        return bytes(state)

    def _get_log_queue(self) -> list[LogMessage]:
        return self._log

    # Inside.

    def _start(self) -> tuple[FlexibleBody, State]:
        """Body and state, set up from parameters and inputs when first asked for."""
        if self._body is None:
            chosen = self._parameters
            try:
                self._body = FlexibleBody(
                    self._model, chosen.formulation, chosen.damping_scale, chosen.step_limits, chosen.fixed
                )
            except OptionError as error:
                raise self._failure(str(error)) from error
            self._lookout, self._interpolation = Lookout(chosen.limits, self._names), chosen.interpolation
        if self._state is None:
            if self._parameters.initialization is Initialization.STATIC:
                try:
                    if not np.all(np.isfinite(self._inputs)):
                        raise OptionError("an input is not finite, so there is no equilibrium to start from")
                    self._state = self._body.static(self._loads())
                except RuntimeBodyError as error:
                    raise self._failure(f"static initialisation: {error}") from error
            else:
                self._state = self._body.rest()
        return self._body, self._state

    def _stepped(self, current_time: float, step_size: float) -> bool:
        """Take a step, or refuse it."""
        if not (math.isfinite(current_time) and math.isfinite(step_size) and step_size >= 0.0):
            return self._refuse(f"a step of {step_size} s from {current_time} s: expected a finite step ≥ 0")
        square = float(self._inputs @ self._inputs)
        # Finite numbers may have a square that is not.
        if not math.isfinite(square) and not np.isfinite(self._inputs).all():
            wrong = int(np.flatnonzero(~np.isfinite(self._inputs))[0])
            return self._refuse(f"input {self._names[wrong]} is {self._inputs[wrong]}: expected a finite value")
        body, state = self._start()
        if step_size == 0.0:
            return True
        start, end = self._over_step(float(step_size))
        state = replace(state, substeps=max(state.substeps, self._parameters.fewest_substeps))
        try:
            reached, work = body.step_packed(state, start, float(step_size), end)
        except StepError as error:
            if self._parameters.on_refusal is OnRefusal.TERMINATE:
                raise _EndOfSimulationError(str(error)) from error
            raise
        findings, seen = self._lookout.look(body, reached, start if end is None else end, step_size, self._seen)
        for finding in findings:
            if finding.action is OnLimit.TERMINATE:
                raise _EndOfSimulationError(finding.text)
            if finding.action is OnLimit.DISCARD:
                return self._refuse(finding.text)
        for finding in findings:
            self._warn(finding)
        self._seen = seen
        self._state, self._work = reached, work
        self._previous, self._last_step = self._inputs.copy(), float(step_size)
        self._outputs.clear()
        return True

    def _over_step(self, step: float) -> tuple[FloatArray, FloatArray | None]:
        """Inputs at a step's start and, where they are others, at its end."""
        now, before = self._inputs, self._previous
        if self._interpolation is Interpolation.CONSTANT or np.array_equal(now, before):
            return now, None
        if self._interpolation is Interpolation.RAMP:
            return before, now
        if self._last_step == 0.0:
            return now, None
        return now, now + (now - before) * (step / self._last_step)

    def _warn(self, finding: Finding) -> None:
        """Log, and remember, a limit that is passed."""
        self._status = self._status or _PASSED
        self._log.append(LogMessage(_WARNING, f"{self.instance_name}: {finding.text}"))

    def _changed(self) -> None:
        """Before the first step inputs and parameters still decide where the body starts."""
        if not self._running:
            self._state = None
            self._outputs.clear()

    def _loads(self) -> Loads:
        count = 6 * self._model.interface_count
        wrench = self._inputs[:count].reshape(-1, 2, 3)
        acceleration = np.zeros(3) if self._model.masses is None else self._inputs[count:]
        return Loads(wrench[:, 0], wrench[:, 1], acceleration)

    def _real(self, vr: int) -> float:
        if 0 <= vr < self._inputs.size:
            return float(self._inputs[vr])
        if self._motion <= vr < self._stress:
            return self._moving()[vr - self._motion]
        if self._stress <= vr < self._status_reference:
            return self._found("stress", self._stresses)[vr - self._stress]
        name = self._named(vr, "Real")
        if name in self._parameters:
            return float(self._parameters[name])
        if vr >= self._compliance:
            return self._found("compliance", self._compliances)[vr - self._compliance]
        body, state = self._start()
        if name == FRAME_ROTATION:
            return body.largest_rotation(state)
        if name == STABILITY:
            # Inputs set since the last step have not acted yet, and need not be finite.
            return body.stability(state, self._previous)[0]
        if name == MISSED:
            return body.judge.error(self._previous) if body.judge is not None else 0.0
        if name == FEED:
            return self._seen.feed.largest
        if name == SPIN:
            return 0.0 if body.spinning is None else body.spinning.ratio(state)
        if name == MOMENTUM:
            return self._seen.momentum.drift
        if name == STEP_ERROR:
            return self._work.error
        strain, kinetic = body.energies(state)
        return {STRAIN_ENERGY: strain, KINETIC_ENERGY: kinetic}[name]

    def _moving(self) -> list[float]:
        """Motion, then rates if there are any, in the order of their references."""
        return self._found("moving", self._motions)

    def _found(self, name: str, find: Callable[[FlexibleBody, State], list[float]]) -> list[float]:
        """Values found once per step, and only when asked for."""
        values = self._outputs.get(name)
        if values is None:
            values = self._outputs[name] = find(*self._start())
        return values

    def _motions(self, body: FlexibleBody, state: State) -> list[float]:
        if not self._model.velocity_outputs:
            return list(body.motion(state).tolist())
        motion, rates = body.motion_and_rates(state)
        return [*motion.tolist(), *rates.tolist()]

    @staticmethod
    def _stresses(body: FlexibleBody, state: State) -> list[float]:
        return list(body.von_mises(state).tolist())

    def _compliances(self, body: FlexibleBody, state: State) -> list[float]:
        """Compliance of every interface that offers it, over a step as long as the last one."""
        step = self._last_step or self._model.suggested_step
        names = self._model.interface_names
        offered = [names.index(name) for name in self._model.compliance_interfaces]
        found = body.compliance(state, self._previous, step, offered)
        # By pairs of interfaces: of the first by loads on the second, row by row.
        count = len(offered)
        return list(found.reshape(count, 6, count, 6).swapaxes(1, 2).ravel().tolist())

    def _named(self, vr: int, kind: str) -> str:
        if not (0 <= vr < len(self._variables) and self._variables[vr].type == kind):
            raise self._failure(f"value reference {vr} is no {kind} variable of this FMU")
        return self._variables[vr].name

    def _check_settable(self, vrs: Sequence[int], kind: str) -> None:
        """Refuse references of which one is no parameter of a type, before any is set."""
        for vr in vrs:
            if (name := self._named(vr, kind)) not in self._parameters:
                raise self._failure(f"{name} cannot be set")

    def _set_parameter(self, vr: int, value: float | bool | str) -> None:
        name = self._variables[vr].name
        tunable = name in self._parameters.tunable
        if self._running and not tunable:
            self._log.append(LogMessage(_WARNING, f"{name} is fixed once initialisation has ended; it keeps its value"))
            return
        self._parameters.set(name, value)
        if not tunable:
            self._body = None

    def _refuse(self, text: str) -> bool:
        """Log, remember and discard a step."""
        self._status = _REFUSED
        self._log.append(LogMessage(_DISCARD, f"{self.instance_name}: {text}"))
        return False

    def _failure(self, text: str) -> RuntimeBodyError:
        """Error that makes pythonfmu's library answer the call with a failure."""
        self._status = _REFUSED
        self._log.append(LogMessage(_ERROR, f"{self.instance_name}: {text}"))
        # The library gives up its references to these when a call raises, and once more when the instance is freed:
        # without one to spare, every later call would use freed memory and end the master's process.
        for held in (self, type(self), self._log):
            pythonapi.Py_IncRef(py_object(held))
        return _ToldError(text)
