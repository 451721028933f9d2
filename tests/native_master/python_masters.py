"""The same run in several masters that are Python packages: `python python_masters.py MASTER ARGUMENTS`.

Without arguments it imports what the master needs and answers line by line: each run is in a copy of the process.

Each function steps an FMU under loads that are set before initialisation ends, and under others from the middle of the
run on, and returns the outputs after every step.
"""

import ast
import contextlib
import ctypes
import importlib
import inspect
import json
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

import fmpy

MARK = "RESULT "


def references(path):
    """Value references by name."""
    return {v.name: v.valueReference for v in fmpy.read_model_description(path).modelVariables}


def following(later, row):
    """Loads of a step: those given, and a spring's, N/m, by the load that it gives and the output that it follows."""
    spring = later.get("spring")
    return {spring[0]: -spring[1] * row[spring[2]]} if spring and row else {}


def numbers(later):
    return {name: value for name, value in later.items() if name != "spring"}


def run_fmpy(path, texts, loads, later, step, count, outputs):
    """fmpy's low-level interface, of FMI 2.0 or 3.0."""
    description, known = fmpy.read_model_description(path), references(path)
    three = description.fmiVersion.startswith("3")
    slave = (fmpy.fmi3.FMU3Slave if three else fmpy.fmi2.FMU2Slave)(
        guid=description.guid if not three else description.instantiationToken,
        unzipDirectory=fmpy.extract(path, tempfile.mkdtemp()),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="body",
    )
    slave.instantiate()
    if not three:
        slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    for name, text in texts.items():
        slave.setString([known[name]], [text])
    put, get = (slave.setFloat64, slave.getFloat64) if three else (slave.setReal, slave.getReal)
    given = {}

    def push(values):
        given.update(values)
        if not three:
            return put([known[name] for name in values], list(values.values()))
        arrays = dict.fromkeys(name.rpartition(".")[0] for name in values)
        return put([known[a] for a in arrays], [given.get(f"{a}.{axis}", 0.0) for a in arrays for axis in "xyz"])

    def read():
        if not three:
            return get([known[name] for name in outputs])
        arrays = list(dict.fromkeys(name.rpartition(".")[0] for name in outputs))
        return get([known[name] for name in arrays], 3 * len(arrays))

    push(loads)
    slave.exitInitializationMode()
    rows = []
    for k in range(count):
        if k == count // 2:
            push(numbers(later))
        if more := following(later, rows[-1:] and rows[-1]):
            push(more)
        slave.doStep(k * step, step)
        rows.append(read())
    return rows


def run_simulate_fmu(path, texts, loads, later, step, count, outputs):
    """fmpy as users call it: a table of inputs, whose rows at one time are a jump."""
    import numpy

    names = [*dict.fromkeys([*loads, *later])]
    first = [loads.get(name, 0.0) for name in names]
    last = [later.get(name, loads.get(name, 0.0)) for name in names]
    change = (count // 2) * step
    rows = [(0.0, *first), (change, *first), (change, *last), (count * step, *last)]
    table = numpy.array(rows, dtype=[(name, float) for name in ("time", *names)])
    asked = {"stop_time": count * step, "output_interval": step, "output": outputs}
    found = fmpy.simulate_fmu(path, input=table, start_values={**texts, **loads}, **asked)
    # Of a refused step fmpy keeps the state before it once more.
    assert len(found) == count + 1, f"simulate_fmu ended after {len(found) - 2} steps"
    return [[float(row[name]) for name in outputs] for row in found[1:]]


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
            own = numbers(later)
            assert manipulator.slave_real_values(body, [known[name] for name in own], list(own.values()))
        for name, value in following(later, rows[-1:] and rows[-1]).items():
            assert manipulator.slave_real_values(body, [known[name]], [value])
        assert execution.step()
        rows.append(observer.last_real_values(body, [known[name] for name in outputs]))
    return rows


def load_tbb():
    """oneTBB, which Ecos' library needs and the package of that name brings, too."""
    with contextlib.suppress(OSError):
        ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), ctypes.RTLD_GLOBAL)


def run_ecospy(path, texts, loads, later, step, count, outputs):
    """Ecos."""
    load_tbb()
    from ecospy import EcosSimulation, EcosSimulationStructure
    from ecospy.lib import EcosLib

    # Below it Ecos keeps what FMUs say to itself.
    EcosLib.set_log_level("debug")
    structure = EcosSimulationStructure()
    structure.add_model("body", path)
    structure.add_parameter_set("start", {f"body::{name}": value for name, value in {**texts, **loads}.items()})
    simulation = EcosSimulation(structure=structure, step_size=step)
    assert simulation.init(parameter_set="start")
    rows = []
    for k in range(count):
        if k == count // 2:
            for name, value in numbers(later).items():
                simulation.set_real(f"body::{name}", value)
        for name, value in following(later, rows[-1:] and rows[-1]).items():
            simulation.set_real(f"body::{name}", value)
        simulation.step()
        rows.append([simulation.get_real(f"body::{name}") for name in outputs])
    return rows


def run_pathsim_fmi(path, texts, loads, later, step, count, outputs):
    """PathSim: a block among others, with a source on every input."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Source
    from pathsim_fmi import CoSimulationFMU

    # PathSim takes the sources' values from a step's end; halfway between two points round-off of time is no matter.
    change = (count // 2 + 0.5) * step

    rows = []

    def held(name):
        def value(time):
            more = following(later, rows[-1:] and rows[-1])
            return more.get(name, later.get(name, loads.get(name, 0.0)) if time > change else loads.get(name, 0.0))

        return value

    body = CoSimulationFMU(path, start_values={**texts, **loads}, dt=step)
    names = list({**loads, **numbers(later), **following(later, [0.0] * len(outputs))})
    sources = [Source(held(name)) for name in names]
    wires = [Connection(source, body[name]) for source, name in zip(sources, names, strict=True)]
    simulation = Simulation([body, *sources], wires, dt=step, log=False)
    for _ in range(count):
        simulation.timestep(step)
        rows.append([float(body.outputs[name]) for name in outputs])
    return rows


def run_cofmupy(path, texts, loads, later, step, count, outputs):
    """CoFMUPy: a configuration file, with a literal series of values for every input."""
    from cofmupy import Coordinator

    # Values hold from their time on.
    change = (count // 2 - 0.5) * step
    series = {
        name: {"0": loads.get(name, 0.0), repr(change): later.get(name, loads.get(name, 0.0))}
        for name in {**loads, **later}
    }
    configuration = {
        "fmus": [{"id": "body", "path": path, "name": "body", "initialization": {**texts, **loads}}],
        "connections": [
            {
                "source": {"type": "literal", "id": f"of {name}", "variable": name, "values": values},
                "target": {"type": "fmu", "id": "body", "variable": name},
            }
            for name, values in series.items()
        ],
    }
    file = Path(tempfile.mkdtemp()) / "configuration.json"
    file.write_text(json.dumps(configuration), encoding="utf-8")
    coordinator = Coordinator()
    coordinator.start(conf_path=str(file))
    for _ in range(count):
        coordinator.do_step(step)
    found = coordinator.get_results()
    return [[found["body", name][k] for name in outputs] for k in range(count)]


def run_gemseo_fmu(path, texts, loads, later, step, count, outputs):
    """GEMSEO: a discipline that takes one step a call."""
    from gemseo_fmu.disciplines.fmu_discipline import FMUDiscipline
    from numpy import array

    body = FMUDiscipline(
        path,
        input_names=[*texts, *{**loads, **numbers(later), **following(later, [0.0] * len(outputs))}],
        output_names=outputs,
        time_step=step,
        final_time=count * step,
        do_step=True,
        restart=False,
    )
    rows, values = [], {**{name: array([value]) for name, value in loads.items()}, **texts}
    for k in range(count):
        if k == count // 2:
            values |= {name: array([value]) for name, value in numbers(later).items()}
        values |= {name: array([value]) for name, value in following(later, rows[-1:] and rows[-1]).items()}
        found = body.execute(values)
        rows.append([float(found[name][0]) for name in outputs])
    return rows


def run_fmusim(path, texts, loads, later, step, count, outputs):
    """fmusim of the Reference FMUs, a program in C: inputs as a table, whose rows at one time are a jump."""
    names = [*dict.fromkeys([*loads, *later])]
    change, first = (count // 2) * step, [loads.get(name, 0.0) for name in names]
    last = [later.get(name, loads.get(name, 0.0)) for name in names]
    rows = [(0.0, first), (change, first), (change, last), (count * step, last)]
    folder = Path(tempfile.mkdtemp())
    described = fmpy.read_model_description(path)
    arrays = described.fmiVersion.startswith("3")

    def column(name):
        """The name of a number, or of the array that it is in."""
        return name.rpartition(".")[0] if arrays else name

    columns = [*dict.fromkeys(map(column, names))]
    lines = [",".join(["time", *columns])]
    for time, values in rows:
        given = dict(zip(names, values, strict=True))
        cells = [
            " ".join(repr(given.get(f"{one}.{axis}", 0.0)) for axis in "xyz") if arrays else repr(given[one])
            for one in columns
        ]
        lines.append(",".join([repr(time), *cells]))
    (folder / "inputs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    asked = [*dict.fromkeys(map(column, outputs))]
    words = ["fmusim", "--interface-type", "cs", "--stop-time", repr(count * step), "--output-interval"]
    words += [repr(step), "--input-file", str(folder / "inputs.csv"), "--output-file", str(folder / "outputs.csv")]
    words += [word for name in asked for word in ("--output-variable", name)]
    words += [word for name, text in texts.items() for word in ("--start-value", name, text)]
    subprocess.run([*words, path], check=True)
    table = [line.split(",") for line in (folder / "outputs.csv").read_text(encoding="utf-8").splitlines()]
    places = [table[0].index(f'"{column(name)}"') for name in outputs]
    axes = ["xyz".index(name[-1]) if arrays else 0 for name in outputs]
    found = [[float(row[n].split()[k]) for n, k in zip(places, axes, strict=True)] for row in table[1:]]
    assert len(found) == count + 1, f"fmusim ended after {len(found) - 1} steps"
    return found[1:]


def answered(name, arguments):
    """Run, print and end."""
    print(MARK + json.dumps(globals()[f"run_{name}"](*arguments)), flush=True)
    # Not by the interpreter's exit: there pythonfmu's library may crash a process that has done its work.
    os._exit(0)


def import_for(name):
    """What the master's function imports."""
    if name == "ecospy":
        load_tbb()
    for node in ast.walk(ast.parse(inspect.getsource(globals()[f"run_{name}"]))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            for module in [node.module] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names]:
                # It is imported, or its error is told, by each run.
                with contextlib.suppress(Exception):
                    importlib.import_module(module)


def serve(name):
    """Run once for each line: arguments, files for what is said, s that it may take; answer how it ended."""
    import_for(name)
    for line in sys.stdin:
        arguments, said, deadline = json.loads(line)
        if not hasattr(os, "fork"):
            with Path(said[0]).open("w") as printed, Path(said[1]).open("w") as errors:
                command = [sys.executable, __file__, name, json.dumps(arguments)]
                done = subprocess.run(command, stdout=printed, stderr=errors, timeout=deadline, check=False)
            print(done.returncode, flush=True)
            continue
        child = os.fork()
        if child == 0:
            try:
                signal.alarm(deadline)
                for stream in (1, 2):
                    os.dup2(os.open(said[stream - 1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
                answered(name, arguments)
            except BaseException:
                traceback.print_exc()
                sys.stderr.flush()
            os._exit(1)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        answered(sys.argv[1], json.loads(sys.argv[2]))
    serve(sys.argv[1])
