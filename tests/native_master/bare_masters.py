"""What FMI masters without manners do with FMUs: `python bare_masters.py NAME ARGUMENTS`, judged by the printed line.

As in fmu_masters.py, every public function gets JSON values and returns one; but calls are made as a C program makes
them, so that nothing stands between a mistake and the FMU.
"""

import gc
import json
import os
import sys
from ctypes import c_void_p
from pathlib import Path

from bare_fmi2 import ERROR, OK, Fmu

MARK = "RESULT "
PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


def resident():
    """Resident memory of this process in MB."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20


def sound(instance):
    """Whether an instance still steps, answers and can be freed, many times over."""
    for _ in range(50):
        instance.get_boolean([0])
        if instance.go_on(1e-3) != OK or instance.get_real([0])[0] != OK:
            return False
    instance.free()
    return True


def moving(fmu, name="moving"):
    """An instance in motion."""
    instance = fmu.instantiate(name)
    assert instance.start() == [OK, OK, OK]
    first, *_ = fmu.references("Real", "input")
    assert instance.set_real([first], [2.0]) == OK
    assert instance.step(0.0, 1e-3) == OK
    return instance


def view(instance):
    """Everything that a master can see but the status code, which a refused call sets."""
    references = instance.fmu.references("Real")
    return instance.get_real(references), instance.get_string(instance.fmu.references("String"))


def refused(path, call, *arguments):
    """Status of a call of a moving instance, whether it left everything as it was, and whether all goes on after it."""
    fmu = Fmu(path)
    instance = moving(fmu)
    before = view(instance)
    status = globals()[f"_{call}"](instance, *arguments)
    return {"status": status, "unchanged": view(instance) == before, "log": fmu.log, "sound": sound(instance)}


def _set_real(instance, references, values):
    return instance.set_real(references, values)


def _damaged_state(instance, damage):
    block = instance.bytes()
    broken = {
        "empty": b"",
        "short": block[:-8],
        "odd": block[:-3],
        "long": block + bytes(8),
        "not a number": b"\xff" * len(block),
        "zeros": bytes(len(block)),
        "bit": block[: len(block) // 2] + bytes([block[len(block) // 2] ^ 4]) + block[len(block) // 2 + 1 :],
    }[damage]
    return instance.set_bytes(broken)


def _state_of(instance, path):
    return instance.set_bytes(moving(Fmu(path), "stranger").bytes())


def huge_loads(path, loads):
    """Steps under loads of every size: statuses, and whether outputs stay finite."""
    fmu = Fmu(path)
    first, *_ = fmu.references("Real", "input")
    outputs = fmu.references("Real", "output") + fmu.references("Real", "local")
    found = []
    for load in loads:
        for method in ("linear", "frames"):
            instance = fmu.instantiate()
            instance.set_string([fmu.reference["method"]], [method])
            instance.start()
            instance.set_real([first], [load])
            step = instance.step(0.0, 1e-3)
            status, values = instance.get_real(outputs)
            found.append([load, method, step, status, all(abs(x) < float("inf") for x in values)])
            instance.free()
    return found


def small_steps(path, sizes):
    """Steps of every length under a load, after one of 10 ms: statuses, and whether outputs stay finite."""
    fmu = Fmu(path)
    third = fmu.references("Real", "input")[2]
    found = []
    for size in sizes:
        instance = fmu.instantiate()
        instance.start()
        instance.set_real([third], [9.0])
        instance.step(0.0, 1e-2)
        step = instance.step(1e-2, size)
        status, values = instance.get_real(fmu.references("Real", "output"))
        found.append([size, step, status, all(abs(x) < float("inf") for x in values)])
        instance.free()
    return found


def stability_under(path, loads):
    """Asking for the stability under loads of every size: whether the instance goes on after it."""
    fmu = Fmu(path)
    first, *_ = fmu.references("Real", "input")
    found = []
    for load in loads:
        instance = moving(fmu)
        instance.set_real([first], [float(load)])
        instance.get_real([fmu.reference["diagnostics.stability"]])
        instance.set_real([first], [1.0])
        found.append(sound(instance))
    return found


def damaged_files(path, damages):
    """Instantiation from damaged programs: [damage, refused, log lines], then from the sound one.

    Another instance has the sound one open meanwhile.
    """
    fmu = Fmu(path)
    other = fmu.instantiate()
    program = fmu.folder / "resources" / "body.prog"
    data = program.read_bytes()
    changed = {
        "missing": None,
        "empty": b"",
        "truncated": data[: len(data) // 2],
        "one byte short": data[:-1],
        "one byte more": data + b"\0",
        "text": b"not a program\n" * 1000,
        "altered number": data[:-100] + bytes([data[-100] ^ 1]) + data[-99:],
        "altered head": data[:8] + bytes([data[8] ^ 1]) + data[9:],
    }
    found = []
    for name in damages:
        program.unlink(missing_ok=True)
        if changed[name] is not None:
            program.write_bytes(changed[name])
        fmu.log.clear()
        instance = fmu.instantiate()
        found.append([name, instance is None, [list(line) for line in fmu.log]])
    program.write_bytes(data)
    # In place: what is open is altered, too.
    with program.open("r+b") as file:
        file.seek(-100, os.SEEK_END)
        file.write(bytes([data[-100] ^ 1]))
    fmu.log.clear()
    found.append(["altered number", fmu.instantiate() is None, [list(line) for line in fmu.log]])
    program.write_bytes(data)
    other.free()
    return {"found": found, "sound": sound(moving(fmu))}


def mixed(path, other):
    """Instantiation from an FMU with a file of another one in place of its own: [file, refused, log lines]."""
    fmu, stranger = Fmu(path), Fmu(other)
    found = []
    for name in ("resources/body.prog", "modelDescription.xml"):
        place = fmu.folder / name
        own = place.read_bytes()
        place.write_bytes((stranger.folder / name).read_bytes())
        fmu.log.clear()
        found.append([name, fmu.instantiate() is None, [list(line) for line in fmu.log]])
        place.write_bytes(own)
    (fmu.folder / "modelDescription.xml").unlink()
    variables = [[(v.get("name"), v.get("valueReference")) for v in one.variables] for one in (fmu, stranger)]
    return {"found": found, "same variables": variables[0] == variables[1], "sound": sound(moving(fmu))}


# The order of calls.


def liberties(path):
    """Statuses of calls out of order, and liberties with states."""
    fmu = Fmu(path)
    never_started = fmu.instantiate()
    read, before_start = never_started.get_real([0])[0], never_started.step(0.0, 1e-3)
    one = moving(fmu)
    found = {
        "another guid": fmu.instantiate(guid="{of-another-fmu}") is not None,
        "read before initialisation": read,
        "step before initialisation": before_start,
        "second initialisation": one.enter(),
        "time that jumps": one.step(7.0, 1e-3),
        "terminate": one.terminate(),
        "step after terminate": one.step(0.0, 1e-3),
        "read after terminate": one.get_real([0])[0],
    }
    _, state = one.get_state()
    one.free_state(state)
    found["freed state is null"] = state.value is None
    _, kept = one.get_state()
    handed_in = c_void_p(kept.value)
    one.get_state(handed_in)
    return found | {"state handed in is used again": handed_in.value == kept.value}


def discarded(path):
    """What a master can find out after a discarded step."""
    fmu = Fmu(path)
    one = moving(fmu)
    status = one.step(1e-3, -1.0)
    last, answers = one.last_successful_time(), one.answers()
    return {"status": status, "last": last, "answers": answers, "calls": one.unsupported()}


def unusable_start(path):
    """What a number that cannot be used does to the reading of outputs, where it was set and where its state is set."""
    fmu = Fmu(path)
    outputs, fewest = fmu.references("Real", "output"), [fmu.reference["internal_step.fewest"]]
    one, opened, ran = (fmu.instantiate(name) for name in ("one", "opened", "ran"))
    for instance in (one, opened):
        instance.setup()
        instance.enter()
    ran.start()
    opened.get_real(outputs)
    one.set_real(fewest, [-1.0])
    block = one.bytes()
    found = [one.get_real(outputs)[0]]
    for other in (opened, ran):
        other.set_bytes(block)
        found.append(other.get_real(outputs)[0])
    return found


def log_lines(path):
    """Log lines after switching categories."""
    fmu = Fmu(path)
    one = moving(fmu)
    found = {}
    for name, on, categories in (
        ("all", True, ()),
        ("none", False, ()),
        ("discards", True, ("logStatusDiscard",)),
        ("errors", True, ("logStatusError",)),
        ("logAll", True, ("logAll",)),
    ):
        one.logging(on, categories)
        fmu.log.clear()
        one.step(0.0, -1.0)
        one.get_real([9999])
        found[name] = [line[:2] for line in fmu.log]
    fmu.log.clear()
    (fmu.folder / "resources" / "body.prog").unlink()
    assert fmu.instantiate(logging=False) is None
    found["failed instantiation, off"] = [line[:2] for line in fmu.log]
    return found


def fatal(path, kind):
    """A mistake that ends the process: the line before it is the last."""
    fmu = Fmu(path)
    print(MARK + json.dumps("before"), flush=True)
    if kind == "no resources":
        fmu.instantiate(resources=(fmu.folder / "nowhere").as_uri())
    elif kind == "path with #":
        # %23 in the address of the resources: of all escapes the library reads that of the space alone.
        assert fmu.instantiate(
            resources=fmu.folder.rename(fmu.folder.with_name(fmu.folder.name + "#")).as_uri() + "/resources"
        )
    else:
        one = moving(fmu)
        if kind == "text that is not UTF-8":
            one.set_string([fmu.reference["initialization"]], [b"\xff\xfe"])
        elif kind == "state that is null":
            one.set_state(None)
        for _ in range(100):
            one.go_on(1e-3)
            one.get_real([0])
        one.free()
    return "survived"


# Long runs.


def mapped(path, count):
    """How often a process with so many instances has their program in its memory; the same after they are gone."""
    fmu = Fmu(path)

    def places():
        return sum("body.prog" in line for line in Path("/proc/self/maps").read_text().splitlines())

    instances = [moving(fmu) for _ in range(count)]
    found = [places()]
    instances.pop().free()
    alike = len({json.dumps(view(one)) for one in instances}) == 1
    found.append(places())
    for one in instances:
        one.free()
    return {"places": [*found, places()], "alike": alike}


def many_instances(path, count, warm_up):
    """Growth of memory over `count` instantiations and freeings, MB, after a warm-up."""
    fmu = Fmu(path)

    def rounds(number):
        for _ in range(number):
            moving(fmu).free()

    rounds(warm_up)
    before = resident()
    rounds(count)
    return {"growth": resident() - before, "resident": resident()}


def many_steps(path, method, count, warm_up):
    """Growth of memory over `count` steps with inputs set, outputs read and some steps refused, MB."""
    fmu = Fmu(path)
    one = fmu.instantiate()
    assert one.set_string([fmu.reference["method"]], [method]) == OK
    assert one.start() == [OK, OK, OK]
    first, *_ = fmu.references("Real", "input")
    outputs = fmu.references("Real", "output")

    def steps(number):
        for k in range(number):
            one.set_real([first], [float(k % 7) - 3.0])
            assert one.go_on(1e-3) == OK
            one.get_real(outputs[k % 2 :: 2])
            if k % max(100, count // 1000) == 0:
                one.step(0.0, -1.0)
                one.set_bytes(one.bytes())
                fmu.log.clear()

    steps(warm_up)
    before = resident()
    steps(count)
    return {"growth": resident() - before, "resident": resident()}


def many_failures(path, count, warm_up):
    """Growth of memory over `count` calls that fail, MB."""
    fmu = Fmu(path)
    one = moving(fmu)

    def failures(number):
        for _ in range(number):
            assert one.get_boolean([0])[0] >= ERROR
            assert one.set_real([9999], [1.0]) >= ERROR
            fmu.log.clear()

    failures(warm_up)
    before = resident()
    failures(count)
    return {"growth": resident() - before, "sound": sound(one)}


def together(paths, loads, steps):
    """Several FMUs, two instances of each, stepped in turn: the real outputs of both at the end, by FMU."""
    instances = [(fmu, [fmu.instantiate(f"{k}_{n}") for n in range(2)]) for k, fmu in enumerate(map(Fmu, paths))]
    for fmu, pair in instances:
        for one in pair:
            assert one.start() == [OK, OK, OK]
            assert one.set_real(fmu.references("Real", "input")[: len(loads)], loads) == OK
    for k in range(steps):
        for _, pair in instances:
            for one in pair:
                assert one.step(1e-3 * k, 1e-3) == OK
    ends = [[one.get_real(fmu.references("Real", "output"))[1] for one in pair] for fmu, pair in instances]
    for _, pair in instances:
        for one in pair:
            one.free()
    return ends


def main():
    name, arguments = sys.argv[1], json.loads(sys.argv[2])
    print(MARK + json.dumps(globals()[name](*arguments)), flush=True)
    # Not by the interpreter's exit: there pythonfmu's library may crash a process that has done its work.
    os._exit(0)


if __name__ == "__main__":
    main()
