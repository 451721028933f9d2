"""Help with names that are not known."""

import difflib
from collections.abc import Iterable

# So many names are worth reading.
_SHOWN = 12


def nearest(name: str, known: Iterable[str]) -> str:
    """Words that help where a name is unknown: those like it, or those that there are.

    Parameters
    ----------
    name : str
    known : iterable of str

    Returns
    -------
    str
    """
    names = list(known)
    near = alike(name, names)
    if near:
        return f"did you mean {' or '.join(map(repr, near))}?"
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"there are: {', '.join(names[:_SHOWN])}{more}"


def alike(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Known names that differ from `name` by case or a few letters, the most alike first."""
    lower = {one.lower(): one for one in known}
    return [lower[match] for match in difflib.get_close_matches(name.lower(), lower, n=count)]
