"""Energies of fourth order in displacements of a finite element model (docs/theory.md, section 4c).

Stress that turns with its material presses upon each section of a bend. What the sections feel as a whole, forces and
moments, bends the body as loads do, which act on the deformed body already. What is left flattens.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..fe.factorisation import AT_A_TIME
from ..fe.gradients import mean_spin, quadratic_strain, stressed_gradients, turned_stress
from ..files.basics import FloatArray, IntArray
from ..files.outputs import tell_nobody
from ..files.store import content_key
from ..mesh.model import Mesh
from .basis import Matrices
from .cut.loops import SLENDER
from .division import distance_along, equal_labels, linked
from .rigid_fit import rigid_motions

# Slices between the supports and what is farthest from them: bending within one of them is none of the body's.
_LEVELS = 32
# Squared length over which distances are evened, over the mean area of a section; distance over the longest by which
# elements are apart that lie on each other, as of doubled sheets.
_EVEN, _APART = 4.0, 1e-5
# As of a level's boundary: round-off must not decide.
_DIGITS = 9
# Residual at which evened distances are as exact as round-off lets them be, and iterations that are enough for it.
_SETTLED, _ROUNDS = 1e-14, 10_000


def slices(mesh: Mesh, anchored: IntArray) -> list[IntArray]:
    """Slices across the slender members of a body.

    Parameters
    ----------
    mesh : Mesh
    anchored : (k,) int
        Nodes of the supports; none of a free body, which is sliced from the node farthest from its middle.

    Returns
    -------
    list of (k,) int
        Nodes of each, none of them twice. Pieces wider than a section of a slender member, as of plates, are left out.
    """
    if not anchored.size:
        anchored = np.array([np.argmax(np.linalg.norm(mesh.points - mesh.points.mean(axis=0), axis=1))])
    distance = distance_along(mesh, anchored)
    way = float(distance.max())
    link = linked(mesh)
    middle = _across(mesh, link, mesh.element_means(distance), way)
    level = np.floor(np.round(_LEVELS * middle / way, _DIGITS)).astype(np.int64)
    piece = connected_components(link.multiply(equal_labels(link, level)), directed=False)[1]
    owner = np.full(len(mesh.points), -1)
    for block, own in zip(mesh.blocks, mesh.split(piece), strict=True):
        owner[block.connectivity] = own[:, None]
    found = [np.flatnonzero(owner == number) for number in np.unique(owner[owner >= 0])]
    return [one for one in found if np.linalg.norm(np.ptp(mesh.points[one], axis=0)) <= SLENDER * way]


def _across(mesh: Mesh, link: sp.csr_array, distance: FloatArray, way: float) -> FloatArray:
    """Distances (e,) made even across each section: the shorter way inside of a bend would have slices lie askew."""
    pairs = link.tocoo()
    centre = mesh.element_means(mesh.points)
    volume = mesh.volumes
    flow = pairs.data / np.maximum(np.linalg.norm(centre[pairs.row] - centre[pairs.col], axis=1), _APART * way)
    spread = sp.csr_array(sp.coo_array((-flow, (pairs.row, pairs.col)), shape=link.shape))
    spread = spread - sp.diags_array(np.asarray(spread.sum(axis=1)))
    # Differences within a section of the mean area fade to a fortieth, those along the body stay.
    matrix = sp.csr_array(sp.diags_array(volume) + _EVEN * volume.sum() / way * spread)
    # Factors of large meshes would take gigabytes. What the iteration leaves when it ends is round-off.
    scale = sp.diags_array(1.0 / matrix.diagonal())
    return spla.cg(matrix, volume * distance, x0=distance, rtol=_SETTLED, M=scale, maxiter=_ROUNDS)[0]


def without_resultants(points: FloatArray, forces: FloatArray, sliced: list[IntArray]) -> FloatArray:
    """Nodal forces less those, spread as a rigid motion over each slice, that have the same force and moment.

    Parameters
    ----------
    points : (n, 3) float
    forces : (3n, p) float
    sliced : list of (k,) int

    Returns
    -------
    (3n, p) float
    """
    result = forces.reshape(len(points), 3, -1).copy()
    for nodes in sliced:
        rigid = rigid_motions(points[nodes] - points[nodes].mean(axis=0)).reshape(-1, 6)
        own = result[nodes].reshape(len(rigid), -1)
        result[nodes] = (own - rigid @ np.linalg.lstsq(rigid, own, rcond=None)[0]).reshape(nodes.size, 3, -1)
    return result.reshape(forces.shape)


# Motions that turn the material less than this of the most turning one, in squares at the same energy, stretch it.
STIFF = 1e-2
# Energy below this share of the largest: a load on a support.
_NONE = 1e-12


@dataclass(frozen=True)
class FourthOrder:
    """What strain of second order, and stress that turns, hold in pairs of displacement fields.

    Attributes
    ----------
    matrices : Matrices
    """

    matrices: Matrices

    def stretching(self, fields: FloatArray, pairs: IntArray, onto: FloatArray) -> tuple[FloatArray, ...]:
        """Energy of the strain of second order that no displacement takes away.

        Parameters
        ----------
        fields : (3n, m) float
        pairs : (p, 2) int
        onto : (3n, e) float

        Returns
        -------
        energies : (p, p) float
            A of (18a).
        work : (e, p) float
            Of f of (18a) on the displacements `onto`.
        answers : (k, p) float
            Displacements of free degrees of freedom by f.
        """
        count, mesh = len(pairs), self.matrices.model.mesh
        title = f"Stretch of {count} pairs of motions"
        with self.matrices.report.counted(title, mesh.element_count, "elements") as tell:
            forces, energies = quadratic_strain(mesh, fields, pairs, tell)
        bushings = self.matrices.model.bushings
        own = 0.5 * bushings.curvature(fields)[:, pairs[:, 0], pairs[:, 1]]
        forces, energies = forces + bushings.rows.T @ own, energies + own.T @ own
        work = onto.T @ forces
        answers = self.matrices.supported.forces(forces)
        return 0.5 * (energies - self.released(answers, f"Static response to {count} stretches")), work, answers

    def third_order_work(
        self, fields: FloatArray, pairs: IntArray, basis: FloatArray, known: FloatArray, turning: FloatArray
    ) -> FloatArray:
        """Work (p, p) of a motion's forces on its displacements of third order, by pairs (p, 2) of fields (3n, m).

        Less by that of the forces `turning` (3n, m, m), as of third_order.py.

        With it goes the energy that stress which turns sets free outside a basis (3n, e) of unit energies.
        Displacements of second order are left out as far as some (e, k) of its shapes know them.
        """
        model, (first, second) = self.matrices.supported, pairs.T
        mesh, springs = self.matrices.model.mesh, self.matrices.model.bushings
        pulled = stressed_gradients(mesh, fields, np.zeros((len(fields), 1)), pairs[:1])[:, :, :-1] - turning
        pulled += springs.pulled(fields)
        pulled = pulled[:, first, second] + (first < second) * pulled[:, second, first]
        own = springs.rows.T @ (0.5 * springs.curvature(fields)[:, first, second])
        strained = (2.0 - (first == second)) * (quadratic_strain(mesh, fields, pairs, tell_nobody)[0] + own)
        moved = model.whole(model.static(model.forces(np.hstack([strained, pulled]))))
        within = basis.T @ np.hstack([strained, pulled])
        moved[:, : len(pairs)] -= basis @ (known @ (known.T @ within[:, : len(pairs)]))
        moved[:, len(pairs) :] -= basis @ within[:, len(pairs) :]
        return pulled.T @ (moved[:, : len(pairs)] + 0.5 * moved[:, len(pairs) :])

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
        model, mesh = self.matrices.supported, self.matrices.model.mesh
        # Forces of springs to the ground keep their axes.
        applied = model.applied(fields) - self.matrices.model.springs @ fields
        title = f"Flattening of {len(pairs)} pairs of motions"
        with self.matrices.report.counted(title, mesh.element_count, "elements") as tell:
            forces = turned_stress(mesh, fields, applied, pairs, tell)
        return model.forces(without_resultants(mesh.points, forces, slices(mesh, self.matrices.model.anchored)))

    def released(self, forces: FloatArray, title: str) -> FloatArray:
        """Work (p, p) of nodal forces on free degrees of freedom (k, p) over the displacements that they make.

        These are there instead of the forces afterwards: of large meshes there is no room for both.
        """
        model, count = self.matrices.supported, forces.shape[1]
        result = np.empty((count, count))
        with self.matrices.report.counted(title, count, "solutions") as tell:
            for first in range(0, count, AT_A_TIME):
                part = slice(first, first + AT_A_TIME)
                moved = model.static(forces[:, part])
                result[first:, part] = forces[:, first:].T @ moved
                forces[:, part] = moved
                tell(min(first + AT_A_TIME, count))
        # What is above the diagonal was not asked for.
        return np.tril(result) + np.tril(result, -1).T

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
        scale = turning_scale(energy, np.diag(mean_spin(self.matrices.model.mesh, fields)))
        chosen = scale > 0.0
        return fields[:, chosen] * scale[chosen], (energy * scale**2)[chosen]

    def shares(self, forces: FloatArray) -> FloatArray:
        """The largest shares (2,) of stretching and flattening in the responses to nodal forces (3n, l)."""
        fields, linear = self.responses(forces)
        if not linear.size:
            return np.zeros(2)
        pairs = np.repeat(np.arange(linear.size)[:, None], 2, axis=1)
        held = self.stretching(fields, pairs, fields)[0]
        freed = self.released(self.flattening_forces(fields, pairs), f"Static response to {linear.size} flattenings")
        return np.array([np.max(np.diag(part) / linear) for part in (held, 0.5 * freed)])


def pair_products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Products (p, k) of two of some coordinates, each pair once, in those of two motions (e, k) each."""
    first, second = np.triu_indices(len(one))
    return one[first] * other[second] + (first < second)[:, None] * one[second] * other[first]


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
    ease = np.divide(turned, energy, out=np.zeros_like(energy), where=(energy > _NONE * energy.max()))
    soft = ease > STIFF * ease.max()
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
