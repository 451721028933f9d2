"""The FMU's C sources and its libraries elsewhere: in one program with others, without files, on older systems."""

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from binary_files import libraries
from bodies import beam_body
from driven import Driven
from flexfmu.core.building import FLAGS, system_compiler
from flexfmu.core.library import library_path
from flexfmu.fmu.package import package_fmu
from flexfmu.program.variable_table import variable_table

MAIN = Path(__file__).parents[1] / "native_master" / "two_in_one.c"
# glibc of RHEL 7, the oldest that wheels know.
OLDEST = (2, 17)
# Importers of either version of FMI have a macro of their own.
PREFIX = {"left": 2, "right": 3}
LOAD, STEPS = 800.0, 20


@pytest.fixture(scope="module")
def compiler():
    found = system_compiler()
    if found is None:
        pytest.skip("no C compiler")
    return found


def compiled(compiler, model, folder, side):
    """Object files of an FMU's own sources with a prefix and its body within, and its guid."""
    package_fmu(model, folder / f"{side}.fmu")
    with zipfile.ZipFile(folder / f"{side}.fmu") as archive:
        archive.extractall(folder / side)
    sources, data = folder / side / "sources", (folder / side / "resources" / "body.prog").read_bytes()
    # As xxd -i writes it.
    (sources / "body_prog.h").write_text(f"unsigned char body_prog[] = {{{','.join(map(str, data))}}};\n")
    flags = [*FLAGS, "-O0", f"-DFMI{PREFIX[side]}_FUNCTION_PREFIX={side}_", '-DFLEX_BODY="body_prog.h"', "-c"]
    subprocess.run([*compiler, *flags, *sorted(map(str, sources.glob("*.c")))], cwd=sources, check=True)
    guid = re.search(r'guid="([^"]*)"', (folder / side / "modelDescription.xml").read_text())
    return [str(path) for path in sources.glob("*.o")], guid[1]


@pytest.fixture(scope="module")
def made(compiler, tmp_path_factory):
    """Two bodies; the folder with their FMUs, and what was compiled of each."""
    folder = tmp_path_factory.mktemp("made")
    models = {side: beam_body(frames, modes=3, damping=0.02) for side, frames in (("left", 2), ("right", 3))}
    return models, folder, {side: compiled(compiler, model, folder, side) for side, model in models.items()}


def alone(model, folder):
    """The tip's deflection at the end of the same steps, in an FMU of its own."""
    driven = Driven(model, folder, **{"tip.force.y": LOAD})
    assert all(driven.taken(1e-3) for _ in range(STEPS))
    return driven.get("tip.displacement.y")[0]


@pytest.mark.slow
def test_two_fmus_stand_in_one_program_without_files(compiler, made, tmp_path):
    models, folder, parts = made
    names = [v.name for v in variable_table(models["left"])]
    objects = [file for files, _ in parts.values() for file in files]
    subprocess.run([*compiler, "-o", "two", str(MAIN), *objects, "-lm"], cwd=tmp_path, check=True)
    for side in models:
        shutil.rmtree(folder / side / "resources")
    words = [parts["left"][1], parts["right"][1], names.index("tip.force.y"), LOAD, names.index("tip.displacement.y")]
    done = subprocess.run([tmp_path / "two", *map(str, words)], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    found = [float(line) for line in done.stdout.split()]
    expected = [alone(model, tmp_path) for model in models.values()]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert abs(found[0] - found[1]) > 1e-6 * abs(found[0])


@pytest.mark.slow
def test_no_name_in_a_program_is_without_the_prefix(made):
    if shutil.which("nm") is None:
        pytest.skip("no nm")
    told = subprocess.run(["nm", "-P", *made[2]["left"][0]], capture_output=True, text=True, check=True).stdout
    names = [line.split()[0] for line in told.splitlines() if re.match(r"\S+ [TDBRC] ", line)]
    assert len(names) > 100
    assert [name for name in names if "left_" not in name] == []


def test_the_core_offers_names_of_fmi_alone():
    (core,) = libraries(library_path().read_bytes())[:1]
    assert {"fmi2DoStep", "fmi3DoStep"} <= core.offered
    assert [name for name in core.offered if not name.startswith(("fmi2", "fmi3", "_"))] == []


def test_the_core_asks_for_no_newer_c_library_than_wheels_know():
    needed = {tuple(map(int, found)) for found in re.findall(rb"GLIBC_(\d+)\.(\d+)", library_path().read_bytes())}
    if not needed:
        pytest.skip("no core for glibc")
    assert max(needed) <= OLDEST
