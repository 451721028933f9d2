"""What the README shows runs."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from references import BEAM

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def block(kind, number=0):
    """A fenced code block of the README."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)[number]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the README's body file, on the beam's mesh, and a table of loads."""
    path = tmp_path_factory.mktemp("readme")
    deck = (BEAM / "beam.inp").read_text(encoding="utf-8").replace("NSET=ROOT", "NSET=CLAMP").replace("=TIP", "=FLANGE")
    (path / "arm.inp").write_text(deck, encoding="utf-8")
    (path / "body.toml").write_text(block("toml"), encoding="utf-8")
    (path / "loads.csv").write_text("time,tip.force.y\n0,0\n0.05,5000\n", encoding="utf-8")
    commands = block("sh", 2).strip().splitlines()
    assert [line.split()[1] for line in commands] == ["build", "info", "simulate"]
    printed = [run(path, line.split()) for line in commands]
    return path, printed


def run(path, command):
    """Run a command of the README in a folder; what it prints on standard output."""
    program = shutil.which(command[0], path=str(Path(sys.executable).parent))
    result = subprocess.run(
        [program or command[0], *command[1:]], cwd=path, capture_output=True, text=True, check=False, env=os.environ
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.slow
def test_commands_build_describe_and_simulate(folder):
    path, printed = folder
    assert (path / "arm.fmu").is_file()
    assert "4 frames" in printed[1]
    assert "carries tip" in printed[1]
    rows = (path / "result.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("time [s],tip.displacement.x [m]")
    assert float(rows[-1].split(",")[2]) > 0.05
    assert (path / "result.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_python_example_runs(folder):
    path, _ = folder
    lines = run(path, [sys.executable, "-c", block("python")]).splitlines()
    static = [float(x) for x in lines[0].strip("[]").split()]
    assert static[1] == pytest.approx(0.1212, rel=1e-2)
    assert len(lines) == 102


def test_gate_finds_the_two_commands():
    for name in ("demo", "test"):
        found = re.search(rf"^<!-- ci: {name} -->\n```sh\n(.+?)\n```$", README, re.MULTILINE)
        assert found is not None
        assert found.group(1).startswith("python3 -m venv .venv && .venv/bin/pip install")
