"""What a step costs through the FMU, against an empty FMU of the same variables driven in turns with it.

A body is packaged once for all methods whose data it holds: they are chosen by the FMU's parameter `method`. The FMUs
live in one process beside this one (`fmu_worker`).
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import fmpy
from pythonfmu.builder import FmuBuilder

from ...body.flexible_body import StepLimits
from ...files.errors import SimulationError
from ...fmu.package import package_fmu
from ...model.methods import Variant
from ...model.reduced_body import ReducedBody
from ...program.variables import METHOD, STEP_LIMIT, STEP_TOLERANCE
from .cost import timing_loads
from .fmu_worker import MARK
from .scene import AXES, Scene

# What is told of a process that died, characters.
_TOLD = 500
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
    """Times FMUs of bodies against an empty one; a context, at whose end the process ends.

    Parameters
    ----------
    folder : Path
        For the FMUs while they are needed.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._said = folder / "stderr.txt"
        self._empty: dict[tuple[str, ...], str] = {}
        self._loaded: tuple[ReducedBody, str, str] | None = None
        self._count = 0
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "FmuTimer":
        """Nothing runs before it is needed."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self._end()

    def times(
        self, body: ReducedBody, scene: Scene, step: float, variant: Variant, limits: StepLimits
    ) -> dict[str, float]:
        """Time steps of a body's FMU and of the empty one, in turns.

        Parameters
        ----------
        body : ReducedBody
            With the data of all variants that it will be timed with; packaged when it is another one than before.
        scene : Scene
        step : float
            s.
        variant : Variant
        limits : StepLimits

        Returns
        -------
        dict of str to float
            fmu_us, empty_us, fmu_ratio, fmu_busy.

        Raises
        ------
        SimulationError
            One of them does not run.
        """
        name, against = self._ready(body)
        parameters: dict[str, float | str] = {
            METHOD: variant.method.value,
            STEP_LIMIT: limits.longest,
            STEP_TOLERANCE: limits.tolerance,
        }
        request = {"name": name, "against": against, "parameters": parameters, "rows": _load_rows(scene), "step": step}
        found = self._ask(request)
        fmu, empty = found["fmu"], found["empty"]
        return {"fmu_us": 1e6 * fmu, "empty_us": 1e6 * empty, "fmu_ratio": fmu / empty, "fmu_busy": found["busy"]}

    def _ready(self, body: ReducedBody) -> tuple[str, str]:
        """Names of a body's FMU and of its empty companion in the process that runs them."""
        if self._loaded is not None and self._loaded[0] is body:
            return self._loaded[1:]
        self._count += 1
        name = f"body{self._count}"
        path = self._folder / f"{name}.fmu"
        package_fmu(body, path)
        variables = fmpy.read_model_description(str(path)).modelVariables
        inputs = [v.name for v in variables if v.causality == "input"]
        outputs = [v.name for v in variables if v.causality == "output" and v.type == "Real"]
        against = self._empty_fmu(inputs, outputs)
        self._load(name, path, empty=False)
        path.unlink()
        self._loaded = body, name, against
        return name, against

    def _empty_fmu(self, inputs: list[str], outputs: list[str]) -> str:
        names = (*inputs, "", *outputs)
        if names not in self._empty:
            name = f"empty{len(self._empty)}"
            folder = self._folder / name
            folder.mkdir()
            script = folder / "emptyslave.py"
            text = _EMPTY.format(inputs=len(inputs), outputs=len(outputs), input_names=inputs, output_names=outputs)
            script.write_text(text, encoding="utf-8")
            self._load(name, Path(FmuBuilder.build_FMU(script, dest=folder)), empty=True)
            self._empty[names] = name
        return self._empty[names]

    def _load(self, name: str, path: Path, empty: bool) -> None:
        self._ask({"load": str(path), "name": name, "folder": str(self._folder / f"{name}_unpacked"), "empty": empty})

    def _ask(self, request: dict[str, Any]) -> dict[str, float]:
        """Have the process answer a request."""
        if self._process is None:
            with self._said.open("w", encoding="utf-8") as said:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "flexfmu.study.scenes.fmu_worker"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=said,
                    text=True,
                    env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                    # Ctrl-C is for this process, which ends the other: one that died of it would be taken for a fault.
                    start_new_session=True,
                )
        into, out = self._process.stdin, self._process.stdout
        assert into is not None
        assert out is not None
        # A process that died is found out when it does not answer.
        with suppress(BrokenPipeError):
            into.write(json.dumps(request) + "\n")
            into.flush()
        for line in out:
            if line.startswith(MARK):
                told: dict[str, Any] = json.loads(line.removeprefix(MARK))
                if "error" in told:
                    raise SimulationError(f"the FMU does not run: {told['error']}")
                return told
        self._end()
        told_last = self._said.read_text(encoding="utf-8", errors="replace").strip()[-_TOLD:]
        raise SimulationError(f"the process that times the FMU died: {told_last or 'it said nothing'}")

    def _end(self) -> None:
        """End the process, and forget what was loaded in it."""
        process, self._process = self._process, None
        self._loaded = None
        self._empty.clear()
        if process is None:
            return
        with suppress(BrokenPipeError):
            process.communicate()


@contextmanager
def fmu_timer(wanted: bool = True) -> Iterator[FmuTimer | None]:
    """Timer with a folder of its own; None where none is wanted.

    Parameters
    ----------
    wanted : bool

    Yields
    ------
    FmuTimer or None
    """
    if not wanted:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder, FmuTimer(Path(folder)) as timer:
        yield timer


def _load_rows(scene: Scene) -> list[dict[str, float]]:
    """Inputs by name of `timing_loads`."""
    rows = []
    for loads in timing_loads(scene):
        row: dict[str, float] = {}
        for kind in ("force", "moment"):
            for name, values in zip(scene.names, getattr(loads, kind), strict=True):
                row |= {f"{name}.{kind}.{axis}": float(v) for axis, v in zip(AXES, values, strict=True) if v}
        row |= {f"body.acceleration.{axis}": float(v) for axis, v in zip(AXES, loads.acceleration, strict=True) if v}
        rows.append(row)
    return rows
