"""What a communication step of `flexfmu couple` costs: two clamped beams, tip to tip by a bushing, one of them loaded.

Run from the repository's root: python -m benchmarks.couple_step [--output FILE.csv]. Prints a table and writes the
records: processor time a step, by runs of two lengths, so that the start of a run does not count.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.progress import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.master import couple, parse_coupling

from .records import write_records

HERE = Path(__file__).parent
BODY = HERE.parent / "demo" / "clamped_beam" / "body.toml"
STEPS, RUNS = 8000, 3
# N/m and N m/rad: soft for what grows by steps, stiff for what iterates.
SOFT, STIFF = [2e3] * 3 + [1e1] * 3, [2e6] * 3 + [1e4] * 3
SCHEMES = {
    "jacobi": ({"scheme": "jacobi", "step": 1e-4}, SOFT),
    "gauss_seidel": ({"scheme": "gauss_seidel", "step": 1e-4}, SOFT),
    "iterated, end": ({"scheme": "iterated", "step": 5e-4}, STIFF),
    "iterated, mean": ({"scheme": "iterated", "step": 5e-4, "held": "mean"}, STIFF),
}


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


def spent(folder: Path, scheme: str, steps: int) -> tuple[float, float]:
    """Processor time of a run, s, and iterations a step."""
    experiment, stiffness = SCHEMES[scheme]
    content = {
        "experiment": {**experiment, "stop": steps * experiment["step"]},
        "fmu": [{"name": "a", "file": "beam.fmu", "start": {"tip.force.y": 100.0}}, {"name": "b", "file": "beam.fmu"}],
        "spring": [{"a": "a.tip", "b": "b.tip", "stiffness": stiffness}],
    }
    coupling = parse_coupling(content, folder)
    begun = time.process_time()
    result = couple(coupling)
    return time.process_time() - begun, float(result["master.iterations"][1:].mean())


def main(output: Path) -> None:
    """Measure, print and write."""
    records = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        package_fmu(reduce_body(read_body_file(BODY), Reporter()), folder / "beam.fmu")
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
