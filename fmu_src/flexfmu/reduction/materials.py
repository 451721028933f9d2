"""Materials of a body: what the mesh file tells, completed or replaced by the body file."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..files.errors import BodyFileError
from ..files.units import UnitSystem
from ..mesh.model import NO_MATERIAL, Material, Mesh
from .options import BodyOptions, MaterialConstants

KEYS = ("youngs_modulus", "poissons_ratio", "density")


def elements_without_material(mesh: Mesh) -> int:
    """Number of elements to which the mesh file gives no material."""
    return sum(int(np.sum(block.material == NO_MATERIAL)) for block in mesh.blocks)


def completed(mesh: Mesh, config: BodyOptions) -> tuple[Mesh, tuple[str, ...]]:
    """Give every element a material with all its constants.

    A table with a name takes the place of what the mesh file says of that material, key by key. The one without is for
    elements without material, and for constants that the file does not tell.

    Parameters
    ----------
    mesh : Mesh
    config : BodyOptions

    Returns
    -------
    mesh : Mesh
    notes : tuple of str
        What was replaced.

    Raises
    ------
    BodyFileError
        A name that no material has, two tables for one, or constants that nobody tells.
    """
    units = config.units
    notes = []
    materials = list(mesh.materials)
    for table in config.materials:
        if table.name is None:
            continue
        place = _place(materials, table.name)
        given = [key for key in KEYS if getattr(table, key) is not None]
        told = [key for key in given if not np.isnan(getattr(materials[place], key))]
        if told:
            notes.append(f"[material]: {', '.join(told)} of {materials[place].name!r} instead of the mesh file's")
        materials[place] = _with(materials[place], table, given, units)
    rest = _unnamed(config.materials)
    if rest is not None:
        for place, material in enumerate(materials):
            lacking = [key for key in missing(material) if getattr(rest, key) is not None]
            materials[place] = _with(material, rest, lacking, units)
            if lacking:
                notes.append(
                    f"[material]: {', '.join(lacking)} of {material.name!r}, which the mesh file does not tell"
                )
    blocks, bare = mesh.blocks, elements_without_material(mesh)
    if bare:
        if rest is None or any(getattr(rest, key) is None for key in KEYS):
            raise BodyFileError(
                f"{bare} of {mesh.element_count} elements have no material in the mesh file: add a [material] table "
                f"with {', '.join(KEYS[:2])} and {KEYS[2]}, in the units of [mesh] ({_units(units)})"
            )
        index = len(materials)
        materials.append(_with(Material("[material]", np.nan, np.nan, np.nan), rest, list(KEYS), units))
        blocks = tuple(
            replace(block, material=np.where(block.material == NO_MATERIAL, index, block.material)) for block in blocks
        )
    _refuse_missing(materials, units)
    return replace(mesh, blocks=blocks, materials=tuple(materials)), tuple(notes)


def _refuse_missing(materials: Sequence[Material], units: UnitSystem) -> None:
    """Raise where a material lacks constants."""
    for material in materials:
        if lacking := list(missing(material)):
            raise BodyFileError(
                f"the mesh file does not tell {', '.join(lacking)} of the material {material.name!r}: add a [material] "
                f"table with it, in the units of [mesh] ({_units(units)}), of this name if there are several"
            )


def missing(material: Material) -> tuple[str, ...]:
    """Keys of the constants that a mesh file does not tell of a material."""
    return tuple(key for key in KEYS if np.isnan(getattr(material, key)))


def needless(mesh: Mesh, config: BodyOptions) -> bool:
    """Whether the table without a name is for nothing."""
    return (
        _unnamed(config.materials) is not None
        and not elements_without_material(mesh)
        and not any(missing(material) for material in mesh.materials)
    )


def _unnamed(tables: Sequence[MaterialConstants]) -> MaterialConstants | None:
    return next((table for table in tables if table.name is None), None)


def _place(materials: Sequence[Material], name: str) -> int:
    found = [place for place, material in enumerate(materials) if material.name.upper() == name.upper()]
    if len(found) != 1:
        there = ", ".join(material.name for material in materials) or "none"
        raise BodyFileError(f"[material] name = {name!r}: the mesh file names no such material; it has: {there}")
    return found[0]


def _with(material: Material, table: MaterialConstants, keys: Sequence[str], units: UnitSystem) -> Material:
    scale = {"youngs_modulus": units.stress, "poissons_ratio": 1.0, "density": units.density}
    values = {key: getattr(table, key) * scale[key] for key in keys}
    # Constants of directions do not survive a modulus without any.
    found = replace(material, **values)
    return found if set(keys) <= {"density"} else replace(found, constants=None, layers=())


def _units(units: UnitSystem) -> str:
    return f"{units.stress_name}, –, {units.density_name}"
