"""Elements to which the section of a shell, a beam or a bar gives what solids have by themselves."""

from collections.abc import Mapping
from typing import TypeVar

from flexfmu.mesh.decks.cards import Card
from flexfmu.mesh.decks.geometry import Elements, ElementTable
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.elements import ElementType

Made = TypeVar("Made")


def take(
    card: Card,
    element_sets: SetTable,
    elements: Elements,
    table: ElementTable,
    kinds: Mapping[str, ElementType],
    made: dict[int, Made],
    value: Made,
) -> None:
    """Give the elements of a section what it makes of them.

    Parameters
    ----------
    card : Card
        With a set.
    element_sets : SetTable
    elements : Elements
        Of which they are not a part yet.
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
    members = element_sets.find(card.required("ELSET"), card.line, card.scope)
    chosen = elements.others_of(members)
    if len(chosen) < len(members) or any(one.name not in kinds for one in chosen):
        names = ", ".join(sorted({one.name for one in chosen} - set(kinds))) or "solids"
        raise card.line.error(
            f"*{card.keyword} is for elements of type {', '.join(kinds)}, set '{card.parameters['ELSET']}' holds "
            f"others: {names}; mesh these with the types named, or with solids"
        )
    for one in chosen:
        if made.setdefault(one.label, value) != value:
            raise card.line.error(f"element {one.label} has another section already; give it one")
        kind = kinds[one.name]
        table.known[one.label] = one._replace(
            solid=kind, nodes=[*one.nodes, one.nodes[-1]][:3] if kind.beam else one.nodes
        )
