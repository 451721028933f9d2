"""Nastran's cards of shells: PSHELL, PCOMP and PCOMPG, the directions of their materials, MAT1, MAT2 and MAT8."""

from pathlib import Path
from typing import Any

import numpy as np

from flexfmu.files.array_types import FloatArray
from flexfmu.files.errors import MeshError
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.model import Material, isotropic_average, laminate
from flexfmu.mesh.nastran.line_cards import basic
from flexfmu.model.rotations import exponential

# Shells by their card, where they have one of these properties.
SHELLS = {name: name for name in ("CTRIA3", "CTRIA6", "CQUAD4", "CQUAD8")} | {"CTRIAR": "CTRIA3", "CQUADR": "CQUAD4"}
LAYERED = ("PCOMP", "PCOMPG")
# What pyNastran says of shear across layers where the file says nothing, and Nastran takes them as rigid.
_NO_SHEAR = (0.0, 1e8)
# Places of strain in the plane and twice shear among xx, yy, zz, xy, yz, zx.
_PLANE = np.array([0, 1, 3])


def faces_of_shells(model: Any, path: Path) -> tuple[dict[str, tuple[float, float]], dict[int, FloatArray]]:
    """Heights of both faces over the grid points by "PSHELL n"; where they are others, by element at its corners."""
    found: dict[str, tuple[float, float]] = {}
    others: dict[int, FloatArray] = {}
    for element in model.elements.values():
        if element.type not in SHELLS or element.pid not in model.properties:
            continue
        own = model.properties[element.pid]
        if own.type not in ("PSHELL", *LAYERED):
            raise MeshError(f"{path}: {own.type} {own.pid} is the property of shells, expected PSHELL, PCOMP or PCOMPG")
        layered = own.type in LAYERED
        if not layered:
            _refuse_others(own, path)
        thickness, low = (own.Thickness(), own.z0) if layered else (own.t, -0.5 * own.t)
        found[f"{own.type} {own.pid}"] = low, low + thickness
        corners = [getattr(element, f"T{k}", None) for k in range(1, (3 if "TRIA" in element.type else 4) + 1)]
        given = not layered and any(one is not None for one in corners)
        if element.zoffset or given:
            unit = thickness if element.tflag else 1.0
            thick = np.array([thickness if one is None or layered else one * unit for one in corners])
            if thick.min() <= 0.0:
                raise MeshError(f"{path}: {element.type} {element.eid} has a thickness of {thick.min():g} at a corner")
            if given and own.nsm:
                raise MeshError(f"{path}: {element.type} {element.eid} has a thickness of its own beside NSM")
            share = np.array([low, low + thickness]) / thickness
            others[element.eid] = (element.zoffset or 0.0) + thick[:, None] * share
    return found, others


def _refuse_others(own: Any, path: Path) -> None:
    """Refuse a PSHELL that is no plate of one material."""
    bent = own.mid2 == own.mid1 and own.mid3 in (own.mid1, None) and own.mid4 in (0, None)
    usual = np.allclose([own.twelveIt3, own.tst], [1.0, 5.0 / 6.0], atol=1e-4)
    if not (bent and usual and own.t):
        raise MeshError(
            f"{path}: PSHELL {own.pid} should have a thickness, one material for stretching, bending and shear (MID1 = "
            "MID2 = MID3), 12I/T**3 = 1 and TS/T = 0.833333"
        )


def directions(model: Any, place: dict[int, FloatArray], path: Path) -> dict[int, FloatArray]:
    """Axes (3, 3), as columns, of the materials of shells that have a direction, by element.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    place : dict of int to (3,) float
        Of grid points.
    path : Path
    """
    found = {}
    for element in model.elements.values():
        own = model.properties.get(element.pid) if element.type in SHELLS else None
        if own is None or (own.type == "PSHELL" and getattr(model.materials.get(own.mid1), "type", "MAT1") == "MAT1"):
            continue
        first, second, third = (place[node] for node in element.nodes[:3])
        last = third if "TRIA" in element.type else place[element.nodes[3]]
        normal = (
            np.cross(third - first, last - second) if last is not third else np.cross(second - first, third - first)
        )
        normal /= np.linalg.norm(normal)
        along, angle = second - first, element.theta_mcid or 0.0
        if isinstance(angle, int):
            along, angle = basic(np.eye(3)[0], angle, model, f"{path}: {element.type} {element.eid}"), 0.0
        along = along - (along @ normal) * normal
        along = exponential(np.radians(angle) * normal) @ along / np.linalg.norm(along)
        found[element.eid] = np.column_stack([along, np.cross(normal, along), normal])
    return found


def layers(model: Any, own: Any, units: UnitSystem, weight: float, path: Path) -> Material:
    """What shells with a PCOMP or PCOMPG are made of."""
    if own.lam not in (None, "", "NO", "SYM"):
        raise MeshError(f"{path}: {own.type} {own.pid} has LAM = {own.lam}, expected none or SYM; write all layers")
    every = zip(own.thicknesses, own.thetas, own.mids, strict=True)
    plies = [(h, float(np.radians(t)), material(model, mid, units, weight, path)) for h, t, mid in every]
    plies += plies[::-1] if own.lam == "SYM" else []
    return laminate(f"{own.type} {own.pid}", plies, by_normal=True, more=own.nsm * weight / own.Thickness())


def material(model: Any, number: int, units: UnitSystem, weight: float, path: Path, more: float = 0.0) -> Material:
    """A material of shells, solids or beams, SI units, by its number; of more density than its own."""
    found, name = model.materials[number], f"{model.materials[number].type} {number}"
    name, density = f"{name}{' with the mass of a section' if more else ''}", found.rho * weight + more
    if found.type == "MAT1":
        return Material(name, found.e * units.stress, found.nu, density)
    if found.type == "MAT8":
        shear = found.g1z, found.g2z
        across = [found.g12 if one in _NO_SHEAR else one for one in shear]
        plane = np.zeros((3, 3))
        plane[:2, :2] = np.array([[found.e11, found.nu12 * found.e22], [found.nu12 * found.e22, found.e22]])
        plane[:2, :2] /= 1.0 - found.nu12**2 * found.e22 / found.e11
        plane[2, 2] = found.g12
    elif found.type == "MAT2":
        rows = (found.G11, found.G12, found.G13), (found.G12, found.G22, found.G23), (found.G13, found.G23, found.G33)
        plane, across = np.array(rows), [found.G33] * 2
    else:
        raise MeshError(
            f"{path}: {found.type} {number} is the material of shells, expected MAT1, or of shells MAT2 or MAT8"
        )
    stiff = np.diag([0.0, 0.0, plane[1, 1], 0.0, across[1], across[0]])
    stiff[_PLANE[:, None], _PLANE] = plane
    if np.linalg.eigvalsh(stiff)[0] <= 0.0:
        raise MeshError(f"{path}: the constants of {found.type} {number} belong to no material; check them")
    constants = tuple((stiff * units.stress).ravel().tolist())
    return Material(name, *isotropic_average(constants), density, constants)
