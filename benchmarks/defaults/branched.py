"""Bodies with arms that evade sideways when loaded on edge, with branches, and stiff beside soft."""

from __future__ import annotations

import numpy as np
from demo.mesh_tools import STEEL, Material, box_mesh

from benchmarks.defaults.bodies import PLASTIC, SPRING_STEEL, _bar_body
from benchmarks.defaults.body import Body, Where, about, above, below, both, either, near, outside
from benchmarks.defaults.shapes import FloatArray, Path, bar, constant, cylindrical, kept, lines, moved, polyline, tube

_SOFT = Material("SOFT", 2e7, 0.4, 1200.0)


def strip() -> Body:
    """Strip twenty times as wide as thick, loaded on edge with a little aside: it evades and twists."""
    mesh = bar(lambda s: np.stack([0.2 * s, 0.0 * s, 0.0 * s], axis=1), 30, constant(0.02, 0.001), (4, 1))
    cases = {
        "on edge": (0.0, 83.1, 1.66),
        "aslant": (0.0, 40.9, 4.09),
        "pulled": (20.9, 69.6, 2.09),
    }
    loads = {case: {"tip": force} for case, force in cases.items()}
    return Body("strip", mesh, near(0, 0.0), {"tip": near(0, 0.2)}, loads)


def two_strips() -> Body:
    """Strip that is held in its middle and loaded at both ends, at one of them on edge."""
    mesh = box_mesh(lines((-0.15, -0.01, 16), (-0.01, 0.01, 2), (0.01, 0.2, 20)), lines((0.0, 0.02, 4)),
                    lines((0.0, 0.001, 1)))  # fmt: skip
    ends = {"left": near(0, -0.15), "right": near(0, 0.2)}
    cases = {
        "left on edge": {"left": (0.0, 164.0, 8.2), "right": (0.0, 0.0, 16.4)},
        "right on edge": {"left": (0.0, 0.0, 6.85), "right": (0.0, 68.5, 3.43)},
    }
    return Body("two_strips", mesh, about(0, [0.0], 0.0101), ends, cases)


def rake() -> Body:
    """Handle, crossbar and three tines of unequal width."""
    y = lines((-0.08, -0.07, 2), (-0.07, -0.005, 5), (-0.005, 0.005, 2), (0.005, 0.05, 4), (0.05, 0.06, 2))
    middle = about(1, [0.0], 0.005)
    mesh = kept(
        box_mesh(lines((0.0, 0.01, 2), (0.01, 0.1, 9), (0.1, 0.11, 2), (0.11, 0.22, 11)), y, lines((0.0, 0.004, 2))),
        either(about(0, [0.105], 0.005), either(middle, both(above(0, 0.11), either(below(1, -0.07), above(1, 0.05))))),
    )
    ends = {"left": both(near(0, 0.22), below(1, -0.06)), "middle": both(near(0, 0.22), about(1, [0.0], 0.0051)),
            "right": both(near(0, 0.22), above(1, 0.049))}  # fmt: skip
    cases = {
        "twisted": {"left": (0.0, 371.0, 111.0), "right": (0.0, 0.0, -111.0)},
        "middle": {"middle": (38.3, 191.0, 38.3), "left": (0.0, 0.0, 95.7)},
        "right": {"right": (0.0, -392.0, 58.8), "middle": (0.0, 157.0, 58.8)},
    }
    return Body("rake", mesh, near(0, 0.0), ends, cases)


def cross() -> Body:
    """Four flat arms of unequal length about a held middle, each an interface."""
    slim = either(about(0, [0.0], 0.005), about(1, [0.0], 0.005))
    x = lines((-0.1, -0.005, 9), (-0.005, 0.005, 2), (0.005, 0.12, 9))
    mesh = kept(
        box_mesh(x, lines((-0.08, -0.005, 8), (-0.005, 0.005, 2), (0.005, 0.1, 8)), lines((0.0, 0.003, 2))), slim
    )
    ends = {"east": near(0, 0.12), "west": near(0, -0.1), "north": near(1, 0.1), "south": near(1, -0.08)}
    cases = {
        "three": {"east": (0.0, 0.0, 623.0), "west": (0.0, 0.0, -311.0), "north": (249.0, 0.0, 0.0)},
        "on edge": {"east": (0.0, 1590.0, 477.0), "south": (0.0, 0.0, 1590.0)},
        "one": {"north": (0.0, 0.0, 1110.0)},
    }
    middle = both(about(0, [0.0], 0.0051), about(1, [0.0], 0.0051))
    return Body("cross", mesh, middle, ends, cases)


def y_branch() -> Body:
    """Trunk that ends in a thin and a wide arm."""
    y = lines((-0.06, -0.054, 2), (-0.054, -0.004, 4), (-0.004, 0.004, 2), (0.004, 0.05, 4), (0.05, 0.06, 2))
    arms = both(above(0, 0.104), either(below(1, -0.054), above(1, 0.05)))
    mesh = kept(
        box_mesh(lines((0.0, 0.1, 8), (0.1, 0.104, 1), (0.104, 0.2, 8)), y, lines((0.0, 0.006, 2))),
        either(about(0, [0.102], 0.002), either(arms, both(below(0, 0.1), about(1, [0.0], 0.004)))),
    )
    ends = {"thin": both(near(0, 0.2), below(1, 0.0)), "wide": both(near(0, 0.2), above(1, 0.0))}
    cases = {
        "opened": {"thin": (0.0, 513.0, 0.0), "wide": (0.0, -513.0, 154.0)},
        "thin arm": {"thin": (0.0, 0.0, 261.0), "wide": (0.0, 0.0, 0.0)},
    }
    return Body("y_branch", mesh, near(0, 0.0), ends, cases)


def portal() -> Body:
    """Two legs and a beam that overhangs."""
    legs = either(below(0, 0.01), about(0, [0.195], 0.005))
    mesh = kept(
        box_mesh(lines((0.0, 0.01, 2), (0.01, 0.19, 9), (0.19, 0.2, 2), (0.2, 0.3, 5)),
                 lines((0.0, 0.14, 8), (0.14, 0.15, 2)), lines((0.0, 0.012, 2))),
        either(above(1, 0.14), legs),
    )  # fmt: skip
    cases = {
        "down": {"over": (1.02e4, -3.41e4, 0.0)},
        "out of its plane": {"over": (0.0, 1750.0, 8760.0)},
        "aside": {"over": (8.9e4, 0.0, 0.0)},
    }
    return Body("portal", mesh, near(1, 0.0), {"over": near(0, 0.3)}, cases)


def rubber_foot() -> Body:
    """Steel bar on a soft foot, which takes all of the strain."""
    mesh = box_mesh(lines((0.0, 0.03, 4), (0.03, 0.2, 8)), lines((0.0, 0.02, 2)), lines((0.0, 0.02, 2)))
    cases = {"aside": {"tip": (0.0, 14.1, 0.0)}, "aslant": {"tip": (0.0, 8.18, 11.4)}}
    return Body("rubber_foot", mesh, near(0, 0.0), {"tip": near(0, 0.2)}, cases, inlay=(_SOFT, below(0, 0.03)))


def l_plate() -> Body:
    """Thin plate around a corner."""
    mesh = kept(
        box_mesh(lines((0.0, 0.05, 5), (0.05, 0.25, 16)), lines((0.0, 0.05, 5), (0.05, 0.2, 12)),
                 lines((0.0, 0.0012, 1))),
        either(below(0, 0.05), below(1, 0.05)),
    )  # fmt: skip
    cases = {"lifted": {"tip": (0.0, 0.0, 9.16)}, "lifted and pushed": {"tip": (0.0, 5.5, 9.16)}}
    return Body("l_plate", mesh, near(1, 0.2), {"tip": near(0, 0.25)}, cases)


def zigzag() -> Body:
    """Flat bar through three corners, out of a plane."""
    path = polyline((0.0, 0.0, 0.0), (0.08, 0.03, 0.0), (0.16, -0.01, 0.02), (0.24, 0.03, 0.0), radius=0.01)
    cases = {"aside": (0.0, 16.7, 5.0), "lifted": (19.2, 0.0, 96.1)}
    return _bar_body("zigzag", path, 44, constant(0.002, 0.01), cases)


def ribbon_coil() -> Body:
    """One and a half turns of wide ribbon."""

    def path(s: FloatArray) -> FloatArray:
        turn = 3.0 * np.pi * s
        return np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), 0.06 * s], axis=1)

    cases = {"pulled": (0.0, 0.0, 12.9), "aside": (12.4, 3.71, 2.47)}
    return _bar_body("ribbon_coil", path, 44, constant(0.0012, 0.02), cases)


def section(path: Path, share: float) -> Where:
    """Nodes of the section at a share of the way, at either end of a path."""
    there = path(np.array([share]))[0]
    along = path(np.array([abs(share - 1e-4)]))[0] - there
    along /= np.linalg.norm(along)
    return lambda p: (abs((p - there) @ along) < 2e-4) & (np.linalg.norm(p - there, axis=1) < 0.03)


def s_tube() -> Body:
    """Tube bent into an S."""

    def path(s: FloatArray) -> FloatArray:
        return np.stack([0.4 * s, 0.06 * np.sin(2.0 * np.pi * s), 0.0 * s], axis=1)

    mesh = tube(path, 24, 12, lambda s: 0.012 + 0.0 * s, 0.0015)
    cases = {"in its plane": {"tip": (0.0, 6280.0, 0.0)}, "out of it": {"tip": (944.0, 0.0, 4720.0)}}
    return Body("s_tube", mesh, section(path, 0.0), {"tip": section(path, 1.0)}, cases, STEEL)


def box_beam() -> Body:
    """Thin-walled box, which buckles locally."""
    mesh = kept(
        box_mesh(lines((0.0, 0.5, 20)), lines((0.0, 0.001, 1), (0.001, 0.039, 6), (0.039, 0.04, 1)),
                 lines((0.0, 0.001, 1), (0.001, 0.019, 4), (0.019, 0.02, 1))),
        lambda p: outside(1, 0.019)(p - [0.0, 0.02, 0.0]) | outside(2, 0.009)(p - [0.0, 0.0, 0.01]),
    )  # fmt: skip
    cases = {"both": {"tip": (0.0, 87.1, 26.1)}, "flat": {"tip": (0.0, 0.0, 48.9)}}
    return Body("box_beam", mesh, near(0, 0.0), {"tip": near(0, 0.5)}, cases, PLASTIC)


def split_ring() -> Body:
    """Flat ring of three quarters, thin, lifted at its end."""
    angle = 1.7 * np.pi
    mesh = moved(
        box_mesh(lines((0.03, 0.06, 4)), np.linspace(0.0, angle, 29), lines((0.0, 0.002, 2))),
        cylindrical,
    )
    across, along = np.array([np.sin(angle), -np.cos(angle), 0.0]), np.array([np.cos(angle), np.sin(angle), 0.0])
    lip: Where = lambda p: (abs(p @ across) < 1e-7) & (p @ along > 0.0)  # noqa: E731
    cases = {"lifted": {"lip": (0.0, 0.0, 162.0)}}
    return Body("split_ring", mesh, both(near(1, 0.0), above(0, 0.0)), {"lip": lip}, cases, SPRING_STEEL)


BRANCHED = {
    "arms on edge": (strip, two_strips, cross, rake, zigzag, ribbon_coil),
    "branches, stiff beside soft": (y_branch, portal, rubber_foot, l_plate, s_tube, box_beam, split_ring),
}
