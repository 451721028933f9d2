"""Everything of a program but geometric stiffness: modes, nodes, loads, what is watched, inertia."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.interface import fields, write_image
from ..files.basics import FloatArray, IntArray, OptionError
from ..model.inertia import LumpedMass
from ..model.methods import Kinematics, LoadPlacement, Mass, Recipe, Stiffness
from ..model.reduced_body import ReducedBody, Ties
from ..model.rotations import skew
from .tree import Tree, bends, build_tree, stretches
from .variable_table import input_names


@dataclass(slots=True)
class Draft:
    """What will be a program.

    Attributes
    ----------
    sizes : dict of str to int
        Those left out are the number of elements of an array that has as many.
    arrays : dict of str to array or bytes
    """

    sizes: dict[str, int]
    arrays: dict[str, NDArray[Any] | bytes]

    def image(self, base: bytes = b"") -> bytes:
        """All of it as bytes, but for arrays that another image holds."""
        counted = {
            field.count: len(array) if isinstance(array := self.arrays[field.name], bytes) else array.size
            for field in fields()
            if field.name in self.arrays and field.count.isidentifier()
        }
        return write_image(counted | self.sizes, self.arrays, base)


def texts(*words: str) -> bytes:
    """Texts as a program has them."""
    return b"".join(text.encode() + b"\0" for text in words)


PLACEMENT = {LoadPlacement.REFERENCE: 0, LoadPlacement.CORRECTIVE_MOMENT: 1, LoadPlacement.DEFORMED: 2}
# Stiffness over that of the softest mode beyond which no load that the body bears makes a mode give way.
_UNBENDING = 1e8
_ROUND_OFF = 64.0 * np.finfo(np.float64).eps
# Percent of the limits of rotation and strain that hold where displacements are wrong by these, not by their squares.
_FIRST_ORDER = 40
_TREES = (Kinematics.COROTATED, Kinematics.SECOND_ORDER)
_WRONG_AT_FIRST_ORDER = (Kinematics.LINEAR, Kinematics.LITERAL)
# Frequency over that of the softest mode up to which the deformed body's mass counts, and how many elastic modes are at
# least: stiffer ones move too little, and cost shorter steps (section 9).
_SLOW, _SLOW_MODES = 20.0, 6
# Smallest over largest eigenvalue of the inverse inertia below which an axis is held.
_HELD = 1e-9
# Motion of the root frame by elastic modes, over that by rigid ones, that is round-off.
_STILL = 1e-6


def mechanics(body: ReducedBody, recipe: Recipe, mass: Mass = Mass.CONSTANT) -> Draft:
    """Everything but geometric stiffness and the second opinion on it.

    Parameters
    ----------
    body : ReducedBody
    recipe : Recipe
    mass : Mass

    Returns
    -------
    Draft
    """
    lumped = _lumped(body, mass)
    tree = build_tree(body, recipe.kinematics, lumped)
    if tree.curvature is not None and not np.all(np.isfinite(tree.curvature)):
        raise np.linalg.LinAlgError("curvature is not finite")
    placement = _placement(body, recipe, tree)
    draft = Draft({"placement": PLACEMENT[placement]}, {})
    _put_modes(draft, body)
    _put_nodes(draft, body, tree)
    _put_loads(draft, body)
    _put_mixed(draft, body)
    _put_watched(draft, body, recipe, tree)
    if tree.curvature is not None:
        draft.arrays |= bends(tree, 0 if lumped is None else inertial_modes(body, True))
        draft.sizes |= {"curved": 1, "bending": len(draft.arrays["extent"])}
    if recipe.kinematics is Kinematics.SECOND_ORDER and tree.frames and body.membrane is not None:
        draft.arrays |= stretches(body.membrane, draft.arrays)
    if body.ties is not None and tree.frames:
        _put_ties(draft, body.ties, tree)
    _put_inertia(draft, body, recipe, mass, tree, lumped)
    if placement is LoadPlacement.DEFORMED and recipe.stiffness is Stiffness.CONSTANT:
        _put_turns(draft, body)
    return draft


def _placement(body: ReducedBody, recipe: Recipe, tree: Tree) -> LoadPlacement:
    """Where loads act."""
    loaded = tree.frames + body.interface_count + (0 if body.masses is None else body.masses.mass.size)
    if recipe.loads is LoadPlacement.DEFORMED and not np.any(tree.parent[tree.frames : loaded] >= 0):
        # Nothing that is loaded hangs on a frame: all places have constant derivatives, and loads on the deformed body
        # are those on the undeformed one.
        return LoadPlacement.REFERENCE
    return recipe.loads


def _put_modes(draft: Draft, body: ReducedBody) -> None:
    """Modes, and which of them loads may buckle."""
    omega, rigid = body.angular_frequency, body.rigid_count
    stiffness = omega**2
    last = int(np.searchsorted(stiffness, _UNBENDING * stiffness[rigid], side="right"))
    draft.sizes |= {"dampers": 0 if body.damper is None else len(body.damper)}
    draft.sizes |= {"modes": body.mode_count, "rigid": rigid, "elastic_first": rigid, "elastic_count": last - rigid}
    draft.arrays |= {
        "omega": omega,
        "zeta": body.damping_ratio,
        "damper": np.zeros(0) if body.damper is None else body.damper,
        "weight": np.where(omega > 0.0, omega, omega[rigid]),
        "suggested_step": np.array([body.suggested_step]),
        "body_size": np.array([_size(body)]),
    }


def _put_mixed(draft: Draft, body: ReducedBody) -> None:
    """Modes that are no vibrations of the finite element model, and how far they move and turn an interface."""
    spread = np.zeros(body.mode_count) if body.frequency_spread is None else body.frequency_spread
    mixed = np.flatnonzero(spread * body.angular_frequency)
    moved = np.stack([body.interface_displacement, body.interface_rotation])[..., mixed]
    draft.sizes |= {"mixed": mixed.size}
    draft.arrays |= {
        "mixed_mode": mixed,
        "mixed_reach": np.linalg.norm(moved, axis=2).max(axis=1, initial=0.0) / body.angular_frequency[mixed],
        "mixed_drift": 0.5 * spread[mixed] * body.angular_frequency[mixed],
    }


def _size(body: ReducedBody) -> float:
    """Diagonal of the box round the undeformed body, m; of what is known of it."""
    points = [body.interface_point, body.joint_point]
    points += [] if body.properties is None else [body.properties.box]
    points += [] if body.masses is None else [body.masses.point]
    points += [] if body.surface is None else [body.surface.points]
    return float(np.linalg.norm(np.ptp(np.concatenate(points), axis=0)))


def _put_nodes(draft: Draft, body: ReducedBody, tree: Tree) -> None:
    """The tree of frames."""
    names = [*body.interface_names, *body.frame_names[: tree.frames], *input_names(body)]
    draft.sizes |= {"frames": tree.frames, "interfaces": body.interface_count}
    draft.arrays |= {name: getattr(tree, name) for name in ("parent", "point", "offset", "base")}
    draft.arrays |= {"operator_": tree.operator, "names": texts(*names), "guid": texts("")}


def _put_loads(draft: Draft, body: ReducedBody) -> None:
    """Loads on interfaces, and accelerations of the supports."""
    loads, mass, inertia = 6 * body.interface_count, np.zeros(0), np.zeros((3, body.mode_count))
    if body.masses is not None:
        mass = body.masses.mass
        inertia = -np.tensordot(mass, body.masses.displacement, axes=1)
        loads += 3
    draft.sizes["loads"] = loads
    draft.arrays |= {
        "load_operator": np.concatenate([body.interface_displacement, body.interface_rotation]),
        "mass": mass,
        "inertia_operator": inertia,
    }


def _put_watched(draft: Draft, body: ReducedBody, recipe: Recipe, tree: Tree) -> None:
    """Rotations within frames, and stress."""
    turning, turning_frame = _turning(body, tree.frames)
    points = [part.stress.reshape(-1, 6, body.mode_count) for part in body.stress_sets]
    # What large strain makes of a body in one piece that is held its shadow knows to third order.
    known = body.shadow is not None and not (body.rigid_count or body.ties or body.shadow.body.ties)
    draft.sizes |= {
        "turning_limit": _FIRST_ORDER if recipe.kinematics in _WRONG_AT_FIRST_ORDER else 100,
        "strain_limit": (300 if known else 100) if recipe.kinematics is Kinematics.SECOND_ORDER else _FIRST_ORDER,
        "stress_sets": len(points),
        "stress_points": sum(len(part) for part in points),
        "strains": 0 if body.watched_strain is None else len(body.watched_strain),
    }
    draft.arrays |= {
        "turning": turning,
        "strain": np.zeros(0) if body.watched_strain is None else body.watched_strain,
        "turning_frame": turning_frame,
        "stress_start": np.cumsum([0, *(len(part) for part in points)]),
        "stress": np.concatenate(points) if points else np.zeros(0),
        "advice": advice(body, recipe),
    }


def _put_inertia(
    draft: Draft, body: ReducedBody, recipe: Recipe, mass: Mass, tree: Tree, lumped: LumpedMass | None
) -> None:
    """Mass of the deformed body, or what constant mass leaves out of it."""
    kept, slow, polynomial = inertial_modes(body, True), inertial_modes(body), body.polynomial
    if lumped is not None:
        draft.sizes |= {"inertial": 1, "inertial_modes": kept, "slow_modes": slow, "lumped": 1}
        draft.arrays |= {
            "lump_mass": lumped.mass,
            "turning_inertia": lumped.turning,
            "turning_sweep": lumped.sweep[:, :, :kept],
            "inertial_rest": -lumped.at_rest(body.frame_rotation)[:kept, :kept],
        }
    elif body.rigid_count and tree.frames and (polynomial is None or mass is not Mass.POLYNOMIAL):
        _put_spin(draft, body)
    elif polynomial is not None and recipe.kinematics in _TREES:
        # With constant mass it is there for the watch.
        form, square = _pairs(polynomial.form, kept), _pairs(polynomial.square, slow)
        draft.sizes |= {"inertial": int(mass is Mass.POLYNOMIAL), "inertial_modes": kept, "mass_pairs": form.shape[1]}
        draft.sizes |= {"slow_modes": slow, "mass_squares": square.shape[1], "mass_forms": len(form)}
        draft.arrays |= {"mass_form": form, "mass_value": np.hstack([polynomial.linear, square])}
        if mass is Mass.POLYNOMIAL and polynomial.further is not None and polynomial.factor is not None:
            draft.sizes["mass_products"] = len(polynomial.factor)
            draft.arrays |= {"mass_further": polynomial.further, "mass_factor": polynomial.factor}
        if polynomial.centre is not None and polynomial.centre_square is not None:
            draft.sizes["centres"] = 3
            draft.arrays["mass_centre"] = np.hstack([polynomial.centre, _pairs(polynomial.centre_square, slow)])


def _pairs(symmetric: FloatArray, count: int) -> FloatArray:
    """Symmetric matrices (n, m, m) by pairs (n, k): one off the diagonal stands for both halves."""
    first, second = np.triu_indices(count)
    return symmetric[:, first, second] * np.where(first == second, 1.0, 2.0)


def _turning(body: ReducedBody, frames: int) -> tuple[FloatArray, IntArray]:
    """Rotations (n, 3, m) of material against its frame, and that frame (n,): elements, joints and interfaces."""
    material, on = body.watched_rotation, body.watched_frame
    if material is None or on is None:
        material, on = np.zeros((0, 3, body.mode_count)), np.zeros(0, dtype=np.int64)
    if frames == 0:
        rotation = np.concatenate([body.interface_rotation, material])
        return rotation, np.zeros(len(rotation), dtype=np.int64)
    on = np.minimum(on, frames - 1)
    carried = np.flatnonzero(body.frame_parent >= 0)
    held = np.flatnonzero(body.interface_frame >= 0)
    moved = np.concatenate([body.joint_rotation, body.joint_rotation[carried], body.interface_rotation[held], material])
    frame = np.concatenate([np.arange(frames), body.frame_parent[carried], body.interface_frame[held], on])
    own = np.where(frame[:, None, None] >= 0, body.frame_rotation[frame], 0.0)
    moved = moved - own
    # Material's are as single as in the body.
    moved[len(moved) - len(material) :] = moved[len(moved) - len(material) :].astype(np.float32)
    return moved, np.maximum(frame, 0)


def _put_ties(draft: Draft, ties: Ties, tree: Tree) -> None:
    """Springs that join the parts of a cut body; H is their stiffness at q = 0, which the modes hold."""
    turned = ties.rotation[:, 0] - ties.rotation[:, 1]
    # Stretch at the centre, then at the points l_c, which turn by θ × l_c.
    stretch = np.empty((len(turned), 4, *turned.shape[1:]))
    stretch[:, 0] = ties.displacement[:, 0] - ties.displacement[:, 1]
    stretch[:, 1:] = -skew(np.swapaxes(ties.lever, 1, 2)) @ turned[:, None]
    each = np.einsum("ti,tcim,tcin->tmn", ties.stiffness, stretch, stretch, optimize=True)
    directions = ties.stiffness > 0.0
    turns = np.any(directions, axis=1) & np.any(ties.lever != 0.0, axis=(1, 2))
    resists = np.concatenate([directions, np.repeat(turns[:, None], 3, axis=1)], axis=1)
    # Each tie has four springs along an axis: at its centre and at three levers.
    noise = _ROUND_OFF * float(np.linalg.norm(tree.point, axis=1).max()) * float(np.sqrt(4.0 * ties.stiffness.sum()))
    draft.sizes["ties"] = len(turned)
    draft.arrays |= {
        "tie_stiffness": ties.stiffness,
        "tie_lever": ties.lever,
        "tie_apart": ties.point[:, 0] - ties.point[:, 1],
        "tie_initial": each.sum(axis=0),
        "tie_welded": each[ties.frame[:, 1] >= 0].sum(axis=0),
        "tie_noise": np.array([noise]),
        "pull": np.flatnonzero(resists),
    }


def _lumped(body: ReducedBody, mass: Mass) -> LumpedMass | None:
    """The lumps that go along; none where nothing of the body hangs on a frame."""
    if mass is not Mass.CONFIGURATION:
        return None
    if body.inertia is None:
        found = 'mass "configuration" needs data that this body was built without'
        raise OptionError(f"{found}: build it with inertia = true in [reduction]")
    if body.ties is not None:
        raise OptionError('mass "configuration" does not know bodies that were cut; take mass "constant"')
    return body.inertia if body.inertia.mass.size else None


def inertial_modes(body: ReducedBody, rates: bool = False) -> int:
    """How many of the first coordinates the mass of the deformed body changes by, or whose rates it knows of."""
    omega, rigid = body.angular_frequency, body.rigid_count
    slow = int(np.searchsorted(omega, _SLOW * omega[rigid], side="right"))
    return min(max(slow, rigid + _SLOW_MODES, body.mass_modes if rates else 0), body.mode_count)


def _put_spin(draft: Draft, body: ReducedBody) -> None:
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


@dataclass(frozen=True, slots=True)
class Turning:
    """How a body turns whose root frame makes the rigid motions, and they alone (section 9).

    Attributes
    ----------
    axis : (t, 3) float
        One or three.
    slides : bool
        Whether it moves in all directions, too.
    coordinates : (r, 6) float
        Rigid coordinates per displacement and turn of the root.
    """

    axis: FloatArray
    slides: bool
    coordinates: FloatArray


def turning_of(body: ReducedBody) -> Turning | None:
    """How a body turns in its own axes; none where it does not."""
    rigid = body.rigid_count
    if not (body.floating and rigid):
        return None
    motion = np.concatenate([body.joint_displacement[0], body.frame_rotation[0]])
    turning, sliding = motion[3:, :rigid], motion[:3, :rigid]
    axes, values, _ = np.linalg.svd(turning, full_matrices=False)
    axis = axes.T[values > _HELD * values.max(initial=0.0)]
    if len(axis) == 3:
        axis = np.eye(3)
    slides = rigid == len(axis) + 3
    elastic, own = np.abs(motion[:, rigid:]).max(), np.abs(motion[:, :rigid]).max(initial=0.0)
    if len(axis) not in (1, 3) or not (slides or rigid == len(axis)) or elastic > _STILL * own:
        return None
    if not slides and np.abs(sliding).max() > _STILL * own:
        return None
    return Turning(axis, slides, np.linalg.pinv(motion[:, :rigid]))


def _put_turns(draft: Draft, body: ReducedBody) -> None:
    """Rigid motions of a body that turns in its own axes."""
    found = turning_of(body)
    if found is None:
        return
    draft.sizes |= {"turns": 1, "turn_axes": len(found.axis), "turn_slides": int(found.slides), "spin_inertia_given": 0}
    draft.arrays |= {"turn_axis": found.axis, "turn_coordinates": found.coordinates}
    draft.arrays.pop("spin_inertia", None)
    operator = np.array(draft.arrays["operator_"])
    operator[:, 0, :, body.rigid_count :] = 0.0
    draft.arrays["operator_"] = operator


# Of a body with closed loops, whose error a shadow with loops opened tells.
_CUT = 'build with cut = "auto" (with constant mass): its loops stay closed'
# Of a body on springs, whose error a shadow tells that holds them as joints.
_BUSHING = "give supports with stiffness rotational_stiffness: springs of nodes resist turns too much"


def advice(body: ReducedBody, recipe: Recipe, missed: str = "", source: str = "") -> bytes:
    """What to do about all that is watched, in the core's order; of missed stiffness also by which source."""
    error = against_error(body, recipe)
    limit = f", or {error}" if error == _CUT else ""
    return texts(against_rotation(body, recipe), missed, source, against_spin(body, recipe), error, limit)


def against_error(body: ReducedBody, recipe: Recipe) -> str:
    """What to do about the error that a body tells of itself."""
    if recipe.kinematics is not Kinematics.SECOND_ORDER:
        held = body.second is not None and body.frame_count
        return f'{"take" if held else "build with frames and"} method = "second_order"'
    if body.ties is None and body.shadow is not None and body.shadow.body.ties is not None:
        return _CUT if body.shadow.body.ties.joins else _BUSHING
    return "build with more frames or more modes"


def against_rotation(body: ReducedBody, recipe: Recipe) -> str:
    """What to do about rotation within a frame."""
    if recipe.kinematics in _WRONG_AT_FIRST_ORDER:
        return 'take method = "frames"' + ("" if body.frame_count else ", and build with frames")
    if recipe.kinematics is Kinematics.COROTATED and body.second is not None:
        return 'take method = "second_order", or build with more frames'
    return "build with more frames"


def against_spin(body: ReducedBody, recipe: Recipe) -> str:
    """What to do about inertia that constant mass does not know."""
    words = f'take mass = "{"configuration" if body.polynomial is None else "polynomial"}"'
    if recipe.kinematics is not Kinematics.SECOND_ORDER:
        words += ' with method = "second_order"'
    if body.inertia is None and body.polynomial is None:
        words = f"build with inertia = true in [reduction], and {words}"
    return words
