"""Surfaces of a deck: their nodes, and their faces."""

from typing import NamedTuple

import numpy as np

from flexfmu.files.array_types import IntArray
from flexfmu.mesh.decks.cards import Card, Line, fields
from flexfmu.mesh.decks.geometry import Elements
from flexfmu.mesh.decks.sets import SetTable

# Sides of a face, an edge's own surface: all its nodes.
_SIDES = ("SPOS", "SNEG", "SP", "SN", "", "S1", "S2", "S3", "S4", "EDGE", "E1", "E2", "E3", "E4")


class DeckSurface(NamedTuple):
    """A surface.

    Attributes
    ----------
    nodes : (k,) int
        Ascending.
    faces : tuple of (f, a) int
        Nodes of solid elements' faces, corners in order around them, then mid-sides; none of a surface of nodes.
    """

    nodes: IntArray
    faces: tuple[IntArray, ...]


def surface(card: Card, node_sets: SetTable, element_sets: SetTable, elements: Elements) -> DeckSurface:
    """Return the surface of a *SURFACE card.

    Parameters
    ----------
    card : Card
        TYPE=NODE, or TYPE=ELEMENT with a face S1 ... S6 on each row.
    node_sets, element_sets : SetTable
    elements : Elements

    Returns
    -------
    DeckSurface

    Raises
    ------
    DeckError
        A member is unknown, or a row does not name a face of its elements.
    """
    kind = card.parameters.get("TYPE", "ELEMENT").upper()
    if kind not in ("NODE", "ELEMENT"):
        raise card.line.error(f"*SURFACE, TYPE={kind} is not supported (supported: NODE, ELEMENT); name its nodes")
    rows: set[int] = set()
    faces: dict[int, list[IntArray]] = {}
    for line in card.data:
        entry, *rest = fields(line)
        if kind == "NODE":
            rows |= node_sets.find(entry, line, node_sets.inside(card))
            continue
        members = element_sets.find(entry, line, element_sets.inside(card))
        face = rest[0].upper() if rest else ""
        for found in _faces(members, face, elements, line):
            faces.setdefault(found.shape[1], []).append(found)
            rows.update(found.ravel().tolist())
        if face in _SIDES:
            rows.update(*(elements.nodes.rows_of(other) for other in elements.others_of(members)))
            rows |= elements.shell_nodes_of(members)
    return DeckSurface(np.array(sorted(rows), dtype=np.int64), tuple(np.concatenate(found) for found in faces.values()))


def _faces(members: set[int], name: str, elements: Elements, line: Line) -> list[IntArray]:
    """Nodes (f, a) of a face of each solid element among some, by kind."""
    found: list[IntArray] = []
    for block, inside in elements.solids_of(members):
        if block.type.natural:
            continue
        faces = {f"S{number}": nodes for number, nodes in enumerate(block.type.shape.faces, start=1)}
        if name not in faces:
            raise line.error(
                f"expected a face of {block.type.name} ({', '.join(faces)}) after the comma, "
                f"found '{name}'; name the face"
            )
        found.append(block.connectivity[inside][:, faces[name]])
    return found
