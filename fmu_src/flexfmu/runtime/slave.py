"""The FMI 2.0 side of a flexible body: values by reference, life cycle, state as one block, failures as statuses.

pythonfmu's library calls the methods; it finds the class in a generated module that derives from this one and from
pythonfmu's base class. Only what follows from the standard is here: the body itself knows nothing of FMI.
"""

from ctypes import py_object, pythonapi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .body import FlexibleBody
from .errors import OptionError, RuntimeBodyError
from .loads import Loads
from .modal_file import read_modal_file
from .reduced_body import Formulation, Kinematics, LoadPlacement, Stiffness
from .stepping import State, StepLimits, Work
from .variables import (
    DAMPING_SCALE,
    FIXED,
    FRAME_ROTATION,
    INITIALIZATION,
    ITERATIONS,
    KINEMATICS,
    KINETIC_ENERGY,
    LOADS,
    STATUS_CODE,
    STEP_LIMIT,
    STEP_TOLERANCE,
    STIFFNESS,
    STRAIN_ENERGY,
    SUBSTEPS,
    Group,
    Initialization,
    variable_table,
)

FloatArray = NDArray[np.float64]

MODAL_FILE = "modal.h5"
# FMI status numbers.
_WARNING, _DISCARD, _ERROR = 1, 2, 3
_CATEGORY = {_WARNING: "logStatusWarning", _DISCARD: "logStatusDiscard", _ERROR: "logStatusError"}
_NUMBERS = (DAMPING_SCALE, STEP_LIMIT, STEP_TOLERANCE)
_CHOICES: dict[str, type[Kinematics] | type[LoadPlacement] | type[Stiffness] | type[Initialization]] = {
    KINEMATICS: Kinematics,
    LOADS: LoadPlacement,
    STIFFNESS: Stiffness,
    INITIALIZATION: Initialization,
}


class LogMessage:
    """A line for the master's logger, in the form that pythonfmu's library reads."""

    def __init__(self, status: int, text: str):
        self.status = status
        self.category = _CATEGORY[status]
        # The library hands the text on as a printf format.
        self.msg = text.replace("%", "%%")


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
    """

    def __init__(self, **kwargs: Any):
        self.instance_name = str(kwargs["instance_name"])
        self._log: list[LogMessage] = []
        self._model = read_modal_file(Path(str(kwargs["resources"])) / MODAL_FILE)
        self._variables = variable_table(self._model)
        groups = [variable.group for variable in self._variables]
        self._motion = groups.index(Group.MOTION)
        self._rate = self._motion + groups.count(Group.MOTION)
        self._stress = self._rate + groups.count(Group.RATE)
        self._status_reference = groups.index(Group.STATUS)
        self._inputs = np.zeros(groups.count(Group.INPUT))
        self._parameters = {v.name: v.start for v in self._variables if v.group is Group.PARAMETER}
        self._switches = [v.name for v in self._variables if v.type == "Boolean"]
        self._status = 0
        self._body: FlexibleBody | None = None
        self._state: State | None = None
        self._work = Work(0, 0, 0.0)
        self._running = False
        self._outputs: dict[Group, list[float]] = {}

    # Life cycle.

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Nothing to do: state follows from the state before and the inputs alone, not from time."""

    def enter_initialization_mode(self) -> None:
        """Nothing to do: initial values are found when first asked for."""

    def exit_initialization_mode(self) -> None:
        """Fix the parameters and the initial state."""
        self._start()
        self._running = True

    def terminate(self) -> None:
        """Nothing to do: no files or processes are held."""

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by a step; False (discard) leaves the state as it was and says why in the log."""
        try:
            if not (np.isfinite(current_time) and np.isfinite(step_size) and step_size >= 0.0):
                return self._refuse(f"a step of {step_size} s from {current_time} s: expected a finite step ≥ 0")
            wrong = np.flatnonzero(~np.isfinite(self._inputs))
            if wrong.size:
                name = self._variables[int(wrong[0])].name
                return self._refuse(f"input {name} is {self._inputs[wrong[0]]}: expected a finite value")
            body, state = self._start()
            if step_size > 0.0:
                with np.errstate(all="ignore"):
                    self._state, self._work = body.step_packed(state, self._inputs, float(step_size))
                self._outputs.clear()
        except RuntimeBodyError as error:
            return self._refuse(str(error))
        except Exception as error:  # an exception that got out would be fatal to the master's whole process
            return self._refuse(f"unexpected {type(error).__name__}: {error}")
        return True

    # Values.

    def get_real(self, vrs: list[int]) -> list[float]:
        """Values of real variables."""
        return [self._real(vr) for vr in vrs]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set inputs, and parameters before initialisation ends."""
        for vr, value in zip(vrs, values, strict=True):
            if vr < self._inputs.size:
                self._inputs[vr] = value
            else:
                self._set_parameter(vr, "Real", value)
        self._changed()

    def get_integer(self, vrs: list[int]) -> list[int]:
        """Values of integer variables."""
        integers = {
            STATUS_CODE: self._status,
            ITERATIONS: self._work.iterations,
            SUBSTEPS: self._work.substeps,
        }
        return [integers[self._named(vr, "Integer")] for vr in vrs]

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """No integer can be set."""
        for vr, value in zip(vrs, values, strict=True):
            self._set_parameter(vr, "Integer", value)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Values of Boolean parameters."""
        return [bool(self._parameters[self._named(vr, "Boolean")]) for vr in vrs]

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Set Boolean parameters before initialisation ends."""
        for vr, value in zip(vrs, values, strict=True):
            self._set_parameter(vr, "Boolean", value)
        self._changed()

    def get_string(self, vrs: list[int]) -> list[str]:
        """Values of string parameters."""
        return [str(self._parameters[self._named(vr, "String")]) for vr in vrs]

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """Set string parameters before initialisation ends."""
        for vr, value in zip(vrs, values, strict=True):
            self._set_parameter(vr, "String", value)
        self._changed()

    # State.

    def _get_fmu_state(self) -> bytes:
        """Everything that the future depends on, as one block of bytes."""
        body = self._model
        state = self._state or State(np.zeros(body.mode_count), np.zeros(body.mode_count))
        # With interfaces fixed the body has fewer modes; the block keeps its length.
        rest = np.zeros(body.mode_count - state.q.size)
        numbers = self._numbers()
        choices = [list(kind).index(kind(self._parameters[name])) for name, kind in _CHOICES.items()]
        fixed = [float(bool(self._parameters[name])) for name in self._switches]
        flags = [self._state is not None, self._running, self._status, state.substeps]
        work = [self._work.substeps, self._work.iterations, self._work.error]
        return np.concatenate(
            [self._inputs, state.q, rest, state.v, rest, numbers, choices, fixed, flags, work]
        ).tobytes()

    def _set_fmu_state(self, block: bytes) -> None:
        """Go back to a state taken from this or another instance of the same FMU."""
        m, inputs = self._model.mode_count, self._inputs.size
        values = np.frombuffer(block, dtype=np.float64)
        sizes = [inputs, m, m, len(_NUMBERS), len(_CHOICES), len(self._switches), 4, 3]
        if values.size != sum(sizes):
            raise self._failure(f"FMU state has {values.size} numbers, expected {sum(sizes)}: of another FMU?")
        ends = np.cumsum(sizes)[:-1]
        set_inputs, q, v, numbers, choices, switches, flags, work = np.split(values, ends)
        self._inputs = set_inputs.copy()
        before = dict(self._parameters)
        self._parameters |= dict(zip(_NUMBERS, (float(x) for x in numbers), strict=True))
        for index, (name, kind) in zip(choices, _CHOICES.items(), strict=True):
            self._parameters[name] = list(kind)[int(index)].value
        self._parameters |= dict(zip(self._switches, (bool(x) for x in switches), strict=True))
        if self._parameters != before:
            self._body = None
        self._outputs.clear()
        self._state = None
        if flags[0]:
            m -= 6 * int(np.sum(switches))
            self._state = State(q[:m].copy(), v[:m].copy(), int(flags[3]))
        self._running, self._status = bool(flags[1]), int(flags[2])
        self._work = Work(int(work[0]), int(work[1]), float(work[2]))

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
            try:
                formulation = Formulation(
                    Kinematics(self._parameters[KINEMATICS]),
                    LoadPlacement(self._parameters[LOADS]),
                    Stiffness(self._parameters[STIFFNESS]),
                )
                damping_scale, longest, tolerance = self._numbers()
                limits = StepLimits(longest, tolerance)
                fixed = [name.removesuffix(FIXED) for name in self._switches if self._parameters[name]]
                self._body = FlexibleBody(self._model, formulation, damping_scale, limits, fixed)
            except OptionError as error:
                raise self._failure(str(error)) from error
        if self._state is None:
            if self._parameters[INITIALIZATION] == Initialization.STATIC.value:
                try:
                    if not np.all(np.isfinite(self._inputs)):
                        raise OptionError("an input is not finite, so there is no equilibrium to start from")
                    self._state = self._body.static(self._loads())
                except RuntimeBodyError as error:
                    raise self._failure(f"static initialisation: {error}") from error
            else:
                self._state = self._body.rest()
        return self._body, self._state

    def _numbers(self) -> list[float]:
        """Values of the numeric parameters, in the order of `_NUMBERS`."""
        return [float(self._parameters[name] or 0.0) for name in _NUMBERS]

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
        if self._motion <= vr < self._rate:
            return self._group(Group.MOTION)[vr - self._motion]
        if self._rate <= vr < self._stress:
            return self._group(Group.RATE)[vr - self._rate]
        if self._stress <= vr < self._status_reference:
            return self._group(Group.STRESS)[vr - self._stress]
        name = self._named(vr, "Real")
        if name in self._parameters:
            return float(self._parameters[name] or 0.0)
        body, state = self._start()
        if name == FRAME_ROTATION:
            return float(np.max(body.rotation_within_frames(state), initial=0.0))
        strain, kinetic = body.energies(state)
        return {STRAIN_ENERGY: strain, KINETIC_ENERGY: kinetic}[name]

    def _group(self, group: Group) -> list[float]:
        """Outputs of a group, found once per step and only when asked for."""
        values = self._outputs.get(group)
        if values is None:
            body, state = self._start()
            if group is Group.STRESS:
                self._outputs[group] = body.von_mises(state).tolist()
            elif self._model.velocity_outputs:
                motion, rates = body.motion_and_rates(state)
                self._outputs |= {Group.MOTION: motion.tolist(), Group.RATE: rates.tolist()}
            else:
                self._outputs[Group.MOTION] = body.motion(state).tolist()
            values = self._outputs[group]
        return values

    def _named(self, vr: int, kind: str) -> str:
        if not (0 <= vr < len(self._variables) and self._variables[vr].type == kind):
            raise self._failure(f"value reference {vr} is no {kind} variable of this FMU")
        return self._variables[vr].name

    def _set_parameter(self, vr: int, kind: str, value: float | int | bool | str) -> None:
        name = self._named(vr, kind)
        if name not in self._parameters:
            raise self._failure(f"{name} cannot be set")
        if self._running:
            self._log.append(LogMessage(_WARNING, f"{name} is fixed once initialisation has ended; it keeps its value"))
            return
        if name in _CHOICES:
            offered = [choice.value for choice in _CHOICES[name]]
            if value not in offered:
                raise self._failure(f"{name} is {value!r}, expected one of {offered}")
        self._parameters[name] = value
        self._body = None

    def _refuse(self, text: str) -> bool:
        """Log, remember and discard a step."""
        self._status = 1
        self._log.append(LogMessage(_DISCARD, f"{self.instance_name}: {text}"))
        return False

    def _failure(self, text: str) -> RuntimeBodyError:
        """Error that makes pythonfmu's library answer the call with a failure."""
        self._status = 1
        self._log.append(LogMessage(_ERROR, f"{self.instance_name}: {text}"))
        # The library gives up its references to these when a call raises, and once more when the instance is freed:
        # without one to spare, every later call would use freed memory and end the master's process.
        for held in (self, type(self), self._log):
            pythonapi.Py_IncRef(py_object(held))
        return OptionError(text)
