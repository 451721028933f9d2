"""Ten bodies of a second blind trial, a kind each: frozen before any result of flexfmu was seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, Material, box_mesh

from benchmarks.defaults import shapes
from benchmarks.defaults.bodies import PLASTIC, SPRING_STEEL, _bar_body
from benchmarks.defaults.body import Body, about, above, below, both, either, near
from benchmarks.defaults.branched import section
from benchmarks.defaults.shapes import FloatArray, bar, constant, kept, lines, moved, tapered
from benchmarks.defaults.unseen import _rounded
from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.formats import read_mesh

_ALUMINIUM = Material("ALUMINIUM", 7e10, 0.33, 2700.0)


def sickle() -> Body:
    """Curved: a blade of 200 degrees that rises and tapers."""

    def path(s: FloatArray) -> FloatArray:
        turn = np.radians(200.0) * s
        return np.stack([0.08 * np.sin(turn), 0.08 * (1.0 - np.cos(turn)), 0.05 * s**2], axis=1)

    cases = {"opened": (-214.0, -64.2, 0.0), "lifted": (0.0, 49.6, 248.0), "aslant": (225.0, 0.0, -225.0)}
    return _rounded(_bar_body("sickle", path, 40, tapered((0.006, 0.01), (0.003, 0.006)), cases))


def fan_blade() -> Body:
    """Thin: a cambered sheet that narrows and twists by 40 degrees, loaded at both corners of its tip."""
    grid = box_mesh(np.linspace(0.0, 1.0, 17), np.linspace(-0.5, 0.5, 7), np.array([-0.5, 0.5]))

    def place(points: FloatArray) -> FloatArray:
        s, across, out = points.T
        wide, turn = (0.07 - 0.03 * s) * across, np.radians(40.0) * s
        camber = 0.006 * (1.0 - 4.0 * across**2) + 0.0008 * out
        return np.stack(
            [0.25 * s, wide * np.cos(turn) - camber * np.sin(turn), wide * np.sin(turn) + camber * np.cos(turn)], axis=1
        )

    tip = both(above(0, 0.2499), lambda p: np.ones(len(p), dtype=bool))
    cases = {
        "flapped": {"tip": (0.0, -26.3, 21.9)},
        "pushed": {"tip": (0.0, 6.11, 7.36)},
        "pulled aslant": {"tip": (39.1, -11.7, 11.7)},
    }
    return _rounded(Body("fan_blade", moved(grid, place), below(0, 1e-9), {"tip": tip}, cases, _ALUMINIUM))


def candelabra() -> Body:
    """Branched: a stem, and three arms of other lengths that leave it in three directions and turn up."""
    z = lines((0.0, 0.07, 5), (0.07, 0.078, 1), (0.078, 0.11, 3), (0.11, 0.118, 1), (0.118, 0.16, 4))
    x = lines((-0.084, -0.076, 1), (-0.076, -0.004, 6), (-0.004, 0.004, 2), (0.004, 0.052, 4), (0.052, 0.06, 1))
    y = lines((-0.004, 0.004, 2), (0.004, 0.062, 5), (0.062, 0.07, 1))
    stem = both(about(0, [0.0], 0.004), both(about(1, [0.0], 0.004), below(2, 0.118)))
    thin = both(about(1, [0.0], 0.004), about(2, [0.074], 0.004))
    left = either(
        both(thin, below(0, 0.0)), both(about(0, [-0.08], 0.004), both(about(1, [0.0], 0.004), above(2, 0.07)))
    )
    right = either(
        both(both(about(1, [0.0], 0.004), about(2, [0.114], 0.004)), above(0, 0.0)),
        both(about(0, [0.056], 0.004), both(about(1, [0.0], 0.004), above(2, 0.11))),
    )
    back = both(about(0, [0.0], 0.004), about(2, [0.114], 0.004))
    mesh = kept(box_mesh(x, y, z), either(either(stem, left), either(right, back)))
    ends = {
        "left": both(near(2, 0.16), below(0, 0.0)),
        "right": both(near(2, 0.16), above(0, 0.0)),
        "back": near(1, 0.07),
    }
    cases = {
        "one": {"left": (0.0, 11.3, 0.0)},
        "all": {"left": (9.71, 0.0, -4.85), "right": (9.71, 4.85, 0.0), "back": (9.71, 0.0, -4.85)},
        "against": {"right": (0.0, -11.7, 3.5), "back": (0.0, 4.66, 11.7)},
    }
    return Body("candelabra", mesh, near(2, 0.0), ends, cases, PLASTIC)


def mallet() -> Body:
    """Stiff beside soft: a head of steel on a handle of plastic, with a thicker grip."""
    x = lines((0.0, 0.02, 3), (0.02, 0.16, 9), (0.16, 0.2, 3))
    y = lines((-0.04, -0.007, 3), (-0.007, 0.007, 2), (0.007, 0.04, 3))
    z = lines((-0.012, -0.005, 1), (-0.005, 0.005, 2), (0.005, 0.012, 1))
    handle = both(about(1, [0.0], 0.007), about(2, [0.0], 0.005))
    head = above(0, 0.16)
    grip = both(below(0, 0.02), about(1, [0.0], 0.007))
    mesh = kept(box_mesh(x, y, z), either(head, either(handle, grip)))
    ends = {"face": near(1, 0.04), "peen": near(1, -0.04)}
    cases = {
        "struck": {"face": (0.0, -67.6, 20.3)},
        "levered": {"peen": (0.0, 0.0, 50.6)},
        "wrung": {"face": (0.0, 0.0, 161.0), "peen": (0.0, 0.0, -161.0)},
    }
    return Body("mallet", mesh, near(0, 0.0), ends, cases, PLASTIC, (STEEL, above(0, 0.16)))


def rake_head() -> Body:
    """Many interfaces: a rail that is held at one end, with an interface on each of eight fingers."""
    at = 0.02 + 0.03 * np.arange(8)
    runs = [(0.0, 0.018, 2), *((a - 0.002, a + 0.002, 1) for a in at), *((a + 0.002, a + 0.028, 2) for a in at[:-1])]
    y = lines((0.0, 0.006, 2), (0.006, 0.05, 5))
    mesh = kept(box_mesh(lines(*runs), y, lines((-0.002, 0.002, 2))), either(below(1, 0.006), about(0, at, 0.002)))
    ends = {f"finger{k}": both(near(1, 0.05), about(0, [a], 0.00201)) for k, a in enumerate(at)}
    cases = {
        "all": dict.fromkeys(ends, (0.0, 0.0, 8.17)),
        "combed": {f"finger{k}": (9.37 * (-1.0) ** (k + 1), 0.0, 0.937 * k) for k in range(8)},
        "two": {"finger2": (0.0, 0.0, -70.2), "finger7": (35.1, 70.2, 21.1)},
    }
    return Body("rake_head", mesh, near(0, 0.0), ends, cases, _ALUMINIUM)


def wish_fork() -> Body:
    """Tetrahedral: a Y with a bent prong and a straight one."""
    grid = box_mesh(
        lines((0.0, 0.06, 5), (0.06, 0.07, 1), (0.07, 0.15, 7)),
        lines((-0.03, -0.022, 1), (-0.022, -0.004, 2), (-0.004, 0.004, 1), (0.004, 0.014, 1), (0.014, 0.022, 1)),
        lines((0.0, 0.006, 1)),
    )
    prongs = both(above(0, 0.07), either(below(1, -0.022), above(1, 0.014)))
    mesh = kept(grid, either(both(below(0, 0.06), about(1, [0.0], 0.004)), either(about(0, [0.065], 0.005), prongs)))
    bent = moved(mesh, lambda p: p + np.outer(40.0 * np.maximum(p[:, 0] - 0.07, 0.0) ** 3, [0.0, 0.0, 1.0]))
    mesh = shapes.tetrahedral(bent)
    ends = {"low": both(above(0, 0.1499), below(1, 0.0)), "high": both(above(0, 0.1499), above(1, 0.0))}
    cases = {
        "together": {"low": (0.0, 0.0, 7.32), "high": (0.0, 0.0, 7.32)},
        "spread": {"low": (0.0, -24.0, 4.81), "high": (0.0, 24.0, 4.81)},
        "twisted": {"low": (0.0, 0.0, 19.8), "high": (0.0, 0.0, -19.8)},
    }
    return _rounded(Body("wish_fork", mesh, near(0, 0.0), ends, cases, PLASTIC))


def scoop() -> Body:
    """Shells: a trough that widens; the reference is of solids. Aside (2820 N) CalculiX buckled at 0.38 of the load."""

    def place(s: FloatArray, b: FloatArray, out: FloatArray) -> FloatArray:
        reach, turn = 0.025 + 0.015 * s + out, np.radians(75.0) - np.radians(150.0) * b
        return np.stack([0.5 * s, reach * np.sin(turn), -reach * np.cos(turn)], axis=1)

    solid = moved(
        box_mesh(np.linspace(0.0, 1.0, 29), np.linspace(0.0, 1.0, 11), np.array([-0.001, 0.001])),
        lambda p: place(p[:, 0], p[:, 1], p[:, 2]),
    )
    flat = box_mesh(np.linspace(0.0, 1.0, 29), np.linspace(0.0, 1.0, 11), np.array([0.0, 1.0]))
    # The lower faces of the bricks, in the order of an eight-node shell.
    quads = flat.bricks[:, [0, 1, 2, 3, 8, 9, 10, 11]]
    nodes, cells = np.unique(quads, return_inverse=True)
    points = flat.points[nodes]
    own = _deck(place(points[:, 0], points[:, 1], 0.0 * points[:, 0]).round(12), cells.reshape(quads.shape), "S8R")
    own += "*SHELL SECTION, ELSET=E_STEEL, MATERIAL=STEEL\n0.002\n"
    own += _sets(HELD=np.isclose(points[:, 0], 0.0), TIP=np.isclose(points[:, 0], 1.0))
    cases = {
        "pressed": {"tip": (0.0, 0.0, -2160.0)},
        "lifted": {"tip": (0.0, 0.0, 1440.0)},
    }
    body = Body("scoop", solid, near(0, 0.0), {"tip": near(0, 0.5)}, cases, STEEL)
    return replace(_rounded(body), own=own)


def wire() -> Body:
    """Beams: a wire along an S in space; the reference is of solids."""

    def path(s: FloatArray) -> FloatArray:
        return np.stack([0.6 * s, 0.08 * np.sin(2.0 * np.pi * s), 0.1 * s**2], axis=1)

    mesh, at = bar(path, 64, constant(0.006, 0.006)), path(np.linspace(0.0, 1.0, 65)).round(12)
    own = _deck(at, np.column_stack([2 * np.arange(32), 2 * np.arange(32) + 1, 2 * np.arange(32) + 2]), "B32")
    own += "*BEAM SECTION, ELSET=E_STEEL, MATERIAL=STEEL, SECTION=RECT\n0.006, 0.006\n0., 0., 1.\n"
    own += _sets(HELD=np.arange(65) == 0, TIP=np.arange(65) == 64)
    cases = {
        "aside": {"tip": (0.0, 41.3, 0.0)},
        "lifted": {"tip": (-6.83, 6.83, 34.1)},
        "pulled": {"tip": (58.0, 5.8, -5.8)},
    }
    body = Body("wire", mesh, section(path, 0.0), {"tip": section(path, 1.0)}, cases, STEEL)
    return replace(_rounded(body), own=own)


def snap_ring() -> Body:
    """Free: an open ring between two forces along the line of its ends, in balance at any load.

    Pushed it turns round: the reference, held at its back, is no stable equilibrium of the free one.
    """
    angle = np.radians(300.0)
    grid = box_mesh(lines((0.03, 0.034, 2)), np.linspace(-0.5 * angle, 0.5 * angle, 37), lines((-0.002, 0.002, 2)))
    mesh = moved(grid, lambda p: shapes.cylindrical(np.stack([p[:, 0], p[:, 1], p[:, 2]], axis=1)))
    lips = {
        "low": lambda p: np.isclose(np.arctan2(p[:, 1], p[:, 0]), -0.5 * angle),
        "high": lambda p: np.isclose(np.arctan2(p[:, 1], p[:, 0]), 0.5 * angle),
    }
    cases = {
        "opened": {"low": (0.0, -580.0, 0.0), "high": (0.0, 580.0, 0.0)},
        "pushed": {"low": (0.0, 279.0, 0.0), "high": (0.0, -279.0, 0.0)},
    }
    back = both(near(1, 0.0), lambda p: p[:, 0] > 0.0)
    return replace(_rounded(Body("snap_ring", mesh, back, lips, cases, SPRING_STEEL)), free=True)


def lug() -> Body:
    """Curved tetrahedra of gmsh, kept as a deck: an arm with a bore, two fillets and a turned end."""
    mesh = read_mesh(Path(__file__).with_name("lug.inp"), UnitSystem.SI)
    tetrahedra = np.concatenate([block.connectivity for block in mesh.blocks])
    cases = {
        "down": {"end": (0.0, 0.0, -134.0)},
        "aside": {"end": (0.0, 141.0, 0.0)},
        "aslant": {"end": (-165.0, 137.0, -165.0)},
    }
    brick = BrickMesh(mesh.points, tetrahedra)
    return Body("lug", brick, near(0, 0.0), {"end": near(2, 0.06)}, cases, PLASTIC)


def _deck(points: FloatArray, cells: FloatArray, kind: str) -> str:
    """Nodes, elements and steel of a deck."""
    out = ["*NODE", *(f"{i}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(points, 1))]
    out += [f"*ELEMENT, TYPE={kind}, ELSET=E_STEEL"]
    out += [", ".join(map(str, [i, *(row + 1)])) for i, row in enumerate(cells, 1)]
    return "\n".join([*out, "*MATERIAL, NAME=STEEL", "*ELASTIC", "2e11, 0.3", "*DENSITY", "7850", ""])


def _sets(**chosen: FloatArray) -> str:
    """Node sets of conditions (n,)."""
    return "".join(
        f"*NSET, NSET={name}\n" + "".join(f"{i + 1},\n" for i in np.flatnonzero(at)) for name, at in chosen.items()
    )


FRESH = (sickle, fan_blade, candelabra, mallet, rake_head, wish_fork, scoop, wire, snap_ring, lug)
