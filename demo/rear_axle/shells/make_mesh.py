"""Mesh of the rear axle of shells and solids, as decks of cars are: writes a model deck.

Axes and parts are those of the axle of bricks (`demo.rear_axle.make_mesh`), but sheets are shells on their middle
surfaces: box-section trailing arms with bulkheads, the U-profile between them, spring trays with ribs. Bushing eyes,
stubs and wheel flanges are solids. At the eyes the sheets reach one element over the solid, so that no hinge is left.

The body is a union of rectangles and boxes on one grid, whose lines run where any of them ends. One number says how
long an element may be. Elements are linear (S4, C3D8I) or quadratic (S8R, C3D20R); a quadratic mesh of twice the length
has the same nodes, but for those within elements.

Run from the repository's root: ``python -m demo.rear_axle.shells.make_mesh [--longest M] [--quadratic] --output FILE``.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.mesh_tools import BRICK_STEPS, NUMBERS_PER_LINE
from demo.rear_axle.make_mesh import STEEL

# Longest edge of a shell, m.
SIZES = {"coarse": 0.015, "full": 0.00325}
# Solids may be so many times as long where no shell shares their edges.
SOLID = 4.0
# Thickness of the arms' sheets and of the cross-beam's, m.
THICKNESS = {"ARM": 0.004, "BEAM": 0.005}

# Middle surfaces and solids, m; y counts outboard from the middle.
ARM_Y, ARM_Z = (0.527, 0.573), 0.033
EYE_X, ARM_END, OVERLAP = 0.025, 0.478, 0.0125
BEAM_X, BEAM_Z = (0.1025, 0.1575), (-0.0285, 0.0285)
SEAT_X, SEAT_Y = (0.282, 0.378), 0.445
STUB_X, STUB_Z = (0.422, 0.478), 0.0285
FLANGE_X, FLANGE_Y, FLANGE_Z = (0.40, 0.50), (0.605, 0.615), 0.05
PIVOT_Y = 0.55
# Three corners of a flange's outer face; with the bushing they span the tetrahedron whose turn is that of the arm.
CORNERS = ((FLANGE_X[0], FLANGE_Z), (FLANGE_X[1], FLANGE_Z), (FLANGE_X[0], -FLANGE_Z))

# Corners and mid-sides of a quad, in half-element steps along its own two axes.
QUAD_STEPS = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [1, 2], [0, 1]])

Range = tuple[float, float]
# Part, normal axis, place along it, ranges along the two other axes.
Sheet = tuple[str, int, float, Range, Range]
Box = tuple[Range, Range, Range]


@dataclass(frozen=True, slots=True)
class ShellAxle:
    """Nodes (n, 3), elements by deck type and part, node sets; indices count from 0."""

    points: np.ndarray
    elements: dict[tuple[str, str], np.ndarray]
    node_sets: dict[str, np.ndarray]


def sheets() -> list[Sheet]:
    """Return the sheets of the half y ≥ 0."""
    tube, section = (EYE_X - OVERLAP, ARM_END), (-ARM_Z, ARM_Z)
    found: list[Sheet] = [("ARM", 1, y, tube, section) for y in ARM_Y]
    found += [("ARM", 2, z, tube, ARM_Y) for z in section]
    found += [("ARM", 0, x, ARM_Y, section) for x in (*BEAM_X, *SEAT_X, *STUB_X)]
    found += [("ARM", 2, -ARM_Z, SEAT_X, (SEAT_Y, ARM_Y[0]))]
    found += [("ARM", 0, x, (SEAT_Y, ARM_Y[0]), (-ARM_Z, 0.0)) for x in SEAT_X]
    found += [("BEAM", 0, x, (0.0, ARM_Y[0]), BEAM_Z) for x in BEAM_X]
    return [*found, ("BEAM", 2, BEAM_Z[1], BEAM_X, (0.0, ARM_Y[0]))]


def boxes() -> list[Box]:
    """Return the solids of the half y ≥ 0: eye, stub, flange."""
    return [
        ((-EYE_X, EYE_X), ARM_Y, (-ARM_Z, ARM_Z)),
        (STUB_X, (ARM_Y[1], FLANGE_Y[0]), (-STUB_Z, STUB_Z)),
        (FLANGE_X, FLANGE_Y, (-FLANGE_Z, FLANGE_Z)),
    ]


def build(longest: float, quadratic: bool = False) -> ShellAxle:
    """Mesh the axle with shells no longer than `longest` (m)."""
    x = {0.0, EYE_X - OVERLAP, ARM_END} | {end for box in boxes() for end in box[0]}
    x |= {end for part in (BEAM_X, SEAT_X) for end in part}
    y = {0.0, SEAT_Y, PIVOT_Y, *ARM_Y, *FLANGE_Y}
    z = {0.0} | {sign * end for end in (ARM_Z, STUB_Z, FLANGE_Z) for sign in (-1.0, 1.0)}
    lines = [
        _lines(x, longest, lambda middle: middle < EYE_X or middle > ARM_END),
        _lines(y, longest, lambda middle: middle > ARM_Y[1]),
        _lines(z, longest, lambda middle: abs(middle) > ARM_Z),
    ]
    lines[1] = np.concatenate([-lines[1][:0:-1], lines[1]])
    steps: dict[tuple[str, str], list[np.ndarray]] = {}
    for part, normal, place, *ranges in sheets():
        for sign in (-1.0, 1.0):
            steps.setdefault(("S8R" if quadratic else "S4", part), []).append(
                _quads(lines, normal, place, ranges, sign)[:, : 8 if quadratic else 4]
            )
    for box in boxes():
        for sign in (-1.0, 1.0):
            cells = _cells(lines, [_mirrored(r, sign) if axis == 1 else r for axis, r in enumerate(box)])
            bricks = (2 * cells[:, None] + BRICK_STEPS)[:, : 20 if quadratic else 8]
            steps.setdefault(("C3D20R" if quadratic else "C3D8I", "SOLID"), []).append(bricks)
    halves = [np.interp(np.arange(2 * line.size - 1) / 2, np.arange(line.size), line) for line in lines]
    joined = {key: np.concatenate(parts) for key, parts in steps.items()}
    # Nodes are numbered along y first, which keeps numbers in a part close.
    every = np.concatenate([part.reshape(-1, 3) for part in joined.values()])[:, [1, 0, 2]]
    kept, number = np.unique(every, axis=0, return_inverse=True)
    points = np.round(np.stack([halves[axis][kept[:, at]] for axis, at in enumerate((1, 0, 2))], axis=1), 9)
    ends = np.cumsum([part.shape[0] * part.shape[1] for part in joined.values()])[:-1]
    numbers = np.split(number.ravel(), ends)
    elements = {key: own.reshape(part.shape[:2]) for (key, part), own in zip(joined.items(), numbers, strict=True)}
    return ShellAxle(points, elements, _node_sets(points, elements))


def write(path: Path, axle: ShellAxle, solids: bool = False) -> None:
    """Write the model deck: nodes, elements with their sections, node sets; `solids`: without shells."""
    text = ["*HEADING", "Twist-beam rear axle of shells and solids. SI units (m, N, kg, s).", "*NODE, NSET=NALL"]
    text += [f"{n}, {p[0]:.9g}, {p[1]:.9g}, {p[2]:.9g}" for n, p in enumerate(axle.points.tolist(), 1)]
    first = 1
    elements = {key: rows for key, rows in axle.elements.items() if key[1] == "SOLID" or not solids}
    for (kind, part), rows in elements.items():
        text.append(f"*ELEMENT, TYPE={kind}, ELSET={part}")
        for number, row in enumerate((rows + 1).tolist(), first):
            values = [number, *row]
            cut = [values[at : at + NUMBERS_PER_LINE - 1] for at in range(0, len(values), NUMBERS_PER_LINE - 1)]
            text.append(",\n".join(", ".join(map(str, piece)) for piece in cut))
        first += len(rows)
    for name, nodes in axle.node_sets.items():
        text.append(f"*NSET, NSET={name}")
        rows = [nodes[at : at + NUMBERS_PER_LINE] for at in range(0, nodes.size, NUMBERS_PER_LINE)]
        text += [", ".join(map(str, (row + 1).tolist())) + "," for row in rows]
    text += [f"*MATERIAL, NAME={STEEL.name}", "*ELASTIC", f"{STEEL.youngs_modulus:g}, {STEEL.poisson_ratio:g}"]
    text += ["*DENSITY", f"{STEEL.density:g}", f"*SOLID SECTION, ELSET=SOLID, MATERIAL={STEEL.name}"]
    for part, thickness in ({} if solids else THICKNESS).items():
        text += [f"*SHELL SECTION, ELSET={part}, MATERIAL={STEEL.name}", f"{thickness:g}"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def _lines(ends: set[float], longest: float, coarse) -> np.ndarray:
    """Grid lines: the ends, and what cuts the ranges between them to the element size."""
    places, found = sorted(ends), []
    for low, high in itertools.pairwise(places):
        size = SOLID * longest if coarse(0.5 * (low + high)) else longest
        found.append(np.linspace(low, high, int(np.ceil((high - low) / size - 1e-9)) + 1)[:-1])
    return np.append(np.concatenate(found), places[-1])


def _mirrored(one: Range, sign: float) -> Range:
    return one if sign > 0.0 else (-one[1], -one[0])


def _between(line: np.ndarray, one: Range) -> np.ndarray:
    """Cells of a grid line within a range."""
    middle = 0.5 * (line[:-1] + line[1:])
    return np.flatnonzero((middle > one[0]) & (middle < one[1]))


def _cells(lines: list[np.ndarray], box: list[Range]) -> np.ndarray:
    chosen = [_between(line, one) for line, one in zip(lines, box, strict=True)]
    return np.stack(np.meshgrid(*chosen, indexing="ij"), axis=-1).reshape(-1, 3)


def _quads(lines: list[np.ndarray], normal: int, place: float, ranges: list[Range], sign: float) -> np.ndarray:
    """Half steps (e, 8, 3) of the nodes of a sheet."""
    plane = [axis for axis in range(3) if axis != normal]
    at = sign * place if normal == 1 else place
    own = [_mirrored(r, sign) if axis == 1 else r for axis, r in zip(plane, ranges, strict=True)]
    cells = np.stack(np.meshgrid(*(_between(lines[a], r) for a, r in zip(plane, own, strict=True)), indexing="ij"), -1)
    result = np.empty((cells.size // 2, 8, 3), dtype=np.int64)
    result[..., plane] = 2 * cells.reshape(-1, 1, 2) + QUAD_STEPS
    result[..., normal] = 2 * int(np.argmin(np.abs(lines[normal] - at)))
    return result


def _node_sets(points: np.ndarray, elements: dict[tuple[str, str], np.ndarray]) -> dict[str, np.ndarray]:
    x, _, z = points.T
    of_beam = np.zeros(len(points), dtype=bool)
    for (_, part), rows in elements.items():
        if part == "BEAM":
            of_beam[rows] = True
    found = {"MID": of_beam & (points[:, 1] == 0.0), "BEAM_NODES": of_beam}
    for side, sign in (("L", -1.0), ("R", 1.0)):
        y = sign * points[:, 1]
        in_tray = (y >= SEAT_Y) & (y <= ARM_Y[0]) & (x >= SEAT_X[0]) & (x <= SEAT_X[1])
        found |= {
            f"PIVOT_{side}": (x == 0.0) & np.isclose(y, PIVOT_Y) & (z == 0.0),
            f"FLANGE_{side}": np.isclose(y, FLANGE_Y[1]),
            f"SEAT_{side}": in_tray & np.isclose(z, -ARM_Z),
            f"ARM_{side}": (y > SEAT_Y - 1e-9) & (~of_beam | np.isclose(y, ARM_Y[0])),
            f"BEAM_{side}": of_beam & (y >= 0.0),
        }
        for number, (along, up) in enumerate(CORNERS):
            outside = np.isclose(y, FLANGE_Y[1])
            found[f"CORNER_{side}{number}"] = outside & np.isclose(x, along) & np.isclose(z, up)
    return {name: np.flatnonzero(inside) for name, inside in found.items()}


def main() -> None:
    """Write a model deck."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--longest", type=float, default=SIZES["coarse"], help="longest edge of a shell, m")
    parser.add_argument("--quadratic", action="store_true", help="S8R and C3D20R in place of S4 and C3D8I")
    parser.add_argument("--output", type=Path, required=True, help="deck to write")
    choice = parser.parse_args()
    axle = build(choice.longest, choice.quadratic)
    write(choice.output, axle)
    counts = ", ".join(f"{len(rows)} {kind} ({part})" for (kind, part), rows in axle.elements.items())
    print(f"{choice.output}: {len(axle.points)} nodes, {counts}")


if __name__ == "__main__":
    main()
