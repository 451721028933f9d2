"""What a step costs through the FMU, against an empty FMU of the same variables driven in the same run.

Run as a module it drives one FMU in a process of its own and prints the time of its steps.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from pythonfmu.builder import FmuBuilder

from ..errors import SimulationError
from ..fmu.package import package_fmu
from ..runtime.reduced_body import ReducedBody
from .scene import AXES, Scene

_BLOCKS, _STEPS = 9, 300
# Blocks that take longer, s, are not repeated so often.
_LONG = 0.5
_MARK = "RESULT "
_EMPTY = '''"""An FMU that has the variables and does nothing."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


def zero():
    return 0.0


def ignore(value):
    pass


class EmptySlave(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.inputs, self.outputs = [0.0] * {inputs}, [0.0] * {outputs}
        for name in {input_names!r}:
            self.register_variable(
                Real(name, causality=Fmi2Causality.input, start=0.0, getter=zero, setter=ignore)
            )
        for name in {output_names!r}:
            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=zero))

    def get_real(self, vrs):
        return self.outputs[: len(vrs)]

    def set_real(self, vrs, values):
        self.inputs[: len(vrs)] = values

    def do_step(self, current_time, step_size):
        return True
'''


class FmuTimer:
    """Times FMUs of bodies against an empty one.

    Parameters
    ----------
    folder : Path
        For the FMUs while they are needed.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._empty: dict[tuple[str, ...], Path] = {}

    def times(self, body: ReducedBody, scene: Scene, step: float) -> dict[str, float]:
        """Time steps of a body's FMU and of the empty one, one right after the other.

        Parameters
        ----------
        body : ReducedBody
        scene : Scene
        step : float
            s.

        Returns
        -------
        dict of str to float
            fmu_us, empty_us, fmu_ratio.

        Raises
        ------
        SimulationError
            One of them does not run.
        """
        path = self._folder / f"{body.name}.fmu"
        package_fmu(body, path)
        variables = fmpy.read_model_description(str(path)).modelVariables
        inputs = [v.name for v in variables if v.causality == "input"]
        outputs = [v.name for v in variables if v.causality == "output" and v.type == "Real"]
        rows = _load_rows(scene)
        fmu = _in_process(path, step, rows)
        empty = _in_process(self._empty_fmu(inputs, outputs), step, rows)
        return {"fmu_us": 1e6 * fmu, "empty_us": 1e6 * empty, "fmu_ratio": fmu / empty}

    def _empty_fmu(self, inputs: list[str], outputs: list[str]) -> Path:
        names = (*inputs, "", *outputs)
        if names not in self._empty:
            folder = self._folder / f"empty{len(self._empty)}"
            folder.mkdir()
            script = folder / "emptyslave.py"
            text = _EMPTY.format(inputs=len(inputs), outputs=len(outputs), input_names=inputs, output_names=outputs)
            script.write_text(text, encoding="utf-8")
            self._empty[names] = Path(FmuBuilder.build_FMU(script, dest=folder))
        return self._empty[names]


def _load_rows(scene: Scene) -> list[dict[str, float]]:
    """Inputs by name of the scene's first transient, or of half its first static load."""
    every = scene.transient[0].start_loads if scene.transient else (scene.static[0].peak.scaled(0.5),)
    rows = []
    for loads in every[:_STEPS]:
        row: dict[str, float] = {}
        for kind in ("force", "moment"):
            for name, values in zip(scene.names, getattr(loads, kind), strict=True):
                row |= {f"{name}.{kind}.{axis}": float(v) for axis, v in zip(AXES, values, strict=True) if v}
        row |= {f"body.acceleration.{axis}": float(v) for axis, v in zip(AXES, loads.acceleration, strict=True) if v}
        rows.append(row)
    return rows


def _in_process(fmu: Path, step: float, rows: list[dict[str, float]]) -> float:
    """Fastest time (s) of a step in a fresh process."""
    command = [sys.executable, "-m", "flexfmu.scenes.fmu_cost"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    request = json.dumps({"fmu": str(fmu), "step": step, "rows": rows})
    done = subprocess.run(command, input=request, capture_output=True, text=True, env=environment, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(_MARK)]
    if not lines:
        raise SimulationError(f"{fmu.name} does not run: {(done.stderr or done.stdout).strip()[-500:]}")
    return float(json.loads(lines[-1].removeprefix(_MARK))["fastest"])


def drive(fmu: str, step: float, rows: list[dict[str, float]]) -> dict[str, float]:
    """Time blocks of steps of one FMU: set all inputs, step, get all outputs.

    Parameters
    ----------
    fmu : str
    step : float
        s.
    rows : list of dict
        Inputs by name, one row a step; a single one holds.

    Returns
    -------
    dict of str to float
        s a step: median and fastest.
    """
    description = fmpy.read_model_description(fmu)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(fmu),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="timed",
    )
    slave.instantiate()
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    references = [v.valueReference for v in inputs]
    outputs = [v.valueReference for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    # Every block is the same piece of the scene, from its start.
    piece = rows[:_STEPS] if len(rows) > 1 else rows * _STEPS
    values = [[row.get(v.name, 0.0) for v in inputs] for row in piece]
    times = []
    for block in range(_BLOCKS):
        if block:
            slave.reset()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        start = time.perf_counter()
        for number, row in enumerate(values):
            slave.setReal(references, row)
            slave.doStep(currentCommunicationPoint=number * step, communicationStepSize=step)
            slave.getReal(outputs)
        took = time.perf_counter() - start
        times.append(took / len(values))
        if took > _LONG and block:
            break
    return {"median": statistics.median(times), "fastest": min(times)}


if __name__ == "__main__":
    asked = json.load(sys.stdin)
    print(_MARK + json.dumps(drive(asked["fmu"], asked["step"], asked["rows"])), flush=True)
    # The library does not always survive the interpreter's end.
    os._exit(0)
