"""What runs a body inside the FMU."""

from enum import Enum


class Runtime(Enum):
    """What runs a body inside the FMU."""

    NATIVE = "native"
    """The core in C: nothing else is needed where the FMU runs."""
    PYTHON = "python"
    """pythonfmu's library and a Python of its own, over the same core."""
