"""What pages promise to list in full is what the code has; see docs/generators/reference_pages.py."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs.generators.reference_pages import KEPT, ON_SITE, PAGES, described, filled, keys_of, messages, tables_of

from bodies import body_of_everything, random_body, with_polynomial
from flexfmu.build.config import BodyFile
from flexfmu.build.tables import PlaceTable
from flexfmu.core.interface import lines, rows
from flexfmu.master.config import CouplingFile
from flexfmu.model.reduced_body import Shadow
from flexfmu.program.variable_table import CONDITIONS, variable_table
from flexfmu.study.scene.config import SceneFile

ROOT = Path(__file__).parents[2]


VARIABLES = (ROOT / "docs" / "reference" / "fmu-variables.md").read_text(encoding="utf-8")
TEXTS = {path: path.read_text(encoding="utf-8") for path in PAGES}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_what_a_page_has_from_the_code_is_what_the_code_gives(path):
    """Else: python -m docs.generators.reference_pages."""
    assert path.read_text(encoding="utf-8") == filled(path.read_text(encoding="utf-8"), KEPT)


def test_every_generated_part_is_on_a_page():
    shown = re.findall(r"<!-- generated: (.*?) -->", "".join(TEXTS.values()))
    assert sorted(shown) == sorted({*KEPT, *ON_SITE})


@pytest.mark.parametrize("file", [BodyFile, PlaceTable, CouplingFile, SceneFile])
def test_each_key_of_a_file_says_what_it_means(file):
    for table in tables_of(file):
        told = {name for names in described(table) for name in names}
        assert told == set(keys_of(table)), table.__name__


@pytest.mark.slow
def test_troubleshooting_quotes_messages_that_there_are():
    said = messages()
    tables = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8").split("## Nothing is said")[0]
    quoted = [
        quote for row in re.findall(r"^\| (`.*?) \|", tables, re.MULTILINE) for quote in re.findall("`(.*?)`", row)
    ]
    assert len(quoted) > 20
    assert [quote for quote in quoted if quote not in said] == []


def test_the_page_of_variables_lists_those_of_the_table_and_no_others():
    listed = re.findall(r"^\| `([\w.]+)`(?: `\.y` `\.z`)?(?: \([\w, ]+\))? \| [^`]", VARIABLES, re.MULTILINE)
    listed += re.findall(r"^\| `([\w.]+)` \(String\)", VARIABLES, re.MULTILINE)
    known = [row.name.replace(".AXIS", ".x") for row in rows()]
    assert sorted(set(listed)) == sorted(known)


def test_every_row_of_the_table_is_a_variable_of_some_body_and_every_variable_is_of_a_row():
    everything, free = body_of_everything(1), body_of_everything(2, modes=9, free=True)
    bodies = [
        replace(with_polynomial(everything), velocity_outputs=True),
        replace(free, shadow=Shadow(free, np.eye(9))),
        random_body(1, compliance_interfaces=("port_0", "port_2"), root_interface=1),
        replace(held := random_body(1), shadow=Shadow(held, np.eye(held.mode_count))),
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
