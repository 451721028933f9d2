"""Parts as a CAD program gives them: STEP in mm, kept as ``*.step.gz``; meshed by gmsh, kept as ``*.inp.gz``.

``python tests/first_hour/parts.py`` writes them anew where gmsh's Python module is installed.
A wishbone with three eyes, a spring clip, a cranked pedal with a hub; and a lever with an eye, which has no deck.
"""

import gzip
import math
from pathlib import Path

import gmsh

HERE = Path(__file__).parent
EYES = {"ball": (0, 0, 9, 18, 16), "front": (300, 140, 8, 16, 30), "rear": (280, -160, 8, 16, 30)}


def upright(x, y, radius, height):
    return 3, gmsh.model.occ.addCylinder(x, y, -height / 2, 0, 0, height, radius)


def beam(start, end, width, height):
    length = math.dist(start, end)
    box = 3, gmsh.model.occ.addBox(0, -width / 2, -height / 2, length, width, height)
    gmsh.model.occ.rotate([box], 0, 0, 0, 0, 0, 1, math.atan2(end[1] - start[1], end[0] - start[0]))
    gmsh.model.occ.translate([box], *start, 0)
    return box


def wishbone():
    rings = [upright(x, y, outer, height) for x, y, _, outer, height in EYES.values()]
    legs = [beam(EYES["ball"][:2], EYES[name][:2], 22, 10) for name in ("front", "rear")]
    whole, _ = gmsh.model.occ.fuse(rings[:1], [*rings[1:], *legs])
    gmsh.model.occ.cut(whole, [upright(x, y, radius, 80) for x, y, radius, _, _ in EYES.values()])
    return 9.0


def clip():
    occ = gmsh.model.occ
    ring, _ = occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 12, 20))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 12, 18))])
    ring, _ = occ.cut(ring, [(3, occ.addBox(0, -7, -1, 40, 14, 14))])
    whole, _ = occ.fuse(ring, [(3, occ.addBox(-24, -20, 0, 6, 40, 12))])
    occ.cut(whole, [(3, occ.addCylinder(-30, y, 6, 11, 0, 0, 2)) for y in (-15, 15)])
    return 3.2


def pedal():
    knee, end = (136, 0), (136 + 120 * math.cos(0.87), -120 * math.sin(0.87))
    pad = 3, gmsh.model.occ.addBox(-3, -25, -30, 6, 50, 60)
    gmsh.model.occ.rotate([pad], 0, 0, 0, 0, 0, 1, -0.87)
    gmsh.model.occ.translate([pad], *end, 0)
    parts = [beam((0, 0), (140, 0), 16, 8), beam(knee, end, 16, 8), pad]
    whole, _ = gmsh.model.occ.fuse([upright(0, 0, 14, 30)], parts)
    gmsh.model.occ.cut(whole, [upright(0, 0, 8, 80), upright(70, 0, 4, 80)])
    return 8.0


def lever():
    bar = 3, gmsh.model.occ.addBox(0, -6, -3, 120, 12, 6)
    whole, _ = gmsh.model.occ.fuse([upright(0, 0, 12, 12)], [bar])
    gmsh.model.occ.cut(whole, [upright(0, 0, 7, 20)])


def main():
    for make in (wishbone, clip, pedal, lever):
        gmsh.initialize()
        gmsh.option.setNumber("General.Verbosity", 2)
        size = make()
        gmsh.model.occ.synchronize()
        step, deck = HERE / f"{make.__name__}.step", HERE / f"{make.__name__}.inp"
        gmsh.write(str(step))
        with gzip.GzipFile(step.with_suffix(".step.gz"), "wb", mtime=0) as kept:
            kept.write(step.read_bytes())
        if size is None:
            step.unlink()
            gmsh.finalize()
            continue
        gmsh.clear()
        gmsh.merge(str(step))
        for name, value in (("SizeMax", size), ("SizeMin", size / 3), ("SizeFromCurvature", 8)):
            gmsh.option.setNumber(f"Mesh.Mesh{name}", value)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(deck))
        with gzip.GzipFile(deck.with_suffix(".inp.gz"), "wb", mtime=0) as kept:
            kept.write(deck.read_bytes())
        step.unlink()
        deck.unlink()
        gmsh.finalize()


if __name__ == "__main__":
    main()
