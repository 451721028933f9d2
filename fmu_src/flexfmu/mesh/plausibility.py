"""Whether a body looks like a solid in the units that it was declared in, and which units it is likely in if not."""

from collections.abc import Mapping

import numpy as np

from flexfmu.files.units import UNITS, UnitSystem
from flexfmu.mesh.model import Material, Mesh

# Longest side, m: flexible bodies from a flexure hinge to a rotor blade.
SIZE_RANGE = (2e-3, 100.0)
# Young's modulus, N/m²: from soft rubber to diamond.
MODULUS_RANGE = (1e6, 2e12)
# Density, kg/m³: from aerogel to osmium.
DENSITY_RANGE = (1.0, 3e4)
# √(E/ρ), m/s: no solid is faster than diamond, at 18 000.
_FASTEST = 2.5e4
# What is as dense as metal or ceramics, kg/m³, is not as soft as rubber, N/m².
_DENSE, _SOFT = 2500.0, 5e9
# What a number is likely to be: sizes of machine parts, moduli and densities of what bears loads.
_LIKELY_SIZE = (5e-3, 20.0)
_LIKELY_MODULUS = (1e9, 1.3e12)
_LIKELY_DENSITY = (500.0, 2.5e4)
_LENGTHS = {"m": 1.0, "mm": UNITS["m"]["mm"], "inches": UNITS["m"]["in"]}
_STRESSES = {"N/m²": 1.0, **{name: UNITS["Pa"][name] for name in ("MPa", "GPa", "psi")}}


def implausible(mesh: Mesh, units: UnitSystem) -> tuple[str, ...]:
    """Say what no solid body is likely to be, with the units that would explain it.

    Parameters
    ----------
    mesh : Mesh
        SI units.
    units : UnitSystem
        What its numbers were declared in.

    Returns
    -------
    tuple of str
        Warnings; none for a plausible body.
    """
    found = [_size_doubt(mesh, units), *(_material_doubt(material, units) for material in mesh.materials)]
    doubts = [doubt for doubt in found if doubt is not None]
    if not doubts:
        return ()
    for other in UnitSystem:
        if other is not units and _plausible_in(other, mesh, units):
            what = "; ".join(fault for fault, _ in doubts)
            return (
                f"{what}: implausible. In {other.value} the body would be {_sides(mesh, other.length / units.length)} "
                f'and all its numbers plausible: if the mesh is in {other.value}, set units = "{other.value}" in '
                f"[mesh] (found {units.value})",
            )
    return tuple(f"{fault}: implausible. {cause}" for fault, cause in doubts)


def is_likely_density(density: float) -> bool:
    """Whether machine parts have such a density, kg/m³."""
    return _within(density, _LIKELY_DENSITY)


def is_likely(mesh: Mesh) -> bool:
    """Whether a mesh (SI units) has the size of machine parts, of materials that they may be of if it tells."""
    known = (one for one in mesh.materials if not np.isnan(one.youngs_modulus + one.density))
    return _within(_size(mesh), _LIKELY_SIZE) and all(_likely(one.youngs_modulus, one.density) for one in known)


def _plausible_in(other: UnitSystem, mesh: Mesh, units: UnitSystem) -> bool:
    """Whether the same numbers are a likely body throughout in another system."""
    stress, density = other.stress / units.stress, other.density / units.density
    return _within(_size(mesh) * other.length / units.length, _LIKELY_SIZE) and all(
        _likely(material.youngs_modulus * stress, material.density * density) for material in mesh.materials
    )


def _likely(modulus: float, density: float) -> bool:
    return _solid(modulus, density) and is_likely_density(density)


def _solid(modulus: float, density: float) -> bool:
    return (
        _within(modulus, MODULUS_RANGE)
        and _within(density, DENSITY_RANGE)
        and modulus <= density * _FASTEST**2
        and not (density > _DENSE and modulus < _SOFT)
    )


def _size_doubt(mesh: Mesh, units: UnitSystem) -> tuple[str, str] | None:
    """What is wrong with the body's size, and the likely cause; None if nothing is."""
    if _within(_size(mesh), SIZE_RANGE):
        return None
    fits = [
        f"in {name}, {_sides(mesh, factor / units.length)}"
        for name, factor in _LENGTHS.items()
        if _within(_size(mesh) * factor / units.length, _LIKELY_SIZE)
    ]
    known = ", ".join(f'"{system.value}"' for system in UnitSystem)
    return (
        f"the body measures {_sides(mesh, 1.0)}",
        _cause(fits, "its mesh") + f"Give the mesh's units in [mesh] (found {units.value}, known: {known}); [material] "
        "is in the same units",
    )


def _material_doubt(material: Material, units: UnitSystem) -> tuple[str, str] | None:
    """What is wrong with a material, and the likely cause; None if nothing is."""
    modulus, density = material.youngs_modulus, material.density
    if _solid(modulus, density):
        return None
    stress_name, density_name = units.stress_name, units.density_name
    fault = (
        f"material {material.name!r} has Young's modulus {modulus / units.stress:.6g} {stress_name} and "
        f"density {density / units.density:.6g} {density_name}"
    )
    if units is not UnitSystem.SI:
        fault += f" ({modulus:.3g} N/m², {density:.3g} kg/m³)"
    causes = []
    if not _within(density, DENSITY_RANGE) or modulus > density * _FASTEST**2:
        causes.append(
            _cause(_fits(density, units.density, UNITS["kg/m³"], _LIKELY_DENSITY, density_name), "the density")
        )
    if not _within(modulus, MODULUS_RANGE) or (density > _DENSE and modulus < _SOFT):
        fits = _fits(modulus, units.stress, _STRESSES, _LIKELY_MODULUS, stress_name)
        causes.append(_cause(fits, "the modulus"))
    return fault, "".join(causes) + f"Give both in the units of [mesh] ({units.value}), or correct these"


def _fits(value: float, unit: float, table: Mapping[str, float], likely: tuple[float, float], name: str) -> list[str]:
    """Other units in which the number that was read is a likely one, with what it is then."""
    return [
        f"in {other}, {value / unit * factor / unit:.4g} {name}"
        for other, factor in table.items()
        if factor != unit and _within(value / unit * factor, likely)
    ]


def _cause(fits: list[str], what: str) -> str:
    return f"{what[0].upper()}{what[1:]} may be {', or '.join(fits)}. " if fits else ""


def _sides(mesh: Mesh, factor: float) -> str:
    return " × ".join(f"{factor * side:.4g}" for side in np.ptp(mesh.points, axis=0)) + " m"


def _size(mesh: Mesh) -> float:
    return float(np.ptp(mesh.points, axis=0).max())


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
