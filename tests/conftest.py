"""Fixtures shared by the tests."""

import os

import numpy as np
import pytest

from flexfmu.body import FlexibleBody
from flexfmu.build import reduce_body
from flexfmu.config import read_body_file
from flexfmu.progress import Reporter
from references import BEAM, L_FRAME

# Builds in tests find everything anew, and leave nothing in the user's folders.
os.environ["FLEXFMU_CACHE"] = ""


class Bodies:
    """Demo bodies reduced on demand, each variant once."""

    def __init__(self):
        self._known = {}

    def __call__(self, folder, **changes):
        key = (folder, repr(sorted(changes.items())))
        if key not in self._known:
            config = read_body_file(folder / "body.toml")
            if "modes" in changes:
                changes["reduction"] = config.reduction.model_copy(update={"modes": changes.pop("modes")})
            self._known[key] = FlexibleBody(reduce_body(config.model_copy(update=changes), Reporter()))
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
    return Bodies()


@pytest.fixture
def random():
    """Seeded random numbers."""
    return np.random.default_rng(20)
