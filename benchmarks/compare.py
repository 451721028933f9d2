"""Two runs of a benchmark side by side, by ratio.

Run from the repository's root: python -m benchmarks.compare OLD.csv NEW.csv [--column median]. Machines differ, and are
busy for a while: each time is divided by that of its own run's first row, which is the empty FMU. What is printed is
how that share has changed.
"""

import argparse
from pathlib import Path

from .records import WHERE, numbers, read_records


def compared(old: Path, new: Path, column: str) -> list[tuple[str, float, float]]:
    """Shares of the first row's time, in the old run and in the new one.

    Parameters
    ----------
    old, new : Path
        Records of the same benchmark.
    column : str
        Of the times.

    Returns
    -------
    list of (what, old share, new share)
        Rows that both have, in the order of the new run.

    Raises
    ------
    SystemExit
        A column that one of them does not have.
    """
    shares = []
    for path in (old, new):
        rows = read_records(path)
        if not rows or column not in rows[0]:
            known = ", ".join(rows[0]) if rows else "nothing"
            raise SystemExit(f"{path}: no column {column!r}, found {known}; choose one by --column")
        times = numbers(rows, column)
        # What is measured stands in the columns of words.
        words = [key for key in rows[0] if key not in WHERE and not any(x == x for x in numbers(rows, key))]
        shares.append({", ".join(row[key] for key in words): t / times[0] for row, t in zip(rows, times, strict=True)})
    before, after = shares
    return [(what, before[what], share) for what, share in after.items() if what in before]


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--column", default="median", help="of the times")
    options = parser.parse_args()
    print("what | old | new | new / old, each as a multiple of its run's first row")
    for what, before, after in compared(options.old, options.new, options.column):
        print(f"{what} | {before:.4g} | {after:.4g} | {after / before:.2f}")


if __name__ == "__main__":
    main()
