"""Error over frames and over modes for a beam, an arch, a plate and the L-frame, with a picture.

Run from the repository's root: python -m benchmarks.field.convergence [--draw]; `--draw` takes the kept records.
Writes ``convergence.csv`` and docs/figures/convergence.png, and prints the orders.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from demo.methods import CASES, HERE, Case

from benchmarks.field.bodies import FOLDER
from benchmarks.records import read_records, write_records
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import ReducedBody

RECORDS = FOLDER / "convergence.csv"
PICTURE = FOLDER.parents[1] / "docs" / "figures" / "convergence.png"
BODIES = ("clamped beam", "L-frame, out of plane", "shallow arch", "plate, bent")
FRAMES, MODES = (1, 2, 4, 8, 16), (5, 10, 20, 40)
METHODS = (Method.SECOND_ORDER, Method.FRAMES)
# Within this factor of their least, errors are what modes or the reference's digits leave out.
FLOOR = 3.0


def case(title: str) -> Case:
    """A load case of the demos."""
    return next(one for one in CASES if one.title == title)


def reduced(folder: str, frames: int, modes: int, residual: bool) -> ReducedBody:
    """A demo body with data of second order."""
    config = read_body_file(HERE / folder / "body.toml")
    changes = {"modes": modes, "residual_flexibility": residual, "second_order": True, "geometric_stiffness": None}
    table = config.reduction.model_copy(update=changes)
    plain = config.without_pictures.model_copy(update={"frames": frames, "frame": [], "reduction": table})
    return reduce_body(plain, Reporter())


def error(model: ReducedBody, method: Method, one: Case) -> float:
    """Error of the interfaces' displacements under the full load; NaN without equilibrium."""
    _, loads, expected = list(one.rows())[-1]
    body = FlexibleBody(model, method)
    found = body.response(body.static(loads)).displacement
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def measure(
    titles: Sequence[str] = BODIES, frames: Sequence[int] = FRAMES, modes: Sequence[int] = MODES
) -> Iterator[dict[str, object]]:
    """Records: 20 modes with residual flexibility over the frames; 4 frames of second order over normal modes."""
    for title in titles:
        one = case(title)
        for n in frames:
            model = reduced(one.folder, n, 20, residual=True)
            for method in METHODS:
                yield {
                    "body": title,
                    "over": "frames",
                    "count": n,
                    "method": method.value,
                    "error": error(model, method, one),
                }
        for m in modes:
            model = reduced(one.folder, 4, m, residual=False)
            method = Method.SECOND_ORDER
            yield {
                "body": title,
                "over": "modes",
                "count": m,
                "method": method.value,
                "error": error(model, method, one),
            }


def order(counts: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of the error over the count, until it is within three times its least; NaN where it begins there."""
    last = int(np.flatnonzero(np.asarray(errors) <= FLOOR * min(errors))[0])
    if last == 0:
        return math.nan
    return float(-np.polyfit(np.log(counts[: last + 1]), np.log(errors[: last + 1]), 1)[0])


def curves(records: Sequence[dict[str, str]]) -> dict[tuple[str, str, str], tuple[list[float], list[float]]]:
    """Counts and errors by what varies, method and body."""
    found: dict[tuple[str, str, str], tuple[list[float], list[float]]] = {}
    for row in records:
        counts, errors = found.setdefault((row["over"], row["method"], row["body"]), ([], []))
        counts.append(float(row["count"]))
        errors.append(float(row["error"]))
    return found


def draw(records: Sequence[dict[str, str]], path: Path) -> None:
    """Two panels: over frames, over modes."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.4), sharey=True, layout="constrained")
    # Okabe and Ito's, which all can tell apart.
    colours = dict(zip(BODIES, ("#0072B2", "#E69F00", "#009E73", "#CC79A7"), strict=True))
    for (over, method, title), (counts, errors) in curves(records).items():
        panel, first = panels[int(over == "modes")], method == Method.FRAMES.value
        name = f"{title}, order {order(counts, errors):.1f}".replace(", order nan", "")
        style = "o--" if first else "o-"
        panel.loglog(counts, [100.0 * e for e in errors], style, color=colours[title], label=None if first else name)
    panels[0].set_xlabel("frames (full lines: second order, dashed: frames)")
    panels[1].set_xlabel("normal modes (4 frames, no static shapes)")
    panels[0].set_ylabel("error at full load / %")
    panels[0].yaxis.set_major_formatter("{x:g}")
    for panel, ticks in zip(panels, (FRAMES, MODES), strict=True):
        panel.set_xticks(ticks, [str(n) for n in ticks])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Measure, unless told to draw the kept records, and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draw", action="store_true")
    if not parser.parse_args().draw:
        write_records(RECORDS, list(measure()))
    records = read_records(RECORDS)
    for (over, method, title), (counts, errors) in curves(records).items():
        shown = ", ".join(f"{100.0 * e:.2g}" for e in errors)
        print(f"| {title} | {method} | {over} | {shown} | {order(counts, errors):.1f} |")
    draw(records, PICTURE)


if __name__ == "__main__":
    main()
