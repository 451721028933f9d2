"""No deck of an assembly that is cut short, or whose lines are changed, ends in a traceback or in a hang."""

from random import Random

import pytest

from decks import BODY, CAE, COUPLING, PART
from flexfmu.files.basics import FlexfmuError, UnitSystem
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from foreign.deck_bars import PLY
from foreign.glued_bars import deck

LAMINATE = PLY.format(kind="ENGINEERING CONSTANTS", constants="1.4e11, 1.e10, 8.e9, 0.3, 0.25, 0.4, 5.e9, 4.e9\n3.e9")
DECKS = {
    "assembly": CAE + "*Boundary\nBar-1.Root, 1, 3\n*Step\n*Static\n*End Step\n",
    "coupling": PART.split("\n", 1)[1].replace("*End Part\n", "").replace("name=Top", "name=Top2")
    + COUPLING
    + LAMINATE.replace("BAR", "Solid").replace("MATERIAL=M", "MATERIAL=Steel").replace("NAME=M", "NAME=Steel")
    + "*Boundary\nRP, 1, 6\nRoot, ENCASTRE\n",
    "tie": deck("tied_linear")[0] + "*MPC\nTIE, 1, 2\nLINEAR, 3, 4, 5\n",
    "equation": BODY + "*NSET, NSET=A\n5, 6\n*EQUATION\n3\nA, 1, 1., 1, 1, -0.5, 2, 1, -0.5\n2\n3, 2, 1., 4, 2, -1.\n",
}
# Of each deck; of those that are longer than this, in characters, a quarter.
SPOILED, LONG = 400, 5000
WORDS = (
    "*",
    "**",
    ",",
    "-1",
    "0",
    "1e400",
    "99999999999999999999",
    "nan",
    "*End Instance",
    "*NSET, NSET=A, ELSET=B",
    "",
)


def spoiled(text, number, numbers):
    """The deck cut short, without a line, with two swapped, or with a field changed."""
    lines = text.split("\n")
    place = numbers.randrange(len(lines))
    match number % 4:
        case 0:
            return text[: numbers.randrange(len(text))]
        case 1:
            del lines[place]
        case 2:
            other = numbers.randrange(len(lines))
            lines[place], lines[other] = lines[other], lines[place]
        case 3:
            fields = lines[place].split(",")
            fields[numbers.randrange(len(fields))] = numbers.choice(WORDS)
            lines[place] = ",".join(fields)
    return "\n".join(lines)


def outcome(path):
    """Elements that are read, or the refusal."""
    try:
        return checked(read_deck(path, UnitSystem.SI)).element_count
    except FlexfmuError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize("name", DECKS)
def test_a_spoiled_deck_is_read_or_refused_with_what_is_wrong(name, tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(DECKS[name])
    whole = outcome(path)
    numbers = Random(name)
    refused = 0
    for number in range(SPOILED // (4 if len(DECKS[name]) > LONG else 1)):
        path.write_text(spoiled(DECKS[name], number, numbers))
        found = outcome(path)
        if isinstance(found, str):
            refused += 1
            assert len(found) > 20
        else:
            assert found <= whole
    assert refused > number // 5
