"""A reduced body under one method as a program: all that does not depend on inputs, found once."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Core
from ..core.image import write_image
from ..files.array_types import FloatArray, IntArray
from ..model.errors import ModalFileError, OptionError
from ..model.inertia import LumpedMass
from ..model.methods import ASKED_BY, Data, Kinematics, LoadPlacement, Mass, Method, Recipe, Stiffness, recipe_of
from ..model.reduced_body import GROUND, ReducedBody
from ..model.rotations import skew
from .tree import Tree, bends, build_tree

Arrays = dict[str, NDArray[Any] | bytes]

_PLACEMENT = {LoadPlacement.REFERENCE: 0, LoadPlacement.CORRECTIVE_MOMENT: 1, LoadPlacement.DEFORMED: 2}
# Stiffness over that of the softest mode beyond which no load that the body bears makes a mode give way.
_UNBENDING = 1e8
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps
# Percent of the limit of rotation that holds where displacements are wrong by the angle, not by its square.
_FIRST_ORDER = 40
_TREES = (Kinematics.COROTATED, Kinematics.SECOND_ORDER)
_WRONG_AT_FIRST_ORDER = (Kinematics.LINEAR, Kinematics.LITERAL)
# Times 1/n²: what n frames in a chain overestimate a cantilever's critical load by (section 4b: 0.223, 0.056, 0.016 for
# 1, 2, 4).
_CHAIN = 0.25
# Critical load of the clamped column over what the moment u × F alone makes of it.
_MOMENT = 8.0 / np.pi**2


_BY_LOAD, _BY_SECOND_ORDER = "geometric stiffness by load", "the frames to second order"
# Frequency over that of the softest mode up to which the deformed body's mass counts, and how many elastic modes are at
# least: stiffer ones move too little, and cost shorter steps (section 9).
_SLOW, _SLOW_MODES = 20.0, 6
# Smallest over largest eigenvalue of the inverse inertia below which an axis is held.
_HELD = 1e-9
# Motion of the root frame by elastic modes, over that by rigid ones, that is round-off.
_STILL = 1e-6


def names_of_inputs(body: ReducedBody) -> list[str]:
    """Names of the loads in the order of a program: force and moment of each interface, then the acceleration."""
    names = [f"{name}.{kind}.{axis}" for name in body.interface_names for kind in ("force", "moment") for axis in "xyz"]
    return names + ([f"body.acceleration.{axis}" for axis in "xyz"] if body.masses is not None else [])


@dataclass(slots=True)
class Draft:
    """What will be a program."""

    sizes: dict[str, int]
    arrays: Arrays

    def image(self) -> bytes:
        """All of it as bytes."""
        return write_image(self.sizes, self.arrays)


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


def _draft(body: ReducedBody, recipe: Recipe, mass: Mass) -> Draft:
    draft = _kinematics(body, recipe, mass)
    if recipe.stiffness is Stiffness.BY_MODE:
        draft.sizes["by_mode_given"] = 1
        draft.arrays["by_mode"] = _given(body.stiffness_by_mode, Data.BY_MODE)
    if recipe.stiffness is Stiffness.BY_LOAD:
        # What moving loads do at first order by themselves *is* part of it: taken out, nothing counts twice.
        data = _in_load_order(_given(body.stiffness_by_load, Data.BY_LOAD), body.interface_count)
        by_load = data - _unit_load_tangents(draft, body)
        draft.sizes["by_load_given"] = 1
        draft.arrays["by_load"] = by_load
    elif body.ties is None and recipe.kinematics is not Kinematics.SECOND_ORDER:
        _judge(draft, body, recipe)
    if recipe.loads is LoadPlacement.DEFORMED and body.following_interfaces:
        # Only now: what has been found above is of loads of fixed direction.
        following = [body.interface_names.index(name) for name in body.following_interfaces]
        draft.sizes |= {"followers": len(following), "placement": _PLACEMENT[LoadPlacement.DEFORMED]}
        draft.arrays["follower"] = np.array(following, dtype=np.int64)
    return draft


def compile_program(body: ReducedBody, method: Method, mass: Mass = Mass.CONSTANT) -> bytes:
    """The same as an image."""
    return compile_draft(body, method, mass).image()


def _kinematics(body: ReducedBody, recipe: Recipe, mass: Mass = Mass.CONSTANT) -> Draft:
    """Everything but geometric stiffness and the second opinion on it."""
    m, interfaces = body.mode_count, body.interface_count
    lumped = _lumped(body, mass)
    tree = build_tree(body, recipe.kinematics, lumped)
    if tree.curvature is not None and not np.all(np.isfinite(tree.curvature)):
        raise np.linalg.LinAlgError("curvature is not finite")
    kept = 0 if lumped is None else inertial_modes(body)
    placement = recipe.loads
    loaded = tree.frames + interfaces + (0 if body.masses is None else body.masses.mass.size)
    if placement is LoadPlacement.DEFORMED and not np.any(tree.parent[tree.frames : loaded] >= 0):
        # Nothing that is loaded hangs on a frame: all places have constant derivatives, and loads on the deformed body
        # are those on the undeformed one.
        placement = LoadPlacement.REFERENCE
    omega, rigid = body.angular_frequency, body.rigid_count
    inertia = np.zeros((3, m))
    masses = np.zeros(0)
    if body.masses is not None:
        masses = body.masses.mass
        inertia = -np.tensordot(masses, body.masses.displacement, axes=1)
    stiffness = omega**2
    last = int(np.searchsorted(stiffness, _UNBENDING * stiffness[rigid], side="right"))
    turning, turning_frame = _turning(body, tree.frames)
    names = [*body.interface_names, *body.frame_names[: tree.frames], *names_of_inputs(body)]
    points = [part.stress.reshape(-1, 6, m) for part in body.stress_sets]
    draft = Draft(
        {
            "modes": m,
            "rigid": rigid,
            "nodes": len(tree.parent),
            "frames": tree.frames,
            "interfaces": interfaces,
            "masses": masses.size,
            "loads": 6 * interfaces + (3 if masses.size else 0),
            "placement": _PLACEMENT[placement],
            "turnings": len(turning_frame),
            "turning_limit": _FIRST_ORDER if recipe.kinematics in _WRONG_AT_FIRST_ORDER else 100,
            "elastic_first": rigid,
            "elastic_count": last - rigid,
            "stress_sets": len(points),
            "stress_points": sum(len(part) for part in points),
        },
        {
            "omega": omega,
            "zeta": body.damping_ratio,
            "weight": np.where(omega > 0.0, omega, omega[rigid]),
            "parent": tree.parent,
            "point": tree.point,
            "offset": tree.offset,
            "base": tree.base,
            "operator_": tree.operator,
            "load_operator": np.concatenate([body.interface_displacement, body.interface_rotation]),
            "mass": masses,
            "inertia_operator": inertia,
            "turning": turning,
            "turning_frame": turning_frame,
            "stress_start": np.cumsum([0, *(len(part) for part in points)]),
            "stress": np.concatenate(points) if points else np.zeros(0),
            "suggested_step": np.array([body.suggested_step]),
        },
    )
    _texts(draft, "names", names)
    _texts(draft, "advice", [_against_rotation(body, recipe), "", "", _against_spin(body, recipe)])
    _texts(draft, "guid", [""])
    if tree.curvature is not None:
        bent = bends(tree, kept)
        draft.sizes |= {"curved": 1, "parts": bent.extent.size, "bends": bent.numbers.size}
        draft.sizes["basis_numbers"] = bent.basis.size
        draft.arrays |= {"curvature": bent.numbers, "basis": bent.basis, "part": bent.part}
        draft.arrays |= {"core_start": bent.start, "extent": bent.extent}
    if recipe.kinematics is Kinematics.SECOND_ORDER and tree.frames and body.membrane is not None:
        draft.sizes["stretches"] = len(body.membrane.linear)
        draft.arrays["stretch"] = np.moveaxis(body.membrane.quadratic, 0, 1)
        draft.arrays["stretch_linear"] = body.membrane.linear
        draft.arrays["stretch_sign"] = body.membrane.sign
    if body.ties is not None and tree.frames:
        _ties(draft, body, tree)
    if lumped is not None:
        rest = -lumped.at_rest(body.frame_rotation)[:kept, :kept]
        draft.sizes |= {"inertial": 1, "inertial_modes": kept, "lumps": lumped.mass.size}
        draft.arrays |= {"lump_mass": lumped.mass, "turning_inertia": lumped.turning, "inertial_rest": rest}
        draft.arrays["turning_sweep"] = lumped.sweep[:, :, :kept]
    elif rigid and tree.frames:
        _spin(draft, body)
    elif body.missed_inertia is not None and recipe.kinematics in _TREES:
        pairs, columns = body.missed_inertia.shape
        draft.sizes |= {"missed_modes": columns - pairs, "missed_pairs": pairs}
        draft.arrays["missed_inertia"] = body.missed_inertia
    if body.floating and placement is LoadPlacement.DEFORMED and recipe.stiffness is Stiffness.CONSTANT:
        _turns(draft, body)
    return draft


def _texts(draft: Draft, name: str, texts: list[str]) -> None:
    data = b"".join(text.encode() + b"\0" for text in texts)
    draft.arrays[name] = data
    draft.sizes[{"names": "name_bytes", "advice": "advice_bytes", "guid": "guid_bytes"}[name]] = len(data)


def _given(values: FloatArray | None, data: Data) -> FloatArray:
    if values is None:
        raise OptionError(
            f"the method needs data that this body was built without: build it with {ASKED_BY[data]} in [reduction]"
        )
    return values


def _in_load_order(by_load: FloatArray, interfaces: int) -> FloatArray:
    """Matrices (L, m, m) of forces of all interfaces, then moments, as force and moment of each interface in turn."""
    wrenches = by_load[: 6 * interfaces].reshape(2, interfaces, 3, *by_load.shape[1:])
    ordered = np.moveaxis(wrenches, 0, 1).reshape(6 * interfaces, *by_load.shape[1:])
    result: FloatArray = np.concatenate([ordered, by_load[6 * interfaces :]])
    return result


def _unit_load_tangents(draft: Draft, body: ReducedBody) -> FloatArray:
    """What each unit load adds to the tangent stiffness of the undeformed body, (L, m, m)."""
    core = Core(draft.image())
    still = np.zeros(body.mode_count)
    loads = np.eye(draft.sizes["loads"])
    return np.array([core.tangent(load, still) for load in loads]) - np.diag(body.angular_frequency**2)


def _turning(body: ReducedBody, frames: int) -> tuple[FloatArray, IntArray]:
    """Rotations (n, 3, m) of material against its frame, and that frame (n,): joints and interfaces."""
    if frames == 0:
        return body.interface_rotation, np.zeros(body.interface_count, dtype=np.int64)
    carried = np.flatnonzero(body.frame_parent >= 0)
    parent = body.frame_parent[carried]
    held = np.flatnonzero(body.interface_frame >= 0)
    on = body.interface_frame[held]
    rotations = [
        body.joint_rotation - body.frame_rotation,
        body.joint_rotation[carried] - body.frame_rotation[parent],
        body.interface_rotation[held] - body.frame_rotation[on],
    ]
    return np.concatenate(rotations), np.concatenate([np.arange(frames), parent, on])


def _ties(draft: Draft, body: ReducedBody, tree: Tree) -> None:
    """Springs that join the parts of a cut body; H is their stiffness at q = 0, which the modes hold."""
    ties = body.ties
    assert ties is not None
    m, count = body.mode_count, len(ties.stiffness)
    relative = ties.displacement[:, 0] - ties.displacement[:, 1]
    turned = ties.rotation[:, 0] - ties.rotation[:, 1]
    # Stretch at the centre, then at the points l_c, which turn by θ × l_c.
    stretch = np.empty((count, 4, 3, m))
    stretch[:, 0] = relative
    stretch[:, 1:] = -skew(np.swapaxes(ties.lever, 1, 2)) @ turned[:, None]
    each = np.einsum("ti,tcim,tcin->tmn", ties.stiffness, stretch, stretch, optimize=True)
    directions = ties.stiffness > 0.0
    turns = np.any(directions, axis=1) & np.any(ties.lever != 0.0, axis=(1, 2))
    resists = np.concatenate([directions, np.repeat(turns[:, None], 3, axis=1)], axis=1)
    pull = np.flatnonzero(resists)
    # Each tie has four springs along an axis: at its centre and at three levers.
    far = float(np.linalg.norm(tree.point, axis=1).max())
    noise = _ROUND_OFF * far * float(np.sqrt(4.0 * ties.stiffness.sum()))
    draft.sizes |= {"ties": count, "tied": 1, "pulls": pull.size}
    draft.arrays |= {
        "tie_stiffness": ties.stiffness,
        "tie_lever": ties.lever,
        "tie_apart": ties.point[:, 0] - ties.point[:, 1],
        "tie_initial": each.sum(axis=0),
        "tie_welded": each[ties.frame[:, 1] >= 0].sum(axis=0),
        "tie_noise": np.array([noise]),
        "pull": pull,
    }


def _lumped(body: ReducedBody, mass: Mass) -> LumpedMass | None:
    """The lumps that go along; none where nothing of the body hangs on a frame."""
    if mass is Mass.CONSTANT:
        return None
    if body.inertia is None:
        raise OptionError(
            'mass "configuration" needs data that this body was built without: build it with inertia = true in '
            "[reduction]"
        )
    if body.ties is not None:
        raise OptionError('mass "configuration" does not know bodies that were cut; take mass "constant"')
    return body.inertia if body.inertia.mass.size else None


def inertial_modes(body: ReducedBody) -> int:
    """How many of the first coordinates the mass of the deformed body knows of."""
    omega, rigid = body.angular_frequency, body.rigid_count
    slow = int(np.searchsorted(omega, _SLOW * omega[rigid], side="right"))
    return min(max(slow, rigid + _SLOW_MODES), body.mode_count)


def _spin(draft: Draft, body: ReducedBody) -> None:
    """How a free body turns as a whole: what constant mass misses of it is watched (section 9)."""
    # Every frame turns alike in rigid motions.
    rotation = body.frame_rotation[0][:, : body.rigid_count]
    # Rigid motions are mass-orthonormal.
    inverse = rotation @ rotation.T
    values = np.linalg.eigvalsh(inverse)
    if values[-1] <= 0.0:
        return
    draft.sizes["spins"] = 1
    draft.arrays["spin_rotation"] = rotation
    if values[0] > _HELD * values[-1]:
        draft.sizes["spin_inertia_given"] = 1
        draft.arrays["spin_inertia"] = np.linalg.inv(inverse)


def _turns(draft: Draft, body: ReducedBody) -> None:
    """Rigid motions of a body whose root frame makes them, and they alone: it turns in its own axes (section 9)."""
    rigid = body.rigid_count
    motion = np.concatenate([body.joint_displacement[0], body.frame_rotation[0]])
    turning, sliding = motion[3:, :rigid], motion[:3, :rigid]
    axes, values, _ = np.linalg.svd(turning, full_matrices=False)
    axis = axes.T[values > _HELD * values.max(initial=0.0)]
    if len(axis) == 3:
        axis = np.eye(3)
    slides = rigid == len(axis) + 3
    elastic, own = np.abs(motion[:, rigid:]).max(), np.abs(motion[:, :rigid]).max(initial=0.0)
    if len(axis) not in (1, 3) or not (slides or rigid == len(axis)) or elastic > _STILL * own:
        return
    if not slides and np.abs(sliding).max() > _STILL * own:
        return
    draft.sizes |= {"turns": 1, "turn_axes": len(axis), "turn_slides": int(slides), "spin_inertia_given": 0}
    draft.arrays |= {"turn_axis": axis, "turn_coordinates": np.linalg.pinv(motion[:, :rigid])}
    draft.arrays.pop("spin_inertia", None)
    operator = np.array(draft.arrays["operator_"])
    operator[:, 0, :, rigid:] = 0.0
    draft.arrays["operator_"] = operator


def _interface_loads(draft: Draft, body: ReducedBody, elastic: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Modal forces (L, e) of unit loads and motions (I, 6, e) of interfaces over ω, and what makes loads comparable."""
    omega, interfaces = body.angular_frequency[elastic], body.interface_count
    displacement, rotation = (
        operator[..., elastic] / omega for operator in (body.interface_displacement, body.interface_rotation)
    )
    # Displacement over rotation under loads of all directions.
    moved, turned = (np.linalg.norm(operator, axis=(1, 2)) for operator in (displacement, rotation))
    length = np.where((moved > 0.0) & (turned > 0.0), moved / np.where(turned > 0.0, turned, 1.0), 1.0)
    motion = np.concatenate([displacement, rotation * length[:, None, None]], axis=1)
    force = np.concatenate([displacement, rotation], axis=1).reshape(6 * interfaces, -1)
    size = np.concatenate([np.ones((interfaces, 3)), np.repeat(1.0 / length[:, None], 3, axis=1)], axis=1).ravel()
    if draft.sizes["masses"]:
        inertia = np.asarray(draft.arrays["inertia_operator"])[:, elastic] / omega
        force = np.concatenate([force, inertia])
        size = np.concatenate([size, np.full(3, float(np.sum(np.asarray(draft.arrays["mass"]))))])
    return force, motion, size


def _against_rotation(body: ReducedBody, recipe: Recipe) -> str:
    """What to do about rotation within a frame."""
    if recipe.kinematics in _WRONG_AT_FIRST_ORDER:
        return 'take method = "frames"' + ("" if body.frame_count else ", and build with frames")
    if recipe.kinematics is Kinematics.COROTATED and body.second is not None:
        return 'take method = "second_order", or build with more frames'
    return "build with more frames"


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


def _against_spin(body: ReducedBody, recipe: Recipe) -> str:
    """What to do about inertia that constant mass does not know."""
    words = 'take mass = "configuration"'
    if recipe.kinematics is not Kinematics.SECOND_ORDER:
        words += ' with method = "second_order"'
    if body.inertia is None:
        words = f"build with inertia = true in [reduction], and {words}"
    return words


def _judge(draft: Draft, body: ReducedBody, recipe: Recipe) -> None:
    """A second opinion on the tangent stiffness, by the best that the body holds (section 7)."""
    own = _unit_load_tangents(draft, body)
    if recipe.stiffness is Stiffness.BY_MODE:
        own = own + _by_mode(draft, body)
    depth = _depth(body)
    if body.second is not None and body.frame_count:
        better = recipe_of(Method.SECOND_ORDER)
        # Without membrane energy, whose coordinates are others: what loads do at first order is the same.
        plain = _kinematics(replace(body, membrane=None), better)
        source, change = _BY_SECOND_ORDER, _unit_load_tangents(plain, body)
    elif body.stiffness_by_load is not None:
        source = _BY_LOAD
        change = _in_load_order(np.asarray(body.stiffness_by_load), body.interface_count)
    elif depth:
        framed = recipe_of(Method.FRAMES)
        source = "the frames"
        change = (1.0 + _CHAIN / depth**2) * _unit_load_tangents(_kinematics(body, framed), body)
    else:
        moved = Recipe(recipe.kinematics, LoadPlacement.CORRECTIVE_MOMENT)
        source = "the displacement of the loaded interfaces, an estimate"
        change = _MOMENT * _unit_load_tangents(_kinematics(body, moved), body)
    first, count = draft.sizes["elastic_first"], draft.sizes["elastic_count"]
    elastic, omega = slice(first, first + count), body.angular_frequency[first : first + count]

    def scaled(tangents: FloatArray) -> FloatArray:
        part = tangents[:, elastic, elastic]
        result: FloatArray = 0.5 * (part + part.swapaxes(1, 2)) / (omega[:, None] * omega)
        return result

    judged, missed = scaled(change), scaled(own - change)
    draft.sizes["judged"] = 1
    draft.arrays |= {
        "judge_change": judged,
        "judge_missed": missed,
        "judge_bound": np.linalg.norm(judged, 2, (1, 2)),
        "judge_missed_bound": np.linalg.norm(missed, 2, (1, 2)),
    }
    force, motion, size = _interface_loads(draft, body, elastic)
    draft.arrays |= {"judge_force": force, "judge_motion": motion, "judge_size": size}
    advice = [_against_rotation(body, recipe), _against_missed(body, recipe, source), source]
    _texts(draft, "advice", [*advice, _against_spin(body, recipe)])


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
        counts = 0 if body.floating and frame == 0 else 1
        depth.append(counts + (0 if parent == GROUND else depth[parent]))
    return max(depth, default=0)
