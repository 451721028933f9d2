"""Maps of stability of bodies with the shortest body file: up to which loads a method is right, or says that it is not.

``python -m benchmarks.defaults.maps [body ...]`` keeps ``maps/NAME.csv`` and draws ``maps/NAME.png``. Loads go to twice
those of the record; the reference is that of `flexfmu chart --stability`. Default: the second blind trial.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.defaults.body import Body
from benchmarks.defaults.fresh import FRESH
from benchmarks.defaults.published import EVERY
from benchmarks.records import read_records
from flexfmu.calls.functions import stability

MAPS = Path(__file__).with_name("maps")
SWEEP = """[sweep]
frames = [1, 2, 4]
methods = ["linear", "frames", "second_order"]

[stability]
factors = [0.1, 0.2, 0.4, 0.7, 1.0, 1.4, 2.0]
"""


def scene(body: Body) -> str:
    """Scene file of a body's cases."""
    lines = []
    for case, forces in body.cases.items():
        words = [
            f'"{name}.force.{axis}" = {size:g}'
            for name, force in forces.items()
            for axis, size in zip("xyz", force, strict=True)
            if size
        ]
        lines += ["[[static]]", f'name = "{case.replace(" ", "_")}"', f"loads = {{ {', '.join(words)} }}", ""]
    return "\n".join([*lines, SWEEP])


def draw(body: Body, folder: Path) -> str:
    """Run what the records of a body lack, and draw its map; how many runs came to which verdict."""
    with tempfile.TemporaryDirectory() as top:
        path, file = body.write(Path(top)), Path(top) / "scene.toml"
        file.write_text(scene(body), encoding="utf-8")
        records = folder / f"{body.name}.csv"
        return stability(path, file, records, picture=records.with_suffix(".png")).finding


def counted(records: Path, model: str = "") -> dict[str, int]:
    """Runs by verdict, of all models or one."""
    found: dict[str, int] = {}
    for row in read_records(records):
        if model in ("", row["model"]):
            found[row["verdict"]] = found.get(row["verdict"], 0) + 1
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Map the bodies named, or the second blind trial."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    known = {make.__name__: make for make in EVERY}
    parser.add_argument("body", nargs="*", help=f"any of {', '.join(known)}")
    parser.add_argument("--output", type=Path, default=MAPS)
    chosen = parser.parse_args(arguments)
    chosen.output.mkdir(exist_ok=True)
    for name in chosen.body or [make.__name__ for make in FRESH]:
        body = known[name]()
        if not body.free:
            print(f"{name}: {draw(body, chosen.output)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
