"""Unit systems of mesh files: the only place where a body's numbers are turned into SI."""

from enum import Enum


class UnitSystem(Enum):
    """Consistent units that a mesh file may be written in.

    `SI` is metre, kilogram, second, newton and pascal; `MM_T_S` is millimetre, tonne, second, newton and
    megapascal.
    """

    SI = "m-kg-s"
    MM_T_S = "mm-t-s"

    @property
    def length(self) -> float:
        """Metres per unit of length."""
        return 1.0 if self is UnitSystem.SI else 1e-3

    @property
    def stress(self) -> float:
        """Pascals per unit of stress."""
        return 1.0 if self is UnitSystem.SI else 1e6

    @property
    def density(self) -> float:
        """Kilograms per cubic metre, per unit of density."""
        return 1.0 if self is UnitSystem.SI else 1e12
