"""All that has strain energy: solids, shells, and the simplices that keep rigid nodes in shape."""

from collections.abc import Iterator

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.links import Simplices
from ..mesh.model import Mesh
from .cells import Cells, cells, turning
from .shells import shell_cells, shell_rule

# m³; of what has energy and shall count in no mean over a volume.
_NO_VOLUME = 1e-30


def elastic_cells(mesh: Mesh, elements: int, strains: int = 0, means: bool = False) -> Iterator[Cells]:
    """Yield all that has strain energy, elements and simplices of rigid links, some at a time.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    elements, strains : int
        How many at a time at most, of strains unless that is less than one element has.
    means : bool
        Whether the fields of shells are in means and differences of both faces (`fe.unknowns`), not displacements.

    Yields
    ------
    Cells
    """
    for block in mesh.blocks:
        natural, places = block.type.natural, block.type.stiffness.weights
        size = max(1, elements, strains // (len(shell_rule(block.type).rows) if natural else 6 * len(places)))
        if natural:
            yield from (some.in_means() if means else some for some in shell_cells(mesh, block, size))
        else:
            yield from (some for _, some in cells(mesh, block, size))
    for one in mesh.simplices:
        count = one.nodes.shape[1]
        volume, value = np.full((len(one.nodes), 1), _NO_VOLUME), np.full((1, count), 1.0 / count)
        nodes, gradient = _in_means(mesh, one) if means else (one.nodes, one.gradient)
        yield Cells(nodes, value, gradient[:, None], volume, _projected(one.span, one.stiffness / _NO_VOLUME))


def _in_means(mesh: Mesh, one: Simplices) -> tuple[IntArray, FloatArray]:
    """Nodes (e, 4 a) and gradients (e, 4 a, 3) of simplices for means and differences, some nodes several times."""
    node, share = mesh.mixed
    count, corners = one.nodes.shape
    gradient = share[one.nodes][..., None] * one.gradient[:, :, None]
    return node[one.nodes].reshape(count, 4 * corners), gradient.reshape(count, 4 * corners, 3)


def _projected(onto: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Matrix (e, 6, 6) of energies ½ k |P E P|², from projectors P (e, 3, 3) and k (e,)."""
    return stiffness[:, None, None] * turning(onto) * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
