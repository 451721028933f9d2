"""Surfaces of a deck, as the sets of their nodes."""

from collections.abc import Callable, Sequence

import numpy as np

from flexfmu.files.array_types import IntArray
from flexfmu.mesh.blocks import ElementBlock
from flexfmu.mesh.decks.cards import Card, Line, fields
from flexfmu.mesh.decks.sets import SetTable

# Sides of a face, an edge's own surface: all its nodes.
_SIDES = ("SPOS", "SNEG", "SP", "SN", "", "S1", "S2", "S3", "S4", "EDGE", "E1", "E2", "E3", "E4")


def surface_nodes(
    card: Card,
    node_sets: SetTable,
    element_sets: SetTable,
    blocks: Sequence[ElementBlock],
    other_nodes: Callable[[int], list[int]],
) -> IntArray:
    """Return the nodes of a *SURFACE card.

    Parameters
    ----------
    card : Card
        TYPE=NODE, or TYPE=ELEMENT with a face S1 ... S6 on each row.
    node_sets, element_sets : SetTable
    blocks : sequence of ElementBlock
    other_nodes : callable
        Nodes of an element that is no solid, by its position.

    Returns
    -------
    (k,) int
        Rows of the nodes, ascending.

    Raises
    ------
    DeckError
        A member is unknown, or a row does not name a face of its elements.
    """
    kind = card.parameters.get("TYPE", "ELEMENT").upper()
    rows: set[int] = set()
    if kind not in ("NODE", "ELEMENT"):
        raise card.line.error(f"*SURFACE, TYPE={kind} is not supported (supported: NODE, ELEMENT); name its nodes")
    for line in card.data:
        entry, *rest = fields(line)
        if kind == "NODE":
            rows |= node_sets.find(entry, line, node_sets.inside(card))
        else:
            found = element_sets.find(entry, line, element_sets.inside(card))
            face = rest[0].upper() if rest else ""
            positions = np.array(sorted(found), dtype=np.int64)
            rows.update(node for part in _faces(positions, face, blocks, line) for node in part.ravel().tolist())
            last = sum(len(block.labels) for block in blocks)
            if face in _SIDES:
                rows.update(row for place in found if place >= last for row in other_nodes(place))
    return np.array(sorted(rows), dtype=np.int64)


def surface_faces(card: Card, element_sets: SetTable, blocks: Sequence[ElementBlock]) -> tuple[IntArray, ...]:
    """Return the faces of a *SURFACE card of solid elements.

    Parameters
    ----------
    card : Card
    element_sets : SetTable
    blocks : sequence of ElementBlock

    Returns
    -------
    tuple of (f, a) int
        Nodes of faces, corners in order around them, then mid-sides; none of a surface of nodes.

    Raises
    ------
    DeckError
        As of `surface_nodes`.
    """
    found: dict[int, list[IntArray]] = {}
    for line in card.data if card.parameters.get("TYPE", "ELEMENT").upper() == "ELEMENT" else ():
        entry, *rest = fields(line)
        positions = np.array(sorted(element_sets.find(entry, line, element_sets.inside(card))), dtype=np.int64)
        for part in _faces(positions, rest[0].upper() if rest else "", blocks, line):
            found.setdefault(part.shape[1], []).append(part)
    return tuple(np.concatenate(parts) for parts in found.values())


def _faces(positions: IntArray, face: str, blocks: Sequence[ElementBlock], line: Line) -> list[IntArray]:
    """Nodes (f, a) of a face of each solid element at some positions, by kind."""
    found: list[IntArray] = []
    start = 0
    for block in blocks:
        count = len(block.labels)
        inside = positions[(positions >= start) & (positions < start + count)] - start
        start += count
        if len(inside):
            faces = {f"S{number}": nodes for number, nodes in enumerate(block.type.shape.faces, start=1)}
            if face not in faces:
                raise line.error(
                    f"expected a face of {block.type.name} ({', '.join(faces)}) after the comma, "
                    f"found '{face}'; name the face"
                )
            found.append(block.connectivity[inside][:, faces[face]])
    return found
