"""interface.def: what is forgotten in the core does not compile."""

import shutil
import subprocess

import pytest

from flexfmu.core.building import FLAGS, FOLDER, system_compiler
from flexfmu.core.interface import TABLE, lines

COMPILER = system_compiler()


def compiled(folder, changed):
    """What the compiler says of instance_values.c with another table."""
    for path in (*FOLDER.glob("*.h"), *FOLDER.glob("*.def"), FOLDER / "instance_values.c"):
        shutil.copy(path, folder)
    (folder / TABLE.name).write_text(changed, "utf-8")
    command = [*COMPILER, *FLAGS, "-fsyntax-only", "instance_values.c"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")
def test_a_diagnostic_that_the_core_forgets_does_not_compile(tmp_path):
    table, row = TABLE.read_text("utf-8"), 'DIAGNOSTIC(forgotten, "diagnostics.forgotten", REAL, "", always, "?", "")\n'
    assert compiled(tmp_path, table).returncode == 0
    done = compiled(tmp_path, table.replace("DIAGNOSTIC(rotation", f"{row}DIAGNOSTIC(rotation"))
    assert done.returncode
    assert "diagnose_forgotten" in done.stderr


def test_cells_of_the_table_may_hold_commas_quotes_and_several_strings():
    (beyond,) = [text for symbol, _, text in lines("MESSAGE") if symbol == "BEYOND_MASS"]
    assert beyond.endswith('build it with mass = "configuration" in [formulation], or lower the load')
    assert all(len(cells) == 6 for cells in lines("VARIABLE"))
