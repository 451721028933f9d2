"""Sections of beams: area, ∫x₁² dA, ∫x₂² dA, torsion constant and shear areas of the usual shapes."""

from collections.abc import Sequence
from functools import cache
from math import pi, tanh
from typing import NamedTuple

import numpy as np

# Shear area over area: of rectangles and circles by G. R. Cowper, J. Appl. Mech. 33 (1966) 335, without ν; of thin
# walls as Abaqus has it.
_SOLID, _ROUND, _TUBE, _WALLS = 5.0 / 6.0, 6.0 / 7.0, 0.53, 0.44


def rectangle(a: float, b: float) -> tuple[float, ...]:
    """Width along the first axis and along the second; torsion by Saint-Venant's series."""
    short, long = sorted((a, b))
    series = sum(tanh(0.5 * n * pi * long / short) / n**5 for n in range(1, 12, 2))
    torsion = long * short**3 * (1.0 / 3.0 - 64.0 / pi**5 * short / long * series)
    return a * b, a**3 * b / 12.0, a * b**3 / 12.0, torsion, _SOLID * a * b, _SOLID * a * b


def ellipse(a: float, b: float) -> tuple[float, ...]:
    """Diameters along both axes; a circle where they are the same."""
    area = 0.25 * pi * a * b
    torsion = pi * a**3 * b**3 / (16.0 * (a**2 + b**2))
    return area, area * a**2 / 16.0, area * b**2 / 16.0, torsion, _ROUND * area, _ROUND * area


def pipe(radius: float, wall: float) -> tuple[float, ...]:
    """Outer radius and thickness of the wall."""
    inner = max(radius - wall, 0.0)
    area, second = pi * (radius**2 - inner**2), 0.25 * pi * (radius**4 - inner**4)
    part = _TUBE if inner > 0.0 else _ROUND
    return area, second, second, 2.0 * second, part * area, part * area


def box(a: float, b: float, side: float, flange: float) -> tuple[float, ...]:
    """Outer widths, and walls across the first axis and across the second; torsion by Bredt."""
    x, y = a - 2.0 * side, b - 2.0 * flange
    area = a * b - x * y
    torsion = 2.0 * ((a - side) * (b - flange)) ** 2 / ((a - side) / flange + (b - flange) / side)
    return area, (a**3 * b - x**3 * y) / 12.0, (a * b**3 - x * y**3) / 12.0, torsion, _WALLS * area, _WALLS * area


class CrossSection(NamedTuple):
    """A section in axes that need not be its principal ones.

    Attributes
    ----------
    constants : tuple of float
        Area, ∫x₁² dA, ∫x₂² dA about the centroid, torsion constant, shear areas along both axes.
    mixed : float
        ∫x₁ x₂ dA about the centroid.
    centroid, shear_centre : (2,) float
    """

    constants: tuple[float, ...]
    mixed: float = 0.0
    centroid: tuple[float, float] = (0.0, 0.0)
    shear_centre: tuple[float, float] = (0.0, 0.0)

    @property
    def transposed(self) -> "CrossSection":
        """The section whose second axis is the first one of this."""
        area, first, second, torsion, one, other = self.constants
        constants = area, second, first, torsion, other, one
        return CrossSection(constants, self.mixed, self.centroid[::-1], self.shear_centre[::-1])

    def scaled(self, length: float) -> "CrossSection":
        """The section whose numbers are in another unit of length."""
        powers = np.array([2, 4, 4, 4, 2, 2])
        places = [(place[0] * length, place[1] * length) for place in (self.centroid, self.shear_centre)]
        constants = tuple((np.array(self.constants) * length**powers).tolist())
        return CrossSection(constants, self.mixed * length**4, *places)


@cache
def principal(section: CrossSection) -> tuple[tuple[float, ...], float]:
    """As of `ElementBlock`, in principal axes, and the angle by which these are turned from the first axis."""
    area, first, second, torsion, *shear = section.constants
    angle = 0.5 * float(np.arctan2(2.0 * section.mixed, first - second)) if section.mixed else 0.0
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    if section.mixed:
        first, second = np.diag(turn @ [[first, section.mixed], [section.mixed, second]] @ turn.T).tolist()
        with np.errstate(divide="ignore"):
            shear = (1.0 / (turn**2 @ (1.0 / np.array(shear)))).tolist()
    away = (turn @ np.subtract(section.shear_centre, section.centroid)).tolist()
    return (area, first, second, torsion, *shear, *away), angle


def walls(parts: Sequence[tuple[float, ...]], shear_centre: tuple[float, float]) -> CrossSection:
    """Open section of rectangles: centre and size along both axes of each; torsion and shear as of thin walls."""
    x, y, a, b = np.array(parts).T
    areas = a * b
    area = float(areas.sum())
    centroid = float(areas @ x / area), float(areas @ y / area)
    x, y = x - centroid[0], y - centroid[1]
    ends = [float(np.max(one + 0.5 * size) - np.min(one - 0.5 * size)) for one, size in ((x, a), (y, b))]
    shear = []
    for along, across, length in ((a, b, ends[0]), (b, a, ends[1])):
        # A single wall reaches through the walls across it.
        own = along > across
        shear.append(_SOLID * float(across[own] @ (along[own] if own.sum() > 1 else np.full(own.sum(), length))))
    torsion = float(np.sum(np.maximum(a, b) * np.minimum(a, b) ** 3)) / 3.0
    first, second = float(areas @ (x**2 + a**2 / 12.0)), float(areas @ (y**2 + b**2 / 12.0))
    return CrossSection((area, first, second, torsion, *shear), float(areas @ (x * y)), centroid, shear_centre)


def i_section(height: float, widths: tuple[float, float], flanges: tuple[float, float], web: float) -> CrossSection:
    """Flanges along the first axis, below and above, and a web, from the middle of the bottom on; a flange may be 0."""
    low, high = flanges
    parts = [(0.0, 0.5 * low, widths[0], low), (0.0, height - 0.5 * high, widths[1], high)]
    parts += [(0.0, 0.5 * (low + height - high), web, height - low - high)]
    stiff = [flange * width**3 for flange, width in zip(flanges, widths, strict=True)]
    middle = (stiff[0] * 0.5 * low + stiff[1] * (height - 0.5 * high)) / (stiff[0] + stiff[1])
    return walls([part for part in parts if part[2] * part[3]], (0.0, middle))


def l_section(width: float, height: float, foot: float, leg: float) -> CrossSection:
    """A foot along the first axis and a leg along the second, from where their middle lines meet on."""
    parts = [(0.5 * (width - leg), 0.0, width, foot), (0.0, 0.5 * height, leg, height - foot)]
    return walls(parts, (0.0, 0.0))


def channel(width: float, height: float, web: float, flange: float) -> CrossSection:
    """A web along the second axis with two flanges along the first, from the middle of the web on."""
    reach, away = width - web, 0.5 * (height - flange)
    parts = [(0.5 * width, side * away, reach, flange) for side in (-1.0, 1.0)]
    long, tall = width - 0.5 * web, height - flange
    centre = -3.0 * long**2 * flange / (tall * web + 6.0 * long * flange)
    return walls([(0.0, 0.0, web, height), *parts], (centre, 0.0))
