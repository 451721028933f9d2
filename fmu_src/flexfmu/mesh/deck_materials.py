"""Materials and solid sections of a deck."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexfmu.mesh.deck_cards import Card, Line, fields, number
from flexfmu.mesh.deck_sets import SetTable
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import NO_MATERIAL, IntArray, Material
from flexfmu.mesh.units import UnitSystem

# Hardly any solid lies outside, kg/m³; a deck whose units are not the declared ones misses by 1e6 and more.
DENSITY_RANGE = (1e-4, 1e5)


@dataclass(slots=True)
class MaterialCard:
    """What the deck says of one material, SI units.

    Attributes
    ----------
    name : str
    line : Line
        The *MATERIAL line.
    elastic : tuple of float or None
        Young's modulus, N/m², and Poisson's ratio.
    density : float or None
        kg/m³.
    """

    name: str
    line: Line
    elastic: tuple[float, float] | None = None
    density: float | None = None


class Section(NamedTuple):
    """A *SOLID SECTION line: an element set made of a material."""

    element_set: str
    material: str
    line: Line


@dataclass(slots=True)
class MaterialTable:
    """The materials and sections read so far.

    Attributes
    ----------
    units : UnitSystem
    cards : dict of str to MaterialCard
        By name in capitals.
    sections : list of Section
    """

    units: UnitSystem
    cards: dict[str, MaterialCard] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)

    def begin(self, card: Card) -> None:
        """Take a *MATERIAL card, to which the following cards belong.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            The material has no name, or there is one of the same name.
        """
        name = card.required("NAME")
        if name.upper() in self.cards:
            raise card.line.error(f"material '{name}' is defined again; rename or remove one of them")
        self.cards[name.upper()] = MaterialCard(name, card.line)

    def elastic(self, card: Card) -> None:
        """Take an *ELASTIC card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            It is not isotropic, not one row, or not physical.
        """
        kind = card.parameters.get("TYPE", "ISO").upper()
        if kind not in ("ISO", "ISOTROPIC"):
            raise card.line.error(f"*ELASTIC, TYPE={kind} is not supported; give isotropic constants (TYPE=ISO)")
        line, values = self._row(card, "Young's modulus, Poisson's ratio", 2)
        youngs, poisson = values[0] * self.units.stress, values[1]
        if youngs <= 0.0:
            raise line.error(f"Young's modulus should be positive, found {values[0]:g}")
        if not -1.0 < poisson < 0.5:
            raise line.error(f"Poisson's ratio should lie between -1 and 0.5 (both excluded), found {poisson:g}")
        self._current(card).elastic = (youngs, poisson)

    def density(self, card: Card) -> None:
        """Take a *DENSITY card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            It is not one row, or not physical in the declared units.
        """
        line, values = self._row(card, "density", 1)
        density = values[0] * self.units.density
        if not DENSITY_RANGE[0] <= density <= DENSITY_RANGE[1]:
            raise line.error(
                f"density {values[0]:g} means {density:g} kg/m³ in the declared units {self.units.value}, "
                f"expected {DENSITY_RANGE[0]:g} to {DENSITY_RANGE[1]:g}; "
                f"correct the density or the units given for this file"
            )
        self._current(card).density = density

    def section(self, card: Card) -> None:
        """Take a *SOLID SECTION card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            Its element set or material is not given.
        """
        self.sections.append(Section(card.required("ELSET"), card.required("MATERIAL"), card.line))

    def assigned(
        self, element_sets: SetTable, labels: IntArray
    ) -> tuple[tuple[Material, ...], IntArray, tuple[str, ...]]:
        """Return the materials that sections name, and which one each element has.

        Parameters
        ----------
        element_sets : SetTable
        labels : (n_elements,) int
            Element numbers, blocks laid end to end.

        Returns
        -------
        materials : tuple of Material
        rows : (n_elements,) int
            Rows of `materials`, or `NO_MATERIAL`.
        notes : tuple of str
            Materials that no section names.

        Raises
        ------
        DeckError
            A section names an unknown set or material, its material lacks a constant, or an element has two
            materials.
        """
        used: dict[str, int] = {}
        materials: list[Material] = []
        rows = np.full(len(labels), NO_MATERIAL, dtype=np.int64)
        for section in self.sections:
            name = section.material.upper()
            if name not in used:
                used[name] = len(materials)
                materials.append(self._material(section))
            row = used[name]
            members = np.array(sorted(element_sets.find(section.element_set, section.line)), dtype=np.int64)
            taken = members[(rows[members] != NO_MATERIAL) & (rows[members] != row)]
            if len(taken):
                raise section.line.error(
                    f"elements of set '{section.element_set}' have the material "
                    f"'{materials[rows[taken[0]]].name}' already: {listed(labels[taken])}; "
                    f"give each element one section"
                )
            rows[members] = row
        notes = tuple(
            f"{card.line.file}, line {card.line.number}: no *SOLID SECTION uses the material '{card.name}'"
            for key, card in self.cards.items()
            if key not in used
        )
        return tuple(materials), rows, notes

    def _material(self, section: Section) -> Material:
        card = self.cards.get(section.material.upper())
        if card is None:
            known = listed(entry.name for entry in self.cards.values())
            raise section.line.error(
                f"material '{section.material}' is not defined (known: {known}); define it or correct the name"
            )
        if card.elastic is None or card.density is None:
            missing = "*ELASTIC" if card.elastic is None else "*DENSITY"
            raise card.line.error(f"material '{card.name}' has no {missing}; add it below this line")
        return Material(card.name, *card.elastic, card.density)

    def _current(self, card: Card) -> MaterialCard:
        if not self.cards:
            raise card.line.error(f"*{card.keyword} stands before any *MATERIAL; put it below the one it belongs to")
        return list(self.cards.values())[-1]

    def _row(self, card: Card, what: str, count: int) -> tuple[Line, list[float]]:
        """Return the card's one row of constants; a temperature may follow them."""
        if len(card.data) != 1:
            raise card.line.error(
                f"*{card.keyword} should have one row ({what}), found {len(card.data)}; "
                f"constants that depend on temperature are not supported"
            )
        line = card.data[0]
        texts = fields(line)
        if not count <= len(texts) <= count + 1:
            raise line.error(f"*{card.keyword} should have the row '{what}', found {len(texts)} numbers")
        return line, [number(text, line, f"each of {what}") for text in texts[:count]]
