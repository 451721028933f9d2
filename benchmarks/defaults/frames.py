"""What more frames bring: the worst displacement error at full load over 1 to 16 frames.

``python -m benchmarks.defaults.frames [body ...]`` builds with ``frames = n``, compares with the kept results of
CalculiX and keeps ``frames.csv``; bodies that are not named keep their rows.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.defaults.body import Body
from benchmarks.defaults.measure import measure
from benchmarks.defaults.published import EVERY
from benchmarks.records import read_records, write_records

RECORDS = Path(__file__).with_name("frames.csv")
FRAMES = (1, 2, 4, 8, 16)
# The case of each body; none: the worst of all.
BODIES = {"c_clip": "", "serpentine": "", "leaf_spring": "", "folded_flexure": "far aside"}


def errors(body: Body, case: str) -> dict[str, str]:
    """The largest displacement error at full load over the largest displacement, by frames; nan: refused."""
    cases = {case: body.cases[case]} if case else body.cases
    found = {}
    for frames in FRAMES:
        rows = measure(replace(body, cases=cases, shares=body.shares[-1:], frames=frames))
        every = [str(row["displacement_error"]) for row in rows]
        found[f"frames_{frames}"] = "nan" if "nan" in every else max(every, key=float)
    return found


def main(names: Sequence[str]) -> int:
    """Run the bodies named, or all."""
    known = {make.__name__: make for make in EVERY}
    kept = {row["body"]: dict(row) for row in read_records(RECORDS)} if RECORDS.exists() else {}
    for name in names or BODIES:
        kept[name] = {"body": name, "case": BODIES[name] or "worst"} | errors(known[name](), BODIES[name])
        print(*kept[name].values(), flush=True)
        write_records(RECORDS, [kept[body] for body in BODIES if body in kept])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
