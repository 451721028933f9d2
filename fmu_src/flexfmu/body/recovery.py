"""Where the points of a body's surface are, and their stress, by the kinematics of the method itself.

A point is carried as any node of the tree is (docs/theory.md, sections 4, 4a and 4b): its offset in its frame is that
of (6), with the second-order part (19) where the method has one.
"""

import numpy as np

from ..core.library import Core
from ..files.array_types import BoolArray, FloatArray, IntArray
from ..model.errors import OptionError
from ..model.methods import Kinematics, Method, recipe_of
from ..model.reduced_body import ReducedBody, Surface
from ..model.rotations import cross

LACKS_SURFACE = "the body holds no surface: build it with surface = true in [output], which is the default"


def surface_of(model: ReducedBody) -> Surface:
    """The body's surface; OptionError where it was built without."""
    if model.surface is None:
        raise OptionError(LACKS_SURFACE)
    return model.surface


def surface_places(model: ReducedBody, method: Method, core: Core, q: FloatArray) -> FloatArray:
    """Where the surface's points are.

    Parameters
    ----------
    model : ReducedBody
    method : Method
    core : Core
        Running the model under the method.
    q : (m,) float
        Modal coordinates, kg^1/2 m.

    Returns
    -------
    (n_points, 3) float
        m, global frame.

    Raises
    ------
    OptionError
        The body was built without its surface.
    """
    surface = surface_of(model)
    kinematics = recipe_of(method).kinematics
    moved: FloatArray = surface.points + surface.modes @ q
    if kinematics is Kinematics.LINEAR or core.frames == 0:
        return moved
    position, rotation = core.nodes_at(q)
    on = surface.frame >= 0
    s = surface.frame[on]
    joint = model.joint_point[s]
    change = surface.modes[on] @ q - (model.joint_displacement @ q)[s]
    if kinematics in (Kinematics.LITERAL, Kinematics.SECANT):
        # Only displacements turn.
        moved[on] = surface.points[on] + position[s] - joint + _applied(rotation[s], change)
        return moved
    arm = surface.points[on] - joint
    local = arm + change - cross((model.frame_rotation @ q)[s], arm)
    if kinematics is Kinematics.SECOND_ORDER:
        local += _second_order(model, q, on, s, arm, local - arm)
        if not on.all():
            moved[~on] += _from_ground(model, q)[~on]
    moved[on] = position[s] + _applied(rotation[s], local)
    return moved


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return (matrices @ vectors[:, :, None])[:, :, 0]


def _from_ground(model: ReducedBody, q: FloatArray) -> FloatArray:
    """½ w of each point, (n, 3), seen as the tree's nodes are: from the ground, or from the floating frame."""
    surface = surface_of(model)
    if surface.second is None or surface.form is None:
        return np.zeros_like(surface.points)
    half: FloatArray = surface.second @ (0.5 * np.einsum("rab,a,b->r", surface.form, q, q))
    half += surface.modes @ _taken(model, q)
    if surface.turn is None or surface.pivot is None or surface.piece is None:
        return half
    turn, arm = (surface.turn @ q)[surface.piece], surface.points - surface.pivot[surface.piece]
    change = surface.modes @ q - cross(turn, arm)
    return half + cross(turn, change + 0.5 * cross(turn, arm))


def _taken(model: ReducedBody, q: FloatArray) -> FloatArray:
    """Modal coordinates (m,) of the part of w that coordinates hold already (section 4c)."""
    return np.zeros_like(q) if model.membrane is None else model.membrane.taken(model.angular_frequency**2, q)


def _second_order(
    model: ReducedBody, q: FloatArray, on: BoolArray, s: IntArray, arm: FloatArray, change: FloatArray
) -> FloatArray:
    """What (19) adds to the offsets of carried points, (k, 3)."""
    if model.second is None:
        return np.zeros_like(arm)
    taken = _taken(model, q)
    parts = (model.second.displacement, model.joint_displacement), (model.second.rotation, model.frame_rotation)
    parent, turned = (
        0.5 * np.einsum("kiab,a,b->ki", part[: model.frame_count], q, q) + linear @ taken for part, linear in parts
    )
    turn = (model.frame_rotation @ q)[s]
    if model.floating:
        turn = turn - model.frame_rotation[0] @ q
    own = _from_ground(model, q)[on]
    return own - parent[s] - cross(turned[s], arm) - cross(turn, change + 0.5 * cross(turn, arm))


def surface_von_mises(model: ReducedBody, q: FloatArray) -> FloatArray:
    """Von Mises stress at the surface's points, (n_points,), N/m².

    Raises
    ------
    OptionError
        The body was built without the stress of its surface.
    """
    surface = surface_of(model)
    if surface.stress is None:
        raise OptionError("the body was built without the stress of its surface: set stress = true in [output]")
    xx, yy, zz, xy, yz, zx = np.moveaxis(surface.stress @ q, 1, 0)
    shear = xy**2 + yz**2 + zx**2
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * shear)
