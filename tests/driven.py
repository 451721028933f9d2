"""An FMU's instance in the tests' own process, with variables by name: of both exports.

The native export is driven by its C functions. Of the Python export the slave is driven, without pythonfmu's library,
which would start an interpreter within this one.
"""

import zipfile
from contextlib import suppress
from ctypes import c_double, c_int, c_size_t, c_uint

import numpy as np
import pytest

from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.python_slave import BodySlave, SlaveError
from flexfmu.program.variable_table import variable_table
from native_master.bare_fmi2 import DISCARD, ERROR, OK, WARNING, Fmu

# Both exports: where every test takes both, the Python one is for the slow ones, since others drive its slave quickly.
RUNTIMES = [Runtime.NATIVE, pytest.param(Runtime.PYTHON, marks=pytest.mark.slow)]
# Mark, size, phase and checksum of a state, then mark, owner, checksum and length of its numbers, bytes.
STATE_HEAD = 64


class _Native:
    """The C functions."""

    def __init__(self, path):
        self.fmu = Fmu(path)
        self.one = self.fmu.instantiate()

    def log(self):
        return [(status, text.replace("%%", "%")) for status, _, text in self.fmu.log]

    def status(self, name, *arguments):
        return getattr(self.one, name)(*arguments)

    def close(self):
        self.one.free()
        self.fmu.remove()


class _Slave:
    """The slave in Python, in words of the C functions."""

    def __init__(self, path):
        with zipfile.ZipFile(path) as archive:
            archive.extractall(path.parent / path.stem)
        self.slave = BodySlave(instance_name="instance", resources=str(path.parent / path.stem / "resources"))

    def log(self):
        return [(line.status, line.msg.replace("%%", "%")) for line in self.slave._get_log_queue()]

    def status(self, name, *arguments):
        calls = {
            "setup": lambda start=0.0, stop=None: self.slave.setup_experiment(start, stop, None),
            "enter": self.slave.enter_initialization_mode,
            "exit": self.slave.exit_initialization_mode,
            "terminate": self.slave.terminate,
            "step": self.slave.do_step,
            "bytes": self.slave._get_fmu_state,
            "set_bytes": self.slave._set_fmu_state,
        }
        call = calls.get(name) or getattr(self.slave, name)
        if name == "bytes":
            return call()
        try:
            found = call(*arguments)
        except SlaveError:
            return (ERROR, None) if name.startswith("get_") else ERROR
        if name.startswith("get_"):
            return OK, found
        return DISCARD if found is False else OK

    def close(self):
        pass


class Driven:
    """An instance that has been started.

    Parameters
    ----------
    model : ReducedBody
    folder : Path
        Where its FMU is written.
    runtime : Runtime
    **start
        Values that are set before the initialisation.
    """

    def __init__(self, model, folder, runtime=Runtime.NATIVE, **start):
        self.model, self.runtime = model, runtime
        path = folder / f"{runtime.value}_{len(list(folder.iterdir()))}.fmu"
        package_fmu(model, path, runtime)
        self.side = _Native(path) if runtime is Runtime.NATIVE else _Slave(path)
        self.table = {v.name: (number, v) for number, v in enumerate(variable_table(model))}
        self.set(**start)
        self.began = max(self.side.status(name) for name in ("setup", "enter", "exit"))
        # The last one that was reached, and that of each state taken.
        self.time, self.times = 0.0, {}

    def set(self, **values):
        for name, value in values.items():
            number, variable = self.table[name]
            assert self.side.status(f"set_{variable.type.lower()}", [number], [value]) <= WARNING, self.log

    def get(self, *names):
        found = []
        for name in names:
            number, variable = self.table[name]
            status, values = self.side.status(f"get_{variable.type.lower()}", [number])
            assert status <= WARNING, self.log
            found.append(values[0])
        return found

    def step(self, size=1e-3):
        """Status of a step."""
        status = self.side.status("step", self.time, size)
        self.time += size if status <= WARNING else 0.0
        return status

    def taken(self, size=1e-3):
        """Whether a step was taken."""
        return self.step(size) <= WARNING

    def motion(self, interface):
        """Displacement and rotation of an interface."""
        return self.get(
            *(f"{interface}.{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz")
        )

    @property
    def state(self):
        """The state as bytes."""
        block = self.side.status("bytes")
        self.times[block] = self.time
        return block

    @state.setter
    def state(self, block):
        assert self.side.status("set_bytes", block) == OK
        self.time = self.times.get(block, self.time)

    @property
    def log(self):
        """Status and text of each line so far."""
        return self.side.log()

    # What the native export alone offers.

    def rates(self, **values):
        """Status of setting derivatives of inputs."""
        numbers = [self.table[name][0] for name in values]
        count = len(numbers)
        references, orders = (c_uint * count)(*numbers), (c_int * count)(*[1] * count)
        given = (c_double * count)(*values.values())
        return self.side.one._call("SetRealInputDerivatives", references, c_size_t(count), orders, given)

    def derivative(self, outputs, inputs, direction):
        """Directional derivative of outputs by inputs; its status first."""
        unknown = (c_uint * len(outputs))(*(self.table[name][0] for name in outputs))
        known = (c_uint * len(inputs))(*(self.table[name][0] for name in inputs))
        along, result = (c_double * len(inputs))(*direction), (c_double * len(outputs))()
        sizes = c_size_t(len(outputs)), c_size_t(len(inputs))
        status = self.side.one._call("GetDirectionalDerivative", unknown, sizes[0], known, sizes[1], along, result)
        return status, np.array(result)

    def __del__(self):
        with suppress(AttributeError):
            self.side.close()
