"""Masters without manners: random sequences of FMI calls, damaged states and files, long runs."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodies import random_body
from flexfmu.body import FlexibleBody
from flexfmu.fmu.package import package_fmu
from flexfmu.model.reduced_body import GROUND, Masses, ReducedBody, StressSet

SCRIPTS = Path(__file__).with_name("native_master")
MARK = "RESULT "
OK, WARNING, DISCARD, ERROR, FATAL = range(5)
# 3600 cases take about a minute of one core.
WORKERS, CASES = 4, 900

# Defects that are known and still there: the random sequences steer around them, and their tests must fail.
OPEN: set[str] = set()
# Of the compiled step alone, which is not everywhere.
SOMETIMES = {"smallest step"}


def defect(name, *values, **options):
    """A case of a parametrised test that a known defect fails."""
    mark = pytest.mark.xfail(reason=f"known defect: {name}", strict=name not in SOMETIMES)
    marks = [mark] if name in OPEN else []
    return pytest.param(*values, marks=marks, **options)


def fuzzed_body(seed: int, modes: int = 3) -> ReducedBody:
    """A body of few modes with every kind of input and output."""
    rng = np.random.default_rng(seed)
    return random_body(
        seed,
        parents=(GROUND, 0),
        interface_frame=(0, 1),
        modes=modes,
        velocity_outputs=True,
        masses=Masses(
            rng.uniform(0.1, 1.0, 2),
            rng.uniform(-1.0, 1.0, (2, 3)),
            0.1 * rng.standard_normal((2, 3, modes)),
            np.array([0, 1]),
        ),
        stress_sets=(StressSet("root", rng.uniform(-1.0, 1.0, (4, 3)), 1e9 * rng.standard_normal((4, 6, modes))),),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """FMUs: a body, another body with states of the same size, and one with another number of modes."""
    place = tmp_path_factory.mktemp("fmus")
    for name, body in (("body", fuzzed_body(1)), ("twin", fuzzed_body(2)), ("other", fuzzed_body(3, modes=4))):
        package_fmu(body, place / f"{name}.fmu")
    return place


def run(script, *arguments, timeout=300):
    command = [sys.executable, str(SCRIPTS / script), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def master(name, *arguments):
    """What a function of bare_masters returns in a process of its own."""
    done = run("bare_masters.py", name, json.dumps(arguments))
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, f"{name} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}"
    return json.loads(lines[-1][len(MARK) :])


# Random sequences.


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(WORKERS))
def test_no_sequence_of_calls_ends_the_process_or_breaks_the_rules(folder, seed):
    # After every call: its status is one that the standard allows; a refused call has changed nothing; outputs are
    # finite; values read back are those set. States replay to the bit, also in another instance.
    done = run("fuzz_worker.py", str(folder), str(seed), str(CASES), ",".join(sorted(OPEN)))
    journal = folder / f"{seed}.txt"
    if "FINE" not in done.stdout.splitlines():
        case = journal.read_text() if journal.exists() else "none was begun"
        pytest.fail(
            f"ended with {done.returncode}; the case that was under way, to be run again by\n"
            f'    python tests/native_master/fuzz_worker.py FOLDER "{case}"\n{done.stdout}\n{done.stderr}'
        )
    (line,) = [line.split() for line in done.stdout.splitlines() if line.startswith("CASES")]
    print(*line)
    assert int(line[1]) >= CASES


# Calls that must be refused.


@pytest.mark.parametrize(
    ("references", "values"),
    [
        pytest.param([9999], [1.0], id="unknown"),
        pytest.param([2**31 - 1], [1.0], id="largest"),
        defect("negative reference", [2**32 - 1], [1.0], id="minus one"),
        defect("negative reference", [2**32 - 1000], [1.0], id="minus one thousand"),
        defect("partial set", [0, 9999], [5.0, 1.0], id="behind one that is known"),
    ],
)
def test_setting_what_is_not_there_fails_changes_nothing_and_the_instance_goes_on(folder, references, values):
    found = master("refused", str(folder / "body.fmu"), "set_real", references, values)
    assert found["status"] == FATAL
    assert found["unchanged"]
    assert found["sound"]
    assert found["log"][0][:2] == [ERROR, "logStatusError"]


@pytest.mark.parametrize(
    "damage",
    [
        "empty",
        "short",
        "long",
        "odd",
        *[defect("damaged state", kind, id=kind) for kind in ("not a number", "zeros", "bit")],
    ],
)
def test_bytes_that_are_no_state_are_refused_and_change_nothing(folder, damage):
    found = master("refused", str(folder / "body.fmu"), "damaged_state", damage)
    assert found["status"] in (ERROR, FATAL)
    assert found["unchanged"]
    assert found["sound"]


@pytest.mark.parametrize(
    "which", [pytest.param("other", id="other size"), defect("twin state", "twin", id="same size")]
)
def test_a_state_of_another_body_is_refused_and_changes_nothing(folder, which):
    found = master("refused", str(folder / "body.fmu"), "state_of", str(folder / f"{which}.fmu"))
    assert found["status"] in (ERROR, FATAL)
    assert found["unchanged"]
    assert found["sound"]


@pytest.mark.parametrize("loads", [[1e3, 1e6, 1e50], defect("huge load", [1e153, 1e160, 1e200, 1e300])])
def test_a_step_under_a_load_of_any_size_leaves_finite_outputs(folder, loads):
    for load, kinematics, step, status, finite in master("huge_loads", str(folder / "body.fmu"), loads):
        assert step in (OK, DISCARD), (load, kinematics)
        assert status == OK, (load, kinematics)
        assert finite, (load, kinematics)


@pytest.mark.parametrize("sizes", [[1e-3, 1e-16, 1e-100, 1e-300], defect("smallest step", [5e-324])])
def test_a_step_of_any_length_down_to_the_smallest_number_is_taken(folder, sizes):
    for size, step, status, finite in master("small_steps", str(folder / "body.fmu"), sizes):
        assert (step, status, finite) == (OK, OK, True), size


@pytest.mark.parametrize(
    "loads",
    [[1e3, 1e6, 1e200], *(defect("stability of extreme inputs", [load], id=load) for load in ("nan", "inf"))],
)
def test_asking_for_the_stability_under_any_load_leaves_a_sound_instance(folder, loads):
    assert all(master("stability_under", str(folder / "body.fmu"), loads))


DAMAGED_FILES = {
    "missing": "no such file",
    "empty": "not a readable modal file",
    "truncated": "not a readable modal file",
    "one byte short": "not a readable modal file",
    "text": "not a readable modal file",
    "foreign HDF5": "not a flexfmu modal file",
    "altered number": "the file was altered",
    "altered name": "the file was altered",
    "newer schema": ", this flexfmu reads version ",
    "no schema": "not a readable modal file",
    "no checksum": "not a readable modal file",
    "no modes": "not a readable modal file",
    "not a number": "not finite",
}


def test_a_damaged_foreign_or_newer_modal_file_is_refused_at_instantiation_with_a_log_line(folder):
    result = master("damaged_files", str(folder / "body.fmu"), list(DAMAGED_FILES))
    for name, refused, log in result["found"]:
        assert refused, name
        assert len(log) == 1, (name, log)
        assert log[0][0] in (ERROR, FATAL), name
        assert DAMAGED_FILES[name] in log[0][2], (name, log)
    # The same process can go on with a sound file.
    assert result["sound"]


def test_the_data_or_the_description_of_another_body_with_the_same_variables_is_refused_at_instantiation(folder):
    result = master("mixed", str(folder / "body.fmu"), str(folder / "twin.fmu"))
    assert result["same variables"]
    for (name, refused, log), words in zip(result["found"], ("modal file has the checksum", "guid"), strict=True):
        assert refused, name
        assert len(log) == 1, log
        assert log[0][0] in (ERROR, FATAL)
        assert words in log[0][2]
        assert "two FMUs are mixed" in log[0][2]
    # Where a master unpacks no description there is none to compare.
    assert result["sound"]


# Liberties and limits of pythonfmu's library: the sentences of docs/masters.md.


def test_the_library_lets_pass_what_the_standard_does_not(folder):
    assert master("liberties", str(folder / "body.fmu")) == {
        "another guid": True,
        "step before initialisation": OK,
        "second initialisation": OK,
        "time that jumps": OK,
        "terminate": OK,
        "step after terminate": OK,
        "freed state is null": False,
        "state handed in is used again": False,
    }


def test_after_a_discarded_step_the_last_successful_time_is_where_it_began_and_other_questions_are_not_answered(folder):
    found = master("discarded", str(folder / "body.fmu"))
    assert found["status"] == DISCARD
    assert found["last"] == [OK, 1e-3]
    # Every call that the model description does not promise.
    assert found["calls"].pop("GetBooleanStatus") == OK
    assert set(found["calls"].values()) == {DISCARD, ERROR}


def test_log_categories_choose_lines_and_those_of_the_library_have_none(folder):
    discard, error, own = [DISCARD, "logStatusDiscard"], [ERROR, "logStatusError"], [FATAL, ""]
    assert master("log_lines", str(folder / "body.fmu")) == {
        "all": [discard, error, own],
        "none": [],
        "discards": [discard],
        "errors": [error],
        "failed instantiation, off": [],
    }


@pytest.mark.parametrize("mistake", ["no resources", "path with #"])
def test_a_wrong_address_of_the_resources_ends_the_process(folder, mistake):
    # Should this fail, the library has learnt to refuse it: take the sentence out of docs/masters.md.
    assert master("fatal", str(folder / "body.fmu"), mistake) == "before"


# Long runs. Growth is measured after a warm-up.

linux = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")


@linux
@pytest.mark.slow
def test_a_thousand_instances_one_after_another_cost_what_the_library_loses_and_no_more(folder):
    # pythonfmu's library loses about 5 kB per instantiation: names of classes, and its search path for modules.
    assert master("many_instances", str(folder / "body.fmu"), 1000, 100)["growth"] < 8.0


@linux
@pytest.mark.slow
@pytest.mark.parametrize(("kinematics", "count"), [("linear", 100_000), ("corotated", 1_000_000)])
def test_many_steps_of_one_instance_keep_memory_flat(folder, kinematics, count):
    if FlexibleBody(fuzzed_body(1))._stepper.kernel is None:
        # In NumPy alone a million steps would take a quarter of an hour.
        count //= 50
    # A thousand steps are refused and states go to bytes and back; the library loses the text of each log line.
    found = master("many_steps", str(folder / "body.fmu"), kinematics, count, 2000)
    print(f"{count} steps: {found['growth']:.2f} MB more")
    assert found["growth"] < 2.0


@linux
@pytest.mark.slow
def test_many_failed_calls_lose_their_log_lines_and_no_more(folder):
    found = master("many_failures", str(folder / "body.fmu"), 10_000, 1000)
    assert found["growth"] < 6.0
    assert found["sound"]


def test_two_versions_of_two_bodies_in_one_process_do_not_mix(tmp_path):
    models = []
    for seed in (1, 2):
        first = fuzzed_body(seed)
        models += [first, replace(first, damping_ratio=2.0 * first.damping_ratio)]
    paths = [str(tmp_path / f"{k}.fmu") for k in range(len(models))]
    for model, path in zip(models, paths, strict=True):
        package_fmu(model, Path(path))
    loads, steps = [4.0, -3.0, 2.0, 0.5, 0.0, -0.5], 50
    ends = master("together", paths, loads, steps)
    for model, pair in zip(models, ends, strict=True):
        assert pair[0] == pair[1]
        body = FlexibleBody(model)
        state, on_body = body.rest(), body.loads({"port_0": loads})
        for _ in range(steps):
            state = body.step(state, on_body, 1e-3)
        response = body.response(state)
        expected = np.concatenate([response.displacement, response.rotation], axis=1).ravel()
        np.testing.assert_allclose(pair[0][: expected.size], expected, rtol=0, atol=1e-13)
    first = [pair[0] for pair in ends]
    assert all(a != b for k, a in enumerate(first) for b in first[:k])
    assert master("together", paths[::-1], loads, steps) == ends[::-1]
