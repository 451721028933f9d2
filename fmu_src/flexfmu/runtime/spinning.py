"""What constant mass misses of a body that turns as a whole (docs/theory.md, section 9).

Centrifugal and Coriolis forces on the elastic part: their share in the stiffness goes by the square of the spin over
the lowest elastic frequency. Gyroscopic terms: a body about whose rotation vector θ nothing is nonlinear keeps I θ̇
under no moment, where its true angular momentum is R I Rᵀ T θ̇, with R = exp(θ) and T its left Jacobian. The two agree
about one axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics
from .reduced_body import ReducedBody
from .rotations import exponential_and_jacobian
from .stepping import State

FloatArray = NDArray[np.float64]

# Smallest over largest eigenvalue of the inverse inertia below which an axis is held.
_HELD = 1e-9
# Share of a moment below which the model hardly feels it, near full turns: what it is cannot be told from the motion.
_UNFELT = 0.05


@dataclass(frozen=True, slots=True)
class AngularMomentum:
    """Angular momentum so far, from rest, about the centre of mass or the point that is held; part of the FMU's state.

    Attributes
    ----------
    impulse : (3,) float
        Of the moments so far, N m s.
    angle, rate : (3,) float
        Rotation vector, rad, and its derivative, rad/s, where it was last looked at.
    largest : float
        Largest of impulse and momentum so far, N m s.
    drift : float
        What momentum and impulse differ by at present, as a share of the largest.
    """

    impulse: FloatArray
    angle: FloatArray
    rate: FloatArray
    largest: float = 0.0
    drift: float = 0.0

    COUNT = 11

    @classmethod
    def nothing(cls) -> "AngularMomentum":
        """At rest."""
        return cls(*np.zeros((3, 3)))

    def numbers(self) -> FloatArray:
        """All of it, (11,)."""
        return np.concatenate([self.impulse, self.angle, self.rate, [self.largest, self.drift]])

    @classmethod
    def of(cls, numbers: FloatArray) -> "AngularMomentum":
        """What `numbers` gave."""
        impulse, angle, rate = numbers[:9].reshape(3, 3).copy()
        return cls(impulse, angle, rate, float(numbers[9]), float(numbers[10]))


@dataclass(frozen=True, slots=True)
class Spinning:
    """How a body turns as a whole; constant.

    Attributes
    ----------
    rotation : (3, r) float
        Rotation vector per unit rigid motion.
    inertia : (3, 3) float or None
        Of the undeformed body, kg m², about its centre of mass or the point that is held; None where its support
        leaves fewer than three axes.
    frequency : float
        Lowest elastic angular frequency, rad/s.
    """

    rotation: FloatArray
    inertia: FloatArray | None
    frequency: float

    def ratio(self, state: State) -> float:
        """Spin over the lowest elastic frequency."""
        count = self.rotation.shape[1]
        _, jacobian = exponential_and_jacobian(self.rotation @ state.q[:count])
        return float(np.linalg.norm(jacobian @ (self.rotation @ state.v[:count]))) / self.frequency

    def after(self, before: AngularMomentum, state: State) -> AngularMomentum:
        """Angular momentum at a step's end.

        Parameters
        ----------
        before : AngularMomentum
        state : State
            At the step's end.

        Returns
        -------
        AngularMomentum
        """
        if self.inertia is None:
            return before
        count = self.rotation.shape[1]
        angle, rate = self.rotation @ state.q[:count], self.rotation @ state.v[:count]
        turns, jacobians = exponential_and_jacobian(np.stack([0.5 * (before.angle + angle), angle]))
        # The model's own law is I θ̈ = Tᵀ M: from it follow the moments, whatever exerts them.
        moment = np.linalg.pinv(jacobians[0].T, rcond=_UNFELT) @ (self.inertia @ (rate - before.rate))
        impulse = before.impulse + moment
        momentum = turns[1] @ (self.inertia @ (turns[1].T @ (jacobians[1] @ rate)))
        largest = max(before.largest, float(np.linalg.norm(impulse)), float(np.linalg.norm(momentum)))
        drift = float(np.linalg.norm(momentum - impulse)) / largest if largest > 0.0 else 0.0
        return AngularMomentum(impulse, angle, rate, largest, drift)


def spinning(body: ReducedBody, dynamics: Dynamics) -> Spinning | None:
    """How a body turns as a whole under a formulation; None where it does not, or its mass knows.

    Parameters
    ----------
    body : ReducedBody
    dynamics : Dynamics

    Returns
    -------
    Spinning or None
    """
    if not body.rigid_count or not dynamics.tree.frame_count or dynamics.inertia is not None:
        return None
    # Every frame turns alike in rigid motions.
    rotation = np.ascontiguousarray(body.frame_rotation[0][:, : body.rigid_count])
    # Rigid motions are mass-orthonormal.
    inverse = rotation @ rotation.T
    values = np.linalg.eigvalsh(inverse)
    if values[-1] <= 0.0:
        return None
    inertia = np.linalg.inv(inverse) if values[0] > _HELD * values[-1] else None
    return Spinning(rotation, inertia, float(body.angular_frequency[body.rigid_count]))
