"""The finite element mesh as data: nodes, blocks of solid elements, sets and materials; SI units throughout."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, wraps
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from flexfmu.files import sparse as sp
from flexfmu.files.basics import BoolArray, FloatArray, IntArray, UnitSystem, listed
from flexfmu.mesh.elements import ElementBlock, FaceBlock, by_block, faces_of, volume_matrices
from flexfmu.mesh.equations import RigidLink, Simplices
from flexfmu.mesh.shapes import BRICK

F = TypeVar("F", bound=Callable[..., Any])
NO_MATERIAL = -1
SECTION_SHARES = 0.5 * np.array([[1.0, x, y, x * y] for x, y in BRICK.corners[:4, :2].tolist()])
"""Displacements of the corners of a beam's section by their mean, both slopes and twist."""


class Layer(NamedTuple):
    """A layer of shells.

    Attributes
    ----------
    share : float
        Of the thickness, or what is in proportion to it.
    angle : float
        From the first axis of the laminate to its own, rad.
    constants : tuple of float
        As of `Material.constants`.
    """

    share: float
    angle: float
    constants: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Material:
    """Linear elasticity; the same constants serve St. Venant-Kirchhoff.

    Attributes
    ----------
    name : str
    youngs_modulus : float
        N/m²; NaN where the mesh file does not tell. Of an anisotropic material, that of its average over directions.
    poissons_ratio : float
        Between −1 and 0.5, both excluded; likewise.
    density : float
        kg/m³; NaN where the mesh file does not tell.
    constants : tuple of float, optional
        Of an anisotropic material: rows of the symmetric matrix (6, 6) from strain xx, yy, zz and twice xy, yz, zx to
        stress xx, yy, zz, xy, yz, zx, in the material's axes, N/m².
    layers : tuple of Layer
        Of shells that have several, from the side against their normal; the others are averages then.
    by_normal : bool
        Whether the layers' angles turn about the shells' normal, and not the material's third axis.
    bending : float
        Of shells of one layer, bending stiffness over that of a plate.
    """

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float
    constants: tuple[float, ...] | None = None
    layers: tuple[Layer, ...] = ()
    by_normal: bool = False
    bending: float = 1.0

    @property
    def elasticity(self) -> FloatArray:
        """Matrix (6, 6) from strain xx, yy, zz and twice xy, yz, zx to stress, in the material's axes, N/m²."""
        if self.constants is not None:
            return np.array(self.constants).reshape(6, 6)
        shear = 0.5 * self.youngs_modulus / (1.0 + self.poissons_ratio)
        lame = 2.0 * shear * self.poissons_ratio / (1.0 - 2.0 * self.poissons_ratio)
        result = np.diag([2.0 * shear] * 3 + [shear] * 3)
        result[:3, :3] += lame
        return result


def isotropic_average(constants: tuple[float, ...]) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio of the average of a stiffness over all directions (Voigt).

    Parameters
    ----------
    constants : tuple of float
        As of `Material.constants`.

    Returns
    -------
    youngs_modulus, poissons_ratio : float
    """
    c = np.array(constants).reshape(6, 6)
    direct, mixed, shear = np.trace(c[:3, :3]), c[0, 1] + c[1, 2] + c[0, 2], np.trace(c[3:, 3:])
    bulk, rigidity = (direct + 2.0 * mixed) / 9.0, (direct - mixed + 3.0 * shear) / 15.0
    poisson = (3.0 * bulk - 2.0 * rigidity) / (6.0 * bulk + 2.0 * rigidity)
    return float(2.0 * rigidity * (1.0 + poisson)), float(poisson)


def laminate(
    name: str, layers: Sequence[tuple[float, float, Material]], *, by_normal: bool, more: float = 0.0
) -> Material:
    """What shells of several layers are made of.

    Parameters
    ----------
    name : str
    layers : sequence of (float, float, Material)
        Thickness, angle in rad, material, from the side against the shells' normal.
    by_normal : bool
        As of `Material`.
    more : float
        Density that no layer has, kg/m³.

    Returns
    -------
    Material
    """
    thickness, _, materials = zip(*layers, strict=True)
    share = np.array(thickness) / sum(thickness)
    stiff = np.array([one.elasticity.ravel() for one in materials])
    found = [
        Layer(h, angle, tuple(own.tolist()))
        for h, (_, angle, _), own in zip(share.tolist(), layers, stiff, strict=True)
    ]
    density = float(share @ [one.density for one in materials]) + more
    average = isotropic_average(tuple((share @ stiff).tolist()))
    return Material(name, *average, density, layers=tuple(found), by_normal=by_normal)


@dataclass(frozen=True, slots=True)
class PointMass:
    """A mass that hangs on nodes of the mesh.

    Attributes
    ----------
    name : str
    point : (3,) float
        Its centre, m.
    nodes : (k,) int
        Rows of `Mesh.points` that carry it: a single one, at its centre, or those of a coupling.
    mass : float
        kg.
    inertia : (3, 3) float
        Rotary inertia about its centre, kg m², global axes.
    """

    name: str
    point: FloatArray
    nodes: IntArray
    mass: float
    inertia: FloatArray


def masses_note(masses: Sequence[PointMass], where: str) -> list[str]:
    """A line on the masses that a file gives to nodes or points; none without them."""
    total = sum(one.mass for one in masses)
    return [f"masses at {len(masses)} {where}: {listed(one.name for one in masses)}; {total:.5g} kg"] if masses else []


# Distance of two ends across a pull, over where they are, that is round-off of coordinates.
_ACROSS = 1e-6


# Which axes a spring's six directions have when its ends move and turn far. FIXED: the given ones, each end's own
# displacements along them. END: carried by the second end, which carries the joint too; on the ground or on nodes that
# cannot turn the given ones. LINE: the line between both ends, whose length alone counts.
Along = Enum("Along", "FIXED END LINE")


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
        across = np.cross(self.axes, self.places[0] - self.places[1])[(self.stiffness + self.damping)[:3] > 0.0]
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
    notes = [f"springs and dampers ({len(springs)}): {listed(one.name for one in springs)}"]
    askew = [one.name for one in springs if one.askew]
    if askew:
        found = f"springs and dampers {listed(askew)} pull along fixed axes across the line between their nodes"
        notes.append(f"{found}: turning the body as a whole strains them")
    return notes


class _Rows:
    """Equations of a mesh, or None: then they are none, as wide as others, and made only where they are asked for."""

    def __init__(self, name: str):
        self._name = name

    def __set__(self, mesh: "Mesh", rows: "sp.csr_array | None") -> None:
        vars(mesh)[self._name] = rows if rows is not None and rows.shape[0] else None

    def __get__(self, mesh: "Mesh | None", _: type) -> "sp.csr_array | None":
        return mesh and (sp.csr_array((0, mesh.points.size)) if (rows := vars(mesh)[self._name]) is None else rows)


_EQUATIONS, _SUPPORTS = _Rows("equations"), _Rows("supports")


@dataclass(frozen=True, repr=False)
class Mesh:
    """A body's mesh; what follows from its nodes and elements alone is found once.

    Attributes
    ----------
    points : (n, 3) float
        Node coordinates, m, global frame.
    labels : (n,) int
        The file's node numbers.
    blocks : tuple of ElementBlock
    node_sets : mapping of str to (k,) int
        Rows of `points`, ascending, none twice. Names as the file spells them.
    element_sets : mapping of str to (k,) int
        Positions in the blocks' elements, laid end to end.
    materials : tuple of Material
    fixed : (n, 3) bool
        Translations that the file itself holds at zero.
    notes : tuple of str
        What the reader left unused, for the log.
    references : mapping of str to (3,) float, optional
        Reference points that the file gives to node sets, m.
    equations : (r, 3n) sparse
        Linear equations between displacements, E u = 0; column 3 i + j is node i in direction j. None by default.
    masses : tuple of PointMass
    links : tuple of RigidLink
        Nodes that the file makes rigid.
    simplices : tuple of Simplices
        What keeps rigid nodes in shape; from `links.with_links`.
    springs : tuple of SpringDamper
    supports : (r, 3n) sparse
        The same by which the file itself holds rotations; of the model where `fixed` counts.
    """

    points: FloatArray
    labels: IntArray
    blocks: tuple[ElementBlock, ...]
    node_sets: Mapping[str, IntArray]
    element_sets: Mapping[str, IntArray]
    materials: tuple[Material, ...]
    fixed: BoolArray
    notes: tuple[str, ...] = ()
    references: Mapping[str, FloatArray] = field(default_factory=dict)
    equations: "sp.csr_array" = _EQUATIONS
    masses: tuple[PointMass, ...] = ()
    links: tuple[RigidLink, ...] = ()
    simplices: tuple[Simplices, ...] = ()
    supports: "sp.csr_array" = _SUPPORTS
    springs: tuple[SpringDamper, ...] = ()

    def __repr__(self) -> str:
        """Size, kinds of elements, sets."""
        kinds = ", ".join(f"{len(block.labels)} {block.type.name}" for block in self.blocks)
        sets = f"node sets {listed(self.node_sets)}; element sets {listed(self.element_sets)}"
        return f"<Mesh: {len(self.points)} nodes, {kinds or 'no elements'}; {sets}>"

    @property
    def element_count(self) -> int:
        """Number of elements over all blocks."""
        return int(self.starts[-1])

    @cached_property
    def kept(self) -> dict[object, Any]:
        """What is kept beside the mesh as long as there is one, by name."""
        return {}

    @cached_property
    def starts(self) -> IntArray:
        """Number of each block's first element, counted over all blocks, and how many there are, (b + 1,)."""
        return np.cumsum([0, *(len(block.labels) for block in self.blocks)])

    @cached_property
    def mixed(self) -> tuple[IntArray, FloatArray]:
        """Points (n, 4), and shares (n, 4), QᵀQ = 1: displacements u = Q v of unknowns that leave thin bodies digits.

        Mean and difference of both faces of shells; mean, both slopes and twist of corners of beams' sections. Of other
        points the displacements themselves. The means take the place of the first point.
        """
        count = len(self.points)
        node, share = np.repeat(np.arange(count)[:, None], 4, axis=1), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        for block in self.blocks:
            if block.type.shell:
                ends = block.connectivity[:, block.type.sheet.halves].swapaxes(1, 2).reshape(-1, 2)
                ends = np.unique(np.sort(ends, axis=1), axis=0)
                node[ends, :2] = ends[:, None]
                share[ends, :2] = np.sqrt(0.5) * np.array([[1.0, -1.0], [1.0, 1.0]])
            elif block.type.beam:
                corners = block.connectivity.reshape(-1, 4)
                node[corners], share[corners] = corners[:, None], SECTION_SHARES
        return node, share

    @cached_property
    def faces(self) -> tuple[FaceBlock, ...]:
        """All faces of all elements, one item per block, two of wedges; a face between two elements appears twice."""
        return faces_of(self.blocks)

    @cached_property
    def volume_matrices(self) -> tuple[FloatArray, ...]:
        """∫ N_a N_b dV (n_elements, node_count, node_count) of each block's elements, m³."""
        return volume_matrices(self.points, self.blocks)

    @property
    def mass_matrices(self) -> tuple[FloatArray, ...]:
        """∫ ρ N_a N_b dV (n_elements, node_count, node_count) of each block's elements, kg."""
        density = np.array([material.density for material in self.materials])
        pairs = zip(self.blocks, self.volume_matrices, strict=True)
        return tuple(density[block.material][:, None, None] * matrices for block, matrices in pairs)

    @cached_property
    def volumes(self) -> FloatArray:
        """Volumes (n_elements,) over all blocks, m³."""
        return np.concatenate([np.zeros(0), *(matrices.sum(axis=(1, 2)) for matrices in self.volume_matrices)])

    def element_means(self, values: FloatArray) -> FloatArray:
        """Mean (n_elements, …) over each element's nodes of values (n, …)."""
        return np.concatenate([values[block.connectivity].mean(axis=1) for block in self.blocks])

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Values (n_elements, …) over all blocks, by block."""
        return np.split(values, self.starts[1:-1])

    def by_block(self, elements: IntArray) -> Iterator[tuple[ElementBlock, IntArray]]:
        """Each block that has some of the elements, counted over all blocks, and their places in it."""
        return by_block(self.blocks, elements)


def once(find: F) -> F:
    """What a function of a mesh finds for arrays and numbers is kept beside the mesh; nobody alters it."""

    @wraps(find)
    def kept(mesh: Mesh, *given: Any) -> Any:
        key = find.__qualname__, *(one.tobytes() if isinstance(one, np.ndarray) else one for one in given)
        if key not in mesh.kept:
            mesh.kept[key] = find(mesh, *given)
        return mesh.kept[key]

    return cast(F, kept)


def hung(mesh: Mesh, moved: Callable[[IntArray], IntArray]) -> dict[str, Any]:
    """What hangs on nodes of a mesh, masses and springs, where these have other rows."""
    masses = tuple(replace(one, nodes=moved(one.nodes)) for one in mesh.masses)
    return {"masses": masses, "springs": moved_springs(mesh.springs, moved)}
