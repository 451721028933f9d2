"""Which methods a body has the data for, which one it is used with, and what it then holds in vain."""

from dataclasses import replace
from typing import Any

from ..files.basics import OptionError
from .methods import ASKED_BY, Data, FrameLayout, Mass, Method, Variant, has_frames, masses_of, named, needs, recipe_of
from .reduced_body import ReducedBody


def chosen(body: ReducedBody, method: Method | str | None = None, mass: Mass | str | None = None) -> Variant:
    """The method and the mass that a body is used with.

    Parameters
    ----------
    body : ReducedBody
    method : Method or str, optional
        Default: the one that the body was built with; linear where it has no frames for it.
    mass : Mass or str, optional
        Default: the body's own, where the method knows it.

    Returns
    -------
    Variant

    Raises
    ------
    OptionError
        No such method or mass, a mass that the method does not know, or data that the body was built without.
    """
    if method is None:
        one = Method.LINEAR if has_frames(body.method) and not body.frame_count else body.method
    else:
        one = named(Method, method)
    if mass is not None:
        found = Variant(one, named(Mass, mass))
    else:
        found = Variant(one, body.mass if body.mass in masses_of(one) else Mass.CONSTANT)
    lack = missing(body, found.method, found.mass)
    if lack is not None:
        raise OptionError(f'method "{found.words}" needs {lack}, and body {body.name!r} was built without')
    return found


def missing(body: ReducedBody, method: Method, mass: Mass = Mass.CONSTANT) -> str | None:
    """What of a body a method lacks, in words that say how to build it; None where it has all.

    Parameters
    ----------
    body : ReducedBody
    method : Method
    mass : Mass

    Returns
    -------
    str or None
    """
    layout = recipe_of(method).layout
    for data in Data:
        if data in needs(method, mass) and getattr(body, data.value) is None:
            return f"{ASKED_BY[data]} in [reduction]"
    if mass is Mass.POLYNOMIAL and (body.polynomial is None or body.ties is not None):
        return "the polynomial, which bodies from a mesh hold that are in one piece, and held or free to turn"
    if has_frames(method) and not body.frame_count:
        return "frames"
    if layout is FrameLayout.ONE and body.ties is not None:
        return "a body in one piece, without [[cut]]"
    if layout is FrameLayout.ONE and body.frame_count > 1 and body.whole is None and not body.floating:
        return "the frame of the whole body, which bodies of several frames hold"
    return None


def offered(body: ReducedBody) -> tuple[Method, ...]:
    """The methods for which a body has all the data, in their order."""
    return tuple(method for method in Method if missing(body, method) is None)


def offered_variants(body: ReducedBody) -> tuple[Variant, ...]:
    """The same with every mass for which it has the data."""
    variants = (Variant(method, mass) for method in offered(body) for mass in masses_of(method))
    return tuple(variant for variant in variants if missing(body, variant.method, variant.mass) is None)


def lean(body: ReducedBody, variant: Variant) -> ReducedBody:
    """The body for a method alone, without data that only others need."""
    needed = needs(variant.method, variant.mass)
    unneeded: dict[str, Any] = {data.value: None for data in set(Data) - needed}
    if Data.SECOND_ORDER not in needed:
        unneeded["membrane"] = None
    return replace(body, method=variant.method, mass=variant.mass, **unneeded)
