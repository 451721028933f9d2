"""Reference results of the rear axle of shells with CalculiX: decks and CSV files in the folder `calculix`.

Shells are S8R and solids C3D20R, twice as long as those of the reduced axle: CalculiX's S4 hourglasses, and its
quadratic ones are what others measure shells by. With --linear the reference has the reduced axle's own elements and
nodes. Supports, loads and files are those of the axle of bricks (`demo.rear_axle.calculix.run_calculix`).

Run from the repository's root, with ``ccx`` on the PATH:
``python -m demo.rear_axle.shells.run_calculix [--longest M] [--linear] [--increments N] [--folder FOLDER] [case ...]``.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from demo.rear_axle.calculix.run_calculix import CASES, run
from demo.rear_axle.shells import make_mesh
from demo.rear_axle.wheels import wheels

HERE = Path(__file__).parent
# CalculiX's knots of shells, rigid by nonlinear equations, converge slowly: each digit takes three iterations.
TOLERANCE = 1e-4
# Their residual grows at first, which ends a run by default.
ITERATIONS = 30


def main() -> None:
    """Run the cases named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", nargs="*", default=["left", "side", "opposite"], help=f"any of {', '.join(CASES)}")
    parser.add_argument(
        "--longest", type=float, default=make_mesh.SIZES["full"], help="longest edge of linear shells, m"
    )
    parser.add_argument("--linear", action="store_true", help="S4 and C3D8I of that length")
    parser.add_argument("--increments", type=int, default=3, help="equal increments")
    parser.add_argument("--folder", type=Path, default=HERE / "calculix", help="where decks and results go")
    choice = parser.parse_args()
    axle = make_mesh.build(choice.longest * (1.0 if choice.linear else 2.0), quadratic=not choice.linear)
    choice.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        model, solids = Path(folder) / "axle.inp", Path(folder) / "solids.inp"
        make_mesh.write(model, axle)
        make_mesh.write(solids, axle, solids=True)
        fitted = wheels(solids)
        for name in choice.case:
            case = CASES[name]
            if case.increments:
                case = replace(case, increments=choice.increments, keep=1, tolerance=TOLERANCE, iterations=ITERATIONS)
            run(name, case, model, choice.folder, fitted, axle.node_sets)


if __name__ == "__main__":
    main()
