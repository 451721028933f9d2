"""Random calls of the FMI functions of both versions: how many, and which took most of the processor.

Run from the repository's root: python -m benchmarks.fuzz [--calls 100000] [--output FILE.csv]. Every version runs once
with the core as it is and once under AddressSanitizer and UndefinedBehaviorSanitizer (Linux, gcc). A run that breaks a
rule ends it all with what is said. Prints a line a body and writes the records.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from flexfmu.core.building import command, system_compiler

from .records import write_records

HERE = Path(__file__).parent
TESTS = HERE.parent / "tests"
FUZZERS = {2: "fuzz_worker.py", 3: "fuzz_fmi3.py"}
KINDS = ("plain", "free", "cut", "masses", "stress")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O1", "-g")


def sanitized(folder: Path) -> tuple[Path, dict[str, str]]:
    """The core compiled with sanitizers, and the environment in which it runs."""
    compiler, core = system_compiler(), folder / "core.so"
    assert compiler is not None
    subprocess.run(command(compiler, core, None, SANITIZERS), check=True)
    first = [
        subprocess.run([*compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        for name in ("libasan.so", "libubsan.so")
    ]
    # Leaks are Python's.
    return core, {"LD_PRELOAD": " ".join(path.strip() for path in first), "ASAN_OPTIONS": "detect_leaks=0"}


def fuzz(version: int, fmus: list[Path], calls: int, core: Path | None, more: dict[str, str]) -> tuple[int, str, float]:
    """Calls made, and the slowest: its name and processor time, s."""
    words = [*map(str, fmus), "1", str(calls)]
    words += ["--library"] * (core is not None and version == 2) + [str(core)] * (core is not None)
    script = [sys.executable, str(TESTS / "native_master" / FUZZERS[version])]
    done = subprocess.run([*script, *words], capture_output=True, text=True, check=False, env=os.environ | more)
    lines = done.stdout.splitlines()
    if lines[-1:] != ["FINE"]:
        raise SystemExit(f"FMI {version}.0, {fmus[0].stem}: ended with {done.returncode}\n{done.stdout}\n{done.stderr}")
    told = {line.split()[0]: line.split()[1:] for line in lines if line}
    return int(told["CALLS"][0]), told["SLOWEST"][0], float(told["SLOWEST"][1])


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=100_000, help="of each version, over all bodies")
    parser.add_argument("--output", type=Path, default=HERE / "fuzz.csv")
    options, rows = parser.parse_args(), []
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as name:
        folder = Path(name)
        for version in FUZZERS:
            (folder / str(version)).mkdir()
            words = [str(folder / str(version)), "native", str(version)]
            subprocess.run([sys.executable, str(TESTS / "fuzzed.py"), *words], check=True)
        for title, (core, more) in {"as built": (None, {}), "sanitizers": sanitized(folder)}.items():
            for version in FUZZERS:
                for kind in KINDS:
                    fmus = [folder / "2" / f"{kind}.fmu", folder / "2" / f"{kind}_twin.fmu"]
                    if version == 3:
                        fmus[1] = folder / "3" / f"{kind}.fmu"
                    calls, slowest, seconds = fuzz(version, fmus, options.calls // len(KINDS), core, more)
                    row = {"fmi": version, "core": title, "body": kind, "calls": calls, "slowest": slowest}
                    rows.append(row | {"seconds": f"{seconds:.3g}"})
                    print("  ".join(map(str, rows[-1].values())), flush=True)
    write_records(options.output, rows)


if __name__ == "__main__":
    main()
