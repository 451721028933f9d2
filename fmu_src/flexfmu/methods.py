"""The methods: what a user chooses, what each is made of, which data it needs, and whether a body has them."""

from enum import Enum

from .model.reduced_body import (
    Division,
    Formulation,
    Kinematics,
    LoadPlacement,
    Mass,
    ReducedBody,
    Stiffness,
)


class Method(Enum):
    """How a body's motion follows from its modes; one row each of docs/methods.md."""

    LINEAR = "linear"
    """Modal superposition, equation (1)."""
    STIFFNESS_BY_LOAD = "stiffness_by_load"
    """Modal superposition with the geometric stiffness of each load's linear stress (the source's section 3)."""
    STIFFNESS_BY_MODE = "stiffness_by_mode"
    """The same with that of each mode's."""
    MODAL_ROTATION = "modal_rotation"
    """The source's section 4 as printed: displacements of each sub-domain by itself turned by its averaged rotation, and
    the moment (3) of displaced forces."""
    HALF_ROTATION = "half_rotation"
    """The same turned by half the rotation, onto the chord of the arc, in a tree."""
    FLOATING_FRAME = "floating_frame"
    """One frame for the whole body, loads on the deformed body."""
    FRAMES = "frames"
    """A tree of frames, loads on the deformed body."""
    FRAMES_STIFFNESS = "frames_stiffness"
    """The same with the geometric stiffness of each load that frames leave out."""
    SECOND_ORDER = "second_order"
    """A tree of frames, and what motions within frames lack at second order."""


_FORMULATION = {
    Method.LINEAR: Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE),
    Method.STIFFNESS_BY_LOAD: Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_LOAD),
    Method.STIFFNESS_BY_MODE: Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_MODE),
    Method.MODAL_ROTATION: Formulation(Kinematics.LITERAL, LoadPlacement.CORRECTIVE_MOMENT, division=Division.SEPARATE),
    Method.HALF_ROTATION: Formulation(Kinematics.SECANT, LoadPlacement.CORRECTIVE_MOMENT),
    Method.FLOATING_FRAME: Formulation(Kinematics.COROTATED, LoadPlacement.DEFORMED, division=Division.ONE),
    Method.FRAMES: Formulation(Kinematics.COROTATED, LoadPlacement.DEFORMED),
    Method.FRAMES_STIFFNESS: Formulation(Kinematics.COROTATED, LoadPlacement.DEFORMED, Stiffness.BY_LOAD),
    Method.SECOND_ORDER: Formulation(Kinematics.SECOND_ORDER, LoadPlacement.DEFORMED),
}


def formulation_of(method: Method, mass: Mass = Mass.CONSTANT) -> Formulation:
    """What a method is made of.

    Parameters
    ----------
    method : Method
    mass : Mass
        Of the tree of frames only.

    Returns
    -------
    Formulation

    Raises
    ------
    OptionError
        The deformed body's mass with a method that does not know it.
    """
    plain = _FORMULATION[method]
    return Formulation(plain.kinematics, plain.loads, plain.stiffness, mass, plain.division)


def method_of(formulation: Formulation) -> Method | None:
    """The method that a formulation is, its mass aside; None where it has no name."""
    plain = (formulation.kinematics, formulation.loads, formulation.stiffness, formulation.division)
    for method, row in _FORMULATION.items():
        if plain == (row.kinematics, row.loads, row.stiffness, row.division):
            return method
    return None


def missing(body: ReducedBody, method: Method) -> str | None:
    """What of a body a method lacks, in words that say how to build it; None where it has all.

    Parameters
    ----------
    body : ReducedBody
    method : Method

    Returns
    -------
    str or None
    """
    row = _FORMULATION[method]
    if row.stiffness is Stiffness.BY_LOAD and body.stiffness_by_load is None:
        return 'geometric_stiffness = ["by_load"] in [reduction]'
    if row.stiffness is Stiffness.BY_MODE and body.stiffness_by_mode is None:
        return 'geometric_stiffness = ["by_mode"] in [reduction]'
    if row.kinematics is Kinematics.SECOND_ORDER and body.second is None:
        return "second_order = true in [reduction]"
    if row.kinematics is not Kinematics.LINEAR and not body.frame_count:
        return "frames"
    if row.division is Division.ONE and body.ties is not None:
        return "a body in one piece, without [[cut]]"
    if row.division is Division.ONE and body.frame_count > 1 and body.whole is None and not body.floating:
        return "the frame of the whole body, which bodies of several frames hold"
    return None


def offered(body: ReducedBody) -> tuple[Method, ...]:
    """The methods for which a body has all the data, in their order."""
    return tuple(method for method in Method if missing(body, method) is None)
