"""What to make of a mesh, as plain data, and the nodes and elements that it names, by place, number or name.

`build.config` makes it of a body file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Literal, TypeVar

import numpy as np

from ..files.basics import BodyFileError, BoolArray, FloatArray, IntArray, UnitSystem, listed
from ..mesh.model import Mesh
from ..model.methods import DEFAULT, Data, Variant
from ..model.reduced_body import Properties
from ..model.summary import point

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
Branch = tuple[str, tuple[float, ...]]
"""Interface or cut, and distances (m) of joints from the supports on the way there."""


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
    branches : tuple of Branch
        In place of levels.
    cuts : tuple of str
        Node sets of the sections at which the body is cut.
    find_cuts : bool
        Whether sections that open loops are looked for.
    may_cut : bool
        Whether loops are cut if it pays.
    stress : tuple of (str, str)
        Outputs, and the element sets whose stress they are.
    basis : BasisOptions
    membrane : bool, "auto" or "finer"
        Energy of stretching and flattening, where it holds enough, or, for a shadow, stretching down to less of it.
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
    far : bool
        Whether loads bend the body so far that it takes more shapes of third order.
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
    branches: tuple[Branch, ...] = ()
    cuts: tuple[str, ...] = ()
    find_cuts: bool = False
    may_cut: bool = False
    stress: tuple[tuple[str, str], ...] = ()
    basis: BasisOptions = BasisOptions()
    membrane: bool | Literal["auto", "finer"] = "auto"
    variant: Variant = _DEFAULT
    stored: frozenset[Data] = frozenset()
    acceleration: bool = False
    surface: bool = False
    surface_stress: bool = False
    certificate: bool = False
    watched: bool = True
    far: bool = False

    @property
    def root_place(self) -> int:
        """Place of the interface from which a free body is divided."""
        return 0 if self.root is None else [one.name for one in self.interfaces].index(self.root)


@dataclass(frozen=True, slots=True)
class BodyUse:
    """How a body will be used: what does not change its reduction; by the names that `ReducedBody` has for it.

    Attributes
    ----------
    name : str
    damping : float or sequence of float
        Modal damping ratio: of all modes, or one each, of all or of the elastic ones; or (k, 2): Hz and ratios, between
        which it is linear.
    variant : Variant
        Method and mass to start with.
    velocity_outputs : bool
        Whether velocities are outputs.
    compliance_interfaces, following_interfaces : tuple of str
        Interfaces whose compliance is offered, and those whose loads turn with them.
    tolerance : float or None
        Relative error above which the FMU warns.
    provenance : mapping of str to str
    properties : Properties or None
    """

    name: str
    damping: float | Sequence[float] | FloatArray = 0.0
    variant: Variant = _DEFAULT
    velocity_outputs: bool = False
    compliance_interfaces: tuple[str, ...] = ()
    following_interfaces: tuple[str, ...] = ()
    tolerance: float | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    properties: Properties | None = None


def named_set(sets: Mapping[str, IntArray], kind: str, name: str, key: str) -> IntArray:
    """Members of a set.

    Parameters
    ----------
    sets : mapping of str to (k,) int
    kind : str
        "node" or "element".
    name : str
        Upper and lower case count as the same where that is unambiguous; so does a set of an instance without the
        instance's name.
    key : str
        The key of the body file that asks, for the message.

    Returns
    -------
    (k,) int

    Raises
    ------
    BodyFileError
        No such set, several, or an empty one.
    """
    match = [known for known in sets if known == name] or [k for k in sets if k.lower() == name.lower()]
    match = match or [known for known in sets if known.lower().endswith(f".{name.lower()}")]
    if len(match) != 1:
        there = ", ".join(sorted(match or sets)) or "none"
        if match:
            raise BodyFileError(f"{key}: {name!r} may be one of several {kind} sets: {there}; give the whole name")
        raise BodyFileError(f"{key}: the mesh has no {kind} set {name!r}; it has: {there}")
    members = sets[match[0]]
    if not members.size:
        raise BodyFileError(f"{key}: {kind} set {name!r} is empty, expected at least one {kind}")
    # One that a script lists twice would count twice, unlike in the shadow.
    return np.unique(members)


def element_set(mesh: Mesh, name: str, key: str) -> IntArray:
    """Elements of a named set, counted over all blocks; see `named_set`."""
    return named_set(mesh.element_sets, "element", name, key)


PLACED = "nodes of "
"""How names of sets begin that stand for places of a body file."""
_Chooser = TypeVar("_Chooser", SupportNodes, InterfaceNodes, FrameNodes)
# Share of the body's longest side by which nodes may miss a plane or a cylinder without a tolerance.
MISS = 1e-4


def node_set(mesh: Mesh, nodes: Nodes, key: str, units: UnitSystem = UnitSystem.SI) -> IntArray:
    """Nodes of a named set, or at a place.

    Parameters
    ----------
    mesh : Mesh
    nodes : Nodes
        Of names, upper and lower case count as the same where that is unambiguous.
    key : str
        The key of the body file that asks, for the message.
    units : UnitSystem
        Of the body file's lengths, for the message.

    Returns
    -------
    (k,) int
        Ascending.

    Raises
    ------
    BodyFileError
        No such set, or an empty one; no node at a place.
    """
    if isinstance(nodes, str):
        return named_set(mesh.node_sets, "node", nodes, key)
    if isinstance(nodes, tuple):
        return np.unique(np.concatenate([node_set(mesh, one, key, units) for one in nodes]))
    rows = np.flatnonzero(_at(mesh, nodes, key))
    if not rows.size:
        raise BodyFileError(f"{key}: no node lies there; {_nearby(mesh, nodes, key, units)}")
    return rows


def reference(mesh: Mesh, nodes: Nodes) -> FloatArray | None:
    """Reference point (3,), m, that the mesh file gives to a set; None without one."""
    if not isinstance(nodes, str):
        return None
    return next((point for name, point in mesh.references.items() if name.upper() == nodes.upper()), None)


def support_places(mesh: Mesh, supports: Sequence[SupportNodes]) -> tuple[tuple[str, ...], FloatArray, IntArray]:
    """Supports, those of the mesh file last: names (k), centres (k, 3), m, and 1 where springs hold (k,)."""
    found = []
    for number, table in enumerate(supports, start=1):
        rows = node_set(mesh, table.nodes, f"support[{number}].nodes")
        named = isinstance(table.nodes, str) and not table.nodes.startswith(PLACED)
        found.append((str(table.nodes) if named else f"support {number}", rows, int(not table.fix)))
    held = np.flatnonzero(mesh.fixed.any(axis=1))
    if held.size:
        found.append(("held by the mesh file", held, 0))
    points = np.array([mesh.points[rows].mean(axis=0) for _, rows, _ in found]).reshape(-1, 3)
    return tuple(name for name, _, _ in found), points, np.array([spring for _, _, spring in found], dtype=int)


def by_name(mesh: Mesh, config: BodyOptions) -> tuple[Mesh, BodyOptions]:
    """Turn the body file's places into node sets of the mesh.

    Parameters
    ----------
    mesh : Mesh
    config : BodyOptions

    Returns
    -------
    mesh : Mesh
        With the sets.
    config : BodyOptions
        With their names.

    Raises
    ------
    BodyFileError
        As of `node_set`.
    """
    sets = dict(mesh.node_sets)

    def named(kind: str, given: tuple[_Chooser, ...]) -> tuple[_Chooser, ...]:
        found = []
        for number, one in enumerate(given, start=1):
            if not isinstance(one.nodes, str):
                title = f"{PLACED}{kind} {getattr(one, 'name', number)}"
                sets[title] = node_set(mesh, one.nodes, title, config.units)
                one = replace(one, nodes=title)
            found.append(one)
        return tuple(found)

    options = replace(
        config,
        supports=named("support", config.supports),
        interfaces=named("interface", config.interfaces),
        frames=named("frame", config.frames),
    )
    return replace(mesh, node_sets=sets), options


def _at(mesh: Mesh, place: Place, key: str) -> BoolArray:
    """Which nodes meet all of a place's conditions."""
    points = mesh.points
    size = float(np.ptp(points, axis=0).max())
    miss = MISS * size if place.tolerance is None else place.tolerance
    chosen = np.ones(len(points), dtype=bool)
    if place.set is not None:
        chosen &= np.isin(np.arange(len(points)), named_set(mesh.node_sets, "node", place.set, key))
    if place.numbers is not None:
        unknown = np.setdiff1d(place.numbers, mesh.labels)
        if unknown.size:
            raise BodyFileError(f"{key}: the mesh has no nodes of the numbers {listed(unknown)}")
        chosen &= np.isin(mesh.labels, place.numbers)
    if place.plane is not None and place.normal is not None:
        normal = np.array(place.normal) / np.linalg.norm(place.normal)
        chosen &= np.abs((points - place.plane) @ normal) <= miss
    if place.box is not None:
        low, high = np.sort(np.array(place.box), axis=0)
        chosen &= np.all((points >= low - miss) & (points <= high + miss), axis=1)
    if place.cylinder is not None and place.radius is not None:
        start, end = np.array(place.cylinder)
        length = float(np.linalg.norm(end - start))
        along = (points - start) @ (end - start) / length
        away = np.linalg.norm(points - start - np.outer(along / length, end - start), axis=1)
        chosen &= (np.abs(away - place.radius) <= miss) & (along >= -miss) & (along <= length + miss)
    if place.patch is not None and place.radius is not None:
        chosen &= np.isin(np.arange(len(points)), _surface(mesh, key))
        chosen &= np.linalg.norm(points - place.patch, axis=1) <= place.radius + miss
    if place.nearest is not None:
        away = np.where(chosen, np.linalg.norm(points - place.nearest, axis=1), np.inf)
        off = np.linalg.norm(points - place.nearest, axis=1).min()
        # Farther off the body it is hardly meant: in other units, or of another body.
        chosen &= (np.arange(len(points)) == np.argmin(away)) & (off <= size)
    return chosen


def _surface(mesh: Mesh, key: str) -> IntArray:
    """Nodes of the body's surface."""
    if not mesh.blocks:
        raise BodyFileError(f"{key}: patch needs elements, which tell the surface; give a box or a cylinder instead")
    return np.unique(np.concatenate([block.nodes[block.outer].ravel() for block in mesh.faces]))


def _nearby(mesh: Mesh, place: Place, key: str, units: UnitSystem) -> str:
    """Where the body is, how far the closest node misses, and in which other units the place would be on it."""
    unit, name = units.length, units.length_name
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    words = f"the body reaches from {point(low / unit)} to {point(high / unit)} {name}"
    centre = place.plane or place.patch or place.nearest
    if place.plane is not None and place.normal is not None:
        least = np.abs((mesh.points - place.plane) @ (np.array(place.normal) / np.linalg.norm(place.normal))).min()
        words += f", and its node nearest to the plane misses it by {least / unit:.3g} {name}"
    elif centre is not None:
        away = np.linalg.norm(mesh.points - centre, axis=1).min()
        words += f", and its nearest node is {away / unit:.3g} {name} away"
    for other in UnitSystem:
        if other is not units and np.any(_at(mesh, _scaled(place, other.length / unit), key)):
            meant = other.length_name
            return f"{words}; its numbers meet nodes if they are in {meant}: give them in {name}, as the mesh is"
    return f"{words}; places are in the mesh's units ({units.value}): correct them or give a larger tolerance"


def _scaled(place: Place, factor: float) -> Place:
    """The same place with all lengths multiplied, but for a tolerance."""
    names = ("plane", "box", "cylinder", "patch", "radius", "nearest")
    given = {name: value for name in names if (value := getattr(place, name)) is not None}
    return replace(place, **{name: np.multiply(value, factor).tolist() for name, value in given.items()})
