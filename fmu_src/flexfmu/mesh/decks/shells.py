"""Shells of a deck: elements to which *SHELL SECTION gives a thickness; without one they serve sets."""

from collections.abc import Sequence

import numpy as np

from flexfmu.files.array_types import FloatArray
from flexfmu.mesh.blocks import ElementBlock
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.geometry import Elements, ElementTable
from flexfmu.mesh.decks.materials import DeckMaterials
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.decks.structures import take
from flexfmu.mesh.elements import ElementType

KEY = "SHELLSECTION"
_READ_AS = dict.fromkeys(("S3", "S3R", "STRI3"), ElementType.S3)
_READ_AS |= dict.fromkeys(("S4", "S4R", "S4R5"), ElementType.S4)
_READ_AS |= dict.fromkeys(("S6", "STRI65"), ElementType.S6)
_READ_AS |= dict.fromkeys(("S8", "S8R", "S8R5", "S9R5"), ElementType.S8)
# What changes results by other integration only, or nothing of linear elasticity.
_PARAMETERS = ("ELSET", "MATERIAL", "OFFSET", "ORIENTATION", "CONTROLS", "SECTIONINTEGRATION", "POISSON", "DENSITY")
# Offsets of the middle from the nodes, over the thickness.
_SIDES = {"SPOS": 0.5, "SNEG": -0.5}
_REFUSED = {
    "COMPOSITE": "layers are not supported: give one material and the thickness",
    "NODALTHICKNESS": "thickness by node is not supported: give sets of elements their thickness",
    "SHELLTHICKNESS": "thickness by a distribution is not supported: give sets of elements their thickness",
}


def take_shells(
    sections: Sequence[Card], element_sets: SetTable, elements: Elements, table: ElementTable, materials: DeckMaterials
) -> dict[int, tuple[float, float]]:
    """Make shells of the elements that sections name.

    Parameters
    ----------
    sections : sequence of Card
        *SHELL SECTION.
    element_sets : SetTable
    elements : Elements
        Of which shells are not a part yet.
    table : ElementTable
        Gets them as elements of the body.
    materials : DeckMaterials
        Gets the sections.

    Returns
    -------
    dict of int to tuple of float
        Heights of both faces of each shell over its nodes along its normal, by its label, in the deck's units.

    Raises
    ------
    DeckError
        Another type of element, layers, or an element with two sections.
    """
    heights: dict[int, tuple[float, float]] = {}
    for card in sections:
        take(card, element_sets, elements, table, _READ_AS, heights, _faces(card))
        materials.section(card)
    return heights


def _faces(card: Card) -> tuple[float, float]:
    """Heights of both faces over the nodes, along the normal."""
    for key, words in _REFUSED.items():
        if key in card.parameters:
            raise card.line.error(f"*SHELL SECTION, {key}: {words}")
    card.allow(_PARAMETERS)
    texts = fields(card.data[0]) if card.data else []
    if not texts or not texts[0]:
        raise card.line.error("*SHELL SECTION should have a row with the thickness; add it")
    value = number(texts[0], card.data[0], "the thickness")
    if value <= 0.0:
        raise card.data[0].error(f"the thickness is {value:g}, expected a positive number")
    text = card.parameters.get("OFFSET", "0").upper()
    offset = _SIDES[text] if text in _SIDES else number(text, card.line, "OFFSET")
    return (offset - 0.5) * value, (offset + 0.5) * value


def by_element(heights: dict[int, tuple[float, float]], blocks: Sequence[ElementBlock]) -> FloatArray:
    """Heights (n_elements, 2) of the faces of the elements of the body; not numbers for solids."""
    labels = np.concatenate([block.labels for block in blocks])
    return np.array([heights.get(label, (np.nan, np.nan)) for label in labels.tolist()])
