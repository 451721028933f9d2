"""Random calls of FMI 3.0 beside the same calls of FMI 2.0: statuses, words, states and values agree to the last bit.

    python fuzz_fmi3.py FMU FMU3 SEED CALLS [CORE]

FMU and FMU3 are of one body. CORE takes the place of both libraries. Prints "SLOWEST call s", "CALLS n"
and "FINE" at the end.
"""

import math
import random
import shutil
import sys
import tempfile
from ctypes import (
    CDLL,
    CFUNCTYPE,
    byref,
    c_bool,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_size_t,
    c_uint,
    c_void_p,
    create_string_buffer,
)
from pathlib import Path
from xml.etree import ElementTree

from bare_fmi2 import DISCARD, ERROR, OK, SLOWEST, Fmu
from fuzz_worker import HEAD, LOADS, NUMBERS, STEPS, TIMES, WRONG

Log = CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
TYPES = {"Real": ("Float64", c_double), "Integer": ("Int32", c_int), "Boolean": ("Boolean", c_bool)}
TYPES["String"] = ("String", c_char_p)


class Unpacked:
    """An FMU of FMI 3.0 with its library loaded."""

    def __init__(self, path, library):
        self.folder = Path(tempfile.mkdtemp(prefix="fmu-"))
        shutil.unpack_archive(path, self.folder, "zip")
        self.root = ElementTree.parse(self.folder / "modelDescription.xml").getroot()
        (own,) = (self.folder / "binaries").glob("*/*")
        if library:
            shutil.copyfile(library, own)
        self.library = CDLL(str(own))


class Three:
    """An instance of FMI 3.0; arrays are given by the references of their numbers in FMI 2.0."""

    def __init__(self, fmu, early=False):
        self.folder, root, self.library, self.log = fmu.folder, fmu.root, fmu.library, []
        self.variables = list(root.find("ModelVariables"))
        self.write = Log(lambda _, status, __, text: self.log.append((status, text.decode(errors="replace"))))
        self.library.fmi3InstantiateCoSimulation.restype = c_void_p
        words = b"case", root.get("instantiationToken").encode(), str(self.folder / "resources").encode()
        flags = c_bool(False), c_bool(True), c_bool(False), c_bool(early), None, c_size_t(0), None, self.write, None
        self.component = c_void_p(self.library.fmi3InstantiateCoSimulation(*words, *flags))
        assert self.component.value, self.log

    def close(self):
        self.call("FreeInstance")

    def call(self, name, *arguments):
        return SLOWEST.timed(name, getattr(self.library, f"fmi3{name}"), self.component, *arguments)

    def given(self, references, values, kind="Real", more=0):
        name, ctype = TYPES[kind]
        count = c_size_t(len(references))
        block = (ctype * (len(values) + max(more, 0)))(*values)
        return self.call(
            f"Set{name}", (c_uint * len(references))(*references), count, block, c_size_t(len(values) + more)
        )

    def got(self, references, size, kind="Real"):
        name, ctype = TYPES[kind]
        block = (ctype * size)()
        arguments = (c_uint * len(references))(*references), c_size_t(len(references)), block, c_size_t(size)
        return self.call(f"Get{name}", *arguments), list(block)

    def bytes(self):
        state, size = c_void_p(), c_size_t()
        assert self.call("GetFMUState", byref(state)) == OK
        assert self.call("SerializedFMUStateSize", state, byref(size)) == OK
        block = create_string_buffer(size.value)
        assert self.call("SerializeFMUState", state, block, size) == OK
        assert self.call("FreeFMUState", byref(state)) == OK
        assert state.value is None
        return block.raw

    def set_bytes(self, block):
        state = c_void_p()
        data = (c_char * len(block)).from_buffer_copy(block) if block else None
        status = self.call("DeserializeFMUState", data, c_size_t(len(block)), byref(state))
        if status == OK:
            status = self.call("SetFMUState", state)
            self.call("FreeFMUState", byref(state))
        return status


class Pair:
    """One body in both versions."""

    def __init__(self, fmu, fmu_3, seed):
        self.random, self.fmu, self.three, self.eager = random.Random(seed), fmu, Three(fmu_3), Three(fmu_3, early=True)
        self.two, self.reached, self.saved = self.fmu.instantiate("case"), 0.0, []
        self.arrays = {int(v.get("valueReference")): v for v in self.three.variables}
        self.wide = {n: 3 if v.find("Dimension") is not None else 1 for n, v in self.arrays.items()}
        self.inputs = [n for n, v in self.arrays.items() if v.get("causality") == "input"]
        kinds = "output", "local"
        self.outputs = [n for n, v in self.arrays.items() if v.get("causality") in kinds and v.tag == "Float64"]
        self.motion = [
            n for n, v in self.arrays.items() if v.get("name").endswith((".displacement", ".rotation"))
            and self.wide[n] == 3
        ]  # fmt: skip
        self.parameters = [n for n, v in self.arrays.items() if v.get("causality") == "parameter"]
        self.time = len(self.fmu.variables)
        self.calls = [getattr(self, name) for name, weight in WEIGHTS.items() for _ in range(weight)]

    def numbers(self, references):
        """References of FMI 2.0."""
        return [n + k for n in references for k in range(self.wide[n])]

    def play(self, call):
        """One call, and what holds after every one."""
        before = self.three.bytes()
        self.fmu.log.clear()
        self.three.log.clear()
        two, three = call()
        assert repr(two) == repr(three), (call.__name__, two, three, self.fmu.log, self.three.log)
        here, there = str(self.fmu.folder), str(self.three.folder)
        words = [(status, text.replace("%%", "%").replace(here, there)) for status, _, text in self.fmu.log]
        assert [status for status, _ in words] == [status for status, _ in self.three.log] or call == self.strange
        for (_, one), (_, other) in zip(words, self.three.log, strict=False):
            assert one == other or "fmi2" in one, (one, other)
            assert "fmi2" not in other
        assert self.two.bytes()[HEAD:] == self.three.bytes()[HEAD:], call.__name__
        if call == self.strange:
            assert self.three.bytes() == before
        numbers = self.numbers(self.outputs)
        status, values = self.two.get_real(numbers)
        found, others = self.three.got(self.outputs, len(numbers))
        assert status == found
        assert status != OK or repr(values) == repr(others), call.__name__

    def some(self, of, most=3):
        return self.random.sample(of, self.random.randrange(1, min(most, len(of)) + 1))

    def begin(self):
        start, stop = self.random.choice(TIMES), self.random.choice([None, None, 0.5, *TIMES])
        tolerance = self.random.choice([None, None, 1e-4, -1.0])
        status = self.two.setup(start, stop, tolerance)
        status = self.two.enter() if status == OK else status
        given = c_bool(tolerance is not None), c_double(tolerance or 0.0), c_double(start)
        given += c_bool(stop is not None), c_double(stop or 0.0)
        # A stop time is no part of the state.
        assert self.eager.set_bytes(self.three.bytes()) == OK
        self.eager.call("EnterInitializationMode", *given)
        other = self.three.call("EnterInitializationMode", *given)
        self.reached = start if status == OK else self.reached
        return status, other

    def exit(self):
        return self.two.exit(), self.three.call("ExitInitializationMode")

    def terminate(self):
        return self.two.terminate(), self.three.call("Terminate")

    def reset(self):
        # Nor is whether it was set up.
        self.eager.call("Reset")
        return self.two.reset(), self.three.call("Reset")

    def ahead(self, before, time, size, status):
        """The same step where the master allows early return: whole, in part, or refused."""
        assert self.eager.set_bytes(before) == OK
        flags, last = [c_bool(True) for _ in range(3)], c_double(-7.0)
        found = self.eager.call("DoStep", c_double(time), c_double(size), c_bool(True), *map(byref, flags), byref(last))
        events, terminate, early = (flag.value for flag in flags)
        if last.value == -7.0:
            assert found == status == ERROR
            return
        assert not events
        assert not terminate
        if status != DISCARD:
            assert (found, early) == (status, False), self.eager.log[-1:]
            assert self.eager.bytes() == self.three.bytes()
        elif early:
            assert found == OK
            assert time <= last.value <= time + 0.51 * size + 1e-15 * abs(time)
        else:
            # Where no part is taken either, the state is as before, but for the status.
            assert found in (DISCARD, ERROR)
            assert self.eager.bytes()[HEAD:] == self.three.bytes()[HEAD:], (found, self.eager.log[-1:])

    def step(self):
        size, time = self.random.choice(STEPS), self.random.choice([*[self.reached] * 20, *TIMES])
        before = self.three.bytes()
        status = self.two.step(time, size)
        flags, last = [c_bool(True) for _ in range(3)], c_double(-7.0)
        other = self.three.call("DoStep", c_double(time), c_double(size), c_bool(True), *map(byref, flags), byref(last))
        assert last.value == -7.0 or not any(flag.value for flag in flags)
        self.ahead(before, time, size, other)
        if status <= DISCARD:
            # A refused step leaves the time where it was.
            assert (OK, [last.value]) == self.three.got([self.time], 1)
            self.reached = last.value
        return status, other

    def load(self):
        chosen = self.some(self.inputs)
        values = [self.random.choice(LOADS[:10] if self.random.random() < 0.8 else LOADS + WRONG) for _ in 3 * chosen]
        return self.two.set_real(self.numbers(chosen), values), self.three.given(chosen, values)

    def parameter(self):
        which = self.random.choice(self.parameters)
        kind = next(kind for kind, (name, _) in TYPES.items() if name == self.arrays[which].tag)
        texts = ["linear", "second_order", "frames", "static", "ramp", "terminate", "discard", "%s", "ä"]
        value = {"String": self.random.choice(texts), "Boolean": True}.get(kind, self.random.choice(NUMBERS))
        given = [value.encode() if kind == "String" else value]
        return getattr(self.two, f"set_{kind.lower()}")([which], [value]), self.three.given([which], given, kind)

    def texts(self):
        which = [n for n in self.parameters if self.arrays[n].tag == "String"]
        status, values = self.two.get_string(which)
        other, found = self.three.got(which, len(which), "String")
        return (status, values), (other, [text.decode() if text is not None else None for text in found])

    def derivative(self):
        """Both kinds: an adjoint one is a sum of directional ones, one for each number."""
        unknown, known = self.some(self.motion), self.some([*self.inputs, *self.inputs, *self.motion[:1]])
        rows, columns = self.numbers(unknown), self.numbers(known)
        sizes = self.random.choice([(len(rows), len(columns))] * 4 + [(len(rows) + 1, len(columns))])
        counts = c_size_t(len(unknown)), c_size_t(len(known))
        lists = (c_uint * len(unknown))(*unknown), (c_uint * len(known))(*known)
        seed, weight = ([self.random.uniform(-2.0, 2.0) for _ in range(n)] for n in (sizes[1], sizes[0]))
        forward, backward = (c_double * sizes[0])(), (c_double * sizes[1])()
        head = lists[0], counts[0], lists[1], counts[1]
        status = self.three.call(
            "GetDirectionalDerivative",
            *head,
            (c_double * sizes[1])(*seed),
            c_size_t(sizes[1]),
            forward,
            c_size_t(sizes[0]),
        )
        if sizes[0] != len(rows):
            self.three.log.clear()
            assert status == ERROR
            return OK, OK
        expected = self.directional(rows, columns, seed)
        assert status == expected[0]
        assert status != OK or list(forward) == expected[1]
        adjoint = self.three.call(
            "GetAdjointDerivative",
            *head,
            (c_double * sizes[0])(*weight),
            c_size_t(sizes[0]),
            backward,
            c_size_t(sizes[1]),
        )
        parts = [self.directional(rows, [number], [1.0]) for number in columns]
        self.fmu.log.clear()
        self.three.log.clear()
        worst = max(part[0] for part in parts)
        assert adjoint == worst
        if worst == OK:
            sums = [sum(w * one for w, one in zip(weight, part[1], strict=True)) for part in parts]
            assert all(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-300) for a, b in zip(backward, sums, strict=True))
        return OK, OK

    def directional(self, rows, columns, seed):
        result = (c_double * len(rows))()
        lists = (
            (c_uint * len(rows))(*rows),
            c_size_t(len(rows)),
            (c_uint * len(columns))(*columns),
            c_size_t(len(columns)),
        )
        return self.two._call("GetDirectionalDerivative", *lists, (c_double * len(seed))(*seed), result), list(result)

    def save(self):
        self.saved.append((self.two.bytes(), self.three.bytes(), self.reached))
        return OK, OK

    def restore(self):
        if not self.saved:
            return OK, OK
        two, three, reached = self.random.choice(self.saved)
        if self.random.random() < 0.2:
            # A place in the numbers, which are alike in both.
            place, byte = self.random.randrange(HEAD, len(two)), self.random.randrange(1, 256)
            two, three = (b[:place] + bytes([b[place] ^ byte]) + b[place + 1 :] for b in (two, three))
        else:
            self.reached = reached
        return self.two.set_bytes(two), self.three.set_bytes(three)

    def strange(self):
        """What FMI 2.0 has not: refused with a word, and nothing has changed."""
        three, which = self.three, self.random.choice(self.inputs)
        one, real, count = (c_uint * 1)(which), (c_double * 3)(), c_size_t(1)
        calls = [
            lambda: three.given([which], [1.0, 2.0, 3.0], more=self.random.choice([-3, -1, 1, 5])),
            lambda: three.given([which + 1], [1.0, 2.0, 3.0]),
            lambda: three.given([which, self.outputs[0]], 6 * [1.0]),
            lambda: three.given([self.time], [1.0]),
            lambda: three.given([self.random.choice([self.time + 1, 2**31, 2**32 - 1])], [1.0]),
            lambda: three.call("SetFloat64", None, count, None, c_size_t(3)),
            lambda: three.call("GetFloat64", one, count, None, c_size_t(3)),
            lambda: three.call("GetFloat64", one, count, real, c_size_t(2)),
            lambda: three.call("SetBoolean", None, count, None, count),
            lambda: three.call("GetInt64", one, count, (c_int64 * 1)(), count),
            lambda: three.call("GetOutputDerivatives", one, count, (c_int * 1)(1), real, c_size_t(3)),
            lambda: three.call("EnterEventMode"),
            lambda: three.call("EnterConfigurationMode"),
            lambda: three.call("DoStep", c_double(self.reached), c_double(1e-3), c_bool(True), None, None, None, None),
            lambda: three.call("GetAdjointDerivative", one, count, None, count, real, c_size_t(3), None, c_size_t(3)),
            lambda: three.set_bytes(b"\0" * 500),
        ]
        status = self.random.choice(calls)()
        assert (
            three.library.fmi3DoStep(None, c_double(0.0), c_double(1.0), c_bool(True), None, None, None, None) == ERROR
        )
        assert three.log
        return ERROR, status


WEIGHTS = {
    "begin": 3,
    "exit": 3,
    "terminate": 1,
    "reset": 2,
    "step": 12,
    "load": 6,
    "parameter": 3,
    "texts": 1,
    "derivative": 3,
    "save": 2,
    "restore": 2,
    "strange": 4,
}


def main(path, path_3, seed, calls, library=None):
    played, fmu, fmu_3 = 0, Fmu(path, library), Unpacked(path_3, library)
    while played < int(calls):
        pair = Pair(fmu, fmu_3, f"{seed} {played}")
        for call in (pair.begin, pair.exit) if pair.random.random() < 0.7 else ():
            pair.play(call)
        for _ in range(60):
            pair.play(pair.random.choice(pair.calls))
        played += 60
        for one in (pair.three, pair.eager):
            one.close()
        pair.two.free()
    fmu.remove()
    shutil.rmtree(fmu_3.folder, ignore_errors=True)
    print("SLOWEST", SLOWEST.name, SLOWEST.seconds)
    print("CALLS", played)
    print("FINE")


if __name__ == "__main__":
    main(*sys.argv[1:])
