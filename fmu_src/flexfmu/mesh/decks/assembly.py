"""Parts, instances and assemblies of a deck, laid out as one flat deck whose cards know where they came from."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flexfmu.files.basics import FloatArray
from flexfmu.mesh.decks.cards import Card, Scope, fields, number
from flexfmu.model.rotations import turned_by

# Keywords of the structure itself.
STRUCTURE = frozenset({"PART", "ENDPART", "ASSEMBLY", "ENDASSEMBLY", "INSTANCE", "ENDINSTANCE"})
# An axis shorter than this part of the coordinates that define it has no direction.
_NO_AXIS = 1e-12
# Numbers with more digits are refused where they are read.
_DIGITS = 13


# An *INSTANCE card, and what stands between it and *END INSTANCE.
_Instance = tuple[Card, list[Card]]


@dataclass(slots=True)
class Assembly:
    """Lays out a deck's instances one after the other.

    Attributes
    ----------
    offsets : dict of str to int
        What is added to the numbers of each instance, by its name in capitals.
    notes : list of str
    """

    offsets: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _parts: dict[str, tuple[Card, list[Card]]] = field(default_factory=dict)

    def flat(self, cards: Iterable[Card]) -> Iterator[Card]:
        """Yield a deck's cards: those of a part once for each of its instances, with that instance's scope.

        Parameters
        ----------
        cards : iterable of Card

        Yields
        ------
        Card

        Raises
        ------
        DeckError
            A part, instance or assembly without end or name, an unknown part, or a malformed placement.
        """
        cards = list(cards)
        keys = Counter(card.key for card in cards)
        # Materials follow the assembly: where they are, the deck is whole.
        if keys["PART"] == keys["ENDPART"] == 1 and keys["MATERIAL"] and not keys["ASSEMBLY"]:
            self.notes.append("there is no *ASSEMBLY: the only part stands as it is")
            cards = [card for card in cards if card.key not in ("PART", "ENDPART")]
        source = iter(cards)
        used: set[str] = set()
        for card in source:
            if card.key == "PART":
                self._take_part(card, _until("ENDPART", card, source))
            elif card.key == "ASSEMBLY":
                instances, own = _split(_until("ENDASSEMBLY", card, source))
                used.update(one.parameters.get("PART", "").upper() for one, _ in instances)
                yield from self._assembled(instances, own)
            elif card.key in STRUCTURE:
                raise card.line.error(f"*{card.keyword} stands outside the part or assembly that it belongs to")
            else:
                yield card
        for name, (card, _) in self._parts.items():
            if name in used:
                continue
            if not used:
                raise card.line.error("no *ASSEMBLY has an *INSTANCE of a part: cut short? Write the deck again")
            self.notes.append(f"{card.line.place}: part '{card.required('NAME')}' has no *INSTANCE and is left unused")

    def _take_part(self, card: Card, content: list[Card]) -> None:
        name = card.required("NAME")
        if name.upper() in self._parts:
            raise card.line.error(f"part '{name}' is defined again; rename one of them")
        self._parts[name.upper()] = (card, content)

    def _assembled(self, instances: Sequence[_Instance], own: Sequence[Card]) -> Iterator[Card]:
        contents = [[*self._content(one), *more] for one, more in instances]
        # A number of a later instance reads as its own with the instance's place before it: 12 becomes 1012.
        step = 10 ** len(str(max((_highest(content) for content in [*contents, own]), default=0)))
        for place, ((one, _), content) in enumerate(zip(instances, contents, strict=True)):
            name = one.required("NAME")
            if name.upper() in self.offsets:
                raise one.line.error(f"instance '{name}' is defined again; rename one of them")
            self.offsets[name.upper()] = offset = place * step
            scope = Scope(name, offset, *_placement(one))
            if offset:
                self.notes.append(f"nodes and elements of instance '{name}' are numbered from {offset + 1}")
            for card in content:
                yield replace(card, scope=scope)
        outside = Scope("", len(instances) * step)
        for card in own:
            yield replace(card, scope=outside)

    def _content(self, card: Card) -> list[Card]:
        name = card.parameters.get("PART", "")
        if not name:
            raise card.line.error("an *INSTANCE needs the parameter PART; those of other analyses are not supported")
        if name.upper() not in self._parts:
            known = ", ".join(part.required("NAME") for part, _ in self._parts.values()) or "none"
            raise card.line.error(f"part '{name}' is not defined (known: {known}); define it or correct the name")
        return self._parts[name.upper()][1]


def _until(end: str, begin: Card, cards: Iterator[Card]) -> list[Card]:
    """Cards up to the one that ends what `begin` begins, that one left out."""
    found: list[Card] = []
    for card in cards:
        if card.key == end:
            return found
        if card.key in ("PART", "ASSEMBLY", "STEP") or (card.key in STRUCTURE and begin.key != "ASSEMBLY"):
            break
        found.append(card)
    raise begin.line.error(f"this *{begin.keyword} has no *END {begin.keyword}; the deck may have been cut short")


def _split(cards: Sequence[Card]) -> tuple[list[_Instance], list[Card]]:
    """Instances of an assembly, and its own cards."""
    instances, own, source = list[_Instance](), list[Card](), iter(cards)
    for card in source:
        if card.key == "INSTANCE":
            instances.append((card, _until("ENDINSTANCE", card, source)))
        elif card.key != "ENDINSTANCE":
            own.append(card)
    return instances, own


def _highest(cards: Sequence[Card]) -> int:
    """Highest number of a node or element of some cards; malformed rows are refused where they are read."""
    lines = (line for card in cards if card.key in ("NODE", "ELEMENT") for line in card.data)
    first = (line.text.split(",", 1)[0].strip() for line in lines)
    return max((int(one) for one in first if one.isdecimal() and len(one) <= _DIGITS), default=0)


def _placement(card: Card) -> tuple[FloatArray, FloatArray] | tuple[None, None]:
    """Rotation (3, 3) and shift (3,) of an instance: moved first, then turned about an axis of the assembly."""
    each = "each number of an instance's placement"
    rows = [[number(text, line, each, 0.0) for text in fields(line)] for line in card.data if any(fields(line))]
    if not rows:
        return None, None
    if len(rows) > 2 or len(rows[0]) > 3 or (len(rows) == 2 and len(rows[1]) != 7):
        raise card.line.error(
            "an *INSTANCE takes up to two rows: its shift 'x, y, z', and its turn 'x1, y1, z1, x2, y2, z2, degrees'"
        )
    shift = np.array([*rows[0], 0.0, 0.0, 0.0][:3])
    if len(rows) == 1:
        return np.eye(3), shift
    start, end, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), np.radians(rows[1][6])
    axis = end - start
    length = np.linalg.norm(axis)
    if length <= _NO_AXIS * max(np.abs(rows[1][:6])):
        raise card.line.error("the axis about which this *INSTANCE is turned has two equal points; give two different")
    turn = turned_by(angle * axis / length)
    return turn, turn @ (shift - start) + start
