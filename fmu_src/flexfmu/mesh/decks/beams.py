"""Beams of a deck: elements to which *BEAM SECTION or *BEAM GENERAL SECTION gives a section."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from flexfmu.files.units import UnitSystem
from flexfmu.mesh.beams import Beam
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.geometry import Elements, ElementTable
from flexfmu.mesh.decks.materials import DeckMaterials, MaterialCard
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.sections import box, ellipse, pipe, rectangle

KEYS = ("BEAMSECTION", "BEAMGENERALSECTION")
_READ_AS = ("B31", "B31R", "B31H", "B32", "B32R", "B32H")
_PARAMETERS = ("ELSET", "MATERIAL", "SECTION", "POISSON", "TEMPERATURE", "DENSITY", "ROTARYINERTIA")
_FIRST_AXIS = (0.0, 0.0, -1.0)
# Numbers of a section, in words, and what they make.
_SHAPES: dict[str, tuple[int, str, Callable[[list[float]], tuple[float, ...]]]] = {
    "RECT": (2, "widths along the first and the second axis", lambda n: rectangle(*n[:2])),
    "CIRC": (1, "radius (two are CalculiX's thicknesses)", lambda n: ellipse(*(n[:2] if n[1:] else [2.0 * n[0]] * 2))),
    "PIPE": (2, "outer radius and wall", lambda n: pipe(*n[:2])),
    "BOX": (6, "both widths and four walls, opposite ones alike", lambda n: box(*n[:4]) if n[2:4] == n[4:6] else ()),
    "GENERAL": (5, "A, I11, I12 = 0, I22, J", lambda n: () if n[2] else (n[0], n[3], n[1], n[4], n[0], n[0])),
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
        card.allow(_PARAMETERS)
        members = element_sets.find(card.required("ELSET"), card.line, card.scope)
        chosen = elements.others_of(members)
        if len(chosen) < len(members) or any(one.name not in _READ_AS for one in chosen):
            words = f"*{card.keyword} is for elements of type {', '.join(_READ_AS)}, its set holds others"
            raise card.line.error(f"{words}; mesh these with beams")
        beam = _beam(card, materials, units)
        for one in chosen:
            if beams.setdefault(one.label, beam) != beam:
                raise card.line.error(f"element {one.label} has another section already; give it one")
            table.known[one.label] = one._replace(solid=ElementType.B31, nodes=[*one.nodes, one.nodes[-1]][:3])
    return beams


def _beam(card: Card, materials: DeckMaterials, units: UnitSystem) -> Beam:
    """The beam of a section; its material is noted."""
    shape = card.parameters.get("SECTION", "GENERAL" if card.key == KEYS[1] else "").upper()
    if shape not in _SHAPES:
        words = f"SECTION={shape or 'nothing'} is not supported (supported: {', '.join(_SHAPES)})"
        raise card.line.error(f"{words}; give A, I11, I12 = 0, I22, J with *BEAM GENERAL SECTION, SECTION=GENERAL")
    count, words, made = _SHAPES[shape]
    rows = [[number(text, line, "a number of the section") for text in fields(line)] for line in card.data]
    section = made(rows[0]) if rows and len(rows[0]) >= count else ()
    direction = tuple(rows[1]) if rows[1:] and rows[1] else _FIRST_AXIS
    if not section or min(section) <= 0.0 or len(direction) != 3:
        words = (
            f"a section {shape} has {count} positive numbers: {words}; and three of the first axis; found {rows[:2]}"
        )
        raise (card.data or [card.line])[0].error(f"{words}. Say others by SECTION=GENERAL in principal axes")
    if card.scope.rotation is not None:
        direction = tuple((card.scope.rotation @ direction).tolist())
    if card.key == KEYS[1]:
        if len(rows) < 3 or len(rows[2]) < 2 or min(rows[2][:2]) <= 0.0:
            raise card.line.error("*BEAM GENERAL SECTION should have a third row with the moduli E and G; add it")
        # A material of ν = 0: the modulus of shear is in the section.
        section = (*section[:3], *(2.0 * rows[2][1] / rows[2][0] * one for one in section[3:]))
        text, name = card.parameters.get("DENSITY"), f"section of {card.required('ELSET')}"
        density = number(text, card.line, "DENSITY") * units.density if text else None
        materials.cards[name.upper()] = MaterialCard(name, card.line, (rows[2][0] * units.stress, 0.0), None, density)
        card = replace(card, parameters={**card.parameters, "MATERIAL": name})
    materials.section(card)
    scales = (units.length**power for power in (2, 4, 4, 4, 2, 2))
    return Beam(tuple(one * scale for one, scale in zip(section, scales, strict=True)), direction)
