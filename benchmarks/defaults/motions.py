"""Motion after a sudden load by the shortest body file, beside the mass of lumps on sixteen frames in short steps.

``python -m benchmarks.defaults.motions [body ...]`` keeps ``motions.csv``; others keep their rows. Undamped, from rest,
three slow periods in steps of a fiftieth, or a twentieth of the period of the fastest mode that has a tenth of the
static energy, under 0.2 and 0.5 of each full load. Held bodies in one piece; the reference has the same modes and the
mass of all of them, so what these lack (`truncation`) is not seen; ``sudden`` has CalculiX's motions.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np

from benchmarks.defaults.body import Body
from benchmarks.defaults.published import EVERY
from benchmarks.defaults.run_fmu import Built
from benchmarks.defaults.shapes import FloatArray
from benchmarks.records import read_records, write_records
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FormulationTable, OutputTable
from flexfmu.files.basics import RuntimeBodyError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method

RECORDS = Path(__file__).with_name("motions.csv")
SHARES, STEPS, FAST_STEPS, PERIODS = (0.2, 0.5), 50, 20, 3
# Share of the static energy from which a mode is one to be resolved.
SEEN = 0.1
FRAMES, TIGHT = 16, StepLimits(0.0, 1e-5)
TOLD = ("error", "inertia_missed", "steps_missed", "softness_missed", "truncation")
WRONG = 0.01


def reference(file: Path) -> FlexibleBody | None:
    """The body with the lumps of all its coordinates on many frames; None of one that is cut."""
    config = read_body_file(file)
    formulation = FormulationTable(method=Method.SECOND_ORDER, mass=Mass.CONFIGURATION)
    changes = {"frames": FRAMES, "formulation": formulation, "output": OutputTable(surface=False, error=False)}
    body = reduce_body(config.model_copy(update=changes), Reporter())
    return None if body.ties is not None else FlexibleBody(replace(body, mass_modes=body.mode_count), limits=TIGHT)


def step_length(model: FlexibleBody, loads: dict[str, list[float]]) -> float:
    """A communication step that resolves what the loads excite, s."""
    body = model.model
    places = [body.interface_names.index(name) for name in loads]
    force = np.einsum("iaj,ia->j", body.interface_displacement[places], np.array(list(loads.values())))
    energy = (force / body.angular_frequency) ** 2
    fastest = body.angular_frequency[energy > SEEN * energy.sum()].max()
    return float(2.0 * np.pi / max(STEPS * body.angular_frequency[0], FAST_STEPS * fastest))


def followed(model: FlexibleBody, loads: dict[str, list[float]], step: float, count: int) -> FloatArray:
    """Displacements (steps, interfaces, 3) of the reference, as far as it goes."""
    state, found = model.rest(), []
    for _ in range(count):
        try:
            state = model.step(state, loads, step)
        except RuntimeBodyError:
            break
        found.append(model.response(state).displacement.copy())
    return np.array(found).reshape(len(found), -1, 3)


def measure(body: Body) -> Iterator[dict[str, object]]:
    """Rows of a body: error of the motion, rms over rms of the interface that moves most, and what its FMU says."""
    size = float(np.ptp(body.mesh.points, axis=0).max())
    with tempfile.TemporaryDirectory() as top, Built(file := body.write(Path(top))) as built:
        if (model := reference(file)) is None:
            return
        # Bodies with the mass of lumps miss none of it.
        told = [word for word in TOLD if f"diagnostics.{word}" in built.names]
        period = 2.0 * np.pi / float(model.model.angular_frequency[0])
        shown = [f"{name}.displacement.{axis}" for name in body.interfaces for axis in "xyz"]
        for case, share in ((case, share) for case in body.cases for share in SHARES):
            loads = {name: [share * one for one in force] for name, force in body.cases[case].items()}
            step = step_length(model, loads)
            steps = int(np.ceil(PERIODS * period / step))
            log: list[str] = []
            found = fmpy.simulate_fmu(
                str(file.with_suffix(".fmu")),
                stop_time=steps * step,
                output_interval=step,
                start_values={f"{i}.force.{a}": x for i, f in loads.items() for a, x in zip("xyz", f, strict=True)},
                output=[*shown, *(f"diagnostics.{word}" for word in told)],
                logger=lambda *words, log=log: log.append(
                    words[-1].decode() if isinstance(words[-1], bytes) else words[-1]
                ),
            )
            expected = followed(model, loads, step, steps)
            own = np.stack([found[name] for name in shown], axis=1)[1:].reshape(-1, len(body.interfaces), 3)
            count = min(len(own), len(expected))
            whole = np.sqrt((expected[:count] ** 2).sum(-1).mean(0)).max()
            off = np.sqrt(((own[:count] - expected[:count]) ** 2).sum(-1).mean(0)).max()
            yield {
                "body": body.name,
                "case": case,
                "share": share,
                "steps": steps,
                "moved": f"{np.linalg.norm(expected, axis=-1).max() / size:.3g}",
                "motion_error": f"{off / whole:.3g}",
                **dict.fromkeys(TOLD, ""),
                **{word: f"{np.nanmax(found[f'diagnostics.{word}']):.3g}" for word in told},
                "log": ("" if len(own) == steps else "refused: ") + " | ".join(log)[:200],
            }


def summary(rows: Sequence[dict[str, str]]) -> str:
    """How many motions are right, told and silent; causes of alarms this reference cannot judge."""
    wrong = [row for row in rows if float(row["motion_error"]) > WRONG]
    silent = [row for row in wrong if not row["log"]]
    right = sum(float(row["motion_error"]) <= WRONG and not row["log"] for row in rows)
    told = f"{len(wrong) - len(silent)} of {len(wrong)} wrong ones told"
    text = f"{len(rows)} motions: {right} right and nothing said, {told}"
    return "\n".join([text, *(f"silent: {r['body']}, {r['case']}, {r['share']}: {r['motion_error']}" for r in silent)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bodies named, or all."""
    known = {make.__name__: make for make in EVERY if not make().free}
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("body", nargs="*", help=f"any of {', '.join(known)} (default: all)")
    parser.add_argument("--output", type=Path, default=RECORDS)
    chosen = parser.parse_args(arguments)
    rows: dict[str, list[dict[str, object]]] = {}
    for row in read_records(chosen.output) if chosen.output.exists() else []:
        rows.setdefault(row["body"], []).append(dict(row) | {word: row.get(word, "") for word in TOLD})
    for name in chosen.body or known:
        rows[name] = list(measure(known[name]()))
        print(summary([{k: str(v) for k, v in row.items()} for row in rows[name]]), name, flush=True)
        write_records(chosen.output, [row for key in known for row in rows.get(key, [])])
    print(summary([{k: str(v) for k, v in row.items()} for key in known for row in rows.get(key, [])]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
