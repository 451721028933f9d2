"""What FMI masters do with FMUs, each in a process of its own: `python fmu_masters.py NAME ARGUMENTS`.

Every public function gets JSON values and returns one. The parent judges by the line that is printed: at the
interpreter's exit pythonfmu's library may crash a process that has done its work. Without arguments it serves.
"""

import json
import os
import shutil
import signal
import sys
import tempfile
from contextlib import suppress
from ctypes import byref

import fmpy
from fmpy.fmi1 import FMICallException as CallError
from fmpy.fmi2 import (
    FMU2Slave,
    calloc,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    free,
)
from fmpy.logging import addLoggerProxy

MARK = "RESULT "
# What a process may take (s).
LONGEST = 120
LOGS = {}


class Instance:
    """An FMU's instance with variables by name and its log."""

    def __init__(self, fmu, name="instance", logging=True):
        self.folder = tempfile.mkdtemp()
        fmpy.extract(fmu, self.folder)
        description = fmpy.read_model_description(fmu)
        self.variables = {v.name: v for v in description.modelVariables}
        self.inputs = [v.name for v in description.modelVariables if v.causality == "input"]
        self.outputs = [v.name for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
        self.log = LOGS.setdefault(name, [])

        # fmpy's proxy knows one logger in a process: the name tells whose line it is.
        def logger(_environment, instance, status, category, text):
            # Fatal errors come without a category.
            LOGS[instance.decode()].append([status, (category or b"").decode(), (text or b"").decode()])

        self.callbacks = fmi2CallbackFunctions()
        self.callbacks.logger = fmi2CallbackLoggerTYPE(logger)
        self.callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        self.callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(self.callbacks))
        self.slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.slave.instantiate(callbacks=self.callbacks, loggingOn=logging)
        self.time = 0.0

    def set(self, values):
        for name, value in values.items():
            variable = self.variables[name]
            call = {"Real": self.slave.setReal, "Integer": self.slave.setInteger, "String": self.slave.setString}
            call[variable.type]([variable.valueReference], [value])

    def get(self, *names):
        values = []
        for name in names:
            variable = self.variables[name]
            call = {"Real": self.slave.getReal, "Integer": self.slave.getInteger, "String": self.slave.getString}
            (value,) = call[variable.type]([variable.valueReference])
            values.append(value.decode() if isinstance(value, bytes) else value)
        return values

    def motion(self):
        return self.get(*self.outputs)

    def start(self, **before):
        self.set(before)
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def step(self, size, count=1):
        for _ in range(count):
            self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
            self.time += size
        return self

    def refused(self, size):
        """FMI status of a step that is refused."""
        try:
            self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
        except CallError as error:
            return error.status
        return 0

    def close(self):
        with suppress(CallError):
            self.slave.terminate()
        self.slave.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def validate(fmu):
    """Problems that fmpy's validator finds."""
    from fmpy.validation import validate_fmu

    return validate_fmu(fmu)


def trajectory(fmu, loads, step, count, before=None):
    """Outputs after each of `count` steps under constant loads that are set before initialisation ends."""
    one = Instance(fmu).start(**(before or {}), **loads)
    rows = [one.motion()]
    rows += [one.step(step).motion() for _ in range(count)]
    more = one.get("status.code", "diagnostics.substeps", "diagnostics.iterations")
    energies = one.get("diagnostics.strain_energy", "diagnostics.kinetic_energy")
    rotation = one.get("diagnostics.rotation_within_frame")
    one.close()
    return {"names": one.outputs, "rows": rows, "integers": more, "energies": energies, "frame": rotation}


def side_by_side(jobs, step, count):
    """Several instances at once, stepped in turn: outputs at the end for each job [fmu, loads]."""
    running = [Instance(fmu, f"instance_{k}") for k, (fmu, _) in enumerate(jobs)]
    for one, (_, loads) in zip(running, jobs, strict=True):
        one.start(**loads)
    for _ in range(count):
        for one in running:
            one.step(step)
    ends = [one.motion() for one in running]
    for one in running:
        one.close()
    return ends


def wrong_start(fmu, settings):
    """What a master sees that sets values before initialisation ends and then goes on regardless."""
    one = Instance(fmu)
    failed = []
    for name, value in settings.items():
        try:
            one.set({name: value})
        except CallError as error:
            failed.append([name, error.status])
    try:
        one.start()
    except CallError as error:
        failed.append(["start", error.status])
    status = None
    with suppress(CallError):
        (status,) = one.get("status.code")
    one.close()
    return {"failed": failed, "log": one.log, "status": status, "freed": True}


def late_parameter(fmu, name, value):
    """A parameter set after initialisation has ended."""
    one = Instance(fmu).start()
    try:
        one.set({name: value})
        status = 0
    except CallError as error:
        status = error.status
    return {"status": status, "value": one.get(name)[0], "log": one.log}


def wrong_input(fmu, name, wrong, right, step):
    """A step refused for a wrong input, then the same step with a right one; beside it one never disturbed."""
    disturbed, calm = Instance(fmu, "100% sound"), Instance(fmu, "calm")
    for one in (disturbed, calm):
        one.start()
        one.set({name: right})
        one.step(step, 3)
    before = disturbed.motion()
    # JSON has no name for what is not finite.
    disturbed.set({name: float(wrong)})
    status = disturbed.refused(step)
    result = {
        "status": status,
        "unchanged": disturbed.motion() == before,
        "code": disturbed.get("status.code")[0],
        "log": list(disturbed.log),
    }
    for one in (disturbed, calm):
        one.set({name: right})
        one.step(step, 3)
    result |= {"recovered": disturbed.motion() == calm.motion(), "moves": disturbed.motion() != before}
    result |= {"codes": [*disturbed.get("status.code"), *calm.get("status.code")]}
    disturbed.set({name: 1e300})
    result |= {"beyond": disturbed.refused(step), "sound": all(abs(x) < 1e9 for x in disturbed.motion())}
    return result


def quiet(fmu, name):
    """Log lines of a warning and a refused step: instantiated without logging, then with logging switched off."""
    one, found = Instance(fmu, logging=False).start(), []
    for _ in range(2):
        with suppress(CallError):
            one.set({"damping.scale": 2.0})
        one.set({name: float("nan")})
        found.append([one.refused(1e-3), [line[:2] for line in one.log]])
        one.log.clear()
        one.slave.setDebugLogging(False, [])
    return found


def wrong_step(fmu, sizes):
    """Statuses of steps of wrong and of no length, and whether the body stayed as it was."""
    one = Instance(fmu).start()
    one.set({one.inputs[0]: 10.0})
    one.step(1e-3)
    before = one.motion()
    statuses = [one.refused(float(size)) for size in sizes]
    return {"statuses": statuses, "unchanged": one.motion() == before}


def replay(fmu, loads, step, count):
    """Ends of the same steps: straight on, replayed from a state, from bytes, and in another instance from bytes."""
    settings = {"damping.scale": 3.0, "internal_step.tolerance": 1e-6, "method": "half_rotation"}
    one, other = Instance(fmu, "one").start(**settings, **loads), Instance(fmu, "other").start()
    one.step(step, 5)
    state = one.slave.getFMUstate()
    data = one.slave.serializeFMUstate(state)
    here = one.motion()

    def end(instance):
        instance.time = 5 * step
        # Where the search for internal steps begins is part of the state, too: the first step's work shows it.
        first = instance.step(step).get("diagnostics.substeps", "diagnostics.iterations")
        instance.step(step, count - 1)
        parameters = instance.get("damping.scale", "internal_step.tolerance", "method")
        work = instance.get("diagnostics.substeps", "diagnostics.iterations")
        return [*instance.motion(), *parameters, *work, *first]

    ends = [end(one)]
    one.set(dict.fromkeys(loads, -3.0))
    one.step(step, 7)
    one.slave.setFMUstate(state)
    at_state = one.motion()
    ends.append(end(one))
    one.slave.freeFMUstate(state)
    from_bytes = one.slave.deSerializeFMUstate(data)
    one.slave.setFMUstate(from_bytes)
    ends.append(end(one))
    there = other.slave.deSerializeFMUstate(data)
    other.slave.setFMUstate(there)
    ends.append(end(other))
    again = one.slave.serializeFMUstate(from_bytes)
    return {"ends": ends, "back": at_state == here, "same_bytes": again == data, "here": here}


def status_in_state(fmu):
    """Status code after a refusal, after going back to before it, and after going on to it again."""
    one = Instance(fmu).start()
    before = one.slave.getFMUstate()
    one.set({one.inputs[0]: float("nan")})
    one.refused(1e-3)
    after = one.slave.getFMUstate()
    codes = one.get("status.code")
    one.slave.setFMUstate(before)
    codes += one.get("status.code")
    one.slave.setFMUstate(after)
    return codes + one.get("status.code")


def foreign_state(fmu, other):
    """An instance that is given the state of another FMU."""
    one, stranger = Instance(fmu, "one").start(), Instance(other, "stranger").start()
    one.set({one.inputs[1]: 10.0})
    one.step(1e-3)
    before = one.motion()
    data = stranger.slave.serializeFMUstate(stranger.slave.getFMUstate())
    try:
        one.slave.setFMUstate(one.slave.deSerializeFMUstate(data))
        status = 0
    except CallError as error:
        status = error.status
    return {"status": status, "log": one.log, "unchanged": one.motion() == before}


def resets(fmu, loads, step):
    """Outputs at the end of a run and of the same run after a reset, and right after the reset."""
    one = Instance(fmu).start(**loads)
    first = one.step(step, 5).motion()
    one.slave.reset()
    one.time = 0.0
    one.start()
    bare = one.motion()
    one.set(loads)
    return {"first": first, "bare": bare, "second": one.step(step, 5).motion()}


def answer(name, arguments):
    """Print what a function returns."""
    print(MARK + json.dumps(globals()[name](*arguments)), flush=True)


def serve():
    """Fork a process for each line that comes in, which need not import anything; its exit code goes out."""
    for line in sys.stdin:
        name, arguments, folder, environment, *files = json.loads(line)
        child = os.fork()
        if not child:
            for number, file in enumerate(files, start=1):
                os.dup2(os.open(file, os.O_WRONLY | os.O_APPEND), number)
            os.chdir(folder)
            os.environ.clear()
            os.environ.update(environment)
            signal.alarm(LONGEST)
            answer(name, arguments)
            return
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    if sys.argv[1:]:
        answer(sys.argv[1], json.loads(sys.argv[2]))
    else:
        serve()
