"""The bars in CalculiX (ccx 2.20), linear and bent far: averaged displacement of the tip under a uniform traction.

Run as `python run_calculix.py`; it writes calculix.csv. The traction's nodal forces are those of each face's shape
functions: of a straight 6-node triangle a third of its share at each mid-side node, of an 8-node rectangle −1/12 at
corners and 1/3 between them.
"""

import csv
import subprocess
import tempfile
from itertools import product
from pathlib import Path

import numpy as np

from flexfmu.mesh.formats import read_mesh

HERE = Path(__file__).parent
FORCE = (1.0e3, 2.0e3, 3.0e3)
AREA = 0.01
# As in test_foreign.py.
LARGE = 200.0


def weights(mesh):
    """Share of the tip's force at each of its nodes, by node label."""
    block = mesh.blocks[0]
    tip = set(mesh.node_sets["TIP"].tolist())
    share = {}
    for row in block.connectivity:
        for face in block.type.shape.faces:
            nodes = row[list(face)]
            if not set(nodes.tolist()) <= tip:
                continue
            corners = len(nodes) // 2
            points = mesh.points[nodes[:corners]]
            area = 0.5 * sum(
                np.linalg.norm(np.cross(points[k] - points[0], points[k + 1] - points[0]))
                for k in range(1, corners - 1)
            )
            for place, node in enumerate(nodes):
                value = {3: (0.0, 1 / 3), 4: (-1 / 12, 1 / 3)}[corners][place >= corners]
                share[int(mesh.labels[node])] = share.get(int(mesh.labels[node]), 0.0) + value * area / AREA
    return share


def main():
    """Run both bars and write the table."""
    with (HERE / "calculix.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["bar", "load", "ux_m", "uy_m", "uz_m"])
        for kind, load in product(("tets", "bricks"), ("linear", "large")):
            scale, options = (LARGE, ", NLGEOM, INC=100") if load == "large" else (1.0, "")
            share = weights(read_mesh(HERE / f"deck_{kind}.inp"))
            forces = [
                f"{node}, {axis}, {float(scale * value * f)!r}"
                for node, value in share.items()
                for axis, f in enumerate(FORCE, 1)
                if value
            ]
            lines = [(HERE / f"deck_{kind}.inp").read_text(), "*BOUNDARY", "ROOT, 1, 3"]
            lines += [f"*STEP{options}", "*STATIC", "0.2, 1.", "*CLOAD"]
            lines += [*forces, "*NODE PRINT, NSET=TIP, FREQUENCY=100", "U", "*END STEP", ""]
            with tempfile.TemporaryDirectory() as folder:
                Path(folder, "job.inp").write_text("\n".join(lines))
                subprocess.run(["ccx", "job"], cwd=folder, check=True, capture_output=True)
                rows = [line.split() for line in Path(folder, "job.dat").read_text().splitlines()]
            moved = {int(row[0]): np.array(row[1:], dtype=float) for row in rows if len(row) == 4 and row[0].isdigit()}
            mean = sum(value * moved[node] for node, value in share.items())
            writer.writerow([kind, load, *(f"{x:.7e}" for x in mean)])


if __name__ == "__main__":
    main()
