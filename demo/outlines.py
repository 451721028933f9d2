"""Where CalculiX puts the edges of the demo bodies' surfaces, for the pictures: OUTLINE.csv beside each case's results.

The decks are those of the cases; printed is the end of the step alone. Run from the repository's root, with ``ccx`` on
the PATH, for all cases or those named: ``python -m demo.outlines [FOLDER/CASE ...]``, such as clamped_beam/static_y.
Columns: place and displacement of each node on an edge, m.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from demo.calculix_results import read_displacements
from demo.calculix_tools import find_ccx

from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.formats import read_mesh
from flexfmu.reduction.surface import surface_nodes
from flexfmu.view.picture import corner_edges

HERE = Path(__file__).parent
SET = "OUTLINE"
CASES = {
    "clamped_beam/static_y": "beam.inp",
    "l_frame/static_z": "l_frame.inp",
    "plate/static_bend": "plate.inp",
    "curved/arc_45": "arc_45.inp",
    "rear_axle/opposite": "rear_axle.inp",
}


def outline_file(case: str) -> Path:
    """The table of a case, FOLDER/CASE."""
    folder, name = case.split("/")
    return HERE / folder / "calculix" / f"{name}_outline.csv"


def run(case: str) -> None:
    """Run the deck of a case and write where the nodes on edges are."""
    folder, name = case.split("/")
    model = HERE / folder / CASES[case]
    mesh = read_mesh(model, UnitSystem.SI)
    nodes, faces = surface_nodes(mesh)
    chosen = nodes[np.unique(corner_edges(mesh.points[nodes], faces))]
    labels = mesh.labels[chosen]
    deck = (HERE / folder / "calculix" / f"{name}.inp").read_text()
    deck = re.sub(r"\*NODE PRINT.*\n(?:[^*].*\n)+", "", deck)
    members = "".join(f"{label},\n" for label in labels)
    deck = re.sub(r"(\*INCLUDE.*\n)", rf"\1*NSET, NSET={SET}\n{members}", deck, count=1)
    deck = deck.replace("*END STEP", f"*NODE PRINT, NSET={SET}, FREQUENCY=9999\nU\n*END STEP")
    with tempfile.TemporaryDirectory() as top:
        place = Path(top) / "run"
        place.mkdir()
        shutil.copy(model, top)
        (place / f"{name}.inp").write_text(deck)
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        command = [find_ccx(), "-i", name]
        subprocess.run(command, cwd=place, env=environment, check=True, stdout=subprocess.DEVNULL)
        moved = read_displacements((place / f"{name}.dat").read_text(), SET)[1][-1]
    # Printed in the order of their numbers.
    order = np.argsort(labels)
    rows = np.hstack([mesh.points[chosen][order], moved])
    np.savetxt(outline_file(case), rows, fmt="%.7g", delimiter=",", header="x_m,y_m,z_m,ux_m,uy_m,uz_m", comments="")
    print(f"{case}: {len(rows)} nodes, largest displacement {np.linalg.norm(moved, axis=1).max():.6g} m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", nargs="*", choices=[*CASES, []])
    for case in parser.parse_args().case or CASES:
        run(case)
