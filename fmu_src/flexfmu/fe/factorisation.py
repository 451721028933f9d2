"""Sparse direct solution of the supported stiffness matrix.

Default: nested dissection of the node graph (METIS) and SuperLU in that order. On solids and thin shells of solids
it is several times faster, and smaller, than SuperLU with its own column orderings, since those do not know that the
matrix is symmetric and that three unknowns share a node.
"""

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
            self._factor = spla.splu(
                permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:
            raise ModelError(
                f"the stiffness matrix is singular ({error}): a part of the body is free to move; check supports and "
                "that all parts share nodes"
            ) from error

    @property
    def positive_definite(self) -> bool:
        """Whether the symmetric matrix is: no pivot of the elimination, whose order is the diagonal's, is negative."""
        return bool(np.all(self._factor.U.diagonal() > 0.0))

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
        result[self._order] = self._factor.solve(np.ascontiguousarray(right[self._order], dtype=np.float64))
        return result
