"""Calls to another process travel together, and values come with the step that they are asked after."""

import ctypes
import os
import threading

import pytest

from flexfmu.core.library import library
from flexfmu.core.structures import structures
from flexfmu.fmu.foreign_host import Memory, channel

_NUMBERS = ctypes.POINTER(ctypes.c_double)
_REFERENCES = ctypes.POINTER(ctypes.c_uint)
_VALUES = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, _REFERENCES, ctypes.c_size_t, _NUMBERS)
_STEP = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
_STATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p))


class Other:
    """An FMU that keeps what it is given, on the other side of a channel: value k is 10 steps + input k."""

    def __init__(self, path, words):
        self.calls, self.given, self.steps, self.refuses = [], {}, 0, ""
        (there, to_there), (here, to_here) = os.pipe(), os.pipe()
        memory = Memory(path, words)
        self.kept = [
            memory,
            _VALUES(lambda _, r, n, v: self.did("set", dict(zip(r[:n], v[:n], strict=True)))),
            _VALUES(lambda _, r, n, v: self.did("get", {}) or self.fill(r, n, v)),
            _STEP(lambda *_: self.did("step", {})),
            _STATE(lambda *_: self.did("save", {})),
        ]
        names = ("set_real", "get_real", "do_step", "get_state")
        kinds = structures("participant", "channel")
        functions = {n: ctypes.cast(f, ctypes.c_void_p).value for n, f in zip(names, self.kept[1:], strict=True)}
        served, self.one = kinds["Participant"](**functions), kinds["Participant"]()
        ends = channel(memory, (there, to_here)), channel(memory, (here, to_there))
        self.channel = ends[1]
        library().channel_join(ctypes.byref(self.channel), ctypes.byref(self.one))
        arguments = tuple(map(ctypes.byref, (ends[0], served)))
        self.thread = threading.Thread(target=library().channel_serve, args=arguments)
        self.thread.start()

    def did(self, what, given):
        self.calls.append(what)
        self.given |= given
        self.steps += what == "step"
        return 3 if what == self.refuses else 0

    def fill(self, references, count, values):
        for k in range(count):
            values[k] = 10.0 * self.steps + self.given.get(references[k], 0.0)
        return 0

    def set(self, values):
        count = len(values)
        pair = (ctypes.c_uint * count)(*values), (ctypes.c_double * count)(*values.values())
        return _VALUES(self.one.set_real)(self.one.instance, pair[0], count, pair[1])

    def get(self, *references):
        count = len(references)
        found = (ctypes.c_double * count)()
        assert _VALUES(self.one.get_real)(self.one.instance, (ctypes.c_uint * count)(*references), count, found) == 0
        return list(found)

    def step(self):
        return _STEP(self.one.do_step)(self.one.instance, 0.0, 1.0, 1)

    def save(self):
        return _STATE(self.one.get_state)(self.one.instance, ctypes.byref(ctypes.c_void_p()))

    def trips(self):
        return self.kept[0].words[0]


@pytest.fixture
def other(request, tmp_path):
    found = Other(tmp_path / "memory", getattr(request, "param", 4096))
    yield found
    library().channel_leave(ctypes.byref(found.channel))
    found.thread.join(30.0)
    assert not found.thread.is_alive()


def test_a_step_with_inputs_and_outputs_is_one_round_trip_from_the_second_on(other):
    for k in range(1, 6):
        before = other.trips()
        assert other.set({1: 0.5 * k, 2: -1.0}) == 0
        assert other.step() == 0
        assert other.get(1, 2) == [10.0 * k + 0.5 * k, 10.0 * k - 1.0]
        assert other.get(1) == [10.0 * k + 0.5 * k]
        assert other.trips() - before == (3 if k == 1 else 1)


def test_values_after_a_set_are_those_after_it(other):
    other.get(1)
    other.step()
    assert other.get(1) == [10.0]
    other.set({1: 4.0})
    assert other.get(1) == [14.0]


def test_first_tries_of_a_step_are_asked_for_what_only_they_were_asked_for(other):
    for _ in range(2):
        other.save()
        other.step()
        other.get(1)
        other.get(1, 2, 3)
        other.step()
        other.get(1)
    other.save()
    other.calls.clear()
    other.step()
    other.step()
    assert other.calls == ["save", "step", "get", "get", "step", "get"]


@pytest.mark.parametrize("other", [64], indirect=True)
def test_calls_that_have_no_room_together_go_one_after_the_other(other):
    for k in range(20):
        assert other.set({k: float(k)}) == 0
    assert other.step() == 0
    assert [other.get(k)[0] for k in range(20)] == [10.0 + k for k in range(20)]
    assert other.step() == 0
    assert [other.get(k)[0] for k in range(20)] == [20.0 + k for k in range(20)]


def test_a_refused_call_that_travelled_with_a_step_is_told_and_the_step_not_taken(other):
    other.refuses = "set"
    other.set({1: 1.0})
    assert other.step() == 4
    assert other.channel.failed == 1
    assert other.steps == 0
    other.refuses = "step"
    assert other.step() == 3
    assert other.get(1) == [11.0]
