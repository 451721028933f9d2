"""Keywords of decks, listed in keywords.toml: which are honoured, which are left unused, and which cannot be."""

import tomllib
from pathlib import Path

WORDS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
HONOURED: dict[str, tuple[str, ...]] = {keyword: tuple(names.split()) for keyword, names in WORDS["honoured"].items()}
PARAMETERS = {keyword.replace(" ", ""): names for keyword, names in HONOURED.items()}
HARMLESS, UNUSED, SECTIONS = (frozenset(WORDS[kind].split()) for kind in ("harmless", "unused", "sections"))


def unused(keyword: str, key: str) -> str:
    """Return the note on a card that is left unused.

    Parameters
    ----------
    keyword, key : str
        As spelt, and without blanks.

    Returns
    -------
    str
    """
    why = WORDS["why"].get(key)
    return f"*{keyword} is left unused{f': {why}' if why else ''}"
