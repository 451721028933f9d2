"""FMUs of other programs in a coupling: what one does to its process ends its own run, with results so far."""

import os
import signal
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from bodies import beam_body
from flexfmu.files.basics import SimulationError, StoppedError
from flexfmu.fmu.package import package_fmu
from flexfmu.master import couple, parse_coupling, read_coupling_file

# Counts its steps; at the time told it does what it is told to do to its process.
SLAVE = """
import os, signal, time
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

class Trouble(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input, start=0.0, setter=self.take))
        self.kind, self.at, self.x, self.process = 0, 1e9, 0.0, float(os.getpid())
        self.register_variable(Integer("kind", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("at", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Real("process", causality=Fmi2Causality.output))
        if "AT_START" in os.environ:
            self.meet("start")

    def take(self, value):
        if self.kind == 6 and value > self.at:
            raise ValueError("too much")
        self.u = value

    def meet(self, now):
        place = os.environ["MEETING"]
        open(f"{place}/{self.instance_name} {now}", "w").close()
        while sum(name.endswith(f" {now}") for name in os.listdir(place)) < 2:
            time.sleep(1e-3)

    def do_step(self, now, size):
        if self.kind == 5:
            self.meet(now)
        if now > self.at:
            if self.kind == 1:
                os._exit(3)
            if self.kind == 2:
                os.kill(os.getpid(), signal.SIGSEGV)
            if self.kind == 3:
                print("asleep", flush=True)
                if "ASLEEP" in os.environ:
                    open(os.environ["ASLEEP"], "w").close()
                time.sleep(1e6)
            if self.kind == 4:
                print("x" * 10**6)
        self.x += size
        return True
"""
LOADS = {"a": 2000.0, "b": 0.0}
BUILD = "import sys; from pythonfmu.builder import FmuBuilder; FmuBuilder.build_FMU(sys.argv[1], dest=sys.argv[2])"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("foreign")
    (path / "trouble.py").write_text(SLAVE, encoding="utf-8")
    subprocess.run([sys.executable, "-c", BUILD, path / "trouble.py", path], check=True, capture_output=True)
    (built,) = path.glob("*.fmu")
    built.rename(path / "trouble.fmu")
    return path


def coupled(folder, kind, timeout=60.0, at=0.0245, calm=0, more=""):
    text = f"[experiment]\nstop = 0.05\nstep = 0.005\ntimeout = {timeout}\n"
    text += '[output]\nvariables = ["odd.x", "odd.process"]\n'
    for name, number in (("calm", calm), ("odd", kind)):
        text += f'[[fmu]]\nname = "{name}"\nfile = "trouble.fmu"\nstart = {{ kind = {number}, at = {at} }}\n'
    (folder / "coupling.toml").write_text(text + more, encoding="utf-8")
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
        (1, "fmu 'odd' ended its process in fmi2DoStep: exit code 3"),
        (2, "fmu 'odd' ended its process in fmi2DoStep: SIGSEGV"),
        (3, "fmu 'odd' did not come back from fmi2DoStep within 8 s and was ended"),
    ],
)
def test_an_fmu_that_exits_crashes_or_never_returns_ends_its_run_with_its_name_and_the_results_so_far(
    folder, kind, words
):
    with pytest.raises(StoppedError, match=words) as stopped:
        # Where the process has to start, too, on a busy machine.
        coupled(folder, kind, timeout=8.0 if kind == 3 else 60.0)
    result = stopped.value.result
    np.testing.assert_allclose(result.time, 0.005 * np.arange(6), atol=1e-12)
    np.testing.assert_allclose(result["odd.x"], result.time, atol=1e-15)


def test_foreign_fmus_of_a_jacobi_step_step_at_the_same_time(folder, tmp_path, monkeypatch):
    """Each waits in its step for the other's: one after the other they would wait for ever."""
    monkeypatch.setenv("MEETING", str(tmp_path))
    found = coupled(folder, 5, calm=5)
    assert len(found.time) == 11
    assert len(list(tmp_path.iterdir())) == 20


def test_foreign_fmus_start_at_the_same_time(folder, tmp_path, monkeypatch):
    """Each waits in its start for the other's."""
    monkeypatch.setenv("MEETING", str(tmp_path))
    monkeypatch.setenv("AT_START", "1")
    assert len(coupled(folder, 0).time) == 11


def test_a_foreign_fmus_process_imports_little():
    imported = "import sys, flexfmu.fmu.foreign_host; print(*{'numpy', 'fmpy', 'h5py', 'pydantic'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", imported], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_inputs_that_a_foreign_fmu_refuses_end_the_run_with_its_name(folder):
    with pytest.raises(
        StoppedError, match=r"(?s)at 0\.025 s: fmu 'odd' failed to take its inputs: .*too much"
    ) as stopped:
        coupled(folder, 6, more='[[connection]]\nfrom = "calm.x"\nto = "odd.u"\n')
    np.testing.assert_allclose(stopped.value.result.time[-1], 0.025, atol=1e-12)


@pytest.mark.slow
def test_ctrl_c_twice_ends_a_run_whose_foreign_fmu_never_returns(folder):
    coupled(folder, 0)
    text = (folder / "coupling.toml").read_text(encoding="utf-8").replace("kind = 0", "kind = 3")
    (folder / "asleep.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "flexfmu", "couple", "asleep.toml", "--output", "motion.csv"]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as job:
        for word in ("asleep", "press it again"):
            assert any(word in line for line in job.stderr)
            job.send_signal(signal.SIGINT)
        assert job.wait(30.0) != 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of threads are POSIX")
def test_ctrl_c_is_heard_though_it_comes_just_before_the_run_waits_for_its_foreign_fmu(folder, tmp_path, monkeypatch):
    """A signal that another thread takes interrupts no wait, as one that comes a moment before."""
    asleep = tmp_path / "asleep"
    monkeypatch.setenv("ASLEEP", str(asleep))
    own = signal.getsignal(signal.SIGINT)

    def press():
        for waits in (lambda: not asleep.exists(), lambda: signal.getsignal(signal.SIGINT) is not own):
            end = time.monotonic() + 30.0
            while waits() and time.monotonic() < end:
                time.sleep(0.01)
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            coupled(folder, 3)
    finally:
        thread.join()
    assert time.monotonic() - begun < 45.0


@pytest.mark.parametrize("scheme", ["jacobi", "iterated"])
def test_an_fmu_in_another_process_gives_the_same_bits(tmp_path, scheme):
    package_fmu(beam_body(3, modes=3, damping=0.02), tmp_path / "own.fmu")
    with (
        zipfile.ZipFile(tmp_path / "own.fmu") as own,
        zipfile.ZipFile(tmp_path / "foreign.fmu", "w") as other,
    ):
        for entry in own.namelist():
            other.writestr(entry, own.read(entry).replace(b'generationTool="flexfmu', b'generationTool="other'))
    found = {}
    for kind in ("own", "foreign"):
        fmus = [{"name": name, "file": f"{kind}.fmu", "start": {"tip.force.y": load}} for name, load in LOADS.items()]
        spring = {"a": "a.tip", "b": "b.tip", "stiffness": [2e5] * 3 + [1e3] * 3, "damping": [10.0] * 6}
        experiment = {"stop": 0.02, "step": 2e-4, "scheme": scheme}
        content = {"experiment": experiment, "fmu": fmus, "spring": [spring], "output": {"every": 3}}
        found[kind] = couple(parse_coupling(content, tmp_path))
    assert found["own"].names == found["foreign"].names
    assert np.max(np.abs(found["own"]["b.tip.displacement.y"])) > 1e-3
    np.testing.assert_array_equal(found["foreign"].values, found["own"].values)


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
