"""Shells, beams and bars of a deck: elements to which a section gives what solids have by themselves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf, nan
from typing import NamedTuple, TypeVar

import numpy as np

from flexfmu.files.basics import FloatArray, IntArray, MeshError, UnitSystem, listed
from flexfmu.mesh.beams import Beam, CrossSection, box, ellipse, i_section, l_section, pipe, rectangle
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.geometry import ElementTable
from flexfmu.mesh.decks.materials import DeckMaterials, plies
from flexfmu.mesh.decks.sets import Deck
from flexfmu.mesh.elements import ElementBlock, ElementType
from flexfmu.mesh.model import Material
from flexfmu.mesh.shells import MOST_NODES, at_nodes

Made = TypeVar("Made")


def take(
    card: Card, deck: Deck, table: ElementTable, kinds: Mapping[str, ElementType], made: dict[int, Made], value: Made
) -> None:
    """Give the elements of a section what it makes of them.

    Parameters
    ----------
    card : Card
        With a set.
    deck : Deck
        Of whose body they are not a part yet.
    table : ElementTable
        Gets them as elements of the body.
    kinds : mapping of str to ElementType
        What elements of the deck become.
    made : dict
        Gets the value by the elements' labels.
    value : anything

    Raises
    ------
    DeckError
        Another type of element, or an element with two sections.
    """
    for one in deck.chosen(card, kinds):
        if made.setdefault(one.label, value) != value:
            raise card.line.error(f"element {one.label} has another section already; give it one")
        kind = kinds[one.name]
        nodes = [*one.nodes, one.nodes[-1]][:3] if kind.beam else one.nodes
        table.known[one.label] = one._replace(solid=kind, nodes=nodes)


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


def thickness_by_node(cards: Sequence[Card], deck: Deck) -> dict[int, float]:
    """Thickness of nodes, by label, of *NODAL THICKNESS."""
    found, labels = {}, deck.nodes.labels()
    for card in cards:
        for line in card.data:
            entry, value, *_ = [*fields(line), ""]
            for row in deck.node_sets.find(entry, line, card.scope):
                found[int(labels[row])] = number(value, line, "the thickness")
    return found


def take_shells(cards: Sequence[Card], deck: Deck, table: ElementTable, materials: DeckMaterials) -> dict[int, Faces]:
    """Make shells of the elements that sections name.

    Parameters
    ----------
    cards : sequence of Card
        *SHELL SECTION.
    deck : Deck
        Of whose body shells are not a part yet.
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
    for card in cards:
        take(card, deck, table, _READ_AS, heights, _faces(card))
        materials.section(card)
    return heights


def _faces(card: Card) -> Faces:
    """Heights of both faces over the nodes, along the normal."""
    if "SHELLTHICKNESS" in card.parameters:
        found = "*SHELL SECTION, SHELLTHICKNESS: thickness by a distribution is not supported"
        raise card.line.error(f"{found}: give sets of elements their thickness")
    card.allow((*_PARAMETERS, _BY_NODE, "COMPOSITE", "LAYUP", "SYMMETRIC"))
    texts, layers = card.row, plies(card)
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
            fault = f"nodes {listed(np.unique(named[own[wanted] <= 0.0]))} of shells have no positive thickness"
            raise MeshError(f"{fault}: give them one by *NODAL THICKNESS")
        faces = np.array([one[:2] for one in given])[:, None]
        found.append(at_nodes(own[:, :, None] * faces) if block.type.shell else np.tile(faces, (1, MOST_NODES, 1)))
    return np.concatenate(found)


KEYS = ("BEAMSECTION", "BEAMGENERALSECTION")
BARS = dict.fromkeys(("T3D2", "T3D2H", "T3D3", "T3D3H"), ElementType.B31)
_BEAMS_AS = dict.fromkeys(("B31", "B31R", "B31H", "B32", "B32R", "B32H"), ElementType.B31)
_OF_BEAMS = ("ELSET", "MATERIAL", "SECTION", "POISSON", "TEMPERATURE", "ROTARYINERTIA", "OFFSET1", "OFFSET2")
_FIRST_AXIS = (0.0, 0.0, -1.0)


def _general(n: list[float]) -> CrossSection | None:
    """Of A, I11, I12, I22, J; about the first axis is across the second."""
    return CrossSection((n[0], n[3], n[1], n[4], n[0], n[0]), n[2]) if n[2] ** 2 < n[1] * n[3] else None


def _eye(n: list[float]) -> CrossSection | None:
    return i_section(n[1], (n[2], n[3]), (n[4], n[5]), n[6]) if n[4] + n[5] < n[1] else None


# Numbers of a section, in words, and what they make.
_SHAPES: dict[str, tuple[int, str, Callable[[list[float]], CrossSection | None]]] = {
    "RECT": (1, "widths along the first and the second axis, or one for both", lambda n: rectangle(*(n * 2)[:2])),
    "CIRC": (1, "radius (two are CalculiX's thicknesses)", lambda n: ellipse(*(n[:2] if n[1:] else [2.0 * n[0]] * 2))),
    "PIPE": (2, "outer radius and wall", lambda n: pipe(*n[:2])),
    "BOX": (6, "both widths and four walls, opposite ones alike", lambda n: box(*n[:4]) if n[2:4] == n[4:6] else None),
    "I": (7, "place of the node over the bottom, height, two widths of flanges, two thicknesses, web", _eye),
    "L": (4, "two widths and their thicknesses", lambda n: l_section(*n[:4]) if n[3] < n[0] and n[2] < n[1] else None),
    "GENERAL": (5, "A, I11, I12, I22, J", _general),
}


def take_beams(cards: Sequence[Card], deck: Deck, table: ElementTable, materials: DeckMaterials) -> dict[int, Beam]:
    """Make beams of the elements that sections name.

    Parameters
    ----------
    cards : sequence of Card
        Of `KEYS`.
    deck : Deck
        Of whose body beams are not a part yet.
    table : ElementTable
        Gets them as elements of the body.
    materials : DeckMaterials
        Gets the sections, and materials of general sections.

    Returns
    -------
    dict of int to Beam
        By label; SI units.

    Raises
    ------
    DeckError
        Another type of element or shape, missing numbers, or an element with two sections.
    """
    beams: dict[int, Beam] = {}
    for card in cards:
        if card.key in KEYS:
            take(card, deck, table, _BEAMS_AS, beams, _beam(card, materials, deck.units))
        # The others of a set have their material by its section.
        elif any(one.dimension == 1 for one in deck.elements.others_of(deck.members(card))):
            take(card, deck, table, BARS, beams, _bar(card, deck.units))
    return beams


def _bar(card: Card, units: UnitSystem) -> Beam:
    """The beam without bending of a *SOLID SECTION."""
    area = number(card.row[0], card.first, "the area") if any(card.row[:1]) else 1.0
    if area <= 0.0:
        raise card.first.error(f"the area of bars is {area:g}, expected a positive number")
    return Beam(CrossSection((area, 0.0, 0.0, 0.0, inf, inf)).scaled(units.length), (0.0, 0.0, 0.0))


def _place(card: Card, shape: str, numbers: list[float], units: UnitSystem) -> tuple[float, float]:
    """Where the nodes are in the section's coordinates, m; CalculiX's offsets are over the section's widths."""
    offsets = [number(card.parameters.get(f"OFFSET{k}", "0"), card.line, f"OFFSET{k}") for k in (1, 2)]
    both = [2.0 * numbers[0]] * 2
    circle = numbers[:2] if numbers[1:] else both
    widths = {"RECT": (numbers * 2)[:2], "BOX": numbers[:2], "PIPE": both, "CIRC": circle}.get(shape, [0.0, 0.0])
    if any(offsets) and not all(widths):
        raise card.line.error(f"offsets of a section {shape} are not supported (supported: RECT, CIRC, BOX, PIPE)")
    one, two = (units.length * part * size for part, size in zip(offsets, widths, strict=True))
    return one, two + (numbers[0] * units.length if shape == "I" else 0.0)


def _beam(card: Card, materials: DeckMaterials, units: UnitSystem) -> Beam:
    """The beam of a section; its material is noted."""
    shape = card.parameters.get("SECTION", "GENERAL" if card.key == KEYS[1] else "").upper()
    card.allow((*_OF_BEAMS, "DENSITY") if card.key == KEYS[1] else _OF_BEAMS)
    shape = shape[:4] if shape[:4] in ("RECT", "CIRC") else shape
    if shape not in _SHAPES:
        words = f"SECTION={shape or 'nothing'} is not supported (supported: {', '.join(_SHAPES)})"
        raise card.line.error(f"{words}; give A, I11, I12, I22, J with *BEAM GENERAL SECTION, SECTION=GENERAL")
    count, words, made = _SHAPES[shape]
    rows = [[number(text, line, "a number of the section") for text in fields(line)] for line in card.data]
    section = made(rows[0]) if rows and len(rows[0]) >= count else None
    direction = tuple(rows[1]) if rows[1:] and rows[1] else _FIRST_AXIS
    if section is None or not 0.0 < min(section.constants) < inf or len(direction) != 3:
        words = f"{shape} has {count} positive numbers: {words}; and three of the first axis; found {rows[:2]}"
        raise card.first.error(f"{words}. Say others by SECTION=GENERAL")
    place = _place(card, shape, rows[0], units)
    if card.scope.rotation is not None:
        direction = tuple((card.scope.rotation @ direction).tolist())
    if card.key == KEYS[1]:
        if len(rows) < 3 or len(rows[2]) < 2 or min(rows[2][:2]) <= 0.0:
            raise card.line.error("*BEAM GENERAL SECTION should have a third row with the moduli E and G; add it")
        # A material of ν = 0: the modulus of shear is in the section.
        over = 2.0 * rows[2][1] / rows[2][0]
        section = section._replace(constants=(*section.constants[:3], *(over * one for one in section.constants[3:])))
        text, name = card.parameters.get("DENSITY"), f"section of {card.required('ELSET')}"
        density = number(text, card.line, "DENSITY") * units.density if text else nan
        materials.cards[name.upper()] = card.line, Material(name, rows[2][0] * units.stress, 0.0, density)
        card = replace(card, parameters={**card.parameters, "MATERIAL": name})
    materials.section(card)
    return Beam(section.scaled(units.length), direction, place)
