"""Demo bodies in three dimensions, bent far: linear modes and flexfmu, beside CalculiX; the pictures of the README.

Run from the repository's root: python -m demo.pictures [--output FOLDER]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from demo.fmu_study import reference
from demo.outlines import outline_file
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.body.recovery import surface_of
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import IntArray
from flexfmu.reduction.surface import face_normals
from flexfmu.view.picture import camera_along, corner_edges, draw_outline, draw_surface

HERE = Path(__file__).parent
FloatArray = NDArray[np.float64]
LINEAR, FLEXFMU, CALCULIX, GHOST = "#aab0b8", "#009e73", "#d55e00", "#5b6875"


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A body under one load case of CalculiX.

    Attributes
    ----------
    name, title : str
        Of the picture.
    folder, table : str
        Demo, and its table of CalculiX results; the last row counts.
    forces : dict of str to (3,) float
        N, by interface.
    right, up : (3,) float
        Directions of the picture.
    frames : int
    files : (str, str)
        Body file of flexfmu, and of linear modes.
    prefixed : bool
        Whether the table's columns begin with the interface's name.
    """

    name: str
    title: str
    folder: str
    table: str
    forces: dict[str, tuple[float, float, float]]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    frames: int = 2
    files: tuple[str, str] = ("body.toml", "body.toml")
    prefixed: bool = False

    def expected(self) -> FloatArray:
        """CalculiX's displacements of the loaded interfaces (i, 3), m."""
        row = reference(HERE / self.folder / "calculix" / f"{self.table}.csv")[-1]
        prefix = [f"{name}_" if self.prefixed else "" for name in self.forces]
        return np.array([[row[f"{p}u{axis}_m"] for axis in "xyz"] for p in prefix])


SCENES = (
    Scene(
        "beam", "Beam of 1 m, 20 kN at its tip", "clamped_beam", "static_y", {"tip": (0.0, 20e3, 0.0)},
        (0.97, 0.0, -0.25), (-0.05, 1.0, -0.1),
    ),
    Scene(
        "l_frame", "L-frame, 2 kN out of its plane", "l_frame", "static_z", {"tip": (0.0, 0.0, 2e3)},
        (0.8, 0.6, 0.0), (-0.25, 0.3, 1.0),
    ),
    Scene(
        "plate", "Plate of 3 mm, 2 × 440 N at its corners", "plate", "static_bend",
        {"corner_left": (0.0, 0.0, 440.0), "corner_right": (0.0, 0.0, 440.0)},
        (0.9, -0.45, 0.0), (0.2, 0.4, 1.0), frames=1, prefixed=True,
    ),
    Scene(
        "arc", "Arc of 45°, 25 kN across its plane", "curved", "arc_45", {"tip": (0.0, 0.0, 25e3)},
        (0.75, 0.66, 0.0), (-0.3, 0.4, 1.0),
    ),
    Scene(
        "axle", "Twist-beam axle, wheels ± 2.4 kN", "rear_axle", "opposite",
        {"wheel_left": (0.0, 0.0, 2.4e3), "wheel_right": (0.0, 0.0, -2.4e3)},
        (0.5, 1.0, 0.0), (-0.75, 0.3, 1.0), files=("body.toml", "body_whole.toml"), prefixed=True,
    ),
)  # fmt: skip


@cache
def models(scene: Scene) -> tuple[FlexibleBody, FlexibleBody]:
    """Bodies of flexfmu and of linear modes, with their surfaces."""

    def built(file: str) -> BodyFile:
        config = read_body_file(HERE / scene.folder / file)
        update: dict[str, object] = {"output": config.output.model_copy(update={"surface": True})}
        if not config.frame:
            update["frames"] = scene.frames
        update["formulation"] = config.formulation.model_copy(update={"method": Method.SECOND_ORDER})
        return config.model_copy(update=update)

    bent = reduce_body(built(scene.files[0]), Reporter())
    whole = bent if len(set(scene.files)) == 1 else reduce_body(built(scene.files[1]), Reporter())
    return FlexibleBody(bent, Method.SECOND_ORDER), FlexibleBody(whole, Method.LINEAR)


def draw(scene: Scene, panel: Any) -> tuple[float, float]:
    """Draw a scene with its errors of the loaded interfaces' displacement, linear and flexfmu, in %."""
    loads = {name: list(force) for name, force in scene.forces.items()}
    camera, expected = camera_along(scene.right, scene.up), scene.expected()
    errors = []
    bent, linear = models(scene)
    rest = surface_of(linear.model)
    own = corner_edges(rest.points, rest.faces)
    draw_outline(panel, rest.points, own, camera, GHOST)
    for body, colour, order in ((linear, LINEAR, 2.0), (bent, FLEXFMU, 3.0)):
        state, faces = body.static(loads), surface_of(body.model).faces
        tint = np.tile(to_rgb(colour), (len(faces), 1))
        moved = body.surface_positions(state)
        if body is linear:
            own = _in_front(moved, faces, own, camera)
        draw_surface(panel, moved, faces, camera, tint, edges=False, order=order)
        index = [body.model.interface_names.index(name) for name in loads]
        found = body.response(state).displacement[index]
        errors.append(float(100.0 * np.linalg.norm(found - expected) / np.linalg.norm(expected)))
    table = np.genfromtxt(outline_file(f"{scene.folder}/{scene.table}"), delimiter=",", skip_header=1)
    row = cKDTree(table[:, :3]).query(rest.points)[1]
    solved = table[:, :3][row] + table[:, 3:][row]
    draw_outline(panel, solved, own, camera, CALCULIX, linewidths=0.8, zorder=4.0)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_axis_off()
    panel.margins(0.04)
    panel.autoscale_view()
    panel.set_title(f"{scene.title}\nerror: linear {errors[0]:.2g} %, flexfmu {errors[1]:.2g} %", fontsize=12)
    return errors[0], errors[1]


def _in_front(points: FloatArray, faces: IntArray, edges: IntArray, camera: FloatArray) -> IntArray:
    """Edges (e, 2) of those faces that look at the eye."""
    near = faces[face_normals(points, faces) @ camera[2] > 0.0]
    sides = np.sort(np.stack([near, np.roll(near, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return edges[(edges[:, None] == sides).all(axis=2).any(axis=1)]


def legend(figure: Figure, columns: int) -> None:
    """Legend below the panels."""
    axes = figure.axes[0]
    handles = [
        axes.plot([], [], "-", color=GHOST, lw=1.0, label="undeformed")[0],
        axes.plot([], [], "s", color=LINEAR, ms=9, label="linear modes")[0],
        axes.plot([], [], "s", color=FLEXFMU, ms=9, label="flexfmu")[0],
        axes.plot([], [], "-", color=CALCULIX, lw=1.6, label="CalculiX: edges")[0],
    ]
    figure.legend(handles=handles, loc="lower center", ncols=columns, frameon=False, fontsize=12)


def main(folder: Path) -> None:
    """Draw all scenes: one picture of three bodies, and one for each."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = [scene for scene in SCENES if scene.name in ("beam", "plate", "axle")]
    figure = Figure(figsize=(11.0, 3.1))
    for k, scene in enumerate(shown):
        draw(scene, figure.add_axes((0.01 + 0.33 * k, 0.1, 0.31, 0.74)))
    legend(figure, 4)
    figure.savefig(folder / "bodies.png", dpi=130, bbox_inches="tight")
    for scene in SCENES:
        figure = Figure(figsize=(7.5, 5.0))
        draw(scene, figure.add_axes((0.02, 0.14, 0.96, 0.74)))
        legend(figure, 2)
        figure.savefig(folder / f"body_{scene.name}.png", dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output/pictures"))
    main(parser.parse_args().output)
