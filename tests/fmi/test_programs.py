"""Programs that are cut short, altered or forged: refused, or answered without a crash, a hang or nonsense."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.core_step import INTERFACES, beam
from benchmarks.fmu_size import sizes

from bodies import beam_body, body_of_everything
from flexfmu.core.interface import _HEAD, DESCRIPTION, ProgramError, aligned, fields, packed, read_image, write_image
from flexfmu.core.library import Core, library_path
from flexfmu.files.basics import OptionError
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method
from flexfmu.program.compile import compile_program, in_units, programs, with_guid
from flexfmu.program.mechanics import Draft
from program_fuzzer import places, resealed, small_programs

pytestmark = pytest.mark.slow

FUZZER = Path(__file__).parents[1] / "program_fuzzer.py"


@pytest.fixture(scope="module")
def small():
    """The smallest of programs: one mode, one frame, one interface."""
    return compile_program(beam_body(1, 1, planes="y"), Method.FRAMES)


def refusal(image):
    """Words with which a program is refused; None where it is opened."""
    try:
        Core(image)
    except OptionError as error:
        return str(error)
    return None


def test_an_image_holds_what_was_written(small):
    held = read_image(small)
    assert write_image(held.sizes, held.arrays) == small
    assert refusal(small) is None
    assert {place[1] for place in places(small, b"")} == {field.name for field in fields()}


def test_every_truncation_is_refused(small):
    for size in range(len(small)):
        assert "not a program" in refusal(small[:size])


def test_every_truncation_that_says_its_own_size_is_refused(small):
    """Size and checksum are those of what is left: what is missing is missed where it is read."""
    for size in range(_HEAD.size, len(small), 8):
        assert "shorter than it says" in refusal(resealed(small[:size]))
    assert "longer than it says" in refusal(resealed(small + bytes(8)))


def test_ten_thousand_flipped_bits_are_refused(small):
    rng, words = np.random.default_rng(11), set()
    for bit in rng.integers(0, 8 * len(small), 10**4):
        altered = bytearray(small)
        altered[bit // 8] ^= 1 << bit % 8
        words.add(refusal(bytes(altered)))
    assert None not in words
    assert any("altered" in word for word in words)


@pytest.mark.parametrize(
    ("at", "layout", "value", "words"),
    [
        (0, "<8s", b"flexprot", "no program of flexfmu"),
        (8, "<q", 99, "another version"),
        (16, "<Q", 1, "its table of fields is another"),
        (24, "<q", 2**62, "shorter than it says"),
    ],
)
def test_a_program_of_another_kind_is_refused_by_what_it_is(small, at, layout, value, words):
    altered = bytearray(small)
    struct.pack_into(layout, altered, at, value)
    assert words in refusal(bytes(altered))


def test_arrays_that_make_no_program_are_refused_by_name(small):
    held = read_image(small)
    with pytest.raises(ProgramError, match="omega has 2 elements, expected modes = 1"):
        write_image(held.sizes, held.arrays | {"omega": np.ones(2)})
    with pytest.raises(ProgramError, match="'nothing' is no field"):
        write_image(held.sizes, held.arrays | {"nothing": np.ones(2)})


@pytest.mark.parametrize("place", [2**63 - 1, -(2**63), 2**60, -(2**60), -1, 1, 10**6])
def test_an_array_that_would_lie_outside_is_refused(small, place):
    """Of some places the end comes round to the front again."""
    number = [field.name for field in fields()].index("operator_")
    altered = bytearray(small)
    struct.pack_into("<q", altered, _HEAD.size + 8 * number, place)
    words = refusal(resealed(bytes(altered)))
    # Within the image any numbers will do that make sense.
    assert place == 1 or "shorter than it says" in words


def test_curvature_that_is_not_all_there_is_refused():
    held = read_image(dict(small_programs())["held second_order constant"])
    whole = {name: held.arrays[name].copy() for name in ("curvature", "part")}
    short = {"curvature": whole["curvature"][:-4]}
    assert "curvatures are incomplete" in refusal(
        write_image(held.sizes | {"bends": held.sizes["bends"] - 4}, held.arrays | short)
    )
    bent = np.flatnonzero(whole["part"] >= 0)
    whole["part"][bent[:4]] = -1
    assert "curvatures are incomplete" in refusal(write_image(held.sizes, held.arrays | {"part": whole["part"]}))


@pytest.mark.parametrize("r", range(1, 10))
@pytest.mark.parametrize("count", [1, 4, 6])
def test_packed_matrices_hold_each_pair_once(count, r):
    matrices = np.random.default_rng(r).standard_normal((count, r, r))
    matrices += matrices.swapaxes(1, 2)
    numbers = packed(matrices)
    # Only blocks of four on the diagonal have both numbers of a pair.
    assert numbers.size == -(-count // 4) * 4 * (r * (r + 1) // 2 + 6 * (r // 4))
    assert set(np.abs(matrices).ravel()) == set(np.abs(numbers)) - ({0.0} if count % 4 else set())


def test_programs_take_arrays_from_the_first_one():
    """Each array of some size is kept once, and is read as it would be by itself."""
    model = body_of_everything(1, modes=20, frames=2, interfaces=4)
    drafts = programs(model)
    images = with_guid(drafts, "{1}")
    first = images[DESCRIPTION]
    for name, draft in drafts.items():
        alone = read_image(Draft(draft.sizes, draft.arrays | {"guid": b"{1}\0"}).image())
        found = read_image(images[name], first)
        for field, array in alone.arrays.items():
            if field != "shared":
                np.testing.assert_array_equal(found.arrays[field], array, err_msg=f"{name}: {field}")
                if array.nbytes >= 4096:
                    assert sum(image.count(aligned(array.tobytes())) for image in images.values()) == 1
    assert any("takes arrays of another body" in (refusal(image) or "") for image in images.values())


def test_what_a_program_holds_twice_is_written_once():
    """Where a method knows of no loads, all that they do is missed."""
    image = compile_program(body_of_everything(1, modes=20, frames=2, interfaces=4), Method.LINEAR)
    change, missed = (read_image(image).arrays[name].tobytes() for name in ("judge_change", "judge_missed"))
    assert change == missed
    assert image.count(change) == 1


def test_an_fmu_of_160_modes_is_at_most_six_megabytes(tmp_path, monkeypatch):
    monkeypatch.setattr(zlib, "Z_DEFAULT_COMPRESSION", -1)
    package_fmu(beam(INTERFACES, 2, modes=160), tmp_path / "beam.fmu")
    assert sizes(tmp_path / "beam.fmu")["whole"] <= 6_000_000


@pytest.mark.parametrize("largest", [1.0, -1.0, 1.0 - 2.0**-20, 2.0**-20 - 1.0, 1.0 + 2.0**-20, 0.7, 1e-300, 0.0])
def test_whole_numbers_are_within_half_a_unit_and_none_too_large_for_its_bits(largest):
    matrix = largest * np.array([[[1.0, 0.3], [0.3, -1e-5]]])
    whole, unit = in_units(matrix)
    np.testing.assert_array_equal(whole, whole.astype(np.int16))
    assert np.abs(whole * unit - matrix).max() <= 0.5 * unit
    assert unit <= abs(largest) * 2.0**-13 or largest == 0.0


def fuzzed(core, seed, count, *words, **environment):
    """How many forged programs were refused, and how many worked, in a process of its own."""
    command = [sys.executable, str(FUZZER), str(core), str(seed), str(count), *words]
    variables = os.environ | {"PYTHONPATH": str(FUZZER.parent)} | environment
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=variables)
    assert done.returncode == 0, "\n".join(done.stderr.splitlines()[-30:])
    return [int(word) for word in done.stdout.split()]


def test_a_thousand_forged_programs_are_refused_or_harmless():
    refused, worked = fuzzed(library_path(), 1, 1000)
    assert refused > 200
    assert worked > 200


def test_an_fmu_with_a_forged_program_is_refused_or_harmless():
    refused, worked = fuzzed(library_path(), 3, 1000, "fmu")
    assert min(refused, worked) > 100


@pytest.fixture(scope="module")
def checked_core(sanitized_core, gcc_library):
    """The core with sanitizers, and what has to be loaded before it."""
    # The second one for libraries in C++ that Python loads: the first looks for their exceptions when it starts.
    found = [Path(gcc_library(name)) for name in ("libasan.so", "libstdc++.so")]
    return sanitized_core, ":".join(str(runtime.resolve()) for runtime in found if runtime.is_absolute())


@pytest.mark.parametrize("count", [150, pytest.param(10**4, marks=pytest.mark.long)])
def test_forged_programs_touch_no_memory_but_their_own(checked_core, count):
    path, runtime = checked_core
    # What Python itself never gives back is no concern here. More memory than there is must be refused, not a crash.
    options = "detect_leaks=0:allocator_may_return_null=1"
    refused, worked = fuzzed(path, 2 + count, count, LD_PRELOAD=runtime, ASAN_OPTIONS=options)
    assert min(refused, worked) > count // 5
    through = fuzzed(path, 3 + count, count // 3, "fmu", LD_PRELOAD=runtime, ASAN_OPTIONS=options)
    assert min(through) > count // 30
