"""The supported finite element model: a mesh with materials and supports, checked to be a body that can be reduced.

Its materials are what the mesh file tells, completed or replaced by the body file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..fe.assembly import Unknowns, unknowns
from ..files.basics import BodyFileError, BoolArray, FloatArray, IntArray, ModelError, UnitSystem, listed, plural
from ..files.toml_files import orthonormal
from ..mesh.checks import connected_parts, linked_pieces, without_mechanisms
from ..mesh.equations import simplex
from ..mesh.model import NO_MATERIAL, Material, Mesh, SpringDamper
from ..model.summary import point
from .bushings import Bushings, End
from .options import BodyOptions, MaterialConstants, SupportNodes, element_set, node_set
from .rigid_fit import rigid_motions
from .rigid_nodes import with_rigid_nodes

KEYS = ("youngs_modulus", "poissons_ratio", "density")


def elements_without_material(mesh: Mesh) -> int:
    """Number of elements to which the mesh file gives no material."""
    return sum(int(np.sum(block.material == NO_MATERIAL)) for block in mesh.blocks)


def completed(mesh: Mesh, config: BodyOptions) -> tuple[Mesh, tuple[str, ...]]:
    """Give every element a material with all its constants.

    A table with a name takes the place of what the mesh file says of that material, key by key, or of the materials of
    an element set. The one without is for elements without material, and for constants that the file does not tell.

    Parameters
    ----------
    mesh : Mesh
    config : BodyOptions

    Returns
    -------
    mesh : Mesh
    notes : tuple of str
        What was replaced.

    Raises
    ------
    BodyFileError
        A name that no material has, two tables for one, or constants that nobody tells.
    """
    units = config.units
    notes = []
    materials = list(mesh.materials)
    for table in (one for one in config.materials if one.name is not None):
        mesh, place = _place(mesh, materials, str(table.name))
        given = [key for key in KEYS if getattr(table, key) is not None]
        if told := [key for key in given if not np.isnan(getattr(materials[place], key))]:
            notes.append(f"[material]: {', '.join(told)} of {materials[place].name!r} instead of the mesh file's")
        materials[place] = _with(materials[place], table, given, units)
    rest = next((table for table in config.materials if table.name is None), None)
    if rest is not None:
        for place, material in enumerate(materials):
            lacking = [key for key in missing(material) if getattr(rest, key) is not None]
            materials[place] = _with(material, rest, lacking, units)
            if lacking:
                notes.append(f"[material]: {', '.join(lacking)} of {material.name!r}, which the mesh does not tell")
    if bare := elements_without_material(mesh):
        if rest is None or any(getattr(rest, key) is None for key in KEYS):
            raise BodyFileError(
                f"{bare} of {mesh.element_count} elements have no material in the mesh file: add a [material] table "
                f"with {', '.join(KEYS[:2])} and {KEYS[2]}, in the units of [mesh] ({_units(units)}), or a "
                "[[material]] for each element set, with its name"
            )
        mesh = _made_of(mesh, np.concatenate([block.material for block in mesh.blocks]) == NO_MATERIAL, len(materials))
        materials.append(_with(Material("[material]", np.nan, np.nan, np.nan), rest, KEYS, units))
    _refuse_missing(materials, units)
    return replace(mesh, materials=tuple(materials)), tuple(notes)


def _refuse_missing(materials: Sequence[Material], units: UnitSystem) -> None:
    """Raise where a material lacks constants."""
    for material in materials:
        if lacking := list(missing(material)):
            raise BodyFileError(
                f"the mesh file does not tell {', '.join(lacking)} of the material {material.name!r}: add a [material] "
                f"table with it, in the units of [mesh] ({_units(units)}), of this name if there are several"
            )


def missing(material: Material) -> tuple[str, ...]:
    """Keys of the constants that a mesh file does not tell of a material."""
    return tuple(key for key in KEYS if np.isnan(getattr(material, key)))


def needless(mesh: Mesh, config: BodyOptions) -> bool:
    """Whether the table without a name is for nothing."""
    lacks = elements_without_material(mesh) or any(missing(material) for material in mesh.materials)
    return not lacks and any(table.name is None for table in config.materials)


def _place(mesh: Mesh, materials: list[Material], name: str) -> tuple[Mesh, int]:
    """The material of a name among `materials`; of an element set a new one, which its elements have then."""
    found = [place for place, material in enumerate(materials) if material.name.upper() == name.upper()]
    if len(found) == 1:
        return mesh, found[0]
    there = ", ".join(material.name for material in materials) or "none"
    key = f"[material] name = {name!r}: the mesh file names no such material; it has: {there}"
    mesh = _made_of(mesh, np.isin(np.arange(mesh.element_count), element_set(mesh, name, key)), len(materials))
    materials.append(Material(name, np.nan, np.nan, np.nan))
    return mesh, len(materials) - 1


def _made_of(mesh: Mesh, chosen: BoolArray, place: int) -> Mesh:
    """A mesh whose chosen elements (e,) have the material at a place."""
    rows = zip(mesh.blocks, mesh.split(chosen), strict=True)
    return replace(mesh, blocks=tuple(replace(b, material=np.where(own, place, b.material)) for b, own in rows))


def _with(material: Material, table: MaterialConstants, keys: Sequence[str], units: UnitSystem) -> Material:
    scale = {"youngs_modulus": units.stress, "poissons_ratio": 1.0, "density": units.density}
    # Constants of directions do not survive a modulus without any.
    found = replace(material, **{key: getattr(table, key) * scale[key] for key in keys})
    return found if set(keys) <= {"density"} else replace(found, constants=None, layers=())


def _units(units: UnitSystem) -> str:
    return f"{units.stress_name}, –, {units.density_name}"


_AXES = {"x": 0, "y": 1, "z": 2}
# Relative size of a singular value below which a rigid motion is not held.
_FREE = 1e-9
# How far, over its size, a motion of second order may be off what supports allow.
_STRAIGHT = 1e-5
# Relative size of parts of a motion that words leave out.
_PLAIN = 1e-6


@dataclass(frozen=True, slots=True)
class Model:
    """A mesh with materials and supports.

    Attributes
    ----------
    mesh : Mesh
    fixed : (n, 3) bool
        Translations held at zero.
    spring : (n, 3) float
        Stiffness of springs from translations to the ground, N/m.
    rigid : (3n, r) float
        Rigid motions that no support resists, zero where one holds; none for most bodies.
    damper : (n, 3) float
        Damping of translations by dampers on the ground, N s/m.
    bushings : Bushings
        The mesh's springs.
    unknowns : Unknowns
        What supports and the mesh's equations leave to be found.
    """

    mesh: Mesh
    fixed: BoolArray
    spring: FloatArray
    rigid: FloatArray
    damper: FloatArray
    bushings: Bushings = field(init=False)
    unknowns: Unknowns = field(init=False)

    def __post_init__(self) -> None:
        """Solve the equations."""
        object.__setattr__(self, "bushings", Bushings(self.mesh.points, self.mesh.springs))
        object.__setattr__(self, "unknowns", unknowns(self.fixed, self.mesh.equations, self.mesh.mixed))

    @property
    def free(self) -> IntArray:
        """Degrees of freedom that neither supports nor equations determine, ascending."""
        return self.unknowns.free

    @property
    def sprung(self) -> BoolArray:
        """Translations (n, 3) that springs resist."""
        found = self.spring > 0.0
        for one in self.mesh.springs:
            if not one.ends[1].size and one.stiffness.any():
                found[one.ends[0]] = True
        return found

    @property
    def springs(self) -> sp.csr_array:
        """Stiffness (3n, 3n) of all springs to the ground, N/m."""
        rows = self.bushings.rows
        return sp.csr_array(sp.diags_array(self.spring.ravel()) + rows.T @ rows)

    def damper_rows(self, shapes: FloatArray) -> FloatArray | None:
        """Rows G (r, m) of the damping GᵀG that all dampers make of modes (3n, m), s^-1/2."""
        held = np.flatnonzero(self.damper)
        single = np.sqrt(self.damper.ravel()[held])[:, None] * shapes[held]
        whole = np.concatenate([single, self.bushings.dampers @ shapes])
        # No more rows than modes.
        if len(whole) > whole.shape[1]:
            whole = np.asarray(np.linalg.qr(whole, mode="r"))
        found: FloatArray = whole[whole.any(axis=1)]
        return found if found.size else None

    @property
    def placed(self) -> BoolArray:
        """Translations (n, 3) held at zero, only in directions in which elements are free, if there are any.

        Planes of symmetry along a body, which hold every element in a direction, hold no place of it.
        """
        plane = np.all([self.fixed[one.connectivity].any(axis=1).all(axis=0) for one in self.mesh.blocks], axis=0)
        return self.fixed & ~plane if self.fixed[:, ~plane].any() else self.fixed

    @property
    def anchored(self) -> IntArray:
        """Nodes from which distances along the body count: those held best, in all directions and without springs."""
        held = self.fixed | self.sprung
        for chosen in (self.fixed.all(axis=1), self.placed.any(axis=1), held.all(axis=1)):
            if np.any(chosen):
                # Corners of beams at a node that is held bear its number.
                return np.flatnonzero(np.isin(self.mesh.labels, self.mesh.labels[chosen]))
        if held.any():
            return np.flatnonzero(held.any(axis=1))
        # Hinges of shells are equations: those that translations do not fulfil.
        moved = np.abs(self.mesh.equations @ np.tile(np.eye(3), (len(held), 1))).max(axis=1)
        return np.unique(self.mesh.equations[np.flatnonzero(moved > _FREE)].indices // 3)

    @property
    def held(self) -> IntArray:
        """Nodes where a frame may hang on the ground: supports, and springs only where there is nothing else."""
        fixed = np.flatnonzero(self.placed.any(axis=1))
        return fixed if fixed.size else self.anchored


def assemble_model(mesh: Mesh, config: BodyOptions) -> Model:
    """Give a mesh its materials and supports.

    Parameters
    ----------
    mesh : Mesh
        Checked.
    config : BodyOptions

    Returns
    -------
    Model

    Raises
    ------
    BodyFileError
        Elements without material, or a set that is not there.
    ModelError
        A part of the body is free to move without the body file's word that it shall.
    """
    mesh, notes = completed(mesh, config)
    mesh = replace(mesh, notes=(*mesh.notes, *notes))
    mesh = with_rigid_nodes(mesh, config)
    if config.boundary:
        mesh = replace(mesh, equations=sp.csr_array(sp.vstack([mesh.equations, mesh.supports])))
    mesh = without_mechanisms(mesh)
    fixed = mesh.fixed.copy()
    if not config.boundary:
        fixed[:] = False
    spring, damper, springs = np.zeros(fixed.shape), np.zeros(fixed.shape), list(mesh.springs)
    for number, support in enumerate(config.supports, start=1):
        nodes = node_set(mesh, support.nodes, f"support[{number}].nodes")
        for axis in support.fix:
            fixed[nodes, _AXES[axis]] = True
        if support.bushing:
            springs.append(_bushing(mesh, nodes, support, f"support[{number}]"))
            mesh = replace(mesh, notes=(*mesh.notes, springs[-1].words))
            continue
        for array, values in ((spring, support.stiffness), (damper, support.damping)):
            array[nodes] += np.array(values or (0.0, 0.0, 0.0)) / nodes.size
    mesh = replace(mesh, springs=tuple(springs))
    if idle := Bushings(mesh.points, mesh.springs).idle:
        text = f"stiffness and damping about axes of {listed(idle)} do nothing: a single node of a solid does not turn"
        mesh = replace(mesh, notes=(*mesh.notes, text))
    rigid = _free_motions(mesh, fixed | (spring > 0.0), config)
    model = Model(mesh, fixed, spring, rigid, damper)
    if not model.free.size:
        raise ModelError("supports and equations hold every node in all directions: nothing moves; hold fewer nodes")
    if rigid.shape[1] and (damper.any() or model.bushings.dampers.nnz):
        found = "dampers act on a body that is held, and this one is free to move"
        raise ModelError(f"{found}: hold it by springs, or put the dampers between interfaces in a coupling file")
    return model


def _bushing(mesh: Mesh, nodes: IntArray, support: SupportNodes, key: str) -> SpringDamper:
    """A bushing from its nodes' mean to the ground."""
    centre, still, none = mesh.points[nodes].mean(axis=0), (0.0,) * 3, np.zeros(0, dtype=np.int64)
    turning = *(support.rotational_stiffness or still), *(support.rotational_damping or still)
    if any(turning) and End(mesh.points, nodes, centre).rank < 2:
        raise ModelError(f"{key}: its nodes lie on a line or in a point, which has no rotation: give more nodes")
    stiff = np.array([*(support.stiffness or still), *turning[:3]])
    damped = np.array([*(support.damping or still), *turning[3:]])
    ends = np.array([centre, centre])
    return SpringDamper(key, (nodes, none), ends, centre, orthonormal(support.axes), stiff, damped)


def rigid_basis(points: FloatArray) -> FloatArray:
    """Translations, and rotations about the points' mean over the points' extent, (n, 3, 6), of points (n, 3)."""
    arm = points - points.mean(axis=0)
    return rigid_motions(arm / max(float(np.abs(arm).max()), 1e-300))


def free_motions(points: FloatArray, held: BoolArray, soft: sp.csr_array | None = None) -> FloatArray:
    """Rigid motions (3n, r) of points (n, 3) that move no held translation (n, 3) and no bushing (6b, 3n)."""
    motions = rigid_basis(points)
    rows = motions[held] if soft is None else np.concatenate([motions[held], soft @ motions.reshape(-1, 6)])
    _, values, turn = np.linalg.svd(np.concatenate([rows, np.zeros((6, 6))]))
    # Without any support the plain translations and rotations are clearer than the axes of a decomposition.
    free = np.eye(6) if not rows.size else turn[values <= _FREE * values.max()].T
    found: FloatArray = motions.reshape(-1, 6) @ free
    found[held.ravel()] = 0.0
    return found


def stays_free(points: FloatArray, held: BoolArray, rigid: FloatArray) -> bool:
    """Whether rigid motions (3n, r) that are free of held translations (n, 3) at first order are so at second order.

    A line of nodes held along itself turns aside a little, but not far.
    """
    rows = (motions := rigid_basis(points))[held]
    free = np.linalg.lstsq(motions.reshape(-1, 6), rigid)[0]
    turned = np.cross(free[3:].T[:, None, None], np.moveaxis(motions @ free, 2, 0))
    second = (turned + turned.swapaxes(0, 1))[:, :, held].reshape(rigid.shape[1] ** 2, len(rows)).T
    left = second - rows @ np.linalg.lstsq(rows, second)[0]
    return bool(np.abs(left).max(initial=0.0) <= _STRAIGHT * np.abs(turned).max(initial=0.0))


def _link_strains(mesh: Mesh, motions: FloatArray) -> list[FloatArray]:
    """By how much motions (3n, k) stretch rigid links over their size, (r, k) of each kind of link."""
    found = []
    for one in mesh.simplices:
        local = motions.reshape(len(mesh.points), 3, -1)[one.nodes]
        size = 1.0 / np.linalg.norm(one.gradient, axis=(1, 2))
        slope = np.einsum("eaik,eaJ,e->eiJk", local, one.gradient, size, optimize=True)
        inside = np.einsum("eij,ejJk->eiJk", one.span, slope)
        found.append((0.5 * (inside + inside.swapaxes(1, 2))).reshape(-1, motions.shape[1]))
    return found


def _rigidly_joined(mesh: Mesh, piece: IntArray) -> IntArray:
    """Pieces (n,) as one that have three points off a line each in a rigid link, or no more than one, so move as it."""
    first, size = int(piece.max()) + 1, np.bincount(piece)
    pairs = [
        (number, first + place)
        for place, link in enumerate(mesh.links)
        for number in np.unique(piece[link.nodes]).tolist()
        if size[number] == 1 or simplex(mesh.points, link.nodes[piece[link.nodes] == number])[0].size > 2
    ]
    return linked_pieces(np.array(pairs, dtype=np.int64).reshape(-1, 2), first + len(mesh.links))[piece]


def _motions_of_joined(mesh: Mesh, equations: sp.csr_array, nodes: IntArray, held: BoolArray) -> FloatArray:
    """Rigid motions (3k, r) of nodes (k,) that equations join; refused where pieces can move against each other."""
    alone = connected_parts(replace(mesh, equations=sp.csr_array((0, 0))))
    piece = np.unique(_rigidly_joined(mesh, alone)[nodes], return_inverse=True)[1]
    whole = free_motions(mesh.points[nodes], np.zeros((nodes.size, 3), dtype=bool))
    # A column for each motion of each piece, in the same units all over.
    blocks = np.zeros((len(mesh.points), 3, 6 * (int(piece.max()) + 1)))
    column = 6 * piece[:, None, None] + np.arange(6)
    blocks[nodes[:, None, None], np.arange(3)[:, None], column] = whole.reshape(-1, 3, 6)
    own: FloatArray = blocks.reshape(3 * len(blocks), -1)
    resisted = np.concatenate([own[held.ravel()], equations @ own, *_link_strains(mesh, own)])
    # The triangle alone: there may be far more rows than motions.
    _, values, turn = np.linalg.svd(np.linalg.qr(np.vstack([resisted, np.zeros(2 * own.shape[1:])]), mode="r"))
    # Equations that resist nothing within a single piece are round-off of their terms.
    found = own @ turn[values <= _FREE * max(float(values.max()), float(np.abs(equations.data).max(initial=0.0)))].T
    found[held.ravel()] = 0.0
    # Of a lone node six motions are three.
    _, moved, mixed = np.linalg.svd(np.linalg.qr(found, mode="r"))
    found = found @ mixed[moved > _FREE].T
    inside: FloatArray = found.reshape(len(blocks), 3, -1)[nodes].reshape(whole.shape[0], -1)
    if found.shape[1] and np.linalg.matrix_rank(np.hstack([inside, whole])) > whole.shape[1]:
        apart = np.abs(inside - whole @ np.linalg.lstsq(whole, inside)[0]).max(axis=1)
        fault = "equations (*TIE, *EQUATION, *MPC), or single nodes where shells, beams and solids meet, leave pieces"
        fault += f" free to move against each other ({plural(found.shape[1], 'motion')} with the supports)"
        raise ModelError(f"{fault}, such as node {mesh.labels[nodes[apart.argmax() // 3]]}: join them by more nodes")
    return inside


def _motion_words(points: FloatArray, motions: FloatArray) -> str:
    """Which slides and turns rigid motions (3n, r) of points (n, 3) are."""
    centre, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    own = np.linalg.lstsq(rigid_motions((points - centre) / size).reshape(-1, 6), motions)[0]
    moved, turned = np.split(np.round(own / np.abs(own).max(), 9), 2)
    _, values, mixed = np.linalg.svd(turned)
    kinds = {"slide along": moved @ mixed[np.count_nonzero(values > _PLAIN) :].T, "turn about": turned}
    words = ", ".join(f"{kind} {axis}" for kind, vectors in kinds.items() for axis in _axes(vectors))
    # The point that stays where it is, if there is one: ω × (p − c) = −u.
    rows = np.cross(turned.T[:, None], np.eye(3)).swapaxes(1, 2).reshape(-1, 3)
    place = np.linalg.lstsq(rows, -moved.T.ravel())[0]
    stays = np.abs(rows @ place + moved.T.ravel()).max() < _PLAIN
    return f"{words} through {point(centre + size * place)} m" if stays else words


def _axes(vectors: FloatArray) -> list[str]:
    """Directions that span vectors (3, j), the global ones where it can be."""
    found = scipy.linalg.qr(vectors @ np.linalg.pinv(vectors, rcond=_PLAIN), pivoting=True)[0]
    found = np.round(found.T[: np.linalg.matrix_rank(vectors, tol=_PLAIN)], 4)
    names = {point(axis): name for name, axis in zip("xyz", np.eye(3), strict=True)}
    return sorted(names.get(one, one) for one in (point(axis * np.sign(axis.sum())) for axis in found))


def _free_motions(mesh: Mesh, held: BoolArray, config: BodyOptions) -> FloatArray:
    """Rigid motions (3n, r) that move no held translation (n, 3); refused where the body file does not expect them."""
    part = connected_parts(mesh)
    parts = int(part.max()) + 1
    within = [one for one in mesh.springs if np.unique(part[np.concatenate(one.ends)]).size == 1]
    soft = Bushings(mesh.points, within).unit_rows
    found = np.zeros((3 * len(mesh.points), 0))
    for number in range(parts):
        nodes = np.flatnonzero(part == number)
        if not mesh.equations.shape[0]:
            own = soft[:, (3 * nodes[:, None] + np.arange(3)).ravel()]
            motions = free_motions(mesh.points[nodes], held[nodes], own)
        else:
            motions = _motions_of_joined(mesh, sp.csr_array(sp.vstack([mesh.equations, soft])), nodes, held)
        if not motions.shape[1]:
            continue
        if parts > 1 or not config.free:
            one = f"the part of the mesh with node {mesh.labels[nodes[0]]} ({len(nodes)} nodes of {len(part)})"
            which = "the body" if parts == 1 else one
            floating = ", or let it float with free = true" if parts == 1 else ", or join the parts to share nodes"
            if len(within) < len(mesh.springs):
                floating += "; parts that springs alone join are bodies of their own: join them by flexfmu couple"
            fault = f"{which} is free to move in {plural(motions.shape[1], 'rigid motion')}"
            if motions.shape[1] < 6:
                fault += f" ({_motion_words(mesh.points[nodes], motions)})"
            advice = f"the supports hold {held[nodes].sum()} of its translations; add a [[support]]{floating}"
            raise ModelError(f"{fault}: {advice}")
        found = motions
    if config.free and not found.shape[1]:
        raise ModelError("free = true, but the supports hold the body: take out the key, or the supports")
    return found
