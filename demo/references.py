"""Reference results of a demo body: each case writes its CalculiX deck, runs it and keeps the result as CSV.

In the CSV files the first line names the columns, with their units, and the lines after it that begin with
``#`` say what was computed. ``numpy.genfromtxt(path, delimiter=",", names=True)`` reads them.

- Static cases: ``force_N`` (or ``fx_N, fy_N, fz_N`` if more than one component acts), then the motion of the
  interface: mean displacement ``ux_m, uy_m, uz_m`` and rotation vector ``rx_rad, ry_rad, rz_rad``. On a body with
  several interfaces each column but ``force_N`` begins with the interface's name: ``corner_left_ux_m``.
- ``frequencies.csv``: ``mode, frequency_Hz``. ``axial_frequencies.csv``: ``force_N, f1_Hz, f2_Hz, …``.
- ``buckling.csv``: ``mode, force_N``.
- Transients: ``time_s``, then the motion of the interface.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo import calculix_results as results, calculix_tools as ccx
from demo.tip_face import MOTION_COLUMNS

# Force of each loaded interface, N.
Forces = dict[str, tuple[float, float, float]]

ROTATION_NOTE = "r: rotation vector of the same face, least-squares rigid fit of the nodes, equal weights."
SMALL_ROTATION_NOTE = "r: small rotation of the same face, linear least-squares fit of the nodes."


@dataclass(frozen=True, slots=True)
class ReferenceBody:
    """A demo body as CalculiX sees it.

    Attributes
    ----------
    model : Model
        Its model deck, the faces of its interfaces and its supports.
    folder : Path
        Where decks and results go; beside the model deck.
    mesh_note : str
        The mesh in a few words, for the comments of the results.
    """

    model: ccx.Model
    folder: Path
    mesh_note: str

    def static(self, name: str, forces: Forces, increments: int) -> None:
        """Nonlinear statics under dead forces that grow to `forces` in equal increments."""
        title = f"Nonlinear statics, dead {_in_words(forces, 'growing to ')}"
        run = self._run(name, ccx.static_deck(self.model, _as_arrays(forces), increments, title))
        parts, motion = self._motion(run)
        parts, motion = np.concatenate([[0.0], parts]), np.vstack([np.zeros(motion.shape[1]), motion])
        # Adding zero makes a negative zero positive.
        loads = {interface: np.outer(parts, force) + 0.0 for interface, force in forces.items()}
        self._write_static(name, loads, motion, [*self._notes(title, run), *self._face_notes(), ROTATION_NOTE])

    def linear(self, name: str, forces: Forces) -> None:
        """Linear statics under `forces`: one row."""
        title = f"Linear statics, {_in_words(forces)}"
        run = self._run(name, ccx.linear_deck(self.model, _as_arrays(forces), title))
        _, motion = self._motion(run, linear=True)
        loads = {interface: np.array([force]) for interface, force in forces.items()}
        self._write_static(name, loads, motion, [*self._notes(title, run), *self._face_notes(), SMALL_ROTATION_NOTE])

    def path(self, name: str, interface: str, axis: int, displacement: float, increments: int) -> None:
        """Nonlinear statics led by the mean displacement (m) of an interface along an axis (0, 1, 2).

        The force that goes with it is that of a uniform traction; unstable equilibria beyond a limit point included.
        """
        title = f"Nonlinear statics, mean displacement u{'xyz'[axis]} of the {interface} face led to {displacement:g} m"
        run = self._run(name, ccx.path_deck(self.model, interface, axis, displacement, increments, title))
        _, motion = self._motion(run)
        motion = np.vstack([np.zeros(motion.shape[1]), motion])
        force = np.zeros((len(motion), 3))
        force[1:, axis] = -sum(results.read_reaction(run.printed, support)[:, axis] for support in self.model.supports)
        notes = [*self._notes(title, run), "force: that of a uniform traction, in equilibrium, stable or not"]
        self._write_static(name, {interface: force}, motion, [*notes, *self._face_notes(), ROTATION_NOTE])

    def frequencies(self, name: str, count: int) -> None:
        """Lowest `count` eigenfrequencies of the clamped, unloaded body."""
        title = f"Lowest {count} eigenfrequencies, clamped and unloaded"
        run = self._run(name, ccx.frequency_deck(self.model, count, title))
        found = results.read_frequencies(run.printed)[0]
        rows = np.column_stack([np.arange(1, found.size + 1), found])
        _write_table(self.folder / f"{name}.csv", ["mode", "frequency_Hz"], rows, self._notes(title, run))

    def preloaded_frequencies(self, name: str, interface: str, axis: int, sizes: Sequence[float], count: int) -> None:
        """Lowest `count` eigenfrequencies about equilibria under dead forces of given sizes (N) along an axis."""
        title = f"Lowest {count} eigenfrequencies about the nonlinear equilibrium under a dead {interface} force"
        title += f" along {'xyz'[axis]}"
        preloads = [{interface: size * np.eye(3)[axis]} for size in sizes]
        run = self._run(name, ccx.preloaded_frequency_deck(self.model, preloads, count, title))
        columns = ["force_N", *(f"f{mode}_Hz" for mode in range(1, count + 1))]
        rows = np.column_stack([sizes, results.read_frequencies(run.printed)])
        _write_table(self.folder / f"{name}.csv", columns, rows, self._notes(title, run))

    def buckling(self, name: str, interface: str, axis: int, size: float, count: int) -> None:
        """Lowest `count` critical forces along an axis, linear; `size` (N) sets their sign and scale."""
        title = f"Linear buckling, lowest {count} critical forces on {interface} along {'xyz'[axis]}"
        run = self._run(name, ccx.buckling_deck(self.model, {interface: size * np.eye(3)[axis]}, count, title))
        factors = results.read_buckling_factors(run.printed)
        rows = np.column_stack([np.arange(1, factors.size + 1), size * factors])
        _write_table(self.folder / f"{name}.csv", ["mode", "force_N"], rows, self._notes(title, run))

    def sudden_load(self, name: str, forces: Forces, step: float, duration: float, keep_every: int) -> None:
        """Undamped nonlinear transient from rest under sudden dead forces.

        Times in s. Of the computed steps, every `keep_every`-th is kept in the result.
        """
        title = f"Nonlinear transient, undamped, sudden dead {_in_words(forces)}, from rest"
        deck = ccx.sudden_load_deck(self.model, _as_arrays(forces), step, duration, title)
        self._transient(name, title, deck, step, keep_every)

    def shaken(
        self, name: str, forces: Forces, hertz: float, step: float, duration: float, keep_every: int, drawn: float
    ) -> None:
        """The same under dead forces that go with the sine of a frequency, drawn by straight lines `drawn` s long."""
        title = f"Nonlinear transient, undamped, dead {_in_words(forces)} times sin(2 pi {hertz:g} t), from rest"
        times = drawn * np.arange(round(duration / drawn) + 1)
        course = np.column_stack([times, np.sin(2.0 * np.pi * hertz * times)])
        deck = ccx.transient_deck(self.model, _as_arrays(forces), course, step, duration, title)
        self._transient(name, title, deck, step, keep_every)

    def _transient(self, name: str, title: str, deck: str, step: float, keep_every: int) -> None:
        run = self._run(name, deck)
        _, motion = self._motion(run)
        motion = np.vstack([np.zeros(motion.shape[1]), motion])
        times = step * np.arange(len(motion))
        rows = np.column_stack([times, motion])[::keep_every]
        method = f"Trapezoidal rule (ALPHA=0), fixed step {step:g} s, every {keep_every}. step kept"
        notes = [*self._notes(title, run), method, *self._face_notes(), ROTATION_NOTE]
        _write_table(self.folder / f"{name}.csv", ["time_s", *self._motion_columns()], rows, notes)

    def _motion(self, run: ccx.Run, *, linear: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Step times (n,) and the motion of all interfaces (n, 6 per interface) of a run."""
        columns = []
        for interface, face in self.model.faces.items():
            times, displacements = results.read_displacements(run.printed, interface)
            columns.append(face.linear_motion(displacements) if linear else face.motion(displacements))
        return times, np.hstack(columns)

    def _run(self, name: str, deck: str) -> ccx.Run:
        path = self.folder / f"{name}.inp"
        path.write_text(deck, encoding="ascii")
        return ccx.run_ccx(path, self.model)

    def _notes(self, title: str, run: ccx.Run) -> list[str]:
        return [
            title,
            f"CalculiX {ccx.ccx_version()}, {self.mesh_note}; {run.seconds:.3g} s wall time on one core",
        ]

    def _face_notes(self) -> list[str]:
        faces = self.model.faces
        which = f"the {next(iter(faces))} face" if len(faces) == 1 else "each interface's face"
        return [
            f"u: mean displacement of {which}, weighted by the consistent nodal forces of a uniform traction",
            "(the work conjugate of the force).",
        ]

    def _prefix(self, interface: str) -> str:
        return f"{interface}_" if len(self.model.faces) > 1 else ""

    def _motion_columns(self) -> list[str]:
        return [self._prefix(interface) + column for interface in self.model.faces for column in MOTION_COLUMNS]

    def _write_static(self, name: str, loads: dict[str, np.ndarray], motion: np.ndarray, notes: list[str]) -> None:
        columns, values = [], []
        for interface, load in loads.items():
            for axis in np.flatnonzero(load.any(axis=0)):
                columns.append(f"{self._prefix(interface)}f{'xyz'[axis]}_N")
                values.append(load[:, axis])
        if len(columns) == 1:
            columns = ["force_N"]
        rows = np.column_stack([*values, motion])
        _write_table(self.folder / f"{name}.csv", [*columns, *self._motion_columns()], rows, notes)


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


def _as_arrays(forces: Forces) -> ccx.Forces:
    return {interface: np.array(force) for interface, force in forces.items()}


def _in_words(forces: Forces, growing: str = "") -> str:
    sizes = {interface: ", ".join(f"{component:g}" for component in force) for interface, force in forces.items()}
    return ", ".join(f"{interface} force {growing}({size}) N" for interface, size in sizes.items())


def _write_table(path: Path, columns: list[str], rows: np.ndarray, notes: list[str]) -> None:
    lines = [",".join(columns), *(f"# {note}" for note in notes)]
    # CalculiX prints seven digits; one more keeps the rounding of the means from adding to theirs.
    lines += [",".join(f"{value:.8g}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{path}: {len(rows)} rows")
