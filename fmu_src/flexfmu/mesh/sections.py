"""Sections of beams: area, ∫x₁² dA, ∫x₂² dA, torsion constant and shear areas of the usual shapes."""

from math import pi, tanh

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
