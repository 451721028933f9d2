"""The body's outer faces with their mode shapes, for viewing only."""

from collections.abc import Sequence

import numpy as np

from ..fe.faces import FaceBlock
from ..mesh.model import FloatArray, Mesh
from ..model.reduced_body import GROUND, Surface
from .subdomains import Subdomain


def body_surface(
    mesh: Mesh, shapes: FloatArray, faces: tuple[FaceBlock, ...], subdomains: Sequence[Subdomain]
) -> Surface:
    """Corner nodes of the outer faces.

    Parameters
    ----------
    mesh : Mesh
    shapes : (3n, m) float
    faces : tuple of FaceBlock
    subdomains : sequence of Subdomain

    Returns
    -------
    Surface
    """
    corners = []
    for block in faces:
        outer = block.nodes[block.outer, : block.corner_count]
        corners.append(outer if block.corner_count == 4 else outer[:, [0, 1, 2, 2]])
    nodes, index = np.unique(np.concatenate(corners), return_inverse=True)
    frame = np.full(len(mesh.points), GROUND)
    # Last to first: a floating frame, the first, would take everything.
    own = [s for s, domain in enumerate(subdomains) if not domain.floating]
    if len(own) < len(subdomains):
        frame[:] = 0
    for s in reversed(own):
        frame[subdomains[s].body.nodes] = s
    return Surface(
        mesh.points[nodes], index.reshape(-1, 4), shapes.reshape(len(mesh.points), 3, -1)[nodes], frame[nodes]
    )
