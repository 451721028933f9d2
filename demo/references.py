"""Reference results of a demo body: each case writes its CalculiX deck, runs it and keeps the result as CSV.

In the CSV files the first line names the columns, with their units, and the lines after it that begin with
``#`` say what was computed. ``numpy.genfromtxt(path, delimiter=",", names=True)`` reads them.

- Static cases: ``force_N`` (or ``fx_N, fy_N, fz_N`` if more than one component acts), then the motion of the
  tip face: mean displacement ``ux_m, uy_m, uz_m`` and rotation vector ``rx_rad, ry_rad, rz_rad``.
- ``frequencies.csv``: ``mode, frequency_Hz``.
- Transients: ``time_s``, then the motion of the tip face.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo import calculix_tools as ccx
from demo.tip_face import MOTION_COLUMNS, TipFace

FACE_NOTES = [
    "u: mean displacement of the tip face, weighted by the consistent nodal forces of a uniform traction",
    "(the work conjugate of the force).",
]
ROTATION_NOTE = "r: rotation vector of the tip section, least-squares rigid fit of the nodes, equal weights."
SMALL_ROTATION_NOTE = "r: small rotation of the tip section, linear least-squares fit of the face's nodes."


@dataclass(frozen=True, slots=True)
class ReferenceBody:
    """A demo body as CalculiX sees it.

    Attributes
    ----------
    model : Path
        Its model deck, with the node sets ROOT (clamped) and TIP.
    folder : Path
        Where decks and results go; beside the model deck.
    tip : TipFace
        Face that bears the loads.
    mesh_note : str
        The mesh in a few words, for the comments of the results.
    """

    model: Path
    folder: Path
    tip: TipFace
    mesh_note: str

    def static(self, name: str, force: tuple[float, float, float], increments: int) -> None:
        """Nonlinear statics under a dead tip force that grows to `force` (N) in equal increments."""
        title = f"Nonlinear statics, dead tip force growing to {_newtons(force)}"
        deck = ccx.static_deck(self.model, self.tip, np.array(force), increments, title)
        run = self._run(name, deck)
        parts, displacements = ccx.read_displacements(run.printed, len(self.tip.nodes))
        motion = np.vstack([np.zeros(6), self.tip.motion(displacements)])
        # Adding zero makes a negative zero positive.
        loads = np.concatenate([[0.0], parts])[:, None] * np.array(force) + 0.0
        self._write_static(name, loads, motion, [*self._notes(title, run), *FACE_NOTES, ROTATION_NOTE])

    def linear(self, name: str, force: tuple[float, float, float]) -> None:
        """Linear statics under the tip force `force` (N): one row."""
        title = f"Linear statics, tip force {_newtons(force)}"
        run = self._run(name, ccx.linear_deck(self.model, self.tip, np.array(force), title))
        _, displacements = ccx.read_displacements(run.printed, len(self.tip.nodes))
        motion = self.tip.linear_motion(displacements)
        notes = [*self._notes(title, run), *FACE_NOTES, SMALL_ROTATION_NOTE]
        self._write_static(name, np.array([force]), motion, notes)

    def frequencies(self, name: str, count: int) -> None:
        """Lowest `count` eigenfrequencies of the clamped, unloaded body."""
        title = f"Lowest {count} eigenfrequencies, clamped and unloaded"
        run = self._run(name, ccx.frequency_deck(self.model, count, title))
        found = ccx.read_frequencies(run.printed)
        rows = np.column_stack([np.arange(1, found.size + 1), found])
        _write_table(self.folder / f"{name}.csv", ["mode", "frequency_Hz"], rows, self._notes(title, run))

    def sudden_load(
        self, name: str, force: tuple[float, float, float], step: float, duration: float, keep_every: int
    ) -> None:
        """Undamped nonlinear transient from rest under the sudden dead tip force `force` (N).

        Times in s. Of the computed steps, every `keep_every`-th is kept in the result.
        """
        title = f"Nonlinear transient, undamped, sudden dead tip force {_newtons(force)}, from rest"
        deck = ccx.sudden_load_deck(self.model, self.tip, np.array(force), step, duration, title)
        run = self._run(name, deck)
        _, displacements = ccx.read_displacements(run.printed, len(self.tip.nodes))
        motion = np.vstack([np.zeros(6), self.tip.motion(displacements)])
        times = step * np.arange(len(motion))
        rows = np.column_stack([times, motion])[::keep_every]
        method = f"Trapezoidal rule (ALPHA=0), fixed step {step:g} s, every {keep_every}. step kept"
        notes = [*self._notes(title, run), method, *FACE_NOTES, ROTATION_NOTE]
        _write_table(self.folder / f"{name}.csv", ["time_s", *MOTION_COLUMNS], rows, notes)

    def _run(self, name: str, deck: str) -> ccx.Run:
        path = self.folder / f"{name}.inp"
        path.write_text(deck, encoding="ascii")
        return ccx.run_ccx(path, self.model)

    def _notes(self, title: str, run: ccx.Run) -> list[str]:
        return [
            title,
            f"CalculiX {ccx.ccx_version()}, {self.mesh_note}; {run.seconds:.3g} s wall time on one core",
        ]

    def _write_static(self, name: str, loads: np.ndarray, motion: np.ndarray, notes: list[str]) -> None:
        acting = np.flatnonzero(loads.any(axis=0))
        columns = ["force_N"] if acting.size == 1 else [f"f{'xyz'[axis]}_N" for axis in acting]
        rows = np.hstack([loads[:, acting], motion])
        _write_table(self.folder / f"{name}.csv", [*columns, *MOTION_COLUMNS], rows, notes)


def run_cases(cases: dict[str, Callable[[str], None]], description: str) -> None:
    """Run the cases named on the command line, or all; each is called with its name."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("case", nargs="*", help=f"any of {', '.join(cases)} (default: all)")
    names = parser.parse_args().case or list(cases)
    unknown = sorted(set(names) - set(cases))
    if unknown:
        parser.error(f"unknown case {', '.join(unknown)}: choose from {', '.join(cases)}")
    for name in names:
        cases[name](name)


def _newtons(force: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{component:g}" for component in force) + ") N"


def _write_table(path: Path, columns: list[str], rows: np.ndarray, notes: list[str]) -> None:
    lines = [",".join(columns), *(f"# {note}" for note in notes)]
    # CalculiX prints seven digits; one more keeps the rounding of the means from adding to theirs.
    lines += [",".join(f"{value:.8g}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{path}: {len(rows)} rows")
