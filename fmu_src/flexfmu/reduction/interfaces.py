"""Interfaces: where loads come in and motion goes out (docs/theory.md, section 2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..fe.faces import area_matrix, select
from ..files.basics import BodyFileError, FloatArray, IntArray
from ..mesh.model import Mesh
from .options import InterfaceNodes
from .places import node_set, reference
from .rigid_fit import Weighted, by_node, rigid_fit
from .subdomains import Subdomain, carrying_frame, elements_within

# Weight of the nodes that are added to a line or a point, beside theirs.
_AROUND = 1e-3


@dataclass(frozen=True, slots=True)
class InterfaceFit:
    """An interface fitted to its node set.

    Attributes
    ----------
    name : str
    point : (3,) float
        Reference point, m.
    nodes : (k,) int
        Of the set; where these lie on a line or in one point, those of their elements too.
    added : (j,) int
        Those of them that are not of the set.
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
    added: IntArray
    operator: FloatArray
    by_area: bool
    frame: int

    def motion(self, shapes: FloatArray) -> FloatArray:
        """Displacement and rotation (6, m) per unit modal coordinate, from mode shapes (3n, m)."""
        return self.operator @ shapes.reshape(-1, 3, shapes.shape[1])[self.nodes].reshape(-1, shapes.shape[1])

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
        # A line or a point tells no rotation about itself and takes no moment: its elements do, and hardly a force.
        around = _of_elements(mesh, nodes)
        weighted = by_node(around, np.where(np.isin(around, nodes), 1.0, _AROUND))
        operator, rank = rigid_fit(mesh.points, weighted, point)
    if rank < 6:
        raise BodyFileError(
            f"{key}: the {nodes.size} nodes of {table.nodes!r} and those of their elements lie on a line or in one "
            "point, which tells no rotation and takes no moment; give the interface at least three nodes off a line"
        )
    added, by_area = np.setdiff1d(weighted.nodes, nodes), weighted.weight.nnz > weighted.nodes.size
    return InterfaceFit(table.name, point, weighted.nodes, added, operator, by_area, carrying_frame(subdomains, nodes))


def _of_elements(mesh: Mesh, nodes: IntArray) -> IntArray:
    """These nodes and all others of the elements that hold one of them."""
    touched = [b.connectivity[np.isin(b.connectivity, nodes).any(axis=1)].ravel() for b in mesh.blocks]
    return np.unique(np.concatenate([nodes, *touched]))


def _weighted(table: InterfaceNodes, mesh: Mesh, nodes: IntArray) -> Weighted:
    if table.weights == "node":
        return by_node(nodes)
    # A section inside the body is an area too; a set that holds whole elements is a piece of it.
    for outer in (True, False) if not elements_within(mesh, nodes).size else (True,):
        faces = select(mesh.faces, nodes, outer=outer)
        covered = np.unique(np.concatenate([nodes[:0], *(block.ravel() for block in faces)]))
        # An edge of shells across a joint holds the knot's other lines, too: of no face here, and rigid with it.
        knots = [link.nodes for link in mesh.links if np.isin(link.nodes, covered).any()]
        kept = covered if np.isin(nodes, np.concatenate([covered, *knots])).all() else nodes
        if (matrix := area_matrix(mesh.points, faces, kept)) is not None:
            return Weighted(kept, matrix)
    if table.weights == "area":
        raise BodyFileError(
            f'interface {table.name!r}: weights = "area" needs a set that consists of whole element faces, '
            f"on the surface or across the body, and {table.nodes!r} does not; add the missing nodes or take "
            'weights = "node"'
        )
    return by_node(nodes)
