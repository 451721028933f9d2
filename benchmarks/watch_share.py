"""What watching costs: mean and worst step of a native FMU with its watches on, over its mean step without.

Run from the repository's root: python -m benchmarks.watch_share [--output FILE.csv]. The clamped beam with two frames
and four interfaces, as in `benchmarks.core_step`, under a load that grows and falls: bent by 5 % of its length, or
pressed until it is warned of. Both variants run in turn; of each step the least of many runs counts. Needs a C compiler
and Linux.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np

from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method

from .core_step import INTERFACES, STEP, beam, compiled
from .records import write_records

BLOCKS, REPEATS = 800, 100
LOADS = {"bent": {"force.y": 500.0}, "pressed": {"force.x": -2.0e4, "force.y": 50.0}}


def steps(
    program: Path,
    fmu: Path,
    loads: dict[str, float],
    variants: tuple[str, ...] = ("1,{off}", "1"),
    blocks: int = BLOCKS,
    repeats: int = REPEATS,
    block: int = 1,
) -> np.ndarray:
    """Seconds of each variant (see steps.c): to make an instance, then of a step of each block of steps.

    {off} stands for parameters that switch all watches off but the one that shortens internal steps: that is accuracy.
    """
    place = fmu.with_suffix("")
    if not place.exists():
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(place)
    description = fmpy.read_model_description(str(fmu), validate=False)
    references = {v.name: v.valueReference for v in description.modelVariables}
    counts = [sum(v.causality == kind for v in description.modelVariables) for kind in ("input", "output")]
    limits = [name for name in references if name.startswith("watch.") and name.endswith(".limit")]
    off = ",".join(f"{references[name]}=0" for name in limits if name != "watch.steps_missed.limit")
    pairs = [f"{r}={size}" for name, r in references.items() for end, size in loads.items() if name.endswith(end)]
    library = place / "binaries" / "linux64" / f"{description.coSimulation.modelIdentifier}.so"
    words = [
        program,
        library,
        description.guid,
        f"file://{place}/resources",
        *counts,
        STEP,
        block,
        blocks,
        repeats,
    ]
    words += [",".join(pairs) or "0=0", *(text.format(off=off) for text in variants)]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=True)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


def measure(output: Path) -> None:
    """Build, time, print a table, write the records."""
    rows: list[dict[str, object]] = []
    print(
        "| method, modes | load | mean without, µs | mean with | worst without | worst with |",
        "|---|---|---|---|---|---|",
        sep="\n",
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = compiled(folder, "steps.c", "steps", "-ldl")
        for modes in (20, 80):
            body = beam(INTERFACES, 2, modes=modes)
            for method in (Method.SECOND_ORDER, Method.LINEAR):
                fmu = folder / f"{method.value}_{modes}.fmu"
                package_fmu(replace(body, method=method), fmu)
                for load, forces in LOADS.items():
                    # The first step makes what all of one length have in common.
                    alone, watched = steps(program, fmu, forces)[2:].T
                    mean = alone.mean()
                    shares = [watched.mean() / mean, alone.max() / mean, watched.max() / mean]
                    print(
                        f"| `{method.value}`, {modes} | {load} | {1e6 * mean:.2g} | "
                        + " | ".join(f"{x:.2f}" for x in shares)
                        + " |"
                    )
                    names = ("mean_with", "worst_without", "worst_with")
                    rows.append(
                        {"modes": modes, "method": method.value, "load": load, "mean_without": f"{mean:.4g}"}
                        | {key: f"{share:.4g}" for key, share in zip(names, shares, strict=True)}
                    )
    write_records(output, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("watch_share.csv"))
    measure(parser.parse_args().output)
