"""What there is to see of a body, whatever it is drawn with."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..files.basics import FloatArray, IntArray

DISPLACEMENT, STRESS = "displacement", "von Mises stress"


MarkKind = Literal["interface", "joint", "cut", "support", "spring"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A point with a name.

    Attributes
    ----------
    kind : MarkKind
    name : str
    """

    kind: MarkKind
    name: str


@dataclass(frozen=True, slots=True)
class Region:
    """What each point of the surface belongs to.

    Attributes
    ----------
    title : str
    names : tuple of str
    number : (n,) int
        Index of `names`, −1 for none of them.
    """

    title: str
    names: tuple[str, ...]
    number: IntArray


@dataclass(frozen=True, slots=True)
class Case:
    """A motion: one or several shapes of the body.

    Attributes
    ----------
    name : str
    label, unit : str
        What the positions along the motion are, and their unit: time in s, share of a load.
    position : (T,) float
    places : (T, n, 3) float
        m.
    marks : (T, k, 3) float
        Where the marks are, m.
    stress : (T, n) float or None
        Von Mises, N/m².
    cyclic : bool
        Whether the last shape is followed by the first.
    note : str
        What to know of it: the largest displacement and where, a warning.
    """

    name: str
    label: str
    unit: str
    position: FloatArray
    places: FloatArray
    marks: FloatArray
    stress: FloatArray | None = None
    cyclic: bool = False
    note: str = ""


@dataclass(frozen=True, slots=True)
class View:
    """A body and its motions.

    Attributes
    ----------
    title, subtitle : str
    points : (n, 3) float
        Undeformed, m.
    faces : (f, 4) int
        Rows of `points`, outward; a triangle repeats its last corner.
    regions : tuple of Region
    marks : tuple of Mark
    mark_points : (k, 3) float
        Undeformed places of the marks, m.
    cases : tuple of Case
        Without any the body is seen as it is.
    sets : mapping of str to (j,) int
        Points of the mesh's node sets that lie on the surface.
    scale : float
        Factor on displacements, 0 to choose one where they are small.
    colour : str
        Title of a region, `DISPLACEMENT` or `STRESS`: what is shown first.
    live : mapping or None
        What a page needs whose body answers to the pointer.
    """

    title: str
    subtitle: str
    points: FloatArray
    faces: IntArray
    regions: tuple[Region, ...]
    marks: tuple[Mark, ...]
    mark_points: FloatArray
    cases: tuple[Case, ...] = ()
    sets: Mapping[str, IntArray] = field(default_factory=dict)
    scale: float = 0.0
    colour: str = DISPLACEMENT
    live: Mapping[str, object] | None = None

    @property
    def size(self) -> float:
        """Largest side of the undeformed body, m."""
        return float(np.max(np.ptp(self.points, axis=0)))

    def factor(self, case: Case) -> float:
        """The factor on displacements that a case is shown with."""
        return self.scale or shown_factor(float(np.abs(case.places - self.points).max()), self.size)

    def telling(self, case: Case) -> int:
        """The shape of a motion that tells most: the last of a load that grows, else the largest."""
        if case.unit == "%":
            return len(case.position) - 1
        return int(np.argmax(np.abs(case.places - self.points).max(axis=(1, 2))))

    @property
    def colours(self) -> tuple[str, ...]:
        """What the surface can be coloured by."""
        moved = (DISPLACEMENT,) if self.cases or self.live else ()
        stressed = (STRESS,) if any(case.stress is not None for case in self.cases) else ()
        return (*moved, *stressed, *(region.title for region in self.regions))


# Displacements below this share of the body's size hardly show: they are drawn as large as the next one.
_SMALL, _SEEN = 0.03, 0.1


def shown_factor(largest: float, size: float) -> float:
    """1 where a displacement (m) shows on a body of some size (m); else a round factor with which it does."""
    if largest <= 0.0 or largest >= _SMALL * size:
        return 1.0
    factor = _SEEN * size / largest
    power = 10.0 ** np.floor(np.log10(factor))
    return float(max(step * power for step in (1, 2, 5) if step * power <= factor * (1 + 1e-12)))
