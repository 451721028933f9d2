"""Springs and dampers between nodes, or from nodes to the ground, as data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.listing import listed

# Distance of two ends across a pull, over where they are, that is round-off of coordinates.
_ACROSS = 1e-6


class Along(Enum):
    """Which axes a spring's six directions have when its ends move and turn far."""

    FIXED = "fixed"
    """The given ones: each end's own displacements along them."""
    END = "end"
    """Carried by the second end, which carries the joint too; on the ground or on nodes that cannot turn the given."""
    LINE = "line"
    """The line between both ends, whose length alone counts."""


@dataclass(frozen=True, slots=True)
class SpringDamper:
    """Six springs and dampers between two ends.

    Attributes
    ----------
    name : str
        What it is and where, for messages.
    ends : (IntArray, IntArray)
        Rows of `Mesh.points` whose mean motion each end makes; of the ground none.
    places : (2, 3) float
        Where the ends are, m.
    joint : (3,) float
        The place that both ends carry with `Along.END`, m.
    axes : (3, 3) float
        In rows.
    stiffness, damping : (6,) float
        Along the axes, then about them: N/m and N m/rad, N s/m and N m s/rad.
    along : Along
    """

    name: str
    ends: tuple[IntArray, IntArray]
    places: FloatArray
    joint: FloatArray
    axes: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    along: Along = Along.END

    @property
    def words(self) -> str:
        """Place, stiffness and damping."""
        parts = (self.joint, *self.stiffness.reshape(2, 3), *self.damping.reshape(2, 3))
        place, one, two, three, four = (", ".join(f"{x:.4g}" for x in part) for part in parts)
        damping = f"; {three} N s/m, {four} N m s/rad" if self.damping.any() else ""
        return f"{self.name}: bushing or spring at ({place}) m, {one} N/m, {two} N m/rad{damping} along its axes"

    @property
    def askew(self) -> bool:
        """Whether it pulls along fixed axes across the line between two ends, so that pull and line make a couple."""
        if self.along is not Along.FIXED or not all(end.size for end in self.ends):
            return False
        used = (self.stiffness + self.damping)[:3] > 0.0
        across = np.cross(self.axes, self.places[0] - self.places[1])[used]
        return bool(np.abs(across).max(initial=0.0) > _ACROSS * np.linalg.norm(self.places[0]))


def moved_springs(springs: Sequence[SpringDamper], moved: Callable[[IntArray], IntArray]) -> tuple[SpringDamper, ...]:
    """Springs whose nodes have other rows."""
    return tuple(replace(one, ends=(moved(one.ends[0]), moved(one.ends[1]))) for one in springs)


def unit_of(direction: int, units: UnitSystem) -> float:
    """What a stiffness or damping of a file is multiplied with, along an axis (0 to 2) or about one (3 to 5)."""
    return units.stress * units.length ** (1 if direction < 3 else 3)


def springs_note(springs: Sequence[SpringDamper]) -> list[str]:
    """Lines on the springs of a file; none without them."""
    if not springs:
        return []
    notes = [f"{len(springs)} springs and dampers: {listed(one.name for one in springs)}"]
    askew = [one.name for one in springs if one.askew]
    if askew:
        notes.append(
            f"springs and dampers {listed(askew)} pull along fixed axes across the line between their nodes: turning "
            "the body as a whole strains them"
        )
    return notes
