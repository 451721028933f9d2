"""A wishbone's CAD: writes wishbone.step, in mm (needs gmsh, for its OpenCASCADE kernel).

x points forward, y from the wheel to the car, z upward. The eye of the ball joint stands upright, those of the bushings
lie along x, the axis that the wheel travels about.
"""

from pathlib import Path

import gmsh

# Eye: centre, direction of its axis, bore's radius, outer radius, length.
EYES = {
    "ball": ((0, 0, 0), (0, 0, 1), 11, 19, 24),
    "front": ((160, 250, 0), (1, 0, 0), 15, 22, 42),
    "rear": ((-150, 270, 0), (1, 0, 0), 15, 22, 42),
}
THICK = 16.0
# Outline of the arms, outer side then window; the curves are splines through these points.
OUTER = (
    [(18, -6), (70, 90), (130, 195), (176, 235)],
    [(144, 265), (80, 190), (0, 160), (-75, 205), (-134, 285)],
    [(-166, 255), (-125, 200), (-65, 95), (-18, -6)],
)
WINDOW = [(0, 48), (36, 104), (0, 120), (-34, 108)]


def eye(name: str, hole: bool) -> tuple[int, int]:
    """Cylinder of an eye, or of its bore."""
    centre, axis, bore, outer, length = EYES[name]
    length *= 1.15 if hole else 1
    begin = [c - 0.5 * length * a for c, a in zip(centre, axis, strict=True)]
    return 3, gmsh.model.occ.addCylinder(*begin, *(length * a for a in axis), bore if hole else outer)


def arms() -> list[tuple[int, int]]:
    """The plate that joins the eyes, with its window."""
    solid = gmsh.model.occ
    ends = [[solid.addPoint(x, y, -0.5 * THICK) for x, y in side] for side in OUTER]
    curves = []
    for side, after in zip(ends, [*ends[1:], ends[0]], strict=True):
        curves += [solid.addSpline(side), solid.addLine(side[-1], after[0])]
    points = [solid.addPoint(x, y, -0.5 * THICK) for x, y in WINDOW]
    window = solid.addSpline([*points, points[0]])
    loops = [solid.addCurveLoop(curves), solid.addCurveLoop([window])]
    grown = solid.extrude([(2, solid.addPlaneSurface(loops))], 0, 0, THICK)
    return [one for one in grown if one[0] == 3]


def main() -> None:
    """Write the STEP file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    solid = gmsh.model.occ
    whole, _ = solid.fuse(arms(), [eye(name, hole=False) for name in EYES])
    solid.cut(whole, [eye(name, hole=True) for name in EYES])
    solid.synchronize()
    gmsh.write(str(Path(__file__).with_name("wishbone.step")))
    gmsh.finalize()


if __name__ == "__main__":
    main()
