"""Where the nodes of the tree go at second order (docs/theory.md, section 4a).

A displacement field u = Φq whose material turns is not free of strain: it holds E = ½ GᵀG with G = ∇u, so that a bent
piece grows longer, and a twisted open profile bends, though no stress asks for it. What is added to u is the
displacement w that takes this strain away again, as far as a displacement can: the response of the body to the initial
strain −E. No more is needed of it than how the nodes of the tree are moved. By Betti's theorem that is the work of E on
the stress S of a unit load at the node,

    w_node = −½ qᵀ (∫ S_JK ∂φ_a/∂X_J · ∂φ_b/∂X_K dV) q,                                                          (18)

a geometric stiffness (11) on the response that the factorised stiffness gives anyway. Of bodies that can move freely
only the elastic modes count here: rigid motions are exact as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fe.gradients import geometric_stiffness, own_spin
from ..files.basics import BoolArray, FloatArray, IntArray
from ..mesh.model import Mesh
from ..model.reduced_body import SecondOrder
from ..model.rotations import from_ground, product, skew
from .basis import Matrices
from .bodies import InterfaceFit
from .masses import Centre
from .modes import Modes
from .rigid_fit import Weighted, is_mean, rigid_fit
from .subdomains import Subdomain, Turn, carrying_frame

_RANK = 6
# Rotation of the material, rad, at which the series is looked at; the part that second order has of it where a
# coordinate bends some small section alone, 0.6 to 1.4 at the end of a leaf that is cut, 0.2 at the most elsewhere; and
# how much faster than the slowest it vibrates, some 10000 times there. In cones the slowest have as large a part.
_TURN, _LOCAL, _FAST = 0.5, 1.0 / 3.0, 300.0
# How far sections depart from planes, over how far their frames turn them, above which a body is one of sections that
# warp: solid bars, curved ones too, have 0.07 at most, thin open sections and tubes 0.09 to 2.
_WARPS = 0.08


@dataclass(frozen=True, slots=True)
class NodeReading(Centre):
    """How the motion of a node of the tree is read off displacements: of a point like a centre of mass, and its turn.

    Attributes
    ----------
    turn : Turn
        Without nodes where no rotation is asked for.
    angle : (3, m) float
        Linear rotation of the node of the tree per unit modal coordinate.
    inside : (3, m) float
        Linear rotation of what `turn` reads less that, where the two differ: of a joint's section in its frame.
    """

    turn: Turn
    angle: FloatArray
    inside: FloatArray | None = None

    @property
    def parts(self) -> list[FloatArray | IntArray]:
        """Its arrays, by which it is known."""
        turn, inside = self.turn, [] if self.inside is None else [self.inside]
        return [self.point, self.nodes, self.operator, turn.nodes, turn.operator, self.angle, *inside]

    def loads(self, count: int) -> FloatArray:
        """Nodal forces (3n, 6) whose work is the motion: a unit of each displacement, then of each rotation."""
        result = np.zeros((count, 3, _RANK))
        result[self.nodes, :, :3] = self.operator[:3].T.reshape(-1, 3, 3)
        result[self.turn.nodes, :, 3:] = self.turn.operator.T.reshape(-1, 3, 3)
        return result.reshape(-1, _RANK)

    def turned_back(self, points: FloatArray, shapes: FloatArray, angle: FloatArray) -> FloatArray:
        """Second-order part (3, m, m) of the rotation that is read off the displacements once `angle` is undone."""
        nodes = self.turn.nodes
        arm = points[nodes] - points[nodes].mean(axis=0) if nodes.size else points[nodes]
        return _undone(self.turn.operator, arm, shapes.reshape(len(points), 3, -1)[nodes], angle)

    def carried(self, points: FloatArray, shapes: FloatArray) -> FloatArray:
        """Second-order part (3, m, m) of the displacement of a point that turns about the nodes' centre, on an arc."""
        modes = shapes.shape[1]
        if len(self.operator) == 3 or is_mean(self.operator):
            return np.zeros((3, modes, modes))
        local = shapes.reshape(len(points), 3, -1)[self.nodes]
        angle = self.operator[3:] @ local.reshape(-1, modes)
        return _undone(self.operator[:3], points[self.nodes] - self.point, local - self.moved(shapes), angle)


def _undone(operator: FloatArray, arm: FloatArray, local: FloatArray, angle: FloatArray) -> FloatArray:
    """Second-order part (3, m, m) of what an operator (3, 3k) reads off displacements (k, 3, m) once `angle` is undone.

    Turning the displaced nodes back by `angle` = θ takes θ × u − ½ θ × (θ × r) away from them.
    """
    mixed = np.einsum("inl,nsb->ilsb", operator.reshape(3, -1, 3), -0.5 * skew(arm) @ angle - local, optimize=True)
    half = np.einsum("ilsb,als->iab", mixed, skew(angle.T), optimize=True)
    return half + half.swapaxes(1, 2)


def _still(modes: int) -> tuple[Turn, FloatArray]:
    return Turn(np.zeros(0, dtype=np.int64), np.zeros((3, 0))), np.zeros((3, modes))


def node_readings(
    points: FloatArray,
    shapes: FloatArray,
    subdomains: Sequence[Subdomain],
    frame_rotation: FloatArray,
    interfaces: Sequence[InterfaceFit],
    centres: Sequence[Centre],
    springs: Sequence[Weighted],
    rates: FloatArray,
) -> list[NodeReading]:
    """How the nodes of the tree are read, in its order.

    A frame is read at its joint's section; where sections warp, a plane through one is no measure of how it turns, and
    frames are read by the mean over their material.

    Parameters
    ----------
    points : (n, 3) float
    shapes : (3n, m) float
    subdomains : sequence of Subdomain
    frame_rotation : (S, 3, m) float
        Averaged rotations.
    interfaces : sequence of InterfaceFit
    centres : sequence of Centre
        Of masses that the tree carries.
    springs : sequence of Weighted
        Nodes of springs that frames carry; their other ends are on the ground.
    rates : (m,) float
        Angular frequencies of the modes, rad/s.

    Returns
    -------
    list of NodeReading
    """
    modes = shapes.shape[1]
    readings = []
    elastic = rates > 0.0
    soft, turned = shapes[:, elastic] / rates[elastic], frame_rotation[:, :, elastic] / rates[elastic]
    planes = all(_warping(points, soft, *each) < _WARPS for each in zip(subdomains, turned, strict=True))
    for domain, angle in zip(subdomains, frame_rotation, strict=True):
        operator, rank = rigid_fit(points, domain.joint, domain.joint_point)
        turn, inside = domain.rotation, None
        if rank == _RANK and planes and not domain.floating:
            turn = Turn(domain.joint.nodes, operator[3:])
            inside = turn.of(shapes) - angle
        readings.append(NodeReading(domain.joint_point, domain.joint.nodes, operator, turn, angle, inside))
    for interface in interfaces:
        turn, angle = Turn(interface.nodes, interface.operator[3:]), interface.motion(shapes)[3:]
        readings.append(NodeReading(interface.point, interface.nodes, interface.operator, turn, angle))
    readings += [NodeReading(c.point, c.nodes, c.operator, *_still(modes)) for c in centres]
    for spring in springs:
        operator, rank = rigid_fit(points, spring, centre := spring.centre(points))
        turn, frame = Turn(spring.nodes, operator[3:]), carrying_frame(subdomains, spring.nodes)
        angle = turn.of(shapes)
        if rank < _RANK and frame >= 0:
            # A line or a point turns as the sub-domain that carries it.
            turn, angle = subdomains[frame].rotation, frame_rotation[frame]
        readings.append(NodeReading(centre, spring.nodes, operator, turn, angle))
    none = np.zeros(0, dtype=np.int64)
    return readings + [NodeReading(np.zeros(3), none, np.zeros((3, 0)), *_still(modes)) for _ in springs]


def _warping(points: FloatArray, shapes: FloatArray, domain: Subdomain, angle: FloatArray) -> float:
    """How far the section of a frame's joint departs from a plane (rms) over its radius, over how far the frame turns.

    Of motions (3n, k) of equal energy and their rotations (3, k), all together.
    """
    operator, rank = rigid_fit(points, domain.joint, domain.joint_point)
    if rank < _RANK or domain.floating or not angle.any():
        return 0.0
    arm = points[domain.joint.nodes] - domain.joint_point
    moved = shapes.reshape(len(points), 3, -1)[domain.joint.nodes]
    fitted = operator @ moved.reshape(-1, shapes.shape[1])
    moved = moved - fitted[:3] - np.einsum("nij,jk->nik", skew(arm), -fitted[3:])
    radius = np.sqrt((arm**2).sum(axis=1).mean())
    return float(np.sqrt((moved**2).sum(axis=(1, 2)).mean()) / (radius * np.linalg.norm(angle)))


def _local(mesh: Mesh, shapes: FloatArray, rates: FloatArray, rotation: FloatArray) -> BoolArray:
    """Coordinates (m,) that turn nodes at second order nearly as they do material at first, where soft ones bend far.

    They are stiff, and bend some small section. Forces hardly move them, but joints would close by their squares. Where
    nothing is joined they count: four nodes dent under a force on a long lever.
    """
    scale = np.where(rates > 0.0, rates, np.inf)
    turned = np.sqrt(own_spin(mesh, shapes)) / scale
    bent = 0.5 * np.abs(np.einsum("kiaa->kia", rotation)).max(axis=(0, 1)) / scale**2
    return (bent * _TURN > _LOCAL * turned.max() * turned) & (rates > _FAST * scale.min())


def second_order(
    matrices: Matrices, modes: Modes, floating: bool, joined: bool, readings: Sequence[NodeReading],
    answers: FloatArray | None = None,
) -> SecondOrder:  # fmt: skip
    """Second derivatives (18) of the motions of the tree's nodes.

    Parameters
    ----------
    matrices : Matrices
    modes : Modes
    floating : bool
        Whether motions are to be seen from the floating frame, which makes the rigid motions.
    joined : bool
        Whether joints hold the body, which local coordinates would close by their squares.
    readings : sequence of NodeReading
        One for each node of the tree, in its order; the first of a frame.
    answers : (3n, p) float, optional
        As of `Stretching.answers`: then no more is to be found.

    Returns
    -------
    SecondOrder
    """
    mesh, bushings, model = matrices.model.mesh, matrices.model.bushings, matrices.supported
    bending, count = modes.angular_frequency > 0.0, modes.shapes.shape[1]
    elastic = modes.shapes * bending
    motion = np.zeros((len(readings), 2, 3, count, count))
    if answers is None:
        loads = np.hstack([reading.loads(len(mesh.points)) for reading in readings])
        fields = model.whole(model.static(model.forces(loads)))
        # Work of the initial strains, and of the bushings' own, on the stress of the fields.
        own = np.tensordot((bushings.rows @ fields).T, bushings.curvature(elastic), axes=1)
        motion -= (geometric_stiffness(mesh, fields, elastic) + own).reshape(motion.shape)
    else:
        own = np.flatnonzero(bending)
        first, second = own[np.array(np.triu_indices(own.size))]
        read = -2.0 * np.array([[reading.moved(answers), reading.turn.of(answers)] for reading in readings])
        motion[..., first, second] = motion[..., second, first] = read
    displacement, rotation = motion[:, 0], motion[:, 1]
    angles = np.array([reading.angle for reading in readings])
    bent = angles * bending
    for k, reading in enumerate(readings):
        # What is left of the section's rotation once the frame's own turn in it is undone: exp(θ_s) exp(θ_X − θ_s).
        inside = np.zeros((3, count)) if reading.inside is None else reading.inside
        rotation[k] -= 0.5 * product(bent[k], inside)
        rotation[k] += reading.turned_back(mesh.points, elastic, bent[k] + inside)
        displacement[k] += reading.carried(mesh.points, elastic)
    if joined:
        tame = ~_local(mesh, elastic, modes.angular_frequency, rotation)
        motion *= tame[:, None] | tame
    if not bending.all() and not floating:
        arm = np.array([reading.point - readings[0].point for reading in readings])
        # On rollers elastic modes move the joint as well, along the ground.
        change = np.array([reading.moved(elastic) - readings[0].moved(elastic) for reading in readings])
        # Ends on the ground stay where they are.
        on_body = np.array([reading.nodes.size > 0 for reading in readings])
        seen = from_ground((displacement, rotation), angles[0] * ~bending, arm, change, angles)
        displacement, rotation = (part * on_body[:, None, None, None] for part in seen)
    return SecondOrder(displacement, rotation)
