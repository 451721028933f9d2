"""Energy of the strain of second order that no displacement takes away (docs/theory.md, section 4c).

To a displacement Φq belongs the strain ½ GᵀG of second order, G = ∇(Φq). Method "second_order" moves its nodes by the
displacement w that takes this strain away as far as any can. What is left costs energy: all of it in a beam that is
held at both ends, hardly anything in one that is held at one.

Stress that turns with its material presses towards the inside of a bend: a thin tube flattens, and gives way by more.

In bodies like arches w itself bends the body. It is then no small addition to Φq: the shapes in which it turns the
material by far more than the square of its angle stay coordinates, and the energy gets a cubic part.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from ..fe.factorisation import GIGA, free_memory
from ..fe.gradients import mean_spin
from ..files.basics import FloatArray, IntArray, ModelError
from ..files.outputs import Reporter
from ..files.store import Store, content_key
from ..model.inertia import Membrane
from ..model.reduced_body import ReducedBody
from .basis import TENSE, TURNING, Matrices
from .fourth_order import STIFF, FourthOrder, energy_shares, pair_products, turning_scale
from .modes import Modes, balanced
from .third_order import lever_sums, missed_energy, turning_forces
from .watched import most_turned

# Directions in the coordinates whose pairs are looked at, at least and at most: 666 and 1830 static responses; between
# them so many that pairs times unknowns are no more. Of a plate on three feet with six interfaces, 58 coordinates, 36
# lacked shapes by which it evades its stretch: 1.1 % at 0.4 rad, unseen by its shadow; 60 leave 0.14.
_DIRECTIONS, _PAIRED = (36, 60), 3e7
# Energy of fourth order over that of second in a static response that turns the material by one radian (rms), up to
# which there is none: cantilevers and curved bars have 1e-4 to 1e-3, portal frames and rings 0.04 to 0.11, a cross
# pivot 0.09, plates 2, a twist-beam axle 0.4, its halves 4, arches 9, clamped beams 85.
_NOTHING = 0.02
# Rotation of the material (rms, rad) at which stretches are compared, the part of the softest motion's linear energy
# there up to which a stretch is left out, and the amplitude that every coordinate has at least, over that motion's.
_TURN, _LEAST, _AMPLITUDE = 0.5, 1e-3, 0.1
# The same of flattening: 0.001 to 0.07 in solid bars, frames, arches and plates, 0.12 in tubes with a wall of a tenth
# of their diameter.
# Stretching from which there is none: stress of shells that stretch is no bending of a slender member. With it
# a cap, at 36, was off by 4.2 % instead of 0.9, a half-cylinder, at 5, had no equilibrium; tubes and channels have 0.2.
_FLAT, _SHELL = 0.09, 4.0
_LOW_MODES = 6
# Turn by w over the square of the angle beyond which w is a motion of its own: 0.3 to 1.4 in cantilevers, curved bars
# and flat plates, 1.1 to 2.3 in a portal frame, by the basis, 5 in a shallow arch, 9 in a roof. And what one of these
# has in the mesh: 5 in that arch, 6 in a fan blade, more in roofs and caps. Arms of curved sheet on two feet have 3.3
# to 4.7: with two to four such shapes one was 3 % off, another had no equilibrium from a third of its critical load
# on.
_LARGE, _CLEAR = 3.3, 4.8
# Part of w's turn that the basis may miss: up to 0.23 in arches, 0.47 in a fan blade, which is 7 % off with that shape
# and 0.5 without, 1 and more in most others, whose only shapes along themselves bend as well.
_MISSED = 0.3
# Relative size below which a shape of w is no other than those before: at 1e-2 the limit load of an arch was 0.6 % low
# with forty modes, 0.09 % with twenty.
_SAME = 2e-3
# Part of the largest energy of pairs of coordinates up to which a combination of them is nothing: of stretching, whose
# largest may be many times what bends the body, in a shadow, in a body and in parts of a cut one, of which an axle has
# 208 at 1e-4 and 156 at 3e-3; and of flattening, which gives way without bound: at 1e-4 a parallelogram of leaves had
# no equilibrium at a quarter of its length. Of parts: an axle is as right with 77 of them, at 1e-2, as with 122, at
# 3e-3, a bow of thin tube is 0.42 and 0.39 % off at 1e-2 and 1e-3, 0.54 at 0.1, 0.7 without. A panel on two hinges was
# 2.9 % off at 3e-3, unseen by its shadow; at 1e-4 1.6, 2.6 by a shadow at 1e-5.
_FINER, _STRETCH, _OF_PARTS = 1e-5, 1e-4, 3e-3
_FLATTENED, _FLATTENED_PARTS = 3e-3, 1e-2
# Coordinates of which all pairs are answered whether their stretch counts or not; numbers up to which disks keep them.
_FEW, _KEPT = 24, 1_000_000
# How many motions under loads what places miss is known of, and how many stiffer ones by their first power: without
# these a bow told 0.7 to 4.8 times what it misses under a moment, with their squares a parallelogram of leaves 100 %.
# Of seven interfaces on soft ribs ten left 11 % untold, twenty told 3.5 % where it is 0.3: all 33 are right. So many as
# pairs times unknowns allow. Least deflection of one by a load of unit energy, and part of the softest one's linear
# energy up to which a square is left out: at 5e-4 a bar told 0.77 of its error.
_SOFTEST, _ALLOWED, _STIFFEST, _SOFT, _NO_SQUARE, _TAKEN = (10, 36), 1e7, 4, 1e-5, 5e-6, 0.5


@dataclass(frozen=True)
class Stretching:
    """What a body's stretch at second order is found from.

    Attributes
    ----------
    matrices : Matrices
    modes : Modes
        Those of frequency zero are rigid motions, which stretch nothing.
    loads : (3n, l) float
        Nodal forces of unit loads on the interfaces: of all forces, then of all moments.
    key : str
        Of the modes, as of `basis.modal_basis`.
    tied : bool
        Whether a tree holds springs of supports as joints: then what they resist at second order is left to it.
    part : bool
        Whether it is a part of a cut body.
    """

    matrices: Matrices
    modes: Modes
    loads: FloatArray
    key: str = ""
    tied: bool = False
    part: bool = False

    @cached_property
    def _elastic(self) -> IntArray:
        return np.flatnonzero(self.modes.angular_frequency > 0.0)

    @cached_property
    def _omega(self) -> FloatArray:
        return self.modes.angular_frequency[self._elastic]

    @property
    def _shapes(self) -> FloatArray:
        return self.modes.shapes[:, self._elastic]

    @cached_property
    def _spin(self) -> FloatArray:
        """Mean of ω_a·ω_b over the volume, ω = ½ curl φ, of coordinates of unit energy."""
        return mean_spin(self.matrices.model.mesh, self._shapes) / np.outer(self._omega, self._omega)

    @cached_property
    def motions(self) -> FloatArray:
        """Motions (n, e) that turn the material by a root mean square of one radian, in coordinates of unit energy.

        Responses to the interfaces' unit loads and the lowest modes, without those that stretch more than they turn.
        """
        found = np.concatenate([self.loads.T @ self._shapes / self._omega, np.eye(self._omega.size)[:_LOW_MODES]])
        scale = turning_scale((found**2).sum(axis=1), np.einsum("ia,ab,ib->i", found, self._spin, found))
        return found[scale > 0.0] * scale[scale > 0.0, None]

    @cached_property
    def _directions(self) -> FloatArray:
        """Orthonormal directions (e, r) of coordinates of unit energy whose pairs are looked at."""
        most = int(np.clip(np.sqrt(2.0 * _PAIRED / self.matrices.supported.free.size), *_DIRECTIONS))
        if self._omega.size <= most:
            return np.eye(self._omega.size)
        # After what motions consist of, the coordinates that turn the material most.
        turns = np.sqrt(np.diag(self._spin) / np.diag(self._spin).max())
        rest = np.diag(_AMPLITUDE * np.linalg.norm(self.motions, axis=1).min() * turns)
        return np.linalg.svd(np.concatenate([self.motions, rest]), full_matrices=False)[2][:most].T

    @cached_property
    def _pairs(self) -> IntArray:
        return np.stack(np.triu_indices(self._directions.shape[1]), axis=1)

    def _stretches(self) -> dict[str, FloatArray]:
        """What `FourthOrder.stretching` tells of all pairs of directions, and their work on coordinates, once."""

        def make() -> dict[str, FloatArray]:
            self._refuse_what_does_not_fit(len(self._pairs))
            unit = self._shapes / self._omega
            found = FourthOrder(self.matrices).stretching(unit @ self._directions, self._pairs, unit)
            return dict(zip(("energies", "work", "answers"), found, strict=True))

        key, store = content_key(__name__, "stretches", self.key, self._directions), self.matrices.store
        kept = store if len(self._pairs) * self.matrices.supported.free.size < _KEPT else Store()
        return store.last("stretches", key, lambda: kept.arrays(key, "stretches", Reporter(), make))

    def answers(self, found: bool) -> FloatArray | None:
        """Displacements (3n, p) by forces of products of two elastic coordinates, of the second order, pair by pair.

        None of many coordinates, unless the membrane energy has `found` them: to find no more than is asked for costs
        less.
        """
        if self._omega.size > (self._directions.shape[1] if found else _FEW):
            return None
        answers = self.matrices.supported.whole(self._stretches()["answers"])
        answers *= self._omega[self._pairs].prod(axis=1)
        return answers

    def _forms(self, energies: FloatArray, first: IntArray, second: IntArray, least: float) -> FloatArray:
        """Forms (r, p) whose squares add up to an energy (p, p) of pairs of coordinates, but for small ones."""
        norms, motions = np.linalg.norm(self.motions, axis=1), self.motions @ self._directions
        # How large coordinates of unit energy get in motions that turn by `_TURN`.
        size = _TURN * np.maximum(np.abs(motions).max(axis=0), _AMPLITUDE * norms.min())
        # Pairs of two coordinates stand for two.
        root = np.where(first == second, 1.0, np.sqrt(2.0)) * size[first] * size[second]
        values, vectors = np.linalg.eigh(energies * np.outer(root, root))
        kept = values > max(least * values[-1], _LEAST * 0.5 * (_TURN * norms.min()) ** 2)
        return (vectors[:, kept] * np.sqrt(values[kept]) / root[:, None]).T

    def _flattening(self) -> FloatArray:
        """Energy (p, p) that stress which turns with its material sets free outside the basis."""
        fourth = FourthOrder(self.matrices)
        forces = fourth.flattening_forces(self._shapes / self._omega @ self._directions, self._pairs)
        held = self.matrices.supported.unknowns.of(self._shapes).T @ forces / self._omega[:, None]
        return 0.5 * (fourth.released(forces, f"Static response to {len(self._pairs)} flattenings") - held.T @ held)

    def membrane(self, stretching: bool, flattening: bool, keep_shapes: bool, least: float) -> Membrane:
        """Stretches of the whole basis.

        Parameters
        ----------
        stretching, flattening : bool
            Which of both energies.
        keep_shapes : bool
            Whether shapes of w may stay coordinates.
        least : float
            Part of the largest energy up to which a stretch is left out.

        Returns
        -------
        Membrane
        """
        count, (first, second) = self._omega.size, self._pairs.T
        # Rows of forms by pair, and what is linear beside them, in coordinates of unit energy.
        forms, linear, signs = [], [], []
        if stretching:
            found = self._stretches()
            energies, against, answers = found["energies"], found["work"], found["answers"]
            if self.tied:
                spring = self.matrices.model.spring.ravel()
                pulled = np.sqrt(spring[spring > 0.0, None]) * self.matrices.supported.whole(answers)[spring > 0.0]
                energies = energies - 0.5 * pulled.T @ pulled
            forms.append(self._forms(energies, first, second, least))
            if keep_shapes:
                # w = −C(q, q).
                shapes = self._turning_shapes(energies, against, answers, least == _FINER)
                forms.append(shapes.T @ against / np.sqrt(2.0))
                linear = [np.zeros((len(forms[0]), count)), shapes.T / np.sqrt(2.0)]
            signs = [np.ones(len(rows)) for rows in forms]
        if flattening:
            small = _FLATTENED if keep_shapes else _FLATTENED_PARTS
            forms.append(self._forms(self._flattening(), first, second, small))
            signs.append(-np.ones(len(forms[-1])))
        linear += [np.zeros((len(rows), count)) for rows in forms[len(linear) :]]
        return self._membrane_of(np.concatenate(forms), np.concatenate(linear), np.concatenate(signs))

    def _membrane_of(self, forms: FloatArray, linear: FloatArray, sign: FloatArray) -> Membrane:
        """Of rows by pairs of directions (r, p), of what is linear beside them (r, e), and of signs (r,)."""
        first, second = self._pairs.T
        wide = (self._directions * self._omega[:, None]).T
        whole = np.zeros((len(forms), *2 * [len(wide)]))
        whole[:, first, second] = whole[:, second, first] = forms
        basis = np.zeros((len(wide), self.modes.angular_frequency.size))
        basis[:, self._elastic] = wide
        of_modes = np.zeros((len(forms), basis.shape[1]))
        of_modes[:, self._elastic] = linear * self._omega
        return Membrane.of(basis, whole, of_modes, sign, sign)

    def keeping(self, membrane: Membrane, shapes: FloatArray) -> Membrane:
        """The same with other shapes (m, k) of w as coordinates, orthonormal in energy."""
        rows = (shapes[self._elastic] * self._omega[:, None]).T / np.sqrt(2.0)
        own = self._membrane_of(rows @ self._stretches()["work"], rows, np.ones(len(rows)))
        return Membrane.joined([membrane.shapeless, own])

    def third_order(self, membrane: Membrane, body: ReducedBody) -> Membrane:
        """The same, and what the places of a body with it miss at third order in its softest motions under loads."""
        unit, mesh, count = self._shapes / self._omega, self.matrices.model.mesh, self.loads.shape[1] // 2
        # Motions of unit energy, and the loads that cause them, which no rigid motion feels.
        # Loads that supports take cause next to nothing: the motion of a unit of it would take huge ones.
        held = np.linalg.norm(self.loads[self.matrices.model.fixed.ravel()], axis=0)
        acting = held < _TAKEN * np.linalg.norm(self.loads, axis=0)
        ways = acting[:, None] * balanced(self.matrices.supported, self.matrices.supported.forces(self.loads * acting))
        caused, sizes, found = np.linalg.svd((self.loads @ ways).T @ unit, full_matrices=False)
        kept = sizes > _SOFT * sizes.max(initial=0.0)
        if not kept.any():
            return membrane
        caused, found = ways @ caused[:, kept] / sizes[kept], found[kept]
        # What strains a material counts as what turns it does.
        moved = (unit @ found.T).reshape(len(mesh.points), 3, -1)
        elements = np.arange(mesh.element_count)
        strained = sum(most_turned(mesh, moved, elements, np.zeros((3, 1)), np.eye(len(found)))[2])
        turned, axes = np.linalg.eigh(found @ self._spin @ found.T + strained)
        most = np.clip(int(np.sqrt(2.0 * _ALLOWED / len(unit))) - _STIFFEST, *_SOFTEST)
        axes = axes[:, -(soft := (turned > STIFF * turned[-1])[-most:].sum()) - _STIFFEST :]
        size = _TURN / np.sqrt(np.maximum(turned, STIFF * turned[-1])[-axes.shape[1] :])
        motions = axes.T @ found
        every = (caused @ axes * size).T.reshape(len(size), 2, -1, 3).swapaxes(1, 2).reshape(len(size), -1, 6)
        pairs = np.stack(np.triu_indices(len(size)), axis=1)
        shapes = np.sqrt(2.0) * membrane.linear[membrane.linear.any(axis=1)][:, self._elastic] / self._omega
        (q, rows), scale = np.zeros((2, len(size), self.modes.angular_frequency.size)), size[:, None] / self._omega
        q[:, self._elastic], rows[:, self._elastic] = motions * scale, motions / scale
        fields, moments = unit @ (motions.T * size), self.loads[:, count:]
        off = body.interface_point - (mesh.points.ravel() @ self.loads[:, :count]).reshape(-1, 3)
        sums = lever_sums(moments, mesh.points[None]), lever_sums(moments, fields.T.reshape(len(size), -1, 3)), off
        turning = turning_forces(moments, every, np.einsum("icm,rm->ric", body.interface_rotation, q), *sums)
        find = partial(FourthOrder(self.matrices).third_order_work, fields, pairs, unit, shapes.T, turning)
        # Frames have no part in it.
        work = self.matrices.kept(content_key(__name__, self.key, fields, shapes, turning), "work of third order", find)
        bushings, least = self.matrices.model.bushings, _NO_SQUARE * size.min() ** 2
        pulls = np.hstack([every.reshape(len(size), -1), (bushings.rows @ fields).T])
        # Joints ring: what is stiff by itself is theirs.
        stiff = len(size) - soft, 0 if self.part else len(size) - soft
        forms, signs = missed_energy(body, q, pulls, *stiff, sums, work, least, partial(bushings.third, fields))
        # Stiffness is of fifth order, of which this is a part only.
        more = Membrane.of(rows, forms, np.zeros((len(forms), rows.shape[1])), signs, 0.0 * signs)
        return Membrane.joined([membrane, more])

    def _refuse_what_does_not_fit(self, pairs: int) -> None:
        """Refuse more pairs than the memory holds, before any is begun."""
        # Forces, those of the free degrees of freedom, energies and their eigenvectors.
        needed, free = 8.0 * pairs * (2.0 * len(self.modes.shapes) + 4.0 * pairs), free_memory()
        if free is not None and needed > free:
            raise ModelError(
                f"membrane energy of {pairs} pairs of modes takes {needed / GIGA:.1f} GB of memory, "
                f"{free / GIGA:.1f} GB are free: take fewer modes, end other programs, or set membrane = false in "
                "[reduction]"
            )

    def _turning_shapes(
        self, energies: FloatArray, against: FloatArray, answers: FloatArray, finer: bool
    ) -> FloatArray:
        """Orthonormal shapes (e, k) of w that turn the material by more than the square of the motions' angle.

        The basis may know a mere shortening by shapes that bend as well: it misses a part of the turn at most.
        """
        one, other = np.triu_indices(len(self.motions))
        motions = (self.motions @ self._directions).T
        amplitudes = pair_products(motions[:, one], motions[:, other])
        size = np.linalg.norm(motions, axis=0)
        tense = _TURN**2 * (amplitudes * (energies @ amplitudes)).sum(axis=0) > 0.5 * TENSE * size[one] * size[other]
        found = against @ amplitudes
        large = (found * (self._spin @ found)).sum(axis=0) > np.where(tense & finer, TURNING, _LARGE) ** 2
        found, unit = found[:, large], self._shapes / self._omega
        if not large.any():
            return found
        fields = self.matrices.supported.whole(answers @ amplitudes[:, large])
        mesh = self.matrices.model.mesh
        # How far the material turns (rms), and how far where the basis does not know of it.
        turned, missed = (np.sqrt(mean_spin(mesh, one).diagonal()) for one in (fields, fields - unit @ found))
        known = missed < _MISSED * turned
        found = found[:, known & np.any(known & ((turned > _CLEAR) | (tense & finer)[large]))]
        shapes, sizes, _ = np.linalg.svd(found, full_matrices=False)
        return shapes[:, sizes > _SAME * sizes[:1]]


def membrane_energy(
    stretching: Stretching, wanted: bool | Literal["auto", "finer"], keep_shapes: bool
) -> Membrane | None:
    """Stretches of a body, where it stretches when it bends or the body file asks for them.

    Parameters
    ----------
    stretching : Stretching
    wanted : bool, "auto" or "finer"
        As of `BodyOptions`.
    keep_shapes : bool
        As of `Stretching.membrane`.

    Returns
    -------
    Membrane or None
    """
    matrices, report = stretching.matrices, stretching.matrices.report
    stretched, flattened, least = bool(wanted), wanted is True, _STRETCH if keep_shapes else _OF_PARTS
    if wanted == "finer":
        least = _FINER
    if wanted == "auto":
        held, freed = energy_shares(matrices, stretching.loads[:, : stretching.loads.shape[1] // 2]).tolist()
        stretched, flattened = held > _NOTHING, freed > _FLAT and held < _SHELL
        report.detail(
            "membrane energy over that of bending at a turn of 1 rad (rms): "
            f"{held:.2g} of stretching, {_taken(stretched)}; {freed:.2g} of flattening, {_taken(flattened)}"
        )
    if not stretched and not flattened:
        return None
    how = stretching.tied, keep_shapes, stretched, flattened, least
    key = content_key(__name__, stretching.key, stretching.loads, *how)
    find = partial(stretching.membrane, stretched, flattened, keep_shapes, least)
    membrane = _kept(matrices, key, "membrane energy", find)
    if not membrane.sign.size:
        return None
    report.detail(membrane.words)
    return membrane


def completed_body(stretching: Stretching, body: ReducedBody) -> ReducedBody:
    """A body that has as energy what its places miss at third order, unless ties work on them, too."""
    if body.ties is not None:
        return body
    none = np.zeros((0, body.mode_count))
    membrane = body.membrane or Membrane.of(none, np.zeros((0, 0, 0)), none, np.zeros(0), np.zeros(0))
    places = stretching.part, body.frame_parent, body.joint_displacement, body.frame_rotation, body.interface_frame
    key = content_key(__name__, "third order", stretching.key, stretching.loads, *asdict(membrane).values(), *places)
    find = partial(stretching.third_order, membrane, body)
    return replace(body, membrane=_kept(stretching.matrices, key, "what places miss at third order", find))


def _kept(matrices: Matrices, key: str, title: str, find: Callable[[], Membrane]) -> Membrane:
    kept: dict[str, Any] = matrices.store.arrays(key, title, matrices.report, lambda: asdict(find()))
    return Membrane(**kept)


def _taken(along: bool) -> str:
    return "taken along" if along else "left out"
