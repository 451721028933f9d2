"""Masses at points of a deck: elements MASS and ROTARYI with *MASS and *ROTARY INERTIA."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.files.units import UnitSystem
from flexfmu.mesh.decks.cards import Card, Line, fields, number
from flexfmu.mesh.decks.couplings import Coupling
from flexfmu.mesh.decks.geometry import Elements
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.model import PointMass, masses_note

# Where I11, I22, I33, I12, I13, I23 stand in a matrix.
CARDS = {"MASS": "MASS", "ROTARYINERTIA": "ROTARYI"}
"""Cards, and the type of the elements that each is for."""
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def point_masses(
    cards: Sequence[Card],
    element_sets: SetTable,
    elements: Elements,
    carriers: "Carriers",
    units: UnitSystem,
    notes: list[str],
) -> tuple[PointMass, ...]:
    """Return the masses of the cards *MASS and *ROTARY INERTIA.

    Parameters
    ----------
    cards : sequence of Card
    element_sets : SetTable
    elements : Elements
    carriers : Carriers
    units : UnitSystem
    notes : list of str
        Gets what is found, and what does nothing.

    Returns
    -------
    tuple of PointMass
        One for each node that has any.

    Raises
    ------
    DeckError
        Numbers are missing or negative, elements are of another type, or nothing carries a node.
    """
    given = _given(cards, element_sets, elements, units)
    found = []
    labels = elements.nodes.labels()
    for row in sorted(given):
        one, on = given[row], carriers.of(row)
        if on is None:
            raise one.line.error(
                f"node {labels[row]} has a mass and belongs to no element and no coupling, which would carry it; "
                "couple it (*COUPLING), or take the mass out"
            )
        if on.size == 1 and np.any(one.inertia) and row not in carriers.turning:
            place = f"{one.line.place}: node {labels[row]}"
            notes.append(f"{place} of a solid does not turn: its rotary inertia does nothing")
        found.append(PointMass(f"node {labels[row]}", carriers.points[row], on, one.mass, one.inertia))
    notes.extend(masses_note(found, "nodes"))
    return tuple(found)


def _given(cards: Sequence[Card], element_sets: SetTable, elements: Elements, units: UnitSystem) -> dict[int, "_Given"]:
    """What the cards give a node, by its row."""
    given: dict[int, _Given] = {}
    for card in cards:
        members = element_sets.find(card.required("ELSET"), card.line, card.scope)
        chosen = elements.others_of(members)
        if len(chosen) < len(members) or any(other.name != CARDS[card.key] for other in chosen):
            raise card.line.error(
                f"*{card.keyword} is for elements of type {CARDS[card.key]}, set '{card.parameters['ELSET']}' "
                "holds others; name a set of these alone"
            )
        values = _values(card)
        for row in (elements.nodes.rows_of(other)[0] for other in chosen):
            one = given.setdefault(row, _Given(card.line))
            one.line = card.line
            if card.key == "MASS":
                one.mass += values[0] * units.density * units.length**3
            else:
                one.inertia = one.inertia + _matrix(values) * units.density * units.length**5
    return given


@dataclass(slots=True)
class _Given:
    """Mass (kg) and inertia (kg m²) of a node, and the last line that gave it some."""

    line: Line
    mass: float = 0.0
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, slots=True)
class Carriers:
    """What carries a node: itself where elements have it, else the nodes of the coupling that it is the reference of.

    Attributes
    ----------
    points : (n, 3) float
        m.
    used : set of int
        Rows of nodes of elements.
    turning : set of int
        Those of beams.
    couplings : sequence of Coupling
    """

    points: FloatArray
    used: set[int]
    turning: set[int]
    couplings: Sequence[Coupling]

    def of(self, row: int) -> IntArray | None:
        """Rows of the nodes (k,) that carry a node, or None."""
        if row in self.used:
            return np.array([row])
        return next((coupling.nodes for coupling in self.couplings if coupling.reference == row), None)


def _values(card: Card) -> list[float]:
    """Numbers of the first row."""
    texts = fields(card.data[0]) if card.data else []
    line = card.data[0] if card.data else card.line
    wanted = 1 if card.key == "MASS" else 3
    if len(texts) < wanted:
        raise line.error(f"*{card.keyword} should have a row of {wanted} numbers or more, found {len(texts)}")
    values = [number(text, line, f"each number of *{card.keyword}") if text else 0.0 for text in texts[:6]]
    if min(values[:wanted]) < 0.0:
        raise line.error(f"*{card.keyword} has the number {min(values[:wanted]):g}; masses are positive")
    return values


def _matrix(values: Sequence[float]) -> FloatArray:
    """Matrix (3, 3) of moments and products of inertia, I12 = −∫ρ x y."""
    result = np.zeros((3, 3))
    for (i, j), value in zip(_PLACES, values, strict=False):
        result[i, j] = result[j, i] = value
    return result
