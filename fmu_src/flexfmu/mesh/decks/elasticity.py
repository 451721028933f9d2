"""Elastic constants: the *ELASTIC cards of a deck."""

from typing import NamedTuple

import numpy as np

from flexfmu.files.array_types import FloatArray
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.decks.cards import Card, Line, fields, number

# Constants a row holds at most, in both solvers.
_ROW = 8
# Number of constants of each type; a temperature may follow them.
_COUNTS = {"ISO": 2, "ISOTROPIC": 2, "ENGINEERINGCONSTANTS": 9, "ENGCONSTANTS": 9, "ORTHO": 9, "ORTHOTROPIC": 9,
           "ANISO": 21, "ANISOTROPIC": 21}  # fmt: skip
_WORDS = {2: "Young's modulus, Poisson's ratio", 9: "nine constants", 21: "21 constants"}
# Places of 11, 22, 33, 12, 13, 23, the decks' order, among xx, yy, zz, xy, yz, zx.
_PLACES = np.array([0, 1, 2, 3, 5, 4])


class Elastic(NamedTuple):
    """What an *ELASTIC card says, N/m².

    Attributes
    ----------
    isotropic : tuple of float or None
        Young's modulus and Poisson's ratio.
    constants : tuple of float or None
        As of `Material.constants`.
    notes : tuple of str
    """

    isotropic: tuple[float, float] | None
    constants: tuple[float, ...] | None
    notes: tuple[str, ...]


def elastic_constants(card: Card, units: UnitSystem) -> Elastic:
    """Return the constants of an *ELASTIC card; of several temperatures those of the first.

    Parameters
    ----------
    card : Card
    units : UnitSystem

    Returns
    -------
    Elastic

    Raises
    ------
    DeckError
        Its type is not supported, constants are missing, or it is not physical.
    """
    kind = card.parameters.get("TYPE", "ISO").upper()
    count = _COUNTS.get(kind.replace(" ", ""))
    if count is None:
        raise card.line.error(
            f"*ELASTIC, TYPE={kind} is not supported; give ISOTROPIC, ENGINEERING CONSTANTS, ORTHOTROPIC or "
            "ANISOTROPIC constants"
        )
    rows = -(-count // _ROW)
    values = [number(text, line, f"each of {_WORDS[count]}") for line in card.data[:rows] for text in fields(line)]
    if not count <= len(values) <= count + 1:
        where = card.data[0] if card.data else card.line
        raise where.error(f"*ELASTIC should have {_WORDS[count]}, found {len(values)} numbers")
    notes = []
    if len(card.data) > rows:
        at = f" ({values[count]:g})" if len(values) > count else ""
        notes.append(f"{card.line.place}: the elastic constants of the first temperature{at} are taken for all")
    if count == 2:
        return Elastic(_isotropic(card.data[0], values, units), None, tuple(notes))
    matrix = _matrix(kind, np.array(values[:count]), card.data[0]) * units.stress
    if not np.isfinite(matrix).all() or np.linalg.eigvalsh(matrix)[0] <= 0.0:
        raise card.data[0].error(
            "these elastic constants belong to no material: some deformation would give energy back; check their "
            "order and Poisson's ratios"
        )
    return Elastic(None, tuple(matrix.ravel().tolist()), tuple(notes))


def _isotropic(line: Line, values: list[float], units: UnitSystem) -> tuple[float, float]:
    youngs, poisson = values[0] * units.stress, values[1]
    if youngs <= 0.0:
        raise line.error(f"Young's modulus should be positive, found {values[0]:g}")
    if not -1.0 < poisson < 0.5:
        raise line.error(f"Poisson's ratio should lie between -1 and 0.5 (both excluded), found {poisson:g}")
    return youngs, poisson


def _matrix(kind: str, values: FloatArray, line: Line) -> FloatArray:
    """Matrix (6, 6) in the order xx, yy, zz, xy, yz, zx of an anisotropic material's constants."""
    matrix = np.zeros((6, 6))
    if values.size == 21:
        # Upper triangle, column by column.
        rows, columns = np.tril_indices(6)
        matrix[columns, rows] = matrix[rows, columns] = values
    elif kind.startswith("ORTHO"):
        rows, columns = np.tril_indices(3)
        matrix[columns, rows] = matrix[rows, columns] = values[:6]
        matrix[range(3, 6), range(3, 6)] = values[6:]
    else:
        moduli, ratios, shear = values[:3], values[3:6], values[6:]
        if min(*moduli, *shear) <= 0.0:
            raise line.error("Young's moduli and shear moduli should be positive")
        compliance = np.diag(1.0 / np.concatenate([moduli, shear]))
        for (i, j), ratio in zip(((0, 1), (0, 2), (1, 2)), ratios, strict=True):
            compliance[i, j] = compliance[j, i] = -ratio / moduli[i]
        if np.linalg.eigvalsh(compliance)[0] <= 0.0:
            raise line.error("these moduli and Poisson's ratios belong to no material; check their order")
        matrix[:] = np.linalg.inv(compliance)
    return matrix[np.ix_(_PLACES, _PLACES)]
