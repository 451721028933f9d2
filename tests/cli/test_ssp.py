"""A coupled system as an SSP archive: by SSP's schema, read and run by fmpy; what SSP cannot hold is refused."""

import zipfile

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import get_connections, read_ssd, read_ssv
from lxml import etree
from typer.testing import CliRunner

from bodies import random_body
from flexfmu.commands.cli import app
from flexfmu.files.basics import OutputError, SimulationError
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.master import couple, read_coupling_file, write_ssp

STEP = 1e-3
PUSH = 40.0
SYSTEM = f"""
[experiment]
stop = 0.05
step = {STEP}
[[fmu]]
name = "arm"
file = "tree.fmu"
start = {{ "damping.scale" = 2.5, "port_1.force.y" = 7.0, "internal_step.most" = 500 }}
input = "push.csv"
[[fmu]]
name = "leg"
file = "tree.fmu"
[[connection]]
from = "arm.port_1.displacement.x"
to = "leg.port_0.force.z"
factor = 1.0
[[connection]]
from = "leg.port_0.displacement.y"
to = "arm.port_1.force.z"
factor = 1.0
"""
SPACES = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}


class Said(Reporter):
    """Keeps warnings."""

    def __init__(self):
        super().__init__()
        self.said = []

    def warning(self, message):
        self.said.append(message)


@pytest.fixture
def folder(tmp_path):
    package_fmu(random_body(), tmp_path / "tree.fmu")
    (tmp_path / "push.csv").write_text(f"time,port_0.force.x\n0,0\n0.05,{PUSH}\n", encoding="utf-8")
    return tmp_path


def written(folder, text):
    """The archive of a coupling, and what was said."""
    (folder / "coupling.toml").write_text(text, encoding="utf-8")
    report = Said()
    write_ssp(folder / "coupling.toml", folder / "system.ssp", report)
    return folder / "system.ssp", report.said


def test_fmpy_reads_and_runs_the_system_as_couple_does(folder):
    archive, said = written(folder, SYSTEM)
    assert said == ["SSP has no tables: the master must feed the system's inputs table.arm.port_0.force.x"]
    start = read_ssv(archive, resource="resources/start.ssv")
    assert {(p.name, p.type, float(p.value)) for p in start.parameters} == {
        ("arm.damping.scale", "Real", 2.5),
        ("arm.port_1.force.y", "Real", 7.0),
        ("arm.internal_step.most", "Real", 500.0),
    }
    # fmpy hands a system's inputs on at the end of a step.
    found = simulate_ssp(
        archive,
        stop_time=0.05 - 0.5 * STEP,
        step_size=STEP,
        parameter_set=start,
        input={"table.arm.port_0.force.x": lambda time: PUSH * (time + STEP) / 0.05},
    )
    expected = couple(read_coupling_file(folder / "coupling.toml"))
    assert len(found) == len(expected.time) - 1
    for name in ("arm.port_1.displacement.x", "leg.port_0.displacement.z", "leg.port_1.rotation.y"):
        mine = expected[name][1:]
        assert np.max(np.abs(mine)) > 0.0
        np.testing.assert_allclose(found[name], mine, rtol=0.0, atol=1e-8 * np.max(np.abs(mine)))


def test_the_structure_holds_the_whole_system_by_the_schema(folder):
    text = SYSTEM.replace("factor = 1.0", "factor = -100.0", 1).replace("stop =", 'scheme = "gauss_seidel"\nstop =')
    archive, said = written(folder, text)
    assert said[-1] == "SSP has no schemes: masters take their own, not 'gauss_seidel'"
    structure = read_ssd(archive)  # refuses what the schema does not allow
    assert structure.name == "system"
    assert [(part.name, part.source) for part in structure.system.elements] == [
        ("arm", "resources/arm.fmu"),
        ("leg", "resources/arm.fmu"),
    ]
    pairs = {(f"{a.parent.name}.{a.name}", f"{b.parent.name}.{b.name}") for a, b in get_connections(structure.system)}
    assert pairs == {
        ("system.table.arm.port_0.force.x", "arm.port_0.force.x"),
        ("arm.port_1.displacement.x", "leg.port_0.force.z"),
        ("leg.port_0.displacement.y", "arm.port_1.force.z"),
    }
    with zipfile.ZipFile(archive) as opened:
        names = opened.namelist()
        tree = etree.fromstring(opened.read("SystemStructure.ssd"))
        assert opened.read("resources/arm.fmu") == (folder / "tree.fmu").read_bytes()
        assert opened.read("extra/arm.csv") == (folder / "push.csv").read_bytes()
    assert len(names) == len(set(names)) == 4
    link = tree.find(".//ssd:Connection[@startElement='arm']", SPACES)
    assert link.get("suppressUnitConversion") == "true"
    assert [child.get("factor") for child in link] == ["-100.0"]
    assert tree.find("ssd:DefaultExperiment", SPACES).get("stopTime") == "0.05"
    assert f'stepSize="{STEP!r}"' in etree.tostring(tree).decode()
    first = archive.read_bytes()
    assert written(folder, text)[0].read_bytes() == first


def test_what_ssp_cannot_hold_is_refused_by_name_and_nothing_is_written(folder):
    twice = '[[connection]]\nfrom = "arm.port_0.displacement.x"\nto = "leg.port_0.force.z"\nfactor = 1.0\n'
    spring = '[[spring]]\na = "arm.port_0"\nb = "leg.port_1"\nstiffness = [1e3, 1e3, 1e3, 0.0, 0.0, 0.0]\n'
    with pytest.raises(SimulationError) as caught:
        written(folder, SYSTEM + twice + spring)
    assert "spring 1 (arm.port_0 to leg.port_1): SSP joins signals" in str(caught.value)
    assert "connection 3: leg.port_0.force.z has another connection" in str(caught.value)
    assert not (folder / "system.ssp").exists()
    with pytest.raises(OutputError, match=r"\.ssp"):
        write_ssp(folder / "coupling.toml", folder / "system.zip", Reporter())


def test_the_command_writes_the_system_the_results_or_both(folder):
    (folder / "coupling.toml").write_text(SYSTEM, encoding="utf-8")
    target, motion = folder / "out.ssp", folder / "motion.csv"
    run = CliRunner()
    assert run.invoke(app, ["couple", str(folder / "coupling.toml"), "--ssp", str(target)]).exit_code == 0
    assert read_ssd(target).name == "out"
    assert not motion.exists()
    both = ["couple", str(folder / "coupling.toml"), "--ssp", str(target), "--output", str(motion)]
    assert run.invoke(app, both).exit_code == 0
    assert motion.exists()
    assert run.invoke(app, ["couple", str(folder / "coupling.toml")]).exit_code != 0
