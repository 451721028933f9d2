"""What nearly all modules take: types of arrays, limits, errors, and how messages list, count and guess names."""

import difflib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MOST_MODES = 1000
"""Normal modes of a body."""
MOST_FRAMES = 1000
"""Frames, or levels of them."""
MOST_STEPS = 1_000_000
"""Communication steps that every model of a scene takes."""
MOST_COUPLED_STEPS = 100_000_000
"""Communication steps of a coupling: of the smallest FMUs they take hours."""
MOST_VALUES = 5e7
"""Results that a run of FMUs keeps, rows times columns: some 2 GB while it runs."""

__version__ = version("flexfmu")

INTERRUPTED = 130
"""Exit code of a job that Ctrl-C ended, as shells have it."""

NOT_MET = 3
"""Exit code of a search that ended well and found no model within the tolerance; 1 is an error, 2 wrong usage."""


class FlexfmuError(Exception):
    """Base of every error that a user's input can cause.

    Attributes
    ----------
    exit_code : int
        Of the command that it ends.
    """

    exit_code = 1


class BodyFileError(FlexfmuError):
    """The body file (TOML) names, lacks or contradicts something."""


class MeshError(FlexfmuError):
    """The mesh file cannot be read, or the mesh cannot be a body."""


class DeckError(MeshError):
    """A deck's line cannot be honoured.

    Parameters
    ----------
    message : str
        What was found, what was expected and what to do.
    file : str
        The deck, or the file that it includes.
    line : int
        Line number, counted from one.
    """

    def __init__(self, message: str, file: str, line: int):
        super().__init__(f"{file}, line {line}: {message}")
        self.file = file
        self.line = line


class ModelError(FlexfmuError):
    """The finite element model is not a body that can be reduced: free to move, or without stiffness or mass."""


class AccuracyError(FlexfmuError):
    """A computed result does not pass its own check (orthogonality, residual)."""


class PackagingError(FlexfmuError):
    """The FMU archive could not be made or read."""


class OutputError(PackagingError):
    """A file cannot, or should not, be written."""


class SimulationError(FlexfmuError):
    """A simulation cannot be set up, or the FMU refused a step."""


class StoppedError(SimulationError):
    """A run that ended before its time.

    Parameters
    ----------
    message : str
    result : anything
        What came out until then.
    interrupted : bool
        Whether the user ended it.
    """

    def __init__(self, message: str, result: Any, interrupted: bool = False):
        super().__init__(message)
        self.result = result
        if interrupted:
            self.exit_code = INTERRUPTED


@contextmanager
def keeping_partial(output: Path, write: Callable[[Path, Any], None]) -> Iterator[None]:
    """Write what came out of a run that stops beside its output, and say where.

    Parameters
    ----------
    output : Path
    write : callable
        Of a path and a result.

    Raises
    ------
    StoppedError
        The run stopped.
    """
    try:
        yield
    except StoppedError as stopped:
        partial = output.with_suffix(f".partial{output.suffix}")
        write(partial, stopped.result)
        stopped.args = (f"{stopped}\nWhat came out until then is in {partial}",)
        raise


def plural(count: int, word: str) -> str:
    """A number of things; none is "no"."""
    return f"{count or 'no'} {word}{'' if count == 1 else 's'}"


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


class RuntimeBodyError(Exception):
    """Base of the errors that the travelling code raises."""


class ModalFileError(RuntimeBodyError):
    """The modal file is not one, is damaged, or has a schema that this version does not read."""


class ContentsError(RuntimeBodyError):
    """Files of an FMU do not belong together."""


class OptionError(RuntimeBodyError):
    """An option or parameter has a value that is not offered."""


class LoadError(RuntimeBodyError):
    """A load is not finite, or acts on an interface that the body does not have."""


class EquilibriumError(RuntimeBodyError):
    """No stable equilibrium was found under the load.

    Parameters
    ----------
    message : str
        What happened and what to do.
    load_factor : float
        Largest fraction of the load for which a stable equilibrium was found.
    """

    def __init__(self, message: str, load_factor: float):
        super().__init__(message)
        self.load_factor = load_factor


class StepError(RuntimeBodyError):
    """A time step has no solution that the iteration can find; the state before it is untouched."""
