"""Modal files that are cut short, altered or forged: `modal_fuzzer.py KIND FIRST COUNT [CORE]`, by itself.

KIND is "truncation", "flip" or "forged"; cases are numbered, and each is the same wherever a run begins. A file is
refused by ModalFileError, or, cut or flipped, it holds the very body that was written. Forged files have a right
checksum: what is read becomes programs, and the core answers every call about them as in program_fuzzer. Prints how
many were refused and how many worked; each case is announced first, so that the one that ends the process is known.
"""

import io
import signal
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

from bodies import body_of_everything, random_ties
from flexfmu.core import library as core_library
from flexfmu.files.basics import ModalFileError, OptionError
from flexfmu.model import modal_file
from flexfmu.model.methods import Mass, Method
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.model.variants import missing
from flexfmu.program.compile import compile_program
from program_fuzzer import PATIENCE, REALS, WHOLES, answers, judge, same

KINDS = ("truncation", "flip", "forged")


def bodies():
    """Small bodies that hold every part between them."""
    small = {"modes": 3, "frames": 2, "interfaces": 2}
    held = body_of_everything(1, **small)
    return [held, body_of_everything(1, **small | {"modes": 8}, free=True), random_ties(held, 1)]


def written(body):
    """The bytes of a body's file."""
    with tempfile.TemporaryDirectory() as folder:
        write_modal_file(body, Path(folder) / "body.h5")
        return (Path(folder) / "body.h5").read_bytes()


def cut_or_flipped(whole, kind, number):
    """The bytes of a case."""
    if kind == "truncation":
        return whole[:number]
    rng = np.random.default_rng(number)
    altered = bytearray(whole)
    altered[rng.integers(len(whole))] ^= 1 << rng.integers(8)
    return bytes(altered)


def forged_value(old, rng):
    """An array like `old` with some elements replaced, or of another shape."""
    value = old.copy()
    if value.size and rng.random() < 0.85:
        for _ in range(rng.integers(1, 4)):
            at = rng.integers(value.size)
            if value.dtype.kind == "f":
                value.flat[at] = rng.choice([*REALS, -value.flat[at], 1e6 * value.flat[at], value.flat[at] + 1.0])
            elif value.dtype.kind in "iu":
                bounds = np.iinfo(value.dtype)
                word = int(
                    rng.choice(np.array([*WHOLES, int(value.flat[at]) + 1, int(value.flat[at]) - 1], dtype=object))
                )
                value.flat[at] = min(max(word, bounds.min), bounds.max)
            else:
                value.flat[at] = rng.choice([b"", b"\xff", b"a", value.flat[rng.integers(value.size)]])
        return value
    axis = int(rng.integers(max(value.ndim, 1)))
    shapes = [value[None], value.ravel(), np.concatenate([value, value], axis=axis) if value.ndim else value[None]]
    shapes.append(value.take(range(value.shape[axis] - 1), axis) if value.ndim and value.shape[axis] else value[None])
    return shapes[rng.integers(len(shapes))]


def forge(whole, number):
    """A file with one dataset or attribute replaced, and what was done."""
    rng = np.random.default_rng(number)
    altered, names = io.BytesIO(whole), []
    with h5py.File(altered, "r+") as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        if rng.random() < 0.1:
            keys = [key for key in file.attrs if key not in ("format", "sha256")]
            name = keys[rng.integers(len(keys))]
            choices = [-1, 0, 1, 2**31, 1e308, "", "x", b"\xff", "frames", "port_0,port_9", np.zeros(2)]
            word = choices[rng.integers(len(choices))]
            file.attrs[name] = word
            return altered, f"{name} = {word!r}"
        name = names[rng.integers(len(names))]
        old = file[name][()]
        value = np.asarray(forged_value(np.asarray(old), rng))
        kept = dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=value).attrs.update(kept)
    return altered, f"{name}: {np.shape(old)} to {value.shape}"


def use(body, seed):
    """Run every program of a body; why one is nonsense, or None."""
    for method in Method:
        for mass in Mass if method is Method.FRAMES else (Mass.CONSTANT,):
            if missing(body, method, mass) is not None:
                continue
            try:
                image = compile_program(body, method, mass)
                first = list(answers(image, np.random.default_rng(seed)))
            except (OptionError, ModalFileError):
                continue
            again = list(answers(image, np.random.default_rng(seed)))
            for (call, given), (_, repeated) in zip(first, again, strict=True):
                why = judge(call, given) or (None if same(given, repeated) else "another answer the second time")
                if why:
                    return f"{method.value}: {call}: {why}: {given}"
    return None


def main(kind, first, count, core=None):
    """Run cases; ends with an error at the first that goes wrong."""
    if core:
        core_library.library_path = lambda: Path(core)
    np.seterr(all="ignore")
    wholes = [written(body) for body in bodies()]
    refused, worked = 0, 0
    for number in range(first, first + count):
        whole = wholes[0 if kind == "truncation" else number % len(wholes)]
        if kind == "truncation" and number >= len(whole):
            break
        print(number, file=sys.stderr, flush=True)
        signal.alarm(PATIENCE)
        if kind == "forged":
            altered, words = forge(whole, number)
            # Without its seal.
            altered.seek(0)
            altered.write(bytes(modal_file._BLOCK))
            # Of whatever there is, it is the right one.
            with h5py.File(altered, "r") as file:
                right = file.attrs["sha256"]
            modal_file._checksum = lambda _, right=right: right
        else:
            altered, words = io.BytesIO(cut_or_flipped(whole, kind, number)), ""
        try:
            body = read_modal_file(altered)
        except ModalFileError:
            refused += 1
            continue
        worked += 1
        why = use(body, number) if kind == "forged" else "another body" if written(body) != whole else None
        if why:
            sys.exit(f"case {number}: {words}: {why}")
    signal.alarm(0)
    print(refused, worked)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:5])
