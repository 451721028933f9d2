"""The unknowns of the finite element model: displacements that neither supports nor equations determine.

All displacements are u = T z. T has a row of the unit matrix for each unknown, zeros for what supports hold, and the
solved equations for the rest. So stiffness and mass become TᵀKT and TᵀMT, and nodal forces Tᵀf.

Of shells (and beams) the unknowns are mean and difference of faces, u = Q v with QᵀQ = 1: of displacements of the faces
themselves, stretch of a thin shell's thickness leaves nothing but round-off for its bending. So v = QᵀT z.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..files.basics import BoolArray, FloatArray, IntArray
from ..mesh.equations import solved


@dataclass(frozen=True)
class Unknowns:
    """Which displacements are unknown, and how all others follow from them.

    Attributes
    ----------
    free : (k,) int
        Places of the unknowns among all 3n displacements, ascending.
    size : int
        3n.
    transform : (3n, k) sparse, optional
        T, where there are equations or shells.
    inner : (3n, k) sparse, optional
        QᵀT, likewise.
    means : (3n, 3n) sparse, optional
        Q, where there are shells.
    """

    free: IntArray
    size: int
    transform: sp.csr_array | None = None
    inner: sp.csr_array | None = None
    means: sp.csr_array | None = None

    @cached_property
    def transposed(self) -> sp.csr_array | None:
        """Tᵀ (k, 3n), where there are equations or shells."""
        return None if self.transform is None else sp.csr_array(self.transform.T)

    @property
    def of_means(self) -> "Unknowns":
        """The same unknowns, of which means and differences follow instead of displacements."""
        return Unknowns(self.free, self.size, self.inner, self.inner)

    def matrix(self, whole: sp.csr_array) -> sp.csr_array:
        """Matrix (k, k) of the unknowns of one (3n, 3n) in means and differences."""
        if self.inner is None:
            return sp.csr_array(whole[self.free][:, self.free])
        return sp.csr_array(self.inner.T @ whole @ self.inner)

    def in_means(self, whole: sp.csr_array) -> sp.csr_array:
        """QᵀAQ of a matrix (3n, 3n) of displacements."""
        return whole if self.means is None else sp.csr_array(self.means.T @ whole @ self.means)

    def nodal(self, whole: sp.csr_array, displacements: FloatArray) -> FloatArray:
        """Product (3n, …) of a matrix (3n, 3n) in means and differences with displacements (3n, …)."""
        return whole @ displacements if self.means is None else self.means @ (whole @ (self.means.T @ displacements))

    def of(self, displacements: FloatArray) -> FloatArray:
        """Unknowns (k, …) of displacements (3n, …)."""
        return displacements[self.free] if self.means is None else (self.means.T @ displacements)[self.free]

    def forces(self, nodal: FloatArray) -> FloatArray:
        """Forces (k, …) on the unknowns of nodal forces (3n, …)."""
        return nodal[self.free] if self.transposed is None else self.transposed @ nodal

    def whole(self, vectors: FloatArray) -> FloatArray:
        """Displacements (3n, …) of unknowns (k, …)."""
        if self.transform is not None:
            return self.transform @ vectors
        result = np.zeros((self.size, *vectors.shape[1:]))
        result[self.free] = vectors
        return result


def unknowns(
    fixed: BoolArray, equations: sp.csr_array | None, mixed: tuple[IntArray, FloatArray] | None = None
) -> Unknowns:
    """The unknowns of a model.

    Parameters
    ----------
    fixed : (n, 3) bool
        Translations held at zero.
    equations : (r, 3n) sparse or None
    mixed : tuple of (n, 4) int and (n, 4) float, optional
        `Mesh.mixed`.

    Returns
    -------
    Unknowns
    """
    held, means = fixed.ravel(), None
    if mixed is not None and np.any(mixed[1][:, 1:]):
        node, share = mixed
        start = np.arange(0, node.size + 1, node.shape[1])
        whole = sp.csr_array((share.flatten(), node.flatten(), start), shape=(len(fixed), len(fixed)))
        whole.eliminate_zeros()
        means = sp.csr_array(sp.kron(whole, sp.eye_array(3), format="csr"))
        # Where one point of several alone is held, neither the mean nor the difference is.
        both = fixed[node].all(axis=1)
        alone = sp.eye_array(held.size, format="csr")[np.flatnonzero((fixed & ~both).ravel())]
        rows = alone if equations is None else sp.vstack([equations, alone])
        equations, held = sp.csr_array(rows @ means), both.ravel()
    if equations is None:
        return Unknowns(np.flatnonzero(~held), held.size)
    # What is held drops out of the equations.
    dependent, matrix = solved(sp.csr_array(equations @ sp.diags_array((~held).astype(float))))
    known = held.copy()
    known[dependent] = True
    free = np.flatnonzero(~known)
    itself = np.zeros(held.size)
    itself[free] = 1.0
    spread = sp.csr_array(
        (np.ones(dependent.size), (dependent, np.arange(dependent.size))), (held.size, dependent.size)
    )
    inner = sp.csr_array((sp.diags_array(itself) + spread @ matrix).tocsc()[:, free])
    transform = inner if means is None else sp.csr_array(means @ inner)
    return Unknowns(free, held.size, transform, inner, means)
