"""Fixtures shared by the tests."""

import csv
import os
import signal
import sys
import tempfile
import zlib
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import threadpoolctl

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.model.methods import Method
from flexfmu.study.cost import StepCost
from flexfmu.study.workshop import Workshop
from references import BEAM, L_FRAME, body_without_error
from scene_tools import SMALL_SWEEP, with_results

LIBRARIES = ("fmpy", "fontTools", "h5py", "hypothesis", "joblib", "lark", "lxml", "matplotlib", "meshio", "numpy",
             "pandas", "PIL", "pydantic", "pymetis", "pyNastran", "rich", "scipy", "skfem", "typer")  # fmt: skip


def _link_bytecode(prefix):
    """Link below the prefix what large libraries were installed with: Python looks for bytecode there alone."""
    for folder in {Path(one) for one in sys.path if Path(one).name == "site-packages"}:
        for name in LIBRARIES:
            for cached in (folder / name).rglob(f"__pycache__/*.{sys.implementation.cache_tag}.pyc"):
                place = prefix / cached.parent.parent.relative_to(cached.anchor) / cached.name
                if "tests" not in cached.parts:
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.symlink_to(cached)


# Where Python is to keep no bytecode beside its sources, that of the tests and of what their processes import is kept
# with what pytest keeps: else every process compiles all of it, and every run the tests.
if sys.dont_write_bytecode:
    kept_bytecode = Path(__file__).parents[1] / ".pytest_cache" / "bytecode"
    # Another run at the same time may do the same; where it goes wrong Python compiles.
    with suppress(OSError):
        if "PYTEST_XDIST_WORKER" not in os.environ and not kept_bytecode.exists():
            _link_bytecode(kept_bytecode)
    sys.dont_write_bytecode, sys.pycache_prefix = False, str(kept_bytecode)
    os.environ |= {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": sys.pycache_prefix}

# A shell's background jobs ignore Ctrl-C, and so would the jobs that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


# Seconds of each file's tests: quick and slow ones. `--seconds` writes it anew.
SECONDS = Path(__file__).with_name("seconds.csv")


def pytest_addoption(parser):
    """What a run of all tests may keep for the next ones."""
    parser.addoption("--seconds", action="store_true", help=f"write {SECONDS.name}, by which files are ordered, anew")


def pytest_terminal_summary(terminalreporter, config):
    """Keep how long files took, those of which it matters."""
    if not config.getoption("seconds"):
        return
    found = defaultdict(lambda: {"quick": 0.0, "slow": 0.0})
    for report in [report for each in terminalreporter.stats.values() for report in each]:
        if hasattr(report, "duration"):
            file = report.nodeid.partition("::")[0].removeprefix("tests/")
            found[file]["slow" if "slow" in report.keywords else "quick"] += report.duration
    rows = sorted(found.items(), key=lambda row: -sum(row[1].values()))
    with SECONDS.open("w", encoding="utf-8", newline="") as table:
        table.write("file,quick,slow\n")
        table.writelines(f"{file},{s['quick']:.0f},{s['slow']:.0f}\n" for file, s in rows if max(s.values()) > 1.0)


def pytest_configure(config):
    """Files go to processes in the order of the tests, not in that of their number."""
    config.option.loadscopereorder = False


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(items):
    """What takes minutes is not among the quick ones either; files that take longest come first.

    The processes that share them end together, then.
    """
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)
    result = yield
    with SECONDS.open(encoding="utf-8") as table:
        known = {row["file"]: row for row in csv.DictReader(table)}
    kinds = {(item.path, "slow" if item.get_closest_marker("slow") else "quick") for item in items}
    total = Counter()
    for path, kind in kinds:
        row = known.get(Path(os.path.relpath(path, SECONDS.parent)).as_posix(), {})
        total[path] += float(row.get(kind, 0.0))
    items.sort(key=lambda item: -total[item.path])
    return result


@pytest.fixture(scope="session")
def kept_builds(tmp_path_factory):
    """Folder of what is kept of builds, one for all processes of the tests."""
    # Where pytest's own folders are does not change later. The folder of a process lies in that of the run.
    folder = tmp_path_factory.getbasetemp()
    return (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "kept"


@pytest.fixture(scope="session", autouse=True)
def _temporary(kept_builds):
    """What tests, their processes and fmpy unpack is gone at the end.

    What builds keep, by the code that made it and what went in, is made once in a run and leaves the user's own alone:
    `Store(None)`, or FLEXFMU_CACHE without a value, finds everything anew.
    """
    with (
        tempfile.TemporaryDirectory(prefix="tests-", ignore_cleanup_errors=True) as folder,
        pytest.MonkeyPatch.context() as patch,
        # Several processes of many threads each wait for one another.
        threadpoolctl.threadpool_limits(1 if "PYTEST_XDIST_WORKER" in os.environ else None),
    ):
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", None)
        # Archives need not be small.
        patch.setattr(zlib, "Z_DEFAULT_COMPRESSION", 1)
        patch.setenv("FLEXFMU_CACHE", str(kept_builds))
        patch.setattr(Store.__init__, "__defaults__", (kept_builds,))
        yield


class Bodies:
    """Demo bodies reduced on demand, each variant once; modes and the like once for all processes of the tests.

    They do not tell their error, which would take twice as long, and have no surface, unless `output` says so.
    """

    def __init__(self, store):
        self._known = {}
        self._store = store

    def __call__(self, folder, **changes):
        key = (folder, repr(sorted(changes.items())))
        if key not in self._known:
            config = body_without_error(folder / "body.toml")
            if "modes" in changes:
                changes["reduction"] = config.reduction.model_copy(update={"modes": changes.pop("modes")})
            self._known[key] = FlexibleBody(reduce_body(config.model_copy(update=changes), Reporter(), self._store))
        return self._known[key]

    @staticmethod
    def config(folder):
        """The body file of a demo body."""
        return read_body_file(folder / "body.toml")

    def beam(self, **changes):
        """The clamped beam with changes to its body file."""
        return self(BEAM, **changes)

    def l_frame(self, **changes):
        """The L-frame with changes to its body file."""
        return self(L_FRAME, **changes)


@pytest.fixture(scope="session")
def bodies():
    """Reduce demo bodies on demand."""
    return Bodies(Store())


@pytest.fixture(scope="module")
def store():
    """What all tests keep of their builds, with what was read and factorised last by those of a file."""
    return Store()


@pytest.fixture
def bent_beam(tmp_path):
    """Scene of the bent beam with CalculiX's results as the user's own, and few combinations."""
    return with_results(tmp_path, SMALL_SWEEP)


@pytest.fixture
def counted(monkeypatch):
    """Steps are not timed but counted, so that no choice depends on what else the machine does."""

    def cost(_, body, variant):
        work = body.mode_count * (1 + body.frame_count + list(Method).index(variant.method))
        return StepCost(1e-6 * work, 1e-6 * work, 1.0, 1.0)

    monkeypatch.setattr(Workshop, "cost", cost)


@pytest.fixture
def random():
    """Seeded random numbers."""
    return np.random.default_rng(20)
