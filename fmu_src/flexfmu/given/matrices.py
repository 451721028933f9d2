"""Linear bodies of condensed matrices: six degrees of freedom an interface, and modal ones behind them."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.linalg
import scipy.sparse as sp

from ..files.basics import FlexfmuError, FloatArray
from ..fmu.built_body import BuiltBody
from ..reduction.making import linear_use, made_body, motion_of_interfaces

# Relative size of what is not symmetric, and of a smallest eigenvalue that is round-off.
_ASYMMETRIC, _ROUND_OFF = 1e-6, 1e-10
_EACH = 6
# Of a substructure's text.
_CARD = re.compile(r"^\*MATRIX *, *TYPE *= *(\w+)[^\n]*\n", re.IGNORECASE | re.MULTILINE)


class MatrixError(FlexfmuError):
    """Matrices that are those of no held body."""


def linear_body(
    stiffness: Any, mass: Any, points: Mapping[str, Sequence[float]], *, damping: float = 0.0, name: str = "body"
) -> BuiltBody:
    """Linear body of condensed matrices, in SI units.

    Matrices tell no displacements inside the body, and so no frame's rotation: no other method goes with them.

    Parameters
    ----------
    stiffness, mass : (k, k) array, sparse, or path
        Of a Matrix Market file, or of the text that *SUBSTRUCTURE MATRIX OUTPUT of Abaqus writes.
        Rows: x, y, z and rotations about x, y, z of each interface in turn (k ≥ 6 I), then modal coordinates.
    points : mapping of str to 3 float
        Places of the interfaces by name, in the rows' order, m.
    damping : float
        Modal damping ratio.
    name : str

    Returns
    -------
    BuiltBody

    Raises
    ------
    MatrixError
        Matrices that are not square, symmetric and positive, or a body that is not held.

    Examples
    --------
    >>> stiffness, mass = np.diag([4e6, 4e6, 4e6, 1e5, 1e5, 1e5]), np.diag([10.0, 10.0, 10.0, 0.1, 0.1, 0.1])
    >>> mount = flexfmu.linear_body(stiffness, mass, {"seat": (0.0, 0.0, 0.0)})
    >>> mount.response(mount.static({"seat": [0.0, 400.0, 0.0]})).displacement.round(9)  # 400 / 4e6 m
    array([[0.    , 0.0001, 0.    ]])
    """
    k, m = _matrix(stiffness, "stiffness"), _matrix(mass, "mass")
    if k.shape != m.shape or len(k) < _EACH * len(points) or not points:
        raise MatrixError(
            f"stiffness has shape {k.shape} and mass {m.shape}, expected the same of both, with at least "
            f"{_EACH * len(points)} rows for {len(points)} interfaces"
        )
    try:
        squares, shapes = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError as error:
        raise MatrixError(f"mass is not positive definite ({error}): take out rows without mass") from error
    if squares[0] <= _ROUND_OFF * squares[-1]:
        raise MatrixError("stiffness is not positive definite: the body is free, or rows are zero; hold it")
    moved = shapes[: _EACH * len(points)].reshape(len(points), _EACH, -1)
    use = linear_use(name, damping, {"matrices": f"{len(k)} rows"})
    body = made_body(use, **motion_of_interfaces(np.sqrt(squares), points, moved))
    return BuiltBody(body)


def _matrix(given: Any, title: str) -> FloatArray:
    """A matrix as an array, symmetric."""
    if isinstance(given, str | Path):
        given = _read(Path(given), title)
    value = np.asarray(given.toarray() if sp.issparse(given) else given, dtype=float)
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.size or not np.isfinite(value).all():
        raise MatrixError(f"{title} has shape {value.shape}, expected a square matrix of finite numbers")
    if np.abs(value - value.T).max() > _ASYMMETRIC * np.abs(value).max():
        raise MatrixError(f"{title} is not symmetric: one triangle alone? give both, or a symmetric Matrix Market file")
    return np.asarray(0.5 * (value + value.T))


def _read(path: Path, title: str) -> Any:
    """A matrix of a file."""
    try:
        if cards := _CARD.split(path.read_text(encoding="utf-8", errors="replace"))[1:]:
            return _lower_triangle(dict(zip((kind.lower() for kind in cards[::2]), cards[1::2], strict=True)), title)
        return scipy.io.mmread(path)
    # SciPy's reader raises whatever the text leads it to.
    except Exception as error:
        raise MatrixError(
            f"{path} cannot be read as a Matrix Market file, nor as text with *MATRIX, TYPE={title.upper()} ({error})"
        ) from error


def _lower_triangle(texts: Mapping[str, str], title: str) -> FloatArray:
    """The matrix of a substructure: its lower triangle row by row, after the card that names it."""
    if title not in texts:
        raise ValueError(f"it holds {', '.join(texts)}, no {title}")
    values = np.array(texts[title].partition("*")[0].replace(",", " ").split(), dtype=float)
    size = int(np.sqrt(2.0 * values.size))
    if size * (size + 1) != 2 * values.size:
        raise ValueError(f"{values.size} numbers are no lower triangle")
    result = np.zeros((size, size))
    rows, columns = np.tril_indices(size)
    result[rows, columns] = result[columns, rows] = values
    return result
