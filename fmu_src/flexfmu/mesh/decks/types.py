"""Element names of Abaqus and CalculiX decks: which solid element each is read as, and which serve sets only."""

import re
from dataclasses import dataclass

from flexfmu.mesh.decks.keywords import WORDS
from flexfmu.mesh.elements import ElementType

_SOLIDS = [kind for kind in ElementType if not kind.natural]
_PAIRS = {name: told.split() for name, told in WORDS["read_as"].items()}
READ_AS = {name: (ElementType[kind], str(WORDS["reasons"][why])) for name, (kind, why) in _PAIRS.items()}
"""Names that stand for another element of small strains, with the reason."""

# Nodes of faces, edges and points by the beginnings of their names; a family's nodes are the digits that follow.
_FACE = re.compile(r"(CPS|CPEG|CPE|CAX|DC2D|DS|M3D|SFM3D|R3D|STRI|S|DC1D|T2D|T3D|B2|B3|RB3D)(\d)")
_EDGES = {"DC1D", "T2D", "T3D", "RB3D"}
# Beams count their order, 1 to 3, instead of their nodes.
_BEAM = {"1": 2, "2": 3, "3": 2}

SUPPORTED = ", ".join([*(kind.name for kind in _SOLIDS), *READ_AS])


@dataclass(frozen=True, slots=True)
class Reading:
    """What an element name is read as.

    Attributes
    ----------
    solid : ElementType or None
        None for what is no solid.
    node_count : int
    dimension : int
        3 for solids, 2 for faces, 1 for edges, 0 for a mass, an inertia or a spring at nodes.
    note : str
        What the name says beyond `solid`; empty without such.
    """

    solid: ElementType | None
    node_count: int
    dimension: int
    note: str = ""


def reading(name: str) -> Reading | None:
    """Return what an element name is read as.

    Parameters
    ----------
    name : str
        In capitals.

    Returns
    -------
    Reading or None
        None where it is not known, or not supported.
    """
    if (kind := next((one for one in _SOLIDS if one.name == name), None)) is not None:
        return Reading(kind, kind.node_count, 3)
    if name in READ_AS:
        kind, note = READ_AS[name]
        return Reading(kind, kind.node_count, 3, note)
    if re.fullmatch("(SPRING|DASHPOT)[A12]|GAPUNI", name):
        return Reading(None, 1 if name[-1] == "1" else 2, 0)
    if name in ("MASS", "ROTARYI", "DCOUP3D"):
        return Reading(None, 1, 0)
    found = _FACE.match(name)
    if found is None:
        return None
    family, digit = found.groups()
    if name == "STRI65":
        return Reading(None, 6, 2)
    if family in ("B2", "B3"):
        return Reading(None, _BEAM[digit], 1) if digit in _BEAM else None
    if family in _EDGES:
        return Reading(None, int(digit), 1) if digit in "23" else None
    return Reading(None, int(digit), 2) if digit in "34689" else None
