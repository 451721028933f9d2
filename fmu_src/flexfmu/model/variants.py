"""Which methods a body has the data for, which one it is used with, and interfaces of a free body that a scene fixes.

A Craig-Bampton basis holds the constraint modes of every interface, so that what is left once G_i q = 0 is the same
body with the interface as its support: q = N z with N the null space of G_i, and the small eigenproblem makes N
mass-orthonormal modes again.

Frames of a body hang together as its method has it: as a tree, each by itself, or one for all. The tree is this
project's; frames by themselves, each about its own joint's linear displacement, are the sub-domains of the method's
source; one for all is a floating frame of reference.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from ..files.basics import FloatArray, OptionError
from .arrays import ARRAYS, SECOND_BITS, is_single, short, turned
from .inertia import without_frames
from .methods import Data, FrameLayout, Mass, Method, Variant, has_frames, masses_of, named, needs, recipe_of
from .reduced_body import GROUND, ReducedBody, SecondOrder, Shadow, Surface
from .rotations import from_ground, skew


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
    usual = Method.LINEAR if has_frames(body.method) and not body.frame_count else body.method
    one = usual if method is None else named(Method, method)
    own = body.mass if body.mass in masses_of(one) else Mass.CONSTANT
    found = Variant(one, own if mass is None else named(Mass, mass))
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
        if data in needs(method, mass) and getattr(body, data.attribute) is None:
            return f"{data.key} in [reduction]"
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
    unneeded: dict[str, Any] = {data.attribute: None for data in set(Data) - needed}
    if Data.SECOND_ORDER not in needed:
        unneeded["membrane"] = None
    return replace(body, method=variant.method, mass=variant.mass, **unneeded)


def shortened(body: ReducedBody) -> ReducedBody:
    """The body, and its shadow, with numbers of second order that pack well; those of parts say by what they bend."""
    shadow, second = body.shadow, body.second
    if shadow is not None:
        shadow = replace(shadow, body=shortened(shadow.body))
    if second is not None and body.ties is None:
        both = second.displacement, second.rotation
        second = SecondOrder(*(short(one, body.angular_frequency, SECOND_BITS[is_single(one)]) for one in both))
    return replace(body, shadow=shadow, second=second)


# Relative size of a singular value below which a motion is not held.
_FREE = 1e-9


def with_fixed_interfaces(body: ReducedBody, names: Collection[str], method: Method) -> ReducedBody:
    """Fix interfaces of a free body.

    Parameters
    ----------
    body : ReducedBody
    names : collection of str
        None to leave the body as it is.
    method : Method
        What the body will be used with.

    Returns
    -------
    ReducedBody
        With six modes less an interface, and without the floating frame.

    Raises
    ------
    OptionError
        The body has supports, no such interface, or frames that hang on another one.
    """
    if not names:
        return body
    _check_names(body, names, method)
    turn, squares = _remaining_modes(_motions(body, names), body.angular_frequency)
    # Each ratio by its share of the strain energy: one ratio for all modes stays what it is.
    share = turn**2 * body.angular_frequency[:, None] ** 2 / squares
    gone, found = int(body.floating), turned_parts(body, turn)
    for name in (entry.name for entry in ARRAYS["body"] if entry.shape.split()[0] == "S"):
        found[name] = found.get(name, getattr(body, name))[gone:]
    found["frame_parent"] = np.maximum(found["frame_parent"] - gone, GROUND)
    found |= _parts_fixed(body, found, turn) | {"polynomial": None}
    return replace(
        body, angular_frequency=np.sqrt(squares), damping_ratio=share.T @ body.damping_ratio, frequency_spread=None,
        interface_frame=np.maximum(body.interface_frame - gone, GROUND), root_interface=GROUND, floating=False,
        watched_frame=None if body.watched_frame is None else np.maximum(body.watched_frame - gone, GROUND),
        membrane=body.membrane and body.membrane.turned(turn, squares),
        shadow=_shadow_fixed(body, names, turn),
        **found,
    )  # fmt: skip


def turned_parts(body: ReducedBody, turn: FloatArray) -> dict[str, Any]:
    """Arrays and parts of a body in coordinates z with q = turn @ z, but frequencies, membrane and shadow, by name."""
    found = turned(body, [entry for entry in ARRAYS["body"] if entry.shape != "m"], turn)
    for name in ("whole", "masses", "ties", "inertia", "polynomial", "second"):
        part = getattr(body, name)
        found[name] = part and replace(part, **turned(part, ARRAYS[name], turn))
    found["stress_sets"] = tuple(replace(part, **turned(part, ARRAYS["stress"], turn)) for part in body.stress_sets)
    return found | {"surface": body.surface and body.surface.in_coordinates(turn)}


def _motions(body: ReducedBody, names: Collection[str]) -> FloatArray:
    """Displacements and rotations (6k, m) of interfaces."""
    held = [body.interface_names.index(name) for name in names]
    result: FloatArray = np.concatenate([body.interface_displacement[held], body.interface_rotation[held]])
    return result.reshape(6 * len(held), -1)


def _shadow_fixed(body: ReducedBody, names: Collection[str], turn: FloatArray) -> Shadow | None:
    """The shadow with its root interface fixed; frames hang on no other one."""
    shadow = body.shadow
    if shadow is None or set(names) != {body.interface_names[body.root_interface]}:
        return None
    finer = shadow.body
    own, _ = _remaining_modes(_motions(finer, names), finer.angular_frequency)
    return Shadow(with_fixed_interfaces(finer, names, Method.SECOND_ORDER), own.T @ shadow.embedding @ turn)


def _check_names(body: ReducedBody, names: Collection[str], method: Method) -> None:
    """Refuse interfaces that cannot be fixed."""
    if body.root_interface == GROUND:
        raise OptionError(
            f"interface {min(names)!r} cannot be fixed: only a free body with a Craig-Bampton basis lets the scene fix "
            'interfaces; build it with free = true and basis = "craig_bampton"'
        )
    root = body.interface_names[body.root_interface]
    if has_frames(method) and set(names) != {root}:
        found = f"fixed interfaces are {', '.join(sorted(names))}, but frames hang on {root!r}: expected that one alone"
        raise OptionError(f'{found}; set root in the body file, or take method "linear"')


def _parts_fixed(body: ReducedBody, found: dict[str, Any], turn: FloatArray) -> dict[str, Any]:
    """Those of the turned parts that frames carry or that move at second order, without the floating frame."""
    gone, masses, inertia = int(body.floating), found["masses"], found["inertia"]
    second, curvature = (None, None) if body.second is None else _second_fixed(body, body.second, turn)
    return {
        "masses": masses and replace(masses, frame=np.maximum(masses.frame - gone, GROUND)),
        "surface": body.surface and _surface_fixed(body, body.surface, turn, gone),
        "inertia": inertia and without_frames(replace(inertia, curvature=curvature), gone),
        "second": second,
    }


def _second_fixed(body: ReducedBody, second: SecondOrder, turn: FloatArray) -> tuple[SecondOrder, FloatArray | None]:
    """The same motions moved as one so that the root interface stays where it is, seen from the ground, and lumps'."""
    gone, root = int(body.floating), body.frame_count + body.root_interface
    lumps = None if body.inertia is None else body.inertia.curvature
    points = [part for part in (body.masses, None if lumps is None else body.inertia) if part is not None]
    moved = [body.joint_displacement, body.interface_displacement, *(part.displacement for part in points)]
    angles = [body.frame_rotation, body.interface_rotation, *(np.zeros_like(part.displacement) for part in points)]
    places = np.concatenate([body.joint_point, body.interface_point, *(part.point for part in points)])
    arm = places - body.interface_point[body.root_interface]
    given = second.displacement, second.rotation
    if lumps is not None:
        given = np.concatenate([given[0], lumps]), np.concatenate([given[1], np.zeros_like(lumps)])
    displacement, rotation = (np.einsum("kiab,ac,bd->kicd", part, turn, turn, optimize=True) for part in given)
    displacement = displacement - displacement[root] + np.einsum("kij,jab->kiab", skew(arm), rotation[root])
    rotation = rotation - rotation[root]
    if body.floating:
        reference = body.frame_rotation[0] @ turn
        change = np.concatenate(moved) @ turn + skew(arm) @ reference
        turns = np.concatenate(angles) @ turn
        displacement, rotation = from_ground((displacement, rotation), reference, arm, change, turns)
    nodes = len(second.displacement)
    return SecondOrder(displacement[gone:nodes], rotation[gone:nodes]), None if lumps is None else displacement[nodes:]


def _surface_fixed(body: ReducedBody, surface: Surface, turn: FloatArray, gone: int) -> Surface:
    """The surface in the coordinates that are left, moved at second order as the nodes of the tree are."""
    found = replace(surface.in_coordinates(turn), frame=np.maximum(surface.frame - gone, GROUND))
    if surface.second is None or surface.form is None or body.second is None:
        return found
    root, pivot = body.frame_count + body.root_interface, body.interface_point[body.root_interface]
    own = np.concatenate([surface.form, -body.second.displacement[root], body.second.rotation[root]])
    count = len(surface.points)
    moved = np.broadcast_to(np.eye(3), (count, 3, 3))
    return replace(
        found,
        second=np.concatenate([surface.second, moved, skew(surface.points - pivot)], axis=2),
        form=np.einsum("rab,ac,bd->rcd", own, turn, turn, optimize=True),
        turn=body.frame_rotation[:1] @ turn if body.floating else None,
        pivot=pivot[None] if body.floating else None,
        piece=np.zeros(count, dtype=np.int64) if body.floating else None,
    )


def _remaining_modes(held: FloatArray, angular_frequency: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Modes (m, m - h) that leave the rows (h, m) at zero, orthonormal, and their squared frequencies."""
    count = held.shape[0]
    if count >= angular_frequency.size:
        raise OptionError(f"fixing {count} coordinates leaves none of the body's {angular_frequency.size} modes")
    size = np.linalg.norm(held, axis=1, keepdims=True)
    _, values, turn = np.linalg.svd(held / np.where(size > 0.0, size, 1.0))
    if values[-1] < _FREE * values[0]:
        raise OptionError("the interfaces to be fixed depend on each other; fix fewer of them")
    turn = turn[count:].T
    squares, small = np.linalg.eigh(turn.T @ (angular_frequency[:, None] ** 2 * turn))
    if squares[0] <= 0.0:
        raise OptionError("the body can still move freely with these interfaces fixed; fix one more")
    return turn @ small, squares


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
    names, found = [entry.name for entry in ARRAYS["whole"]], dict[str, Any]()
    if body.floating:
        found |= {name: getattr(body, name)[:1] for name in names}
    elif body.whole is None:
        raise OptionError("the method needs the whole body's frame, which this modal file does not hold")
    else:
        found |= {name: getattr(body.whole, name)[None] for name in names}
    for name in ("masses", "surface"):
        part = getattr(body, name)
        found[name] = part and replace(part, frame=np.zeros_like(part.frame))
    return replace(
        body,
        frame_names=(body.frame_names[0] if body.floating else "whole",),
        frame_parent=np.array([GROUND]),
        interface_frame=np.zeros_like(body.interface_frame),
        inertia=None,
        second=None,
        membrane=None,
        **found,
    )
