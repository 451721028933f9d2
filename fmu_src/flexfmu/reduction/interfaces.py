"""Interfaces: where loads come in and motion goes out (docs/theory.md, section 2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fe.faces import area_matrix, select
from ..files.array_types import FloatArray, IntArray
from ..files.errors import BodyFileError
from ..mesh.model import Mesh
from .options import InterfaceNodes
from .places import node_set, reference
from .rigid_fit import Weighted, by_node, rigid_fit
from .subdomains import Subdomain, carrying_frame, elements_within


@dataclass(frozen=True, slots=True)
class InterfaceFit:
    """An interface fitted to its node set.

    Attributes
    ----------
    name : str
    point : (3,) float
        Reference point, m.
    nodes : (k,) int
    operator : (6, 3k) float
        From displacements of the nodes to displacement and rotation; its transpose spreads loads.
    by_area : bool
        Whether loads are spread over the area of the set's faces.
    frame : int
        The sub-domain that carries it, or `GROUND`.
    """

    name: str
    point: FloatArray
    nodes: IntArray
    operator: FloatArray
    by_area: bool
    frame: int

    def motion(self, shapes: FloatArray) -> FloatArray:
        """Displacement and rotation (6, m) per unit modal coordinate, from mode shapes (3n, m)."""
        local = shapes.reshape(-1, 3, shapes.shape[1])[self.nodes].reshape(self.operator.shape[1], -1)
        return self.operator @ local

    def nodal_loads(self, node_count: int) -> FloatArray:
        """Nodal forces (3n, 6) of unit forces and moments at the reference point."""
        result = np.zeros((node_count, 3, 6))
        result[self.nodes] = self.operator.T.reshape(-1, 3, 6)
        return result.reshape(-1, 6)


def fit_interface(table: InterfaceNodes, mesh: Mesh, subdomains: Sequence[Subdomain]) -> InterfaceFit:
    """Fit an interface of the body file.

    Parameters
    ----------
    table : InterfaceNodes
    mesh : Mesh
    subdomains : sequence of Subdomain

    Returns
    -------
    InterfaceFit

    Raises
    ------
    BodyFileError
        A set that is missing or empty, that tells no rotation, or that is no area where one is asked for.
    """
    key = f"interface {table.name!r}"
    nodes = node_set(mesh, table.nodes, f"{key}, nodes")
    weighted = _weighted(table, mesh, nodes)
    point = reference(mesh, table.nodes) if table.point is None else np.array(table.point)
    if point is None:
        point = weighted.centre(mesh.points)
    operator, rank = rigid_fit(mesh.points, weighted, point)
    if rank < 6:
        raise BodyFileError(
            f"{key}: the {nodes.size} nodes of {table.nodes!r} lie on a line or in one point, which tells no rotation "
            "and takes no moment; give the interface at least three nodes off a line"
        )
    by_area = weighted.weight.nnz > nodes.size
    return InterfaceFit(table.name, point, nodes, operator, by_area, carrying_frame(subdomains, nodes))


def _weighted(table: InterfaceNodes, mesh: Mesh, nodes: IntArray) -> Weighted:
    if table.weights == "node":
        return by_node(nodes)
    # A section inside the body is an area too; a set that holds whole elements is a piece of it.
    for outer in (True, False) if not elements_within(mesh, nodes).size else (True,):
        matrix = area_matrix(mesh.points, select(mesh.faces, nodes, outer=outer), nodes)
        if matrix is not None:
            return Weighted(nodes, matrix)
    if table.weights == "area":
        raise BodyFileError(
            f'interface {table.name!r}: weights = "area" needs a set that consists of whole element faces, '
            f"on the surface or across the body, and {table.nodes!r} does not; add the missing nodes or take "
            'weights = "node"'
        )
    return by_node(nodes)
