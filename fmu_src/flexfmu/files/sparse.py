"""scipy.sparse, imported when something of it is first used: a tenth of a second that reading a mesh need not take."""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    return getattr(import_module("scipy.sparse"), name)
