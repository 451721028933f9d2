"""Inertia integrals of the frames: what the mass of the deformed body is made of (docs/theory.md, section 9)."""

from collections.abc import Sequence

import numpy as np

from ..mesh.model import FloatArray, Mesh
from ..model.inertia import InertiaIntegrals
from ..model.reduced_body import GROUND
from .subdomains import FrameOperators, Subdomain, element_owner, volume_weighted


def inertia_integrals(
    mesh: Mesh,
    volumes: tuple[FloatArray, ...],
    shapes: FloatArray,
    subdomains: Sequence[Subdomain],
    frames: FrameOperators,
) -> InertiaIntegrals:
    """Moments of the mass of each frame's elements with the consistent mass matrix; an element has one frame.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    volumes : tuple of (n_elements, node_count, node_count) float
        From `fe.assembly.volume_matrices`.
    shapes : (3n, m) float
    subdomains : sequence of Subdomain
    frames : FrameOperators
        Of the same shapes.

    Returns
    -------
    InertiaIntegrals
    """
    owner = element_owner(mesh, subdomains)
    density = np.array([material.density for material in mesh.materials])
    masses = tuple(
        density[block.material][:, None, None] * matrices for block, matrices in zip(mesh.blocks, volumes, strict=True)
    )
    modes = shapes.shape[1]
    nodal = shapes.reshape(len(mesh.points), 3, modes)
    ground = np.zeros((modes, modes))
    frame, mass, first, second = [], [], [], []
    for s in np.unique(owner):
        part = volume_weighted(mesh, masses, np.flatnonzero(owner == s))
        moved = nodal[part.nodes]
        if s == GROUND:
            flat = moved.reshape(len(moved), -1)
            ground = np.einsum("nia,nib->ab", moved, (part.weight @ flat).reshape(moved.shape), optimize=True)
            continue
        arm = mesh.points[part.nodes] - subdomains[s].joint_point
        turned = np.cross(frames.frame_rotation[s][None], arm[:, :, None], axis=1)
        fields = np.concatenate([arm[:, :, None], moved - frames.joint_displacement[s] - turned], axis=2)
        # Index of y first, its component last.
        columns = fields.swapaxes(1, 2).reshape(len(arm), -1)
        weighted = part.weight @ columns
        frame.append(s)
        mass.append(part.weight.sum())
        first.append(weighted.sum(axis=0).reshape(1 + modes, 3))
        second.append((columns.T @ weighted).reshape(1 + modes, 3, 1 + modes, 3).swapaxes(1, 2))
    return InertiaIntegrals(
        np.array(frame, dtype=np.int64),
        np.array(mass),
        np.array(first).reshape(-1, 1 + modes, 3),
        np.array(second).reshape(-1, 1 + modes, 1 + modes, 3, 3),
        ground,
    )
