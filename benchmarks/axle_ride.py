"""The ride over a bump with every model of the rear axle's chart: whether the coupling settles, and in how many rounds.

Run from the repository's root: python -m benchmarks.axle_ride [--output FILE.csv] [--internal-step 0.01 …]. Prints a
line a ride and writes the records. A ride that stops has the reason as its note. `--resume` leaves out what the records
hold already.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import get_type_hints

HERE = Path(__file__).parent
ROOT = HERE.parent
MARK = "RESULT "
# As short as shows it all: the wheel runs up the bump, leaves the road behind it and lands.
BEGIN, STOP = 0.02, 0.16


@dataclass(frozen=True)
class Record:
    """One ride.

    Attributes
    ----------
    method, internal_step : str
    modes, frames : int
        As the chart counts them; −1: the frames of the body file.
    steps : int
        Communication steps that settled.
    rounds, most_rounds : float
        Times that a step was taken: mean and largest.
    travel, toe : float
        Largest rise of the left wheel, m, and its toe-in then, degrees.
    seconds : float
    note : str
        Why the ride stopped.
    """

    method: str
    internal_step: str
    modes: int
    frames: int
    steps: int
    rounds: float
    most_rounds: float
    travel: float
    toe: float
    seconds: float
    note: str


def ride(folder: Path, preload: float, axle: dict[str, float | str], stop: float = STOP) -> dict[str, float | str]:
    """Ride once; in a process of its own, since FMUs end up in it."""
    from demo.rear_axle.alignment import LEFT, alignment
    from demo.rear_axle.road.scene import Ride, coupling, motion

    from flexfmu.files.basics import StoppedError
    from flexfmu.master import couple

    set_up = coupling(Ride(begin=BEGIN, stop=stop, cut=True, axle=axle), preload, folder)
    begun, note = time.perf_counter(), ""
    try:
        result = couple(set_up)
    except StoppedError as stopped:
        result, note = stopped.result, str(stopped)
    seconds = time.perf_counter() - begun
    moved = motion(result, "left")
    found, rounds = alignment(moved[:, :3], moved[:, 3:], LEFT), result["master.iterations"][1:]
    top = int(found.travel.argmax())
    return {
        "steps": len(rounds),
        "rounds": float(rounds.mean()) if len(rounds) else 0.0,
        "most_rounds": float(rounds.max()) if len(rounds) else 0.0,
        "travel": float(found.travel[top]),
        "toe": float(found.toe[top]),
        "seconds": seconds,
        "note": note,
    }


def ridden(folder: Path, preload: float, axle: dict[str, float | str]) -> dict[str, float | str]:
    """The same from another process."""
    command = [sys.executable, "-m", "benchmarks.axle_ride", "--ride", str(folder), str(preload), json.dumps(axle)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if not lines:
        raise RuntimeError(done.stderr)
    return json.loads(lines[-1].removeprefix(MARK))


def read_records(path: Path) -> list[Record]:
    """Records of an earlier run."""
    kinds = get_type_hints(Record)
    with path.open(newline="", encoding="utf-8") as file:
        return [Record(**{name: kinds[name](value) for name, value in row.items()}) for row in csv.DictReader(file)]


def measure(folder: Path, internal_steps: list[str] | None, known: set[tuple[str | int, ...]]) -> Iterator[Record]:
    """Ride with every model of the chart, or those of some internal steps, that is not known yet."""
    from demo.rear_axle.road.models import build_model, chart_models, parameters
    from demo.rear_axle.road.scene import WHEEL, Ride, build_axle, build_wheel, coil_preload

    from flexfmu.files.outputs import Reporter

    preload = coil_preload(build_axle(folder, Reporter()), Ride())
    build_wheel(folder)
    for reduction, models in chart_models():
        here = folder / f"{reduction.modes}_{reduction.frames}"
        chosen = [
            one
            for one in models
            if (internal_steps is None or one.internal_step_word in internal_steps)
            and (one.variant.method.value, one.internal_step_word, reduction.modes, reduction.frames) not in known
        ]
        if chosen:
            build_model(reduction, models, here, Reporter())
            shutil.copy(folder / WHEEL, here / WHEEL)
        for model in chosen:
            record = Record(
                model.variant.method.value,
                model.internal_step_word,
                reduction.modes,
                reduction.frames,
                **ridden(here, preload, parameters(model)),
            )
            words = f"{record.method:14} {record.internal_step:6} {record.modes:3} modes"
            words += f" {record.frames:2} frames: {record.steps} steps, {record.rounds:.2f} rounds, at most "
            words += f"{record.most_rounds:.0f}, {record.toe:+.3f}°, {record.seconds:.1f} s"
            print(words + (f"; {record.note}" if record.note else ""), flush=True)
            yield record


def row_of(record: Record) -> dict[str, str | int]:
    """A line of the records."""
    return {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in asdict(record).items()}


def main(path: Path, internal_steps: list[str] | None, resume: bool) -> list[Record]:
    """Measure and write the records."""
    records = read_records(path) if resume and path.exists() else []
    known: set[tuple[str | int, ...]] = {(one.method, one.internal_step, one.modes, one.frames) for one in records}
    with tempfile.TemporaryDirectory() as folder, path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Record)], lineterminator="\n")
        writer.writeheader()
        for record in records:
            writer.writerow(row_of(record))
        for record in measure(Path(folder), internal_steps, known):
            writer.writerow(row_of(record))
            file.flush()
            records.append(record)
    print(f"\n{sum(not one.note for one in records)} of {len(records)} rides ran to the end; records: {path}")
    return records


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=HERE / "axle_ride.csv")
    parser.add_argument("--internal-step", nargs="+", help="of the chart's internal steps these alone")
    parser.add_argument("--resume", action="store_true", help="leave out what the records hold already")
    parser.add_argument("--ride", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.ride:
        where, coil, chosen = arguments.ride
        print(MARK + json.dumps(ride(Path(where), float(coil), json.loads(chosen))))
    else:
        main(arguments.output, arguments.internal_step, arguments.resume)
