"""Sparse direct solution of the supported stiffness matrix.

Default: nested dissection of the node graph (METIS) and SuperLU in that order. On solids and thin shells of solids
it is several times faster, and smaller, than SuperLU with its own column orderings, since those do not know that the
matrix is symmetric and that three unknowns share a node. Where scikit-sparse is installed, its CHOLMOD factorises in
the same order, faster still: it knows that the matrix is symmetric, and works on dense blocks.
"""

from collections.abc import Callable
from functools import cache
from types import ModuleType

import numpy as np
import pymetis
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..errors import ModelError
from ..mesh.model import FloatArray, IntArray


def dissection_order(matrix: sp.csr_array, node: IntArray) -> IntArray:
    """Fill-reducing order of a symmetric matrix, found on the graph of its nodes.

    Parameters
    ----------
    matrix : (n, n) sparse
    node : (n,) int
        Node to which each unknown belongs, ascending.

    Returns
    -------
    (n,) int
        Unknowns in the order of elimination; those of a node stay together.
    """
    _, compact = np.unique(node, return_inverse=True)
    count = int(compact[-1]) + 1
    coordinates = matrix.tocoo()
    rows, columns = compact[coordinates.row], compact[coordinates.col]
    off = rows != columns
    graph = sp.csr_array((np.ones(int(off.sum()), dtype=np.int8), (rows[off], columns[off])), shape=(count, count))
    graph.sum_duplicates()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    _, position = pymetis.nested_dissection(adjacency=adjacency)
    order: IntArray = np.argsort(np.asarray(position)[compact], kind="stable")
    return order


@cache
def _cholmod() -> ModuleType | None:
    """CHOLMOD, if there is a scikit-sparse with the interface that is used here (0.4)."""
    try:
        from sksparse import cholmod
    except ImportError:
        return None
    return cholmod if hasattr(cholmod, "cholesky") else None


def solver_name() -> str:
    """Name of the solver that factorisations use on this machine."""
    return "SuperLU" if _cholmod() is None else "CHOLMOD"


# Residual of a solution for forces of one everywhere, relative to them, beyond which a factorisation is worth nothing.
_PROBE = 1e-3
Solve = Callable[[FloatArray], FloatArray]


def _by_cholmod(matrix: sp.csc_matrix) -> tuple[Solve, bool] | None:
    """Solve, and whether the matrix is positive definite; None without CHOLMOD, or where round-off defeats it."""
    cholmod = _cholmod()
    if cholmod is None:
        return None
    try:
        solve: Solve = cholmod.cholesky(matrix, ordering_method="natural", mode="supernodal")
    except cholmod.CholmodError:
        return None
    # A pivot that is round-off of zero may pass: then the solution does not.
    probe = np.ones(matrix.shape[0])
    residual = matrix @ solve(probe) - probe
    return (solve, True) if np.linalg.norm(residual) < _PROBE * np.linalg.norm(probe) else None


def _by_superlu(matrix: sp.csc_matrix) -> tuple[Solve, bool]:
    """Solve, and whether the matrix is positive definite: the elimination along the diagonal has no negative pivot."""
    factor = spla.splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve, bool(np.all(factor.U.diagonal() > 0.0))


class Factorisation:
    """A factorised symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) sparse
    node : (n,) int
        Node to which each unknown belongs, ascending.
    order : (n,) int, optional
        Order of elimination, where it is known from a matrix of the same pattern.

    Raises
    ------
    ModelError
        The matrix is singular.
    """

    def __init__(self, matrix: sp.csr_array, node: IntArray, order: IntArray | None = None):
        self._order = dissection_order(matrix, node) if order is None else order
        permuted = sp.csc_matrix(matrix[self._order][:, self._order])
        try:
            self._solve, self._positive = _by_cholmod(permuted) or _by_superlu(permuted)
        except RuntimeError as error:
            raise ModelError(
                f"the stiffness matrix is singular ({error}): a part of the body is free to move; check supports and "
                "that all parts share nodes"
            ) from error

    @property
    def positive_definite(self) -> bool:
        """Whether the symmetric matrix is, as far as round-off lets it be told."""
        return self._positive

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for one or several right-hand sides.

        Parameters
        ----------
        right : (n,) or (n, k) float

        Returns
        -------
        (n,) or (n, k) float
        """
        result = np.empty_like(right, dtype=np.float64)
        result[self._order] = self._solve(np.ascontiguousarray(right[self._order], dtype=np.float64))
        return result
