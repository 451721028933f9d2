"""Beams as metric elements: a brick between two rigid sections, of six strains in its middle (docs/theory.md).

Extension, shear, curvatures and twist are products of positions' slopes, as of shells. One element is exact in linear
statics: its shear compliance has the bending that linear functions lack (R. H. MacNeal, Comput. Struct. 8 (1978) 175).
"""

import numpy as np

from ..files.basics import FloatArray

ROWS = (*((place, 2, 2) for place in range(5)), *((k, 0, 2) for k in (0, 3, 4)), *((k, 1, 2) for k in (0, 1, 2)))
"""Place and both components of each natural strain; the third runs along the beam."""

# ε, κ₁, κ₂, τ, γ₁, γ₂ of them, times what lengths make of them.
_STRAINS = np.zeros((6, len(ROWS)))
_STRAINS[[0, 4, 5], [0, 5, 8]] = 2.0, 1.0, 1.0
_STRAINS[[1, 1, 2, 2], [1, 2, 3, 4]] = _STRAINS[3, [10, 9, 6, 7]] = 1.0, -1.0, 1.0, -1.0


def beam_law(corners: FloatArray, merged: FloatArray, constants: FloatArray, section: FloatArray) -> FloatArray:
    """Matrix of a beam's energy ½ eᵀ D e.

    Parameters
    ----------
    corners : (e, 8, 3) float
        Of both sections, m.
    merged : (r, k) float
        Natural strains at `ROWS`, shear twice, of those that differ.
    constants : (e, 2) float
        E, ν.
    section : (e, 8) float
        As of `ElementBlock`.

    Returns
    -------
    (e, k, k) float
        J.
    """
    modulus, shear = constants[:, 0], 0.5 * constants[:, 0] / (1.0 + constants[:, 1])
    length = np.linalg.norm(corners[:, 4:].mean(axis=1) - corners[:, :4].mean(axis=1), axis=1)
    a, b = np.sqrt(3.0 * section[:, 1:3] / section[:, :1]).T
    scale = np.array([1.0 / length, 1.0 / (length * a), 1.0 / (length * b), 0.25 / (a * b), 1.0 / a, 1.0 / b])
    soft = [1.0 / (shear * section[:, 4 + k]) + length**2 / (12.0 * modulus * section[:, 1 + k]) for k in (0, 1)]
    stiff = np.array([*(modulus * section[:, :3].T), shear * section[:, 3], 1.0 / soft[0], 1.0 / soft[1]])
    found = (2.0 / length * scale).T[:, :, None] * (_STRAINS @ merged)
    # Shear is that at the shear centre, which twist moves.
    found[:, 4:] += section[:, [7, 6], None] * np.array([[1.0], [-1.0]]) * found[:, 3:4]
    return found.swapaxes(1, 2) @ ((length * stiff).T[:, :, None] * found)
