"""Energies of fourth order in displacements of a finite element model (docs/theory.md, section 4c)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..fe.gradients import mean_spin, quadratic_strain, turned_stress
from ..files.array_types import FloatArray, IntArray
from ..files.store import content_key
from ..mesh.model import Mesh
from .basis import Matrices
from .flattening import slices, without_resultants

# Motions that turn the material less than this of the most turning one, in squares at the same energy, stretch it.
_STIFF = 1e-2
# Energy below this share of the largest: a load on a support.
_NONE = 1e-12
# Right-hand sides at a time.
_COLUMNS = 16


@dataclass(frozen=True)
class FourthOrder:
    """What strain of second order, and stress that turns, hold in pairs of displacement fields.

    Attributes
    ----------
    matrices : Matrices
    """

    matrices: Matrices

    @property
    def _mesh(self) -> Mesh:
        return self.matrices.model.mesh

    @cached_property
    def _slices(self) -> list[IntArray]:
        return slices(self._mesh, self.matrices.model.anchored)

    def stretching(self, fields: FloatArray, pairs: IntArray) -> tuple[FloatArray, FloatArray]:
        """Energy of the strain of second order that no displacement takes away.

        Parameters
        ----------
        fields : (3n, m) float
        pairs : (p, 2) int

        Returns
        -------
        energies : (p, p) float
            A of (18a).
        forces : (3n, p) float
            f of (18a).
        """
        count, mesh = len(pairs), self._mesh
        title = f"Stretch of {count} pairs of motions"
        with self.matrices.report.counted(title, mesh.element_count, "elements") as tell:
            forces, energies = quadratic_strain(mesh, fields, pairs, tell)
        bushings = self.matrices.model.bushings
        own = 0.5 * bushings.curvature(fields)[:, pairs[:, 0], pairs[:, 1]]
        forces, energies = forces + bushings.rows.T @ own, energies + own.T @ own
        free = self.matrices.supported.forces(forces)
        return 0.5 * (energies - self.released(free, f"Static response to {count} stretches")), forces

    def flattening_forces(self, fields: FloatArray, pairs: IntArray) -> FloatArray:
        """Forces on free degrees of freedom by which stress that turns with its material flattens sections.

        Parameters
        ----------
        fields : (3n, m) float
        pairs : (p, 2) int

        Returns
        -------
        (k, p) float
            g of (18c).
        """
        model, mesh = self.matrices.supported, self._mesh
        # Forces of springs to the ground keep their axes.
        applied = model.applied(fields) - self.matrices.model.springs @ fields
        with self.matrices.report.counted(
            f"Flattening of {len(pairs)} pairs of motions", mesh.element_count, "elements"
        ) as tell:
            forces = turned_stress(mesh, fields, applied, pairs, tell)
        return model.forces(without_resultants(mesh.points, forces, self._slices))

    def released(self, forces: FloatArray, title: str) -> FloatArray:
        """Work (p, p) of nodal forces on free degrees of freedom (k, p) over the displacements that they make."""
        model, count = self.matrices.supported, forces.shape[1]
        result = np.empty((count, count))
        with self.matrices.report.counted(title, count, "solutions") as tell:
            for first in range(0, count, _COLUMNS):
                part = slice(first, first + _COLUMNS)
                result[:, part] = forces.T @ model.static(forces[:, part])
                tell(first)
        return 0.5 * (result + result.T)

    def turns(self, forces: FloatArray) -> FloatArray:
        """Rotation (p,) of the material, rms over its volume, in static responses to nodal forces (3n, p)."""
        model, count = self.matrices.supported, forces.shape[1]
        result = np.empty(count)
        for first in range(0, count, _COLUMNS):
            part = slice(first, first + _COLUMNS)
            fields = model.whole(model.static(model.forces(forces[:, part])))
            result[part] = np.sqrt(np.diag(mean_spin(self._mesh, fields)))
        return result

    def responses(self, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Static responses to nodal forces (3n, l) and accelerations along the axes that are no mere stretch.

        Returns
        -------
        fields : (3n, k) float
            Turn the material by one radian (rms), m.
        energies : (k,) float
            Of linear strain, J.
        """
        model = self.matrices.supported
        found = model.static(model.forces(np.hstack([forces, model.inertia])))
        fields = model.whole(found)
        energy = 0.5 * np.einsum("ij,ij->j", found, model.stiffness @ found)
        scale = turning_scale(energy, np.diag(mean_spin(self._mesh, fields)))
        chosen = scale > 0.0
        return fields[:, chosen] * scale[chosen], (energy * scale**2)[chosen]

    def shares(self, forces: FloatArray) -> FloatArray:
        """The largest shares (2,) of stretching and flattening in the responses to nodal forces (3n, l)."""
        fields, linear = self.responses(forces)
        if not linear.size:
            return np.zeros(2)
        pairs = np.repeat(np.arange(linear.size)[:, None], 2, axis=1)
        held = self.stretching(fields, pairs)[0]
        flat = self.flattening_forces(fields, pairs)
        freed = 0.5 * self.released(flat, f"Static response to {linear.size} flattenings")
        return np.array([np.max(np.diag(part) / linear) for part in (held, freed)])


def turning_scale(energy: FloatArray, turned: FloatArray) -> FloatArray:
    """What makes motions turn the material by one radian; zero for those that stretch it or that are none.

    Parameters
    ----------
    energy : (k,) float
        Linear energy of each.
    turned : (k,) float
        Mean square of the material's rotation.

    Returns
    -------
    (k,) float
    """
    real = energy > _NONE * energy.max()
    ease = np.divide(turned, energy, out=np.zeros_like(energy), where=real)
    soft = ease > _STIFF * ease.max()
    # What does not turn at all may be less than nothing by round-off.
    return np.divide(1.0, np.sqrt(np.maximum(turned, 0.0)), out=np.zeros_like(energy), where=soft)


def energy_shares(matrices: Matrices, forces: FloatArray) -> FloatArray:
    """Shares of a body's energies of fourth order, whatever modes are taken; found once and kept by content.

    Moments are left out: on an interface between supports they bend slices that are not quite straight across.

    Parameters
    ----------
    matrices : Matrices
    forces : (3n, l) float
        Nodal forces of unit forces on the interfaces.

    Returns
    -------
    (2,) float
        Energy of stretching and of flattening over the linear one, where the material turns by one radian (rms).
    """
    key = content_key(__name__, "shares", matrices.key, forces)
    return matrices.kept(key, "shares of membrane energy", lambda: FourthOrder(matrices).shares(forces))
