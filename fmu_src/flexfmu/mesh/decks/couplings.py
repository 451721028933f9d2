"""Couplings and rigid bodies of a deck: node sets with a reference point, which serve as interfaces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexfmu.files.array_types import BoolArray, FloatArray, IntArray
from flexfmu.mesh.decks.cards import Card, fields
from flexfmu.mesh.decks.geometry import Elements
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.decks.surfaces import Surface

# Cards that say how the coupling above them holds its nodes.
_KINDS = {"KINEMATIC": True, "DISTRIBUTING": False}


class Coupling(NamedTuple):
    """Nodes that move with a reference node.

    Attributes
    ----------
    names : tuple of str
        By which the body file knows it.
    nodes : (k,) int
    reference : int
        Row of the reference node.
    stiff : bool
        Whether the deck lets the nodes move as a rigid body only.
    card : Card
    """

    names: tuple[str, ...]
    nodes: IntArray
    reference: int
    stiff: bool
    card: Card


@dataclass(slots=True)
class CouplingTable:
    """The coupling cards read so far, each with whether it is stiff."""

    cards: list[tuple[Card, bool, list[Card]]] = field(default_factory=list)

    def add(self, card: Card) -> None:
        """Take a card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            *KINEMATIC or *DISTRIBUTING without the *COUPLING that it belongs to.
        """
        if card.key not in _KINDS:
            self.cards.append((card, card.key != "COUPLING", []))
        elif self.cards and self.cards[-1][0].key == "COUPLING":
            first, _, others = self.cards[-1]
            self.cards[-1] = (first, _KINDS[card.key], [*others, card])
        else:
            raise card.line.error(f"*{card.keyword} stands below no *COUPLING; put it below the one it belongs to")

    def resolved(
        self, node_sets: SetTable, element_sets: SetTable, elements: Elements, surfaces: Mapping[str, Surface]
    ) -> tuple[Coupling, ...]:
        """Return the couplings.

        Parameters
        ----------
        node_sets, element_sets : SetTable
        elements : Elements
        surfaces : mapping of str to Surface

        Returns
        -------
        tuple of Coupling

        Raises
        ------
        DeckError
            A set, surface or reference node is missing, or two couplings have the same reference node.
        """
        found: list[Coupling] = []
        for number, (card, stiff, _) in enumerate(self.cards, start=1):
            entry = card.required("REFNODE")
            rows = sorted(node_sets.find(entry, card.line, card.scope))
            if len(rows) != 1:
                raise card.line.error(f"REF NODE = {entry} names {len(rows)} nodes, expected one")
            reference = rows[0]
            known = next((other for other in found if other.reference == reference), None)
            if known is not None:
                raise card.line.error(
                    f"the reference node {entry} is that of *{known.card.keyword} in line {known.card.line.number} "
                    "too, which joins their nodes rigidly: not supported; join them by elements"
                )
            alone = [node_sets.spelling[name] for name, members in node_sets.members.items() if members == {reference}]
            given = card.parameters.get("CONSTRAINTNAME", "")
            names = [*([card.scope.qualified(given)] if given else []), *alone] or [f"{card.keyword} {number}"]
            nodes = np.setdiff1d(_nodes(card, node_sets, element_sets, elements, surfaces), [reference])
            found.append(Coupling(tuple(dict.fromkeys(names)), nodes, reference, stiff, card))
        return tuple(found)


def _nodes(
    card: Card, node_sets: SetTable, element_sets: SetTable, elements: Elements, surfaces: Mapping[str, Surface]
) -> IntArray:
    if card.key == "COUPLING":
        return card.scope.find(card.required("SURFACE"), surfaces, "surface", card.line).nodes
    if card.key == "KINEMATICCOUPLING":
        rows = set().union(*(node_sets.find(fields(line)[0], line, card.scope) for line in card.data))
    elif "ELSET" in card.parameters:
        rows = elements.nodes_of(element_sets.find(card.required("ELSET"), card.line, card.scope))
    else:
        name = next((card.parameters[key] for key in ("NSET", "TIENSET", "PINNSET") if key in card.parameters), "")
        if not name:
            raise card.line.error(f"*{card.keyword} needs the parameter NSET or ELSET; add it")
        rows = node_sets.find(name, card.line, card.scope)
    return np.array(sorted(rows), dtype=np.int64)


def offered(
    couplings: Sequence[Coupling], points: FloatArray, fixed: BoolArray
) -> tuple[dict[str, IntArray], dict[str, FloatArray], list[str]]:
    """Return what couplings mean to a body file, and hold the nodes of those whose reference node is held.

    Parameters
    ----------
    couplings : sequence of Coupling
    points : (n, 3) float
    fixed : (n, 6) bool
        Translations and rotations held; changed in place.

    Returns
    -------
    node_sets : dict of str to (k,) int
    references : dict of str to (3,) float
    notes : list of str
    """
    sets, references, notes = {}, {}, []
    for coupling in couplings:
        for name in coupling.names:
            sets[name], references[name] = coupling.nodes, points[coupling.reference]
        words = " and ".join(repr(name) for name in coupling.names)
        where = f"{coupling.card.line.place}: *{coupling.card.keyword}"
        note = f"{where} is offered as an interface: nodes = {words}, with its reference node as point"
        held = fixed[coupling.reference]
        if held.all():
            fixed[coupling.nodes, :3] = True
            note = f"{where}: its reference node is held, and so are its nodes"
        elif held.any():
            note += "; what *BOUNDARY holds of that node is left out: hold the nodes with a [[support]]"
        if coupling.stiff and not held.all():
            note += "; the deck keeps its nodes rigid, the interface lets them deform"
        notes.append(note)
    return sets, references, notes
