"""Equations of motion of a reduced body under one formulation: modal forces, their potential and derivative."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import OptionError
from .inertia import InertiaIntegrals
from .loads import Loads
from .reduced_body import Formulation, Kinematics, LoadPlacement, Mass, ReducedBody, Stiffness
from .rotations import cross, skew
from .ties import TieForces, energy, gap_derivative, moment_stiffness, nodal_loads, tension, tie_forces
from .tree import Configuration, Tree, build_tree, configuration, generalised_force, jacobians, load_stiffness

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Dynamics:
    """What a formulation makes of a body; constant.

    Attributes
    ----------
    stiffness : (m,) float
        ω², 1/s².
    weight : (m,) float
        What weighs errors of q, rad/s: ω, and the lowest elastic ω for rigid motions.
    tree : Tree
        Kinematics of outputs, and of loads on the deformed body.
    placement : LoadPlacement
    load_operator : (6I, m) float
        Linear displacements of all interfaces, then rotations: the transpose maps loads on the reference body.
    mass : (P,) float
        Of the tree's centres of mass, kg.
    inertia_operator : (3, m) float
        Modal force per unit acceleration of the supports, on the reference body.
    by_load : (6I or 6I + 3, m, m) float or None
        Geometric stiffness of each unit load (forces, moments, accelerations), less what their own motion makes of it.
    by_mode : (m, m, m) float or None
        Geometric stiffness of each unit modal coordinate.
    nonlinear : bool
        Whether modal forces depend on q.
    inertia : InertiaIntegrals or None
        What the mass of the deformed body is made of; None where it is that of the undeformed one.
    ties : TieForces or None
        What joins the parts of a body that was cut.
    """

    stiffness: FloatArray
    weight: FloatArray
    tree: Tree
    placement: LoadPlacement
    load_operator: FloatArray
    mass: FloatArray
    inertia_operator: FloatArray
    by_load: FloatArray | None
    by_mode: FloatArray | None
    nonlinear: bool
    inertia: InertiaIntegrals | None = None
    ties: TieForces | None = None


@dataclass(frozen=True, slots=True)
class NodeLoads:
    """Loads spread to the tree's nodes, frames included.

    Attributes
    ----------
    force, moment : (K, 3) float
        N and N m, global frame.
    constant : (m,) float
        Modal force of the loads on the reference body.
    geometric : (m, m) float or None
        Geometric stiffness of these loads, 1/s².
    forces_only : NodeLoads or None
        The same without moments, which have no potential; None where there are none.
    active : bool
        Whether the modal force varies with q under these loads.
    """

    force: FloatArray
    moment: FloatArray
    constant: FloatArray
    geometric: FloatArray | None
    forces_only: "NodeLoads | None"
    active: bool


def build_dynamics(body: ReducedBody, formulation: Formulation) -> Dynamics:
    """Set up a body under a formulation.

    Parameters
    ----------
    body : ReducedBody
    formulation : Formulation

    Returns
    -------
    Dynamics

    Raises
    ------
    OptionError
        The formulation needs data that the body was built without.
    """
    m = body.mode_count
    placement = formulation.loads
    linear = formulation.kinematics is Kinematics.LINEAR or not np.any(body.interface_frame >= 0)
    if placement is LoadPlacement.DEFORMED and linear:
        # Linear kinematics have a constant derivative: loads on the deformed body are then those on the reference one.
        placement = LoadPlacement.REFERENCE
    operator = np.concatenate([body.interface_displacement.reshape(-1, m), body.interface_rotation.reshape(-1, m)])
    tree = build_tree(body, formulation.kinematics)
    omega = body.angular_frequency
    weight = np.where(omega > 0.0, omega, omega[body.rigid_count])
    mass, inertia = np.zeros(0), np.zeros((3, m))
    if body.masses is not None:
        mass = body.masses.mass
        inertia = -np.tensordot(mass, body.masses.displacement, axes=1)
    by_load = by_mode = None
    if formulation.stiffness is Stiffness.BY_LOAD:
        bare = Dynamics(omega**2, weight, tree, placement, operator, mass, inertia, None, None, True)
        data = _aboard(body.stiffness_by_load, formulation)
        by_load = data + unit_load_stiffness(bare, body.interface_count, len(data))
    elif formulation.stiffness is Stiffness.BY_MODE:
        by_mode = _aboard(body.stiffness_by_mode, formulation)
    ties = tie_forces(body, tree)
    nonlinear = (
        placement is not LoadPlacement.REFERENCE or by_load is not None or by_mode is not None or ties is not None
    )
    return Dynamics(
        omega**2,
        weight,
        tree,
        placement,
        operator,
        mass,
        inertia,
        by_load,
        by_mode,
        nonlinear,
        _integrals(body, formulation),
        ties,
    )


def _integrals(body: ReducedBody, formulation: Formulation) -> InertiaIntegrals | None:
    # Without frames the kinematics are linear, and the mass is constant.
    if formulation.mass is Mass.CONSTANT or not body.frame_count:
        return None
    if body.inertia is None:
        raise OptionError(
            'mass "configuration" needs data that this body was built without: build it with inertia = true in '
            "[reduction]"
        )
    if body.ties is not None:
        raise OptionError('mass "configuration" does not know bodies that were cut; take mass "constant"')
    return body.inertia


def _aboard(data: FloatArray | None, formulation: Formulation) -> FloatArray:
    if data is None:
        kind = formulation.stiffness.value
        raise OptionError(
            f'stiffness "{kind}" needs data that this body was built without: build it with geometric_stiffness = '
            f'["{kind}"] in [reduction]'
        )
    return data


def unit_load_stiffness(dynamics: Dynamics, interfaces: int, count: int) -> FloatArray:
    """∂Q/∂q at q = 0 under each of `count` unit loads, (count, m, m): what the loads' displacement does at first order.

    It *is* part of the effect that geometric stiffness by load carries. Taken out of it, the tangent at the unloaded
    shape is Λ + Σ f_l K_l whatever the placement of loads, and nothing counts twice.
    """
    m = dynamics.stiffness.size
    result = np.zeros((count, m, m))
    if dynamics.placement is LoadPlacement.REFERENCE:
        return result
    undeformed = configuration_at(dynamics, np.zeros(m))
    for column, unit in enumerate(np.eye(count, 6 * interfaces + 3)):
        force, moment = unit[:-3].reshape(2, interfaces, 3)
        loads = spread(dynamics, Loads(force, moment, unit[-3:]))
        result[column] = _displacement_stiffness(dynamics, loads, undeformed)
    return result


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
    interfaces = dynamics.tree.interfaces
    force = np.zeros((len(dynamics.tree.parent), 3))
    moment = np.zeros_like(force)
    force[interfaces], moment[interfaces] = loads.force, loads.moment
    # d'Alembert: in the supports' frame each mass feels the acceleration as a force against it.
    force[interfaces.stop : interfaces.stop + dynamics.mass.size] = -dynamics.mass[:, None] * loads.acceleration
    components = np.concatenate([loads.force.ravel(), loads.moment.ravel()])
    constant = components @ dynamics.load_operator + loads.acceleration @ dynamics.inertia_operator
    geometric = None
    if dynamics.by_load is not None:
        every = np.concatenate([components, loads.acceleration])[: len(dynamics.by_load)]
        geometric = np.tensordot(every, dynamics.by_load, axes=1)
    forces_only = None
    if dynamics.nonlinear and np.any(loads.moment):
        forces_only = spread(dynamics, Loads(loads.force, np.zeros_like(loads.moment), loads.acceleration))
    active = dynamics.by_mode is not None or dynamics.ties is not None
    active = active or (dynamics.nonlinear and bool(np.any(components) or np.any(force)))
    return NodeLoads(force, moment, constant, geometric, forces_only, active)


def between(start: NodeLoads, end: NodeLoads, share: float) -> NodeLoads:
    """Loads at a share of the way from `start` to `end`."""

    def mixed(a: FloatArray, b: FloatArray) -> FloatArray:
        result: FloatArray = a + share * (b - a)
        return result

    geometric = forces_only = None
    if start.geometric is not None and end.geometric is not None:
        geometric = mixed(start.geometric, end.geometric)
    if start.forces_only is not None or end.forces_only is not None:
        forces_only = between(start.forces_only or start, end.forces_only or end, share)
    return NodeLoads(
        mixed(start.force, end.force),
        mixed(start.moment, end.moment),
        mixed(start.constant, end.constant),
        geometric,
        forces_only,
        start.active or end.active,
    )


def modal_force(
    dynamics: Dynamics, loads: NodeLoads, state: Configuration, tense: FloatArray | None = None
) -> FloatArray:
    """Modal force Q(q) of the loads, geometric stiffness included.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration
        The configuration at q.
    tense : (T, 4, 3) float, optional
        Tension of the ties where it is to be another than that at q.

    Returns
    -------
    (m,) float
    """
    ties = dynamics.ties
    own = None if ties is None else nodal_loads(ties, state, tension(ties, state) if tense is None else tense)
    match dynamics.placement:
        case LoadPlacement.DEFORMED if own is not None:
            force = generalised_force(dynamics.tree, state, loads.force + own[0], loads.moment + own[1])
        case LoadPlacement.DEFORMED:
            force = generalised_force(dynamics.tree, state, loads.force, loads.moment)
        case LoadPlacement.CORRECTIVE_MOMENT:
            interfaces = dynamics.tree.interfaces
            displacement = state.position[interfaces] - dynamics.tree.point[interfaces]
            moment = cross(displacement, loads.force[interfaces])
            force = loads.constant + moment.ravel() @ dynamics.load_operator[moment.size :]
        case LoadPlacement.REFERENCE:
            force = loads.constant
    if ties is not None and own is not None:
        if dynamics.placement is not LoadPlacement.DEFORMED:
            force = force + generalised_force(dynamics.tree, state, *own)
        force = force + ties.initial @ state.q
    if loads.geometric is not None:
        force = force - loads.geometric @ state.q
    if dynamics.by_mode is not None:
        # Σ q_j K_j q and no more. Made the gradient of an energy, it would be bounded by the quartic term alone, which
        # modes do not have: a bent cantilever then collapses.
        force = force - np.tensordot(state.q, dynamics.by_mode, axes=1) @ state.q
    return force


def force_work(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> float | None:
    """Potential whose gradient is the part of Q(q) that is due to forces, J; moments do not count.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration

    Returns
    -------
    float or None
        Work from the undeformed body on; None where there is no potential (corrective moments, stiffness by mode).
    """
    if dynamics.placement is LoadPlacement.CORRECTIVE_MOMENT or dynamics.by_mode is not None:
        return None
    q = state.q
    if dynamics.placement is LoadPlacement.DEFORMED:
        work = float(np.vdot(loads.force, state.position - dynamics.tree.point))
    else:
        # Constant modal forces; without the moments, as everywhere here.
        work = float((loads if loads.forces_only is None else loads.forces_only).constant @ q)
    geometric = loads.geometric if loads.forces_only is None else loads.forces_only.geometric
    if geometric is not None:
        work -= 0.5 * float(q @ geometric @ q)
    if dynamics.ties is not None:
        work -= energy(dynamics.ties, state)
    return work


def work_reach(tree: Tree, force: FloatArray) -> float:
    """What the round-off of places can make of the work of forces (n, 3) on them, over ε: their norms by the size, J.

    Frames turn places, so that each coordinate has the round-off of all three.
    """
    norms = np.sqrt(np.einsum("ki,ki->k", force, force))
    return float(norms.sum()) * math.sqrt(float(np.einsum("ki,ki->k", tree.point, tree.point).max()))


def _displacement_stiffness(dynamics: Dynamics, loads: NodeLoads, state: Configuration) -> FloatArray:
    """∂Q/∂q (m, m) for want of geometric stiffness: that of loads that move with the body."""
    match dynamics.placement:
        case LoadPlacement.DEFORMED:
            return load_stiffness(dynamics.tree, state, loads.force, loads.moment)
        case LoadPlacement.CORRECTIVE_MOMENT:
            interfaces = dynamics.tree.interfaces
            translation, _ = jacobians(dynamics.tree, state)
            change = -skew(loads.force[interfaces]) @ translation[interfaces]
            rotation = dynamics.load_operator[3 * len(change) :]
            result: FloatArray = rotation.T @ change.reshape(rotation.shape)
            return result
        case LoadPlacement.REFERENCE:
            return np.zeros((state.q.size, state.q.size))


def _tie_stiffness(dynamics: Dynamics, ties: TieForces, state: Configuration, tense: FloatArray | None) -> FloatArray:
    """What ties add to Λ, (m, m)."""
    tense = tension(ties, state) if tense is None else tense
    translation, spin = jacobians(dynamics.tree, state)
    change = gap_derivative(ties, state, translation, spin)
    flat = change.reshape(-1, change.shape[-1])
    result: FloatArray = flat.T @ (ties.stiffness[..., None] * change).reshape(flat.shape) - ties.initial
    result = result - load_stiffness(dynamics.tree, state, *nodal_loads(ties, state, tense))
    return result - moment_stiffness(ties, state, tense, spin)


def tangent_stiffness(
    dynamics: Dynamics, loads: NodeLoads, state: Configuration, tense: FloatArray | None = None
) -> FloatArray:
    """Λ − ∂Q/∂q, (m, m): positive definite where the equilibrium is stable.

    Parameters
    ----------
    dynamics : Dynamics
    loads : NodeLoads
    state : Configuration
    tense : (T, 4, 3) float, optional
        Tension of the ties where it is to be another than that at q: Newton's method finds its way with the one that
        its last step foresaw, where the one at hand is that of stiff springs which do not quite fit yet.

    Returns
    -------
    (m, m) float
        1/s².
    """
    result: FloatArray = np.diag(dynamics.stiffness)
    if not loads.active:
        return result
    result = result - _displacement_stiffness(dynamics, loads, state)
    if dynamics.ties is not None:
        result = result + _tie_stiffness(dynamics, dynamics.ties, state, tense)
    if loads.geometric is not None:
        result = result + loads.geometric
    if dynamics.by_mode is not None:
        result = result + np.tensordot(state.q, dynamics.by_mode, axes=1) + (dynamics.by_mode @ state.q).T
    return result


def configuration_at(dynamics: Dynamics, q: FloatArray) -> Configuration:
    """Positions and rotations of the body's nodes at q (m,)."""
    return configuration(dynamics.tree, q)
