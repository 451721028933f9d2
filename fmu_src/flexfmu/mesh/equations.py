"""Linear equations between displacements of nodes, E u = 0, solved for as many of them as there are equations.

Rows are handled as mappings from unknowns to coefficients: they are short, and few unknowns are in many of them.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from ..files.array_types import BoolArray, FloatArray, IntArray

Row = dict[int, float]
# A coefficient below this part of those that went into it is round-off of zero.
_ROUND_OFF = 1e-12
# Digits to which coefficients count as equal when one of their unknowns is chosen.
_DIGITS = 6


def matrix_of(rows: Sequence[Mapping[int, float]], size: int) -> sp.csr_array:
    """Matrix (r, size) of equations.

    Parameters
    ----------
    rows : sequence of mapping of int to float
        Coefficients by unknown.
    size : int
        Number of unknowns.

    Returns
    -------
    (r, size) sparse
    """
    place = np.repeat(np.arange(len(rows)), [len(row) for row in rows]).astype(np.int64)
    unknown = np.array([key for row in rows for key in row], dtype=np.int64)
    value = np.array([value for row in rows for value in row.values()], dtype=float)
    return sp.csr_array(sp.coo_array((value, (place, unknown)), shape=(len(rows), size)))


def without(equations: sp.csr_array, gone: BoolArray) -> sp.csr_array:
    """What equations say of the other unknowns once some are eliminated, which nothing else determines.

    Parameters
    ----------
    equations : (r, n) sparse
    gone : (n,) bool

    Returns
    -------
    (s, n) sparse
        Without entries in the columns that are gone.
    """
    rows = dict(enumerate(_rows(equations)))
    users: dict[int, set[int]] = defaultdict(set)
    for number, row in rows.items():
        for key in row:
            if gone[key]:
                users[key].add(number)
    for key in sorted(users):
        numbers = users[key] & rows.keys()
        if not numbers:
            continue
        pivot = min(numbers, key=lambda number: (-abs(rows[number][key]), len(rows[number]), number))
        row = rows.pop(pivot)
        for number in numbers - {pivot}:
            changed = _added(rows[number], row, -rows[number][key] / row[key])
            changed.pop(key, None)
            for other in users:
                (users[other].add if other in changed else users[other].discard)(number)
            rows[number] = changed
    return matrix_of([row for row in rows.values() if row], equations.shape[1])


def solved(equations: sp.csr_array) -> tuple[IntArray, sp.csr_array]:
    """Solve equations for one unknown each.

    Parameters
    ----------
    equations : (r, n) sparse
        Those that follow from others do no harm.

    Returns
    -------
    dependent : (s,) int
        Unknowns, ascending.
    matrix : (s, n) sparse
        They are this times the unknowns; its columns of dependent ones are zero.
    """
    rows = _rows(equations)
    uses = Counter(key for row in rows for key in row)
    known: dict[int, Row] = {}
    for given in rows:
        row, scale = dict(given), max(map(abs, given.values()), default=0.0)
        while inside := [key for key in row if key in known]:
            for key in inside:
                row = _added({k: v for k, v in row.items() if k != key}, known[key], row.get(key, 0.0))
        row = {key: value for key, value in row.items() if abs(value) > _ROUND_OFF * scale}
        if not row:
            continue
        largest = max(map(abs, row.values()))
        # Of the largest the one in fewest equations: little is filled in.
        pivot = min(row, key=lambda key: (-round(abs(row[key]) / largest, _DIGITS), uses[key], key))
        value = row.pop(pivot)
        known[pivot] = {key: -other / value for key, other in row.items()}
    dependent = np.array(sorted(known), dtype=np.int64)
    matrix = matrix_of([known[key] for key in dependent.tolist()], equations.shape[1])
    is_dependent = np.zeros(equations.shape[1], dtype=bool)
    is_dependent[dependent] = True
    # Rows name unknowns that later rows have been solved for; never in a circle.
    while matrix[:, dependent].nnz:
        matrix = sp.csr_array(matrix @ sp.diags_array((~is_dependent).astype(float)) + matrix[:, dependent] @ matrix)
        matrix.eliminate_zeros()
    return dependent, matrix


def coupled_nodes(equations: sp.csr_array) -> sp.csr_array:
    """Nodes that stand in an equation together.

    Parameters
    ----------
    equations : (r, 3n) sparse

    Returns
    -------
    (n, n) sparse
        Ones; symmetric, zero on the diagonal.
    """
    found = equations.tocoo()
    shape = (equations.shape[0], equations.shape[1] // 3)
    member = sp.csr_array(sp.coo_array((np.ones(found.nnz), (found.row, found.col // 3)), shape=shape))
    pairs = sp.coo_array(member.T @ member)
    apart = pairs.row != pairs.col
    ones: FloatArray = np.ones(int(apart.sum()))
    return sp.csr_array(sp.coo_array((ones, (pairs.row[apart], pairs.col[apart])), shape=pairs.shape))


def _rows(equations: sp.csr_array) -> list[Row]:
    starts, keys, values = equations.indptr, equations.indices.tolist(), equations.data.tolist()
    found = []
    for first, end in pairwise(starts.tolist()):
        row: Row = defaultdict(float)
        for key, value in zip(keys[first:end], values[first:end], strict=True):
            row[key] += value
        found.append({key: value for key, value in row.items() if value})
    return found


def _added(row: Row, other: Iterable[tuple[int, float]] | Row, factor: float) -> Row:
    """`row` plus a multiple of another; what cancels is left out."""
    result = dict(row)
    for key, value in dict(other).items():
        total = result.get(key, 0.0) + factor * value
        if abs(total) > _ROUND_OFF * max(abs(result.get(key, 0.0)), abs(factor * value)):
            result[key] = total
        else:
            result.pop(key, None)
    return result
