"""A bar whose modes another program found."""

import numpy as np
import scipy.sparse as sp

from flexfmu.fe.assembly import mass as mass_matrix
from flexfmu.mesh.elements import ElementType
from meshes import box, with_sets

LENGTH, SIDE, MODES = 1.0, 0.05, 8


def bar():
    """A steel bar of 20-node bricks along x with sets at its ends."""
    mesh = box(ElementType.C3D20R, (10, 2, 2), (LENGTH, SIDE, SIDE))
    return with_sets(mesh, ROOT=lambda p: p[:, 0], TIP=lambda p: p[:, 0] - LENGTH)


def eigenmodes(mesh, held):
    """Modes (m, n, 3), frequencies and consistent mass, as another program would find them; held nodes or none."""
    from scipy.sparse.linalg import eigsh

    from flexfmu.fe.assembly import stiffness

    k, m = sp.csc_array(stiffness(mesh)), sp.csc_array(mass_matrix(mesh))
    count = len(mesh.points)
    if m.shape[0] == count:
        m = sp.csc_array(sp.kron(m, sp.eye_array(3)))
    free = np.setdiff1d(np.arange(3 * count), (3 * held[:, None] + np.arange(3)).ravel())
    kf, mf = k[free][:, free], m[free][:, free]
    number = MODES if held.size else MODES + 6
    values, vectors = eigsh(kf, number, mf, sigma=-1.0 if not held.size else 0.0)
    shapes = np.zeros((3 * count, number))
    shapes[free] = vectors
    return shapes.T.reshape(number, count, 3), np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi), m


LOAD = {"tip": [0.0, 40.0e3, 15.0e3, 0.0, 0.0, 200.0]}


def motion(body):
    """Displacement and rotation of the tip in equilibrium."""
    response = body.response(body.static(LOAD))
    return np.concatenate([response.displacement[0], response.rotation[0]])
