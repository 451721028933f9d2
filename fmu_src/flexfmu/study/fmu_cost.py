"""What a step costs through the FMU, against an empty FMU of the same variables driven in turns with it.

Of the FMU there is what it starts with: the core and one program. Both run in one process beside this one
(`fmu_worker`).
"""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pythonfmu.builder import FmuBuilder

from ..body.flexible_body import StepLimits
from ..body.loads import load_names
from ..core.interface import DESCRIPTION
from ..core.library import library_path
from ..files.basics import SimulationError
from ..files.workers import Worker, WorkerError
from ..model.methods import Variant
from ..model.reduced_body import ReducedBody
from ..program.compile import programs, with_guid
from ..program.variable_table import STEP_LIMIT, STEP_TOLERANCE, variable_table
from .fmu_worker import answering, load_empty, timed
from .scene.scene import Scene

# An FMU that has the variables and does nothing.
_EMPTY = """from pythonfmu import Fmi2Causality, Fmi2Slave, Real
class EmptySlave(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.inputs, self.outputs = [0.0] * {inputs}, [0.0] * {outputs}
        idle = {{"getter": lambda: 0.0, "setter": lambda value: None}}
        for n in {input_names!r}: self.register_variable(Real(n, causality=Fmi2Causality.input, start=0.0, **idle))
        for n in {output_names!r}: self.register_variable(Real(n, causality=Fmi2Causality.output, getter=lambda: 0.0))
    def get_real(self, vrs): return self.outputs[: len(vrs)]
    def set_real(self, vrs, values): self.inputs[: len(vrs)] = values
    def do_step(self, current_time, step_size): return True
"""


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
        self._process: Worker | None = None

    def times(
        self, body: ReducedBody, scene: Scene, step: float, variant: Variant, limits: StepLimits
    ) -> dict[str, float]:
        """Time steps of a body's FMU and of the empty one, in turns.

        Parameters
        ----------
        body : ReducedBody
            With the data of the variant.
        scene : Scene
        step : float
            s.
        variant : Variant
        limits : StepLimits

        Returns
        -------
        dict of str to float
            As of `timed`.

        Raises
        ------
        SimulationError
            One of them does not run.
        """
        body = replace(body, method=variant.method, mass=variant.mass)
        table = {v.name: (reference, v) for reference, v in enumerate(variable_table(body))}
        inputs = {name: reference for name, (reference, v) in table.items() if v.causality == "input"}
        outputs = [name for name, (_, v) in table.items() if v.causality == "output" and v.type == "Real"]
        resources = self._folder / "timed" / "resources"
        resources.mkdir(parents=True, exist_ok=True)
        (resources / DESCRIPTION).write_bytes(with_guid(programs(body, every=False), "")[DESCRIPTION])
        names = load_names(scene.names, True)
        loads = [dict(zip(names, one.packed(True).tolist(), strict=True)) for one in scene.timing_loads]
        rows = [[one.get(name, 0.0) for name in inputs] for one in loads]
        references = list(inputs.values()), [table[name][0] for name in outputs]
        parameters = {table[STEP_LIMIT][0]: limits.longest, table[STEP_TOLERANCE][0]: limits.tolerance}
        how = references, parameters, {"libraryPath": str(library_path()), "unzipDirectory": str(resources.parent)}
        return dict(self._ask(timed, how, self._empty_fmu([*inputs], outputs), rows, step))

    def _empty_fmu(self, inputs: list[str], outputs: list[str]) -> str:
        names = (*inputs, "", *outputs)
        if names not in self._empty:
            name = f"empty{len(self._empty)}"
            folder = self._folder / name
            folder.mkdir()
            script = folder / "emptyslave.py"
            text = _EMPTY.format(inputs=len(inputs), outputs=len(outputs), input_names=inputs, output_names=outputs)
            script.write_text(text, encoding="utf-8")
            self._ask(load_empty, name, str(FmuBuilder.build_FMU(script, dest=folder)))
            self._empty[names] = name
        return self._empty[names]

    def _ask(self, work: Callable[..., Any], *arguments: object) -> Any:
        """Have the process do something."""
        self._process = self._process or Worker(f"{answering.__module__}:{answering.__name__}", fork=True)
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
