"""Nastran's masses at points: CONM2 on solids, or on the reference points of RBE2 and RBE3."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexfmu.files.array_types import FloatArray
from flexfmu.files.errors import MeshError
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.model import PointMass, masses_note
from flexfmu.mesh.nastran.constraints import spider_ends


def unit_of_mass(model: Any) -> float:
    """What densities and masses of a file are multiplied with: PARAM,WTMASS."""
    return float(model.params["WTMASS"].values[0]) if "WTMASS" in model.params else 1.0


def point_masses(
    model: Any,
    points: FloatArray,
    row: Mapping[int, int],
    used: set[int],
    path: Path,
    units: UnitSystem,
    notes: list[str],
) -> tuple[PointMass, ...]:
    """Return the masses of CONM2.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    points : (n, 3) float
        In the file's units.
    row : mapping of int to int
        Rows of `points` by grid point.
    used : set of int
        Grid points of elements.
    path : Path
    units : UnitSystem
    notes : list of str
        Gets what is left out.

    Returns
    -------
    tuple of PointMass

    Raises
    ------
    MeshError
        A mass in another coordinate system, or on a grid point that nothing carries.
    """
    weight = unit_of_mass(model) * units.density * units.length**3
    carried = {reference: nodes for nodes, reference in spider_ends(model).values()}
    found = []
    for number, one in sorted(model.masses.items()):
        if one.type != "CONM2":
            continue
        nodes = [one.nid] if one.nid in used else carried.get(one.nid, [])
        if one.cid != 0 or not nodes or one.nid not in row or any(node not in row for node in nodes):
            raise MeshError(
                f"{path}: CONM2 {number} at GRID {one.nid}: supported are masses in the basic system, on grid points "
                "of solids and on reference points of RBE2 and RBE3"
            )
        offset = np.asarray(one.X, dtype=float)
        i11, i21, i22, i31, i32, i33 = (float(value) for value in one.I)
        inertia = np.array([[i11, -i21, -i31], [-i21, i22, -i32], [-i31, -i32, i33]])
        if len(nodes) == 1 and (offset.any() or inertia.any()):
            notes.append(f"CONM2 {number}: GRID {one.nid} of a solid does not turn: its offset and inertia do nothing")
            offset, inertia = np.zeros(3), np.zeros((3, 3))
        rows = np.array(sorted({row[node] for node in nodes}), dtype=np.int64)
        at = (points[row[one.nid]] + offset) * units.length
        found.append(
            PointMass(f"CONM2 {number}", at, rows, float(one.mass) * weight, inertia * weight * units.length**2)
        )
    notes.extend(masses_note(found, "points"))
    return tuple(found)
