"""A core with sanitizers, which two files of tests try."""

import shutil
import subprocess
import sys
import time

import pytest

from flexfmu.core.building import command

SANITIZERS = ("-g1", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")


@pytest.fixture(scope="session")
def sanitized_core(kept_builds):
    """The core compiled with checks of every access and every operation, by the process that asks first."""
    compiler = shutil.which("gcc")
    if sys.platform != "linux" or compiler is None:
        pytest.skip("sanitizers are used by way of gcc on Linux")
    kept_builds.mkdir(parents=True, exist_ok=True)
    core, begun = kept_builds / "sanitized.so", kept_builds / "sanitized.begun"
    while not core.exists():
        try:
            begun.touch(exist_ok=False)
        except FileExistsError:
            time.sleep(0.2)
            continue
        try:
            part = kept_builds / "part.so"
            words = command([compiler], part, extra=SANITIZERS)
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            if done.returncode:
                pytest.skip(f"gcc has no sanitizers here: {done.stderr[-300:]}")
            part.replace(core)
        finally:
            begun.unlink()
    return core


@pytest.fixture(scope="session")
def gcc_library():
    """Where gcc has a library of its own."""

    def find(name):
        words = [shutil.which("gcc"), f"-print-file-name={name}"]
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()

    return find
