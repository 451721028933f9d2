"""What a body is made of and how large it is, in words by which a user sees wrong units at once."""

import numpy as np

from ..files.basics import FloatArray
from .reduced_body import Properties, ReducedBody

NORMAL_MODES = "normal_modes"
"""Where a body's origin tells the numbers of its normal modes, if the body file chose them."""

# What a basis may miss of a load's displacement in silence.
_MISSES = 0.01


def missed_loads(body: ReducedBody) -> dict[str, float]:
    """Loads of whose own linear displacement the basis misses more than 1 %, as its shadow tells (theory, (2d)).

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    dict of str to float
        Shares by the names of loads, the largest first.
    """
    if body.shadow is None:
        return {}
    own, finer = _compliance(body), _compliance(body.shadow.body)
    share = np.where(finer > 0.0, 1.0 - own / np.where(finer > 0.0, finer, 1.0), 0.0)
    kinds = [f"{kind}.{axis}" for kind in ("force", "moment") for axis in "xyz"]
    found = [
        (float(share[i, k]), f"{name}.{kind}")
        for i, name in enumerate(body.interface_names)
        for k, kind in enumerate(kinds)
        if share[i, k] > _MISSES
    ]
    return {name: missed for missed, name in sorted(found, reverse=True)}


def _compliance(body: ReducedBody) -> FloatArray:
    """Elastic displacement and rotation (I, 6) of interfaces along unit loads of their own, m/N and 1/(N m)."""
    motion = np.concatenate([body.interface_displacement, body.interface_rotation], axis=1)[:, :, body.rigid_count :]
    return ((motion / body.angular_frequency[body.rigid_count :]) ** 2).sum(axis=2)


def missed_words(body: ReducedBody) -> str:
    """The same in a sentence; empty where no load misses so much."""
    found = missed_loads(body)
    if not found:
        return ""
    worst = next(iter(found))
    return (
        f"the basis misses {100.0 * found[worst]:.2g} % of the linear displacement under {worst} (limit "
        f"{100.0 * _MISSES:g} %; {len(found)} loads are above it): leave [reduction] out, or take "
        "residual_flexibility = true"
    )


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
    lines = [("mass", f"{properties.mass:.4g} kg")]
    if properties.point_mass is not None:
        hung = properties.point_mass
        lines.append(("masses at points", f"{hung.sum():.4g} kg, {hung.size} of them"))
    if properties.spring is not None:
        along = ", ".join(f"{k:.4g}" for k in properties.spring)
        lines.append(("springs to the ground", f"{along} N/m along x, y, z"))
    lines += [
        ("volume", f"{volume:.4g} m³"),
        ("size", f"{' × '.join(f'{side:.4g}' for side in high - low)} m, from {point(low)} to {point(high)}"),
    ]
    constants = properties.youngs_modulus, properties.poissons_ratio, properties.density, properties.volume / volume
    for name, modulus, poisson, density, share in zip(properties.material_names, *constants, strict=True):
        part = "" if share == 1.0 else f", {100.0 * share:.3g} % of the volume"
        lines.append((f"material {name}", f"E {modulus:.4g} N/m², ν {poisson:.4g}, ρ {density:.4g} kg/m³{part}"))
    return lines


def first_frequency(angular_frequency: FloatArray) -> str:
    """First elastic frequency of ascending angular frequencies (m,), rad/s, in words."""
    return f"{float(angular_frequency[angular_frequency > 0.0][0]) / (2.0 * np.pi):.4g} Hz"


def point(place: FloatArray) -> str:
    """A point (3,), m, in words."""
    # Nanometres are round-off of coordinates, not information.
    return "(" + ", ".join(f"{round(float(x), 9) + 0.0:.5g}" for x in place) + ")"
