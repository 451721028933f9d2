"""Clamped bars with springs of decks; as a script, it writes spring_bars.csv by CalculiX (ccx 2.20).

The bar of `deck_bars` bends far, held by a spring at a corner of its tip: along the line to a point beside it, along a
line to a point near the clamp, which turns as the bar bends, and along fixed axes.
"""

import numpy as np

from flexfmu.mesh.elements import ElementType
from foreign.deck_bars import COUNTS, HERE, SIZE, STEEL, mesh_cards, write_table
from meshes import box

LENGTH, WIDTH, HEIGHT = SIZE
STIFF = 1e6
ORIENTED = "*ORIENTATION, NAME=O\n0.6, 0.8, 0., -0.8, 0.6, 0.\n"
# Type, both ends (the second one a place of the bar, of the ground, or none), the cards.
SPRINGS = {
    "line to the ground": ("SPRINGA", (LENGTH, -0.3, 0.2), "*SPRING, ELSET=S\n\n{k}\n"),
    "line within the bar": ("SPRINGA", (0.2, 0.0, 0.0), "*SPRING, ELSET=S\n\n{k}\n"),
    "axis to the ground": ("SPRING1", None, "*SPRING, ELSET=S\n2\n{k}\n"),
    "own axis to the ground": ("SPRING1", None, ORIENTED + "*SPRING, ELSET=S, ORIENTATION=O\n1\n{k}\n"),
    "axis within the bar": ("SPRING2", (0.2, 0.0, 0.0), "*SPRING, ELSET=S\n2, 2\n{k}\n"),
    "node of equations": ("SPRINGA", (LENGTH, -0.3, 0.2), "*SPRING, ELSET=S\n\n{k}\n"),
    # Solvers take springs along global axes whatever *TRANSFORM says of their nodes.
    "node with axes": (
        "SPRING2",
        (0.2, 0.0, 0.0),
        f"*TRANSFORM, NSET=END{ORIENTED[20:]}*SPRING, ELSET=S\n2, 2\n{{k}}\n",
    ),
}


def deck(name):
    """The model part of a bar's deck, and the labels of its tip."""
    kind, other, cards = SPRINGS[name]
    mesh = box(ElementType.C3D20R, COUNTS, SIZE)

    def at(place):
        distance = np.linalg.norm(mesh.points - mesh.points.min(axis=0) - place, axis=1)
        return int(mesh.labels[np.argmin(distance)]) if distance.min() < 1e-9 else 0

    lines = mesh_cards(mesh)
    for which, rows in mesh.node_sets.items():
        lines += [f"*NSET, NSET={which}", *(f"{label}," for label in mesh.labels[rows])]
    ends = [at((LENGTH, 0.0, 0.0))]
    if other is not None and not at(other):
        low = mesh.points.min(axis=0) + other
        lines += ["*NODE", "9001, " + ", ".join(map(repr, low.tolist())), "*BOUNDARY", "9001, 1, 3"]
    if other is not None:
        ends.append(at(other) or 9001)
    if name == "node of equations":
        # The mean of the corners of the tip.
        corners = [at((LENGTH, y, z)) for y in (0.0, WIDTH) for z in (0.0, HEIGHT)]
        low = mesh.points[mesh.node_sets["TIP"]].min(axis=0)
        middle = low + np.array([0.0, 0.5 * WIDTH, 0.5 * HEIGHT])
        lines += ["*NODE", "9002, " + ", ".join(map(repr, middle.tolist())), "*EQUATION"]
        for axis in (1, 2, 3):
            lines += ["5", f"9002, {axis}, -4.", *(f"{corner}, {axis}, 1." for corner in corners)]
        ends[0] = 9002
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=S", ", ".join(map(str, [9001, *ends]))]
    lines += ["*NSET, NSET=END", str(ends[-1])]
    return "\n".join(lines) + "\n" + STEEL + cards.format(k=STIFF), mesh.labels[mesh.node_sets["TIP"]]


if __name__ == "__main__":
    write_table(HERE / "spring_bars.csv", {name: deck(name) for name in SPRINGS})
