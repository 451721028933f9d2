"""FMUs of other programs in a coupling: what one does to its process ends its own run, with results so far."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from flexfmu.files.errors import SimulationError
from flexfmu.master import couple, read_coupling_file
from flexfmu.master.coupling import CouplingStoppedError

# Counts its steps; at the time told it does what it is told to do to its process.
SLAVE = """
import os, signal, time
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

class Trouble(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.kind, self.at, self.x, self.process = 0, 1e9, 0.0, float(os.getpid())
        self.register_variable(Integer("kind", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("at", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Real("process", causality=Fmi2Causality.output))

    def do_step(self, now, size):
        if now > self.at:
            if self.kind == 1:
                os._exit(3)
            if self.kind == 2:
                os.kill(os.getpid(), signal.SIGSEGV)
            if self.kind == 3:
                time.sleep(1e6)
            if self.kind == 4:
                print("x" * 10**6)
        self.x += size
        return True
"""
BUILD = "import sys; from pythonfmu.builder import FmuBuilder; FmuBuilder.build_FMU(sys.argv[1], dest=sys.argv[2])"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("foreign")
    (path / "trouble.py").write_text(SLAVE, encoding="utf-8")
    subprocess.run([sys.executable, "-c", BUILD, path / "trouble.py", path], check=True, capture_output=True)
    (built,) = path.glob("*.fmu")
    built.rename(path / "trouble.fmu")
    return path


def coupled(folder, kind, timeout=60.0, at=0.0245):
    text = f"[experiment]\nstop = 0.05\nstep = 0.005\ntimeout = {timeout}\n"
    text += '[output]\nvariables = ["odd.x", "odd.process"]\n'
    for name, number in (("calm", 0), ("odd", kind)):
        text += f'[[fmu]]\nname = "{name}"\nfile = "trouble.fmu"\nstart = {{ kind = {number}, at = {at} }}\n'
    (folder / "coupling.toml").write_text(text, encoding="utf-8")
    return couple(read_coupling_file(folder / "coupling.toml"))


def test_a_foreign_fmu_runs_in_a_process_of_its_own_that_ends_with_the_run(folder):
    found = coupled(folder, 0)
    np.testing.assert_allclose(found["odd.x"], found.time, atol=1e-15)
    process = int(found["odd.process"][-1])
    assert process != os.getpid()
    assert not Path(f"/proc/{process}/stat").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (1, "fmu 'odd' ended its process in doStep: exit code 3"),
        (2, "fmu 'odd' ended its process in doStep: SIGSEGV"),
        (3, "fmu 'odd' did not come back from doStep within 8 s and was ended"),
    ],
)
def test_an_fmu_that_exits_crashes_or_never_returns_ends_its_run_with_its_name_and_the_results_so_far(
    folder, kind, words
):
    with pytest.raises(CouplingStoppedError, match=words) as stopped:
        # Where the process has to start, too, on a busy machine.
        coupled(folder, kind, timeout=8.0 if kind == 3 else 60.0)
    result = stopped.value.result
    np.testing.assert_allclose(result.time, 0.005 * np.arange(6), atol=1e-12)
    np.testing.assert_allclose(result["odd.x"], result.time, atol=1e-15)


def test_what_a_foreign_fmu_prints_is_not_taken_for_an_answer(folder):
    found = coupled(folder, 4)
    np.testing.assert_allclose(found["odd.x"], found.time, atol=1e-15)


@pytest.mark.slow
def test_an_archive_that_unpacks_to_far_more_than_it_is_is_not_unpacked(folder):
    bomb = folder / "trouble.fmu"
    whole = bomb.read_bytes()
    with (
        zipfile.ZipFile(bomb, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("resources/zeros", "w") as file,
    ):
        for _ in range(1100):
            file.write(bytes(2**20))
    try:
        with pytest.raises(SimulationError, match=r"unpack to 1\.1\de\+03 MB, expected at most 1\.07e\+03"):
            coupled(folder, 0)
    finally:
        bomb.write_bytes(whole)
