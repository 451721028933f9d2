"""The FMU's core at work in this process, with variables by name: what it says is what an FMU says."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core.library import library_path
from ..files.array_types import FloatArray
from ..fmu.python_slave import BodySlave, SlaveError, core_file
from ..model.reduced_body import ReducedBody
from ..program.programs import programs, with_guid
from ..program.variable_table import variable_table
from ..program.variables import STATUS_CODE


class BodyPrograms:
    """A body's programs in a folder, from which slaves start.

    Parameters
    ----------
    body : ReducedBody
    """

    def __init__(self, body: ReducedBody):
        self.body = body
        self._folder = tempfile.TemporaryDirectory(prefix="flexfmu-")
        folder = Path(self._folder.name)
        for name, image in with_guid(programs(body), "").items():
            (folder / name).write_bytes(image)
        core = core_file(folder)
        core.parent.mkdir()
        core.write_bytes(library_path().read_bytes())
        self.variables = {v.name: (number, v) for number, v in enumerate(variable_table(body))}

    def start(self, **parameters: float | str) -> BodySlave:
        """Instance with some parameters, before its initialisation ends."""
        slave = BodySlave(instance_name=self.body.name, resources=self._folder.name)
        for name, value in parameters.items():
            number, variable = self.variables[name]
            if variable.type == "String":
                slave.set_string([number], [str(value)])
            else:
                slave.set_real([number], [float(value)])
        return slave

    def __enter__(self) -> "BodyPrograms":
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()


class DrivenSlave:
    """An instance that takes steps until it refuses one.

    Parameters
    ----------
    programs : BodyPrograms
    parameters : mapping of str to float or str
    inputs : (L,) float
        Held throughout.
    """

    def __init__(self, programs: BodyPrograms, parameters: Mapping[str, float | str], inputs: FloatArray):
        self._variables = programs.variables
        self._count = 6 * programs.body.interface_count
        self.refused = False
        self._time = 0.0
        self._slave = programs.start(**parameters)
        self._slave.set_real(list(range(inputs.size)), inputs.tolist())
        try:
            self._slave.setup_experiment(0.0, None, None)
            self._slave.enter_initialization_mode()
            self._slave.exit_initialization_mode()
        except SlaveError:
            self.refused = True

    def step(self, size: float) -> bool:
        """Take a step (s); whether it was taken."""
        try:
            self.refused = self.refused or not self._slave.do_step(self._time, size)
        except SlaveError:
            self.refused = True
        self._time += size
        return not self.refused

    def motion(self) -> FloatArray:
        """Displacement and rotation vector of each interface, (I, 2, 3)."""
        first = next(number for number, v in self._variables.values() if v.name.endswith("displacement.x"))
        values = self._slave.get_real(list(range(first, first + self._count)))
        return np.array(values).reshape(-1, 2, 3)

    def real(self, name: str) -> float:
        """Value of a Real variable."""
        return self._slave.get_real([self._variables[name][0]])[0]

    @property
    def warned(self) -> bool:
        """Whether status.code tells of a limit that was passed."""
        return self._slave.get_integer([self._variables[STATUS_CODE][0]])[0] != 0

    @property
    def words(self) -> str:
        """First line of the log."""
        log = self._slave._get_log_queue()
        return log[0].msg.replace("%%", "%") if log else ""
