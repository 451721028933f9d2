"""What a body is made of and how large it is, in words by which a user sees wrong units at once."""

import numpy as np

from ..files.array_types import FloatArray
from .reduced_body import Properties

NORMAL_MODES = "normal_modes"
"""Where a body's origin tells the numbers of its normal modes, if the body file chose them."""


def summary(properties: Properties) -> list[tuple[str, str]]:
    """Mass, volume, bounding box and materials.

    Parameters
    ----------
    properties : Properties

    Returns
    -------
    list of (label, value)
    """
    low, high = properties.box
    volume = float(properties.volume.sum())
    lines = [
        ("mass", f"{properties.mass:.4g} kg"),
        *_points(properties),
        *_springs(properties),
        ("volume", f"{volume:.4g} m³"),
        ("size", f"{' × '.join(f'{side:.4g}' for side in high - low)} m, from {point(low)} to {point(high)}"),
    ]
    constants = properties.youngs_modulus, properties.poissons_ratio, properties.density, properties.volume / volume
    for name, modulus, poisson, density, share in zip(properties.material_names, *constants, strict=True):
        part = "" if share == 1.0 else f", {100.0 * share:.3g} % of the volume"
        lines.append((f"material {name}", f"E {modulus:.4g} N/m², ν {poisson:.4g}, ρ {density:.4g} kg/m³{part}"))
    return lines


def _points(properties: Properties) -> list[tuple[str, str]]:
    """What masses at points have of the mass."""
    if properties.point_mass is None:
        return []
    return [("masses at points", f"{properties.point_mass.sum():.4g} kg, {properties.point_mass.size} of them")]


def _springs(properties: Properties) -> list[tuple[str, str]]:
    """What springs to the ground there are."""
    if properties.spring is None:
        return []
    return [("springs to the ground", f"{', '.join(f'{k:.4g}' for k in properties.spring)} N/m along x, y, z")]


def first_frequency(angular_frequency: FloatArray) -> str:
    """First elastic frequency of ascending angular frequencies (m,), rad/s, in words."""
    return f"{float(angular_frequency[angular_frequency > 0.0][0]) / (2.0 * np.pi):.4g} Hz"


def point(place: FloatArray) -> str:
    """A point (3,), m, in words."""
    # Nanometres are round-off of coordinates, not information.
    return "(" + ", ".join(f"{round(float(x), 9) + 0.0:.5g}" for x in place) + ")"
