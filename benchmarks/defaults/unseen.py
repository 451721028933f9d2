"""Bodies made as a blind trial: meshes and loads were frozen before any result of flexfmu was looked at."""

from __future__ import annotations

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, Material, box_mesh, merge

from benchmarks.defaults import shapes
from benchmarks.defaults.bodies import PLASTIC, RUBBER, SPRING_STEEL, _bar_body, _straight
from benchmarks.defaults.body import Body, Where, about, above, below, both, either, near, outside, reach
from benchmarks.defaults.branched import section
from benchmarks.defaults.shapes import FloatArray, bar, constant, kept, lines, moved, polyline, ring, tapered, tube

_FEET = Material("FEET", 2e6, 0.4, 1100.0)


def _rounded(body: Body) -> Body:
    """Coordinates without the digits in which processors differ, so that the deck is the same everywhere."""
    mesh = BrickMesh(body.mesh.points.round(12), body.mesh.bricks)
    return Body(body.name, mesh, body.supports, body.interfaces, body.cases, body.material, body.inlay)


def crankshaft() -> Body:
    """Hollow crankshaft of one throw, with interfaces on its free end and in the middle of the pin."""
    way = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.09, 0.0), (0.22, 0.09, 0.0), (0.22, 0.0, 0.0), (0.32, 0.0, 0.0)]
    mesh = tube(polyline(*way, radius=0.03), 40, 8, lambda s: 0.011 + 0.0 * s, 0.004)
    ends = {"free": near(0, 0.32)}
    cases = {"bent": {"free": (0.0, 15400.0, 0.0)}, "out of its plane": {"free": (0.0, 0.0, 14700.0)}}
    return _rounded(Body("crankshaft", mesh, near(0, 0.0), ends, cases))


def bellows() -> Body:
    """Five convolutions of thin wall."""
    mesh = tube(_straight(0.06), 40, 10, lambda s: 0.018 - 0.003 * np.cos(10.0 * np.pi * s), 0.0004)
    cases = {
        "aside": {"tip": (0.0, 2090.0, 0.0)},
        "pulled": {"tip": (8200.0, 2460.0, 0.0)},
        "pressed": {"tip": (-1630.0, 163.0, 0.0)},
    }
    return _rounded(Body("bellows", mesh, near(0, 0.0), {"tip": near(0, 0.06)}, cases))


def leg_spring() -> Body:
    """Coil of one and three quarter turns between two straight legs."""
    turn = np.linspace(0.0, 3.5 * np.pi, 60)
    coil = np.stack([0.012 * np.sin(turn), 0.012 * (1.0 - np.cos(turn)), 0.005 * turn / np.pi], axis=1)
    last = coil[-1] + (coil[-1] - coil[-2]) / np.linalg.norm(coil[-1] - coil[-2]) * 0.05
    points = np.vstack([[-0.03, 0.0, 0.0], coil, last])
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(step)]) / step.sum()

    def path(s: FloatArray) -> FloatArray:
        return np.stack([np.interp(s, at, points[:, axis]) for axis in range(3)], axis=1)

    cases = {"closed": (11.5, 2.29, 0.0), "aside": (0.0, 0.0, 11.2), "both": (-7.48, 0.0, -7.48)}
    return _rounded(_bar_body("leg_spring", path, 54, constant(0.002, 0.0025), cases))


def perforated_plate() -> Body:
    """Thin plate with twelve square holes, held along one edge, loaded at two corners."""
    runs_x = [(0.0, 0.02, 2)]
    runs_y = [(0.0, 0.015, 2)]
    for k in range(4):
        runs_x += [(0.02 + 0.05 * k, 0.05 + 0.05 * k, 2), (0.05 + 0.05 * k, 0.07 + 0.05 * k, 2)]
    for k in range(3):
        runs_y += [(0.015 + 0.045 * k, 0.045 + 0.045 * k, 2), (0.045 + 0.045 * k, 0.06 + 0.045 * k, 2)]
    holes = both(about(0, 0.035 + 0.05 * np.arange(4), 0.015), about(1, 0.03 + 0.045 * np.arange(3), 0.015))
    mesh = kept(box_mesh(lines(*runs_x), lines(*runs_y), lines((0.0, 0.0015, 1))), lambda p: ~holes(p))
    corners = {"near": both(above(0, 0.1999), below(1, 0.0151)), "far": both(above(0, 0.1999), above(1, 0.1349))}
    cases = {
        "bent": {"near": (0.0, 0.0, 39.2), "far": (0.0, 0.0, 39.2)},
        "twisted": {"near": (0.0, 0.0, 293.0), "far": (0.0, 0.0, -293.0)},
        "one corner": {"far": (13.8, -13.8, 69.2)},
    }
    return Body("perforated_plate", mesh, near(0, 0.0), corners, cases)


def bell_crank() -> Body:
    """Coarse lever of tetrahedra with a short and a long arm, held at its corner."""
    grid = box_mesh(
        lines((0.0, 0.02, 1), (0.02, 0.14, 6)), lines((0.0, 0.02, 1), (0.02, 0.09, 4)), lines((0.0, 0.01, 1))
    )
    mesh = shapes.tetrahedral(kept(grid, either(below(0, 0.02), below(1, 0.02))))
    corner = both(below(0, 0.0201), below(1, 0.0201))
    ends = {"long": near(0, 0.14), "short": near(1, 0.09)}
    cases = {
        "long": {"long": (0.0, 1050.0, 0.0)},
        "across": {"long": (0.0, 0.0, 269.0), "short": (0.0, 0.0, -188.0)},
        "aslant": {"long": (0.0, -260.0, 260.0), "short": (371.0, 0.0, 0.0)},
    }
    return Body("bell_crank", mesh, corner, ends, cases, PLASTIC)


def ribbed_sector() -> Body:
    """Thin ring sector of 150 degrees with a rim below and three ribs."""
    turn = lines(*((a, a + 0.05, 1) for a in (0.62, 1.28, 1.94)), (0.0, 0.62, 6), (0.67, 1.28, 6), (1.33, 1.94, 6),
                 (1.99, 2.6, 6))  # fmt: skip
    ribs = about(1, [0.645, 1.305, 1.965], 0.025)
    grid = box_mesh(lines((0.1, 0.102, 1), (0.102, 0.14, 4)), turn, lines((-0.012, 0.0, 2), (0.0, 0.0015, 1)))
    mesh = moved(kept(grid, either(above(2, 0.0), below(0, 0.102), ribs)), shapes.cylindrical)
    last = np.array([np.cos(2.6), np.sin(2.6), 0.0])
    side = np.array([-last[1], last[0], 0.0])
    lip: Where = lambda p: (abs(p @ side) < 1e-7) & (p @ last > 0.0)  # noqa: E731
    cases = {
        "lifted": {"lip": (0.0, 0.0, 163.0)},
        "inwards": {"lip": (573.0, -246.0, 164.0)},
        "opened": {"lip": (-6190.0, 0.0, 0.0)},
    }
    return _rounded(Body("ribbed_sector", mesh, near(1, 0.0), {"lip": lip}, cases))


def press_frame() -> Body:
    """C of a press, held under its back, with both jaws loaded: thick, and softer at the throat."""
    x = lines((0.0, 0.03, 3), (0.03, 0.14, 7))
    y = lines((0.0, 0.02, 2), (0.02, 0.12, 6), (0.12, 0.14, 2))
    mesh = kept(box_mesh(x, y, lines((-0.01, 0.01, 2))), either(below(0, 0.03), below(1, 0.02), above(1, 0.12)))
    jaws = {"low": both(near(0, 0.14), below(1, 0.0201)), "high": both(near(0, 0.14), above(1, 0.1199))}
    cases = {
        "opened": {"low": (0.0, -1500.0, 0.0), "high": (0.0, 1500.0, 0.0)},
        "one jaw": {"high": (0.0, 630.0, 840.0)},
        "sheared": {"low": (0.0, 0.0, 949.0), "high": (0.0, 0.0, -949.0)},
    }
    return Body("press_frame", mesh, both(near(0, 0.0), about(1, [0.07], 0.0168)), jaws, cases, PLASTIC)


def stem_fork() -> Body:
    """Tuning fork on a thin stem: the stem bends, and the tines turn with it."""
    y = lines((-0.02, -0.015, 2), (-0.015, -0.002, 2), (-0.002, 0.002, 2), (0.002, 0.015, 2), (0.015, 0.02, 2))
    x = lines((0.0, 0.06, 6), (0.06, 0.066, 1), (0.066, 0.16, 9))
    stem, tines = both(below(0, 0.06), about(1, [0.0], 0.002)), both(above(0, 0.066), outside(1, 0.015))
    mesh = kept(box_mesh(x, y, lines((-0.003, 0.003, 2))), either(about(0, [0.063], 0.003), either(stem, tines)))
    ends = {"left": both(near(0, 0.16), below(1, 0.0)), "right": both(near(0, 0.16), above(1, 0.0))}
    cases = {
        "together": {"left": (0.0, 112.0, 0.0), "right": (0.0, 112.0, 0.0)},
        "twisted": {"left": (0.0, 0.0, 1110.0), "right": (0.0, 0.0, -1110.0)},
        "pressed": {"left": (-355.0, 17.8, 0.0), "right": (-355.0, 17.8, 0.0)},
    }
    return Body("stem_fork", mesh, near(0, 0.0), ends, cases)


def rod_beside_block() -> Body:
    """Flexible base that carries a stiff block at its end and a slender rod in its middle."""
    x = lines((0.0, 0.058, 5), (0.058, 0.062, 2), (0.062, 0.1, 4), (0.1, 0.14, 2))
    y = lines((0.0, 0.003, 1), (0.003, 0.03, 2), (0.03, 0.1, 7))
    z = lines((-0.012, -0.002, 1), (-0.002, 0.002, 2), (0.002, 0.012, 1))
    rod = both(about(0, [0.06], 0.002), about(2, [0.0], 0.002), above(1, 0.003))
    block = both(above(0, 0.1), below(1, 0.03))
    mesh = kept(box_mesh(x, y, z), either(below(1, 0.003), either(block, rod)))
    ends = {"block": both(near(1, 0.03), above(0, 0.0999)), "rod": near(1, 0.1)}
    cases = {
        "block": {"block": (0.0, 645.0, 0.0)},
        "rod": {"rod": (213.0, 0.0, 213.0)},
        "both": {"block": (0.0, -616.0, 123.0), "rod": (30.8, 0.0, 0.0)},
    }
    return Body("rod_beside_block", mesh, near(0, 0.0), ends, cases)


def gooseneck() -> Body:
    """Slender neck that rises, bows and hangs over."""

    def path(s: FloatArray) -> FloatArray:
        turn = np.pi * np.clip((s - 0.5) / 0.5, 0.0, 1.0)
        rise = np.minimum(s, 0.5) / 0.5
        return np.stack(
            [0.08 * (1.0 - np.cos(turn)), 0.03 * np.sin(turn) ** 2, 0.25 * rise + 0.08 * np.sin(turn)], axis=1
        )

    cases = {"down": (0.0, 0.0, -561.0), "aside": (0.0, 289.0, 0.0), "pulled": (714.0, 214.0, 214.0)}
    return _rounded(
        _bar_body("gooseneck", path, 44, tapered((0.009, 0.009), (0.006, 0.006)), cases, up=[0.2, 1.0, 0.1])
    )


def tweezers() -> Body:
    """Two bowed leaves, joined and held at one end."""

    def leaf(sign: float) -> shapes.Path:
        return lambda s: np.stack(
            [0.11 * s, sign * (0.0012 + 0.009 * np.sin(np.pi * np.clip(s / 0.95, 0.0, 1.0)) ** 2 + 0.004 * s), 0.0 * s],
            1,
        )

    leaves = [bar(leaf(sign), 24, tapered((0.0024, 0.008), (0.001, 0.005))) for sign in (1.0, -1.0)]
    mesh = merge(*leaves)
    ends = {"high": both(above(0, 0.1099), above(1, 0.0)), "low": both(above(0, 0.1099), below(1, 0.0))}
    cases = {
        "closed": {"high": (0.0, -52.2, 0.0), "low": (0.0, 52.2, 0.0)},
        "aside": {"high": (0.0, 0.0, 251.0), "low": (0.0, 0.0, 251.0)},
        "sheared": {"high": (0.0, 49.3, 164.0), "low": (0.0, 49.3, -164.0)},
    }
    return _rounded(Body("tweezers", mesh, below(0, 1e-4), ends, cases))


def box_with_lid() -> Body:
    """Thin-walled box that is held at its bottom, with a lid on one edge."""
    wall = 0.0015
    x = lines((0.0, wall, 1), (wall, 0.1 - wall, 6), (0.1 - wall, 0.1, 1))
    y = lines((0.0, wall, 1), (wall, 0.08 - wall, 5), (0.08 - wall, 0.08, 1))
    z = lines((0.0, wall, 1), (wall, 0.04, 3), (0.04, 0.04 + wall, 1))
    sides = either(either(below(0, wall), above(0, 0.1 - wall)), either(below(1, wall), above(1, 0.08 - wall)))
    low = both(below(2, 0.03), either(sides, below(2, wall)))
    # The lid hangs on one wall; the other walls end an element below it.
    mesh = kept(box_mesh(x, y, z), either(low, either(above(2, 0.04), both(below(0, wall), above(2, 0.0)))))
    lip = both(near(2, 0.04 + wall), above(0, 0.0984))
    cases = {"lifted": {"lid": (0.0, 0.0, 3.12)}, "pushed": {"lid": (4.31, 14.4, -2.87)}}
    return Body("box_with_lid", mesh, near(2, 0.0), {"lid": lip}, cases, PLASTIC)


def cell_lattice() -> Body:
    """Beam of four by two square cells of thin walls."""
    at = 0.02 * np.arange(5)
    x = lines(*((a, a + 0.002, 2) for a in at), *((a + 0.002, a + 0.02, 2) for a in at[:-1]))
    y = lines(*((a, a + 0.002, 2) for a in at[:3]), *((a + 0.002, a + 0.02, 2) for a in at[:2]))
    walls = either(about(0, at + 0.001, 0.001), about(1, at[:3] + 0.001, 0.001))
    mesh = kept(box_mesh(x, y, lines((0.0, 0.006, 1))), walls)
    cases = {
        "bent": {"end": (0.0, 119.0, 0.0)},
        "lifted": {"end": (0.0, 0.0, 30.7)},
        "pressed": {"end": (-90.4, 2.71, 1.81)},
    }
    return Body("cell_lattice", mesh, near(0, 0.0), {"end": near(0, 0.082)}, cases, PLASTIC)


def corrugated_strip() -> Body:
    """Wide strip of four waves."""

    def path(s: FloatArray) -> FloatArray:
        return np.stack([0.16 * s, 0.006 * np.sin(8.0 * np.pi * s), 0.0 * s], axis=1)

    cases = {"pulled": (452.0, 0.0, 0.0), "bent": (0.0, 7.01, 0.0), "twisted aside": (0.0, 6.68, 22.3)}
    return _rounded(_bar_body("corrugated_strip", path, 40, constant(0.0008, 0.03), cases, across=(1, 3)))


def plate_on_feet() -> Body:
    """Stiff plate on three soft feet, an interface above each; CalculiX has no result at full loads."""
    feet = {"a": (0.0, 0.0), "b": (0.1, 0.0), "c": (0.05, 0.08)}

    def foot(place: tuple[float, float]) -> Where:
        low = np.array(place)
        return lambda p: np.all((p[:, :2] > low - 1e-7) & (p[:, :2] < low + 0.0201), axis=1)

    x = lines((0.0, 0.02, 2), (0.02, 0.05, 2), (0.05, 0.07, 2), (0.07, 0.1, 2), (0.1, 0.12, 2))
    y = lines((0.0, 0.02, 2), (0.02, 0.08, 3), (0.08, 0.1, 2))
    every = either(foot(feet["a"]), either(foot(feet["b"]), foot(feet["c"])))
    mesh = kept(box_mesh(x, y, lines((0.0, 0.03, 4), (0.03, 0.036, 1))), either(above(2, 0.03), every))
    tops = {name: both(near(2, 0.036), foot(place)) for name, place in feet.items()}
    cases = {
        "sheared": {"a": (81.4, 0.0, 0.0), "b": (81.4, 0.0, 0.0), "c": (81.4, 0.0, 0.0)},
        "rocked": {"a": (0.0, 0.0, 185.0), "c": (0.0, 0.0, -185.0)},
        "turned": {"a": (0.0, 74.7, 0.0), "b": (0.0, -74.7, 0.0), "c": (74.7, 0.0, -37.3)},
    }
    return Body("plate_on_feet", mesh, near(2, 0.0), tops, cases, inlay=(_FEET, below(2, 0.03)), shares=(0.1, 0.4))


def cam_follower() -> Body:
    """Bowed follower of wedges with a thick pad at its end."""

    def path(s: FloatArray) -> FloatArray:
        return np.stack([0.12 * s, 0.02 * np.sin(np.pi * s), 0.0 * s], axis=1)

    mesh = shapes.wedges(bar(path, 24, lambda s: np.stack([0.004 + 0.008 * s**4, 0.012 + 0.0 * s], axis=1)))
    cases = {"pressed": (-205.0, -683.0, 0.0), "aside": (0.0, 534.0, 1780.0), "lifted": (0.0, 710.0, 0.0)}
    loads = {case: {"pad": force} for case, force in cases.items()}
    return _rounded(Body("cam_follower", mesh, section(path, 0.0), {"pad": section(path, 1.0)}, loads))


def bush() -> Body:
    """Rubber between a steel sleeve that carries loads and a held bore."""
    mesh = ring(lines((0.008, 0.016, 3), (0.016, 0.018, 1)), 16, lines((0.0, 0.03, 4)))
    sleeve = reach(0.018)
    cases = {
        "radial": {"sleeve": (906.0, 0.0, 0.0)},
        "axial": {"sleeve": (0.0, 0.0, 241.0)},
        "both": {"sleeve": (177.0, 0.0, 236.0)},
    }
    steel: Where = lambda p: np.hypot(p[:, 0], p[:, 1]) > 0.016  # noqa: E731
    return Body("bush", mesh, reach(0.008), {"sleeve": sleeve}, cases, RUBBER, (STEEL, steel))


def proving_ring() -> Body:
    """Ring on a foot, with a stud on top: a loop without a second support."""
    flat = ring(lines((0.05, 0.052, 1), (0.052, 0.054, 1)), 32, lines((0.0, 0.01, 2)))
    top = both(reach(0.054), lambda p: p[:, 1] > 0.054 * np.cos(np.pi / 16.0 + 1e-6))
    foot = both(reach(0.054), lambda p: p[:, 1] < -0.054 * np.cos(np.pi / 16.0 + 1e-6))
    cases = {
        "pulled": {"top": (0.0, 18500.0, 0.0)},
        "pressed": {"top": (379.0, -7590.0, 0.0)},
        "aside": {"top": (1060.0, 0.0, 2110.0)},
    }
    return Body("proving_ring", flat, foot, {"top": top}, cases, SPRING_STEEL)


def stirrup() -> Body:
    """Trapezium of flat bar, held in the middle of its short side and loaded on the long one: a loop."""
    t = 0.004
    x = lines((-0.05, -0.05 + t, 2), (-0.05 + t, -0.01, 3), (-0.01, 0.01, 2), (0.01, 0.05 - t, 3), (0.05 - t, 0.05, 2))
    y = lines((0.0, t, 2), (t, 0.1 - t, 9), (0.1 - t, 0.1, 2))
    grid = kept(
        box_mesh(x, y, lines((0.0, 0.008, 2))), either(either(below(1, t), above(1, 0.1 - t)), outside(0, 0.05 - t))
    )
    mesh = moved(grid, lambda p: p * np.stack([0.6 + 4.0 * p[:, 1], 1.0 + 0.0 * p[:, 1], 1.0 + 0.0 * p[:, 1]], axis=1))
    tread = both(near(1, 0.1), lambda p: abs(p[:, 0]) < 0.0101)
    foot = both(near(1, 0.0), lambda p: abs(p[:, 0]) < 0.0061)
    cases = {
        "pulled": {"tread": (0.0, 16200.0, 0.0)},
        "aside": {"tread": (927.0, 0.0, 0.0)},
        "out of its plane": {"tread": (247.0, 0.0, 1230.0)},
    }
    return Body("stirrup", mesh, foot, {"tread": tread}, cases)


def spectacles() -> Body:
    """Two square loops side by side on a bridge that is held, an interface on each."""
    t = 0.002
    x = lines(
        (-0.05, -0.05 + t, 2),
        (-0.05 + t, -0.01 - t, 5),
        (-0.01 - t, -0.01, 2),
        (-0.01, -0.003, 1),
        (-0.003, 0.003, 2),
        (0.003, 0.01, 1),
        (0.01, 0.01 + t, 2),
        (0.01 + t, 0.06 - t, 6),
        (0.06 - t, 0.06, 2),
    )
    y = lines((0.0, t, 2), (t, 0.015, 2), (0.015, 0.018, 2), (0.018, 0.034 - t, 2), (0.034 - t, 0.034, 2))
    left = both(
        lambda p: (p[:, 0] > -0.05) & (p[:, 0] < -0.01),
        either(either(below(1, t), above(1, 0.034 - t)), either(below(0, -0.05 + t), above(0, -0.01 - t))),
    )
    right = both(
        above(0, 0.01), either(either(below(1, t), above(1, 0.034 - t)), either(below(0, 0.01 + t), above(0, 0.06 - t)))
    )
    bridge = both(about(1, [0.0165], 0.0015), about(0, [0.0], 0.01))
    mesh = kept(box_mesh(x, y, lines((0.0, 0.004, 2))), either(left, either(right, bridge)))
    held = both(about(0, [0.0], 0.0031), about(1, [0.0165], 0.0016))
    ends = {"left": near(0, -0.05), "right": near(0, 0.06)}
    cases = {
        "folded": {"left": (0.0, 0.0, 7.54), "right": (0.0, 0.0, 7.54)},
        "pulled": {"left": (-28.8, 0.0, 0.0), "right": (28.8, 8.64, 0.0)},
        "one": {"right": (0.0, 7.34, 3.67)},
    }
    return Body("spectacles", mesh, held, ends, cases, PLASTIC)


UNSEEN = (
    crankshaft, bellows, leg_spring, perforated_plate, bell_crank, ribbed_sector, press_frame, stem_fork,
    rod_beside_block, gooseneck, tweezers, box_with_lid, cell_lattice, corrugated_strip, plate_on_feet, cam_follower,
    bush, proving_ring, stirrup, spectacles,
)  # fmt: skip
