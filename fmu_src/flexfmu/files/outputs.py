"""What goes out: files checked and written whole, tables and JSON of plain data, pages and pictures."""

import base64
import io
import json
import math
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

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


def json_text(value: object) -> str:
    """JSON of dataclasses, mappings, arrays and what they hold; numbers that are not finite become null."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False, indent=2)


def page_text(package: str | None, title: str, content: object, *scripts: str) -> str:
    """The page `page.html` of a package with a title, data, which its script reads, and more scripts of the package."""
    # Nothing in the data may end the script.
    text = json.dumps(_plain(content), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    template, *more = (
        files(package or "").joinpath(name).read_text(encoding="utf-8") for name in ("page.html", *scripts)
    )
    return template.replace("@LIVE@", "".join(more)).replace("@TITLE@", escape(title)).replace("@DATA@", text)


def fields_of(value: object) -> dict[str, object]:
    """Fields of a dataclass by name, to which others may be added."""
    return {field.name: getattr(value, field.name) for field in fields(value)}  # type: ignore[arg-type]


def records_frame(records: Iterable[object]) -> Any:
    """A pandas.DataFrame of dataclasses, one row each."""
    return table_frame(map(fields_of, records))


def table_frame(rows: Iterable[Mapping[str, object]]) -> Any:
    """A pandas.DataFrame of rows by the names of their columns."""
    import pandas

    return pandas.DataFrame([*rows])


def rows_html(rows: Iterable[tuple[str, str]]) -> str:
    """Pairs of a label and a value as an HTML table."""
    return f"<table>{''.join(f'<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>' for a, b in rows)}</table>"


def picture_html(figure: Any, kind: str = "svg") -> str:
    """A matplotlib figure for a notebook, as "svg" or "png" within HTML."""
    data = io.BytesIO()
    figure.savefig(data, format=kind)
    if kind == "png":
        return f'<img src="data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}">'
    return "".join(data.getvalue().decode().partition("<svg")[1:])


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(fields_of(value))
    if isinstance(value, Mapping):
        return {str(_plain(key)): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
