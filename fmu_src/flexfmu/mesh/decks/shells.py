"""Shells of a deck: elements to which *SHELL SECTION gives a thickness; without one they serve sets."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.files.errors import MeshError
from flexfmu.mesh.blocks import ElementBlock
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.geometry import Elements, ElementTable
from flexfmu.mesh.decks.materials import DeckMaterials, plies
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.decks.structures import take
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.listing import listed
from flexfmu.mesh.shells import MOST_NODES, at_nodes

KEY = "SHELLSECTION"
_READ_AS = dict.fromkeys(("S3", "S3R", "STRI3"), ElementType.S3)
_READ_AS |= dict.fromkeys(("S4", "S4R", "S4R5"), ElementType.S4)
_READ_AS |= dict.fromkeys(("S6", "STRI65"), ElementType.S6)
_READ_AS |= dict.fromkeys(("S8", "S8R", "S8R5", "S9R5"), ElementType.S8)
# What changes results by other integration only, or nothing of linear elasticity.
_PARAMETERS = ("ELSET", "MATERIAL", "OFFSET", "ORIENTATION", "CONTROLS", "SECTIONINTEGRATION", "POISSON")
_BY_NODE = "NODALTHICKNESS"
# Offsets of the nodes from the middle, over the thickness.
_SIDES = {"SPOS": 0.5, "SNEG": -0.5}


class Faces(NamedTuple):
    """Heights of both faces of a shell over its nodes along its normal; whether by the thickness of the nodes."""

    low: float
    high: float
    by_node: bool


def thickness_by_node(cards: Sequence[Card], node_sets: SetTable, labels: IntArray) -> dict[int, float]:
    """Thickness of nodes, by label, of *NODAL THICKNESS."""
    found: dict[int, float] = {}
    for card in cards:
        for line in card.data:
            entry, value, *_ = [*fields(line), ""]
            for row in node_sets.find(entry, line, card.scope):
                found[int(labels[row])] = number(value, line, "the thickness")
    return found


def take_shells(
    sections: Sequence[Card], element_sets: SetTable, elements: Elements, table: ElementTable, materials: DeckMaterials
) -> dict[int, Faces]:
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
    dict of int to Faces
        Of each shell, by its label, in the deck's units.

    Raises
    ------
    DeckError
        Another type of element, layers, or an element with two sections.
    """
    heights: dict[int, Faces] = {}
    for card in sections:
        take(card, element_sets, elements, table, _READ_AS, heights, _faces(card))
        materials.section(card)
    return heights


def _faces(card: Card) -> Faces:
    """Heights of both faces over the nodes, along the normal."""
    if "SHELLTHICKNESS" in card.parameters:
        raise card.line.error(
            "*SHELL SECTION, SHELLTHICKNESS: thickness by a distribution is not supported: give sets of elements their "
            "thickness"
        )
    card.allow((*_PARAMETERS, _BY_NODE, "COMPOSITE", "LAYUP", "SYMMETRIC"))
    texts, layers = fields(card.data[0]) if card.data else [], plies(card)
    if not (texts and texts[0]) and _BY_NODE not in card.parameters:
        raise card.line.error("*SHELL SECTION should have a row with the thickness; add it")
    value = sum(layer.thickness for layer in layers)
    if _BY_NODE in card.parameters or not layers:
        value = 1.0 if _BY_NODE in card.parameters else number(texts[0], card.data[0], "the thickness")
    if value <= 0.0:
        raise card.data[0].error(f"the thickness is {value:g}, expected a positive number")
    text = card.parameters.get("OFFSET", "0").upper()
    offset = _SIDES[text] if text in _SIDES else number(text, card.line, "OFFSET")
    return Faces((-0.5 - offset) * value, (0.5 - offset) * value, _BY_NODE in card.parameters)


def by_element(
    heights: Mapping[int, Faces], blocks: Sequence[ElementBlock], labels: IntArray, thickness: Mapping[int, float]
) -> FloatArray:
    """Heights (n_elements, 9, 2) of the faces of the elements of the body at their nodes; not numbers for solids.

    Parameters
    ----------
    heights : mapping of int to Faces
    blocks : sequence of ElementBlock
    labels : (n,) int
        Of nodes.
    thickness : mapping of int to float
        By the labels of nodes.

    Raises
    ------
    MeshError
        A node of a shell whose thickness is that of its nodes has none.
    """
    found = []
    for block in blocks:
        given = [heights.get(one, Faces(np.nan, np.nan, by_node=False)) for one in block.labels.tolist()]
        own, wanted = np.ones(block.connectivity.shape), np.array([one.by_node for one in given])
        named = labels[block.connectivity[wanted]]
        own[wanted] = np.array([thickness.get(one, 0.0) for one in named.ravel().tolist()]).reshape(named.shape)
        if (own <= 0.0).any():
            raise MeshError(
                f"nodes {listed(np.unique(named[own[wanted] <= 0.0]))} of shells have no positive thickness: give them "
                "one by *NODAL THICKNESS"
            )
        faces = np.array([one[:2] for one in given])[:, None]
        found.append(at_nodes(own[:, :, None] * faces) if block.type.shell else np.tile(faces, (1, MOST_NODES, 1)))
    return np.concatenate(found)
