"""What places of a body's surface follow from, for the core (core/surface.c), and the surface's stress."""

import numpy as np

from ..files.basics import FloatArray, IntArray, OptionError
from ..model.methods import Kinematics, Method, recipe_of
from ..model.reduced_body import ReducedBody, Surface


def surface_of(model: ReducedBody) -> Surface:
    """The body's surface; OptionError where it was built without."""
    if model.surface is None:
        raise OptionError("the body holds no surface: build it with surface = true in [output], which is the default")
    return model.surface


def surface_data(model: ReducedBody, method: Method) -> tuple[IntArray, IntArray, FloatArray]:
    """What the core makes places of the surface's points from: sizes, `on` and numbers as of core/surface.h.

    Raises
    ------
    OptionError
        The body was built without its surface.
    """
    surface = surface_of(model)
    kinematics, numbers = recipe_of(method).kinematics, [surface.points, surface.modes]
    forms = pieces = 0
    if kinematics is Kinematics.SECOND_ORDER and surface.second is not None and surface.form is not None:
        forms = len(surface.form)
        numbers += [surface.second, surface.form]
        if surface.turn is not None and surface.pivot is not None:
            pieces = len(surface.turn)
            numbers += [surface.turn, surface.pivot]
    numbers.append(np.concatenate([model.joint_displacement, model.frame_rotation], axis=1))
    if kinematics is Kinematics.SECOND_ORDER and model.second is not None:
        second = model.second.displacement, model.second.rotation
        numbers.append(np.concatenate([part[: model.frame_count] for part in second], axis=1))
    on = [surface.frame] if surface.piece is None else [surface.frame, surface.piece]
    sizes = np.array([list(Kinematics).index(kinematics), len(surface.points), forms, pieces, model.floating])
    return sizes, np.concatenate(on), np.concatenate([np.ravel(part) for part in numbers])


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
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (xy**2 + yz**2 + zx**2))
