"""What a factorisation will take, before it is begun, and whether the machine has it."""

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..files.array_types import IntArray
from ..files.errors import ModelError

GIGA = 1e9
# Bytes a number of the factor L: SuperLU keeps U besides, indices of both, and doubles what it has when it is full.
# Measured 39 on 204 363 unknowns of C3D10.
SUPERLU_BYTES = 40.0
# PARDISO keeps one factor in blocks: measured 8.2 to 9.
PARDISO_BYTES = 9.0
# Vectors of all unknowns that modes and their pairs take beside the factors: 110 to 150 measured on a million.
_VECTORS = 150
_MEMINFO = Path("/proc/meminfo")


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
    place = np.full(int(compact[-1]) + 1, -1, dtype=np.int64)
    _, first = np.unique(compact[order], return_index=True)
    place[np.argsort(first, kind="stable")] = np.arange(place.size)
    entries = matrix.tocoo()
    rows, columns = place[compact[entries.row]], place[compact[entries.col]]
    above = rows < columns
    ones = np.ones(int(above.sum()), dtype=np.int8)
    graph = sp.csr_array((ones, (rows[above], columns[above])), shape=(place.size, place.size))
    graph.sum_duplicates()
    unknowns = np.zeros(place.size)
    np.add.at(unknowns, place[compact], 1.0)
    waiting: list[list[IntArray]] = [[] for _ in range(place.size)]
    total = 0.0
    for column in range(place.size):
        own = graph.indices[graph.indptr[column] : graph.indptr[column + 1]]
        below = np.unique(np.concatenate([own, *waiting[column]]))
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


def refuse_what_does_not_fit(unknowns: int, needed: float, advice: str) -> None:
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
        raise ModelError(
            f"factors of {unknowns} unknowns and what follows take {whole / GIGA:.1f} GB of memory, "
            f"{free / GIGA:.1f} GB are free: {advice}end other programs, or take a coarser mesh"
        )
