"""Clamped bars of the elements and materials that only decks have; as a script, it writes deck_bars.csv by CalculiX.

The bar reaches along x from ROOT to TIP, whose nodes take equal shares of a force; CalculiX (ccx 2.20) finds the mean
displacement of the tip, linear under FORCE and with geometric nonlinearity under LARGE times that, or more for
elements that lock.
"""

import csv
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from flexfmu.mesh.elements import ElementType
from meshes import box

HERE = Path(__file__).parent
SIZE, COUNTS = (1.0, 0.05, 0.1), (10, 2, 2)
FORCE = np.array([1e3, 2e3, 1e3])
LARGE = 20.0
LOCKING = {"wedges": 200.0, "tets": 100.0, "bricks": 60.0}
STEEL = "*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n*SOLID SECTION, ELSET=BAR, MATERIAL=M\n"
PLY = """*MATERIAL, NAME=M
*ELASTIC, TYPE={kind}
{constants}
*DENSITY
1600.
*ORIENTATION, NAME=O
1., 0.4, 0.2, -1., 1., 0.3
3, 20.
*SOLID SECTION, ELSET=BAR, MATERIAL=M, ORIENTATION=O
"""
CONSTANTS = "1.4e11, 1.e10, 8.e9, 0.3, 0.25, 0.4, 5.e9, 4.e9\n3.e9"
ORTHOTROPIC = "1.5e11, 6.e9, 1.3e10, 5.e9, 5.5e9, 1.1e10, 5.e9, 4.e9\n3.e9"
ANISOTROPIC = """1.5e11, 6.e9, 1.3e10, 5.e9, 5.5e9, 1.1e10, 1.e9, 2.e8
3.e8, 5.e9, 2.e8, 1.e8, 3.e8, 1.e8, 4.e9, 5.e8
2.e8, 1.e8, 3.e8, 2.e8, 3.e9"""
BARS = {
    "tets": (ElementType.C3D4, STEEL),
    "bricks": (ElementType.C3D8, STEEL),
    "incompatible": (ElementType.C3D8I, STEEL),
    "quadratic_tets": (ElementType.C3D10, STEEL),
    "quadratic_bricks": (ElementType.C3D20, STEEL),
    "reduced_bricks": (ElementType.C3D20R, STEEL),
    "wedges": (ElementType.C3D6, STEEL),
    "quadratic_wedges": (ElementType.C3D15, STEEL),
    "engineering": (ElementType.C3D20R, PLY.format(kind="ENGINEERING CONSTANTS", constants=CONSTANTS)),
    "orthotropic": (ElementType.C3D20R, PLY.format(kind="ORTHO", constants=ORTHOTROPIC)),
    "anisotropic": (ElementType.C3D15, PLY.format(kind="ANISO", constants=ANISOTROPIC)),
}


def mesh_cards(mesh, name="BAR", first=0):
    """Nodes and elements of a mesh of one type, numbers from `first` on."""
    (block,) = mesh.blocks
    lines = ["*NODE"]
    labels = first + mesh.labels
    lines += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(labels, mesh.points.tolist(), strict=True)]
    lines.append(f"*ELEMENT, TYPE={block.type.name}, ELSET={name}")
    for label, nodes in zip(first + block.labels, labels[block.connectivity], strict=True):
        row = [str(label), *map(str, nodes)]
        lines += [", ".join(row[:11]) + ("," if row[11:] else "")] + ([", ".join(row[11:])] if row[11:] else [])
    return lines


def deck(name):
    """The model part of a bar's deck, and the labels of its tip."""
    kind, material = BARS[name]
    mesh = box(kind, COUNTS, SIZE)
    lines = mesh_cards(mesh)
    for which, rows in mesh.node_sets.items():
        lines += [f"*NSET, NSET={which}", *(f"{label}," for label in mesh.labels[rows])]
    return "\n".join(lines) + "\n" + material, mesh.labels[mesh.node_sets["TIP"]]


def solved(text, tip, factor, options):
    """Mean displacement of the tip in CalculiX under a multiple of the force, in equal shares of its nodes."""
    forces = [f"{n}, {axis}, {float(factor * f / len(tip))!r}" for n in tip for axis, f in enumerate(FORCE, 1)]
    rows = ["*BOUNDARY", "ROOT, 1, 3", f"*STEP{options}", "*STATIC", "0.2, 1.", "*CLOAD", *forces]
    rows += ["*NODE PRINT, NSET=TIP, FREQUENCY=100", "U", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bar.inp").write_text(text + "\n".join(rows))
        subprocess.run(["ccx", "bar"], cwd=folder, check=True, capture_output=True)
        words = [line.split() for line in (Path(folder) / "bar.dat").read_text().splitlines()]
    found = {int(row[0]): [float(x) for x in row[1:]] for row in words if len(row) == 4 and row[0].isdigit()}
    return np.mean([found[int(n)] for n in tip], axis=0)


def write_table(file, bars):
    """Linear and large deflections of bars, by name with deck and tip."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["bar", "load", "ux_m", "uy_m", "uz_m"])
        for name, (text, tip) in bars.items():
            large = LOCKING.get(name, LARGE)
            for load, factor, options in (("linear", 1.0, ""), ("large", large, ", NLGEOM, INC=100")):
                writer.writerow([name, load, *solved(text, tip, factor, options).tolist()])


if __name__ == "__main__":
    write_table(HERE / "deck_bars.csv", {name: deck(name) for name in BARS})
