"""Bodies that no demo is like, with loads that bend them far.

Sizes in m. Full loads move an interface by some 20 to 30 % of the body's length, turn it by 0.7 to 1 rad, or come near
the critical load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
from demo.mesh_tools import STEEL, Material, box_mesh, merge

from benchmarks.defaults import body, shapes
from benchmarks.defaults.body import Body, Where, about, above, below, both, either, end, near, outside, reach
from benchmarks.defaults.shapes import FloatArray, bar, constant, kept, lines, moved, polyline, ring, tapered, tube

FOAM = Material("FOAM", 2e8, 0.3, 100.0)
RUBBER = Material("RUBBER", 3e6, 0.45, 1100.0)
PLASTIC = Material("PLASTIC", 2.5e9, 0.35, 1200.0)
SPRING_STEEL = Material("STEEL", 2.06e11, 0.29, 7850.0)


def _bar_body(
    name: str,
    path: shapes.Path,
    along: int,
    size: Callable[[FloatArray], FloatArray],
    cases: Mapping[str, tuple[float, float, float]],
    across: tuple[int, int] = (2, 2),
    up: object = None,
    material: Material = SPRING_STEEL,
) -> Body:
    """A bar held at its start, with the interface tip at its end; cases are the tip's forces."""
    mesh = bar(path, along, size, across, up)
    loads = {case: {"tip": force} for case, force in cases.items()}
    first, last = end(mesh, across, False), end(mesh, across, True)
    return Body(name, mesh, first, {"tip": last}, loads, material)


def _straight(length: float) -> shapes.Path:
    return lambda s: np.stack([length * s, 0.0 * s, 0.0 * s], axis=1)


# Springs.


def coil_spring() -> Body:
    """Two and a half turns of square wire, radius 30 mm."""

    def path(s: FloatArray) -> FloatArray:
        turn = 5.0 * np.pi * s
        return np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), 0.045 * s], axis=1)

    cases = {"pulled": (0.0, 0.0, 200.0), "pushed aside": (150.0, 60.0, 0.0), "pressed": (0.0, 30.0, -150.0)}
    return _bar_body("coil_spring", path, 48, constant(0.005, 0.005), cases)


def volute() -> Body:
    """Two turns of flat strip on a cone."""

    def path(s: FloatArray) -> FloatArray:
        turn, reach = 4.0 * np.pi * s, 0.06 - 0.035 * s
        return np.stack([reach * np.cos(turn), reach * np.sin(turn), 0.05 * s], axis=1)

    cases = {"pulled": (0.0, 0.0, 100.0), "pushed aside": (0.0, 110.0, 0.0)}
    return _bar_body("volute", path, 44, constant(0.003, 0.008), cases)


def spiral() -> Body:
    """Flat spiral of two and a quarter turns, loaded at its inner end."""

    def path(s: FloatArray) -> FloatArray:
        turn, reach = 4.5 * np.pi * s, 0.06 - 0.04 * s
        return np.stack([reach * np.cos(turn), reach * np.sin(turn), 0.0 * s], axis=1)

    cases = {"in its plane": (20.0, 12.0, 0.0), "out of it": (0.0, 0.0, 18.0), "both": (-10.0, 0.0, 16.0)}
    return _bar_body("spiral", path, 56, constant(0.0015, 0.008), cases)


def serpentine() -> Body:
    """Five legs of flat wire side by side."""
    corners = [(0.0, 0.0, 0.0)]
    for k in range(5):
        high = 0.06 if k % 2 == 0 else 0.0
        corners += [(0.014 * k, high, 0.0), (0.014 * (k + 1), high, 0.0)]
    corners += [(0.07, 0.0, 0.0)]
    path = polyline(*corners, radius=0.006)
    cases = {"pulled": (30.0, 0.0, 0.0), "across": (0.0, 15.0, 0.0), "out of its plane": (0.0, 0.0, 25.0)}
    return _bar_body("serpentine", path, 66, constant(0.002, 0.006), cases)


def leaf_spring() -> Body:
    """Bowed leaf of 1 m, clamped in its middle, with an eye at both ends: both arms are alike."""

    def path(s: FloatArray) -> FloatArray:
        x = s - 0.5
        return np.stack([x, 0.4 * x**2, 0.0 * s], axis=1)

    def size(s: FloatArray) -> FloatArray:
        return np.stack([0.012 - 0.012 * abs(s - 0.5), 0.06 + 0.0 * s], axis=1)

    mesh = bar(path, 40, size)
    ends = {"left": end(mesh, (2, 2), False), "right": end(mesh, (2, 2), True)}
    cases = {
        "both up": {"left": (0.0, 6e3, 0.0), "right": (0.0, 6e3, 0.0)},
        "opposite": {"left": (0.0, 6e3, 0.0), "right": (0.0, -6e3, 0.0)},
        "pulled": {"left": (-1.2e4, 0.0, 0.0), "right": (1.2e4, 0.0, 4e3)},
    }
    return Body("leaf_spring", mesh, about(0, [0.0], 0.026), ends, cases, SPRING_STEEL)


def fork() -> Body:
    """Tuning fork: two tines alike, in one level of the distance from the support."""
    across = lines((-0.02, -0.016, 2), (-0.016, 0.016, 4), (0.016, 0.02, 2))
    mesh = kept(
        box_mesh(lines((0.0, 0.02, 2), (0.02, 0.2, 12)), across, lines((0.0, 0.008, 2))),
        either(below(0, 0.02), outside(1, 0.016)),
    )  # fmt: skip
    ends = {
        "left": both(near(0, 0.2), below(1, 0.0)),
        "right": both(near(0, 0.2), above(1, 0.0)),
    }
    cases = {
        "opened": {"left": (0.0, -250.0, 0.0), "right": (0.0, 250.0, 0.0)},
        "bent": {"left": (0.0, 250.0, 0.0), "right": (0.0, 250.0, 150.0)},
        "one tine": {"right": (0.0, 250.0, 0.0)},
    }
    return Body("fork", mesh, near(0, 0.0), ends, cases)


def c_clip() -> Body:
    """Open ring of 300 degrees, held at its back, with both ends loaded."""
    mesh = bar(lambda s: 0.04 * _arc(np.pi / 6.0 + s * 5.0 * np.pi / 3.0), 40, constant(0.003, 0.006))
    ends = {"low": end(mesh, (2, 2), True), "high": end(mesh, (2, 2), False)}
    cases = {
        "opened": {"low": (0.0, -200.0, 0.0), "high": (0.0, 200.0, 0.0)},
        "closed": {"low": (0.0, 180.0, 0.0), "high": (0.0, -180.0, 0.0)},
        "twisted": {"low": (0.0, 0.0, -300.0), "high": (0.0, 0.0, 300.0)},
    }
    return Body("c_clip", mesh, both(below(0, 0.0), about(1, [0.0], 2e-3)), ends, cases, SPRING_STEEL)


def _arc(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)


# Flexures: loops between supports, or folded.


def cross_pivot() -> Body:
    """Two crossed leaves beside each other that carry a block."""
    reach, thick = 0.025, 0.0004
    ends = [lines((x - thick, x + thick, 2)) for x in (-reach, reach)]
    x = np.concatenate([ends[0], [-0.0125, 0.0, 0.0125], ends[1]])
    deep = lines((0.0, 0.006, 2), (0.006, 0.008, 1), (0.008, 0.014, 2))
    block = box_mesh(x, lines((0.05, 0.056, 1)), deep)
    leaves = [
        moved(
            box_mesh(lines((-thick, thick, 2)), lines((0.0, 1.0, 16)), z),
            lambda p, sign=sign: np.stack([p[:, 0] + sign * reach * (2.0 * p[:, 1] - 1.0), 0.05 * p[:, 1], p[:, 2]], 1),
        )
        for sign, z in ((1.0, deep[deep < 0.0061]), (-1.0, deep[deep > 0.0079]))
    ]
    cases = {"turned": {"stage": (18.0, 0.0, 0.0)}, "turned and pressed": {"stage": (7.5, -20.0, 0.0)}}
    return Body("cross_pivot", merge(block, *leaves), near(1, 0.0), {"stage": near(1, 0.056)}, cases, SPRING_STEEL)


def parallelogram() -> Body:
    """Two parallel leaves that carry a block."""
    x = lines((-0.0153, -0.0147, 2), (-0.0147, 0.0147, 3), (0.0147, 0.0153, 2))
    mesh = kept(
        box_mesh(x, lines((0.0, 0.06, 14), (0.06, 0.07, 1)), lines((0.0, 0.008, 2))),
        either(outside(0, 0.0147), above(1, 0.06)),
    )
    cases = {"aside": {"stage": (60.0, 0.0, 0.0)}, "aside and pressed": {"stage": (30.0, -60.0, 0.0)}}
    return Body("parallelogram", mesh, near(1, 0.0), {"stage": near(1, 0.07)}, cases, SPRING_STEEL)


def folded_flexure() -> Body:
    """Two leaves up to a bridge, two down again to the stage."""
    leaves = [-0.02, -0.01, 0.01, 0.02]
    x = lines(*((at - 0.00025, at + 0.00025, 2) for at in leaves), *zip(
        [at + 0.00025 for at in leaves[:-1]], [at - 0.00025 for at in leaves[1:]], [2, 3, 2], strict=True,
    ))  # fmt: skip
    stage = both(below(1, 0.0), about(0, [0.0], 0.0102))
    mesh = kept(
        box_mesh(x, lines((-0.006, 0.0, 1), (0.0, 0.06, 14), (0.06, 0.066, 1)), lines((0.0, 0.006, 2))),
        either(stage, above(1, 0.06), both(above(1, 0.0), about(0, leaves, 0.00025))),
    )
    cases = {"aside": {"stage": (12.0, 0.0, 0.0)}, "far aside": {"stage": (56.0, 0.0, 0.0)},
             "aside and down": {"stage": (12.0, -20.0, 0.0)}}  # fmt: skip
    feet = both(near(1, 0.0), outside(0, 0.015))
    return Body("folded_flexure", mesh, feet, {"stage": near(1, -0.006)}, cases, SPRING_STEEL)


def bistable_beam() -> Body:
    """Cosine-shaped beam between two walls, pressed in its middle short of snapping."""

    def path(s: FloatArray) -> FloatArray:
        return np.stack([0.1 * s, 0.0015 * (1.0 - np.cos(2.0 * np.pi * s)), 0.0 * s], axis=1)

    mesh = bar(path, 40, constant(0.001, 0.005))
    walls = either(below(0, 1e-7), above(0, 0.1 - 1e-7))
    cases = {"pressed": {"middle": (0.0, -85.0, 0.0)}, "pressed aslant": {"middle": (30.0, -80.0, 10.0)},
             "pulled": {"middle": (0.0, 1200.0, 0.0)}}  # fmt: skip
    return Body("bistable_beam", mesh, walls, {"middle": about(0, [0.05], 1e-6)}, cases, SPRING_STEEL)


# Thin walls and shells.


def channel() -> Body:
    """Thin-walled channel, loaded beside its shear centre: it twists as it bends."""
    mesh = kept(
        box_mesh(lines((0.0, 0.5, 20)), lines((0.0, 0.0015, 1), (0.0015, 0.03, 3)),
                 lines((-0.03, -0.0285, 1), (-0.0285, 0.0285, 4), (0.0285, 0.03, 1))),
        either(below(1, 0.0015), outside(2, 0.0285)),
    )  # fmt: skip
    cases = {
        "along the web": {"tip": (0.0, 0.0, 1500.0)},
        "across it": {"tip": (0.0, 1200.0, 0.0)},
        "flanges buckle": {"tip": (0.0, 1800.0, 0.0)},
        "both": {"tip": (0.0, 900.0, 900.0)},
    }
    return Body("channel", mesh, near(0, 0.0), {"tip": near(0, 0.5)}, cases)


def twisted_blade() -> Body:
    """Blade of 0.4 m, twisted by 60 degrees and tapered."""

    def up(s: FloatArray) -> FloatArray:
        angle = np.pi / 3.0 * s
        return np.stack([0.0 * s, np.sin(angle), np.cos(angle)], axis=1)

    cases = {"flapwise": (0.0, 450.0, 0.0), "edgewise": (0.0, 0.0, 1000.0), "both": (0.0, -320.0, 320.0)}
    return _bar_body("twisted_blade", _straight(0.4), 24, tapered((0.005, 0.06), (0.003, 0.04)), cases, (2, 3), up)


def angle() -> Body:
    """Thin-walled angle section: it twists under a load through its centroid."""
    walls = lines((0.0, 0.002, 1), (0.002, 0.04, 4))
    mesh = kept(box_mesh(lines((0.0, 0.6, 20)), walls, walls), either(below(1, 0.002), below(2, 0.002)))
    cases = {
        "down": {"tip": (0.0, 0.0, -600.0)},
        "up": {"tip": (0.0, 0.0, 600.0)},
        "both": {"tip": (0.0, 500.0, 500.0)},
        "against": {"tip": (0.0, 400.0, -400.0)},
    }
    return Body("angle", mesh, near(0, 0.0), {"tip": near(0, 0.6)}, cases)


def gutter() -> Body:
    """Half a thin tube, which opens and closes as it bends."""
    grid = box_mesh(np.linspace(0.0, 0.5, 20), np.linspace(0.0, np.pi, 9), np.array([-0.0006, 0.0006]))

    def place(points: FloatArray) -> FloatArray:
        x, turn, out = points.T
        r = 0.03 + out
        return np.stack([x, -r * np.cos(turn), r * np.sin(turn)], axis=1)

    cases = {
        "up": {"tip": (0.0, 0.0, 300.0)},
        "down": {"tip": (0.0, 0.0, -300.0)},
        "side": {"tip": (0.0, 300.0, 0.0)},
    }
    return Body("gutter", moved(grid, place), near(0, 0.0), {"tip": near(0, 0.5)}, cases)


def elbow() -> Body:
    """Pipe bend of 90 degrees with straight ends; its section becomes oval."""
    path = polyline((0.0, 0.0, 0.0), (0.25, 0.0, 0.0), (0.25, 0.25, 0.0), radius=0.12)
    mesh = tube(path, 22, 12, lambda s: 0.03 + 0.0 * s, 0.002)
    cases = {"closed": {"tip": (-2.5e4, 0.0, 0.0)}, "opened": {"tip": (5.4e4, 0.0, 0.0)},
             "out of its plane": {"tip": (0.0, 0.0, 4.2e4)}}  # fmt: skip
    return Body("elbow", mesh, near(0, 0.0), {"tip": near(1, 0.25)}, cases)


def tapered_tube() -> Body:
    """Thin conical tube of 0.8 m."""
    mesh = tube(_straight(0.8), 22, 12, lambda s: 0.03 - 0.012 * s, 0.0015)
    cases = {"bent": {"tip": (0.0, 1.6e4, 0.0)}, "bent and pressed": {"tip": (-2.4e4, 6e3, 0.0)}}
    return Body("tapered_tube", mesh, near(0, 0.0), {"tip": near(0, 0.8)}, cases)


def cap() -> Body:
    """Spherical cap on a held rim, with a boss ring; pressed short of snapping."""
    flat = ring(lines((0.008, 0.04, 5)), 20, np.array([-0.0005, 0.0005]))

    def place(points: FloatArray) -> FloatArray:
        r = np.hypot(points[:, 0], points[:, 1])
        return points * [1.0, 1.0, 1.0] + np.stack([0.0 * r, 0.0 * r, np.sqrt(0.25**2 - r**2) - 0.246], axis=1)

    cases = {"pressed": {"boss": (0.0, 0.0, -1600.0)}, "pulled": {"boss": (0.0, 0.0, 8e3)},
             "aslant": {"boss": (2.2e3, 0.0, -1300.0)}}  # fmt: skip
    return Body("cap", moved(flat, place), reach(0.04), {"boss": reach(0.008)}, cases)


def pads_on_plate() -> Body:
    """Thin plate held along one edge, with six pads."""
    cells = lines((0.0, 0.3, 12))
    mesh = box_mesh(cells, cells, lines((0.0, 0.003, 1)))

    def pad(i: int, j: int) -> Where:
        low = np.array([0.025 + 0.1 * i, 0.025 + 0.2 * j])
        return lambda p: (
            (p[:, 2] > 0.00299) & np.all(p[:, :2] > low - 1e-7, axis=1) & np.all(p[:, :2] < low + 0.0501, axis=1)
        )

    pads = {f"pad{i}{j}": pad(i, j) for i in range(3) for j in range(2)}
    cases = {
        "far pads": {"pad20": (0.0, 0.0, 900.0), "pad21": (0.0, 0.0, 900.0)},
        "twisted": {"pad20": (0.0, 0.0, 900.0), "pad21": (0.0, 0.0, -900.0)},
        "all": dict.fromkeys(pads, (200.0, 0.0, 400.0)),
    }
    return Body("pads_on_plate", mesh, near(0, 0.0), pads, cases)


# Frames, and bodies with many interfaces.


def ladder_frame() -> Body:
    """Two rails and five rungs, held at two ends; the others are loaded."""
    rungs = (0.0, 0.24, 0.48, 0.72, 0.96)
    x = lines(*((at - 0.01, at + 0.01, 2) for at in rungs), *((at + 0.01, at + 0.23, 3) for at in rungs[:-1]))
    y = lines((-0.01, 0.01, 2), (0.01, 0.29, 4), (0.29, 0.31, 2))
    mesh = kept(
        box_mesh(x, y, lines((0.0, 0.02, 2))),
        either(below(1, 0.01), above(1, 0.29), about(0, rungs, 0.01)),
    )
    rails = either(below(1, 0.0101), above(1, 0.2899))
    ends = {"left": both(near(0, 0.97), below(1, 0.0101)), "right": both(near(0, 0.97), above(1, 0.2899))}
    cases = {
        "bent": {"left": (0.0, 0.0, 2200.0), "right": (0.0, 0.0, 2200.0)},
        "twisted": {"left": (0.0, 0.0, 2e4), "right": (0.0, 0.0, -2e4)},
        "in its plane": {"left": (0.0, 2e4, 0.0), "right": (0.0, 0.0, 0.0)},
    }
    return Body("ladder_frame", mesh, both(near(0, -0.01), rails), ends, cases)


def lattice_tower() -> Body:
    """Tower of four posts and square rings."""
    storeys = np.linspace(0.0, 1.2, 6)
    side = lines((-0.06, -0.05, 2), (-0.05, 0.05, 2), (0.05, 0.06, 2))
    z = lines(*((a, b - 0.01, 2) for a, b in pairwise(storeys)),
              *((b - 0.01, b, 1) for b in storeys[1:]))  # fmt: skip
    wide, deep = outside(0, 0.05), outside(1, 0.05)
    rings = both(about(2, storeys[1:] - 0.005, 0.005), either(wide, deep))
    mesh = kept(box_mesh(side, side, z), either(both(wide, deep), rings))
    tops = {"a": both(near(2, 1.2), above(0, 0.0499), above(1, 0.0499)),
            "b": both(near(2, 1.2), below(0, -0.0499), below(1, -0.0499))}  # fmt: skip
    cases = {"aside": {"a": (3600.0, 0.0, 0.0), "b": (3600.0, 0.0, 0.0)},
             "twisted": {"a": (5e3, -5e3, 0.0), "b": (-5e3, 5e3, 0.0)},
             "pressed": {"a": (400.0, 0.0, -2.5e4), "b": (400.0, 0.0, -2.5e4)}}  # fmt: skip
    return Body("lattice_tower", mesh, near(2, 0.0), tops, cases)


def comb() -> Body:
    """Back with ten teeth, an interface on each."""
    teeth = 0.008 * np.arange(10) + 0.005
    x = lines((0.0, 0.004, 1), *((at - 0.001, at + 0.001, 1) for at in teeth),
              *((at + 0.001, at + 0.007, 1) for at in teeth[:-1]))  # fmt: skip
    mesh = kept(
        box_mesh(x, lines((0.0, 0.006, 2), (0.006, 0.036, 5)), lines((0.0, 0.003, 2))),
        either(below(1, 0.006), about(0, teeth, 0.001)),
    )
    names = {f"tooth{k}": both(near(1, 0.036), about(0, [at], 0.0011)) for k, at in enumerate(teeth)}
    cases = {
        "one tooth": {"tooth5": (250.0, 0.0, 0.0)},
        "every second": {f"tooth{k}": (30.0, 0.0, 70.0) for k in range(0, 10, 2)},
        "last tooth": {"tooth9": (0.0, 80.0, 250.0)},
    }
    return Body("comb", mesh, near(0, 0.0), names, cases)


def wheel() -> Body:
    """Hub, six spokes and a rim."""
    # Of centres of sectors of 10 degrees: those that begin at a multiple of 60.
    spokes = about(1, np.pi / 3.0 * np.arange(6) + np.pi / 36.0, 0.01)
    mesh = ring(
        lines((0.02, 0.03, 1), (0.03, 0.1, 5), (0.1, 0.106, 2)), 36, lines((0.0, 0.006, 2)),
        either(below(0, 0.03), above(0, 0.1), spokes),
    )  # fmt: skip

    def rim(at: float) -> Where:
        return lambda p: (
            np.isclose(np.hypot(p[:, 0], p[:, 1]), 0.106, atol=1e-7)
            & (p[:, 0] * np.cos(at) + p[:, 1] * np.sin(at) > 0.106 * np.cos(np.pi / 18.0 + 1e-6))
        )

    cases = {
        "pressed": {"road": (0.0, -2e4, 0.0)},
        "around": {"road": (1.8e4, 0.0, 0.0)},
        "aside": {"road": (0.0, 0.0, 2.5e3), "top": (0.0, 0.0, -2.5e3)},
    }
    return Body("wheel", mesh, reach(0.02), {"road": rim(-0.5 * np.pi), "top": rim(0.5 * np.pi)}, cases)


def mast() -> Body:
    """Mast of 6 m with a cross arm, loaded at one end of the arm up to near the critical load."""

    def slim(points: FloatArray) -> FloatArray:
        share = (1.0 - 0.06 * points[:, 2])[:, None]
        return points * np.hstack([share, share, np.ones_like(share)])

    def tip(sign: float) -> Where:
        return lambda p: np.isclose(p[:, 0], sign * (1.0 - 0.06 * p[:, 2]), atol=1e-7) & (p[:, 2] > 5.8)

    across = lines((-1.0, -0.06, 4), (-0.06, 0.06, 2), (0.06, 1.0, 4))
    grid = box_mesh(across, lines((-0.06, 0.06, 2)), lines((0.0, 5.9, 20), (5.9, 6.0, 1)))
    mesh = moved(kept(grid, either(above(2, 5.9), about(0, [0.0], 0.06))), slim)
    cases = {
        "pressed": {"left": (0.0, 0.0, -4.8e4), "right": (0.0, 0.0, -5.4e4)},
        "aside": {"left": (0.0, 2.4e4, 0.0), "right": (0.0, 2.4e4, 0.0)},
        "turned": {"left": (0.0, 2.4e4, 0.0), "right": (0.0, -2.4e4, 0.0)},
    }
    return Body("mast", mesh, near(2, 0.0), {"left": tip(-1.0), "right": tip(1.0)}, cases)


# Thick, soft and mixed bodies.


def stocky_rod() -> Body:
    """Rod three times as long as it is thick, pressed and bent."""
    cases = {"pressed": (-3.2e4, 0.0, 0.0), "bent": (0.0, 6e3, 0.0), "pressed and bent": (-2e4, 4e3, 1e3)}
    return _bar_body("stocky_rod", _straight(0.12), 10, constant(0.03, 0.04), cases, (3, 3), material=PLASTIC)


def sandwich() -> Body:
    """Soft core between stiff skins."""
    mesh = box_mesh(
        lines((0.0, 0.5, 20)), lines((-0.01, -0.009, 1), (-0.009, 0.009, 2), (0.009, 0.01, 1)), lines((-0.03, 0.03, 2))
    )
    cases = {"bent": {"tip": (0.0, 3e3, 0.0)}, "twisted aside": {"tip": (0.0, 600.0, 5e3)},
             "pressed": {"tip": (-1.2e4, 600.0, 0.0)}}  # fmt: skip
    return Body("sandwich", mesh, near(0, 0.0), {"tip": near(0, 0.5)}, cases, STEEL, (FOAM, about(1, [0.0], 0.009)))


def rubber_mount() -> Body:
    """Rubber block under a steel plate."""
    mesh = box_mesh(lines((-0.02, 0.02, 5)), lines((-0.02, 0.02, 5)), lines((0.0, 0.03, 5), (0.03, 0.034, 1)))
    cases = {"sheared": {"plate": (200.0, 0.0, 0.0)}, "pressed": {"plate": (0.0, 0.0, -500.0)},
             "both": {"plate": (130.0, 30.0, -200.0)}}  # fmt: skip
    plate = (STEEL, above(2, 0.03))
    return Body("rubber_mount", mesh, near(2, 0.0), {"plate": near(2, 0.034)}, cases, RUBBER, plate)


def hook() -> Body:
    """Thick hook of plastic, tapered."""
    way = [(0.0, 0.12, 0.0), (0.0, 0.0, 0.0), (0.07, 0.0, 0.0), (0.07, 0.05, 0.0)]
    cases = {"pulled": (0.0, -180.0, 0.0), "aside": (0.0, -70.0, 90.0)}
    path = polyline(*way, radius=0.034)
    return _bar_body("hook", path, 26, tapered((0.014, 0.014), (0.008, 0.01)), cases, material=PLASTIC)


def wishbone() -> Body:
    """Bent arm between two bearings with a ball joint at its point, of tetrahedra."""
    path = polyline((0.0, -0.16, 0.0), (0.3, -0.02, 0.03), (0.3, 0.02, 0.03), (0.0, 0.16, 0.0), radius=0.015)
    bricks = bar(path, 24, lambda s: np.stack([0.016 + 0.01 * np.sin(np.pi * s), 0.02 + 0.0 * s], axis=1), (2, 2))
    mesh = shapes.tetrahedral(bricks)
    first, last = path(np.array([0.0, 1e-3])), path(np.array([1.0, 1.0 - 1e-3]))
    cases = {"up": {"ball": (0.0, 0.0, 4e4)}, "across": {"ball": (2e5, 0.0, 5e3)},
             "along": {"ball": (0.0, 3e5, 1.6e4)}}  # fmt: skip
    return Body(
        "wishbone",
        mesh,
        either(body.section_at(first), body.section_at(last)),
        {"ball": both(near(1, 0.0), above(0, 0.2))},
        cases,
    )


def cranked_arm() -> Body:
    """Arm of three legs in three directions."""
    path = polyline((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.15, 0.0), (0.2, 0.15, 0.15), radius=0.03)
    cases = {"x": (900.0, 0.0, 0.0), "y": (0.0, 1000.0, 0.0), "z": (0.0, 0.0, 1300.0)}
    return _bar_body("cranked_arm", path, 34, constant(0.012, 0.01), cases, up=[0.31, 0.27, 0.9])


def chain_link() -> Body:
    """Oval link held at one end and pulled at the other: a loop without a second support."""
    inner = ring(lines((0.02, 0.0225, 1), (0.0225, 0.025, 1)), 24, lines((-0.0025, 0.0025, 2)))
    mesh = moved(inner, lambda p: p * [1.0, 2.2, 1.0])
    top = both(above(1, 0.0), near(0, 0.0))
    cases = {"pulled": {"top": (0.0, 3e4, 0.0)}, "pressed": {"top": (80.0, -3200.0, 0.0)},
             "aside": {"top": (1600.0, 0.0, 1600.0)}}  # fmt: skip
    return Body("chain_link", mesh, below(1, -0.0535), {"top": top}, cases)


GROUPS: dict[str, tuple[Callable[[], Body], ...]] = {
    "springs": (coil_spring, volute, spiral, serpentine, leaf_spring, fork, c_clip),
    "flexures": (cross_pivot, parallelogram, folded_flexure, bistable_beam),
    "thin walls": (channel, twisted_blade, angle, gutter, elbow, tapered_tube, cap, pads_on_plate),
    "frames": (ladder_frame, lattice_tower, comb, wheel, mast),
    "thick, soft, mixed": (stocky_rod, sandwich, rubber_mount, hook, wishbone, cranked_arm, chain_link),
}
