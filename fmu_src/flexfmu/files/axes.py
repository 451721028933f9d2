"""Axes that a TOML file tells by two vectors: the first one, and one in the plane of the first two."""

from collections.abc import Sequence
from math import hypot, inf
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from .array_types import FloatArray
from .toml_files import Vector

# Sine of the angle between two vectors below which they are parallel.
_PARALLEL = 1e-6


def _not_parallel(value: list[list[float]]) -> list[list[float]]:
    (a, b, c), (x, y, z) = value
    normal = hypot(b * z - c * y, c * x - a * z, a * y - b * x)
    if not _PARALLEL * hypot(a, b, c) * hypot(x, y, z) < normal < inf:
        raise ValueError(f"are {value}, expected two vectors that are not parallel")
    return value


Axes = Annotated[list[Vector], Field(min_length=2, max_length=2), AfterValidator(_not_parallel)]
"""Two vectors that are not parallel."""


def orthonormal(vectors: Sequence[Sequence[float]] | FloatArray | None) -> FloatArray:
    """Axes (3, 3), in rows, of two vectors; the global ones without them."""
    first, second = np.asarray(vectors if vectors is not None else np.eye(3)[:2], dtype=np.float64)
    third = np.cross(first, second)
    found = np.array([first, np.cross(third, first), third])
    return found / np.linalg.norm(found, axis=1)[:, None]
