"""Nodes and elements of a deck."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

import numpy as np

from flexfmu.files.basics import DeckError, FloatArray, IntArray, listed
from flexfmu.mesh.decks.cards import Card, Line, fields, integer, number
from flexfmu.mesh.decks.types import SUPPORTED, reading
from flexfmu.mesh.elements import ElementBlock, ElementType, by_block
from flexfmu.mesh.model import NO_MATERIAL

# CalculiX and Abaqus end a data line here at the latest, so that a shorter row is one line.
FIELDS_PER_LINE = 16
# Far beyond any mesh, and within 64 bits also where instances add to numbers.
HIGHEST_LABEL = 10**12


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
        scope = card.scope
        for line in card.data:
            label, point = _node(line)
            if scope.rotation is not None and scope.shift is not None:
                x, y, z = (scope.rotation @ point + scope.shift).tolist()
                point = (x, y, z)
            label += scope.offset
            row = self.rows.setdefault(label, len(self.coordinates))
            if row == len(self.coordinates):
                self.coordinates.append(point)
            elif self.coordinates[row] != point:
                before = self.coordinates[row]
                raise line.error(f"node {label} is defined again at {point}, before at {before}; renumber one of them")
            labels.append(label)
        return labels

    def rows_of(self, element: "Element") -> list[int]:
        """Return the rows of an element's nodes.

        Parameters
        ----------
        element : Element

        Returns
        -------
        list of int

        Raises
        ------
        DeckError
            A node is not defined.
        """
        try:
            return [self.rows[label] for label in element.nodes]
        except KeyError:
            missing = [label for label in element.nodes if label not in self.rows]
            found = f"element {element.label} names nodes that are not defined: {listed(missing)}"
            raise element.line.error(f"{found}; add them with *NODE or correct the element") from None

    def points(self) -> FloatArray:
        """Coordinates, (n, 3), in the deck's units."""
        return np.array(self.coordinates, dtype=float).reshape(-1, 3)

    def labels(self) -> IntArray:
        """Node numbers, (n,)."""
        return np.fromiter(self.rows, dtype=np.int64, count=len(self.rows))


class Element(NamedTuple):
    """An element as the deck has it.

    Attributes
    ----------
    label : int
    name : str
        Its type.
    solid : ElementType or None
        None for a face, an edge or a point, whose nodes serve sets.
    nodes : list of int
        Labels.
    dimension : int
    line : Line
        Its first.
    """

    label: int
    name: str
    solid: ElementType | None
    nodes: list[int]
    dimension: int
    line: Line


@dataclass(frozen=True, slots=True)
class Elements:
    """All elements by their position: solids block by block, then the others.

    Attributes
    ----------
    blocks : tuple of ElementBlock
    others : tuple of Element
    nodes : NodeTable
    """

    blocks: tuple[ElementBlock, ...]
    others: tuple[Element, ...]
    nodes: NodeTable

    @property
    def solid_count(self) -> int:
        """Number of solid elements."""
        return sum(len(block.labels) for block in self.blocks)

    def solids_of(self, positions: Iterable[int]) -> list[tuple[ElementBlock, IntArray]]:
        """Blocks with some of the elements, and their places in them."""
        return list(by_block(self.blocks, np.array(sorted(positions), dtype=np.int64)))

    def shell_nodes_of(self, positions: Iterable[int]) -> set[int]:
        """Rows of the nodes of those that are shells or beams."""
        chosen = [block.connectivity[inside] for block, inside in self.solids_of(positions) if block.type.natural]
        return {row for rows in chosen for row in rows.ravel().tolist()}

    def others_of(self, positions: Iterable[int]) -> list[Element]:
        """Those of the elements that are no solids."""
        first = self.solid_count
        return [self.others[place - first] for place in sorted(positions) if place >= first]

    def nodes_of(self, positions: Iterable[int]) -> set[int]:
        """Rows of the elements' nodes."""
        solid = {row for b, inside in self.solids_of(positions) for row in b.connectivity[inside].ravel().tolist()}
        return solid.union(*(self.nodes.rows_of(other) for other in self.others_of(positions)))


@dataclass(slots=True)
class ElementTable:
    """The elements read so far.

    Attributes
    ----------
    known : dict of int to Element
        By label.
    notes : dict of str to None
        What types were read as others; each once.
    """

    known: dict[int, Element] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)

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
        kind = reading(name)
        if kind is None:
            raise card.line.error(
                f"element type {name} is not supported (supported: {SUPPORTED}; faces and edges without a section "
                "serve sets); mesh what it stands for with solid elements"
            )
        labels = []
        rows, cut = _element_rows(card, name, kind.node_count)
        if cut:
            self.notes.setdefault(f"{cut} rows of {name} name more than {kind.node_count} nodes: the rest is left out")
        for line, row in rows:
            self._store(Element(row[0], name, kind.solid, row[1:], kind.dimension, line))
            labels.append(row[0])
        if kind.solid is not None and kind.note and labels:
            self.notes.setdefault(f"elements of type {name} are read as {kind.solid.name}: {kind.note}")
        return labels

    def _by_type(self) -> tuple[dict[ElementType, list[Element]], list[Element]]:
        """Solids by type, in the order in which the types appear, and the others."""
        solids: dict[ElementType, list[Element]] = {}
        others: list[Element] = []
        for element in self.known.values():
            (others if element.solid is None else solids.setdefault(element.solid, [])).append(element)
        return solids, others

    def positions(self) -> dict[int, int]:
        """Position of each label in the blocks laid end to end; what is no solid comes after them."""
        solids, others = self._by_type()
        return {element.label: place for place, element in enumerate(chain(*solids.values(), others))}

    def resolved(self, nodes: NodeTable) -> Elements:
        """Return all elements, without materials; solids by type, in the order in which the types appear.

        Parameters
        ----------
        nodes : NodeTable

        Returns
        -------
        Elements

        Raises
        ------
        DeckError
            A solid element names a node that the deck does not define.
        """
        solids, others = self._by_type()
        blocks = []
        for kind, members in solids.items():
            labels = np.array([element.label for element in members], dtype=np.int64)
            connectivity = np.array([nodes.rows_of(element) for element in members], dtype=np.int64)
            blocks.append(ElementBlock(kind, labels, connectivity, np.full(len(members), NO_MATERIAL, dtype=np.int64)))
        return Elements(tuple(blocks), tuple(others), nodes)

    def _store(self, element: Element) -> None:
        label, line = element.label, element.line
        if not 0 < label <= HIGHEST_LABEL:
            raise line.error(f"element numbers should be positive, at most 1e12, found {label}")
        if max(element.nodes) > HIGHEST_LABEL:
            raise line.error(f"node numbers should be at most 1e12, found {max(element.nodes)} in element {label}")
        before = self.known.setdefault(label, element)
        if (before.solid or before.name, before.nodes) != (element.solid or element.name, element.nodes):
            raise line.error(f"element {label} is defined again, other than in {before.line.place}; renumber one")


def _node(line: Line) -> tuple[int, tuple[float, float, float]]:
    parts = line.text.split(",")
    try:
        # The regular row, four times as fast as the careful way below.
        label, x, y, z = int(parts[0]), float(parts[1]), float(parts[2]), float(parts[3])
        regular = len(parts) == 4 and 0 < label <= HIGHEST_LABEL and math.isfinite(x + y + z)
    except (ValueError, IndexError):
        regular = False
    return (label, (x, y, z)) if regular else _irregular_node(line)


def _irregular_node(line: Line) -> tuple[int, tuple[float, float, float]]:
    """Read a node row with missing coordinates (zero, as the solvers have it) or an error."""
    parts = fields(line)
    label = integer(parts[0], line, "the node number")
    if not 0 < label <= HIGHEST_LABEL:
        raise line.error(f"node numbers should be positive, at most 1e12, found {label}")
    # A blank third one and a zero beyond it are a slip of the comma that CalculiX forgives.
    if any(parts[4:]) and (parts[3] or any(number(text, line, "each coordinate") for text in parts[4:] if text)):
        raise line.error(f"node {label} has {len(parts) - 1} coordinates, expected 3; keep x, y and z")
    x, y, z = (
        number(text, line, f"coordinate {axis} of node {label}", 0.0)
        for axis, text in zip("xyz", [*parts[1:4], "", "", ""][:3], strict=True)
    )
    return label, (x, y, z)


def _element_rows(card: Card, name: str, node_count: int) -> tuple[list[tuple[Line, list[int]]], int]:
    """Return label and node labels of each element with its first line; rows go on until they are full.

    Beside them how many say more, and a comma at the end would have them go on: the solvers leave that out.
    """
    rows: list[tuple[Line, list[int]]] = []
    length, cut = node_count + 1, 0
    offset = card.scope.offset
    row: list[int] = []
    first = card.line
    for line in card.data:
        if not row:
            first = line
        row += _integers(line)
        goes_on = line.text.endswith(",")
        if len(row) > length and goes_on:
            row, cut = row[:length], cut + 1
        if len(row) == length:
            rows.append((first, [label + offset for label in row] if offset else row))
            row = []
        elif len(row) > length or not (goes_on or length > FIELDS_PER_LINE):
            raise _miscounted(first, row, name, node_count)
    if row:
        raise _miscounted(first, row, name, node_count)
    return rows, cut


def _integers(line: Line) -> list[int]:
    try:
        return [int(part) for part in line.text.rstrip(",").split(",")]
    except ValueError:
        return [integer(text, line, "an element's row") for text in fields(line)]


def _miscounted(line: Line, row: list[int], name: str, node_count: int) -> DeckError:
    found = f"element {row[0]} has {len(row) - 1} nodes, expected {node_count} for {name}"
    advice = "correct the row or the element type (rows that go on in the next line end with a comma)"
    return line.error(f"{found}; {advice}")
