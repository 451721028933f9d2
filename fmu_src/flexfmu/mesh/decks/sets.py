"""Node sets, element sets and surfaces of a deck."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexfmu.files.basics import IntArray, UnitSystem, listed
from flexfmu.mesh.decks.cards import FLAT, Card, Line, Scope, fields, integer
from flexfmu.mesh.decks.geometry import Element, Elements, NodeTable


@dataclass(slots=True)
class SetTable:
    """The sets of one kind; names are found whatever their case, and kept as first spelt.

    Attributes
    ----------
    kind : str
        ``"node"`` or ``"element"``.
    rows : mapping of int to int
        Row (of an element: position) of each label.
    offsets : mapping of str to int
        What instances add to their numbers, by their names in capitals.
    spelling : dict of str to str
        Name as spelt, by the name in capitals; sets of an instance are called ``instance.set``.
    members : dict of str to set of int
        Rows, by the name in capitals.
    notes : list of str
    unsorted : set of str
        Names in capitals of sets whose order the deck wants kept; it is not.
    """

    kind: str
    rows: Mapping[int, int]
    offsets: Mapping[str, int] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    members: dict[str, set[int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    unsorted: set[str] = field(default_factory=set)

    def extend(self, name: str, rows: Iterable[int]) -> None:
        """Add rows to a set, which is made if there is none.

        Parameters
        ----------
        name : str
        rows : iterable of int
        """
        self.spelling.setdefault(name.upper(), name)
        self.members.setdefault(name.upper(), set()).update(rows)

    def add(self, card: Card, name: str) -> None:
        """Take the data lines of a *NSET or *ELSET card.

        Parameters
        ----------
        card : Card
        name : str
            The set's name, in the card's scope.

        Raises
        ------
        DeckError
            A member is unknown, or a range is malformed.
        """
        read = self._generated if "GENERATE" in card.parameters else self._line
        scope = self.inside(card)
        self.extend(card.scope.qualified(name), set[int]().union(*(read(line, scope) for line in card.data)))
        self.unsorted |= {card.scope.qualified(name).upper()} if "UNSORTED" in card.parameters else set()

    def inside(self, card: Card) -> Scope:
        """Return the scope of a card's members: its own, or that of the instance that it names.

        Parameters
        ----------
        card : Card

        Returns
        -------
        Scope

        Raises
        ------
        DeckError
            There is no such instance.
        """
        if "INSTANCE" not in card.parameters:
            return card.scope
        name = card.required("INSTANCE")
        if name.upper() not in self.offsets:
            raise card.line.error(f"there is no instance '{name}' (known: {listed(self.offsets)}); correct the name")
        return Scope(name, self.offsets[name.upper()])

    def find(self, entry: str, line: Line, scope: Scope = FLAT) -> set[int]:
        """Return the rows of a label or of a set; ``instance.12`` and ``instance.set`` are understood.

        Parameters
        ----------
        entry : str
        line : Line
            Where the entry stands.
        scope : Scope
            Where numbers and names are looked up first.

        Returns
        -------
        set of int

        Raises
        ------
        DeckError
            There is no such label or set, or there are several.
        """
        text = entry.strip("\"'").strip()
        instance, _, last = text.rpartition(".")
        known = instance.upper() in self.offsets
        if (known and last.isdecimal()) or text.lstrip("+-").isdecimal():
            offset = self.offsets[instance.upper()] if known else scope.offset
            label = integer(last if known else text, line, f"the {self.kind} number") + offset
            if label not in self.rows:
                raise line.error(f"{self.kind} {text} is not defined; define it or correct this line")
            return {self.rows[label]}
        found = self.named(text, scope)
        if len(found) != 1:
            where = "is in several instances" if found else "is not defined"
            names = (self.spelling[name] for name in found) if found else self.spelling.values()
            raise line.error(f"{self.kind} set '{entry}' {where} (known: {listed(names)}); define or correct it")
        return self.members[found[0]]

    def named(self, name: str, scope: Scope) -> list[str]:
        """Return the keys of the sets that a name may mean: of the scope, of the deck, of an instance.

        Parameters
        ----------
        name : str
        scope : Scope

        Returns
        -------
        list of str
        """
        for key in (scope.qualified(name).upper(), name.upper()):
            if key in self.members:
                return [key]
        return [key for instance in self.offsets if (key := f"{instance}.{name.upper()}") in self.members]

    def arrays(self) -> dict[str, IntArray]:
        """Rows of each set, ascending, by the name as spelt."""
        return {self.spelling[name]: np.array(sorted(rows), dtype=np.int64) for name, rows in self.members.items()}

    def _line(self, line: Line, scope: Scope) -> set[int]:
        return set().union(*(self.find(entry, line, scope) for entry in fields(line) if entry))

    def _generated(self, line: Line, scope: Scope) -> set[int]:
        numbers = [integer(text, line, f"a range of {self.kind}s") for text in fields(line)]
        if not 2 <= len(numbers) <= 3:
            raise line.error(f"GENERATE takes 'first, last, increment', found {len(numbers)} numbers")
        first, last, step = [*numbers, 1][:3]
        if step <= 0 or last < first:
            fault = f"cannot go from {first} to {last} in steps of {step}"
            raise line.error(f"{fault}; give an ascending range and a positive increment")
        labels = range(first + scope.offset, last + scope.offset + 1, step)
        # The shorter of the two: a range may have been mistyped by many digits.
        if len(labels) <= len(self.rows):
            found = {self.rows[label] for label in labels if label in self.rows}
        else:
            found = {row for label, row in self.rows.items() if label in labels}
        if not found:
            raise line.error(f"there is no {self.kind} from {first} to {last}; correct the range")
        if len(found) < len(labels):
            # Both solvers pass over gaps in the numbering.
            gaps = len(labels) - len(found)
            self.notes.append(f"{line.place}: {gaps} numbers from {first} to {last} belong to no {self.kind}")
        return found


class Deck(NamedTuple):
    """What cards name, and what is said of them.

    Attributes
    ----------
    node_sets, element_sets : SetTable
    elements : Elements
    units : UnitSystem
    notes : list of str
        Gets what is found, left out or does nothing.
    """

    node_sets: SetTable
    element_sets: SetTable
    elements: Elements
    units: UnitSystem
    notes: list[str]

    @property
    def nodes(self) -> NodeTable:
        """All nodes."""
        return self.elements.nodes

    @property
    def turning(self) -> set[int]:
        """Nodes of shells and beams."""
        return self.elements.shell_nodes_of(range(self.elements.solid_count))

    def members(self, card: Card) -> set[int]:
        """Return the elements of a card's set.

        Parameters
        ----------
        card : Card

        Returns
        -------
        set of int
            Their places.

        Raises
        ------
        DeckError
            The set is missing or unknown.
        """
        return self.element_sets.find(card.required("ELSET"), card.line, card.scope)

    def chosen(self, card: Card, kinds: Collection[str]) -> list[Element]:
        """Return the elements of a card's set, which are no solids but of certain types.

        Parameters
        ----------
        card : Card
        kinds : collection of str

        Returns
        -------
        list of Element

        Raises
        ------
        DeckError
            The set is missing, unknown or holds others.
        """
        members = self.members(card)
        chosen = self.elements.others_of(members)
        others = sorted({one.name for one in chosen} - set(kinds)) or ["solids"] * (len(chosen) < len(members))
        if others:
            raise card.line.error(
                f"*{card.keyword} is for elements of type {', '.join(kinds)}, set '{card.parameters['ELSET']}' holds "
                f"others: {', '.join(others)}; name a set of these alone, or mesh this part with them"
            )
        return chosen


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
    shells : tuple of (f, a) int
        Nodes of shells likewise.
    """

    nodes: IntArray
    faces: tuple[IntArray, ...]
    shells: tuple[IntArray, ...]


def surface(card: Card, deck: Deck) -> DeckSurface:
    """Return the surface of a *SURFACE card.

    Parameters
    ----------
    card : Card
        TYPE=NODE, or TYPE=ELEMENT with a face S1 ... S6 on each row.
    deck : Deck

    Returns
    -------
    DeckSurface

    Raises
    ------
    DeckError
        A member is unknown, or a row does not name a face of its elements.
    """
    node_sets, element_sets, elements, *_ = deck
    kind = card.parameters.get("TYPE", "ELEMENT").upper()
    if kind not in ("NODE", "ELEMENT"):
        raise card.line.error(f"*SURFACE, TYPE={kind} is not supported (supported: NODE, ELEMENT); name its nodes")
    rows: set[int] = set()
    faces: dict[int, list[IntArray]] = {}
    shells: list[IntArray] = []
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
            shells += [block.connectivity[inside] for block, inside in elements.solids_of(members) if block.type.shell]
    joined = tuple(np.concatenate(found) for found in faces.values())
    return DeckSurface(np.array(sorted(rows), dtype=np.int64), joined, tuple(shells))


def _faces(members: set[int], name: str, elements: Elements, line: Line) -> list[IntArray]:
    """Nodes (f, a) of a face of each solid element among some, by kind."""
    found: list[IntArray] = []
    for block, inside in elements.solids_of(members):
        if block.type.natural:
            continue
        faces = {f"S{number}": nodes for number, nodes in enumerate(block.type.shape.faces, start=1)}
        if name not in faces:
            fault = f"expected a face of {block.type.name} ({', '.join(faces)}) after the comma, found '{name}'"
            raise line.error(f"{fault}; name the face")
        found.append(block.connectivity[inside][:, faces[name]])
    return found
