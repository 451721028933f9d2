"""Libraries read formats of other programs in a process of their own: what one does there costs an error alone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numpy as np
import pytest

from flexfmu.files import workers
from flexfmu.files.basics import MeshError, UnitSystem
from flexfmu.mesh import formats
from flexfmu.mesh.formats import read_mesh

FOREIGN = Path(__file__).parent
FILE = FOREIGN / "gmsh_bricks_binary.msh"
linux = pytest.mark.skipif(sys.platform != "linux", reason="the copy of this process has what the test put into it")


def hang(_):
    while True:
        time.sleep(1.0)


def crash(_):
    os.kill(os.getpid(), signal.SIGSEGV)


def leave(_):
    os._exit(7)


def swallow(_):
    kept = []
    while True:
        kept.append(np.empty(2**22))


def chatter(path):
    os.write(1, b"x" * 100_000)
    return real(path)


real = meshio.read
TROUBLE = {
    "never returns": (hang, "gave no answer within 1.5 s; is it damaged? Write it again, or give it longer by timeout"),
    "crashes": (crash, "the library that read it ended with SIGSEGV"),
    "ends the process": (leave, "the library that read it ended with exit code 7"),
    "takes all memory": (swallow, "Unable to allocate"),
}


@pytest.mark.slow
@linux
@pytest.mark.parametrize(("trouble", "words"), TROUBLE.values(), ids=TROUBLE)
def test_a_reader_that_goes_wrong_costs_an_error_with_the_files_name(monkeypatch, trouble, words):
    monkeypatch.setattr(meshio, "read", trouble)
    monkeypatch.setattr(formats, "_most_memory", lambda: 2**29)
    with pytest.raises(MeshError) as refused:
        read_mesh(FILE, timeout=1.5 if trouble is hang else None)
    assert str(refused.value).startswith(f"{FILE} cannot be read as a mesh")
    assert words in str(refused.value)
    monkeypatch.undo()
    assert len(read_mesh(FILE).points) > 100


@linux
def test_what_a_reader_prints_is_no_answer(monkeypatch):
    monkeypatch.setattr(meshio, "read", chatter)
    np.testing.assert_array_equal(read_mesh(FILE).points, real(FILE).points)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("platform", "name"),
    [
        ("linux", "gmsh_bricks_binary.msh"),
        ("linux", "ansys_bricks.cdb"),
        ("linux", "exodus_bricks.e"),
        ("win32", "nastran_bricks.bdf"),
    ],
)
def test_a_good_file_is_read_alike_there_also_where_processes_cannot_be_copied(monkeypatch, platform, name):
    here = formats._reader()((FOREIGN / name, Path(name).suffix, UnitSystem.SI))
    monkeypatch.setattr(workers, "PLATFORM", platform)
    mesh = read_mesh(FOREIGN / name)
    np.testing.assert_array_equal(mesh.points, here.mesh.points)
    assert set(here.mesh.point_sets) <= set(mesh.node_sets)
    with pytest.raises(MeshError, match=r"nothing\.e"):
        read_mesh(FOREIGN / "nothing.e")


SCRIPT = """
import sys, time, meshio
meshio.read = lambda path: time.sleep(600)
from flexfmu.mesh.formats import read_mesh
print("begun", flush=True)
read_mesh(sys.argv[1])
"""


def state(number):
    """Letter that says what a process does, "Z" also where there is none any more."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return "Z"


@pytest.mark.slow
@linux
def test_ctrl_c_ends_the_waiting_and_the_reader():
    one = subprocess.Popen([sys.executable, "-c", SCRIPT, FILE], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert one.stdout.readline() == b"begun\n"
    children = Path(f"/proc/{one.pid}/task/{one.pid}/children")
    # What forking calls afterwards would swallow the interrupt: it is to come while the reader is waited for.
    while not (readers := children.read_text().split()) or state(one.pid) != "S":
        time.sleep(0.05)
    one.send_signal(signal.SIGINT)
    _, said = one.communicate(timeout=60)
    assert b"KeyboardInterrupt" in said
    # Who inherits a reader that has ended may take its time to notice.
    late = time.monotonic() + 30.0
    while not all(state(number) == "Z" for number in readers) and time.monotonic() < late:
        time.sleep(0.05)
    assert all(state(number) == "Z" for number in readers)
