"""Displacements that a deck itself holds at zero."""

from flexfmu.files.array_types import BoolArray
from flexfmu.mesh.decks.cards import Card, Line, fields, integer, number
from flexfmu.mesh.decks.sets import SetTable

# Degrees of freedom 4 to 6 are rotations, which reference nodes have and nodes of solids have not.
LAST_DOF = 6

# Named conditions: the degrees of freedom, counted from one, that they hold.
NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
}


def hold(card: Card, node_sets: SetTable, fixed: BoolArray) -> None:
    """Mark the translations and rotations that a *BOUNDARY card holds at zero.

    Parameters
    ----------
    card : Card
    node_sets : SetTable
    fixed : (n, 6) bool
        Changed in place.

    Raises
    ------
    DeckError
        A displacement other than zero, an impossible degree of freedom, or an unknown node or set.
    """
    for line in card.data:
        entry, *rest = fields(line)
        rows = list(node_sets.find(entry, line, card.scope))
        for dof in _dofs(rest, line):
            fixed[rows, dof - 1] = True


def _dofs(texts: list[str], line: Line) -> tuple[int, ...]:
    """Return the degrees of freedom, counted from one, that a row's fields after the node name."""
    if len(texts) == 1 and texts[0].upper() in NAMED:
        return NAMED[texts[0].upper()]
    if not 1 <= len(texts) <= 3:
        raise line.error(f"expected 'node or set, first, last' or 'node or set, name' with one of {', '.join(NAMED)}")
    first = integer(texts[0], line, f"the first degree of freedom (or a name such as {next(iter(NAMED))})")
    last = integer(texts[1], line, "the last degree of freedom") if texts[1:] and texts[1] else first
    if not 1 <= first <= last <= LAST_DOF:
        raise line.error(
            f"degrees of freedom {first} to {last} cannot be held; give an ascending range of the translations 1 to 3"
        )
    value = number(texts[2], line, "the displacement") if texts[2:] and texts[2] else 0.0
    if value != 0.0:
        raise line.error(
            f"a displacement of {value:g} is prescribed, only zero can be held: move the interface in the simulation "
            "instead, or leave the deck's *BOUNDARY out with boundary = false in [mesh]"
        )
    return tuple(range(first, last + 1))
