"""Records of the maps of stability: one CSV, one row a run, written as soon as it is known; see docs/stability.md."""

import math
from dataclasses import dataclass
from enum import Enum

from ...files.errors import FlexfmuError
from ..scenes.record_file import Layout


class StabilityError(FlexfmuError):
    """A map cannot be made or drawn."""


class Verdict(Enum):
    """What came of a run."""

    RIGHT = "right"
    """Within the tolerance, and nothing said."""
    WARNED = "warned"
    """The FMU, or the master, warned; right or wrong."""
    REFUSED = "refused"
    """The FMU, or the master, stopped."""
    SILENT = "silent"
    """Beyond the tolerance, and nothing said."""


@dataclass(frozen=True, slots=True)
class Run:
    """One row of the records of stability maps: one run.

    Attributes
    ----------
    digest, body : str
        Digest of body and scene; name of the body.
    map, panel, x, y : str
        "buckling", "rotation" or "coupling"; part of its picture; place in the panel.
    verdict : str
        "right", "warned", "refused" or "silent".
    error : float
        Relative displacement of the interface, rms over time; not a number where nothing is known to compare with.
    measure : float
        Buckling: `diagnostics.stability`; rotation: `diagnostics.rotation_within_frame`, rad; coupling: κ.
    taken, seconds : int, float
        Steps until the verdict; time, s.
    words : str
        First message.
    """

    digest: str
    body: str
    map: str
    panel: str
    x: str
    y: str
    verdict: str
    error: float = math.nan
    measure: float = math.nan
    taken: int = 0
    seconds: float = math.nan
    words: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others."""
        return self.map, self.panel, self.x, self.y


def verdict(error: float, warned: bool, refused: bool, tolerance: float) -> Verdict:
    """What to call a run.

    Parameters
    ----------
    error : float
        What is no number counts as wrong.
    warned, refused : bool
    tolerance : float

    Returns
    -------
    Verdict
    """
    if refused:
        return Verdict.REFUSED
    if warned:
        return Verdict.WARNED
    return Verdict.RIGHT if error <= tolerance else Verdict.SILENT


LAYOUT = Layout(
    Run,
    owner="digest",
    digits=4,
    made_by=f"{__package__}.maps",
    called="the records of maps of stability",
    others="runs of another body or scene, or of this one before it changed",
    error=StabilityError,
)
