"""Fixtures shared by the tests."""

import os
import signal
import tempfile

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from references import BEAM, L_FRAME, body_without_error
from scene_tools import SMALL_SWEEP, with_results

# Builds in tests find everything anew, and leave nothing in the user's folders.
os.environ["FLEXFMU_CACHE"] = ""
# A shell's background jobs ignore Ctrl-C, and so would the jobs that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """What takes minutes is not among the quick ones either."""
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session", autouse=True)
def _temporary(tmp_path_factory):
    """What tests, their processes and fmpy unpack is gone at the end."""
    # Where pytest's own folders are does not change.
    tmp_path_factory.getbasetemp()
    with (
        tempfile.TemporaryDirectory(prefix="tests-", ignore_cleanup_errors=True) as folder,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", None)
        yield


class Bodies:
    """Demo bodies reduced on demand, each variant once; modes and the like once for all processes of the tests.

    They do not tell their error, which would take twice as long, unless `output` says so.
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
def bodies(tmp_path_factory):
    """Reduce demo bodies on demand."""
    folder = tmp_path_factory.getbasetemp()
    # The folder of a process lies in that of the run.
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    return Bodies(Store(shared / "reductions"))


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """What the tests of a file keep of their builds."""
    return Store(tmp_path_factory.mktemp("kept"))


@pytest.fixture
def bent_beam(tmp_path):
    """Scene of the bent beam with CalculiX's results as the user's own, and few combinations."""
    return with_results(tmp_path, SMALL_SWEEP)


@pytest.fixture
def random():
    """Seeded random numbers."""
    return np.random.default_rng(20)
