"""Plain `fmpy.simulate_fmu`, as users call it, where the FMU refuses a step: it ends, and says why; of both exports."""

import json
import subprocess
import sys

import numpy as np
import pytest

from bodies import Beam, beam_body
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.runtime import Runtime

# Wall clock, s, for runs that take some 2 s on a busy machine. Without an end they would go on for ever.
DEADLINE = 60.0
MARK = "RESULT "
PROGRAM = """
import json, sys
import fmpy, numpy
path, stop, interval, times, values, settings, along, more = json.loads(sys.argv[1])
table = numpy.array(list(zip(times, map(float, values))), dtype=[("time", float), ("tip.force." + along, float)])
result = fmpy.simulate_fmu(path, stop_time=stop, output_interval=interval, input=table, start_values=settings, **more)
print("RESULT " + json.dumps([result["time"].tolist(), result["tip.displacement." + along].tolist()]), flush=True)
"""


@pytest.fixture(scope="module", params=list(Runtime), ids=lambda runtime: runtime.value)
def runtime(request):
    """Each export."""
    return request.param


@pytest.fixture(scope="module")
def beam(tmp_path_factory, runtime):
    path = tmp_path_factory.mktemp("plain") / f"beam_{runtime.value}.fmu"
    package_fmu(beam_body(3, modes=3), path, runtime)
    return path


def simulated(path, stop, interval, times, values, along="y", more=None, **settings):
    """Times and deflections that fmpy returns in a process of its own, and all that a user reads meanwhile."""
    job = json.dumps([str(path), stop, interval, times, [str(value) for value in values], settings, along, more or {}])
    command = [sys.executable, "-c", PROGRAM, job]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    (line,) = [line for line in done.stdout.splitlines() if line.startswith(MARK)] or [""]
    assert line, f"no result:\n{done.stdout}\n{done.stderr}"
    return *np.array(json.loads(line[len(MARK) :])), done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "values", "last", "words"),
    [
        ([0.0, 1.0], [1e12, 1e12], 0.0, "does not converge: the loads would turn the linear body"),
        ([0.0, 0.05, 0.05, 1.0], [1.0, 1.0, "nan", "nan"], 0.05, "input tip.force.y is nan, expected a finite number"),
        ([0.0, 1.0], [0.0, 1e14], 0.01, "does not converge: the loads would turn the linear body"),
    ],
    ids=["load", "not a number", "ramp"],
)
def test_a_refused_step_ends_the_run_and_says_why(beam, times, values, last, words):
    time, deflection, read = simulated(beam, 1.0, 0.01, times, values)
    assert time[-1] == pytest.approx(last)
    # fmpy keeps the state before the refused step once more.
    assert time[-1] == time[-2]
    assert len(time) == round(last / 0.01) + 2
    assert np.all(np.isfinite(deflection))
    assert read.count(words) == 1


def test_a_step_that_takes_more_work_than_it_may_ends_the_run_and_says_why(beam):
    hard = {"internal_step.tolerance": 1e-10, "internal_step.most": 4.0}
    time, _, read = simulated(beam, 3.0, 1.0, [0.0, 3.0], [2000.0, 2000.0], **hard)
    assert time.tolist() == [0.0, 0.0]
    assert read.count("the step of 1 s needs more work") == 1


def test_a_step_of_a_second_that_can_be_taken_is_taken_in_silence(beam):
    time, _, read = simulated(beam, 3.0, 1.0, [0.0, 3.0], [100.0, 100.0])
    assert time.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert "refused" not in read
    assert "DISCARD" not in read


@pytest.mark.slow
def test_flexfmu_simulate_says_it_once(beam, tmp_path):
    (tmp_path / "loads.csv").write_text("time,tip.force.y\n0,1e12\n1,1e12\n")
    words = ["simulate", str(beam), "--input", "loads.csv", "--output", "motion.csv"]
    command = [sys.executable, "-m", "flexfmu", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False, cwd=tmp_path)
    assert done.returncode
    assert (done.stdout + done.stderr).count("does not converge") == 1


RAMP = [0.0, 1.0], [0.0, 1e7]


@pytest.mark.slow
@pytest.mark.parametrize("interval", [0.01, 0.001])
def test_motion_beyond_all_meaning_ends_the_run_by_default(beam, interval):
    time, deflection, read = simulated(beam, 1.0, interval, *RAMP)
    assert time[-1] < 0.2
    assert np.max(np.abs(deflection)) < 2.0
    assert read.count("where no method means anything (bound.rotation = 85.9 deg)") == 1


@pytest.mark.slow
def test_the_bounds_can_be_lifted(beam):
    time, _, read = simulated(beam, 0.3, 0.001, *RAMP, **{"bound.rotation": 0.0, "bound.displacement": 0.0})
    assert time[-1] == pytest.approx(0.3)
    assert "bound." not in read
    # The tip moves by a quarter of the length sooner than the material turns by the first bound.
    time, deflection, read = simulated(beam, 0.3, 0.001, *RAMP, **{"bound.displacement": 0.25})
    assert 0.1 < np.max(np.abs(deflection)) < 0.25
    assert read.count("interface 'tip' would move by 0.2") == 1


def test_the_first_warning_of_a_kind_reaches_a_user_who_asks_for_no_log(beam):
    _, _, read = simulated(beam, 0.5, 0.01, [0.0, 0.5], [0.0, 1e5])
    assert read.count("material turns by") == 1
    assert "beyond the limit of 28.6 deg" in read


@pytest.mark.parametrize("set_stop_time", [True, False])
def test_a_run_of_two_steps_beyond_the_critical_load_is_told_so(beam, set_stop_time):
    """Shorter than the look that finds it; with a stop time, or by fmi2Terminate alone."""
    press = [-1.2 * Beam().critical_load] * 2
    time, _, read = simulated(beam, 2e-3, 1e-3, [0.0, 1.0], press, "x", {"set_stop_time": set_stop_time})
    assert len(time) == 3
    assert read.count("the loads are beyond the critical load: the tangent stiffness") == 1
