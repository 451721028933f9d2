"""How the frames of a body hang together, chosen when it is set up: as a tree, each by itself, or one for all.

The tree is this project's; frames by themselves, each about its own joint's linear displacement, are the sub-domains of
the method's source; one for all is a floating frame of reference.
"""

from dataclasses import replace

import numpy as np

from .errors import OptionError
from .methods import FrameLayout, Method, recipe_of
from .reduced_body import GROUND, ReducedBody, WholeFrame


def with_frame_layout(body: ReducedBody, method: Method) -> ReducedBody:
    """The body with its frames as a method has them.

    Parameters
    ----------
    body : ReducedBody
    method : Method

    Returns
    -------
    ReducedBody

    Raises
    ------
    OptionError
        The body does not hold the frame of the whole.
    """
    layout = recipe_of(method).layout
    # A floating frame counts: the method has it alone.
    if layout is FrameLayout.TREE or body.frame_count < 2:
        return body
    if layout is FrameLayout.SEPARATE:
        # Of a free body all frames hang on the floating one.
        parent = np.full(body.frame_count, 0 if body.floating else GROUND)
        if body.floating:
            parent[0] = GROUND
        return replace(body, frame_parent=parent)
    return _as_one(body)


def _as_one(body: ReducedBody) -> ReducedBody:
    """The body on one frame: its floating frame, or that of the whole body about its supports."""
    name, whole = "whole", body.whole
    if body.floating:
        name = body.frame_names[0]
        whole = WholeFrame(
            body.joint_point[0], body.joint_displacement[0], body.joint_rotation[0], body.frame_rotation[0]
        )
    if whole is None:
        raise OptionError("the method needs the whole body's frame, which this modal file does not hold")
    masses, surface = body.masses, body.surface
    if masses is not None:
        masses = replace(masses, frame=np.zeros_like(masses.frame))
    if surface is not None:
        surface = replace(surface, frame=np.zeros_like(surface.frame))
    return replace(
        body,
        frame_names=(name,),
        frame_parent=np.array([GROUND]),
        joint_point=whole.joint_point[None],
        joint_displacement=whole.joint_displacement[None],
        joint_rotation=whole.joint_rotation[None],
        frame_rotation=whole.frame_rotation[None],
        interface_frame=np.zeros_like(body.interface_frame),
        masses=masses,
        surface=surface,
        inertia=None,
        second=None,
        membrane=None,
    )
