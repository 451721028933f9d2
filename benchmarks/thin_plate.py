"""A plate that is too thin for CalculiX's shells, by mesh and thickness, in both programs.

Run from the repository's root: python -m benchmarks.thin_plate; it needs ccx. The plate is that of the public decks
leifer1 and square, with the places that `against_calculix` holds and loads there: 229 × 229 × 0.0762 mm, 3790 MPa,
Poisson's ratio 0.
"""

from __future__ import annotations

import tempfile
from itertools import product
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from benchmarks.against_calculix import FORCE, calculix
from flexfmu.fe.assembly import stiffness, unknowns
from flexfmu.fe.factorisation import Factorisation
from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck

SIDE, THICKNESS = 229.0, 0.0762
# In twentieths of the side: at x = 1/20 every even y, and two more nodes; along the other side the same x as y.
HELD = [(1, y) for y in range(0, 21, 2)] + [(2, 6), (2, 10)]
LOADED = [(19, y) for y in range(0, 21, 2)]


def plate(count: int, thickness: float) -> tuple[str, set[int], set[int]]:
    """Deck of count × count elements (a multiple of 10), and the numbers of held and loaded nodes."""
    number = {}
    for j, i in product(range(2 * count + 1), repeat=2):
        if not (i % 2 and j % 2):
            number[i, j] = len(number) + 1
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {SIDE * i / (2 * count):.9g}, {SIDE * j / (2 * count):.9g}, 0." for (i, j), n in number.items()]
    lines += ["*ELEMENT, TYPE=S8, ELSET=E"]
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for label, (j, i) in enumerate(product(range(count), repeat=2), start=1):
        lines.append(f"{label}, " + ", ".join(str(number[2 * i + a, 2 * j + b]) for a, b in around))
    lines += ["*MATERIAL, NAME=M", "*DENSITY", "1e-9", "*ELASTIC", "3790., 0.", "*SHELL SECTION, ELSET=E, MATERIAL=M"]
    places = ({number[count // 10 * i, count // 10 * j] for i, j in each} for each in (HELD, LOADED))
    return "\n".join([*lines, f"{thickness}", ""]), *places


def deflections(count: int, thickness: float) -> tuple[float, float]:
    """Mean deflection of the loaded nodes by flexfmu and by CalculiX, mm."""
    text, held, loaded = plate(count, thickness)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "plate.inp").write_text(text)
        mesh = checked(read_deck(Path(folder, "plate.inp"), UnitSystem.MM_T_S))
    fixed = mesh.fixed | np.isin(mesh.labels, list(held))[:, None]
    rows = np.flatnonzero(np.isin(mesh.labels, list(loaded)))
    load = np.zeros((len(mesh.points), 3))
    load[rows] = FORCE / len(rows)
    parts = [each for each in (mesh.equations, mesh.supports) if each is not None]
    unknown = unknowns(fixed, sp.csr_array(sp.vstack(parts)) if parts else None, mesh.mixed)
    solution = Factorisation(unknown.matrix(stiffness(mesh)), unknown.free // 3).solve(unknown.forces(load.ravel()))
    mine = 1e3 * unknown.whole(solution).reshape(-1, 3)[rows, 2].mean()
    found = [line.split() for line in calculix(text, held, loaded, "*STATIC").splitlines()]
    return mine, float(np.mean([float(one[3]) for one in found if len(one) == 4 and one[0].isdigit()]))


def main() -> None:
    """Print deflections times the cube of thickness over that of the file, m."""
    for factor in (10.0, 1.0, 0.1):
        for count in (10, 20, 40) if factor >= 1.0 else (10, 20):
            mine, theirs = (1e-3 * factor**3 * each for each in deflections(count, factor * THICKNESS))
            print(f"{factor:g} × as thick, {count} elements: flexfmu {mine:.1f} m, CalculiX {theirs:.1f} m")


if __name__ == "__main__":
    main()
