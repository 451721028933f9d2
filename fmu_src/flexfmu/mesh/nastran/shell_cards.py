"""Nastran's cards of shells: PSHELL, PSHEAR, PCOMP, PCOMPG, directions of their materials, MAT1, MAT2, MAT8."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexfmu.files.basics import FloatArray, MeshError, UnitSystem, listed
from flexfmu.mesh.model import Material, isotropic_average, laminate
from flexfmu.mesh.nastran.line_cards import basic
from flexfmu.mesh.nastran.node_cards import lines_of
from flexfmu.model.rotations import turned_by

# Shells by their card, where they have one of these properties.
SHELLS = {name: name for name in ("CTRIA3", "CTRIA6", "CQUAD4", "CQUAD8")}
SHELLS |= {"CTRIAR": "CTRIA3", "CQUADR": "CQUAD4", "CSHEAR": "CQUAD4"}
LAYERED = ("PCOMP", "PCOMPG")
OF_SHELLS = ("PSHELL", "PSHEAR", *LAYERED)
# Bending stiffness of what only stretches, over that of a plate, and stretching of what is only sheared, over shear.
_LIMP, _SLACK = 1e-3, 1e-6
# Sine of the angle by which corners of shear panels may be no right ones: 5 degrees.
_SKEW = 0.087
# What pyNastran says of shear across layers where the file says nothing, and Nastran takes them as rigid.
_NO_SHEAR = (0.0, 1e8)
# Places of strain in the plane and twice shear among xx, yy, zz, xy, yz, zx.
_PLANE = np.array([0, 1, 3])


def faces_of_shells(
    model: Any, path: Path, notes: list[str]
) -> tuple[dict[str, tuple[float, float]], dict[int, FloatArray]]:
    """Heights of both faces over the grid points by "PSHELL n"; where they are others, by element at its corners.

    Notes get what does not bend.
    """
    found: dict[str, tuple[float, float]] = {}
    others: dict[int, FloatArray] = {}
    for element in model.elements.values():
        if element.type not in SHELLS or element.pid not in model.properties:
            continue
        own = model.properties[element.pid]
        if own.type not in OF_SHELLS or (own.type == "PSHEAR") != (element.type == "CSHEAR"):
            fault = f"{path}: {own.type} {own.pid} is the property of shells"
            raise MeshError(f"{fault}, expected PSHELL, PCOMP or PCOMPG, of CSHEAR PSHEAR")
        layered = own.type in LAYERED
        thickness, low = (own.Thickness(), own.z0) if layered else (own.t, -0.5 * own.t)
        found[f"{own.type} {own.pid}"] = low, low + thickness
        corners = [getattr(element, f"T{k}", None) for k in range(1, (3 if "TRIA" in element.type else 4) + 1)]
        given = not layered and any(one is not None for one in corners)
        if getattr(element, "zoffset", 0.0) or given:
            unit = thickness if element.tflag else 1.0
            thick = np.array([thickness if one is None or layered else one * unit for one in corners])
            if thick.min() <= 0.0:
                raise MeshError(f"{path}: {element.type} {element.eid} has a thickness of {thick.min():g} at a corner")
            if given and own.nsm:
                raise MeshError(f"{path}: {element.type} {element.eid} has a thickness of its own beside NSM")
            share = np.array([low, low + thickness]) / thickness
            others[element.eid] = (element.zoffset or 0.0) + thick[:, None] * share
    limp = [name for name in found if getattr(model.properties[int(name.split()[1])], "mid2", None) in (None, 0)]
    if limp := [name for name in limp if not name.startswith("PCOMP")]:
        notes.append(
            f"{listed(limp)} only stretch or are sheared (no MID2): they get a thousandth of a plate's stiffness for "
            "bending; hold what else would be free across them by supports"
        )
    return found, others


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
        normal = np.cross(*((third - first, last - second) if last is not third else (second - first, third - first)))
        normal /= np.linalg.norm(normal)
        if own.type == "PSHEAR":
            _refuse_skew([place[node] for node in element.nodes], f"{path}: {element.type} {element.eid}")
        along, angle = second - first, getattr(element, "theta_mcid", 0.0) or 0.0
        if isinstance(angle, int):
            along, angle = basic(np.eye(3)[0], angle, model, f"{path}: {element.type} {element.eid}"), 0.0
        along = along - (along @ normal) * normal
        along = turned_by(np.radians(angle) * normal) @ along / np.linalg.norm(along)
        found[element.eid] = np.column_stack([along, np.cross(normal, along), normal])
    return found


def _refuse_skew(corners: list[FloatArray], title: str) -> None:
    """Refuse shear panels that are no rectangles: their flow of shear is not even."""
    sides = np.roll(corners, -1, axis=0) - corners
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    if np.abs(np.sum(sides * np.roll(sides, 1, axis=0), axis=1)).max() > _SKEW:
        raise MeshError(f"{title} is no rectangle, which shear panels should be: take a CQUAD4 with a PSHELL")


def plate(model: Any, own: Any, units: UnitSystem, weight: float, path: Path) -> Material | None:
    """What shells with a PSHEAR or PSHELL are made of; None of a PSHELL that is a plate of one material."""
    title = f"{path}: {own.type} {own.pid}"
    more = own.nsm * weight / own.t if own.t else 0.0
    if own.type == "PSHEAR":
        one = material(model, own.mid, units, weight, path, more)
        if own.f1 or own.f2 or one.constants is not None or not own.t:
            raise MeshError(f"{title} should have a thickness, MAT1 and no F1 or F2: give stretching by CROD")
        shear = units.stress * model.materials[own.mid].g
        constants = np.diag([_SLACK * shear, _SLACK * shear, *[shear] * 4])
        return replace(one, name=f"{own.type} {own.pid}", constants=tuple(constants.ravel().tolist()), bending=_LIMP)
    if not own.t or not own.mid1 or own.mid4 or (own.mid3 and not own.mid2):
        raise MeshError(f"{title} should have a thickness, MID1, no MID4, and MID3 beside MID2 alone")
    usual = np.allclose([own.twelveIt3, own.tst], [1.0, 5.0 / 6.0], atol=1e-4)
    if own.mid2 == own.mid1 and usual and own.mid3 in (own.mid1, None):
        return None
    # pyNastran forgets it.
    strained = not own.mid2 and lines_of(path, "PSHELL", rf"{own.pid}[\s,]+\d+[\s,]+[-+.\deE]+[\s,]+-1")
    if strained or not {own.mid1, own.mid2 or own.mid1, own.mid3 or own.mid1} <= set(model.materials):
        raise MeshError(f"{title} names a material that is not there (plane strain by MID2 = -1 is not supported)")
    one, other = (material(model, mid or own.mid1, units, weight, path, more) for mid in (own.mid1, own.mid2))
    # In plane stress.
    stiff, bends = (np.linalg.inv(np.linalg.inv(part.elasticity)[_PLANE[:, None], _PLANE]) for part in (one, other))
    share = bends[0, 0] / stiff[0, 0]
    if not np.allclose(bends, share * stiff, atol=1e-3 * bends[0, 0]):
        raise MeshError(f"{title} bends by another Poisson's ratio or direction (MID2) than it stretches (MID1)")
    constants = one.elasticity
    if own.mid3:
        third = model.materials[own.mid3]
        across = (
            units.stress * np.array([[third.G22, third.G12], [third.G12, third.G11]])
            if third.type == "MAT2"
            else material(model, own.mid3, units, weight, path).elasticity[4:, 4:]
        )
        constants[4:, 4:] = 1.2 * own.tst * across
    found = replace(one, constants=tuple(constants.ravel().tolist()))
    return replace(found, name=f"{own.type} {own.pid}", bending=share * own.twelveIt3 if own.mid2 else _LIMP)


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
        raise MeshError(f"{path}: {found.type} {number} is the material of shells, expected MAT1, MAT2 or MAT8")
    stiff = np.diag([0.0, 0.0, plane[1, 1], 0.0, across[1], across[0]])
    stiff[_PLANE[:, None], _PLANE] = plane
    if np.linalg.eigvalsh(stiff)[0] <= 0.0:
        raise MeshError(f"{path}: the constants of {found.type} {number} belong to no material; check them")
    constants = tuple((stiff * units.stress).ravel().tolist())
    return Material(name, *isotropic_average(constants), density, constants)
