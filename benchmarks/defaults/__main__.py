"""Build every body with the shortest body file, run its FMU, and compare with the kept results of CalculiX.

``python -m benchmarks.defaults [body ...]``; others keep their rows in ``defaults.csv``. CalculiX is not needed. With
``--kept FOLDER`` FMUs stay there, and a change of the core alone is measured in minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.defaults.measure import measure
from benchmarks.defaults.published import EVERY
from benchmarks.defaults.table import RECORDS, report
from benchmarks.records import read_records, write_records


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bodies named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    known = {make.__name__: make for make in EVERY}
    parser.add_argument("body", nargs="*", help=f"any of {', '.join(known)} (default: all)")
    parser.add_argument("--output", type=Path, default=RECORDS)
    parser.add_argument("--kept", type=Path, help="folder of FMUs that are built once, and run with the core of now")
    chosen = parser.parse_args(arguments)
    rows: dict[str, list[dict[str, object]]] = {}
    for row in read_records(chosen.output) if chosen.output.exists() else []:
        rows.setdefault(row["body"], []).append(dict(row))
    for name in chosen.body or known:
        rows[name] = measure(known[name](), kept=chosen.kept)
        print(report([{k: str(v) for k, v in row.items()} for row in rows[name]]), flush=True)
        write_records(chosen.output, [row for key in known for row in rows.get(key, [])])
    print(report([{k: str(v) for k, v in row.items()} for key in known for row in rows.get(key, [])]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
