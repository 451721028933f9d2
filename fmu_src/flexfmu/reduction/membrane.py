"""Energy of the strain of second order that no displacement takes away (docs/theory.md, section 4c).

To a displacement Φq belongs the strain ½ GᵀG of second order, G = ∇(Φq). Method "second_order" moves its nodes by the
displacement w that takes this strain away as far as any can. What is left costs energy: all of it in a beam that is
held at both ends, hardly anything in one that is held at one.

Stress that turns with its material presses towards the inside of a bend: a thin tube flattens, and gives way by more.

In bodies like arches w itself bends the body. It is then no small addition to Φq: the shapes in which it turns the
material by far more than the square of its angle stay coordinates, and the energy gets a cubic part.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..fe.memory import GIGA, free_memory
from ..fe.quadratic_strain import mean_spin, quadratic_strain
from ..fe.turned_stress import turned_stress
from ..mesh.model import FloatArray, IntArray, Mesh
from ..model.membrane import Membrane
from ..progress import Reporter
from ..store import Store, content_key
from .basis import Matrices
from .modes import Modes

# Energy of fourth order over that of second in a motion that turns the material by one radian (rms), up to which it is
# left out: it is then a fortieth at half a radian within a frame, the most that is trusted. Cantilevers and curved bars
# have 1e-4 to 1e-3; a twisted plate has 2, arches and beams held at both ends 5 and more.
_NOTHING = 0.1
# The same of flattening: 0.006 to 0.03 in solid bars and plates, 0.3 to 5 in arches and roofs, 0.45 in tubes with a
# wall of a tenth of their diameter.
_FLAT = 0.05
# Motions that turn the material less than this of the most turning one, in squares at the same energy, stretch it.
_STIFF = 1e-2
_LOW_MODES = 6
# Turn by w over the square of the angle beyond which w is a motion of its own: 0.3 to 1.4 in cantilevers, curved bars
# and flat plates, 5 in a shallow arch.
_LARGE = 2.0
# Relative size below which a shape of w is no other than those before.
_SAME = 1e-2
# Part of the largest energy of pairs of coordinates, each of unit energy, up to which a combination of them is nothing.
TOLERANCE = 1e-2
# Right-hand sides at a time.
_COLUMNS = 64


@dataclass(frozen=True)
class Stretching:
    """What a body's stretch at second order is found from.

    Attributes
    ----------
    matrices : Matrices
    modes : Modes
        Those of frequency zero are rigid motions, which stretch nothing.
    loads : (3n, l) float
        Nodal forces of unit loads on the interfaces.
    report : Reporter
    """

    matrices: Matrices
    modes: Modes
    loads: FloatArray
    report: Reporter

    @property
    def _mesh(self) -> Mesh:
        return self.matrices.model.mesh

    @cached_property
    def _elastic(self) -> IntArray:
        return np.flatnonzero(self.modes.angular_frequency > 0.0)

    @cached_property
    def _omega(self) -> FloatArray:
        return self.modes.angular_frequency[self._elastic]

    @cached_property
    def _spin(self) -> FloatArray:
        """Mean of ω_a·ω_b over the volume, ω = ½ curl φ, of coordinates of unit energy."""
        result: FloatArray = mean_spin(self._mesh, self.modes.shapes[:, self._elastic]) / np.outer(
            self._omega, self._omega
        )
        return result

    @cached_property
    def motions(self) -> FloatArray:
        """Motions (n, e) that turn the material by a root mean square of one radian, in coordinates of unit energy.

        Responses to the interfaces' unit loads and the lowest modes, without those that stretch more than they turn.
        """
        found = np.concatenate(
            [self.loads.T @ self.modes.shapes[:, self._elastic] / self._omega, np.eye(self._omega.size)[:_LOW_MODES]]
        )
        energy = (found**2).sum(axis=1)
        found = found[energy > 0.0] / np.sqrt(energy[energy > 0.0])[:, None]
        turned = np.einsum("ia,ab,ib->i", found, self._spin, found)
        soft = turned > _STIFF * turned.max()
        result: FloatArray = found[soft] / np.sqrt(turned[soft])[:, None]
        return result

    def shares(self) -> tuple[float, float]:
        """The largest energy of fourth order over that of second, of `motions`: of stretching, and of flattening."""
        motions = self.motions
        fields = self.modes.shapes[:, self._elastic] @ (motions / self._omega).T
        each = np.arange(len(motions))
        pairs = np.stack([each, each], axis=1)
        linear = 0.5 * (motions**2).sum(axis=1)
        stretched, flattened = self._energies(fields, pairs)[0], self._flattening(fields, pairs)
        return float(np.max(np.diag(stretched) / linear)), float(np.max(np.diag(flattened) / linear))

    def _flattening(self, fields: FloatArray, pairs: IntArray) -> FloatArray:
        """Energy (p, p) that stress which turns with its material sets free outside the basis."""
        model, count = self.matrices.supported, len(pairs)
        applied = model.whole(model.stiffness @ fields[model.free])
        with self.report.counted(
            f"Flattening of {count} pairs of motions", self._mesh.element_count, "elements"
        ) as tell:
            forces = turned_stress(self._mesh, fields, applied, pairs, tell)[model.free]
        held = self.modes.shapes[:, self._elastic][model.free].T @ forces / self._omega[:, None]
        return 0.5 * (self._released(forces, f"Static response to {count} flattenings") - held.T @ held)

    def _released(self, forces: FloatArray, title: str) -> FloatArray:
        """Work (p, p) of nodal forces on free degrees of freedom over the displacements that they make."""
        model, count = self.matrices.supported, forces.shape[1]
        result = np.empty((count, count))
        with self.report.counted(title, count, "solutions") as tell:
            for first in range(0, count, _COLUMNS):
                part = slice(first, first + _COLUMNS)
                result[:, part] = forces.T @ model.static(forces[:, part])
                tell(first)
        return 0.5 * (result + result.T)

    def _energies(self, fields: FloatArray, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
        """A (p, p) of pairs of displacement fields, and the nodal forces (3n, p)."""
        count = len(pairs)
        with self.report.counted(f"Stretch of {count} pairs of motions", self._mesh.element_count, "elements") as tell:
            forces, energies = quadratic_strain(self._mesh, fields, pairs, tell)
        free = forces[self.matrices.supported.free]
        return 0.5 * (energies - self._released(free, f"Static response to {count} stretches")), forces

    def membrane(self, stretching: bool, flattening: bool, keep_shapes: bool) -> Membrane:
        """Stretches of the whole basis.

        Parameters
        ----------
        stretching, flattening : bool
            Which of both energies.
        keep_shapes : bool
            Whether shapes of w may stay coordinates.

        Returns
        -------
        Membrane
        """
        count = self._omega.size
        first, second = np.triu_indices(count)
        self._refuse_what_does_not_fit(len(first))
        fields, pairs = self.modes.shapes[:, self._elastic] / self._omega, np.stack([first, second], axis=1)
        # Rows of forms by pair, and what is linear beside them, in coordinates of unit energy.
        forms, linear, signs = [], [], []
        if stretching:
            energies, forces = self._energies(fields, pairs)
            forms.append(_forms(energies, first == second))
            if keep_shapes:
                # w = −C(q, q).
                against = fields.T @ forces
                shapes = self._turning_shapes(against, first, second)
                forms.append(shapes.T @ against / np.sqrt(2.0))
                linear = [np.zeros((len(forms[0]), count)), shapes.T / np.sqrt(2.0)]
            signs = [np.ones(len(rows)) for rows in forms]
        if flattening:
            forms.append(_forms(self._flattening(fields, pairs), first == second))
            signs.append(-np.ones(len(forms[-1])))
        linear += [np.zeros((len(rows), count)) for rows in forms[len(linear) :]]
        found, wide = np.concatenate(forms), np.concatenate(linear) * self._omega
        scaled = found * self._omega[first] * self._omega[second]
        modes, elastic = self.modes.angular_frequency.size, self._elastic
        result = Membrane(np.zeros((len(found), modes, modes)), np.zeros((len(found), modes)), np.concatenate(signs))
        result.quadratic[:, elastic[first], elastic[second]] = scaled
        result.quadratic[:, elastic[second], elastic[first]] = scaled
        result.linear[:, elastic] = wide
        return result

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

    def _turning_shapes(self, against: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
        """Orthonormal shapes (e, k) of w that turn the material by more than the motions that make them do."""
        motions, large = self.motions, []
        for i, one in enumerate(motions):
            for other in motions[: i + 1]:
                pair = one[first] * other[second] + np.where(first == second, 0.0, one[second] * other[first])
                w = against @ pair
                if w @ self._spin @ w > _LARGE**2:
                    large.append(w)
        if not large:
            return np.zeros((self._omega.size, 0))
        shapes, sizes, _ = np.linalg.svd(np.array(large).T, full_matrices=False)
        result: FloatArray = shapes[:, sizes > _SAME * sizes[0]]
        return result


def _forms(energies: FloatArray, alike: NDArray[np.bool_]) -> FloatArray:
    """Forms (r, p) whose squares add up to an energy (p, p) of pairs; `alike` where a pair is one motion twice."""
    # All others stand for two.
    root = np.where(alike, 1.0, np.sqrt(2.0))
    values, vectors = np.linalg.eigh(energies * np.outer(root, root))
    kept = values > TOLERANCE * values[-1]
    result: FloatArray = (vectors[:, kept] * np.sqrt(values[kept]) / root[:, None]).T
    return result


def membrane_energy(
    stretching: Stretching, modes_key: str, asked: bool, keep_shapes: bool, store: Store
) -> Membrane | None:
    """Stretches of a body, where it stretches when it bends or the body file asks for them.

    Parameters
    ----------
    stretching : Stretching
    modes_key : str
        As of `basis.modal_basis`.
    asked : bool
        Whether it is to be there whatever it holds.
    keep_shapes : bool
        As of `Stretching.membrane`.
    store : Store

    Returns
    -------
    Membrane or None
    """
    report = stretching.report
    key = content_key(__name__, modes_key, stretching.loads, keep_shapes)

    def shares() -> dict[str, FloatArray]:
        return {"shares": np.array(stretching.shares())}

    stretched = flattened = asked
    if not asked:
        held, freed = store.arrays(f"{key}-shares", "shares of membrane energy", report, shares)["shares"]
        stretched, flattened = bool(held > _NOTHING), bool(freed > _FLAT)
        report.note(
            "membrane energy over that of bending at a turn of 1 rad (rms): "
            f"{held:.2g} of stretching, {_taken(stretched)}; {freed:.2g} of flattening, {_taken(flattened)}"
        )
        if not stretched and not flattened:
            return None

    def make() -> dict[str, FloatArray]:
        made = stretching.membrane(stretched, flattened, keep_shapes)
        return {"quadratic": made.quadratic, "linear": made.linear, "sign": made.sign}

    membrane = Membrane(**store.arrays(f"{key}-{stretched}-{flattened}", "membrane energy", report, make))
    report.note(membrane.words)
    return membrane


def _taken(along: bool) -> str:
    return "taken along" if along else "left out"
