"""Mesh of a twist-beam rear axle: writes `rear_axle.inp` beside this file, or a finer one elsewhere.

Axes as vehicle builders draw them: x to the rear, y to the right, z up; the origin lies in the middle of the lateral
axis through both bushings. Two box-section trailing arms of steel sheet are joined by an open U-profile. In front each
arm ends in a bushing eye, at the rear it carries a stub with the wheel flange outboard and a tray for the coil spring
inboard; bulkheads stiffen it where these parts and the cross-beam meet it. All sheets are one brick thick.

The body is a union of boxes (`Axle.boxes`). Their faces, cut to the element size, are the lines of one grid, so that
parts share the nodes where they meet. Only the noses of the eyes are rounded afterwards.

Run from the repository's root: ``python -m demo.rear_axle.make_mesh [--size full --output FILE]``.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.mesh_tools import BRICK_STEPS, NUMBERS_PER_LINE, BrickMesh, Material, write_model

from flexfmu.mesh.checks import jacobian_determinants
from flexfmu.mesh.elements import ElementBlock, ElementType

STEEL = Material(name="STEEL", youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)

# Longest edge of an element across no sheet, m.
SIZES = {"coarse": 0.026, "full": 0.0065}

MODEL_FILE = Path(__file__).with_name("rear_axle.inp")

# Pieces of each half of the cross-beam, from the arm to the middle.
PIECES = 4

# Decks hold coordinates to a micrometre.
DIGITS = 6
HALF_STEP = 0.5 * 10.0**-DIGITS

# What an element may look like at worst: longest over shortest edge, and the triple product of the unit edges at a
# corner (1 in a cuboid, 0 where the corner is flat).
WORST_ASPECT = 10.0
WORST_CORNER = 0.4

HEADING = [
    "Twist-beam rear axle: two box-section trailing arms and a U-profile, C3D20R, sheets one element thick.",
    "SI units (m, N, kg, s). x to the rear, y to the right, z up; _L is left (y < 0), _R is right.",
    "Node sets: BUSH_L/R (nodes on the bushing's lateral axis, x = z = 0), PIVOT_L/R (the middle one of them),",
    "EYE_L/R (the bushing's eye), FLANGE_L/R (outboard face of the wheel flange), SEAT_L/R (spring seat), ARM_L/R",
    "(all of an arm), BEAM (the cross-beam), BEAM_L1 ... BEAM_L4 and BEAM_R1 ... (its pieces from the arm to the",
    "middle), MID (the section in its middle). Neighbours share the nodes of their common section. Element sets: EALL,",
    "ARM_L/R, BEAM, BEAM_L1 ... The body is ARM_L, ARM_R and BEAM.",
]

# Corners joined to each corner of a brick, in an order that makes a right-handed triad.
CORNER_TRIADS = np.array(
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]],
)  # fmt: skip

# Lower and upper corner of a box, m.
Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Axle:
    """Dimensions, m; y counts outboard from the middle.

    Attributes
    ----------
    sheet, beam_sheet : float
        Thickness of the arms' sheets and of the cross-beam's.
    arm_y : (float, float)
        Inboard and outboard face of an arm.
    arm_half_height : float
    eye_half_length : float
        Of the block at the arm's front; the bushing's axis is its middle.
    arm_end : float
        x of the arm's rear end.
    wheel_x : float
        x of the wheel's centre.
    stub_half_length, stub_half_height, flange_half_side : float
    flange_y : (float, float)
        Inboard and outboard face of the wheel flange.
    beam_x : (float, float)
        Front and rear face of the cross-beam.
    beam_z : (float, float)
        Its lower, open edge and its top.
    seat_x : (float, float)
        Front and rear end of the spring tray.
    seat_y : float
        Its inboard edge.
    """

    sheet: float = 0.004
    beam_sheet: float = 0.005
    arm_y: tuple[float, float] = (0.525, 0.575)
    arm_half_height: float = 0.035
    eye_half_length: float = 0.025
    arm_end: float = 0.48
    wheel_x: float = 0.45
    stub_half_length: float = 0.03
    stub_half_height: float = 0.026
    flange_half_side: float = 0.05
    flange_y: tuple[float, float] = (0.605, 0.615)
    beam_x: tuple[float, float] = (0.10, 0.16)
    beam_z: tuple[float, float] = (-0.026, 0.031)
    seat_x: tuple[float, float] = (0.28, 0.38)
    seat_y: float = 0.445

    @property
    def tray_z(self) -> tuple[float, float]:
        """Lower and upper face of the spring tray."""
        return -self.arm_half_height, -self.arm_half_height + self.sheet

    def beam_boxes(self) -> list[Box]:
        """Return the boxes of the cross-beam, for y ≥ 0: top, front leg, rear leg."""
        (front, rear), (low, top), t = self.beam_x, self.beam_z, self.beam_sheet
        y = (0.0, self.arm_y[0])
        legs = (low, top - t)
        return [((front, rear), y, (top - t, top)), ((front, front + t), y, legs), ((rear - t, rear), y, legs)]

    def arm_boxes(self) -> list[Box]:
        """Return the boxes of the right arm and of all that it carries."""
        t, h, (inner, outer) = self.sheet, self.arm_half_height, self.arm_y
        eye, tube = (-self.eye_half_length, self.eye_half_length), (self.eye_half_length, self.arm_end)
        stub = (self.wheel_x - self.stub_half_length, self.wheel_x + self.stub_half_length)
        flange = (self.wheel_x - self.flange_half_side, self.wheel_x + self.flange_half_side)
        walls: list[Box] = [
            (tube, (inner, inner + t), (-h, h)),
            (tube, (outer - t, outer), (-h, h)),
            (tube, (inner, outer), (-h, t - h)),
            (tube, (inner, outer), (h - t, h)),
        ]
        slices = [
            (self.beam_x[0], self.beam_x[0] + self.beam_sheet),
            (self.beam_x[1] - self.beam_sheet, self.beam_x[1]),
            (self.seat_x[0], self.seat_x[0] + t),
            (self.seat_x[1] - t, self.seat_x[1]),
            (stub[0], stub[0] + t),
            (stub[1] - t, stub[1]),
        ]
        bulkheads: list[Box] = [(x, (inner, outer), (-h, h)) for x in slices]
        ribs: list[Box] = [(x, (self.seat_y, inner), (self.tray_z[1], 0.0)) for x in slices[2:4]]
        return [
            (eye, (inner, outer), (-h, h)),
            *walls,
            *bulkheads,
            (stub, (outer, self.flange_y[0]), (-self.stub_half_height, self.stub_half_height)),
            (flange, self.flange_y, (-self.flange_half_side, self.flange_half_side)),
            (self.seat_x, (self.seat_y, inner), self.tray_z),
            *ribs,
        ]


@dataclass(frozen=True, slots=True)
class Quality:
    """Worst aspect ratio and worst corner of a mesh."""

    aspect: float
    corner: float


@dataclass(frozen=True, slots=True)
class AxleMesh:
    """The mesh, its node sets and element sets (indices counted from 0), and how good it is."""

    mesh: BrickMesh
    node_sets: dict[str, np.ndarray]
    element_sets: dict[str, np.ndarray]
    quality: Quality


def build(longest: float, axle: Axle | None = None) -> AxleMesh:
    """Mesh the axle with elements no longer than `longest` (m).

    Raises
    ------
    ValueError
        If an element is inverted or worse than `WORST_ASPECT` or `WORST_CORNER`.
    """
    axle = axle or Axle()
    beam, arm = axle.beam_boxes(), axle.arm_boxes()
    # The grid has lines where the bushing's axis runs and in the middle of the cross-beam.
    lines = [
        _lines([edge for box in beam + arm for edge in box[axis]] + [0.0], longest, mirrored=axis == 1)
        for axis in range(3)
    ]
    cells, in_beam = _filled(lines, beam, arm)
    mesh = _bricks(lines, cells)
    mesh = BrickMesh(np.round(_rounded_noses(mesh.points, axle), DIGITS), mesh.bricks)
    element_sets = _element_sets(mesh, in_beam, axle)
    node_sets = _face_sets(mesh, axle) | {name: np.unique(mesh.bricks[e]) for name, e in element_sets.items()}
    return AxleMesh(mesh, node_sets, element_sets, check_quality(mesh))


def check_quality(mesh: BrickMesh) -> Quality:
    """Judge the elements of a mesh.

    Raises
    ------
    ValueError
        As `build` does.
    """
    count = len(mesh.bricks)
    block = ElementBlock(ElementType.C3D20R, np.arange(1, count + 1), mesh.bricks, np.zeros(count, dtype=np.int64))
    inverted = np.flatnonzero(jacobian_determinants(mesh.points, block).min(axis=1) <= 0.0)
    if inverted.size:
        raise ValueError(f"{inverted.size} elements are inverted, first {inverted[0] + 1}: change the dimensions")
    corners = mesh.points[mesh.bricks[:, :8]]
    edges = corners[:, CORNER_TRIADS] - corners[:, :, None]
    length = np.linalg.norm(edges, axis=-1)
    aspect = length.max(axis=(1, 2)) / length.min(axis=(1, 2))
    corner = np.linalg.det(edges / length[..., None]).min(axis=1)
    quality = Quality(float(aspect.max()), float(corner.min()))
    if quality.aspect > WORST_ASPECT or quality.corner < WORST_CORNER:
        worst = corners[np.argmax(aspect) if quality.aspect > WORST_ASPECT else np.argmin(corner)].mean(axis=0)
        raise ValueError(
            f"aspect {quality.aspect:.1f} (at most {WORST_ASPECT}), corner {quality.corner:.2f} (at least "
            f"{WORST_CORNER}); the worst element lies at {np.round(worst, 4)}: change the dimensions or the size"
        )
    return quality


def write(path: Path, axle: AxleMesh) -> None:
    """Write the model deck: nodes, elements, node sets, material, element sets."""
    write_model(path, axle.mesh, axle.node_sets, STEEL, HEADING)
    lines = []
    for name, elements in axle.element_sets.items():
        numbers = np.sort(elements) + 1
        lines.append(f"*ELSET, ELSET={name}")
        rows = np.split(numbers, range(NUMBERS_PER_LINE, numbers.size, NUMBERS_PER_LINE))
        lines += [", ".join(map(str, row)) + "," for row in rows]
    with path.open("a", encoding="ascii") as deck:
        deck.write("\n".join(lines) + "\n")


def _lines(edges: list[float], longest: float, *, mirrored: bool) -> np.ndarray:
    """Grid lines along an axis: the edges, and what cuts the ranges between them to the element size."""
    edges = np.unique(np.round(edges, 9))
    if mirrored:
        edges = np.unique(np.concatenate([-edges, edges]))
    pieces = [
        np.linspace(low, high, int(np.ceil((high - low) / longest - 1e-9)) + 1)[:-1]
        for low, high in itertools.pairwise(edges)
    ]
    return np.append(np.concatenate(pieces), edges[-1])


def _filled(lines: list[np.ndarray], beam: list[Box], arm: list[Box]) -> tuple[np.ndarray, np.ndarray]:
    """Cells (n, 3) of the grid that the boxes fill, counted along y first, and which belong to the cross-beam."""
    x, y, z = ((line[:-1] + line[1:]) / 2 for line in lines)
    y = np.abs(y)

    def inside(boxes: list[Box]) -> np.ndarray:
        filled = np.zeros((y.size, x.size, z.size), dtype=bool)
        for box in boxes:
            within = [(c > low) & (c < high) for c, (low, high) in zip((x, y, z), box, strict=True)]
            filled |= within[1][:, None, None] & within[0][None, :, None] & within[2][None, None, :]
        return filled

    in_beam = inside(beam)
    cells = np.argwhere(in_beam | inside(arm))
    return cells[:, [1, 0, 2]], in_beam[tuple(cells.T)]


def _bricks(lines: list[np.ndarray], cells: np.ndarray) -> BrickMesh:
    """20-node bricks of grid cells (n, 3); nodes are numbered along y first, which keeps numbers in a part close."""
    steps = 2 * cells[:, None, :] + BRICK_STEPS
    size = [2 * line.size - 1 for line in lines]
    key = (steps[..., 1] * size[0] + steps[..., 0]) * size[2] + steps[..., 2]
    kept, bricks = np.unique(key, return_inverse=True)
    place = np.stack([kept // size[2] % size[0], kept // (size[2] * size[0]), kept % size[2]], axis=1)
    halves = [np.interp(np.arange(n) / 2, np.arange(line.size), line) for n, line in zip(size, lines, strict=True)]
    points = np.stack([half[place[:, axis]] for axis, half in enumerate(halves)], axis=1)
    return BrickMesh(points=points, bricks=bricks.reshape(-1, 20))


def _rounded_noses(points: np.ndarray, axle: Axle) -> np.ndarray:
    """Draw the eyes' front corners in towards an ellipse, more the farther in front they lie."""
    size = np.array([axle.eye_half_length, axle.arm_half_height])
    reach = points[:, [0, 2]] / size
    in_front = points[:, 0] < 0.0
    a, b = np.abs(reach[in_front]).T
    share = np.maximum(a, b) / np.hypot(a, b)
    result = points.copy()
    result[np.ix_(in_front, [0, 2])] *= (1.0 + 0.6 * a * (share - 1.0))[:, None]
    return result


def _element_sets(mesh: BrickMesh, in_beam: np.ndarray, axle: Axle) -> dict[str, np.ndarray]:
    y = mesh.centres()[:, 1]
    sides = {"L": y < 0.0, "R": y > 0.0}
    sets = {f"ARM_{side}": np.flatnonzero(~in_beam & on) for side, on in sides.items()}
    sets["BEAM"] = np.flatnonzero(in_beam)
    piece = np.minimum(PIECES * (1.0 - np.abs(y) / axle.arm_y[0]), PIECES - 1).astype(int)
    for side, on in sides.items():
        for number in range(PIECES):
            sets[f"BEAM_{side}{number + 1}"] = np.flatnonzero(in_beam & on & (piece == number))
    return sets


def _face_sets(mesh: BrickMesh, axle: Axle) -> dict[str, np.ndarray]:
    sets = {}
    x, _, z = mesh.points.T
    for side, sign in (("L", -1.0), ("R", 1.0)):
        y = sign * mesh.points[:, 1]
        in_arm = (y >= axle.arm_y[0]) & (y <= axle.arm_y[1])
        low, high = axle.seat_x[0] + axle.sheet - HALF_STEP, axle.seat_x[1] - axle.sheet + HALF_STEP
        in_tray = (x > low) & (x < high) & (y >= axle.seat_y) & (y <= axle.arm_y[0])
        sets |= {
            f"BUSH_{side}": mesh.nodes_where(in_arm & (x == 0.0) & (z == 0.0)),
            f"PIVOT_{side}": mesh.nodes_where(np.isclose(y, sum(axle.arm_y) / 2) & (x == 0.0) & (z == 0.0)),
            f"EYE_{side}": mesh.nodes_where(in_arm & (x <= axle.eye_half_length)),
            f"FLANGE_{side}": mesh.nodes_where(y == axle.flange_y[1]),
            f"SEAT_{side}": mesh.nodes_where(in_tray & np.isclose(z, axle.tray_z[1])),
        }
    sets["MID"] = mesh.nodes_where(mesh.points[:, 1] == 0.0)
    return sets


def main() -> None:
    """Write a model deck."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", choices=SIZES, default="coarse", help="element size (default: coarse)")
    parser.add_argument("--output", type=Path, default=MODEL_FILE, help="deck to write")
    choice = parser.parse_args()
    axle = build(SIZES[choice.size])
    choice.output.parent.mkdir(parents=True, exist_ok=True)
    write(choice.output, axle)
    nodes = len(axle.mesh.points)
    print(f"{choice.output}: {nodes} nodes ({3 * nodes} degrees of freedom), {len(axle.mesh.bricks)} elements,")
    print(f"worst aspect {axle.quality.aspect:.1f}, worst corner {axle.quality.corner:.2f}")


if __name__ == "__main__":
    main()
