"""Equations of motion of a reduced body under one formulation: modal forces, their potential and derivative."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .loads import Loads
from .reduced_body import Formulation, Kinematics, LoadPlacement, ReducedBody
from .tree import Configuration, Tree, build_tree, configuration, generalised_force, load_stiffness

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Dynamics:
    """What a formulation makes of a body; constant.

    Attributes
    ----------
    stiffness : (m,) float
        ω², 1/s².
    tree : Tree
        Kinematics of outputs, and of loads on the deformed body.
    load_operator : (6I, m) float
        Linear displacements of all interfaces, then rotations: the transpose maps loads on the reference body.
    nonlinear : bool
        Whether modal forces depend on q.
    """

    stiffness: FloatArray
    tree: Tree
    load_operator: FloatArray
    nonlinear: bool


def build_dynamics(body: ReducedBody, formulation: Formulation) -> Dynamics:
    """Set up a body under a formulation.

    Parameters
    ----------
    body : ReducedBody
    formulation : Formulation

    Returns
    -------
    Dynamics
    """
    m = body.mode_count
    # Linear kinematics have a constant derivative: loads on the deformed body are then those on the reference one.
    nonlinear = (
        formulation.loads is LoadPlacement.DEFORMED
        and formulation.kinematics is not Kinematics.LINEAR
        and bool(np.any(body.interface_frame >= 0))
    )
    operator = np.concatenate([body.interface_displacement.reshape(-1, m), body.interface_rotation.reshape(-1, m)])
    return Dynamics(body.angular_frequency**2, build_tree(body, formulation.kinematics), operator, nonlinear)


@dataclass(frozen=True, slots=True)
class NodeLoads:
    """Loads spread to the tree's nodes, frames included.

    Attributes
    ----------
    force, moment : (K, 3) float
        N and N m, global frame.
    constant : (m,) float
        Modal force of the loads on the reference body.
    active : bool
        Whether the modal force varies with q under these loads.
    """

    force: FloatArray
    moment: FloatArray
    constant: FloatArray
    active: bool


def spread(dynamics: Dynamics, loads: Loads) -> NodeLoads:
    """Put the interfaces' loads on the tree.

    Parameters
    ----------
    dynamics : Dynamics
    loads : Loads

    Returns
    -------
    NodeLoads
    """
    frames = dynamics.tree.frame_count
    force = np.zeros((frames + len(loads.force), 3))
    moment = np.zeros_like(force)
    force[frames:], moment[frames:] = loads.force, loads.moment
    constant = np.concatenate([loads.force.ravel(), loads.moment.ravel()]) @ dynamics.load_operator
    active = dynamics.nonlinear and bool(np.any(loads.force) or np.any(loads.moment))
    return NodeLoads(force, moment, constant, active)


def modal_force(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> FloatArray:
    """Modal force Q(q) of loads on the deformed body.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration
        The configuration at q.

    Returns
    -------
    (m,) float
    """
    return generalised_force(dynamics.tree, state, loads.force, loads.moment)


def force_work(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> float:
    """Work Σ f·(x − X) of the forces from the undeformed body on, J; moments have no potential and do not count.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration

    Returns
    -------
    float
    """
    return float(np.vdot(loads.force, state.position - dynamics.tree.point))


def tangent_stiffness(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> FloatArray:
    """Λ − ∂Q/∂q, (m, m): positive definite where the equilibrium is stable.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration

    Returns
    -------
    (m, m) float
        1/s².
    """
    result: FloatArray = np.diag(dynamics.stiffness)
    if loads.active:
        result = result - load_stiffness(dynamics.tree, state, loads.force, loads.moment)
    return result


def configuration_at(dynamics: Dynamics, q: FloatArray) -> Configuration:
    """Positions and rotations of the body's nodes at q (m,)."""
    return configuration(dynamics.tree, q)
