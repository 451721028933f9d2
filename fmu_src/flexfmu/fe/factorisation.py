"""Sparse direct solution of the supported stiffness matrix.

Default: nested dissection of the node graph (METIS) and SuperLU in that order. On solids and thin shells of solids
it is several times faster, and smaller, than SuperLU with its own column orderings, since those do not know that the
matrix is symmetric and that three unknowns share a node. Where pypardiso is installed, the MKL's PARDISO takes a fifth
of the time and of the memory: it knows that the matrix is symmetric, and works on dense blocks.
"""

import weakref
from collections.abc import Callable
from ctypes import CDLL, c_void_p
from functools import cache, partial
from pathlib import Path

import numpy as np
import pymetis
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import lapack

from ..files.basics import FloatArray, IntArray, ModelError

GIGA = 1e9
# Bytes a number of the factor L: SuperLU keeps U besides, indices of both, and doubles what it has when it is full.
# Measured 39 on 204 363 unknowns of C3D10.
_SUPERLU_BYTES = 40.0
# PARDISO keeps one factor in blocks: measured 8.2 to 9.
_PARDISO_BYTES = 9.0
# Vectors of all unknowns that modes and their pairs take beside the factors: 110 to 150 measured on a million.
_VECTORS = 150
_MEMINFO = Path("/proc/meminfo")


def _node_graph(matrix: sp.csr_array, node: IntArray) -> sp.csr_array:
    """Which nodes a matrix couples, of the node of each unknown."""
    entries, count = matrix.tocoo(), int(node.max()) + 1
    rows, columns = node[entries.row], node[entries.col]
    off = rows != columns
    graph = sp.csr_array((np.ones(int(off.sum()), dtype=np.int8), (rows[off], columns[off])), shape=(count, count))
    graph.sum_duplicates()
    return graph


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

    Raises
    ------
    ModelError
        METIS has ended without one.
    """
    graph = _node_graph(matrix, compact := np.unique(node, return_inverse=True)[1])
    try:
        position = pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(graph.indptr, graph.indices))[1]
    except RuntimeError as error:
        # METIS catches signals, lack of memory among them, and does not tell which.
        raise ModelError("METIS has not ordered the unknowns: a signal has ended it, or memory was short") from error
    return np.argsort(np.asarray(position)[compact], kind="stable")


@cache
def _pardiso() -> CDLL | None:
    """The MKL with its PARDISO, where pypardiso has brought and finds it."""
    try:
        from pypardiso import pardiso_wrapper

        library: CDLL = pardiso_wrapper.PyPardisoSolver().libmkl
        # On several threads the machine's load decides the order of its sums: the same body would get other bits.
        library.MKL_Set_Num_Threads(1)
    except (ImportError, OSError, AttributeError):
        return None
    return library


def solver_name() -> str:
    """Name of the solver that factorisations use on this machine."""
    return "SuperLU" if _pardiso() is None else "PARDISO"


Solve = Callable[[FloatArray], FloatArray]
# Unknowns from which on a factorisation is looked at before it is begun: fewer take seconds, and less than 2 GB.
_LARGE = 80_000
# Right-hand sides at a time: one alone reads all of the factor and takes as long as three of these; more gain nothing,
# and every copy of them counts. The same by blocks, their columns, and right-hand sides from which on they are faster.
_FEWER, AT_A_TIME, _WIDTH, _MANY = 16, 64, 48, 12
# Residual of a solution for forces of one everywhere, relative to them, beyond which a matrix is singular, or that of a
# body so thin that round-off leaves as much. Only the factorisation of symmetric ones tells which: it counts the pivots
# that it has put in place of none.
_PROBE = 1e-3
# PARDISO's numbers: matrices that are positive definite, and symmetric ones; phases.
_POSITIVE, _SYMMETRIC = 2, -2
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1
# What it is told, from 0: these settings, METIS' order, pivots of 1e-8 at least, of 1 × 1 and 2 × 2, indices from 0.
_SETTINGS = {0: 1, 1: 2, 9: 8, 20: 1, 34: 1}
# What it reports, from 0: pivots replaced, KiB that factors will take beside the analysis, negative eigenvalues.
_REPLACED, _FACTOR, _NEGATIVE = 13, 16, 22
_NO_MEMORY = -2


class _Pardiso:
    """The MKL's PARDISO for one symmetric matrix.

    Parameters
    ----------
    library : CDLL
    upper : (n, n) sparse
        Its upper triangle, as of `upper_triangle`. PARDISO reads its arrays, without copies.
    kind : int
        `_POSITIVE` or `_SYMMETRIC`.
    """

    def __init__(self, library: CDLL, upper: sp.csr_array, kind: int):
        # Not the attribute, whose types pypardiso has set.
        self._call, self._upper = library["pardiso"], upper
        self._handle = np.zeros(64, dtype=np.intp)
        self._kind = kind
        self.settings = np.zeros(64, dtype=np.int32)
        self.settings[list(_SETTINGS)] = list(_SETTINGS.values())

    def run(self, phase: int, right: FloatArray | None = None) -> FloatArray:
        """Run a phase; return the solution (n, k) for right-hand sides (n, k), where there are any."""
        upper = self._upper
        b = np.zeros((upper.shape[0], 1)) if right is None else np.asfortranarray(right, dtype=np.float64)
        x, columns = np.zeros_like(b, order="F"), b.size // len(b)
        # One factor, the first; of the order, nothing; it prints nothing.
        before = [np.array(value, dtype=np.int32) for value in (1, 1, self._kind, phase, len(b))]
        after = [np.array(value, dtype=np.int32) for value in (0, columns)]
        error = np.array(0, dtype=np.int32)
        matrix = (upper.data, upper.indptr, upper.indices)
        every = (self._handle, *before, *matrix, *after, self.settings, np.array(0, dtype=np.int32), b, x, error)
        self._call(*(c_void_p(array.ctypes.data) for array in every))
        if error == _NO_MEMORY:
            raise ModelError(f"no memory for the factors of {len(b)} unknowns: end other programs")
        if error:
            raise RuntimeError(f"PARDISO's error {error}")
        return x


def upper_triangle(matrix: sp.csr_array) -> sp.csr_array:
    """The upper triangle of a symmetric matrix, columns ascending, in 32-bit indices."""
    size = matrix.shape[0]
    rows = np.repeat(np.arange(size, dtype=np.int32), np.diff(matrix.indptr))
    kept = matrix.indices >= rows
    ends = np.concatenate([[0], np.cumsum(np.bincount(rows[kept], minlength=size))]).astype(np.int32)
    upper = sp.csr_array((matrix.data[kept], matrix.indices[kept].astype(np.int32), ends), shape=matrix.shape)
    upper.sort_indices()
    return upper


def _by_pardiso(library: CDLL, matrix: sp.csr_array, checked: bool, owner: object) -> tuple[Solve, bool]:
    """Solve, and whether the matrix is positive definite; of the upper triangle, in an order of PARDISO's own."""
    upper = upper_triangle(matrix)
    if not np.diff(upper.indptr).all():
        raise RuntimeError("a row is empty")
    for kind in (_POSITIVE, _SYMMETRIC):
        solver = _Pardiso(library, upper, kind)
        release = weakref.finalize(owner, solver.run, _RELEASE)
        try:
            # The two phases by themselves: what it takes is known after the first.
            solver.run(_ANALYSE)
            if not checked:
                _refuse_what_does_not_fit(matrix.shape[0], 1024.0 * solver.settings[_FACTOR], "")
            solver.run(_FACTORISE)
        except RuntimeError as error:
            release()
            failure = error
            continue
        except BaseException:
            release()
            raise

        solve = partial(solver.run, _SOLVE)
        probe = np.ones((matrix.shape[0], 1))
        exact = kind == _SYMMETRIC and solver.settings[_REPLACED] == 0
        if exact or np.linalg.norm(matrix @ solve(probe) - probe) < _PROBE * np.linalg.norm(probe):
            return solve, bool(kind == _POSITIVE or solver.settings[_NEGATIVE] == 0)
        release()
        failure = RuntimeError("its solution leaves a residual")
    raise failure


def _check_fill(matrix: sp.csr_array, node: IntArray, order: IntArray, tell: Callable[[str], None] | None) -> None:
    """Refuse what SuperLU cannot hold; say of what takes long how it would be faster."""
    if matrix.shape[0] < _LARGE:
        return
    entries = factor_entries(matrix, node, order)
    share = _PARDISO_BYTES / _SUPERLU_BYTES
    needed = _SUPERLU_BYTES * entries
    faster = f'pip install "flexfmu[fast]" takes {needed * share / GIGA:.1f} GB and a fifth of the time; '
    _refuse_what_does_not_fit(matrix.shape[0], needed, faster)
    if tell is not None:
        tell(f"{matrix.shape[0]} unknowns take SuperLU {needed / GIGA:.1f} GB and minutes; {faster.rstrip('; ')}")


def _by_blocks(lower: sp.csc_array, pivots: FloatArray) -> Solve:
    """Solve by factors L D Lᵀ, of columns L (n, n) and pivots D (n,); right-hand sides (n, k) become the solution.

    Some columns of L at a time are a dense block: many right-hand sides take 0.4 of SuperLU's time.
    """
    parts = []
    for first in range(0, pivots.size, _WIDTH):
        own = lower[:, first : first + _WIDTH]
        width, rows = own.shape[1], np.unique(own.indices)
        block = own[rows].toarray()
        inverse = lapack.dtrtri(block[:width], lower=1, unitdiag=1)[0]
        # What L⁻¹ of these columns adds to each row.
        block[width:] @= -inverse
        block[:width] = inverse - np.eye(width)
        parts.append((slice(first, first + width), rows, block))

    def solve(right: FloatArray) -> FloatArray:
        for own, rows, block in parts:
            right[rows] += block @ right[own]
        right /= pivots[:, None]
        for own, rows, block in reversed(parts):
            right[own] += block.T @ right[rows]
        return right

    return solve


class Factorisation:
    """A factorised symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) sparse
    node : (n,) int
        Node to which each unknown belongs, ascending.
    order : (n,) int, optional
        Order of elimination, where it is known from a matrix of the same pattern; then its size is not checked again.
    tell : callable, optional
        Takes what the user should know of a long factorisation.

    Attributes
    ----------
    positive_definite : bool
        Whether the symmetric matrix is, as far as round-off lets it be told.

    Raises
    ------
    ModelError
        The matrix is singular, or its factors do not fit into the memory that is free.
    """

    def __init__(
        self,
        matrix: sp.csr_array,
        node: IntArray,
        order: IntArray | None = None,
        tell: Callable[[str], None] | None = None,
    ):
        pardiso = _pardiso()
        # What makes `_solve` of many right-hand sides.
        self._several: Callable[[], Solve] = lambda: self._solve
        try:
            if pardiso is not None:
                self._order = np.arange(matrix.shape[0])
                self._solve, self.positive_definite = _by_pardiso(pardiso, matrix, order is not None, self)
                return
            self._order = dissection_order(matrix, node) if order is None else order
            permuted = sp.csc_matrix(matrix[self._order][:, self._order])
            if order is None:
                _check_fill(matrix, node, self._order, tell)
            factor = spla.splu(permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            self._solve, lower, pivots = factor.solve, factor.L, factor.U.diagonal()
            # The elimination along the diagonal has no negative pivot then.
            self.positive_definite = bool(np.all(pivots > 0.0))
            if not np.array_equal((factor.perm_r, factor.perm_c), 2 * [np.arange(pivots.size)]):
                return
            self._several = cache(partial(_by_blocks, lower, pivots))
            if order is None and pivots.size >= _LARGE:
                # Blocks serve one right-hand side as well: what SuperLU keeps is four times as large.
                del factor
                self._solve = solve = _by_blocks(lower, pivots)
                self._several = lambda: solve
        except RuntimeError as error:
            found = f"the stiffness matrix is singular ({error}): a part of the body is free to move"
            raise ModelError(f"{found}; check supports and that all parts share nodes") from error

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
        columns = right.reshape(len(right), -1)
        found = result.reshape(columns.shape)
        solve = self._several() if columns.shape[1] >= _MANY else self._solve
        count = AT_A_TIME if _pardiso() is None else _FEWER
        for first in range(0, columns.shape[1], count):
            part = slice(first, first + count)
            found[self._order, part] = solve(np.asarray(columns[self._order, part], dtype=np.float64))
        return result


def factor_entries(matrix: sp.csr_array, node: IntArray, order: IntArray) -> float:
    """Numbers of the factor L of a symmetric matrix, found on the graph of its nodes.

    The row structure of a column of L is that of the matrix's column and of its children in the elimination tree, less
    themselves. Source: A. George, J. W. Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981,
    chapter 5.

    Parameters
    ----------
    matrix : (n, n) sparse
    node : (n,) int
        Node to which each unknown belongs, ascending.
    order : (n,) int
        Order of elimination that keeps the unknowns of a node together.

    Returns
    -------
    float
    """
    compact = np.unique(node, return_inverse=True)[1]
    # When each node is eliminated.
    place = np.argsort(np.argsort(np.unique(compact[order], return_index=True)[1]))
    graph = _node_graph(matrix, place[compact])
    unknowns = np.bincount(place[compact])
    waiting: list[list[IntArray]] = [[] for _ in range(place.size)]
    total = 0.0
    for column in range(place.size):
        own = graph.indices[graph.indptr[column] : graph.indptr[column + 1]]
        below = np.unique(np.concatenate([own[own > column], *waiting[column]]))
        waiting[column] = []
        size = unknowns[column]
        total += size * (0.5 * (size + 1.0) + unknowns[below].sum())
        if below.size:
            waiting[below[0]].append(below[1:])
    return total


def free_memory() -> float | None:
    """Bytes that the machine can give without swapping; None where it does not tell."""
    try:
        lines = _MEMINFO.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * float(found[0]) if found else None


def _refuse_what_does_not_fit(unknowns: int, needed: float, advice: str) -> None:
    """Refuse a factorisation before it swaps.

    Parameters
    ----------
    unknowns : int
    needed : float
        Bytes of the factors.
    advice : str
        What would take less, or nothing.

    Raises
    ------
    ModelError
    """
    free, whole = free_memory(), needed + 8.0 * _VECTORS * unknowns
    if free is not None and whole > free:
        found = f"factors of {unknowns} unknowns and what follows take {whole / GIGA:.1f} GB of memory"
        raise ModelError(f"{found}, {free / GIGA:.1f} GB are free: {advice}end other programs, or take a coarser mesh")
