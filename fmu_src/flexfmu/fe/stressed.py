"""What stress does to the gradients of displacements, docs/theory.md sections 1, 4c and 7a."""

import numpy as np
import scipy.sparse as sp

from ..files.array_types import FloatArray, IntArray
from ..mesh.model import Mesh
from .assembly import CHUNK, summed
from .cells import Cells
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
    for some in elastic_cells(mesh, 0, _NUMBERS // (9 * (m + len(pairs)))):
        gradient = some.displacement_gradient(u)
        stress = _stresses(some, gradient, some.displacement_gradient(w), pairs)
        for a in range(m):
            pulled = np.einsum("eqiK,eqJKs->eqiJs", gradient[..., a], stress, optimize=True)
            np.add.at(result[:, :, a], some.nodes, some.relaxed(pulled)[0])
    return result.reshape(3 * count, m, -1)


def _stresses(some: Cells, gradient: FloatArray, response: FloatArray, pairs: IntArray) -> FloatArray:
    """Stress (e, q, 3, 3, m + p) of the motions, and that which is left of the pairs' strain of second order."""
    a, b = pairs.T
    half = np.einsum("eqiJp,eqiKp->eqJKp", gradient[..., a], gradient[..., b], optimize=True)
    strain = 0.25 * (half + half.swapaxes(2, 3))
    if some.gradient.shape[2] > some.nodes.shape[1]:
        response = response + some.relaxation(some.stress(strain))
    strain += 0.5 * (response + response.swapaxes(2, 3))
    # Each of two different motions comes first once.
    left = strain * np.where(a == b, 1.0, 2.0)
    return some.stress(np.concatenate([0.5 * (gradient + gradient.swapaxes(2, 3)), left], axis=4))


def stress_stiffness(mesh: Mesh, field: FloatArray) -> sp.csr_array:
    """Geometric stiffness (3n, 3n), N/m, of the linear stress of a displacement (3n,), m; own shape functions rest."""
    count, u = len(mesh.points), field.reshape(len(mesh.points), 3, 1)
    parts = []
    for some in elastic_cells(mesh, CHUNK):
        strain = some.displacement_gradient(u)[..., 0]
        stress = some.stress(0.5 * (strain + strain.swapaxes(2, 3))) * some.volume[:, :, None, None]
        gradient = some.gradient[:, :, : some.nodes.shape[1]]
        matrices = np.einsum("eqaJ,eqJK,eqbK->eab", gradient, stress, gradient, optimize=True)
        rows, columns = np.broadcast_arrays(some.nodes[:, :, None], some.nodes[:, None])
        whole = sp.coo_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count))
        parts.append(sp.csr_array(whole))
    return sp.csr_array(sp.kron(summed(parts), sp.eye_array(3)))
