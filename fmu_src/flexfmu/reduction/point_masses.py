"""Masses at points: what they add to the mass of the elements (docs/theory.md, section 1).

A mass hangs on its nodes as an interface does, by their rigid fit A: its motion is A u, and it adds Aᵀ diag(m, J) A.
On a single node A is that node's displacement, and there is nothing that its rotary inertia turns with.
"""

import numpy as np
import scipy.sparse as sp

from ..fe.assembly import assembled, mass
from ..files.basics import FloatArray, ModelError
from ..mesh.model import Mesh, PointMass
from .rigid_fit import by_node, rigid_fit

# Nodes that a mass may hang on: each couples with all others.
_NODES = 1500


def attachment(points: FloatArray, one: PointMass) -> FloatArray:
    """Operator A (6, 3k) from displacements of a mass's nodes to its displacement and rotation.

    Parameters
    ----------
    points : (n, 3) float
    one : PointMass

    Returns
    -------
    (6, 3k) float

    Raises
    ------
    ModelError
        It hangs on more nodes than its matrix can be held of.
    """
    if one.nodes.size > _NODES:
        raise ModelError(f"mass {one.name!r} hangs on {one.nodes.size} nodes, at most {_NODES}: couple it to fewer")
    return rigid_fit(points, by_node(one.nodes), one.point)[0]


def point_mass_matrix(mesh: Mesh) -> sp.csr_array:
    """What all masses at points add to the mass matrix (3n, 3n), kg."""
    size = 3 * len(mesh.points)
    total = sp.csr_array((size, size))
    for one in mesh.masses:
        operator = attachment(mesh.points, one)
        own = np.zeros((6, 6))
        own[:3, :3], own[3:, 3:] = one.mass * np.eye(3), one.inertia
        total = total + assembled(one.nodes[None], operator.T @ own @ operator, size)
    return total


def model_mass(mesh: Mesh) -> sp.csr_array:
    """Mass matrix of elements and of masses at points.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    (3n, 3n) sparse
        kg.
    """
    elements = mass(mesh)
    return sp.csr_array(elements + point_mass_matrix(mesh)) if mesh.masses else elements
