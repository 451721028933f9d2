"""What goes out: what a long job tells, files checked and written whole, plain data as tables and JSON, pages."""

import base64
import io
import json
import logging
import math
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from html import escape
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from .basics import OutputError

_HOURS, _MINUTES = 3600.0, 60.0

Tell = Callable[[float], None]
"""Says how much of a counted stage is done."""

_PRESSED = threading.Event()


class Reporter:
    """Says nothing; the base of those that do."""

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:  # noqa: ARG002
        """Enclose a stage of the job.

        Parameters
        ----------
        title : str
        """
        yield

    @contextmanager
    def counted(self, title: str, total: float, unit: str = "") -> Iterator[Tell]:  # noqa: ARG002
        """Enclose a stage that can tell how far it is; call what it yields as often as you like.

        Parameters
        ----------
        title : str
        total : float
            All there is to do: a number of things, or the last time of a simulation.
        unit : str
            Of `total`, such as "models" or "s".

        Yields
        ------
        callable
            Takes how much of `total` is done.
        """
        yield tell_nobody

    def note(self, text: str) -> None:
        """Say what was found or chosen."""

    def detail(self, text: str) -> None:
        """Say what few ask for; a terminal shows it with `--verbose` only."""
        self.note(text)

    def warning(self, text: str) -> None:
        """Say what the user should look at."""

    def doubt(self, text: str) -> None:
        """Say what is hardly meant; `flexfmu build` ends there unless it is told to go on."""
        self.warning(text)

    def tell(self, notes: Iterable[str] = (), warnings: Iterable[str] = ()) -> None:
        """Say notes, then warnings."""
        for text in notes:
            self.note(text)
        for text in warnings:
            self.warning(text)


class Stages(Reporter):
    """Shows stages, and keeps notes and warnings to itself.

    Parameters
    ----------
    report : Reporter
        Who shows them.
    """

    def __init__(self, report: Reporter):
        self.stage, self.counted = report.stage, report.counted  # type: ignore[method-assign]


class Heard(Stages):
    """Hands on all that is said, and keeps it: pairs of a method's name and a text.

    Parameters
    ----------
    report : Reporter
        Who is told.
    """

    def __init__(self, report: Reporter):
        super().__init__(report)
        self.said: list[tuple[str, str]] = []
        for kind in ("note", "detail", "warning", "doubt"):
            setattr(self, kind, partial(self._hear, kind, getattr(report, kind)))

    def _hear(self, kind: str, say: Callable[[str], None], text: str) -> None:
        self.said.append((kind, text))
        say(text)


class Tentative(Stages):
    """Shows stages, details and doubts, each doubt once; keeps notes and warnings until they are sure to hold.

    Parameters
    ----------
    report : Reporter
        Who says them.
    """

    def __init__(self, report: Reporter):
        super().__init__(report)
        self.detail = report.detail  # type: ignore[method-assign]
        self._report, self._doubts = report, set[str]()
        self._kept: list[tuple[Callable[[str], None], str]] = []

    def note(self, text: str) -> None:
        """Keep what was found or chosen."""
        self._kept.append((self._report.note, text))

    def warning(self, text: str) -> None:
        """Keep what the user should look at."""
        self._kept.append((self._report.warning, text))

    def doubt(self, text: str) -> None:
        """Say what is hardly meant, unless it was said before."""
        if text not in self._doubts:
            self._doubts.add(text)
            self._report.doubt(text)

    def release(self, holds: bool = True) -> None:
        """Say what is kept, if it holds, and from now on all at once."""
        for say, text in self._kept * holds:
            say(text)
        self._kept.clear()
        self.note, self.warning = self._report.note, self._report.warning  # type: ignore[method-assign]


class ScriptReporter(Reporter):
    """Warnings as Python's, notes to the log "flexfmu"."""

    def note(self, text: str) -> None:
        """Log what was found or chosen."""
        logging.getLogger("flexfmu").info(text)

    def warning(self, text: str) -> None:
        """Warn of what the user should look at."""
        warnings.warn(text, stacklevel=2)


SILENT, SCRIPT = Reporter(), ScriptReporter()


def progress_words(done: float, total: float, unit: str, elapsed: float) -> str:
    """How far a job is and how long it will still take, at the mean pace so far.

    Parameters
    ----------
    done, total : float
    unit : str
    elapsed : float
        s.

    Returns
    -------
    str
        As "3 of 12 models, 40 s left".
    """
    words = f"{done:.6g} of {total:.6g} {unit}".rstrip()
    return words if done <= 0.0 else f"{words}, {duration_words(elapsed * max(total - done, 0.0) / done)} left"


def duration_words(seconds: float) -> str:
    """A time as a person would say it: 40 s, 3 min, 1.5 h."""
    if seconds >= _HOURS:
        return f"{seconds / _HOURS:.1f} h"
    return f"{seconds / _MINUTES:.0f} min" if seconds >= 2.0 * _MINUTES else f"{seconds:.0f} s"


def tell_nobody(_done: float) -> None:
    """Say nothing."""


@contextmanager
def keeps_interrupts() -> Iterator[None]:
    """Let no Ctrl-C be lost in what is enclosed.

    Python drops a KeyboardInterrupt that rises amid a callback of its own (of a weak reference, or `__del__`), and
    prints it. Here it is not printed, and rises anew where a `ConsoleReporter` is told of progress next.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is not signal.default_int_handler:
        yield
        return

    hook = sys.unraisablehook

    def note(number: int, frame: FrameType | None) -> None:
        _PRESSED.set()
        signal.default_int_handler(number, frame)

    def dropped(what: Any) -> None:
        if what.exc_type is not KeyboardInterrupt:
            hook(what)

    _PRESSED.clear()
    signal.signal(signal.SIGINT, note)
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook
        _PRESSED.clear()


def end_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that was lost, if one was."""
    if _PRESSED.is_set():
        _PRESSED.clear()
        raise KeyboardInterrupt


@contextmanager
def ends_on_interrupt(report: Reporter) -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C end a job at a place of its own choice, with its results so far, instead of anywhere.

    A KeyboardInterrupt may otherwise rise inside an FMU's Python code, which makes an error of it. A second Ctrl-C does
    what it always does.

    Parameters
    ----------
    report : Reporter

    Yields
    ------
    callable
        Whether Ctrl-C was pressed; ask it where the job can end.
    """
    pressed, before = threading.Event(), signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (signal.SIG_IGN, None):
        # Signals reach the main thread only; a job in the background may be meant to go on.
        yield pressed.is_set
        return

    def note(_number: int, _frame: FrameType | None) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, before)
        # The signal may come amid another line.
        with suppress(RuntimeError):
            report.note("Ctrl-C: ends after the step under way; press it again to end at once")

    signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)


PICTURE_SUFFIXES = (".png", ".pdf", ".svg")


def check_target(path: Path | None, suffixes: Collection[str], inputs: Collection[Path | None] = ()) -> None:
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
    if path is None:
        return
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
    for source in filter(None, inputs):
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
        beside = tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent, ignore_cleanup_errors=True)
        with beside as folder:
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
    from importlib.resources import files

    # Nothing in the data may end the script.
    text = json.dumps(_plain(content), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    folder = files(package or "")
    template, *more = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", *scripts))
    return template.replace("@LIVE@", "".join(more)).replace("@TITLE@", escape(title)).replace("@DATA@", text)


def fields_of(value: object) -> dict[str, Any]:
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
