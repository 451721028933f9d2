"""Files that a job is to write: checked before the work, written whole or not at all."""

import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from .basics import OutputError

PICTURE_SUFFIXES = (".png", ".pdf", ".svg")


def check_target(path: Path, suffixes: Collection[str], inputs: Collection[Path] = ()) -> None:
    """Refuse a file that cannot or should not be written, before any work is done for it.

    Parameters
    ----------
    path : Path
    suffixes : collection of str
        Endings that will do, with the dot.
    inputs : collection of Path
        Files that the job reads and must not overwrite.

    Raises
    ------
    OutputError
        With what is wrong and what to do.
    """
    if path.suffix.lower() not in suffixes:
        raise OutputError(f"{path}: expected a file name that ends in {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give a file name")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OutputError(f"{path}: the folder {path.parent} cannot be written to ({error.strerror})") from error
    for source in inputs:
        if path.exists() and source.exists() and path.samefile(source):
            raise OutputError(f"{path} is what the job reads; give the result another name")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Name of a file to write to that takes the place of `path` when all went well, and disappears otherwise.

    The file stands in a new folder that nobody else may write to, so that no link that others have laid is followed.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(
            prefix=f".{path.name}.", dir=path.parent, ignore_cleanup_errors=True
        ) as folder:
            part = Path(folder) / path.name
            yield part
            part.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error})") from error
