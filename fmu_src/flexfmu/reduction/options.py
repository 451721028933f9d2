"""What to make of a mesh, as plain data: where it is held and loaded, its frames, its basis, and what is stored.

`build.config` makes it of a body file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

from ..files.basics import FloatArray
from ..files.units import UnitSystem
from ..model.methods import DEFAULT, Data, Variant
from ..model.reduced_body import Properties

_DEFAULT = Variant(DEFAULT)
DEFAULT_FRAMES = 4
"""Of a body of which nothing is said; parts of a cut one share them."""


class Basis(Enum):
    """Modal basis."""

    NORMAL = "normal"
    """Eigenmodes with the supports in place."""
    CRAIG_BAMPTON = "craig_bampton"
    """Constraint modes of the interfaces and fixed-interface normal modes."""


@dataclass(frozen=True, slots=True)
class Place:
    """Nodes that meet every condition given; lengths in m."""

    set: str | None = None
    numbers: tuple[int, ...] | None = None
    plane: tuple[float, ...] | None = None
    normal: tuple[float, ...] | None = None
    box: tuple[tuple[float, ...], ...] | None = None
    cylinder: tuple[tuple[float, ...], ...] | None = None
    patch: tuple[float, ...] | None = None
    radius: float | None = None
    nearest: tuple[float, ...] | None = None
    tolerance: float | None = None


Nodes = str | Place | tuple[str | Place, ...]
"""A set's name, a place, or all of several."""


@dataclass(frozen=True, slots=True)
class MaterialConstants:
    """Constants that the mesh file lacks, or that replace those of its material of a name; in the mesh's units."""

    name: str | None = None
    youngs_modulus: float | None = None
    poissons_ratio: float | None = None
    density: float | None = None


@dataclass(frozen=True, slots=True)
class SupportNodes:
    """Nodes whose translations are held along some axes, or by springs (N/m, N s/m) that they share equally.

    With stiffness or damping of turns (N m/rad, N m s/rad) a bushing: it acts on the averaged motion, along axes of
    which x and a vector in the plane of x and y are given.
    """

    nodes: Nodes
    fix: tuple[str, ...] = ()
    stiffness: tuple[float, ...] | None = None
    rotational_stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None
    rotational_damping: tuple[float, ...] | None = None
    axes: tuple[tuple[float, ...], ...] | None = None

    @property
    def bushing(self) -> bool:
        """Whether it acts on the nodes' averaged motion."""
        return self.rotational_stiffness is not None or self.rotational_damping is not None


@dataclass(frozen=True, slots=True)
class InterfaceNodes:
    """Nodes of an interface, its reference point (m), how they weigh: "auto", "area" or "node", and whether rigid."""

    name: str
    nodes: Nodes
    point: tuple[float, ...] | None = None
    weights: str = "auto"
    rigid: bool | None = None


@dataclass(frozen=True, slots=True)
class FrameNodes:
    """Nodes of a frame by hand, its joint (a set or a point), its parent, and sets that tell its rotation."""

    name: str
    nodes: Nodes
    joint: str | tuple[float, ...] | None = None
    parent: str | None = None
    rotation_points: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BranchJoints:
    """Distances (m) of joints from the supports on the way toward an interface or a cut."""

    toward: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StressElements:
    """Element set whose stress is stored, by the output's name."""

    name: str
    elements: str


@dataclass(frozen=True, slots=True)
class BasisOptions:
    """Modal basis.

    Attributes
    ----------
    kind : Basis
    numbers : tuple of int
        Of the normal modes, in order of frequency, from 1.
    exact : bool
        Whether just these: else a coarse mesh may have fewer, and one more keeps a pair together.
    residual : bool or tuple of int
        Whether static shapes of all interface loads are added; or places of some, among forces of all interfaces, then
        moments.
    by_need : bool
        Whether static shapes are those alone that the loads need, and shapes of second and third order join them.
    """

    kind: Basis = Basis.NORMAL
    numbers: tuple[int, ...] = tuple(range(1, 9))
    exact: bool = False
    residual: bool | tuple[int, ...] = True
    by_need: bool = False


@dataclass(frozen=True, slots=True)
class BodyOptions:
    """What to make of a mesh.

    Attributes
    ----------
    name : str
    interfaces : tuple of InterfaceNodes
    supports : tuple of SupportNodes
    materials : tuple of MaterialConstants
    units : UnitSystem
        Of the materials' constants.
    boundary : bool
        Whether what the mesh file holds is a support.
    free : bool
        Whether the body may move rigidly.
    root : str or None
        Of a free body, the interface from which frames are counted; None: the first.
    levels : int
        Of automatic division.
    levels_asked : bool
        Whether just so many: else one frame where stretch stops a loop before it turns far.
    frames : tuple of FrameNodes
    branches : tuple of BranchJoints
        In place of levels.
    cuts : tuple of str
        Node sets of the sections at which the body is cut.
    find_cuts : bool
        Whether sections that open loops are looked for.
    may_cut : bool
        Whether loops are cut if it pays.
    stress : tuple of StressElements
    basis : BasisOptions
    membrane : bool, "auto" or "stretching"
    variant : Variant
        That the body starts with.
    stored : frozenset of Data
        Of methods.
    acceleration, surface, surface_stress : bool
        Whether masses, the surface and its stress are stored.
    certificate : bool
        Whether the body is reduced once more, finer, to tell its error.
    watched : bool
        Whether rotation and strain of its material are watched.
    """

    name: str
    interfaces: tuple[InterfaceNodes, ...]
    supports: tuple[SupportNodes, ...] = ()
    materials: tuple[MaterialConstants, ...] = ()
    units: UnitSystem = UnitSystem.SI
    boundary: bool = True
    free: bool = False
    root: str | None = None
    levels: int = DEFAULT_FRAMES
    levels_asked: bool = False
    frames: tuple[FrameNodes, ...] = ()
    branches: tuple[BranchJoints, ...] = ()
    cuts: tuple[str, ...] = ()
    find_cuts: bool = False
    may_cut: bool = False
    stress: tuple[StressElements, ...] = ()
    basis: BasisOptions = BasisOptions()
    membrane: bool | Literal["auto", "stretching"] = "auto"
    variant: Variant = _DEFAULT
    stored: frozenset[Data] = frozenset()
    acceleration: bool = False
    surface: bool = False
    surface_stress: bool = False
    certificate: bool = False
    watched: bool = True

    @property
    def root_place(self) -> int:
        """Place of the interface from which a free body is divided."""
        return 0 if self.root is None else [one.name for one in self.interfaces].index(self.root)


@dataclass(frozen=True, slots=True)
class BodyUse:
    """How a body will be used: what does not change its reduction.

    Attributes
    ----------
    name : str
    damping : float or sequence of float
        Modal damping ratio: of all modes, or one each, of all or of the elastic ones; or (k, 2): Hz and ratios, between
        which it is linear.
    variant : Variant
        Method and mass to start with.
    velocities : bool
        Whether velocities are outputs.
    compliance, follows : tuple of str
        Interfaces whose compliance is offered, and those whose loads turn with them.
    tolerance : float or None
        Relative error above which the FMU warns.
    provenance : mapping of str to str
    properties : Properties or None
    """

    name: str
    damping: float | Sequence[float] | FloatArray = 0.0
    variant: Variant = _DEFAULT
    velocities: bool = False
    compliance: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()
    tolerance: float | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    properties: Properties | None = None
