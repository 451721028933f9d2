"""*TIE of shells whose meshes do not fit: plates that go on, stand on each other, or overlap."""

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from flexfmu import read_mesh
from flexfmu.fe.assembly import stiffness
from flexfmu.files.basics import DeckError, MeshError
from flexfmu.mesh.checks import checked
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.options import BodyOptions

THICK, LONG, WIDE = 0.002, 0.2, 0.1
MATERIAL = "*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850\n"


class Deck:
    """Plates of S4, and sets of their nodes."""

    def __init__(self):
        self.text, self.at, self.elements = "*NODE\n", {}, ""

    def plate(self, name, origin, along, counts):
        """Add a plate that reaches 0.1 along y; the rows of its nodes, by position."""
        first, grid = len(self.at) + 1, np.indices((counts[0] + 1, counts[1] + 1)).reshape(2, -1).T / counts
        for label, (u, v) in enumerate(grid, first):
            self.at[label] = np.array(origin) + u * np.array(along) + [0.0, v * WIDE, 0.0]
            self.text += f"{label}, {', '.join(f'{x:.12g}' for x in self.at[label])}\n"
        rows = np.arange(first, first + len(grid)).reshape(counts[0] + 1, counts[1] + 1)
        corners = np.stack([rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]], axis=2).reshape(-1, 4)
        self.elements += f"*ELEMENT, TYPE=S4, ELSET={name}\n"
        self.elements += "".join(f"{first + k}, {', '.join(map(str, row))}\n" for k, row in enumerate(corners))
        self.elements += f"*SHELL SECTION, ELSET={name}, MATERIAL=M\n{THICK}\n*SURFACE, NAME={name}\n{name}, SPOS\n"
        return rows

    def written(self, path, tail="", **sets):
        """The deck in a file."""
        named = "".join(f"*NSET, NSET={name}\n" + "".join(f"{k},\n" for k in rows) for name, rows in sets.items())
        path.write_text(self.text + self.elements + named + tail + MATERIAL)
        return path


def tied(path, joint):
    """Two plates whose meshes do not fit, the second one on the first."""
    deck = Deck()
    reach = 0.24 if joint == "overlap" else 2.0 * LONG if joint == "upright" else LONG
    first = deck.plate("A", (0.0, 0.0, 0.0), (reach, 0.0, 0.0), (round(reach / 0.02), 5))
    lift = THICK if joint == "overlap" else 0.0
    along = (0.0, 0.0, LONG) if joint == "upright" else (LONG, 0.0, 0.0)
    second = deck.plate("B", (LONG, 0.0, lift), along, (10, 7))
    on = second[:3] if joint == "overlap" else second[:1]
    tail = "*SURFACE, NAME=ON, TYPE=NODE\nON\n*TIE, NAME=T\nON, A\n"
    return deck.written(path, tail, ROOT=first[0], TIP=second[-1], ON=on.ravel())


def shared(path, joint):
    """The same in one mesh."""
    deck = Deck()
    first = deck.plate("A", (0.0, 0.0, 0.0), (2.0 * LONG, 0.0, 0.0), (20, 5))
    if joint == "on":
        return deck.written(path, ROOT=first[0], TIP=first[-1])
    second = deck.plate("B", (LONG, 0.0, 0.0), (0.0, 0.0, LONG), (10, 5))
    words = deck.elements.splitlines()
    same = {str(one): str(other) for one, other in zip(second[0], first[10], strict=True)}
    start = words.index("*ELEMENT, TYPE=S4, ELSET=B")
    for k in range(start + 1, len(words)):
        if words[k].startswith("*"):
            break
        label, *nodes = words[k].split(", ")
        words[k] = ", ".join([label, *(same.get(node, node) for node in nodes)])
    deck.elements = "\n".join(words) + "\n"
    return deck.written(path, ROOT=first[0], TIP=second[-1])


def flexibility(path):
    """Mean displacement of the tip under its unit forces, (3, 3)."""
    mesh = checked(read_mesh(path))
    mesh.fixed[mesh.node_sets["ROOT"]] = True
    model = assemble_model(mesh, BodyOptions("plates", ()))
    matrix = model.unknowns.matrix(stiffness(model.mesh)).tocsc()
    tip = mesh.node_sets["TIP"]
    forces = np.zeros((len(mesh.points), 3, 3))
    forces[tip] = np.eye(3) / tip.size
    moved = model.unknowns.whole(spla.splu(matrix).solve(model.unknowns.forces(forces.reshape(-1, 3))))
    return moved.reshape(-1, 3, 3)[tip].mean(axis=0)


@pytest.mark.parametrize("joint", ["on", "upright"])
def test_plates_that_are_tied_bend_as_one_mesh(tmp_path, joint):
    ours, one = flexibility(tied(tmp_path / "two.inp", joint)), flexibility(shared(tmp_path / "one.inp", joint))
    size = np.sqrt(np.outer(one.diagonal(), one.diagonal()))
    assert np.abs((ours - one) / size).max() < 5e-3


@pytest.mark.parametrize("joint", ["on", "upright", "overlap"])
def test_ties_of_shells_let_both_turn_together(tmp_path, joint):
    mesh = read_mesh(tied(tmp_path / "two.inp", joint))
    turn = np.cross(np.eye(3), [0.3, -0.5, 0.7])
    np.testing.assert_allclose(mesh.equations @ (mesh.points @ turn + [1.0, 2.0, 3.0]).ravel(), 0.0, atol=1e-12)
    count = 24 if joint == "overlap" else 8
    assert mesh.equations.shape[0] == 6 * count
    assert any(f"{count} nodes of 'ON' are tied to shells of 'A' and turn with them" in note for note in mesh.notes)


def test_plates_that_overlap_are_twice_as_thick_there(tmp_path):
    """By beam theory, of eight times the stiffness between 0.2 and 0.24 m."""
    bent = flexibility(tied(tmp_path / "two.inp", "overlap"))[2, 2]
    stiff = 2.1e11 * WIDE * THICK**3 / 12.0
    expected = ((0.4**3 - LONG**3) + (LONG**3 - 0.16**3) / 8.0 + 0.16**3) / (3.0 * stiff)
    # A plate that cannot narrow where it is held is stiffer by up to ν².
    assert 0.90 * expected < bent < expected


def brick(deck, thick, card):
    """A brick of 2 × 7 × 3 elements before the plate's beginning, and what joins both."""
    first, counts = len(deck.at) + 1, (2, 7, 3)
    places = np.indices((3, 8, 4)).reshape(3, -1).T / counts * [0.05, WIDE, thick] - [0.05, 0.0, 0.5 * thick]
    deck.text += "".join(f"{k}, {', '.join(f'{x:.12g}' for x in p)}\n" for k, p in enumerate(places, first))
    rows = np.arange(first, first + len(places)).reshape(3, 8, 4)
    deck.elements += "*ELEMENT, TYPE=C3D8I, ELSET=C\n"
    for k, (x, y, z) in enumerate(np.ndindex(*counts), 5000):
        corners = [rows[x + i, y + j, z + h] for h in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        deck.elements += f"{k}, {', '.join(map(str, corners))}\n"
    deck.elements += "*SOLID SECTION, ELSET=C, MATERIAL=M\n*SURFACE, NAME=C\nC, S4\n"
    return rows[0].ravel(), f"*SURFACE, NAME=ON, TYPE=NODE\nON\n{card}\nON, C\n"


def test_an_edge_of_shells_coupled_to_solids_is_held_as_if_it_were_clamped(tmp_path):
    """A stiff block on supports; its end turns by what its own beam theory says, a hundredth of the plate's."""
    one = Deck()
    plate = one.plate("A", (0.0, 0.0, 0.0), (LONG, 0.0, 0.0), (10, 5))
    clamped = flexibility(one.written(tmp_path / "one.inp", ROOT=plate[0], TIP=plate[-1]))
    deck = Deck()
    plate = deck.plate("A", (0.0, 0.0, 0.0), (LONG, 0.0, 0.0), (10, 5))
    root, tail = brick(deck, 0.02, "*SHELL TO SOLID COUPLING, CONSTRAINT NAME=J")
    coupled = flexibility(deck.written(tmp_path / "two.inp", tail, ROOT=root, TIP=plate[-1], ON=plate[0]))
    more = coupled[2, 2] / clamped[2, 2] - 1.0
    # Bending of the block, and what the plate's end digs into it.
    assert 1e-3 < more < 0.03
    mesh = read_mesh(tmp_path / "two.inp")
    turn = np.cross(np.eye(3), [0.3, -0.5, 0.7])
    np.testing.assert_allclose(mesh.equations @ (mesh.points @ turn + [1.0, 2.0, 3.0]).ravel(), 0.0, atol=1e-12)


def test_an_edge_thicker_than_the_faces_that_hold_it_is_refused(tmp_path):
    deck = Deck()
    plate = deck.plate("A", (0.0, 0.0, 0.0), (LONG, 0.0, 0.0), (4, 2))
    root, tail = brick(deck, 0.5 * THICK, "*SHELL TO SOLID COUPLING, CONSTRAINT NAME=J")
    with pytest.raises(MeshError, match="thicker than the faces that hold it"):
        read_mesh(deck.written(tmp_path / "thin.inp", tail, ROOT=root, ON=plate[0]))


def test_ties_of_shells_to_solids_are_refused(tmp_path):
    deck = Deck()
    plate = deck.plate("A", (0.0, 0.0, 0.0), (LONG, 0.0, 0.0), (4, 2))
    root, tail = brick(deck, 0.02, "*TIE, NAME=T")
    with pytest.raises(DeckError, match="turn freely there: let the shells be the second surface"):
        read_mesh(deck.written(tmp_path / "both.inp", tail, ROOT=root, ON=plate[0]))
