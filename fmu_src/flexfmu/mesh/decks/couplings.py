"""Couplings and rigid bodies of a deck: node sets with a reference point, which serve as interfaces or are rigid."""

from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np

from flexfmu.files.basics import BoolArray, FloatArray, IntArray
from flexfmu.mesh.decks.cards import Card, fields, integer, number
from flexfmu.mesh.decks.sets import Deck, DeckSurface
from flexfmu.mesh.equations import RigidLink, Row

# Cards that say how the coupling above them holds its nodes.
_KINDS = ("KINEMATIC", "DISTRIBUTING")
COUPLINGS = ("COUPLING", "KINEMATICCOUPLING", "DISTRIBUTINGCOUPLING", "RIGIDBODY", *_KINDS)
"""Keys of the cards that `resolved` takes."""


class Coupling(NamedTuple):
    """Nodes that move with a reference node.

    Attributes
    ----------
    names : tuple of str
        By which the body file knows it.
    nodes : (k,) int
    reference : int
        Row of the reference node.
    rigid : bool
        Whether the deck lets the nodes move as a rigid body only.
    turns : int
        Row of the node whose translations are the reference node's rotations; −1: none.
    told : str
        What the deck says more, and what comes of it.
    card : Card
    """

    names: tuple[str, ...]
    nodes: IntArray
    reference: int
    rigid: bool
    turns: int
    told: str
    card: Card


def resolved(cards: Sequence[Card], deck: Deck, surfaces: Mapping[str, DeckSurface]) -> tuple[Coupling, ...]:
    """Return the couplings.

    Parameters
    ----------
    cards : sequence of Card
        Of `COUPLINGS`, in their order: those that say how a coupling holds its nodes come below it.
    deck : Deck
    surfaces : mapping of str to DeckSurface

    Returns
    -------
    tuple of Coupling

    Raises
    ------
    DeckError
        A name is unknown, a reference node is not one, or two couplings share it and one of them is not rigid.
    """
    found, node_sets = list[Coupling](), deck.node_sets
    pairs: list[tuple[Card, Card]] = []
    for card in cards:
        if card.key not in _KINDS:
            pairs.append((card, card))
        elif pairs and pairs[-1][0].key == "COUPLING":
            pairs[-1] = (pairs[-1][0], card)
        else:
            raise card.line.error(f"*{card.keyword} stands below no *COUPLING; put it below the one it belongs to")
    turning = deck.turning if cards else set()
    for place, (card, holding) in enumerate(pairs, start=1):
        # Its reference is the node of an element DCOUP3D.
        by_element = card.key == "DISTRIBUTINGCOUPLING"
        entry = card.parameters.get("ELSET" if by_element else "REFNODE", "")
        # A rigid body without one moves as any of its nodes.
        lone = _nodes(card, deck, surfaces)[:1].tolist() if card.key == "RIGIDBODY" and not entry else ()
        own = deck.elements.nodes_of(deck.members(card)) if by_element else set(lone)
        rows = own or _found(card.required("REFNODE"), card, deck)
        if len(rows) != 1:
            raise card.line.error(f"{entry} names {len(rows)} reference nodes, expected one")
        (reference,) = rows
        held = _axes(holding)
        rigid = held >= {1, 2, 3}
        known = next((other for other in found if other.reference == reference), None)
        if known is not None and not (rigid and known.rigid):
            raise card.line.error(
                f"the reference node {entry} is that of *{known.card.keyword} in line {known.card.line.number} "
                "too, and one of them lets its nodes deform: not supported; give them nodes of their own"
            )
        alone = [node_sets.spelling[name] for name, members in node_sets.members.items() if members == {reference}]
        given = card.parameters.get("CONSTRAINTNAME", "")
        names = [*([card.scope.qualified(given)] if given else []), *alone] or [f"{card.keyword} {place}"]
        nodes = _near(card, np.setdiff1d(_nodes(card, deck, surfaces), [reference]), reference, deck)
        told = _told(card, holding, held, turning.intersection(nodes.tolist()))
        turns = card.parameters.get("ROTNODE", "")
        about = min(_found(turns, card, deck)) if turns else -1
        found.append(Coupling(tuple(dict.fromkeys(names)), nodes, reference, rigid, about, told, card))
    return tuple(found)


def _found(entry: str, card: Card, deck: Deck) -> set[int]:
    return deck.node_sets.find(entry, card.line, card.scope)


def _nodes(card: Card, deck: Deck, surfaces: Mapping[str, DeckSurface]) -> IntArray:
    if card.key == "COUPLING":
        return card.scope.find(card.required("SURFACE"), surfaces, "surface", card.line).nodes
    if card.key in ("KINEMATICCOUPLING", "DISTRIBUTINGCOUPLING"):
        rows = set().union(*(deck.node_sets.find(fields(line)[0], line, card.scope) for line in card.data))
    else:
        if not (given := [card.parameters[key] for key in ("NSET", "TIENSET", "PINNSET") if key in card.parameters]):
            card.required("ELSET")
        rows = set().union(*(_found(name, card, deck) for name in given))
        if "ELSET" in card.parameters:
            rows |= deck.elements.nodes_of(deck.members(card))
    if card.parameters.get("POSITION", "INPUT").upper() != "INPUT":
        raise card.line.error("POSITION moves the reference node to the centre of mass: put it there, without POSITION")
    return np.array(sorted(rows), dtype=np.int64)


def _near(card: Card, nodes: IntArray, reference: int, deck: Deck) -> IntArray:
    """Nodes within the INFLUENCE RADIUS of the reference node."""
    if not (text := card.parameters.get("INFLUENCERADIUS", "")):
        return nodes
    points = deck.nodes.points()
    near = np.linalg.norm(points[nodes] - points[reference], axis=1) <= number(text, card.line, "INFLUENCE RADIUS")
    if near.any():
        return nodes[near]
    raise card.line.error(f"no node of the surface lies within the INFLUENCE RADIUS, {text}; correct it")


def _told(card: Card, holding: Card, held: set[int], turning: set[int]) -> str:
    """What is said of a coupling's directions and weights that an interface or a rigid link does not follow."""
    weights = {fields(line)[1] for line in card.data if len(fields(line)) > 1} if card.key == COUPLINGS[2] else set()
    if len(weights) > 1 or holding.parameters.get("WEIGHTINGMETHOD", "UNIFORM").upper() != "UNIFORM":
        return "; the deck's weights are left out: the interface spreads loads evenly"
    kinematic = holding.key in ("KINEMATIC", "KINEMATICCOUPLING", "RIGIDBODY")
    if kinematic and not held >= {1, 2, 3}:
        return "; the deck keeps its nodes rigid in some directions, the interface lets them deform"
    if kinematic and turning and not held >= {4, 5, 6}:
        return "; shells and beams turn with it, too, though the deck lets them turn freely"
    return ""


def _axes(card: Card) -> set[int]:
    """Directions in which a card holds nodes, counted from one; a row without any holds all."""
    if card.key in ("COUPLING", "DISTRIBUTING", "DISTRIBUTINGCOUPLING"):
        return set()
    every = {1, 2, 3, 4, 5, 6}
    if card.key == "RIGIDBODY":
        return every - {4, 5, 6} if "PINNSET" in card.parameters else every
    skipped = int(card.key == "KINEMATICCOUPLING")
    # Of *KINEMATIC COUPLING each set has its own.
    found: dict[tuple[str, ...], set[int]] = {}
    for line in card.data:
        texts = [text for text in fields(line)[skipped:] if text]
        ends = [integer(text, line, "a direction that is held") for text in texts[:2]] or [1, 6]
        found.setdefault(tuple(fields(line)[:skipped]), set()).update(range(ends[0], ends[-1] + 1))
    return every.intersection(*found.values())


def offered(
    couplings: Sequence[Coupling], points: FloatArray, fixed: BoolArray, carried: Set[int]
) -> tuple[dict[str, IntArray], dict[str, FloatArray], list[RigidLink], list[Row], list[str]]:
    """Return what couplings mean to a body file, and hold the nodes of those whose reference node is held.

    Parameters
    ----------
    couplings : sequence of Coupling
    points : (n, 3) float
    fixed : (n, 6) bool
        Translations and rotations held; changed in place.
    carried : set of int
        Nodes of elements and equations.

    Returns
    -------
    node_sets : dict of str to (k,) int
    references : dict of str to (3,) float
    links : list of RigidLink
        Each with its reference node, which joins those that share it.
    rows : list of dict of int to float
        Equations for what is held of a reference node's translations alone.
    notes : list of str

    Raises
    ------
    DeckError
        The reference node of a coupling that is not rigid joins it to something.
    """
    sets = {name: one.nodes for one in couplings for name in one.names}
    references = {name: points[one.reference] for one in couplings for name in one.names}
    links = [RigidLink(one.names[0], np.union1d(one.nodes, [one.reference])) for one in couplings if one.rigid]
    rows: list[Row] = []
    notes = []
    for coupling in couplings:
        where = f"{coupling.card.line.place}: *{coupling.card.keyword}"
        words = " and ".join(repr(name) for name in coupling.names)
        note = f"{where} is offered as an interface: nodes = {words}, with its reference node as point"
        held = fixed[coupling.reference]
        if coupling.reference in carried and not coupling.rigid:
            raise coupling.card.line.error(
                "the reference node belongs to an element or an equation, or is held along axes of *TRANSFORM, and "
                "the coupling lets its nodes deform: this would be lost; take *KINEMATIC with directions 1 to 6, or "
                "another reference node"
            )
        if coupling.turns >= 0:
            held[3:] |= fixed[coupling.turns, :3]
        if held.all():
            fixed[coupling.nodes, :3] = True
            note = f"{where}: its reference node is held, and so are its nodes"
        elif coupling.rigid and held[:3].any():
            rows += [{3 * coupling.reference + axis: 1.0} for axis in np.flatnonzero(held[:3]).tolist()]
            held[:3] = False
            note += "; what *BOUNDARY holds of its translations are equations: boundary = false leaves them"
        if held.any() and not held.all():
            note += "; what *BOUNDARY holds of that node is left out: hold the nodes with a [[support]]"
        notes.append(note + "; its nodes are rigid" * coupling.rigid + coupling.told)
    return sets, references, links, rows, notes
