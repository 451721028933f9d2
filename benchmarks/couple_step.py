"""What a communication step of `flexfmu couple` costs: two clamped beams, tip to tip by a bushing, one of them loaded.

Once more as FMUs of another program, which run in a process of their own.

Run from the repository's root: python -m benchmarks.couple_step [--output FILE.csv]. Prints a table and writes the
records: processor time a step, by runs of two lengths, so that the start of a run does not count.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path

from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.master import couple, parse_coupling

from .records import write_records

HERE = Path(__file__).parent
BODY = HERE.parent / "demo" / "clamped_beam" / "body.toml"
STEPS, RUNS = 8000, 3
# N/m and N m/rad: soft for what grows by steps, stiff for what iterates.
SOFT, STIFF = [2e3] * 3 + [1e1] * 3, [2e6] * 3 + [1e4] * 3
FOREIGN = ", foreign"
SCHEMES = {
    "jacobi": ({"scheme": "jacobi", "step": 1e-4}, SOFT),
    "gauss_seidel": ({"scheme": "gauss_seidel", "step": 1e-4}, SOFT),
    "iterated, end": ({"scheme": "iterated", "step": 5e-4}, STIFF),
    "iterated, mean": ({"scheme": "iterated", "step": 5e-4, "held": "mean"}, STIFF),
}
SCHEMES |= {name + FOREIGN: SCHEMES[name] for name in ("jacobi", "iterated, end")}


@dataclass(frozen=True)
class Record:
    """A scheme's cost.

    Attributes
    ----------
    scheme : str
    seconds : float
        Of a communication step, the least of some runs.
    iterations : float
        A step.
    """

    scheme: str
    seconds: float
    iterations: float


def used() -> float:
    """Processor time so far, with that of processes that have ended, s."""
    return time.process_time() + sum(os.times()[2:4])


def spent(folder: Path, scheme: str, steps: int) -> tuple[float, float]:
    """Processor time of a run, s, and iterations a step."""
    experiment, stiffness = SCHEMES[scheme]
    file = "foreign.fmu" if scheme.endswith(FOREIGN) else "beam.fmu"
    content = {
        "experiment": {**experiment, "stop": steps * experiment["step"]},
        "fmu": [{"name": "a", "file": file, "start": {"tip.force.y": 100.0}}, {"name": "b", "file": file}],
        "spring": [{"a": "a.tip", "b": "b.tip", "stiffness": stiffness}],
    }
    coupling = parse_coupling(content, folder)
    begun = used()
    result = couple(coupling)
    return used() - begun, float(result["master.iterations"][1:].mean())


def main(output: Path) -> None:
    """Measure, print and write."""
    records = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        package_fmu(reduce_body(read_body_file(BODY), Reporter()), folder / "beam.fmu")
        with zipfile.ZipFile(folder / "beam.fmu") as own, zipfile.ZipFile(folder / "foreign.fmu", "w") as other:
            for entry in own.namelist():
                other.writestr(entry, own.read(entry).replace(b'generationTool="flexfmu', b'generationTool="other'))
        for scheme in SCHEMES:
            runs = [(spent(folder, scheme, STEPS), spent(folder, scheme, STEPS // 4)[0]) for _ in range(RUNS)]
            seconds = min((long - short) / (STEPS - STEPS // 4) for (long, _), short in runs)
            records.append(Record(scheme, seconds, runs[0][0][1]))
            print(f"{scheme:16} {1e6 * seconds:6.1f} µs a step, {records[-1].iterations:.2f} iterations", flush=True)
    write_records(output, [asdict(record) for record in records])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=HERE / "couple_step.csv")
    main(parser.parse_args().output)
