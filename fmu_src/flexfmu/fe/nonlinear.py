"""Static equilibrium of the whole finite element model with geometric nonlinearity: the reference of reduced bodies.

Total Lagrangian: the second Piola-Kirchhoff stress is linear in the Green-Lagrange strain (Saint Venant-Kirchhoff), as
CalculiX has it for *ELASTIC with NLGEOM. Nodal loads keep their direction and their distribution over the undeformed
body; what else acts on nodes is a function of displacements.
Newton's method with load increments that are cut back where it fails. Source: J. Bonet, R. D. Wood, Nonlinear Continuum
Mechanics for Finite Element Analysis, 2nd ed., chapter 9. Its tangent has the stress that the last iteration foresaw,
as if stress were an unknown, too: then half as many are needed (D. Magisano, L. Leonetti, G. Garcea, Comput. Methods
Appl. Mech. Engrg. 313 (2017) 986).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..files.basics import AccuracyError, FloatArray, IntArray, ModelError
from ..files.outputs import Reporter
from ..files.threads import in_one_thread
from ..mesh.model import Mesh
from .assembly import CHUNK, Unknowns, add_nodal, assembler, elastic_cells, summed
from .factorisation import Factorisation, dissection_order
from .layers import Cells

# |residual| / |load|: Newton's last iteration goes far below it.
_TOLERANCE = 1e-8
# |change| / |displacement| from which on a soft body on stiff elements has settled although round-off of its internal
# forces keeps the residual above that, but not above this part of the load.
_SETTLED, _ROUND_OFF = 1e-9, 1e-4
_ITERATIONS = 12
# Residual of a change by a tangent that is not symmetric, relative.
_TURNED = 1e-6
# |residual| / |load| below which the last factors serve again, as long as each round leaves a tenth at most.
_NEAR, _LEFT = 1e-4, 0.1
# An increment that took fewer iterations lets the next one be twice as long.
_EASY = 6
# The first part of the load: one increment for all of it might land beyond a limit load on the far side.
_FIRST = 0.25
# Displacement of an increment over what the tangent at its start foresees; near a limit load it grows without bound.
_JUMP = 3.0
# The smallest part of the load that an increment may be.
_SMALLEST = 1e-4
# Rounds in which the elements' own shape functions settle, to this part of the displacement.
_OWN_ROUNDS, _OWN_SETTLED = 12, 1e-12


@dataclass(frozen=True, slots=True)
class LoadPath:
    """Equilibria along a growing load.

    Attributes
    ----------
    displacement : (f, 3n) float
        m.
    increments, iterations : int
        What it took.
    """

    displacement: FloatArray
    increments: int
    iterations: int


Resisting = Callable[[FloatArray, float, bool], tuple[FloatArray, sp.csr_array]]


class _Body:
    """Internal forces and their derivative at a displacement; of shells in means and differences (`fe.assembly`)."""

    def __init__(self, mesh: Mesh, unknowns: Unknowns, spring: FloatArray, bushings: Resisting | None):
        self._spring = unknowns.in_means(sp.csr_array(sp.diags_array(spring.ravel())))
        self._bushings, self._means, self.factor = bushings, unknowns.means, 1.0
        self._parts = list(elastic_cells(mesh, CHUNK, means=True))
        self._sums = [assembler(part.nodes, spring.size) for part in self._parts]
        # Amplitudes of the elements' own shape functions, as last found.
        self._own = [np.zeros((len(p.nodes), p.gradient.shape[2] - p.nodes.shape[1], 3)) for p in self._parts]
        # The last displacement, and the state of each part there: forces and their derivative are asked for in turns.
        self._last: tuple[FloatArray, list[tuple[FloatArray, FloatArray]]] = np.full(spring.size, np.nan), []

    def _states(self, displacement: FloatArray) -> Iterator[tuple[Cells, FloatArray, FloatArray]]:
        """Every part, and its `_state`."""
        if not np.array_equal(displacement, self._last[0]):
            self._last = displacement.copy(), [self._state(number, displacement) for number in range(len(self._parts))]
        for part, state in zip(self._parts, self._last[1], strict=True):
            yield part, *state

    def forces(self, displacement: FloatArray) -> FloatArray:
        """Internal forces (3n,), N."""
        result = (self._spring @ displacement).reshape(-1, 3)
        for part, slopes, work in self._states(displacement):
            add_nodal(result, part.nodes, part.nodal(work[..., None], slopes)[:, : part.nodes.shape[1], :, 0])
        return result.ravel() + self._of_bushings(displacement, False)[0]

    def _of_bushings(self, displacement: FloatArray, derived: bool) -> tuple[FloatArray, sp.csr_array]:
        """Their forces (3n,) and, where it is asked for, the derivative of these (3n, 3n)."""
        if self._bushings is None:
            return np.zeros(displacement.size), sp.csr_array((displacement.size, displacement.size))
        if self._means is None:
            return self._bushings(displacement, self.factor, derived)
        force, tangent = self._bushings(self._means @ displacement, self.factor, derived)
        return self._means.T @ force, self._means.T @ tangent @ self._means

    def tangent(self, displacement: FloatArray, change: FloatArray) -> sp.csr_array:
        """Their derivative (3n, 3n), N/m, with the stress that was foreseen where the last `change` (3n,) began.

        A change that turns material stretches it by the square of the turn: stress that the next one takes away.
        """
        parts = [self._spring, self._of_bushings(displacement, True)[1]]
        for (part, slopes, work), sums in zip(self._states(displacement), self._sums, strict=True):
            moved = part.shape_slopes[..., : part.nodes.shape[1]] @ change.reshape(-1, 3)[part.nodes]
            foreseen = work - part.work(_strains(part, moved, 0.5 * moved)[..., None])[..., 0]
            parts.append(sums(part.eliminated(_tangent(part, slopes, foreseen))[0]))
        return summed(parts)

    def _state(self, number: int, displacement: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slopes (e, s, 3) of a part and what works on its strains (e, r), its own shape functions in equilibrium."""
        part, local = self._parts[number], displacement.reshape(-1, 3)[self._parts[number].nodes]
        own = self._own[number]
        for _ in range(_OWN_ROUNDS):
            # Of the displacements themselves: as what places have more than at first, small strains would be round-off.
            change = part.shape_slopes @ np.concatenate([local, own], axis=1)
            strain = _strains(part, change, part.undeformed + 0.5 * change)
            slopes, work = part.undeformed + change, part.work(strain[..., None])[..., 0]
            if not own.size:
                break
            inner = part.nodes.shape[1]
            force = part.nodal(work[..., None], slopes)[..., 0]
            stiff = _tangent(part, slopes, work)[:, part.own, part.own]
            change = -np.linalg.solve(stiff, force[:, inner:].reshape(len(own), -1, 1)).reshape(own.shape)
            # The last round's stress is that of the amplitudes that it leaves.
            if np.abs(change).max() <= _OWN_SETTLED * max(np.abs(local).max(), np.abs(own).max(), 1e-300):
                break
            own = own + change
        self._own[number] = own
        return slopes, work


def _strains(part: Cells, change: FloatArray, slopes: FloatArray) -> FloatArray:
    """Strains (e, r) by a change (e, s, 3) of places that have slopes."""
    i, j = part.rows.T
    strain = np.einsum("erc,erc->er", change[:, i], slopes[:, j])
    return strain + np.where(i == j, 0.0, np.einsum("erc,erc->er", change[:, j], slopes[:, i]))


def _tangent(part: Cells, slopes: FloatArray, work: FloatArray) -> FloatArray:
    """Derivative (e, 3(a + b), 3(a + b)) of those forces."""
    strain, geometric = part.operator(slopes), part.geometric(work)
    result = strain.swapaxes(1, 2) @ part.work(strain)
    for axis in range(3):
        result[:, axis::3, axis::3] += geometric
    return result


@in_one_thread
def load_path(
    mesh: Mesh, unknowns: Unknowns, spring: FloatArray, load: FloatArray, factors: Sequence[float], report: Reporter,
    bushings: Resisting | None = None, turns: bool = False,
) -> LoadPath:  # fmt: skip
    """Equilibria of the whole model under parts of a load.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    unknowns : Unknowns
    spring : (n, 3) float
        Stiffness of springs to the ground, N/m.
    load : (3n,) float
        Nodal forces, N.
    factors : sequence of float
        Parts of the load at which equilibria are wanted, ascending and positive.
    report : Reporter
    bushings : function of (3n,) float and a part of the load, optional
        Forces (3n,) of springs and turning loads against displacements of any size, and the derivative (3n, 3n).
    turns : bool
        Whether these have no potential: then the derivative is not symmetric, and tells no instability.

    Returns
    -------
    LoadPath

    Raises
    ------
    AccuracyError
        No equilibrium is found beyond some part of the load.
    """
    body = _Body(mesh, unknowns, spring, bushings)
    # Of them follow means and differences instead of displacements.
    means, unknowns = unknowns.means, Unknowns(unknowns.free, unknowns.size, unknowns.inner, unknowns.inner)
    load = load if means is None else means.T @ load
    u = np.zeros(load.size)
    size = float(np.linalg.norm(unknowns.forces(load - body.forces(u))))
    body.factor = 0.0
    stiff, node = unknowns.matrix(body.tangent(u, u)), unknowns.free // 3
    kept = [Factorisation(stiff, node, order := dissection_order(stiff, node))]
    found, reached, increment, increments, iterations = [], 0.0, _FIRST * float(factors[-1]), 0, 0
    for factor in factors:
        while reached < factor:
            target = body.factor = min(factor, reached + increment)
            solution, used = _newton(body, unknowns, order, u, target * load, size, kept, turns)
            iterations += used
            increments += 1
            if solution is None:
                kept.clear()
                increment = 0.5 * (target - reached)
                if increment < _SMALLEST:
                    fault = f"no equilibrium of the finite element model beyond {100.0 * reached:.2f} % of the load"
                    raise AccuracyError(f"{fault}: it is near a limit or critical load; lower the load")
                continue
            u, reached = solution, target
            report.note(f"{100.0 * reached:.4g} % of the load after {used} iterations")
            increment *= 2.0 if used < _EASY else 1.0
        found.append(u.copy() if means is None else means @ u)
    return LoadPath(np.array(found), increments, iterations)


def _newton(
    body: _Body, unknowns: Unknowns, order: IntArray, start: FloatArray, load: FloatArray, size: float,
    kept: list[Factorisation], turns: bool,
) -> tuple[FloatArray | None, int]:  # fmt: skip
    """Newton's method from `start`; None where it fails, or leaves the stable path that leads from there.

    `kept` holds what the increment that led to the start has left, if one did, then what is left here.
    """
    u, foreseen, before, step = start.copy(), 0.0, size, np.zeros_like(start)
    residual = unknowns.forces(load - body.forces(u))
    for iteration in range(1, _ITERATIONS + 1):
        # Stress foreseen from far off may make unstable what the displacement's own does not: then that is taken.
        for known in (step, 0.0 * step)[:iteration]:
            with suppress(ModelError):
                if turns or not kept:
                    tangent = unknowns.matrix(body.tangent(u, known))
                if not kept:
                    symmetric = 0.5 * (tangent + tangent.T) if turns else tangent
                    kept.append(Factorisation(symmetric, unknowns.free // 3, order))
                if kept[0].positive_definite or (turns and not known.any()):
                    break
            kept.clear()
        else:
            return None, iteration
        change = kept[0].solve(residual)
        if turns:
            like = spla.LinearOperator(tangent.shape, kept[0].solve, dtype=np.float64)
            change, _ = spla.gmres(tangent, residual, change, rtol=_TURNED, M=like, restart=_ITERATIONS, maxiter=1)
        foreseen = foreseen or float(np.linalg.norm(change))
        u += (step := unknowns.whole(change))
        residual = unknowns.forces(load - body.forces(u))
        error = float(np.linalg.norm(residual))
        if not np.isfinite(error):
            return None, iteration
        settled = float(np.linalg.norm(change)) <= _SETTLED * float(np.linalg.norm(u)) and error <= _ROUND_OFF * size
        if error <= _TOLERANCE * size or settled:
            # Much farther than the tangent foresaw: a jump to another branch.
            return (None if float(np.linalg.norm(u - start)) > _JUMP * foreseen else u), iteration
        if error > min(_NEAR * size, _LEFT * before):
            # Gone before the next are made: there may be no room for two.
            kept.clear()
        before = error
    return None, _ITERATIONS
