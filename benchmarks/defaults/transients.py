"""Motion of four bodies by the shortest body file: `python -m benchmarks.defaults.transients`.

Clamped beam and L-frame under a sudden load, against CalculiX; a bracket, against lumps on eight frames with all static
shapes and short steps, since CalculiX has not run it; a beam that is spun up, its lag against the published one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.defaults.shapes import FloatArray
from benchmarks.field.exudyn_results import SPUN
from benchmarks.field.motion import SIMO, rotating_beam, spin_up
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import ReductionTable
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Mass, Method
from flexfmu.study.scene.reference import by_default

DEMO = Path(__file__).parents[2] / "demo"
FORCES = {"clamped_beam": (0.0, 5e3, 0.0), "l_frame": (0.0, 0.0, 1.7e3), "bracket": (15.0, 0.0, 0.0)}
# Seconds of the bracket's motion, and between places that count; internal steps of its reference in each.
_LONG, _APART, _FINE = 0.1, 1e-3, 8


def swing(body: FlexibleBody, force: tuple[float, ...], times: FloatArray) -> FloatArray:
    """Displacement (n, 3) of the tip at times (n,), from rest, undamped."""
    state, found = body.rest(), [np.zeros(3)]
    for step in np.diff(times):
        state = body.step(state, {"tip": list(force)}, float(step))
        found.append(body.response(state).displacement[0])
    return np.array(found)


def sudden(name: str) -> float:
    """Error of the tip, rms over that of its motion, of a demo's body with nothing said of basis, frames and method."""
    config: BodyFile = read_body_file(DEMO / name / "body.toml")
    body = FlexibleBody(reduce_body(by_default(config), Reporter()), damping_scale=0.0)
    kept = DEMO / name / "calculix" / "sudden_load.csv"
    if kept.exists():
        table = np.genfromtxt(kept, delimiter=",", names=True)
        times, expected = table["time_s"], np.stack([table[f"u{axis}_m"] for axis in "xyz"], axis=1)
    else:
        times = np.linspace(0.0, _LONG, round(_LONG / _APART) + 1)
        reduction = ReductionTable(modes=20, residual_flexibility=True, second_order=True, inertia=True)
        fine = by_default(config).model_copy(update={"frames": 8, "reduction": reduction})
        lumps = FlexibleBody(
            reduce_body(fine, Reporter()), Method.SECOND_ORDER, Mass.CONFIGURATION, 0.0, StepLimits(1e-5)
        )
        fine_times = np.linspace(0.0, _LONG, _FINE * (len(times) - 1) + 1)
        expected = swing(lumps, FORCES[name], fine_times)[::_FINE]
    off = swing(body, FORCES[name], times) - expected
    return float(np.linalg.norm(off) / np.linalg.norm(expected))


def spun_up() -> float:
    """Error of the lag of a beam that is spun up, rms over four times."""
    found, _ = spin_up(rotating_beam(SIMO), SIMO.length, Mass.POLYNOMIAL)
    words = {at: f"lag at {at:g} s, m" for at in (5.0, 7.5, 10.0, 12.5)}
    ours, published = (
        np.array(one) for one in zip(*((found[at][0], SPUN[key]) for at, key in words.items()), strict=True)
    )
    return float(np.linalg.norm(ours - published) / np.linalg.norm(published))


def main() -> None:
    """Print the four errors."""
    for name in FORCES:
        print(f"{name}, sudden load: {100.0 * sudden(name):.2g} % rms", flush=True)
    print(f"spin-up, lag: {100.0 * spun_up():.2g} % rms")


if __name__ == "__main__":
    main()
