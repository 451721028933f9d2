"""FMI 2.0 calls as a C program makes them: statuses are returned, nothing is checked, nothing is raised.

fmpy's classes raise at the first failure and keep masters from most mistakes; these calls allow every one of them.
"""

import shutil
import sys
import tempfile
import time
import zipfile
from ctypes import (
    CDLL,
    CFUNCTYPE,
    Structure,
    byref,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_size_t,
    c_uint,
    c_void_p,
    create_string_buffer,
)
from pathlib import Path
from xml.etree import ElementTree

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
LAST_SUCCESSFUL_TIME = 2

Logger = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)
Allocate = CFUNCTYPE(c_void_p, c_size_t, c_size_t)
Free = CFUNCTYPE(None, c_void_p)
StepFinished = CFUNCTYPE(None, c_void_p, c_int)


class Callbacks(Structure):
    _fields_ = (
        ("logger", Logger),
        ("allocateMemory", Allocate),
        ("freeMemory", Free),
        ("stepFinished", StepFinished),
        ("componentEnvironment", c_void_p),
    )


class Slowest:
    """The call that took most of the processor so far: its name and s."""

    def __init__(self):
        self.name, self.seconds = "", 0.0

    def timed(self, name, call, *arguments):
        begun = time.thread_time()
        answer = call(*arguments)
        taken = time.thread_time() - begun
        if taken > self.seconds:
            self.name, self.seconds = name, taken
        return answer


SLOWEST = Slowest()


class Fmu:
    """An unpacked FMU with its library loaded; lines that instances log are in `log`."""

    def __init__(self, path, library=None):
        self.folder = Path(tempfile.mkdtemp(prefix="fmu-"))
        with zipfile.ZipFile(path) as archive:
            archive.extractall(self.folder)
        root = ElementTree.parse(self.folder / "modelDescription.xml").getroot()
        self.guid = root.get("guid")
        self.variables = list(root.find("ModelVariables"))
        self.reference = {v.get("name"): int(v.get("valueReference")) for v in self.variables}
        identifier = root.find("CoSimulation").get("modelIdentifier")
        platform, ending = ("win64", "dll") if sys.platform == "win32" else ("linux64", "so")
        own = self.folder / "binaries" / platform / f"{identifier}.{ending}"
        if library:
            shutil.copyfile(library, own)
        self.library = CDLL(str(own))
        self.library.fmi2Instantiate.restype = c_void_p
        self.log = []

        def write(_environment, _instance, status, category, text):
            # Lines of the library's own come without a category.
            self.log.append((status, (category or b"").decode(), (text or b"").decode(errors="replace")))

        self.callbacks = Callbacks(Logger(write), Allocate(), Free(), StepFinished(), None)

    def references(self, kind=None, causality=None):
        """Value references of the variables of a type and causality."""
        return [
            int(v.get("valueReference"))
            for v in self.variables
            if (kind is None or v.find(kind) is not None) and causality in (None, v.get("causality"))
        ]

    def instantiate(self, name="instance", logging=True, guid=None, resources=None):
        """A new instance, or None."""
        resources = resources or (self.folder / "resources").as_uri()
        arguments = (name.encode(), 1, (guid or self.guid).encode(), resources.encode(), byref(self.callbacks), 0)
        component = self.library.fmi2Instantiate(*arguments, int(logging))
        return Instance(self, component) if component else None

    def remove(self):
        """Delete the unpacked files."""
        shutil.rmtree(self.folder, ignore_errors=True)


class Instance:
    """An instance; every method is one FMI call and returns its status, first where there is more."""

    def __init__(self, fmu, component):
        self.fmu = fmu
        self.component = c_void_p(component)
        # Where the last step ended.
        self.reached = 0.0

    def _call(self, name, *arguments):
        return SLOWEST.timed(name, getattr(self.fmu.library, f"fmi2{name}"), self.component, *arguments)

    def _set(self, kind, ctype, references, values):
        count = len(references)
        return self._call(f"Set{kind}", (c_uint * count)(*references), c_size_t(count), (ctype * count)(*values))

    def _get(self, kind, ctype, references):
        count = len(references)
        values = (ctype * count)()
        status = self._call(f"Get{kind}", (c_uint * count)(*references), c_size_t(count), values)
        return status, list(values)

    def setup(self, start=0.0, stop=None, tolerance=None):
        defined = int(tolerance is not None), c_double(tolerance or 0.0), c_double(start)
        return self._call("SetupExperiment", *defined, int(stop is not None), c_double(stop or 0.0))

    def enter(self):
        return self._call("EnterInitializationMode")

    def exit(self):
        return self._call("ExitInitializationMode")

    def start(self):
        """The three calls from instantiation to the first step."""
        return [self.setup(), self.enter(), self.exit()]

    def terminate(self):
        return self._call("Terminate")

    def reset(self):
        return self._call("Reset")

    def free(self):
        self._call("FreeInstance")

    def step(self, time, size):
        status = self._call("DoStep", c_double(time), c_double(size), 1)
        self.reached = time + size if status <= WARNING else self.reached
        return status

    def go_on(self, size):
        """A step from where the last one ended."""
        return self.step(self.reached, size)

    def logging(self, on, categories=()):
        names = (c_char_p * len(categories))(*(name.encode() for name in categories))
        return self._call("SetDebugLogging", int(on), c_size_t(len(categories)), names)

    def set_real(self, references, values):
        return self._set("Real", c_double, references, values)

    def set_integer(self, references, values):
        return self._set("Integer", c_int, references, values)

    def set_boolean(self, references, values):
        return self._set("Boolean", c_int, references, values)

    def set_string(self, references, values):
        encoded = [value.encode() if isinstance(value, str) else value for value in values]
        return self._set("String", c_char_p, references, encoded)

    def get_real(self, references):
        return self._get("Real", c_double, references)

    def get_integer(self, references):
        return self._get("Integer", c_int, references)

    def get_boolean(self, references):
        return self._get("Boolean", c_int, references)

    def get_string(self, references):
        status, values = self._get("String", c_char_p, references)
        return status, [value.decode() if value is not None else None for value in values]

    def get_state(self, state=None):
        state = c_void_p() if state is None else state
        return self._call("GetFMUstate", byref(state)), state

    def set_state(self, state):
        return self._call("SetFMUstate", state)

    def free_state(self, state):
        return self._call("FreeFMUstate", byref(state))

    def serialize(self, state):
        size = c_size_t()
        status = self._call("SerializedFMUstateSize", state, byref(size))
        block = create_string_buffer(size.value)
        return max(status, self._call("SerializeFMUstate", state, block, size)), block.raw

    def deserialize(self, block):
        state = c_void_p()
        data = (c_char * len(block)).from_buffer_copy(block) if block else None
        return self._call("DeSerializeFMUstate", data, c_size_t(len(block)), byref(state)), state

    def bytes(self):
        """The state as bytes, by the three calls that it takes."""
        status, state = self.get_state()
        assert status == OK, status
        status, block = self.serialize(state)
        assert status == OK, status
        assert self.free_state(state) == OK
        return block

    def set_bytes(self, block):
        """Take over a state from bytes; the status of the call that failed, if one did."""
        status, state = self.deserialize(block)
        if status > WARNING:
            return status
        status = self.set_state(state)
        assert self.free_state(state) == OK
        return status

    def last_successful_time(self):
        value = c_double()
        return self._call("GetRealStatus", LAST_SUCCESSFUL_TIME, byref(value)), value.value

    def answers(self):
        """The status of the last step, whether the run is at its end, and what is pending."""
        status, over, pending = c_int(-1), c_int(-1), c_char_p()
        self._call("GetStatus", 0, byref(status))
        self._call("GetBooleanStatus", 3, byref(over))
        self._call("GetStringStatus", 1, byref(pending))
        return [status.value, over.value, (pending.value or b"").decode()]

    def unsupported(self):
        """Statuses of the calls that pythonfmu's library offers but does not support."""
        one, real, whole, text = (c_uint * 1)(0), (c_double * 1)(), (c_int * 1)(1), (c_char_p * 1)()
        count = c_size_t(1)
        return {
            "GetDirectionalDerivative": self._call("GetDirectionalDerivative", one, count, one, count, real, real),
            "SetRealInputDerivatives": self._call("SetRealInputDerivatives", one, count, whole, real),
            "GetRealOutputDerivatives": self._call("GetRealOutputDerivatives", one, count, whole, real),
            "CancelStep": self._call("CancelStep"),
            "GetStatus": self._call("GetStatus", 0, whole),
            "GetIntegerStatus": self._call("GetIntegerStatus", 0, whole),
            "GetBooleanStatus": self._call("GetBooleanStatus", 3, whole),
            "GetStringStatus": self._call("GetStringStatus", 1, text),
        }
