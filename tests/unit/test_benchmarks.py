"""Records of measurements: where they were made, and that a slower machine is no slower program."""

import csv
from pathlib import Path

import pytest
from benchmarks.compare import compared
from benchmarks.records import WHERE, read_records, where, write_records

STEPS = [("empty", "native", 2e-8), ("linear", "native", 1.6e-6), ("linear", "python", 2.2e-5)]


def record(path, factor, changes=()):
    rows = [{"what": what, "export": export, "median": factor * time} for what, export, time in STEPS]
    for place, change in changes:
        rows[place]["median"] *= change
    write_records(path, rows)
    return path


def test_each_row_tells_commit_day_machine_and_python(tmp_path):
    rows = read_records(record(tmp_path / "new.csv", 1.0))
    assert [row["what"] for row in rows] == ["empty", "linear", "linear"]
    assert {tuple(row[name] for name in WHERE) for row in rows} == {tuple(where().values())}
    assert all(rows[0][name] for name in ("day", "machine", "python"))


def test_what_a_row_says_of_its_own_python_stays(tmp_path):
    write_records(tmp_path / "masters.csv", [{"master": "fmpy", "python": "3.9.1"}])
    with (tmp_path / "masters.csv").open(newline="", encoding="utf-8") as file:
        assert next(csv.DictReader(file))["python"] == "3.9.1"


def test_a_machine_of_half_the_speed_changes_no_ratio(tmp_path):
    old, new = record(tmp_path / "old.csv", 1.0), record(tmp_path / "new.csv", 2.0, [(2, 1.5)])
    found = {what: after / before for what, before, after in compared(old, new, "median")}
    assert found == pytest.approx({"empty, native": 1.0, "linear, native": 1.0, "linear, python": 1.5})


def test_a_column_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    path = record(tmp_path / "old.csv", 1.0)
    with pytest.raises(SystemExit, match="no column 'seconds', found what, export, median"):
        compared(path, path, "seconds")


def test_kept_records_of_steps_compare_with_themselves():
    kept = Path(__file__).parents[2] / "benchmarks" / "core_step.csv"
    found = compared(kept, kept, "median")
    assert len(found) == len(read_records(kept))
    assert {after / before for _, before, after in found} == {1.0}
