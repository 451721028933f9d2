"""Programs with forged fields, at work in the core: `program_fuzzer.py CORE SEED COUNT [fmu]`, by itself.

Each forged program has a right checksum. It is refused when it is opened, or the core answers every call: without a
crash, within its bound of work, the same again from a fresh body, and finite where it says that all is well.
"""

import signal
import struct
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodies import body_of_everything, random_ties
from flexfmu.core import library as core_library
from flexfmu.core.interface import _HEAD, DESCRIPTION, checksum, fields, read_image
from flexfmu.core.library import Core, StepLimits
from flexfmu.files.basics import OptionError
from flexfmu.fmu.python_slave import SlaveError, core_file
from flexfmu.model.methods import Mass, Method
from flexfmu.model.variants import missing
from flexfmu.program.compile import compile_program
from flexfmu.study.stability import BodyPrograms

# Seconds that one program may take, with every call and under sanitizers.
PATIENCE = 60
# Internal steps of usual cost that a call may take.
MOST = 400.0
REALS = [0.0, -0.0, 5e-324, -5e-324, 1e-160, 1e-308, 1e308, -1e308, 1e154, -1e-3, -1.0, 1.0, 1e8, np.inf, np.nan]
WHOLES = [
    -(2**63),
    -(2**31),
    -2,
    -1,
    0,
    1,
    2,
    3,
    5,
    6,
    7,
    63,
    100,
    4096,
    10**8,
    10**8 + 1,
    2**31,
    2**40,
    2**62,
    2**63 - 1,
]


def small_programs(seed=1):
    """Programs of every method and kind of body, as (name, image)."""
    small = {"modes": 3, "frames": 2, "interfaces": 2}
    models = {
        "held": body_of_everything(seed, **small),
        "free": body_of_everything(seed, **small | {"modes": 8}, free=True),
    }
    models["cut"] = random_ties(models["held"], seed)
    for name, model in models.items():
        for method in Method:
            for mass in Mass if method is Method.FRAMES else (Mass.CONSTANT,):
                if missing(model, method, mass) is None:
                    yield f"{name} {method.value} {mass.value}", compile_program(model, method, mass)


def resealed(image):
    """The same bytes with the size and the checksum that belong to them."""
    mark, version, table, _, base, _ = _HEAD.unpack_from(image)
    body = image[_HEAD.size :]
    return _HEAD.pack(mark, version, table, len(image), base, checksum(body)) + body


def places(image, base):
    """Where each size, each array's place and each array of its own lies: (kind, name, start, count)."""
    held = read_image(image, base)
    for number, field in enumerate(fields()):
        at = _HEAD.size + 8 * number
        yield "SIZE", field.name, at, 1
        if field.kind != "SIZE" and (start := struct.unpack_from("<q", image, at)[0]) > 0:
            yield field.kind, field.name, 8 * start, held.arrays[field.name].size


def forged(image, rng, base=b""):
    """The image with one to three elements of a field replaced, and what was done."""
    # Sizes are refused nearly always: most of the work goes to arrays.
    sizes = rng.random() < 0.2
    table = [place for place in places(image, base) if place[3] and (place[0] == "SIZE") == sizes]
    kind, name, start, count = table[rng.integers(len(table))]
    altered, words = bytearray(image), []
    for _ in range(rng.integers(1, 4)):
        element = int(rng.integers(count))
        if kind == "TEXT":
            value = int(rng.integers(256))
            altered[start + element] = value
        elif kind == "REAL":
            (old,) = struct.unpack_from("<d", image, start + 8 * element)
            value = float(rng.choice([*REALS, -old, 1e6 * old, 1e-6 * old, old + 1.0]))
            struct.pack_into("<d", altered, start + 8 * element, value)
        else:
            (old,) = struct.unpack_from("<q", image, start + 8 * element)
            value = [*WHOLES, old + 1, old - 1, 2 * old][rng.integers(len(WHOLES) + 3)]
            struct.pack_into("<q", altered, start + 8 * element, max(min(value, 2**63 - 1), -(2**63)))
        words.append(f"{name}[{element}] = {value}")
        if kind == "SIZE":
            break
    return resealed(bytes(altered)), ", ".join(words)


def answers(image, rng):
    """Every call once, as (name, answer); OptionError where the program is refused."""
    core = Core(image, limits=StepLimits(most=MOST))
    m, rest = core.modes, np.zeros(core.modes)
    inputs = rng.standard_normal(core.loads)
    q, v = 0.1 * rng.standard_normal(m), rng.standard_normal(m)
    answer, found, share, _ = core.static(inputs)
    yield "static", (answer, rest if answer else found, np.array(share))
    for step, end in ((1e-3, None), (1e-3, -inputs), (0.3, None)):
        answer, q1, v1, _, _ = core.step(q, v, inputs, step, end)
        yield "step", (answer, q1, v1)
        if not answer:
            q, v = q1, v1
    for at in (rest, q):
        yield "motion", (None, *core.motion_and_rates(at, v))
        yield "nodes", (None, *core.nodes_at(at))
        yield "energies", (None, np.array(core.energies(at, v)))
        yield "forces", (None, core.force(inputs, at), core.tangent(inputs, at), core.mass(at))
        yield "rotations", (None, core.rotations(at), np.array(core.largest_rotation(at)))
        yield "stability", (None, np.array(core.stability(inputs, at)[0]), np.array(core.is_stable(inputs, at, 0.1)))
        yield "missed", (None, np.array(core.missed(inputs)), np.array(core._ask("may_miss", inputs, 0.1)))
        yield "compliance", (None, core.compliance(inputs, 1e-3, at, range(core.interfaces)))
        yield "stress", (None, core.stress(at, read_image(image).sizes["stress_sets"]))


def judge(name, given):
    """Why an answer is nonsense; None where it is sound."""
    answer, *arrays = given
    sound = answer is not None and not answer
    if sound and not all(np.all(np.isfinite(array)) for array in arrays):
        return "not finite, and yet OK"
    if name == "static" and sound and given[2] != 1.0:
        return "an equilibrium under part of the load"
    if name == "nodes":
        rotation = arrays[1][np.all(np.isfinite(arrays[1]), axis=(1, 2))]
        square = rotation @ np.swapaxes(rotation, 1, 2)
        # Angles of 1e10 and more are round-off, which exponentials still turn into rotations.
        if square.size and np.max(np.abs(square - np.eye(3))) > 1e-6:
            return "rotations that are none"
    if name in ("stress", "rotations") and any(np.any(array < 0.0) for array in arrays):
        return "negative"
    if name == "missed" and not 0.0 <= arrays[0] <= 1.0:
        return "no share"
    return None


def same(a, b):
    return a[0] == b[0] and all(x.tobytes() == y.tobytes() for x, y in zip(a[1:], b[1:], strict=True))


def main(core, seed, count):
    """Forge and run; prints how many programs were refused and run, or fails on the first that goes wrong."""
    core_library.library_path = lambda: Path(core)
    np.seterr(all="ignore")
    rng = np.random.default_rng(seed)
    kinds, refused, worked = list(small_programs()), 0, 0
    for number in range(count):
        name, image = kinds[number % len(kinds)]
        altered, words = forged(image, rng)
        print(f"{number} {name}: {words}", file=sys.stderr, flush=True)
        signal.alarm(PATIENCE)
        try:
            first = list(answers(altered, np.random.default_rng(number)))
        except OptionError:
            refused += 1
            continue
        again = list(answers(altered, np.random.default_rng(number)))
        worked += 1
        for (call, given), (_, repeated) in zip(first, again, strict=True):
            why = judge(call, given) or (None if same(given, repeated) else "another answer the second time")
            if why:
                sys.exit(f"{name}: {words}: {call}: {why}: {given}")
    signal.alarm(0)
    print(refused, worked)


def rewritten(path, data):
    """Another file in its place: a slave that is no longer needed, but not freed yet, may still read the former."""
    new = path.with_suffix(".new")
    new.write_bytes(data)
    new.replace(path)


def through_the_fmu(core, seed, count):
    """The same with the programs of an FMU, variables and all: its slave is started, stepped and read."""
    small = body_of_everything(1, modes=3, frames=2, interfaces=2)
    aboard = BodyPrograms(replace(small, compliance_interfaces=small.interface_names[:1], velocity_outputs=True))
    folder = Path(aboard._folder.name)
    core_file(folder).write_bytes(Path(core).read_bytes())
    images = {path: path.read_bytes() for path in sorted(folder.glob("*.prog"))}
    reals = [number for number, variable in aboard.variables.values() if variable.type == "Real"]
    rng, refused, worked = np.random.default_rng(seed), 0, 0
    for number in range(count):
        path = list(images)[number % len(images)]
        altered, words = forged(images[path], rng, images[folder / DESCRIPTION])
        print(f"{number} {path.name}: {words}", file=sys.stderr, flush=True)
        rewritten(path, altered)
        signal.alarm(PATIENCE)
        try:
            slave = aboard.start(method=path.stem) if path.stem in {m.value for m in Method} else aboard.start()
            slave.set_real(range(6), [1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
            slave.setup_experiment(0.0, None, None)
            slave.enter_initialization_mode()
            slave.exit_initialization_mode()
            for time, step in ((0.0, 1e-3), (1e-3, 1e-3), (2e-3, 0.1)):
                slave.do_step(time, step)
            slave._set_fmu_state(slave._get_fmu_state())
            for real in reals:
                with suppress(SlaveError):
                    assert np.isfinite(slave.get_real([real])[0]), words
            worked += 1
        except (SlaveError, UnicodeDecodeError):
            refused += 1
        rewritten(path, images[path])
    signal.alarm(0)
    print(refused, worked)


if __name__ == "__main__":
    (through_the_fmu if "fmu" in sys.argv else main)(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
