"""Forces that flatten a body, told from those that bend its slender members (docs/theory.md, section 4c).

Stress that turns with its material presses upon each section of a bend. What the sections feel as a whole, forces and
moments, bends the body as loads do, which act on the deformed body already. What is left flattens.
"""

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from ..model.rotations import skew
from .cut.loops import SLENDER
from .division import distance_along, equal_labels, linked

# Slices between the supports and what is farthest from them: bending within one of them is none of the body's.
_LEVELS = 32
# Squared length over which distances are evened, over the mean area of a section.
_EVEN = 4.0
# As of a level's boundary: round-off must not decide.
_DIGITS = 9
# Residual at which evened distances are as exact as round-off lets them be, and iterations that are enough for it.
_SETTLED, _ROUNDS = 1e-14, 10_000


def slices(mesh: Mesh, anchored: IntArray) -> list[IntArray]:
    """Slices across the slender members of a body.

    Parameters
    ----------
    mesh : Mesh
    anchored : (k,) int
        Nodes of the supports; none of a free body, which is sliced from the node farthest from its middle.

    Returns
    -------
    list of (k,) int
        Nodes of each, none of them twice. Pieces wider than a section of a slender member, as of plates, are left out.
    """
    if not anchored.size:
        anchored = np.array([np.argmax(np.linalg.norm(mesh.points - mesh.points.mean(axis=0), axis=1))])
    distance = distance_along(mesh, anchored)
    way = float(distance.max())
    link = linked(mesh)
    middle = _across(mesh, link, np.concatenate([distance[b.connectivity].mean(axis=1) for b in mesh.blocks]), way)
    level = np.floor(np.round(_LEVELS * middle / way, _DIGITS)).astype(np.int64)
    piece = connected_components(link.multiply(equal_labels(link, level)), directed=False)[1]
    owner = np.full(len(mesh.points), -1)
    for block, own in zip(mesh.blocks, mesh.split(piece), strict=True):
        owner[block.connectivity] = own[:, None]
    found = [np.flatnonzero(owner == number) for number in np.unique(owner[owner >= 0])]
    return [one for one in found if np.linalg.norm(np.ptp(mesh.points[one], axis=0)) <= SLENDER * way]


def _across(mesh: Mesh, link: sp.csr_array, distance: FloatArray, way: float) -> FloatArray:
    """Distances (e,) made even across each section: the shorter way inside of a bend would have slices lie askew."""
    pairs = link.tocoo()
    centre = np.concatenate([mesh.points[block.connectivity].mean(axis=1) for block in mesh.blocks])
    volume = mesh.volumes
    flow = pairs.data / np.linalg.norm(centre[pairs.row] - centre[pairs.col], axis=1)
    spread = sp.csr_array(sp.coo_array((-flow, (pairs.row, pairs.col)), shape=link.shape))
    spread = spread - sp.diags_array(np.asarray(spread.sum(axis=1)))
    # Differences within a section of the mean area fade to a fortieth, those along the body stay.
    matrix = sp.csr_array(sp.diags_array(volume) + _EVEN * volume.sum() / way * spread)
    # Factors of large meshes would take gigabytes. What the iteration leaves when it ends is round-off.
    scale = sp.diags_array(1.0 / matrix.diagonal())
    return spla.cg(matrix, volume * distance, x0=distance, rtol=_SETTLED, M=scale, maxiter=_ROUNDS)[0]


def without_resultants(points: FloatArray, forces: FloatArray, sliced: list[IntArray]) -> FloatArray:
    """Nodal forces less those, spread as a rigid motion over each slice, that have the same force and moment.

    Parameters
    ----------
    points : (n, 3) float
    forces : (3n, p) float
    sliced : list of (k,) int

    Returns
    -------
    (3n, p) float
    """
    result = forces.reshape(len(points), 3, -1).copy()
    for nodes in sliced:
        arm = points[nodes] - points[nodes].mean(axis=0)
        rigid = np.concatenate([np.broadcast_to(np.eye(3), (nodes.size, 3, 3)), -skew(arm)], axis=2).reshape(-1, 6)
        own = result[nodes].reshape(len(rigid), -1)
        result[nodes] = (own - rigid @ np.linalg.lstsq(rigid, own, rcond=None)[0]).reshape(nodes.size, 3, -1)
    return result.reshape(forces.shape)
