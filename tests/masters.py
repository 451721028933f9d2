"""FMI masters in processes of their own, and what is in an FMU."""

import atexit
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

MASTERS = Path(__file__).with_name("fmu_masters.py")
MARK = "RESULT "


def master(name, *arguments, folder=None):
    """What a function of fmu_masters returns in a process of its own."""
    code, out, error = (forked if hasattr(os, "fork") else started)(name, arguments, folder or Path.cwd())
    lines = [line for line in out.splitlines() if line.startswith(MARK)]
    assert lines, f"{name} ended with {code}:\n{out}\n{error}"
    return json.loads(lines[-1][len(MARK) :])


def started(name, arguments, folder):
    """Exit code and what was printed on both streams."""
    command = [sys.executable, str(MASTERS), name, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=folder)
    return done.returncode, done.stdout, done.stderr


def forked(name, arguments, folder):
    """As `started`, without the imports, which take longer than what most functions do."""
    with tempfile.TemporaryDirectory() as place:
        files = [Path(place) / stream for stream in ("out", "error")]
        for file in files:
            file.touch()
        order = [name, arguments, str(folder), dict(os.environ), *map(str, files)]
        print(json.dumps(order), file=server().stdin, flush=True)
        return server().stdout.readline().strip(), *(file.read_text(errors="replace") for file in files)


@cache
def server():
    """The process that forks one for each call."""
    process = subprocess.Popen([sys.executable, str(MASTERS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(process.communicate)
    return process


def motion(flexible, state):
    """Displacement and rotation of every interface in the order of the outputs."""
    response = flexible.response(state)
    return np.concatenate([response.displacement, response.rotation], axis=1).ravel()


def entries(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def description(path):
    return ElementTree.fromstring(entries(path)["modelDescription.xml"])
