"""The face of a demo body's interface: consistent nodal forces, mean displacement and rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from demo.mesh_tools import BrickMesh, traction_weights
from scipy.spatial.transform import Rotation

MOTION_COLUMNS = ("ux_m", "uy_m", "uz_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True, slots=True)
class TipFace:
    """The face of an interface: the end of a cantilever, a section inside a body, a patch of its surface.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
        Node indices, counted from 0, ascending.
    points : ndarray, shape (n, 3)
        Their coordinates, m.
    weights : ndarray, shape (n,)
        Their shares in the resultant of a uniform traction; the sum is 1.
    """

    nodes: np.ndarray
    points: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, mesh: BrickMesh, nodes: np.ndarray) -> TipFace:
        """Take the face from a mesh and the indices of its nodes."""
        nodes = np.sort(nodes)
        return cls(nodes=nodes, points=mesh.points[nodes], weights=traction_weights(mesh, nodes))

    def load_cards(self, force: np.ndarray) -> list[str]:
        """Return the data lines of ``*CLOAD`` for a uniform traction of resultant `force` (3,), N."""
        return [
            f"{node + 1}, {axis + 1}, {share * component:.9e}"
            for axis, component in enumerate(force)
            if component != 0.0
            for node, share in zip(self.nodes, self.weights, strict=True)
        ]

    def motion(self, displacements: np.ndarray) -> np.ndarray:
        """Reduce nodal displacements of the face to its mean displacement and rotation vector.

        Parameters
        ----------
        displacements : ndarray, shape (n_times, n, 3)
            Displacements of the face's nodes in the order of `nodes`, m.

        Returns
        -------
        ndarray, shape (n_times, 6)
            Columns as in `MOTION_COLUMNS`.
        """
        mean = np.einsum("n,tnk->tk", self.weights, displacements)
        arms = self.points - self.points.mean(axis=0)
        deformed = self.points + displacements
        deformed = deformed - deformed.mean(axis=1, keepdims=True)
        vectors = [Rotation.align_vectors(now, arms)[0].as_rotvec() for now in deformed]
        return np.hstack([mean, np.array(vectors)])

    def linear_motion(self, displacements: np.ndarray) -> np.ndarray:
        """Reduce the displacements of a linear analysis; as `motion`, but to the small rotation.

        The rotation θ minimises Σ|u − ū − θ × r|² over the nodes, r from their centroid: it is proportional
        to the load, as the displacements are.
        """
        mean = np.einsum("n,tnk->tk", self.weights, displacements)
        arms = self.points - self.points.mean(axis=0)
        inertia = np.einsum("nk,nk->", arms, arms) * np.eye(3) - arms.T @ arms
        moments = np.cross(arms, displacements).sum(axis=1)
        return np.hstack([mean, np.linalg.solve(inertia, moments.T).T])
