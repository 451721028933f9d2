"""Beams of a deck: elements to which *BEAM SECTION or *BEAM GENERAL SECTION gives a section, and bars."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf

from flexfmu.files.units import UnitSystem
from flexfmu.mesh.beams import Beam, CrossSection, box, ellipse, i_section, l_section, pipe, rectangle
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.geometry import Elements, ElementTable
from flexfmu.mesh.decks.materials import DeckMaterials, MaterialCard
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.decks.structures import take
from flexfmu.mesh.elements import ElementType

KEYS = ("BEAMSECTION", "BEAMGENERALSECTION")
BARS = dict.fromkeys(("T3D2", "T3D2H", "T3D3", "T3D3H"), ElementType.B31)
_READ_AS = dict.fromkeys(("B31", "B31R", "B31H", "B32", "B32R", "B32H"), ElementType.B31)
_PARAMETERS = ("ELSET", "MATERIAL", "SECTION", "POISSON", "TEMPERATURE", "ROTARYINERTIA", "OFFSET1", "OFFSET2")
_FIRST_AXIS = (0.0, 0.0, -1.0)


def _general(n: list[float]) -> CrossSection | None:
    """Of A, I11, I12, I22, J; about the first axis is across the second."""
    return CrossSection((n[0], n[3], n[1], n[4], n[0], n[0]), n[2]) if n[2] ** 2 < n[1] * n[3] else None


def _ell(n: list[float]) -> CrossSection | None:
    return l_section(*n[:4]) if n[3] < n[0] and n[2] < n[1] else None


def _eye(n: list[float]) -> CrossSection | None:
    return i_section(n[1], (n[2], n[3]), (n[4], n[5]), n[6]) if n[4] + n[5] < n[1] else None


# Numbers of a section, in words, and what they make.
_SHAPES: dict[str, tuple[int, str, Callable[[list[float]], CrossSection | None]]] = {
    "RECT": (2, "widths along the first and the second axis", lambda n: CrossSection(rectangle(*n[:2]))),
    "CIRC": (
        1,
        "radius (two are CalculiX's thicknesses)",
        lambda n: CrossSection(ellipse(*(n[:2] if n[1:] else [2.0 * n[0]] * 2))),
    ),
    "PIPE": (2, "outer radius and wall", lambda n: CrossSection(pipe(*n[:2]))),
    "BOX": (
        6,
        "both widths and four walls, opposite ones alike",
        lambda n: CrossSection(box(*n[:4])) if n[2:4] == n[4:6] else None,
    ),
    "I": (7, "place of the node over the bottom, height, two widths of flanges, two thicknesses, web", _eye),
    "L": (4, "two widths and their thicknesses", _ell),
    "GENERAL": (5, "A, I11, I12, I22, J", _general),
}


def take_beams(
    cards: Sequence[Card],
    element_sets: SetTable,
    elements: Elements,
    table: ElementTable,
    materials: DeckMaterials,
    units: UnitSystem,
) -> dict[int, Beam]:
    """Make beams of the elements that sections name.

    Parameters
    ----------
    cards : sequence of Card
        Of `KEYS`.
    element_sets : SetTable
    elements : Elements
        Of which beams are not a part yet.
    table : ElementTable
        Gets them as elements of the body.
    materials : DeckMaterials
        Gets the sections, and materials of general sections.
    units : UnitSystem

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
            take(card, element_sets, elements, table, _READ_AS, beams, _beam(card, materials, units))
            continue
        # The others of a set have their material by its section.
        members = elements.others_of(element_sets.find(card.required("ELSET"), card.line, card.scope))
        if any(one.dimension == 1 for one in members):
            take(card, element_sets, elements, table, BARS, beams, _bar(card, units))
    return beams


def _bar(card: Card, units: UnitSystem) -> Beam:
    """The beam without bending of a *SOLID SECTION."""
    texts = fields(card.data[0]) if card.data else []
    area = number(texts[0], card.data[0], "the area") if texts and texts[0] else 1.0
    if area <= 0.0:
        raise card.data[0].error(f"the area of bars is {area:g}, expected a positive number")
    return Beam(CrossSection((area, 0.0, 0.0, 0.0, inf, inf)).scaled(units.length), (0.0, 0.0, 0.0))


def _place(card: Card, shape: str, numbers: Sequence[float], units: UnitSystem) -> tuple[float, float]:
    """Where the nodes are in the section's coordinates, m; CalculiX's offsets are over the section's widths."""
    offsets = [number(card.parameters.get(f"OFFSET{k}", "0"), card.line, f"OFFSET{k}") for k in (1, 2)]
    widths = {"RECT": numbers[:2], "BOX": numbers[:2], "PIPE": [2.0 * numbers[0]] * 2}.get(shape, [0.0, 0.0])
    if any(offsets) and not all(widths):
        raise card.line.error(f"offsets of a section {shape} are not supported (supported: RECT, BOX, PIPE)")
    one, two = (units.length * part * size for part, size in zip(offsets, widths, strict=True))
    return one, two + (numbers[0] * units.length if shape == "I" else 0.0)


def _beam(card: Card, materials: DeckMaterials, units: UnitSystem) -> Beam:
    """The beam of a section; its material is noted."""
    shape = card.parameters.get("SECTION", "GENERAL" if card.key == KEYS[1] else "").upper()
    card.allow((*_PARAMETERS, "DENSITY") if card.key == KEYS[1] else _PARAMETERS)
    if shape not in _SHAPES:
        words = f"SECTION={shape or 'nothing'} is not supported (supported: {', '.join(_SHAPES)})"
        raise card.line.error(f"{words}; give A, I11, I12, I22, J with *BEAM GENERAL SECTION, SECTION=GENERAL")
    count, words, made = _SHAPES[shape]
    rows = [[number(text, line, "a number of the section") for text in fields(line)] for line in card.data]
    section = made(rows[0]) if rows and len(rows[0]) >= count else None
    direction = tuple(rows[1]) if rows[1:] and rows[1] else _FIRST_AXIS
    if section is None or not 0.0 < min(section.constants) < inf or len(direction) != 3:
        words = (
            f"a section {shape} has {count} positive numbers: {words}; and three of the first axis; found {rows[:2]}"
        )
        raise (card.data or [card.line])[0].error(f"{words}. Say others by SECTION=GENERAL")
    place = _place(card, shape, rows[0], units)
    if card.scope.rotation is not None:
        direction = tuple((card.scope.rotation @ direction).tolist())
    if card.key == KEYS[1]:
        if len(rows) < 3 or len(rows[2]) < 2 or min(rows[2][:2]) <= 0.0:
            raise card.line.error("*BEAM GENERAL SECTION should have a third row with the moduli E and G; add it")
        # A material of ν = 0: the modulus of shear is in the section.
        over = 2.0 * rows[2][1] / rows[2][0]
        constants = *section.constants[:3], *(over * one for one in section.constants[3:])
        section = section._replace(constants=constants)
        text, name = card.parameters.get("DENSITY"), f"section of {card.required('ELSET')}"
        density = number(text, card.line, "DENSITY") * units.density if text else None
        materials.cards[name.upper()] = MaterialCard(name, card.line, (rows[2][0] * units.stress, 0.0), None, density)
        card = replace(card, parameters={**card.parameters, "MATERIAL": name})
    materials.section(card)
    return Beam(section.scaled(units.length), direction, place)
