"""Curved bars against CalculiX: errors over frames, and over the load, as Markdown tables.

Run from the repository's root: ``python -m demo.curved.run``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.curved.make_mesh import HERE, LINES
from numpy.typing import NDArray

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import MeshTable
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]
DEMO = HERE.parent
FRAMES = (1, 2, 4)


@dataclass(frozen=True, slots=True)
class Case:
    """A body, its mesh and CalculiX's table; `axis` is the direction of a force that the table calls only force_N."""

    title: str
    body: Path
    mesh: Path
    table: Path
    axis: int

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Forces and tip displacements of CalculiX, (n, 3) each, unloaded first."""
        table = np.genfromtxt(self.table, delimiter=",", names=True)
        force = np.zeros((len(table), 3))
        for axis, letter in enumerate("xyz"):
            single = "force_N" if axis == self.axis else ""
            for name in (f"f{letter}_N", single):
                if name in (table.dtype.names or ()):
                    force[:, axis] = table[name]
        return force, np.stack([table[f"u{letter}_m"] for letter in "xyz"], axis=1)

    def reduced(self, frames: int) -> ReducedBody:
        """The body with 10 modes, residual flexibility and a number of frames."""
        config = read_body_file(self.body)
        table = config.reduction.model_copy(update={"modes": 10, "residual_flexibility": True, "second_order": True})
        changes = {"frames": frames, "mesh": MeshTable(file=self.mesh), "reduction": table}
        return reduce_body(config.model_copy(update=changes), Reporter())

    def error(self, body: ReducedBody, method: Method, row: int = -1) -> float:
        """Error of the tip's displacement, of CalculiX's."""
        forces, moved = self.rows()
        model = FlexibleBody(body, method)
        found = model.response(model.static({"tip": list(forces[row])})).displacement[0]
        return float(np.linalg.norm(found - moved[row]) / np.linalg.norm(moved[row]))


def bar(name: str) -> Case:
    """A curved bar."""
    return Case(name.replace("_", " "), HERE / "body.toml", HERE / f"{name}.inp", HERE / "calculix" / f"{name}.csv", 2)


def demo(title: str, folder: str, mesh: str, table: str, axis: int) -> Case:
    """Another demo body."""
    place = DEMO / folder
    return Case(title, place / "body.toml", place / f"{mesh}.inp", place / "calculix" / f"{table}.csv", axis)


CASES = (
    *(bar(name) for name in LINES),
    demo("straight", "clamped_beam", "beam", "static_y", 1),
    demo("L-frame, out of plane", "l_frame", "l_frame", "static_z", 2),
    demo("L-frame, in plane", "l_frame", "l_frame", "static_x", 0),
)


def percent(error: float) -> str:
    """Two significant digits."""
    return f"{100.0 * error:.2g}"


def main() -> None:
    """Print both tables."""
    print(
        "| body (largest displacement, m) | linear | frames alone: 1 | 2 | 4 | second order: 1 | 2 | 4 |"
        + "\n"
        + "|---" * 8
        + "|"
    )
    for case in CASES:
        bodies = [case.reduced(frames) for frames in FRAMES]
        errors = [case.error(bodies[0], Method.LINEAR)]
        errors += [case.error(body, method) for method in (Method.FRAMES, Method.SECOND_ORDER) for body in bodies]
        size = np.linalg.norm(case.rows()[1][-1])
        print(f"| {case.title} ({size:.2f}) | " + " | ".join(map(percent, errors)) + " |", flush=True)
    print(
        "\n| body | frames | at 0.3 of the load | half | all of it | frames alone: 0.3 | half | all |"
        + "\n"
        + "|---" * 8
        + "|"
    )
    for name in ("s_curve", "s_curve_tetrahedra"):
        case = bar(name)
        for frames in (1, 2, 3, 4, 5, 6, 8):
            body = case.reduced(frames)
            cells = [case.error(body, m, row) for m in (Method.SECOND_ORDER, Method.FRAMES) for row in (3, 5, 10)]
            print(f"| {case.title} | {frames} | " + " | ".join(map(percent, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
