"""Work shared among processes: the same answers, in the same order, and an end by Ctrl-C that leaves whole records."""

import os
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest

from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.study.candidates import candidates, grouped
from flexfmu.study.chart.sweep import measure
from flexfmu.study.records import RECORDS
from flexfmu.study.workshop import Crew, JobsError, Workshop
from scene_tools import SMALL_SWEEP, with_results


def slow_first(number):
    time.sleep(0.2 if number == 0 else 0.0)
    return number, os.getpid()


@pytest.mark.slow
def test_results_come_in_the_order_of_the_tasks_from_other_processes():
    with Crew(2) as crew:
        found = list(crew.each([partial(slow_first, number) for number in range(4)]))
    assert [number for number, _ in found] == [0, 1, 2, 3]
    assert os.getpid() not in {process for _, process in found}
    with Crew() as crew:
        assert {process for _, process in crew.each([partial(slow_first, n) for n in range(2)])} == {os.getpid()}


@pytest.mark.parametrize(
    ("jobs", "words"),
    [(0, "1 or more, or -1"), (-2, "1 or more, or -1")],
)
def test_jobs_are_a_number(jobs, words):
    with pytest.raises(JobsError, match=words):
        Crew(jobs)


@pytest.mark.slow
def test_errors_are_the_same_whoever_measures_them(tmp_path):
    scene = with_results(tmp_path, SMALL_SWEEP)
    most = Workshop(scene, Reporter(), Store()).most
    groups = [(members,) for members in grouped(candidates(scene), most)]
    found = {}
    for jobs in (1, 2):
        with Crew(jobs) as crew:
            workshop = Workshop(scene, Reporter(), Store(), crew)
            found[jobs] = [[e for _, e in one] for one in workshop.each(measure, groups)]
            assert workshop.tried == len(candidates(scene)) == 6
    # What was not compared is no number, which equals nothing.
    assert repr(found[1]) == repr(found[2])
    assert all(np.isfinite(e.share) for one in found[1] for e in one)


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_and_leaves_whole_records(tmp_path):
    with_results(tmp_path, SMALL_SWEEP.replace("[1, 2]", "[1, 2, 3, 4, 5, 6, 7, 8]").replace("[3, 6]", "[3, 6, 9, 12]"))
    code = "from flexfmu.commands.entry import main; main()"
    command = ["chart", "body.toml", "--scene", "scene.toml", "--records", "r.csv", "--bare", "--all", "--jobs", "2"]
    job = subprocess.Popen(
        [sys.executable, "-c", code, *command],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "FLEXFMU_CACHE": ""},
        start_new_session=True,
    )
    records = tmp_path / "r.csv"
    while job.poll() is None and not (records.exists() and records.read_text().count("\n") > 3):
        time.sleep(0.02)
    # As a terminal does: to the whole group.
    os.killpg(job.pid, signal.SIGINT)
    _, said = job.communicate(timeout=300)
    assert job.returncode == 130, said
    assert "goes on from there" in " ".join(said.split())
    assert "Traceback" not in said
    rows = RECORDS.read(records)
    assert 3 <= len(rows) < 36
    deadline = time.monotonic() + 300.0
    while _alive(job.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(job.pid)


def _alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
