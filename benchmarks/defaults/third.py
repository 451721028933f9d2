"""Bodies of a third blind trial: many interfaces, stretch that bends, a panel on two hinges, a loop that sways."""

from __future__ import annotations

import numpy as np
from demo.mesh_tools import BrickMesh, Material, box_mesh

from benchmarks.defaults.bodies import PLASTIC, SPRING_STEEL
from benchmarks.defaults.body import Body, Where, about, above, below, both, either, near
from benchmarks.defaults.shapes import FloatArray, bar, constant, kept, lines, polyline

_ALUMINIUM = Material("ALUMINIUM", 7e10, 0.33, 2700.0)


def trivet() -> Body:
    """Thin plate on three small feet, with six tabs, each an interface."""
    y = lines((-0.045, -0.015, 6), (-0.015, 0.015, 4), (0.015, 0.045, 6))
    full = box_mesh(lines((-0.06, -0.02, 5), (-0.02, 0.02, 4), (0.02, 0.06, 5)), y, lines((0.0, 0.002, 1)))
    sides = both(about(0, [-0.04, 0.04], 0.02 + 1e-9), about(1, [-0.03, 0.03], 0.0051))
    mesh = kept(
        full, either(sides, either(both(about(0, [0.0], 0.0201), about(1, [0.0], 0.0451)), about(1, [0.0], 0.0151)))
    )
    feet = np.array([[0.0, -0.045, 0.0], [-0.02, 0.015, 0.0], [0.02, 0.015, 0.0]])
    ends = {
        f"tab{k}": both(near(0, 0.06 * x), about(1, [0.03 * y], 0.0051))
        for k, (x, y) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    }
    ends |= {name: both(near(0, x), about(1, [0.0], 0.0151)) for name, x in (("west", -0.06), ("east", 0.06))}
    cases = {
        "all": dict.fromkeys(ends, (0.0, 0.0, 417.0)) | dict.fromkeys(("west", "east"), (0.0, 0.0, 156.0)),
        "one": {"west": (0.0, 0.0, 1510.0)},
        "pair": {"west": (0.0, 0.0, 1510.0), "east": (0.0, 0.0, -1510.0)},
    }

    def held(points: FloatArray) -> FloatArray:
        away = np.abs(points[:, None, :] - feet).max(axis=2).min(axis=1)
        return (away < 0.0051) & (points[:, 2] < 1e-9)

    return Body("trivet", mesh, held, ends, cases, _ALUMINIUM)


def pergola() -> Body:
    """Stiff arc of aluminium that carries seven fingers of plastic, bent up and down in turn."""
    at = 0.13 + 0.4 * np.arange(7)
    runs = [(0.0, 0.1, 2), *((a - 0.03, a + 0.03, 1) for a in at), *((a + 0.03, a + 0.37, 4) for a in at[:-1])]
    grid = box_mesh(lines((0.05, 0.056, 2), (0.056, 0.1, 6)), lines(*runs), lines((-0.003, 0.003, 2)))
    flat = kept(grid, either(below(0, 0.056), about(1, at, 0.03)))
    r, turn, z = flat.points.T
    out = np.maximum(r - 0.056, 0.0)
    up = np.where(np.round((turn - 0.13) / 0.4) % 2 == 0, 1.0, -1.0)
    places = np.stack([r * np.cos(turn), r * np.sin(turn), z * (1.0 - 8.0 * out) + 6.0 * up * out**2], axis=1)

    def chosen(rows: FloatArray) -> FloatArray:
        return lambda _: rows

    ends = {f"finger{k}": chosen(np.isclose(r, 0.1) & (abs(turn - a) < 0.031)) for k, a in enumerate(at)}
    cases = {
        "all": dict.fromkeys(ends, (0.0, 0.0, 73.5)),
        "combed": {f"finger{k}": (56.1 * (-1.0) ** k, 44.9 * (-1.0) ** (k // 2), 0.0) for k in range(7)},
        "one": {"finger2": (45.4, -45.4, 45.4)},
    }
    plastic = lambda p: np.hypot(p[:, 0], p[:, 1]) > 0.056  # noqa: E731
    mesh = BrickMesh(places.round(12), flat.bricks)
    return Body("pergola", mesh, chosen(turn < 1e-9), ends, cases, _ALUMINIUM, (PLASTIC, plastic))


def bossed_strip() -> Body:
    """Thin strip that both ends hold, with a boss on one face: its tension bends it beside the boss."""
    x = lines((-0.03, -0.006, 8), (-0.006, 0.006, 3), (0.006, 0.03, 8))
    grid = box_mesh(x, lines((-0.01, 0.01, 4)), lines((0.0, 0.0006, 1), (0.0006, 0.0066, 2)))
    mesh = kept(grid, either(below(2, 0.0006), about(0, [0.0], 0.006)))
    cases = {
        "pushed": {"boss": (0.0, 0.0, -300.0)},
        "pulled": {"boss": (0.0, 0.0, 300.0)},
        "aside": {"boss": (150.0, 0.0, 0.0)},
    }
    return Body("bossed_strip", mesh, about(0, [-0.03, 0.03], 1e-7), {"boss": near(2, 0.0066)}, cases, _ALUMINIUM)


def door() -> Body:
    """Thin panel on two hinges, pulled at its lock and at a corner."""
    x = lines((0.0, 0.4, 14))
    y = lines((-0.35, -0.27, 3), (-0.27, -0.23, 2), (-0.23, -0.05, 6), (-0.05, 0.0, 2))
    mesh = box_mesh(x, np.concatenate([y, -y[-2::-1]]), lines((0.0, 0.0015, 1)))
    cases = {
        "lock": {"lock": (0.0, 0.0, 150.0)},
        "corner": {"corner": (0.0, 0.0, 110.0)},
        "both": {"lock": (0.0, 0.0, 150.0), "corner": (0.0, 0.0, -60.0)},
    }
    ends = {
        "lock": both(near(0, 0.4), about(1, [0.0], 0.0501)),
        "corner": both(near(0, 0.4), above(1, 0.269)),
    }
    hinges = both(near(0, 0.0), about(1, [-0.25, 0.25], 0.0201))
    return Body("door", mesh, hinges, ends, cases)


def omega() -> Body:
    """Leaf in the shape of an omega that both feet hold: its frames meet, and part, in its crown."""
    way = [(-0.05, 0.0, 0.0), (-0.014, 0.0, 0.0), (-0.03, 0.05, 0.0)]
    path = polyline(*way, *((-x, y, z) for x, y, z in way[::-1]), radius=0.008)
    mesh = bar(path, 44, constant(0.0012, 0.012))
    share = box_mesh(np.arange(45.0), np.arange(3.0), np.arange(3.0)).points[:, 0]

    def at(*places: float) -> Where:
        return lambda _: np.isin(share, places)

    cases = {
        "pressed": {"crown": (45.0, -675.0, 0.0)},
        "aside": {"crown": (700.0, 0.0, 0.0)},
        "sheared": {"crown": (0.0, 0.0, 400.0), "shoulder": (0.0, 100.0, 0.0)},
    }
    ends = {"crown": at(22.0), "shoulder": at(28.0)}
    return Body("omega", BrickMesh(mesh.points.round(12), mesh.bricks), at(0.0, 44.0), ends, cases, SPRING_STEEL)


THIRD = (trivet, pergola, bossed_strip, door, omega)
