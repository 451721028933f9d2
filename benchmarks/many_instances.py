"""What instances of one FMU cost in one process: a step of each of a thousand over a step of one, at rest and bent.

Run from the repository's root: python -m benchmarks.many_instances [--output FILE.csv]. The body of
`benchmarks.watch_share`; all variants run in turn, and the least of several runs of each block of steps counts. Also
the time to make and initialise an instance, where others have been made. Needs a C compiler and Linux.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method

from .core_step import INTERFACES, beam, compiled
from .records import write_records
from .watch_share import LOADS, steps

# Steps follow each other between two readings of the clock, which takes some 50 ns itself. Loads grow and fall once.
MANY, BLOCK, BLOCKS, REPEATS = 1000, 10, 48, 3


def measure(output: Path) -> None:
    """Build, time, print a table, write the records."""
    rows: list[dict[str, object]] = []
    print("| method, modes | load | µs, one | many | without watches, one | many | make one, ms |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = compiled(folder, "steps.c", "steps", "-ldl")
        variants = ("1", str(MANY), "1,{off}", f"{MANY},{{off}}")
        for modes in (20, 80):
            body = beam(INTERFACES, 2, modes=modes)
            for method in (Method.SECOND_ORDER, Method.LINEAR):
                fmu = folder / f"{method.value}_{modes}.fmu"
                package_fmu(replace(body, method=method), fmu)
                for load, forces in {"rest": {}, "bent": LOADS["bent"]}.items():
                    made, *times = steps(program, fmu, forces, variants, BLOCKS, REPEATS, BLOCK)
                    one, many, one_off, many_off = (f"{x:.4g}" for x in np.median(times[1:], axis=0))
                    row = {"modes": modes, "method": method.value, "load": load, "one": one, "many": many}
                    row |= {"one_without": one_off, "many_without": many_off, "made": f"{min(made):.4g}"}
                    rows.append(row)
                    cells = (f"{1e6 * float(x):.3g}" for x in (one, many, one_off, many_off))
                    print(f"| `{method.value}`, {modes} | {load} | {' | '.join(cells)} | {1e3 * min(made):.3g} |")
    write_records(output, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("many_instances.csv"))
    measure(parser.parse_args().output)
