"""Bodies of published static problems: meshes of C3D20R, in SI units.

`python -m benchmarks.field.run_calculix` writes their decks to ``bodies/`` and CalculiX's results to ``calculix/``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, Material, box_mesh, merge, write_model
from demo.shallow_arch import make_mesh
from numpy.typing import NDArray

from flexfmu.build.config import BodyFile
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.model.reduced_body import ReducedBody

FOLDER = Path(__file__).parent
DEMO = make_mesh.MODEL_FILE.parent
INCH, POUND = 0.0254, 4.4482216152605

FloatArray = NDArray[np.float64]
Sets = dict[str, NDArray[np.bool_]]
# From points (n, 3) of a box to those of the body.
Placing = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Body:
    """A body of a problem.

    Attributes
    ----------
    name : str
    title : str
        What it is, for the deck.
    mesh : BrickMesh
    sets : dict of str to (n_nodes,) bool
        Node sets by name.
    material : Material
    interface : str
        The set that is loaded; its interface has the name in small letters.
    supports : tuple of str
        Sets that are held in all directions: a line of nodes is a hinge.
    kept : Path, optional
        A deck that stands elsewhere.
    """

    name: str
    title: str
    mesh: BrickMesh
    sets: Sets
    material: Material
    interface: str = "TIP"
    supports: tuple[str, ...] = ("ROOT",)
    kept: Path | None = None

    @property
    def deck(self) -> Path:
        """Where the model deck is kept."""
        return self.kept or FOLDER / "bodies" / f"{self.name}.inp"

    def write(self) -> Path:
        """Write the model deck."""
        self.deck.parent.mkdir(exist_ok=True)
        sets = {name: self.mesh.nodes_where(chosen) for name, chosen in self.sets.items()}
        held = " and ".join(self.supports)
        write_model(self.deck, self.mesh, sets, self.material, [f"{self.title}. SI units. Held: {held}."])
        return self.deck

    def reduced(self, frames: int, modes: int = 10, **tables: object) -> ReducedBody:
        """Reduced body with normal modes and residual flexibility, as in `reduced_deck`."""
        content = {
            "name": self.name,
            "mesh": {"file": self.deck},
            "support": [{"nodes": name, "fix": ["x", "y", "z"]} for name in self.supports],
            "interface": [{"name": self.interface.lower(), "nodes": self.interface}],
            "frames": frames,
            "reduction": {"modes": modes, "residual_flexibility": True, "second_order": True},
            "output": {"surface": False},
        }
        return reduce_body(BodyFile.model_validate(content | tables), Reporter())


def bar(cells: tuple[int, int, int], length: float, height: float, width: float) -> tuple[BrickMesh, Sets]:
    """Bar along x, centred across, with the sets ROOT and TIP and the lines ROOT_LINE and TIP_LINE across z."""
    sizes = ((0.0, length), (-0.5 * height, 0.5 * height), (-0.5 * width, 0.5 * width))
    mesh = box_mesh(*(np.linspace(*size, n + 1) for size, n in zip(sizes, cells, strict=True)))
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    root, tip, line = np.isclose(x, 0.0), np.isclose(x, length), np.isclose(y, 0.0)
    return mesh, {"ROOT": root, "TIP": tip, "ROOT_LINE": root & line, "TIP_LINE": tip & line}


def placed(mesh: BrickMesh, placing: Placing) -> BrickMesh:
    """The mesh with its points moved."""
    return BrickMesh(placing(mesh.points), mesh.bricks)


@cache
def bend() -> Body:
    """Bathe's bend: an eighth of a circle of 100 in, 1 in x 1 in, in the x-y plane; it begins along y."""
    radius = 100.0 * INCH
    mesh, sets = bar((24, 2, 2), radius * np.pi / 4.0, INCH, INCH)

    def arc(points: FloatArray) -> FloatArray:
        angle, reach = points[:, 0] / radius, radius + points[:, 1]
        return np.stack([radius - reach * np.cos(angle), reach * np.sin(angle), points[:, 2]], axis=1)

    material = Material("M1", 1e7 * POUND / INCH**2, 0.0, 7850.0)
    return Body(
        "bend", "Bend of 45 degrees, radius 100 in, 1 in x 1 in, C3D20R 24 x 2 x 2", placed(mesh, arc), sets, material
    )


@cache
def strip() -> Body:
    """Cantilever of 1 m, a hundred times as long as high, without Poisson's effect.

    It is wide enough to stay in its plane: a square one leaves it when a moment has rolled it up by 300°.
    """
    mesh, sets = bar((40, 2, 2), 1.0, 0.01, 0.03)
    return Body(
        "strip", "Cantilever, 1 m x 10 mm x 30 mm, C3D20R 40 x 2 x 2", mesh, sets, Material("M1", 2e11, 0.0, 7850.0)
    )


@cache
def princeton() -> Body:
    """The Princeton beam: 508 mm x 12.3777 mm (y) x 3.2024 mm (z), aluminium 7075."""
    mesh, sets = bar((32, 2, 2), 0.508, 12.3777e-3, 3.2024e-3)
    title = "Princeton beam, 508 mm x 12.3777 mm x 3.2024 mm, C3D20R 32 x 2 x 2"
    return Body("princeton", title, mesh, sets, Material("M1", 71.7e9, 0.31, 2810.0))


@cache
def right_angle() -> Body:
    """Argyris' frame: legs of 240 mm along x and y, 30 mm high in the plane, 0.6 mm thick."""
    leg, height = 0.24, 0.03
    across, thick = np.linspace(-0.5 * height, 0.5 * height, 3), np.linspace(-3e-4, 3e-4, 2)
    first = box_mesh(np.linspace(0.0, leg - 0.5 * height, 13), across, thick)
    corner = box_mesh(leg + across, across, thick)
    second = box_mesh(leg + across, np.linspace(0.5 * height, leg, 13), thick)
    mesh = merge(first, corner, second)
    sets = {"ROOT": np.isclose(mesh.points[:, 0], 0.0), "TIP": np.isclose(mesh.points[:, 1], leg)}
    title = "Right-angle frame, legs of 240 mm, 30 mm x 0.6 mm, C3D20R, 12 + 12 along the legs"
    return Body("right_angle", title, mesh, sets, Material("M1", 71240e6, 0.31, 2700.0))


@cache
def lee() -> Body:
    """Lee's frame: legs of 1.2 m, 20 mm high, hinged at both ends, loaded 240 mm from the corner.

    It is 120 mm wide where the source has 30 mm, so that it stays in its plane.
    """
    leg, half, load = 1.2, 0.01, 0.24
    across, wide = np.linspace(-half, half, 3), np.linspace(-0.06, 0.06, 3)
    column = box_mesh(across, np.linspace(0.0, leg - half, 21), wide)
    corner = box_mesh(across, leg + across, wide)
    x = np.concatenate([np.linspace(half, load, 5), np.linspace(load, leg, 17)[1:]])
    mesh = merge(column, corner, box_mesh(x, leg + across, wide))
    foot = np.isclose(mesh.points[:, 1], 0.0) & np.isclose(mesh.points[:, 0], 0.0)
    far = np.isclose(mesh.points[:, 0], leg) & np.isclose(mesh.points[:, 1], leg)
    sets = {"FOOT": foot, "FAR": far, "LOAD": np.isclose(mesh.points[:, 0], load)}
    title = "Lee's frame, legs of 1.2 m, 20 mm x 120 mm, C3D20R, 20 + 20 along the legs"
    return Body("lee", title, mesh, sets, Material("M1", 72e9, 0.3, 2700.0), "LOAD", ("FOOT", "FAR"))


def _risen(mesh: BrickMesh, span: float, rise: float) -> BrickMesh:
    """A bar along x of length 1 as an arc of a circle over a span, its sections at right angles to it."""
    radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
    half = np.arcsin(0.5 * span / radius)

    def arc(points: FloatArray) -> FloatArray:
        angle, reach = half * (2.0 * points[:, 0] - 1.0), radius + points[:, 1]
        return np.stack(
            [0.5 * span + reach * np.sin(angle), reach * np.cos(angle) - radius + rise, points[:, 2]], axis=1
        )

    return placed(mesh, arc)


@cache
def hinged_arch() -> Body:
    """Shallow arch on two hinges: span 1 m, rise 18 mm, section 20 mm high and 40 mm wide."""
    mesh, sets = bar((40, 2, 2), 1.0, 0.02, 0.04)
    crown = {"CROWN": np.isclose(mesh.points[:, 0], 0.5)}
    title = "Hinged arch, span 1 m, rise 18 mm, 20 mm x 40 mm, C3D20R 40 x 2 x 2"
    material = Material("M1", 2e11, 0.0, 7850.0)
    return Body(
        "hinged_arch", title, _risen(mesh, 1.0, 0.018), sets | crown, material, "CROWN", ("ROOT_LINE", "TIP_LINE")
    )


@cache
def clamped_arch() -> Body:
    """The demo's clamped arch."""
    mesh, sets = make_mesh.build()
    chosen = {name: np.isin(np.arange(len(mesh.points)), nodes) for name, nodes in sets.items()}
    return Body("clamped_arch", "", mesh, chosen, STEEL, "CROWN", ("ROOT", "FAR"), make_mesh.MODEL_FILE)


@cache
def hinged_roof() -> Body:
    """Sabir and Lock's cylindrical roof: radius 2.54 m, 0.2 rad, 508 mm long, 12.7 mm thick, straight edges hinged."""
    radius, angle, length, thickness = 2.54, 0.1, 0.508, 0.0127
    grid = np.linspace(-0.5 * length, 0.5 * length, 13)
    flat = box_mesh(np.linspace(-angle, angle, 13), grid, np.linspace(-0.5 * thickness, 0.5 * thickness, 3))
    turn, along, out = flat.points.T
    points = np.stack([(radius + out) * np.sin(turn), along, (radius + out) * np.cos(turn) - radius], axis=1)
    middle, line = np.isclose(turn, 0.0), np.isclose(out, 0.0)
    sets = {
        "LEFT": np.isclose(turn, -angle) & line,
        "RIGHT": np.isclose(turn, angle) & line,
        "CROWN": middle & (np.abs(along) < 1.01 * (grid[1] - grid[0])),
    }
    title = "Hinged roof, radius 2.54 m, 508 mm square, 12.7 mm thick, C3D20R 12 x 12 x 2"
    material = Material("M1", 3102.75e6, 0.3, 2000.0)
    return Body("hinged_roof", title, BrickMesh(points, flat.bricks), sets, material, "CROWN", ("LEFT", "RIGHT"))


# Bending stiffness of the strip and of Lee's frame, N m².
STRIP, LEE = 2e11 * 0.03 * 0.01**3 / 12.0, 72e9 * 0.12 * 0.02**3 / 12.0
BODIES = (bend, strip, princeton, right_angle, lee, hinged_arch, hinged_roof)
