"""A copy of the tree in which a line is wrong, and the tests that run there: for mutations of every kind."""

from __future__ import annotations

import os
import runpy
import shutil
import signal
import subprocess
import sys
from enum import Enum
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PACKAGE = Path("fmu_src") / "flexfmu"
# Not needed by any test, or made anew.
LEFT_OUT = (".git", ".venv*", "__pycache__", ".*_cache", ".hypothesis", "output", "dist", "*.egg-info")
CORE = PACKAGE / "core"
# Tests are short: compiling well takes longer than what it saves in them.
QUICK = ("-O0",)
# That a test fails is enough: nobody looks for its smallest example.
HASTE = """
import hypothesis

hypothesis.settings.register_profile("haste", phases=[hypothesis.Phase.explicit, hypothesis.Phase.generate])
hypothesis.settings.load_profile("haste")
"""
# Tests that take this long (s) do not end any more.
LONGEST = 900.0
# Fails with any change of the core, and says nothing of it.
OF_BYTES = "tests/unit/test_platforms.py::test_the_core_of_pages_is_of_these_c_files_and_goes_with_them"
# A command with a limit of processor time (POSIX), which follows.
LIMITED = (
    sys.executable,
    "-c",
    "import os, resource, sys; n = int(sys.argv[1]); resource.setrlimit(resource.RLIMIT_CPU, (n, n + 5)); "
    "os.execv(sys.argv[2], sys.argv[2:])",
)
OUT_OF_TIME = getattr(signal, "SIGXCPU", 0)
# Says nothing of the change. (Windows knows no SIGKILL.)
ENDED_FROM_OUTSIDE = (signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGKILL", signal.SIGTERM))


class Outcome(Enum):
    """What became of a change."""

    KILLED = "killed"
    """A test failed."""
    SURVIVED = "survived"
    """All tests passed."""
    GONE = "gone"
    """The line is not there any more, or more than once: the table has to be brought up to date."""
    BROKEN = "broken"
    """No test ran."""


def copied(tree: Path, settings: str = "") -> None:
    """Copy this tree, with settings of its tests of their own, and build its core."""
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*LEFT_OUT))
    with (tree / "tests" / "conftest.py").open("a", encoding="utf-8") as file:
        file.write(settings + HASTE)
    compile_core(tree)
    check_copy(tree)


def arguments_of(tests: str) -> list[str]:
    """Arguments of pytest: what follows -k is joined by "or"."""
    files, _, words = tests.partition(" -k ")
    return files.split() + (["-k", " or ".join(words.split("|"))] if words else [])


def run_tests(
    tree: Path, tests: str | list[str], longest: float = LONGEST, processor: float = 0.0
) -> subprocess.CompletedProcess[str]:
    """Run tests in a copy of the tree until the first fails, with a limit in time, or in that of the processor (s)."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(tree / "fmu_src"), str(tree)]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-rf",
        "--tb=no",
        "-p",
        "no:cacheprovider",
        "--deselect",
        OF_BYTES,
    ]
    words = arguments_of(tests) if isinstance(tests, str) else tests
    return subprocess.run(
        [*command, *words] if not processor else [*LIMITED, str(int(processor)), *command, *words],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=max(longest, 8.0 * processor),
    )


def compile_core(tree: Path) -> None:
    """Build the core in place by the copy's own command, which knows its sources."""
    building: dict[str, Any] = runpy.run_path(str(tree / CORE / "building.py"))
    compiler = building["system_compiler"]()
    if compiler is None:
        raise SystemExit("there is no C compiler")
    output = library_of(tree)
    # Another file: who has the old one open keeps it.
    part = output.with_name(f"part{output.suffix}")
    words = building["command"](compiler, part, extra=QUICK)
    done = subprocess.run(words, cwd=tree, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"the core does not compile:\n{done.stdout}\n{done.stderr}")
    part.replace(output)


def library_of(tree: Path) -> Path:
    """The compiled core of a copy."""
    return (tree / CORE / "_flexcore").with_suffix({"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so"))


def judged(code: int, output: str) -> tuple[Outcome, str]:
    """What pytest's exit code says, and the test that failed."""
    failed = [line.split()[1] for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    if code == 0:
        return Outcome.SURVIVED, ""
    if code == 1:
        return Outcome.KILLED, failed[0].partition("::")[2] if failed else "?"
    if -code in ENDED_FROM_OUTSIDE:
        return Outcome.BROKEN, f"the process was ended from outside ({code})"
    if code < 0 or code > 5:
        return Outcome.KILLED, f"the process ended with {code}"
    return Outcome.BROKEN, (output.strip().splitlines() or ["no output"])[-1]


def check_copy(tree: Path) -> None:
    """Make sure that tests run on the copy."""
    code = "import flexfmu; print(flexfmu.__file__)"
    environment = os.environ | {"PYTHONPATH": str(tree / "fmu_src")}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tree, env=environment, capture_output=True, text=True, check=False
    )
    if not done.stdout.startswith(str(tree)):
        raise SystemExit(f"tests would run on {done.stdout.strip()!r} instead of the copy in {tree}")
