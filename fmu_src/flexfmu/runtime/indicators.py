"""How far a reduced body is to be trusted: rotation within its frames, stability of its tangent, its compliance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics, NodeLoads, tangent_stiffness
from .propagation import Propagator
from .reduced_body import ReducedBody
from .ties import gap_derivative
from .tree import Configuration, jacobians

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


# Stiffness over that of the softest mode beyond which no load that the body bears makes a mode give way.
_UNBENDING = 1e8


@dataclass(frozen=True, slots=True)
class Turning:
    """Rotations of material against the frames that carry it, linear in q.

    Attributes
    ----------
    operator : (3n, m) float
        Rotation vectors per unit modal coordinate.
    frame : (n,) int
        The frame of each; 0 for a body without frames.
    frame_count : int
        At least one.
    """

    operator: FloatArray
    frame: IntArray
    frame_count: int

    def angles(self, q: FloatArray) -> FloatArray:
        """Angle (n,) of each rotation, rad, for small angles the norm of its vector."""
        vectors = (self.operator @ q).reshape(-1, 3)
        result: FloatArray = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
        return result


def turning(body: ReducedBody, frame_count: int) -> Turning:
    """For each frame: its own joint, the joints and the interfaces that it carries, against its averaged rotation.

    Parameters
    ----------
    body : ReducedBody
    frame_count : int
        Of the kinematics: without frames, interfaces against the ground.

    Returns
    -------
    Turning
    """
    m = body.mode_count
    if frame_count == 0:
        none = np.zeros(body.interface_count, dtype=np.int64)
        return Turning(body.interface_rotation.reshape(-1, m), none, 1)
    carried = np.flatnonzero(body.frame_parent >= 0)
    parent = body.frame_parent[carried]
    held = np.flatnonzero(body.interface_frame >= 0)
    on = body.interface_frame[held]
    rotations = [
        body.joint_rotation - body.frame_rotation,
        body.joint_rotation[carried] - body.frame_rotation[parent],
        body.interface_rotation[held] - body.frame_rotation[on],
    ]
    frame = np.concatenate([np.arange(frame_count), parent, on])
    return Turning(np.concatenate(rotations).reshape(-1, m), frame, frame_count)


def scaled_tangent(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> FloatArray:
    """Tangent stiffness of the elastic coordinates over the unloaded one: the identity without loads.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration

    Returns
    -------
    (e, e) float
        Its symmetric part: all of it, but under moments and corrective moments.
    """
    tangent = tangent_stiffness(dynamics, loads, state)
    if dynamics.ties is None:
        return elastic_part(dynamics, tangent)
    # Turned frames stretch the modes' linear springs without any cause: the material's own stiffness and that of the
    # ties where they are now is what the tangent has to be compared with.
    ties = dynamics.ties
    change = gap_derivative(ties, state, *jacobians(dynamics.tree, state)).reshape(-1, len(tangent))
    pull = np.repeat(ties.stiffness, 4, axis=1).reshape(-1, 1)
    unloaded = np.diag(dynamics.stiffness) - ties.initial + change.T @ (pull * change)
    lower = np.linalg.cholesky(0.5 * (unloaded + unloaded.T))
    scaled = np.linalg.solve(lower, np.linalg.solve(lower, 0.5 * (tangent + tangent.T)).T)
    return 0.5 * (scaled + scaled.T)


def elastic_part(dynamics: Dynamics, tangent: FloatArray) -> FloatArray:
    """Symmetric part (e, e) of a tangent stiffness (m, m) over the unloaded one, of the modes that loads may buckle.

    Rigid motions are left out, and what is stiffer than the softest mode by eight powers of ten: joints of a cut body
    above all, whose tension rings far faster than steps resolve.
    """
    rigid = int(np.sum(dynamics.stiffness == 0.0))
    last = int(np.searchsorted(dynamics.stiffness, _UNBENDING * dynamics.stiffness[rigid], side="right"))
    elastic = tangent[rigid:last, rigid:last]
    omega = np.sqrt(dynamics.stiffness[rigid:last])
    result: FloatArray = 0.5 * (elastic + elastic.T) / (omega[:, None] * omega)
    return result


def interface_jacobian(dynamics: Dynamics, state: Configuration, interfaces: Sequence[int]) -> FloatArray:
    """Displacement and spin of each of some interfaces in turn per rate of the modal coordinates, (6n, m)."""
    translation, spin = jacobians(dynamics.tree, state)
    nodes = dynamics.tree.frame_count + np.asarray(interfaces, dtype=np.int64)
    result: FloatArray = np.concatenate([translation[nodes], spin[nodes]], axis=1).reshape(6 * nodes.size, -1)
    return result


def compliance(
    dynamics: Dynamics, p: Propagator, loads: NodeLoads, state: Configuration, interfaces: Sequence[int]
) -> FloatArray:
    """Derivative of interfaces' motion at a step's end with respect to loads on them that are held over the step.

    Of the step's own linear equation q₁ = P q₀ + g_q Q̄, with Q̄ linearised about its end.

    Parameters
    ----------
    dynamics : Dynamics
    p : Propagator
        Of the step.
    loads : NodeLoads
    state : Configuration
        At the step's end.
    interfaces : sequence of int

    Returns
    -------
    (6n, 6n) float
        Displacement and rotation of each interface in turn (rows) per force and moment on each (columns); m/N,
        m/(N m), rad/N, rad/(N m).
    """
    motion = interface_jacobian(dynamics, state, interfaces)
    # Half the load's stiffness acts at the step's end, half at its start.
    half = 0.5 * (np.diag(dynamics.stiffness) - tangent_stiffness(dynamics, loads, state))
    change = np.linalg.solve(np.eye(p.gq.size) - p.gq[:, None] * half, p.gq[:, None] * motion.T)
    result: FloatArray = motion @ change
    return result
