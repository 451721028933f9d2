"""Whether the tests notice when one line of physics is wrong: changes of `mutations.toml`, one at a time.

Run from the repository's root: python -m benchmarks.mutations [--only WORDS] [--minutes N] [--output FILE.csv]. The
tree is copied to a temporary folder; there each change is made in turn and the tests that should notice run until the
first fails. A change is *killed* when one does, and *survives* when none does: then a test is missing. It takes about
three quarters of an hour. Each result is written at once; `--resume` leaves out what the records hold already, so that
a run can be ended (Ctrl-C, `--minutes`) and gone on with. `--random N [--seed S]` draws N changes instead
(random_mutations.py), and goes on with the record of that seed.
"""

from __future__ import annotations

import argparse
import csv
import platform
import subprocess
import tempfile
import time
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from benchmarks import random_mutations
from benchmarks.mutated import LONGEST, PACKAGE, Outcome, compile_core, copied, judged, library_of, run_tests

HERE = Path(__file__).parent
TABLE = HERE / "mutations.toml"


@dataclass(frozen=True)
class Change:
    """A change of one line, and the tests that should notice.

    Attributes
    ----------
    file : str
        Below the package.
    before, after : str
        Part of one line, found once in the file, and what takes its place.
    tests : str
        Arguments of pytest: files, test names, and -k with words joined by "|".
    fact : str
        What the change makes wrong.
    """

    file: str
    before: str
    after: str
    tests: str
    fact: str


CHANGE_FIELDS = [field.name for field in fields(Change)]


@dataclass(frozen=True)
class Result:
    """What became of a change.

    Attributes
    ----------
    outcome : Outcome
    by : str
        The test that failed, or what is wrong with the table.
    seconds : float
    """

    outcome: Outcome
    by: str
    seconds: float


def read_table(path: Path) -> list[Change]:
    """Changes of a table."""
    return [Change(**entry) for entry in tomllib.loads(path.read_text(encoding="utf-8"))["change"]]


def try_change(tree: Path, change: Change) -> Result:
    """Make a change, run its tests, and take it back."""
    start = time.perf_counter()
    path = tree / PACKAGE / change.file
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    found = text.count(change.before)
    if found != 1:
        return Result(Outcome.GONE, f"the line is found {found} times, expected once", 0.0)
    compiled, library = path.suffix == ".c", library_of(tree)
    right = library.read_bytes()
    path.write_text(text.replace(change.before, change.after), encoding="utf-8")
    try:
        if compiled:
            compile_core(tree)
        done = run_tests(tree, change.tests)
        outcome, by = judged(done.returncode, done.stdout)
    except subprocess.TimeoutExpired:
        outcome, by = Outcome.KILLED, f"no end within {LONGEST:.0f} s"
    finally:
        path.write_text(text, encoding="utf-8")
        if compiled:
            library.unlink()
            library.write_bytes(right)
    return Result(outcome, by, time.perf_counter() - start)


def check_tests(tree: Path, tests: str) -> None:
    """Make sure that tests pass as long as nothing is changed."""
    done = run_tests(tree, tests)
    if done.returncode:
        raise SystemExit(f"without any change {tests!r} does not pass:\n{done.stdout}\n{done.stderr}")


def read_records(path: Path, changes: list[Change]) -> dict[Change, Result]:
    """Results of changes that the table still has, as they were recorded."""
    found = {}
    if path.is_file():
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                change = Change(**{name: row[name] for name in CHANGE_FIELDS})
                outcome = Outcome(row["outcome"])
                if change in changes and outcome in (Outcome.KILLED, Outcome.SURVIVED):
                    found[change] = Result(outcome, row["by"], 0.0)
    return found


def write_records(path: Path, results: dict[Change, Result], changes: list[Change]) -> None:
    """Write one line for each change that was tried, in the table's order."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*CHANGE_FIELDS, "outcome", "by", "machine", "python"], lineterminator="\n")
        writer.writeheader()
        where = {"machine": platform.machine(), "python": platform.python_version()}
        for change in changes:
            if change in results:
                found = {"outcome": results[change].outcome.value, "by": results[change].by}
                writer.writerow(asdict(change) | found | where)


def run(changes: list[Change], minutes: float) -> Iterator[tuple[Change, Result]]:
    """Try changes one after the other, each with its result, until time is up."""
    checked: set[str] = set()
    with tempfile.TemporaryDirectory(prefix="mutations_") as name:
        tree = Path(name).resolve() / "tree"
        copied(tree)
        start = time.perf_counter()
        for change in changes:
            if time.perf_counter() - start > 60.0 * minutes:
                return
            if change.tests not in checked:
                check_tests(tree, change.tests)
                checked.add(change.tests)
            yield change, try_change(tree, change)


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only changes whose file or fact holds these words")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no change later than this")
    parser.add_argument("--output", type=Path, help="records, CSV")
    parser.add_argument("--resume", action="store_true", help="leave out what the records hold already")
    parser.add_argument("--random", type=int, default=0, metavar="N", help="draw this many instead")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.random:
        output = arguments.output or HERE / "random_mutations.csv"
        raise SystemExit(not random_mutations.run(arguments.random, arguments.seed, arguments.minutes, output))
    table = read_table(TABLE)
    changes = [change for change in table if arguments.only in f"{change.file} {change.fact}"]
    results = read_records(arguments.output, table) if arguments.output and arguments.resume else {}
    left = [change for change in changes if change not in results]
    try:
        for number, (change, result) in enumerate(run(left, arguments.minutes), start=1):
            results[change] = result
            if arguments.output:
                write_records(arguments.output, results, table)
            words = f"{result.outcome.value} in {result.seconds:.0f} s: {change.file}: {change.fact}"
            print(f"{number} of {len(left)}: {words} ({result.by or change.tests})", flush=True)
    except KeyboardInterrupt:
        print("stopped: results so far", flush=True)
    results = {change: results[change] for change in changes if change in results}
    for outcome in (Outcome.SURVIVED, Outcome.GONE, Outcome.BROKEN):
        for change, result in results.items():
            if result.outcome is outcome:
                print(f"{outcome.value}: {change.file}: {change.before} → {change.after}. {change.fact}. {result.by}")
    killed = sum(result.outcome is Outcome.KILLED for result in results.values())
    print(f"{killed} of {len(results)} changes are noticed, {len(changes) - len(results)} are left to try")
    raise SystemExit(killed < len(changes))


if __name__ == "__main__":
    main()
