"""What runs a body inside the FMU."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

from .python_slave import WORDS


class Runtime(Enum):
    """What runs a body inside the FMU."""

    NATIVE = "native"
    """The core in C: nothing else is needed where the FMU runs."""
    PYTHON = "python"
    """pythonfmu's library and a Python of its own, over the same core."""


@contextmanager
def own_log() -> Iterator[None]:
    """Keep the Python export's words from Python's logging while a run reads the FMU's log itself."""
    before, WORDS.disabled = WORDS.disabled, True
    try:
        yield
    finally:
        WORDS.disabled = before
