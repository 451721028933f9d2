"""Libraries that read one format and are installed where a user needs them."""

import contextlib
import io
import traceback
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from flexfmu.files.basics import FlexfmuError, MeshError


def imported(module: str, path: Path, library: str, extra: str) -> Any:
    """Import a library that a file needs.

    Parameters
    ----------
    module : str
    path : Path
        The file, for the message.
    library : str
        As package indices call it.
    extra : str
        Of this package, that installs it.

    Returns
    -------
    module

    Raises
    ------
    MeshError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MeshError(
            f'{path} needs {library} to be read ({error}): pip install "flexfmu[{extra}]", or pip install {library}'
        ) from error


@contextlib.contextmanager
def quiet(path: Path, advice: str) -> Iterator[None]:
    """Turn whatever a library says and raises into one error that names the file.

    Parameters
    ----------
    path : Path
    advice : str
        What to do.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            yield
    except (FlexfmuError, KeyboardInterrupt, GeneratorExit):
        raise
    # Some end the interpreter where they cannot read, and all let any exception of their parsers through.
    except (Exception, SystemExit) as failure:
        reason = str(failure) if isinstance(failure, Exception) else ""
        frames = [frame.f_locals for frame, _ in traceback.walk_tb(failure.__traceback__)]
        reason += "".join(f" {cards}" for cards in [one["card_lines"] for one in frames if "card_lines" in one][-1:])
        told = " ".join(f"{said.getvalue()} {reason}".split())[-_LONGEST:] or type(failure).__name__
        raise MeshError(f"{path} cannot be read as a mesh: {told}; {advice}") from failure


# Characters of a library's own words that are passed on: the last ones name the reason.
_LONGEST = 600
