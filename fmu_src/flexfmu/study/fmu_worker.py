"""What runs in the process of its own in which FMUs are timed: loads them, and drives one and an empty one in turns."""

import statistics
from collections.abc import Callable
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from .pace import Clock, calm_blocks, timed_piece

# What models that are tried warn of is no message to the user.
_SILENT = fmi2CallbackFunctions.from_buffer_copy(defaultCallbacks)
_SILENT.logger = fmi2CallbackLoggerTYPE(lambda *_: None)
_KNOWN: dict[str, "Driven"] = {}
"""FMUs that were loaded in this process, by name."""


class Driven:
    """An FMU that is set up again and again.

    Parameters
    ----------
    path : str
    folder : str
        Where it is unpacked; not there yet.
    """

    def __init__(self, path: str, folder: str):
        description = fmpy.read_model_description(path)
        name, unpacked = description.coSimulation.modelIdentifier, fmpy.extract(path, folder)
        place = {"guid": description.guid, "unzipDirectory": unpacked, "modelIdentifier": name}
        self.slave = FMU2Slave(**place, instanceName="timed")
        self.slave.instantiate(callbacks=_SILENT)
        variables = description.modelVariables
        self.references = {v.name: v.valueReference for v in variables}
        self.inputs = [v.name for v in variables if v.causality == "input"]
        self.input_references = [self.references[name] for name in self.inputs]
        self.outputs = [v.valueReference for v in variables if v.causality == "output" and v.type == "Real"]

    def begin(self, parameters: dict[str, float | str]) -> None:
        """Start anew under some parameters."""
        self.slave.reset()
        for name, value in parameters.items():
            put = self.slave.setString if isinstance(value, str) else self.slave.setReal
            put([self.references[name]], [value])
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def run(self, rows: list[list[float]], step: float) -> float:
        """Time (s) of setting all inputs, stepping and getting all outputs, once for each row."""
        slave, references, outputs = self.slave, self.input_references, self.outputs
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


def load(name: str, path: str, empty: bool) -> None:
    """Load an FMU under a name; an empty one is set up at once.

    Parameters
    ----------
    name, path : str
        It is unpacked beside its file.
    empty : bool
    """
    _KNOWN[name] = Driven(path, f"{path}_unpacked")
    if empty:
        _KNOWN[name].begin({})


def timed(
    name: str, against: str, parameters: dict[str, float | str], rows: list[dict[str, float]], step: float
) -> dict[str, float]:
    """Time steps of an FMU and of an empty one, in turns.

    Parameters
    ----------
    name, against : str
        Under which they were loaded.
    parameters : dict of str to float or str
    rows : list of dict
        Inputs by name, one row a step; a single one holds.
    step : float
        s.

    Returns
    -------
    dict of str to float
        s a step: fmu, empty: fastest; and busy.
    """
    driven, empty = _KNOWN[name], _KNOWN[against]
    first = [[rows[0].get(one, 0.0) for one in driven.inputs]]
    driven.begin(parameters)
    start = driven.slave.getFMUState()
    # What is prepared at the first steps is there afterwards.
    driven.run(first * 2, step)
    driven.slave.setFMUState(start)
    piece = timed_piece(rows, driven.run(first, step))
    values = [[row.get(one, 0.0) for one in driven.inputs] for row in piece]
    zeros = [[row.get(one, 0.0) for one in empty.inputs] for row in piece]

    def block() -> tuple[float, float]:
        driven.slave.setFMUState(start)
        return driven.run(values, step) / len(values), empty.run(zeros, step) / len(zeros)

    done = calm_blocks(block)
    driven.slave.freeFMUState(start)
    fastest = [min(times) for times in zip(*(pair for _, pair in done), strict=True)]
    return {"fmu": fastest[0], "empty": fastest[1], "busy": statistics.median(busy for busy, _ in done)}
