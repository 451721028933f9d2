"""What runs in the process of its own in which FMUs are timed: loads them, and drives one and an empty one in turns."""

import statistics
from collections.abc import Callable, Sequence
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from .pace import Clock, calm_blocks, timed_piece

# What models that are tried warn of is no message to the user.
_SILENT = fmi2CallbackFunctions.from_buffer_copy(defaultCallbacks)
_SILENT.logger = fmi2CallbackLoggerTYPE(lambda *_: None)
_EMPTY: dict[str, "Driven"] = {}
"""Empty FMUs that were loaded in this process, by name."""


class Driven:
    """An FMU that is driven from its start.

    Parameters
    ----------
    references : tuple of list of int
        Value references of inputs, and of outputs.
    parameters : dict of int to float
        By their value references.
    places : dict of str to str
        Its library and its resources, as fmpy has them.
    """

    def __init__(self, references: Sequence[list[int]], parameters: dict[int, float], places: dict[str, str]):
        self._inputs, self._outputs = references
        self.slave = FMU2Slave(**{"guid": "", "modelIdentifier": "", "instanceName": "timed"} | places)
        self.slave.instantiate(callbacks=_SILENT)
        self.slave.setReal(list(parameters), list(parameters.values()))
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def run(self, rows: list[list[float]], step: float) -> float:
        """Time (s) of setting all inputs, stepping and getting all outputs, once for each row."""
        slave, references, outputs = self.slave, self._inputs, self._outputs
        clock = Clock()
        for number, row in enumerate(rows):
            slave.setReal(references, row)
            slave.doStep(currentCommunicationPoint=number * step, communicationStepSize=step)
            slave.getReal(outputs)
        return clock.elapsed()


def answering(*_: int) -> Callable[..., tuple[bool, Any]]:
    """What answers in a `files.workers.Worker`: whether work was done, and what it gave, or why not; by no pipes."""

    def answer(request: tuple[Callable[..., Any], tuple[Any, ...]]) -> tuple[bool, Any]:
        try:
            return True, request[0](*request[1])
        except Exception as error:  # whatever a library raises
            return False, f"{type(error).__name__}: {error}"

    return answer


def load_empty(name: str, path: str) -> None:
    """Load an empty FMU under a name; it is unpacked beside its file."""
    description = fmpy.read_model_description(path, validate=False)
    variables, unpacked = description.modelVariables, fmpy.extract(path, f"{path}_unpacked")
    references = [[v.valueReference for v in variables if v.causality == kind] for kind in ("input", "output")]
    places = {"modelIdentifier": description.coSimulation.modelIdentifier, "unzipDirectory": unpacked}
    _EMPTY[name] = Driven(references, {}, places | {"guid": description.guid})


def timed(how: tuple[Any, ...], against: str, rows: list[list[float]], step: float) -> dict[str, float]:
    """Time steps of an FMU and of an empty one, in turns.

    Parameters
    ----------
    how : tuple
        Arguments of `Driven`.
    against : str
        The empty one, as of `load_empty`.
    rows : list of list of float
        Inputs, one row a step; a single one holds.
    step : float
        s.

    Returns
    -------
    dict of str to float
        fmu_us, empty_us: of a step, the fastest; fmu_ratio, fmu_busy.
    """
    driven, empty = Driven(*how), _EMPTY[against]
    first = rows[:1]
    start = driven.slave.getFMUState()
    # What is prepared at the first steps is there afterwards.
    driven.run(first * 2, step)
    driven.slave.setFMUState(start)
    piece = timed_piece(rows, driven.run(first, step))

    def block() -> tuple[float, float]:
        driven.slave.setFMUState(start)
        return driven.run(piece, step) / len(piece), empty.run(piece, step) / len(piece)

    done = calm_blocks(block)
    driven.slave.freeFMUState(start)
    driven.slave.freeInstance()
    fmu, idle = (1e6 * min(times) for times in zip(*(pair for _, pair in done), strict=True))
    busy = statistics.median(busy for busy, _ in done)
    return {"fmu_us": fmu, "empty_us": idle, "fmu_ratio": fmu / idle, "fmu_busy": busy}
