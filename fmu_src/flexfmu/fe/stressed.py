"""What stress does to the gradients of displacements, docs/theory.md sections 1, 4c and 7a."""

import numpy as np
import scipy.sparse as sp

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from .assembly import CHUNK, scatter, summed
from .elastic import elastic_cells

# Numbers of a stress field that are held at a time: as of the quadratic strain.
_NUMBERS = 400_000


def stressed_gradients(mesh: Mesh, fields: FloatArray, responses: FloatArray, pairs: IntArray) -> FloatArray:
    """Forces ∫ S_JK u_i,K N,_J dV of a motion u = Σ c_a u_a, by products of its amplitudes c.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    fields : (3n, m) float
        u_a, m.
    responses : (3n, p) float
        w_ab of each pair, the response to its strain of second order, m.
    pairs : (p, 2) int
        a ≤ b: each pair once.

    Returns
    -------
    (3n, m, m + p) float
        By a: first with S the linear stress of u_b, then with S = C (½ GᵀG + sym ∇w) of the pairs, that of two
        different motions twice; N.
    """
    count, m = len(mesh.points), fields.shape[1]
    u, w = fields.reshape(count, 3, -1), responses.reshape(count, 3, -1)
    result = np.zeros((count, 3, m, m + len(pairs)))
    for some in elastic_cells(mesh, 0, _NUMBERS // (m + len(pairs))):
        slopes = some.slopes(u)
        strain = some.products(slopes, pairs)
        # What responses and the elements' own shape functions leave; each of two different motions comes first once.
        strain += some.strains(w) + some.relaxation(some.work(strain))
        strain *= np.where(pairs[:, 0] == pairs[:, 1], 1.0, 2.0)
        work = some.work(np.concatenate([some.strains(u), strain], axis=2))
        for a in range(m):
            np.add.at(result[:, :, a], some.nodes, some.relaxed(some.nodal(work, slopes[..., a]))[0])
    return result.reshape(3 * count, m, -1)


def stress_stiffness(mesh: Mesh, field: FloatArray) -> sp.csr_array:
    """Geometric stiffness (3n, 3n), N/m, of the linear stress of a displacement (3n,), m; own shape functions rest."""
    count, u = len(mesh.points), field.reshape(len(mesh.points), 3, 1)
    parts = []
    for some in elastic_cells(mesh, CHUNK):
        inner = some.nodes.shape[1]
        matrices = some.geometric(some.work(some.strains(u))[..., 0])[:, :inner, :inner]
        parts.append(scatter(some.nodes, matrices, count))
    return sp.csr_array(sp.kron(summed(parts), sp.eye_array(3)))
