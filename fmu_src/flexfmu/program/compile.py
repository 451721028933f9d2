"""A reduced body under one method as a program: all that does not depend on inputs, found once."""

from dataclasses import replace

import numpy as np

from ..files.array_types import FloatArray
from ..model.errors import ModalFileError, OptionError
from ..model.methods import ASKED_BY, Data, Kinematics, LoadPlacement, Mass, Method, Recipe, Stiffness, recipe_of
from ..model.reduced_body import ReducedBody
from .draft import Draft
from .mechanics import PLACEMENT, mechanics
from .second_opinion import in_load_order, second_opinion, unit_load_tangents


def compile_draft(body: ReducedBody, method: Method, mass: Mass = Mass.CONSTANT) -> Draft:
    """Program of a body under a method, without what the FMI layer needs besides.

    Parameters
    ----------
    body : ReducedBody
        Its frames divided as the method has them, its interfaces fixed as the scene does.
    method : Method
    mass : Mass

    Returns
    -------
    Draft

    Raises
    ------
    OptionError
        The method needs data that the body was built without.
    ModalFileError
        The body's numbers are finite, but what follows from them is not.
    """
    try:
        return _draft(body, recipe_of(method), mass)
    except np.linalg.LinAlgError as error:
        raise ModalFileError(
            f"body '{body.name}': its numbers go beyond the arithmetic in method '{method.value}' ({error}); "
            "build it again"
        ) from error


def shadow_draft(body: ReducedBody) -> Draft:
    """Program of a body's shadow.

    Parameters
    ----------
    body : ReducedBody
        With a shadow.

    Returns
    -------
    Draft
    """
    shadow = body.shadow
    if shadow is None:
        raise OptionError("the body was built without what tells its error: build it with error = true in [output]")
    draft = compile_draft(replace(shadow.body, following_interfaces=body.following_interfaces), Method.SECOND_ORDER)
    # As `Shadow` has what it is made of.
    draft.arrays["curvature"] = np.asarray(draft.arrays["curvature"], np.float32)
    draft.sizes["embedded"] = body.mode_count
    draft.arrays["embedding"] = shadow.embedding
    return draft


def _draft(body: ReducedBody, recipe: Recipe, mass: Mass) -> Draft:
    draft = mechanics(body, recipe, mass)
    if recipe.stiffness is Stiffness.BY_MODE:
        draft.sizes["by_mode_given"] = 1
        draft.arrays["by_mode"] = _given(body.stiffness_by_mode, Data.BY_MODE)
    if recipe.stiffness is Stiffness.BY_LOAD:
        # What moving loads do at first order by themselves *is* part of it: taken out, nothing counts twice.
        data = in_load_order(_given(body.stiffness_by_load, Data.BY_LOAD), body.interface_count)
        by_load = data - unit_load_tangents(draft, body)
        draft.sizes["by_load_given"] = 1
        draft.arrays["by_load"] = by_load
    elif body.ties is None and recipe.kinematics is not Kinematics.SECOND_ORDER:
        second_opinion(draft, body, recipe)
    if recipe.loads is LoadPlacement.DEFORMED and body.following_interfaces:
        # Only now: what has been found above is of loads of fixed direction.
        following = [body.interface_names.index(name) for name in body.following_interfaces]
        draft.sizes["placement"] = PLACEMENT[LoadPlacement.DEFORMED]
        draft.arrays["follower"] = np.array(following, dtype=np.int64)
    return draft


def compile_program(body: ReducedBody, method: Method, mass: Mass = Mass.CONSTANT) -> bytes:
    """The same as an image."""
    return compile_draft(body, method, mass).image()


def _given(values: FloatArray | None, data: Data) -> FloatArray:
    if values is None:
        raise OptionError(
            f"the method needs data that this body was built without: build it with {ASKED_BY[data]} in [reduction]"
        )
    return values
