"""Every method on every demo body against CalculiX: error of the interfaces' displacements at several loads.

Run from the repository's root: python -m demo.methods [--output FILE.csv]. Prints a Markdown table and writes the
records that it is made of.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.fmu_study import reference
from numpy.typing import NDArray

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import BodyFile, read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import EquilibriumError, OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method, has_frames
from flexfmu.model.reduced_body import ReducedBody

HERE = Path(__file__).parent
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """A load case: a demo body, its CalculiX table, and the direction of the force at each interface."""

    folder: str
    table: str
    title: str
    forces: dict[str, FloatArray]
    column: str
    prefixed: bool = False

    def rows(self) -> Iterator[tuple[float, dict[str, list[float]], FloatArray]]:
        """Load (N), loads by interface, and expected displacements (interfaces, 3), for a third and all of the load."""
        table = reference(HERE / self.folder / "calculix" / f"{self.table}.csv")
        for row in (table[len(table) // 3], table[-1]):
            load = float(abs(row[self.column]))
            prefix = [f"{name}_" if self.prefixed else "" for name in self.forces]
            expected = np.array([[row[f"{p}u{axis}_m"] for axis in "xyz"] for p in prefix])
            yield load, {name: list(load * direction) for name, direction in self.forces.items()}, expected


X, Y, Z = np.eye(3)
CASES = (
    Case("clamped_beam", "static_y", "clamped beam", {"tip": Y}, "force_N"),
    Case("l_frame", "static_z", "L-frame, out of plane", {"tip": Z}, "force_N"),
    Case("l_frame", "static_x", "L-frame, in plane", {"tip": X}, "force_N"),
    Case("clamped_clamped", "static_y", "beam clamped at both ends", {"middle": Y}, "force_N"),
    Case("shallow_arch", "static_y", "shallow arch", {"crown": -Y}, "force_N"),
    Case("shallow_roof", "static_z", "shallow roof", {"crown": -Z}, "force_N"),
    Case("thin_tube", "static_y", "thin tube", {"tip": Y}, "force_N"),
    Case(
        "plate", "static_bend", "plate, bent", {"corner_left": Z, "corner_right": Z}, "corner_left_fz_N", prefixed=True
    ),
    Case(
        "plate", "static_twist", "plate, twisted", {"corner_left": Z, "corner_right": -Z}, "corner_left_fz_N",
        prefixed=True,
    ),
)  # fmt: skip

# Numbers of frames that each method is tried with, in the order of the table.
METHODS: dict[Method, tuple[int, ...]] = {
    Method.LINEAR: (1,),
    Method.STIFFNESS_BY_LOAD: (1,),
    Method.STIFFNESS_BY_MODE: (1,),
    Method.MODAL_ROTATION: (1, 4),
    Method.HALF_ROTATION: (1, 4),
    Method.FLOATING_FRAME: (4,),
    Method.FRAMES: (4, 8),
    Method.FRAMES_STIFFNESS: (4, 8),
    Method.SECOND_ORDER: (1, 2, 4),
}


# Rows that come with residual flexibility, too.
WITH_RESIDUAL = {Method.SECOND_ORDER: (1, 2)}


def label(frames: int, method: Method, residual: bool) -> str:
    """Name of a row of the table."""
    if residual:
        return f"{label(frames, method, False)}, and residual flexibility"
    if not has_frames(method) or method is Method.FLOATING_FRAME:
        return f"`{method.value}`"
    return f"`{method.value}`, {frames} frame{'' if frames == 1 else 's'}"


def reduced(config: BodyFile, frames: int, residual: bool) -> ReducedBody:
    """A body with a number of frames and the data of every method."""
    stored = {
        "geometric_stiffness": ["by_load", "by_mode"],
        "second_order": True,
        "residual_flexibility": residual,
    }
    reduction = config.reduction.model_copy(update=stored)
    return reduce_body(config.model_copy(update={"frames": frames, "reduction": reduction}), Reporter())


def measure() -> list[dict[str, object]]:
    """One record for each method, case and load."""
    records: list[dict[str, object]] = []
    known: dict[tuple[str, int, bool], ReducedBody] = {}
    rows = [(n, method, False) for method, numbers in METHODS.items() for n in numbers]
    rows += [(n, method, True) for method, numbers in WITH_RESIDUAL.items() for n in numbers]
    for case in CASES:
        config = read_body_file(HERE / case.folder / "body.toml")
        for frames, method, residual in rows:
            key = case.folder, frames, residual
            if key not in known:
                known[key] = reduced(config, frames, residual)
            body = FlexibleBody(known[key], method)
            for load, loads, expected in case.rows():
                # Where there is no stable equilibrium the record says so by leaving the error out.
                error: float | None = None
                try:
                    found = body.response(body.static(loads)).displacement
                    order = [body.model.interface_names.index(name) for name in loads]
                    error = float(np.linalg.norm(found[order] - expected) / np.linalg.norm(expected))
                except (EquilibriumError, OptionError):
                    error = None
                records.append(
                    {
                        "body": case.folder,
                        "case": case.title,
                        "load_N": load,
                        "frames": body.model.frame_count,
                        "modes": body.model.mode_count,
                        "method": label(frames, method, residual),
                        "relative_error": "" if error is None else f"{error:.6g}",
                    }
                )
    return records


def percent(error: float) -> str:
    """Two significant digits, without an exponent."""
    value = 100.0 * error
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def table(records: Sequence[Mapping[str, object]]) -> str:
    """Markdown: a row a method, a column a case, errors in % of each load."""
    cases = list(dict.fromkeys(str(record["case"]) for record in records))
    lines = ["| method | " + " | ".join(cases) + " |", "|---" * (len(cases) + 1) + "|"]
    for method in dict.fromkeys(str(record["method"]) for record in records):
        cells = []
        for case in cases:
            errors = [r["relative_error"] for r in records if r["method"] == method and r["case"] == case]
            cells.append(" / ".join("none" if e == "" else percent(float(str(e))) for e in errors))
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=HERE / "methods.csv", help="records, CSV")
    target = parser.parse_args().output
    found = measure()
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(found[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)
    print(table(found))
