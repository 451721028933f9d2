"""The unknowns of the finite element model: displacements that neither supports nor equations determine.

All displacements are u = T z. T has a row of the unit matrix for each unknown, zeros for what supports hold, and the
solved equations for the rest. So stiffness and mass become TᵀKT and TᵀMT, and nodal forces Tᵀf.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..files.array_types import BoolArray, FloatArray, IntArray
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
        T, where there are equations.
    """

    free: IntArray
    size: int
    transform: sp.csr_array | None = None

    @cached_property
    def transposed(self) -> sp.csr_array | None:
        """Tᵀ (k, 3n), where there are equations."""
        return None if self.transform is None else sp.csr_array(self.transform.T)

    def matrix(self, whole: sp.csr_array) -> sp.csr_array:
        """Matrix (k, k) of the unknowns of one (3n, 3n) of all displacements."""
        if self.transposed is None:
            return sp.csr_array(whole[self.free][:, self.free])
        return sp.csr_array(self.transposed @ whole @ self.transform)

    def forces(self, nodal: FloatArray) -> FloatArray:
        """Forces (k, …) on the unknowns of nodal forces (3n, …)."""
        result: FloatArray = nodal[self.free] if self.transposed is None else self.transposed @ nodal
        return result

    def whole(self, vectors: FloatArray) -> FloatArray:
        """Displacements (3n, …) of unknowns (k, …)."""
        if self.transform is not None:
            moved: FloatArray = self.transform @ vectors
            return moved
        result = np.zeros((self.size, *vectors.shape[1:]))
        result[self.free] = vectors
        return result


def unknowns(fixed: BoolArray, equations: sp.csr_array | None) -> Unknowns:
    """The unknowns of a model.

    Parameters
    ----------
    fixed : (n, 3) bool
        Translations held at zero.
    equations : (r, 3n) sparse or None

    Returns
    -------
    Unknowns
    """
    held = fixed.ravel()
    if equations is None:
        return Unknowns(np.flatnonzero(~held), held.size)
    # What is held drops out of the equations.
    dependent, matrix = solved(sp.csr_array(equations @ sp.diags_array((~held).astype(float))))
    known = held.copy()
    known[dependent] = True
    free = np.flatnonzero(~known)
    rows = np.zeros(held.size)
    rows[free] = 1.0
    spread = sp.csr_array(
        (np.ones(dependent.size), (dependent, np.arange(dependent.size))), (held.size, dependent.size)
    )
    transform = (sp.diags_array(rows) + spread @ matrix).tocsc()[:, free]
    return Unknowns(free, held.size, sp.csr_array(transform))
