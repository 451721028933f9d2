"""CalculiX: write decks and run them.

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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.tip_face import TipFace

# Largest residual over mean internal force at which an increment counts as converged; CalculiX's own 0.005
# leaves errors that the bodies' reduced models are able to resolve.
FORCE_TOLERANCE = 1e-7

# Accuracy of buckling factors; CalculiX's own 0.01 is no reference.
BUCKLING_TOLERANCE = 1e-6

# Number of the node that leads a face, beyond the numbers of all model decks.
PILOT_NODE = 10_000


@dataclass(frozen=True, slots=True)
class Model:
    """A model deck and what the decks that include it need to know of it.

    Attributes
    ----------
    file : Path
        The model deck, one folder above the decks that include it.
    faces : dict of str to TipFace
        The face of each interface, by its name; the node set has the same name in capitals.
    supports : tuple of str
        Node sets that are clamped.
    """

    file: Path
    faces: dict[str, TipFace]
    supports: tuple[str, ...] = ("ROOT",)


# Force of each loaded interface, shape (3,), N, in fixed directions.
Forces = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class Run:
    """Printed results of a CalculiX run and its wall time, s."""

    printed: str
    seconds: float


def static_deck(model: Model, forces: Forces, increments: int, title: str) -> str:
    """Deck of a nonlinear static run: dead forces grow from 0 to `forces` in equal increments.

    Parameters
    ----------
    model : Model
        The body.
    forces : dict of str to ndarray, shape (3,)
        Forces at the end.
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
            *_load_cards(model, forces),
            *_print_cards(model),
            "*END STEP",
        ],
    )


def linear_deck(model: Model, forces: Forces, title: str) -> str:
    """Deck of a linear static run under `forces`; the rest as in `static_deck`."""
    return _deck(model, title, [], ["*STEP", "*STATIC", *_load_cards(model, forces), *_print_cards(model), "*END STEP"])


def path_deck(model: Model, interface: str, axis: int, displacement: float, increments: int, title: str) -> str:
    """Deck of a nonlinear static run led by the mean displacement of a face, past limit points of the load.

    The force is that of a uniform traction, as in `static_deck`: an equation ties the face's weighted mean to a
    node of its own, the only one of the set PILOT. The supports' reactions, printed too, are the force's opposite.

    Parameters
    ----------
    model, increments, title
        As in `static_deck`.
    interface : str
        Name of the interface.
    axis : int
        0, 1 or 2: direction of displacement and force.
    displacement : float
        Mean displacement at the end, m.
    """
    face = model.faces[interface]
    terms = [f"{node + 1}, {axis + 1}, {share:.12e}" for node, share in zip(face.nodes, face.weights, strict=True)]
    terms.append(f"{PILOT_NODE}, {axis + 1}, -1.")
    # Lines of an equation have to be full: four terms.
    lines = [", ".join(terms[i : i + 4]) for i in range(0, len(terms), 4)]
    return _deck(
        model,
        title,
        ["*NODE, NSET=PILOT", f"{PILOT_NODE}, 0., 0., 0.", "*EQUATION", f"{len(terms)}", *lines],
        [
            f"*STEP, NLGEOM, INC={increments + 1}",
            "*STATIC, DIRECT",
            f"{1 / increments:.9g}, 1.",
            *_tolerance_cards(),
            "*BOUNDARY",
            f"PILOT, {axis + 1}, {axis + 1}, {displacement:.9g}",
            *_print_cards(model),
            *(line for node_set in model.supports for line in (f"*NODE PRINT, NSET={node_set}, TOTALS=ONLY", "RF")),
            "*END STEP",
        ],
    )


def frequency_deck(model: Model, count: int, title: str) -> str:
    """Deck of an eigenfrequency run for the lowest `count` modes of the supported body."""
    return _deck(model, title, [], ["*STEP", "*FREQUENCY", f"{count}", "*END STEP"])


def preloaded_frequency_deck(model: Model, preloads: Sequence[Forces], count: int, title: str) -> str:
    """Deck of eigenfrequencies about nonlinear equilibria, one after the other.

    Parameters
    ----------
    model, title
        As in `static_deck`.
    preloads : sequence of dict of str to ndarray, shape (3,)
        The dead forces of each equilibrium.
    count : int
        Number of modes of each.
    """
    steps = []
    for forces in preloads:
        steps += ["*STEP, NLGEOM", "*STATIC", *_tolerance_cards(), *_load_cards(model, forces, ", OP=NEW"), "*END STEP"]
        steps += ["*STEP, PERTURBATION", "*FREQUENCY", f"{count}", "*END STEP"]
    return _deck(model, title, [], steps)


def buckling_deck(model: Model, forces: Forces, count: int, title: str) -> str:
    """Deck of the lowest `count` factors by which `forces` become critical, linear, from the unloaded body."""
    step = ["*STEP", "*BUCKLE", f"{count}, {BUCKLING_TOLERANCE:g}", *_load_cards(model, forces), "*END STEP"]
    return _deck(model, title, [], step)


def sudden_load_deck(model: Model, forces: Forces, step: float, duration: float, title: str) -> str:
    """Deck of an undamped nonlinear transient from rest under forces that are there from the start.

    Parameters
    ----------
    model, forces, title
        As in `static_deck`.
    step, duration : float
        Fixed time step and end time, s. With ALPHA=0 the method is the trapezoidal rule, free of damping.
    """
    return transient_deck(model, forces, np.array([[0.0, 1.0], [2.0 * duration, 1.0]]), step, duration, title)


def transient_deck(model: Model, forces: Forces, course: np.ndarray, step: float, duration: float, title: str) -> str:
    """The same under forces that follow a course.

    Parameters
    ----------
    model, forces, step, duration, title
        As in `sudden_load_deck`.
    course : ndarray, shape (n, 2)
        Times (s) and the share of `forces` that acts then; linear in between.
    """
    rows = [f"{time:.9g}, {share:.9g}" for time, share in course]
    return _deck(
        model,
        title,
        ["*AMPLITUDE, NAME=COURSE", *rows],
        [
            f"*STEP, NLGEOM, INC={10 * round(duration / step)}",
            "*DYNAMIC, ALPHA=0., DIRECT",
            f"{step:.9g}, {duration:.9g}",
            *_tolerance_cards(),
            *_load_cards(model, forces, ", AMPLITUDE=COURSE"),
            *_print_cards(model),
            "*END STEP",
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


def run_ccx(deck: Path, model: Model) -> Run:
    """Run CalculiX on one core in a temporary copy of the deck's folder.

    Parameters
    ----------
    deck : Path
        Deck to run.
    model : Model
        Body whose model deck it includes from one folder above.

    Raises
    ------
    RuntimeError
        If the run fails; the message holds the end of CalculiX's log.
    """
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "run"
        folder.mkdir()
        shutil.copy(model.file, top)
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


def _deck(model: Model, title: str, extra: list[str], step: list[str]) -> str:
    supports = [f"{node_set}, 1, 3" for node_set in model.supports]
    head = [f"** {title}", f"*INCLUDE, INPUT=../{model.file.name}", *extra, "*BOUNDARY", *supports]
    return "\n".join(head + step) + "\n"


def _tolerance_cards() -> list[str]:
    return ["*CONTROLS, PARAMETERS=FIELD", f"{FORCE_TOLERANCE:.9g}"]


def _load_cards(model: Model, forces: Forces, option: str = "") -> list[str]:
    loads = [line for interface, force in forces.items() for line in model.faces[interface].load_cards(force)]
    return [f"*CLOAD{option}", *loads]


def _print_cards(model: Model) -> list[str]:
    return [line for interface in model.faces for line in (f"*NODE PRINT, NSET={interface.upper()}", "U")]
