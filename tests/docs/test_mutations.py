"""The list of wrong physics that tests should notice (benchmarks/mutations.py) follows the code."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHANGES = tomllib.loads((ROOT / "benchmarks" / "mutations.toml").read_text(encoding="utf-8"))["change"]


@pytest.mark.parametrize("file", sorted({change["file"] for change in CHANGES}))
def test_each_change_is_part_of_one_line_of_the_code(file):
    lines = (ROOT / "fmu_src" / "flexfmu" / file).read_text(encoding="utf-8").splitlines()
    for change in CHANGES:
        if change["file"] == file:
            assert sum(line.count(change["before"]) for line in lines) == 1, change["before"]
            assert change["after"] != change["before"]


def test_the_tests_that_should_notice_are_there():
    named = {word for change in CHANGES for word in change["tests"].split() if word.startswith("tests/")}
    assert [name for name in sorted(named) if not (ROOT / name.partition("::")[0]).exists()] == []
