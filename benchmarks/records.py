"""How measurements are kept: as CSV, each row with the commit, the day, the machine and the Python it was made on."""

import csv
import datetime
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from flexfmu.files.outputs import whole_file

WHERE = ("commit", "day", "machine", "python")
"""Columns that tell where a row was measured."""


def where() -> dict[str, str]:
    """Commit, day, machine and Python of this run.

    A commit with changes on top of it ends in "+"; outside of a clone it is empty.
    """
    root = Path(__file__).parent

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False, cwd=root)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return {
        "commit": git("rev-parse", "--short", "HEAD") + ("+" if changed else ""),
        "day": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": f"{platform.system()} {platform.machine()}, {_processor()}",
        "python": platform.python_version(),
    }


def write_records(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows of one kind, with where they were measured; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
    rows : iterable of mapping
        At least one; all of them with the keys of the first.
    """
    rows, here = list(rows), where()
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*(key for key in rows[0] if key not in WHERE), *WHERE], lineterminator="\n")
        writer.writeheader()
        writer.writerows(here | dict(row) for row in rows)


def read_records(path: Path) -> list[dict[str, str]]:
    """Rows of a file of measurements."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def numbers(rows: Sequence[Mapping[str, str]], column: str) -> list[float]:
    """A column's numbers; not a number where a row has none."""

    def number(text: str | None) -> float:
        try:
            return float(text or "nan")
        except ValueError:
            return float("nan")

    return [number(row.get(column)) for row in rows]


def _processor() -> str:
    """The processor's name, as Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
