"""Weighted least-squares rigid fit of a node set (docs/theory.md, section 2), and masses at points, which hang by it.

Such a mass hangs on its nodes as an interface does, by their fit A: its motion is A u, and it adds Aᵀ diag(m, J) A. On
a single node A is that node's displacement, and there is nothing that its rotary inertia turns with.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..fe.assembly import assembled, mass
from ..files.basics import FloatArray, IntArray, ModelError
from ..mesh.model import Mesh, PointMass

# Second moments of the set below this fraction of the largest count as zero: nodes on a line or in one point.
_FLAT = 1e-9
# Share of a mean's largest weight below which other parts are round-off: the point is its nodes' centre.
_EVEN = 1e-9


@dataclass(frozen=True, slots=True)
class Weighted:
    """A node set with the weight of its fit.

    Attributes
    ----------
    nodes : (k,) int
        Ascending.
    weight : (k, k) or (3k, 3k) sparse
        Symmetric, positive: diagonal for weights by node, ∫ N_a N_b over an area or a volume otherwise. The larger one
        weighs directions too: a mass beside its nodes.
    """

    nodes: IntArray
    weight: sp.csr_array

    def centre(self, points: FloatArray) -> FloatArray:
        """Weighted centre (3,) of the nodes among `points` (n, 3)."""
        if self.weight.shape[0] > self.nodes.size:
            # Momentum of a turn about the mean of the nodes tells how far the centre is from there.
            middle = points[self.nodes].mean(axis=0)
            motions = rigid_motions(points[self.nodes] - middle)
            momenta = motions.reshape(-1, 6).T @ self.times(motions)
            return middle + np.array([momenta[1, 5], momenta[2, 3], momenta[0, 4]]) / momenta[0, 0]
        share = np.asarray(self.weight.sum(axis=0)).ravel()
        return share @ points[self.nodes] / share.sum()

    def times(self, motions: FloatArray) -> FloatArray:
        """The weight times motions (k, 3, j) of its nodes, (3k, j)."""
        if self.weight.shape[0] > self.nodes.size:
            return self.weight @ motions.reshape(-1, motions.shape[2])
        return (self.weight @ motions.reshape(len(motions), -1)).reshape(-1, motions.shape[2])


def rigid_motions(arm: FloatArray) -> FloatArray:
    """Translations and turns (k, 3, 6) of places (k, 3) from where they turn about."""
    basis = np.zeros((len(arm), 3, 6))
    basis[:, :, :3] = np.eye(3)
    # θ × r, column by column.
    basis[:, 0, 4], basis[:, 0, 5] = arm[:, 2], -arm[:, 1]
    basis[:, 1, 3], basis[:, 1, 5] = -arm[:, 2], arm[:, 0]
    basis[:, 2, 3], basis[:, 2, 4] = arm[:, 1], -arm[:, 0]
    return basis


def by_node(nodes: IntArray, weights: FloatArray | None = None) -> Weighted:
    """Weigh each node (k,) of a set by a number (k,), by default the same for all."""
    return Weighted(nodes, sp.csr_array(sp.diags_array(np.ones(nodes.size) if weights is None else weights)))


def rigid_fit(points: FloatArray, nodes: Weighted, origin: FloatArray) -> tuple[FloatArray, int]:
    """Operator G from nodal displacements to the displacement and small rotation of their best rigid motion.

    G = (RᵀWR)⁻¹RᵀW, with R the rigid motions about `origin`; forces and moments are spread by Gᵀ, so that virtual
    work is conserved.

    Parameters
    ----------
    points : (n, 3) float
        Of the whole mesh.
    nodes : Weighted
    origin : (3,) float

    Returns
    -------
    operator : (6, 3k) float
        Displacement at `origin`, then rotation vector (1/m).
    rank : int
        6, or less where the nodes lie on a line (5) or in a point (3): rotations that they cannot tell are then zero.
    """
    # About the centre translations and rotations do not mix, which makes the rank plain to see.
    centre = nodes.centre(points)
    arm = points[nodes.nodes] - centre
    basis = rigid_motions(arm)
    weighted = nodes.times(basis)
    motions = basis.reshape(-1, 6)
    # Rotations are scaled by the set's own size, so that the rank does not depend on units.
    size = float(np.max(np.linalg.norm(arm, axis=1))) or 1.0
    scale = np.array([1.0, 1.0, 1.0, 1.0 / size, 1.0 / size, 1.0 / size])
    values, vectors = np.linalg.eigh((motions.T @ weighted) * np.outer(scale, scale))
    kept = values > _FLAT * values[-1]
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    operator: FloatArray = (scale[:, None] * inverse * scale) @ weighted.T
    # u(P) = u(c) + θ × (P − c)
    x, y, z = origin - centre
    operator[:3] -= np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ operator[3:]
    return operator, int(kept.sum())


def modal_fit(
    points: FloatArray, shapes: FloatArray, nodes: Weighted, origin: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Rigid fit of the mode shapes.

    Parameters
    ----------
    points : (n, 3) float
    shapes : (3n, m) float
    nodes : Weighted
    origin : (3,) float

    Returns
    -------
    displacement, rotation : (3, m) float
        Per unit modal coordinate.
    rank : int
        As of `rigid_fit`.
    """
    operator, rank = rigid_fit(points, nodes, origin)
    fit = operator @ shapes.reshape(len(points), 3, -1)[nodes.nodes].reshape(operator.shape[1], -1)
    return fit[:3], fit[3:], rank


def is_mean(operator: FloatArray, share: float = _EVEN) -> bool:
    """Whether the displacement that an operator (3 or 6, 3k) reads is a mean of its nodes': the point is their centre.

    Off it, a displacement takes a part of the rotation, and a force is spread with a moment. Other parts than
    equal ones below a `share` of the largest do not count.
    """
    parts = operator[:3].reshape(3, -1, 3)
    return bool(np.all(abs(parts - parts[0, :, :1] * np.eye(3)[:, None]) <= share * abs(parts).max(initial=0.0)))


# Nodes that a mass may hang on: each couples with all others.
_NODES = 1500


def attachment(points: FloatArray, one: PointMass) -> FloatArray:
    """Operator A (6, 3k) from displacements of a mass's nodes to its displacement and rotation.

    Parameters
    ----------
    points : (n, 3) float
    one : PointMass

    Returns
    -------
    (6, 3k) float

    Raises
    ------
    ModelError
        It hangs on more nodes than its matrix can be held of.
    """
    if one.nodes.size > _NODES:
        raise ModelError(f"mass {one.name!r} hangs on {one.nodes.size} nodes, at most {_NODES}: couple it to fewer")
    return rigid_fit(points, by_node(one.nodes), one.point)[0]


def point_mass_matrix(mesh: Mesh) -> sp.csr_array:
    """What all masses at points add to the mass matrix (3n, 3n), kg."""
    size = 3 * len(mesh.points)
    total = sp.csr_array((size, size))
    for one in mesh.masses:
        operator = attachment(mesh.points, one)
        own = np.zeros((6, 6))
        own[:3, :3], own[3:, 3:] = one.mass * np.eye(3), one.inertia
        total = total + assembled(one.nodes[None], operator.T @ own @ operator, size)
    return total


def model_mass(mesh: Mesh) -> sp.csr_array:
    """Mass matrix of elements and of masses at points.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    (3n, 3n) sparse
        kg.
    """
    elements = mass(mesh)
    return sp.csr_array(elements + point_mass_matrix(mesh)) if mesh.masses else elements
