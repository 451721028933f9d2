"""Results of CalculiX for the bodies of this folder, kept in ``calculix.csv``, one row a point and interface.

Run from the repository's root, with ``ccx`` on the PATH, for all bodies or those named:
``python -m benchmarks.defaults.run_calculix [body ...]``. Others keep their rows.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from demo.calculix_results import read_displacements
from demo.calculix_tools import FORCE_TOLERANCE, ccx_version, find_ccx
from scipy.spatial.transform import Rotation

from benchmarks.defaults.body import Body, Loads
from benchmarks.defaults.published import EVERY
from benchmarks.defaults.shapes import FloatArray
from benchmarks.records import read_records, write_records
from flexfmu.fe.assembly import area_matrix, select
from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.formats import read_mesh
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.options import InterfaceNodes

RESULTS = Path(__file__).with_name("calculix.csv")
MOTION = ("ux", "uy", "uz", "rx", "ry", "rz")
# First and largest part of a step that CalculiX takes at once, and the residual over the mean force that it accepts.
# Of the thin annulus round-off alone is 1e-7.
ORDINARY, EASED = (0.5, 0.5, FORCE_TOLERANCE), {"slit_annulus": (0.025, 0.1, 1e-5)}


def weights(body: Body, deck: Path) -> dict[str, FloatArray]:
    """What spreads a force over an interface, and fits its motion, as flexfmu does: ∫ N_a N_b dA, or 1 for a node."""
    mesh = read_mesh(deck, UnitSystem.SI)
    found = {}
    for name in body.interfaces:
        nodes = body.sets[name.upper()]
        fit = fit_interface(InterfaceNodes(name, name.upper()), mesh, ())
        if fit.added.size:
            raise ValueError(f"{body.name}: the nodes of {name} lie on a line or in a point")
        tried = (area_matrix(mesh.points, select(mesh.faces, nodes, outer=outer), nodes) for outer in (True, False))
        found[name] = next(one.toarray() for one in tried if one is not None) if fit.by_area else np.eye(nodes.size)
    return found


def step_deck(body: Body, loads: Loads, weight: dict[str, FloatArray]) -> str:
    """Deck of a run through the shares of a load, a step each; nodal forces are those of uniform tractions."""
    deck = [f"*INCLUDE, INPUT={body.name}.inp", "*BOUNDARY", "HELD, 1, 3"]
    deck += [f"GUIDE_{axis.upper()}, {'xyz'.index(axis) + 1}" for axis in body.guides]
    first, largest, tolerance = EASED.get(body.name, ORDINARY)
    for share in body.shares:
        deck += ["*STEP, NLGEOM, INC=1000", "*STATIC", f"{first}, 1., 1e-6, {largest}"]
        deck += ["*CONTROLS, PARAMETERS=FIELD", f"{tolerance:g}", "*CLOAD"]
        for name, force in loads.items():
            nodal = weight[name].sum(axis=1) / weight[name].sum()
            for axis, size in enumerate(force):
                deck += [
                    f"{node + 1}, {axis + 1}, {share * size * part:.9e}"
                    for node, part in zip(body.sets[name.upper()], nodal, strict=True)
                    if size
                ]
        for name in body.interfaces:
            deck += [f"*NODE PRINT, NSET={name.upper()}, FREQUENCY=100000", "U"]
        deck.append("*END STEP")
    return "\n".join(deck) + "\n"


def motion(points: FloatArray, displacement: FloatArray, weight: FloatArray) -> FloatArray:
    """Mean displacement, and rotation vector of the rigid motion that fits best over the area, (6,)."""
    share = weight.sum(axis=1) / weight.sum()
    before, after = points - share @ points, points + displacement
    after = after - share @ after
    # Least squares with a full weight: those of its factor's rows with equal weights.
    factor = np.linalg.cholesky(weight + 1e-12 * np.trace(weight) * np.eye(len(weight))).T
    turned = Rotation.align_vectors(factor @ after, factor @ before)[0].as_rotvec()
    return np.concatenate([share @ displacement, turned])


def run(body: Body) -> list[dict[str, object]]:
    """Rows of a body: every case, share and interface."""
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top)
        (folder / f"{body.name}.inp").write_text(body.deck(), encoding="ascii")
        weight = weights(body, folder / f"{body.name}.inp")
        for case, loads in body.cases.items():
            (folder / "run.inp").write_text(step_deck(body, loads, weight), encoding="ascii")
            start = time.perf_counter()
            done = subprocess.run(
                [find_ccx(), "-i", "run"],
                cwd=folder,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
                capture_output=True,
                text=True,
                check=False,
            )
            seconds = time.perf_counter() - start
            printed = (folder / "run.dat").read_text() if (folder / "run.dat").exists() else ""
            reached = 0
            for name in body.interfaces:
                try:
                    _, displacements = read_displacements(printed, name)
                except ValueError:
                    break
                nodes = body.sets[name.upper()]
                # CalculiX prints each step's end; a run that fails has fewer of them.
                reached = len(displacements)
                for share, field in zip(body.shares, displacements, strict=False):
                    numbers = motion(body.mesh.points[nodes], field, weight[name])
                    rows.append(
                        {"body": body.name, "case": case, "share": share, "interface": name}
                        | {key: f"{value:.9g}" for key, value in zip(MOTION, numbers, strict=True)}
                        | {"nodes": len(body.mesh.points), "seconds": f"{seconds:.3g}", "deck": body.digest(case),
                           "ccx": ccx_version()}
                    )  # fmt: skip
            words = "" if reached == len(body.shares) else "  INCOMPLETE " + done.stdout[-200:].replace("\n", " ")
            print(f"{body.name}, {case}: {reached} shares, {seconds:.1f} s{words}", flush=True)
    return rows


def main() -> None:
    """Run the bodies named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("body", nargs="*", help="default: all")
    chosen = parser.parse_args().body
    known = {make.__name__: make for make in EVERY}
    rows: dict[str, list[dict[str, object]]] = {}
    for row in read_records(RESULTS) if RESULTS.exists() else []:
        rows.setdefault(row["body"], []).append(dict(row))
    for name in chosen or known:
        rows[name] = run(known[name]())
        write_records(RESULTS, [row for key in known for row in rows.get(key, [])])


if __name__ == "__main__":
    main()
