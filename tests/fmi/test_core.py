"""What the core does not do: allocate in a step, print, or keep numbers that belong to no instance."""

import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fuzzed
from flexfmu.core.building import FLAGS, command, sources, system_compiler
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.runtime import Runtime

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or system_compiler() is None, reason="needs Linux and a C compiler"
)

TESTS = Path(__file__).parents[1]
# One counter for all files of the core.
COUNTED = """
#include <stdlib.h>
__attribute__((weak, visibility("default"))) long flex_allocations;
#define malloc(size) (flex_allocations++, malloc(size))
#define calloc(count, size) (flex_allocations++, calloc(count, size))
#define realloc(old, size) (flex_allocations++, realloc(old, size))
"""
MASTER = """
import sys
sys.path.insert(0, sys.argv[1])
from ctypes import c_long
from bare_fmi2 import OK, Fmu

fmu = Fmu(sys.argv[3], sys.argv[2])
made = c_long.in_dll(fmu.library, "flex_allocations")
one = fmu.instantiate()
opened = made.value
inputs, outputs = (fmu.references("Real", kind) for kind in ("input", "output"))
assert one.setup() == one.enter() == one.set_real(inputs, [0.1] * len(inputs)) == one.exit() == OK
begun = made.value
for number in range(50):
    load = [(0.1 + 0.3 * (number % 7)) * (-1) ** k for k in range(len(inputs))]
    # The last load is beyond anything.
    load = load if number < 49 else [1e200] * len(inputs)
    statuses = one.set_real(inputs, load), one.step(0.0, 1e-4 * 4 ** (number % 6))
    assert statuses[0] == OK
    one.get_real(outputs)
stepped = made.value
status, state = one.get_state()
print("COUNTS", opened, begun, stepped, made.value, statuses[1], max(map(abs, one.get_real(outputs)[1])))
"""


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    """The core, compiled so that it counts what it allocates."""
    folder = tmp_path_factory.mktemp("counted")
    (folder / "counted.h").write_text(COUNTED, encoding="utf-8")
    library = folder / "counted.so"
    subprocess.run(command(system_compiler(), library, extra=[f"-include{folder / 'counted.h'}"]), check=True)
    return library


@pytest.mark.slow
@pytest.mark.parametrize("kind", fuzzed.KINDS)
def test_a_step_allocates_nothing(kind, counted, tmp_path):
    fmu = tmp_path / f"{kind}.fmu"
    package_fmu(fuzzed.fuzzed_body(kind), fmu, Runtime.NATIVE)
    words = [sys.executable, "-c", MASTER, str(TESTS / "native_master"), str(counted), str(fmu)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("COUNTS")]
    assert lines, done.stderr
    opened, begun, stepped, saved, last, moved = map(float, lines[0].split()[1:])
    assert 0 < opened <= begun
    assert stepped == begun
    # What does allocate is counted, and there was something to do.
    assert saved > stepped
    assert last > 0
    assert moved > 0.0
    # Nothing is printed: all that stands there is the master's own.
    assert done.stdout.splitlines() == lines
    assert done.stderr == ""


def test_the_core_calls_nothing_that_prints_or_ends_the_process():
    calls = re.compile(r"\b(v?f?printf|puts|putchar|fputs|fwrite|perror|exit|abort) ?\(|\b(stdout|stderr)\b")
    assert [path.name for path in sources() if calls.search(path.read_text(encoding="utf-8"))] == []


def test_the_only_variable_of_the_core_is_whether_the_processor_has_wide_vectors(tmp_path):
    if shutil.which("nm") is None:
        pytest.skip("nm lists what files hold")
    found = set()
    for path in sources():
        part = tmp_path / f"{path.stem}.o"
        flags = [*(flag for flag in FLAGS if flag != "-O3"), '-DFLEX_SOURCES=""', "-fPIC", "-c"]
        subprocess.run([*system_compiler(), *flags, str(path), "-o", str(part)], check=True)
        listed = subprocess.run(["nm", "-f", "sysv", str(part)], capture_output=True, text=True, check=True).stdout
        rows = [[cell.strip() for cell in line.split("|")] for line in listed.splitlines() if line.count("|") == 6]
        found |= {row[0] for row in rows if row[6] in (".data", ".bss", "*COM*") and row[3] == "OBJECT"}
    assert found == ({"wide"} if platform.machine() in ("x86_64", "AMD64") else set())
