"""Clamped bars of two meshes that *TIE or *EQUATION joins; as a script, it writes glued_bars.csv by CalculiX.

The bars are those of deck_bars.py, with two meshes that meet in the middle.
"""

from dataclasses import replace

import numpy as np

from flexfmu.mesh.elements import ElementType
from foreign.deck_bars import HERE, SIZE, STEEL, mesh_cards, write_table
from meshes import box

# Elements, their number along, across and up, of both halves; how far the second is from the first, of its length.
HALVES = {
    "equation": ((ElementType.C3D20R, (5, 2, 2)), (ElementType.C3D20R, (5, 2, 2)), 0.0),
    "tied_bricks": ((ElementType.C3D20R, (5, 2, 2)), (ElementType.C3D20R, (5, 3, 3)), 0.0),
    "tied_tetrahedra": ((ElementType.C3D20R, (5, 2, 2)), (ElementType.C3D10, (5, 3, 3)), 0.0),
    "tied_linear": ((ElementType.C3D8I, (5, 2, 2)), (ElementType.C3D8I, (5, 3, 3)), 0.0),
    "tied_after_a_gap": ((ElementType.C3D20R, (5, 2, 2)), (ElementType.C3D20R, (5, 3, 3)), 1e-4),
}
# Number that is added to those of the second half.
SECOND = 10000
MIDDLE = 0.5 * SIZE[0]


def halves(name):
    """The two meshes, the second beside the first."""
    found = []
    for (kind, counts), shift in zip(HALVES[name][:2], (0.0, MIDDLE + HALVES[name][2]), strict=True):
        mesh = box(kind, counts, (MIDDLE, *SIZE[1:]))
        found.append(replace(mesh, points=mesh.points + np.array([shift, 0.0, 0.0])))
    return found


def surface(mesh, name, rows, first):
    """Cards of a surface of all element faces within a set."""
    (block,) = mesh.blocks
    inside = np.isin(block.connectivity, rows)
    lines = [f"*SURFACE, NAME={name}"]
    for place, corners in enumerate(block.type.shape.polytope.faces, start=1):
        lines += [f"{first + label}, S{place}" for label in block.labels[inside[:, corners].all(axis=1)]]
    return lines


def deck(name, extra=""):
    """The model part of a bar's deck, and the labels of its tip."""
    first, second = halves(name)
    lines = mesh_cards(first, "A") + mesh_cards(second, "B", SECOND)
    lines += ["*ELSET, ELSET=BAR", "A, B"]
    tip = SECOND + second.labels[second.node_sets["TIP"]]
    sets = {"ROOT": first.labels[first.node_sets["ROOT"]], "TIP": tip}
    for which, labels in sets.items():
        lines += [f"*NSET, NSET={which}", *(f"{label}," for label in labels)]
    if name == "equation":
        ends = first.node_sets["TIP"], second.node_sets["ROOT"]
        pairs = zip(*(np.sort(ends[k])[_order((first, second)[k], ends[k])] for k in (0, 1)), strict=True)
        for a, b in pairs:
            for axis in (1, 2, 3):
                lines += ["*EQUATION", "2", f"{SECOND + second.labels[b]}, {axis}, 1., {first.labels[a]}, {axis}, -1."]
    else:
        lines += surface(first, "MAIN", first.node_sets["TIP"], 0)
        lines += surface(second, "DEPENDENT", second.node_sets["ROOT"], SECOND)
        lines += [f"*TIE, NAME=GLUE, POSITION TOLERANCE=0.001{extra}", "DEPENDENT, MAIN"]
    return "\n".join(lines) + "\n" + STEEL, tip


def _order(mesh, rows):
    """Order of nodes by their place in the section."""
    return np.lexsort(np.round(mesh.points[np.sort(rows), 1:], 9).T)


if __name__ == "__main__":
    write_table(HERE / "glued_bars.csv", {name: deck(name) for name in HALVES})
