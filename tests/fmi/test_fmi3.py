"""FMUs of FMI 3.0, run by fmpy as users run it: the numbers of FMI 2.0 to the last bit, and what is new.

Expectations are the standard's (FMI 3.0.2) and the FMI 2.0 FMU's of the same body.
"""

import math
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

import fuzzed
from driven import Driven
from flexfmu.files.basics import PackagingError, SimulationError
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.fmu.runtime import Runtime
from flexfmu.fmu.simulation import simulate
from flexfmu.master.layout import read_description

SCHEMAS = Path(fmpy.__file__).parent / "schema" / "fmi3"
STEP, STEPS = 1e-3, 12
OK, DISCARD, ERROR = 0, 2, 3
FUZZER = Path(__file__).parents[1] / "native_master" / "fuzz_fmi3.py"
# Random calls of each body: whole cases of sixty.
CALLS = 600


@pytest.fixture(scope="module", params=fuzzed.KINDS)
def kind(request):
    """Each of the five bodies."""
    return request.param


@pytest.fixture(scope="module")
def body(kind):
    return fuzzed.fuzzed_body(kind)


@pytest.fixture(scope="module")
def fmu(kind, body, tmp_path_factory):
    """An FMU of FMI 3.0."""
    path = tmp_path_factory.mktemp("fmi3") / f"{kind}.fmu"
    package_fmu(body, path, fmi=3)
    return path


class Slave:
    """An FMU of FMI 3.0 behind fmpy, by names; its log as status, category and text."""

    def __init__(self, path, folder, start=True, **options):
        self.description = fmpy.read_model_description(str(path))
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.log = []
        folder = Path(folder) / "an FMU at 100 %"
        if not folder.exists():
            shutil.unpack_archive(path, folder, "zip")
        token, model = self.description.instantiationToken, self.description.coSimulation.modelIdentifier
        self.fmu = FMU3Slave(guid=token, modelIdentifier=model, unzipDirectory=str(folder), instanceName="body")
        self.fmu.instantiate(
            loggingOn=True,
            logMessage=lambda _, status, kind, text: self.log.append((status, kind, text.decode())),
            **options,
        )
        if start:
            self.start()

    def start(self):
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def references(self, names):
        return [self.variables[name].valueReference for name in names]

    def size(self, name):
        return math.prod(int(dimension.start) for dimension in self.variables[name].dimensions)

    def names(self, causality):
        return [v.name for v in self.variables.values() if v.causality == causality and v.type == "Float64"]

    def get(self, *names):
        return self.fmu.getFloat64(self.references(names), sum(map(self.size, names)))

    def set(self, name, *values):
        self.fmu.setFloat64(self.references([name]), values)

    def push(self, number):
        """Loads of a step: all inputs, none alike."""
        names = self.names("input")
        count = sum(map(self.size, names))
        self.fmu.setFloat64(self.references(names), 0.2 * np.sin(1.0 + number + np.arange(count)))

    def run(self, first, last):
        """Outputs after each step."""
        found = []
        for number in range(first, last):
            self.push(number)
            self.fmu.doStep(number * STEP, STEP)
            found.append(self.get(*self.names("output"), *self.names("local")))
        return np.array(found)


@pytest.fixture
def slave(fmu, tmp_path):
    made = Slave(fmu, tmp_path)
    yield made
    made.fmu.freeInstance()


def test_the_files_are_valid_and_describe_arrays_and_terminals(fmu, body):
    assert validate_fmu(str(fmu)) == []
    with zipfile.ZipFile(fmu) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    files = {
        "modelDescription.xml": "fmi3ModelDescription",
        "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons",
        "sources/buildDescription.xml": "fmi3BuildDescription",
    }
    trees = {}
    for name, schema in files.items():
        trees[name] = etree.fromstring(contents[name])
        etree.XMLSchema(file=str(SCHEMAS / f"{schema}.xsd")).assertValid(trees[name])
    described, terminals, built = trees.values()
    variables = {one.get("name"): one for one in described.find("ModelVariables")}
    assert [name for name, one in variables.items() if one.get("causality") == "independent"] == ["time"]
    references = [one.get("valueReference") for one in variables.values()]
    assert len(set(references)) == len(references)
    for interface, terminal in zip(body.interface_names, terminals.find("Terminals"), strict=True):
        assert terminal.get("name") == interface
        members = {one.get("memberName"): one.get("variableName") for one in terminal}
        assert {"force", "moment", "displacement", "rotation", "velocity", "angular_velocity"} == members.keys()
        for member, name in members.items():
            assert name == f"{interface}.{member}"
            assert [one.get("start") for one in variables[name].findall("Dimension")] == ["3"]
    named = [one.get("name") for one in built.iter("SourceFile")]
    assert {f"sources/{name}" for name in named} == {name for name in contents if re.fullmatch(r"sources/\w+\.c", name)}
    # Folders of libraries are those of FMI 3.0.
    folders = {name.split("/")[1] for name in contents if name.startswith("binaries/")}
    assert all(re.fullmatch(r"(x86_64|aarch64)-(linux|windows|darwin)", name) for name in folders)


def test_it_gives_the_numbers_of_fmi_2_to_the_last_bit(body, slave, tmp_path):
    driven = Driven(body, tmp_path)
    table = {name: (number, one.causality) for name, (number, one) in driven.table.items() if one.type == "Real"}
    # One reference of FMI 3.0 for three of FMI 2.0, the first of which has its number.
    for name in slave.names("input") + slave.names("output"):
        assert slave.references([name]) == [table[name if slave.size(name) == 1 else f"{name}.x"][0]]
    found = slave.run(0, STEPS)
    assert np.all(np.isfinite(found))
    assert np.ptp(found, axis=0).max() > 1e-6
    inputs, *others = (
        [number for number, kind in table.values() if kind == causality] for causality in ("input", "output", "local")
    )
    for row in range(STEPS):
        assert driven.side.status("set_real", inputs, list(0.2 * np.sin(1.0 + row + np.arange(len(inputs))))) == 0
        assert driven.taken(STEP)
        np.testing.assert_array_equal(found[row], driven.side.status("get_real", others[0] + others[1])[1])
    assert slave.get("time") == [pytest.approx(STEPS * STEP)]


def test_plain_fmpy_runs_it_with_arrays(tmp_path):
    body = fuzzed.fuzzed_body("free")
    results = []
    for version in (2, 3):
        path = tmp_path / f"version_{version}.fmu"
        package_fmu(body, path, fmi=version)
        names = [v.name for v in fmpy.read_model_description(str(path)).modelVariables if v.causality == "input"]
        table = np.zeros(3, dtype=[("time", float), *((name, float, (3,) if version == 3 else ()) for name in names)])
        table["time"] = [0.0, 0.01, 0.02]
        for axis, load in enumerate((1.0, -2.0, 3.0)):
            column = table["tip.force"][:, axis] if version == 3 else table[f"tip.force.{'xyz'[axis]}"]
            column[:] = [0.0, load, load]
        settings = {"method": "linear", "damping.scale": 2.0}
        results.append(
            fmpy.simulate_fmu(str(path), stop_time=0.02, output_interval=1e-3, input=table, start_values=settings)
        )
    scalars, arrays = results
    assert len(arrays) == 21
    for name in arrays.dtype.names[1:]:
        expected = np.column_stack([scalars[f"{name}.{axis}"] for axis in "xyz"])
        assert np.any(expected)
        np.testing.assert_array_equal(arrays[name], expected)


def test_a_refused_step_ends_the_run_with_the_fmus_words(tmp_path, capfd):
    path = tmp_path / "body.fmu"
    package_fmu(fuzzed.fuzzed_body("plain"), path, fmi=3)
    with pytest.raises(FMICallException) as refused:
        fmpy.simulate_fmu(
            str(path), stop_time=1.0, output_interval=0.1, start_values={"port_1.force": [1e12, 0.0, 0.0]}
        )
    assert refused.value.status == DISCARD
    assert capfd.readouterr().out.count("[DISCARD] the step of 0.1 s") == 1


def test_after_a_refused_step_another_may_be_tried(slave):
    slave.run(0, 2)
    before = slave.get(*slave.names("output"))
    name = slave.names("input")[0]
    slave.set(name, 1e300, 0.0, 0.0)
    with pytest.raises(FMICallException) as refused:
        slave.fmu.doStep(2 * STEP, 0.1)
    assert refused.value.status == DISCARD
    assert slave.log[-1][:2] == (DISCARD, b"logStatusDiscard")
    assert slave.get(*slave.names("output"), "time") == [*before, pytest.approx(2 * STEP)]
    slave.set(name, 0.0, 0.0, 0.0)
    assert slave.fmu.doStep(2 * STEP, STEP) == (False, False, False, pytest.approx(3 * STEP))


def status_of(call):
    """Of a call behind fmpy, which raises from `fmi3Discard` on."""
    try:
        call()
    except FMICallException as error:
        return error.status
    return OK


@pytest.mark.parametrize("kind", ["plain"], indirect=True)
def test_the_order_of_calls_is_that_of_the_standard(fmu, tmp_path):
    one = Slave(fmu, tmp_path, start=False)

    def found(*calls):
        return [status_of(call) for call in calls]

    def begin():
        one.fmu.enterInitializationMode(startTime=1.0, stopTime=1.01)

    step, read = (lambda: one.fmu.doStep(1.0, 0.006)), (lambda: one.get("time"))
    # Only what the standard allows before, in and after initialisation.
    assert found(step, read, one.fmu.exitInitializationMode, one.fmu.terminate) == [ERROR] * 4
    assert found(begin, begin, read, step, one.fmu.terminate) == [OK, ERROR, OK, ERROR, ERROR]
    assert found(one.fmu.exitInitializationMode, one.fmu.exitInitializationMode, begin) == [OK, ERROR, ERROR]
    assert found(lambda: one.fmu.doStep(1.001, 0.006), step, step) == [ERROR, OK, ERROR]
    assert "expected one from 1.006 s" in one.log[-1][2]
    assert status_of(lambda: one.fmu.doStep(1.006, 0.006)) == ERROR
    assert "goes beyond the stop time of fmi3EnterInitializationMode" in one.log[-1][2]
    assert found(lambda: one.fmu.doStep(1.006, 0.004), one.fmu.terminate, step, read) == [OK, OK, ERROR, OK]
    assert found(one.fmu.terminate, one.fmu.reset, read, begin, read) == [ERROR, OK, ERROR, OK, OK]
    assert one.get("time") == [1.0]
    one.fmu.freeInstance()


@pytest.mark.slow
def test_a_refused_step_is_taken_as_far_as_it_goes_where_the_master_allows_early_return(fmu, tmp_path):
    one, strict, other = (Slave(fmu, tmp_path, earlyReturnAllowed=allowed) for allowed in (True, False, False))
    name = one.names("input")[0]
    load, state = 1.0, strict.fmu.getFMUState()

    def pushed():
        strict.fmu.setFMUState(state)
        strict.set(name, load, 0.0, 0.0)
        return status_of(lambda: strict.fmu.doStep(0.0, 0.1))

    while pushed() == OK:
        load *= 2.0
    for side in (one, other):
        side.set(name, load, 0.0, 0.0)
    assert pushed() == DISCARD
    *flags, reached = one.fmu.doStep(0.0, 0.1)
    assert flags == [False, False, True]
    assert 0.1 / reached in (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
    assert one.get("time") == [reached]
    assert DISCARD not in [status for status, *_ in one.log]
    # What is reached is what the shorter step gives.
    assert other.fmu.doStep(0.0, reached) == (False, False, False, reached)
    assert one.fmu.serializeFMUState(one.fmu.getFMUState()) == other.fmu.serializeFMUState(other.fmu.getFMUState())
    # A step that is not refused is whole, and one that no part of is taken is refused.
    one.set(name, 0.0, 0.0, 0.0)
    assert one.fmu.doStep(reached, 1e-6) == (False, False, False, reached + 1e-6)
    one.set(name, float("nan"), 0.0, 0.0)
    with pytest.raises(FMICallException) as refused:
        one.fmu.doStep(reached + 1e-6, 1e-6)
    assert refused.value.status == DISCARD


def test_plain_fmpy_goes_on_to_where_no_part_of_a_step_is_taken(tmp_path):
    path = tmp_path / "body.fmu"
    package_fmu(fuzzed.fuzzed_body("plain"), path, fmi=3)
    times = []

    def look(time, _):
        times.append(time)
        return True

    with pytest.raises(FMICallException) as refused:
        fmpy.simulate_fmu(
            str(path),
            stop_time=1.0,
            output_interval=0.1,
            start_values={"port_1.force": [1e5, 0.0, 0.0]},
            early_return_allowed=True,
            step_finished=look,
        )
    assert refused.value.status == DISCARD
    assert len(times) > 1
    assert np.all(np.diff(times) > 0.0)
    assert 0.0 < times[-1] < 0.1


def test_a_state_replays_to_the_last_bit_also_in_another_instance(slave, fmu, tmp_path):
    slave.run(0, 3)
    state = slave.fmu.getFMUState()
    block = slave.fmu.serializeFMUState(state)
    first = slave.run(3, STEPS)
    slave.fmu.setFMUState(state)
    np.testing.assert_array_equal(slave.run(3, STEPS), first)
    slave.fmu.freeFMUState(state)
    other = Slave(fmu, tmp_path, start=False)
    other.fmu.setFMUState(other.fmu.deserializeFMUState(block))
    np.testing.assert_array_equal(other.run(3, STEPS), first)
    with pytest.raises(FMICallException):
        other.fmu.deserializeFMUState(b"\1" + block[1:])
    assert "fmi3GetFMUState or fmi3DeserializeFMUState" in other.log[-1][2]
    other.fmu.freeInstance()


def test_derivatives_are_those_of_fmi_2_and_adjoint_ones_their_transpose(slave, body):
    inputs = [name for name in slave.names("input") if name != "body.acceleration"]
    motion = [f"{name}.{what}" for name in body.interface_names for what in ("displacement", "rotation")]
    known, unknown = slave.references(inputs), slave.references(motion)
    rows, columns = 3 * len(motion), 3 * len(inputs)
    slave.run(0, 3)
    jacobian = np.array([slave.fmu.getDirectionalDerivative(unknown, known, e, rows) for e in np.eye(columns)]).T
    assert np.linalg.matrix_rank(jacobian) > 2
    transpose = np.array([slave.fmu.getAdjointDerivative(unknown, known, e, columns) for e in np.eye(rows)])
    np.testing.assert_array_equal(transpose, jacobian)
    rng = np.random.default_rng(1)
    seed, weight = rng.standard_normal(columns), rng.standard_normal(rows)
    forward = slave.fmu.getDirectionalDerivative(unknown, known, seed, rows)
    backward = slave.fmu.getAdjointDerivative(unknown, known, weight, columns)
    assert weight @ forward == pytest.approx(seed @ backward, rel=1e-12)
    # Against differences of steps from the same state.
    state, loads = slave.fmu.getFMUState(), np.array(slave.get(*inputs))
    small = 1e-3

    def ends(change):
        slave.fmu.setFMUState(state)
        slave.fmu.setFloat64(known, loads + change)
        slave.fmu.doStep(3 * STEP, STEP)
        return np.array(slave.get(*motion))

    differences = (ends(small * seed) - ends(-small * seed)) / (2.0 * small)
    np.testing.assert_allclose(forward, differences, atol=0.02 * np.abs(differences).max())
    slave.fmu.freeFMUState(state)


def test_time_is_told_wherever_it_stands_among_others(fmu, tmp_path):
    slave = Slave(fmu, tmp_path)
    slave.run(0, 3)
    one, other = slave.names("output")[:2]
    (time,) = slave.get("time")
    assert time == pytest.approx(3 * STEP)
    first, second = slave.get(one), slave.get(other)
    assert slave.get("time", one, "time", "time", other) == [time, *first, time, time, *second]
    assert slave.get(other, "time", one) == [*second, time, *first]


WRONG_CALLS = {
    "too few values": (
        lambda s: s.fmu.setFloat64(s.references([s.names("input")[0]]), [1.0]),
        "expected the 3 of these",
    ),
    "too many values": (lambda s: s.fmu.getFloat64(s.references([s.names("input")[0]]), 4), "expected the 3 of these"),
    "within an array": (lambda s: s.fmu.getFloat64([1], 1), "fmi3GetFloat64: value reference 1 is within an array"),
    "no variable": (lambda s: s.fmu.getFloat64([99999], 1), "value reference 99999 is no Float64 variable"),
    "an output set": (
        lambda s: s.set(s.names("output")[0], 1.0, 1.0, 1.0),
        "fmi3SetFloat64: port_0.displacement.x cannot",
    ),
    "time set": (lambda s: s.set("time", 1.0), "is no Float64 variable"),
    "another type": (lambda s: s.fmu.getInt32([0]), "is no Int32 variable"),
    "a type that is not there": (lambda s: s.fmu.getInt64([0]), "fmi3GetInt64: this FMU has nothing of the kind"),
    "event mode": (lambda s: s.fmu.enterEventMode(), "fmi3EnterEventMode: this FMU has nothing of the kind"),
    "configuration": (lambda s: s.fmu.enterConfigurationMode(), "nothing of the kind"),
    "a second start": (lambda s: s.start(), "fmi3EnterInitializationMode is not allowed in step mode"),
    "time that jumps": (lambda s: s.fmu.doStep(5.0, STEP), "fmi3DoStep: a step from 5 s, expected one from"),
    "a derivative of an input": (
        lambda s: s.fmu.getAdjointDerivative([0], [0], [1.0] * 3, 3),
        "derivatives are offered of",
    ),
    "a seed of another length": (
        lambda s: s.fmu.getDirectionalDerivative(s.references(s.names("output")[:1]), [0], [1.0], 3),
        "expected the 3 of these variables",
    ),
}


@pytest.mark.parametrize("call", WRONG_CALLS.values(), ids=WRONG_CALLS)
@pytest.mark.parametrize("kind", ["plain"], indirect=True)
def test_a_wrong_call_is_refused_with_words_and_changes_nothing(slave, call):
    slave.run(0, 2)
    state = slave.fmu.serializeFMUState(slave.fmu.getFMUState())
    with pytest.raises(FMICallException) as refused:
        call[0](slave)
    assert refused.value.status == ERROR
    assert call[1] in slave.log[-1][2]
    assert slave.fmu.serializeFMUState(slave.fmu.getFMUState()) == state
    slave.run(2, 3)


@pytest.mark.parametrize("kind", ["plain"], indirect=True)
def test_what_instantiation_does_not_offer_is_refused_with_words(fmu, tmp_path):
    for words, options in (
        ("no event mode", {"eventModeUsed": True}),
        ("intermediate", {"requiredIntermediateVariables": [0]}),
    ):
        one, log = Slave(fmu, tmp_path, start=False), []
        one.fmu.freeInstance()
        one = FMU3Slave(
            guid=one.fmu.guid, modelIdentifier=one.fmu.modelIdentifier, unzipDirectory=one.fmu.unzipDirectory
        )
        with pytest.raises(Exception, match="instantiate"):
            one.instantiate(logMessage=lambda _, __, ___, text, log=log: log.append(text.decode()), **options)
        assert words in log[0]


def test_flexfmu_reads_it_and_says_what_it_does_not_run(fmu, body, tmp_path):
    assert read_packaged_body(fmu).interface_names == body.interface_names
    with pytest.raises(SimulationError, match=r"is FMI 3\.0, co-simulation; expected FMI 2\.0 .* without --fmi 3"):
        simulate(fmu, [], np.zeros((2, 1)))
    with pytest.raises(SimulationError, match=r"is FMI 3\.0, co-simulation; expected FMI 2\.0"):
        read_description("body", fmu)
    for version, runtime, words in ((4, Runtime.NATIVE, "expected 2 or 3"), (3, Runtime.PYTHON, "FMI 2.0 alone")):
        with pytest.raises(PackagingError, match=words):
            package_fmu(body, tmp_path / "none.fmu", runtime, fmi=version)
    assert not (tmp_path / "none.fmu").exists()


def test_random_calls_answer_as_those_of_fmi_2(fmu, body, tmp_path):
    # Statuses, words, states and values; FMI 2.0's have a fuzzer of their own.
    package_fmu(body, tmp_path / "two.fmu")
    words = [str(FUZZER), str(tmp_path / "two.fmu"), str(fmu), "1", str(CALLS)]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, check=False)
    assert done.stdout.splitlines()[1:] == [f"CALLS {CALLS}", "FINE"], (done.returncode, done.stdout, done.stderr)
