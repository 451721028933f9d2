"""Matrices of a body's free degrees of freedom and its static response, with or without rigid motions.

A body that is free to move has a singular stiffness. Loads are then balanced by the inertia of its rigid motions, and
the response is taken orthogonal to them (inertia relief): what is left over is elastic. Held at just as many degrees of
freedom as it has rigid motions, the body bears balanced loads without reactions, so that one factorisation serves.
Source: R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics, 2nd ed., section 17.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ..fe.assembly import Unknowns
from ..fe.factorisation import Factorisation
from ..files.basics import FloatArray, IntArray
from ..files.outputs import fields_of


@dataclass(frozen=True, slots=True)
class Eliminated:
    """Matrices of the free degrees of freedom.

    Attributes
    ----------
    stiffness, mass : (k, k) sparse
        N/m, kg.
    unknowns : Unknowns
        How all 3n displacements follow from those of the free degrees of freedom.
    inertia : (3n, 3) float
        Nodal forces that accelerate the mass by one along each axis, kg.
    whole_stiffness : (3n, 3n) sparse or None
        Where there are equations, which exert forces of their own, or shells; in means and differences.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    unknowns: Unknowns
    inertia: FloatArray
    whole_stiffness: sp.csr_array | None


@dataclass(frozen=True, slots=True)
class Supported(Eliminated):
    """Matrices of the free degrees of freedom, with the stiffness factorised.

    Attributes
    ----------
    factor : Factorisation
        Of the stiffness at the degrees of freedom `kept`.
    rigid : (k, r) float
        Mass-orthonormal rigid motions, kg^-1/2.
    kept : (k - r,) int
        Rows of `free` that remain when just these motions are prevented.
    """

    factor: Factorisation
    rigid: FloatArray
    kept: IntArray

    @property
    def free(self) -> IntArray:
        """Their places (k,) among all 3n degrees of freedom."""
        return self.unknowns.free

    def static(self, loads: FloatArray) -> FloatArray:
        """Elastic displacements (k, j) under loads (k, j) that inertia balances."""
        if not self.rigid.shape[1]:
            return self.factor.solve(loads)
        balanced = loads - self.mass @ (self.rigid @ (self.rigid.T @ loads))
        displacement = np.zeros_like(balanced)
        displacement[self.kept] = self.factor.solve(balanced[self.kept])
        return self.elastic(displacement)

    def elastic(self, displacement: FloatArray) -> FloatArray:
        """What displacements (k, j) hold besides rigid motions."""
        return displacement - self.rigid @ (self.rigid.T @ (self.mass @ displacement))

    def whole(self, vectors: FloatArray) -> FloatArray:
        """Displacements (3n, j) of all nodes, zero at supports, of those of the free degrees of freedom (k, j)."""
        return self.unknowns.whole(vectors)

    def forces(self, nodal: FloatArray) -> FloatArray:
        """Forces (k, j) on the free degrees of freedom of nodal forces (3n, j)."""
        return self.unknowns.forces(nodal)

    def applied(self, shapes: FloatArray) -> FloatArray:
        """Nodal forces (3n, j) that hold displacements (3n, j), those of supports left out."""
        if self.whole_stiffness is None:
            return self.whole(self.stiffness @ shapes[self.free])
        return self.unknowns.nodal(self.whole_stiffness, shapes)


def eliminated(stiffness: sp.csr_array, mass: sp.csr_array, unknowns: Unknowns) -> Eliminated:
    """Take supports and equations out of stiffness (3n, 3n), in means and differences, and mass (3n, 3n)."""
    inertia = mass @ np.tile(np.eye(3), (mass.shape[0] // 3, 1))
    whole = None if unknowns.transform is None else stiffness
    return Eliminated(unknowns.matrix(stiffness), unknowns.matrix(unknowns.in_means(mass)), unknowns, inertia, whole)


def supported(matrices: Eliminated, motions: FloatArray, tell: Callable[[str], None] | None = None) -> Supported:
    """Factorise the stiffness.

    Parameters
    ----------
    matrices : Eliminated
    motions : (3n, r) float
        Rigid motions that no support resists.
    tell : callable, optional
        As of `Factorisation`.

    Returns
    -------
    Supported

    Raises
    ------
    ModelError
        The stiffness is singular in other motions than these.
    """
    k, m, free = matrices.stiffness, matrices.mass, matrices.unknowns.free
    rigid = matrices.unknowns.of(motions)
    # Orthonormal in the order given: rotations come out about the centre of mass, translations as they are.
    lower = np.linalg.cholesky(rigid.T @ (m @ rigid)) if rigid.shape[1] else np.zeros((0, 0))
    rigid = scipy.linalg.solve_triangular(lower, rigid.T, lower=True).T if rigid.shape[1] else rigid
    kept = np.arange(free.size)
    if rigid.shape[1]:
        _, pivots = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)
        kept = np.delete(kept, pivots[: rigid.shape[1]])
    # A copy of a large matrix counts beside its factors.
    factor = Factorisation(k[kept][:, kept] if rigid.shape[1] else k, free[kept] // 3, tell=tell)
    return Supported(**fields_of(matrices), factor=factor, rigid=np.ascontiguousarray(rigid), kept=kept)
