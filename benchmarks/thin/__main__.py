"""Thin bodies of shells and beams by `flexfmu build` with the shortest body file, driven through the FMU, by CalculiX.

Run from the repository's root: ``python -m benchmarks.thin [body ...]``. Prints the table; all bodies: writes
``thin.csv``. References are those of `benchmarks.thin.bodies`: S8R, or solids where the body is not of shells alone.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.defaults.run_fmu import Built
from benchmarks.records import read_records, write_records
from benchmarks.thin.bodies import BESIDE_SOLIDS, RESULTS, Middle

RECORDS = Path(__file__).with_name("thin.csv")
BODY = 'name = "thin"\n[mesh]\nfile = "body.inp"\n[[interface]]\nname = "tip"\nnodes = "TIP"\n'
# Bodies whose tip moves by a fifth to a third of their length.
FAR = ("strip", "laminate", "long channel", "twisted channel", "long tee", "long tube", *BESIDE_SOLIDS)
RIGHT = 0.01


def row(name: str) -> dict[str, object]:
    """What the FMU says of a body under its load: error of the displacement, own estimate, and whether it is told."""
    body = BESIDE_SOLIDS.get(name) or Middle(name)
    deck = body.deck if name in BESIDE_SOLIDS else body.deck()
    kept = next(one for one in read_records(RESULTS) if one["body"] == name)
    expected, linear = (np.array([float(kept[f"{u}{axis}_m"]) for axis in "xyz"]) for u in "uv")
    points = body.mesh.points if name in BESIDE_SOLIDS else body.points
    with tempfile.TemporaryDirectory() as top:
        file = Path(top) / "body.toml"
        (Path(top) / "body.inp").write_text(deck, encoding="ascii")
        file.write_text(BODY, encoding="utf-8")
        with Built(file) as built:
            point = built.point({"tip": body.force}, ["tip"])
    size = np.linalg.norm(expected)
    error = np.linalg.norm(point.motion[0, :3] - expected) / size
    estimate = point.estimate[0, 0] / size
    told = bool(point.log) or estimate > RIGHT
    word = "right" if error <= RIGHT else "told" if told else "silent"
    return {
        "body": name,
        "reference": "solids" if name in BESIDE_SOLIDS else "S8R",
        "moved": f"{size / np.ptp(points, axis=0).max():.4g}",
        "linear": f"{np.linalg.norm(linear - expected) / size:.4g}",
        "error": f"{error:.4g}",
        "estimate": f"{estimate:.4g}",
        "word": word,
        "log": " | ".join(line[:160] for line in point.log),
        "build": f"{built.seconds:.3g}",
    }


def main() -> None:
    """Measure the bodies named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("body", nargs="*", help=f"any of {', '.join(FAR)} (default: all)")
    chosen = parser.parse_args().body
    rows = []
    for name in chosen or FAR:
        rows.append(row(name))
        print(*rows[-1].values(), sep=" | ", flush=True)
    if not chosen:
        write_records(RECORDS, rows)


if __name__ == "__main__":
    main()
