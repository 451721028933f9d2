"""Results of expensive stages, kept on disk by what they were made from, so that no build does them twice.

A version number would not do: it stays the same from change to change.
"""

import hashlib
import math
import os
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .basics import FloatArray
from .outputs import Reporter, fields_of, whole_file

_PACKAGE, _CODE = __name__.partition(".")[0], (".py", ".c", ".h", ".def")
_ROOT = Path(__file__).parents[2]
# Another version of these may give other numbers; the last two need not be there.
_LIBRARIES = ("numpy", "scipy", "pymetis", "pypardiso", "mkl")


@cache
def code_digest() -> str:
    """Hash of all files of this package that hold code, and the versions of the libraries: 12 hexadecimal digits."""
    files = [path for path in sorted((_ROOT / _PACKAGE).rglob("*")) if path.suffix in _CODE]
    return _hash([(path.name, hashlib.sha256(path.read_bytes()).digest()) for path in files], _versions())[:12]


@cache
def _versions() -> dict[str, str]:
    """Versions of the libraries that are there."""
    # Its import takes a tenth of a second, and `flexfmu info` needs no key.
    from importlib.metadata import PackageNotFoundError, version

    found = {}
    for library in _LIBRARIES:
        with suppress(PackageNotFoundError):
            found[library] = version(library)
    return found


REUSED = "taken from an earlier build"
"""What a note says of a result that was kept."""
FOLDER_VARIABLE = "FLEXFMU_CACHE"
"""Environment variable that names the folder; empty: nothing is kept."""
# The largest part of the disk that all entries may take; the longest unused go first.
_LARGEST = 8 * 2**30
# Name under which an entry's checksum lies among its arrays.
_CHECK = "checksum"


def content_key(made_by: str, *parts: object) -> str:
    """Hash of what a result depends on: the code that makes it, and what goes in.

    Parameters
    ----------
    made_by : str
        Module that makes it, `__name__`.
    *parts : arrays, or anything whose representation says what it is

    Returns
    -------
    str
    """
    return _hash(code_digest(), made_by, *parts)


def _hash(*parts: object) -> str:
    digest = hashlib.sha256()
    for part in _flat(parts):
        if isinstance(part, np.ndarray):
            digest.update(f"\0{part.dtype.str}{part.shape}\0".encode())
            digest.update(np.ascontiguousarray(part).data)
        else:
            digest.update(f"\0{part!r}\0".encode())
    return digest.hexdigest()


def _flat(part: Any) -> Iterator[Any]:
    """Arrays and plain values that something is made of: dataclasses, tables, tuples and sparse matrices are."""
    if hasattr(part, "indptr"):
        part = part.shape, part.data, part.indices, part.indptr
    elif is_dataclass(part):
        # As it was made: nothing is found for the key's sake.
        held = getattr(part, "__dict__", None) or fields_of(part)
        part = tuple(held[one.name] for one in fields(part))
    elif isinstance(part, Mapping):
        part = tuple(part.items())
    elif isinstance(part, bytes):
        part = np.frombuffer(part, np.uint8)
    yield from (len(part), *(one for inner in part for one in _flat(inner))) if isinstance(part, tuple) else (part,)


def _checksum(key: str, arrays: Mapping[str, FloatArray]) -> str:
    """Hash of an entry and of the key under which it is kept: one that was renamed is as good as damaged."""
    return _hash(key, *(part for name in sorted(arrays) for part in (name, arrays[name])))


def default_folder() -> Path | None:
    """Where results are kept: what the environment names, else the user's cache folder."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named is not None:
        return Path(named) if named else None
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData" / "Local")))
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")))
    return base / "flexfmu"


class Store:
    """A folder of results by key, without one nothing is kept there; and in memory what was made last.

    Parameters
    ----------
    folder : Path or None
    """

    def __init__(self, folder: Path | None = None):
        self.folder = folder
        self._last: dict[str, tuple[str, Any]] = {}
        self._unseen = math.inf  # bytes written since the folder was last looked through

    def last(self, kind: str, key: str, make: Callable[[], Any]) -> Any:
        """What was made last of a kind, if it was for this key; else make it: there is room for one factorisation."""
        if self._last.get(kind, ("",))[0] != key:
            self._last.pop(kind, None)
            self._last[kind] = key, make()
        return self._last[kind][1]

    def arrays(
        self, key: str, what: str, report: Reporter, make: Callable[[], Mapping[str, FloatArray]]
    ) -> dict[str, FloatArray]:
        """Return what is kept under a key, or make it and keep it; a disk that is full or damaged is no reason to fail.

        Parameters
        ----------
        key : str
        what : str
            In words, for the report.
        report : Reporter
        make : callable
            Called where nothing is kept.

        Returns
        -------
        dict of str to array
        """
        found = self._read(key)
        if found:
            report.detail(f"{what}: {REUSED}")
            return found
        if found is not None:
            report.warning(f"{what}: what was kept of it is damaged; made anew")
        made = {name: np.asarray(array) for name, array in make().items()}
        self._write(key, made)
        return made

    def _path(self, key: str) -> Path | None:
        return None if self.folder is None else self.folder / f"{key}.npz"

    def _read(self, key: str) -> dict[str, FloatArray] | None:
        """Arrays of an entry: None where there is none, nothing where it is damaged or not what it says."""
        path = self._path(key)
        if path is None or not path.is_file():
            return None
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
                found = dict(content)
            sound = str(found.pop(_CHECK)) == _checksum(key, found)
            path.touch()
        except (OSError, ValueError, EOFError, KeyError, NotImplementedError, zipfile.BadZipFile, zlib.error):
            return {}
        return found if sound else {}

    def _write(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        path = self._path(key)
        if path is None:
            return
        # Only speed depends on it.
        with suppress(Exception):
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(path) as part, part.open("wb") as file:
                contents: dict[str, Any] = {_CHECK: np.array(_checksum(key, arrays)), **arrays}
                np.savez(file, **contents)
            self._unseen += path.stat().st_size
            # To look through thousands of entries takes longer than to write one.
            if self._unseen > _LARGEST / 100:
                self._make_room(path.parent)
                self._unseen = 0.0

    @staticmethod
    def _make_room(folder: Path) -> None:
        """Remove the longest unused entries until the rest fit."""
        entries = sorted(((p.stat().st_mtime, p.stat().st_size, p) for p in folder.glob("*.npz")), reverse=True)
        total = 0
        for _, size, path in entries:
            total += size
            if total > _LARGEST:
                path.unlink(missing_ok=True)
