"""Modal files cut short at every byte, with flipped bits, and with forged contents under a right checksum.

Run from the repository's root: python -m benchmarks.altered_files [--kinds flip forged] [--flips N] [--forged N]
[--output FILE.csv]. A file must be refused, or hold what was written; a forged one may be read, and the core, compiled
with AddressSanitizer and UndefinedBehaviorSanitizer where gcc has them, must answer every call about it
(`tests/modal_fuzzer.py`). Prints each case that ends a process, does not end, or gives nonsense, goes on after it, and
writes a line for each kind.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import h5py

from flexfmu.core import building

from .records import read_records, write_records

HERE = Path(__file__).parent
FUZZER = HERE.parent / "tests" / "modal_fuzzer.py"
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
# Cases of one process.
PORTION = 2500


@dataclass(frozen=True)
class Record:
    """Files of one kind.

    Attributes
    ----------
    kind : str
    refused, worked, failed : int
        Cases that were refused, that worked, and that went wrong.
    sanitizers : str
        Of the core.
    seconds : float
    hdf5 : str
    """

    kind: str
    refused: int
    worked: int
    failed: int
    sanitizers: str
    seconds: float
    hdf5: str


def checked_core(folder: Path) -> tuple[Path, str] | None:
    """The core compiled with sanitizers, and what has to be loaded before it; None without gcc."""
    compiler = shutil.which("gcc")
    if compiler is None:
        return None
    path = folder / "core.so"
    done = subprocess.run(building.command([compiler], path, extra=SANITIZERS), capture_output=True, check=False)
    found = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    runtime = Path(found.stdout.strip())
    return (path, str(runtime.resolve())) if done.returncode == 0 and runtime.is_absolute() else None


def run(kind: str, count: int, core: tuple[Path, str] | None) -> Record:
    """Run the cases of a kind; one that ends its process is told, and left behind."""
    environment = os.environ | {"PYTHONPATH": str(FUZZER.parent)}
    words = []
    if core:
        words = [str(core[0])]
        # What Python itself never gives back is no concern here. More memory than there is must be refused.
        environment |= {"LD_PRELOAD": core[1], "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1"}
    refused = worked = failed = number = 0
    start = time.perf_counter()
    while number < count:
        portion = min(PORTION, count - number)
        command = [sys.executable, str(FUZZER), kind, str(number), str(portion), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if done.returncode == 0:
            one, other = (int(word) for word in done.stdout.splitlines()[-1].split())
            refused, worked, number = refused + one, worked + other, number + portion
            if one + other < portion:
                break
        else:
            cases = [int(line) for line in done.stderr.splitlines() if line.isdigit()]
            if not cases:
                raise RuntimeError(done.stderr)
            tail = "\n".join(done.stderr.splitlines()[-8:])
            print(f"{kind} {cases[-1]}: ended with {done.returncode}\n{tail}", flush=True)
            # The others of this portion count with those before them.
            failed, number = failed + 1, cases[-1] + 1
            worked += len(cases) - 1
    checks = "address, undefined" if core else "none"
    seconds = round(time.perf_counter() - start)
    return Record(kind, refused, worked, failed, checks, seconds, h5py.version.hdf5_version)


def main(counts: dict[str, int], path: Path | None) -> list[Record]:
    """Run kinds of so many cases and write the records; those of other kinds stay."""
    records = []
    with tempfile.TemporaryDirectory() as folder:
        core = checked_core(Path(folder))
        # Files that are cut or flipped reach no core.
        for kind, count in counts.items():
            record = run(kind, count, core if kind == "forged" else None)
            print(record, flush=True)
            records.append(record)
    if path:
        others = [row for row in read_records(path) if row["kind"] not in counts] if path.exists() else []
        write_records(path, [*others, *(asdict(record) for record in records)])
    return records


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=["truncation", "flip", "forged"])
    parser.add_argument("--flips", type=int, default=10**4)
    parser.add_argument("--forged", type=int, default=2000)
    parser.add_argument("--output", type=Path)
    arguments = parser.parse_args()
    number = {"truncation": sys.maxsize, "flip": arguments.flips, "forged": arguments.forged}
    found = main({kind: number[kind] for kind in arguments.kinds}, arguments.output)
    raise SystemExit(any(record.failed for record in found))
