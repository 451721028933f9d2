"""Normal modes of the supported body, equation (1)'s φ: mass-orthonormal, checked, with a fixed sign."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..errors import AccuracyError, BodyFileError, ModelError
from ..fe.factorisation import Factorisation
from ..mesh.model import FloatArray

# Lanczos reaches round-off; these leave three decades for matrices of bad condition.
_ORTHONORMALITY_LIMIT = 1e-9
_RESIDUAL_LIMIT = 1e-6
# Relative distance of ω² below which modes span a plane whose axes are arbitrary.
_DEGENERATE = 1e-7
# A component this close to the largest may serve to fix a sign: the first such one is taken.
_NEARLY_LARGEST = 0.9


@dataclass(frozen=True, slots=True)
class Modes:
    """Mass-orthonormal modes.

    Attributes
    ----------
    angular_frequency : (m,) float
        rad/s, ascending.
    shapes : (3n, m) float
        kg^-1/2, zero at supports; degree of freedom 3 i + j is node i in direction j.
    orthonormality_error : float
        Largest entry of |ΦᵀMΦ − I|.
    residual : float
        Largest of |Kφ − ω²Mφ| / |Kφ|.
    splits_pair : bool
        Whether the next mode, left out, has the frequency of the last.
    """

    angular_frequency: FloatArray
    shapes: FloatArray
    orthonormality_error: float
    residual: float
    splits_pair: bool


def normal_modes(
    stiffness: sp.csr_array, mass: sp.csr_array, free: np.ndarray, factor: Factorisation, count: int
) -> Modes:
    """Lowest modes with the supports in place, by shift-invert Lanczos about zero.

    Parameters
    ----------
    stiffness, mass : (3n, 3n) sparse
        Of all degrees of freedom.
    free : (k,) int
        Degrees of freedom that no support holds.
    factor : Factorisation
        Of the stiffness of the free degrees of freedom.
    count : int
        Number of modes.

    Returns
    -------
    Modes

    Raises
    ------
    BodyFileError
        More modes are asked for than the mesh has.
    AccuracyError
        The modes do not pass their own check.
    """
    k, m = stiffness[free][:, free], mass[free][:, free]
    asked = count + 1
    if asked >= free.size:
        raise BodyFileError(f"[reduction] modes = {count}: the mesh has {free.size} free degrees of freedom only")
    # A fixed start with all wave lengths in it makes a rebuild repeat the same iteration.
    start = np.random.default_rng(0).standard_normal(free.size)
    inverse = spla.LinearOperator(k.shape, matvec=factor.solve, dtype=np.float64)
    try:
        _, vectors = spla.eigsh(k, k=asked, M=m, sigma=0.0, OPinv=inverse, v0=start, ncv=max(2 * asked + 1, 20))
    except spla.ArpackError as error:
        raise AccuracyError(f"the eigenvalue iteration failed ({error}); ask for fewer modes") from error
    # One Rayleigh-Ritz step removes what is left of the iteration's lack of orthogonality.
    squares, small = scipy.linalg.eigh(vectors.T @ (k @ vectors), vectors.T @ (m @ vectors))
    vectors = vectors @ small
    if squares[0] <= 0.0:
        raise ModelError(f"the lowest eigenvalue is {squares[0]:.3e} 1/s²: a part of the body is free to move")
    splits = bool(squares[count] - squares[count - 1] < _DEGENERATE * squares[count])
    squares, vectors = squares[:count], _fixed_axes(squares[:count], vectors[:, :count])

    orthonormality = float(np.max(np.abs(vectors.T @ (m @ vectors) - np.eye(count))))
    forces = k @ vectors
    residuals = np.linalg.norm(forces - (m @ vectors) * squares, axis=0) / np.linalg.norm(forces, axis=0)
    residual = float(residuals.max())
    if orthonormality > _ORTHONORMALITY_LIMIT or residual > _RESIDUAL_LIMIT:
        raise AccuracyError(
            f"modes are not good enough: |ΦᵀMΦ − I| = {orthonormality:.1e} (limit {_ORTHONORMALITY_LIMIT:.0e}), "
            f"residual {residual:.1e} (limit {_RESIDUAL_LIMIT:.0e}); check the mesh for badly shaped elements"
        )
    shapes = np.zeros((stiffness.shape[0], count))
    shapes[free] = vectors
    return Modes(np.sqrt(squares), shapes, orthonormality, residual, splits)


def _fixed_axes(squares: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn modes of equal frequency to fixed axes and give every mode a fixed sign."""
    vectors = vectors.copy()
    starts = np.flatnonzero(np.diff(squares, prepend=-np.inf) > _DEGENERATE * squares)
    for first, end in zip(starts, [*starts[1:], squares.size], strict=True):
        block = vectors[:, first:end]
        for column in range(block.shape[1]):
            # Put all of one component that these modes have much of into this mode, none into the later ones.
            size = np.linalg.norm(block[:, column:], axis=1)
            row = int(np.argmax(size >= _NEARLY_LARGEST * size.max()))
            axis = block[row, column:] / size[row]
            turn = _rotation_onto(axis)
            block[:, column:] = block[:, column:] @ turn
    return vectors


def _rotation_onto(axis: FloatArray) -> FloatArray:
    """Orthogonal matrix whose first column is the unit vector `axis`."""
    turn, upper = np.linalg.qr(np.column_stack([axis, np.eye(axis.size)]))
    result: FloatArray = turn * np.sign(np.concatenate([[upper[0, 0]], np.ones(axis.size - 1)]))
    return result
