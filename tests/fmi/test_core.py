"""What the core does not do: allocate in a step, print, write beyond its arrays, or keep numbers of no instance."""

import ctypes
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fuzzed
from bodies import beam_body
from core_files import core_order
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.core.building import FLAGS, FOLDER, sources, system_compiler
from flexfmu.core.library import Core, declare
from flexfmu.files.basics import OptionError
from flexfmu.fmu.package import package_fmu
from flexfmu.fmu.runtime import Runtime
from flexfmu.program.compile import compile_program

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or system_compiler() is None, reason="needs Linux and a C compiler"
)

TESTS = Path(__file__).parents[1]
# The linker puts these in the place of what allocates: one counter for all files of the core.
COUNTED = """
#include <stdlib.h>
__attribute__((visibility("default"))) long flex_allocations;
#define COUNT(call, taken, given) \\
    void *__real_##call taken; \\
    void *__wrap_##call taken; \\
    void *__wrap_##call taken { flex_allocations++; return __real_##call given; }
COUNT(malloc, (size_t size), (size))
COUNT(calloc, (size_t count, size_t size), (count, size))
COUNT(realloc, (void *old, size_t size), (old, size))
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
    statuses = one.set_real(inputs, load), one.go_on(1e-4 * 4 ** (number % 6))
    assert statuses[0] == OK
    one.get_real(outputs)
stepped = made.value
status, state = one.get_state()
print("COUNTS", opened, begun, stepped, made.value, statuses[1], max(map(abs, one.get_real(outputs)[1])))
"""


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """What each of the core's files is compiled to, once for all that is asked of it here."""
    folder = tmp_path_factory.mktemp("objects")
    flags = [*(flag for flag in FLAGS if flag != "-O3"), '-DFLEX_SOURCES=""', "-fPIC", "-c"]
    subprocess.run([*system_compiler(), *flags, *map(str, sources())], cwd=folder, check=True)
    return [folder / f"{path.stem}.o" for path in sources()]


def linked(objects, text, library, *flags):
    """The core as a library, with one more file in C."""
    (library.with_suffix(".c")).write_text(text, encoding="utf-8")
    more = [str(library.with_suffix(".c")), *map(str, objects), "-lm", "-Wl,-Bsymbolic", *flags]
    words = ["-std=c99", "-shared", "-fPIC", "-fvisibility=hidden", f"-I{FOLDER}", "-o", str(library)]
    subprocess.run([*system_compiler(), *words, *more], check=True)
    return library


@pytest.fixture(scope="module")
def counted(objects, tmp_path_factory):
    """The core, linked so that it counts what it allocates."""
    calls = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
    return linked(objects, COUNTED, tmp_path_factory.mktemp("counted") / "counted.so", *calls)


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


# What tests do to a body: its workspace cut short, with a mark on every number beyond.
CUT = """
#include "body.h"
#define FLEX_EXPORT __attribute__((visibility("default")))
static const double MARK = 1234.5;
FLEX_EXPORT int64_t body_room(const Body *body) { return body->scratch.work_size; }
FLEX_EXPORT void body_cut(Body *body, int64_t size, int64_t whole) {
    body->scratch.work_size = size;
    for (int64_t i = 0; i < whole; i++) body->scratch.work[i] = MARK;
}
FLEX_EXPORT int64_t body_written(const Body *body, int64_t whole) {
    int64_t count = 0;
    for (int64_t i = body->scratch.work_size; i < whole; i++) count += body->scratch.work[i] != MARK;
    return count;
}
FLEX_EXPORT int64_t taken(int64_t size, const int64_t *counts, int64_t *at) {
    double numbers[100];
    Arena arena = {numbers, 0, size, 0};
    for (int64_t i = 0; counts[i] >= 0; i++) {
        const double *place = take(&arena, counts[i]);
        at[i] = place ? place - numbers : -1;
    }
    return arena.refused;
}
"""


@pytest.fixture(scope="module")
def cutting(objects, tmp_path_factory):
    """The core with entries for tests of its work arrays."""
    found = ctypes.CDLL(str(linked(objects, CUT, tmp_path_factory.mktemp("cutting") / "cut.so")))
    declare(found)
    found.body_room.restype = found.body_written.restype = ctypes.c_int64
    found.body_room.argtypes = (ctypes.c_void_p,)
    found.body_cut.argtypes = (ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
    found.body_written.argtypes = (ctypes.c_void_p, ctypes.c_int64)
    return found


@pytest.mark.slow
def test_a_take_beyond_the_end_is_refused_and_so_are_all_that_follow(cutting):
    counts, places = np.array([6, 4, 0, 1, 2, 0, -1]), np.full(7, -2)
    at = (ctypes.c_void_p(array.ctypes.data) for array in (counts, places))
    assert cutting.taken(ctypes.c_int64(10), *at) == 1
    assert places.tolist() == [0, 6, 10, -1, -1, -1, -2]
    at = (ctypes.c_void_p(array.ctypes.data) for array in (counts, places))
    assert cutting.taken(ctypes.c_int64(13), *at) == 0


class CutCore(Core):
    """A core whose workspace can be cut."""

    def __init__(self, library, image):
        super().__init__(image)
        self._library.body_close(self._body)
        self._library, self._body = library, library.body_open(image, len(image), ctypes.byref(ctypes.c_char_p()))
        self.room = library.body_room(self._body)

    def cut(self, size):
        self._library.body_cut(self._body, size, self.room)

    def written(self):
        return self._library.body_written(self._body, self.room)


def asked(core, loads, q, v, step):
    """What each call of a body says, by name; None where it is refused for want of room."""

    def said(call):
        try:
            return call()
        except MemoryError:
            return None

    answer, end, rate, *_ = core.step(q, v, loads, step, 1.5 * loads)
    refused = answer.name == "NO_ROOM"
    # Nothing was changed.
    assert not refused or ((end == q).all() and (rate == v).all())
    found = {"step": None if refused else np.hstack([answer, end, rate])}
    answer, place, *_ = core.static(loads)
    found["static"] = None if answer.name == "NO_ROOM" else np.hstack([answer, place])
    found["motion"] = said(lambda: np.hstack(core.motion_and_rates(q, v)))
    found["energies"] = said(lambda: np.array(core.energies(q, v)))
    found["force"] = said(lambda: core.force(loads, q))
    found["tangent"] = said(lambda: core.tangent(loads, q))
    found["mass"] = said(lambda: core.mass(q))
    found["compliance"] = said(lambda: core.compliance(loads, step, q, [0]))
    margin, shape = core.stability(loads, q)
    found["stability"] = None if np.isnan(margin) else np.hstack([margin, shape])
    missed = core.missed(loads)
    found["missed"] = None if np.isnan(missed) else np.array([missed])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", fuzzed.KINDS)
def test_calls_that_lack_room_are_refused_and_write_nothing_beyond_it(kind, cutting):
    body = fuzzed.fuzzed_body(kind)
    core = CutCore(cutting, compile_program(body, body.method, body.mass))
    rng = np.random.default_rng(3)
    loads, q, v = 1e-3 * rng.standard_normal(core.loads), 1e-4 * rng.standard_normal(core.modes), np.zeros(core.modes)
    whole = asked(core, loads, q, v, 1e-4)
    assert all(answer is not None for answer in whole.values())
    refused = dict.fromkeys(whole, 0)
    sizes = [0, *np.geomspace(1, core.room, 25).astype(int), core.room - 1]
    for size in sizes:
        core.cut(int(size))
        for name, answer in asked(core, loads, q, v, 1e-4).items():
            refused[name] += answer is None
            assert answer is None or (answer == whole[name]).all(), (name, size)
        assert core.written() == 0, size
    # Without any room each is refused but what needs none; the last number is somebody's.
    assert [name for name, count in refused.items() if not count] in ([], ["missed"])
    core.cut(core.room - 1)
    assert any(answer is None for answer in asked(core, loads, q, v, 1e-4).values())


def test_the_core_calls_nothing_that_prints_or_ends_the_process():
    calls = re.compile(r"\b(v?f?printf|puts|putchar|fputs|fwrite|perror|exit|abort) ?\(|\b(stdout|stderr)\b")
    assert [path.name for path in sources() if calls.search(path.read_text(encoding="utf-8"))] == []


@pytest.fixture(scope="module")
def symbols(objects):
    """What nm lists of each of the core's files: rows of name, value, class, type, size, line, section."""
    if shutil.which("nm") is None:
        pytest.skip("nm lists what files hold")
    found = {}
    for path in objects:
        listed = subprocess.run(["nm", "-f", "sysv", str(path)], capture_output=True, text=True, check=True).stdout
        found[path.stem] = [
            [cell.strip() for cell in line.split("|")] for line in listed.splitlines() if line.count("|") == 6
        ]
    return found


@pytest.mark.slow
def test_the_only_variables_of_the_core_are_the_list_of_programs_and_whether_the_processor_has_wide_vectors(symbols):
    rows = [row for part in symbols.values() for row in part]
    found = {row[0] for row in rows if row[6] in (".data", ".bss", "*COM*") and row[3] == "OBJECT"}
    assert found == {"programs", "busy"} | ({"wide"} if platform.machine() in ("x86_64", "AMD64") else set())


@pytest.mark.slow
def test_files_of_the_core_call_those_before_them_only(symbols):
    order = core_order()
    home = {row[0]: name for name, rows in symbols.items() for row in rows if row[2] == "T"}
    wanted = {(name, home.get(row[0], name)) for name, rows in symbols.items() for row in rows if row[2] == "U"}
    assert [pair for pair in sorted(wanted) if order.index(pair[1]) > order.index(pair[0])] == []
    assert len(wanted) > 2 * len(order)


def test_a_body_at_rest_without_loads_takes_no_work_and_any_load_or_motion_moves_it():
    core = FlexibleBody(beam_body(3, modes=3)).core
    rest, none = np.zeros(core.modes), np.zeros(core.loads)
    answer, q, v, hint, work = core.step(rest, rest, none, 1e-3)
    assert not answer
    assert (hint, work) == (1, (1, 0, 0.0))
    assert not np.any([q, v])
    little = np.ones(core.loads)
    for case in (
        (rest, rest, little),
        (rest, rest, none, 1e-3, little),
        (rest, 1e-3 + rest, none),
        (1e-6 + rest, rest, none),
    ):
        moved = core.step(*case) if len(case) > 3 else core.step(*case, 1e-3)
        assert np.any([moved[1], moved[2]])


@pytest.mark.parametrize("interfaces", [[0, 0], [1], [-1]])
def test_the_compliance_of_what_is_no_interface_or_more_than_there_are_is_refused(interfaces):
    body = FlexibleBody(beam_body(3, modes=3))
    rest = body.rest()
    with pytest.raises(OptionError, match="expected different numbers from 0 to 0"):
        body.compliance(rest, np.zeros(6), 1e-3, interfaces)
    # The core looks for itself.
    with pytest.raises(MemoryError, match="workspace"):
        body.core.compliance(np.zeros(6), 1e-3, rest.q, interfaces)


def test_ctrl_c_while_an_argument_is_made_is_ctrl_c_and_another_error_stays_what_it_was():
    body = FlexibleBody(beam_body(3, modes=3))

    class Interrupted:
        size = body.core.modes

        def __array__(self, dtype=None, copy=None):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        body.core.motion(Interrupted())
    with pytest.raises(ctypes.ArgumentError):
        body.core.motion(np.full(body.core.modes, "no number"))
