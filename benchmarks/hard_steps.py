"""The longest calls of a step: hard loads in long steps, in multiples of the body's usual step.

Run from the repository's root: python -m benchmarks.hard_steps [--output FILE.csv]. Each call starts at rest and is
timed alone, the least of three; the usual step is one of 1 ms in a slow swing. Prints a line a call and writes them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from demo.clamped_beam.run import HERE as BEAM
from demo.rear_axle.run import HERE as AXLE

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, default_folder
from flexfmu.model.methods import Method

from .records import write_records

HERE = Path(__file__).parent
REPEATS, SWING, USUAL = 3, 5.0, 1e-3


@dataclass(frozen=True)
class Record:
    """One call.

    Attributes
    ----------
    body, load : str
    step : float
        s.
    answer : str
        "ok", or why it was refused.
    substeps, rounds : int
        Internal steps of the last try, rounds of all.
    seconds, usual : float
        Of the processor, for the call and for the usual step, s.
    """

    body: str
    load: str
    step: float
    answer: str
    substeps: int
    rounds: int
    seconds: float
    usual: float


def usual_step(body: FlexibleBody, interface: str, force: np.ndarray) -> float:
    """Seconds of a step of 1 ms under a force that swings slowly; the least of many."""
    best, state = np.inf, body.rest()
    for number in range(200):
        swung = np.sin(2.0 * np.pi * SWING * number * USUAL) * force
        inputs = body.loads({interface: swung.tolist()}).packed(body.model.masses is not None)
        start = time.process_time()
        state, _ = body.step_packed(state, inputs, USUAL)
        best = min(best, time.process_time() - start)
    return float(best)


def call(body: FlexibleBody, loads: Mapping[str, list[float]], step: float) -> tuple[str, int, int, float]:
    """Answer, internal steps, rounds and seconds of a step from rest."""
    inputs, rest = body.loads(loads).packed(body.model.masses is not None), body.rest()
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        answer, _, _, _, work = body.core.step(rest.q, rest.v, inputs, step)
        best = min(best, time.process_time() - start)
    return answer.name.lower() if answer else "ok", int(work[0]), int(work[1]), float(best)


def measure(name: str, body: FlexibleBody, interface: str, cases: list[tuple[str, list[float], float]]) -> list[Record]:
    """Records of a body."""
    usual = usual_step(body, interface, np.array([0.0, 1e3 if body.model.ties is None else 0.0, 1e3]))
    records = []
    for words, load, step in cases:
        record = Record(name, words, step, *call(body, {interface: load}, step), usual)
        print(f"{record}: {record.seconds / usual:.0f} usual steps", flush=True)
        records.append(record)
    return records


def main(path: Path) -> list[Record]:
    """Measure and write the records."""
    store, quiet = Store(default_folder()), Reporter()
    axle = read_body_file(AXLE / "body.toml")
    few = axle.reduction.model_copy(update={"modes": 6})
    plain = axle.model_copy(update={"frames": 1, "frame": [], "reduction": few})
    up = [(f"{size:g} kN up", [0.0, 0.0, 1e3 * size], 1e-2) for size in (1.0, 3.0, 5.0)]
    cases = [
        ("107 N m", [0.0, 0.0, 0.0, 107.0, 0.0, 0.0], 1.0),
        *up,
        ("1 kN along the arms", [1e3, 0.0, 0.0], 1e-2),
        ("1 kN up", [0.0, 0.0, 1e3], 0.1),
        ("50 kN up", [0.0, 0.0, 5e4], 0.1),
        ("400 kN up", [0.0, 0.0, 4e5], 1e-2),
    ]
    records = []
    for name, config in (("axle, cut, one frame a part", plain), ("axle, cut, of the body file", axle)):
        records += measure(name, FlexibleBody(reduce_body(config, quiet, store)), "wheel_left", cases)
    beam = read_body_file(BEAM / "body.toml").model_copy(update={"frames": 8})
    body = FlexibleBody(reduce_body(beam, quiet, store), Method.FRAMES)
    loads = [
        (f"{size:g} kN across", [0.0, 1e3 * size, 0.0], step)
        for size, step in ((10, 0.1), (20, 1.0), (200, 1.0), (2000, 1.0))
    ]
    records += measure("clamped beam, 8 frames", body, "tip", loads)
    rounded = [{k: f"{v:.4g}" if isinstance(v, float) else v for k, v in asdict(one).items()} for one in records]
    write_records(path, rounded)
    return records


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=HERE / "hard_steps.csv")
    main(parser.parse_args().output)
