"""A process of its own in which FMUs are timed: loads them, and drives one and an empty one in turns.

It reads one request a line, JSON, and answers each with one line that begins with `MARK`; what FMUs print in between is
nobody's. Run as a module by `fmu_cost.FmuTimer`.
"""

import json
import os
import statistics
import sys
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave

from .pace import Clock, calm_blocks, timed_piece

MARK = "RESULT "


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
        self.slave = FMU2Slave(
            guid=description.guid, unzipDirectory=unpacked, modelIdentifier=name, instanceName="timed"
        )
        self.slave.instantiate()
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


def timed(
    driven: Driven, empty: Driven, parameters: dict[str, float | str], rows: list[dict[str, float]], step: float
) -> dict[str, float]:
    """Time steps of an FMU and of an empty one, in turns.

    Parameters
    ----------
    driven, empty : Driven
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
    first = [[rows[0].get(name, 0.0) for name in driven.inputs]]
    driven.begin(parameters)
    start = driven.slave.getFMUState()
    # What is prepared at the first steps is there afterwards.
    driven.run(first * 2, step)
    driven.slave.setFMUState(start)
    piece = timed_piece(rows, driven.run(first, step))
    values = [[row.get(name, 0.0) for name in driven.inputs] for row in piece]
    zeros = [[row.get(name, 0.0) for name in empty.inputs] for row in piece]

    def block() -> tuple[float, float]:
        driven.slave.setFMUState(start)
        return driven.run(values, step) / len(values), empty.run(zeros, step) / len(zeros)

    done = calm_blocks(block)
    driven.slave.freeFMUState(start)
    fastest = [min(times) for times in zip(*(pair for _, pair in done), strict=True)]
    return {"fmu": fastest[0], "empty": fastest[1], "busy": statistics.median(busy for busy, _ in done)}


def answer(known: dict[str, Driven], request: dict[str, Any]) -> dict[str, float]:
    """Carry out a request: load an FMU, or time one."""
    if "load" in request:
        known[request["name"]] = Driven(request["load"], request["folder"])
        if request["empty"]:
            known[request["name"]].begin({})
        return {}
    driven, empty = known[request["name"]], known[request["against"]]
    return timed(driven, empty, request["parameters"], request["rows"], request["step"])


def main() -> None:
    """Answer until the requests end."""
    known: dict[str, Driven] = {}
    for line in sys.stdin:
        try:
            told: dict[str, Any] = answer(known, json.loads(line))
        except Exception as error:
            # Whatever a library raises is for the one who asked.
            told = {"error": f"{type(error).__name__}: {error}"}
        print(f"\n{MARK}{json.dumps(told)}", flush=True)
    # The library does not always survive the interpreter's end.
    os._exit(0)


if __name__ == "__main__":
    main()
