"""Kinematics and loads of the tree of corotated frames (docs/theory.md, section 4).

Frames and interfaces are nodes of one tree; node k hangs on frame p(k), or on the ground. Linear in q are its offset
from the parent's joint and its rotation relative to the parent,

    b_k = X_k − X_p + D_k q,     φ_k = C_k q,
    D_k q = u(X_k) − u(X_p) − θ_p × (X_k − X_p),     C_k q = θ_k − θ_p,

so that one pass outwards gives

    R_k = R_p exp(φ_k),     x_k = x_p + R_p b_k.

A node on the ground has R_p = I, x_p = 0: without frames this is modal superposition, equation (1) of the paper.

The paper's own readings, where displacements turn but positions do not (`LITERAL`, `SECANT`), are the same tree with
x_k = X_k + y_k, y_k = y_p + R_p (u(X_k) − u(X_p)), and R_p made of the whole or half the averaged rotation.

With `SECOND_ORDER` b_k and φ_k are quadratic in q: their second derivatives are the tree's curvature.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .curvature import relative_curvature
from .errors import OptionError
from .reduced_body import GROUND, Kinematics, ReducedBody
from .rotations import cross, exponential_and_jacobian, skew, transposed_jacobian_derivative

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Share of the averaged rotation by which displacements turn where positions do not.
_TURN = {Kinematics.LITERAL: 1.0, Kinematics.SECANT: 0.5}


@dataclass(frozen=True, slots=True)
class Tree:
    """Constant data of the tree: S frames, I interfaces, P centres of mass, 2 T ends of ties; K nodes in all.

    Attributes
    ----------
    parent : (K,) int
        Frame on which a node hangs, or `GROUND`.
    frame_count, interface_count : int
        S and I.
    point : (K, 3) float
        Undeformed joints and interface points, m.
    offset : (K, 3) float
        X_k − X_p, m.
    operator : (6K, m) float
        D_k of all nodes, then C_k of all nodes.
    base : (K, 3) float
        Part of the positions that no frame turns, m: zero for corotated frames.
    path : (K, K) float
        path[k, a] = 1 where a is k or one of its ancestors.
    parent_path : (K, K) float
        The same for the parent of k: zero where a is k itself.
    tie_count : int
        T; the ends a of all ties, then the ends b.
    curvature : (6K, m, m) float or None
        Second derivatives of b_k and φ_k with respect to q, in the order of `operator`; None where they are linear.
    """

    parent: IntArray
    frame_count: int
    interface_count: int
    point: FloatArray
    offset: FloatArray
    operator: FloatArray
    base: FloatArray
    path: FloatArray
    parent_path: FloatArray
    tie_count: int = 0
    curvature: FloatArray | None = None

    @property
    def interfaces(self) -> slice:
        """Where the interfaces stand among the nodes."""
        return slice(self.frame_count, self.frame_count + self.interface_count)


@dataclass(frozen=True, slots=True)
class Configuration:
    """Where all nodes are for one q.

    Attributes
    ----------
    q : (m,) float
        kg^1/2 m.
    position : (K, 3) float
        x_k, m, global frame.
    rotation : (K, 3, 3) float
        R_k.
    parent_rotation : (K, 3, 3) float
        R_p of each node.
    offset : (K, 3) float
        b_k, m, frame of the parent.
    relative : (K, 3) float
        φ_k, rad, frame of the parent.
    jacobian : (K, 3, 3) float
        T(φ_k): the relative angular velocity is R_p T φ̇.
    operator : (6K, m) float
        Derivatives of b_k and φ_k with respect to q: those of the tree, and what its curvature adds.
    """

    q: FloatArray
    position: FloatArray
    rotation: FloatArray
    parent_rotation: FloatArray
    offset: FloatArray
    relative: FloatArray
    jacobian: FloatArray
    operator: FloatArray


def build_tree(body: ReducedBody, kinematics: Kinematics) -> Tree:
    """Tree of a body under the given kinematics; `LINEAR` hangs every interface on the ground.

    Parameters
    ----------
    body : ReducedBody
    kinematics : Kinematics

    Returns
    -------
    Tree
    """
    if kinematics is Kinematics.LINEAR:
        frames = 0
        parent = np.full(body.interface_count, GROUND, dtype=np.int64)
    else:
        frames = body.frame_count
        parent = np.concatenate([body.frame_parent, body.interface_frame])
    point = np.concatenate([body.joint_point[:frames], body.interface_point])
    displacement = np.concatenate([body.joint_displacement[:frames], body.interface_displacement])
    rotation = np.concatenate([body.frame_rotation[:frames], body.interface_rotation])
    if body.masses is not None:
        carrier = np.where(kinematics is Kinematics.LINEAR, GROUND, body.masses.frame)
        parent = np.concatenate([parent, carrier])
        point = np.concatenate([point, body.masses.point])
        displacement = np.concatenate([displacement, body.masses.displacement])
        # A centre of mass has no rotation of its own: nothing reads it, and no moment acts on it.
        rotation = np.concatenate([rotation, np.zeros_like(body.masses.displacement)])
    ties = 0
    if body.ties is not None and kinematics is not Kinematics.LINEAR:
        # Linear kinematics stretch the springs linearly, which the modes hold already.
        ties = len(body.ties.stiffness)
        parent = np.concatenate([parent, body.ties.frame.T.ravel()])
        point = np.concatenate([point, np.swapaxes(body.ties.point, 0, 1).reshape(-1, 3)])
        both = [np.swapaxes(x, 0, 1).reshape(2 * ties, 3, -1) for x in (body.ties.displacement, body.ties.rotation)]
        displacement = np.concatenate([displacement, both[0]])
        rotation = np.concatenate([rotation, both[1]])

    offset, d, c = point.copy(), displacement.copy(), rotation.copy()
    hung = np.flatnonzero(parent >= 0)
    p = parent[hung]
    offset[hung] -= point[p]
    d[hung] -= displacement[p] - skew(offset[hung]) @ rotation[p]
    c[hung] -= rotation[p]

    base = np.zeros_like(point)
    if kinematics in _TURN:
        # Only displacements turn: u_p + exp(α θ_p) (u − u_p), with what is left of the rotation on top.
        share = _TURN[kinematics]
        base, offset, d = point, np.zeros_like(point), displacement.copy()
        d[hung] -= displacement[p]
        c = rotation.copy()
        c[:frames] *= share
        c[hung] -= share * rotation[p]

    path = np.eye(len(parent))
    for k, frame in enumerate(parent):
        if frame >= 0:
            path[k] += path[frame]
    operator = np.concatenate([d.reshape(-1, body.mode_count), c.reshape(-1, body.mode_count)])
    parent_path = path - np.eye(len(parent))
    curvature = _curvature(body, parent, offset, d, rotation) if kinematics is Kinematics.SECOND_ORDER else None
    return Tree(parent, frames, body.interface_count, point, offset, operator, base, path, parent_path, ties, curvature)


def _curvature(
    body: ReducedBody, parent: IntArray, offset: FloatArray, change: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Second derivatives (6K, m, m) of offsets and relative rotations, docs/theory.md equations (19) and (20).

    Parameters
    ----------
    body : ReducedBody
    parent : (K,) int
    offset : (K, 3) float
    change : (K, 3, m) float
        D_k.
    rotation : (K, 3, m) float
        Linear rotations of the nodes.
    """
    data = body.second
    if data is None:
        raise OptionError(
            'kinematics "second_order" needs data that this body was built without: build it with second_order = true '
            "in [reduction]"
        )
    # Seen from the floating frame, if there is one.
    turn = rotation - body.frame_rotation[0] if body.floating else rotation
    d, c = data.displacement.copy(), data.rotation.copy()
    hung = np.flatnonzero(parent >= 0)
    p = parent[hung]
    d[hung], c[hung] = relative_curvature(
        data.displacement[hung] - data.displacement[p],
        np.stack([data.rotation[hung], data.rotation[p]]),
        turn[p],
        turn[hung],
        offset[hung],
        change[hung],
    )
    return np.concatenate([d.reshape(-1, *d.shape[2:]), c.reshape(-1, *c.shape[2:])])


def configuration(tree: Tree, q: FloatArray) -> Configuration:
    """Positions and rotations of all nodes: the pass outwards.

    Parameters
    ----------
    tree : Tree
    q : (m,) float
        Modal coordinates, kg^1/2 m.

    Returns
    -------
    Configuration
    """
    count = len(tree.parent)
    operator = tree.operator
    linear = operator @ q
    if tree.curvature is not None:
        change = tree.curvature @ q
        operator = operator + change
        linear = linear + 0.5 * (change @ q)
    linear = linear.reshape(2, count, 3)
    offset = tree.offset + linear[0]
    relative = linear[1]
    exponential, jacobian = exponential_and_jacobian(relative)
    # Row GROUND (the last) stays the identity, so that a parent's index is all that is needed.
    rotation = np.empty((count + 1, 3, 3))
    rotation[GROUND] = np.eye(3)
    for k in range(tree.frame_count):
        np.matmul(rotation[tree.parent[k]], exponential[k], out=rotation[k])
    parent_rotation = rotation[tree.parent]
    first = tree.frame_count
    np.matmul(parent_rotation[first:], exponential[first:], out=rotation[first:-1])
    position = tree.base + tree.path @ (parent_rotation @ offset[:, :, None])[:, :, 0]
    return Configuration(q, position, rotation[:-1], parent_rotation, offset, relative, jacobian, operator)


def outboard_loads(
    tree: Tree, state: Configuration, force: FloatArray, moment: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Force and moment about each node of all loads on it and beyond it: the pass back.

    Parameters
    ----------
    tree : Tree
    state : Configuration
    force, moment : (K, 3) float
        Loads at the nodes, N and N m, global frame.

    Returns
    -------
    force, moment : (K, 3) float
        F_k = Σ f_d and M_k = Σ (m_d + (x_d − x_k) × f_d) over k and its descendants d.
    """
    turning = state.position - tree.base
    total = tree.path.T @ force
    about_origin = tree.path.T @ (moment + cross(turning, force))
    return total, about_origin - cross(turning, total)


def generalised_force(tree: Tree, state: Configuration, force: FloatArray, moment: FloatArray) -> FloatArray:
    """Modal force Q = Jᵀ(f, m): virtual work of the loads on the deformed body.

    Parameters
    ----------
    tree : Tree
    state : Configuration
    force, moment : (K, 3) float
        Loads at the nodes, N and N m, global frame.

    Returns
    -------
    (m,) float
        Q, kg^1/2 m/s².
    """
    total, about = outboard_loads(tree, state, force, moment)
    # Row vectors times R_p are the components in the parent's frame.
    local_force = total[:, None, :] @ state.parent_rotation
    local_moment = about[:, None, :] @ state.parent_rotation @ state.jacobian
    result: FloatArray = np.concatenate([local_force.ravel(), local_moment.ravel()]) @ state.operator
    return result


def jacobians(tree: Tree, state: Configuration) -> tuple[FloatArray, FloatArray]:
    """Derivatives of positions and rotations with respect to q.

    Parameters
    ----------
    tree : Tree
    state : Configuration

    Returns
    -------
    translation : (K, 3, m) float
        ∂x_k/∂q.
    spin : (K, 3, m) float
        W_k with angular velocity ω_k = W_k q̇, global frame.
    """
    count = len(tree.parent)
    d, c = state.operator.reshape(2, count, 3, -1)
    turn = state.parent_rotation @ (state.jacobian @ c)
    spin = np.tensordot(tree.path, turn, axes=1)
    parent_spin = np.tensordot(tree.parent_path, turn, axes=1)
    arm = (state.parent_rotation @ state.offset[:, :, None])[:, :, 0]
    step = state.parent_rotation @ d - skew(arm) @ parent_spin
    return np.tensordot(tree.path, step, axes=1), spin


def load_stiffness(tree: Tree, state: Configuration, force: FloatArray, moment: FloatArray) -> FloatArray:
    """Derivative ∂Q/∂q of the generalised force at fixed loads.

    Parameters
    ----------
    tree : Tree
    state : Configuration
    force, moment : (K, 3) float
        Loads at the nodes, N and N m, global frame.

    Returns
    -------
    (m, m) float
        Symmetric under forces; moments about fixed axes have no potential and make it unsymmetric.
    """
    count = len(tree.parent)
    d, c = state.operator.reshape(2, count, 3, -1)
    translation, spin = jacobians(tree, state)
    parent_spin = np.zeros_like(spin)
    hung = tree.parent >= 0
    parent_spin[hung] = spin[tree.parent[hung]]
    total, about = outboard_loads(tree, state, force, moment)
    back = np.swapaxes(state.parent_rotation, 1, 2)

    # δ(Rᵀ F) = Rᵀ (F × δω),  δM_k = Σ δx_d × f_d − δx_k × F_k.
    force_change = back @ (skew(total) @ parent_spin)
    about_change = np.tensordot(tree.path.T, -skew(force) @ translation, axes=1) + skew(total) @ translation
    moment_change = back @ (about_change + skew(about) @ parent_spin)
    local_moment = (about[:, None, :] @ state.parent_rotation)[:, 0]
    moment_change = (
        np.swapaxes(state.jacobian, 1, 2) @ moment_change
        + transposed_jacobian_derivative(state.relative, local_moment) @ c
    )
    result: FloatArray = np.tensordot(d, force_change, axes=([0, 1], [0, 1])) + np.tensordot(
        c, moment_change, axes=([0, 1], [0, 1])
    )
    if tree.curvature is not None:
        local_force = (total[:, None, :] @ state.parent_rotation)[:, 0]
        turned = (local_moment[:, None, :] @ state.jacobian)[:, 0]
        result = result + np.tensordot(np.concatenate([local_force.ravel(), turned.ravel()]), tree.curvature, axes=1)
    return result
