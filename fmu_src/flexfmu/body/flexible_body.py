"""A flexible body ready to be loaded, solved and stepped: the Python face of the core, which knows nothing of FMI."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.library import Core, StepLimits
from ..files.basics import EquilibriumError, FloatArray, IntArray, LoadError, OptionError, StepError
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody
from ..model.variants import chosen, with_fixed_interfaces, with_frame_layout
from ..program.compile import compile_program, shadow_draft
from .loads import Loads, loads_from_mapping
from .recovery import surface_data

_Given = Loads | Mapping[str, Sequence[float]]

__all__ = ["Errors", "FlexibleBody", "Response", "State", "StepLimits", "Work"]


@dataclass(frozen=True, slots=True, repr=False)
class State:
    """The evolving state of a body.

    Attributes
    ----------
    q, v : (m,) float
        Modal coordinates (kg^1/2 m) and their rates.
    substeps : int
        Sub-steps that the last step took; where the next one starts to look.
    """

    q: FloatArray
    v: FloatArray
    substeps: int = 1

    def __repr__(self) -> str:
        """Size: how far the body is from its rest, and how fast it moves."""
        return f"<State of {self.q.size} modes: |q| = {np.linalg.norm(self.q):.4g}, |v| = {np.linalg.norm(self.v):.4g}>"


@dataclass(frozen=True, slots=True)
class Work:
    """What a step cost.

    Attributes
    ----------
    substeps : int
    iterations : int
        Rounds of the implicit iteration over all sub-steps, discarded tries included.
    error : float
        Estimated error of the step, relative, as `StepLimits.tolerance` bounds it.
    """

    substeps: int
    iterations: int
    error: float


@dataclass(frozen=True, slots=True)
class Response:
    """Motion of the I interfaces.

    Attributes
    ----------
    displacement : (I, 3) float
        Of the reference points, m, global frame.
    rotation : (I, 3) float
        Rotation vectors, rad, global frame.
    """

    displacement: FloatArray
    rotation: FloatArray


@dataclass(frozen=True, slots=True)
class Errors:
    """How far the motion of the I interfaces is off, as the body estimates it of itself.

    Attributes
    ----------
    displacement : (I,) float
        m.
    rotation : (I,) float
        rad.
    relative : float
        The largest error of a displacement over the largest deflection of the interfaces; 0 at rest. Beyond 0.1 it
        says that the motion is wrong, not by how much.
    bound : float
        Of the same, with what the estimate cannot see: an FMU warns where it exceeds `watch.error.limit`.
    """

    displacement: FloatArray
    rotation: FloatArray
    relative: float
    bound: float


class FlexibleBody:
    """A reduced body under one method. Constant: states go in and come out.

    Parameters
    ----------
    model : ReducedBody
    method : Method or str, optional
        Default: the one that the body was built with.
    mass : Mass or str, optional
        Default: the body's own, where the method knows it.
    damping_scale : float
        Factor on all modal damping ratios, not negative.
    limits : StepLimits
        Bounds of the internal step.
    fixed : collection of str
        Interfaces of a free body that the scene fixes; see `with_fixed_interfaces`.

    Raises
    ------
    OptionError
        No such method or mass, data that the body was built without, a scale, limit or tolerance out of range, or
        interfaces that cannot be fixed.
    """

    def __init__(
        self,
        model: ReducedBody,
        method: Method | str | None = None,
        mass: Mass | str | None = None,
        damping_scale: float = 1.0,
        limits: StepLimits | None = None,
        fixed: Collection[str] = (),
    ):
        limits = limits or StepLimits()
        if not (math.isfinite(damping_scale) and damping_scale >= 0.0):
            raise OptionError(f"damping scale is {damping_scale}, expected a finite number ≥ 0")
        if not (math.isfinite(limits.longest) and limits.longest >= 0.0):
            raise OptionError(f"internal step limit is {limits.longest} s, expected 0 (none) or a positive number")
        if not (math.isfinite(limits.tolerance) and limits.tolerance > 0.0):
            raise OptionError(f"internal step tolerance is {limits.tolerance}, expected a positive number")
        if not (math.isfinite(limits.most) and limits.most >= 1.0):
            raise OptionError(f"internal_step.most is {limits.most}, expected a finite number of internal steps ≥ 1")
        variant = chosen(model, method, mass)
        self.variant, self.method = variant, variant.method
        self.model = with_frame_layout(with_fixed_interfaces(model, fixed, self.method), self.method)
        self.limits = limits
        self.core = Core(compile_program(self.model, self.method, variant.mass), damping_scale, limits)

    def __repr__(self) -> str:
        """Name, method and size."""
        size = f"{self.core.modes} modes, {self.core.frames} frames"
        kind, interfaces = type(self).__name__, ", ".join(self.model.interface_names)
        return f"<{kind} {self.model.name!r}: {self.method.value}, {size}, interfaces {interfaces}>"

    def loads(self, loads: Mapping[str, Sequence[float]], acceleration: Sequence[float] = (0.0, 0.0, 0.0)) -> Loads:
        """Loads from {interface: (fx, fy, fz)} or {interface: (fx, fy, fz, mx, my, mz)}, N and N m, global frame.

        Parameters
        ----------
        loads : mapping of str to 3 or 6 float
        acceleration : 3 float
            Of the supports, m/s²; weight is an acceleration against gravity.

        Returns
        -------
        Loads

        Raises
        ------
        LoadError
            An unknown interface, a wrong number of components, a value that is not finite, or an acceleration of a body
            that was built without its masses.

        Examples
        --------
        >>> arm.loads({"tip": [0.0, 100.0, 0.0]}).force
        array([[  0., 100.,   0.]])
        """
        result = loads_from_mapping(self.model.interface_names, loads, acceleration)
        if self.model.masses is None and np.any(result.acceleration):
            raise LoadError("the body was built without its masses: set acceleration = true in [input]")
        return result

    def rest(self) -> State:
        """Return the undeformed body at rest."""
        return State(*np.zeros((2, self.core.modes)))

    def static(self, loads: _Given) -> State:
        """Stable equilibrium under constant loads, at rest.

        Parameters
        ----------
        loads : Loads or mapping as for `loads`

        Returns
        -------
        State

        Raises
        ------
        EquilibriumError
            There is none that the unloaded body could reach.
        LoadError
            As for `loads`, or `Loads` on another number of interfaces.

        Examples
        --------
        >>> bent = arm.static({"tip": [0.0, 20e3, 0.0]})
        >>> bool(arm.response(bent).displacement[0, 0] < 0.0)  # the tip draws nearer as the arm bends
        True
        """
        refused, q, share, _ = self.core.static(self._packed(loads))
        if refused:
            raise EquilibriumError(self.core.static_refusal(refused, share), share)
        return State(q, np.zeros_like(q))

    def step(self, state: State, loads: _Given, step: float) -> State:
        """State after a step (s) under loads that are constant over it; see `step_with_work`."""
        return self.step_with_work(state, loads, step)[0]

    def step_with_work(
        self, state: State, loads: _Given, step: float, end_loads: _Given | None = None
    ) -> tuple[State, Work]:
        """State after a step under loads that are constant over it, or grow linearly, and what it cost.

        Parameters
        ----------
        state : State
            Left untouched.
        loads : Loads or mapping as for `loads`
            Over the step, or at its start.
        step : float
            s, positive.
        end_loads : Loads or mapping as for `loads`, optional
            At its end, where they are others.

        Returns
        -------
        state : State
        work : Work

        Raises
        ------
        StepError
            A step that is not positive and finite, or a load that the body cannot bear.
        LoadError
            As for `loads`, or `Loads` on another number of interfaces.

        Examples
        --------
        >>> state, work = arm.step_with_work(arm.rest(), {"tip": [0.0, 100.0, 0.0]}, 1e-4)
        >>> work.error < arm.limits.tolerance
        True
        """
        end = None if end_loads is None else self._packed(end_loads)
        return self.step_packed(state, self._packed(loads), step, end)

    def step_packed(
        self, state: State, inputs: FloatArray, step: float, end_inputs: FloatArray | None = None
    ) -> tuple[State, Work]:
        """As `step_with_work`, with loads as the array (6I,) or, of a body with masses, (6I + 3,) of `Loads.packed`."""
        refused, q, v, hint, work = self.core.step(state.q, state.v, inputs, step, end_inputs, state.substeps)
        if refused:
            raise StepError(self.core.step_refusal(refused, step, work))
        return State(q, v, hint), Work(*work)

    def motion(self, state: State) -> FloatArray:
        """Displacement and rotation vector of each interface in turn, (6I,); as `response`."""
        return self.core.motion(state.q)

    def response(self, state: State) -> Response:
        """Displacement and rotation of every interface.

        Parameters
        ----------
        state : State

        Returns
        -------
        Response
        """
        return Response(*self.core.motion(state.q).reshape(-1, 2, 3).swapaxes(0, 1))

    def motion_and_rates(self, state: State) -> tuple[FloatArray, FloatArray]:
        """As `motion`, and velocity and angular velocity of each interface in turn, (6I,); as `rates`."""
        return self.core.motion_and_rates(state.q, state.v)

    def rates(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and angular velocity (rad/s) of every interface, global frame, each (I, 3)."""
        rates = self.core.motion_and_rates(state.q, state.v)[1].reshape(-1, 2, 3)
        return rates[:, 0], rates[:, 1]

    def surface_positions(self, state: State) -> FloatArray:
        """Where the points of the model's surface are, for viewing.

        Parameters
        ----------
        state : State

        Returns
        -------
        (n_points, 3) float
            m, global frame.

        Raises
        ------
        OptionError
            The body was built without its surface.
        """
        return self.core.surface(self._surface, state.q)

    @cached_property
    def _surface(self) -> tuple[IntArray, IntArray, FloatArray]:
        return surface_data(self.model, self.method)

    def von_mises(self, state: State) -> FloatArray:
        """Largest von Mises stress of each stress set, N/m², (number of stress sets,)."""
        return self.core.stress(state.q, len(self.model.stress_sets))

    def energies(self, state: State) -> tuple[float, float]:
        """Strain and kinetic energy, J."""
        return self.core.energies(state.q, state.v)

    def forces(self, state: State, inputs: FloatArray) -> FloatArray:
        """Modal force Q(q) (m,) of loads, as of `Loads.packed`; kg^1/2 m/s²."""
        return self.core.force(inputs, state.q)

    def tangent(self, state: State, inputs: FloatArray) -> FloatArray:
        """Tangent stiffness Λ − ∂Q/∂q (m, m) under loads, as of `Loads.packed`; 1/s²."""
        return self.core.tangent(inputs, state.q)

    def mass(self, state: State) -> FloatArray:
        """Mass M(q), (m, m): the identity for that of the undeformed body."""
        return self.core.mass(state.q)

    def largest_rotation(self, state: State) -> float:
        """Largest rotation of material within its frame, rad: of joints and interfaces against its averaged one.

        Linear kinematics count as one frame on the ground.
        """
        return self.core.largest_rotation(state.q)

    def stability(self, state: State, inputs: FloatArray) -> tuple[float, FloatArray]:
        """Smallest eigenvalue of the tangent stiffness over the unloaded one: 1 without loads, 0 at the critical load.

        Parameters
        ----------
        state : State
        inputs : (6I,) or (6I + 3,) float
            Loads, as of `Loads.packed`.

        Returns
        -------
        margin : float
        shape : (m,) float
            The eigenvector, zero for rigid motions and for what is too stiff to give way.
        """
        return self.core.stability(inputs, state.q)

    def is_stable(self, state: State, inputs: FloatArray, margin: float) -> bool:
        """Whether `stability` is above a margin; faster than finding it."""
        return self.core.is_stable(inputs, state.q, margin)

    def stiffness_missed(self, inputs: FloatArray) -> float:
        """Upper bound of the deflection error from geometric stiffness that the method omits; 1 at the most."""
        return self.core.missed(inputs)

    @cached_property
    def _shadow(self) -> Core:
        return Core(shadow_draft(self.model).image())

    def error(self, state: State, loads: _Given) -> Errors:
        """Error of the interfaces' motion, estimated by a finer reduction of the same body.

        Parameters
        ----------
        state : State
            In equilibrium under the loads, or at a step's end.
        loads : Loads or mapping as for `loads`

        Returns
        -------
        Errors

        Raises
        ------
        OptionError
            The body was built without what tells its error.
        LoadError
            As for `loads`, or `Loads` on another number of interfaces.

        Examples
        --------
        >>> loads = {"tip": [0.0, 20e3, 0.0]}
        >>> arm.error(arm.static(loads), loads).relative < 0.001
        True
        """
        found, share, bound = self.core.error(self._shadow, self._packed(loads), state.q)
        return Errors(found[:, 0], found[:, 1], share, bound)

    def compliance(self, state: State, inputs: FloatArray, step: float, interfaces: Sequence[int]) -> FloatArray:
        """Derivative of interfaces' motion at a step's end with respect to loads on them held over the step.

        Parameters
        ----------
        state : State
            At the step's end.
        inputs : (6I,) or (6I + 3,) float
        step : float
            s.
        interfaces : sequence of int

        Returns
        -------
        (6n, 6n) float
            Displacement and rotation of each in turn per force and moment on each: m/N, m/(N m), rad/N, rad/(N m).

        Raises
        ------
        OptionError
            An interface is named twice, or is none.
        """
        count = len(self.model.interface_names)
        if len(set(interfaces)) < len(interfaces) or not all(0 <= one < count for one in interfaces):
            raise OptionError(f"interfaces are {list(interfaces)}, expected different numbers from 0 to {count - 1}")
        return self.core.compliance(inputs, step, state.q, interfaces)

    def _packed(self, loads: _Given) -> FloatArray:
        given = loads if isinstance(loads, Loads) else self.loads(loads)
        names, found = self.model.interface_names, [np.shape(given.force), np.shape(given.moment)]
        if found != [(len(names), 3)] * 2:
            what = f"expected ({len(names)}, 3), one row each of {', '.join(names)}: make them by this body's `loads`"
            raise LoadError(f"forces and moments have shapes {found[0]} and {found[1]}, {what}")
        return given.packed(self.model.masses is not None)
