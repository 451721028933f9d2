"""Decks of others against CalculiX on the same deck: linear statics, and frequencies where there is a density.

Run from the repository's root: python -m benchmarks.against_calculix FOLDER [--only PATTERN]; it needs ccx, and writes
benchmarks/against_calculix.csv. CalculiX gets the model part of the deck as it is, with supports and a load that this
script adds: nodes at one end of the longest axis are held, a force acts on those at the other. Left out are decks
without CalculiX's answer, those whose model part has contact, links, initial stress, prescribed motion, axes of nodes
or C3D8R (its hourglass control is CalculiX's own) or plasticity, mechanisms, and those above some thousand elements.

Of the shells those with S8 are compared, which CalculiX gets as S8R: its other shells lock or hourglass. Both get
Poisson's ratio 0 there. Where rotations are held, CalculiX keeps the thickness, too, so that the next row of elements
is in plane strain; a plate of one row of S8R clamped with Poisson's ratio 0.3 is 8.3, 4.5, 2.1, 1.0 % too stiff with 2,
4, 8, 16 elements over its length (with 0: 1e-5), and comes to what flexfmu gives from 2 elements on. Loads at a corner
beside clamped edges leave 29 % (shell6rot2): refined, both come to the same; with 2, 4, 8, 16 elements across CalculiX
is 27, 8, 2, 0.3 % too stiff, flexfmu 2, 1.6, 0.6, 0 %. Plates of 10 by 10 elements, 3000 times as wide as
thick, that are held and loaded at single mid-sides (leifer1, square) leave 5.6 %. Deflections, m, each times the cube
of thickness over the file's (`python -m benchmarks.thin_plate`):

| elements | 10 | 20 | 40 |
|---|---|---|---|
| 10 × as thick: flexfmu, CalculiX | 257, 252 | 265, 263 | 269, 266 |
| as in the file | 257, 249 | 264, 247 | 267, 286 |
| 0.1 × | 257, 2 | 264, 25 | |

Those of a thin plate do not depend on it. CalculiX makes solids of shells, which run out of digits here (coordinates
that differ in the last ones give 246, 249, 282); ten times as thick it nears flexfmu with the mesh.

Frequencies of C3D8I are not compared. CalculiX's incompatible modes have mass: the third axial frequency of a bar whose
sections stay plane is 8.9, 2.5, 0.63 % too low with 1, 2, 4 elements across, however many are along (here 0.16 %).
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from benchmarks.coverage import kind_of
from flexfmu import FlexfmuError
from flexfmu.fe.assembly import mass, stiffness, unknowns
from flexfmu.fe.factorisation import Factorisation
from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.checks import checked, without_mechanisms
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Mesh
from flexfmu.reduction.modes import normal_modes
from flexfmu.reduction.supported import eliminated, supported

RECORD = Path(__file__).with_suffix(".csv")
MOST_ELEMENTS, SECONDS, FREQUENCIES = 6000, 100, 4
MOST_MOVED = 1e7
"""Displacement over the body's size beyond which it is a mechanism; materials of decks may be soft."""
FORCE = np.array([1.0, 2.0, 3.0])
_LEFT_OUT = re.compile(
    r"^\s*\*\s*(CONTACT|GAP|RIGID ?BODY|COUPLING|DISTRIBUTING|KINEMATIC|CYCLIC|PRE-?TENSION|MASS\b|ROTARY|DASHPOT|"
    r"SPRING|SUBMODEL|PLASTIC|USER|HYPER|PHYSICAL|INITIAL|TRANSFORM|VALUES AT INF|NETWORK|FLUID)|"
    r"TYPE\s*=\s*(S4|S3|S6|STRI|C3D8R|B3|B2|T3|D\b|MASS)",
    re.MULTILINE | re.IGNORECASE,
)


def model_part(path: Path) -> str:
    """Text of a deck before its first step, with what it includes."""
    text = re.split(r"^\s*\*\s*STEP\b", path.read_text(encoding="latin-1").replace("\r", ""), flags=re.M | re.I)[0]

    def included(found: re.Match[str]) -> str:
        return (path.parent / found[1].strip()).read_text(encoding="latin-1").replace("\r", "")

    text = re.sub(r"^\s*\*INCLUDE\s*,\s*INPUT\s*=\s*\"?([^\n\"]+)\"?", included, text, flags=re.M | re.I)
    if re.search(r"^\s*\*\s*SHELL ?SECTION", text, re.M | re.I):
        text = re.sub(r"(^\s*\*ELASTIC[^\n]*\n\s*[^,\n]+,)\s*[^,\n]+", r"\1 0.", text, flags=re.M | re.I)
    return text


def ends(mesh: Mesh) -> tuple[set[int], set[int]]:
    """Numbers of the nodes at both ends of the longest axis, free of equations; the first ones can be held."""
    free = np.ones(len(mesh.points), dtype=bool)
    for rows in (mesh.equations, mesh.supports):
        if rows is not None:
            free[np.unique(rows.indices // 3)] = False
    for block in mesh.blocks:
        if block.type is ElementType.S8:
            # Middles have numbers of our own.
            free[block.connectivity[:, block.type.sheet.halves[:, -1]]] = False
    axis = int(np.ptp(mesh.points, axis=0).argmax())
    along = mesh.points[:, axis] - mesh.points[:, axis].min()
    length = along.max()
    for share in (1e-4, 0.02, 0.1, 0.3):
        held, loaded = free & (along <= share * length), free & (along >= (1.0 - share) * length)
        spread = mesh.points[held] - mesh.points[held].mean(axis=0) if held.any() else np.zeros((0, 3))
        size = np.linalg.svd(spread, compute_uv=False) if len(spread) > 2 else np.zeros(3)
        if size[1] > 1e-3 * length and loaded.any():
            return set(mesh.labels[held].tolist()), set(mesh.labels[loaded].tolist())
    raise FlexfmuError("no ends that can be held and loaded")


def calculix(part: str, held: set[int], loaded: set[int], step: str) -> str:
    """What ccx writes of one step of the deck."""
    rows = [f"{node}, 1, {6 if 'SHELL SECTION' in part.upper() else 3}" for node in sorted(held)]
    loads = [f"{node}, {k}, {f / len(loaded)!r}" for node in sorted(loaded) for k, f in enumerate(FORCE.tolist(), 1)]
    # Those without R lock.
    part = re.sub(r"(TYPE\s*=\s*S8)\s*(?=,|$)", r"\1R", part, flags=re.M | re.I)
    deck = [part.rstrip(), "*NSET, NSET=ZZLOADED", *(f"{node}," for node in sorted(loaded)), "*BOUNDARY", *rows]
    deck += ["*STEP", step, *([str(FREQUENCIES)] if step == "*FREQUENCY" else ["*CLOAD", *loads])]
    deck += ["*NODE PRINT, NSET=ZZLOADED, GLOBAL=YES", "U", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "job.inp").write_text("\n".join(deck), encoding="latin-1")
        subprocess.run(["ccx", "job"], cwd=folder, check=True, capture_output=True, timeout=SECONDS)
        return Path(folder, "job.dat").read_text()


def units_of(deck: Path) -> UnitSystem:
    """The first units in which a deck is plausible."""
    for units in UnitSystem:
        try:
            read_deck(deck, units)
        except FlexfmuError as error:
            if "units" not in str(error):
                return units
        else:
            return units
    return UnitSystem.SI


def compared(path: Path) -> dict[str, str]:
    """Errors of one deck."""
    part = model_part(path)
    if found := _LEFT_OUT.search(part):
        raise FlexfmuError(f"{found[0].strip()} is not compared")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "deck.inp")
        copy.write_text(part, encoding="latin-1")
        units = units_of(copy)
        mesh = without_mechanisms(checked(read_deck(copy, units)))
    if any("is moved holds nothing" in note for note in mesh.notes):
        raise FlexfmuError("prescribed displacements are loads, which are not compared")
    if mesh.element_count > MOST_ELEMENTS or mesh.links or mesh.masses:
        raise FlexfmuError("too large, or with links or masses")
    held, loaded = ends(mesh)
    fixed = mesh.fixed | np.isin(mesh.labels, list(held))[:, None]
    rows = np.flatnonzero(np.isin(mesh.labels, list(loaded)))
    load = np.zeros((len(mesh.points), 3))
    # Both points of a shell's node bear its number.
    copies = np.array([(mesh.labels == label).sum() for label in mesh.labels[rows].tolist()])
    load[rows] = units.stress * units.length**2 * FORCE / len(loaded) / copies[:, None]
    parts = [rows for rows in (mesh.equations, mesh.supports) if rows is not None]
    unknown, stiff = unknowns(fixed, sp.csr_array(sp.vstack(parts)) if parts else None, mesh.mixed), stiffness(mesh)
    solution = Factorisation(unknown.matrix(stiff), unknown.free // 3).solve(unknown.forces(load.ravel()))
    moved = unknown.whole(solution).reshape(-1, 3)
    mine = {label: moved[mesh.labels == label].mean(axis=0) / units.length for label in sorted(loaded)}
    lines = [line.split() for line in calculix(part, held, loaded, "*STATIC").splitlines()]
    theirs = {int(one[0]): np.array(one[1:], dtype=float) for one in lines if len(one) == 4 and one[0].isdigit()}
    both = np.array([(mine[label], theirs[label]) for label in mine])
    error = np.linalg.norm(both[:, 0] - both[:, 1], axis=1).max() / np.linalg.norm(both[:, 1], axis=1).max()
    if not 0.0 < np.linalg.norm(both[:, 1], axis=1).max() < MOST_MOVED * np.ptp(mesh.points) / units.length:
        raise FlexfmuError("nothing, or everything, keeps the loaded nodes from moving")
    row = {"elements": " ".join(sorted({b.type.name for b in mesh.blocks})), "nodes": str(len(mesh.points)),
           "statics": f"{error:.2e}", "frequencies": ""}  # fmt: skip
    dense = all(one.density > 0.0 for one in mesh.materials) and "C3D8I" not in row["elements"]
    if dense and min(b.material.min() for b in mesh.blocks) >= 0:
        matrices = eliminated(stiff, mass(mesh), unknown)
        modes = normal_modes(supported(matrices, np.zeros((load.size, 0))), FREQUENCIES)
        found = re.findall(r"^\s+\d+\s+\S+E\S+\s+\S+E\S+\s+(\S+E\S+)\s+\S+E\S+\s*$",
                           calculix(part, held, loaded, "*FREQUENCY"), re.M)  # fmt: skip
        own, other = modes.angular_frequency[:FREQUENCIES] / (2.0 * np.pi), np.array(found[:FREQUENCIES], dtype=float)
        # Of few unknowns CalculiX finds none.
        row["frequencies"] = f"{np.abs(own / other - 1.0).max():.2e}" if other.all() else ""
    return row


def in_a_process(path: Path) -> tuple[dict[str, str], str]:
    """Errors of one deck, or why there are none, from a process that may take some time."""
    with tempfile.TemporaryFile("w+") as said:
        child = os.fork()
        if not child:
            try:
                text = repr((compared(path), ""))
            except BaseException as error:
                text = repr(({}, f"{type(error).__name__}: {error}"[:300]))
            said.write(text)
            said.flush()
            os._exit(0)
        start = time.monotonic()
        while not os.waitpid(child, os.WNOHANG)[0]:
            if time.monotonic() - start > 2 * SECONDS:
                os.kill(child, signal.SIGKILL)
            time.sleep(0.01)
        said.seek(0)
        return eval(said.read() or "({}, 'no time')")  # what this script has written


def main() -> None:
    """Compare all decks of a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    fields = ("source", "file", "kind", "elements", "nodes", "statics", "frequencies")
    rows = []
    for path in sorted(options.folder.resolve().rglob("*.inp")):
        if options.only not in str(path) or (kind := kind_of(path)) not in ("solids", "shells", "mixed"):
            continue
        row, reason = in_a_process(path)
        name = path.relative_to(options.folder.resolve())
        print(name, row or reason, flush=True)
        if row:
            rows.append(
                {"source": name.parts[0].replace("+", "/"), "file": str(Path(*name.parts[1:])), "kind": kind, **row}
            )
    with RECORD.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
