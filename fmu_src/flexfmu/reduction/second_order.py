"""What motions within frames lack at second order (docs/theory.md, section 4a).

Within its frame a point of sub-domain s moves by e = u − u(X_s) − θ_s × (x − X_s), linear in q. The strain of that is
not linear: it holds E = ½ GᵀG with G = ∇u − θ̂_s, so that a bent piece grows longer, and a twisted open profile bends,
though no stress asks for it. What is added to e is the displacement w that takes this strain away again, as far as a
displacement can: the response of the body to the initial strain −E. No more is needed of it than how the nodes of the
tree are moved. By Betti's theorem that is the work of E on the stress S of a unit load at the node,

    w_node = −½ qᵀ (Σ_s ∫_s S_JK ∂φ_a/∂X_J · ∂φ_b/∂X_K dV) q,        ∂φ/∂X less the frame's own rotation,        (18)

a geometric stiffness (11) of what turns within the frames, on the response that the factorised stiffness gives anyway.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fe.geometric import geometric_stiffness
from ..mesh.model import FloatArray, IntArray, Mesh
from ..model.reduced_body import GROUND, SecondOrder
from ..rotations import skew
from .interfaces import Interface
from .rigid_fit import Weighted, rigid_fit
from .subdomains import Subdomain, carrying_frame, element_owner
from .supported import Supported

_RANK = 6


@dataclass(frozen=True, slots=True)
class Reading:
    """How the motion of a node of the tree is read off displacements.

    Attributes
    ----------
    nodes : (k,) int
    displacement : (3, 3k) float
    turning_nodes : (j,) int
    rotation : (3, 3j) float
        Zero where nothing asks for it.
    section : (3, 3, 3) float
        Rotation that it reads off nodes displaced by S (x − X), per component of the symmetric S.
    """

    nodes: IntArray
    displacement: FloatArray
    turning_nodes: IntArray
    rotation: FloatArray
    section: FloatArray

    def loads(self, count: int) -> FloatArray:
        """Nodal forces (3n, 6) whose work is the motion: a unit of each displacement, then of each rotation."""
        result = np.zeros((count, 3, _RANK))
        result[self.nodes, :, :3] = self.displacement.T.reshape(-1, 3, 3)
        result[self.turning_nodes, :, 3:] = self.rotation.T.reshape(-1, 3, 3)
        return result.reshape(-1, _RANK)


def _section(points: FloatArray, nodes: IntArray, rotation: FloatArray, origin: FloatArray) -> FloatArray:
    result: FloatArray = np.einsum(
        "inj,nl->ijl", rotation.reshape(3, nodes.size, 3), points[nodes] - origin, optimize=True
    )
    return result


def joint_reading(points: FloatArray, domain: Subdomain) -> Reading:
    """Motion of the section on which a sub-domain hangs; a hinge line or a single node turns as the sub-domain does."""
    nodes = domain.joint.nodes
    operator, rank = rigid_fit(points, domain.joint, domain.joint_point)
    if rank == _RANK:
        section = _section(points, nodes, operator[3:], domain.joint.centre(points))
        return Reading(nodes, operator[:3], nodes, operator[3:], section)
    body, _ = rigid_fit(points, domain.body, domain.joint_point)
    return Reading(nodes, operator[:3], domain.body.nodes, body[3:], np.zeros((3, 3, 3)))


def interface_reading(points: FloatArray, interface: Interface) -> Reading:
    """Motion of an interface."""
    rotation = interface.operator[3:]
    section = _section(points, interface.nodes, rotation, interface.point)
    return Reading(interface.nodes, interface.operator[:3], interface.nodes, rotation, section)


def mean_reading(share: FloatArray) -> Reading:
    """Mean displacement of all nodes, weighted by their share (n,) of one."""
    nodes = np.flatnonzero(share)
    mean = (share[nodes, None, None] * np.eye(3)).transpose(1, 0, 2).reshape(3, -1)
    return Reading(nodes, mean, np.zeros(0, dtype=np.int64), np.zeros((3, 0)), np.zeros((3, 3, 3)))


def spring_reading(points: FloatArray, nodes: Weighted, carrier: Subdomain | None) -> Reading:
    """Motion of the nodes of a support's springs; a line or a point of them turns as the sub-domain that carries it."""
    origin = nodes.centre(points)
    operator, rank = rigid_fit(points, nodes, origin)
    if rank == _RANK or carrier is None:
        section = _section(points, nodes.nodes, operator[3:], origin)
        return Reading(nodes.nodes, operator[:3], nodes.nodes, operator[3:], section)
    body, _ = rigid_fit(points, carrier.body, carrier.joint_point)
    return Reading(nodes.nodes, operator[:3], carrier.body.nodes, body[3:], np.zeros((3, 3, 3)))


def node_readings(
    points: FloatArray,
    subdomains: Sequence[Subdomain],
    interfaces: Sequence[Interface],
    shares: FloatArray,
    springs: Sequence[Weighted],
) -> list[Reading]:
    """How the nodes of the tree are read, in its order.

    Parameters
    ----------
    points : (n, 3) float
    subdomains : sequence of Subdomain
    interfaces : sequence of Interface
    shares : (P, n) float
        Share of each node in each centre of mass.
    springs : sequence of Weighted
        Nodes of springs that frames carry; their other ends are on the ground.

    Returns
    -------
    list of Reading
    """
    readings = [joint_reading(points, domain) for domain in subdomains]
    readings += [interface_reading(points, interface) for interface in interfaces]
    readings += [mean_reading(share) for share in shares]
    for nodes in springs:
        frame = carrying_frame(subdomains, nodes.nodes)
        readings.append(spring_reading(points, nodes, subdomains[frame] if frame >= 0 else None))
    return readings + [mean_reading(np.zeros(len(points)))] * len(springs)


def second_order(
    mesh: Mesh,
    model: Supported,
    shapes: FloatArray,
    subdomains: Sequence[Subdomain],
    frame_rotation: FloatArray,
    readings: Sequence[Reading],
) -> SecondOrder:
    """Quadratic parts (18) of the motions of the tree's nodes.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    model : Supported
    shapes : (3n, m) float
    subdomains : sequence of Subdomain
    frame_rotation : (S, 3, m) float
        Averaged rotations.
    readings : sequence of Reading
        One for each node of the tree, in its order.

    Returns
    -------
    SecondOrder
    """
    count, modes = len(mesh.points), shapes.shape[1]
    loads = np.hstack([reading.loads(count) for reading in readings])
    fields = model.whole(model.static(loads[model.free]))
    owner = element_owner(mesh, subdomains)
    total = np.zeros((loads.shape[1], modes, modes))
    for s in np.unique(owner):
        turned = shapes
        if s != GROUND:
            # u(X_s) is left out: only the gradient counts.
            arm = mesh.points - subdomains[s].joint_point
            turned = shapes + (skew(arm) @ frame_rotation[s]).reshape(3 * count, modes)
        total -= geometric_stiffness(mesh, fields, turned, np.flatnonzero(owner == s))
    motion = total.reshape(len(readings), 2, 3, modes, modes)
    return SecondOrder(motion[:, 0], motion[:, 1], np.array([reading.section for reading in readings]))
