"""What hangs at nodes of a deck: masses (MASS, ROTARYI), springs and dampers (SPRINGA, SPRING1, SPRING2, DASHPOT)."""

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np

from flexfmu.files.basics import BoolArray, FloatArray, IntArray, UnitSystem, listed
from flexfmu.mesh.decks.cards import Card, Line, fields, integer, number
from flexfmu.mesh.decks.couplings import Coupling
from flexfmu.mesh.decks.geometry import Element
from flexfmu.mesh.decks.orientation import Orientation
from flexfmu.mesh.decks.sets import Deck
from flexfmu.mesh.model import Along, PointMass, SpringDamper, masses_note, springs_note, unit_of

MASSES = {"MASS": "MASS", "ROTARYINERTIA": "ROTARYI"}
"""Cards, and the type of the elements that each is for."""
# Where I11, I22, I33, I12, I13, I23 stand in a matrix.
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def point_masses(cards: Sequence[Card], carriers: "Carriers") -> tuple[PointMass, ...]:
    """Return the masses of the cards *MASS and *ROTARY INERTIA.

    Parameters
    ----------
    cards : sequence of Card
    carriers : Carriers

    Returns
    -------
    tuple of PointMass
        One for each node that has any.

    Raises
    ------
    DeckError
        Numbers are missing or negative, elements are of another type, or nothing carries a node.
    """
    deck, given = carriers.deck, dict[int, tuple[Line, float, FloatArray]]()
    for card in cards:
        mass, inertia = _mass_numbers(card, deck.units)
        for one in deck.chosen(card, [MASSES[card.key]]):
            row = deck.nodes.rows_of(one)[0]
            _, before, turning = given.get(row, (card.line, 0.0, np.zeros((3, 3))))
            given[row] = card.line, before + mass, turning + inertia
    found, labels = [], deck.nodes.labels()
    for row, (line, mass, inertia) in sorted(given.items()):
        on = carriers.of(row)
        if on is None:
            fault = f"node {labels[row]} has a mass and belongs to no element and no coupling, which would carry it"
            raise line.error(f"{fault}; couple it (*COUPLING), or take the mass out")
        if on.size == 1 and np.any(inertia) and row not in carriers.turning:
            place = f"{line.place}: node {labels[row]}"
            deck.notes.append(f"{place} of a solid does not turn: its rotary inertia does nothing")
        found.append(PointMass(f"node {labels[row]}", carriers.points[row], on, mass, inertia))
    deck.notes.extend(masses_note(found, "nodes"))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Carriers:
    """What carries a node: itself where elements have it, else the nodes of the coupling that it is the reference of.

    Attributes
    ----------
    deck : Deck
    points : (n, 3) float
        m.
    fixed : (n, 6) bool
        What the deck holds of each node.
    used : set of int
        Rows of nodes of elements.
    turning : set of int
        Those of beams.
    couplings : sequence of Coupling
    """

    deck: Deck
    points: FloatArray
    fixed: BoolArray
    used: set[int]
    turning: set[int]
    couplings: Sequence[Coupling]

    def of(self, row: int) -> IntArray | None:
        """Rows of the nodes (k,) that carry a node, or None."""
        if row in self.used:
            return np.array([row])
        return next((coupling.nodes for coupling in self.couplings if coupling.reference == row), None)

    def ends(self, element: Element) -> tuple[list[IntArray], FloatArray]:
        """Rows that carry each end of an element, none on the ground, and where they are (2, 3), m."""
        rows = self.deck.nodes.rows_of(element)
        found = []
        for row, label in zip(rows, element.nodes, strict=True):
            on = self.of(row)
            if on is None and not self.fixed[row, :3].all():
                raise element.line.error(
                    f"element {element.label} ends at node {label}, which belongs to no element and no coupling and is "
                    "not held: nothing carries it; couple it (*COUPLING), or hold it (*BOUNDARY, 1 to 3) as ground"
                )
            found.append(np.zeros(0, dtype=np.int64) if on is None else on)
        places = self.points[rows]
        return [*found, np.zeros(0, dtype=np.int64)][:2], np.array([places[0], places[-1]])


def _mass_numbers(card: Card, units: UnitSystem) -> tuple[float, FloatArray]:
    """Mass, kg, or moments and products of inertia (3, 3), I12 = −∫ρ x y, kg m², of the first row."""
    texts, line = card.row, card.first
    wanted = 1 if card.key == "MASS" else 3
    if len(texts) < wanted:
        raise line.error(f"*{card.keyword} should have a row of {wanted} numbers or more, found {len(texts)}")
    values = [number(text, line, f"each number of *{card.keyword}", 0.0) for text in texts[:6]]
    if min(values[:wanted]) < 0.0:
        raise line.error(f"*{card.keyword} has the number {min(values[:wanted]):g}; masses are positive")
    inertia = np.zeros((3, 3))
    if card.key == "MASS":
        return values[0] * units.density * units.length**3, inertia
    for (i, j), value in zip(_PLACES, values, strict=False):
        inertia[i, j] = inertia[j, i] = value
    return 0.0, inertia * units.density * units.length**5


SPRINGS = {key: tuple(key + end for end in "A12") for key in ("SPRING", "DASHPOT")}
"""Cards, and the types of the elements that each is for."""


def deck_springs(
    cards: Sequence[Card], carriers: Carriers, orientations: dict[str, Orientation], transformed: Set[int]
) -> tuple[SpringDamper, ...]:
    """Return the springs and dampers of the cards *SPRING and *DASHPOT.

    Parameters
    ----------
    cards : sequence of Card
    carriers : Carriers
    orientations : dict of str to Orientation
        By name in capitals.
    transformed : set of int
        Nodes with axes of *TRANSFORM.

    Returns
    -------
    tuple of SpringDamper

    Raises
    ------
    DeckError
        What is not linear, elements of another type or without a card, or an end that nothing carries.
    """
    found, known, deck = [], set(), carriers.deck
    for card in cards:
        given = _spring_numbers(card)
        name = card.parameters.get("ORIENTATION")
        turned = card.scope.find(name, orientations, "orientation", card.line) if name else None
        for element in deck.chosen(card, SPRINGS[card.key]):
            known.add(element.label)
            found.append(_spring(card, element, carriers, turned, *given))
    lone = [one for one in deck.elements.others if one.name.startswith(tuple(SPRINGS)) and one.label not in known]
    if lone:
        raise lone[0].line.error(f"element {lone[0].label} of type {lone[0].name} has no *SPRING or *DASHPOT; add it")
    deck.notes.extend(springs_note(found))
    if askew := [one.name for one in found if one.along is Along.FIXED and transformed & {*np.hstack(one.ends)}]:
        deck.notes.append(f"{listed(askew)}: *TRANSFORM turns no springs; they have global axes, or an ORIENTATION")
    return tuple(found)


def _spring(
    card: Card, element: Element, on: Carriers, turned: Orientation | None, directions: tuple[int, ...], value: float
) -> SpringDamper:
    """The spring or damper that an element is."""
    (ends, places), units = on.ends(element), on.deck.units
    numbers, line = np.zeros(6), element.name.endswith("A")
    if line and not np.linalg.norm(places[0] - places[1]) > 0.0:
        raise element.line.error(f"both nodes of element {element.label} are in one place: {element.name} has no line")
    if not line and not directions:
        raise card.line.error(f"*{card.keyword} for {element.name} takes a row of directions 1 to 6 before its number")
    if len(set(directions)) > 1 and not line:
        found = f"*{card.keyword} joins direction {directions[0]} to {directions[1]}"
        raise card.line.error(f"{found}: both must be the same; use *EQUATION")
    direction = 0 if line else directions[0] - 1
    numbers[direction] = value * unit_of(direction, units)
    axes = np.eye(3) if turned is None else turned.axes(places[:1] / units.length)[0].T
    still = np.zeros(6)
    stiffness, damping = (numbers, still) if card.key == "SPRING" else (still, numbers)
    along = Along.LINE if line else Along.FIXED
    name = f"{element.name} {element.label}"
    return SpringDamper(name, (ends[0], ends[1]), places, places.mean(axis=0), axes, stiffness, damping, along)


def _spring_numbers(card: Card) -> tuple[tuple[int, ...], float]:
    """Directions of a card's first row, none where it is blank, and its number."""
    if "NONLINEAR" in card.parameters or "RTOL" in card.parameters or "COMPLEXSTIFFNESS" in card.parameters:
        found = f"*{card.keyword} is nonlinear or complex, springs and dampers of a body are linear"
        raise card.line.error(f"{found}: give its number about the working point")
    rows = [fields(line) for line in card.data]
    full = [(row, line) for row, line in zip(rows, card.data, strict=True) if any(row)]
    first = _directions(*full[0]) if len(full) > 1 else ()
    if len(full) != (2 if first else 1):
        found = f"*{card.keyword} has {len(full)} rows of numbers, expected directions and one number"
        raise card.line.error(f"{found}: tables over frequency or temperature are none of a linear body; give one row")
    texts, line = full[-1]
    value = number(texts[0], line, f"the number of *{card.keyword}")
    if value < 0.0:
        raise line.error(f"*{card.keyword} has the number {value:g}, expected one that is not negative")
    return first, value


def _directions(texts: list[str], line: Line) -> tuple[int, ...]:
    """Directions 1 to 6 of a row; none where it holds something else."""
    given = [text for text in texts if text]
    if len(given) > 2 or not all(text.isdigit() for text in given):
        return ()
    found = tuple(integer(text, line, "a direction") for text in given)
    if not all(1 <= one <= 6 for one in found):
        raise line.error(f"directions of a spring are 1 to 6, found {found}")
    return found
