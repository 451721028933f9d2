"""Random sequences of FMI calls against a small model of what each must answer.

    python fuzz_worker.py FOLDER SEED CASES [OPEN,…]     run cases; prints "CASES n CALLS m" and "FINE" at the end
    python fuzz_worker.py FOLDER "[('step', 0, 0.0, 0.001), …]"    run one again

FOLDER holds the FMUs body.fmu, other.fmu (another number of modes) and twin.fmu (another body with states of the same
size). The case that is under way stands in FOLDER/SEED.txt: what was being done when the process ended early. Defects
that are named as open are steered around.
"""

import faulthandler
import math
import os
import re
import sys
from collections import Counter
from pathlib import Path
from typing import ClassVar

from bare_fmi2 import DISCARD, ERROR, FATAL, OK, WARNING, Fmu
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

MODERATE_LOAD, MODERATE_STEP = 10.0, 0.1
HUGE = [1e12, -1e60, 1e160, 1e300, -1.7976931348623157e308]
WRONG = [math.nan, math.inf, -math.inf]
NO_REFERENCES = [9999, 2**31 - 1]
BEYOND_INT = [2**31, 2**32 - 1000, 2**32 - 1]
OPEN = set()
# The one value that is found from the inputs, too.
STABILITY = "diagnostics.stability"
# Values of status.code besides that of a refused call, 1.
SOUND, LIMIT_PASSED = 0, 2
COUNTS = Counter()
CASES_PER_INSTANCE = 20
# Mark, owner and checksum before a state's numbers, bytes.
HEADER = 48


class Prediction:
    """What the standard and docs/fmu-variables.md say of an instance."""

    def __init__(self, fmu):
        self.inputs = dict.fromkeys(fmu.references("Real", "input"), 0.0)
        self.parameters = {fmu.reference[name]: value for name, value in NUMBERS.items()}
        self.texts = {fmu.reference[name]: value for name, value in TEXTS.items()}
        self.running = self.started = False
        self.code = 0
        # No load or step beyond reason so far: steps must succeed.
        self.calm = True

    def copy(self):
        other = object.__new__(Prediction)
        other.__dict__ = {k: dict(v) if isinstance(v, dict) else v for k, v in self.__dict__.items()}
        return other

    def start(self, fmu):
        """Statuses with which the start can end: of FMI calls but steps."""
        values = {name: self.parameters[fmu.reference[name]] for name in NUMBERS}
        texts = {name: self.texts[fmu.reference[name]] for name in TEXTS}
        sound = {name: math.isfinite(value) and value >= 0.0 for name, value in values.items()}
        sound["internal_step.tolerance"] &= values["internal_step.tolerance"] > 0.0
        if not all(sound[name] for name in ("damping.scale", "internal_step.limit", "internal_step.tolerance")):
            return {FATAL}
        if texts["formulation.stiffness"] != "constant" or texts["formulation.kinematics"] == "second_order":
            # There are no data for them.
            return {FATAL}
        if self.started:
            return {OK}
        known = ("formulation.kinematics", "formulation.loads", "formulation.stiffness")
        if any(texts[n] != TEXTS[n] for n in TEXTS if n.startswith("formulation.") and n not in known):
            return {OK, FATAL}
        if texts["initialization"] != "rest":
            return {OK, FATAL} if all(math.isfinite(v) for v in self.inputs.values()) else {FATAL}
        # What is watched for may be refused from the start or not.
        return {OK} if all(sound.values()) else {OK, FATAL}

    def step(self, fmu, time, size):
        """Statuses with which a step can end."""
        if not (math.isfinite(time) and math.isfinite(size) and size >= 0.0):
            return {DISCARD}
        if not all(math.isfinite(v) for v in self.inputs.values()):
            return {DISCARD}
        start = self.start(fmu)
        if start == {FATAL}:
            return {DISCARD}
        if size == 0.0 and start == {OK}:
            return {OK}
        watched = {n: v for n, v in self.texts.items() if n in {fmu.reference[w] for w in TEXTS if ".on_" in w}}
        if "terminate" in watched.values():
            return {OK, DISCARD, FATAL}
        sure = self.moderate(fmu, size) and start == {OK} and "discard" not in watched.values()
        return {OK} if sure else {OK, DISCARD}

    def moderate(self, fmu, size):
        limit = self.parameters[fmu.reference["internal_step.limit"]]
        return (
            self.calm
            and all(abs(v) <= MODERATE_LOAD for v in self.inputs.values())
            and size <= MODERATE_STEP
            and self.parameters[fmu.reference["damping.scale"]] <= 10.0
            and self.parameters[fmu.reference["internal_step.tolerance"]] >= 1e-8
            and (limit == 0.0 or size / limit <= 1e3)
        )


class Player:
    """Instances of one case, with their predictions and saved states."""

    # Instantiation takes most of a case's time: the fresh state takes instances back to where they began.
    pool: ClassVar[list] = []
    uses: ClassVar[Counter] = Counter()

    def __init__(self):
        if not self.pool:
            self.pool += [BODY.instantiate(f"case_{k}") for k in range(2)]
        self.instances = [self.pool.pop() for _ in range(2)]
        self.predictions = [Prediction(BODY) for _ in range(2)]
        self.logging = [True, True]
        self.saved = []
        self.last_time = [math.nan, math.nan]

    def close(self):
        for _, block_state, _ in self.saved:
            assert self.instances[0].free_state(block_state) == OK
        for instance in self.instances:
            assert instance.set_bytes(FRESH) == OK
            assert instance.logging(True) == OK
            self.uses[instance] += 1
            if self.uses[instance] < CASES_PER_INSTANCE:
                self.pool.append(instance)
            else:
                del self.uses[instance]
                instance.free()

    def play(self, operations):
        for name, which, *arguments in operations:
            COUNTS[name] += 1
            self.instance, self.prediction, self.which = self.instances[which], self.predictions[which], which
            before, lines = self.instance.bytes(), len(BODY.log)
            status = getattr(self, name)(*arguments)
            self.check(name, status, before, BODY.log[lines:])

    def check(self, name, status, before, lines):
        """What holds after every call."""
        instance, prediction = self.instance, self.prediction
        if status >= DISCARD:
            prediction.code = 1 if name != "unsupported" else prediction.code
            same_state(instance, before)
        own = [line for line in lines if line[0] >= DISCARD]
        assert bool(own) == (status >= DISCARD and self.logging[self.which]), (name, status, lines)
        code, values = instance.get_integer([BODY.reference["status.code"]])
        if name == "step" and status == OK and prediction.code == SOUND and values == [LIMIT_PASSED]:
            prediction.code = LIMIT_PASSED
        assert (code, values) == (OK, [prediction.code]), (name, status, values)
        finite_outputs(instance, prediction)
        references = [*prediction.inputs, *prediction.parameters]
        status, values = instance.get_real(references)
        assert status == OK
        expected = [*prediction.inputs.values(), *prediction.parameters.values()]
        assert all(a == b or (a != a and b != b) for a, b in zip(values, expected, strict=True)), (name, values)
        assert instance.get_string(list(prediction.texts)) == (OK, list(prediction.texts.values()))

    # Life cycle: pythonfmu's library lets every order pass.

    def setup(self, start, stop, tolerance):
        return expect({OK}, self.instance.setup(start, stop, tolerance))

    def enter(self):
        return expect({OK}, self.instance.enter())

    def exit(self):
        status = expect(self.prediction.start(BODY), self.instance.exit())
        if status == OK:
            self.prediction.running = self.prediction.started = True
        return status

    def terminate(self):
        return expect({OK}, self.instance.terminate())

    def reset(self):
        status = expect({OK}, self.instance.reset())
        self.predictions[self.which] = self.prediction = Prediction(BODY)
        assert self.instance.bytes() == FRESH
        return status

    def log(self, on, categories):
        status = expect({OK}, self.instance.logging(on, categories))
        self.logging[self.which] = bool(on) and not categories
        if on and categories:
            # Which lines pass is a matter of their categories: back to all of them or none.
            self.instance.logging(True)
            self.logging[self.which] = True
        return status

    def unsupported(self):
        found = self.instance.unsupported()
        assert all(status in (DISCARD, ERROR) for name, status in found.items() if name != "GetBooleanStatus"), found
        return max(found.values())

    def step(self, time, size):
        prediction = self.prediction
        status = expect(prediction.step(BODY, time, size), self.instance.step(time, size))
        if status == OK:
            prediction.calm = prediction.moderate(BODY, size)
            prediction.started = True
        elif prediction.start(BODY) == {OK}:
            prediction.started = True
        found, last = self.instance.last_successful_time()
        reached = time + size if status == OK else time
        assert found == OK
        assert last == reached or reached != reached, (last, reached)
        return status

    # Values.

    def inputs(self, positions, values):
        references = [list(self.prediction.inputs)[p % len(self.prediction.inputs)] for p in positions]
        status = expect({OK}, self.instance.set_real(references, values))
        self.prediction.inputs.update(zip(references, values, strict=True))
        self.changed()
        return status

    def number(self, name, value):
        reference = BODY.reference[name]
        status = expect({OK}, self.instance.set_real([reference], [value]))
        if not self.prediction.running:
            self.prediction.parameters[reference] = value
        self.changed()
        return status

    def text(self, name, value):
        reference = BODY.reference[name]
        fine = value in OFFERED[name] or self.prediction.running
        status = expect({OK if fine else FATAL}, self.instance.set_string([reference], [value]))
        if fine and not self.prediction.running:
            self.prediction.texts[reference] = value
        if fine:
            self.changed()
        return status

    def changed(self):
        if not self.prediction.running:
            self.prediction.started = False
            self.prediction.calm = True

    def wrong_set(self, kind, reference, value, behind):
        """A set that must fail: no such variable, another type, or one that cannot be set."""
        call = {"Real": self.instance.set_real, "Integer": self.instance.set_integer}
        call |= {"Boolean": self.instance.set_boolean, "String": self.instance.set_string}
        references, values = [reference], [str(value) if kind == "String" else value]
        if behind and kind == "Real":  # behind one that could be set
            references, values = [0, reference], [7.5, value]
        if behind and kind == "String":
            references, values = [BODY.reference["initialization"], reference], ["static", str(value)]
        return expect({FATAL}, call[kind](references, values))

    def wrong_get(self, kind, reference):
        call = {"Real": self.instance.get_real, "Integer": self.instance.get_integer}
        call |= {"Boolean": self.instance.get_boolean, "String": self.instance.get_string}
        return expect({FATAL}, call[kind]([reference])[0])

    def nothing(self):
        """Calls with no values at all."""
        one = self.instance
        statuses = [one.set_real([], []), one.set_integer([], []), one.set_boolean([], []), one.set_string([], [])]
        statuses += [call([])[0] for call in (one.get_real, one.get_integer, one.get_boolean, one.get_string)]
        self.changed()
        return expect({OK}, max(statuses))

    # States.

    def save(self):
        status, state = self.instance.get_state()
        self.saved.append((self.instance.serialize(state)[1], state, self.prediction.copy()))
        return expect({OK}, status)

    def restore(self, number, from_bytes):
        """A saved state, of this instance or the other one: both are of the same FMU."""
        if not self.saved:
            return OK
        block, state, prediction = self.saved[number % len(self.saved)]
        status = expect({OK}, self.instance.set_bytes(block) if from_bytes else self.instance.set_state(state))
        self.predictions[self.which] = self.prediction = prediction.copy()
        assert self.instance.bytes() == block
        return status

    def foreign(self, twin):
        return expect({FATAL}, self.instance.set_bytes(TWIN_BLOCK if twin else OTHER_BLOCK))

    def damaged(self, number, damage):
        """Bytes that are no state."""
        block = self.saved[number % len(self.saved)][0] if self.saved else FRESH
        kind, place, byte = damage
        place %= len(block)
        broken = {
            "cut": block[:place],
            "longer": block + bytes([byte]) * (1 + place),
            "filled": bytes([byte]) * len(block),
            "flipped": block[:place] + bytes([block[place] ^ (byte or 1)]) + block[place + 1 :],
        }[kind]
        return expect({ERROR, FATAL}, self.instance.set_bytes(broken)) if broken != block else OK

    def replay(self, loads, sizes):
        """The same steps from the same state, here and in the other instance, end in the same bits."""
        block = self.instance.bytes()
        ends = []
        for instance in (self.instance, self.instance, self.instances[1 - self.which]):
            kept = instance.bytes()
            assert instance.set_bytes(block) == OK
            instance.set_real(list(self.prediction.inputs)[: len(loads)], loads)
            row = [(instance.step(0.1, size), repr(instance.get_real(OUTPUTS)), instance.bytes()) for size in sizes]
            ends.append(row)
            assert instance.set_bytes(kept) == OK
        assert ends[0] == ends[1] == ends[2]
        # Refused steps have left log lines, none of them of the calls that are checked next.
        BODY.log.clear()
        return OK


def expect(allowed, status):
    """A status that must be one of those allowed; warnings are as good as OK."""
    status = OK if status == WARNING else status
    assert status in allowed, f"status {status}, expected one of {sorted(allowed)}"
    return status


def finite_outputs(instance, prediction):
    start = prediction.start(BODY)
    lines = len(BODY.log)
    status, values = instance.get_real(OUTPUTS)
    assert status in start, f"outputs: status {status}, expected one of {sorted(start)}"
    if status == OK:
        prediction.started = True
        assert all(map(math.isfinite, values)), values
    else:
        prediction.code = 1
    if "stability of extreme inputs" not in OPEN:
        # Of loads beyond reason there may be none to be told.
        status, (value,) = instance.get_real([BODY.reference[STABILITY]])
        reasonable = all(abs(v) <= MODERATE_LOAD for v in prediction.inputs.values())
        assert status in start or not reasonable, status
        assert math.isfinite(value) or not reasonable or status != OK, value
        prediction.code = 1 if status >= DISCARD else prediction.code
    del BODY.log[lines:]


def same_state(instance, before):
    """A refused call has changed nothing but the status code."""
    after = instance.bytes()
    if strip(after) == strip(before):
        return
    # A call may have made the body start before it was refused: then both go on alike.
    assert SPARE.set_bytes(before) == OK
    pair = [
        (one.get_real(EVERYTHING), one.get_string(BODY.references("String")), strip(one.bytes()))
        for one in (SPARE, instance)
    ]
    assert repr(pair[0]) == repr(pair[1]), "a refused call changed the state"


def strip(block):
    """A state without its status code, and without the checksum before the numbers."""
    return block[HEADER:STATUS_SLOT] + block[STATUS_SLOT + 8 :]


def status_slot():
    """Where the status code stands in a state: what a refused call changes in a fresh one."""
    instance = BODY.instantiate("slot")
    before = instance.bytes()
    instance.get_boolean([0])
    after = instance.bytes()
    instance.free()
    places = [k for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b and k >= HEADER]
    return places[0] // 8 * 8


def block_of(path):
    """A state of another body in motion."""
    fmu = Fmu(path)
    instance = fmu.instantiate()
    instance.start()
    instance.set_real([0], [1.0])
    instance.step(0.0, 1e-3)
    return instance.bytes()


def operations():
    """Strategy for a list of calls on two instances."""
    moderate = st.floats(-MODERATE_LOAD, MODERATE_LOAD)
    huge = HUGE[:2] if "huge load" in OPEN else HUGE
    extreme = st.sampled_from([0.0, -0.0, 5e-324, *huge, *WRONG])
    load = st.integers(0, 4).flatmap(lambda k: moderate if k else extreme)
    loads, position = st.tuples(load, load, load), st.integers(0, 20)
    categories = st.sampled_from([(), ("logStatusDiscard",), ("nonsense", "logStatusError")])
    smallest = 1e-300 if "smallest step" in OPEN else 5e-324
    size = st.sampled_from([1e-3, 1e-3, 1e-2, 0.1, 1e-4, 0.0, 1e-12, smallest, -1e-3, 1.0, 1e300, *WRONG])
    time = st.sampled_from([0.0, 0.0, 0.5, -1.0, 1e300, *WRONG])
    number = st.sampled_from([1.0, 0.0, 0.5, 1e-3, 1e-6, 1e-9, 5e-324, 3.0, -1.0, 1e300, *WRONG])
    damage_kinds = ["cut", "longer", "filled", "flipped"]
    if "damaged state" in OPEN:
        damage_kinds = []
    references = list(range(len(BODY.variables) + 2)) + NO_REFERENCES
    references = st.sampled_from(references)
    if "negative reference" not in OPEN:
        references = st.one_of(references, st.sampled_from(BEYOND_INT))
    inputs, parameters = BODY.references("Real", "input"), [BODY.reference[n] for n in NUMBERS]
    settable = {*inputs, *parameters, *BODY.references("String")}
    kinds = st.sampled_from(["Real", "Integer", "Boolean", "String"])
    types = {int(v.get("valueReference")): v[0].tag for v in BODY.variables}
    wrong_sets = st.tuples(
        st.just("wrong_set"),
        st.integers(0, 1),
        kinds,
        references,
        st.integers(-1, 1),
        st.just(False) if "partial set" in OPEN else st.booleans(),
    ).filter(lambda op: not (op[3] in settable and types[op[3]] == op[2]))
    wrong_gets = st.tuples(st.just("wrong_get"), st.integers(0, 1), kinds, references).filter(
        lambda op: types.get(op[3]) != op[2]
    )

    def op(name, *strategies):
        return st.tuples(st.just(name), st.integers(0, 1), *strategies)

    def choice(name):
        return st.tuples(st.just(name), st.sampled_from([*OFFERED[name], "", "magic", "100% sure", "ä" * 50]))

    choices = st.sampled_from(list(OFFERED)).flatmap(choice)
    offered = {
        "setup": (1, op("setup", time, st.none() | time, st.none() | number)),
        "enter": (1, op("enter")),
        "exit": (3, op("exit")),
        "terminate": (1, op("terminate")),
        "reset": (1, op("reset")),
        "log": (
            1,
            op("log", st.booleans(), categories),
        ),
        "unsupported": (1, op("unsupported")),
        "step": (6, op("step", time, size)),
        "inputs": (
            5,
            op("inputs", st.lists(position, min_size=3, max_size=3, unique=True), loads),
        ),
        "number": (2, op("number", st.sampled_from(list(NUMBERS)), number)),
        "text": (2, choices.flatmap(lambda pair: op("text", st.just(pair[0]), st.just(pair[1])))),
        "wrong_set": (2, wrong_sets),
        "wrong_get": (2, wrong_gets),
        "nothing": (1, op("nothing")),
        "save": (2, op("save")),
        "restore": (2, op("restore", position, st.booleans())),
        "foreign": (1, op("foreign", st.just(False) if "twin state" in OPEN else st.booleans())),
        "replay": (2, op("replay", st.lists(moderate, min_size=2, max_size=5), st.lists(size, min_size=1, max_size=3))),
    }
    if damage_kinds:
        damage = st.tuples(st.sampled_from(damage_kinds), st.integers(0, 10**4), st.integers(0, 255))
        offered["damaged"] = (2, op("damaged", position, damage))
    weighted = [name for name, (weight, _) in offered.items() for _ in range(weight)]
    call = st.sampled_from(weighted).flatmap(lambda name: offered[name][1])
    # Half of the cases begin as the standard wants it.
    regular = st.sampled_from(OFFERED["formulation.kinematics"]).map(
        lambda kinematics: [
            ("text", 0, "formulation.kinematics", kinematics),
            ("setup", 0, 0.0, None, None),
            ("enter", 0),
            ("exit", 0),
            ("setup", 1, 0.0, None, None),
            ("enter", 1),
        ]
    )
    start = st.booleans().flatmap(lambda yes: regular if yes else st.just([]))
    return st.tuples(start, st.lists(call, min_size=1, max_size=25)).map(lambda pair: [*pair[0], *pair[1]])


def run(case):
    player = Player()
    try:
        player.play(case)
    finally:
        player.close()


def main():
    global BODY, NUMBERS, TEXTS, OFFERED, OUTPUTS, EVERYTHING, FRESH, SPARE, STATUS_SLOT, TWIN_BLOCK, OTHER_BLOCK
    faulthandler.enable()
    folder = Path(sys.argv[1])
    BODY = Fmu(folder / "body.fmu")
    OUTPUTS = BODY.references("Real", "output") + BODY.references("Real", "local")
    OUTPUTS.remove(BODY.reference[STABILITY])
    EVERYTHING = [reference for reference in BODY.references("Real") if reference != BODY.reference[STABILITY]]
    SPARE = BODY.instantiate("spare")
    parameters = [v for v in BODY.variables if v.get("causality") == "parameter"]
    NUMBERS = {v.get("name"): float(v[0].get("start")) for v in parameters if v[0].tag == "Real"}
    TEXTS = {v.get("name"): v[0].get("start") for v in parameters if v[0].tag == "String"}
    # The description ends with what is offered.
    OFFERED = {
        v.get("name"): re.findall(r'"([^"]*)"', v.get("description")) for v in parameters if v[0].tag == "String"
    }
    FRESH = SPARE.bytes()
    STATUS_SLOT = status_slot()
    OTHER_BLOCK, TWIN_BLOCK = block_of(folder / "other.fmu"), block_of(folder / "twin.fmu")
    if len(sys.argv) == 3:
        run(eval(sys.argv[2], {"nan": math.nan, "inf": math.inf}))
        return
    number, cases = int(sys.argv[2]), int(sys.argv[3])
    OPEN.update(sys.argv[4].split(",") if len(sys.argv) > 4 else ())
    journal = (folder / f"{number}.txt").open("w+")
    done = Counter()

    @seed(number)
    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(operations())
    def cases_hold(case):
        journal.seek(0)
        journal.truncate()
        journal.write(repr(case))
        journal.flush()
        done["cases"] += 1
        run(case)

    cases_hold()
    print(dict(COUNTS))
    print(f"CASES {done['cases']} CALLS {sum(COUNTS.values())}")
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
