"""CalculiX: write decks, run them, read the printed results.

A deck includes the body's model deck by ``*INCLUDE, INPUT=../<model>.inp``: it runs as it stands from its own
folder (``ccx -i <name>``). Under NLGEOM, CalculiX takes the isotropic elastic constants as a linear law
between Green's strain and the second Piola-Kirchhoff stress.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.tip_face import TipFace

# Largest residual over mean internal force at which an increment counts as converged; CalculiX's own 0.005
# leaves errors that the bodies' reduced models are able to resolve.
FORCE_TOLERANCE = 1e-7


@dataclass(frozen=True, slots=True)
class Run:
    """Printed results of a CalculiX run and its wall time, s."""

    printed: str
    seconds: float


def static_deck(model: Path, tip: TipFace, force: np.ndarray, increments: int, title: str) -> str:
    """Deck of a nonlinear static run: a dead force grows from 0 to `force` in equal increments.

    Parameters
    ----------
    model : Path
        The model deck, one folder above the deck.
    tip : TipFace
        Face that bears the force.
    force : ndarray, shape (3,)
        Force at the end, N, in fixed directions.
    increments : int
        Number of increments; each is printed.
    title : str
        First comment line.
    """
    return _deck(
        model,
        title,
        [],
        [
            f"*STEP, NLGEOM, INC={increments + 1}",
            "*STATIC, DIRECT",
            f"{1 / increments:.9g}, 1.",
            *_tolerance_cards(),
            *_load_and_print_cards(tip, force),
        ],
    )


def linear_deck(model: Path, tip: TipFace, force: np.ndarray, title: str) -> str:
    """Deck of a linear static run under `force`, shape (3,), N; the rest as in `static_deck`."""
    return _deck(model, title, [], ["*STEP", "*STATIC", *_load_and_print_cards(tip, force)])


def frequency_deck(model: Path, count: int, title: str) -> str:
    """Deck of an eigenfrequency run for the lowest `count` modes of the supported body."""
    return _deck(model, title, [], ["*STEP", "*FREQUENCY", f"{count}", "*END STEP"])


def sudden_load_deck(model: Path, tip: TipFace, force: np.ndarray, step: float, duration: float, title: str) -> str:
    """Deck of an undamped nonlinear transient from rest under a force that is there from the start.

    Parameters
    ----------
    model, tip, force, title
        As in `static_deck`.
    step, duration : float
        Fixed time step and end time, s. With ALPHA=0 the method is the trapezoidal rule, free of damping.
    """
    return _deck(
        model,
        title,
        ["*AMPLITUDE, NAME=SUDDEN", f"0., 1., {2 * duration:.9g}, 1."],
        [
            f"*STEP, NLGEOM, INC={10 * round(duration / step)}",
            "*DYNAMIC, ALPHA=0., DIRECT",
            f"{step:.9g}, {duration:.9g}",
            *_tolerance_cards(),
            *_load_and_print_cards(tip, force, ", AMPLITUDE=SUDDEN"),
        ],
    )


def find_ccx() -> str:
    """Return the path of CalculiX's solver, `ccx`.

    Raises
    ------
    FileNotFoundError
        If it is not on the PATH.
    """
    path = shutil.which("ccx")
    if path is None:
        raise FileNotFoundError("ccx is not on the PATH: install CalculiX (Debian package calculix-ccx)")
    return path


def ccx_version() -> str:
    """Return the version that `ccx` states, for instance ``"2.20"``."""
    stated = subprocess.run([find_ccx(), "-v"], capture_output=True, text=True, check=False).stdout
    return re.search(r"Version\s+(\S+)", stated).group(1)


def run_ccx(deck: Path, model: Path) -> Run:
    """Run CalculiX on one core in a temporary copy of the deck's folder.

    Parameters
    ----------
    deck : Path
        Deck to run.
    model : Path
        Model deck that it includes from one folder above.

    Raises
    ------
    RuntimeError
        If the run fails; the message holds the end of CalculiX's log.
    """
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "run"
        folder.mkdir()
        shutil.copy(model, top)
        shutil.copy(deck, folder)
        start = time.perf_counter()
        done = subprocess.run(
            [find_ccx(), "-i", deck.stem],
            cwd=folder,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - start
        if done.returncode != 0 or "*ERROR" in done.stdout or "Job finished" not in done.stdout:
            raise RuntimeError(f"ccx failed on {deck}:\n{done.stdout[-2000:]}{done.stderr[-500:]}")
        return Run(printed=(folder / f"{deck.stem}.dat").read_text(), seconds=seconds)


def read_displacements(printed: str, n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Read the displacements of the one printed node set, at all printed times.

    Parameters
    ----------
    printed : str
        Contents of the .dat file.
    n_nodes : int
        Number of nodes in the set; they come in ascending order.

    Returns
    -------
    times : ndarray, shape (n_times,)
        Step times.
    displacements : ndarray, shape (n_times, n_nodes, 3)
        Displacements, m.
    """
    blocks = re.split(r"displacements \(vx,vy,vz\) for set \S+ and time", printed)[1:]
    times = np.empty(len(blocks))
    displacements = np.empty((len(blocks), n_nodes, 3))
    for i, block in enumerate(blocks):
        head, *rows = [line.split() for line in block.splitlines() if line.strip()]
        times[i] = float(head[0])
        table = np.array(rows, dtype=float)
        displacements[i] = table[np.argsort(table[:, 0]), 1:]
    return times, displacements


def read_frequencies(printed: str) -> np.ndarray:
    """Read the eigenfrequencies, Hz, from the contents of a .dat file; shape (n_modes,)."""
    table = printed.split("E I G E N V A L U E   O U T P U T")[1].split("P A R T I C I P A T I O N")[0]
    rows = [line.split() for line in table.splitlines()]
    return np.array([float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()])


def _deck(model: Path, title: str, extra: list[str], step: list[str]) -> str:
    head = [f"** {title}", f"*INCLUDE, INPUT=../{model.name}", *extra, "*BOUNDARY", "ROOT, 1, 3"]
    return "\n".join(head + step) + "\n"


def _tolerance_cards() -> list[str]:
    return ["*CONTROLS, PARAMETERS=FIELD", f"{FORCE_TOLERANCE:.9g}"]


def _load_and_print_cards(tip: TipFace, force: np.ndarray, option: str = "") -> list[str]:
    return [f"*CLOAD{option}", *tip.load_cards(force), "*NODE PRINT, NSET=TIP", "U", "*END STEP"]
