"""Nodes and elements of a deck."""

import math
from dataclasses import dataclass, field

import numpy as np

from flexfmu.errors import DeckError
from flexfmu.mesh.deck_cards import Card, Line, fields, integer, number
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import NO_MATERIAL, ElementBlock, ElementType, FloatArray, IntArray

# CalculiX and Abaqus end a data line here at the latest, so that a shorter row is one line.
FIELDS_PER_LINE = 16

SUPPORTED_TYPES = tuple(kind.value for kind in ElementType)


@dataclass(slots=True)
class NodeTable:
    """The nodes read so far.

    Attributes
    ----------
    coordinates : list of tuple of float
        In the deck's units.
    rows : dict of int to int
        Row of each label, in order of appearance.
    """

    coordinates: list[tuple[float, float, float]] = field(default_factory=list)
    rows: dict[int, int] = field(default_factory=dict)

    def add(self, card: Card) -> list[int]:
        """Take a *NODE card's nodes.

        Parameters
        ----------
        card : Card

        Returns
        -------
        list of int
            The card's labels.

        Raises
        ------
        DeckError
            A number is malformed, or a label comes twice with different coordinates.
        """
        labels = []
        for line in card.data:
            label, point = _node(line)
            row = self.rows.setdefault(label, len(self.coordinates))
            if row == len(self.coordinates):
                self.coordinates.append(point)
            elif self.coordinates[row] != point:
                raise line.error(
                    f"node {label} is defined again at {point}, before at {self.coordinates[row]}; renumber one of them"
                )
            labels.append(label)
        return labels

    def points(self) -> FloatArray:
        """Coordinates, (n, 3), in the deck's units."""
        return np.array(self.coordinates, dtype=float).reshape(-1, 3)

    def labels(self) -> IntArray:
        """Node numbers, (n,)."""
        return np.fromiter(self.rows, dtype=np.int64, count=len(self.rows))


@dataclass(slots=True)
class ElementTable:
    """The elements read so far.

    Attributes
    ----------
    labels, nodes, lines : dict of ElementType to list
        Label, node labels and first line of each element, in order of appearance.
    types : dict of int to tuple of ElementType and int
        Type of each element label, and its place among the elements of that type.
    """

    labels: dict[ElementType, list[int]] = field(default_factory=dict)
    nodes: dict[ElementType, list[list[int]]] = field(default_factory=dict)
    lines: dict[ElementType, list[Line]] = field(default_factory=dict)
    types: dict[int, tuple[ElementType, int]] = field(default_factory=dict)

    def add(self, card: Card) -> list[int]:
        """Take an *ELEMENT card's elements.

        Parameters
        ----------
        card : Card

        Returns
        -------
        list of int
            The card's labels.

        Raises
        ------
        DeckError
            The type is not supported, a row has the wrong number of nodes, a number is malformed, or a label
            comes twice with different nodes.
        """
        name = card.required("TYPE").upper()
        if name not in SUPPORTED_TYPES:
            raise card.line.error(
                f"element type {name} is not supported (supported: {', '.join(SUPPORTED_TYPES)}); "
                f"mesh the body with these solid elements, or take these elements out"
            )
        kind = ElementType(name)
        for table in (self.labels, self.nodes, self.lines):
            table.setdefault(kind, [])
        labels = []
        for line, row in _element_rows(card, kind):
            self._store(kind, row, line)
            labels.append(row[0])
        return labels

    def positions(self) -> dict[int, int]:
        """Position of each label in the blocks laid end to end."""
        labels = [label for block in self.labels.values() for label in block]
        return dict(zip(labels, range(len(labels)), strict=True))

    def blocks(self, nodes: NodeTable) -> tuple[ElementBlock, ...]:
        """Return the elements by type, in the order in which the types appear, without materials.

        Parameters
        ----------
        nodes : NodeTable

        Returns
        -------
        tuple of ElementBlock

        Raises
        ------
        DeckError
            An element names a node that the deck does not define.
        """
        blocks = []
        for kind, labels in self.labels.items():
            if labels:
                connectivity = self._connectivity(kind, nodes)
                material = np.full(len(labels), NO_MATERIAL, dtype=np.int64)
                blocks.append(ElementBlock(kind, np.array(labels, dtype=np.int64), connectivity, material))
        return tuple(blocks)

    def _store(self, kind: ElementType, row: list[int], line: Line) -> None:
        label, nodes = row[0], row[1:]
        if label <= 0:
            raise line.error(f"element numbers should be positive, found {label}")
        known = self.types.setdefault(label, (kind, len(self.labels[kind])))
        if known == (kind, len(self.labels[kind])):
            self.labels[kind].append(label)
            self.nodes[kind].append(nodes)
            self.lines[kind].append(line)
        elif known[0] is not kind or self.nodes[kind][known[1]] != nodes:
            before = self.lines[known[0]][known[1]]
            raise line.error(
                f"element {label} is defined again, differently from {before.file}, line {before.number}; "
                f"renumber one of them"
            )

    def _connectivity(self, kind: ElementType, nodes: NodeTable) -> IntArray:
        wanted = np.array(self.nodes[kind], dtype=np.int64)
        known = nodes.labels()
        order = np.argsort(known)
        places = np.searchsorted(known, wanted, sorter=order)
        rows: IntArray = order[np.minimum(places, len(known) - 1)] if len(known) else np.zeros_like(wanted)
        wrong = known[rows] != wanted if len(known) else np.ones(wanted.shape, dtype=bool)
        if wrong.any():
            first = int(np.argmax(wrong.any(axis=1)))
            raise self.lines[kind][first].error(
                f"element {self.labels[kind][first]} names nodes that are not defined: "
                f"{listed(wanted[first][wrong[first]])}; add them with *NODE or correct the element"
            )
        return rows


def _node(line: Line) -> tuple[int, tuple[float, float, float]]:
    parts = line.text.split(",")
    try:
        # The regular row, four times as fast as the careful way below.
        label, x, y, z = int(parts[0]), float(parts[1]), float(parts[2]), float(parts[3])
        regular = len(parts) == 4 and label > 0 and math.isfinite(x + y + z)
    except (ValueError, IndexError):
        regular = False
    return (label, (x, y, z)) if regular else _irregular_node(line)


def _irregular_node(line: Line) -> tuple[int, tuple[float, float, float]]:
    """Read a node row with missing coordinates (zero, as the solvers have it) or an error."""
    parts = fields(line)
    label = integer(parts[0], line, "the node number")
    if label <= 0:
        raise line.error(f"node numbers should be positive, found {label}")
    if any(parts[4:]):
        raise line.error(f"node {label} has {len(parts) - 1} coordinates, expected 3; keep x, y and z")
    x, y, z = (
        number(text, line, f"coordinate {axis} of node {label}") if text else 0.0
        for axis, text in zip("xyz", [*parts[1:4], "", "", ""][:3], strict=True)
    )
    return label, (x, y, z)


def _element_rows(card: Card, kind: ElementType) -> list[tuple[Line, list[int]]]:
    """Return label and node labels of each element with its first line; rows go on until they are full."""
    rows: list[tuple[Line, list[int]]] = []
    length = kind.node_count + 1
    row: list[int] = []
    first = card.line
    for line in card.data:
        if not row:
            first = line
        row += _integers(line)
        may_go_on = line.text.endswith(",") or length > FIELDS_PER_LINE
        if len(row) == length:
            rows.append((first, row))
            row = []
        elif len(row) > length or not may_go_on:
            raise _miscounted(first, row, kind)
    if row:
        raise _miscounted(first, row, kind)
    return rows


def _integers(line: Line) -> list[int]:
    try:
        return [int(part) for part in line.text.rstrip(",").split(",")]
    except ValueError:
        return [integer(text, line, "an element's row") for text in fields(line)]


def _miscounted(line: Line, row: list[int], kind: ElementType) -> DeckError:
    return line.error(
        f"element {row[0]} has {len(row) - 1} nodes, expected {kind.node_count} for {kind.value}; "
        f"correct the row or the element type (rows that go on in the next line end with a comma)"
    )
