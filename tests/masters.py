"""FMI masters in processes of their own, and what is in an FMU."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

MASTERS = Path(__file__).with_name("fmu_masters.py")
MARK = "RESULT "


def master(name, *arguments, folder=None):
    """What a function of fmu_masters returns in a process of its own."""
    command = [sys.executable, str(MASTERS), name, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=folder)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, f"{name} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}"
    return json.loads(lines[-1][len(MARK) :])


def motion(flexible, state):
    """Displacement and rotation of every interface in the order of the outputs."""
    response = flexible.response(state)
    return np.concatenate([response.displacement, response.rotation], axis=1).ravel()


def entries(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def description(path):
    return ElementTree.fromstring(entries(path)["modelDescription.xml"])
