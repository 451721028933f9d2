"""Springs and dampers between nodes, or from nodes to the ground, as data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.mesh.listing import listed


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


def moved_springs(springs: Sequence[SpringDamper], moved: Callable[[IntArray], IntArray]) -> tuple[SpringDamper, ...]:
    """Springs whose nodes have other rows."""
    return tuple(replace(one, ends=(moved(one.ends[0]), moved(one.ends[1]))) for one in springs)


def springs_note(springs: Sequence[SpringDamper], what: str) -> list[str]:
    """A line on the springs of a file; none without them."""
    return [f"{len(springs)} springs and dampers: {listed(one.name for one in springs)} ({what})"] if springs else []
