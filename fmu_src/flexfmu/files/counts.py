"""Numbers of things, in words."""


def plural(count: int, word: str) -> str:
    """A number of things; none is "no"."""
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"
