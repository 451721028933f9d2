"""Node sets and element sets of a deck."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from flexfmu.mesh.deck_cards import Card, Line, fields, integer
from flexfmu.mesh.listing import listed
from flexfmu.mesh.model import IntArray


@dataclass(slots=True)
class SetTable:
    """The sets of one kind; names are found whatever their case, and kept as first spelt.

    Attributes
    ----------
    kind : str
        ``"node"`` or ``"element"``.
    rows : mapping of int to int
        Row (of an element: position) of each label.
    spelling : dict of str to str
        Name as spelt, by the name in capitals.
    members : dict of str to set of int
        Rows, by the name in capitals.
    notes : list of str
    """

    kind: str
    rows: Mapping[int, int]
    spelling: dict[str, str] = field(default_factory=dict)
    members: dict[str, set[int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def extend(self, name: str, rows: Iterable[int]) -> None:
        """Add rows to a set, which is made if there is none.

        Parameters
        ----------
        name : str
        rows : iterable of int
        """
        self.spelling.setdefault(name.upper(), name)
        self.members.setdefault(name.upper(), set()).update(rows)

    def extend_by_labels(self, name: str, labels: Iterable[int]) -> None:
        """Add labels that are known to exist.

        Parameters
        ----------
        name : str
        labels : iterable of int
        """
        self.extend(name, (self.rows[label] for label in labels))

    def add(self, card: Card, name: str) -> None:
        """Take the data lines of a *NSET or *ELSET card.

        Parameters
        ----------
        card : Card
        name : str
            The set's name.

        Raises
        ------
        DeckError
            A member is unknown, or a range is malformed.
        """
        read = self._generated if "GENERATE" in card.parameters else self._line
        rows: set[int] = set()
        for line in card.data:
            rows |= read(line)
        self.extend(name, rows)

    def find(self, entry: str, line: Line) -> set[int]:
        """Return the rows of a label or of a set.

        Parameters
        ----------
        entry : str
        line : Line
            Where the entry stands.

        Returns
        -------
        set of int

        Raises
        ------
        DeckError
            There is no such label or set.
        """
        if entry.lstrip("+-").isdecimal():
            label = int(entry)
            if label not in self.rows:
                raise line.error(f"{self.kind} {label} is not defined; define it or take it out of this line")
            return {self.rows[label]}
        name = entry.strip("\"'").strip().upper()
        if name not in self.members:
            raise line.error(
                f"{self.kind} set '{entry}' is not defined before this line "
                f"(known: {listed(self.spelling.values())}); define it or correct the name"
            )
        return self.members[name]

    def arrays(self) -> dict[str, IntArray]:
        """Rows of each set, ascending, by the name as spelt."""
        return {self.spelling[name]: np.array(sorted(rows), dtype=np.int64) for name, rows in self.members.items()}

    def _line(self, line: Line) -> set[int]:
        return set().union(*(self.find(entry, line) for entry in fields(line) if entry))

    def _generated(self, line: Line) -> set[int]:
        numbers = [integer(text, line, f"a range of {self.kind}s") for text in fields(line)]
        if not 2 <= len(numbers) <= 3:
            raise line.error(f"GENERATE takes 'first, last, increment', found {len(numbers)} numbers")
        first, last, step = [*numbers, 1][:3]
        if step <= 0 or last < first:
            raise line.error(
                f"cannot go from {first} to {last} in steps of {step}; give an ascending range and a positive increment"
            )
        labels = range(first, last + 1, step)
        found = {self.rows[label] for label in labels if label in self.rows}
        if not found:
            raise line.error(f"there is no {self.kind} from {first} to {last}; correct the range")
        if len(found) < len(labels):
            # Both solvers pass over gaps in the numbering.
            self.notes.append(
                f"{line.file}, line {line.number}: {len(labels) - len(found)} numbers "
                f"from {first} to {last} belong to no {self.kind}"
            )
        return found
