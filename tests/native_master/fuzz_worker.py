"""Random sequences of FMI calls against a small model of what each must answer.

    python fuzz_worker.py FMU TWIN SEED CALLS [--library CORE] [--refused 4] [--case N]

FMU is an archive of either export, TWIN another body's with states of the same size. CORE takes the place of the
library in the archive: one that was compiled with sanitizers. Calls that are refused return 3 (fmi2Error) from the
native export and 4 from pythonfmu's library. Prints "SLOWEST call s", "CALLS n" and "FINE" at the end; the case that is
under way stands beside the archive in SEED.txt and can be run again by --case.
"""

import argparse
import faulthandler
import math
import os
import random
import re
import sys
from collections import Counter
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint
from pathlib import Path

from bare_fmi2 import DISCARD, ERROR, OK, SLOWEST, WARNING, Fmu

INSTANTIATED, INITIALIZING, STEPPING, STEP_FAILED, TERMINATED, FAILED = range(6)
READABLE = (INITIALIZING, STEPPING, STEP_FAILED, TERMINATED, FAILED)
SETTABLE = (INSTANTIATED, INITIALIZING, STEPPING, STEP_FAILED)
FIXABLE = (INSTANTIATED, INITIALIZING)
RUNNING = (STEPPING, STEP_FAILED)
AFTER_START = (STEPPING, STEP_FAILED, TERMINATED, FAILED)
CALM_LOAD, CALM_STEP = 2.0, 1e-2
LOADS = [
    0.0,
    -0.0,
    1.0,
    -2.0,
    0.3,
    1.5,
    -0.7,
    2.0,
    1e-3,
    5e-324,
    1e6,
    1e12,
    -1e60,
    1e160,
    1e300,
    -1.7976931348623157e308,
]
WRONG = [math.nan, math.inf, -math.inf]
STEPS = [1e-3, 1e-3, 1e-3, 1e-4, 1e-2, 5e-3, 0.1, 0.0, 1e-12, 5e-324, 1.0, 1e300, -1e-3, *WRONG]
TIMES = [0.0, 0.0, 0.0, 0.5, -1.0, 1e300, *WRONG]
NUMBERS = [1.0, 1.0, 0.0, 0.5, 1e-3, 1e-6, 5e-324, 3.0, -1.0, 1e300, *WRONG]
CATEGORIES = ["logAll", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "nonsense", ""]
# Heads before a state's numbers, bytes; of the export for Python the same.
HEAD = 64
# So that a fault shows near the calls that led to it.
CALLS_PER_CASE = 40


class Body:
    """What is known of an FMU from its description."""

    def __init__(self, path, twin, library, refused):
        self.fmu, self.refused = Fmu(path, library), refused
        self.native = refused == ERROR
        fmu = self.fmu
        self.inputs = fmu.references("Real", "input")
        self.outputs = fmu.references("Real", "output") + fmu.references("Real", "local")
        self.motion = [n for name, n in fmu.reference.items() if re.search(r"\.(displacement|rotation)\.[xyz]$", name)]
        self.positive = [
            n for name, n in fmu.reference.items() if name.endswith(("von_mises", "strain_energy", "kinetic_energy"))
        ]
        parameters = [v for v in fmu.variables if v.get("causality") == "parameter"]
        self.numbers = {
            int(v.get("valueReference")): float(v[0].get("start")) for v in parameters if v[0].tag == "Real"
        }
        self.least = {int(v.get("valueReference")): float(v[0].get("min")) for v in parameters if v[0].tag == "Real"}
        self.tunable = {int(v.get("valueReference")) for v in parameters if v.get("variability") == "tunable"}
        self.texts = {int(v.get("valueReference")): v[0].get("start") for v in parameters if v[0].tag == "String"}
        self.flags = {int(v.get("valueReference")): False for v in parameters if v[0].tag == "Boolean"}
        # The description ends with what is offered.
        self.offered = {
            int(v.get("valueReference")): re.findall(r'"([^"]*)"', v.get("description"))
            for v in parameters
            if v[0].tag == "String"
        }
        self.type = {int(v.get("valueReference")): v[0].tag for v in fmu.variables}
        self.settable = {*self.inputs, *self.numbers, *self.texts, *self.flags}
        self.status = fmu.reference["status.code"]
        self.limit_actions = [n for name, n in fmu.reference.items() if name.endswith(".on_limit")]
        one = fmu.instantiate("first")
        self.fresh = one.bytes()
        one.start()
        before = one.bytes()
        one.step(0.0, -1.0)
        places = [k for k, (a, b) in enumerate(zip(before, one.bytes(), strict=True)) if a != b and k >= HEAD]
        self.slot = places[0] // 8 * 8
        assert places[-1] < self.slot + 8
        one.free()
        stranger = Fmu(twin, library).instantiate("stranger")
        self.foreign = stranger.bytes()
        fmu.log.clear()

    def numbers_of(self, block):
        """A state without heads and status code."""
        return block[HEAD : self.slot] + block[self.slot + 8 :]


def same(one, other, step):
    """Whether two times are the same but for round-off."""
    return abs(one - other) <= 1e-6 * step + 1e-12 * max(abs(one), abs(other))


class Expected:
    """What an instance must answer."""

    def __init__(self, body):
        self.phase, self.calm, self.extreme = INSTANTIATED, True, False
        self.inputs = dict.fromkeys(body.inputs, 0.0)
        self.rates, self.time = False, 0.0
        self.numbers, self.texts, self.flags = dict(body.numbers), dict(body.texts), dict(body.flags)

    def copy(self):
        other = object.__new__(Expected)
        other.__dict__ = {k: dict(v) if isinstance(v, dict) else v for k, v in self.__dict__.items()}
        return other

    def sure(self, body):
        """Whether a start and calm steps must succeed: nothing is set that could refuse them."""
        return (
            (self.numbers, self.texts, self.flags) == (body.numbers, body.texts, body.flags)
            and all(abs(value) <= CALM_LOAD for value in self.inputs.values())
            and self.calm
            and not self.rates
        )

    def wrong(self, body):
        """Whether a parameter is out of range, so that no start can succeed."""
        return any(not (math.isfinite(v) and v >= body.least[n]) for n, v in self.numbers.items())


class Player:
    """Two instances of a body, and random calls of either."""

    def __init__(self, body, seed, counts):
        self.body, self.random, self.counts = body, random.Random(seed), counts
        self.pair = [body.fmu.instantiate(f"case_{k}") for k in range(2)]
        assert all(self.pair)
        self.expected = [Expected(body) for _ in self.pair]
        self.logging = [True, True]
        # Of the experiment, which is no part of a state: whether it is set up, and where it ends.
        self.experiment = [(False, math.inf)] * 2
        self.saved = []
        self.calls = [getattr(self, name) for name, weight in WEIGHTS.items() for _ in range(weight)]
        if self.random.random() < 0.6:
            for self.which in (0, 1):
                if self.random.random() < 0.5:
                    self.play(self.text)
                for call in (self.setup, self.enter, self.exit):
                    self.play(call)

    def close(self):
        for _, state, _ in self.saved:
            assert self.pair[0].free_state(state) == OK
        for instance in self.pair:
            instance.free()

    def run(self, count):
        for _ in range(count):
            self.which = self.random.randrange(2)
            self.play(self.random.choice(self.calls))

    def play(self, call):
        """One call, and what holds after every one."""
        body, which = self.body, self.which
        self.one, self.know = self.pair[which], self.expected[which]
        self.counts[call.__name__] += 1
        before, lines, phase = self.one.bytes(), len(body.fmu.log), self.know.phase
        status = call()
        self.know = self.expected[which]
        told = [line for line in body.fmu.log[lines:] if line[0] >= DISCARD]
        assert all(line[2].strip() for line in told)
        if call not in (self.many, self.replay):
            assert bool(told) == (status >= DISCARD and self.logging[which]), (call.__name__, status, told)
        after = self.one.bytes()
        if status >= DISCARD and call != self.exit:
            same = (
                body.numbers_of(after) == body.numbers_of(before) if phase in RUNNING else after[HEAD:] == before[HEAD:]
            )
            assert same or call == self.get_values, f"{call.__name__}: a refused call has changed the state"
        if self.know.phase in READABLE:
            self.look()
        body.fmu.log.clear()

    def look(self):
        """Values read back are those set; outputs are finite, and make sense."""
        body, know, one = self.body, self.know, self.one
        given = {**know.inputs, **know.numbers}
        status, values = one.get_real(list(given))
        assert status == OK
        for value, (number, expected) in zip(values, given.items(), strict=True):
            free = know.rates and number in know.inputs
            assert free or value == expected or value != value, (number, value, expected)
        assert one.get_string(list(know.texts)) == (OK, list(know.texts.values()))
        if know.flags:
            assert one.get_boolean(list(know.flags)) == (OK, [int(flag) for flag in know.flags.values()])
        status, (code,) = one.get_integer([body.status])
        assert status == OK
        assert code in (0, 1, 2)
        # The motion can always be asked for. What else is found may be beyond all numbers under loads beyond reason.
        know.extreme |= any(not abs(value) < 1e7 for value in know.inputs.values()) or know.rates
        status, values = one.get_real(body.motion)
        assert status == OK or know.phase in (INITIALIZING, FAILED), body.fmu.log
        assert status != OK or all(map(math.isfinite, values)), values
        status, values = one.get_real(body.outputs)
        assert status == OK or know.phase in (INITIALIZING, FAILED) or know.extreme, body.fmu.log
        if status == OK:
            assert all(map(math.isfinite, values)), [
                (name, values[body.outputs.index(n)])
                for name, n in body.fmu.reference.items()
                if n in body.outputs and not math.isfinite(values[body.outputs.index(n)])
            ]
            assert all(values[body.outputs.index(n)] >= 0.0 for n in body.positive)

    def expect(self, allowed, status):
        assert status in allowed, (
            f"status {status}, expected one of {sorted(allowed)}, in phase {self.know.phase}; {self.body.fmu.log[-3:]}"
        )
        return status

    def refused_unless(self, allowed, status):
        """OK where a call is allowed, else refused."""
        return self.expect({OK} if allowed else {self.body.refused}, status)

    # Life cycle.

    def setup(self):
        start, stop = self.random.choice(TIMES), self.random.choice([None, *TIMES])
        tolerance = self.random.choice([None, 1e-4]) if not self.body.native else self.random.choice([None, *NUMBERS])
        fine = math.isfinite(start) and (stop is None or stop >= start) and (tolerance is None or tolerance > 0.0)
        if not self.body.native:
            # The library drops what is not given by zeros.
            start, stop, fine = 0.0, None, True
        fine = fine and self.know.phase == INSTANTIATED
        if fine:
            self.know.time = start
            self.experiment[self.which] = True, math.inf if stop is None else stop
        return self.refused_unless(fine, self.one.setup(start, stop, tolerance))

    def enter(self):
        ready = self.know.phase == INSTANTIATED and self.experiment[self.which][0]
        status = self.refused_unless(ready, self.one.enter())
        if status == OK:
            self.know.phase = INITIALIZING
        return status

    def exit(self):
        know, status = self.know, self.one.exit()
        if know.phase != INITIALIZING:
            return self.expect({self.body.refused}, status)
        sure = know.sure(self.body)
        self.expect({OK} if sure else {self.body.refused} if know.wrong(self.body) else {OK, self.body.refused}, status)
        know.phase = STEPPING if status == OK else FAILED
        return status

    def terminate(self):
        status = self.refused_unless(self.know.phase in RUNNING, self.one.terminate())
        if status == OK:
            self.know.phase = TERMINATED
        return status

    def reset(self):
        status = self.expect({OK}, self.one.reset())
        self.expected[self.which] = Expected(self.body)
        self.experiment[self.which] = False, math.inf
        assert self.one.bytes() == self.body.fresh
        return status

    def step(self):
        know, body, size = self.know, self.body, self.random.choice(STEPS)
        time = self.random.choice([*[know.time] * 20, *TIMES])
        status = self.one.step(time, size)
        if know.phase not in RUNNING:
            return self.expect({body.refused}, status)
        numbers, stop = math.isfinite(size) and size >= 0.0 and math.isfinite(time), self.experiment[self.which][1]
        if numbers and (not same(time, know.time, size) or (time + size > stop and not same(time + size, stop, size))):
            return self.expect({body.refused}, status)
        fine = numbers and math.isfinite(time + size)
        sure = fine and size <= CALM_STEP and know.sure(body)
        may_end = any(know.texts[n] == "terminate" for n in body.limit_actions)
        self.expect(
            {OK} if sure else {OK, DISCARD, *([body.refused] if may_end else [])} if fine else {DISCARD}, status
        )
        know.phase = {OK: STEPPING, DISCARD: STEP_FAILED}.get(status, FAILED)
        if status == OK:
            know.calm = know.sure(body) and size <= CALM_STEP
            know.time = time + size if size > 0.0 else know.time
        return status

    def many(self):
        """Steps under calm loads, one after another."""
        if self.know.phase not in RUNNING:
            return OK
        self.one.set_real(self.body.inputs, [0.0] * len(self.body.inputs))
        # Rates that were given wait for a step, which the inputs grow over.
        self.know.inputs = dict.fromkeys(self.body.inputs, 0.0)
        for _ in range(5):
            end = self.know.time + 1e-3
            if end > self.experiment[self.which][1]:
                break
            status = self.one.step(self.know.time, 1e-3)
            self.know.phase = {OK: STEPPING, DISCARD: STEP_FAILED}.get(status, FAILED)
            if status > DISCARD:
                break
            self.know.time = end if status == OK else self.know.time
        return OK

    # Values.

    def set_inputs(self):
        numbers = self.random.sample(self.body.inputs, min(3, len(self.body.inputs)))
        loads = LOADS[:10] if self.random.random() < 0.8 else LOADS + WRONG
        values = [self.random.choice(loads) for _ in numbers]
        status = self.refused_unless(self.know.phase in SETTABLE, self.one.set_real(numbers, values))
        if status == OK:
            self.know.inputs.update(zip(numbers, values, strict=True))
        return status

    def put(self, values, kept, set_call):
        """Set a parameter, which after the start keeps its value with a warning."""
        know = self.know
        status = set_call(list(values), list(values.values()))
        if know.phase in FIXABLE or (know.phase in SETTABLE and set(values) <= self.body.tunable):
            kept.update(values)
            return self.expect({OK}, status)
        if know.phase in SETTABLE:
            # pythonfmu's library hands on no warnings.
            return self.expect({WARNING} if self.body.native else {OK}, status)
        return self.expect({self.body.refused}, status)

    def number(self):
        which = self.random.choice(list(self.body.numbers))
        return self.put({which: self.random.choice(NUMBERS)}, self.know.numbers, self.one.set_real)

    def text(self):
        which = self.random.choice(list(self.body.texts))
        value = self.random.choice([*self.body.offered[which] * 4, "", "magic", "100% sure", "ä" * 500, "%s%n"])
        if value in self.body.offered[which]:
            return self.put({which: value}, self.know.texts, self.one.set_string)
        return self.expect({self.body.refused}, self.one.set_string([which], [value]))

    def flag(self):
        if not self.body.flags:
            return OK
        which = self.random.choice(list(self.body.flags))
        return self.put({which: self.random.random() < 0.5}, self.know.flags, self.one.set_boolean)

    def any_reference(self):
        beyond = [len(self.body.type), 9999, 2**31 - 1, *([2**31, 2**32 - 1] if self.body.native else [])]
        return self.random.choice([*self.body.type, *beyond])

    def wrong_set(self):
        """No such variable, another type, or one that cannot be set; also behind one that can."""
        kind, which = self.random.choice(["Real", "Integer", "Boolean", "String"]), self.any_reference()
        if which in self.body.settable and self.body.type[which] == kind:
            return OK
        numbers, values = [which], ["x" if kind == "String" else 1]
        if self.random.random() < 0.5 and kind == "Real":
            numbers, values = [self.body.inputs[0], which], [7.5, 1.0]
        return self.expect({self.body.refused}, getattr(self.one, f"set_{kind.lower()}")(numbers, values))

    def wrong_get(self):
        kind, which = self.random.choice(["Real", "Integer", "Boolean", "String"]), self.any_reference()
        if self.body.type.get(which) == kind:
            return OK
        return self.expect({self.body.refused}, getattr(self.one, f"get_{kind.lower()}")([which])[0])

    def get_values(self):
        """Before initialisation nothing can be read; in it what follows from wrong parameters cannot."""
        status, _ = self.one.get_real([self.random.choice(self.body.motion)])
        fine = {OK, self.body.refused} if self.know.phase in (INITIALIZING, FAILED) else {OK}
        return self.expect(fine if self.know.phase in READABLE else {self.body.refused}, status)

    def nothing(self):
        """No values at all."""
        fine = self.know.phase in READABLE
        return self.refused_unless(fine, self.one.get_real([])[0])

    def no_arrays(self):
        """Null pointers where arrays are due, and calls without an instance."""
        if not self.body.native:
            return OK
        library, one = self.body.fmu.library, (c_uint * 1)(0)
        name = self.random.choice(["SetReal", "GetReal", "SetString", "GetString", "SetInteger", "GetBoolean"])
        assert getattr(library, f"fmi2{name}")(None, one, c_size_t(1), None) == ERROR
        assert library.fmi2DoStep(None, c_double(0.0), c_double(1.0), 0) == ERROR
        return self.expect(
            {ERROR}, self.one._call(name, *self.random.choice([(None, c_size_t(1), None), (one, c_size_t(1), None)]))
        )

    def derivatives(self):
        """Derivatives of inputs."""
        if not self.body.native:
            return OK
        which, order = self.any_reference(), self.random.choice([1, 1, 1, 0, 2, -1])
        which = self.random.choice([which, *self.body.inputs])
        rate = self.random.choice([1.0, -20.0, 0.0, 1e308, math.nan])
        status = self.one._call(
            "SetRealInputDerivatives", (c_uint * 1)(which), c_size_t(1), (c_int * 1)(order), (c_double * 1)(rate)
        )
        fine = which in self.body.inputs and order == 1 and self.know.phase in SETTABLE
        if fine:
            self.know.rates = True
        return self.refused_unless(fine, status)

    def directional(self):
        """Derivatives of outputs by inputs."""
        if not self.body.native:
            return OK
        unknown = [self.random.choice([*self.body.motion * 3, self.any_reference()]) for _ in range(2)]
        known = [self.random.choice([*self.body.inputs * 3, self.any_reference()]) for _ in range(2)]
        result = (c_double * 2)()
        status = self.one._call(
            "GetDirectionalDerivative", (c_uint * 2)(*unknown), c_size_t(2), (c_uint * 2)(*known), c_size_t(2),
            (c_double * 2)(1.0, -0.5), result,
        )  # fmt: skip
        fine = (
            set(unknown) <= set(self.body.motion)
            and set(known) <= set(self.body.inputs)
            and self.know.phase in READABLE
        )
        assert status != OK or all(map(math.isfinite, result)), list(result)
        if fine and (self.know.phase in (INITIALIZING, FAILED) or self.know.extreme):
            return self.expect({OK, ERROR}, status)
        return self.refused_unless(fine, status)

    def statuses(self):
        """What can be asked about steps."""
        if not self.body.native:
            return OK
        kind, name = self.random.randrange(-1, 6), self.random.choice(["", "Real", "Integer", "Boolean", "String"])
        place = {"": c_int(), "Real": c_double(), "Integer": c_int(), "Boolean": c_int(), "String": c_char_p()}[name]
        status = self.one._call(f"Get{name}Status", kind, byref(place))
        offered = {"": 0, "Real": 2, "Boolean": 3, "String": 1}.get(name) == kind
        return self.expect({ERROR} if self.know.phase not in AFTER_START else {OK} if offered else {DISCARD}, status)

    def cancel(self):
        return (
            self.expect({ERROR, DISCARD} if not self.body.native else {ERROR}, self.one._call("CancelStep"))
            if self.body.native
            else OK
        )

    def log(self):
        """Switch categories; all come back, so that lines can be counted."""
        if not self.body.native:
            return OK
        chosen = [self.random.choice(CATEGORIES) for _ in range(self.random.randrange(3))]
        fine = all(name.startswith("log") for name in chosen)
        status = self.one.logging(True, chosen)
        if fine:
            assert self.one.logging(True) == OK
        return self.refused_unless(fine, status)

    # States.

    def save(self):
        status, state = self.one.get_state()
        self.saved.append((self.one.serialize(state)[1], state, self.know.copy()))
        return self.expect({OK}, status)

    def restore(self):
        """A state of this instance or of the other."""
        if not self.saved:
            return OK
        block, state, know = self.random.choice(self.saved)
        status = self.one.set_bytes(block) if self.random.random() < 0.5 else self.one.set_state(state)
        self.expected[self.which] = know.copy()
        assert self.one.bytes() == block
        return self.expect({OK}, status)

    def foreign(self):
        return self.expect({self.body.refused}, self.one.set_bytes(self.body.foreign))

    def damaged(self):
        block = self.random.choice(self.saved)[0] if self.saved else self.body.fresh
        place, byte = self.random.randrange(len(block)), self.random.randrange(1, 256)
        broken = self.random.choice(
            [
                block[:place],
                block + bytes([byte]) * (1 + place),
                bytes([byte]) * len(block),
                block[:place] + bytes([block[place] ^ byte]) + block[place + 1 :],
            ]
        )
        return self.expect({self.body.refused, ERROR}, self.one.set_bytes(broken))

    def replay(self):
        """The same calls from the same state, here and in the other instance, end in the same bits."""
        if self.experiment[0][1] != self.experiment[1][1]:
            return OK
        block, other = self.one.bytes(), self.pair[1 - self.which]
        there = other.bytes()
        loads = [[self.random.uniform(-2.0, 2.0) for _ in self.body.inputs] for _ in range(3)]
        sizes = [self.random.choice(STEPS) for _ in loads]
        ends = []
        for instance in (self.one, self.one, other):
            assert instance.set_bytes(block) == OK
            row, time = [], self.know.time
            for given, size in zip(loads, sizes, strict=True):
                row.append(instance.set_real(self.body.inputs, given))
                row += [instance.step(time, size), repr(instance.get_real(self.body.outputs)), instance.bytes()]
                time += size if row[-3] == OK and size > 0.0 else 0.0
            ends.append(row)
        assert ends[0] == ends[1] == ends[2]
        assert self.one.set_bytes(block) == OK
        assert other.set_bytes(there) == OK
        return OK


# How often each call is made, those not named once.
WEIGHTS = dict.fromkeys(
    [
        *("setup", "enter", "exit", "terminate", "reset", "step", "many", "set_inputs", "number", "text", "flag"),
        *("wrong_set", "wrong_get", "get_values", "nothing", "no_arrays", "derivatives", "directional", "statuses"),
        *("cancel", "log", "save", "restore", "foreign", "damaged", "replay"),
    ],
    1,
)
WEIGHTS |= {"step": 12, "set_inputs": 10, "exit": 3, "text": 3, "restore": 3}
WEIGHTS |= dict.fromkeys(
    ("enter", "many", "number", "wrong_set", "wrong_get", "derivatives", "directional", "statuses", "save", "damaged"),
    2,
)


def main():
    faulthandler.enable()
    parser = argparse.ArgumentParser()
    parser.add_argument("fmu", type=Path)
    parser.add_argument("twin", type=Path)
    parser.add_argument("seed", type=int)
    parser.add_argument("calls", type=int)
    parser.add_argument("--library", type=Path)
    parser.add_argument("--refused", type=int, default=ERROR)
    parser.add_argument("--case", type=int)
    options = parser.parse_args()
    body, counts = Body(options.fmu, options.twin, options.library, options.refused), Counter()
    journal = options.fmu.with_name(f"{options.fmu.stem}_{options.seed}.txt")
    case = options.case or 0
    while sum(counts.values()) < options.calls:
        journal.write_text(f"--case {case}")
        player = Player(body, f"{options.seed} {case}", counts)
        player.run(CALLS_PER_CASE)
        player.close()
        if options.case is not None:
            break
        case += 1
    print(dict(counts))
    print("SLOWEST", SLOWEST.name, SLOWEST.seconds)
    print(f"CALLS {sum(counts.values())}")
    print("FINE", flush=True)


if __name__ == "__main__":
    status = 1
    try:
        main()
        status = 0
    except BaseException:
        import traceback

        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    # Not by the interpreter's exit: there pythonfmu's library may crash a process that has done its work.
    os._exit(status)
