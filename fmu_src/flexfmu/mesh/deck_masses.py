"""Masses at points of a deck: elements MASS and ROTARYI with *MASS and *ROTARY INERTIA."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfmu.mesh.deck_cards import Card, Line, fields, number
from flexfmu.mesh.deck_couplings import Coupling
from flexfmu.mesh.deck_geometry import NodeTable, Other
from flexfmu.mesh.deck_sets import SetTable
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import FloatArray, IntArray, PointMass
from flexfmu.mesh.units import UnitSystem

# The type of element that each card gives its numbers, and where I11, I22, I33, I12, I13, I23 stand in a matrix.
_TYPES = {"MASS": "MASS", "ROTARYINERTIA": "ROTARYI"}
_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(slots=True)
class MassTable:
    """The cards *MASS and *ROTARY INERTIA read so far.

    Attributes
    ----------
    cards : list of Card
    notes : list of str
    """

    cards: list[Card] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def masses(
        self,
        element_sets: SetTable,
        others: Sequence[Other],
        first: int,
        nodes: NodeTable,
        carriers: "Carriers",
        units: UnitSystem,
    ) -> tuple[PointMass, ...]:
        """Return the masses.

        Parameters
        ----------
        element_sets : SetTable
        others : sequence of Other
            Elements that are no solids.
        first : int
            Position of the first of them.
        nodes : NodeTable
        carriers : Carriers
        units : UnitSystem

        Returns
        -------
        tuple of PointMass
            One for each node that has any.

        Raises
        ------
        DeckError
            Numbers are missing or negative, elements are of another type, or nothing carries a node.
        """
        mass: dict[int, float] = {}
        inertia: dict[int, FloatArray] = {}
        lines: dict[int, Line] = {}
        for card in self.cards:
            members = element_sets.find(card.required("ELSET"), card.line, card.scope)
            chosen = [others[place - first] for place in sorted(members) if place >= first]
            if len(chosen) < len(members) or any(other.name != _TYPES[card.key] for other in chosen):
                raise card.line.error(
                    f"*{card.keyword} is for elements of type {_TYPES[card.key]}, set '{card.parameters['ELSET']}' "
                    "holds others; name a set of these alone"
                )
            values = _values(card)
            for row in (nodes.rows_of(other)[0] for other in chosen):
                lines[row] = card.line
                if card.key == "MASS":
                    mass[row] = mass.get(row, 0.0) + values[0] * units.density * units.length**3
                else:
                    own = _matrix(values) * units.density * units.length**5
                    inertia[row] = inertia.get(row, np.zeros((3, 3))) + own
        found = []
        labels = nodes.labels()
        for row in sorted({*mass, *inertia}):
            on = carriers.of(row)
            if on is None:
                raise lines[row].error(
                    f"node {labels[row]} has a mass and belongs to no solid and no coupling, which would carry it; "
                    "couple it (*COUPLING), or take the mass out"
                )
            if on.size == 1 and row in inertia:
                place = f"{lines[row].place}: node {labels[row]}"
                self.notes.append(f"{place} of a solid does not turn: its rotary inertia does nothing")
            own = inertia.get(row, np.zeros((3, 3)))
            found.append(PointMass(f"node {labels[row]}", carriers.points[row], on, mass.get(row, 0.0), own))
        if found:
            total = sum(one.mass for one in found)
            self.notes.append(f"masses at {len(found)} nodes: {listed(one.name for one in found)}; {total:.5g} kg")
        return tuple(found)


@dataclass(frozen=True, slots=True)
class Carriers:
    """What carries a node: itself where elements have it, else the nodes of the coupling that it is the reference of.

    Attributes
    ----------
    points : (n, 3) float
        m.
    used : set of int
        Rows of nodes of solid elements.
    couplings : sequence of Coupling
    """

    points: FloatArray
    used: set[int]
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
