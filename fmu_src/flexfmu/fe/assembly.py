"""Stiffness and mass of the mesh: of solids, shells, and the simplices that keep rigid nodes in shape; faces; unknowns.

Unknowns are displacements that neither supports nor equations determine: all displacements are u = T z. T has a row of
the unit matrix for each unknown, zeros for what supports hold, and the solved equations for the rest. So stiffness and
mass become TᵀKT and TᵀMT, and nodal forces Tᵀf.

Of shells (and beams) the unknowns are mean and difference of faces, u = Q v with QᵀQ = 1: of displacements of the faces
themselves, stretch of a thin shell's thickness leaves nothing but round-off for its bending. So v = QᵀT z.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..files.basics import BoolArray, FloatArray, IntArray
from ..mesh.elements import FaceBlock, jacobians
from ..mesh.equations import Simplices, solved
from ..mesh.model import Mesh, once
from ..mesh.shapes import FACE_RULES, FACE_SHAPES
from .layers import Cells, kept_cells, turning
from .shells import shell_cells, shell_rule


@dataclass(frozen=True)
class Unknowns:
    """Which displacements are unknown, and how all others follow from them.

    Attributes
    ----------
    free : (k,) int
        Places of the unknowns among all 3n displacements, ascending.
    size : int
        3n.
    transform : (3n, k) sparse, optional
        T, where there are equations or shells.
    inner : (3n, k) sparse, optional
        QᵀT, likewise.
    means : (3n, 3n) sparse, optional
        Q, where there are shells.
    """

    free: IntArray
    size: int
    transform: sp.csr_array | None = None
    inner: sp.csr_array | None = None
    means: sp.csr_array | None = None

    @cached_property
    def transposed(self) -> sp.csr_array | None:
        """Tᵀ (k, 3n), where there are equations or shells."""
        return None if self.transform is None else sp.csr_array(self.transform.T)

    def matrix(self, whole: sp.csr_array) -> sp.csr_array:
        """Matrix (k, k) of the unknowns of one (3n, 3n) in means and differences."""
        if self.inner is None:
            return sp.csr_array(whole[self.free][:, self.free])
        return sp.csr_array(self.inner.T @ whole @ self.inner)

    def in_means(self, whole: sp.csr_array) -> sp.csr_array:
        """QᵀAQ of a matrix (3n, 3n) of displacements."""
        return whole if self.means is None else sp.csr_array(self.means.T @ whole @ self.means)

    def nodal(self, whole: sp.csr_array, displacements: FloatArray) -> FloatArray:
        """Product (3n, …) of a matrix (3n, 3n) in means and differences with displacements (3n, …)."""
        return whole @ displacements if self.means is None else self.means @ (whole @ (self.means.T @ displacements))

    def of(self, displacements: FloatArray) -> FloatArray:
        """Unknowns (k, …) of displacements (3n, …)."""
        return displacements[self.free] if self.means is None else (self.means.T @ displacements)[self.free]

    def forces(self, nodal: FloatArray) -> FloatArray:
        """Forces (k, …) on the unknowns of nodal forces (3n, …)."""
        return nodal[self.free] if self.transposed is None else self.transposed @ nodal

    def whole(self, vectors: FloatArray) -> FloatArray:
        """Displacements (3n, …) of unknowns (k, …)."""
        if self.transform is not None:
            return self.transform @ vectors
        result = np.zeros((self.size, *vectors.shape[1:]))
        result[self.free] = vectors
        return result


def unknowns(fixed: BoolArray, equations: sp.csr_array, mixed: tuple[IntArray, FloatArray] | None = None) -> Unknowns:
    """The unknowns of a model.

    Parameters
    ----------
    fixed : (n, 3) bool
        Translations held at zero.
    equations : (r, 3n) sparse
    mixed : tuple of (n, 4) int and (n, 4) float, optional
        `Mesh.mixed`.

    Returns
    -------
    Unknowns
    """
    held, means = fixed.ravel(), None
    if mixed is not None and np.any(mixed[1][:, 1:]):
        node, share = mixed
        start = np.arange(0, node.size + 1, node.shape[1])
        whole = sp.csr_array((share.flatten(), node.flatten(), start), shape=(len(fixed), len(fixed)))
        whole.eliminate_zeros()
        means = sp.csr_array(sp.kron(whole, sp.eye_array(3), format="csr"))
        # Where one point of several alone is held, neither the mean nor the difference is.
        both = fixed[node].all(axis=1)
        alone = sp.eye_array(held.size, format="csr")[np.flatnonzero((fixed & ~both).ravel())]
        equations = sp.csr_array(sp.vstack([equations, alone]) @ means)
        held = both.ravel()
    elif not equations.shape[0]:
        return Unknowns(np.flatnonzero(~held), held.size)
    # What is held drops out of the equations.
    dependent, matrix = solved(sp.csr_array(equations @ sp.diags_array((~held).astype(float))))
    known = held.copy()
    known[dependent] = True
    free = np.flatnonzero(~known)
    itself = (~known).astype(float)
    place = dependent, np.arange(dependent.size)
    spread = sp.csr_array((np.ones(dependent.size), place), (held.size, dependent.size))
    inner = sp.csr_array((sp.diags_array(itself) + spread @ matrix).tocsc()[:, free])
    return Unknowns(free, held.size, inner if means is None else sp.csr_array(means @ inner), inner, means)


def select(faces: tuple[FaceBlock, ...], nodes: IntArray, *, outer: bool) -> tuple[IntArray, ...]:
    """Faces all of whose nodes are in a set.

    Parameters
    ----------
    faces : tuple of FaceBlock
    nodes : (k,) int
    outer : bool
        Only faces on the body's surface.

    Returns
    -------
    tuple of (n_faces, node_count) int
        Each face once.
    """
    result = []
    for block in faces:
        chosen = np.isin(block.nodes, nodes).all(axis=1)
        if outer:
            chosen &= block.outer
        picked = block.nodes[chosen]
        _, once = np.unique(np.sort(picked, axis=1), axis=0, return_index=True)
        result.append(picked[np.sort(once)])
    return tuple(result)


def area_matrix(points: FloatArray, faces: tuple[IntArray, ...], nodes: IntArray) -> sp.csr_array | None:
    """∫ N_a N_b dA over faces, as a matrix over the nodes of a set.

    A least-squares fit with this weight is one over the area itself, not over however many nodes it has: a force that
    is spread by its transpose is a uniform traction.

    Parameters
    ----------
    points : (n, 3) float
    faces : tuple of (n_faces, node_count) int
    nodes : (k,) int
        The set, ascending.

    Returns
    -------
    (k, k) sparse or None
        m²; None where the faces do not cover every node of the set.
    """
    covered = np.unique(np.concatenate([block.ravel() for block in faces])) if faces else np.zeros(0)
    if not np.array_equal(covered, nodes):
        return None
    total = sp.csr_array((nodes.size, nodes.size))
    for block in faces:
        if not len(block):
            continue
        shape, rule = FACE_SHAPES[block.shape[1]], FACE_RULES[block.shape[1]]
        value = shape.value(rule.points)
        tangents = np.einsum("fai,qaj->qfij", points[block], shape.gradient(rule.points))
        area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)
        matrices = np.einsum("qa,qb,q,qf->fab", value, value, rule.weights, area, optimize=True)
        total = total + scatter(np.searchsorted(nodes, block), matrices, nodes.size)
    return total


# m³; of what has energy and shall count in no mean over a volume.
_NO_VOLUME = 1e-30


def elastic_cells(mesh: Mesh, elements: int, strains: int = 0, means: bool = False) -> Iterator[Cells]:
    """Yield all that has strain energy, elements and simplices of rigid links, some at a time.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    elements, strains : int
        How many at a time at most, of strains unless that is less than one element has.
    means : bool
        Whether the fields of shells are in means and differences of both faces (`fe.assembly`), not displacements.

    Yields
    ------
    Cells
    """
    for block in mesh.blocks:
        natural, places = block.type.natural, block.type.stiffness.weights
        size = max(1, elements, strains // (len(shell_rule(block.type).rows) if natural else 6 * len(places)))
        if natural:
            yield from (some.in_means() if means else some for some in shell_cells(mesh, block, size))
        else:
            yield from kept_cells(mesh, block, size)
    for one in mesh.simplices:
        count = one.nodes.shape[1]
        volume, value = np.full((len(one.nodes), 1), _NO_VOLUME), np.full((1, count), 1.0 / count)
        nodes, gradient = _in_means(mesh, one) if means else (one.nodes, one.gradient)
        yield Cells(nodes, value, gradient[:, None], volume, _projected(one.span, one.stiffness / _NO_VOLUME))


def _in_means(mesh: Mesh, one: Simplices) -> tuple[IntArray, FloatArray]:
    """Nodes (e, 4 a) and gradients (e, 4 a, 3) of simplices for means and differences, some nodes several times."""
    node, share = mesh.mixed
    count, corners = one.nodes.shape
    gradient = share[one.nodes][..., None] * one.gradient[:, :, None]
    return node[one.nodes].reshape(count, 4 * corners), gradient.reshape(count, 4 * corners, 3)


def _projected(onto: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Matrix (e, 6, 6) of energies ½ k |P E P|², from projectors P (e, 3, 3) and k (e,)."""
    return stiffness[:, None, None] * turning(onto) * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])


# Elements at a time: the strain operators of this many take some 200 MB.
CHUNK = 2048


def stiffness(mesh: Mesh) -> sp.csr_array:
    """Linear elastic stiffness matrix of all nodes, supports not yet eliminated.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.

    Returns
    -------
    (3n, 3n) sparse
        N/m; degree of freedom 3 i + j is node i in direction j; of shells in means and differences (`fe.assembly`).
    """
    size = 3 * len(mesh.points)
    cells = elastic_cells(mesh, CHUNK, means=True)
    total = summed(assembled(some.nodes, some.eliminated(some.elastic)[0], size) for some in cells)
    node, share = mesh.mixed
    moved: FloatArray = np.bincount(node.ravel(), share.ravel()).astype(float)
    return _without_forces_of_translations(sp.csr_array(0.5 * (total + total.T)), moved)


def _without_forces_of_translations(matrix: sp.csr_array, moved: FloatArray) -> sp.csr_array:
    """The matrix less the forces that it has under translations, by round-off: of thin bodies these hide soft modes.

    A translation by one is `moved` (n,) at each node, zero for differences.
    """
    count = len(moved)
    forces = (matrix @ np.kron(moved[:, None], np.eye(3))).reshape(count, 3, 3)
    over = np.divide(0.5, moved, out=np.zeros(count), where=moved > 0.0)[:, None, None]
    blocks = over * (forces + forces.swapaxes(1, 2))
    ends = np.arange(count + 1, dtype=np.int32)
    return sp.csr_array(matrix - sp.bsr_array((blocks, ends[:-1], ends), shape=matrix.shape))


def assembled(nodes: IntArray, matrices: FloatArray, size: int) -> sp.csr_array:
    """Sum element matrices into one of all degrees of freedom.

    Parameters
    ----------
    nodes : (e, a) int
    matrices : (e, 3a, 3a) float
    size : int
        3n.

    Returns
    -------
    (size, size) sparse
    """
    unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1).astype(np.int32)
    return scatter(unknowns, matrices, size)  # type: ignore[arg-type]


def assembler(nodes: IntArray, size: int) -> Callable[[FloatArray], sp.csr_array]:
    """What sums matrices of the same elements again and again, as `assembled` does."""
    count, width = nodes.shape[1], size // 3
    key, place = np.unique((nodes[:, :, None] * width + nodes[:, None]).ravel(), return_inverse=True)
    spread = sp.csr_array((np.ones(place.size), (place, np.arange(place.size))))
    ends = np.searchsorted(key, width * np.arange(width + 1)).astype(np.int32)

    def summed_up(matrices: FloatArray) -> sp.csr_array:
        blocks = matrices.reshape(-1, count, 3, count, 3).swapaxes(2, 3).reshape(-1, 9)
        found = (spread @ blocks).reshape(-1, 3, 3), (key % width).astype(np.int32), ends
        return sp.csr_array(sp.bsr_array(found, shape=(size, size)))

    return summed_up


def summed(parts: Iterable[sp.csr_array]) -> sp.csr_array:
    """Sum of sparse matrices, one at least, in pairs as they come: those of neighbouring elements overlap."""
    # Sums of 2^level parts each, levels descending.
    waiting: list[tuple[int, sp.csr_array]] = []
    for part in parts:
        total, level = part, 0
        while waiting and waiting[-1][0] == level:
            total, level = waiting.pop()[1] + total, level + 1
        waiting.append((level, total))
    total = waiting.pop()[1]
    while waiting:
        total = waiting.pop()[1] + total
    return total


def add_nodal(total: FloatArray, nodes: IntArray, parts: FloatArray) -> None:
    """Add what elements have at their nodes (e, a), parts (e, a, …), to a total (n, …) of all nodes."""
    some, place = np.unique(nodes, return_inverse=True)
    spread = sp.csr_array((np.ones(nodes.size), (place.ravel(), np.arange(nodes.size))))
    total[some] += (spread @ parts.reshape(nodes.size, -1)).reshape(-1, *total.shape[1:])


@once
def mean_gradient(mesh: Mesh, elements: IntArray) -> tuple[IntArray, FloatArray]:
    """Mean displacement gradient over the volume of some elements, as a sum over their nodes.

    Parameters
    ----------
    mesh : Mesh
    elements : (k,) int
        Counted over all blocks; at least one.

    Returns
    -------
    nodes : (j,) int
        Of these elements, ascending.
    gradient : (j, 3) float
        ∫ ∂N_a/∂X dV over the volume, 1/m: the mean of ∂u_i/∂X_J is the sum of u_ai times entry (a, J).
    """
    total, volume = np.zeros((len(mesh.points), 3)), 0.0
    used = np.zeros(len(mesh.points), dtype=bool)
    for block, chosen in mesh.by_block(elements):
        nodes, rule = block.connectivity[chosen], block.type.mass
        slope = block.type.shape.gradient(rule.points)
        inverse, determinant = jacobians(mesh.points[nodes], slope)
        weights = determinant * rule.weights
        np.add.at(total, nodes, np.einsum("eqaJ,eq->eaJ", slope @ inverse, weights, optimize=True))
        volume += float(weights.sum())
        used[nodes] = True
    nodes = np.flatnonzero(used)
    return nodes, total[nodes] / volume


def scatter(nodes: IntArray, matrices: FloatArray, size: int) -> sp.csr_array:
    """Sum element matrices into one over nodes or unknowns.

    Parameters
    ----------
    nodes : (n_elements, node_count) int
    matrices : (n_elements, node_count, node_count) float
    size : int
        Number of nodes or unknowns.

    Returns
    -------
    (size, size) sparse
    """
    count = nodes.shape[1]
    rows, columns = np.repeat(nodes, count, axis=1).ravel(), np.tile(nodes, (1, count)).ravel()
    return sp.csr_array(sp.coo_array((matrices.ravel(), (rows, columns)), shape=(size, size)))


def mass(mesh: Mesh) -> sp.csr_array:
    """Consistent mass matrix of all nodes.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    (3n, 3n) sparse
        kg.
    """
    size = len(mesh.points)
    pairs = zip(mesh.blocks, mesh.mass_matrices, strict=True)
    scalar = summed(scatter(block.connectivity, matrices, size) for block, matrices in pairs)
    return in_short(sp.csr_array(sp.kron(scalar, sp.eye_array(3), format="csr")))


def in_short(matrix: sp.csr_array) -> sp.csr_array:
    """The same matrix in 32-bit indices, where they are enough."""
    kind = np.int32 if matrix.nnz <= np.iinfo(np.int32).max else np.int64
    arrays = matrix.data, matrix.indices.astype(kind, copy=False), matrix.indptr.astype(kind, copy=False)
    return sp.csr_array(arrays, shape=matrix.shape)
