"""Keyword cards of Abaqus and CalculiX decks: comments, continuation lines, includes and parameters."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

from flexfmu.files.basics import DeckError, FloatArray, MeshError, listed

Found = TypeVar("Found")
# Files that are included within each other; no deck of a user has as many.
_DEEPEST = 50
# Of data; other text before the first keyword is a title.
_BEGINS_ROW = re.compile(r"[-+.\d]|\w+\s*,")


class Line(NamedTuple):
    """A line of a deck and where it stands.

    Attributes
    ----------
    text : str
        Without surrounding blanks; never empty, never a comment.
    file : str
    number : int
        Counted from one.
    """

    text: str
    file: str
    number: int

    @property
    def place(self) -> str:
        """File and number, for notes."""
        return f"{self.file}, line {self.number}"

    def error(self, message: str) -> DeckError:
        """Return the error that names this line.

        Parameters
        ----------
        message : str

        Returns
        -------
        DeckError
        """
        return DeckError(message, self.file, self.number)


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """Whose numbers and names a card speaks of: a flat deck's, an instance's or an assembly's.

    Attributes
    ----------
    name : str
        Of the instance; empty elsewhere.
    offset : int
        What is added to numbers of nodes and elements.
    rotation : (3, 3) float or None
    shift : (3,) float or None
        Placement of the instance, x ↦ rotation x + shift, in the deck's units; None where it stays.
    """

    name: str = ""
    offset: int = 0
    rotation: FloatArray | None = None
    shift: FloatArray | None = None

    def qualified(self, name: str) -> str:
        """Return a name of this scope as the whole deck knows it, ``instance.name``.

        Parameters
        ----------
        name : str

        Returns
        -------
        str
        """
        return f"{self.name}.{name}" if self.name else name

    def find(self, name: str, known: Mapping[str, Found], what: str, line: Line) -> Found:
        """Return what a name stands for in this scope, else in the whole deck, whatever its case.

        Parameters
        ----------
        name : str
        known : mapping of str to anything
            By qualified name.
        what : str
            What has such names, for the message.
        line : Line
            Where the name stands.

        Returns
        -------
        anything

        Raises
        ------
        DeckError
            Nothing has this name.
        """
        capitals = {key.upper(): value for key, value in known.items()}
        for key in (self.qualified(name).upper(), name.upper()):
            if key in capitals:
                return capitals[key]
        raise line.error(f"{what} '{name}' is not defined (known: {listed(known)}); define it or correct the name")


FLAT = Scope()


@dataclass(slots=True)
class Card:
    """A keyword line with its data lines.

    Attributes
    ----------
    keyword : str
        In capitals, with single blanks: ``"SOLID SECTION"``.
    parameters : mapping of str to str
        Names in capitals; values as spelt, without quotes, empty for a parameter without a value.
    line : Line
        The keyword line.
    data : list of Line
    scope : Scope
    """

    keyword: str
    parameters: Mapping[str, str]
    line: Line
    data: list[Line] = field(default_factory=list)
    scope: Scope = FLAT

    @property
    def key(self) -> str:
        """The keyword without blanks and hyphens, as the solvers compare it."""
        return self.keyword.replace(" ", "").replace("-", "")

    @property
    def first(self) -> Line:
        """The first row, or the keyword line where there is none."""
        return self.data[0] if self.data else self.line

    @property
    def row(self) -> list[str]:
        """Fields of the first row; none without one."""
        return fields(self.data[0]) if self.data else []

    def required(self, name: str) -> str:
        """Return the value of a parameter that the card cannot do without.

        Parameters
        ----------
        name : str
            In capitals.

        Returns
        -------
        str

        Raises
        ------
        DeckError
            The parameter is missing or has no value.
        """
        value = self.parameters.get(name, "")
        if not value:
            raise self.line.error(f"*{self.keyword} needs the parameter {name}; add {name}=...")
        return value

    def allow(self, names: tuple[str, ...]) -> None:
        """Check that the card has no parameters but these.

        Parameters
        ----------
        names : tuple of str

        Raises
        ------
        DeckError
            There is another one, which might change the card's meaning.
        """
        for name in self.parameters:
            if name not in names:
                supported = ", ".join(names) or "none"
                found = f"parameter {name} of *{self.keyword} is not supported (supported: {supported})"
                raise self.line.error(f"{found}; say the same without it, if it matters to the body at all")


def read_cards(path: Path) -> Iterator[Card]:
    """Yield a deck's cards in order, those of included files in place of their *INCLUDE.

    Parameters
    ----------
    path : Path

    Yields
    ------
    Card

    Raises
    ------
    MeshError
        The deck cannot be read.
    DeckError
        An included file cannot be read or includes itself, or data stand before the first keyword.
    """
    card: Card | None = None
    for line in _included_lines(path, ()):
        if line.text.startswith("*"):
            if card is not None:
                yield card
            card = _card(line)
        elif card is not None:
            card.data.append(line)
        elif _BEGINS_ROW.match(line.text):
            raise line.error("data before the first keyword; a deck begins with a line such as *NODE")
    if card is not None:
        yield card


def fields(line: Line) -> list[str]:
    """Return a data line's fields.

    Parameters
    ----------
    line : Line

    Returns
    -------
    list of str
        Without surrounding blanks; the empty one after a comma at the line's end is left out.
    """
    parts = [part.strip() for part in line.text.split(",")]
    if not parts[-1]:
        parts.pop()
    return parts


def integer(text: str, line: Line, what: str) -> int:
    """Return a field as a whole number.

    Parameters
    ----------
    text : str
    line : Line
        Where the field stands.
    what : str
        The field's meaning, for the message.

    Returns
    -------
    int

    Raises
    ------
    DeckError
        It is no whole number.
    """
    try:
        return int(text)
    except ValueError:
        raise line.error(f"{what} should be a whole number, found '{text}'") from None


def number(text: str, line: Line, what: str, blank: float = math.nan) -> float:
    """Return a field as a finite number; Fortran's exponent D is understood.

    Parameters
    ----------
    text : str
    line : Line
        Where the field stands.
    what : str
        The field's meaning, for the message.
    blank : float
        What an empty field stands for; without it a field has to be there.

    Returns
    -------
    float

    Raises
    ------
    DeckError
        It is no finite number.
    """
    try:
        value = float(re.sub("[dD]", "e", text)) if text else blank
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise line.error(f"{what} should be a finite number, found '{text}'")
    return value


def _card(line: Line) -> Card:
    parts = line.text[1:].split(",")
    parameters: dict[str, str] = {}
    for part in parts[1:]:
        name, _, value = part.partition("=")
        if name := "".join(name.split()).upper():
            parameters[name] = value.strip().strip("\"'").strip()
    return Card(" ".join(parts[0].split()).upper(), parameters, line)


def _included_lines(path: Path, including: tuple[Path, ...]) -> Iterator[Line]:
    chain = (*including, path.resolve())
    for line in _logical_lines(path):
        # Cheap test first: nearly all lines are data.
        if not (line.text.startswith("*") and line.text[1:].lstrip()[:7].upper() == "INCLUDE"):
            yield line
            continue
        card = _card(line)
        card.allow(("INPUT",))
        included = path.parent / card.required("INPUT")
        if included.resolve() in chain:
            raise line.error(f"{included} is already being read: a file cannot include itself; remove this *INCLUDE")
        if len(chain) > _DEEPEST:
            raise line.error(f"includes stand {len(chain)} deep within each other, expected at most {_DEEPEST}")
        if not included.is_file():
            found = f"the included file {included} does not exist"
            raise line.error(f"{found}; INPUT is taken relative to the including file")
        yield from _included_lines(included, chain)


def _logical_lines(path: Path) -> Iterator[Line]:
    """Yield lines without comments and blanks; a keyword line that ends with a comma goes on in the next."""
    file = str(path)
    begun: Line | None = None
    for index, raw in enumerate(_text(path).split("\n")):
        text = raw.strip()
        if text in ("", "*") or text.startswith("**"):
            continue
        if begun is None:
            line = Line(text, file, index + 1)
        elif text.startswith("*") or text[0].isdigit():
            # The comma was the last character of a finished keyword line.
            yield begun
            line = Line(text, file, index + 1)
        else:
            line = Line(begun.text + text, file, begun.number)
        begun = line if line.text.startswith("*") and line.text.endswith(",") else None
        if begun is None:
            yield line
    if begun is not None:
        yield begun


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as failure:
        raise MeshError(f"{path} cannot be read: {failure.strerror}; give the path of an existing deck") from failure
    if b"\x00" in content:
        raise MeshError(f"{path} is not a deck: it holds binary data; give a text file with keywords such as *NODE")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Names and comments with umlauts, from older pre-processors.
        text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")
