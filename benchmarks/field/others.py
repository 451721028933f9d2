"""Exudyn's geometrically exact beam beside ours: kept results of `benchmarks.field.exudyn_beams`."""

from __future__ import annotations

import time

import numpy as np
from demo.clamped_beam import make_mesh

from benchmarks.field.exudyn_results import SPUN, kept
from benchmarks.field.records import Record, label
from benchmarks.field.statics import ELASTICA
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method

SUDDEN = "Clamped beam, sudden 5 kN"
SUDDEN_WORDS = "tip over 0.25 s, rms"


def exudyn_records() -> list[Record]:
    """Spin-up and elastica."""
    records = [
        Record("Spin-up, by Exudyn", "", words, model, values, (SPUN[words],), (), cost)
        for words, model, values, cost in kept("spin_up")
    ]
    for words, model, values, cost in kept("elastica"):
        across, along = ELASTICA[float(words.removeprefix("PL²/EI = "))]
        records.append(Record("Elastica, by Exudyn", "", words, model, values, (-along, across), (), cost))
    return records


def sudden_records(step: float = 2.5e-4) -> list[Record]:
    """Sudden load on the demo's clamped beam: ours and Exudyn's beside CalculiX."""
    folder = make_mesh.MODEL_FILE.parent
    table = np.genfromtxt(folder / "calculix" / "sudden_load.csv", delimiter=",", names=True)
    times = np.linspace(0.0125, 0.25, 20)
    moved = np.stack([np.interp(times, table["time_s"], table[f"u{axis}_m"]) for axis in "xy"], axis=1)
    config = read_body_file(folder / "body.toml")
    records, base = [], 0.0
    for method, frames, mass in (
        (Method.LINEAR, 1, Mass.CONSTANT),
        (Method.SECOND_ORDER, 1, Mass.CONSTANT),
        (Method.SECOND_ORDER, 2, Mass.CONSTANT),
        (Method.SECOND_ORDER, 1, Mass.CONFIGURATION),
        (Method.SECOND_ORDER, 2, Mass.CONFIGURATION),
    ):
        reduction = config.reduction.model_copy(update={"second_order": True, "inertia": True})
        changes = {"frames": frames, "frame": [], "reduction": reduction}
        model = reduce_body(config.model_copy(update=changes), Reporter())
        body = FlexibleBody(model, method, mass, damping_scale=0.0, limits=StepLimits())
        state, found, start = body.rest(), {}, time.perf_counter()
        for k in range(round(times[-1] / step)):
            state = body.step(state, {"tip": [0.0, 5e3, 0.0]}, step)
            found[k + 1] = state
        cost = (time.perf_counter() - start) / times[-1]
        base = base or cost
        ours = [body.response(found[round(at / step)]).displacement[0, :2] for at in times]
        name = label(method, frames) + ("" if method is Method.LINEAR else f", {mass.value} mass")
        both = tuple(map(float, np.ravel(ours))), tuple(map(float, moved.ravel()))
        records.append(Record(SUDDEN, "CalculiX", SUDDEN_WORDS, name, both[0], (), both[1], cost, cost / base))
    for _, name, values, cost in kept("sudden"):
        records.append(
            Record(SUDDEN, "CalculiX", SUDDEN_WORDS, name, values, (), tuple(map(float, moved.ravel())), cost)
        )
    return records
