"""What a step costs through the FMU, against an empty FMU of the same variables driven in turns with it.

A body is packaged once for all methods of one mass whose data it holds, and for those that know constant mass alone:
they are chosen by the FMU's parameter `method`. The FMUs live in one process beside this one (`fmu_worker`).
"""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
from pythonfmu.builder import FmuBuilder

from ..body.flexible_body import StepLimits
from ..body.loads import load_names
from ..files.basics import SimulationError
from ..files.workers import Worker, WorkerError
from ..fmu.package import package_fmu
from ..model.methods import Mass, Variant, masses_of
from ..model.reduced_body import ReducedBody
from ..program.variable_table import METHOD, STEP_LIMIT, STEP_TOLERANCE
from .fmu_worker import answering, load, timed
from .scene.scene import Scene

_EMPTY = '''"""An FMU that has the variables and does nothing."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class EmptySlave(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.inputs, self.outputs = [0.0] * {inputs}, [0.0] * {outputs}
        idle = {{"getter": lambda: 0.0, "setter": lambda value: None}}
        for name in {input_names!r}:
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0, **idle))
        for name in {output_names!r}:
            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=idle["getter"]))

    def get_real(self, vrs):
        return self.outputs[: len(vrs)]

    def set_real(self, vrs, values):
        self.inputs[: len(vrs)] = values

    def do_step(self, current_time, step_size):
        return True
'''


class FmuTimer:
    """Times FMUs of bodies against an empty one, in a process that ends when it is closed.

    Parameters
    ----------
    folder : Path
        For the FMUs while they are needed.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self._empty: dict[tuple[str, ...], str] = {}
        # By identity, with the body, which so keeps it.
        self._loaded: dict[tuple[int, Mass], tuple[ReducedBody, str, str]] = {}
        self._count = 0
        self._process: Worker | None = None

    def times(
        self, body: ReducedBody, scene: Scene, step: float, variant: Variant, limits: StepLimits
    ) -> dict[str, float]:
        """Time steps of a body's FMU and of the empty one, in turns.

        Parameters
        ----------
        body : ReducedBody
            With the data of all variants that it will be timed with; packaged once for each mass.
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
        parameters = {METHOD: variant.method.value, STEP_LIMIT: limits.longest, STEP_TOLERANCE: limits.tolerance}
        names = load_names(scene.names, True)
        rows = [{n: float(v) for n, v in zip(names, one.packed(True), strict=True) if v} for one in scene.timing_loads]
        found = self._ask(timed, *self._ready(body, variant), parameters, rows, step)
        fmu, empty = found["fmu"], found["empty"]
        return {"fmu_us": 1e6 * fmu, "empty_us": 1e6 * empty, "fmu_ratio": fmu / empty, "fmu_busy": found["busy"]}

    def _ready(self, body: ReducedBody, variant: Variant) -> tuple[str, str]:
        """Names of a body's FMU and of its empty companion in the process that runs them."""
        # Methods that know no polynomial have constant mass in the FMU of one.
        if (variant.mass, body.mass) == (Mass.CONSTANT, Mass.POLYNOMIAL) and body.mass not in masses_of(variant.method):
            variant = Variant(body.method, body.mass)
        key = id(body), variant.mass
        if key not in self._loaded:
            self._count += 1
            name = f"body{self._count}"
            path = self._folder / f"{name}.fmu"
            package_fmu(replace(body, method=variant.method, mass=variant.mass), path, kept=False)
            variables = fmpy.read_model_description(str(path)).modelVariables
            inputs = [v.name for v in variables if v.causality == "input"]
            outputs = [v.name for v in variables if v.causality == "output" and v.type == "Real"]
            self._ask(load, name, str(path), False)
            path.unlink()
            self._loaded[key] = body, name, self._empty_fmu(inputs, outputs)
        return self._loaded[key][1:]

    def _empty_fmu(self, inputs: list[str], outputs: list[str]) -> str:
        names = (*inputs, "", *outputs)
        if names not in self._empty:
            name = f"empty{len(self._empty)}"
            folder = self._folder / name
            folder.mkdir()
            script = folder / "emptyslave.py"
            text = _EMPTY.format(inputs=len(inputs), outputs=len(outputs), input_names=inputs, output_names=outputs)
            script.write_text(text, encoding="utf-8")
            self._ask(load, name, str(FmuBuilder.build_FMU(script, dest=folder)), True)
            self._empty[names] = name
        return self._empty[names]

    def _ask(self, work: Callable[..., Any], *arguments: object) -> Any:
        """Have the process do something."""
        self._process = self._process or Worker(f"{answering.__module__}:{answering.__name__}")
        try:
            # Calls take some s; one that never returns ends the measurement, not the session.
            done, found = self._process.ask((work, arguments), timeout=600.0)
        except WorkerError as error:
            self.close()
            raise SimulationError(f"the process that times the FMU ended ({error})") from error
        if not done:
            raise SimulationError(f"the FMU does not run: {found}")
        return found

    def close(self) -> None:
        """End the process, and forget what was loaded in it."""
        process, self._process = self._process, None
        self._loaded.clear()
        self._empty.clear()
        if process is not None:
            process.close()


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
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder, closing(FmuTimer(Path(folder))) as timer:
        yield timer
