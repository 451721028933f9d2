"""A reduced body under one method as a program, and the programs that an FMU carries, one for each of its methods.

All that does not depend on inputs is found once. With it goes a second opinion on what loads do to the stiffness, by
the best that it holds (docs/theory.md, section 7).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from ..core.interface import DESCRIPTION, shared, symbols
from ..core.library import Core
from ..files.basics import FloatArray, ModalFileError, OptionError
from ..model.arrays import triangles
from ..model.methods import Kinematics, LoadPlacement, Mass, Method, Recipe, Stiffness, has_frames, masses_of, recipe_of
from ..model.reduced_body import GROUND, ReducedBody
from ..model.variants import chosen, offered, with_fixed_interfaces, with_frame_layout
from .mechanics import PLACEMENT, Draft, advice, mechanics, texts
from .variable_table import Variable, variable_table

# Times 1/n²: what n frames in a chain overestimate a cantilever's critical load by (section 4b: 0.223, 0.056, 0.016 for
# 1, 2, 4).
_CHAIN = 0.25
# Critical load of the clamped column over what the moment u × F alone makes of it.
_MOMENT = 8.0 / np.pi**2
# Bits of its numbers, of each load's largest, none of which fills them with the margin: a few percent need no more.
_BITS, _MARGIN = 15, 1.0001
_BY_LOAD, _BY_SECOND_ORDER = "geometric stiffness by load", "the frames to second order"


def in_load_order(by_load: FloatArray, interfaces: int) -> FloatArray:
    """Matrices (L, m, m) of forces of all interfaces, then moments, as force and moment of each interface in turn."""
    wrenches = by_load[: 6 * interfaces].reshape(2, interfaces, 3, *by_load.shape[1:])
    ordered = np.moveaxis(wrenches, 0, 1).reshape(6 * interfaces, *by_load.shape[1:])
    return np.concatenate([ordered, by_load[6 * interfaces :]])


def unit_load_tangents(draft: Draft, body: ReducedBody) -> FloatArray:
    """What each unit load adds to the tangent stiffness of the undeformed body, (L, m, m)."""
    core, still = Core(draft.image()), np.zeros(body.mode_count)
    loads = np.eye(draft.sizes["loads"])
    return np.array([core.tangent(load, still) for load in loads]) - np.diag(body.angular_frequency**2)


def _interface_loads(draft: Draft, body: ReducedBody, elastic: slice) -> tuple[FloatArray, FloatArray]:
    """Modal forces (L, e) of unit loads over ω, and what makes loads comparable."""
    omega, interfaces = body.angular_frequency[elastic], body.interface_count
    displacement = body.interface_displacement[..., elastic] / omega
    rotation = body.interface_rotation[..., elastic] / omega
    # Displacement over rotation under loads of all directions.
    moved, turned = (np.linalg.norm(operator, axis=(1, 2)) for operator in (displacement, rotation))
    length = np.where((moved > 0.0) & (turned > 0.0), moved / np.where(turned > 0.0, turned, 1.0), 1.0)
    force = np.concatenate([displacement, rotation], axis=1).reshape(6 * interfaces, -1)
    size = np.concatenate([np.ones((interfaces, 3)), np.repeat(1.0 / length[:, None], 3, axis=1)], axis=1).ravel()
    if body.masses is not None:
        force = np.concatenate([force, np.asarray(draft.arrays["inertia_operator"])[:, elastic] / omega])
        size = np.concatenate([size, np.full(3, float(np.sum(body.masses.mass)))])
    return force, size


def _against_missed(body: ReducedBody, recipe: Recipe, source: str) -> str:
    """What to do about stiffness that is missed."""
    linear = recipe.kinematics is Kinematics.LINEAR
    by_load = "stiffness_by_load" if linear else "frames_stiffness"
    if source == _BY_SECOND_ORDER:
        return 'take method = "second_order"'
    if source == _BY_LOAD:
        return f'take method = "{by_load}"'
    stored = f'geometric_stiffness = ["by_load"] and take method = "{by_load}"'
    if linear and body.frame_count > 1:
        return f'take method = "frames", or build with {stored}'
    return f"build with more frames, or with {stored}"


def in_units(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrices (…, m, m) as whole numbers of 16 bits, and the unit of each."""
    unit = np.ldexp(1.0, np.frexp(_MARGIN * np.abs(matrices).max(axis=(-2, -1)))[1] - _BITS)
    return np.rint(matrices / unit[..., None, None]), unit


def second_opinion(draft: Draft, body: ReducedBody, recipe: Recipe) -> None:
    """A second opinion on the tangent stiffness, by the best that the body holds (section 7)."""
    own = unit_load_tangents(draft, body)
    if recipe.stiffness is Stiffness.BY_MODE:
        own = own + _by_mode(draft, body)
    depth = _depth(body)
    if body.second is not None and body.frame_count:
        # Without membrane energy, whose coordinates are others: what loads do at first order is the same.
        plain = mechanics(replace(body, membrane=None), recipe_of(Method.SECOND_ORDER))
        source, change = _BY_SECOND_ORDER, unit_load_tangents(plain, body)
    elif body.stiffness_by_load is not None:
        source = _BY_LOAD
        change = in_load_order(np.asarray(body.stiffness_by_load), body.interface_count)
    elif depth:
        framed = recipe_of(Method.FRAMES)
        source = "the frames"
        change = (1.0 + _CHAIN / depth**2) * unit_load_tangents(mechanics(body, framed), body)
    else:
        moved = Recipe(recipe.kinematics, LoadPlacement.CORRECTIVE_MOMENT)
        source = "the displacement of the loaded interfaces, an estimate"
        change = _MOMENT * unit_load_tangents(mechanics(body, moved), body)
    first, count = draft.sizes["elastic_first"], draft.sizes["elastic_count"]
    elastic, omega = slice(first, first + count), body.angular_frequency[first : first + count]

    parts = np.array([change, change - own])[..., elastic, elastic] / (omega[:, None] * omega)
    # Of methods that know of no loads both are the same array, which an FMU then has once.
    judged, unit = in_units(0.5 * (parts + parts.swapaxes(-1, -2)))
    draft.sizes |= {"judged": 1, "judged_pairs": count * (count + 1) // 2}
    both = triangles(judged).astype(np.int16)
    draft.arrays |= {"judge_change": both[0], "judge_missed": both[1], "judge_unit": unit}
    bounds = unit * np.linalg.norm(judged, 2, (2, 3))
    draft.arrays |= {"judge_bound": bounds[0], "judge_missed_bound": bounds[1]}
    draft.arrays["judge_force"], draft.arrays["judge_size"] = _interface_loads(draft, body, elastic)
    draft.arrays["advice"] = advice(body, recipe, _against_missed(body, recipe, source), source)


def _by_mode(draft: Draft, body: ReducedBody) -> FloatArray:
    """Tangent (L, m, m) of stiffness by mode in the linear response to each unit load."""
    by_mode = np.asarray(body.stiffness_by_mode)
    core = Core(draft.image())
    still, stiffness = np.zeros(body.mode_count), body.angular_frequency**2
    result = []
    for load in np.eye(draft.sizes["loads"]):
        force = core.force(load, still)
        q = np.divide(force, stiffness, out=np.zeros_like(force), where=stiffness > 0.0)
        result.append(np.tensordot(q, by_mode, axes=1) + (by_mode @ q).T)
    return np.array(result)


def _depth(body: ReducedBody) -> int:
    """Frames in the longest chain of those that carry material, but for the floating one."""
    depth: list[int] = []
    for frame, parent in enumerate(body.frame_parent.tolist()):
        depth.append((0 if body.floating and frame == 0 else 1) + (0 if parent == GROUND else depth[parent]))
    return max(depth, default=0)


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
        found = f"body '{body.name}': its numbers go beyond the arithmetic in method '{method.value}' ({error})"
        raise ModalFileError(f"{found}; build it again") from error


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
    for name in {"curvature", "stretch"} & draft.arrays.keys():
        draft.arrays[name] = np.asarray(draft.arrays[name], np.float32)
    draft.sizes["embedded"] = body.mode_count
    draft.arrays["embedding"] = shadow.embedding
    return draft


def _draft(body: ReducedBody, recipe: Recipe, mass: Mass) -> Draft:
    draft = mechanics(body, recipe, mass)
    if recipe.stiffness is Stiffness.BY_MODE:
        draft.sizes["by_mode_given"] = 1
        draft.arrays["by_mode"] = np.asarray(body.stiffness_by_mode)
    if recipe.stiffness is Stiffness.BY_LOAD:
        # What moving loads do at first order by themselves *is* part of it: taken out, nothing counts twice.
        data = in_load_order(np.asarray(body.stiffness_by_load), body.interface_count)
        draft.arrays["by_load"] = data - unit_load_tangents(draft, body)
        draft.sizes["by_load_given"] = 1
    elif body.ties is None and recipe.kinematics is not Kinematics.SECOND_ORDER:
        second_opinion(draft, body, recipe)
    if recipe.loads is LoadPlacement.DEFORMED and body.following_interfaces:
        # Only now: what has been found above is of loads of fixed direction.
        draft.sizes["placement"] = PLACEMENT[LoadPlacement.DEFORMED]
        draft.arrays["follower"] = np.array([body.interface_names.index(name) for name in body.following_interfaces])
    return draft


def compile_program(body: ReducedBody, method: Method, mass: Mass = Mass.CONSTANT) -> bytes:
    """The same as an image."""
    return compile_draft(body, method, mass).image()


# What begins the name of the program that tells the error.
_SHADOW = "shadow"
# Sets of interfaces that a linear body may be fixed at: all of them as long as there are few.
_MOST_FIXED = 5
_TYPES = ("Real", "Integer", "Boolean", "String")


def programs(body: ReducedBody, every: bool = True) -> dict[str, Draft]:
    """Every program of a body's FMU by its file name, without the guid.

    Parameters
    ----------
    body : ReducedBody
    every : bool
        Else that alone which the FMU starts with.

    Returns
    -------
    dict of str to Draft
    """
    fields = variable_fields(body, variable_table(body))
    start = chosen(body).method
    result = {}
    for method in offered(body) if every else (start,):
        mass = body.mass if body.mass in masses_of(method) else Mass.CONSTANT
        for fixed in _fixed_sets(body, method) if every else [()]:
            names = tuple(body.interface_names[number] for number in fixed)
            try:
                held = with_frame_layout(with_fixed_interfaces(body, names, method), method)
            except OptionError:
                if not fixed:
                    raise
                # A set that leaves the body no coordinates: the FMU says that it is not there.
                continue
            draft = compile_draft(held, method, mass)
            name = DESCRIPTION if method is start and not fixed else _name(method.value, fixed)
            result[name] = Draft(draft.sizes, draft.arrays | fields)
    if body.shadow is not None and every:
        # Frames hang on the root: of other interfaces fixed nothing is known.
        for fixed in _fixed_sets(body, Method.SECOND_ORDER):
            names = tuple(body.interface_names[number] for number in fixed)
            held = with_fixed_interfaces(body, names, Method.SECOND_ORDER)
            result[_name(_SHADOW, fixed)] = shadow_draft(held)
    return result


def _name(first: str, fixed: Iterable[int]) -> str:
    return f"{'-'.join([first, *map(str, fixed)])}.prog"


def variable_fields(body: ReducedBody, table: Sequence[Variable]) -> dict[str, Any]:
    """Fields of a program that describe its variables.

    Parameters
    ----------
    body : ReducedBody
    table : sequence of Variable
        By value reference.

    Returns
    -------
    dict of str to array or bytes
    """
    roles = symbols("ROLE")
    start = [v.choices.index(str(v.start)) if v.choices else float(v.start or 0.0) for v in table]
    offered = [body.interface_names.index(name) for name in body.compliance_interfaces]
    return {
        "variable_type": np.array([_TYPES.index(v.type) for v in table]),
        "variable_role": np.array([roles.index(v.role) for v in table]),
        "variable_index": np.array([v.number for v in table]),
        "variable_start": np.array(start, dtype=np.float64),
        "variable_texts": texts(*("".join(f"{text}\n" for text in (v.name, *v.choices)) for v in table)),
        "compliance_interface": np.array(offered, dtype=np.int64),
    }


def with_guid(made: Mapping[str, Draft], guid: str) -> dict[str, bytes]:
    """Images of programs that belong to the model description of a guid."""
    drafts = {name: Draft(draft.sizes, draft.arrays | {"guid": texts(guid)}) for name, draft in made.items()}
    first = drafts.pop(DESCRIPTION)
    first.arrays["shared"] = shared([draft.arrays for draft in drafts.values()], first.image())
    base = first.image()
    return {DESCRIPTION: base} | {name: draft.image(base) for name, draft in drafts.items()}


def _fixed_sets(body: ReducedBody, method: Method) -> list[tuple[int, ...]]:
    """Sets of interfaces that a scene may fix, none first."""
    if body.root_interface == GROUND:
        return [()]
    if has_frames(method):
        return [(), (body.root_interface,)]
    count = body.interface_count
    sizes = range(count + 1) if count <= _MOST_FIXED else (0, 1, count)
    return [chosen for size in sizes for chosen in combinations(range(count), size)]
