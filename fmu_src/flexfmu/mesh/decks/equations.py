"""Displacements that a deck holds at zero, and linear constraints as equations: *EQUATION, *MPC, the nodes of *TIE."""

import contextlib
from collections.abc import Container, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from flexfmu.files.basics import BoolArray, DeckError, FloatArray, IntArray, listed
from flexfmu.mesh.decks.cards import Card, Line, fields, integer, number
from flexfmu.mesh.decks.sets import Deck, DeckSurface, SetTable
from flexfmu.mesh.elements import face_corners
from flexfmu.mesh.equations import Row, moved_by
from flexfmu.mesh.ties import EdgeTie, OfShell, ShellTie, nearest_faces, weighted

# Degrees of freedom 4 to 6 are rotations, which reference nodes have and nodes of solids have not.
LAST_DOF = 6
# Pressure and temperature of fluids and heat.
_OTHER_DOFS = (8, 11)
# Cosine of the angle to a global axis, less one, within which a direction is that axis.
_ALONG = 1e-9

# Nodes, direction from zero, and coefficient.
Term = tuple[list[int], int, float]
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


def inclined(axes: Mapping[int, FloatArray], fixed: BoolArray, card: Card) -> list[Row]:
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
    found: list[Row] = []
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
        found = f"degrees of freedom {first} to {last} cannot be held"
        raise line.error(f"{found}; give an ascending range of the translations 1 to 3")
    if number("".join(texts[2:]), line, "the displacement", 0.0) != 0.0:
        moved.append(line.text)
        return ()
    return tuple(range(first, last + 1))


TRANSLATIONS = 3
# Directions of CalculiX and Abaqus that are none of motion.
_TEMPERATURE = {"0", "11"}
# Nodes this close, over the body's size, are in one place.
_SAME_PLACE = 1e-9
# Of lengths that are told: the rest is round-off.
_DIGITS = 12


def equations(
    cards: Sequence[Card], deck: Deck, points: FloatArray, axes: Mapping[int, FloatArray], busy: Set[int]
) -> list[Row]:
    """Return the equations of the cards *EQUATION and *MPC.

    Parameters
    ----------
    cards : sequence of Card
    deck : Deck
        Is told of mean rotations, which are left out.
    points : (n, 3) float
    axes : mapping of int to (3, 3) float
        Of *TRANSFORM, columns by row of the node; *EQUATION speaks of them.
    busy : set of int
        Nodes of elements, and those that are held.

    Returns
    -------
    list of dict of int to float
        Coefficients by unknown, 3 i + j for node i in direction j.

    Raises
    ------
    DeckError
        A row is malformed, names what is not there, or is no linear constraint of translations.
    """
    found, node_sets = list[Row](), deck.node_sets
    for card in cards:
        if card.key == "EQUATION":
            found += _equations(card, node_sets, axes)
        else:
            for line in card.data:
                if fields(line)[0].upper() == "MEANROT":
                    deck.notes.append(_mean_rotation(line, card, node_sets, busy))
                else:
                    found += _constraint(line, card, node_sets, points)
    return found


def _equations(card: Card, node_sets: SetTable, axes: Mapping[int, FloatArray]) -> list[Row]:
    """Equations of a card, which holds several one after the other: a count, then so many terms."""
    found: list[Row] = []
    lines = iter(card.data)
    for line in lines:
        count = integer(fields(line)[0], line, "the number of terms of an equation")
        if count < 1:
            raise line.error(f"an equation has at least one term, found {count}")
        texts: list[str] = []
        last = line
        while len(texts) < 3 * count:
            following = next(lines, None)
            if following is None:
                fault = f"an equation of {count} terms ends after {len(texts) // 3}"
                raise line.error(f"{fault}: each is 'node, direction, coefficient'; the deck may have been cut short")
            last = following
            texts += fields(last)
        if len(texts) > 3 * count:
            raise last.error(f"an equation of {count} terms has {len(texts)} entries, expected {3 * count}")
        if {*texts[1::3]} <= _TEMPERATURE:
            continue
        parts = zip(texts[::3], texts[1::3], texts[2::3], strict=True)
        found += _expanded([_term(*part, last, card, node_sets) for part in parts], line, axes)
    return found


def _term(node: str, direction: str, factor: str, line: Line, card: Card, node_sets: SetTable) -> Term:
    """A term of an equation."""
    if not 1 <= (axis := integer(direction, line, "the direction of an equation's term")) <= TRANSLATIONS:
        found = f"an equation between rotations (direction {axis}) is not supported"
        raise line.error(f"{found}: nodes of solids have the translations 1 to 3; say it by translations of nodes")
    return _members(node, line, card, node_sets), axis - 1, number(factor, line, "an equation's coefficient")


def _members(entry: str, line: Line, card: Card, node_sets: SetTable) -> list[int]:
    """Rows of a node or of a set in the order of the nodes' numbers, in which sets are paired."""
    rows = node_sets.find(entry, line, card.scope)
    if len(rows) > 1 and node_sets.unsorted.intersection(node_sets.named(entry, card.scope)):
        raise line.error(f"set '{entry}' is UNSORTED, and its order is not kept: write one row for each node")
    return sorted(rows, key=list(node_sets.rows).__getitem__) if len(rows) > 1 else [*rows]


def _expanded(terms: Sequence[Term], line: Line, axes: Mapping[int, FloatArray]) -> list[Row]:
    """One equation for each node of the sets; single nodes stand in all of them."""
    counts = {len(nodes) for nodes, _, _ in terms} - {1}
    if len(counts) > 1 or 0 in counts:
        there = listed(sorted(counts))
        raise line.error(f"the sets of an equation have {there} nodes, expected the same number, or one")
    found = []
    for place in range(max(counts, default=1)):
        row: dict[int, float] = {}
        for nodes, axis, factor in terms:
            node = nodes[place if len(nodes) > 1 else 0]
            direction = axes[node][:, axis] if node in axes else np.eye(3)[axis]
            if not direction.any():
                raise line.error("a node of this equation lies on the axis of its *TRANSFORM: it has no such direction")
            for along in np.flatnonzero(direction).tolist():
                row[3 * node + along] = row.get(3 * node + along, 0.0) + factor * float(direction[along])
        found.append(row)
    return found


def _mean_rotation(line: Line, card: Card, node_sets: SetTable, busy: Set[int]) -> str:
    """Note on a MEANROT, which holds nothing where its last node, by which steps drive the rotation, is free."""
    if node_sets.find(fields(line)[-1], line, card.scope) & busy:
        raise line.error("the last node of MPC MEANROT is held or belongs to elements; give an interface its nodes")
    return f"{line.place}: MPC MEANROT is left to an interface of its nodes, whose rotation is their mean one"


def _constraint(line: Line, card: Card, node_sets: SetTable, points: FloatArray) -> list[Row]:
    """Equations of a row of *MPC: those that stay linear however far the nodes turn."""
    kind, *entries = fields(line)
    kind = kind.upper()
    groups = [_members(entry, line, card, node_sets) for entry in entries]
    if kind in ("TIE", "PIN", "BEAM") and len(groups) == 2 and len(groups[1]) in (1, len(groups[0])):
        pairs = [(node, groups[1][place if len(groups[1]) > 1 else 0]) for place, node in enumerate(groups[0])]
        apart = max((float(np.linalg.norm(points[a] - points[b])) for a, b in pairs), default=0.0)
        if kind == "BEAM" and apart > _SAME_PLACE * float(np.ptp(points, axis=0).max()):
            raise line.error(
                f"MPC BEAM joins nodes that are {apart:.4g} apart: where it turns, a rigid link is no linear "
                "constraint; mesh it with stiff solids, or take a *COUPLING, which serves as an interface"
            )
        return [row for node, other in pairs if node != other for row in moved_by(node, {other: 1.0})]
    if kind in ("LINEAR", "QUADRATIC") and all(len(group) == 1 for group in groups):
        nodes, wanted = [group[0] for group in groups], {"LINEAR": 3, "QUADRATIC": 4}[kind]
        if len(nodes) != wanted:
            raise line.error(f"MPC {kind} takes {wanted} nodes, found {len(nodes)}")
        weights = _along(points[nodes], line, kind)
        return [] if nodes[0] in nodes[1:] else moved_by(nodes[0], dict(zip(nodes[1:], weights, strict=True)))
    raise line.error(
        f"MPC {kind} of {len(groups)} nodes or sets is not supported (supported: TIE and PIN of two, LINEAR of three, "
        "QUADRATIC of four); others turn with their nodes, which no linear equation does"
    )


def _along(places: FloatArray, line: Line, kind: str) -> list[float]:
    """Lagrange's weights of nodes after the first, on the line from the second to the last, at the first."""
    axis = places[-1] - places[1]
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise line.error(f"the ends of MPC {kind} are in one place; give two nodes apart from each other")
    at = (places - places[1]) @ axis / length**2
    others, weights = at[1:], []
    for k, own in enumerate(others):
        rest = np.delete(others, k)
        if np.min(np.abs(own - rest)) == 0.0:
            raise line.error(f"two nodes of MPC {kind} are in one place; give nodes apart from each other")
        weights.append(float(np.prod((at[0] - rest) / (own - rest))))
    return weights


# Distance from a face, over the mean edge of the faces, up to which a node is tied where the deck does not say.
_NEAR = 0.05


@dataclass(slots=True)
class TieTable:
    """Nodes that have been tied so far.

    Attributes
    ----------
    points : (n, 3) float
        In the deck's units; changed where a tie moves nodes onto their face.
    tied : set of int
    reach : float
        How far faces of shells are from their nodes, in the deck's units.
    shells : list of ShellTie or EdgeTie
    notes : list of str
    """

    points: FloatArray
    reach: float
    tied: set[int] = field(default_factory=set)
    shells: list[OfShell] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def rows(self, card: Card, surfaces: Mapping[str, DeckSurface]) -> list[Row]:
        """Return the equations of a *TIE or *SHELL TO SOLID COUPLING; ties of shells go to `shells`.

        Parameters
        ----------
        card : Card
        surfaces : mapping of str to DeckSurface

        Returns
        -------
        list of dict of int to float

        Raises
        ------
        DeckError
            A surface is missing or has no faces, or no node lies near a face.
        """
        found: list[Row] = []
        tolerance = card.parameters.get("POSITIONTOLERANCE", "")
        given = number(tolerance, card.line, "POSITION TOLERANCE") if tolerance else None
        edge = card.keyword != "TIE"
        for line in card.data:
            names = fields(line)
            if len(names) != 2:
                raise line.error(f"*{card.keyword} takes 'dependent surface, main surface', found {len(names)} names")
            dependent, main = (card.scope.find(name, surfaces, "surface", card.line) for name in names)
            faces = (*main.faces, *main.shells)
            if not faces or (main.shells and (main.faces or edge)):
                words = "no element faces" if not faces else "faces of shells" if edge else "faces of solids and shells"
                fault = f"surface '{names[1]}' has {words} to tie to"
                raise line.error(f"{fault}; exchange them, or name faces of one kind")
            nodes = np.array([node for node in dependent.nodes.tolist() if node not in self.tied], dtype=np.int64)
            nodes = np.setdiff1d(nodes, np.concatenate([block.ravel() for block in faces]))
            near = given if given is not None else _NEAR * _edge(self.points, faces)
            near += 2.0 * self.reach if main.shells else 0.0
            nearest = nearest_faces(self.points, nodes, faces, near)
            if not nearest:
                raise line.error(
                    f"none of the {len(nodes)} nodes of '{names[0]}' lies within {near:.4g} of the faces of "
                    f"'{names[1]}': the parts stay apart; give a larger POSITION TOLERANCE, or correct the surfaces"
                )
            self.tied.update(nearest)
            told = f"{card.line.place}: {len(nearest)} nodes of '{names[0]}' "
            left = len(nodes) - len(nearest)
            more = f"; {left} lie too far from them and stay free" if left else ""
            if edge:
                self.shells += [EdgeTie(node, main.faces) for node in nearest]
                more = f"are held by '{names[1]}' through their thickness{more}"
            elif main.shells:
                self.shells += [ShellTie(node, face) for node, (face, _) in nearest.items()]
                more = f"are tied to shells of '{names[1]}' and turn with them{more}"
            else:
                place = {node: weighted(*one) for node, one in nearest.items()}
                found += [row for node, one in place.items() for row in moved_by(node, one)]
                more = f"are tied to faces of '{names[1]}'{more}{self._moved(card, place)}"
            self.notes.append(told + more)
        return found

    def _moved(self, card: Card, place: Mapping[int, Mapping[int, float]]) -> str:
        """Move nodes onto their faces where the deck does not forbid it; what was done."""
        target = {node: sum(w * self.points[other] for other, w in weights.items()) for node, weights in place.items()}
        gap = max(float(np.linalg.norm(self.points[node] - at).round(_DIGITS)) for node, at in target.items())
        if card.parameters.get("ADJUST", "YES").upper() == "NO":
            return f"; they lie up to {gap:.3g} beside them, ADJUST=NO: the joint resists turning" if gap else ""
        for node, at in target.items():
            self.points[node] = at
        return f"; they were moved onto them, by up to {gap:.3g}" if gap else ""


def _edge(points: FloatArray, faces: Sequence[IntArray]) -> float:
    """Mean distance of neighbouring corners."""
    lengths = []
    for block in faces:
        corners = points[block[:, : face_corners(block)]]
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel())
    return float(np.concatenate(lengths).mean())
