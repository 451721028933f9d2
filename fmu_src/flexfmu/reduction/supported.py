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

from ..fe.factorisation import Factorisation
from ..mesh.model import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Supported:
    """Matrices of the free degrees of freedom, with the stiffness factorised.

    Attributes
    ----------
    stiffness, mass : (k, k) sparse
        N/m, kg.
    factor : Factorisation
        Of the stiffness at the degrees of freedom `kept`.
    free : (k,) int
        Their places among all 3n degrees of freedom.
    size : int
        3n.
    rigid : (k, r) float
        Mass-orthonormal rigid motions, kg^-1/2.
    kept : (k - r,) int
        Rows of `free` that remain when just these motions are prevented.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    factor: Factorisation
    free: IntArray
    size: int
    rigid: FloatArray
    kept: IntArray

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
        result: FloatArray = displacement - self.rigid @ (self.rigid.T @ (self.mass @ displacement))
        return result

    def whole(self, vectors: FloatArray) -> FloatArray:
        """Put vectors (k, j) into all degrees of freedom (3n, j), zero at supports."""
        result = np.zeros((self.size, vectors.shape[1]))
        result[self.free] = vectors
        return result


def supported(
    stiffness: sp.csr_array,
    mass: sp.csr_array,
    free: IntArray,
    motions: FloatArray,
    tell: Callable[[str], None] | None = None,
) -> Supported:
    """Take out the supports and factorise.

    Parameters
    ----------
    stiffness, mass : (3n, 3n) sparse
    free : (k,) int
        Degrees of freedom that no support holds.
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
    k, m = stiffness[free][:, free], mass[free][:, free]
    rigid = motions[free]
    # Orthonormal in the order given: rotations come out about the centre of mass, translations as they are.
    lower = np.linalg.cholesky(rigid.T @ (m @ rigid)) if rigid.shape[1] else np.zeros((0, 0))
    rigid = scipy.linalg.solve_triangular(lower, rigid.T, lower=True).T if rigid.shape[1] else rigid
    kept = np.arange(free.size)
    if rigid.shape[1]:
        _, pivots = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)
        kept = np.delete(kept, pivots[: rigid.shape[1]])
    factor = Factorisation(k[kept][:, kept], free[kept] // 3, tell=tell)
    return Supported(k, m, factor, free, stiffness.shape[0], np.ascontiguousarray(rigid), kept)
