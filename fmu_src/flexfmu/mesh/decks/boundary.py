"""Displacements that a deck itself holds at zero."""

import contextlib
from collections.abc import Container, Mapping, Sequence

import numpy as np

from flexfmu.files.basics import BoolArray, DeckError, FloatArray, IntArray, listed
from flexfmu.mesh.decks.cards import Card, Line, fields, integer, number
from flexfmu.mesh.decks.sets import Deck

# Degrees of freedom 4 to 6 are rotations, which reference nodes have and nodes of solids have not.
LAST_DOF = 6
# Pressure and temperature of fluids and heat.
_OTHER_DOFS = (8, 11)
# Cosine of the angle to a global axis, less one, within which a direction is that axis.
_ALONG = 1e-9

# Named conditions: the degrees of freedom, counted from one, that they hold.
NAMED = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
}


def hold(card: Card, deck: Deck, fixed: BoolArray) -> list[str]:
    """Mark the translations and rotations that a *BOUNDARY card holds at zero.

    Parameters
    ----------
    card : Card
    deck : Deck
    fixed : (n, 6) bool
        Changed in place.

    Returns
    -------
    list of str
        Notes on displacements other than zero, which hold nothing.

    Raises
    ------
    DeckError
        An impossible degree of freedom, or an unknown node or set.
    """
    moved: list[str] = []
    for line in card.data:
        entry, *rest = fields(line)
        rows = list(deck.node_sets.find(entry, line, card.scope))
        for dof in _dofs(rest, line, moved):
            fixed[rows, dof - 1] = True
    told = f"{card.line.place}: what is moved holds nothing here: {listed(moved)}"
    return [f"{told}; give an interface, and move it in the simulation"] if moved else []


def held_by_steps(steps: Sequence[Sequence[Card]], deck: Deck, axes: Container[int]) -> dict[str, IntArray]:
    """Return the nodes that steps hold, which hold nothing by themselves, as sets to choose from.

    Parameters
    ----------
    steps : sequence of sequence of Card
        The *BOUNDARY cards of each step; a row that cannot be read is of another analysis.
    deck : Deck
    axes : container of int
        Rows of nodes with axes of their own, which are left out.

    Returns
    -------
    dict of str to (k,) int
        "STEP 1" is held in all translations, "STEP 1 xy" along these, and so on.
    """
    found, count = {}, len(deck.nodes.rows)
    for which, cards in enumerate(steps, start=1):
        fixed = np.zeros((count, LAST_DOF), dtype=bool)
        for card in cards:
            with contextlib.suppress(DeckError):
                hold(card, deck, fixed)
        kinds = fixed[:, :3] @ [1, 2, 4] * [row not in axes for row in range(count)]
        for kind in sorted(set(kinds.tolist()) - {0}, reverse=True):
            along = "".join(name for k, name in enumerate("xyz") if kind >> k & 1)
            found[f"STEP {which} {along}".removesuffix(" xyz")] = np.flatnonzero(kinds == kind)
    return found


def inclined(axes: Mapping[int, FloatArray], fixed: BoolArray, card: Card) -> list[dict[int, float]]:
    """Take what is held along axes of *TRANSFORM as held along global axes, or as equations where these differ.

    Parameters
    ----------
    axes : mapping of int to (3, 3) float
        Columns by row of the node.
    fixed : (n, 6) bool
        Along the nodes' own axes; changed in place.
    card : Card
        The last *TRANSFORM, for the message.

    Returns
    -------
    list of dict of int to float
        Coefficients by unknown, 3 i + j for node i in direction j.

    Raises
    ------
    DeckError
        A rotation is held about an axis that is not global, and others are not.
    """
    found: list[dict[int, float]] = []
    for row, own in axes.items():
        held = fixed[row].copy()
        for first in (0, 3):
            chosen = np.flatnonzero(held[first : first + 3])
            if len(chosen) in (0, 3):
                continue
            fixed[row, first : first + 3] = False
            for direction in own.T[chosen]:
                if not direction.any():
                    raise card.line.error("a held node lies on the axis of this system: it has no such direction")
                if np.abs(direction).max() > 1.0 - _ALONG:
                    fixed[row, first + int(np.abs(direction).argmax())] = True
                elif first:
                    raise card.line.error("a rotation is held about an axis of this system; hold all three, or none")
                else:
                    found.append({3 * row + axis: float(part) for axis, part in enumerate(direction)})
    return found


def _dofs(texts: list[str], line: Line, moved: list[str]) -> tuple[int, ...]:
    """Return the degrees of freedom, counted from one, that a row's fields after the node name."""
    if len(texts) == 1 and texts[0].upper() in NAMED:
        return NAMED[texts[0].upper()]
    if not 1 <= len(texts) <= 3:
        raise line.error(f"expected 'node or set, first, last' or 'node or set, name' with one of {', '.join(NAMED)}")
    first = integer(texts[0], line, f"the first degree of freedom (or a name such as {next(iter(NAMED))})")
    last = integer(texts[1], line, "the last degree of freedom") if texts[1:] and texts[1] else first
    if first == last and first in _OTHER_DOFS:
        return ()
    if not 1 <= first <= last <= LAST_DOF:
        raise line.error(
            f"degrees of freedom {first} to {last} cannot be held; give an ascending range of the translations 1 to 3"
        )
    value = number(texts[2], line, "the displacement") if texts[2:] and texts[2] else 0.0
    if value != 0.0:
        moved.append(line.text)
        return ()
    return tuple(range(first, last + 1))
