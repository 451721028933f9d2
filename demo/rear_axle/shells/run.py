"""The rear axle of shells and solids: mesh, build, and displacement, toe and camber of the wheels against CalculiX.

Run from the root: ``python -m demo.rear_axle.shells.run [--full] [--output FOLDER]``; --full: as large as an axle of
the literature, of 44 000 shells and 5 000 solids, whose shape is not published. Prints the stages of the builds and
Markdown tables, and draws toe against travel, error against cost, and the sub-domains with their rotations.

References are S8R and C3D20R of CalculiX on meshes of three sizes, the finest with the nodes of the full axle.
"""

from __future__ import annotations

import argparse
import re
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from demo.rear_axle.alignment import LEFT, RIGHT, arm_angle
from demo.rear_axle.full_size import StageRecorder, print_build
from demo.rear_axle.run import WHEELS, FloatArray, Reference, draw, print_table, read_reference, solve
from demo.rear_axle.shells import make_mesh
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.body.recovery import surface_of
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FrameTable, MeshTable
from flexfmu.files.figures import BLUE, GREEN, ORANGE, PINK, SKY, VERMILION, save
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method
from flexfmu.view.picture import camera_along, corner_edges, draw_outline, draw_surface

HERE = Path(__file__).parent
# Direction of the force that the files call only force_N, and words.
CASES = {"left": ("z", "vertical force at the left wheel"), "side": ("y", "side force at the left wheel")}
# Sizes of the references by that of the axle; the chart is of the first.
REFERENCES = {"coarse": ("coarse",), "full": ("full", "middle")}
LINEAR, FLOATING, ROTATED, FRAMES, SECOND = (
    "linear", "one floating frame", "arms as sub-domains", "cut, frames", "cut, second order",
)  # fmt: skip
COLOURS = {LINEAR: "0.5", FLOATING: SKY, ROTATED: ORANGE, FRAMES: PINK, SECOND: GREEN}
SIDES = {"L": (LEFT, BLUE), "R": (RIGHT, ORANGE)}
MARKS, STYLES = {"left": "o", "side": "s"}, {"left": "-", "side": "--"}
# Points by which names of marks that lie close stand above them.
PLACES = {"arms as sub-domains": 5, "one floating frame": -9}
ALONG = {"rotation": 90, "fontsize": "x-small", "color": VERMILION, "va": "top", "ha": "right"}
# Fewer runs of a case say little about its time.
REPEATS = 5


@dataclass(frozen=True, slots=True)
class Cost:
    """An answer to a case: its error in wheel displacement over the largest one, seconds of the processor."""

    case: str
    label: str
    error: float
    seconds: float


def bodies(deck: Path, report: Reporter, folder: Path) -> dict[str, FlexibleBody]:
    """Build the models, and the FMU of the best: as the body file says, and in one piece with the arms' rotations."""
    config = read_body_file(HERE / "body.toml").model_copy(update={"mesh": MeshTable(file=deck)})
    joined = reduce_body(config, report)
    package_fmu(joined, folder / "rear_axle_shells.fmu")
    # Not of the build that is measured.
    whole = reduce_body(with_arms(config), Reporter())
    return {
        LINEAR: FlexibleBody(joined, Method.LINEAR),
        FLOATING: FlexibleBody(whole, Method.FLOATING_FRAME),
        ROTATED: FlexibleBody(whole, Method.MODAL_ROTATION),
        FRAMES: FlexibleBody(joined, Method.FRAMES),
        SECOND: FlexibleBody(joined, Method.SECOND_ORDER),
    }


def with_arms(config: BodyFile) -> BodyFile:
    """The axle in one piece, 20 modes, its arms sub-domains: each turns as bushing and three points of its flange."""
    frames = [
        FrameTable(name=f"arm_{side}", nodes=f"ARM_{side}", rotation_points=[f"CORNER_{side}{k}" for k in range(3)])
        for side in SIDES
    ]
    update: dict[str, object] = {"cut": [], "frame": frames, "frames": None}
    update["reduction"] = config.reduction.model_copy(update={"modes": 20})
    update["formulation"] = config.formulation.model_copy(update={"method": Method.FRAMES})
    return config.model_copy(update=update)


def error(motion: FloatArray, reference: FloatArray) -> float:
    """Displacement of the wheel that is farther off at the last load, over the larger displacement of the two."""
    off = np.linalg.norm(motion[-1, :, :3] - reference[-1, :, :3], axis=1).max()
    return float(off / np.linalg.norm(reference[-1, :, :3], axis=1).max())


def effort(path: Path) -> float:
    """Seconds of the processor in the head of a reference; of the wall's where none are told."""
    found = re.search(
        r"; ([\d.e+]+) s wall time on one core(?:, ([\d.e+]+) of the processor)?", path.read_text("utf-8")
    )
    if found is None:
        raise ValueError(f"{path}: no line on the time in its head")
    return float(found[2] or found[1])


def at_loads_of(finer: Reference, coarser: Reference) -> tuple[FloatArray, FloatArray]:
    """Motion by both of the loads that they share."""
    loads = [np.round(one.forces[WHEELS[0]], 6).tolist() for one in (finer, coarser)]
    shared = [load for load in loads[0] if load in loads[1]]
    first, second = (
        one.motion[[own.index(x) for x in shared]] for one, own in zip((finer, coarser), loads, strict=True)
    )
    return first, second


def compare(size: str, models: dict[str, FlexibleBody], folder: Path) -> list[Cost]:
    """Print tables, draw toe against travel; returns errors and times against the reference of each case."""
    found: list[Cost] = []
    for case, (axis, words) in CASES.items():
        paths = {
            own: path
            for own in ("coarse", *REFERENCES[size])
            if (path := HERE / "calculix" / f"{own}_{case}.csv").exists()
        }
        known = {own: read_reference(path, axis) for own, path in paths.items()}
        motions: dict[str, dict[str, FloatArray]] = {}
        for label, body in models.items():
            for own in REFERENCES[size]:
                if own in known:
                    motions.setdefault(own, {})[label] = solve(body, known[own])
        first = REFERENCES[size][0]
        for own, by_label in motions.items():
            print(f"\n### {words}; CalculiX, {own}")
            print_table(known[own], by_label)
            print_arms(known[own], by_label)
            draw(folder / f"{own}_{case}_toe.png", known[own], by_label, f"{words}; CalculiX, {own}")
        for label, body in models.items():
            begun = time.process_time()
            for _ in range(REPEATS):
                solve(body, known[first])
            seconds = (time.process_time() - begun) / (REPEATS * len(known[first].motion))
            found.append(Cost(case, label, error(motions[first][label], known[first].motion), seconds))
        for own in paths:
            if own != first:
                expected, motion = at_loads_of(known[first], known[own])
                found.append(Cost(case, f"CalculiX, {own}", error(motion, expected), effort(paths[own])))
        found.append(Cost(case, f"CalculiX, {first}", 0.0, effort(paths[first])))
    return found


def draw_costs(path: Path, costs: list[Cost]) -> None:
    """Draw error against seconds of the processor of an equilibrium."""
    figure, panel = plt.subplots(figsize=(7.0, 4.4), layout="constrained")
    for case, (_, words) in CASES.items():
        panel.plot([], [], MARKS[case], color="0.3", fillstyle="none", label=words)
    for label in dict.fromkeys(one.label for one in costs):
        own = [one for one in costs if one.label == label and one.error > 0.0]
        exact = [one for one in costs if one.label == label and one.error == 0.0]
        for one in exact:
            panel.axvline(one.seconds, color=VERMILION, linestyle=STYLES[one.case], linewidth=1.0)
        if exact:
            first, words = min(one.seconds for one in exact), f"{label}: the reference"
            panel.text(first, 0.98, words, transform=panel.get_xaxis_transform(), **ALONG)
        if not own:
            continue
        colour = COLOURS.get(label, VERMILION)
        panel.plot([x.seconds for x in own], [100.0 * x.error for x in own], "-", color=colour, linewidth=0.8)
        for one in own:
            panel.plot(one.seconds, 100.0 * one.error, MARKS[one.case], color=colour, markersize=7)
        last = max(own, key=lambda x: x.error)
        # Beside the mark where there is room: CalculiX's stand at the right, others at the right of the linear one.
        left = colour == VERMILION or label == LINEAR
        place = {"textcoords": "offset points", "fontsize": "small", "color": colour}
        place |= {"xytext": (-8, -3), "ha": "right"} if left else {"xytext": (8, PLACES.get(label, -3))}
        panel.annotate(label, (last.seconds, 100.0 * last.error), **place)
    panel.axhline(1.0, color="0.7", linestyle=":", linewidth=1.0)
    panel.set(xscale="log", yscale="log", xlabel="an equilibrium, seconds of the processor")
    panel.set_ylabel("error of the wheels' displacement / %")
    panel.margins(x=0.12, y=0.15)
    panel.grid(alpha=0.25)
    panel.legend(frameon=False, fontsize="small")
    save(figure, path)


def draw_arms(path: Path, folder: Path) -> None:
    """Draw the sub-domains, and how they turn under the largest vertical force; the coarse axle, with its surface."""
    deck = folder / "rear_axle_shells_coarse.inp"
    make_mesh.write(deck, make_mesh.build(make_mesh.SIZES["coarse"]))
    config = read_body_file(HERE / "body.toml").model_copy(update={"mesh": MeshTable(file=deck)})
    drawn = config.model_copy(update={"output": config.output.model_copy(update={"surface": True})})
    body = FlexibleBody(reduce_body(drawn, Reporter()))
    reference = read_reference(HERE / "calculix" / "coarse_left.csv", "z")
    state, surface = body.static(reference.loads()[-1]), surface_of(body.model)
    camera = camera_along((0.5, 1.0, 0.0), (-0.75, 0.3, 1.0))
    x, y, _ = surface.points.T
    in_tray = (
        (x >= make_mesh.SEAT_X[0] - 0.01) & (x <= make_mesh.SEAT_X[1] + 0.01) & (abs(y) >= make_mesh.SEAT_Y - 0.01)
    )
    arm = (abs(y) >= make_mesh.ARM_Y[0] - 0.006) | in_tray
    tint = np.tile(to_rgb("#b8c2cc"), (len(surface.faces), 1))
    for sign, colour in SIDES.values():
        tint[(arm & (sign * y > 0.0))[surface.faces].all(axis=1)] = to_rgb(colour)
    figure = Figure(figsize=(11.0, 3.3))
    moved, angles = body.surface_positions(state), []
    for k, points in enumerate((surface.points, moved)):
        panel = figure.add_axes((0.01 + 0.5 * k, 0.01, 0.48, 0.86))
        draw_surface(panel, points, surface.faces, camera, tint, edges=False)
        if k:
            edges = corner_edges(surface.points, surface.faces)
            draw_outline(panel, surface.points, edges, camera, "#5b6875", linewidths=0.5)
        for wheel, (side, (sign, _)) in enumerate(SIDES.items()):
            corners = tetrahedron(sign)
            if k:
                _draw_tetrahedron(panel, corners @ camera.T, "0.55")
                response = body.response(state)
                corners = _followed(corners, surface.points, moved)
                angles.append(turned(tetrahedron(sign), corners))
                told = arm_angle(response.rotation[None, wheel])[0]
                print(f"arm {side}: its four points turn by {angles[-1]:.2f}°; the flange about y by {told:.2f}°")
            _draw_tetrahedron(panel, corners @ camera.T, "black")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_axis_off()
        panel.autoscale_view()
    figure.text(0.02, 0.92, "sub-domains: arms, and the points that tell how they turn", fontsize=11)
    words = f"1.8 kN up at the left wheel: arms turn by {angles[0]:.1f}° and {angles[1]:.1f}°"
    figure.text(0.52, 0.92, words, fontsize=11)
    save(figure, path)


def _draw_tetrahedron(panel: Axes, seen: FloatArray, colour: str) -> None:
    """Draw the edges and corners of a tetrahedron (4, 3) in the picture's axes."""
    for a, b in zip(*np.triu_indices(4, 1), strict=True):
        panel.plot(*seen[[a, b], :2].T, "-", color=colour, linewidth=1.1, zorder=8)
    panel.plot(*seen[:, :2].T, "o", color=colour, markersize=4, zorder=9)


def tetrahedron(sign: float) -> FloatArray:
    """Bushing and three corners of the flange (4, 3) of an arm, m."""
    corners = [(x, sign * make_mesh.FLANGE_Y[1], z) for x, z in make_mesh.CORNERS]
    return np.array([(0.0, sign * make_mesh.PIVOT_Y, 0.0), *corners])


def _followed(corners: FloatArray, rest: FloatArray, moved: FloatArray) -> FloatArray:
    """Where corners go with the nearest points of the surface; the bushing, which is inside, is held."""
    nearest = [int(np.argmin(np.linalg.norm(rest - corner, axis=1))) for corner in corners[1:]]
    return np.concatenate([corners[:1], corners[1:] + moved[nearest] - rest[nearest]])


def turned(before: FloatArray, after: FloatArray) -> float:
    """Degrees by which a tetrahedron turns: the polar decomposition of what takes it there."""
    mapped = np.linalg.solve(before[1:] - before[0], after[1:] - after[0]).T
    left, _, right = np.linalg.svd(mapped)
    return float(np.degrees(Rotation.from_matrix(left @ right).magnitude()))


def print_arms(reference: Reference, found: dict[str, FloatArray]) -> None:
    """Print how the arms turn, as bushing and three points of the flange tell it: by CalculiX and by the models."""
    load = max(np.abs(force[-1]).max() for force in reference.forces.values())
    print(f"\n| {load:g} N: rotation of the sub-domains, degrees | left arm | right arm |\n|---|---|---|")
    for label, motion in {"CalculiX": reference.motion, **found}.items():
        angles = []
        for (sign, _), (shift, turn) in zip(SIDES.values(), motion[-1].reshape(2, 2, 3), strict=True):
            corners, centre = tetrahedron(sign), np.array([*_centre(), 0.0]) * [1.0, sign, 1.0]
            moved = Rotation.from_rotvec(turn).apply(corners[1:] - centre) + centre + shift
            angles.append(f"{turned(corners, np.concatenate([corners[:1], moved])):.3f}")
        print(f"| {label} | {' | '.join(angles)} |")


def _centre() -> tuple[float, float]:
    """Middle of a flange's outer face: x, and y outboard, m."""
    return 0.5 * sum(make_mesh.FLANGE_X), make_mesh.FLANGE_Y[1]


def main(size: str, longest: float, folder: Path) -> None:
    """Run all of it."""
    report = StageRecorder()
    deck = folder / "rear_axle_shells.inp"
    with report.stage("Mesh and write the deck"):
        make_mesh.write(deck, make_mesh.build(longest))
    models = bodies(deck, report, folder)
    print(f"{report.notes[0]}\n\n| | s | of the processor, s | peak until then, GiB |\n|---|---|---|---|")
    print_build("build", report)
    costs = compare(size, models, folder)
    print("\n| | error, % | an equilibrium, s of the processor |\n|---|---|---|")
    for one in costs:
        told = f"{100.0 * one.error:.2g}" if one.error else "reference"
        print(f"| {one.label}, {CASES[one.case][1]} | {told} | {one.seconds:.2g} |")
    draw_costs(folder / "rear_axle_shells_costs.png", costs)
    draw_arms(folder / "rear_axle_shells_arms.png", folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="45 942 shells and 6 164 solids in place of 2 708 and 288")
    parser.add_argument("--output", type=Path, default=Path("output/rear_axle_shells"), help="folder for deck and FMU")
    choice = parser.parse_args()
    chosen = "full" if choice.full else "coarse"
    main(chosen, make_mesh.SIZES[chosen], choice.output)
