"""What a formulation misses of the loads' effect on stiffness, judged by the best that is aboard (docs/theory.md, 7).

A formulation knows of buckling what its own tangent stiffness says; one with loads on the undeformed body knows
nothing, and one frame overestimates a cantilever's critical load by 22 %. Beside it stands a second tangent stiffness
of the undeformed body under the same loads: that of the frames to second order, of geometric stiffness by load, of the
frames, or of the moments that forces make about where the interfaces were.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, unit_load_stiffness
from .indicators import elastic_part
from .reduced_body import GROUND, Kinematics, LoadPlacement, ReducedBody
from .tree import build_tree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Times 1/n²: what n frames in a chain overestimate a cantilever's critical load by (section 4b: 0.223, 0.056, 0.016 for
# 1, 2, 4).
_CHAIN = 0.25
# Critical load of the clamped column over what the moment u' × F alone makes of it.
_MOMENT = 8.0 / np.pi**2
# Disturbance that any loads may come with, as a share of their size: nothing is aligned better.
_DISTURBANCE = 0.01

BY_LOAD = "geometric stiffness by load"
BY_SECOND_ORDER = "the frames to second order"
BY_FRAMES = "the frames"
BY_INTERFACES = "the displacement of the loaded interfaces, an estimate"


@dataclass(frozen=True, slots=True)
class Judge:
    """A second opinion on the tangent stiffness of the undeformed body, of its elastic modes, over the unloaded one.

    Attributes
    ----------
    source : str
        What it follows from.
    change : (L, e, e) float
        Of the tangent by each unit load, symmetric.
    missed : (L, e, e) float
        The formulation's own change less that.
    bound : (L,) float
        Spectral norm of `change`.
    missed_bound : (L,) float
    force : (L, e) float
        Modal force of each unit load over ω.
    motion : (I, 6, e) float
        Displacement of each interface, and its rotation times a length of its own, over ω.
    size : (L,) float
        What makes unit loads comparable: one for forces, one over that length for moments, the mass for accelerations.
    """

    source: str
    change: FloatArray
    missed: FloatArray
    bound: FloatArray
    missed_bound: FloatArray
    force: FloatArray
    motion: FloatArray
    size: FloatArray

    def may_exceed(self, inputs: FloatArray, limit: float) -> bool:
        """Whether `error` may be above a limit: a bound that costs next to nothing."""
        size = np.abs(inputs)
        stiffness = 1.0 - float(size @ self.bound)
        missed = float(size @ self.missed_bound)
        return not missed <= limit * (stiffness - missed)

    def within(self, inputs: FloatArray, limit: float) -> bool:
        """Whether the error of every shape of the body is below a limit, and so is `error`; faster than finding it."""
        true = np.eye(self.change.shape[1]) + np.tensordot(inputs, self.change, axes=1)
        missed = np.tensordot(inputs, self.missed, axes=1)
        try:
            np.linalg.cholesky(limit / (1.0 - limit) * true - missed)
            np.linalg.cholesky(limit / (1.0 + limit) * true + missed)
        except np.linalg.LinAlgError:
            return False
        return True

    def error(self, inputs: FloatArray) -> float:
        """Relative error of the interfaces' deflections under loads by what the formulation misses of their effect.

        Of the loads as they are, and of a disturbance of `_DISTURBANCE` of their size that acts on an interface in the
        worst direction; over the larger of the two deflections. Never more than that of any shape of the body.

        Parameters
        ----------
        inputs : (L,) float
            Loads, as of `Loads.packed`.

        Returns
        -------
        float
            1 beyond the critical load of either, and at the most.
        """
        true = np.eye(self.change.shape[1]) + np.tensordot(inputs, self.change, axes=1)
        missed = np.tensordot(inputs, self.missed, axes=1)
        try:
            lower = np.linalg.cholesky(true)
        except np.linalg.LinAlgError:
            return 1.0
        share = np.linalg.eigvalsh(np.linalg.solve(lower, np.linalg.solve(lower, missed).T))
        if share[0] <= -0.5:
            return 1.0
        of_any_shape = float(np.max(np.abs(share / (1.0 + share))))
        interfaces = len(self.motion)
        loads = np.column_stack([inputs @ self.force, self.motion.reshape(6 * interfaces, -1).T])
        right = np.linalg.solve(true, loads)
        # Motions of each interface (I, 6, 1 + 6 I) under the loads, then under unit loads on the interfaces.
        deflection, off = self.motion @ right, self.motion @ (np.linalg.solve(true + missed, loads) - right)
        disturbance = _DISTURBANCE * float(np.linalg.norm(inputs * self.size))
        worst = 0.0
        for k in range(interfaces):
            own = slice(1 + 6 * k, 7 + 6 * k)
            errors, sizes = (
                (float(np.linalg.norm(x[k, :, 0])), disturbance * float(np.linalg.norm(x[k, :, own], 2)))
                for x in (off, deflection)
            )
            if max(sizes) > 0.0:
                worst = max(worst, sum(errors) / max(sizes))
        return min(of_any_shape, worst)

    def margin(self, inputs: FloatArray) -> float:
        """Smallest eigenvalue of its own tangent: 1 without loads, 0 at the critical load."""
        true = np.eye(self.change.shape[1]) + np.tensordot(inputs, self.change, axes=1)
        return float(np.linalg.eigvalsh(true)[0])


def judge(body: ReducedBody, dynamics: Dynamics) -> Judge | None:
    """The second opinion on a formulation; None where there is none to be had, or no need.

    Parameters
    ----------
    body : ReducedBody
    dynamics : Dynamics
        What the formulation makes of it.

    Returns
    -------
    Judge or None
    """
    if dynamics.by_load is not None or dynamics.ties is not None:
        return None
    if dynamics.tree.curvature is not None and dynamics.placement is LoadPlacement.DEFORMED:
        # There is none better.
        return None
    interfaces, loads = body.interface_count, 6 * body.interface_count + (0 if body.masses is None else 3)
    own = -unit_load_stiffness(dynamics, interfaces, loads)
    if dynamics.by_mode is not None:
        own = own + _by_mode(dynamics, dynamics.by_mode, loads)
    depth = _depth(body)
    if body.second is not None:
        tree = build_tree(body, Kinematics.SECOND_ORDER)
        framed = replace(dynamics, tree=tree, placement=LoadPlacement.DEFORMED, by_mode=None, nonlinear=True)
        source, change = BY_SECOND_ORDER, -unit_load_stiffness(framed, interfaces, loads)
    elif body.stiffness_by_load is not None:
        source, change = BY_LOAD, np.asarray(body.stiffness_by_load)
    elif depth:
        tree = build_tree(body, Kinematics.COROTATED)
        framed = replace(dynamics, tree=tree, placement=LoadPlacement.DEFORMED, by_mode=None, nonlinear=True)
        source = BY_FRAMES
        change = -(1.0 + _CHAIN / depth**2) * unit_load_stiffness(framed, interfaces, loads)
    else:
        moved = replace(dynamics, placement=LoadPlacement.CORRECTIVE_MOMENT, by_mode=None, nonlinear=True)
        source, change = BY_INTERFACES, -_MOMENT * unit_load_stiffness(moved, interfaces, loads)
    order = _packed_order(interfaces, loads)
    scaled = np.array([elastic_part(dynamics, matrix) for matrix in change[order]])
    missed = np.array([elastic_part(dynamics, matrix) for matrix in own[order]]) - scaled
    bound, missed_bound = (np.linalg.norm(matrices, 2, (1, 2)) for matrices in (scaled, missed))
    return Judge(source, scaled, missed, bound, missed_bound, *_interface_loads(body, dynamics, order, scaled.shape[1]))


def _packed_order(interfaces: int, loads: int) -> IntArray:
    """Places (L,) of loads in the order of `Loads.packed` among all forces, then all moments, then accelerations."""
    order = np.arange(loads)
    order[: 6 * interfaces] = order[: 6 * interfaces].reshape(2, interfaces, 3).swapaxes(0, 1).ravel()
    return order


def _interface_loads(
    body: ReducedBody, dynamics: Dynamics, order: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`force`, `motion` and `size` of a judge of `count` elastic modes."""
    elastic = slice(body.rigid_count, body.rigid_count + count)
    omega = np.sqrt(dynamics.stiffness[elastic])
    displacement, rotation = (
        operator[..., elastic] / omega for operator in (body.interface_displacement, body.interface_rotation)
    )
    # Displacement over rotation under loads of all directions.
    moved, turned = (np.linalg.norm(operator, axis=(1, 2)) for operator in (displacement, rotation))
    length = np.where((moved > 0.0) & (turned > 0.0), moved / np.where(turned > 0.0, turned, 1.0), 1.0)
    # All forces, then all moments, then accelerations.
    size = np.concatenate([np.ones(3 * length.size), np.repeat(1.0 / length, 3), np.full(3, dynamics.mass.sum())])
    operator = np.concatenate([dynamics.load_operator, dynamics.inertia_operator])
    motion = np.concatenate([displacement, rotation * length[:, None, None]], axis=1)
    return operator[order][:, elastic] / omega, motion, size[order]


def _by_mode(dynamics: Dynamics, by_mode: FloatArray, loads: int) -> FloatArray:
    """Tangent (L, m, m) of stiffness by mode in the linear response to each unit load."""
    forces = np.concatenate([dynamics.load_operator, dynamics.inertia_operator])[:loads]
    response = np.divide(forces, dynamics.stiffness, out=np.zeros_like(forces), where=dynamics.stiffness > 0.0)
    return np.array([np.tensordot(q, by_mode, axes=1) + (by_mode @ q).T for q in response])


def _depth(body: ReducedBody) -> int:
    """Frames in the longest chain of those that carry material, but for the floating one."""
    depth: list[int] = []
    for frame, parent in enumerate(body.frame_parent.tolist()):
        counts = 0 if body.floating and frame == 0 else 1
        depth.append(counts + (0 if parent == GROUND else depth[parent]))
    return max(depth, default=0)
