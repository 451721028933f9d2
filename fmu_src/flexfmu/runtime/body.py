"""A flexible body ready to be loaded, solved and stepped; knows nothing of FMI."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .buckling import Judge, judge
from .division import divided
from .dynamics import build_dynamics, spread
from .errors import LoadError, OptionError, StepError
from .evaluation import FeedRates
from .fixing import with_fixed_interfaces
from .indicators import compliance, elastic_part, scaled_tangent, turning
from .inertia import mass_matrix
from .loads import Loads, loads_from_mapping
from .reduced_body import Evaluation, Formulation, ReducedBody
from .rotations import cross, rotation_vector
from .spinning import Spinning, spinning
from .statics import equilibrium
from .stepping import State, StepLimits, Stepper, Work
from .ties import energy as tie_energy
from .tree import jacobians

FloatArray = NDArray[np.float64]

# Square of coordinates and rates beyond which arithmetic overflows: far beyond anything that a body bears.
_LARGEST_SQUARE = 1e200


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


class FlexibleBody:
    """A reduced body under one formulation. Constant: states go in and come out.

    Parameters
    ----------
    model : ReducedBody
    formulation : Formulation, optional
        Default: the one in the model.
    damping_scale : float
        Factor on all modal damping ratios, not negative.
    limits : StepLimits
        Bounds of the internal step.
    fixed : collection of str
        Interfaces of a free body that the scene fixes; see `with_fixed_interfaces`.
    use_compiled : bool
        Whether compiled code is used where there is some.

    Raises
    ------
    OptionError
        A scale, limit or tolerance out of range, or interfaces that cannot be fixed.
    """

    def __init__(
        self,
        model: ReducedBody,
        formulation: Formulation | None = None,
        damping_scale: float = 1.0,
        limits: StepLimits | None = None,
        fixed: Collection[str] = (),
        use_compiled: bool = True,
    ):
        limits = limits or StepLimits()
        if not (np.isfinite(damping_scale) and damping_scale >= 0.0):
            raise OptionError(f"damping scale is {damping_scale}, expected a finite number ≥ 0")
        if not (np.isfinite(limits.longest) and limits.longest >= 0.0):
            raise OptionError(f"internal step limit is {limits.longest} s, expected 0 (none) or a positive number")
        if not (np.isfinite(limits.tolerance) and limits.tolerance > 0.0):
            raise OptionError(f"internal step tolerance is {limits.tolerance}, expected a positive number")
        if not (np.isfinite(limits.most) and limits.most >= 1.0):
            raise OptionError(f"internal_step.most is {limits.most}, expected a finite number of internal steps ≥ 1")
        self.formulation = formulation or model.formulation
        model = with_fixed_interfaces(model, fixed, self.formulation.kinematics)
        self.model = model = divided(model, self.formulation)
        self.limits = limits
        self._dynamics = build_dynamics(model, self.formulation)
        if self.explicit and self._dynamics.ties is not None:
            raise OptionError(
                'evaluation "explicit" does not go with cut bodies, whose parts are joined by stiff springs; take '
                'evaluation "implicit"'
            )
        damping = damping_scale * model.damping_ratio
        self._turning = turning(model, self._dynamics.tree.frame_count)
        self._stepper = Stepper(
            self._dynamics,
            model.angular_frequency,
            damping,
            limits,
            self._turning.operator,
            use_compiled,
            self.formulation.evaluation,
        )
        self._configuration = self._stepper.configuration
        self.spinning: Spinning | None = spinning(model, self._dynamics)
        self._judge: Judge | None = None
        self._judged = False

    @property
    def explicit(self) -> bool:
        """Whether loads on the moving body are evaluated at each step's start."""
        return self.formulation.evaluation is Evaluation.EXPLICIT

    @property
    def judge(self) -> Judge | None:
        """The second opinion on the formulation's tangent stiffness, set up when first asked for."""
        if not self._judged:
            self._judge, self._judged = judge(self.model, self._dynamics), True
        return self._judge

    def feed_rates(self, state: State, inputs: FloatArray, step: float) -> FeedRates:
        """What explicit evaluation does to vibrations about a state; see `evaluation.feed_rates`.

        Parameters
        ----------
        state : State
        inputs : (6I,) or (6I + 3,) float
            Loads, as of `Loads.packed`.
        step : float
            s.

        Returns
        -------
        FeedRates
        """
        return self._stepper.feed_rates(state, inputs, step)

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
        """
        result = loads_from_mapping(self.model.interface_names, loads, acceleration)
        if self.model.masses is None and np.any(result.acceleration):
            raise LoadError("the body was built without its masses: set acceleration = true in [input]")
        return result

    def rest(self) -> State:
        """Return the undeformed body at rest."""
        zero = np.zeros(self.model.mode_count)
        return State(zero, zero.copy())

    def static(self, loads: Loads | Mapping[str, Sequence[float]]) -> State:
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
        """
        q, _ = equilibrium(self._dynamics, self._as_loads(loads), self.limits.most)
        return State(q, np.zeros_like(q))

    def step(self, state: State, loads: Loads | Mapping[str, Sequence[float]], step: float) -> State:
        """State after a step (s) under loads that are constant over it; see `step_with_work`."""
        return self.step_with_work(state, loads, step)[0]

    def step_with_work(
        self,
        state: State,
        loads: Loads | Mapping[str, Sequence[float]],
        step: float,
        end_loads: Loads | Mapping[str, Sequence[float]] | None = None,
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
        """
        heavy = self.model.masses is not None
        start = self._as_loads(loads).packed(heavy)
        end = None if end_loads is None else self._as_loads(end_loads).packed(heavy)
        return self.step_packed(state, start, step, end)

    def step_packed(
        self, state: State, inputs: FloatArray, step: float, end_inputs: FloatArray | None = None
    ) -> tuple[State, Work]:
        """As `step_with_work`, with loads as the array (6I,) or, of a body with masses, (6I + 3,) of `Loads.packed`."""
        if not (math.isfinite(step) and step > 0.0):
            raise StepError(f"step is {step} s, expected a positive number")
        end, work = self._stepper.advance(state, inputs, step, end_inputs)
        # Not a number compares as false. What is larger would overflow on its way to the outputs.
        if not end.q @ end.q + end.v @ end.v < _LARGEST_SQUARE:
            raise StepError("the step ends in values that are not finite: the loads are too large for the arithmetic")
        return end, work

    def motion(self, state: State) -> FloatArray:
        """Displacement and rotation vector of each interface in turn, (6I,); as `response`."""
        if self._stepper.kernel is not None:
            return self._stepper.kernel.motion(state.q)
        response = self.response(state)
        return np.concatenate([response.displacement, response.rotation], axis=1).ravel()

    def response(self, state: State) -> Response:
        """Displacement and rotation of every interface.

        Parameters
        ----------
        state : State

        Returns
        -------
        Response
        """
        tree = self._dynamics.tree
        nodes = self._configuration(state.q)
        displacement = nodes.position[tree.interfaces] - tree.point[tree.interfaces]
        return Response(displacement, rotation_vector(nodes.rotation[tree.interfaces]))

    def motion_and_rates(self, state: State) -> tuple[FloatArray, FloatArray]:
        """As `motion`, and velocity and angular velocity of each interface in turn, (6I,); as `rates`."""
        if self._stepper.kernel is not None:
            return self._stepper.kernel.motion_and_rates(state.q, state.v)
        return self.motion(state), np.concatenate(self.rates(state), axis=1).ravel()

    def rates(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Velocity (m/s) and angular velocity (rad/s) of every interface, global frame, each (I, 3).

        Parameters
        ----------
        state : State

        Returns
        -------
        velocity, angular_velocity : (I, 3) float
        """
        tree = self._dynamics.tree
        translation, spin = jacobians(tree, self._configuration(state.q))
        return translation[tree.interfaces] @ state.v, spin[tree.interfaces] @ state.v

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
        body = self.model
        if body.surface is None:
            raise OptionError("the body holds no surface: build it with surface = true in [output]")
        surface, q = body.surface, state.q
        moved: FloatArray = surface.points + surface.modes @ q
        if self._dynamics.tree.frame_count == 0:
            return moved
        nodes = self._configuration(q)
        carried = surface.frame >= 0
        s = surface.frame[carried]
        # X − X_s + e, with e = u − u(X_s) − θ_s × (X − X_s)
        arm = surface.points[carried] - body.joint_point[s]
        turn = cross((body.frame_rotation @ q)[s], arm)
        local = moved[carried] - body.joint_point[s] - (body.joint_displacement @ q)[s] - turn
        moved[carried] = nodes.position[s] + (nodes.rotation[s] @ local[:, :, None])[:, :, 0]
        return moved

    def von_mises(self, state: State) -> FloatArray:
        """Largest von Mises stress of each stress set, N/m².

        Parameters
        ----------
        state : State

        Returns
        -------
        (number of stress sets,) float
        """
        largest = np.empty(len(self.model.stress_sets))
        for number, part in enumerate(self.model.stress_sets):
            xx, yy, zz, xy, yz, zx = (part.stress @ state.q).T
            direct = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
            largest[number] = np.sqrt(np.max(0.5 * direct + 3.0 * (xy**2 + yz**2 + zx**2)))
        return largest

    def energies(self, state: State) -> tuple[float, float]:
        """Strain and kinetic energy, J.

        Parameters
        ----------
        state : State

        Returns
        -------
        strain, kinetic : float
        """
        strain = 0.5 * float(np.vdot(self._dynamics.stiffness * state.q, state.q))
        if self._dynamics.ties is not None:
            strain += tie_energy(self._dynamics.ties, self._configuration(state.q))
        momentum, inertia = state.v, self._dynamics.inertia
        if inertia is not None:
            momentum = mass_matrix(self._dynamics.tree, inertia, self._configuration(state.q)) @ state.v
        return strain, 0.5 * float(state.v @ momentum)

    def rotation_within_frames(self, state: State) -> FloatArray:
        """How far the material turns within each frame, the measure of trust in it (good to about 0.5 rad).

        For each frame the largest rotation of its own joint, of the joints and of the interfaces that it carries,
        against its averaged one. Linear kinematics count as one frame on the ground.

        Parameters
        ----------
        state : State

        Returns
        -------
        (S,) float, or (1,) for linear kinematics
            rad.
        """
        largest = np.zeros(self._turning.frame_count)
        np.maximum.at(largest, self._turning.frame, self._turning.angles(state.q))
        return largest

    def largest_rotation(self, state: State) -> float:
        """Largest rotation within any frame, rad."""
        if self._stepper.kernel is not None:
            return self._stepper.kernel.largest_rotation(state.q)
        return float(self._turning.angles(state.q).max(initial=0.0))

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
        values, vectors = np.linalg.eigh(self._scaled_tangent(state, inputs))
        shape, first = np.zeros(self.model.mode_count), self.model.rigid_count
        shape[first : first + len(vectors)] = vectors[:, 0]
        return float(values[0]), shape

    def is_stable(self, state: State, inputs: FloatArray, margin: float) -> bool:
        """Whether `stability` is above a margin, to some six digits; faster than finding it."""
        kernel = self._stepper.kernel
        # Differences lose too many digits to springs as stiff as those of a cut.
        if kernel is None or self._dynamics.ties is not None:
            tangent = self._scaled_tangent(state, inputs)
        else:
            change = kernel.force_derivative(inputs, state.q)
            tangent = elastic_part(self._dynamics, np.diag(self._dynamics.stiffness) - change)
        try:
            np.linalg.cholesky(tangent - margin * np.eye(len(tangent)))
        except np.linalg.LinAlgError:
            return False
        return True

    def softening(self, state: State, inputs: FloatArray, shape: FloatArray) -> float:
        """What some loads alone take off `stability` in a shape (m,) that it gave."""
        tangent, first = self._scaled_tangent(state, inputs), self.model.rigid_count
        elastic = shape[first : first + len(tangent)]
        return float(elastic @ elastic - elastic @ tangent @ elastic)

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
        """
        loads = spread(self._dynamics, Loads.unpacked(inputs, self.model.interface_count))
        if self._stepper.tied is not None:
            return self._stepper.tied.compliance(step, loads, self._configuration(state.q), interfaces)
        return compliance(
            self._dynamics, self._stepper.propagator(step), loads, self._configuration(state.q), interfaces
        )

    def _scaled_tangent(self, state: State, inputs: FloatArray) -> FloatArray:
        loads = spread(self._dynamics, Loads.unpacked(inputs, self.model.interface_count))
        return scaled_tangent(self._dynamics, loads, self._configuration(state.q))

    def _as_loads(self, loads: Loads | Mapping[str, Sequence[float]]) -> Loads:
        return loads if isinstance(loads, Loads) else self.loads(loads)
