"""Sub-domains and their frames: the tree of docs/theory.md, section 4, as the body file gives it or as divided."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..fe.assembly import area_matrix, mean_gradient, scatter, select
from ..files.basics import BodyFileError, BoolArray, FloatArray, IntArray
from ..mesh.model import Mesh
from ..model.reduced_body import GROUND
from ..model.rotations import skew
from .rigid_fit import Weighted, by_node, modal_fit, point_mass_matrix, rigid_fit

# Volume of the tetrahedron of characteristic points over the cube of its longest edge: below it rotations are guesses.
_FLAT_TETRAHEDRON = 1e-4

# A joint given by coordinates may lie this many times the section's reach from its centre.
_JOINT_REACH = 1.5
# Rigid motion of a node over the largest one that is none.
_STILL = 1e-9


@dataclass(frozen=True, slots=True)
class Turn:
    """Linear operator from displacements to a small rotation; translations do not enter.

    Attributes
    ----------
    nodes : (k,) int
    operator : (3, 3k) float
        1/m.
    rank : int
        3, or less where the nodes do not tell every rotation.
    """

    nodes: IntArray
    operator: FloatArray
    rank: int = 3

    def of(self, shapes: FloatArray) -> FloatArray:
        """Rotation (3, m) of mode shapes (3n, m)."""
        return self.operator @ shapes.reshape(-1, 3, shapes.shape[1])[self.nodes].reshape(-1, shapes.shape[1])


def mean_rotation(mesh: Mesh, elements: IntArray) -> Turn:
    """Mean of ½ curl u over the volume of some elements (k,).

    A slender piece that is slightly curved can bend sideways without turning about its own axis. A rigid fit takes part
    of that bending for such a turn; the mean rotation does not.
    """
    nodes, gradient = mean_gradient(mesh, elements)
    return Turn(nodes, 0.5 * np.swapaxes(skew(gradient), 0, 1).reshape(3, -1))


def fitted_rotation(points: FloatArray, nodes: Weighted) -> Turn:
    """Rotation of the rigid motion that fits a node set best."""
    operator, rank = rigid_fit(points, nodes, nodes.centre(points))
    return Turn(nodes.nodes, operator[3:], rank - 3)


@dataclass(frozen=True, slots=True)
class Subdomain:
    """A part of the body that gets a frame of its own.

    Attributes
    ----------
    name : str
    parent : int
        Position of the parent in the list of sub-domains, earlier than its own, or `GROUND`.
    elements : (e,) int
        Its elements, counted over all blocks.
    body : Weighted
        Its nodes, weighted by volume, or by mass for a floating frame.
    rotation : Turn
        How its averaged rotation is read off its material.
    joint : Weighted
        The section that it shares with its parent; at a root, the support.
    joint_point : (3,) float
        m.
    points : tuple of Weighted
        Characteristic points that tell the averaged rotation instead, one or three, or none.
    floating : bool
        Whether it is the floating frame of a body that nothing holds, which carries no part of its own.
    """

    name: str
    parent: int
    elements: IntArray
    body: Weighted
    rotation: Turn
    joint: Weighted
    joint_point: FloatArray
    points: tuple[Weighted, ...] = ()
    floating: bool = False


@dataclass(frozen=True, slots=True)
class FrameOperators:
    """Linear operators of S frames, as `ReducedBody` holds them.

    Attributes
    ----------
    joint_displacement, joint_rotation, frame_rotation : (S, 3, m) float
    """

    joint_displacement: FloatArray
    joint_rotation: FloatArray
    frame_rotation: FloatArray


def volume_weighted(mesh: Mesh, volumes: tuple[FloatArray, ...], elements: IntArray) -> Weighted:
    """Nodes of some elements with the weight ∫ N_a N_b dV.

    Parameters
    ----------
    mesh : Mesh
    volumes : tuple of (n_elements, node_count, node_count) float
    elements : (k,) int
        Counted over all blocks.

    Returns
    -------
    Weighted
    """
    size = len(mesh.points)
    total = sp.csr_array((size, size))
    used = np.zeros(size, dtype=bool)
    inside = np.isin(np.arange(mesh.element_count), elements)
    for block, matrices, chosen in zip(mesh.blocks, volumes, mesh.split(inside), strict=True):
        total = total + scatter(block.connectivity[chosen], matrices[chosen], size)
        used[block.connectivity[chosen]] = True
    nodes = np.flatnonzero(used)
    return Weighted(nodes, sp.csr_array(total[nodes][:, nodes]))


def floating_frame(mesh: Mesh) -> Subdomain:
    """Mean-axis frame of a body that nothing holds: its origin is the centre of mass, it turns with the rigid motions.

    Fitted by mass, elastic modes do not move it, and momentum is that of the rigid motions however far they go.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    Subdomain
        Without elements: what lies on no other frame hangs on it.
    """
    whole = _by_mass(mesh)
    none = np.zeros(0, dtype=np.int64)
    turn = fitted_rotation(mesh.points, whole)
    return Subdomain("floating", GROUND, none, whole, turn, whole, whole.centre(mesh.points), floating=True)


def hinge_frame(mesh: Mesh, rigid: FloatArray, held: BoolArray | None = None) -> Subdomain | None:
    """Frame of a body on a hinge or a ball joint: it turns with the rigid motions, elastic modes do not move it.

    Parameters
    ----------
    mesh : Mesh
    rigid : (3n, r) float
        Rigid motions that no support resists.
    held : (n,) bool, optional
        Nodes that supports hold: others on the axis move as the body bends.

    Returns
    -------
    Subdomain or None
        None unless these are turns about one axis or all, through nodes of the mesh that stay where they are.
    """
    motions = rigid.reshape(len(mesh.points), 3, -1)
    size = np.linalg.norm(motions, axis=(1, 2))
    still = np.flatnonzero(size <= _STILL * size.max())
    if motions.shape[2] not in (1, 3) or not still.size:
        return None
    if held is not None and held[still].any():
        still = still[held[still]]
    whole = _by_mass(mesh)
    arm = mesh.points - mesh.points[still[0]]
    fitted = fitted_rotation(mesh.points, whole).of(rigid)
    if np.abs(np.cross(fitted[None], arm[:, :, None], axis=1) - motions).max() > _STILL * size.max():
        return None
    # Momenta of the rigid motions tell how much there is of each; their turns, by how much the body turns.
    momenta, own = whole.times(motions[whole.nodes]), motions[whole.nodes].reshape(-1, motions.shape[2])
    turn = Turn(whole.nodes, fitted @ np.linalg.solve(own.T @ momenta, momenta.T))
    none = np.zeros(0, dtype=np.int64)
    return Subdomain("hinge", GROUND, none, whole, turn, by_node(still), mesh.points[still[0]], floating=True)


def _by_mass(mesh: Mesh) -> Weighted:
    whole = volume_weighted(mesh, mesh.mass_matrices, np.arange(mesh.element_count))
    if not mesh.masses:
        return whole
    unknown = (3 * whole.nodes[:, None] + np.arange(3)).ravel()
    added = point_mass_matrix(mesh)[unknown][:, unknown]
    return Weighted(whole.nodes, sp.csr_array(sp.kron(whole.weight, sp.eye_array(3)) + added))


def on_floating_frame(subdomains: Sequence[Subdomain], floating: int) -> list[Subdomain]:
    """Sub-domains moved back by the number of floating frames, 0 or 1: roots hang on it where there is one."""
    return [replace(domain, parent=domain.parent + floating) for domain in subdomains]


def section(mesh: Mesh, nodes: IntArray) -> Weighted:
    """Nodes of a section, weighted by area where element faces make it up, else each the same.

    Parameters
    ----------
    mesh : Mesh
    nodes : (k,) int
        Ascending.

    Returns
    -------
    Weighted
    """
    matrix = area_matrix(mesh.points, select(mesh.faces, nodes, outer=False), nodes)
    return by_node(nodes) if matrix is None else Weighted(nodes, matrix)


def elements_within(mesh: Mesh, nodes: IntArray) -> IntArray:
    """Elements (k,) all of whose nodes are among `nodes`, counted over all blocks."""
    parts = [np.isin(block.connectivity, nodes).all(axis=1) for block in mesh.blocks]
    return np.flatnonzero(np.concatenate([np.zeros(0, dtype=bool), *parts]))


@dataclass(frozen=True, slots=True)
class FrameRequest:
    """A frame as the body file names it.

    Attributes
    ----------
    name : str
    nodes : (k,) int
        The sub-domain.
    joint : (j,) int, (3,) float, or None
        Nodes of the joint's section, a point, or None for what is shared with the parent.
    parent : str or None
    points : tuple of (k,) int
        Node sets whose centres are the characteristic points, or none.
    """

    name: str
    nodes: IntArray
    joint: IntArray | FloatArray | None
    parent: str | None
    points: tuple[IntArray, ...] = ()


def requested_subdomains(mesh: Mesh, supported: IntArray, requests: Sequence[FrameRequest]) -> list[Subdomain]:
    """Sub-domains as given by hand, parents first.

    Parameters
    ----------
    mesh : Mesh
    supported : (k,) int
        Nodes that a support holds.
    requests : sequence of FrameRequest

    Returns
    -------
    list of Subdomain

    Raises
    ------
    BodyFileError
        A parent that is not there or hangs on its own child, or a joint that cannot be found.
    """
    position: dict[str, int] = {}
    waiting = list(requests)
    known = {request.name: request for request in requests}
    result: list[Subdomain] = []
    while waiting:
        ready = [r for r in waiting if r.parent is None or r.parent in position]
        if not ready:
            chain = ", ".join(f"{r.name!r} on {r.parent!r}" for r in waiting)
            raise BodyFileError(f"[[frame]] parents must form a tree; these lead to no root: {chain}")
        for request in ready:
            joint, point = _joint(mesh, request, supported if request.parent is None else known[request.parent].nodes)
            elements = elements_within(mesh, request.nodes)
            body = by_node(request.nodes)
            turn = None
            if elements.size:
                solid = volume_weighted(mesh, mesh.volume_matrices, elements)
                # Where the set is no union of elements, every node counts the same.
                if np.array_equal(solid.nodes, request.nodes):
                    body, turn = solid, mean_rotation(mesh, elements)
            parent = GROUND if request.parent is None else position[request.parent]
            position[request.name] = len(result)
            points = tuple(section(mesh, nodes) for nodes in request.points)
            turn = turn or fitted_rotation(mesh.points, body)
            result.append(Subdomain(request.name, parent, elements, body, turn, joint, point, points))
        waiting = [r for r in waiting if r.name not in position]
    return result


def _joint(mesh: Mesh, request: FrameRequest, neighbour: IntArray) -> tuple[Weighted, FloatArray]:
    where = "any support" if request.parent is None else f"its parent {request.parent!r}"
    if request.joint is not None and request.joint.dtype.kind in "iu":
        nodes = request.joint.astype(np.int64)
        for other, words in ((request.nodes, "the frame itself"), (neighbour, where)):
            if not np.intersect1d(nodes, other).size:
                found = f"frame {request.name!r}: its joint shares no node with {words}"
                raise BodyFileError(f"{found}; the joint is the section between the two")
        joint = section(mesh, nodes)
        return joint, joint.centre(mesh.points)
    shared = np.intersect1d(request.nodes, neighbour)
    if not shared.size:
        raise BodyFileError(
            f'frame {request.name!r} shares no node with {where}: name the joint\'s nodes (joint = "SET"), or let '
            "neighbouring sets share their common section"
        )
    joint = section(mesh, shared)
    if request.joint is None:
        return joint, joint.centre(mesh.points)
    point = request.joint.astype(np.float64)
    # A joint anywhere else would have the frame turn about a place where nothing joins.
    reach = float(np.max(np.linalg.norm(mesh.points[shared] - joint.centre(mesh.points), axis=1)))
    away = float(np.linalg.norm(point - joint.centre(mesh.points)))
    if away > _JOINT_REACH * reach:
        raise BodyFileError(
            f"frame {request.name!r}: its joint lies {away:.3g} m from the centre of the section shared with {where}, "
            f"which reaches {reach:.3g} m; coordinates are in m, in the mesh's frame"
        )
    return joint, point


def division_warnings(mesh: Mesh, subdomains: Sequence[Subdomain]) -> tuple[str, ...]:
    """What looks unintended about sub-domains given by hand: parts in several of them, in none, or without elements.

    Parameters
    ----------
    mesh : Mesh
    subdomains : sequence of Subdomain

    Returns
    -------
    tuple of str
    """
    times = np.bincount(np.concatenate([d.elements for d in subdomains]), minlength=mesh.element_count)
    found = [
        f"frame {d.name}: its node set holds no whole element; every node counts the same in its averaged rotation"
        for d in subdomains
        if not d.elements.size
    ]
    if np.any(times > 1):
        found.append(f"{int(np.sum(times > 1))} elements are in more than one frame: what turns there counts twice")
    if np.any(times == 0):
        found.append(f"{int(np.sum(times == 0))} elements are in no frame")
    return tuple(found)


def frame_operators(points: FloatArray, shapes: FloatArray, subdomains: Sequence[Subdomain]) -> FrameOperators:
    """Averaged rotations and joint motions per unit modal coordinate.

    Parameters
    ----------
    points : (n, 3) float
    shapes : (3n, m) float
    subdomains : sequence of Subdomain

    Returns
    -------
    FrameOperators

    Raises
    ------
    BodyFileError
        A sub-domain whose nodes lie on a line, so that its rotation cannot be told.
    """
    displacement, rotation, averaged = (np.zeros((len(subdomains), 3, shapes.shape[1])) for _ in range(3))
    for s, domain in enumerate(subdomains):
        averaged[s] = domain.rotation.of(shapes)
        if domain.rotation.rank < 3:
            found = f"frame {domain.name!r}: its {domain.body.nodes.size} nodes lie on a line or in one point"
            raise BodyFileError(f"{found}, which does not tell a rotation; give it at least three nodes off a line")
        if domain.points:
            averaged[s] = rotation_by_points(points, shapes, domain)
        displacement[s], rotation[s], rank = modal_fit(points, shapes, domain.joint, domain.joint_point)
        if rank < 6:
            # A hinge line or a single node: its own section tells no turn other than the frame's.
            rotation[s] = averaged[s]
    return FrameOperators(displacement, rotation, averaged)


def rotation_by_points(points: FloatArray, shapes: FloatArray, domain: Subdomain) -> FloatArray:
    """Averaged rotation of a sub-domain from the joint and one or three characteristic points.

    One point: the turn of the chord from the joint, r × (u − u_a)/|r|². Three: the skew part of D D₀⁻¹ − I, D₀ and D
    being the tetrahedron's edges before and after. Both are the first-order part of the rotation that the chord, or the
    polar decomposition D D₀⁻¹ = R U, gives: of a turn by θ they find θ, where those find arctan θ.

    Parameters
    ----------
    points : (n, 3) float
    shapes : (3n, m) float
    domain : Subdomain

    Returns
    -------
    (3, m) float
        Per unit modal coordinate.

    Raises
    ------
    BodyFileError
        Points that coincide with the joint or lie in a plane with it.
    """
    anchor, _, _ = modal_fit(points, shapes, domain.joint, domain.joint.centre(points))
    edges = np.array([point.centre(points) - domain.joint.centre(points) for point in domain.points])
    moved = np.array([modal_fit(points, shapes, p, p.centre(points))[0] - anchor for p in domain.points])
    size = float(np.max(np.linalg.norm(edges, axis=1)))
    if len(edges) == 1:
        if size <= 0.0:
            raise BodyFileError(f"frame {domain.name!r}: its rotation point lies in the joint; take the far end")
        return skew(edges[0]) @ moved[0] / size**2
    if abs(np.linalg.det(edges / max(size, 1e-300))) < _FLAT_TETRAHEDRON:
        found = f"frame {domain.name!r}: its three rotation points lie in a plane with the joint"
        raise BodyFileError(f"{found}, which tells no rotation; take points that span a volume with it")
    gradient = np.einsum("pim,jp->ijm", moved, np.linalg.inv(edges))
    spin = 0.5 * (gradient - gradient.transpose(1, 0, 2))
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def element_owner(mesh: Mesh, subdomains: Sequence[Subdomain]) -> IntArray:
    """Frame (e,) that each element counts for, the earliest of several; what is in none hangs on a floating frame.

    Parameters
    ----------
    mesh : Mesh
    subdomains : sequence of Subdomain

    Returns
    -------
    (e,) int
        `GROUND` for elements that no frame carries.
    """
    floating = bool(subdomains) and subdomains[0].floating
    return first_of([domain.elements for domain in subdomains], mesh.element_count, 0 if floating else GROUND)


def first_of(sets: Sequence[IntArray], count: int, otherwise: int = -1) -> IntArray:
    """Which of several sets holds each of `count` nodes or elements, the first that does."""
    number = np.full(count, otherwise)
    for k in reversed(range(len(sets))):
        number[sets[k]] = k
    return number


def carrying_frame(subdomains: Sequence[Subdomain], nodes: IntArray) -> int:
    """Sub-domain that holds most of an interface's nodes (k,), the earliest of equals.

    If none does, the floating frame; without one, `GROUND`.
    """
    if not subdomains:
        return GROUND
    shared = [
        0 if domain.floating else np.intersect1d(nodes, domain.body.nodes, assume_unique=True).size
        for domain in subdomains
    ]
    best = int(np.argmax(shared))
    if shared[best]:
        return best
    return 0 if subdomains[0].floating else GROUND
