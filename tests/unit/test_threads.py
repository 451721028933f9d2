"""Builds leave processors to others: OpenBLAS has one thread while they run, and as many as before afterwards."""

import pytest
import threadpoolctl

from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.mesh.elements import ElementType
from meshes import body_file, box


def threads():
    """Threads of each OpenBLAS that is loaded: NumPy's and SciPy's."""
    return [found["num_threads"] for found in threadpoolctl.threadpool_info() if found["internal_api"] == "openblas"]


class Looking(Reporter):
    """Looks at the threads whenever something is told."""

    def __init__(self):
        self.seen = {}

    def note(self, text):
        self.seen[text] = threads()


def test_a_build_takes_one_thread_of_openblas(tmp_path):
    config = body_file(box(ElementType.C3D20R, (4, 2, 2), (1.0, 0.1, 0.1)), tmp_path, interface=["TIP"])
    before, looking = threads(), Looking()
    with threadpoolctl.ThreadpoolController().select(internal_api="openblas").limit(limits=2):
        given = threads()
        if given != [2] * len(before):
            pytest.skip("OpenBLAS has one thread only")
        reduce_body(config, looking, Store(None))
        assert threads() == given
    assert looking.seen
    assert all(each == [1] * len(before) for each in looking.seen.values())
