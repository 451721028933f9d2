"""Interface quasi-Newton: from what the coupled inputs changed and what came back, to the next change of inputs.

The coupled inputs x settle where the residual r(x) = g(x) − x is zero; g(x) is what the FMUs' outputs ask for after a
step with x. Columns of V and W are differences of residuals and of inputs between evaluations. Least squares on V takes
away what is known of the residual, the rest goes through a model M of −∂r/∂x,

    α = argmin |V α + r|,   Δx = W α + M⁻¹ (r + V α).

With M = 1 this is IQN-ILS: J. Degroote, K.-J. Bathe, J. Vierendeels, Performance of a new partitioned procedure versus
a monolithic procedure in fluid-structure interaction, Computers and Structures 87 (2009) 793-801.
"""

from dataclasses import dataclass

import numpy as np

from ..files.array_types import BoolArray, FloatArray

# Least new part of a difference: of this step, where less is noise, and of earlier ones. Those are off by the curvature
# between steps, some per mille, which a smaller new part would divide: the inputs would jump by far.
_DEPENDENT, _DEPENDENT_EARLIER = 1e-6, 1e-3


@dataclass(frozen=True, slots=True)
class Secants:
    """K differences between evaluations, the newest first.

    Attributes
    ----------
    residuals : (n, K) float
        V, in the units of the inputs.
    inputs : (n, K) float
        W.
    """

    residuals: FloatArray
    inputs: FloatArray


@dataclass(frozen=True, slots=True)
class KnownResponse:
    """What is known beforehand of g.

    Attributes
    ----------
    slope : (n, n) float
        ∂g/∂x, zero where unknown.
    known : (n,) bool
        Inputs of whose g the slope is known.
    whole : bool
        Whether nothing is missing: no input, and no effect of one on another.
    """

    slope: FloatArray
    known: BoolArray
    whole: bool = False


def no_secants(size: int) -> Secants:
    """Secants before the first evaluation.

    Parameters
    ----------
    size : int
        Number of coupled inputs.

    Returns
    -------
    Secants
    """
    return Secants(np.zeros((size, 0)), np.zeros((size, 0)))


def joined(newer: Secants, older: Secants) -> Secants:
    """All differences of both, the newer ones first.

    Parameters
    ----------
    newer, older : Secants

    Returns
    -------
    Secants
    """
    return Secants(np.hstack([newer.residuals, older.residuals]), np.hstack([newer.inputs, older.inputs]))


def quasi_newton_update(
    residual: FloatArray,
    secants: Secants,
    scale: FloatArray,
    relaxation: float,
    model: KnownResponse | None = None,
    earlier: Secants | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Change of the coupled inputs that should make the residual zero, and how far off they may still be.

    What neither differences nor model explain of the residual is added in part only: by the stiffest response seen so
    far. The small change tells the rest. How far off the inputs are is judged by the softest response instead.

    Parameters
    ----------
    residual : (n,) float
        g(x) − x.
    secants : Secants
        Of this step.
    scale : (n,) float
        Sizes that make inputs of different kinds comparable, > 0.
    relaxation : float
        Part of an unexplained residual that is added as long as there are no differences.
    model : KnownResponse, optional
    earlier : Secants, optional
        Of earlier steps.

    Returns
    -------
    change : (n,) float
    estimate : (n,) float
        Of the error of the inputs.
    """
    least_new = np.full(secants.inputs.shape[1], _DEPENDENT)
    if earlier is not None:
        secants = joined(secants, earlier)
        least_new = np.append(least_new, np.full(earlier.inputs.shape[1], _DEPENDENT_EARLIER))
    basis, kept = _independent(secants.residuals / scale[:, None], least_new)
    # α from the triangular system, V = basis · triangle.
    triangle = basis.T @ (secants.residuals[:, kept] / scale[:, None])
    alpha = -np.linalg.solve(triangle, basis.T @ (residual / scale)) if kept else np.zeros(0)
    rest = residual + secants.residuals[:, kept] @ alpha
    explained = secants.inputs[:, kept] @ alpha
    least, most = (relaxation, 1.0) if not kept else _responses(secants, kept, scale)
    return explained + _unexplained(rest, scale, least, model), explained + _unexplained(rest, scale, most, model)


def _responses(secants: Secants, kept: list[int], scale: FloatArray) -> tuple[float, float]:
    """Smallest and largest ratio of inputs to residuals among the differences, at most one."""
    moved = np.linalg.norm(secants.inputs[:, kept] / scale[:, None], axis=0)
    answered = np.linalg.norm(secants.residuals[:, kept] / scale[:, None], axis=0)
    ratio = np.minimum(moved / answered, 1.0)
    return float(np.min(ratio)), float(np.max(ratio))


def _unexplained(rest: FloatArray, scale: FloatArray, part: float, model: KnownResponse | None) -> FloatArray:
    """M⁻¹ times what is left of the residual; where nothing is known M is 1/part."""
    plain: FloatArray = part * rest
    if model is None:
        return plain
    matrix = np.diag(np.where(model.known, 1.0, 1.0 / part)) - model.slope
    try:
        solved: FloatArray = scale * np.linalg.solve(matrix * scale[None, :] / scale[:, None], rest / scale)
    except np.linalg.LinAlgError:
        return plain
    return solved


def _independent(columns: FloatArray, least_new: FloatArray) -> tuple[FloatArray, list[int]]:
    """Orthonormal basis of the columns, and which of them are kept: those that add a direction to the earlier ones."""
    basis = np.zeros((len(columns), 0))
    kept: list[int] = []
    for k, column in enumerate(columns.T):
        size = float(np.linalg.norm(column))
        rest = column
        # Twice is enough to be orthogonal to round-off.
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        new = float(np.linalg.norm(rest))
        if size > 0.0 and np.isfinite(size) and new > least_new[k] * size and basis.shape[1] < len(columns):
            basis = np.column_stack([basis, rest / new])
            kept.append(k)
    return basis, kept
