"""What pages promise to list in full is what the code has; see tools/reference_pages.py."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import pytest

from bodies import body_of_everything, random_body
from flexfmu.core.interface import lines, rows
from flexfmu.program.missed_inertia import missed_inertia
from flexfmu.program.variable_table import CONDITIONS, variable_table

ROOT = Path(__file__).parents[2]


def _module():
    spec = importlib.util.spec_from_file_location("reference_pages", ROOT / "tools" / "reference_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


reference_pages = _module()
PAGES = {path.name: path.read_text("utf-8") for path in sorted((ROOT / "docs").glob("*.md"))}


@pytest.mark.parametrize("name", [name for name, page in PAGES.items() if "<!-- made by " in page])
def test_a_page_is_as_the_code_makes_it(name):
    assert PAGES[name] == reference_pages.rewritten(PAGES[name]), "python tools/reference_pages.py"


def test_every_part_stands_on_a_page():
    placed = re.findall(r"<!-- made by (\w+) -->", "".join(PAGES.values()))
    assert sorted(placed) == sorted(part.__name__ for part in reference_pages.PARTS)


def test_the_page_of_variables_lists_those_of_the_table_and_no_others():
    listed = re.findall(
        r"^\| `([\w.]+)`(?: `\.y` `\.z`)?(?: \([\w, ]+\))? \| [^`]", PAGES["fmu-variables.md"], re.MULTILINE
    )
    listed += re.findall(r"^\| `([\w.]+)` \(String\)", PAGES["fmu-variables.md"], re.MULTILINE)
    known = [row.name.replace(".AXIS", ".x") for row in rows()]
    assert sorted(set(listed)) == sorted(known)


def test_every_row_of_the_table_is_a_variable_of_some_body_and_every_variable_is_of_a_row():
    everything, free = body_of_everything(1), body_of_everything(2, modes=9, free=True)
    bodies = [
        replace(everything, missed_inertia=missed_inertia(everything), velocity_outputs=True),
        free,
        random_body(1, compliance_interfaces=("port_0", "port_2"), root_interface=1),
    ]
    words = {"NAME": r"port_\d", "OTHER": r"port_\d", "AXIS": "[xyz]", "ROW": "[ur][xyz]", "COLUMN": "[fm][xyz]"}
    patterns = {row.name: re.sub("|".join(words), lambda found: words[found[0]], re.escape(row.name)) for row in rows()}
    del patterns["SET.von_mises"]
    found = set()
    for body in bodies:
        for variable in variable_table(body):
            (name,) = [name for name, pattern in patterns.items() if re.fullmatch(pattern, variable.name)]
            found.add(name)
    assert found == patterns.keys()


def test_every_condition_of_the_table_is_known():
    assert {symbol for symbol, _ in lines("WHEN")} == CONDITIONS.keys() == {row.when for row in rows()}
