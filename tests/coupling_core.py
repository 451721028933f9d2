"""What the core's coupling is made of, function by function: its files compiled with names that a test may call."""

import ctypes
import subprocess
import tempfile
from ctypes import c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexfmu.core.building import FLAGS, FOLDER, system_compiler
from flexfmu.core.structures import Arrays
from flexfmu.master.loop import joined, participating, wired
from flexfmu.master.participants import Participant

FILES = ("vectors", "algebra", "joints", "acceleration", "exchange", "doubts", "participant")
# Calls with the work arrays that they need.
MORE = """
#include <stdlib.h>
#include <string.h>
#include "algebra.h"
#include "doubts.h"
static double *room(Arena *arena) {
    *arena = (Arena){calloc((size_t)arena->used + 1, 8), 0, arena->used, 0};
    return arena->start;
}
void updated(int64_t n, const double *residual, const Secants *sets, int64_t count, const double *scale,
             double relaxation, const double *slope, const int64_t *known, double *change, double *estimate) {
    Arena arena = {0};
    Update update;
    const Secants *each[2] = {sets, sets + 1};
    KnownResponse model = {(double *)slope, (int64_t *)known, 0};
    take_update(&arena, &update, n);
    double *start = room(&arena);
    take_update(&arena, &update, n);
    quasi_newton_update(&update, residual, each, count, scale, relaxation, slope ? &model : 0, change, estimate);
    free(start);
}
void asked(const Wiring *wiring, const double *signals, const double *before, int64_t what, double *out) {
    Arena arena = {0};
    Exchange exchange;
    take_exchange(&arena, wiring, &exchange);
    double *start = room(&arena);
    take_exchange(&arena, wiring, &exchange);
    if (before) {
        /* What was asked before, with dampers, changes nothing. */
        coupled_inputs(wiring, &exchange, signals, before, DAMPERS_MEAN, out);
        coupled_inputs(wiring, &exchange, signals, before, (Dampers)what, out);
    } else round_off(wiring, &exchange, signals, (int)what, out);
    free(start);
}
int64_t resolved(const Wiring *wiring, const double *signals, int64_t steps, double *out) {
    Arena arena = {0};
    Resolution resolution;
    Notice told;
    take_resolution(&arena, wiring, &resolution);
    double *start = room(&arena);
    take_resolution(&arena, wiring, &resolution);
    int64_t step = 0;
    while (step < steps && !look_at_resolution(&resolution, wiring, signals + step * wiring->signals, &told)) step++;
    free(start);
    if (step == steps) return -1;
    out[0] = (double)told.who;
    memcpy(out + 1, told.figures, sizeof told.figures);
    return step;
}
int64_t in_pieces(double *a, double *work, double *value, double *vector, int64_t n, int64_t calls, double *costs) {
    Slice counted = {.until = COUNTS}, slice = {0};
    smallest_eigen(a, work, value, vector, n, &counted);
    int64_t call = 0;
    while (call < 4 * calls && !(call && caught_up(&slice))) {
        slice.met = 0;
        slice.fresh = 1;
        slice.until = counted.whole * (double)++call / (double)calls;
        smallest_eigen(a, work, value, vector, n, &slice);
    }
    costs[0] = counted.whole;
    costs[1] = slice.spent;
    return call;
}
int64_t grown(const EnergyCount *counts, int64_t steps) {
    Growth growth;
    Notice told[2];
    int grows = 0;
    int64_t step = 0;
    begin_growth(&growth);
    for (; step < steps && !grows; step++) look_at_growth(&growth, counts + step, told, &grows);
    return grows ? step : -1;
}
"""


@dataclass
class Secants:
    """Differences (n, K) of residuals and of inputs, the newest first."""

    residuals: np.ndarray
    inputs: np.ndarray

    def before(self, older):
        """All differences of both, these first."""
        return Secants(np.hstack([self.residuals, older.residuals]), np.hstack([self.inputs, older.inputs]))


class _Rows(ctypes.Structure):
    """`Secants` of core/acceleration.h."""

    _fields_ = [("count", c_int64), ("residuals", c_void_p), ("inputs", c_void_p)]


@cache
def core():
    """The files, compiled."""
    if system_compiler() is None:
        pytest.skip("needs a C compiler")
    folder = Path(tempfile.mkdtemp(prefix="coupling-"))
    (folder / "more.c").write_text(MORE, encoding="utf-8")
    flags = [*(flag for flag in FLAGS if flag not in ("-O3", "-fvisibility=hidden")), "-O1", "-fPIC", f"-I{FOLDER}"]
    files = [folder / "more.c", *(FOLDER / f"{name}.c" for name in FILES)]
    words = [*system_compiler(), *flags, "-shared", "-o", folder / "core.so", *files, "-lm"]
    subprocess.run(list(map(str, words)), check=True)
    found = ctypes.CDLL(str(folder / "core.so"))
    found.resolved.restype = found.grown.restype = found.in_pieces.restype = c_int64
    found.joint_energy.restype = found.joint_losses.restype = found.smallest_real_part.restype = c_double
    return found


def _called(name, size, *arguments):
    """What a function writes to its last argument."""
    out = np.zeros(size)
    getattr(core(), name)(*arguments, c_void_p(out.ctypes.data))
    return out


def _at(arrays, *values):
    return [c_void_p(arrays.at(value)) for value in values]


def relative_motion(a, b):
    arrays, relative, matrix = Arrays(), np.zeros(6), np.zeros((12, 6))
    core().relative_motion(*_at(arrays, a, b), *(c_void_p(out.ctypes.data) for out in (relative, matrix)))
    return relative, matrix


def backward_rates(motion, before, step):
    arrays, rates = Arrays(), np.zeros(motion.shape)
    places = _at(arrays, motion, before)
    core().backward_rates(*places, c_double(step), c_void_p(rates.ctypes.data), c_int64(len(motion)))
    return rates


def _joints(springs, motion, arrays):
    return ctypes.byref(joined(springs, len(motion), arrays))


def loads(springs, motion, rates):
    arrays = Arrays()
    return _called("joint_loads", motion.shape, _joints(springs, motion, arrays), *_at(arrays, motion, rates))


def tangent(springs, motion, by_motion):
    arrays = Arrays()
    size = (motion.size, motion.size)
    return _called("joint_tangent", size, _joints(springs, motion, arrays), None, *_at(arrays, motion, by_motion))


def energy(springs, motion):
    arrays = Arrays()
    return core().joint_energy(_joints(springs, motion, arrays), *_at(arrays, motion))


def losses(springs, motion, before, step):
    arrays = Arrays()
    return core().joint_losses(_joints(springs, motion, arrays), *_at(arrays, motion, before), c_double(step))


def resolved(wiring, signals, step):
    """Step (from zero) at which motion (steps, signals) is told to be too fast; which end, steps a period, and lag."""
    arrays, out = Arrays(), np.zeros(3)
    place = ctypes.byref(wired(wiring, step, arrays))
    at = core().resolved(place, *_at(arrays, signals), c_int64(len(signals)), c_void_p(out.ctypes.data))
    return at, out


def grown(energies):
    """Steps after which a coupling with energies (steps, 4) created, stored, exchanged and in springs is stopped."""
    return core().grown(*_at(Arrays(), energies), c_int64(len(energies)))


def smallest_real_part(matrix):
    return core().smallest_real_part(*_at(Arrays(), matrix), c_int64(len(matrix)))


def congruent(lower, matrix):
    """L⁻¹ A L⁻ᵀ."""
    found = matrix.copy()
    core().congruent(*_at(Arrays(), lower), c_void_p(found.ctypes.data), c_int64(len(lower)), None)
    return found


def smallest_eigen(matrix, calls=0):
    """Eigenvalue and vector; of work done by so many calls also how many it took, and its cost counted and spent."""
    n = len(matrix)
    work, value, vector, costs = np.zeros(4 * n + 2), np.zeros(1), np.zeros(n), np.zeros(2)
    outs = (c_void_p(out.ctypes.data) for out in (work, value, vector))
    if not calls:
        core().smallest_eigen(*_at(Arrays(), matrix), *outs, c_int64(n), None)
        return value[0], vector
    own = c_void_p(costs.ctypes.data)
    taken = core().in_pieces(*_at(Arrays(), matrix), *outs, c_int64(n), c_int64(calls), own)
    return value[0], vector, taken, costs


def base_inputs(wiring, time, step, before=False):
    arrays = Arrays()
    place = ctypes.byref(wired(wiring, step, arrays))
    return _called("base_inputs", len(wiring.base), place, c_double(time), int(before))


def coupled_inputs(wiring, signals, before, step, dampers=0):
    arrays = Arrays()
    place = ctypes.byref(wired(wiring, step, arrays))
    return _called("asked", len(wiring.base), place, *_at(arrays, signals, before), c_int64(dampers))


def noise(wiring, signals, step, nominal=False):
    arrays = Arrays()
    place = ctypes.byref(wired(wiring, step, arrays))
    return _called("asked", len(wiring.base), place, *_at(arrays, signals), None, c_int64(nominal))


def quasi_newton_update(residual, secants, scale, relaxation, slope=None, known=None, earlier=None):
    """Change of the inputs and estimate of their error; secants of this step and of earlier ones, the newest first."""
    arrays, change, estimate = Arrays(), np.zeros(len(residual)), np.zeros(len(residual))
    sets = [secants] if earlier is None else [secants, earlier]
    rows = [_Rows(s.inputs.shape[1], *(arrays.at(v[:, ::-1].T) for v in (s.residuals, s.inputs))) for s in sets]
    model = (None, None)
    if slope is not None:
        model = (*_at(arrays, slope), c_void_p(arrays.at(known, np.int64)))
    places = _at(arrays, residual, scale)
    outs = (c_void_p(out.ctypes.data) for out in (change, estimate))
    both = (_Rows * len(rows))(*rows)
    core().updated(
        c_int64(len(residual)), places[0], both, c_int64(len(rows)), places[1], c_double(relaxation), *model, *outs
    )
    return change, estimate


class Driven:
    """The first FMU of a coupling, initialised, in the hands of the loop's functions."""

    def __init__(self, wiring):
        self._size = wiring.matrix.shape[1]
        self._one, self._arrays = Participant(wiring.roles[0], 60.0), Arrays()
        self._one.initialize(1.0)
        self._place = participating(self._one, [], self._arrays)
        self._one.join(self._place)
        self._call("begin")

    def _call(self, name, *arguments):
        answer = (c_double * 4)()
        assert getattr(core(), f"participant_{name}")(ctypes.byref(self._place), *arguments, answer) == 1

    @property
    def tried(self):
        """Internal steps that the last step took."""
        return self._place.tried

    def take(self, inputs):
        self._call("take", c_void_p(inputs.ctypes.data))

    def give(self):
        values = np.zeros(self._size)
        self._call("give", c_void_p(values.ctypes.data))
        return values.tolist()

    def step(self, time, size):
        self._call("step", c_double(time), c_double(size))

    def save(self):
        self._call("save")

    def restore(self, hold=False):
        self._call("restore", int(hold))

    def close(self):
        core().participant_forget(ctypes.byref(self._place))
        self._one.close()
