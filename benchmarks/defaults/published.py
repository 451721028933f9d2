"""Published problems of large deflection, built with the shortest body file; values in `benchmarks.field.statics`."""

from __future__ import annotations

import numpy as np
from demo.mesh_tools import Material, box_mesh

from benchmarks.defaults.bodies import GROUPS
from benchmarks.defaults.body import Body, above, below, both, end, near
from benchmarks.defaults.branched import BRANCHED
from benchmarks.defaults.fresh import FRESH
from benchmarks.defaults.shapes import FloatArray, bar, constant, cylindrical, moved
from benchmarks.defaults.third import THIRD
from benchmarks.defaults.unseen import UNSEEN


def twisted_cantilever() -> Body:
    """Cantilever of 10 m, 0.5 m x 0.25 m, twisted by 90 degrees, under 4 MN (Wang et al. 2017)."""

    def up(s: FloatArray) -> FloatArray:
        angle = -0.5 * np.pi * s
        return np.stack([0.0 * s, np.sin(angle), np.cos(angle)], axis=1)

    mesh = bar(lambda s: np.stack([10.0 * s, 0.0 * s, 0.0 * s], axis=1), 32, constant(0.25, 0.5), up=up)
    material = Material("M1", 2e11, 2e11 / (2.0 * 79.3e9) - 1.0, 7850.0)
    first, last = end(mesh, (2, 2), False), end(mesh, (2, 2), True)
    return Body("twisted_cantilever", mesh, first, {"tip": last}, {"down": {"tip": (0.0, 0.0, -4e6)}}, material)


def slit_annulus() -> Body:
    """Annular plate, radii 6 and 10, slit along x; 0.8 a length lifts one lip (Sze, Liu, Lo 2004)."""
    grid = box_mesh(np.linspace(6.0, 10.0, 7), np.linspace(0.0, 2.0 * np.pi, 61), np.array([-0.015, 0.015]))
    turn = grid.points[:, 1]
    first, last = np.isclose(turn, 0.0), np.isclose(turn, 2.0 * np.pi)
    lip = {"lip": lambda _: last}
    cases = {"lifted": {"lip": (0.0, 0.0, 3.2)}}
    material = Material("M1", 2.1e7, 0.0, 1e3)
    mesh = moved(grid, cylindrical)
    return Body("slit_annulus", mesh, lambda _: first, lip, cases, material, shares=(0.1, 0.3, 0.5, 1.0))


def half_cylinder() -> Body:
    """Half-cylinder, held at one end and guided along its edges, pinched at the other (Sze, Liu, Lo 2004)."""
    grid = box_mesh(np.linspace(0.0, 3.048, 17), np.linspace(0.0, np.pi, 25), np.array([-0.015, 0.015]))

    def place(points: FloatArray) -> FloatArray:
        x, turn, out = points.T
        reach = 1.016 + out
        return np.stack([x, -reach * np.cos(turn), reach * np.sin(turn)], axis=1)

    mesh = moved(grid, place)
    step = np.pi / 24.0
    out, turn = np.isclose(grid.points[:, 2], 0.015), abs(grid.points[:, 1] - 0.5 * np.pi) < 1.01 * step
    crown = out & turn & (grid.points[:, 0] > 3.048 - 1.01 * 3.048 / 16.0)
    edge = both(below(2, 1e-6), above(0, 1e-6))
    cases = {"pinched": {"crown": (0.0, 0.0, -600.0)}}
    material = Material("M1", 2.0685e7, 0.3, 1e3)
    return Body("half_cylinder", mesh, near(0, 0.0), {"crown": lambda _: crown}, cases, material, guides={"z": edge})


PUBLISHED = (twisted_cantilever, slit_annulus, half_cylinder)
ALL = (
    GROUPS
    | BRANCHED
    | {"published": PUBLISHED, "blind trial": UNSEEN, "second blind trial": FRESH, "third blind trial": THIRD}
)
EVERY = tuple(make for group in ALL.values() for make in group)
