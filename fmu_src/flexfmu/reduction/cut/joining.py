"""Parts of a cut body, each reduced by itself, joined to one reduced body (docs/theory.md, section 10)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg

from ...files.basics import BoolArray, FloatArray, IntArray, ModelError
from ...model.arrays import ARRAYS, Entry
from ...model.inertia import Membrane
from ...model.reduced_body import GROUND, Masses, ReducedBody, SecondOrder, StressSet, Surface, Ties
from ...model.rotations import skew
from ..bodies import made_body
from ..options import BodyUse

# Springs of the joints take up this share of an interface's displacement under a load on it, all together. Stiffer ones
# would only make equations worse.
_SHARE = 5e-5
# Compliance of an interface below this share of the largest: it lies on a support.
_HELD = 1e-9
# Stiffness of a coordinate below this part of the largest is round-off of a rigid motion.
_ROUND_OFF = 1e-15
# Shapes of sections below this share of the largest are the same as others.
_DEPENDENT = 1e-6
# As in `modes`.
_NEARLY_LARGEST = 0.9
# What the body has of its parts as they have it.
_LAID = ("joint_point", "frame_parent", "joint_displacement", "joint_rotation", "frame_rotation", "damper",
         "watched_frame", "watched_rotation", "watched_strain")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Weld:
    """A joint between two sections.

    Attributes
    ----------
    first, second : (part, interface)
        The sections, as interfaces of their parts.
    first_warping, second_warping : (w, m_p) float
        How far each section warps in each of w shapes, which are to be the same.
    """

    first: tuple[int, int]
    second: tuple[int, int]
    first_warping: FloatArray
    second_warping: FloatArray


@dataclass(frozen=True, slots=True)
class _Stack:
    """Coordinates and frames of all parts, laid end to end."""

    parts: Sequence[ReducedBody]
    first: IntArray
    first_frame: IntArray
    size: int

    @classmethod
    def of(cls, parts: Sequence[ReducedBody]) -> "_Stack":
        """Lay the parts end to end."""
        ends = np.cumsum([[0, 0], *([part.mode_count, part.frame_count] for part in parts)], axis=0, dtype=np.int64)
        return cls(parts, ends[:-1, 0], ends[:-1, 1], int(ends[-1, 0]))

    def widened(self, part: int, operator: FloatArray) -> FloatArray:
        """Operator (..., m_p) of a part's coordinates on those of all parts (..., m)."""
        result = np.zeros((*operator.shape[:-1], self.size))
        result[..., self.first[part] : self.first[part] + operator.shape[-1]] = operator
        return result

    def own(self, part: int, modes: FloatArray) -> FloatArray:
        """Rows of a part's coordinates (m_p, k) in modes (m, k) of all."""
        return modes[self.first[part] :][: self.parts[part].mode_count]

    def on(self, part: int, frame: IntArray) -> IntArray:
        """Numbers of a part's frames as those of the whole body."""
        return np.where(frame >= 0, frame + self.first_frame[part], GROUND)

    def motion(self, part: int, interface: int) -> FloatArray:
        """Displacement and rotation (6, m) of a part's interface."""
        body = self.parts[part]
        own = np.concatenate([body.interface_displacement[interface], body.interface_rotation[interface]])
        return self.widened(part, own)

    def joined(self, entries: Sequence[Entry], holders: Sequence[tuple[int, Any]], modes: FloatArray) -> dict[str, Any]:
        """Arrays of parts (number, holder) one after the other, by the body's modes and numbers of frames."""
        result = {}
        for entry in entries:
            own = [(p, array) for p, one in holders if (array := getattr(one, entry.name)) is not None]
            if own and entry.kind is int and "frame" in entry.name:
                result[entry.name] = np.concatenate([self.on(p, array) for p, array in own])
            elif own and entry.shape.endswith(" m"):
                result[entry.name] = np.concatenate([self.widened(p, array) for p, array in own]) @ modes
            elif own:
                result[entry.name] = np.concatenate([array for _, array in own])
        return result

    def holding(self, name: str) -> list[tuple[int, Any]]:
        """Parts that have something, by their numbers."""
        return [(p, one) for p, part in enumerate(self.parts) if (one := getattr(part, name)) is not None]


def join_parts(
    parts: Sequence[ReducedBody], welds: Sequence[Weld], loose: Sequence[BoolArray], interfaces: Sequence[str]
) -> tuple[ReducedBody, FloatArray, str]:
    """Join parts by stiff springs between their sections, and take the modes of the whole.

    Parameters
    ----------
    parts : sequence of ReducedBody
        With springs to the ground as ties.
    welds : sequence of Weld
    loose : sequence of (T,) bool
        For each part, which of its ties its modes do not hold yet.
    interfaces : sequence of str
        Names of those to keep, in their order.

    Returns
    -------
    body : ReducedBody
        Damping and other things of the whole body file are left to be set.
    modes : (m, k) float
        Its coordinates, in those of the parts laid end to end.
    note : str
        How stiff the joints are.

    Raises
    ------
    ModelError
        Parts that can move although they are joined.
    """
    stack = _Stack.of(parts)
    named = {name: (p, i) for p, body in enumerate(parts) for i, name in enumerate(body.interface_names)}
    places = [named[name] for name in interfaces]
    moved = np.array([stack.motion(*place) for place in places])
    values, modes, pull, turn = _modes_of_whole(stack, welds, loose, moved)
    body = made_body(
        BodyUse(parts[0].name),
        **stack.joined([entry for entry in ARRAYS["body"] if entry.name in _LAID], list(enumerate(parts)), modes),
        angular_frequency=np.sqrt(values),
        interface_names=tuple(interfaces),
        interface_point=np.array([parts[p].interface_point[i] for p, i in places]),
        interface_displacement=moved[:, :3] @ modes,
        interface_rotation=moved[:, 3:] @ modes,
        interface_frame=np.array([stack.on(p, parts[p].interface_frame)[i] for p, i in places]),
        frame_names=tuple(name for part in parts for name in part.frame_names),
        masses=Masses(**stack.joined(ARRAYS["masses"], held, modes)) if (held := stack.holding("masses")) else None,
        stress_sets=_stress_sets(stack, modes),
        surface=_surface(stack, modes, interfaces),
        ties=_ties(stack, welds, pull, turn, modes),
        second=_second_order(stack, welds, places, modes),
        membrane=joined_membrane(parts, modes),
    )
    return body, modes, f"joints of {pull:.3g} N/m and {turn:.3g} N m"


def _modes_of_whole(
    stack: _Stack, welds: Sequence[Weld], loose: Sequence[BoolArray], moved: FloatArray
) -> tuple[FloatArray, FloatArray, float, float]:
    """Eigenvalues (k,) and modes (m, k) of the joined parts, and the stiffness of their joints (N/m, N m).

    Interfaces move by `moved` (i, 6, m).
    """
    gap = np.array([stack.motion(*weld.first) - stack.motion(*weld.second) for weld in welds])
    squares = np.concatenate([part.angular_frequency for part in stack.parts]) ** 2
    stiffness = np.diag(squares)
    for p, part in enumerate(stack.parts):
        if part.ties is not None:
            rows = stack.widened(p, _stretch(part.ties, loose[p]))
            stiffness = stiffness + rows.T @ rows
    # Sections warp alike: linear in what frames do not turn, this holds for good and leaves fewer coordinates.
    unlike = [stack.widened(w.first[0], w.first_warping) - stack.widened(w.second[0], w.second_warping) for w in welds]
    alike = _null_space(np.concatenate(unlike), squares, gap.reshape(-1, stack.size))
    stiffness, gap = alike.T @ stiffness @ alike, gap @ alike
    pull, turn = _stiffness(stiffness, gap, moved.reshape(-1, stack.size) @ alike)
    rows = (gap * np.sqrt(np.repeat([pull, turn], 3))[:, None]).reshape(-1, len(stiffness))
    values, modes = np.linalg.eigh(stiffness + rows.T @ rows)
    if values[0] <= 0.0:
        raise ModelError(f"the lowest eigenvalue of the joined parts is {values[0]:.3e} 1/s²: they are free to move")
    large = np.argmax(np.abs(modes) >= _NEARLY_LARGEST * np.abs(modes).max(axis=0), axis=0)
    return values, alike @ (modes * np.sign(modes[large, np.arange(len(values))])), pull, turn


def _ties(stack: _Stack, welds: Sequence[Weld], pull: float, turn: float, modes: FloatArray) -> Ties:
    """Springs of the parts to the ground, then those of the joints."""
    parts, ends = stack.parts, [(weld.first, weld.second) for weld in welds]
    sections = np.array([[stack.motion(*first), stack.motion(*second)] for first, second in ends])
    found = {
        "frame": np.array([[stack.on(p, parts[p].interface_frame)[i] for p, i in both] for both in ends]),
        "point": np.array([[parts[p].interface_point[i] for p, i in both] for both in ends]),
        "displacement": sections[:, :, :3] @ modes,
        "rotation": sections[:, :, 3:] @ modes,
        "stiffness": np.full((len(welds), 3), pull),
        # Springs of stiffness k at e_x s, e_y s, e_z s resist turning by 2 k s².
        "lever": np.tile(np.sqrt(0.5 * turn / pull) * np.eye(3), (len(welds), 1, 1)),
    }
    own = stack.joined(ARRAYS["ties"], stack.holding("ties"), modes)
    return Ties(**{name: np.concatenate([own[name], one]) if own else one for name, one in found.items()})


def _null_space(rows: FloatArray, squares: FloatArray, gap: FloatArray) -> FloatArray:
    """Orthonormal combinations (m, m - r) of coordinates that rows (r, m) do not feel, but for what shut gaps imply.

    All but rigid sections, as of beams, warp by their resultants, which are in balance where gaps (6 W, m) are shut.
    """
    if not len(rows):
        return np.eye(squares.size)
    scale = 1.0 / np.sqrt(np.where(squares > 0.0, squares, squares[squares > 0.0].min()))
    _, values, turn = np.linalg.svd(rows * scale)
    rank = int((values > _DEPENDENT * values[0]).sum())
    left, own, _ = np.linalg.svd(rows * scale @ scipy.linalg.null_space(gap * scale))
    if (needed := int((own > _DEPENDENT * values[0]).sum())) < rank:
        turn, rank = np.linalg.svd(left[:, :needed].T @ rows * scale)[2], needed
    return np.linalg.qr((turn[rank:] * scale).T)[0]


def _stretch(ties: Ties, chosen: BoolArray) -> FloatArray:
    """Stretch of springs to the ground per unit coordinate, times the root of their stiffness, (12 T, m)."""
    turned = skew(np.swapaxes(ties.lever, 1, 2)) @ ties.rotation[:, :1]
    rows = np.concatenate([ties.displacement[:, :1], -turned], axis=1) * np.sqrt(ties.stiffness)[:, None, :, None]
    return rows[chosen].reshape(-1, rows.shape[-1])


def _stiffness(stiffness: FloatArray, gap: FloatArray, loads: FloatArray) -> tuple[float, float]:
    """Stiffness (N/m, N m) of the joints' springs that all but keeps their gaps (W, 6, m) shut under loads (l, m)."""
    count, size = 6 * len(gap), len(stiffness)
    rows = gap.reshape(count, size)
    # With the gaps shut: Λq + Cᵀλ = F, Cq = 0. Rigid motions of a part have no stiffness of their own.
    own = np.diag(stiffness)
    elastic = own > _ROUND_OFF * own.max()
    scale = 1.0 / np.sqrt(np.where(elastic, own, own[elastic].min()))
    length = np.linalg.norm(rows * scale, axis=1)
    matrix = np.zeros((size + count, size + count))
    matrix[:size, :size] = stiffness * np.outer(scale, scale)
    matrix[size:, :size] = rows * scale / length[:, None]
    matrix[:size, size:] = matrix[size:, :size].T
    right = np.zeros((size + count, len(loads)))
    right[:size] = (loads * scale).T
    try:
        solution = scipy.linalg.solve(matrix, right, assume_a="sym")
    except np.linalg.LinAlgError as error:
        raise ModelError(f"the parts do not make up a body that their supports hold ({error})") from error
    compliance = np.einsum("lm,ml->l", loads * scale, solution[:size])
    felt = np.sqrt(((solution[size:] / length[:, None]).reshape(len(gap), 2, 3, -1) ** 2).sum(axis=(0, 2)))
    free = compliance > _HELD * compliance.max()
    pull, turn = (felt[:, free] ** 2 / compliance[free]).max(axis=1) * 2.0 / _SHARE
    return float(pull), float(turn)


def _second_order(
    stack: _Stack, welds: Sequence[Weld], places: Sequence[tuple[int, int]], modes: FloatArray
) -> SecondOrder | None:
    """Second-order parts of the motions of all parts' nodes, in the order of the joined tree."""
    parts = stack.parts
    found = [part.second for part in parts]
    if any(second is None for second in found):
        return None
    frames = [part.frame_count for part in parts]
    masses = [0 if part.masses is None else len(part.masses.mass) for part in parts]
    ties = [0 if part.ties is None else len(part.ties.stiffness) for part in parts]
    ends = [f + p.interface_count + m for f, p, m in zip(frames, parts, masses, strict=True)]
    every = range(len(parts))
    rows = [(p, k) for p in every for k in range(frames[p])]
    rows += [(p, frames[p] + i) for p, i in places]
    rows += [(p, ends[p] - masses[p] + k) for p in every for k in range(masses[p])]
    for side, weld_ends in ((0, [w.first for w in welds]), (1, [w.second for w in welds])):
        rows += [(p, ends[p] + side * ties[p] + k) for p in every for k in range(ties[p])]
        rows += [(p, frames[p] + i) for p, i in weld_ends]

    def of_whole(name: str) -> FloatArray:
        turned = []
        for p, second in enumerate(found):
            own = stack.own(p, modes)
            turned.append(np.einsum("kiab,ac,bd->kicd", getattr(second, name), own, own, optimize=True))
        return np.array([turned[p][k] for p, k in rows])

    return SecondOrder(of_whole("displacement"), of_whole("rotation"))


def joined_membrane(parts: Sequence[ReducedBody], modes: FloatArray) -> Membrane | None:
    """Stretches of all parts, which have no shapes of their own, in modes (m, k) of all."""
    stack = _Stack.of(parts)
    held = [(part.membrane, stack.own(p, modes)) for p, part in enumerate(parts) if part.membrane is not None]
    found = [replace(one, basis=one.basis @ own, linear=one.linear @ own) for one, own in held]
    return Membrane.joined(found) if found else None


def _stress_sets(stack: _Stack, modes: FloatArray) -> tuple[StressSet, ...]:
    """Stress sets, put together where several parts have a share."""
    names = dict.fromkeys(own.name for part in stack.parts for own in part.stress_sets)
    result = []
    for name in names:
        found = [(p, own) for p, part in enumerate(stack.parts) for own in part.stress_sets if own.name == name]
        result.append(StressSet(name, **stack.joined(ARRAYS["stress"], found, modes)))
    return tuple(result)


def _surface(stack: _Stack, modes: FloatArray, interfaces: Sequence[str]) -> Surface | None:
    parts = stack.parts
    found = [(p, part.surface) for p, part in enumerate(parts) if part.surface is not None]
    if not found:
        return None
    first = np.concatenate([[0], np.cumsum([len(s.points) for _, s in found])[:-1]])

    def every(name: str) -> Any:
        parts_of = [getattr(surface, name) for _, surface in found]
        return None if any(part is None for part in parts_of) else np.concatenate(parts_of)

    fields, forms = _second_order_fields(stack, modes)
    stress = [(p, s.stress) for p, s in found if s.stress is not None]
    # Rotation by which a part's second-order motions are turned back; none where it cannot turn.
    turns = [(p, np.zeros((1, 3, parts[p].mode_count)) if s.turn is None else s.turn) for p, s in found]
    numbers = [_renumbered(parts[p].interface_names, s.interface, interfaces) for p, s in found]
    return Surface(
        every("points"),
        np.concatenate([s.faces + start for (_, s), start in zip(found, first, strict=True)]),
        np.concatenate([stack.widened(p, s.modes) for p, s in found]) @ modes,
        np.concatenate([stack.on(p, s.frame) for p, s in found]),
        np.concatenate(numbers),
        every("support"),
        fields,
        forms,
        np.concatenate([stack.widened(p, turn) for p, turn in turns]) @ modes,
        np.concatenate([np.zeros((1, 3)) if s.pivot is None else s.pivot for _, s in found]),
        np.repeat(np.arange(len(found)), [len(s.points) for _, s in found]),
        stress=np.concatenate([stack.widened(p, part) for p, part in stress]) @ modes if stress else None,
    )


def _renumbered(names: Sequence[str], number: IntArray | None, kept: Sequence[str]) -> IntArray:
    """Numbers of a part's interfaces as those of the whole body, −1 for sections that are no interface of it."""
    table = np.array([kept.index(name) if name in kept else -1 for name in names] + [-1])
    return np.zeros(0, dtype=np.int64) if number is None else table[number]


def _second_order_fields(stack: _Stack, modes: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
    """Second-order fields of the surfaces of all parts, each zero on the others, and their forms."""
    fields, forms = [], []
    for p, part in enumerate(stack.parts):
        if part.surface is None or part.surface.second is None or part.surface.form is None:
            return None, None
        own = stack.own(p, modes)
        fields.append(part.surface.second)
        forms.append(np.einsum("rab,ac,bd->rcd", part.surface.form, own, own, optimize=True))
    widths = np.cumsum([0, *(field.shape[2] for field in fields)])
    wide = [
        np.pad(field, ((0, 0), (0, 0), (start, widths[-1] - start - field.shape[2])))
        for field, start in zip(fields, widths[:-1], strict=True)
    ]
    return np.concatenate(wide), np.concatenate(forms)
