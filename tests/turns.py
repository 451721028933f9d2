"""Rotation matrices of rotation vectors and back, on stacks of any leading shape, by SciPy."""

from scipy.spatial.transform import Rotation


def exponential(vector):
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*vector.shape, 3)


def rotation_vector(rotation):
    """Rotation vectors (..., 3), no longer than π, of rotation matrices (..., 3, 3)."""
    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec().reshape(rotation.shape[:-1])
