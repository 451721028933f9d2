"""Shapes in which a body buckles, locally too, under the stress of its softest motions (docs/theory.md, section 7a)."""

from itertools import zip_longest

import numpy as np
import scipy.sparse.linalg as spla

from ..fe.stressed import stress_stiffness
from ..files.array_types import FloatArray
from .basis import Matrices
from .third_order import softest_motions

# Motions, of which stiffer ones bear far more stress than they will; shapes in all, and of each motion; the part of a
# motion with a turn of 0.5 rad (rms) beyond which none counts.
_MOTIONS, _MOST, _EACH, _REACH = 3, 8, 6, 1.0
# Of the iteration, whose shapes need not be exact: Krylov vectors, relative error.
_VECTORS, _TOLERANCE, _SEED = 20, 1e-2, 20261122


def buckling_loads(matrices: Matrices, loads: FloatArray) -> FloatArray:
    """Nodal forces (3n, k) whose static responses are shapes of buckling, K x = −λ K_σ x, of the smallest |λ|.

    K_σ is the geometric stiffness of one of the softest motions.

    Parameters
    ----------
    matrices : Matrices
    loads : (3n, l) float
        Nodal forces of the interfaces' unit loads.

    Returns
    -------
    (3n, k) float
    """
    model = matrices.supported
    # Loads on a support do nothing.
    if model.free.size <= 2 * _VECTORS or not np.any(model.forces(loads)):
        return np.zeros((len(loads), 0))
    motions = softest_motions(matrices, loads)[0][:, :_MOTIONS]
    with matrices.report.counted("Find shapes of buckling", motions.shape[1], "motions") as tell:
        found = []
        for number, motion in enumerate(motions.T):
            found.append(_shapes(matrices, motion))
            tell(number)
    # The lowest of each motion first.
    ranked = [shape for level in zip_longest(*found) for shape in level if shape is not None][:_MOST]
    shapes = np.array(ranked).reshape(-1, model.free.size).T
    return model.applied(model.whole(shapes))


def _shapes(matrices: Matrices, motion: FloatArray) -> FloatArray:
    """Shapes (k, f) in which the stress of a motion (3n,), or its opposite, buckles the body, the first ones first."""
    model = matrices.supported
    size = model.free.size
    stress = model.unknowns.matrix(model.unknowns.in_means(stress_stiffness(matrices.model.mesh, motion)))
    solve = spla.LinearOperator((size, size), matvec=lambda force: model.static(force.reshape(-1, 1))[:, 0])
    start = model.static(np.random.default_rng(_SEED).standard_normal((size, 1)))[:, 0]
    try:
        inverse, shapes = spla.eigsh(
            stress, _EACH, model.stiffness, which="BE", v0=start, Minv=solve, ncv=_VECTORS, tol=_TOLERANCE
        )
    except spla.ArpackNoConvergence as error:
        inverse, shapes = error.eigenvalues, error.eigenvectors
    order = np.argsort(-np.abs(inverse))
    return shapes[:, order[np.abs(inverse[order]) > 1.0 / _REACH]].T
