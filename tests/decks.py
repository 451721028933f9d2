"""Small decks for tests, flat and of parts and instances, and how they are read and refused."""

from pathlib import Path

import pytest

from flexfmu.files.basics import DeckError, UnitSystem
from flexfmu.mesh.decks.deck import read_deck

NODES = """*NODE, NSET=Nall
1, 0., 0., 0.
2, 2., 0., 0.
3, 2., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 2., 0., 1.
7, 2., 1., 1.
8, 0., 1., 1.
"""
BRICK = "*ELEMENT, TYPE=C3D8, ELSET=Eall\n11, 1, 2, 3, 4, 5, 6, 7, 8\n"
STEEL = "*MATERIAL, NAME=Steel\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n*SOLID SECTION, ELSET=Eall, MATERIAL=Steel\n"
BODY = NODES + BRICK + STEEL
PART = (
    "*Part, name=Bar\n*Node\n"
    + NODES.split("\n", 1)[1]
    + BRICK.replace("Eall", "Solid")
    + """*Nset, nset=Root, generate
1, 4, 1
*Elset, elset=_Top_S2, internal
11
*Surface, type=ELEMENT, name=Top
_Top_S2, S2
** Section: Section-1
*Solid Section, elset=Solid, material=Steel
,
*End Part
"""
)
MATERIAL = "*Material, name=Steel\n*Density\n7850.,\n*Elastic\n2.1e11, 0.3\n"
ASSEMBLY = """*Assembly, name=Assembly
*Instance, name=Bar-1, part=Bar
*End Instance
*Instance, name=Bar-2, part=Bar
10., 0., 0.
10., 0., 0., 10., 0., 1., 90.
*End Instance
*Node
1, 5., 5., 5.
*Nset, nset=Point
1
*Nset, nset=Both, instance=Bar-1
Root
*Nset, nset=Both, instance=Bar-2
5, 6
*Elset, elset=_Face_S1, internal, instance=Bar-2
11
*Surface, type=ELEMENT, name=Face
_Face_S1, S1
*End Assembly
"""
CAE = "*Heading\n*Preprint, echo=NO\n" + PART + ASSEMBLY + MATERIAL
COUPLING = """*NODE
100, 2., 0.5, 0.5
*NSET, NSET=RP
100
*SURFACE, NAME=End
11, S4
*COUPLING, CONSTRAINT NAME=Flange, REF NODE=RP, SURFACE=End
*KINEMATIC
1, 3
"""


def read(folder: Path, text: str, units: UnitSystem = UnitSystem.SI):
    path = folder / "body.inp"
    path.write_text(text)
    return read_deck(path, units)


def set_labels(mesh, name: str) -> list[int]:
    return mesh.labels[mesh.node_sets[name]].tolist()


def line_of(text: str, part: str) -> int:
    return next(number for number, line in enumerate(text.split("\n"), 1) if part in line)


def refuse(folder: Path, text: str, culprit: str, *words: str) -> None:
    """Check that reading fails at the line that holds `culprit`, with these words."""
    with pytest.raises(DeckError) as caught:
        read(folder, text)
    assert caught.value.line == line_of(text, culprit)
    assert caught.value.file == str(folder / "body.inp")
    for word in words:
        assert word in str(caught.value)
