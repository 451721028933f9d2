"""Long lists of names and numbers, shortened for messages."""

from collections.abc import Iterable

# Enough to find the place in a mesh; a thousand labels would bury the message.
SHOWN = 10


def listed(items: Iterable[object]) -> str:
    """Return the first ten items in words, with the number of those left out.

    Parameters
    ----------
    items : iterable of object
        Names or labels.

    Returns
    -------
    str
        Such as ``"3, 5, 8 and 12 more"``; ``"none"`` without items.
    """
    names = [str(item) for item in items]
    if not names:
        return "none"
    shown = ", ".join(names[:SHOWN])
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"
