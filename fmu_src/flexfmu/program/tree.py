"""Constant data of the tree of frames, and how far it is quadratic in q (docs/theory.md, sections 4, 4a and 4b).

Frames and interfaces are nodes of one tree; node k hangs on frame p(k), or on the ground. Its offset from the parent's
joint and its rotation relative to the parent are

    b_k = X_k − X_p + D_k q,     φ_k = C_k q,
    D_k q = u(X_k) − u(X_p) − θ_p × (X_k − X_p),     C_k q = θ_k − θ_p,

linear in q but for the curvature, (19) and (20). The core (core/tree.c) makes places of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.interface import packed
from ..files.basics import FloatArray, IntArray, OptionError
from ..model.arrays import SECOND_BITS, is_single, short
from ..model.inertia import LumpedMass, Membrane
from ..model.methods import Kinematics
from ..model.reduced_body import GROUND, ReducedBody
from ..model.rotations import product, skew

# Share of the averaged rotation by which displacements turn where positions do not.
_TURN = {Kinematics.LITERAL: 1.0, Kinematics.SECANT: 0.5}
# Share of the largest, below which a direction bends nothing but by round-off of double or of single precision.
_NO_BEND = 1e-13, 1e-5
# Share of all coordinates up to which those of a part, or of a group of stretches, are worth turning to.
_WORTH = 0.75


@dataclass(frozen=True, slots=True)
class Tree:
    """S frames, I interfaces, P centres of mass, lumps, 2 T ends of ties: K nodes.

    Attributes
    ----------
    parent : (K,) int
        Frame on which a node hangs, or `GROUND`.
    frames : int
        S.
    point, offset, base : (K, 3) float
        X_k; X_k − X_p; the part of the places that no frame turns; m.
    operator : (2, K, 3, m) float
        D_k of all nodes, then C_k.
    curvature : (6K, m, m) float or None
        Second derivatives of b_k and φ_k, in the order of `operator`.
    lumps : (P,) int
        Nodes that are lumps.
    no_bend : float
        Share of the largest curvature below which it is round-off.
    """

    parent: IntArray
    frames: int
    point: FloatArray
    offset: FloatArray
    base: FloatArray
    operator: FloatArray
    curvature: FloatArray | None
    lumps: IntArray
    no_bend: float


def build_tree(body: ReducedBody, kinematics: Kinematics, inertia: LumpedMass | None = None) -> Tree:
    """Tree of a body under the given kinematics; `LINEAR` hangs every node on the ground.

    Parameters
    ----------
    body : ReducedBody
    kinematics : Kinematics
    inertia : LumpedMass, optional
        Lumps to go along.

    Returns
    -------
    Tree

    Raises
    ------
    OptionError
        The body was built without what second order needs.
    """
    linear = kinematics is Kinematics.LINEAR
    frames = 0 if linear else body.frame_count
    on, x, u, theta, lumps = _nodes(body, frames, linear, inertia)
    offset, d, c = x.copy(), u.copy(), theta.copy()
    hung = np.flatnonzero(on >= 0)
    p = on[hung]
    offset[hung] -= x[p]
    base = np.zeros_like(x)
    if kinematics in _TURN:
        # Only displacements turn: u_p + exp(α θ_p) (u − u_p), with what is left of the rotation on top.
        share = _TURN[kinematics]
        base, offset = x, np.zeros_like(x)
        d[hung] -= u[p]
        c[:frames] *= share
        c[hung] -= share * theta[p]
    else:
        d[hung] -= u[p] - skew(offset[hung]) @ theta[p]
        c[hung] -= theta[p]
    curvature, no_bend = None, _NO_BEND[0]
    if kinematics is Kinematics.SECOND_ORDER and frames:
        curvature = _curvature(body, inertia, on, offset, d, u, theta)
        curvature.reshape(2, len(on), 3, *curvature.shape[1:])[1, lumps] = 0.0
        kept = body.second.displacement if body.second else np.zeros(0)
        omega = body.angular_frequency
        no_bend, bits = _NO_BEND[is_single(kept)], SECOND_BITS[is_single(kept)]
        if np.array_equal(kept, short(kept, omega, bits)):
            curvature = short(curvature, omega, bits)
    return Tree(on, frames, x, offset, base, np.stack([d, c]), curvature, lumps, no_bend)


def _nodes(
    body: ReducedBody, frames: int, linear: bool, inertia: LumpedMass | None
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """Parents, places, displacements and rotations of all nodes, and which of them are lumps."""
    parent = [body.frame_parent[:frames], np.full(body.interface_count, GROUND) if linear else body.interface_frame]
    point = [body.joint_point[:frames], body.interface_point]
    displacement = [body.joint_displacement[:frames], body.interface_displacement]
    rotation = [body.frame_rotation[:frames], body.interface_rotation]
    if body.masses is not None:
        parent.append(np.full(body.masses.mass.size, GROUND) if linear else body.masses.frame)
        point.append(body.masses.point)
        displacement.append(body.masses.displacement)
        # A centre of mass has no rotation of its own: nothing reads it, and no moment acts on it.
        rotation.append(np.zeros_like(body.masses.displacement))
    lumps = np.zeros(0, dtype=np.int64)
    if inertia is not None:
        lumps = sum(map(len, parent)) + np.arange(inertia.mass.size)
        parent.append(inertia.frame)
        point.append(inertia.point)
        displacement.append(inertia.displacement)
        # Seen from its frame a lump does not turn.
        rotation.append(body.frame_rotation[inertia.frame])
    if body.ties is not None and not linear:
        # Linear kinematics stretch the springs linearly, which the modes hold already.
        parent.append(body.ties.frame.T.ravel())
        point.append(np.swapaxes(body.ties.point, 0, 1).reshape(-1, 3))
        for target, ends in ((displacement, body.ties.displacement), (rotation, body.ties.rotation)):
            target.append(np.swapaxes(ends, 0, 1).reshape(-1, 3, body.mode_count))
    on = np.concatenate(parent).astype(np.int64)
    return on, np.concatenate(point), np.concatenate(displacement), np.concatenate(rotation), lumps


def _curvature(
    body: ReducedBody,
    inertia: LumpedMass | None,
    parent: IntArray,
    offset: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    rotation: FloatArray,
) -> FloatArray:
    """Second derivatives (6K, m, m) of offsets and relative rotations, (19) and (20); `change` is D_k."""
    data = body.second
    if data is None:
        found = 'method "second_order" needs data that this body was built without'
        raise OptionError(f"{found}: build it with second_order = true in [reduction]")
    # Seen from the floating frame, if there is one.
    turn = rotation - body.frame_rotation[0] if body.floating else rotation
    displacement, turned = data.displacement, data.rotation
    if inertia is not None:
        if inertia.curvature is None:
            found = 'mass "configuration" with method "second_order" needs data that this body was built without'
            raise OptionError(f"{found}: build it with inertia = true and second_order = true in [reduction]")
        # Lumps stand before the ties.
        before = len(displacement) - (0 if body.ties is None else 2 * len(body.ties.stiffness))
        displacement = np.insert(displacement, [before], inertia.curvature, axis=0)
        turned = np.insert(turned, [before], np.zeros_like(inertia.curvature), axis=0)
    if body.membrane is not None and np.any(body.membrane.linear):
        # Of w only what is no coordinate is left (section 4c).
        shift = body.membrane.shift(body.angular_frequency**2)
        displacement = displacement + np.tensordot(moved, shift, axes=1)
        turned = turned + np.tensordot(rotation, shift, axes=1)
    d, c = displacement.copy(), turned.copy()
    if body.floating:
        # Elastic modes do not move it.
        d[0], c[0] = 0.0, 0.0
    hung = np.flatnonzero(parent >= 0)
    p = parent[hung]
    # In the parent's frame: from its joint, and less what its own turn does.
    down, arm = turn[p], skew(offset[hung])
    d[hung] = displacement[hung] - displacement[p] + np.einsum("kij,kjab->kiab", arm, turned[p])
    d[hung] -= product(down, change[hung]) + 0.5 * product(down, -arm @ down)
    c[hung] = turned[hung] - turned[p] - 0.5 * product(down, turn[hung])
    return np.concatenate([d.reshape(-1, *d.shape[2:]), c.reshape(-1, *c.shape[2:])])


def bends(tree: Tree, inertial: int) -> dict[str, FloatArray | IntArray]:
    """What bends the nodes of a tree with curvature, its lumps by the first `inertial` coordinates only.

    Coordinates bend parts: nodes of one root, of a cut body one of its pieces. There are far fewer of them than q has,
    and a step's cost goes by their square. In one piece q itself stays.

    Returns
    -------
    dict
        Fields of a program: curvature, basis, part, extent; no membrane energy.
    """
    assert tree.curvature is not None
    curvature, modes, root = tree.curvature, tree.operator.shape[-1], tree.parent.copy()
    for node, parent in enumerate(tree.parent):
        root[node] = node if parent < 0 else root[parent]
    # Lumps are a part of their own, which comes last.
    root[tree.lumps] = len(root)
    size = np.abs(curvature).max(axis=(1, 2))
    owner = np.where(size > 0.0, np.tile(np.repeat(root, 3), 2), -1)
    part = np.full(len(owner), -1)
    bases = []
    for number, name in enumerate(np.unique(owner[owner >= 0])):
        rows = np.flatnonzero(owner == name)
        part[rows] = number
        if name == len(root):
            bases.append(np.eye(inertial, modes))
            continue
        scaled = curvature[rows] / size[rows, None, None]
        _, strength, directions = np.linalg.svd(scaled.reshape(-1, modes), full_matrices=False)
        basis = directions[strength > tree.no_bend * strength[0]]
        bases.append(basis if len(basis) <= _WORTH * modes else np.eye(modes))
    if all(len(basis) == modes for basis in bases):
        part, bases = np.where(size > 0.0, 0, -1), []
    own = [curvature[part == number] for number in range(len(bases) or 1)]
    cores = [packed(a @ k @ a.T) for a, k in zip(bases, own, strict=True)] if bases else [packed(own[0])]
    return {
        "curvature": np.concatenate(cores),
        "basis": np.concatenate([np.zeros(0), *(basis.ravel() for basis in bases if len(basis) < modes)]),
        "part": part,
        "extent": np.array([len(basis) for basis in bases] or [modes]),
        "stretch_rows": np.zeros(len(bases) or 1, dtype=np.int64),
    }


def stretches(membrane: Membrane, bent: Mapping[str, Any]) -> dict[str, FloatArray | IntArray]:
    """Membrane energy, each group in its own coordinates where these are fewer than q has.

    Parameters
    ----------
    membrane : Membrane
    bent : mapping
        From `bends`.

    Returns
    -------
    dict
        Fields of a program: basis, extent, stretch, stretch_rows, stretch_linear, stretch_sign, stretch_stiff.
    """
    linear, rest = membrane.linear, np.ones(len(membrane.linear), dtype=bool)
    bases, forms, order = [bent["basis"]], list[FloatArray](), list[IntArray]()
    for basis, found, rows in membrane.groups():
        plain = np.flatnonzero(~linear[rows].any(axis=1))
        directions, parts = np.linalg.qr(basis.T)
        if 0 < len(parts) <= _WORTH * linear.shape[1] and plain.size:
            bases.append(directions.T)
            forms.append(packed(parts @ found[plain] @ parts.T))
            order.append(rows.start + plain)
            rest[order[-1]] = False
    every = np.concatenate([*order, np.flatnonzero(rest)])
    return {
        "basis": np.concatenate([one.ravel() for one in bases]),
        "extent": np.array([*bent["extent"], *map(len, bases[1:])]),
        "stretch": np.concatenate([*forms, packed(membrane.quadratic[rest])]),
        "stretch_rows": np.array([*0 * bent["extent"], *map(len, order)]),
        **{f"stretch_{name}": getattr(membrane, name)[every] for name in ("linear", "sign", "stiff")},
    }
