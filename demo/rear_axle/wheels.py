"""The axle's wheels as interfaces: how forces enter the flanges, and how their motion is read off nodal results.

Both are the interface's own (docs/theory.md, section 2): a rigid fit weighted by area, whose transpose spreads forces.
For the finite rotation, which CalculiX's results ask for, the same weight enters a polar decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from flexfmu.fe.assembly import area_matrix, select
from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.formats import read_mesh
from flexfmu.reduction.bodies import InterfaceFit, fit_interface
from flexfmu.reduction.options import InterfaceNodes

FloatArray = NDArray[np.float64]

# Node set of each wheel's flange.
FLANGES = {"wheel_left": "FLANGE_L", "wheel_right": "FLANGE_R"}


@dataclass(frozen=True, slots=True)
class Wheel:
    """A wheel's flange.

    Attributes
    ----------
    interface : InterfaceFit
        The fit: point, nodes and operator.
    points : ndarray, shape (k, 3)
        Coordinates of its nodes, m.
    weight : sparse, shape (k, k)
        Weight of the fit, ∫ N_a N_b dA.
    numbers : ndarray of int, shape (k,)
        Its nodes in the deck.
    """

    interface: InterfaceFit
    points: FloatArray
    weight: csr_array
    numbers: np.ndarray

    def nodal_forces(self, force: FloatArray) -> FloatArray:
        """Forces on the nodes, shape (k, 3), of a force (3,) at the wheel's centre, N."""
        operator = self.interface.operator
        spread: FloatArray = (operator[:3].T @ force).reshape(-1, 3)
        return spread

    def linear_motion(self, displacements: FloatArray) -> FloatArray:
        """Displacement and small rotation, shape (n, 6), from nodal displacements (n, k, 3)."""
        motion: FloatArray = displacements.reshape(len(displacements), -1) @ self.interface.operator.T
        return motion

    def motion(self, displacements: FloatArray) -> FloatArray:
        """Displacement and rotation vector, shape (n, 6), from nodal displacements (n, k, 3).

        The rotation R minimises ∫ |x − x̄ − R (X − X̄)|² dA over the flange's face.
        """
        arms = self.points - self.interface.point
        result = np.empty((len(displacements), 6))
        for row, moved in zip(result, displacements, strict=True):
            row[:3] = self.linear_motion(moved[None])[0, :3]
            u, _, v = np.linalg.svd((arms + moved - row[:3]).T @ (self.weight @ arms))
            u[:, 2] *= np.linalg.det(u) * np.linalg.det(v)
            row[3:] = Rotation.from_matrix(u @ v).as_rotvec()
        return result


def wheels(deck: Path) -> dict[str, Wheel]:
    """Fit the wheels to the flanges of a model deck."""
    mesh = read_mesh(deck, UnitSystem.SI)
    result = {}
    for name, nodes in FLANGES.items():
        interface = fit_interface(InterfaceNodes(name, nodes, weights="area"), mesh, ())
        weight = area_matrix(mesh.points, select(mesh.faces, interface.nodes, outer=True), interface.nodes)
        result[name] = Wheel(interface, mesh.points[interface.nodes], weight, mesh.labels[interface.nodes])
    return result
