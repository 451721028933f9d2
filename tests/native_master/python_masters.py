"""The same run in several masters that are Python packages: `python python_masters.py MASTER ARGUMENTS`.

Each function steps an FMU under loads that are set before initialisation ends, and under others from the middle of the
run on, and returns the outputs after every step.
"""

import contextlib
import ctypes
import json
import os
import sys
import tempfile
from pathlib import Path

import fmpy

MARK = "RESULT "


def references(path):
    """Value references by name."""
    return {v.name: v.valueReference for v in fmpy.read_model_description(path).modelVariables}


def run_fmpy(path, texts, loads, later, step, count, outputs):
    """fmpy's low-level interface."""
    description, known = fmpy.read_model_description(path), references(path)
    folder = tempfile.mkdtemp()
    slave = fmpy.fmi2.FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(path, folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="body",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.setString([known[name] for name in texts], list(texts.values()))
    slave.setReal([known[name] for name in loads], list(loads.values()))
    slave.exitInitializationMode()
    rows = []
    for k in range(count):
        if k == count // 2:
            slave.setReal([known[name] for name in later], list(later.values()))
        slave.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
        rows.append(slave.getReal([known[name] for name in outputs]))
    return rows


def run_libcosimpy(path, texts, loads, later, step, count, outputs):
    """The Open Simulation Platform's libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    known = references(path)
    execution = CosimExecution.from_step_size(round(step * 1e9))
    body = execution.add_local_slave(CosimLocalSlave(path, "body"))
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(manipulator)
    assert execution.add_observer(observer)
    for name, value in texts.items():
        assert execution.string_initial_value(body, known[name], value)
    for name, value in loads.items():
        assert execution.real_initial_value(body, known[name], value)
    rows = []
    for k in range(count):
        if k == count // 2:
            assert manipulator.slave_real_values(body, [known[name] for name in later], list(later.values()))
        assert execution.step()
        rows.append(observer.last_real_values(body, [known[name] for name in outputs]))
    return rows


def run_ecospy(path, texts, loads, later, step, count, outputs):
    """Ecos; its library needs oneTBB, which the package of that name brings, too."""
    with contextlib.suppress(OSError):
        ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("body", path)
    structure.add_parameter_set("start", {f"body::{name}": value for name, value in {**texts, **loads}.items()})
    simulation = EcosSimulation(structure=structure, step_size=step)
    assert simulation.init(parameter_set="start")
    rows = []
    for k in range(count):
        if k == count // 2:
            for name, value in later.items():
                simulation.set_real(f"body::{name}", value)
        simulation.step()
        rows.append([simulation.get_real(f"body::{name}") for name in outputs])
    return rows


def main():
    name, arguments = sys.argv[1], json.loads(sys.argv[2])
    print(MARK + json.dumps(globals()[f"run_{name}"](*arguments)), flush=True)
    # Not by the interpreter's exit: there pythonfmu's library may crash a process that has done its work.
    os._exit(0)


if __name__ == "__main__":
    main()
