"""Tables of an FMU's variables, parameters and messages, from core/interface.def."""

import re
from collections.abc import Iterable

from flexfmu.core.interface import Row, lines, rows, words_of

_COMPLIANCE = "m/N, m/(N.m), rad/N, rad/(N.m)"


def table(heads: Iterable[str], lines: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    heads = list(heads)
    every = [heads, ["---"] * len(heads), *lines]
    return "".join("| " + " | ".join(line) + " |\n" for line in every)


def variables_in_and_out() -> str:
    """Inputs and outputs of an FMU."""
    return _variables(row for row in rows() if row.role in ("INPUT", "MOTION", "RATE", "STRESS"))


def local_variables() -> str:
    """Local variables of an FMU."""
    return _variables(row for row in rows() if row.role in ("STATUS", "DIAGNOSTIC", "COMPLIANCE", "ERROR"))


def parameters() -> str:
    """Parameters of an FMU."""
    found = [row for row in rows() if row.role == "PARAMETER"]
    return table(("parameter", "start", "meaning"), ([_named(row), _start(row), _meaning(row)] for row in found))


def parameter_words() -> str:
    """Words that parameters of an FMU offer."""
    result = []
    for macro in dict.fromkeys(row.words for row in rows() if row.words not in ("", "METHOD")):
        names = ", ".join(f"`{row.name}`" for row in rows() if row.words == macro)
        result += [[names if word == words_of(macro)[0] else "", f'`"{word}"`', text] for _, word, text in lines(macro)]
    return table(("parameter", "word", "meaning"), result)


def status_codes() -> str:
    """Values of status.code."""
    return table(("status.code", "meaning"), ([str(k), text] for k, (_, text) in enumerate(lines("STATE"))))


def log_messages() -> str:
    """Lines of an FMU's log."""
    kinds = {"WARNING": "warning", "REFUSAL": "refusal"}
    found = (
        [kinds[kind], re.sub(r"(?:%[.\d]*(?:ll)?[gdsf])+", "…", text).replace("%%", "%")]
        for _, kind, text in lines("MESSAGE")
    )
    return table(("kind", "what the log says"), found)


def _variables(found: Iterable[Row]) -> str:
    return table(
        ("variable", "unit", "meaning"),
        ([_named(row), row.unit.replace("UNIT", _COMPLIANCE), _meaning(row)] for row in found),
    )


def _named(row: Row) -> str:
    words = [row.type] * (row.type != "Real") + ["tunable"] * row.tunable
    name = f"`{row.name}`".replace(".AXIS`", ".x` `.y` `.z`")
    return f"{name} ({', '.join(words)})" if words else name


def _start(row: Row) -> str:
    if row.words == "METHOD":
        return "body file's"
    unit = f" {row.unit}" if row.unit else ""
    return f'`"{words_of(row.words)[0]}"`' if row.words else f"{row.start:g}{unit}" if row.type == "Real" else "false"


def _meaning(row: Row) -> str:
    when = dict(lines("WHEN"))[row.when]
    text = row.text.replace("COUNT", "all").replace("ROW", "`ux` … `rz`").replace("COLUMN", "`fx` … `mz`")
    # Notes link to pages of docs/, the tables stand one folder below.
    words = "; ".join(part for part in (text, row.note.replace("](", "](../")) if part)
    return f"{when}: {words}" if when else words
