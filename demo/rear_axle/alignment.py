"""Toe, camber and travel of a wheel, from the motion of its flange.

Axes as in `make_mesh`: x to the rear, y to the right, z up; the road is the plane z = const. The wheel's plane is
normal to its spin axis, which points outboard, along ∓y on the undeformed axle, and turns with the flange by the finite
rotation of the rotation vector. The definitions are those of ISO 8855:

- **Toe**: angle between the vehicle's longitudinal axis and the line in which the wheel's plane meets the road.
  Positive is toe-in: the wheel's front edge is nearer to the middle of the vehicle than its rear edge.
- **Camber**: inclination of the wheel's plane against the road's normal. Positive is top outboard.
- **Travel**: rise of the wheel's centre. Positive is bump, the wheel up.

With the axle's one pair of wheels *static* angles are zero: everything is the change from the undeformed axle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]

# Sign of y on the side of each wheel.
LEFT, RIGHT = -1.0, 1.0


@dataclass(frozen=True, slots=True)
class Alignment:
    """Alignment of one wheel at n loads.

    Attributes
    ----------
    toe, camber : ndarray, shape (n,)
        Degrees.
    travel : ndarray, shape (n,)
        m.
    """

    toe: FloatArray
    camber: FloatArray
    travel: FloatArray


def alignment(displacement: FloatArray, rotation: FloatArray, side: float) -> Alignment:
    """Alignment of a wheel.

    Parameters
    ----------
    displacement, rotation : ndarray, shape (n, 3)
        Of the flange: displacement of its centre, m, and rotation vector, rad, global axes.
    side : float
        `LEFT` or `RIGHT`.
    """
    axis = Rotation.from_rotvec(rotation).apply([0.0, side, 0.0])
    # Toe-in turns the outboard end of the spin axis to the front, where x is negative.
    toe = np.degrees(np.arctan2(-axis[:, 0], side * axis[:, 1]))
    camber = np.degrees(np.arcsin(np.clip(-axis[:, 2], -1.0, 1.0)))
    return Alignment(toe=toe, camber=camber, travel=displacement[:, 2])


def arm_angle(rotation: FloatArray) -> FloatArray:
    """Angle by which an arm has swung up, degrees, shape (n,), from the rotation vectors (n, 3) of its flange.

    The angle of the flange's longitudinal direction, which points to the rear along the arm, above the road.
    """
    direction = Rotation.from_rotvec(rotation).apply([1.0, 0.0, 0.0])
    return np.degrees(np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)))
