"""Unit systems of mesh files and body files' materials: the only place where a body's numbers are turned into SI."""

from enum import Enum
from typing import NamedTuple

# Exact by definition: the inch, and the pound-force.
INCH = 0.0254
POUND_FORCE = 4.4482216152605


class Factors(NamedTuple):
    """A system's units in SI, and what they are called.

    Attributes
    ----------
    length, stress, density : float
        Metres, pascals and kilograms per cubic metre per unit.
    length_name, stress_name, density_name : str
    """

    length: float
    stress: float
    density: float
    length_name: str
    stress_name: str
    density_name: str


class UnitSystem(Enum):
    """Consistent units that a mesh file may be written in.

    `SI` is metre, kilogram, second, newton and pascal; `MM_T_S` is millimetre, tonne, second, newton and
    megapascal; `IN_LBF_S` is inch, pound-force, second and psi, densities in lbf s²/in⁴.
    """

    SI = "m-kg-s"
    MM_T_S = "mm-t-s"
    IN_LBF_S = "in-lbf-s"

    @property
    def factors(self) -> Factors:
        """Its units in SI."""
        return _FACTORS[self]

    @property
    def length(self) -> float:
        """Metres per unit of length."""
        return self.factors.length

    @property
    def stress(self) -> float:
        """Pascals per unit of stress."""
        return self.factors.stress

    @property
    def density(self) -> float:
        """Kilograms per cubic metre, per unit of density."""
        return self.factors.density


_FACTORS = {
    UnitSystem.SI: Factors(1.0, 1.0, 1.0, "m", "N/m²", "kg/m³"),
    UnitSystem.MM_T_S: Factors(1e-3, 1e6, 1e12, "mm", "MPa", "t/mm³"),
    UnitSystem.IN_LBF_S: Factors(INCH, POUND_FORCE / INCH**2, POUND_FORCE / INCH**4, "in", "psi", "lbf s²/in⁴"),
}
