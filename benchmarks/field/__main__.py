"""Run all problems, print the tables and write the records: python -m benchmarks.field [problem ...]."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.field import mechanisms, motion, others, rotor, short, statics
from benchmarks.field.records import Record, tables
from benchmarks.records import write_records

PROBLEMS: dict[str, Callable[[], list[Record]]] = {
    "bend": statics.bend_records,
    "elastica": statics.elastica_records,
    "rolling": statics.rolling_records,
    "princeton": statics.princeton_records,
    "right_angle": statics.right_angle_records,
    "arch": statics.arch_records,
    "roof": statics.roof_records,
    "lee": statics.lee_records,
    "twisted": short.twisted_records,
    "annulus": short.annulus_records,
    "half_cylinder": short.half_cylinder_records,
    "flutter": motion.flutter_records,
    "spin_up": motion.rotating_beam_records,
    "kane": motion.kane_records,
    "flight": motion.flight_records,
    "tumbling": motion.tumbling_records,
    "mechanisms": mechanisms.mechanism_records,
    "rotor": rotor.rotor_records,
    "sudden": others.sudden_records,
    "exudyn": others.exudyn_records,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the problems named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problem", nargs="*", help=f"any of {', '.join(PROBLEMS)} (default: all)")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("field.csv"))
    chosen = parser.parse_args(arguments)
    unknown = sorted(set(chosen.problem) - set(PROBLEMS))
    if unknown:
        parser.error(f"unknown problem {', '.join(unknown)}: choose from {', '.join(PROBLEMS)}")
    records = [record for name in chosen.problem or PROBLEMS for record in PROBLEMS[name]()]
    print(tables(records))
    if not chosen.problem:
        write_records(chosen.output, [record.row() for record in records])
    return 0


if __name__ == "__main__":
    sys.exit(main())
