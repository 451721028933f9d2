"""Eight bodies alive in the browser: one page each, in which the pointer takes an interface and pulls.

Run from the repository's root, with flexfmu[platforms]: python -m demo.live [NAME ...] [--output FOLDER]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

import flexfmu

HERE = Path(__file__).parent


def of_deck(file: str, supports: list[str], interfaces: dict[str, str], **more: bool) -> flexfmu.Body:
    """A body of one of the demos' decks, with the defaults of the shortest body file."""
    path = HERE / file
    return flexfmu.Body(
        flexfmu.read_mesh(path), supports=supports, interfaces=interfaces, name=path.stem, damping=0.02, **more
    )


def gutter() -> flexfmu.Body:
    """Half a pipe of shells, 0.6 m long and 1.5 mm thick."""
    along, around = np.meshgrid(np.linspace(0.0, 0.6, 31), np.linspace(0.0, np.pi, 13), indexing="ij")
    points = np.column_stack([along.ravel(), 0.04 * np.cos(around).ravel(), -0.04 * np.sin(around).ravel()])
    first = (13 * np.arange(30)[:, None] + np.arange(12)).ravel()
    cells = {"quad": np.column_stack([first, first + 13, first + 14, first + 1])}
    mesh = flexfmu.shell_mesh(points, cells, 0.0015, ROOT=np.arange(13), TIP=390 + np.arange(13))
    return flexfmu.Body(mesh, (2.1e11, 0.3, 7850.0), ["ROOT"], {"tip": "TIP"}, name="gutter", damping=0.02)


BODIES: dict[str, Callable[[], flexfmu.Body]] = {
    "beam": lambda: of_deck("clamped_beam/beam.inp", ["ROOT"], {"tip": "TIP"}),
    "l_frame": lambda: of_deck("l_frame/l_frame.inp", ["ROOT"], {"tip": "TIP"}),
    "plate": lambda: flexfmu.Body.read(HERE / "plate/body.toml"),
    "arch": lambda: of_deck("shallow_arch/shallow_arch.inp", ["ROOT", "FAR"], {"crown": "CROWN"}),
    "coil_spring": lambda: of_deck("curved/helix.inp", ["ROOT"], {"tip": "TIP"}),
    "gutter": gutter,
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
        print(BODIES[name]().build().view(live=True).save(arguments.output / f"{name}.html"))


if __name__ == "__main__":
    main()
