"""Eight bodies alive in the browser: one page each, in which the pointer takes an interface and pulls.

Run from the repository's root: python -m demo.live [NAME ...] [--output FOLDER]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from demo.mesh_tools import box_mesh

import flexfmu

HERE = Path(__file__).parent
STEEL = (2.1e11, 0.3, 7850.0)
AXLE_MODES = 6


def of_deck(file: str, supports: list[str], interfaces: dict[str, str], **more: bool) -> flexfmu.Body:
    """A body of one of the demos' decks, with the defaults of the shortest body file."""
    path = HERE / file
    return flexfmu.Body(
        flexfmu.read_mesh(path), supports=supports, interfaces=interfaces, name=path.stem, damping=0.02, **more
    )


def coil_spring() -> flexfmu.Body:
    """Four turns of a square wire, held at the lower end."""
    turns, radius, wire, pitch = 4, 0.04, 0.009, 0.022
    across = np.array([-0.5 * wire, 0.5 * wire])
    mesh = box_mesh(np.linspace(0.0, turns, 20 * turns + 1), across, across)
    turn, outward, upward = 2.0 * np.pi * mesh.points[:, 0], *mesh.points[:, 1:, None].swapaxes(0, 1)
    out = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    rise = pitch / (2.0 * np.pi) / radius
    along = np.column_stack([-out[:, 1], out[:, 0], np.full_like(turn, rise)]) / np.hypot(1.0, rise)
    points = (radius + outward) * out + upward * np.cross(along, out)
    points[:, 2] += pitch * mesh.points[:, 0]
    ends = (mesh.nodes_where(np.isclose(mesh.points[:, 0], end)) for end in (0.0, turns))
    root, tip = ends
    return flexfmu.Body((points, mesh.bricks), STEEL, [root], {"tip": tip}, name="coil_spring", damping=0.02)


def leaf() -> flexfmu.Body:
    """A bent, tapered leaf of shells, 4 mm thick."""
    along, across = np.meshgrid(np.linspace(0.0, 1.0, 31), np.linspace(-0.06, 0.06, 7), indexing="ij")
    angle, radius = np.radians(70.0) * along, 0.5
    width = across * (1.0 - 0.5 * along)
    points = np.stack([radius * np.sin(angle), width, radius * (1.0 - np.cos(angle))], axis=-1).reshape(-1, 3)
    first = (7 * np.arange(30)[:, None] + np.arange(6)).ravel()
    cells = {"quad": np.column_stack([first, first + 7, first + 8, first + 1])}
    mesh = flexfmu.shell_mesh(points, cells, 0.004, ROOT=np.arange(7), TIP=210 + np.arange(7))
    return flexfmu.Body(mesh, STEEL, ["ROOT"], {"tip": "TIP"}, name="leaf", damping=0.02)


BODIES: dict[str, Callable[[], flexfmu.Body]] = {
    "beam": lambda: of_deck("clamped_beam/beam.inp", ["ROOT"], {"tip": "TIP"}),
    "l_frame": lambda: of_deck("l_frame/l_frame.inp", ["ROOT"], {"tip": "TIP"}),
    "plate": lambda: of_deck("plate/plate.inp", ["ROOT"], {"left": "CORNER_LEFT", "right": "CORNER_RIGHT"}),
    "arch": lambda: of_deck("shallow_arch/shallow_arch.inp", ["ROOT", "FAR"], {"crown": "CROWN"}),
    "coil_spring": coil_spring,
    "leaf": leaf,
    "bar": lambda: of_deck("clamped_beam/beam.inp", [], {"root": "ROOT", "tip": "TIP"}, free=True),
    "axle": lambda: flexfmu.Body.read(HERE / "rear_axle/body.toml"),
}


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(BODIES), help="of " + ", ".join(BODIES))
    parser.add_argument("--output", type=Path, default=HERE.parent / "live", help="default: live/")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.names:
        body = BODIES[name]().build(modes=AXLE_MODES if name == "axle" else None, stress=True)
        print(body.view(live=True).save(arguments.output / f"{name}.html"), flush=True)


if __name__ == "__main__":
    main()
